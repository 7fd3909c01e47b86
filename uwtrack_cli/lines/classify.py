"""Harmonic families among the peaks of single frames.

**Method.** Vessels emit lines at equal distances (shaft, blade and firing rates). Each
frame is searched for combs by the a-contrario test (`lines.families.comb_test`), gated by
bearing: a family is reported when fewer than ``chance`` such combs are expected
from peaks at random. That rate needs no calibration and is conservative.

**Conventions.** Only detections are searched, the loudest ``most_peaks`` of a frame.
A family's number is unique in a recording.

**References.** Desolneux, Moisan & Morel, "From Gestalt Theory to Image Analysis"
(2008); Choi (2014) for families as the births of lines.
"""

from typing import Annotated, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.lines.families.comb_test import TOLERANCE_SIGMAS, CombRule
from uwtrack_cli.lines.families.harmonics import Comb, CombFit, comb_fit, find_combs

_MOST_FAMILIES = 64
"""Families that a frame may have; their numbers are frame * this + rank."""

_FEWEST_MEMBERS = 3
"""Peaks that a family needs; frames with fewer are not searched."""

_LEAST_JITTER = 0.1
"""Floor of a peak's deviation in resolutions: lines are never perfectly steady."""


class _Row(NamedTuple):
    """A family of one frame."""

    family: int
    """Number of the family."""
    comb: Comb
    """Its members."""
    fit: CombFit
    """Its spacing and offset."""


@checked
def classify_peaks(
    peaks: Peaks,
    *,
    chance: Annotated[float, Above(0), AtMost(1)] = 0.1,
    spacing_hz: Annotated[
        tuple[float, float], Unit("Hz"), AtLeast(1e-3), AtMost(1e6), Increasing()
    ] = (2.0, 60.0),
    teeth: Annotated[int, AtLeast(2), AtMost(63)] = 18,
    bearing_window_deg: Annotated[float, Unit("degree"), Above(0), AtMost(360)] | None = None,
    most_peaks: Annotated[int, AtLeast(3), AtMost(500)] = 40,
) -> Families:
    """Find the harmonic families in each frame.

    The spacing of a family is a vessel's shaft or blade rate, so a family is a
    better sign of a vessel than any single line.

    Parameters
    ----------
    peaks
        Spectral peaks.
    chance
        Expected number of families by chance in a frame.
    spacing_hz
        Least and greatest distance of neighbouring teeth in Hz.
    teeth
        Most spacings from one end of a family to the other.
    bearing_window_deg
        Greatest difference of bearings in degrees; None: from their deviations.
    most_peaks
        Peaks of a frame that are searched at most, loudest first.

    Returns
    -------
    Families
        One row per family and frame; it carries the peaks.

    Raises
    ------
    OptionError
        An option is out of range.

    Notes
    -----
    A chance of 0.1 was measured to mean at most one false family in 90 frames of
    noise, a chance of 0.01 at most one in 800.
    """
    rows: list[_Row] = []
    peak_family = np.full(peaks.frame.size, -1, dtype=np.int64)
    loud = np.flatnonzero(peaks.is_detection)
    frames, starts = np.unique(peaks.frame[loud], return_index=True)
    for frame, members in zip(frames, np.split(loud, starts)[1:], strict=True):
        if members.size < _FEWEST_MEMBERS:
            continue
        chosen = _loudest(peaks, members, most_peaks)
        rule = _rule(peaks, chosen, spacing_hz, teeth, bearing_window_deg)
        frequency = peaks.frequency_hz[chosen]
        bearing = peaks.bearing_deg[chosen].astype(float)
        combs, _ = find_combs(frequency, bearing, rule, chance)
        for rank, comb in enumerate(combs[:_MOST_FAMILIES]):
            fit = comb_fit(frequency[comb.members], comb.teeth, rule.sigma_hz)
            number = int(frame) * _MOST_FAMILIES + rank
            rows.append(_Row(number, comb, fit))
            peak_family[chosen[comb.members]] = number
    return _table(rows, peak_family, peaks)


def _loudest(peaks: Peaks, members: IntArray, most: int) -> IntArray:
    if members.size <= most:
        return members
    order = np.argsort(-peaks.snr_db[members], kind="stable")[:most]
    return np.sort(members[order])


def _rule(
    peaks: Peaks,
    chosen: IntArray,
    spacing_hz: tuple[float, float],
    teeth: int,
    bearing_window_deg: float | None,
) -> CombRule:
    sigma = float(np.median(peaks.frequency_std_hz[chosen]))
    sigma = max(sigma, _LEAST_JITTER / peaks.frames.window_s)
    window = bearing_window_deg
    if window is None:
        window = _usual_window_deg(peaks.bearing_std_deg[chosen])
    band = peaks.highest_hz - peaks.lowest_hz
    return CombRule(spacing_hz, teeth, sigma, window, band)


def _usual_window_deg(deviations: FloatArray) -> float:
    known = deviations[np.isfinite(deviations)]
    if not known.size:
        return 180.0
    return float(TOLERANCE_SIGMAS * np.sqrt(2.0) * np.median(known))


def _table(rows: list[_Row], peak_family: IntArray, peaks: Peaks) -> Families:
    number = np.array([row.family for row in rows], dtype=np.int64)
    return Families(
        family=number,
        frame=number // _MOST_FAMILIES,
        spacing_hz=np.array([row.fit.spacing_hz for row in rows]),
        spacing_std_hz=np.array([row.fit.spacing_std_hz for row in rows]),
        offset_hz=np.array([row.fit.offset_hz for row in rows]),
        is_harmonic=np.array([row.fit.is_harmonic for row in rows], dtype=bool),
        n_members=np.array([row.comb.members.size for row in rows]),
        log10_chance=np.array([row.comb.log10_chance for row in rows]),
        peak_family=peak_family,
        peaks=peaks,
    )
