"""Which bearings are the target's: association inside the fit.

**Method.** Every bearing is the target's, with a Gaussian error, or comes from anywhere
(uniform over the circle). Expectation and maximisation in turn (Dempster, Laird & Rubin
1977) give the probability of every row and the motion that the rows so weighted
determine, from many starts. Rows that are left and follow a straight motion of their own
are a further source; then each row belongs to one of the sources or to none.

What is left for the analysis of a source is a least-squares problem, each weight times the
root of its row's probability. The information that is lost because the rows are not known
for certain (Louis 1982) scales the weights.

**Conventions.** Each row has at most one bearing. Frequencies take part in the misfit with
their full weight: a line is tracked, a bearing is not.

**References.** Dempster, Laird & Rubin 1977, J. R. Stat. Soc. B 39, 1; Louis 1982, J. R.
Stat. Soc. B 44, 226; Wald & Wolfowitz 1940, Ann. Math. Stat. 11, 147 (runs).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.motion.target_motion.objective import loss_value, misfit, residuals
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.row_mixture import RowMixture
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds, minimise
from uwtrack_cli.motion.target_motion.starts import multistart, subset_starts

FEWEST_ROWS = 20
"""Bearings below which none is taken for another's."""

MOST_SOURCES = 3
"""Sources that one table is taken apart into."""

LEAST_GAIN = 20.0
"""Twice the gain in log likelihood from which bearings of others are believed."""

LEAST_SHARE, FEWEST_OWN = 0.1, 15
"""Share of the rows, and rows, that a further source must explain."""

SOURCE_GAIN = 40.0
"""Twice its gain in log likelihood over chance, beside four parameters."""

FEWEST_RUNS = -4.0
"""Deviations from the expected number of runs below which strange rows come in
stretches: then the target turned, or the motion is wrong, and they are not others."""

ROUNDS, FIRST_ROUNDS, FOLLOWED_STARTS, TOLERANCE = 40, 4, 5, 1e-3
FLATTEST = 1e-2
"""Curvature below which a direction reaches beyond any search box."""
FIRST_STD_RAD = np.radians([6.0, 2.0])
"""Deviations with which the search for an unknown deviation begins."""

SMALLEST_PROBABILITY = 1e-6
DENSITY = 1.0 / (2.0 * np.pi)
"""Of a bearing that comes from anywhere, 1/rad."""


@dataclass(frozen=True, eq=False)
class BearingSource:
    """A source and the rows that are its own."""

    q: FloatArray
    """Motion in solver coordinates, shape (4,)."""
    probability: FloatArray
    """Probability that the row's bearing is this source's, shape (rows,); nan where
    there is none."""
    problem: Problem
    """The problem with the weights that follow."""
    mixture: RowMixture
    """What every row says of the source, whoever it belongs to."""


@dataclass(frozen=True, eq=False)
class _Mixture:
    """One step of the expectation: motions with shares, deviations and rows."""

    q: FloatArray
    """Motions, shape (sources, 4)."""
    share: FloatArray
    """Shares of the sources, shape (sources,); the rest comes from anywhere."""
    scale: float
    """Factor of all deviations."""
    probability: FloatArray
    """Of every source for every row, shape (sources, rows)."""
    z: FloatArray
    """Whitened residuals at the scale, same shape."""
    gain: float
    """Twice the log likelihood of the bearings over that of chance, less the misfit
    of the frequencies and priors."""
    offset_rad: FloatArray
    """Constant errors of the streams by every source, rad, shape (sources, streams)."""


def associate(
    problem: Problem, limits: SearchBounds, *, is_told: bool
) -> list[BearingSource] | None:
    """Take a record apart into its sources; None where every row may be one source's.

    The deviations of the bearings were stated (``is_told``), or are sought.
    """
    heard: BoolArray = np.asarray((problem.bearing_weight > 0).any(0))
    if np.count_nonzero(heard) < FEWEST_ROWS:
        return None
    best = _search(problem, limits, heard, is_told=is_told)
    plain = _plain(problem, limits, best, heard, is_told=is_told)
    if best.gain - plain.gain < LEAST_GAIN:
        return None
    while len(best.q) < MOST_SOURCES:
        more = _with_another(problem, limits, best, heard, is_told=is_told)
        if more is None:
            break
        best = more
    if len(best.q) == 1 and _in_stretches(best.probability[0][heard] < 0.5):
        return None
    order = np.argsort(-best.probability[:, heard].sum(1), kind="stable")
    return [_source(problem, best, int(index), heard) for index in order]


def _source(problem: Problem, found: _Mixture, index: int, heard: BoolArray) -> BearingSource:
    own, z = found.probability[index], found.z[index]
    lost = float((z**2 * own * (1.0 - own))[heard].sum() / own[heard].sum())
    known = float(np.clip(1.0 - lost, 0.2, 1.0))
    weight = problem.bearing_weight * np.sqrt(known * own) / found.scale
    weight = np.where(own > 0.01, weight, 0.0)
    full = problem.bearing_weight / found.scale
    others = np.delete(_densities(found.share, found.z, full.max(0)), index, axis=0)
    mixture = RowMixture(
        replace(problem, bearing_weight=full),
        float(found.share[index]),
        others.sum(axis=0) + _share_of_none(found.share) * DENSITY,
        found.offset_rad[index],
    )
    return BearingSource(
        found.q[index],
        np.where(heard, own, np.nan),
        replace(problem, bearing_weight=weight),
        mixture,
    )


def _in_stretches(strange: BoolArray) -> bool:
    """Return whether strange rows follow each other far more than by chance."""
    n, ones = strange.size, int(np.count_nonzero(strange))
    zeros = n - ones
    if min(ones, zeros) < 4:
        return False
    runs = 1 + int(np.count_nonzero(np.diff(strange.astype(int))))
    mean = 1.0 + 2.0 * ones * zeros / n
    spread = np.sqrt((mean - 1.0) * (mean - 2.0) / (n - 1.0))
    return bool((runs - mean) / spread < FEWEST_RUNS)


def _search(problem: Problem, limits: SearchBounds, heard: BoolArray, *, is_told: bool) -> _Mixture:
    """Return the best single source with rows from anywhere."""
    typical = 1.0 / float(np.median(problem.bearing_weight[problem.bearing_weight > 0]))
    scales = [1.0] if is_told else [float(std / typical) for std in FIRST_STD_RAD]
    usual: FloatArray = np.empty((0, 4))
    if len(problem.bearing_weight) == 1:
        usual = multistart(replace(problem, loss="student"), limits).q[:2]
    found = []
    for scale in scales:
        # the scatter of all rows together is the others', too: by it no draw stands out
        weighed = replace(problem, bearing_weight=problem.bearing_weight / scale)
        starts = np.concatenate([subset_starts(weighed, limits), usual])
        found += [
            _climb(
                problem, limits, _begin(problem, q[np.newaxis], scale), heard, is_told,
                rounds=FIRST_ROUNDS,
            )
            for q in starts
        ]  # fmt: skip
    found.sort(key=lambda one: -one.gain)
    ends = [_climb(problem, limits, one, heard, is_told) for one in found[:FOLLOWED_STARTS]]
    return max(ends, key=lambda one: _evidence(problem, one))


def _evidence(problem: Problem, found: _Mixture) -> float:
    """Return twice the log evidence of a single source: gain and posterior volume.

    Laplace's approximation (MacKay 2003, eq. 27.8), flat in the solver's coordinates. A
    way through the very place of a sensor may explain strange bearings of that sensor
    well, but few ways do.
    """
    weight = problem.bearing_weight * np.sqrt(found.probability[0]) / found.scale
    here = misfit(replace(problem, bearing_weight=weight), found.q[:1])
    values = np.linalg.eigvalsh(here.matrix[0])
    return found.gain - float(np.log(np.maximum(values, FLATTEST)).sum())


def _begin(problem: Problem, q: FloatArray, scale: float) -> _Mixture:
    rows = np.full((len(q), problem.n_rows), 0.5)
    share = np.full(len(q), 0.5 / len(q))
    offset = np.zeros((len(q), len(problem.bearing_weight)))
    return _Mixture(q, share, scale, rows, rows, -np.inf, offset)


def _plain(
    problem: Problem, limits: SearchBounds, best: _Mixture, heard: BoolArray, *, is_told: bool
) -> _Mixture:
    """Return the fit in which every row is the source's."""
    scale = best.scale
    sure = np.where(heard, 1.0, 0.0)[np.newaxis]
    found = best
    for _ in range(1 if is_told else 4):
        weighed = replace(problem, bearing_weight=problem.bearing_weight / scale)
        q = minimise(weighed, best.q[:1], limits).q
        found = _expect(problem, q, np.ones(1), scale, sure, heard)
        if not is_told:
            scale *= float(np.sqrt(np.mean(found.z[0][heard] ** 2)))
    return found


def _climb(
    problem: Problem,
    limits: SearchBounds,
    begin: _Mixture,
    heard: BoolArray,
    is_told: bool,
    rounds: int = ROUNDS,
) -> _Mixture:
    """Repeat expectation and maximisation until the likelihood no longer rises."""
    here = begin
    if begin.gain == -np.inf:
        here = _expect(problem, begin.q, begin.share, begin.scale, begin.probability, heard)
    count = np.count_nonzero(heard)
    for _ in range(rounds):
        own = here.probability
        share = (own[:, heard].sum(1) + 0.5) / (count + 1.0 + 0.5 * len(own))
        scale = here.scale
        if not is_told:
            power = float((own * here.z**2)[:, heard].sum() * scale**2)
            scale = float(np.sqrt(power / max(own[:, heard].sum() - 4.0, 1.0)))
            scale = max(scale, 1e-3)
        q = here.q.copy()
        for index in range(len(q)):
            weight = problem.bearing_weight * np.sqrt(own[index]) / scale
            weighed = replace(problem, bearing_weight=weight)
            q[index] = minimise(weighed, q[index : index + 1], limits, iterations=6).q[0]
        there = _expect(problem, q, share, scale, own, heard)
        rise = there.gain - here.gain
        here = there
        if abs(rise) < TOLERANCE:
            break
    return here


def _expect(
    problem: Problem,
    q: FloatArray,
    share: FloatArray,
    scale: float,
    before: FloatArray,
    heard: BoolArray,
) -> _Mixture:
    """Weigh the sources for every row; offsets are those of the rows as they were."""
    weight = problem.bearing_weight / scale
    strength = weight.max(0)
    z, others = np.zeros((len(q), problem.n_rows)), 0.0
    offset = np.zeros((len(q), len(weight)))
    for index, motion in enumerate(q):
        root = np.sqrt(np.maximum(before[index], SMALLEST_PROBABILITY))
        weighed = replace(problem, bearing_weight=weight * root)
        r = residuals(weighed, motion[np.newaxis])
        z[index] = r.bearing[0].sum(0) / root
        offset[index] = r.offset_rad[0]
        others += float(loss_value(r.frequency, problem.loss).sum())
        others += float(r.prior_value(problem)[0])
    joint = _densities(share, z, strength) / DENSITY
    total = joint.sum(0) + _share_of_none(share)
    own = np.where(heard, joint / total, 0.0)
    gain = 2.0 * float(np.log(total[heard]).sum()) - others / len(q)
    return _Mixture(q, share, scale, np.maximum(own, SMALLEST_PROBABILITY * heard), z, gain, offset)


def _densities(share: FloatArray, z: FloatArray, weight: FloatArray) -> FloatArray:
    """Return share times density, 1/rad, of every source for every row.

    The inverse deviations of the rows, 1/rad, have the shape (rows,).
    """
    own = weight / np.sqrt(2.0 * np.pi) * np.exp(-0.5 * z**2)
    return np.asarray(share[:, np.newaxis] * own)


def _share_of_none(share: FloatArray) -> float:
    return max(1.0 - float(share.sum()), 1e-12)


def _with_another(
    problem: Problem, limits: SearchBounds, found: _Mixture, heard: BoolArray, *, is_told: bool
) -> _Mixture | None:
    """Seek a further source among the rows that are nobody's; None if there is none."""
    left = heard & (found.probability.sum(0) < 0.5)
    fewest = max(FEWEST_OWN, LEAST_SHARE * np.count_nonzero(heard))
    if np.count_nonzero(left) < max(fewest, FEWEST_ROWS):
        return None
    rest = replace(problem, bearing_weight=problem.bearing_weight * left / found.scale)
    # the frequencies are the first source's
    rest = replace(rest, frequency_weight=np.zeros_like(problem.frequency_weight))
    other = _search(rest, limits, left, is_told=True)
    explained = float(other.probability[0][left].sum())
    if explained < fewest or other.gain < SOURCE_GAIN + 4.0 * np.log(left.sum()):
        return None
    q = np.concatenate([found.q, other.q])
    start = _begin(problem, q, found.scale)
    rows = np.concatenate([found.probability, other.probability])
    start = replace(start, probability=rows, share=rows[:, heard].mean(1))
    return _climb(problem, limits, start, heard, is_told)
