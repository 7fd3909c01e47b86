"""Whether the parts of the band tell one passage: what a rise of the level alone needs.

**Method.** A rise of the broadband is a passage where the sound of one source comes
nearer and goes away in all of its spectrum at once. Each part of the band has a level of
its own; b + a / (1 + ((t - t0) / w)^2), the power of a source that passes over a constant
background, is fitted to each by itself, with the scatter and correlation of its own
residuals. Parts that rise by more than noise must agree on t0 and w: the chi-square of
each part's own values about the common ones, with the deviation that the law leaves to
either besides (`LAW_SHARE`: sources have directions, and spread by other laws). Then the law must explain the parts better
than others do: a raised cosine and a flat top in power (gusts, pumps, doors), a rise and
fall of unequal length (rain), and one gain for all parts, noise and all.

Whole shapes are searched on grids that are refined; background and height follow by
linear least squares.

Both flanks must be recorded: a rise that the recording ends in may be a slow drift.

**Conventions.** Power over the quiet time; times count from the first sample. Costs are
halves of chi-square: differences are log-likelihood ratios.

**References.** Choi et al. (2014), eq. 3, for the law; Golub and Pereyra (1973), SIAM J.
Numer. Anal. 10, 413, for the separation of linear unknowns.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.passage.candidates import CandidatePassage
from uwtrack_cli.motion.passage.encounter_rows import LAW_SHARE

REACH = 3.0
"""d/v on either side of the closest approach that are compared: farther away other
vessels are as loud."""

FEWEST_FRAMES = 12
"""Frames there below which no part rises."""

LEAST_FLANK = 0.7
"""d/v to either side that must be recorded: where the excess has not fallen by a third,
a slow drift of the ambient level looks alike."""

FEWEST_PARTS = 4
"""Parts of the band that must rise."""

LEAST_GAIN = 10.0
"""Gain in log-likelihood over a constant from which a part rises: chance in a thousand
over the places and widths that are tried."""

SMALLEST_PROBABILITY = 0.01
"""Probability of the disagreement below which the parts tell different passages."""

STEPS, ROUNDS, FINER = 9, 4, 0.35
"""Places and widths that are tried at once, how often, and how much finer each time."""

SPAN = 1.0
"""First span of the places, in d/v, and of the logarithms of the widths."""

STEP = 0.03
"""Step of the differences that tell a curvature, in d/v and in logarithms."""

SMALLEST_CHANGE = 1e-6
"""Variance of a shape below which it is not told from the background."""

SMALLEST_STD = 0.02
"""Deviation of a part's power that is assumed at least, as a share of it: the law holds
no better, with fringes and directions of sources."""

Shape = Callable[[FloatArray], FloatArray]


class Agreement(NamedTuple):
    """What the parts of the band say of a rise."""

    n_parts: int
    """Parts that rise by themselves."""
    probability: float
    """Probability that parts of one passage disagree as much; nan with few parts."""
    rival: str
    """What explains the parts best, `PASSAGE` if the law does."""
    gain: float
    """Log-likelihood of the law over that of its best rival."""
    flank: float = np.inf
    """What is recorded on the shorter side of the rise, in d/v."""

    @property
    def reason(self) -> str:
        """Why this is no passage by its levels alone; empty if it is one."""
        if self.flank < LEAST_FLANK:
            return (
                f"the level alone makes a passage with {LEAST_FLANK:g} d/v recorded "
                f"before and after it, got {max(self.flank, 0.0):.2g}"
            )
        if self.n_parts < FEWEST_PARTS:
            return (
                f"{self.n_parts} parts of the band rise by themselves, and the level "
                f"alone makes a passage with {FEWEST_PARTS}"
            )
        if self.probability < SMALLEST_PROBABILITY:
            return (
                f"the parts of the band tell different times or widths (chance "
                f"{self.probability:.1g})"
            )
        if self.gain < 0.0:
            return f"its levels rise and fall more as {self.rival} than as a passage"
        return ""


PASSAGE = "a passage"


def _law(u: FloatArray) -> FloatArray:
    law: FloatArray = 1.0 / (1.0 + u**2)
    return law


def _raised_cosine(u: FloatArray) -> FloatArray:
    cosine: FloatArray = np.cos(0.25 * np.pi * np.clip(u, -2.0, 2.0)) ** 2
    return cosine


def _flat_top(u: FloatArray) -> FloatArray:
    top: FloatArray = np.clip(2.0 - np.abs(u), 0.0, 1.0)
    return top


def _slow_fall(u: FloatArray) -> FloatArray:
    ramps: FloatArray = np.clip(np.minimum(1.0 + 2.0 * u, 1.0 - 0.5 * u), 0.0, 1.0)
    return ramps


def _slow_rise(u: FloatArray) -> FloatArray:
    return _slow_fall(-u)


RIVALS: dict[str, Shape] = {
    "a gust": _raised_cosine,
    "a door that opens and shuts": _flat_top,
    "rain that begins and dies away": _slow_fall,
    "what swells and stops": _slow_rise,
}
"""Shapes of power that are no passages."""

GAIN = "one gain for all"


class _Parts(NamedTuple):
    """Levels of the parts about a rise."""

    time_s: FloatArray
    """Times, s, shape (n,)."""
    power: FloatArray
    """Power over the quiet time, shape (part, n)."""
    weight: FloatArray
    """Inverse variances, shape (part, n)."""


def ask_the_parts(candidate: CandidatePassage, levels: Levels) -> CandidatePassage:
    """Return a passage of the level alone with what the parts of the band say.

    Parameters
    ----------
    candidate
        A significant fit without lines, or whose lines show no Doppler shift.
    levels
        Levels of the recording.

    Returns
    -------
    CandidatePassage
        The same, with a doubt where neither bearings that turn nor the parts tell a
        passage.
    """
    gain = candidate.likelihood_ratio
    if candidate.doubt or gain.bearing > gain.threshold:
        return candidate
    fit = candidate.fit
    told = agreement(levels, float(fit.theta[0, 0]), float(fit.range_over_speed_s[0]))
    return replace(candidate, doubt=told.reason) if told else candidate


def agreement(levels: Levels, time_s: float, width_s: float) -> Agreement | None:
    """Ask the parts of the band whether a rise of the level is one passage.

    Parameters
    ----------
    levels
        Levels of the recording.
    time_s
        When the rise is highest, s from the first sample.
    width_s
        Its d/v, s.

    Returns
    -------
    Agreement | None
        None where the levels are those of an older product, without parts.
    """
    if levels.part_excess_db is None:
        return None
    lag = levels.frames.time_s - time_s
    near = np.abs(lag) < REACH * width_s
    near &= np.isfinite(levels.part_excess_db).all(axis=1)
    flank = float(min(-lag[0], lag[-1])) / width_s
    if flank < LEAST_FLANK or np.count_nonzero(near) < FEWEST_FRAMES:
        return Agreement(0, np.nan, PASSAGE, 0.0, flank)
    power = 10 ** (levels.part_excess_db[near].T.astype(np.float64) / 10)
    weight = 1 / _smooth(power, max(1, round(width_s / levels.frames.hop_s / 4))) ** 2
    parts = _Parts(levels.frames.time_s[near], power, weight)
    centre = (time_s, float(np.log(width_s)))
    risen: list[int] = []
    scale = np.ones(power.shape[0])
    told, information = [], []
    for k in range(power.shape[0]):
        one = _only(parts, [k])
        best, _ = _least(one, _law, centre, width_s)
        scale[k] = _noise(one, best)
        one = one._replace(weight=one.weight / scale[k])
        if _flat(one) - _least(one, _law, best, 0.0)[1] > LEAST_GAIN:
            risen.append(k)
            told.append([(best[0] - time_s) / width_s, best[1] - centre[1]])
            information.append(_curvature(one, best))
    if len(risen) < FEWEST_PARTS:
        return Agreement(len(risen), np.nan, PASSAGE, 0.0)
    scaled = _only(parts, risen)
    scaled = scaled._replace(weight=scaled.weight / scale[risen, None])
    _, together = _least(scaled, _law, centre, width_s)
    chi_square = _disagreement(np.array(told), np.array(information))
    others = {
        name: _least(scaled, shape, centre, width_s)[1]
        for name, shape in RIVALS.items()
    }
    others[GAIN] = _least_gain(scaled, centre, width_s)
    rival = min(others, key=lambda name: others[name])
    gain = others[rival] - together
    return Agreement(
        len(risen), _exceeded(chi_square, 2 * (len(risen) - 1)),
        rival if gain < 0 else PASSAGE, gain,
    )  # fmt: skip


def _curvature(parts: _Parts, best: tuple[float, float]) -> FloatArray:
    """Return the information about place, in d/v, and ln of the width, shape (2, 2)."""
    steps = STEP * np.arange(-1, 2)
    cost = _costs(
        parts,
        _columns(parts, _law, best[0] + np.exp(best[1]) * steps, best[1] + steps),
    ).reshape(3, 3)  # fmt: skip
    mixed = (cost[2, 2] - cost[2, 0] - cost[0, 2] + cost[0, 0]) / 4
    second = [cost[0, 1] + cost[2, 1], cost[1, 0] + cost[1, 2]]
    own = np.maximum(np.array(second) - 2 * cost[1, 1], 1e-9)
    mixed = np.clip(mixed, *(0.99 * np.sqrt(own.prod()) * np.array([-1, 1])))
    found: FloatArray = np.array([[own[0], mixed], [mixed, own[1]]]) / STEP**2
    return found


def _disagreement(told: FloatArray, information: FloatArray) -> float:
    """Return the chi-square of the parts' values about their common ones."""
    variance = np.linalg.inv(information) + LAW_SHARE**2 * np.eye(2)
    weight = np.linalg.inv(variance)
    common = np.linalg.solve(weight.sum(axis=0), np.einsum("kij,kj->i", weight, told))
    off = told - common
    return float(np.einsum("ki,kij,kj->", off, weight, off))


def _exceeded(chi_square: float, degrees: int) -> float:
    """Return the probability that a chi-square of even degrees exceeds a value."""
    terms = np.arange(degrees // 2)
    half = 0.5 * chi_square
    logs = terms * np.log(max(half, 1e-300)) - np.cumsum(
        np.log(np.maximum(terms, 1))
    )  # fmt: skip
    return float(min(1.0, np.exp(logs - half).sum()))


def _only(parts: _Parts, rows: list[int]) -> _Parts:
    return _Parts(parts.time_s, parts.power[rows], parts.weight[rows])


def _smooth(power: FloatArray, half: int) -> FloatArray:
    """Return the running mean of each part, for weights that noise does not bias."""
    kernel = np.ones(2 * half + 1)
    total = [np.convolve(row, kernel, "same") for row in power]
    count = np.convolve(np.ones(power.shape[1]), kernel, "same")
    return np.maximum(np.array(total) / count, 1e-12)


def _columns(
    parts: _Parts, shape: Shape, place_s: FloatArray, log_width: FloatArray
) -> FloatArray:
    """Return the shape at every place and width, shape (place * width, n)."""
    lag = parts.time_s - place_s[:, None]
    columns = shape(lag[:, None] / np.exp(log_width)[:, None])
    return columns.reshape(-1, parts.time_s.size)


def _costs(parts: _Parts, columns: FloatArray) -> FloatArray:
    """Return half the chi-square of each column, summed over the parts.

    Background and height are those of least squares; a height below zero is none.
    """
    weight, power = parts.weight, parts.power
    total, first = weight.sum(axis=1), (weight * power).sum(axis=1)
    whole = (weight * power**2).sum(axis=1) - first**2 / total
    mean = weight @ columns.T / total[:, None]
    square = weight @ (columns**2).T - total[:, None] * mean**2
    along = (weight * power) @ columns.T - first[:, None] * mean
    # a column that hardly changes there is the background again
    changes = square > SMALLEST_CHANGE * total[:, None]
    gain = np.where(changes, np.maximum(along, 0.0) ** 2, 0.0)
    gain /= np.where(changes, square, 1.0)
    costs: FloatArray = 0.5 * (whole[:, None] - gain).sum(axis=0)
    return costs


def _flat(parts: _Parts) -> float:
    return float(_costs(parts, np.zeros((1, parts.time_s.size)))[0])


def _grids(
    centre: tuple[float, float], width_s: float, turn: int
) -> tuple[FloatArray, FloatArray]:
    reach = np.linspace(-SPAN, SPAN, STEPS) * FINER**turn
    return centre[0] + width_s * reach, centre[1] + reach


def _least(
    parts: _Parts, shape: Shape, centre: tuple[float, float], width_s: float
) -> tuple[tuple[float, float], float]:
    """Return place and ln of the width of least cost, and that cost."""
    cost = np.inf
    for turn in range(ROUNDS):
        places, widths = _grids(centre, width_s, turn)
        costs = _costs(parts, _columns(parts, shape, places, widths))
        best = int(np.argmin(costs))
        cost = float(costs[best])
        centre = (float(places[best // STEPS]), float(widths[best % STEPS]))
    return centre, cost


def _least_gain(parts: _Parts, centre: tuple[float, float], width_s: float) -> float:
    """Return the cost of a gain of all parts that rises and falls, noise and all."""
    level = np.log(np.maximum(parts.power, 1e-12))
    # in logarithms the deviation of a power is its share
    weight = parts.weight * parts.power**2
    cost = np.inf
    for turn in range(ROUNDS):
        places, widths = _grids(centre, width_s, turn)
        columns = _columns(parts, _raised_cosine, places, widths)
        total = weight.sum(axis=1)
        mean = (weight * level).sum(axis=1) / total
        free = level - mean[:, None]
        usual = weight @ columns.T / total[:, None]
        square = (weight @ (columns**2).T - total[:, None] * usual**2).sum(axis=0)
        along = ((weight * free) @ columns.T).sum(axis=0)
        changes = square > SMALLEST_CHANGE * total.sum()
        gain = np.where(changes, along, 0.0) ** 2 / np.where(changes, square, 1.0)
        costs = 0.5 * ((weight * free**2).sum() - gain)
        best = int(np.argmin(costs))
        cost = float(costs[best])
        centre = (float(places[best // STEPS]), float(widths[best % STEPS]))
    return cost


def _noise(parts: _Parts, best: tuple[float, float]) -> float:
    """Return the variance of a part's residuals, times their correlation sum."""
    (column,) = _columns(parts, _law, np.array([best[0]]), np.array([best[1]]))
    basis = np.stack([np.ones(column.size), column], axis=1)
    root = np.sqrt(parts.weight[0])
    values, *_ = np.linalg.lstsq(root[:, None] * basis, root * parts.power[0])
    residual = root * (parts.power[0] - basis @ values)
    variance = max(float(np.mean(residual**2)), SMALLEST_STD**2)
    correlation = 1.0
    for lag in range(1, residual.size // 4):
        share = float(np.mean(residual[lag:] * residual[:-lag])) / variance
        if share < 0.05:
            break
        correlation += 2.0 * share
    return variance * correlation
