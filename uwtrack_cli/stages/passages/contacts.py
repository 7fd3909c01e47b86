"""From the measurements of a contact to a candidate passage; contacts that are one.

**Method.** A contact is fitted by itself. Contacts whose measurements agree with the
motion of a stronger one are taken for parts of the same vessel (a tracker may split
its lines) and are fitted together.

**Conventions.** Agreement is a difference of log-likelihoods, robust against slow
noise; see `cpa_decision`.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.estimation.passages.blocks import (
    Blocks,
    PassageData,
    condense,
    make_blocks,
    thin,
)
from uwtrack_cli.estimation.passages.fit import (
    PassageFit,
    fit_passage,
    fit_with_memory,
    take_row,
)
from uwtrack_cli.estimation.passages.normal import Medium
from uwtrack_cli.estimation.passages.seeds import find_starts
from uwtrack_cli.stages.passages.evidence import (
    Evidence,
    motion_likelihood,
    passage_evidence,
)
from uwtrack_cli.stages.passages.measurements import contact_data, contact_ids, lines_of

FEWEST_MEASUREMENTS = 8
"""Instants with a measurement below which nothing is fitted."""

LARGEST_LEVEL_MISFIT = 4.0
"""Variance of level residuals, slow ones as sums, over what is expected: beyond it
the levels are left out where lines or bearings tell the passage."""

AGREEMENT = 9.2
"""Loss of log-likelihood that another contact's motion may cost: 99.9 % of the true
ones cost less (chi-square with four degrees of freedom)."""


@dataclass(frozen=True)
class Candidate:
    """A significant fit of one vessel's measurements."""

    contacts: tuple[int, ...]
    line_ids: IntArray
    data: PassageData
    blocks: Blocks
    fit: PassageFit
    evidence: Evidence
    other_turn: float


def examine(
    data: PassageData,
    contacts: tuple[int, ...],
    line_ids: IntArray,
    medium: Medium,
    false_alarm_probability: float,
) -> Candidate | None:
    """Fit one contact and keep it if it is significant.

    Parameters
    ----------
    data
        Its measurements.
    contacts
        Contact numbers that they came from.
    line_ids
        Lines in the order of the rows of frequencies.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    """
    thinned = thin(data)
    blocks = make_blocks(thinned)
    used = np.zeros(thinned.time_s.size, np.bool_)
    for block in (blocks.shift, blocks.bearing, blocks.level):
        used |= (block.weight[0] > 0).any(axis=0)
    if used.sum() < FEWEST_MEASUREMENTS:
        return None
    rough, other = best_start(blocks, medium)
    if rough is None:
        return None
    return examine_from(
        thinned, (contacts, line_ids), (rough.theta, rough.turn), medium,
        false_alarm_probability, other,
    )  # fmt: skip


def examine_from(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    start: tuple[FloatArray, FloatArray],
    medium: Medium,
    false_alarm_probability: float,
    other_turn: float = 0.0,
) -> Candidate | None:
    """Fit measurements from a known start and keep the fit if it is significant.

    Parameters
    ----------
    data
        Measurements.
    owner
        Contact numbers and lines that they came from.
    start
        Unknowns, shape (1, 4), and turn, shape (1,).
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    other_turn
        Weight of the opposite turn.
    """
    theta, turn = start
    short = condense(data, float(theta[0, 0]), float(np.exp(theta[0, 1])))
    blocks = make_blocks(short)
    fit = fit_passage(blocks, theta, turn, medium)
    if _is_misfit(fit, blocks):
        short = replace(short, level_db=np.full_like(short.level_db, np.nan))
        blocks = make_blocks(short)
        fit = fit_passage(blocks, fit.theta, fit.turn, medium)
    fit = fit_with_memory(fit, blocks, medium)
    evidence = passage_evidence(fit, blocks, medium, false_alarm_probability)
    if not evidence.is_passage:
        return None
    return Candidate(*owner, short, blocks, fit, evidence, other_turn)


def _is_misfit(fit: PassageFit, blocks: Blocks) -> bool:
    """Tell whether levels follow another law, and others know the passage.

    Fringes of the surface image and other spreading laws leave slow residuals.
    """
    known = not blocks.shift.is_empty or not blocks.bearing.is_empty
    misfit = float(fit.noises[2].inflation[0] * fit.noises[2].scale[0, 0] ** 2)
    return known and not blocks.level.is_empty and misfit > LARGEST_LEVEL_MISFIT


def best_start(blocks: Blocks, medium: Medium) -> tuple[PassageFit | None, float]:
    """Fit one data set from many starts, and weigh the opposite turn.

    Parameters
    ----------
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    """
    starts = find_starts(blocks, medium.sound_speed_mps)
    if not starts.turn.size:
        return None, 0.0
    fits = fit_passage(blocks, starts.theta, starts.turn, medium, is_slow_noise=False)
    sane = np.isfinite(fits.cost)
    if not blocks.shift.is_empty:
        sane &= fits.theta[:, 2] > 0
    cost = np.where(sane, fits.cost, np.inf)
    if not np.isfinite(cost).any():
        return None, 0.0
    best = int(np.argmin(cost))
    opposite = cost[starts.turn != starts.turn[best]]
    behind = float(opposite.min() - cost[best]) if opposite.size else np.inf
    weight = 0.0 if blocks.bearing.is_empty else 1 / (1 + np.exp(min(behind, 50.0)))
    return take_row(fits, best), float(weight)


def examine_contacts(
    lines: Lines, medium: Medium, false_alarm_probability: float
) -> list[Candidate]:
    """Examine the lines of every contact; contacts that are one vessel are joined.

    Parameters
    ----------
    lines
        Tracked lines.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    """
    found: list[Candidate] = []
    for contact in contact_ids(lines):
        part = (contact,)
        one = examine(
            contact_data(lines, None, part), part, lines_of(lines, part),
            medium, false_alarm_probability,
        )  # fmt: skip
        found += [one] if one else []
    return _merge(found, lines, medium, false_alarm_probability)


def _merge(
    found: list[Candidate], lines: Lines, medium: Medium, probability: float
) -> list[Candidate]:
    """Join contacts that agree with the motion of a stronger one."""
    left = sorted(found, key=lambda item: -item.evidence.total)
    kept: list[Candidate] = []
    while left:
        leader, *left = left
        same = [item for item in left if agrees(item, leader, medium)]
        if same:
            contacts = tuple(
                number for item in (leader, *same) for number in item.contacts
            )
            joint = examine(
                contact_data(lines, None, contacts), contacts,
                lines_of(lines, contacts), medium, probability,
            )  # fmt: skip
            leader = joint or leader
            left = [item for item in left if item not in same]
        kept.append(leader)
    return kept


def agrees(item: Candidate, leader: Candidate, medium: Medium) -> bool:
    """Tell whether a candidate's measurements agree with another's motion.

    Parameters
    ----------
    item
        Candidate whose measurements are tried.
    leader
        Candidate whose motion is tried.
    medium
        Sound speed and depth difference.
    """
    own = motion_likelihood(item.blocks, item.fit, item.fit, medium)
    other = motion_likelihood(item.blocks, item.fit, leader.fit, medium)
    return own - other < AGREEMENT
