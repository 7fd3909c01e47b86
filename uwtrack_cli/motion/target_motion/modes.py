"""Modes: the motions that explain the data about equally well, and what each says.

**Method.** Minima within the likelihood-ratio region of the best are kept when a
barrier lies between them, and weighted by Laplace's approximation of their
posterior mass, exp(-F/2) |C|^(1/2) (MacKay 2003, eq. 27.8), flat in the solver's
coordinates. The 95 % interval of a quantity holds the values for which the best fit
of everything else is worse by no more than the chi-square quantile of one degree of
freedom (Cox & Hinkley 1974, ch. 9). The profile is followed outwards in steps of the
Laplace deviation with one batched descent, and interpolated at the crossing. A descent
from the minimum may stall in a valley that bends: the point behind the crossing is
fitted again from where its neighbour arrived, and the profile followed on while that
helps. An interval that meets the limits of the search is open on that side.

**Conventions.** Under a robust loss, or with estimated deviations, the rise of the
misfit is divided by ``scale`` (Wilks' statistic of an M-estimate).
"""

from dataclasses import dataclass, field, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.normal_mixture import HALF_WIDTH, HELD, half_width, widened
from uwtrack_cli.motion.options import Misfit, MotionModel, Search
from uwtrack_cli.motion.target_motion.bounce import Bounce
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations, error_budget
from uwtrack_cli.motion.target_motion.joint_region import ellipse_holds
from uwtrack_cli.motion.target_motion.legs import NOTHING, Alterations, Rival, seek_alteration
from uwtrack_cli.motion.target_motion.model import (
    PER_ALTERATION,
    STRAIGHT,
    from_state,
    motion_jacobian,
    state_at,
    state_jacobian,
    to_motion,
    to_polar,
)
from uwtrack_cli.motion.target_motion.objective import Residuals, misfit, residuals
from uwtrack_cli.motion.target_motion.observability import (
    Observability,
    assess,
    information,
    scaled_inverse,
)
from uwtrack_cli.motion.target_motion.problem import MotionPrior, Problem
from uwtrack_cli.motion.target_motion.row_noise import NO_MEMORY, Colours
from uwtrack_cli.motion.target_motion.solvers.marquardt import DescentResult, SearchBounds, minimise
from uwtrack_cli.motion.target_motion.solvers.solvers import SolverName

STEPS = 12
"""Points of the profile on each side."""


LOOSE = 1e-5
"""Relative decrease of the misfit at which a profile of several legs has arrived: a
hundredth of the rise that ends an interval."""


@dataclass(frozen=True)
class Interval:
    """A likelihood-ratio interval and whether the search limits cut it."""

    low: float
    """Lower end."""
    high: float
    """Upper end."""
    open_low: bool
    """Whether the search limits cut the lower side."""
    open_high: bool
    """Whether the search limits cut the upper side."""
    ways: tuple[DescentResult, ...] = ()
    """The fits along the profile, to the lower side and to the upper one."""

    @property
    def is_open(self) -> bool:
        """Whether either side is cut by the limits."""
        return self.open_low or self.open_high

    def widened(self, centre: float, ratio: float) -> "Interval":
        """Return the interval stretched about its centre."""
        low, high = (centre + ratio * (end - centre) for end in (self.low, self.high))
        return replace(self, low=low, high=high)


def profile_interval(
    problem: Problem,
    q: FloatArray,
    coordinate: int,
    deviation: float,
    limits: SearchBounds,
    *,
    rise: float,
) -> Interval:
    """Find where the profile likelihood of one coordinate has fallen by ``rise``.

    Coordinate 0 is ln R, 1 bearing, 2 speed, 3 course; its Laplace deviation is the
    first guess of the width.
    """
    polar = coordinate >= 2
    centre = to_polar(q) if polar else q.copy()
    profile = _Profile(problem, _bounds(limits, polar=polar), coordinate, rise, polar)
    low, open_low, before = profile.side(centre, -deviation)
    high, open_high, behind = profile.side(centre, deviation)
    return Interval(low, high, open_low, open_high, (before, behind))


def _bounds(limits: SearchBounds, *, polar: bool) -> SearchBounds:
    if not polar:
        return limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[2], lower[3], upper[3] = 0.0, -np.inf, np.inf
    upper[2] *= np.sqrt(2.0)
    return SearchBounds(lower, upper)


@dataclass(frozen=True, eq=False)
class _Profile:
    """Least misfit of a problem over all coordinates but one, which is held."""

    problem: Problem
    """What is fitted."""
    bounds: SearchBounds
    """Ends of the coordinates."""
    coordinate: int
    """Place of the coordinate that is held."""
    rise: float
    """Misfit over the least one at which the interval ends."""
    polar: bool
    """Whether coordinates are ranges and bearings."""

    def _fit(self, trials: FloatArray, *, iterations: int, tolerance: float) -> DescentResult:
        return minimise(
            self.problem, trials, self.bounds, held=(self.coordinate,),
            polar=self.polar, iterations=iterations, tolerance=tolerance,
        )  # fmt: skip

    def _tolerance(self, usual: float) -> float:
        """Return that of a descent; an instant between rows has a misfit with kinks."""
        return usual if self.bounds.lower.size == STRAIGHT else LOOSE

    def side(self, centre: FloatArray, deviation: float) -> tuple[float, bool, DescentResult]:
        """Follow the profile to one side: the crossing, whether it was cut, and the way.

        The way holds the fit at every point, with its excess over the first as value.
        """
        way = list[DescentResult]()
        place = float(centre[self.coordinate])
        ends = self.bounds.upper if deviation > 0 else self.bounds.lower
        end = ends[self.coordinate]
        reach = 2.0 * np.sqrt(self.rise) * deviation
        room = end - place if np.isfinite(end) else np.sign(reach) * np.pi
        start, base, done = centre, 0.0, 0.0
        for _ in range(6):
            reach = reach if abs(reach) < abs(room) else room
            value = done + (reach - done) * np.linspace(0.0, 1.0, STEPS + 1)
            trials = np.repeat(start[np.newaxis], value.size, axis=0)
            trials[:, self.coordinate] = place + value
            fit = self._fit(trials, iterations=25, tolerance=self._tolerance(1e-7))
            if done == 0.0:
                base = float(fit.value[0])
            excess, arrived = fit.value - base, fit.q.copy()
            self._follow_on(arrived, excess, trials[:, self.coordinate], base)
            way.append(DescentResult(arrived, fit.rest_hz, excess, fit.matrix))
            if (excess > self.rise).any():
                end, is_cut = _crossing(place + value, excess, self.rise), False
                break
            end, is_cut = float(place + reach), True
            if reach == room:
                break
            start, done, reach = arrived[-1], reach, 3.0 * reach
        return end, is_cut, DescentResult.join(way)

    def _follow_on(
        self, arrived: FloatArray, excess: FloatArray, place: FloatArray, base: float
    ) -> None:
        """Fit the first point beyond the rise from its neighbour, and go on if it is not.

        Where the points arrived and their excess are changed in place.
        """
        while (over := np.flatnonzero(excess > self.rise)).size and over[0]:
            here = int(over[0])
            trial = arrived[here - 1 : here].copy()
            trial[:, self.coordinate] = place[here]
            fit = self._fit(trial, iterations=100, tolerance=self._tolerance(1e-9))
            if fit.value[0] - base < excess[here]:
                excess[here], arrived[here] = float(fit.value[0]) - base, fit.q[0]
            if excess[here] > self.rise:
                return


def _crossing(place: FloatArray, excess: FloatArray, rise: float) -> float:
    """Interpolate the square root of the excess, linear for a parabola."""
    last = int(np.flatnonzero(excess > rise)[0])
    if last == 0:
        return float(place[0])
    root = np.sqrt(np.maximum(excess[last - 1 : last + 1], 0.0))
    share = (np.sqrt(rise) - root[0]) / max(root[1] - root[0], 1e-300)
    return float(place[last - 1] + share * (place[last] - place[last - 1]))


BARRIER = 0.5
"""Rise of the misfit between two minima that makes two modes of them."""


@dataclass(frozen=True, eq=False)
class Modes(Rows):
    """Distinct motions, best first, with weights that sum to one."""

    q: FloatArray
    """Motions in solver coordinates, shape (modes, p)."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (modes, lines)."""
    value: FloatArray
    """Misfit, shape (modes,)."""
    weight: FloatArray
    """Probabilities that sum to one, shape (modes,)."""
    between: FloatArray
    """Covariance between the minima that are one mode, shape (modes, p, p)."""


def find_modes(
    problem: Problem, fit: DescentResult, threshold: float, *, singular: bool = False
) -> Modes:
    """Pick the distinct minima, best first, within a threshold over the best.

    ``singular``: a whole line of motions fits alike, and one of them stands for all on
    its side of the array. Minima that differ in little but the instant of an alteration
    are one mode, which is as wide as they lie apart.
    """
    kept, owner = [0], {0: 0}
    for index in range(1, len(fit.q)):
        if fit.value[index] - fit.value[0] > threshold:
            break
        apart = _other_side if singular else _apart
        if not all(apart(problem, fit, index, other) for other in kept):
            continue
        alike = [other for other in owner if _alike(problem, fit, index, other)]
        owner[index] = owner[alike[0]] if alike else index
        if not alike:
            kept.append(index)
    minima = list(owner)
    log_weight = -0.5 * fit.value[minima] + 0.5 * _log_volume(
        fit.matrix[minima], float(np.ptp(problem.row_time_s))
    )
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    total, between = np.zeros(len(kept)), np.zeros((len(kept), *fit.matrix.shape[1:]))
    for index, share in zip(minima, weight, strict=True):
        place = kept.index(owner[index])
        total[place] += share
        off = fit.q[index] - fit.q[owner[index]]
        off[1] = wrap_rad(off[1])
        between[place] += share * np.outer(off, off)
    q = fit.q[kept].copy()
    q[:, 1] = np.mod(q[:, 1], 2.0 * np.pi)
    between /= np.maximum(total, 1e-300)[:, np.newaxis, np.newaxis]
    return Modes(q, fit.rest_hz[kept], fit.value[kept], total, between)


def _alike(problem: Problem, fit: DescentResult, a: int, b: int) -> bool:
    """Return whether two minima with alterations have the same first and last leg.

    Each lies in the other's region of 95 %, which then holds both.
    """
    from scipy.special import chdtri

    if fit.q.shape[1] == STRAIGHT:
        return False
    reach = float(chdtri(STRAIGHT, 1.0 - HELD))
    first = fit.q[a, :STRAIGHT] - fit.q[b, :STRAIGHT]
    first[1] = wrap_rad(first[1])
    end_s = float(problem.row_time_s[-1])
    ends = [state_at(fit.q[index], end_s) for index in (a, b)]
    last = ends[0][0] - ends[1][0]
    return all(
        off @ np.linalg.pinv(own, hermitian=True) @ off < reach
        for (_, rows), spread in zip(
            ends, np.linalg.pinv(fit.matrix[[a, b]], hermitian=True), strict=True
        )
        for off, own in ((first, spread[:STRAIGHT, :STRAIGHT]), (last, rows @ spread @ rows.T))
    )


def _apart(problem: Problem, fit: DescentResult, a: int, b: int) -> bool:
    """Return whether a barrier lies on the straight line from one to the other."""
    change = fit.q[b] - fit.q[a]
    change[1] = wrap_rad(change[1])
    # curvature of the better one: a distance far below a sigma is the same minimum
    if change @ fit.matrix[b] @ change < 1e-2:
        return False
    share = np.linspace(0.0, 1.0, 11)[1:-1, np.newaxis]
    between = misfit(problem, fit.q[a] + share * change)
    top = max(fit.value[a], fit.value[b])
    return bool(between.value.max() > top + BARRIER)


def _other_side(problem: Problem, fit: DescentResult, a: int, b: int) -> bool:
    """Return whether two motions start on other sides, or in other lobes, of an array."""
    if problem.array_heading_rad is None:
        return False
    off = wrap_rad(fit.q[[a, b], 1] - problem.array_heading_rad[0])
    if np.isnan(off).any():
        return False
    lobes = problem.lobe_cosine
    apart = 2.0 if lobes is None else float(lobes.min())
    return bool(off[0] * off[1] < 0 or abs(np.ptp(np.cos(off))) > 0.5 * apart)


def _log_volume(matrix: FloatArray, span_s: float) -> FloatArray:
    """Half-log volumes up to a constant; flat directions are cut at the bounds.

    Instants count in lengths of the record.
    """
    unit = np.ones(matrix.shape[-1])
    unit[STRAIGHT + 2 :: PER_ALTERATION] = max(span_s, 1e-9)
    values = np.linalg.eigvalsh(matrix * np.outer(unit, unit))
    # a direction flatter than this would reach beyond any search box
    return np.asarray(-np.log(np.maximum(values, 1e-2)).sum(-1))


@dataclass(frozen=True, eq=False)
class TmaOptions:
    """What an analysis of one contact needs besides the measurements."""

    nuisances: NuisanceDeviations
    """Deviations of sound speed, compass and own ship."""
    sound_speed_mps: float
    """Sound speed, m/s."""
    is_table: bool
    """Whether the measurements come from a table, not from lines."""
    navigation: Navigation | None = None
    """Own ship; None for a platform that stands still."""
    towing: Navigation | None = None
    """The ship that tows the array whose way ``navigation`` is; None: nothing does."""
    solver: SolverName = "mle"
    """Name of the solver."""
    array_heading: str = "none"
    """Direction of a line array: 'none', 'course' or 'heading'."""
    design_frequency_hz: float | None = None
    """Frequency at which the array's hydrophones lie half a wavelength apart, Hz; None: no
    array heard the lines."""
    fixed_heading_deg: float | None = None
    """Heading of a fixed sensor, degrees; None without a sensor."""
    height_m: float = 0.0
    """Depth between sensor and source, m."""
    delayed: bool = False
    """Whether sound takes its time."""
    updates: int = 1
    """Number of estimates over time."""
    seed: int = 1
    """Seed of the random solvers."""
    misfit: Misfit = field(default_factory=Misfit)
    """Deviations of the measurements and loss of residuals."""
    model: MotionModel = field(default_factory=MotionModel)
    """Model of Doppler and propagation."""
    prior: MotionPrior = field(default_factory=MotionPrior)
    """What is expected of the motion before the fit."""
    search: Search = field(default_factory=Search)
    """Limits of the search and of the modes."""
    compass_std_deg: float | None = None
    """Deviation of every sensor's compass that was asked for, degrees; None: the
    sensor's own."""
    bounce: Bounce | None = None
    """The reflected path whose delays the table has; None: it has none."""


@dataclass(frozen=True, eq=False)
class PosteriorPart:
    """A part of what the record leaves possible."""

    q: FloatArray
    """Motion in solver coordinates, shape (p,); p may be that of another number of
    legs."""
    covariance: FloatArray
    """Of these, shape (p, p)."""
    weight: float
    """Probability of the part."""


@dataclass(frozen=True, eq=False)
class ModeAnswer:
    """What is known of one mode."""

    q: FloatArray
    """Motion in solver coordinates, shape (p,)."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (lines,)."""
    value: float
    """Misfit."""
    weight: float
    """Probability of the mode."""
    covariance: FloatArray
    """Of range, bearing, speed, course (SI) and rest frequencies, shape (p, p)."""
    solver_covariance: FloatArray
    """Of the solver coordinates and rest frequencies, shape (p, p), without alterations
    that the evidence does not ask for."""
    now: FloatArray
    """Range, bearing, speed and course (SI) at the last measurement, shape (4,)."""
    now_std: FloatArray
    """Their deviations."""
    legs: tuple["Leg", ...]
    """Its legs, in order of time."""
    observability: Observability
    """Rank, condition and weakest direction."""
    ellipse_holds: bool
    """Whether the joint ellipse of 95 % holds what it should, by the likelihood."""
    intervals: dict[str, Interval]
    """Likelihood-ratio intervals of 'range' (ln m), 'speed' (m/s) and 'course'
    (rad)."""
    range_per_sound_speed: float
    """Relative change of range per relative change of sound speed."""
    at_limit_m: float | None
    """Limit of the search that stopped the range, m; None if none did."""
    nuisance_shares: dict[str, float]
    """Share of the variance of the range that each nuisance causes."""
    bearing_residual_deg: FloatArray
    """Model less measured bearing, offsets taken out, degrees, shape (rows,); nan where
    there is none; of several streams their mean."""
    offset_deg: FloatArray
    """Constant error of each stream of bearings, model less measured, degrees, shape
    (streams,)."""


def describe_mode(
    problem: Problem,
    limits: SearchBounds,
    modes: Modes,
    index: int,
    options: TmaOptions,
    *,
    scale: float,
    colours: Colours = NO_MEMORY,
    beside: tuple[tuple[Rival, ...], Alterations | None] = ((), None),
) -> ModeAnswer:
    """Work out what one of the modes says of the target.

    ``scale`` is that of likelihood ratios under the loss, 1 for least squares;
    ``colours`` are the memory of the noise, and ``beside`` motions with other numbers of
    legs and one more alteration, as `Legs` gives them.
    """
    from scipy.special import chdtri

    q = modes.q[index]
    end_s = float(problem.row_time_s[-1])
    rivals, more = beside
    if any(rival.q.size > q.size for rival in rivals):
        more = NOTHING
    elif more is None:
        more = seek_alteration(problem, q, options.nuisances, colours)
    moved = more.spread(q, problem.n_lines)
    found = information(problem, q)
    budget = error_budget(
        problem, q, found, options.nuisances, with_coloured_noise=options.is_table
    )
    inner = budget.covariance.copy()
    inner[: q.size, : q.size] += modes.between[index]
    covariance: FloatArray = found.turn @ inner @ found.turn.T
    back = np.eye(len(inner))
    back[: q.size, : q.size] = np.linalg.inv(state_jacobian(q[np.newaxis])[0])
    outward = found.turn @ back
    covariance = widened(covariance, more.weight, outward @ moved @ outward.T)
    white = found.covariance()
    r = residuals(problem, q[np.newaxis])
    own_covariance = inner[: q.size, : q.size]
    rise = scale * float(chdtri(1, 1.0 - options.search.confidence))
    intervals = _intervals(problem, q, (white, covariance), limits, rise)
    parts = _parts(problem, q, rivals, intervals, inner, options, scale)
    now, now_std = seen_at(problem, q, own_covariance, end_s, more, parts)
    if parts:
        _, first_std = seen_at(problem, q, own_covariance, 0.0, more, parts)
        ratio = np.ones(len(covariance))
        plain = np.sqrt(np.maximum(np.diagonal(covariance)[:STRAIGHT], 1e-300))
        ratio[:STRAIGHT] = first_std / plain
        covariance = covariance * np.outer(ratio, ratio)
    return ModeAnswer(
        q=q,
        rest_hz=modes.rest_hz[index],
        value=float(modes.value[index]),
        weight=float(modes.weight[index]),
        covariance=covariance,
        solver_covariance=inner,
        now=now,
        now_std=now_std,
        legs=legs_of(problem, q, own_covariance, more, parts),
        observability=assess(found, to_motion(q)),
        ellipse_holds=ellipse_holds(problem, q, white[: q.size, : q.size], scale),
        intervals=intervals,
        range_per_sound_speed=_sound_speed_effect(problem, q, limits),
        at_limit_m=_limit_met(q, limits),
        nuisance_shares={
            name: float(part[0, 0] / max(inner[0, 0], 1e-300))
            for name, part in budget.parts.items()
        },
        bearing_residual_deg=_mean_residual(problem, r),
        offset_deg=np.degrees(r.offset_rad[0]),
    )


def _parts(
    problem: Problem,
    q: FloatArray,
    rivals: tuple[Rival, ...],
    intervals: dict[str, Interval],
    covariance: FloatArray,
    options: TmaOptions,
    scale: float,
) -> tuple[PosteriorPart, ...]:
    """Return the parts of the posterior; none where the motion alone stands for it."""
    own: tuple[PosteriorPart, ...] = (PosteriorPart(q, covariance[: q.size, : q.size], 1.0),)
    if q.size > STRAIGHT:
        white = information(problem, q).covariance(people=False)
        beyond = (covariance - white)[: q.size, : q.size]
        own = _valley(intervals["range"], beyond, scale)
    elif not rivals:
        return ()
    left = 1.0 - sum(rival.weight for rival in rivals)
    found = [replace(one, weight=left * one.weight) for one in own]
    for rival in rivals:
        budget = error_budget(
            problem, rival.q, information(problem, rival.q), options.nuisances,
            with_coloured_noise=options.is_table,
        )  # fmt: skip
        size = rival.q.size
        found.append(PosteriorPart(rival.q, budget.covariance[:size, :size], rival.weight))
    return tuple(found)


def _mean_residual(problem: Problem, r: Residuals) -> FloatArray:
    """Return the mean residual of the bearings of every row, degrees."""
    weight = problem.bearing_weight
    count = np.count_nonzero(weight, axis=0)
    plain = np.where(weight > 0, r.bearing[0] / np.where(weight > 0, weight, 1.0), 0.0)
    mean = plain.sum(0) / np.maximum(count, 1)
    return np.degrees(np.where(count > 0, mean, np.nan))


def _limit_met(q: FloatArray, limits: SearchBounds) -> float | None:
    """Return the limit of the range that stopped the fit, m; None if none did."""
    for limit in (limits.lower[0], limits.upper[0]):
        if abs(q[0] - limit) < 1e-6:
            return float(np.exp(limit))
    return None


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg of a target, seen from own ship where it begins."""

    begin_s: float
    """When it begins, s from the first measurement."""
    end_s: float
    """When it ends, s from the first measurement."""
    state: FloatArray
    """Range, bearing, speed and course (SI) where it begins, shape (4,)."""
    std: FloatArray
    """Their deviations, shape (4,)."""
    altered_s: float
    """Middle of the alteration before it, s from the first measurement; nan for the
    first leg."""
    altered_std_s: float
    """Its deviation, s."""


def legs_of(
    problem: Problem,
    q: FloatArray,
    covariance: FloatArray,
    more: Alterations,
    parts: tuple[PosteriorPart, ...] = (),
) -> tuple[Leg, ...]:
    """Return the legs of a motion; the covariance is of its solver coordinates."""
    end_s = float(problem.row_time_s[-1])
    found, begin, altered = [], 0.0, (np.nan, np.nan)
    for first in range(STRAIGHT, q.size + 1, PER_ALTERATION):
        if first < q.size:
            middle, half = float(q[first + 2]), 0.5 * float(np.exp(q[first + 3]))
            end = max(middle - half, begin)
        else:
            end = end_s
        # a moment after the alteration, whose partials end there
        state, std = seen_at(problem, q, covariance, begin + 1e-6, more, parts)
        if parts:  # in its middle no other motion is still altering to the leg
            middle_s = 0.5 * (begin + end)
            std[2:] = seen_at(problem, q, covariance, middle_s, more, parts)[1][2:]
        found.append(Leg(begin, end, state, std, *altered))
        if first < q.size:
            begin = min(middle + half, end_s)
            variance = max(float(covariance[first + 2, first + 2]), 0.0)
            altered = middle, float(np.sqrt(variance))
    return tuple(found)


def seen_at(
    problem: Problem,
    q: FloatArray,
    covariance: FloatArray,
    time_s: float,
    more: Alterations = NOTHING,
    parts: tuple[PosteriorPart, ...] = (),
) -> tuple[FloatArray, FloatArray]:
    """Return range, bearing, speed and course (SI) at a time, s, with deviations.

    They count from the sensor of the first row. The covariance is that of the solver
    coordinates, shape (p, p). An alteration that may be, and the parts of the posterior
    where the motion alone does not stand for it, make the deviations hold 95 % of all.
    """
    motion, outward, spread = _seen(problem, q, covariance, time_s)
    moved = outward @ more.spread_at(q, time_s) @ outward.T
    variance = np.diagonal(widened(spread, more.weight, moved))
    if not parts:
        return motion, np.sqrt(np.maximum(variance, 0.0))
    others = [_seen(problem, one.q, one.covariance, time_s) for one in parts]
    off = np.array([other - motion for other, _, _ in others])
    off[:, [1, 3]] = wrap_rad(off[:, [1, 3]])
    own = np.array([np.diagonal(each) for _, _, each in others])
    own = np.concatenate([own, np.diagonal(moved, axis1=1, axis2=2) + np.diagonal(spread)])
    share = np.array([one.weight for one in parts]) * (1.0 - more.weight.sum())
    share = np.concatenate([share, more.weight])
    mean = np.concatenate([off, np.zeros((more.weight.size, off.shape[1]))])
    std = np.sqrt(np.maximum(own, 1e-300))
    half = [half_width(share, mean[:, k], std[:, k]) for k in range(off.shape[1])]
    return motion, np.array(half) / HALF_WIDTH


def _seen(
    problem: Problem, q: FloatArray, covariance: FloatArray, time_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return range, bearing, speed and course at a time, and their covariance.

    Between them the partials of these by the state at that time.
    """
    track, sensor = problem.track, problem.sensor
    node = track.now if sensor is None else track.now[sensor == sensor[0]]
    state, partials = state_at(q, time_s)
    for place, own in enumerate((track.east_m, track.north_m)):
        state[place] -= np.interp(time_s, track.time_s[node], own[node])
    spread = partials @ covariance @ partials.T
    local = from_state(state)
    inward = np.linalg.inv(state_jacobian(local[np.newaxis])[0])
    outward = motion_jacobian(local[np.newaxis])[0] @ inward
    return to_motion(local), outward, outward @ spread @ outward.T


SMALLEST_PART = 1e-3
"""Probability below which a part of the posterior is left out."""


def _valley(range_span: Interval, more: FloatArray, scale: float) -> tuple[PosteriorPart, ...]:
    """Return the parts of the posterior along the profile of the range.

    The likelihood of a target with legs lies in a long valley that bends: at every range
    the rest is normal about its best fit (Laplace's approximation there), and ``more`` is
    the covariance that noise beyond the white adds, shape (p, p).
    """
    ways = range_span.ways
    fits = DescentResult.join([ways[0], ways[1]])
    order = np.argsort(fits.q[:, 0], kind="stable")
    fits = fits.take(order)
    width = np.gradient(fits.q[:, 0])
    inner = fits.matrix[:, 1:, 1:]
    root = np.sqrt(np.maximum(np.diagonal(inner, axis1=1, axis2=2), 1e-300))
    unit = inner / (root[:, :, np.newaxis] * root[:, np.newaxis])
    volume = np.log(np.maximum(np.linalg.eigvalsh(unit), 1e-13)).sum(axis=1)
    volume = volume + 2.0 * np.log(root).sum(axis=1)
    log_weight = -0.5 * fits.value / scale - 0.5 * volume
    weight = width * np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    found = []
    for index in np.flatnonzero(weight > SMALLEST_PART):
        covariance = more.copy()
        covariance[1:, 1:] += scale * scaled_inverse(inner[index])
        found.append(PosteriorPart(fits.q[index], covariance, float(weight[index])))
    return tuple(found)


def _intervals(
    problem: Problem,
    q: FloatArray,
    covariances: tuple[FloatArray, FloatArray],
    limits: SearchBounds,
    rise: float,
) -> dict[str, Interval]:
    """Follow the profiles, and widen them by what white noise does not explain."""
    motion = to_motion(q)
    std, wide = (np.sqrt(np.maximum(np.diagonal(c), 0.0)) for c in covariances)
    first_steps = {
        "range": (0, min(float(std[0] / motion[0]), 1.0)),
        "speed": (2, min(float(std[2]), float(limits.upper[2]) / 2.0)),
        "course": (3, min(float(std[3]), 0.8)),
    }
    centres = {"range": q[0], "speed": motion[2], "course": to_polar(q)[3]}
    found = {}
    for name, (axis, step) in first_steps.items():
        span = profile_interval(problem, q, axis, max(step, 1e-6), limits, rise=rise)
        ratio = wide[axis] / std[axis] if std[axis] > 0 else 1.0
        found[name] = span.widened(centres[name], float(max(ratio, 1.0)))
    return found


def _sound_speed_effect(problem: Problem, q: FloatArray, limits: SearchBounds) -> float:
    """Relative change of range when the assumed sound speed is 1 % higher."""
    other = replace(problem, sound_speed_mps=1.01 * problem.sound_speed_mps)
    moved = minimise(other, q[np.newaxis], limits, iterations=20)
    return float((moved.q[0, 0] - q[0]) / np.log(1.01))
