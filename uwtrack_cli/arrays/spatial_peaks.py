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

from uwtrack_cli.arrays.array_place import ArrayPlace
from uwtrack_cli.arrays.beam_peaks import (
    BENT_DEG,
    SPARE_DB,
    PeakRules,
    bin_offsets,
    cells_above,
)
from uwtrack_cli.arrays.direction_grid import (
    LOBE_DB,
    DirectionGrid,
    SpatialArray,
    highest_lobe,
)
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.window import NOISE_BANDWIDTH_BINS, frequency_std_hz
from uwtrack_cli.spectra.peaks import peak_power, threshold_factors, with_noise

LOBE_POINTS = 12
"""Frequencies of the band at which the lobes are looked at."""


BEAMS_AT_ONCE = 64
"""Beams that are held against their floors at once."""


@dataclass(frozen=True, eq=False)
class Lobes:
    """The highest lobe beside the main one over frequency."""

    frequency_hz: FloatArray
    """Frequencies, Hz."""
    share: FloatArray
    """Its power as a share of the main lobe's."""

    @classmethod
    def of(
        cls, array: SpatialArray, grid: DirectionGrid, frequency_hz: FloatArray
    ) -> "Lobes":
        """Look at an array over a band."""
        some = np.linspace(frequency_hz[0], frequency_hz[-1], LOBE_POINTS)
        return cls(some, np.array([highest_lobe(array, grid, f) for f in some]))

    def at(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the lobe at other frequencies."""
        return np.interp(frequency_hz, self.frequency_hz, self.share)


@dataclass(frozen=True, eq=False)
class SpatialBeams:
    """The beams of a block, and what is known of the array that made them."""

    array: SpatialArray
    """The hydrophones."""
    grid: DirectionGrid
    """Directions of the beams."""
    lobes: Lobes
    """Their sidelobes."""
    weights: FloatArray
    """Weights of the hydrophones in this block."""
    frequency_hz: FloatArray
    """Frequency of every cell, Hz."""
    power: FloatArray
    """Power density, shape (beam, frame, cell)."""
    frames: Frames
    """Time base."""
    place: ArrayPlace
    """Where the array was."""


@dataclass(frozen=True, eq=False)
class SharedFloor:
    """Noise density of the beams, of which neighbours share one."""

    density: FloatArray
    """Noise density of those that are estimated, shape (centre, frame, cell)."""
    owner: IntArray
    """Row of every beam's own, shape (beam,)."""

    def at(self, place: tuple[IntArray, IntArray, IntArray]) -> FloatArray:
        """Return the density at some beams, frames and cells."""
        beam, frame, cell = place
        return np.asarray(self.density[self.owner[beam], frame, cell])


def find_spatial_peaks(
    beams: SpatialBeams, floor: SharedFloor, noise: FloatArray, rules: PeakRules
) -> Peaks:
    """Find the peaks of a block of beams.

    Parameters
    ----------
    beams
        The beams.
    floor
        Noise density of each of them.
    noise
        Its median over the beams, shape (frame, cell).
    rules
        What counts as a peak.

    Returns
    -------
    Peaks
        In the order of frame and frequency.
    """
    frames = beams.frames
    padding = max(1, round(frames.fft_length / frames.window_samples))
    detect, keep = (
        threshold_factors(frames, beams.frequency_hz.size, padding, probability)
        for probability in (rules.false_alarm_probability, rules.kept_probability)
    )
    at = _maxima(beams, floor, keep, padding)
    beam, frame, cell = at
    offset, step_bins, bin_hz = bin_offsets(beams.power, frames, *at)
    frequency_hz = beams.frequency_hz[cell] + offset * bin_hz
    around = np.concatenate([beam[:, None], beams.grid.neighbours[beam]], axis=1)
    values = beams.power[around, frame[:, None], cell[:, None]].astype(np.float64)
    toward, height = beams.grid.refine(beam, np.log(np.maximum(values, 1e-37)))
    peak = peak_power(np.exp(height), offset, step_bins)
    ratio = peak / floor.at(at)
    snr = np.maximum(ratio - 1.0, 0.1 * ratio)
    speed = beams.place.speed_mps[frame] / beams.array.sound_speed_mps
    scale = beams.frequency_hz[cell] / frequency_hz / (1.0 - speed * toward[:, 1])
    if beams.array.is_planar:
        toward = toward * scale[:, None]
    known = beams.array.bearings(
        toward,
        beams.array.tone_covariance(snr, frequency_hz, beams.weights),
        np.nan_to_num(beams.place.heading_deg[frame]),
    )
    is_known = rules.compass & ~(beams.place.bend_deg[frame] > BENT_DEG)
    return Peaks(
        frames=with_noise(frames, beams.frequency_hz, noise, detect),
        frame=frame + frames.first_frame,
        frequency_hz=frequency_hz,
        frequency_std_hz=frequency_std_hz(snr, frames.window_s),
        level_db=10 * np.log10(peak * NOISE_BANDWIDTH_BINS * bin_hz),
        snr_db=10 * np.log10(snr),
        bearing_deg=np.where(is_known, known.bearing_deg, np.nan),
        bearing_std_deg=np.where(is_known, known.bearing_std_deg, np.nan),
        is_detection=beams.power[at] > detect[frame] * floor.at(at),
        elevation_deg=known.elevation_deg,
        elevation_std_deg=known.elevation_std_deg,
        is_aliased=beams.lobes.at(frequency_hz) > 10.0 ** (-LOBE_DB / 10.0),
        false_alarm_probability=rules.false_alarm_probability,
        kept_probability=rules.kept_probability,
        reference=rules.reference,
        lowest_hz=float(beams.frequency_hz[0]),
        highest_hz=float(beams.frequency_hz[-1]),
    )


def _maxima(
    beams: SpatialBeams, floor: SharedFloor, keep: FloatArray, padding: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Beams, frames and cells of the maxima, in the order of frame and cell."""
    power = beams.power
    parts = []
    for first in range(0, len(power), BEAMS_AT_ONCE):
        some = slice(first, first + BEAMS_AT_ONCE)
        own = floor.density[floor.owner[some]]
        beam, frame, cell = cells_above(power[some], own, keep, padding)
        parts.append((beam + first, frame, cell))
    beam, frame, cell = (np.concatenate(one) for one in zip(*parts, strict=True))
    heights = power[beam, frame, cell]
    lobe = beams.lobes.at(beams.frequency_hz[cell])
    spare = np.minimum(lobe * 10.0 ** (SPARE_DB / 10.0), 1.0)
    strongest = power.max(axis=0)[frame, cell]
    beside = power[beams.grid.neighbours[beam], frame[:, None], cell[:, None]]
    kept = heights > beside.max(axis=1)
    kept &= ~beams.grid.is_rim[beam] & (heights >= spare * strongest)
    order = np.lexsort((beam[kept], cell[kept], frame[kept]))
    return beam[kept][order], frame[kept][order], cell[kept][order]
