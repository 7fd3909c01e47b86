"""Whether the parts of the band tell one passage: what a rise of the level alone needs.

**Method.** A rise of the broadband is a passage where the sound of one source comes
nearer and goes away in all of its spectrum at once. Each part of the band has a level of
its own; b + a / (1 + ((t - t0) / w)^2), the power of a source that passes over a constant
background, is fitted to each by itself, with the scatter and correlation of its own
residuals. Parts that rise by more than noise must agree on t0 and w: the chi-square of
each part's own values about the common ones, with the deviation that the law leaves to
either besides (`LAW_SHARE`: sources have directions, and spread by other laws). Then the law must explain the parts better
than others do: a raised cosine and a flat top in power (gusts, pumps, doors), a rise and
fall of unequal length (rain), a bell with even or uneven flanks (squalls, an aircraft far
off: a passage has longer tails), and one gain for all parts, of any course in time (the
ambient sound drifts, a recorder turns itself up): of a vessel each part rises by as much
as its own spectrum stands above the ambient's. Where the surface or the ground reflects
a source, its parts have fringes (`surface_image`): then the law is that with the fringes
of one reflection, the same for all parts, and it pays for what was searched.

Where several rises are told as passages, each is asked with the laws of the others beside
it, in every fit. Together they must explain the parts better than one squall does that
rises, stays and dies away in times of its own; what is refused is beside nobody.

Whole shapes are searched on grids that are refined; background and height follow by
linear least squares.

Both flanks must be recorded: a rise that the recording ends in may be a slow drift.

**Conventions.** Power over the quiet time; times count from the first sample. Costs are
halves of chi-square: differences are log-likelihood ratios.

**References.** Choi et al. (2014), eq. 3, for the law; Golub and Pereyra (1973), SIAM J.
Numer. Anal. 10, 413, for the separation of linear unknowns.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.alternatives import ENOUGH_SUB_BANDS
from uwtrack_cli.motion.passage.candidates import CandidatePassage
from uwtrack_cli.motion.passage.checks.surface_image import LEAST_GAIN as LEAST_IMAGE_GAIN
from uwtrack_cli.motion.passage.checks.surface_image import (
    Image,
    correlation_sum,
    find_image,
    gain_of,
    residuals,
)
from uwtrack_cli.motion.passage.fit.source_patterns import LAW_SHARE

REACH = 3.0
"""d/v on either side of the closest approach that are compared: farther away other
vessels are as loud."""

FEWEST_FRAMES = 12
"""Frames there below which no part rises."""

LEAST_FLANK = 0.7
"""d/v to either side that must be recorded: where the excess has not fallen by a third,
a slow drift of the ambient level looks alike."""

LEAST_GAIN = 10.0
"""Gain in log-likelihood over a constant from which a part rises: chance in a thousand
over the places and widths that are tried."""

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
    def is_passage(self) -> bool:
        """Whether enough sub-bands rise, and rather as a passage than otherwise."""
        return self.n_parts >= ENOUGH_SUB_BANDS and self.gain >= 0.0


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
    ramps: FloatArray = np.maximum(np.minimum(1.0 + 2.0 * u, 1.0 - 0.5 * u), 0.0)
    return ramps


def _slow_rise(u: FloatArray) -> FloatArray:
    return _slow_fall(-u)


def _bell(u: FloatArray) -> FloatArray:
    bell: FloatArray = np.exp2(-(u**2))
    return bell


def _bell_slow_fall(u: FloatArray) -> FloatArray:
    return _bell(np.where(u < 0, u * UNEVEN, u / UNEVEN))


def _bell_slow_rise(u: FloatArray) -> FloatArray:
    return _bell_slow_fall(-u)


UNEVEN = 1.6
"""Square root of the ratio of both flanks of an uneven bell."""

RIVALS: dict[str, Shape] = {
    "a gust": _raised_cosine,
    "a door that opens and shuts": _flat_top,
    "rain that begins and dies away": _slow_fall,
    "what swells and stops": _slow_rise,
    "a squall": _bell,
    "a squall that goes slowly": _bell_slow_fall,
    "a squall that comes slowly": _bell_slow_rise,
}
"""Shapes of power that are no passages."""

GAIN_ROUNDS = 20
"""Rounds in which the gain and the parts' own levels are fitted in turn."""

HALF_NORMAL = 0.455
"""Median of the square of a normal variable of unit variance."""

GAIN = "one gain for all"
SQUALL = "one squall"

BIN, FEWEST_OF_BIN = 0.25, 3
"""Length over which parts are averaged to be held against a gain, in d/v, and frames."""

OTHER_WIDTHS = (0.7, 1.4)
"""Widths, over that of the whole level, at which fringes are sought besides."""

SQUALL_STEPS = (9, 5, 5, 5)
"""Begins, rises, stays and falls of a squall that are tried at once."""


class Rise(NamedTuple):
    """A rise of the level."""

    time_s: float
    """When it is highest, s."""
    width_s: float
    """Its d/v, s."""

    @classmethod
    def of(cls, candidate: CandidatePassage) -> "Rise":
        """Return the rise of a candidate."""
        fit = candidate.fit
        return cls(float(fit.theta[0, 0]), float(fit.range_over_speed_s[0]))


class _Parts(NamedTuple):
    """Levels of the parts about a rise."""

    time_s: FloatArray
    """Times, s, shape (n,)."""
    power: FloatArray
    """Power over the quiet time, shape (part, n)."""
    weight: FloatArray
    """Inverse variances, shape (part, n)."""
    basis: FloatArray
    """Background and laws of other passages, shape (1 + other, n)."""
    edges_hz: FloatArray
    """Lower and upper edges, Hz, shape (part, 2)."""
    image: Image | None = None
    """Reflection whose fringes the law has."""


def ask_the_parts(
    candidate: CandidatePassage, levels: Levels, beside: Sequence[Rise] = ()
) -> CandidatePassage:
    """Return a passage of the level alone with what the parts of the band say.

    Parameters
    ----------
    candidate
        A significant fit without lines, or whose lines show no Doppler shift.
    levels
        Levels of the recording.
    beside
        Other passages that the broadband tells.

    Returns
    -------
    CandidatePassage
        The same with what they say; nothing is asked where bearings turn.
    """
    gain = candidate.likelihood_ratio
    if gain.bearing > gain.threshold:
        return candidate
    told = agreement(levels, *Rise.of(candidate), beside)
    if told is None:
        return candidate.measured(as_given=1.0)
    return candidate.measured(
        sub_bands=told.n_parts, sub_bands_agree=told.probability, sub_bands_gain=told.gain
    )


def ask_the_parts_of_all(
    rises: Sequence[CandidatePassage], levels: Sequence[Levels], beside: Sequence[Rise] = ()
) -> list[CandidatePassage]:
    """Ask the parts about several rises, each beside those that are not refused.

    Parameters
    ----------
    rises
        Significant fits without lines.
    levels
        Levels of the recording as each would have made them alone.
    beside
        Passages that lines have shown.
    """
    told = list(rises)
    while True:
        left = [number for number, item in enumerate(told) if item.passes]
        asked = list(told)
        for number in left:
            others = [Rise.of(told[other]) for other in left if other != number]
            near = [*beside, *others]
            asked[number] = ask_the_parts(told[number], levels[number], near)
        asked = _beside_larger(asked, left, beside)
        if all(asked[number].passes for number in left):
            return asked
        told = asked


def _beside_larger(
    rises: list[CandidatePassage], left: list[int], beside: Sequence[Rise]
) -> list[CandidatePassage]:
    """Measure how near each rise is to a larger one that passes."""
    places = [one.time_s for one in beside]
    asked = list(rises)
    for number in sorted(left, key=lambda n: -rises[n].likelihood_ratio.total):
        time_s = Rise.of(rises[number]).time_s
        if places:
            apart_s = min(abs(time_s - other) for other in places)
            asked[number] = rises[number].measured(apart_s=apart_s)
        if asked[number].passes:
            places.append(time_s)
    return asked


def agreement(
    levels: Levels, time_s: float, width_s: float, beside: Sequence[Rise] = ()
) -> Agreement | None:
    """Ask the parts of the band whether a rise of the level is one passage.

    Parameters
    ----------
    levels
        Levels of the recording.
    time_s
        When the rise is highest, s from the first sample.
    width_s
        Its d/v, s.
    beside
        Other passages that the broadband tells.

    Returns
    -------
    Agreement | None
        None where the levels are those of an older product, without parts.
    """
    if levels.part_excess_db is None:
        return None
    lag = levels.frames.time_s - time_s
    near = np.abs(lag) < REACH * width_s
    near &= _heard(levels)
    flank = float(min(-lag[0], lag[-1])) / width_s
    if flank < LEAST_FLANK or np.count_nonzero(near) < FEWEST_FRAMES:
        return Agreement(0, np.nan, PASSAGE, 0.0, flank)
    parts = _parts(levels, near, width_s, beside)
    own = Rise(time_s, width_s)
    crowd = [own, *(one for one in beside if _meet(own, one))]
    over_squall = _squall_over_laws(levels, crowd) if len(crowd) > 1 else np.inf
    image = _image(parts, own)
    first = _told(parts._replace(image=image), own, over_squall)
    if first.is_passage:
        return first
    # the level of the whole band has the fringes, too, and its width need not be right
    for factor in OTHER_WIDTHS:
        wide = own._replace(width_s=factor * width_s)
        image = _image(parts, wide)
        told = _told(parts._replace(image=image), wide, over_squall)
        if image is not None and told.is_passage:
            return told
    return first


def _told(parts: _Parts, own: Rise, over_squall: float) -> Agreement:
    """Return what the parts say of a rise whose law may have fringes."""
    power, width_s = parts.power, own.width_s
    centre = (own.time_s, float(np.log(width_s)))
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
            told.append([(best[0] - own.time_s) / width_s, best[1] - centre[1]])
            information.append(_curvature(one, best))
    if len(risen) < ENOUGH_SUB_BANDS:
        return Agreement(len(risen), np.nan, PASSAGE, 0.0)
    scaled = _only(parts, risen)
    scaled = scaled._replace(weight=scaled.weight / scale[risen, None])
    _, together = _least(scaled, _law, centre, width_s)
    chi_square = _disagreement(np.array(told), np.array(information))
    gains = {
        name: _least(scaled, shape, centre, width_s)[1] - together for name, shape in RIVALS.items()
    }
    gains |= {GAIN: _gain_over_law(parts, own), SQUALL: over_squall}
    rival = min(gains, key=lambda name: gains[name])
    # fringes were searched for, and pay for it
    gain = gains[rival] - (LEAST_IMAGE_GAIN if parts.image else 0.0)
    return Agreement(
        len(risen), _exceeded(chi_square, 2 * (len(risen) - 1)),
        rival if gain < 0 else PASSAGE, gain,
    )  # fmt: skip


def is_one_with_fringes(levels: Levels, one: Rise, crowd: Sequence[Rise]) -> bool:
    """Tell whether several rises are one passage whose parts have fringes.

    Fringes make the top of a rise flat, or hollow, and the whole looks like several.

    Parameters
    ----------
    levels
        Levels of the recording.
    one
        The passage that the whole level shows.
    crowd
        The rises that it was taken for.
    """
    apart = any(not _meet(one, other) for other in crowd)
    if apart or levels.part_excess_db is None:
        return False
    first_s = min(each.time_s - REACH * each.width_s for each in (one, *crowd))
    last_s = max(each.time_s + REACH * each.width_s for each in (one, *crowd))
    time_s = levels.frames.time_s
    frames = (time_s > first_s) & (time_s < last_s) & _heard(levels)
    if np.count_nonzero(frames) < FEWEST_FRAMES:
        return False
    parts = _parts(levels, frames, one.width_s, ())
    several = _parts(levels, frames, one.width_s, crowd)
    usual = 1 / np.sqrt(parts.weight)
    none = np.zeros((len(parts.power), 1, parts.time_s.size))
    left = residuals(parts.power, usual, several.basis, none)[:, 0]
    for factor in (1.0, *OTHER_WIDTHS):
        wide = one._replace(width_s=factor * one.width_s)
        image = _image(parts, wide)
        if image is None:
            continue
        fringed = parts._replace(image=image)
        place, log_width = np.array([wide.time_s]), np.log([wide.width_s])
        columns = _columns(fringed, _law, place, log_width)
        own = residuals(parts.power, usual, parts.basis, columns)[:, 0]
        if gain_of(left, own) > LEAST_IMAGE_GAIN:
            return True
    return False


def _curvature(parts: _Parts, best: tuple[float, float]) -> FloatArray:
    """Return the information about place, in d/v, and ln of the width, shape (2, 2)."""
    steps = STEP * np.arange(-1, 2)
    cost = _costs(
        parts, _columns(parts, _law, best[0] + np.exp(best[1]) * steps, best[1] + steps)
    ).reshape(3, 3)
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
    logs = terms * np.log(max(half, 1e-300)) - np.cumsum(np.log(np.maximum(terms, 1)))
    return float(min(1.0, np.exp(logs - half).sum()))


def _only(parts: _Parts, rows: list[int]) -> _Parts:
    return parts._replace(
        power=parts.power[rows], weight=parts.weight[rows], edges_hz=parts.edges_hz[rows]
    )


def _image(parts: _Parts, rise: Rise) -> Image | None:
    """Return the reflection whose fringes a passage has in its parts."""
    u = (parts.time_s - rise.time_s) / rise.width_s
    usual = 1 / np.sqrt(parts.weight)
    return find_image(u, parts.power, usual, parts.basis, parts.edges_hz)


def _heard(levels: Levels) -> BoolArray:
    if levels.part_excess_db is None:
        return np.zeros(levels.frames.n_frames, np.bool_)
    return np.asarray(np.isfinite(levels.part_excess_db).all(axis=1), np.bool_)


def _parts(levels: Levels, frames: BoolArray, width_s: float, beside: Sequence[Rise]) -> _Parts:
    """Return the parts in some frames, with the laws of what passes beside."""
    excess_db = np.asarray(levels.part_excess_db, np.float64)[frames]
    power = 10 ** (excess_db.T / 10)
    weight = 1 / _smooth(power, max(1, round(width_s / levels.frames.hop_s / 4))) ** 2
    time_s = levels.frames.time_s[frames]
    laws = [_law((time_s - one.time_s) / one.width_s) for one in beside]
    # a law that hardly changes there is the background again
    laws = [law for law in laws if np.ptp(law) > SMALLEST_STD]
    edges = np.linspace(levels.band_low_hz, levels.band_high_hz, len(power) + 1)
    basis = np.array([np.ones(time_s.size), *laws])
    return _Parts(time_s, power, weight, basis, np.stack([edges[:-1], edges[1:]], 1))


def _meet(one: Rise, other: Rise) -> bool:
    """Tell whether two rises may be parts of one."""
    return abs(one.time_s - other.time_s) < REACH * max(one.width_s, other.width_s)


def _smooth(power: FloatArray, half: int) -> FloatArray:
    """Return the running mean of each part, for weights that noise does not bias."""
    kernel = np.ones(2 * half + 1)
    total = [np.convolve(row, kernel, "same") for row in power]
    count = np.convolve(np.ones(power.shape[1]), kernel, "same")
    return np.maximum(np.array(total) / count, 1e-12)


def _columns(parts: _Parts, shape: Shape, place_s: FloatArray, log_width: FloatArray) -> FloatArray:
    """Return the shape at every place and width, shape (part or 1, place * width, n)."""
    lag = parts.time_s - place_s[:, None]
    u = (lag[:, None] / np.exp(log_width)[:, None]).reshape(-1, parts.time_s.size)
    columns = shape(u)[None]
    if parts.image is None or shape is not _law:
        return columns
    return columns * [parts.image.pattern(u, *edges) for edges in parts.edges_hz]


def _costs(parts: _Parts, columns: FloatArray) -> FloatArray:
    """Return half the chi-square of each column, summed over the parts.

    Columns are those of every part, or the same for all. Background, what passes beside and height are those of least squares; a height below
    zero is none.
    """
    costs = np.zeros(columns.shape[1])
    each = np.broadcast_to(columns, (len(parts.power), *columns.shape[1:]))
    for power, weight, column in zip(parts.power, parts.weight, each, strict=True):
        root = np.sqrt(weight)
        usual, _ = np.linalg.qr((root * parts.basis).T)
        left = root * power - usual @ (usual.T @ (root * power))
        free = root * column - (root * column) @ usual @ usual.T
        square = (free**2).sum(axis=1)
        # a column that hardly changes there is the background again
        changes = square > SMALLEST_CHANGE * weight.sum()
        gain = np.where(changes, np.maximum(free @ left, 0.0) ** 2, 0.0)
        costs += (left**2).sum() - gain / np.where(changes, square, 1.0)
    return 0.5 * costs


def _flat(parts: _Parts) -> float:
    return float(_costs(parts, np.zeros((1, 1, parts.time_s.size)))[0])


def _grids(centre: tuple[float, float], width_s: float, turn: int) -> tuple[FloatArray, FloatArray]:
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


def _gain_over_law(parts: _Parts, rise: Rise) -> float:
    """Return what the law gains in log-likelihood over one gain for all parts.

    The gain is free in every bin; each value of it that the law does without would
    gain a half in noise alone.
    """
    binned = _binned(parts, rise.width_s)
    if binned is None:
        return 0.0
    level = np.log(binned.power)
    # in logarithms the deviation of a power is its share
    weight = binned.weight * binned.power**2
    own = np.zeros((level.shape[0], 1))
    for _ in range(GAIN_ROUNDS):
        gain = (weight * (level - own)).sum(axis=0) / weight.sum(axis=0)
        own = (weight * (level - gain)).sum(axis=1, keepdims=True)
        own /= weight.sum(axis=1, keepdims=True)
    cost = 0.5 * float((weight * (level - own - gain) ** 2).sum())
    centre = (rise.time_s, float(np.log(rise.width_s)))
    _, law = _least(binned, _law, centre, rise.width_s)
    n_parts, n_bins = level.shape
    more = n_bins - 1 - n_parts * len(binned.basis) - 2
    return float(cost + 0.5 * max(more, 0) - law)


def _binned(parts: _Parts, width_s: float) -> _Parts | None:
    """Return means over bins, weighted by the scatter within; None with too few bins."""
    hop_s = float(np.median(np.diff(parts.time_s)))
    size = max(FEWEST_OF_BIN, round(BIN * width_s / hop_s))
    number = np.floor((parts.time_s - parts.time_s[0]) / (size * hop_s) + 1e-6)
    number = number.astype(np.int64)
    count = np.bincount(number)

    def means(rows: FloatArray) -> FloatArray:
        total = [np.bincount(number, row, count.size) for row in rows]
        return np.array(total) / np.maximum(count, 1)

    mean = means(parts.power)
    used = count >= FEWEST_OF_BIN
    if np.count_nonzero(used) < FEWEST_FRAMES // 2:
        return None
    off = parts.power / np.maximum(mean[:, number], 1e-12) - 1.0
    square = np.maximum((off**2).mean(axis=1), 1e-12)
    # the mean of a bin takes its share of the correlation of neighbours
    share = np.clip((off[:, 1:] * off[:, :-1]).mean(axis=1) / square + 1 / size, 0, 1)
    variance = np.median(off**2, axis=1) / HALF_NORMAL * (1 + 2 * share)
    variance *= size / (size - 1)
    deviation = np.maximum(variance[:, None] / count[used], SMALLEST_STD**2)
    mean = np.maximum(mean[:, used], 1e-12)
    times = means(parts.time_s[None])[0, used]
    weight = 1 / (deviation * mean**2)
    return parts._replace(
        time_s=times, power=mean, weight=weight, basis=means(parts.basis)[:, used]
    )


def _squall_over_laws(levels: Levels, crowd: Sequence[Rise]) -> float:
    """Return what several laws gain in log-likelihood over one squall.

    Rise and fall are halves of raised cosines.
    """
    first_s = min(one.time_s - REACH * one.width_s for one in crowd)
    last_s = max(one.time_s + REACH * one.width_s for one in crowd)
    time_s = levels.frames.time_s
    frames = (time_s > first_s) & (time_s < last_s) & _heard(levels)
    width_s = min(one.width_s for one in crowd)
    binned = _binned(_parts(levels, frames, width_s, crowd), width_s)
    if binned is None:
        return 0.0
    laws = _flat(binned)
    alone = binned._replace(basis=binned.basis[:1])
    span_s = last_s - first_s
    centre = np.array([first_s + span_s / 4, *np.log([span_s / 4] * 3)])
    reach = np.array([span_s / 2, 1.5, 1.5, 1.5])
    cost = np.inf
    for turn in range(ROUNDS):
        steps = [np.linspace(-1.0, 1.0, count) for count in SQUALL_STEPS]
        tried = centre + reach * FINER**turn * np.array(list(product(*steps)))
        begin = tried[:, :1]
        rise, stay, fall = np.exp(tried[:, 1:]).T[..., None]
        risen = np.clip((binned.time_s - begin) / rise, 0.0, 1.0)
        left = np.clip((begin + rise + stay + fall - binned.time_s) / fall, 0.0, 1.0)
        costs = _costs(alone, np.sin(0.5 * np.pi * np.minimum(risen, left))[None] ** 2)
        best = int(np.argmin(costs))
        cost, centre = float(costs[best]), tried[best]
    n_more = (len(crowd) - 1) * len(binned.power) + 2 * len(crowd) - centre.size
    return cost - 0.5 * n_more - laws


def _noise(parts: _Parts, best: tuple[float, float]) -> float:
    """Return the variance of a part's residuals, times their correlation sum."""
    ((column,),) = _columns(parts, _law, np.array([best[0]]), np.array([best[1]]))
    basis = np.stack([*parts.basis, column], axis=1)
    root = np.sqrt(parts.weight[0])
    values, *_ = np.linalg.lstsq(root[:, None] * basis, root * parts.power[0])
    residual = root * (parts.power[0] - basis @ values)
    variance = max(float(np.mean(residual**2)), SMALLEST_STD**2)
    return variance * correlation_sum(residual, variance)
