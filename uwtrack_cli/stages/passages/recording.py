"""Every passage of a recording: those of its lines, and those of its broadband.

**Method.** The broadband belongs to nobody in particular. It is given to the only
contact that passes, if it agrees with its lines; where no line shows a passage, the
broadband is examined first, with the lines that follow it. Where it tells of passages
that no contact accounts for, each is examined with what the others put into the
broadband taken out (see `several`).

**Conventions.** As in `contacts`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.estimation.passages.normal import Medium
from uwtrack_cli.stages.passages.contacts import (
    Candidate,
    agrees,
    examine,
    examine_contacts,
)
from uwtrack_cli.stages.passages.decision import Limits, not_a_passage
from uwtrack_cli.stages.passages.evidence import motion_likelihood
from uwtrack_cli.stages.passages.measurements import contact_data, contact_ids, lines_of
from uwtrack_cli.stages.passages.several import share_out
from uwtrack_cli.stages.passages.splitting import split

SMALLEST_LINE_GAIN = 5.0
"""Gain in log-likelihood by which the lines of a contact must follow a passage that
the broadband has shown."""


class Terms(NamedTuple):
    """Medium, false-alarm probability, and the frames and ends of the recording."""

    medium: Medium
    probability: float
    limits: Limits


def examine_recording(
    lines: Lines | None,
    levels: Levels | None,
    medium: Medium,
    false_alarm_probability: float,
    limits: Limits,
) -> list[Candidate]:
    """Examine every contact of a recording, and its broadband.

    Parameters
    ----------
    lines
        Tracked lines, or None.
    levels
        Broadband levels and bearings, or None.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    limits
        Length of the frames and ends of the recording.
    """
    probability = false_alarm_probability
    found = _of_lines(lines, medium, probability) if lines is not None else []
    if levels is None:
        return found
    if len(found) == 1:
        found = [_with_broadband(found[0], lines, levels, medium, probability)]
    terms = Terms(medium, probability, limits)
    passing = [item for item in found if _is_passage(item, limits)]
    shares, more = share_out(levels, passing, medium, probability, limits)
    if more:
        passing = _apart(passing, more, shares, lines, terms)
    elif not passing:
        passing = _broadband_first(lines, levels, terms)
        # what moves without passing is told of once
        if found and not all(_is_passage(item, limits) for item in passing):
            passing = []
    used = {number for item in passing for number in item.contacts}
    return passing + [item for item in found if used.isdisjoint(item.contacts)]


def _is_passage(item: Candidate, limits: Limits) -> bool:
    return not_a_passage(item.fit, item.blocks, limits) is None


def _of_lines(lines: Lines, medium: Medium, probability: float) -> list[Candidate]:
    """Examine the contacts; one that is two vessels gives a new contact."""
    found: list[Candidate] = []
    number = int(lines.line_contact.max(initial=0))
    for contact in examine_contacts(lines, medium, probability):
        first, *others = split(contact, medium, probability)
        found.append(first)
        for other in others:
            number += 1
            found.append(replace(other, contacts=(number,)))
    return found


def _apart(
    found: list[Candidate],
    more: list[Candidate],
    shares: list[Levels],
    lines: Lines | None,
    terms: Terms,
) -> list[Candidate]:
    """Examine every passage with its own share of the broadband."""
    first = len(found)
    medium, probability, _ = terms
    if len(found) == 1:
        found = [_with_broadband(found[0], lines, shares[0], medium, probability)]
    taken = {number for item in found for number in item.contacts}
    free = (
        [n for n in contact_ids(lines) if n not in taken] if lines is not None else []
    )
    used = lines.line_contact.max(initial=0) if lines is not None else 0
    number = max([*taken, int(used)], default=0)
    pairs = zip(more, shares[first:], strict=True)
    for passage, own in sorted(pairs, key=lambda pair: pair[0].fit.theta[0, 0]):
        best = _with_lines(passage, lines, free, own, terms)
        free = [n for n in free if n not in best.contacts]
        if best is passage:
            number += 1
            best = replace(passage, contacts=(number,))
        found = [*found, best]
    return found


def _broadband_first(
    lines: Lines | None, levels: Levels, terms: Terms
) -> list[Candidate]:
    """Examine the broadband, with the lines that fit it if any do.

    Lines too weak to show a passage by themselves can still tell its speed.
    """
    data = contact_data(None, levels, ())
    alone = examine(data, (1,), np.empty(0, np.int64), terms.medium, terms.probability)
    if alone is None or lines is None:
        return [alone] if alone else []
    return [_with_lines(alone, lines, contact_ids(lines), levels, terms)]


def _with_lines(
    alone: Candidate,
    lines: Lines | None,
    contacts: list[int],
    levels: Levels,
    terms: Terms,
) -> Candidate:
    """Add the lines that follow a passage which the broadband has shown."""
    best, gain = alone, SMALLEST_LINE_GAIN
    if lines is None:
        return alone
    for contact in contacts:
        part = (contact,)
        joint = examine(
            contact_data(lines, levels, part), part, lines_of(lines, part),
            terms.medium, terms.probability,
        )  # fmt: skip
        if joint is not None and joint.evidence.doppler > gain:
            best, gain = joint, joint.evidence.doppler
    # a line that follows by chance must not spoil what the broadband has shown
    spoils = _is_passage(alone, terms.limits) and not _is_passage(best, terms.limits)
    return alone if spoils else best


def _with_broadband(
    only: Candidate,
    lines: Lines | None,
    levels: Levels,
    medium: Medium,
    probability: float,
) -> Candidate:
    """Fit the lines with the broadband, unless the two tell of different motions."""
    wide = contact_data(None, levels, ())
    alone = examine(wide, only.contacts, np.empty(0, np.int64), medium, probability)
    if alone is not None and not agrees(alone, only, medium):
        alone_shape = motion_likelihood(alone.blocks, alone.fit, alone.fit, medium)
        flat = alone_shape - alone.evidence.total
        if motion_likelihood(alone.blocks, alone.fit, only.fit, medium) < flat:
            return only
    joint = examine(
        contact_data(lines, levels, only.contacts), only.contacts, only.line_ids,
        medium, probability,
    )  # fmt: skip
    return joint or only
