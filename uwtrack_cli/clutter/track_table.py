"""The table of tracks: what the filters found scan by scan, one target after the other.

**Method.** The density of false measurements about a target is found from those that lie
nearest to it. In each scan the volume about the target within which the nearest few false
measurements lie is taken: times the density it is a sum of unit exponentials. Over all
scans the density is the number of these measurements over the sum of the volumes. So few
are taken that most of a scan is outside, and scans at whose edge the target is are left
out.

**References.** Song and Musicki (2011), IEEE Trans. Signal Processing 59, 1401 (sparsity
of clutter of an order); Cressie (1993), Statistics for Spatial Data, section 8.2.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, ScanUpdate
from uwtrack_cli.clutter.scan_table import ScanTable, least_amplitude, usable_rows
from uwtrack_cli.clutter.sensing import Sensing, expect
from uwtrack_cli.clutter.several_targets import FollowedScan
from uwtrack_cli.clutter.track_start import TrackStarts
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.estimation.imm import Belief, moments, smooth
from uwtrack_cli.estimation.information_reduction import information_reduction, unit_ball_volume
from uwtrack_cli.estimation.track_score import track_score

MOST_NEIGHBOURS = 5
"""Greatest number of the nearest false measurements."""

NEIGHBOUR_SHARE = 0.125
"""Share of a scan's false measurements that they may be: a circle of an eighth of a
square about its middle has 0.4 of the square's width."""


class FoundClutter(NamedTuple):
    """Neighbours of a target, and how many the told density has in their volume."""

    n_found: float
    """Number of false measurements."""
    n_expected: float
    """Density told times the volume that they fill."""

    @property
    def ratio(self) -> float | None:
        """Density over the one told; None where the scans hold too few to tell."""
        return self.n_found / self.n_expected if self.n_expected > 0.0 else None

    @property
    def ratio_std(self) -> float | None:
        """Standard deviation of the ratio, of a gamma distribution."""
        ratio = self.ratio
        return None if ratio is None else ratio / float(np.sqrt(self.n_found))


def neighbours_of(
    away: FloatArray, scan: IntArray, scale: FloatArray, density: FloatArray
) -> FoundClutter:
    """Count the nearest false measurements of each scan about a target.

    The edges of a scan are those of the box of its measurements.

    Parameters
    ----------
    away
        False measurements minus the target, ``(k, m)``, in the units of the components.
    scan
        Scan of each of them, ``(k,)``, a place in ``density``.
    scale
        Unit of length in each component, ``(m,)``.
    density
        Density told about the target in each scan, ``(scan,)``.

    Returns
    -------
    FoundClutter
        None of them where scans hold fewer than eight on average.

    Examples
    --------
    >>> about = np.array([[1.0], [-2], [-4], [6], [-7], [8], [9], [-9]])
    >>> found = neighbours_of(about, np.zeros(8, int), np.ones(1), np.array([0.25]))
    >>> round(found.ratio, 6)
    2.0
    """
    count = np.bincount(scan, minlength=density.size)
    order = min(int(NEIGHBOUR_SHARE * count.mean()), MOST_NEIGHBOURS)
    if not order:
        return FoundClutter(0.0, 0.0)
    scaled = away / scale
    dimension = scaled.shape[1]
    unit = unit_ball_volume(dimension)
    distance2 = (scaled**2).sum(axis=1)
    # the measurements of a scan follow each other, nearest first
    sorting = np.lexsort((distance2, scan))
    first = np.cumsum(count) - count
    some = np.flatnonzero(count >= max(order, 2))
    # a target nearer to an edge than the neighbours usually reach has fewer of them
    low = np.minimum.reduceat(scaled[sorting], first[count > 0])
    high = np.maximum.reduceat(scaled[sorting], first[count > 0])
    at = np.searchsorted(np.flatnonzero(count > 0), some)
    share = order / count[some]
    reach = (share * np.prod(high[at] - low[at], axis=1) / unit) ** (1.0 / dimension)
    inside = np.minimum(-low[at], high[at]).min(axis=1) >= reach
    some = some[inside]
    volume = unit * distance2[sorting[first[some] + order - 1]] ** (0.5 * dimension)
    expected = density[some] * volume * float(np.prod(scale))
    return FoundClutter(float(order * some.size), float(expected.sum()))


class Ending(NamedTuple):
    """When tracks count as lost, and what is told of all of them."""

    loss_score: float
    """Page's statistic at which a target counts as lost."""
    ended: IntArray | tuple[()] = ()
    """Numbers of the tracks that ended by it."""
    false_tracks_per_hour: float | None = None
    """Bound on the rate of false tracks, where tracks begin."""
    confirming_score: float | None = None
    """Score that they needed."""
    crowded_scans: int | None = None
    """Scans in which pairs were left out."""


class Smoothing(NamedTuple):
    """What it takes to let states learn from later scans."""

    lag: int
    """Number of later scans; 0 for none."""
    carry: Callable[[float], tuple[FloatArray, FloatArray]]
    """Returns F and Q of the models for an interval in s."""
    starts: TrackStarts
    """Motion models, and what is tracked."""


def target_table(
    scans: Scans,
    table: ScanTable,
    rows: list[IntArray],
    past: list[FollowedScan],
    setting: ClutterSetting,
    ending: Ending,
    smoothing: Smoothing,
) -> Target:
    """Gather the tracks after each scan into the container.

    ``rows``: rows of each scan that was followed.
    """
    track = np.concatenate([each.track for each in past])
    scan = np.repeat([each.scan for each in past], [each.track.size for each in past])
    order: IntArray = np.lexsort((scan, track))
    number: IntArray = np.unique(track[order], return_inverse=True)[1]
    rise = _joined(past, lambda u: u.association.log_likelihood_ratio)[order]
    score, cusum = _scores(number, rise)
    order, number, score, cusum = _cut(order, number, score, cusum, track, ending)

    def column(read: Callable[[ScanUpdate], FloatArray]) -> FloatArray:
        return _joined(past, read)[order]

    owner, association_row, weight = _associations(past, order)
    false_alarm = column(lambda u: u.point.false_alarm)
    detection = column(lambda u: u.point.detection)
    gate, expected = column(lambda u: u.gate), column(lambda u: u.expected_clutter)
    volume = column(lambda u: u.gate_volume)
    lost = cusum > ending.loss_score
    first = np.array([index[0] for index in rows])[scan[order]]
    belief = Belief.join([each.update.belief for each in past]).take(order)
    state, covariance = column(lambda u: u.mean), column(lambda u: u.covariance)
    if smoothing.lag:
        belief = _smoothed(belief, number, scans.time_s[first], smoothing)
        state, covariance = moments(belief)
    chance = belief.probability
    n_ranges = smoothing.starts.range_m.size
    chance = chance.reshape(len(chance) // n_ranges, n_ranges, order.size).sum(axis=1)
    own = None if table.own is None else table.own[first]
    found = expect(state, setting.sensing, own)
    expected_of_state = state[:, ::2] if found is None else found.measured
    clutter = None
    if not setting.count_clutter:
        recorded = setting.false_alarm if setting.rule == "fixed" else setting.limits[1]
        clutter = _found_clutter(
            scans, table, [rows[place] for place in scan[order]], number,
            expected_of_state, lost,
            expected / volume * (recorded / false_alarm),
            np.bincount(association_row, weight, scans.scan.size) >= 0.5, setting,
        )  # fmt: skip
    sensing = smoothing.starts.sensing
    return Target(
        target_id=number + 1,
        scan=scans.scan[first],
        time_s=scans.time_s[first],
        state=_in_circle(state, sensing),
        state_covariance=covariance,
        model_probability=chance.T,
        false_alarm_probability=false_alarm,
        detection_probability=detection,
        threshold=setting.curve.threshold(false_alarm),
        gate=gate,
        gate_volume=volume,
        expected_clutter=expected,
        validated=np.bincount(owner, minlength=order.size),
        miss_probability=column(lambda u: u.association.miss),
        information_reduction=_expected_reduction(detection, expected, gate, setting.dimension),
        score=score,
        loss_cusum=cusum,
        lost=lost,
        association_target_id=number[owner] + 1,
        association_scan=scans.scan[association_row],
        association_row=association_row,
        association_probability=weight,
        component=sensing.component,
        component_unit=sensing.component_unit,
        threshold_rule=setting.rule,
        false_tracks_per_hour=ending.false_tracks_per_hour,
        confirming_score=ending.confirming_score,
        crowded_scans=ending.crowded_scans,
        smoothing_scans=smoothing.lag or None,
        clutter_ratio=None if clutter is None else clutter.ratio,
        clutter_ratio_std=None if clutter is None else clutter.ratio_std,
        start_utc_ns=scans.start_utc_ns,
    )


def _joined(past: list[FollowedScan], read: Callable[[ScanUpdate], FloatArray]) -> FloatArray:
    return np.concatenate([read(each.update) for each in past])


def _scores(number: IntArray, rise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the score of every track and the statistic of the test for its loss."""
    starts = np.flatnonzero(np.diff(number)) + 1
    parts = [track_score(part) for part in np.split(rise, starts)]
    return (
        np.concatenate([score for score, _ in parts]),
        np.concatenate([cusum for _, cusum in parts]),
    )


def _cut(
    order: IntArray,
    number: IntArray,
    score: FloatArray,
    cusum: FloatArray,
    track: IntArray,
    ending: Ending,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Let the tracks that ended do so where their evidence was greatest."""
    if not len(ending.ended):
        return order, number, score, cusum
    place = np.arange(order.size)
    best = np.full(number.max() + 1, -1)
    np.maximum.at(best, number, np.where(cusum == 0.0, place, -1))
    kept = ~np.isin(track[order], ending.ended) | (place <= best[number])
    _, left = np.unique(number[kept], return_inverse=True)
    return order[kept], left, score[kept], cusum[kept]


def _associations(
    past: list[FollowedScan], order: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return place in the table, measured row and probability of all associations."""
    count = np.concatenate([each.update.point.allowed.sum(axis=1) for each in past])
    row = np.concatenate([each.row[each.update.point.allowed] for each in past])
    weight = np.concatenate(
        [each.update.association.weight[each.update.point.allowed] for each in past]
    )
    place = np.full(count.size, -1)
    place[order] = np.arange(order.size)
    owner = np.repeat(place, count)
    sorting = np.argsort(owner, kind="stable")
    sorting = sorting[owner[sorting] >= 0]
    return owner[sorting], row[sorting], weight[sorting]


def _found_clutter(
    scans: Scans,
    table: ScanTable,
    rows: list[IntArray],
    number: IntArray,
    expected: FloatArray,
    lost: BoolArray,
    density: FloatArray,
    is_taken: BoolArray,
    setting: ClutterSetting,
) -> FoundClutter:
    """Compare the false measurements about the targets with the density told."""
    usable = usable_rows(scans, least_amplitude(setting))
    scale = np.sqrt(table.covariance[usable].mean(axis=0).diagonal())
    is_false = usable & ~is_taken
    found = FoundClutter(0.0, 0.0)
    for target in range(int(number.max(initial=-1)) + 1):
        own = np.flatnonzero((number == target) & ~lost)
        if not own.size:
            continue
        row = np.concatenate([rows[place] for place in own])
        scan = np.repeat(np.arange(own.size), [rows[place].size for place in own])
        row, scan = row[is_false[row]], scan[is_false[row]]
        away = table.measured[row] - expected[own][scan]
        if setting.period is not None:
            whole = np.where(np.isfinite(setting.period), setting.period, 0.0)
            away -= np.round(away / setting.period) * whole
        more = neighbours_of(away, scan, scale, density[own])
        found = FoundClutter(found.n_found + more.n_found, found.n_expected + more.n_expected)
    return found


def _smoothed(belief: Belief, number: IntArray, time_s: FloatArray, smoothing: Smoothing) -> Belief:
    """Smooth the states of every target, whose scans follow each other."""
    parts = []
    for target in range(int(number.max(initial=-1)) + 1):
        own = number == target
        steps = [smoothing.carry(float(step)) for step in np.diff(time_s[own])]
        one = belief.take(own)
        if steps:
            count, states = len(one.mean), one.mean.shape[-1]
            shape = (count, len(steps), states, states)
            forward, noise = (np.array(each) for each in zip(*steps, strict=True))
            if forward.ndim == 3:  # one for all models
                forward = forward[:, None]
            one = smooth(
                one, np.broadcast_to(forward.swapaxes(0, 1), shape),
                noise.swapaxes(0, 1), smoothing.starts.models.switching, smoothing.lag,
            )  # fmt: skip
        parts.append(one)
    return Belief.join(parts) if parts else belief


def _in_circle(state: FloatArray, sensing: Sensing) -> FloatArray:
    """Bring angles to where compass bearings lie, from 0 up to 360."""
    period = sensing.period
    if period is None or sensing.kind != "components":
        return state
    for i in np.flatnonzero(np.isfinite(period)):
        state[:, 2 * i] %= period[i]
    return state


def _expected_reduction(
    detection: FloatArray, expected: FloatArray, gate: FloatArray, dimension: int
) -> FloatArray:
    """Return q2 of each scan; the region rule has a gate of its own per scan."""
    reduction = np.empty_like(detection)
    for radius in np.unique(gate):
        same = gate == radius
        reduction[same] = information_reduction(
            detection[same], expected[same], dimension=dimension, gate=float(radius)
        )
    return reduction
