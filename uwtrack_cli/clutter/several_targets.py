"""Several targets in the same scans: joint association, tracks that begin and end.

**Method.** Confirmed tracks are associated jointly. A measurement that is probably none
of theirs begins a tentative track. The score of a track adds up how much likelier each
scan is with it than without it, where clutter and the tracks before it in rank explain
the rest. A tentative track is confirmed when its score passes Wald's bound, and given up
when it falls; a confirmed one ends when its score no longer rises (Page's test).

**Conventions.** As in `uwtrack_cli.clutter.clutter_filter`; the axis after the motion
models is the track. Candidates of a track are the measurements near it, padded.

**References.** Fortmann, Bar-Shalom and Scheffe (1983); Wald (1947); Page (1954); Ville
(1939) for the bound at any time; Musicki and La Scala (2008), IEEE Trans. AES 44, 877,
for other targets as a density of clutter; Bar-Shalom and Li (1995), section 6.2.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Look, Scan, ScanUpdate, learn, look
from uwtrack_cli.clutter.sensing import expect_with_spread
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.imm import Belief, advance, mix
from uwtrack_cli.estimation.joint_association import associate_jointly
from uwtrack_cli.estimation.probabilistic_association import Association
from uwtrack_cli.estimation.track_score import DISMISSED, shortfall

LIKELY = 0.5
"""Association probability from which a measurement counts as a track's own."""

FORGET_SCANS = 64
"""Scans after which what was kept of dismissed tracks is thrown away."""

_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class TrackRule:
    """When tracks begin and end."""

    begins: bool
    """Whether measurements may begin tracks, and scores end them."""
    confirming: float
    """Score at which a tentative track is confirmed."""
    loss_score: float
    """Page's statistic at which a track ends."""


class FollowedScan(NamedTuple):
    """All tracks after a scan."""

    scan: int
    """Place of the scan in the table, from 0."""
    track: IntArray
    """Number of each track, ``(track,)``, from 1 in the order of their beginning."""
    update: ScanUpdate
    """The filters after the scan."""
    row: IntArray
    """Row in the table of each candidate, ``(track, k)``."""


class Followed(NamedTuple):
    """What became of all tracks."""

    scans: list[FollowedScan]
    """The scans in which there was a track, with those that were confirmed."""
    ended: IntArray
    """Numbers of those that ended."""
    n_crowded: int
    """Scans in which pairs were left out of the joint hypotheses."""


@dataclass
class _Tracks:
    """The tracks that are followed just now, confirmed ones first in rank."""

    belief: Belief
    """Their filters, ``(model, track, ...)``."""
    number: IntArray
    """Number of each, from 1."""
    is_confirmed: BoolArray
    """Whether its score has passed the bound, or it was told."""
    score: FloatArray
    """Log likelihood ratio of the track so far."""
    cusum: FloatArray
    """Page's statistic of its loss."""

    def keep(self, chosen: BoolArray) -> None:
        """Keep some of them, the confirmed before the tentative."""
        places = np.flatnonzero(chosen)
        places = places[np.argsort(~self.is_confirmed[places], kind="stable")]
        self.belief = self.belief.take(places)
        self.number = self.number[places]
        self.is_confirmed = self.is_confirmed[places]
        self.score, self.cusum = self.score[places], self.cusum[places]

    def add(self, belief: Belief, first: int) -> None:
        """Add new tentative tracks behind the others."""
        count = belief.mean.shape[1]
        nothing = np.zeros(count)
        self.belief = Belief.join([self.belief, belief])
        self.number = np.append(self.number, np.arange(first, first + count))
        self.is_confirmed = np.append(self.is_confirmed, nothing > 0.0)
        self.score = np.append(self.score, nothing)
        self.cusum = np.append(self.cusum, nothing)


class ScanRows(NamedTuple):
    """The measurements of a scan that a track may take."""

    time_s: float
    """Time of the scan, s."""
    row: IntArray
    """Their rows in the table, ``(k,)``."""
    measured: FloatArray
    """Their components, ``(k, m)``."""
    noise: FloatArray
    """Their covariances, ``(k, m, m)``."""
    usual_noise: FloatArray
    """Covariance that stands for a measurement where there is none, ``(m, m)``."""
    own: FloatArray | None
    """Own ship; see `Scan`."""


def follow_several(
    scans: Iterable[ScanRows],
    told: Belief,
    time_s: float,
    setting: ClutterSetting,
    rule: TrackRule,
    *,
    motion: Callable[[float], tuple[FloatArray, FloatArray]],
    switching: FloatArray,
    begin: Callable[[ScanRows, BoolArray], Belief],
) -> Followed:
    """Follow targets through scans.

    Parameters
    ----------
    scans
        Their measurements, in the order of time.
    told
        Tracks that are there from the start, ``(model, track, ...)``, perhaps none.
    time_s
        Time of these, s.
    setting
        Facts of detector, clutter and gate; the threshold is fixed.
    rule
        When tracks begin and end.
    motion
        Returns F, and Q of the models, for an interval in s.
    switching
        Probabilities of changing the motion model.
    begin
        Returns the state of tracks that begin at some of a scan's measurements.

    Returns
    -------
    Followed
        The tracks that were confirmed, from their first measurement on.
    """
    n_told = told.mean.shape[1]
    tracks = _Tracks(
        told, np.arange(1, n_told + 1), np.full(n_told, fill_value=True),
        np.zeros(n_told), np.zeros(n_told),
    )  # fmt: skip
    next_number, n_crowded = n_told + 1, 0
    confirmed: list[int] = tracks.number.tolist()
    ended: list[int] = []
    past: list[FollowedScan] = []
    remembered = 0
    for place, scan in enumerate(scans):
        interval, time_s = scan.time_s - time_s, scan.time_s
        claimed: FloatArray = np.zeros(len(scan.row))
        if tracks.number.size:
            predicted = advance(mix(tracks.belief, switching), *motion(interval))
            near, packed = _candidates(predicted, scan, setting)
            seen = look(predicted, packed, setting)
            association, claimed, n_omitted = _associate(
                seen, near, tracks.is_confirmed, len(scan.row)
            )
            n_crowded += n_omitted > 0
            update = learn(seen, association)
            tracks.belief = update.belief
            rows = scan.row[near] if scan.row.size else near
            past.append(FollowedScan(place, tracks.number, update, rows))
            if rule.begins:
                new, gone = _judge(tracks, update.association, near, claimed, rule)
                confirmed += new
                ended += gone
        if not rule.begins:
            continue
        free = claimed < LIKELY
        if free.any():
            tracks.add(begin(scan, free), next_number)
            next_number += int(free.sum())
        if len(past) - remembered >= FORGET_SCANS:
            known = np.union1d(confirmed, tracks.number)
            past[remembered:] = [_only(each, known) for each in past[remembered:]]
            remembered = len(past)
    lasting = [_only(each, np.array(confirmed, int)) for each in past]
    return Followed(lasting, np.array(ended, int), n_crowded)


def _only(past: FollowedScan, known: IntArray) -> FollowedScan:
    """Keep what became of some of the tracks."""
    kept = np.isin(past.track, known)
    return FollowedScan(past.scan, past.track[kept], past.update.take(kept), past.row[kept])


def _candidates(
    predicted: Belief, scan: ScanRows, setting: ClutterSetting
) -> tuple[IntArray, Scan]:
    """Return which measurements are near each track, and the scan made of them.

    No measurement in the gate is outside the box that encloses it.
    """
    n_tracks, count = predicted.mean.shape[1], len(scan.row)
    common = scan.usual_noise[None, None]
    if not count:
        empty = np.zeros((n_tracks, 1, setting.dimension))
        absent = np.zeros((n_tracks, 1), dtype=bool)
        return absent.astype(np.int64), Scan(
            empty, absent, np.full(absent.shape, np.nan), common, scan.own
        )
    expected, variance = expect_with_spread(predicted, setting.sensing, scan.own)
    widest = np.diagonal(scan.noise, axis1=-2, axis2=-1).max(axis=0)
    reach = setting.gate * np.sqrt(variance + widest)
    near = np.ones((*predicted.mean.shape[:2], count), dtype=bool)
    for i in range(setting.dimension):
        away = scan.measured[:, i] - expected[..., i, None]
        if setting.period is not None and np.isfinite(setting.period[i]):
            away -= setting.period[i] * np.round(away / setting.period[i])
        near &= np.abs(away) <= reach[..., i, None]
    any_model = near[0] if len(near) == 1 else near.any(axis=0)
    most = max(int(any_model.sum(axis=1).max()), 1)
    order = np.argsort(~any_model, axis=1, kind="stable")[:, :most]
    present = np.take_along_axis(any_model, order, axis=1)
    noise = common
    if not (scan.noise == scan.usual_noise).all():
        # a region is searched with the noise of what lies in it
        first = np.where(present[:, :1], order[:, :1], order)
        noise = scan.noise[np.where(present, order, first)]
    amplitude = np.full(order.shape, np.nan)  # those below the threshold are gone
    return order, Scan(scan.measured[order], present, amplitude, noise, scan.own)


def _associate(
    seen: Look, near: IntArray, is_confirmed: BoolArray, count: int
) -> tuple[Association, FloatArray, int]:
    """Weigh the hypotheses of all tracks.

    Returned with the probabilities under each motion model: the probability that a
    measurement is a confirmed target's, ``(k,)``, and the number of pairs left out.

    Notes
    -----
    Given the association the models are independent of the other targets, so that the
    weight of a model is sum_i beta_i mu_m g_mi / g_i + beta_0 mu_m.
    """
    prior = seen.predicted.probability
    each = seen.each.density * seen.point.allowed
    mixed = (prior[..., None] * each).sum(axis=0)
    missed = 1.0 - seen.point.detection * seen.inside
    # P_D g of every confirmed track at every measurement of the scan
    intensity = seen.point.detection[:, None] * mixed
    n_confirmed = int(is_confirmed.sum())
    known = np.zeros((n_confirmed, max(count, 1)))
    np.put_along_axis(known, near[:n_confirmed], intensity[:n_confirmed], axis=1)
    before = np.cumsum(known, axis=0)
    total = before[-1] if n_confirmed else np.zeros(known.shape[1])
    others = total[near]
    others[:n_confirmed] = np.take_along_axis(before - known, near[:n_confirmed], 1)
    density = np.maximum(seen.density, _TINY)[:, None]
    ratio = intensity / (density + others)
    likelihood = missed + ratio.sum(axis=1)
    weight, miss = ratio / likelihood[:, None], missed / likelihood
    found = associate_jointly(known / density[:n_confirmed], missed[:n_confirmed])
    miss[:n_confirmed] = found.miss
    weight[:n_confirmed] = np.take_along_axis(found.weight, near[:n_confirmed], axis=1)
    weight *= seen.point.allowed  # a padded place is another measurement's
    score = np.log(likelihood)
    claimed = found.weight.sum(axis=0)[:count]
    if len(prior) == 1:
        whole = Association(miss[None], weight[None], score[None])
        return whole, claimed, found.n_omitted
    divisor = np.where(mixed > 0.0, mixed, 1.0)
    taken = weight * each / divisor
    model = (miss + taken.sum(axis=-1)).clip(_TINY)
    return (
        Association(miss / model, taken / model[..., None], np.log(model) + score),
        claimed,
        found.n_omitted,
    )


def _judge(
    tracks: _Tracks, association: Association, near: IntArray, claimed: FloatArray, rule: TrackRule
) -> tuple[list[int], list[int]]:
    """Add up the scores; confirm, end and give up tracks.

    Returned are the numbers of those confirmed and of those ended.
    """
    rise = association.log_likelihood_ratio
    tracks.score = tracks.score + rise
    tracks.cusum = shortfall(tracks.cusum, rise)
    best = association.weight.argmax(axis=1)[:, None]
    is_own = np.take_along_axis(association.weight, best, axis=1)[:, 0] >= LIKELY
    own = np.take_along_axis(near, best, axis=1)[:, 0]
    is_taken = claimed >= LIKELY
    stays = tracks.cusum <= rule.loss_score
    gone = tracks.number[tracks.is_confirmed & ~stays].tolist()
    stays &= tracks.is_confirmed | (tracks.score > DISMISSED)
    ready = ~tracks.is_confirmed & stays & (tracks.score >= rule.confirming)
    new = []
    for place in sorted(np.flatnonzero(ready), key=lambda at: -tracks.score[at]):
        if is_own[place] and not is_taken[own[place]]:
            is_taken[own[place]] = tracks.is_confirmed[place] = True
            new.append(int(tracks.number[place]))
    # a target has one track: the others that follow its measurements are given up
    if is_taken.size:
        stays &= tracks.is_confirmed | ~(is_own & is_taken[own])
    tracks.keep(stays)
    return new, gone
