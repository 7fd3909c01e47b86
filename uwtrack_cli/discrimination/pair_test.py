"""The test between two contacts: four filters and their log likelihoods over scans.

**Method.** Under the hypothesis that the first contact moves, a moving filter follows the
first and a drifting filter the second; under the opposite the other way round. Every scan
in which both contacts are measured completely adds to the log odds.

**Conventions.** As in `uwtrack_cli.discrimination.contact_filters`; the order of the four
filters is: first moves, second drifts, first drifts, second moves.

**References.** Jeong and Hong (1996), equations 19-25, with the sum of its four terms.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.discrimination.contact_filters import (
    DriftState,
    InnovationFit,
    Observation,
    predict_drift,
    predict_moving,
    start_drift,
    start_moving,
    update_drift,
    update_moving,
)
from uwtrack_cli.discrimination.options import ContactFilters
from uwtrack_cli.estimation.imm import Belief


@dataclass(frozen=True)
class EarlierTrack:
    """Track of a contact that was there before the second one."""

    belief: Belief
    """Its moving filter."""
    time_s: float
    """Time of the filter's state, s."""


@dataclass(frozen=True)
class PairTest:
    """The four filters over the scans of a pair, the first scan excluded."""

    log_density: FloatArray
    """Increments, ``(scan, 4, ...)``; 0 in scans that do not count."""
    distance2: FloatArray
    """Normalised squared innovations, ``(scan, 4, ...)``."""
    degrees: FloatArray
    """Their degrees of freedom, ``(scan, 4, ...)``."""
    inverse_range_std: FloatArray
    """Relative deviation of the inverse range at the end, ``(2, ...)``: second, first
    contact."""

    @property
    def log_odds(self) -> FloatArray:
        """Log odds of "the second moves" after every scan, ``(scan, ...)``."""
        signs = np.array([-1.0, -1.0, 1.0, 1.0])
        signs = signs.reshape(4, *(1,) * (self.log_density.ndim - 2))
        odds: FloatArray = np.cumsum((signs * self.log_density).sum(axis=1), axis=0)
        return odds


def follow(
    scans: list[Observation], times_s: FloatArray, filters: ContactFilters
) -> "EarlierTrack | None":
    """Track the one contact that is there before the second one.

    The first complete measurement starts the filter; None without one.
    """
    belief: Belief | None = None
    before = 0.0
    for observation, now in zip(scans, times_s, strict=True):
        if belief is not None:
            belief = predict_moving(
                belief, float(now) - before, filters.intensities, filters.switching
            )
            belief, _ = update_moving(belief, observation)
        elif np.isfinite(observation.measured[..., :2]).all():
            belief = start_moving(
                observation, filters.speed_std_mps, filters.intensities.size
            )
        before = float(now)
    return None if belief is None else EarlierTrack(belief, before)


def run_pair(
    first: list[Observation],
    second: list[Observation],
    times_s: FloatArray,
    filters: ContactFilters,
    *,
    history: "EarlierTrack | None" = None,
) -> PairTest:
    """Run the four filters through the scans of two contacts.

    Measurements are nan where a scan lacks a contact; the first scan must be complete,
    and only starts the filters, which go on from ``history`` if there was one contact
    before.
    """
    moving = [
        _start(observation, filters, history, float(times_s[0]))
        for observation in (first[0], second[0])
    ]
    drifting = [
        start_drift(s, filters.inverse_range_std) for s in (first[0], second[0])
    ]
    fits: list[list[InnovationFit]] = []
    for scan in range(1, len(first)):
        interval = float(times_s[scan] - times_s[scan - 1])
        moved = first[scan].position - first[scan - 1].position
        pair = (first[scan], second[scan])
        found = [
            _advance(moving[i], drifting[i], pair[i], interval, moved, filters)
            for i in range(2)
        ]
        moving = [each[0] for each in found]
        drifting = [each[1] for each in found]
        (_, _, first_moves, first_drifts), (_, _, second_moves, second_drifts) = found
        counts = _complete(pair[0]) & _complete(pair[1])
        order = (first_moves, second_drifts, first_drifts, second_moves)
        fits.append([_only(fit, counts) for fit in order])
    ends = [
        np.sqrt(drifting[i].covariance[..., 1, 1]) / drifting[i].mean[..., 1]
        for i in (1, 0)
    ]
    return PairTest(
        np.stack([[fit.log_density for fit in row] for row in fits]),
        np.stack([[fit.distance2 for fit in row] for row in fits]),
        np.stack([[fit.degrees for fit in row] for row in fits]),
        np.stack(ends),
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
    total = gammaincc(
        0.5 * np.maximum(degrees.sum(axis=0), 1), 0.5 * distance2.sum(axis=0)
    )
    probability: FloatArray = np.minimum(2.0 * np.minimum(largest, total), 1.0)
    return probability


def _start(
    observation: Observation,
    filters: ContactFilters,
    history: "EarlierTrack | None",
    now: float,
) -> Belief:
    if history is None:
        return start_moving(
            observation, filters.speed_std_mps, filters.intensities.size
        )
    belief = predict_moving(
        history.belief, now - history.time_s, filters.intensities, filters.switching
    )
    return update_moving(belief, observation)[0]


def _advance(
    moving: Belief,
    drifting: DriftState,
    observation: Observation,
    interval_s: float,
    moved: FloatArray,
    filters: ContactFilters,
) -> tuple[Belief, DriftState, InnovationFit, InnovationFit]:
    """Carry both filters of one contact to the next scan."""
    belief = predict_moving(moving, interval_s, filters.intensities, filters.switching)
    belief, moves = update_moving(belief, observation)
    drift = predict_drift(drifting, interval_s, moved, filters.drift_std_mps)
    drift, drifts = update_drift(drift, observation)
    return belief, drift, moves, drifts


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
