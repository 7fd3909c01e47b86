"""Checks of a passage against its own measurements.

**Method.** Three questions whose answers the fit itself cannot bend:

* *Residuals.* The lines' residuals are averaged over quarters of d/v. What these means
  scatter beyond the noise, which is measured off the model from differences of
  neighbours, is the misfit, as a share of the Doppler shift v/c. A fit whose noise is
  scaled until it fits could never be refused; this one can.
* *Lines that do not take part.* Each line, with its bearings, is read by the passage and as
  standing still. Where more than half of them prefer to stand still, the contact is not
  the one vessel that the others show.
* *Influence.* The passage is fitted to its two halves, and without each line. Where the
  answers disagree by more than they should, the deviations grow by that ratio (Birge
  1932); what a subset moves an answer by has the difference of both variances (Hausman
  1978).

**Conventions.** Times count from the first sample. One data set, the fit's one row.

**References.** Gelman et al. (2013), Bayesian Data Analysis, ch. 6; Birge (1932), Phys.
Rev. 40, 207; Hausman (1978), Econometrica 46, 1251.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.robust import median_centred
from uwtrack_cli.motion.passage.candidates import CandidatePassage
from uwtrack_cli.motion.passage.fit.estimator import PassageFit, fit_passage
from uwtrack_cli.motion.passage.fit.likelihood_ratio import passage_residuals
from uwtrack_cli.motion.passage.model.measurements import Blocks

REACH = 3.0
"""d/v on either side of the closest approach that are checked."""

BLOCK = 0.25
"""Length over which residuals and levels are averaged, in d/v."""

FEWEST_BLOCKS = 4
"""Such blocks of a line below which it is not checked."""

HALF_NORMAL = 0.455
"""Median of the square of a normal variable of unit variance."""

CHANCE = 2.0
"""Disagreement of the halves, in deviations, that is not yet a misfit."""

CHANCE_OF_LINES = 3.0
"""The same without one of several lines: one of them is more often far off by chance."""

SMALLEST_ADDED = 0.5
"""Share of the variance without a line that its absence adds at least."""

STANDS_STILL = 9.2
"""Gain in log-likelihood by which a line prefers to stand still: a passage that it takes
part in loses as much in one of ten thousand, having no unknowns of its own to lose."""

WILDEST = 3.0
"""Deviations beyond which a measurement counts no more for or against that."""

MOST_LINES = 8
"""Lines that are left out in turn, the best measured ones."""


def check_fit(candidate: CandidatePassage) -> CandidatePassage:
    """Return a candidate with its misfit, wider where its parts disagree.

    Parameters
    ----------
    candidate
        A significant fit.
    """
    fit, blocks = candidate.fit, candidate.blocks
    if blocks.shift.is_empty:
        return candidate
    n_stationary, n_lines = count_stationary_lines(fit, blocks)
    candidate = candidate.measured(stationary_share=n_stationary / max(n_lines, 1), n_lines=n_lines)
    if not _moves(fit):
        return candidate
    misfit = doppler_misfit(fit, blocks)
    scale = _influence(fit, blocks)
    every = np.append(scale, np.ones(fit.full_covariance.shape[1] - 4))
    wider = replace(
        fit,
        covariance=fit.covariance * np.outer(scale, scale),
        full_covariance=fit.full_covariance * np.outer(every, every),
    )
    return replace(candidate, fit=wider, misfit=misfit)


def doppler_misfit(fit: PassageFit, blocks: Blocks) -> float:
    """Return what the lines leave of their curve beyond noise, as a share of v/c.

    Parameters
    ----------
    fit
        Fit of one data set with lines.
    blocks
        The measurements that it was made from.

    Returns
    -------
    float
        Median over the lines of the deviation of their blocks, zero or more: a stray
        line or block counts little. nan where no line has enough blocks.
    """
    law = fit.law(blocks.time_s)
    weight = blocks.shift.weight[0] / fit.noises[0].scale[0][:, None] ** 2
    weight = weight * _near(fit, blocks.time_s)
    number = _numbers(fit, blocks.time_s)
    departures = []
    for value, size in zip(blocks.shift.value[0] - law.shift[0], weight, strict=True):
        whole = np.bincount(number, size)
        used = whole > 0
        if used.sum() < FEWEST_BLOCKS:
            continue
        mean = np.bincount(number, size * value)[used] / whole[used]
        square = (mean - np.median(mean)) ** 2
        noise = float(np.median(1 / whole[used]))
        departures.append(max(float(np.median(square)) / HALF_NORMAL - noise, 0.0))
    if not departures:
        return float("nan")
    mach = abs(float(fit.theta[0, 2])) / fit.medium.sound_speed_mps
    return float(np.sqrt(np.median(departures)) / mach)


def count_stationary_lines(fit: PassageFit, blocks: Blocks) -> tuple[int, int]:
    """Return how many lines rather stand still than pass, and how many there are.

    Parameters
    ----------
    fit
        Fit of one data set with lines.
    blocks
        The measurements that it was made from.
    """
    passing = passage_residuals(fit, blocks)
    bearing = blocks.bearing
    resting = blocks.shift.value[0], wrap_rad(bearing.value[0])
    gain = np.zeros(blocks.shift.value.shape[1])
    own = blocks.count[0] == blocks.count[1]  # every line has its own bearings
    for number, block in enumerate((blocks.shift, bearing)[: 1 + own]):
        weight = block.weight[0] / fit.noises[number].scale[0][:, None] ** 2
        gain += _square(passing[number], weight) - _square(resting[number], weight)
    known = blocks.shift.weight[0].any(axis=1)
    still = int(np.count_nonzero(0.5 * gain[known] > STANDS_STILL))
    return still, int(np.count_nonzero(known))


def _square(value: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the sum of squares of every row about its middle, none beyond a limit."""
    square = weight * median_centred(value, weight) ** 2
    total: FloatArray = np.minimum(square, WILDEST**2).sum(axis=1)
    return total


def _moves(fit: PassageFit) -> bool:
    speed, variance = float(fit.theta[0, 2]), float(fit.covariance[0, 2, 2])
    return bool(np.isfinite(variance) and speed > 3.0 * np.sqrt(max(variance, 0.0)))


def _heard_s(fit: PassageFit) -> float:
    """Return when the sound of the closest approach arrived, s."""
    width, speed = float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])
    return float(fit.theta[0, 0]) + width * speed / fit.medium.sound_speed_mps


def _near(fit: PassageFit, time_s: FloatArray) -> BoolArray:
    reach = REACH * float(fit.range_over_speed_s[0])
    near: BoolArray = np.abs(time_s - _heard_s(fit)) < reach
    return near


def _numbers(fit: PassageFit, time_s: FloatArray) -> IntArray:
    """Return the number of the block that each time lies in, from 0."""
    block = BLOCK * float(fit.range_over_speed_s[0])
    number = np.floor((time_s - _heard_s(fit)) / block).astype(int)
    number = np.clip(number, -round(REACH / BLOCK), round(REACH / BLOCK))
    return np.asarray(number - number.min(), np.int64)


def _influence(fit: PassageFit, blocks: Blocks) -> FloatArray:
    """Return factors on the four standard deviations by halves and single lines."""
    is_late = blocks.time_s > _heard_s(fit)
    early, late = (_refit(fit, blocks, keep) for keep in (~is_late, is_late))
    factor = np.ones(4)
    if early is not None and late is not None:
        (first, a), (second, b) = early, late
        apart = _apart(first, second) / np.sqrt(a + b)
        factor = np.fmax(1.0, apart / CHANCE)
    return np.fmax(factor, _without_each_line(fit, blocks))


def _apart(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return how far two answers are apart; bearings may lie on both sides of north."""
    apart = one - other
    apart[3] = (apart[3] + 180.0) % 360.0 - 180.0
    return np.abs(apart)


def _without_each_line(fit: PassageFit, blocks: Blocks) -> FloatArray:
    """Return factors on the four deviations by leaving out lines.

    What a line moves the answer by has the variance that its absence adds.
    """
    weight = blocks.shift.weight[0].sum(axis=1)
    best = np.argsort(-weight)[:MOST_LINES]
    best = best[weight[best] > 0]
    factor = np.ones(4)
    if best.size < 2:
        return factor
    whole, own = _answer(fit)
    for line in best:
        kept = np.ones(weight.size, np.bool_)
        kept[line] = False
        found = _refit(fit, blocks, np.ones(blocks.time_s.size, np.bool_), kept)
        if found is not None:
            added = np.maximum(found[1] - own, SMALLEST_ADDED * np.maximum(found[1], own))
            moved = _apart(found[0], whole) / np.sqrt(added)
            factor = np.fmax(factor, moved / CHANCE_OF_LINES)
    return factor


def _refit(
    fit: PassageFit, blocks: Blocks, instants: BoolArray, kept_lines: BoolArray | None = None
) -> tuple[FloatArray, FloatArray] | None:
    """Fit a part of the measurements; the four answers with their variances.

    A line is left out with its bearings, if it has its own.
    """
    weight = blocks.weight * instants
    if kept_lines is not None:
        weight[:, blocks.parts[0]] *= kept_lines[:, None]
        if blocks.count[1] == blocks.count[0]:
            weight[:, blocks.parts[1]] *= kept_lines[:, None]
    part = replace(blocks, weight=weight)
    if np.count_nonzero(part.shift.weight.any(axis=(0, 1))) < 2 * FEWEST_BLOCKS:
        return None
    found = fit_passage(part, fit.theta, fit.turn, fit.medium, change=fit.change)
    answer, variance = _answer(found)
    if not (np.isfinite(answer[:3]).all() and np.isfinite(variance[:3]).all()):
        return None
    return answer, variance


def _answer(fit: PassageFit) -> tuple[FloatArray, FloatArray]:
    """Time, slant d/v, speed and bearing with their variances."""
    motion = (fit.theta[0, 0], fit.range_over_speed_s[0], fit.theta[0, 2])
    return np.array([*motion, fit.bearing_deg[0]]), np.diag(fit.covariance[0])
