"""Lines that move together along log frequency: a machine whose speed swings.

**Method.** The harmonics of a machine keep their distances in log frequency, as fringes
do, and move as its speed does, on a course of its own. The course is the likeliest of all
that a random walk of whole cells takes (Viterbi) under a pattern that is found again from
it, until both stay; parts of a cell and a smooth course follow. What tells lines from
interference is the pattern: few narrow peaks upon nothing, where interference of images
is bright and dark everywhere. Its prior says so: a coefficient is zero, or positive and
normal, and how many are is found from the image.

**Conventions.** Courses are shifts of the logarithm of frequency. Nepers.

**References.** Viterbi (1967), doi 10.1109/TIT.1967.1054010; Mitchell and Beauchamp
(1988), doi 10.1080/01621459.1988.10478694, for a prior of spike and slab; Streit and
Barrett (1990), IEEE Trans. ASSP 38, 586, for courses of lines by hidden Markov models.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.motion.evidence.fringe_panel import Panel
from uwtrack_cli.motion.evidence.fringe_template import (
    FringeModel,
    Hypothesis,
    Template,
    pattern_in,
    shift_of,
)

LINE_KNOTS = 0.75
"""Distance of the knots of a pattern of lines, cells: one of a cell's width is one of its
coefficients."""

LINE_VARIANCES = (0.05, 0.25, 1.0, 4.0)
"""Variances of the height of a line that are tried, nepers^2."""

FARTHEST, LARGEST_STEP, USUAL_STEP = 0.7, 3, 1.0
"""Largest shift of the logarithm of frequency from the middle of a course, most cells that
it moves from row to row, and deviation of that."""

STEPS = (0.03, 0.1, 0.3, 1.0)
"""Deviations of the steps of a course from row to row that are tried, cells."""

ROUNDS, SMOOTH = 8, 10.0
"""Times that course and pattern are found from each other, and what a course's bend weighs
against its places."""


def likeliest_course(
    panel: Panel, value: FloatArray, start: FloatArray, weight: FloatArray, variance: float
) -> FloatArray:
    """Return the course on which one pattern of any shape moves, shape (row,).

    Parameters
    ----------
    panel
        The rows.
    value
        Their values, less what stays and what is smooth, shape (row, cell).
    start, weight
        Course to begin with, and what each row counts on it, shape (row,).
    variance
        Prior variance of the pattern, nepers^2.
    """
    count, n_cells = value.shape
    reach = int(FARTHEST / panel.cell)
    about = np.rint((start - np.median(start)) / panel.cell)
    path: IntArray = np.clip(about, -reach, reach).astype(np.int64)
    row = np.arange(count)
    place = np.arange(n_cells)
    score = np.zeros((count, 2 * reach + 1))
    for _ in range(ROUNDS):
        at = (reach - path[:, None] + place).ravel()
        size = n_cells + 2 * reach
        heard = np.outer(weight, panel.precision)
        total = np.bincount(at, (heard * value).ravel(), size)
        pattern = total / (np.bincount(at, heard.ravel(), size) + 1.0 / variance)
        shown = np.lib.stride_tricks.sliding_window_view(pattern, n_cells)[::-1]
        score = (value * panel.precision) @ shown.T
        score -= 0.5 * (panel.precision * shown**2).sum(axis=1)
        before, path, weight = path, _walked(score) - reach, np.ones(count)
        if np.array_equal(path, before):
            break
    # the top of a parabola through three neighbours is a part of a cell away
    inside = np.clip(path + reach, 1, 2 * reach - 1)
    low, top, high = (score[row, inside + k] for k in (-1, 0, 1))
    bend = np.minimum(low - 2.0 * top + high, -1e-9)
    fine = path + np.clip(0.5 * (low - high) / bend, -0.5, 0.5)
    second = np.diff(np.eye(count), 2, axis=0)
    smooth = np.linalg.solve(np.eye(count) + SMOOTH * second.T @ second, fine)
    return np.asarray(panel.cell * smooth)


def _walked(score: FloatArray) -> IntArray:
    """Return the likeliest random walk over places that score, shape (row,)."""
    steps = np.arange(-LARGEST_STEP, LARGEST_STEP + 1)
    cost = 0.5 * (steps / USUAL_STEP) ** 2
    total = score[0]
    came = []
    for own in score[1:]:
        padded = np.pad(total, LARGEST_STEP, constant_values=-np.inf)
        each = np.lib.stride_tricks.sliding_window_view(padded, steps.size) - cost
        best = np.argmax(each, axis=1)
        came.append(np.arange(total.size) + best - LARGEST_STEP)
        total = own + each.max(axis=1)
    path = [int(np.argmax(total))]
    for back in reversed(came):
        path.append(int(back[path[-1]]))
    return np.array(path[::-1])


def course_share(panel: Panel, moving: Hypothesis, template: Template, divisor: float) -> float:
    """Return the log of the prior probability of courses that agree with rows, nepers.

    Courses are random walks whose steps are as large as the rows tell: what follows rows
    one by one is less likely than a law that says the same. ``divisor``: what the evidence
    of the rows is divided by.
    """
    pattern = FringeModel(panel, [template]).explain([moving]).pattern[0]
    course = shift_of(panel.time_s, moving)
    shown = [
        pattern_in(panel, moving._replace(swing=(panel.time_s, course + by)), template,
                   pattern, panel)
        for by in (0.0, panel.cell)
    ]  # fmt: skip
    told = ((shown[1] - shown[0]) / panel.cell) ** 2 @ panel.precision / divisor
    walk = np.diff(np.eye(course.size), axis=0)
    found = []
    for step in STEPS:
        before = walk.T @ walk / (step * panel.cell) ** 2
        before[0, 0] += FARTHEST**-2.0
        share = np.linalg.slogdet(before)[1]
        share -= np.linalg.slogdet(before + np.diag(told))[1]
        off = np.diff(course) / (step * panel.cell)
        found.append(0.5 * float(share - off @ off))
    return max(found)


def lines_gain(panel: Panel, moving: Hypothesis) -> float:
    """Return what a pattern of lines that moves explains over no pattern, nepers."""
    model = FringeModel(panel, [Template(LINE_KNOTS, 1.0)])
    normal, right, _ = model.information(moving)
    return max(_sparse_gain(normal, right, each) for each in LINE_VARIANCES)


def _sparse_gain(normal: FloatArray, right: FloatArray, variance: float) -> float:
    """Return the gain of coefficients that are 0, or positive with a variance."""
    own, count = np.diag(normal), right.size
    usual = np.linalg.inv(normal + np.eye(count) / variance)
    is_on: BoolArray = usual @ right > 2.0 * np.sqrt(np.diag(usual))
    gain = 0.0
    for _ in range(ROUNDS):
        on = np.flatnonzero(is_on)
        if not 0 < on.size < count:
            break
        known = normal[np.ix_(on, on)] + np.eye(on.size) / variance
        height = np.zeros(count)
        height[on] = np.linalg.solve(known, right[on])
        share = on.size / count
        told = 0.5 * float(height @ right) - 0.5 * np.linalg.slogdet(known)[1]
        told += on.size * (np.log(2.0 * share) - 0.5 * np.log(variance))
        gain = max(gain, told + (count - on.size) * np.log1p(-share))
        # each by itself, the others as they are
        alone = right - normal @ height + own * height
        odds = 0.5 * alone**2 / (own + 1.0 / variance)
        odds += np.log(2.0 * share / (1.0 - share)) - 0.5 * np.log1p(variance * own)
        before, is_on = is_on, (odds > 0.0) & (alone > 0.0)
        if np.array_equal(is_on, before):
            break
    return float(gain)
