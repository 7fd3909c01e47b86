"""Peaks in frequency and direction of a planar or volume array.

**Method.** As for a line array (`beam_peaks`): maxima in raw power among the cells and
the beams beside, a threshold from the floor of each beam. Directions are refined by a
paraboloid over the beams beside, and corrected for the tone's place in its bin and for
the array's own speed. Where the array is sparse for its band other lobes are nearly as
high as the main one: peaks there are marked, not left out.

**Conventions.** Power has shape (beam, frame, cell).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.arrays.beam_peaks import SPARE_DB, FormedBeams, Maxima, PeakRules, cells_above
from uwtrack_cli.arrays.direction_grid import LOBE_DB, DirectionGrid, SpatialArray, highest_lobe
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.spectra.peaks import with_noise

LOBE_POINTS = 12
"""Frequencies of the band at which the lobes are looked at."""


@dataclass(frozen=True, eq=False)
class Lobes:
    """The highest lobe beside the main one over frequency."""

    frequency_hz: FloatArray
    """Frequencies, Hz."""
    share: FloatArray
    """Its power as a share of the main lobe's."""

    @classmethod
    def of(cls, array: SpatialArray, grid: DirectionGrid, frequency_hz: FloatArray) -> "Lobes":
        """Look at an array over a band."""
        some = np.linspace(frequency_hz[0], frequency_hz[-1], LOBE_POINTS)
        return cls(some, np.array([highest_lobe(array, grid, f) for f in some]))

    def at(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the lobe at other frequencies."""
        return np.interp(frequency_hz, self.frequency_hz, self.share)


@dataclass(frozen=True, eq=False)
class SpatialBeams(FormedBeams):
    """The beams of a planar or volume array."""

    array: SpatialArray
    """The hydrophones."""
    grid: DirectionGrid
    """Directions of the beams."""
    lobes: Lobes
    """Their sidelobes."""


@dataclass(frozen=True, eq=False)
class SharedFloor:
    """Noise density of the beams, of which neighbours share one."""

    density: FloatArray
    """Noise density of those that are estimated, shape (centre, frame, cell)."""
    owner: IntArray
    """Row of every beam's own, shape (beam,)."""

    def at(self, place: Maxima) -> FloatArray:
        """Return the density at some beams, frames and cells."""
        beam, frame, cell = place
        return np.asarray(self.density[self.owner[beam], frame, cell])


def find_spatial_peaks(
    beams: SpatialBeams, floor: SharedFloor, noise: FloatArray, rules: PeakRules
) -> Peaks:
    """Find the peaks of a block of beams, in the order of frame and frequency.

    ``noise`` is the median of the floors over the beams, shape (frame, cell).
    """
    detect, keep = beams.thresholds(rules)
    at = _maxima(beams, floor, keep)
    beam, frame, cell = at
    tones = beams.tones(at)
    around = np.concatenate([beam[:, None], beams.grid.neighbours[beam]], axis=1)
    values = beams.power[around, frame[:, None], cell[:, None]].astype(np.float64)
    toward, log_height = beams.grid.refine(beam, np.log(np.maximum(values, 1e-37)))
    height = np.exp(log_height)
    speed = beams.place.speed_mps[frame] / beams.array.sound_speed_mps
    if beams.array.is_planar:
        scale = beams.frequency_hz[cell] / tones.frequency_hz
        toward = toward * (scale / (1.0 - speed * toward[:, 1]))[:, None]
    known = beams.array.bearings(
        toward,
        beams.array.tone_covariance(
            tones.snr(height, floor.at(at)), tones.frequency_hz, beams.weights
        ),
        np.nan_to_num(beams.place.heading_deg[frame]),
    )
    return beams.peaks(
        at,
        rules,
        (known.bearing_deg, known.bearing_std_deg),
        frames=with_noise(beams.frames, beams.frequency_hz, noise, detect),
        **tones.columns(height, floor.at(at)),
        is_detection=beams.power[at] > detect[frame] * floor.at(at),
        elevation_deg=known.elevation_deg,
        elevation_std_deg=known.elevation_std_deg,
        is_aliased=beams.lobes.at(tones.frequency_hz) > 10.0 ** (-LOBE_DB / 10.0),
    )


def _maxima(beams: SpatialBeams, floor: SharedFloor, keep: FloatArray) -> Maxima:
    """Beams, frames and cells of the maxima, in the order of frame and cell."""
    power = beams.power
    beam, frame, cell = cells_above(
        power, floor.density, keep, beams.frames.cells_per_bin, floor.owner
    )
    heights = power[beam, frame, cell]
    lobe = beams.lobes.at(beams.frequency_hz[cell])
    spare = np.minimum(lobe * 10.0 ** (SPARE_DB / 10.0), 1.0)
    strongest = power.max(axis=0)[frame, cell]
    beside = power[beams.grid.neighbours[beam], frame[:, None], cell[:, None]]
    kept = heights > beside.max(axis=1)
    kept &= ~beams.grid.is_rim[beam] & (heights >= spare * strongest)
    order = np.lexsort((beam[kept], cell[kept], frame[kept]))
    return beam[kept][order], frame[kept][order], cell[kept][order]
