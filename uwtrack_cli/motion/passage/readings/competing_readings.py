"""Readings that compete: a straight passage, one with a change, or none at all.

**Method.** A line's frequency also changes when a shaft is run faster or slower, or
when the vessel turns; a straight passage of a steady source is then bent to fit, and is
wrong with a small deviation. So every passage of lines is read in four ways: straight,
with one step of all rest frequencies, with one ramp of them, and with one change of
velocity. For many instants the unknowns of a change are added to the linearised
passage, whose own unknowns and constants are projected out (score test). A change that
gains too little, even with noise taken as white, is not fitted, and what it may have
left open is weighed by the linear law (`unseen_changes`). The other
readings are fitted in full from their best instants, and weighed by their likelihoods
with coloured noise of their own best strength, less what their search is worth: how few
of the instants fit, and what the prior of the change costs (`change_priors`). What the
weights leave to the rivals widens the deviations of the winner by how far the rivals'
answers are from its own, and so do changes that were not seen (`reading_mixture`).
What does not pass competes with all of them (`still_readings`); whether a passage is told
is not asked here, but by the likelihood ratio and its false-alarm probability.

**Conventions.** Log-likelihoods in nepers. One data set, the fit's one row.

**References.** Davies (1987), Biometrika 74, 33; MacKay (2003), Information Theory,
ch. 28 (Laplace's method, Occam factors).
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.presence import STILL
from uwtrack_cli.estimation.row_offsets import Design, padded
from uwtrack_cli.motion.coloured_noise import coloured_likelihoods
from uwtrack_cli.motion.passage.fit.estimator import (
    PassageFit,
    fit_passage,
    fit_with_coloured_noise,
    fit_with_line_levels,
    join_rows,
    take_rows,
)
from uwtrack_cli.motion.passage.fit.initial_estimates import PassageSearch, find_changed_estimates
from uwtrack_cli.motion.passage.fit.likelihood_ratio import measured_series, passage_residuals
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS, slant_over_speed_s
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import (
    CHANGED,
    FREE_INSTANTS,
    HEIGHT,
    MANOEUVRE,
    RAMP,
    STEP,
    TURN,
    Change,
)
from uwtrack_cli.motion.passage.readings.change_priors import STRAIGHT, cost_of_change, speed_prior
from uwtrack_cli.motion.passage.readings.change_scores import Scores, instants, score_changes
from uwtrack_cli.motion.passage.readings.reading_mixture import SMALLEST_WEIGHT, mixed
from uwtrack_cli.motion.passage.readings.still_readings import (
    cost_of_motion,
    prior_of_place,
    still_evidences,
    still_frequencies,
)
from uwtrack_cli.motion.passage.readings.unseen_changes import unseen_change
from uwtrack_cli.motion.passage.readings.unseen_passages import unseen_passages

TWO_TARGETS = "two-targets"

FREQUENCY_CHANGES = (STEP, RAMP)
CHANGES = (*FREQUENCY_CHANGES, MANOEUVRE, TURN)
"""What may have changed beside a passage."""

READ_AS = {TURN: MANOEUVRE}
"""Readings whose name is not that of their change."""

N_STARTS = 3
"""Instants from which each change is fitted."""

ROUGH_SHARE = 0.5
"""Share of the gain of a passage that a coarse search beside a change must find."""

FINEST = 1.0 / 16.0
"""Distance of the instants that are tried in the end, over that of the search."""

MOST_ROUNDS, MOST_ROWS = 9, (6, 3)
"""Rounds of instants at most; starts that are followed in the first one, and then."""

SAME_COST, NEARLY_KNOWN, LOST_MODE = 0.05, 0.25, 40.0
"""Costs that are alike; share of the first distance of instants at which one is nearly
known, and the cost behind the best with which it is given up then."""

FEWEST_APART = 2.5
"""Distances of neighbouring instants that two starts must be apart."""

SMALLEST_SCORE = 4.0
"""Gain in log-likelihood, noise taken as white, below which a change is not fitted."""

SMALLEST_RIVAL = 0.05
"""Weight from which a rival is named."""

FARTHEST_EVIDENCE, FEWEST_MODES = 12.0, 2
"""Evidence behind the best, before its own coloured noise is fitted, up to which a mode
is one of the readings; so few are not asked."""

FARTHEST_MODE, MODE_STEPS = 8.0, 2.0
"""Cost behind the best up to which another instant is kept, and how many steps of the
last round it must be away."""

FASTEST_START = 0.8
"""Speed of a start at most, over that of sound; no fit goes beyond it."""


class Reading(NamedTuple):
    """How a passage is read."""

    name: str = STRAIGHT
    """The likeliest reading of what passes, or of all where nothing is told to pass."""
    weight: float = 1.0
    """Its probability."""
    rival: str = ""
    """The next one; empty if it has less than 5 %."""
    rival_weight: float = 0.0
    """The probability of that one."""
    change_time_std_s: float = np.nan
    """Deviation of the instant of the change, s."""
    nothing: float = 0.0
    """Probability that nothing passes, in whatever way."""
    log_odds: float = np.inf
    """Logarithm of the odds of all that passes over all that does not, nepers."""


STRAIGHT_READING = Reading()
"""Nothing changed beside the passage."""


class Tried(NamedTuple):
    """Everything that a passage was read as."""

    fits: list[PassageFit]
    """Fits, the straight one first."""
    time_std_s: list[float]
    """Deviation of the instant of each change, s; nan for the straight one."""
    searches: list[Scores | None]
    """The search that each change came from."""
    unseen: list[Scores]
    """Changes that gain too little to be fitted."""


def read_passage(
    fit: PassageFit, blocks: Blocks, kinds: tuple[str, ...] = CHANGES
) -> tuple[PassageFit, Reading]:
    """Return the fit of the likeliest reading of a passage, as wide as the rivals ask.

    Parameters
    ----------
    fit
        Straight fit of one row, with lines.
    blocks
        The measurements that it was made from.
    kinds
        The changes that are tried; none beside bearings and levels alone.
    """
    if blocks.shift.is_empty:
        kinds = ()
    return weigh_readings(try_readings(fit, blocks, kinds), blocks)


def try_readings(fit: PassageFit, blocks: Blocks, kinds: tuple[str, ...] = CHANGES) -> Tried:
    """Fit the changes that gain enough beside a passage.

    Parameters
    ----------
    fit
        Straight fit of one row, with lines.
    blocks
        The measurements that it was made from.
    kinds
        The changes that are tried.
    """
    tried = Tried([fit], [float("nan")], [None], [])
    modes, found_by = list[tuple[PassageFit, float]](), list[Scores]()
    search: PassageSearch | None = None
    for kind in kinds:
        scores = score_changes(kind, fit, blocks)
        if scores.gain.max() > SMALLEST_SCORE:
            search = search or PassageSearch.of(blocks, fit.medium, float(fit.turn[0]))
            found = _fit_change(scores, fit, blocks, search)
            modes += found
            found_by += [scores] * len(found)
        elif fit.theta[0, 2] > 0:
            tried.unseen.append(scores)
    behind = np.zeros(len(modes))
    if len(modes) > FEWEST_MODES:
        value = _evidences([fit, *(one for one, _ in modes)], [None, *found_by], blocks)
        behind = value.max() - value[1:]
    for (one, std), scores, lag in zip(modes, found_by, behind, strict=True):
        if lag < FARTHEST_EVIDENCE:
            made, own = _with_coloured_noise(one, std, blocks)
            tried.fits.append(made)
            tried.time_std_s.append(own)
            tried.searches.append(scores)
    return tried


def read_still(fit: PassageFit, blocks: Blocks, tried: Tried | None = None) -> Reading:
    """Return the likeliest reading of what is not told to pass, be it a passage or none.

    Parameters
    ----------
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    tried
        What it was read as beside a change; None if that was not tried.
    """
    tried = tried or Tried([fit], [float("nan")], [None], [])
    value = _evidences(tried.fits, tried.searches, blocks)
    value = value - cost_of_motion(fit, blocks)
    frequencies = still_frequencies(fit, blocks)
    log_weight = still_evidences(fit, blocks, frequencies)
    log_weight |= unseen_passages(fit, blocks, frequencies)
    for name, own in zip(_names(tried.fits), value.tolist(), strict=True):
        # both are the same evidence, by the peak of the likelihood and by its mean
        log_weight[name] = max(log_weight.get(name, -np.inf), own)
    most = float(np.logaddexp.reduce(list(log_weight.values())))
    return _named({name: float(np.exp(one - most)) for name, one in log_weight.items()})


def _named(weight: dict[str, float], told: set[str] | None = None) -> Reading:
    """Return the likeliest reading, of those that may be told, and its rival."""
    ranked = sorted(weight, key=lambda name: -weight[name])
    name = next(one for one in ranked if told is None or one in told)
    rival = next((one for one in ranked if one != name), "")
    has_rival = weight.get(rival, 0.0) > SMALLEST_RIVAL
    return Reading(
        name, weight[name], rival if has_rival else "",
        weight[rival] if has_rival else 0.0,
        nothing=sum(weight.get(name, 0.0) for name in STILL),
    )  # fmt: skip


def _names(fits: list[PassageFit]) -> list[str]:
    """Return what each fit is read as."""
    kinds = [one.change.kind if one.change else STRAIGHT for one in fits]
    return [READ_AS.get(kind, kind) for kind in kinds]


def weigh_readings(tried: Tried, blocks: Blocks) -> tuple[PassageFit, Reading]:
    """Return the fit of the likeliest of the readings that were tried.

    Parameters
    ----------
    tried
        What the passage was read as.
    blocks
        The measurements.
    """
    fits = tried.fits
    value = _evidences(fits, tried.searches, blocks)
    if not np.isfinite(value.max()):  # no reading is a passage at all
        return fits[0], STRAIGHT_READING
    unseen = [unseen_change(scores, fits[0], blocks) for scores in tried.unseen]
    hidden = [float(value[0]) + one.log_evidence for one in unseen]
    passing = float(np.logaddexp.reduce([*value, *hidden]))
    still = still_evidences(fits[0], blocks, still_frequencies(fits[0], blocks))
    passing -= cost_of_motion(fits[int(np.argmax(value))], blocks)
    most = float(np.logaddexp.reduce([passing, *still.values()]))
    weight = {name: float(np.exp(one - most)) for name, one in still.items()}
    passes = float(np.exp(passing - most))
    every = np.exp(np.append(value, hidden) - max([*value, *hidden]))
    every /= every.sum()
    chance, left = every[: value.size], every[value.size :]
    kinds = np.array([one.change.kind if one.change else STRAIGHT for one in fits])
    names = np.array(_names(fits))
    weight |= {str(name): passes * float(chance[names == name].sum()) for name in names}
    for one, share in zip(unseen, passes * left, strict=True):
        # what moves nothing is straight in all that is told
        hidden_as = READ_AS.get(one.kind, one.kind)
        weight[hidden_as] = weight.get(hidden_as, 0.0) + float(share) * one.share
        weight[STRAIGHT] += float(share) * (1.0 - one.share)
    reading = _named(weight, set(names.tolist()))
    best = int(np.argmax(np.where(names == reading.name, chance, -1.0)))
    time_std_s = _time_std_s(tried, kinds == kinds[best], best, chance)
    weighed = list(zip(left.tolist(), unseen, strict=True))
    whole = [
        fit_with_line_levels(one, blocks) if share > SMALLEST_WEIGHT else one
        for one, share in zip(fits, chance, strict=True)
    ]
    fit = mixed(whole, best, chance, weighed)
    log_odds = passing - float(np.logaddexp.reduce(list(still.values())))
    return fit, reading._replace(change_time_std_s=time_std_s, log_odds=log_odds)


def _evidences(fits: list[PassageFit], searches: list[Scores | None], blocks: Blocks) -> FloatArray:
    """Return the logarithm of the evidence of each reading, the straight one first.

    They count from the likelihood of the straight one. What bearings and levels tell has
    no speed.
    """
    gain: FloatArray = np.zeros(1)
    if len(fits) > 1:
        gain = _log_likelihoods(fits, blocks)
        gain -= gain[0]
    value = gain.copy()
    if blocks.shift.is_empty:
        return value
    if fits[0].theta[0, 2] <= 0:
        value[0] = -np.inf
    there = prior_of_place(fits[0], blocks)
    for place, searched in enumerate(searches):
        value[place] += speed_prior(fits[place])
        # where a straight one lies is for the decision; a change may go no farther out
        value[place] += min(prior_of_place(fits[place], blocks) - there, 0.0)
        if searched is not None:
            value[place] -= searched.search(float(gain[place]))
            value[place] -= cost_of_change(fits[place], blocks.time_s)
    return value


def may_hide_passage(fit: PassageFit, blocks: Blocks, least: float) -> bool:
    """Return whether a change of all frequencies leaves room for a passage beside it.

    Parameters
    ----------
    fit
        Straight fit of one row that is no passage.
    blocks
        The measurements that it was made from.
    least
        Gain in log-likelihood that a passage must have.
    """
    if blocks.shift.is_empty:
        return False
    block, time_s = blocks.shift, blocks.time_s
    series, constants, precision, used = measured_series(
        block.value[0], block.weight[0], fit.noises[0].scale[0]
    )
    time_s = time_s[used]
    search = PassageSearch.of(blocks, fit.medium, float(fit.turn[0]))
    for kind in FREQUENCY_CHANGES:
        every = instants(kind, fit, blocks)
        found = find_changed_estimates(search, fit.medium, every, n_starts=N_STARTS)
        width = slant_over_speed_s(
            np.exp(found.theta[:, 1]), found.theta[:, 2], fit.medium.height_m
        )
        lag = (time_s - found.theta[:, :1]) / width[:, None]
        passing = lag / np.hypot(1, lag)
        changed = Change(kind, found.time_s, found.sign).shape(time_s) / np.ptp(time_s)
        for at, change, passage, others in zip(
            found.time_s, changed, passing, found.others, strict=True
        ):
            # the instant is known to a step of the search: what lies there is left out
            kept = abs(time_s - at) > found.known_to_s
            alone = constants.beside(change).of(kept)
            both = alone.beside(passage[kept])
            spread = [
                _weighed_misfit(series[kept], columns, precision[kept]) for columns in (alone, both)
            ]
            n_values = np.count_nonzero(kept)
            white = 0.5 * n_values * np.log(spread[0] / max(spread[1], 1e-300))
            if white + others <= ROUGH_SHARE * least:
                continue  # noise that is coloured gives it less, and takes long to ask
            value = coloured_likelihoods(
                [(series[kept], alone), (series[kept], both)], precision[kept],
                time_s[kept], float(fit.range_over_speed_s[0]),
            )  # fmt: skip
            if value[1] - value[0] + others > ROUGH_SHARE * least:
                return True
    return False


def _weighed_misfit(series: FloatArray, columns: Design, precision: FloatArray) -> float:
    """Return the weighted sum of squares that constants and shapes leave."""
    root = np.sqrt(precision)
    rows = columns.rows(root)
    value = padded(series * root, len(rows))
    share, *_ = np.linalg.lstsq(rows, value, rcond=None)
    return float(((value - rows @ share) ** 2).sum())


def _time_std_s(tried: Tried, same: BoolArray, best: int, chance: FloatArray) -> float:
    """Return the deviation of the instant of a change: within its mode and among them."""
    if tried.fits[best].change is None:
        return float("nan")
    at, own = np.array([
        (_change(tried.fits[row]).time_s[0], tried.time_std_s[row])
        for row in np.flatnonzero(same)
    ]).T  # fmt: skip
    square = own**2 + (at - _change(tried.fits[best]).time_s[0]) ** 2
    return float(np.sqrt((chance[same] * square).sum() / chance[same].sum()))


def _fit_change(
    scores: Scores, fit: PassageFit, blocks: Blocks, search: PassageSearch
) -> list[tuple[PassageFit, float]]:
    """Fit one kind of change: its likely modes, with the deviation of each instant."""
    kind = scores.kind
    theta, change, step = _starts(scores, fit, blocks, search)
    fits = _fitted(theta, change, fit, blocks)
    if kind in FREE_INSTANTS:
        time_std = np.sqrt(fits.full_covariance[:, -1, -1])
        apart = np.fmax(MODE_STEPS * time_std, 1e-3 * step)
    else:
        fits, time_std, step = _with_best_instants(fits, step, fit, blocks)
        apart = MODE_STEPS * step
    if kind == MANOEUVRE:
        fits = _with_nearer_leg(fits, fit, blocks)
    cost = _cost(fits)
    at, kept = _change(fits).time_s, list[int]()
    for row in np.argsort(cost):
        far = abs(at[row] - at[kept]) > apart[row]
        likely = np.isfinite(cost[row]) and cost[row] < cost.min() + FARTHEST_MODE
        if likely and far.all() and len(kept) < N_STARTS:
            kept.append(int(row))
    return [(take_rows(fits, [row]), float(time_std[row])) for row in kept]


def _with_coloured_noise(
    fit: PassageFit, time_std_s: float, blocks: Blocks
) -> tuple[PassageFit, float]:
    """Fit a mode again with its coloured noise; also the deviation of its instant, s."""
    made = fit_with_coloured_noise(fit, blocks, rounds=1)
    change = _change(made)
    if change.kind in FREE_INSTANTS:
        # between two measurements every instant is alike
        after = np.searchsorted(blocks.time_s[1:-1], change.time_s[0])
        spacing_s = float(blocks.time_s[after + 1] - blocks.time_s[after])
        variance = float(made.full_covariance[0, -1, -1]) + spacing_s**2 / 12
        time_std_s = float(np.sqrt(variance))
    return made, time_std_s


def _with_best_instants(
    fits: PassageFit, step: FloatArray, fit: PassageFit, blocks: Blocks
) -> tuple[PassageFit, FloatArray, FloatArray]:
    """Return the likeliest fits at their best instants, their deviations and steps, s.

    The instants on either side of the best one are tried, and the step is halved unless
    one of them is better.
    """
    kind, cost = _change(fits).kind, _cost(fits)
    square, first = np.zeros(step.size), step
    for number in range(MOST_ROUNDS):
        rows = _followed(_change(fits), cost, step, first)[: MOST_ROWS[min(number, 1)]]
        fits, cost, step = take_rows(fits, rows), cost[rows], step[rows]
        square, first = square[rows], first[rows]
        if np.all(step <= FINEST * first):
            break
        sides = [
            _fitted(
                fits.theta,
                Change(kind, _change(fits).time_s + lag, _change(fits).sign),
                fit,
                blocks,
            )
            for lag in (-0.5 * step, 0.5 * step)
        ]
        both = join_rows([fits, *sides])
        near = 0.5 * step * np.array([[0.0], [-1.0], [1.0]])
        costs = np.minimum(_cost(both), 1e300).reshape(3, -1)
        chance = np.exp(costs.min(axis=0) - costs)
        chance /= chance.sum(axis=0)
        mean = (chance * near).sum(axis=0)
        square = np.maximum(square, (chance * (near - mean) ** 2).sum(axis=0))
        best = np.argmin(costs, axis=0)
        fits = take_rows(both, best * step.size + np.arange(step.size))
        step = np.where(best > 0, step, 0.5 * step)
        cost = _cost(fits)
    return fits, np.sqrt(square + step**2 / 12), step


def _followed(change: Change, cost: FloatArray, step: FloatArray, first: FloatArray) -> list[int]:
    """Return the rows that are worth following, the best ones first.

    Left out are those that came to where a better one is, and those whose instant is
    nearly known and that will still not be kept.
    """
    rows, cost = list[int](), np.minimum(cost, 1e300)
    for row in np.argsort(cost).tolist():
        same = change.sign[rows] == change.sign[row]
        same &= np.abs(change.time_s[rows] - change.time_s[row]) < step[row]
        same &= np.abs(cost[rows] - cost[row]) < SAME_COST
        is_known = step[row] <= NEARLY_KNOWN * first[row]
        is_lost = cost[row] > cost.min() + LOST_MODE
        if not (same.any() or (is_known and is_lost)):
            rows.append(row)
    return rows


def _starts(
    scores: Scores, fit: PassageFit, blocks: Blocks, search: PassageSearch
) -> tuple[FloatArray, Change, FloatArray]:
    """Return starts by the linearised passage, and by a search through all of them.

    The last is how far the instant of each may be off, s, shape (starts,).
    """
    starts: list[int] = []
    for place in np.argsort(-scores.gain):
        lag = np.abs(scores.time_s[place] - scores.time_s[starts])
        apart = lag > FEWEST_APART * scores.spacing_s[place]
        if np.all(apart | (scores.sign[starts] != scores.sign[place])):
            starts.append(int(place))
        if len(starts) == N_STARTS:
            break
    theta, time_s = scores.theta[starts], scores.time_s[starts]
    sign, step = scores.sign[starts], scores.spacing_s[starts]
    if scores.kind in FREQUENCY_CHANGES:
        every = Change(scores.kind, scores.time_s, scores.sign)
        more = find_changed_estimates(search, fit.medium, every, n_starts=N_STARTS)
        added = np.zeros((more.size.size, theta.shape[1]))
        added[:, :4] = more.theta
        added[:, HEIGHT] = fit.height_m
        added[:, CHANGED] = more.size
        theta = np.concatenate([theta, added])
        time_s = np.append(time_s, more.time_s)
        sign = np.append(sign, more.sign)
        step = np.append(step, np.full(more.size.size, scores.spacing_s[0]))
    elif scores.kind == MANOEUVRE:
        reach = np.maximum(step, float(fit.range_over_speed_s[0]))
        near = np.abs(time_s - fit.theta[0, 0]) < reach
        theta = np.concatenate([theta, _exchanged(theta[near], time_s[near])[0]])
        time_s, sign = np.append(time_s, time_s[near]), np.append(sign, -sign[near])
        step = np.append(step, step[near])
        if not blocks.bearing.is_empty:
            theta = np.concatenate([theta, _mirrored(theta, time_s)])
            time_s, sign, step = np.tile(time_s, 2), np.tile(sign, 2), np.tile(step, 2)
    return theta, Change(scores.kind, time_s, sign), step


def _with_nearer_leg(fits: PassageFit, fit: PassageFit, blocks: Blocks) -> PassageFit:
    """Fit again from the other leg where that one has a nearer approach of its own."""
    change = _change(fits)
    other, same_side = _exchanged(fits.theta, change.time_s)
    is_passed = (change.time_s - other[:, 0]) * change.sign < 0
    ranges = [np.exp(theta[:, 1]) * theta[:, 2] for theta in (fits.theta, other)]
    nearer = np.flatnonzero(is_passed & same_side & (ranges[1] < ranges[0]))
    if not nearer.size:
        return fits
    turned = replace(change, time_s=change.time_s[nearer], sign=-change.sign[nearer])
    found = _fitted(other[nearer], turned, fit, blocks)
    order = np.arange(change.time_s.size)
    order[nearer] = order.size + np.arange(nearer.size)
    return take_rows(join_rows([fits, found]), order)


def _exchanged(theta: FloatArray, time_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the same manoeuvres with the closest approach taken on the other leg.

    Near the closest approach it is not known which of the legs has it. The second tells
    whether the sensor is on the same side of that leg.
    """
    speed, changed = theta[:, 2], theta[:, CHANGED:]
    velocity = np.stack([speed + changed[:, 0], changed[:, 1]])
    fast = np.maximum(np.hypot(*velocity), SLOWEST_MPS)
    east, north = velocity / fast
    place = speed * (time_s - theta[:, 0]), speed * np.exp(theta[:, 1])
    along = place[0] * east + place[1] * north
    across = place[1] * east - place[0] * north
    away = np.abs(across)
    other = theta.copy()
    other[:, 0] = time_s - along / fast
    other[:, 1] = np.log(np.maximum(away / fast, 1e-3))
    other[:, 2] = fast
    other[:, CHANGED] = speed * east - fast
    other[:, CHANGED + 1] = -speed * north
    return other, across > 0


def _mirrored(theta: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return manoeuvres whose other leg is mirrored at the bearing of their instant.

    Ranges, and so frequencies and levels, are the same on both: only bearings tell.
    """
    place = np.stack([time_s - theta[:, 0], np.exp(theta[:, 1])], axis=1)
    unit = place / np.sqrt((place**2).sum(axis=1, keepdims=True))
    straight = np.stack([theta[:, 2], np.zeros(theta.shape[0])], axis=1)
    velocity = straight + theta[:, CHANGED:]
    along = (velocity * unit).sum(axis=1, keepdims=True)
    other = theta.copy()
    other[:, CHANGED:] = 2 * along * unit - velocity - straight
    return other


def _fitted(theta: FloatArray, change: Change, fit: PassageFit, blocks: Blocks) -> PassageFit:
    turn = np.repeat(fit.turn, theta.shape[0])
    # a start that a score test has thrown beyond the speed of sound has no law
    theta = theta.copy()
    theta[:, 2] = np.minimum(theta[:, 2], FASTEST_START * fit.medium.sound_speed_mps)
    return fit_passage(blocks, theta, turn, fit.medium, change=change)


def _change(fit: PassageFit) -> Change:
    """Return what changed in a fit of a change."""
    if fit.change is None:
        raise ValueError("a straight passage has no change")
    return fit.change


def _cost(fits: PassageFit) -> FloatArray:
    """Return the cost of every row with the prior of its change; inf if it is invalid.

    A passage whose own closest approach lies on the other leg is none.
    """
    change = _change(fits)
    cost = fits.cost + 0.5 * ((fits.theta[:, CHANGED:] / change.std) ** 2).sum(axis=1)
    valid = np.isfinite(cost) & (fits.theta[:, 2] > 0)
    if change.kind in FREE_INSTANTS:
        valid &= fits.full_covariance[:, -1, -1] > 0
    if change.kind == TURN:
        # faster, the closest approach of the turn would be its farthest place
        angle, duration = fits.theta[:, CHANGED : CHANGED + 2].T
        near = np.abs(fits.theta[:, 0] - change.time_s) < 0.5 * duration
        rate = np.where(near, angle / duration, 0.0)
        valid &= 1.0 + rate * np.exp(fits.theta[:, 1]) > 0
    if change.kind == MANOEUVRE:
        valid &= (change.time_s - fits.theta[:, 0]) * change.sign > 0
    return np.where(valid, cost, np.inf)


def _log_likelihoods(fits: list[PassageFit], blocks: Blocks) -> FloatArray:
    """Return the log-likelihood of every reading, coloured noise at its best in each."""
    total = np.zeros(len(fits))
    kinds = (blocks.shift, blocks.bearing, blocks.level)
    residuals = [passage_residuals(fit, blocks) for fit in fits]
    width_s = float(fits[0].range_over_speed_s[0])
    for number, block in enumerate(kinds):
        scale = np.min([fit.noises[number].scale[0] for fit in fits], axis=0)
        series = [
            measured_series(residual[number], block.weight[0], scale) for residual in residuals
        ]
        kept = series[0][3]
        if kept.any():
            total += coloured_likelihoods(
                [(one[0], one[1]) for one in series],
                series[0][2], blocks.time_s[kept], width_s, smooth=number == 0,
            )  # fmt: skip
    return total
