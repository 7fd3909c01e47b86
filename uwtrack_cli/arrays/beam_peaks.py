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
from typing import Any, NamedTuple

import numpy as np

from uwtrack_cli.arrays.array_place import ArrayPlace
from uwtrack_cli.arrays.line_array import LineArray, angle_std_deg
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.estimation.noise_floor import noise_floor
from uwtrack_cli.estimation.window import (
    NOISE_BANDWIDTH_BINS,
    frequency_std_hz,
    peak_offset_bins,
)
from uwtrack_cli.spectra.peaks import peak_power, threshold_factors, with_noise

SPARE_DB = 3.0
"""What a peak may lie below the strongest of its cell less than the sidelobes, dB."""

BENT_DEG = 0.5
"""Bend of the array from which its bearings are not given, degrees."""


@dataclass(frozen=True, eq=False)
class Beams:
    """The beams of a block, and what is known of the array that made them."""

    array: LineArray
    """The hydrophones."""
    weights: FloatArray
    """Their weights in this block."""
    cos_angle: FloatArray
    """Cosines of the beams."""
    frequency_hz: FloatArray
    """Frequency of every cell, Hz."""
    power: FloatArray
    """Power density, shape (beam, frame, cell)."""
    frames: Frames
    """Time base."""
    place: ArrayPlace
    """Where the array was."""

    @property
    def padding(self) -> int:
        """Cells per natural bin."""
        return max(1, round(self.frames.fft_length / self.frames.window_samples))


@dataclass(frozen=True)
class PeakRules:
    """What counts as a peak, and how its bearing is written."""

    false_alarm_probability: float
    """Exceedance rate per beam and cell at which a peak is a detection."""
    kept_probability: float
    """The same for the weakest peaks kept."""
    sidelobe_db: float
    """Sidelobes of the beams below their main lobe, dB."""
    side: str
    """Side that bearings are written for, starboard or port."""
    compass: bool
    """Whether there are compass bearings, and not angles alone."""
    reference: str
    """Reference of the levels."""


def beam_floors(power: FloatArray, frames: Frames) -> FloatArray:
    """Return the noise density of every beam by itself, shape (beam, frame, cell).

    Parameters
    ----------
    power
        Power density of the beams, same shape.
    frames
        Time base.
    """
    valid = frames.valid_fraction
    padding = max(1, round(frames.fft_length / frames.window_samples))
    return noise_floor(power, valid, zero_padding=padding)


def median_of_beams(floor: FloatArray) -> FloatArray:
    """Return the median over the beams of their noise density, shape (frame, cell).

    Parameters
    ----------
    floor
        Noise density, shape (beam, frame, cell); nan where a frame has none.
    """
    # a partition by one rank takes a third of the time of np.median
    middle = len(floor) // 2
    ordered = np.partition(floor, middle, axis=0)
    noise: FloatArray = ordered[middle]
    if len(floor) % 2 == 0:
        noise = 0.5 * (noise + ordered[:middle].max(axis=0))
    return noise


def find_beam_peaks(
    beams: Beams, floor: FloatArray, noise: FloatArray, rules: PeakRules
) -> Peaks:
    """Find the peaks of a block of beams.

    Parameters
    ----------
    beams
        The beams.
    floor
        Noise density of each of them, same shape as their power.
    noise
        Its median over the beams, shape (frame, cell).
    rules
        What counts as a peak.

    Returns
    -------
    Peaks
        In the order of frame and frequency.
    """
    frames, padding = beams.frames, beams.padding
    detect, keep = (
        threshold_factors(frames, beams.frequency_hz.size, padding, probability)
        for probability in (rules.false_alarm_probability, rules.kept_probability)
    )
    at = _maxima(beams, floor, keep, rules.sidelobe_db)
    measured = _measure(beams, floor, *at)
    frame = at[1]
    snr = np.maximum(measured["ratio"] - 1.0, 0.1 * measured["ratio"])
    cosine = np.clip(measured["cosine"], -1.0, 1.0)
    cone_deg = np.degrees(np.arccos(cosine))
    std_deg = angle_std_deg(
        cosine, beams.array.cosine_std(snr, measured["frequency_hz"], beams.weights)
    )
    side = 1.0 if rules.side == "starboard" else -1.0
    bearing = (beams.place.heading_deg[frame] + side * cone_deg) % 360.0
    is_known = rules.compass & ~(beams.place.bend_deg[frame] > BENT_DEG)
    bent = beams.place.bend_deg > BENT_DEG
    heading = np.where(bent, np.nan, beams.place.heading_deg)
    return Peaks(
        frames=replace(
            with_noise(frames, beams.frequency_hz, noise, detect),
            array_heading_deg=heading if rules.compass else None,
        ),
        frame=frame + frames.first_frame,
        frequency_hz=measured["frequency_hz"],
        frequency_std_hz=frequency_std_hz(snr, frames.window_s),
        level_db=10 * np.log10(measured["line_power"]),
        snr_db=10 * np.log10(snr),
        bearing_deg=np.where(is_known, bearing, np.nan),
        bearing_std_deg=np.where(is_known, std_deg, np.nan),
        is_detection=beams.power[at] > detect[frame] * floor[at],
        cone_deg=cone_deg,
        cone_std_deg=std_deg,
        is_aliased=beams.array.is_aliased(measured["frequency_hz"], cosine),
        false_alarm_probability=rules.false_alarm_probability,
        kept_probability=rules.kept_probability,
        reference=rules.reference,
        lowest_hz=float(beams.frequency_hz[0]),
        highest_hz=float(beams.frequency_hz[-1]),
    )


def cells_above(
    power: FloatArray, floor: FloatArray, keep: FloatArray, padding: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the cells above the threshold that no cell beside them in frequency exceeds.

    Parameters
    ----------
    power, floor
        Power and noise density of the beams, shape (beam, frame, cell).
    keep
        Threshold over the floor, per frame.
    padding
        Cells per natural bin, within which a maximum is the largest.

    Returns
    -------
    tuple
        Beams, frames and cells; the outermost natural bin is left out.
    """
    cells = slice(padding, power.shape[2] - padding)
    threshold = floor[:, :, cells] * keep[:, None].astype(np.float32)
    # noise seldom reaches the threshold: the neighbours of few cells are looked at
    beam, frame, cell = np.nonzero(power[:, :, cells] > threshold)
    cell += padding
    height = power[beam, frame, cell]
    is_peak = np.ones(cell.size, bool)
    for shift in range(1, padding + 1):
        is_peak &= height >= power[beam, frame, cell - shift]
        is_peak &= height > power[beam, frame, cell + shift]
    return beam[is_peak], frame[is_peak], cell[is_peak]


def _maxima(
    beams: Beams, floor: FloatArray, keep: FloatArray, sidelobe_db: float
) -> tuple[IntArray, IntArray, IntArray]:
    """Beams, frames and cells of the maxima, in the order of frame and cell."""
    power = beams.power
    beam, frame, cell = cells_above(power, floor, keep, beams.padding)
    inside = (beam > 0) & (beam < len(power) - 1)
    beam, frame, cell = beam[inside], frame[inside], cell[inside]
    height = power[beam, frame, cell]
    share = np.float32(10.0 ** (-(sidelobe_db - SPARE_DB) / 10.0))
    is_peak = height >= power[beam - 1, frame, cell]
    is_peak &= height > power[beam + 1, frame, cell]
    is_peak &= height > share * power.max(axis=0)[frame, cell]
    beam, frame, cell = beam[is_peak], frame[is_peak], cell[is_peak]
    order = np.lexsort((beam, cell, frame))
    return beam[order], frame[order], cell[order]


def _measure(
    beams: Beams, floor: FloatArray, beam: IntArray, frame: IntArray, cell: IntArray
) -> dict[str, Any]:
    """Interpolate in direction and frequency; both corrections of the direction."""
    power = beams.power
    offset_bins, step_bins, natural_bin_hz = bin_offsets(
        power, beams.frames, beam, frame, cell
    )
    frequency_hz = beams.frequency_hz[cell] + offset_bins * natural_bin_hz
    around = [power[beam + k, frame, cell].astype(np.float64) for k in (-1, 0, 1)]
    left, centre, right = (np.log(np.maximum(p, 1e-37)) for p in around)
    curvature = np.minimum(left + right - 2.0 * centre, -1e-12)
    part = np.clip(0.5 * (left - right) / curvature, -0.5, 0.5)
    step = float(beams.cos_angle[1] - beams.cos_angle[0])
    seen = beams.cos_angle[beam] + part * step
    speed = beams.place.speed_mps[frame] / beams.array.sound_speed_mps
    cosine = seen * (beams.frequency_hz[cell] / frequency_hz) / (1.0 - speed * seen)
    at_beam = np.exp(centre - 0.25 * (left - right) * part)
    peak = peak_power(at_beam, offset_bins, step_bins)
    return {
        "frequency_hz": frequency_hz,
        "cosine": cosine,
        "ratio": peak / floor[beam, frame, cell],
        "line_power": peak * NOISE_BANDWIDTH_BINS * natural_bin_hz,
    }


class BinOffsets(NamedTuple):
    """How far tones lie from their cells."""

    offset_bins: FloatArray
    """Offsets in natural bins, one for each tone."""
    step_bins: float
    """Distance of cells in natural bins."""
    natural_bin_hz: float
    """Width of a natural bin, Hz."""


def bin_offsets(
    power: FloatArray, frames: Frames, beam: IntArray, frame: IntArray, cell: IntArray
) -> BinOffsets:
    """Return how far tones lie from their cells, in natural bins.

    Parameters
    ----------
    power
        Power of the beams, shape (beam, frame, cell).
    frames
        Time base.
    beam, frame, cell
        Where the maxima are.
    """
    step_bins = frames.window_samples / frames.fft_length
    beside = [power[beam, frame, cell + k].astype(np.float64) for k in (-1, 0, 1)]
    offset = peak_offset_bins(beside[0], beside[1], beside[2], step_bins)
    return BinOffsets(offset, step_bins, frames.bin_hz / step_bins)
