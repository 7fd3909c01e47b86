"""The test between two contacts: their filters and log likelihoods over scans.

**Method.** Under the hypothesis that the first contact moves, a moving filter follows the
first and a drifting filter the second; under the opposite the other way round. Every scan
in which both contacts are measured completely adds to the log odds, but for the first:
without an earlier track it says the same under both hypotheses, a range and a bearing
anywhere and a range rate of the same deviation.

A sequential test adds log likelihood ratios up until they leave an interval. Crossing its
upper end decides for the alternative, crossing the lower for the null hypothesis.

**Conventions.** As in `uwtrack_cli.discrimination.contact_filters`; the order of the
filters is: first moves, second drifts, first drifts, second moves, and then both moving
ones begun anew.

A miss is deciding for the null hypothesis when the alternative holds; a
false alarm is the opposite. Scans lie on the first axis, further axes are tests run
together.

**References.** Jeong and Hong (1996), equations 1-4 (sequential test) and 19-25, with
the sum of its four terms; Wald (1947); Siegmund (1985) for the overshoot.
"""

import math
import sys
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.discrimination.contact_filters import (
    GaussianSum,
    InnovationFit,
    Observation,
    inverse_range_deviation,
    predict_drift,
    predict_moving,
    separated,
    start_drift,
    start_moving,
    update_drift,
    update_moving,
)
from uwtrack_cli.discrimination.options import ContactFilters


@dataclass(frozen=True)
class EarlierTrack:
    """Track of a contact that was there before the second one."""

    state: GaussianSum
    """Its moving filter."""
    time_s: float
    """Time of the filter's state, s."""
    position: FloatArray
    """Own ship's east and north then, m, ``(..., 2)``."""


@dataclass(frozen=True)
class PairTest:
    """The filters over the scans of a pair, the first scan excluded."""

    log_density: FloatArray
    """Increments, ``(scan, 6, ...)``; 0 in scans that do not count."""
    distance2: FloatArray
    """Normalised squared innovations, ``(scan, 6, ...)``."""
    degrees: FloatArray
    """Their degrees of freedom, ``(scan, 6, ...)``."""
    inverse_range_std: FloatArray
    """Relative deviation of the inverse range at the end, ``(2, ...)``: second, first
    contact."""
    inverse_range_left: FloatArray
    """The same over that at the start, ``(2, ...)``."""

    @property
    def log_odds(self) -> FloatArray:
        """Log odds of "the second moves" after every scan, ``(scan, ...)``."""
        first_moves, second_drifts, first_drifts, second_moves = np.moveaxis(
            self.log_density[:, :4], 1, 0
        )
        steps = (second_moves - second_drifts) - (first_moves - first_drifts)
        return np.asarray(np.cumsum(steps, axis=0))


def follow(
    scans: list[Observation], times_s: FloatArray, filters: ContactFilters
) -> "EarlierTrack | None":
    """Track the one contact that is there before the second one.

    The first complete measurement starts the filter; None without one.
    """
    track: EarlierTrack | None = None
    for observation, now in zip(scans, times_s, strict=True):
        if track is not None:
            state, _ = _go_on(track, observation, float(now), filters)
        elif np.isfinite(observation.measured[..., :2]).all():
            state = start_moving(observation, filters.speed_std_mps, filters.intensities.size)
        else:
            continue
        track = EarlierTrack(state, float(now), observation.position)
    return track


def _go_on(
    track: EarlierTrack, observation: Observation, now: float, filters: ContactFilters
) -> tuple[GaussianSum, InnovationFit]:
    """Carry a moving filter to a scan."""
    ahead = predict_moving(
        track.state, now - track.time_s, observation.position - track.position,
        filters.intensities, filters.switching,
    )  # fmt: skip
    return update_moving(ahead, observation)


def run_pair(
    first: list[Observation],
    second: list[Observation],
    times_s: FloatArray,
    filters: ContactFilters,
    *,
    history: "EarlierTrack | None" = None,
) -> PairTest:
    """Run the filters through the scans of two contacts.

    Measurements are nan where a scan lacks a contact; the first scan must be complete,
    and only starts the filters, which go on from ``history`` if there was one contact
    before.
    """
    contacts = [_start(scans[0], filters, history, times_s[0]) for scans in (first, second)]
    starts = [inverse_range_deviation(one.drifts) for one in contacts]
    fits: list[list[InnovationFit]] = []
    for scan in range(1, len(first)):
        before, now = first[scan - 1].position, float(times_s[scan])
        pair = (first[scan], second[scan])
        found = [
            _advance(one, seen, float(times_s[scan - 1]), before, now, filters)
            for one, seen in zip(contacts, pair, strict=True)
        ]
        contacts = [each[0] for each in found]
        (_, a_moves, a_drifts, a_anew), (_, b_moves, b_drifts, b_anew) = found
        counts = _complete(pair[0]) & _complete(pair[1])
        order = (a_moves, b_drifts, a_drifts, b_moves, a_anew, b_anew)
        fits.append([_only(fit, counts) for fit in order])
    ends = np.stack([inverse_range_deviation(contacts[i].drifts) for i in (1, 0)])
    return PairTest(
        np.stack([[fit.log_density for fit in row] for row in fits]),
        np.stack([[fit.distance2 for fit in row] for row in fits]),
        np.stack([[fit.degrees for fit in row] for row in fits]),
        ends,
        ends / np.stack(starts[::-1]),
    )


def consistency(distance2: FloatArray, degrees: FloatArray) -> FloatArray:
    """Return the probability of innovations as large as those found.

    Normalised squared innovations and their degrees of freedom, 0 where a scan does not
    count, have the shape ``(scan, ...)``.

    Notes
    -----
    The smaller of two chi-square probabilities, of the sum over the scans and of the
    largest scan, doubled. A manoeuvre shows in one scan alone, a wrong noise in all.
    """
    from scipy.special import gammaincc

    scans = np.maximum((degrees > 0).sum(axis=0), 1)
    each = gammaincc(0.5 * np.maximum(degrees, 1), 0.5 * distance2)
    largest = -np.expm1(scans * np.log1p(-np.minimum(each.min(axis=0), 1.0 - 1e-15)))
    total = gammaincc(0.5 * np.maximum(degrees.sum(axis=0), 1), 0.5 * distance2.sum(axis=0))
    probability: FloatArray = np.minimum(2.0 * np.minimum(largest, total), 1.0)
    return probability


@dataclass(frozen=True)
class _Contact:
    """Filters of one contact."""

    moves: GaussianSum
    """The moving one, which goes on from an earlier track if there was one."""
    anew: GaussianSum
    """The moving one that began with the pair; the same without an earlier track."""
    drifts: GaussianSum
    """The drifting one."""


def _start(
    observation: Observation, filters: ContactFilters, history: "EarlierTrack | None", now: float
) -> _Contact:
    n_models, speed = filters.intensities.size, filters.speed_std_mps
    anew = moves = start_moving(observation, speed, n_models)
    if history is not None:
        moves, _ = _go_on(history, observation, now, filters)
        observation = separated(moves, observation)
    drifts = start_drift(observation, filters.inverse_range_std, speed, n_models)
    return _Contact(moves, anew, drifts)


def _advance(
    contact: _Contact,
    observation: Observation,
    before_s: float,
    before: FloatArray,
    now: float,
    filters: ContactFilters,
) -> tuple[_Contact, InnovationFit, InnovationFit, InnovationFit]:
    """Carry the filters of one contact to the next scan."""

    def move(state: GaussianSum) -> tuple[GaussianSum, InnovationFit]:
        track = EarlierTrack(state, before_s, before)
        return _go_on(track, observation, now, filters)

    moves, moving = move(contact.moves)
    anew, beginning = (moves, moving) if contact.anew is contact.moves else move(contact.anew)
    drifts, drifting = update_drift(
        predict_drift(
            contact.drifts, now - before_s, observation.position - before,
            filters.drift_std_mps, filters.intensities, filters.switching,
        ),
        observation,
    )  # fmt: skip
    return _Contact(moves, anew, drifts), moving, drifting, beginning


def _complete(observation: Observation) -> BoolArray:
    return np.asarray(np.isfinite(observation.measured).all(axis=-1))


def _only(fit: InnovationFit, counts: BoolArray) -> InnovationFit:
    """Drop a scan in which the hypotheses would explain unequal numbers."""
    return replace(
        fit,
        log_density=np.where(counts, fit.log_density, 0.0),
        distance2=np.where(counts, fit.distance2, 0.0),
        degrees=np.where(counts, fit.degrees, 0),
    )


_OVERSHOOT = 0.5826
"""Mean overshoot of a Gaussian walk in deviations of its step (Siegmund 1985)."""


@dataclass(frozen=True)
class Thresholds:
    """Ends of the interval in which another scan is taken."""

    lower: float
    """Log odds that decide for the null hypothesis."""
    upper: float
    """Log odds that decide for the alternative."""


class Crossing(NamedTuple):
    """Where tests left their interval."""

    scan: IntArray
    """Scan, counted from 0; -1 for never."""
    decision: IntArray
    """1 for the alternative, -1 for the null hypothesis, 0 for undecided."""


def wald_thresholds(miss: float, false_alarm: float) -> Thresholds:
    """Return the thresholds for two error probabilities in (0, 1), their sum below 1.

    Notes
    -----
    ln((1 - P_M) / P_F) and ln(P_M / (1 - P_F)) (Wald 1947).

    Examples
    --------
    >>> round(wald_thresholds(0.05, 0.05).upper, 3)
    2.944
    """
    return Thresholds(math.log(miss / (1.0 - false_alarm)), math.log((1.0 - miss) / false_alarm))


def first_crossing(log_odds: FloatArray, thresholds: Thresholds) -> "Crossing":
    """Find where walks of log odds, ``(scan, ...)``, first leave the interval."""
    above = log_odds >= thresholds.upper
    outside = above | (log_odds <= thresholds.lower)
    decided = outside.any(axis=0)
    scan = outside.argmax(axis=0)
    up = np.take_along_axis(above, scan[None], axis=0)[0]
    decision = np.where(decided, np.where(up, 1, -1), 0)
    return Crossing(np.where(decided, scan, -1), decision)


def expected_scans(mean: float, deviation: float, thresholds: Thresholds, error: float) -> float:
    """Return the mean number of scans until a decision, wrong with a probability.

    Mean, above 0, and deviation are those of the log likelihood ratio per scan towards
    the truth.

    Notes
    -----
    Wald's identity with Siegmund's overshoot: E[n] = ((1 - e) h - e h) / mean, h the
    threshold plus 0.5826 deviations.

    Examples
    --------
    >>> symmetric = wald_thresholds(0.05, 0.05)
    >>> round(expected_scans(0.5, 1.0, symmetric, 0.02855), 3)
    6.651
    """
    height = 0.5 * (thresholds.upper - thresholds.lower) + _OVERSHOOT * deviation
    return (1.0 - 2.0 * error) * height / mean


def scans_to(walk: FloatArray, height: float, steady: float) -> float:
    """Return the mean number of scans after which walks like one seen reach a height.

    Log odds towards the truth, ``(scan,)``, need not grow evenly: the scans below the
    height are counted, of which as many come too early as too late. ``steady`` is the
    number at even growth, for a walk that ends below.

    Examples
    --------
    >>> scans_to(np.array([0.1, 0.3, 2.0, 4.0, 3.5]), 2.5, 4.0)
    4.0
    """
    return steady if walk[-1] < height else float(np.count_nonzero(walk < height) + 1)


def overshoot_error(thresholds: Thresholds, deviation: float) -> float:
    """Return the error rate of a symmetric test, which its overshoot makes smaller.

    The deviation is that of the log likelihood ratio per scan.

    Examples
    --------
    >>> round(overshoot_error(wald_thresholds(0.05, 0.05), 1.0), 5)
    0.02855
    """
    odds = math.exp(-(thresholds.upper + _OVERSHOOT * deviation))
    return odds / (1.0 + odds)


def fixed_scans(mean: float, deviation: float, error: float) -> float:
    """Return the length of a test of fixed length with the same error, below 0.5.

    Mean and deviation are those of `expected_scans`.

    Notes
    -----
    n = (z_e deviation / mean)^2 with z_e the normal quantile, and at least one scan. An
    error too small for the number format counts as the smallest number.

    Examples
    --------
    >>> round(fixed_scans(0.5, 1.0, 0.02855), 2)
    14.48
    >>> fixed_scans(1e4, 100.0, 0.0)
    1.0
    """
    from scipy.special import ndtri

    quantile = float(ndtri(max(error, sys.float_info.min)))
    return max((quantile * deviation / mean) ** 2, 1.0)
