"""Legs of a target: whether it altered its velocity, how often, when, and how well.

**Method.** A target keeps its velocity on a leg and goes evenly from one to the next
during an alteration. One more alteration at the instant s by dv moves what is measured
at t > s by (d/dv - s d/dx) of the model: its partials by the velocity less s times those
by the position. For many instants the two unknowns of dv, with normal priors of several
widths, are added to the linearised model of the motion, whose own unknowns are projected
out with those of sound speed and compass (or of the offset of every sensor). The
likelihood of the record then has a closed form, and the mean over instants and widths,
times the odds that a target alters in so long a record, those of one more alteration.

Where that is worth a look, the alteration is fitted with all others (Levenberg-Marquardt
from several instants), and the next one is sought beside it. The evidence of every number
of legs (Laplace's approximation) decides. The noise of the rows is that of `row_noise`:
white, of own navigation, and with a memory, which the residuals of the most legs tell.

An alteration that the evidence does not ask for may still have been there: the standard
deviations of the legs that are kept hold 95 % of the mixture of all (Bayesian model
averaging about the motion that is reported; see `estimation/normal_mixture.py`). Other
numbers of legs that were fitted are parts of it as they are; where none was, the linear
model stands for one more.

**Conventions.** Times count from the first measurement.

**References.** Rao (1948), Proc. Camb. Phil. Soc. 44, 50 (score test); MacKay (2003), ch.
28 (evidence); Hoeting et al. (1999), Stat. Sci. 14, 382 (model averaging).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.model import (
    PER_ALTERATION,
    STRAIGHT,
    from_state,
    state_at,
    state_jacobian,
    to_state,
)
from uwtrack_cli.motion.target_motion.objective import (
    Residuals,
    loss_value,
    misfit,
    motion_prior,
    residuals,
)
from uwtrack_cli.motion.target_motion.observability import scaled_inverse
from uwtrack_cli.motion.target_motion.problem import Expectation, Problem
from uwtrack_cli.motion.target_motion.row_noise import (
    NO_MEMORY,
    Colours,
    RowNoise,
    find_colours,
    kinds_of,
    row_noise,
    whitened,
)
from uwtrack_cli.motion.target_motion.solvers.marquardt import DescentResult, SearchBounds, minimise

N_INSTANTS = 41
"""Instants at which the target may have altered its velocity."""

FIRST_SHARE, LAST_SHARE = 0.05, 0.95
"""Where they begin and end, as shares of the rows."""

FEWEST_ROWS = 20
"""Rows below which no alteration is sought."""

MOST_ALTERATIONS = 3
"""Alterations that are sought in one record."""

ALTERATIONS_PER_HOUR = 0.5
"""Rate at which a target alters, before anything is known of it: see
studies/constants/manoeuvre.py."""

CHANGE_STDS_MPS = (0.5, 1.0, 2.0, 4.0)
"""Deviations of each component of a change of velocity that are equally likely before."""

WORTH_A_FIT = 0.15
"""Probability of an alteration from which it is fitted: the linear model that gives it is
right within a factor of a few in the odds. See studies/constants/manoeuvre.py ("worth")."""

N_STARTS = 7
"""Stretches of the record in each of which a fit starts from the best instant."""

FIRST_STEPS, HOPELESS = 12, 40.0
"""Steps from every start, and the rise over the best from which none goes on."""

MOST_STEPS = 200
"""Steps of what is left: minima of bearings alone lie in long valleys that bend."""

SCATTER = 2.0
"""Deviations by which the misfit of white noise may fall short of what is expected."""

EDGE = 0.01
"""Share of the record at either end in which no alteration lies."""

ROWS_OF_A_TURN = 2.0
"""Rows that an alteration lasts at least: between two rows nothing tells its time."""


@dataclass(frozen=True, eq=False)
class Alterations:
    """What a record says of one more alteration of a motion."""

    log_odds: FloatArray
    """Of every instant and width, before the record's own odds, shape (instants,
    widths)."""
    instant_s: FloatArray
    """Instants, s, shape (instants,)."""
    change_mps: FloatArray
    """Best change at every instant with the widest prior, shape (instants, 2)."""
    shift: FloatArray
    """What a change of 1 m/s moves in state and rest frequencies, shape (instants, p +
    lines, 2)."""
    square: FloatArray
    """Second moments of the change at every instant and width, (instants, widths, 2, 2)."""
    gain: FloatArray
    """Gain of every instant in the misfit, shape (instants,)."""
    prior_odds: float
    """Odds of an alteration before the record."""

    @property
    def log_odds_of_any(self) -> float:
        """Log odds of one more alteration, of all instants and widths together."""
        if not self.log_odds.size:
            return -np.inf
        top = self.log_odds.max()
        return float(np.log(self.prior_odds * np.exp(self.log_odds - top).mean()) + top)

    @property
    def probability(self) -> float:
        """Probability of one more alteration."""
        if not self.log_odds.size:
            return 0.0
        return float(1.0 / (1.0 + np.exp(-np.clip(self.log_odds_of_any, -500.0, 500.0))))

    def spread(self, q: FloatArray, n_lines: int) -> FloatArray:
        """Return second moments of what the alteration that may be moves.

        Of state and rest frequencies, at every instant and width, shape (instants *
        widths, p + lines, same), about the motion ``q`` without it.
        """
        if not self.log_odds.size:
            return np.zeros((0, q.size + n_lines, q.size + n_lines))
        return self._moments(self.shift)

    def spread_at(self, q: FloatArray, time_s: float) -> FloatArray:
        """Return the same of the state at a time, s, shape (instants * widths, 4, 4)."""
        if not self.log_odds.size:
            return np.zeros((0, STRAIGHT, STRAIGHT))
        chain = state_jacobian(q[np.newaxis])[0]
        onward = state_at(q, time_s)[1] @ np.linalg.inv(chain)
        since = (time_s - self.instant_s)[:, np.newaxis, np.newaxis]
        place, velocity = np.maximum(since, 0.0) * np.eye(2), (since > 0.0) * np.eye(2)
        moved = onward @ self.shift[:, : q.size]
        return self._moments(moved + np.concatenate([place, velocity], axis=1))

    @property
    def weight(self) -> FloatArray:
        """Probability of every instant and width, shape (instants * widths,)."""
        if not self.log_odds.size:
            return np.zeros(0)
        weight = np.exp(self.log_odds - self.log_odds.max()).ravel()
        return np.asarray(weight * (self.probability / weight.sum()))

    def with_alteration(self, q: FloatArray, at: int, log_duration: float) -> FloatArray:
        """Return a motion with its best alteration at one of the instants."""
        change = self.change_mps[at]
        state = to_state(q) + self.shift[at, : q.size] @ change
        moved = [*from_state(state[:STRAIGHT]), *state[STRAIGHT:]]
        return np.array([*moved, *change, self.instant_s[at], log_duration])

    def _moments(self, moved: FloatArray) -> FloatArray:
        """Return second moments of what changes move, (instants * widths, q, q)."""
        every = np.einsum("ipa,iwab,iqb->iwpq", moved, self.square, moved)
        return np.asarray(every.reshape(-1, *every.shape[2:]))


NOTHING = Alterations(
    np.empty((0, 0)), np.empty(0), np.empty((0, 2)), np.empty((0, 0, 2)),
    np.empty((0, 0, 2, 2)), np.empty(0), 0.0,
)  # fmt: skip
"""Where no alteration was sought."""


@dataclass(frozen=True, eq=False)
class Rival:
    """The best motion with another number of legs."""

    q: FloatArray
    """The motion in solver coordinates, shape (p,)."""
    weight: float
    """Probability of that number of legs."""


SMALLEST_WEIGHT = 1e-3
"""Probability below which another number of legs is left out."""


@dataclass(frozen=True, eq=False)
class Legs:
    """The motions with the number of legs that the record asks for."""

    fit: DescentResult
    """Minima, best first, with their alterations in order of time."""
    limits: SearchBounds
    """Bounds of their unknowns."""
    gain: float
    """What the last alteration gains in the misfit, or the best one that was not kept."""
    probability: float
    """Probability that the target altered at all."""
    colours: Colours
    """Noise with a memory of bearings and of frequencies."""
    inflation: FloatArray
    """Factor by which bearings, and frequencies, tell less than white ones would."""
    problem: Problem
    """The problem, with the prior of durations that its rows can tell."""
    rivals: tuple[Rival, ...] = ()
    """Motions with other numbers of legs that the record leaves possible."""
    more: Alterations | None = None
    """One more alteration of the best motion, where it was sought last."""

    def beside(self, q: FloatArray) -> tuple[tuple[Rival, ...], Alterations | None]:
        """Return rivals and one more alteration of a motion; None: not yet sought.

        They are of the best motion, whose bearing may count from elsewhere.
        """
        if not np.array_equal(q[2:], self.fit.q[0, 2:]):
            return (), None
        return self.rivals, self.more

    def weighed(self) -> tuple[Problem, DescentResult]:
        """Return problem and minima with the weights that noise with a memory leaves."""
        if (self.inflation == 1.0).all():
            return self.problem, self.fit
        problem = _weighed(self.problem, self.inflation)
        found = misfit(problem, self.fit.q)
        fit = DescentResult(self.fit.q, found.rest_hz, found.value, found.matrix)
        return problem, fit.take(np.argsort(found.value, kind="stable"))


def find_legs(
    problem: Problem, straight: DescentResult, limits: SearchBounds, nuisances: NuisanceDeviations
) -> Legs:
    """Fit as many legs as the evidence asks for, from the best straight motions."""
    problem = _with_durations(problem)
    fits, bounds, models = [straight], [limits], list[list[_Linear]]()
    while True:
        minima = _minima_apart(fits[-1])
        models.append([_Linear(problem, q, nuisances) for q in minima])
        found, colours, worth = _look(problem, models[-1][0])
        each = [[one.evidence(colours) for one in number] for number in models]
        # minima of one number share a valley: their volumes do not add
        evidence = np.array([number[0] for number in each])
        # odds of the next number of legs over the likeliest so far
        odds = np.exp(evidence[-1] - evidence.max()) * worth / max(1.0 - worth, 1e-300)
        # beside the likeliest number that is not one, the next one is fitted, too
        is_last = 0 < int(evidence.argmax()) == len(fits) - 1
        if not found.log_odds.size:
            break
        goes_on = is_last or odds > WORTH_A_FIT / (1.0 - WORTH_A_FIT)
        if not goes_on or len(fits) > MOST_ALTERATIONS:
            break
        bounds.append(with_one_more(bounds[-1], problem))
        more = _fitted(problem, fits[-1], found, bounds[-1])
        if not more.q.size or not more.value[0] < fits[-1].value[0]:
            break
        fits.append(more)
    best = int(evidence.argmax())
    if len(fits) == 1:
        gain, probability = float(found.gain.max(initial=0.0)), found.probability
    else:
        others = np.exp(np.clip(evidence - evidence[0], -500.0, 500.0))[1:].sum()
        gain = models[0][0].least(colours)[0] - models[1][0].least(colours)[0]
        probability = float(others / (1.0 + others))
    rivals = _rivals(models, each, best)
    return Legs(
        fits[best], bounds[best], gain, probability, colours,
        models[best][0].inflation(colours), problem, rivals,
        found if best == len(fits) - 1 else None,
    )  # fmt: skip


def _rivals(
    models: "list[list[_Linear]]", evidence: list[list[float]], best: int
) -> tuple[Rival, ...]:
    """Return the motions with other numbers of legs, with their probabilities.

    A number is as likely as its likeliest minimum, and its minima share that.
    """
    total = np.logaddexp.reduce([max(number) for number in evidence])
    found = []
    for number, chances in enumerate(evidence):
        if number == best:
            continue
        weights = np.exp(chances - np.logaddexp.reduce(chances) + max(chances) - total)
        found += [
            Rival(model.q, weight)
            for model, weight in zip(models[number], weights.tolist(), strict=True)
            if weight > SMALLEST_WEIGHT
        ]
    return tuple(found)


HIGHEST = 15.0
"""Rise of the misfit over the best one from which a minimum has no weight."""


def _minima_apart(fit: DescentResult) -> FloatArray:
    """Return the minima of one number of legs that are more than a deviation apart."""
    kept = [0]
    if fit.q.shape[1] == STRAIGHT:
        return fit.q[kept]
    for index in np.flatnonzero(fit.value < fit.value[0] + HIGHEST).tolist():
        off = fit.q[index] - fit.q[kept]
        off[:, 1] = wrap_rad(off[:, 1])
        away = np.einsum("kp,kpq,kq->k", off, fit.matrix[kept], off)
        if (away > 1.0).all():
            kept.append(index)
    return fit.q[kept]


def _look(problem: Problem, model: "_Linear") -> tuple[Alterations, Colours, float]:
    """Weigh one more alteration, and the noise that is left beside the best one.

    And the probability with which it is worth a fit. An alteration that is missing looks
    like noise with a memory until it is fitted. It is fitted unless that noise is
    likelier than white noise is with residuals no larger than was stated: no alteration
    leaves less.
    """
    if problem.n_rows < FEWEST_ROWS:
        return NOTHING, NO_MEMORY, 0.0
    found, moves = model.one_more(NO_MEMORY)
    worth = found.probability
    colours = model.colours(moves if worth > WORTH_A_FIT else moves[:, :0])
    if all(colour.is_white for colour in colours):
        return found, colours, worth
    coloured = model.one_more(colours)[0]
    if model.is_remembered(colours):
        worth = coloured.probability
    return coloured, colours, max(worth, coloured.probability)


def _with_durations(problem: Problem) -> Problem:
    """Return the problem with alterations that its rows can tell."""
    spacing = np.diff(np.unique(problem.row_time_s))
    if not spacing.size:
        return problem
    shortest = np.log(ROWS_OF_A_TURN * float(np.median(spacing)))
    usual = problem.prior.log_duration
    mean = max(usual.mean, shortest + usual.std)
    prior = replace(problem.prior, log_duration=Expectation(mean, usual.std))
    return replace(problem, prior=prior)


def with_one_more(limits: SearchBounds, problem: Problem) -> SearchBounds:
    """Return bounds with those of one more alteration behind them."""
    span_s = float(np.ptp(problem.row_time_s))
    usual, fast = problem.prior.log_duration, 2.0 * float(limits.upper[2])
    lower = [-fast, -fast, EDGE * span_s, usual.mean - usual.std]
    upper = [fast, fast, (1.0 - EDGE) * span_s, np.log(max(0.5 * span_s, 1.0))]
    upper[3] = max(upper[3], lower[3] + 0.1)
    return SearchBounds(np.append(limits.lower, lower), np.append(limits.upper, upper))


def _fitted(
    problem: Problem, fit: DescentResult, found: Alterations, limits: SearchBounds
) -> DescentResult:
    """Fit one more alteration, from the best instants of several stretches.

    A leg is longer than an alteration: other minima, which make one alteration of two, are
    left out, and there may be none.
    """
    q = fit.q[0]
    chances = found.log_odds.max(axis=1)
    stretches = np.array_split(np.arange(chances.size), N_STARTS)
    instants = [int(one[chances[one].argmax()]) for one in stretches]
    usual = problem.prior.log_duration.mean
    starts = []
    for at in instants:
        starts.append(np.concatenate([q, [0.0, 0.0, found.instant_s[at], usual]]))
        starts.append(found.with_alteration(q, at, usual))
    # the other minima of the straight motion, where the record begins otherwise
    top = instants[int(np.argmax(chances[instants]))]
    for other in _minima_apart(fit)[1:]:
        when = found.instant_s[top]
        starts.append(np.concatenate([other, [0.0, 0.0, when, usual]]))
    # with instant and duration held: a free instant stays between the rows of its start
    held = (limits.lower.size - 2, limits.lower.size - 1)
    ends = minimise(
        problem, np.array(starts), limits, held=held, iterations=FIRST_STEPS, tolerance=1e-3
    )
    near = ends.q[ends.value < ends.value.min() + HOPELESS]
    ends = minimise(problem, near, limits, iterations=MOST_STEPS, tolerance=1e-6)
    ends = ends.take(np.argsort(ends.value, kind="stable"))
    q = in_order(ends.q)
    q = q[_are_apart(q)]
    value = misfit(problem, q)
    return DescentResult(q, value.rest_hz, value.value, value.matrix)


def in_order(q: FloatArray) -> FloatArray:
    """Return motions, one per row, with their alterations in order of time."""
    count = len(q)
    parts = q[:, STRAIGHT:].reshape(count, -1, 4)
    order = np.argsort(parts[:, :, 2], axis=1, kind="stable")
    parts = np.take_along_axis(parts, order[:, :, np.newaxis], axis=1)
    return np.concatenate([q[:, :STRAIGHT], parts.reshape(count, -1)], axis=1)


def _are_apart(q: FloatArray) -> BoolArray:
    """Return whether a leg lies between all alterations of motions in order of time."""
    parts = q[:, STRAIGHT:].reshape(len(q), -1, 4)
    half = 0.5 * np.exp(parts[:, :, 3])
    end, begin = parts[:, :-1, 2] + half[:, :-1], parts[:, 1:, 2] - half[:, 1:]
    return np.asarray((begin - end > half[:, :-1] + half[:, 1:]).all(axis=1))


def _weighed(problem: Problem, inflation: FloatArray) -> Problem:
    """Return the problem with the weights that noise with a memory leaves."""
    lines = np.full((problem.n_lines, 1), inflation[1])
    lines[problem.n_tones :] = inflation[2]
    return replace(
        problem,
        bearing_weight=problem.bearing_weight / np.sqrt(inflation[0]),
        frequency_weight=problem.frequency_weight / np.sqrt(lines),
    )


def _prior_odds(span_s: float) -> float:
    return ALTERATIONS_PER_HOUR * span_s / 3600.0


def seek_alteration(
    problem: Problem, q: FloatArray, nuisances: NuisanceDeviations, colours: Colours = NO_MEMORY
) -> Alterations:
    """Weigh one more alteration of a motion at many instants, in noise with a memory."""
    if problem.n_rows < FEWEST_ROWS:
        return NOTHING
    return _Linear(problem, q, nuisances).one_more(colours)[0]


class _Linear:
    """The linearised model of one record about a motion, under the noise of its rows."""

    def __init__(self, problem: Problem, q: FloatArray, nuisances: NuisanceDeviations) -> None:
        self._problem, self.q, self._nuisances = problem, q, nuisances
        self._r = residuals(problem, q[np.newaxis])
        self._parts = _Parts(problem, q, self._r, nuisances)

    def _equations(self, colours: Colours) -> "_Equations":
        noise = row_noise(self._problem, self._r, self._nuisances, colours)
        parts = self._parts
        known = parts.known
        weighed = noise.weigh(np.column_stack([known, parts.z]))
        solved, z = weighed[:, :-1], weighed[:, -1]
        matrix = known.T @ solved + parts.prior_rows.T @ parts.prior_rows
        pull = known.T @ z + parts.prior_rows.T @ parts.prior_z
        value = float(parts.z @ z + parts.prior_z @ parts.prior_z)
        return _Equations(noise, solved, z, matrix, pull, value)

    def one_more(self, colours: Colours) -> tuple[Alterations, FloatArray]:
        """Weigh one more alteration; and what the best one does, (values, 2)."""
        problem, q, parts = self._problem, self.q, self._parts
        own = self._equations(colours)
        inverse = scaled_inverse(own.matrix)
        rows = np.linspace(FIRST_SHARE, LAST_SHARE, N_INSTANTS) * (problem.n_rows - 1)
        before = np.unique(rows.astype(int))  # an instant lies between two rows
        time = problem.row_time_s
        instants = 0.5 * (time[before] + time[np.minimum(before + 1, time.size - 1)])
        at = instants[:, np.newaxis]
        moved = parts.state[:, np.newaxis, 2:4] - at * parts.state[:, np.newaxis, :2]
        turned = np.where(parts.time_s[:, np.newaxis] > instants, 1.0, 0.0)
        turned = turned[:, :, np.newaxis] * moved
        flat = turned.reshape(len(turned), -1)
        weighed = own.noise.weigh(flat).reshape(turned.shape)
        along = np.moveaxis((own.solved.T @ flat).reshape(-1, at.size, 2), 1, 0)
        shift = -inverse @ along
        # what is left of them: as products of these, errors of the inverse are squared
        left = np.moveaxis(turned, 1, 0) + parts.known @ shift
        heavy = np.moveaxis(weighed, 1, 0) + own.solved @ shift
        expected = parts.prior_rows @ shift
        matrix = np.swapaxes(left, 1, 2) @ heavy
        matrix = matrix + np.swapaxes(expected, 1, 2) @ expected
        pull = np.swapaxes(heavy, 1, 2) @ parts.z
        pull = pull + np.swapaxes(expected, 1, 2) @ parts.prior_z
        width = np.array(CHANGE_STDS_MPS)[:, np.newaxis, np.newaxis]
        joint = matrix[:, np.newaxis] + width**-2.0 * np.eye(2)
        sign, volume = np.linalg.slogdet(joint * width**2.0)
        if not (sign > 0.0).all():
            # through the very place of a sensor: numbers do not hold what a change tells
            return NOTHING, turned[:, 0]
        spread = np.linalg.inv(joint)
        change = -(spread @ pull[:, np.newaxis, :, np.newaxis])[..., 0]
        gain = -np.einsum("iwa,ia->iw", change, pull)
        square = spread + change[..., :, np.newaxis] * change[..., np.newaxis, :]
        found = Alterations(
            0.5 * (gain - volume), instants, change[:, -1],
            shift[:, : q.size + problem.n_lines], square, gain[:, -1],
            _prior_odds(float(np.ptp(time))),
        )  # fmt: skip
        return found, turned[:, int(gain[:, -1].argmax())]

    def colours(self, more: FloatArray) -> Colours:
        """Find the memory of the noise beside all that is known, and one alteration."""
        design = np.concatenate([self._parts.known, more], axis=1)
        prior = np.pad(self._parts.prior_rows, ((0, 0), (0, more.shape[1])))
        return find_colours(self._problem, self._r, self._nuisances, design, prior)

    def is_remembered(self, colours: Colours) -> bool:
        """Return whether noise with a memory is likelier than any white one can be."""
        own, white = self._equations(colours), self._equations(NO_MEMORY)
        left = own.value - own.pull @ scaled_inverse(own.matrix) @ own.pull
        least = self._problem.n_values - self.q.size - self._problem.n_lines
        least -= SCATTER * np.sqrt(2.0 * max(least, 0))
        return bool(left + own.noise.log_volume < least + white.noise.log_volume)

    def inflation(self, colours: Colours) -> FloatArray:
        """Return by how much each kind of value tells less than white ones would."""
        known = self._parts.known
        solved = self._equations(colours).solved
        size = np.maximum((known**2).sum(axis=0), 1e-300)
        found = []
        for kind in kinds_of(self._problem):
            plain = ((known[kind] ** 2).sum(axis=0) / size).sum()
            told = ((known[kind] * solved[kind]).sum(axis=0) / size).sum()
            found.append(max(plain / told, 1.0) if told > 0.0 else 1.0)
        return np.array(found)

    def least(self, colours: Colours) -> tuple[float, FloatArray]:
        """Return the least misfit near the motion, and half its curvature.

        In solver coordinates and all that goes with them, shape (known, known).
        """
        own, r, problem = self._equations(colours), self._r, self._problem
        gained = own.pull @ scaled_inverse(own.matrix) @ own.pull
        # what outliers cost beside their weighted squares
        z = np.concatenate([r.bearing[0].ravel(), r.frequency[0].ravel()])
        outlying = loss_value(z, problem.loss).sum() - self._parts.z @ self._parts.z
        chain = np.eye(len(own.matrix))
        size = self.q.size
        chain[:size, :size] = state_jacobian(self.q[np.newaxis])[0]
        return own.value - float(gained) + float(outlying), chain.T @ own.matrix @ chain

    def evidence(self, colours: Colours) -> float:
        """Return the log evidence of the motion's number of legs, by Laplace.

        Up to what all numbers have in common. An instant is likely anywhere in the
        record, a change has the widest of its priors or, with smaller odds, narrower ones.
        """
        span_s = float(np.ptp(self._problem.row_time_s))
        prior = self._problem.prior
        misfit_value, matrix = self.least(colours)
        value = 0.0
        for first in range(STRAIGHT, self.q.size, PER_ALTERATION):
            matrix[first + 2, first + 2] += 12.0 / span_s**2
            change = self.q[first : first + 2]
            widths = np.array(CHANGE_STDS_MPS)
            narrow = -0.5 * (change @ change) / widths**2 - 2.0 * np.log(widths)
            value += np.log(np.exp(narrow).mean())
            value += 0.5 * (change @ change) / prior.change_std_mps**2
            value -= np.log(prior.log_duration.std) + np.log(span_s)
            value += 0.5 * np.log(2.0 * np.pi) + np.log(_prior_odds(span_s))
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
        values = np.linalg.eigvalsh(matrix / np.outer(scale, scale))
        volume = np.log(np.maximum(values, 1e-13)).sum() + 2.0 * np.log(scale).sum()
        return float(value - 0.5 * misfit_value - 0.5 * volume)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of all that is known, under the noise of the rows."""

    noise: RowNoise
    """The noise."""
    solved: FloatArray
    """Inverse covariance times the partials, shape (values, known)."""
    z: FloatArray
    """Inverse covariance times the residuals, shape (values,)."""
    matrix: FloatArray
    """With what was expected, shape (known, known)."""
    pull: FloatArray
    """Half gradient, shape (known,)."""
    value: float
    """Misfit."""


class _Parts:
    """Whitened residuals and partials of one record, value by value."""

    def __init__(
        self, problem: Problem, q: FloatArray, r: Residuals, nuisances: NuisanceDeviations
    ) -> None:
        self.z, share = whitened(problem, r)
        n_bearings, shape_b = problem.bearing_weight.size, problem.bearing_weight.shape
        share_b = share[:n_bearings].reshape(shape_b)
        share_f = share[n_bearings:].reshape(problem.frequency_weight.shape)
        weight_b = share_b * problem.bearing_weight * r.side[0]
        weight_f = share_f * problem.frequency_weight
        bearing = weight_b[:, :, np.newaxis] * r.prediction.bearing_jacobian[0].T
        state = [bearing.reshape(-1, q.size)]
        shape_f, speed = np.zeros_like(weight_f), np.zeros_like(weight_f)
        for one in r.scaled:
            scale = r.rest_hz[0, one.lines, np.newaxis] * weight_f[one.lines]
            partials = (one.slope[0] * one.jacobian[0]).T
            each = scale[:, :, np.newaxis] * partials
            state.append(each.reshape(-1, q.size))
            shape_f[one.lines] = weight_f[one.lines] * one.shape[0]
            # by the logarithm of the sound speed: delays fall as it rises
            is_tone = one.lines.start < problem.n_tones
            speed[one.lines] = scale * ((1.0 if is_tone else 0.0) - one.shape[0])
        self.state = np.concatenate(state)
        time = problem.row_time_s
        streams, n_lines = shape_b[0], problem.n_lines
        self.time_s = np.tile(time, streams + n_lines)
        std = problem.offset_std_rad
        n_constant = 1 if std is None else streams
        others = np.zeros((self.z.size, n_lines + 1 + n_constant))
        for line in range(n_lines):
            begin = n_bearings + line * time.size
            others[begin : begin + time.size, line] = shape_f[line]
        relative = nuisances.sound_speed_mps / problem.sound_speed_mps
        others[n_bearings:, n_lines] = relative * speed.ravel()
        prior_z = np.zeros(1 + n_constant)
        if std is None:
            compass = np.radians(nuisances.compass_deg)
            others[:n_bearings, -1] = compass * np.broadcast_to(weight_b, shape_b).ravel()
        else:
            plain = share_b * problem.bearing_weight
            for stream in range(streams):
                begin = stream * time.size
                own = slice(begin, begin + time.size)
                others[own, n_lines + 1 + stream] = std[stream] * plain[stream]
            known = np.maximum(std, 1e-300)
            prior_z[1:] = np.where(std > 0, r.offset_rad[0] / known, 0.0)
        self.known = np.concatenate([self.state, others], axis=1)
        # sound speed and constant bearing errors have unit priors
        root = np.sqrt(problem.rest_precision)
        prior_z = np.concatenate([root * (r.rest_hz[0] - 1.0), prior_z])
        unit = np.concatenate([root, np.ones(1 + n_constant)])
        expected_z, expected = motion_prior(problem, to_state(q)[np.newaxis])
        self.prior_z = np.concatenate([expected_z[0], prior_z])
        self.prior_rows = np.zeros((self.prior_z.size, q.size + unit.size))
        self.prior_rows[: -unit.size, : q.size] = expected[0]
        self.prior_rows[-unit.size :, q.size :] = np.diag(unit)
