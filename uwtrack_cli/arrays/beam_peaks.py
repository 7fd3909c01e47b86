"""Peaks in frequency and direction, from the power of all beams.

**Method.** A peak is a cell that is the largest among its neighbours in frequency (one
natural bin) and in direction (the beams beside it), in raw power; the floor of its own
beam, estimated as for one hydrophone, sets the threshold alone. Normalised first, the
maximum would lean to where the noise is less. Direction and frequency are interpolated,
and the direction is corrected for the place of the tone in its bin and for the array's
own speed.

**Conventions.** Power has shape (beam, frame, cell). Sidelobes are no vessels: a peak
that is lower than the strongest of its cell by more than the sidelobes is dropped.

**References.** Rohling 1983 for the threshold, as in `uwtrack_cli.spectra.peaks`;
Rife & Boorstyn 1974 for the deviation of the frequency.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uwtrack_cli.arrays.array_place import ArrayPlace
from uwtrack_cli.arrays.line_array import LineArray, angle_std_deg
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.noise_floor import noise_floor
from uwtrack_cli.estimation.window import parabola_offset
from uwtrack_cli.spectra.peaks import Tones, threshold_factors, tones_in, with_noise

SPARE_DB = 3.0
"""What a peak may lie below the strongest of its cell less than the sidelobes, dB."""

BENT_DEG = 0.5
"""Bend of the array from which its bearings are not given, degrees."""

BEAMS_AT_ONCE = 64
"""Beams that are held against their floors at once."""

Maxima = tuple[IntArray, IntArray, IntArray]
"""Beams, frames and cells of some maxima."""


@dataclass(frozen=True)
class PeakRules:
    """What counts as a peak, and how its bearing is written."""

    false_alarm_probability: float
    """Exceedance rate per beam and cell at which a peak is a detection."""
    kept_probability: float
    """The same for the weakest peaks kept."""
    side: str
    """Side that bearings are written for, starboard or port."""
    compass: bool
    """Whether there are compass bearings, and not angles alone."""
    reference: str
    """Reference of the levels."""


@dataclass(frozen=True, eq=False)
class FormedBeams:
    """The beams of a block, and where the array was that made them."""

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

    def thresholds(self, rules: PeakRules) -> tuple[FloatArray, FloatArray]:
        """Return the factors over the floor of detections and of peaks kept, per frame."""
        detect, keep = (
            threshold_factors(self.frames, self.frequency_hz.size, probability)
            for probability in (rules.false_alarm_probability, rules.kept_probability)
        )
        return detect, keep

    def tones(self, at: Maxima) -> Tones:
        """Interpolate the tones of some maxima."""
        beam, frame, cell = at
        three = [self.power[beam, frame, cell + k] for k in (-1, 0, 1)]
        return tones_in(self.frames, self.frequency_hz[cell], three)

    def peaks(
        self, at: Maxima, rules: PeakRules, bearing: tuple[FloatArray, FloatArray], **own: Any
    ) -> Peaks:
        """Return the table of some maxima; bearings of a bent array are not given.

        ``bearing`` are compass bearings and their deviations, degrees, ``own`` the
        other columns of `Peaks`.
        """
        is_known = rules.compass & ~(self.place.bend_deg[at[1]] > BENT_DEG)
        bearing_deg, std_deg = (np.where(is_known, each, np.nan) for each in bearing)
        return Peaks(
            frame=at[1] + self.frames.first_frame,
            bearing_deg=bearing_deg,
            bearing_std_deg=std_deg,
            false_alarm_probability=rules.false_alarm_probability,
            kept_probability=rules.kept_probability,
            reference=rules.reference,
            lowest_hz=float(self.frequency_hz[0]),
            highest_hz=float(self.frequency_hz[-1]),
            **own,
        )


@dataclass(frozen=True, eq=False)
class Beams(FormedBeams):
    """The beams of a line array."""

    array: LineArray
    """The hydrophones."""
    cos_angle: FloatArray
    """Cosines of the beams."""


def beam_floors(power: FloatArray, frames: Frames) -> FloatArray:
    """Return the noise density of every beam by itself, shape (beam, frame, cell)."""
    padding = frames.cells_per_bin
    return noise_floor(power, frames.valid_fraction, zero_padding=padding)


def median_of_beams(floor: FloatArray) -> FloatArray:
    """Return the median over the beams of their noise density, shape (frame, cell).

    nan where a frame has none.
    """
    # a partition by one rank takes a third of the time of np.median
    middle = len(floor) // 2
    ordered = np.partition(floor, middle, axis=0)
    noise: FloatArray = ordered[middle]
    if len(floor) % 2 == 0:
        noise = 0.5 * (noise + ordered[:middle].max(axis=0))
    return noise


def find_beam_peaks(beams: Beams, floor: FloatArray, noise: FloatArray, rules: PeakRules) -> Peaks:
    """Find the peaks of a block of beams, in the order of frame and frequency.

    The noise density of each beam has the shape of their power, its median over the
    beams (frame, cell).
    """
    frames, place = beams.frames, beams.place
    detect, keep = beams.thresholds(rules)
    at = _maxima(beams, floor, keep)
    tones = beams.tones(at)
    cosine, height = _directions(beams, tones, at)
    cosine_std = beams.array.cosine_std(
        tones.snr(height, floor[at]), tones.frequency_hz, beams.weights
    )
    cone_deg = np.degrees(np.arccos(cosine))
    std_deg = angle_std_deg(cosine, cosine_std)
    side = 1.0 if rules.side == "starboard" else -1.0
    bearing = (place.heading_deg[at[1]] + side * cone_deg) % 360.0
    heading = np.where(place.bend_deg > BENT_DEG, np.nan, place.heading_deg)
    return beams.peaks(
        at,
        rules,
        (bearing, std_deg),
        frames=replace(
            with_noise(frames, beams.frequency_hz, noise, detect),
            array_heading_deg=heading if rules.compass else None,
        ),
        **tones.columns(height, floor[at]),
        is_detection=beams.power[at] > detect[at[1]] * floor[at],
        cone_deg=cone_deg,
        cone_std_deg=std_deg,
        is_aliased=beams.array.lobe_cosine(tones.frequency_hz) < 2.0,
    )


def cells_above(
    power: FloatArray,
    floor: FloatArray,
    keep: FloatArray,
    padding: int,
    owner: IntArray | None = None,
) -> Maxima:
    """Return cells above the threshold that none beside them in frequency exceeds.

    Power and noise density have the shape (beam, frame, cell); the threshold over the
    floor is per frame. ``owner``: row of every beam's floor; None: one for each. A maximum is the largest within ``padding`` cells, a natural
    bin; the outermost ones are left out.
    """
    cells = slice(padding, power.shape[2] - padding)
    parts = []
    for first in range(0, len(power), BEAMS_AT_ONCE):
        some = slice(first, first + BEAMS_AT_ONCE)
        own = floor[some] if owner is None else floor[owner[some]]
        threshold = own[:, :, cells] * keep[:, None].astype(np.float32)
        beam, frame, cell = np.nonzero(power[some, :, cells] > threshold)
        parts.append((beam + first, frame, cell + padding))
    # noise seldom reaches the threshold: the neighbours of few cells are looked at
    beam, frame, cell = (np.concatenate(one) for one in zip(*parts, strict=True))
    height = power[beam, frame, cell]
    is_peak = np.ones(cell.size, bool)
    for shift in range(1, padding + 1):
        is_peak &= height >= power[beam, frame, cell - shift]
        is_peak &= height > power[beam, frame, cell + shift]
    return beam[is_peak], frame[is_peak], cell[is_peak]


def _maxima(beams: Beams, floor: FloatArray, keep: FloatArray) -> Maxima:
    """Beams, frames and cells of the maxima, in the order of frame and cell."""
    power = beams.power
    beam, frame, cell = cells_above(power, floor, keep, beams.frames.cells_per_bin)
    inside = (beam > 0) & (beam < len(power) - 1)
    beam, frame, cell = beam[inside], frame[inside], cell[inside]
    height = power[beam, frame, cell]
    sidelobe_db = beams.array.sidelobe_db(beams.weights)
    share = np.float32(10.0 ** (-(sidelobe_db - SPARE_DB) / 10.0))
    is_peak = height >= power[beam - 1, frame, cell]
    is_peak &= height > power[beam + 1, frame, cell]
    is_peak &= height > share * power.max(axis=0)[frame, cell]
    # one of the lobes of a line, which all lie at equal distances, stands for all of them
    around = beams.cos_angle[beam] / beams.array.lobe_cosine(beams.frequency_hz[cell])
    is_peak &= (around >= -0.5) & (around < 0.5)
    beam, frame, cell = beam[is_peak], frame[is_peak], cell[is_peak]
    order = np.lexsort((beam, cell, frame))
    return beam[order], frame[order], cell[order]


def _directions(beams: Beams, tones: Tones, at: Maxima) -> tuple[FloatArray, FloatArray]:
    """Return the cosines of tones, both corrections made, and their power at them."""
    beam, frame, cell = at
    around = [beams.power[beam + k, frame, cell].astype(np.float64) for k in (-1, 0, 1)]
    left, centre, right = (np.log(np.maximum(p, 1e-37)) for p in around)
    part = parabola_offset(left, centre, right)
    step = float(beams.cos_angle[1] - beams.cos_angle[0])
    seen = beams.cos_angle[beam] + part * step
    speed = beams.place.speed_mps[frame] / beams.array.sound_speed_mps
    cosine = seen * (beams.frequency_hz[cell] / tones.frequency_hz)
    cosine = np.clip(cosine / (1.0 - speed * seen), -1.0, 1.0)
    return cosine, np.exp(centre - 0.25 * (left - right) * part)
