"""Two vessels in one contact: lines that a tracker put together, taken apart.

**Method.** Vessels that pass close together on like courses look like one until their
closest approach is fitted. A line whose residuals, less what all lines share (a shaft
that wanders, a wrong law), still follow the partials of the passage has a motion of its
own. Where there is such a line, every line is fitted by itself and the lines that agree
are fitted together again; the contact is divided only if two vessels with two lines
each come of it, neither of which would have the other's motion.

**Conventions.** Agreement as in `contacts`; the strongest vessel keeps the contact.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.passages.normal import Medium
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import passage_law
from uwtrack_cli.stages.passages.contacts import (
    AGREEMENT,
    Candidate,
    agrees,
    examine_from,
)
from uwtrack_cli.stages.passages.evidence import motion_likelihood

FEWEST_LINES = 2
"""Lines that a vessel must have to be told from another in the same contact."""

SUSPICION = 30.0
"""Gain of a line's own motion (half a chi-square) beyond which the lines are tried."""

DISAGREEMENT = 3.0 * AGREEMENT
"""Loss that the other vessel's motion must cost either."""


def split(
    candidate: Candidate, medium: Medium, false_alarm_probability: float
) -> list[Candidate]:
    """Divide a contact whose lines have two motions; else return it alone.

    Parameters
    ----------
    candidate
        Fit of the lines of a contact, without broadband.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    """
    count = candidate.line_ids.size
    if count < 2 * FEWEST_LINES or own_motion_gain(candidate, medium).max() < SUSPICION:
        return [candidate]
    groups = _groups(candidate, medium, false_alarm_probability)
    whole = [item for item in groups if item.line_ids.size >= FEWEST_LINES]
    if len(whole) < 2:
        return [candidate]
    first, second = whole[:2]
    if _loss(first, second, medium) < DISAGREEMENT:
        return [candidate]
    if _loss(second, first, medium) < DISAGREEMENT:
        return [candidate]
    return [first, second]


def own_motion_gain(candidate: Candidate, medium: Medium) -> FloatArray:
    """Return for each line what a motion of its own would gain, half a chi-square.

    Parameters
    ----------
    candidate
        Fit of several lines.
    medium
        Sound speed and depth difference.
    """
    fit, blocks = candidate.fit, candidate.blocks
    law = passage_law(
        blocks.time_s, fit.theta[:, :3], medium.sound_speed_mps, medium.height_m
    )
    shift = blocks.shift.value[0] - law.shift[0]
    angle = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    bearing = wrap_rad(blocks.bearing.value[0] - angle)
    gain = np.zeros(candidate.line_ids.size)
    for residual, block, noise, slope in (
        (_centred(shift, blocks.shift.weight[0]), blocks.shift, 0, law.shift_d[0]),
        (bearing, blocks.bearing, 1, law.angle_d[0]),
    ):
        weight = block.weight[0] / fit.noises[noise].scale[0][:, None] ** 2
        total = np.maximum(weight.sum(axis=0), 1e-300)
        own = residual - (weight * residual).sum(axis=0) / total
        gain += _projected(own, weight, slope)
    return gain


def _centred(value: FloatArray, weight: FloatArray) -> FloatArray:
    """Take off every line's mean: its rest frequency is free."""
    size = np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    centred: FloatArray = value - (weight * value).sum(axis=1, keepdims=True) / size
    return centred


def _projected(
    residual: FloatArray, weight: FloatArray, slope: FloatArray
) -> FloatArray:
    """Half the square of every row's residuals along a constant and the partials."""
    design = np.column_stack([np.ones(slope.shape[0]), slope])
    design = design / np.sqrt((design**2).sum(axis=0))
    gain = np.zeros(residual.shape[0])
    for row, (value, root) in enumerate(zip(residual, np.sqrt(weight), strict=True)):
        basis, size, _ = np.linalg.svd(root[:, None] * design, full_matrices=False)
        basis = basis[:, size > 1e-6 * max(float(size[0]), 1e-300)]
        gain[row] = 0.5 * float(((basis.T @ (root * value)) ** 2).sum())
    return gain


def _groups(
    candidate: Candidate, medium: Medium, probability: float
) -> list[Candidate]:
    """Fit each line alone, and together again those that agree; strongest first."""
    rows = np.arange(candidate.line_ids.size)
    alone = [_refit(candidate, rows[[n]], medium, probability) for n in rows]
    left = sorted(
        [(item, n) for n, item in enumerate(alone) if item is not None],
        key=lambda pair: -pair[0].evidence.total,
    )
    groups: list[Candidate] = []
    while left:
        (leader, first), *left = left
        members = [n for item, n in left if agrees(item, leader, medium)]
        left = [(item, n) for item, n in left if n not in members]
        joint = _refit(candidate, np.array([first, *members]), medium, probability)
        if joint is not None:
            groups.append(joint)
    return sorted(groups, key=lambda item: -item.evidence.total)


def _refit(
    candidate: Candidate, rows: IntArray, medium: Medium, probability: float
) -> Candidate | None:
    """Fit some of the lines of a contact, from the motion of all."""
    data = candidate.data
    some = replace(
        data,
        frequency_hz=data.frequency_hz[rows],
        frequency_std_hz=data.frequency_std_hz[rows],
        bearing_deg=data.bearing_deg[rows],
        bearing_std_deg=data.bearing_std_deg[rows],
    )
    return examine_from(
        some, (candidate.contacts, candidate.line_ids[rows]),
        (candidate.fit.theta, candidate.fit.turn), medium, probability,
    )  # fmt: skip


def _loss(item: Candidate, other: Candidate, medium: Medium) -> float:
    own = motion_likelihood(item.blocks, item.fit, item.fit, medium)
    return own - motion_likelihood(item.blocks, item.fit, other.fit, medium)
