"""The test between two contacts: their filters and log likelihoods over scans.

**Method.** Under the hypothesis that the first contact moves, a moving filter follows the
first and a drifting filter the second; under the opposite the other way round. Every scan
in which both contacts are measured completely adds to the log odds, but for the first:
without an earlier track it says the same under both hypotheses, a range and a bearing
anywhere and a range rate of the same deviation.

**Conventions.** As in `uwtrack_cli.discrimination.contact_filters`; the order of the
filters is: first moves, second drifts, first drifts, second moves, and then both moving
ones begun anew.

**References.** Jeong and Hong (1996), equations 19-25, with the sum of its four terms.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
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
            state = start_moving(
                observation, filters.speed_std_mps, filters.intensities.size
            )
        else:
            continue
        track = EarlierTrack(state, float(now), observation.position)
    return track


def _go_on(
    track: EarlierTrack,
    observation: Observation,
    now: float,
    filters: ContactFilters,
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
    contacts = [
        _start(scans[0], filters, history, times_s[0]) for scans in (first, second)
    ]
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
    total = gammaincc(
        0.5 * np.maximum(degrees.sum(axis=0), 1), 0.5 * distance2.sum(axis=0)
    )
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
    observation: Observation,
    filters: ContactFilters,
    history: "EarlierTrack | None",
    now: float,
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
    anew, beginning = (
        (moves, moving) if contact.anew is contact.moves else move(contact.anew)
    )
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
