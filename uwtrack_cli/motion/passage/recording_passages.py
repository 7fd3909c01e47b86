"""Every passage of a recording: those of its lines, and those of its broadband.

**Method.** The broadband has no contact of its own. It is given to the only
contact that passes, if it agrees with its lines; where no line shows a passage, the
broadband is examined first, with the lines that follow it if its parts tell a passage
(`sub_bands`). What contacts of minutes do not show is sought among all lines for a few
d/v (`moving_lines`); such lines are told as a contact of their own, and so is what the
sound alone tells where nothing else has shown a passage (`own_time`). In air, contacts in
short frames are pieces of lines, which break where they fall fastest: there the pattern of
all sound is shifted along Doppler laws wherever a line falls or the level rises
(`evidence/doppler_image`), and measured frame by frame along the best one. Where lines and
broadband tell one passage and either leaves it in doubt, one fit of both is asked.
Where the broadband tells of passages that no contact accounts for, each is examined
with what the others put into it taken out (`source_separation`), unless they are one
passage with fringes.

**Conventions.** As in `contacts`.
"""

from dataclasses import replace
from functools import partial
from math import asinh, ceil
from typing import NamedTuple

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.correlation import overlap_correlation
from uwtrack_cli.motion.evidence.doppler_image import doppler_evidence, level_hump
from uwtrack_cli.motion.passage import moving_lines, own_time
from uwtrack_cli.motion.passage.candidates import (
    CandidatePassage,
    RecordingSpan,
    Still,
    agrees,
    examine,
    examine_contacts,
    examine_from,
    fit_contact,
    is_one,
    read,
    split,
    tell_once,
)
from uwtrack_cli.motion.passage.checks.fit_checks import check_fit
from uwtrack_cli.motion.passage.checks.known_sounds import check_known_sounds
from uwtrack_cli.motion.passage.checks.rest_frame import ask_the_sound
from uwtrack_cli.motion.passage.checks.sub_bands import (
    Rise,
    ask_the_parts,
    ask_the_parts_of_all,
    is_one_with_fringes,
)
from uwtrack_cli.motion.passage.failed_fits import attempted
from uwtrack_cli.motion.passage.fit.directivity import consider_directivity
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.likelihood_ratio import motion_likelihood
from uwtrack_cli.motion.passage.model.direction_bearings import with_directions_of
from uwtrack_cli.motion.passage.model.measurements import (
    contact_data,
    contact_ids,
    lines_of,
    with_frequency,
)
from uwtrack_cli.motion.passage.moving_lines import (
    APART,
    Together,
    line_falls,
    line_gains,
    lines_together,
    stretch_of,
)
from uwtrack_cli.motion.passage.own_time import Law, OwnTime, low_sound, measured, own_time_passages
from uwtrack_cli.motion.passage.readings.change_priors import cost_of_speed
from uwtrack_cli.motion.passage.source_separation import separate_sources

SMALLEST_LINE_GAIN = 5.0
"""Gain in log-likelihood by which the lines of a contact must follow a passage that
the broadband has shown, beside the logarithm of the number of contacts that may do so by
chance."""


LEAST_LEVEL_GAIN = 3.0
"""Gain in log-likelihood by which the levels of lines that move together for a few d/v
must follow the range: strong evidence (Kass & Raftery 1995)."""


N_CUTS, SAME_WIDTH = 3, 0.1
"""How often the lines that move together are cut out and fitted at most, and share by
which the width of what is cut out may still change in the end. Both are chosen."""


MOST_PLACES, LONGEST_FRAME_S = 4, 0.5
"""Places of a minute in air at which a pattern is sought in the sound at most, and the
length of frames, s, up to which contacts are pieces of lines and it is sought."""

WHOLE_FRAMES = 10.0
"""R/v, in frames, from which lines are whole where they fall, and are examined beside it."""

WANDER = 1.5
"""How many times wider the deviations by a pattern are than those of its fit: an engine whose
speed wanders within a second shifts its sound as a part of the law does. From 29 drawn
passages (`studies/constants/passage_probability.py draw FILE 611000 32 vehicle`), whose errors
are 1.1, 0.8 and 1.0 of the fit's deviations of time, R/v and speed in the median."""


N_MEASURED, FEWEST_FRAMES = 2, 12
"""How often a passage that the sound tells is measured, the last time by the fit of the
time before, and frames with a line that it must have."""


Place = tuple[float, float]
"""Time and R/v where something may pass, s."""


class SearchTerms(NamedTuple):
    """Medium, false-alarm probability, frames, ends and sound of the recording."""

    medium: Medium
    """Sound speed and depth difference."""
    probability: float
    """Probability of a passage in noise alone."""
    limits: RecordingSpan
    """Frames and ends of the recording."""
    sound: Recording | None
    """The recording, whose sound may be read again; None without it."""
    directions: Directions | None = None
    """What an array heard, of which the bearings of the levels are; None without it."""

    @property
    def asks_pattern(self) -> bool:
        """Whether the pattern of the sound shows passages better than pieces of lines."""
        is_short = self.limits.window_s <= LONGEST_FRAME_S
        return self.sound is not None and self.medium.is_air and is_short


def examine_recording(
    lines: Lines | None,
    levels: Levels | None,
    medium: Medium,
    false_alarm_probability: float,
    limits: RecordingSpan,
    sound: Recording | None = None,
    directions: Directions | None = None,
) -> tuple[list[CandidatePassage], list[Still]]:
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
    sound
        The recording, whose sound may contradict a passage of lines.
    directions
        What an array heard: a contact with lines has the source beside its lines.

    Returns
    -------
    list[CandidatePassage]
        Candidates, rejected ones included.
    list[Still]
        What the contacts of lines are read as that are none.
    """
    terms = SearchTerms(medium, false_alarm_probability, limits, sound, directions)
    asked: list[Place] = []
    every, still = _with_speed(lines, levels, terms, asked)
    parts: dict[int, Lines] = {}
    if lines is not None and not terms.medium.is_air:  # engines hardly keep their speed
        more, parts = _of_lines_together(lines, every, terms)
        every = [*every, *more]
    if levels is None:
        return every, still
    found = [item for item in every if item.passes]
    rejected = [item for item in every if not item.passes]
    if len(found) == 1:
        own = parts.get(found[0].contacts[0], lines)
        found = [_with_broadband(found[0], own, levels, terms)]
    passing = found
    shares, more = separate_sources(levels, passing, medium, false_alarm_probability, limits)
    if more and (passing or not _is_one(levels, more, terms)):
        passing = _apart(passing, more, shares, (lines, parts), terms)
    elif not passing:
        passing = _broadband_first(lines, levels, terms)
    if lines is not None and not terms.medium.is_air:
        numbers = [n for item in (*passing, *found, *rejected) for n in item.contacts]
        first = max([*numbers, int(lines.line_contact.max(initial=0))], default=0) + 1
        passing = [*passing, *_of_own_time(passing, first, terms)]
    used = {number for item in passing for number in item.contacts}
    others = [item for item in (*found, *rejected) if used.isdisjoint(item.contacts)]
    return (
        _with_patterns(passing + others, None, levels, terms, asked),
        [one for one in still if one.contact not in used],
    )


def _with_speed(
    lines: Lines | None, levels: Levels | None, terms: SearchTerms, asked: list[Place]
) -> tuple[list[CandidatePassage], list[Still]]:
    """Examine what may have a speed: contacts of lines, or patterns of the sound in air."""
    if not terms.asks_pattern:
        return _of_lines(lines, terms) if lines is not None else ([], [])
    rise = _of_levels(levels, terms) if levels is not None else None
    every, still = [rise] if rise else [], list[Still]()
    widths_s = [_place(item)[1] for item in every]
    if lines is not None:
        widths_s += [one.width_s for one in line_falls(lines)[:MOST_PLACES]]
        if max(widths_s, default=0.0) > WHOLE_FRAMES * terms.limits.window_s:
            found, still = _of_lines(lines, terms)
            every += [_with_hump(item, levels) for item in found]
    every = _with_patterns(every, lines, levels, terms, asked)
    return [item for item in every if not item.blocks.shift.is_empty], still


def _of_levels(levels: Levels, terms: SearchTerms) -> CandidatePassage | None:
    """Examine the broadband alone."""
    data, no_line = contact_data(None, levels, ()), np.empty(0, np.int64)
    return examine(data, (1,), no_line, terms.medium, terms.probability)


def _checked(
    item: CandidatePassage, lines: Lines | None, terms: SearchTerms
) -> CandidatePassage | None:
    def check() -> CandidatePassage:
        asked = ask_the_sound(read(item), terms.sound)
        return check_known_sounds(check_fit(asked), lines)

    return attempted(check, item.contacts, item.blocks.time_s)


def _of_lines(lines: Lines, terms: SearchTerms) -> tuple[list[CandidatePassage], list[Still]]:
    """Examine the contacts; one that is two vessels gives a new contact."""
    medium, probability = terms.medium, terms.probability
    found: list[CandidatePassage] = []
    number = int(lines.line_contact.max(initial=0))
    examined, still = examine_contacts(lines, medium, probability)
    for contact in examined:
        apart = attempted(
            partial(split, contact, medium, probability), contact.contacts, contact.blocks.time_s
        )
        first, *others = apart or [contact]
        found.append(first)
        for other in others:
            number += 1
            found.append(replace(other, contacts=(number,)))

    def join(one: CandidatePassage, other: CandidatePassage) -> CandidatePassage | None:
        both = one.contacts + other.contacts
        if not set(both) <= set(contact_ids(lines)):
            return None  # a part of a contact that was divided
        joint = examine(
            contact_data(lines, None, both), both, lines_of(lines, both), medium, probability
        )
        return _checked(joint, lines, terms) if joint else None

    checked = [_checked(item, lines, terms) for item in found]
    return tell_once([item for item in checked if item], join), still


def _of_lines_together(
    lines: Lines, known: list[CandidatePassage], terms: SearchTerms
) -> tuple[list[CandidatePassage], dict[int, Lines]]:
    """Examine lines that move together where no contact has a passage.

    Returned are passages that nothing speaks against, with contact numbers of their own,
    and the lines of each of them, about it, by contact number.
    """
    passing = [item for item in known if item.passes]
    numbers = [n for item in known for n in item.contacts]
    number = max([*numbers, int(lines.line_contact.max(initial=0))], default=0)
    found: list[CandidatePassage] = []
    parts: dict[int, Lines] = {}
    for place in lines_together(lines, terms.medium.sound_speed_mps):
        if any(_is_near(item.fit, place) for item in (*passing, *found)):
            continue
        item, part = _of_place(lines, place, number + 1, terms)
        if item is None or not _is_near(item.fit, place):
            continue
        # the rest of these lines has told nothing: their levels have to follow, too
        if item.likelihood_ratio.line_level < LEAST_LEVEL_GAIN:
            continue
        item = _checked(item, lines, terms)
        if item and item.passes:
            number += 1
            parts[number] = part
            found.append(item)
    return found, parts


def _of_place(
    lines: Lines, place: Together, number: int, terms: SearchTerms
) -> tuple[CandidatePassage | None, Lines]:
    """Fit the lines of a place, and all that move so about what was found."""
    span_s = max(float(np.ptp(lines.time_s)), 1e-9)
    item: CandidatePassage | None = None
    part = lines
    for _ in range(N_CUTS):
        part = stretch_of(lines, place, number)
        share = min(1.0, 2.0 * moving_lines.REACH * place.width_s / span_s)
        ids = lines_of(part, (number,))
        made = fit_contact(
            contact_data(part, None, (number,)), (number,), ids, terms.medium,
            share * terms.probability,
        )  # fmt: skip
        item = made if isinstance(made, CandidatePassage) else None
        if made is None or not _is_near(made.fit, place):
            return None, part
        width_s, speed = float(made.fit.range_over_speed_s[0]), made.fit.theta[0, 2]
        mach = float(speed) / terms.medium.sound_speed_mps
        heard_s = float(made.fit.theta[0, 0]) + mach * width_s
        again = line_gains(lines, Together(heard_s, width_s, ids, 0.0), mach)
        is_same = abs(width_s / place.width_s - 1.0) < SAME_WIDTH
        if not again.lines.size or (is_same and np.array_equal(again.lines, ids)):
            break
        place = again
    return item, part


def _of_own_time(
    known: list[CandidatePassage], number: int, terms: SearchTerms
) -> list[CandidatePassage]:
    """Examine passages of seconds that the sound tells where nothing else has.

    They have contact numbers of their own, from ``number`` on, and no line of the table.
    """
    # beside frames that hold the narrowest; shorter ones look again at what these did
    is_held = own_time.FRAME_S <= terms.limits.window_s <= own_time.NARROWEST_S
    if terms.sound is None or not is_held:
        return []
    found: list[CandidatePassage] = []
    there = [(float(item.fit.theta[0, 0]), float(item.fit.range_over_speed_s[0])) for item in known]
    sound_mps = terms.medium.sound_speed_mps
    for passage in own_time_passages(terms.sound, sound_mps, there):
        if any(_claims(item, passage.law) for item in (*known, *found)):
            continue
        item = _of_sound(passage, number + len(found), terms.sound, terms)
        if item is None:
            continue
        item = _checked(item, None, terms)
        if item is None:
            continue
        # one whose speed is not known was not asked about, and has nothing else
        is_asked = np.isfinite(item.rest_frame_evidence)
        if is_asked and item.passes:
            found.append(item)
    return found


def _claims(item: CandidatePassage, law: Law) -> bool:
    """Tell whether a candidate lies where a law has its closest approach."""
    apart_s = abs(float(item.fit.theta[0, 0]) - law[0])
    return apart_s < max(law[1], float(item.fit.range_over_speed_s[0]))


def _of_sound(
    passage: OwnTime, number: int, recording: Recording, terms: SearchTerms
) -> CandidatePassage | None:
    """Measure and fit a passage of the sound, twice: the second time by the first fit."""
    medium, law = terms.medium, passage.law
    reach_s = 2 * own_time.REACH * law[1]
    sound = low_sound(recording, law[0] - reach_s, law[0] + reach_s, medium.sound_speed_mps)
    if sound is None:
        return None
    item: CandidatePassage | None = None
    for _ in range(N_MEASURED):
        data = measured(sound, passage._replace(law=law))
        if np.count_nonzero(np.isfinite(data.frequency_hz).any(axis=0)) < FEWEST_FRAMES:
            return None
        theta = np.array([[law[0], np.log(law[1]), law[2], 0.0]])
        item = examine_from(
            data, ((number,), np.zeros(passage.tones_hz.size, np.int64)),
            (theta, np.ones(1)), medium, terms.probability,
        )  # fmt: skip
        if item is None or not _claims(item, passage.law):
            return None
        fit = item.fit
        law = (float(fit.theta[0, 0]), float(fit.range_over_speed_s[0]), float(fit.theta[0, 2]))
    return item


def _is_near(fit: PassageFit, place: Together) -> bool:
    """Return whether a fit is heard where lines move together."""
    theta, width_s = fit.theta[0], float(fit.range_over_speed_s[0])
    delay_s = width_s * float(theta[2]) / fit.medium.sound_speed_mps
    off_s = abs(float(theta[0]) + delay_s - place.time_s)
    return bool(off_s < APART * max(width_s, place.width_s))


def _apart(
    found: list[CandidatePassage],
    more: list[CandidatePassage],
    shares: list[Levels],
    heard: tuple[Lines | None, dict[int, Lines]],
    terms: SearchTerms,
) -> list[CandidatePassage]:
    """Examine every passage with its own share of the broadband.

    ``heard`` are all lines, and those of the contacts that were found among them.
    """
    lines, parts = heard
    first = len(found)
    if len(found) == 1:
        own_lines = parts.get(found[0].contacts[0], lines)
        found = [_with_broadband(found[0], own_lines, shares[0], terms)]
    taken = {number for item in found for number in item.contacts}
    free = [n for n in contact_ids(lines) if n not in taken] if lines is not None else []
    used = lines.line_contact.max(initial=0) if lines is not None else 0
    number = max([*taken, int(used)], default=0)
    shown = [Rise.of(item) for item in found]
    asked = ask_the_parts_of_all(more, shares[first:], shown)
    pairs = zip(asked, shares[first:], strict=True)
    for passage, own in sorted(pairs, key=lambda pair: pair[0].fit.theta[0, 0]):
        best = _with_lines(passage, lines, free, own, terms)
        free = [n for n in free if n not in best.contacts]
        if best is passage:
            number += 1
            best = replace(passage, contacts=(number,))
        found = [*found, best]
    return found


def _is_one(levels: Levels, several: list[CandidatePassage], terms: SearchTerms) -> bool:
    """Tell whether rises beside each other are one passage with fringes."""
    alone = _of_levels(levels, terms)
    if alone is None:
        return False
    return is_one_with_fringes(levels, Rise.of(alone), list(map(Rise.of, several)))


def _broadband_first(
    lines: Lines | None, levels: Levels, terms: SearchTerms
) -> list[CandidatePassage]:
    """Examine the broadband, with the lines that fit it if any do.

    Lines too weak to show a passage by themselves can still give its speed.
    """
    alone = _of_levels(levels, terms)
    if alone is not None:
        alone = ask_the_parts(alone, levels)
    if alone is None or lines is None:
        return [alone] if alone else []
    return [_with_lines(alone, lines, contact_ids(lines), levels, terms)]


def _with_patterns(
    items: list[CandidatePassage],
    lines: Lines | None,
    levels: Levels | None,
    terms: SearchTerms,
    asked: list[Place],
) -> list[CandidatePassage]:
    """Let the pattern of the sound compete for every place where something may pass in air.

    It takes the place of what has no speed, agrees with it or is less probable. ``asked``
    are the places that were asked before, and grow by those that are.
    """
    if not terms.asks_pattern:
        return items
    kept = sorted(items, key=lambda item: -item.decision.probability)
    places = [(_place(item), item.contacts) for item in kept if not _has_speed(item)]
    places += [
        ((one.time_s, one.width_s), (one.contact,))
        for one in (line_falls(lines) if lines is not None else [])
    ]
    asked += [_place(item) for item in kept if _has_speed(item)]
    minutes = (terms.limits.last_s - terms.limits.first_s) / 60.0
    most = len(asked) + MOST_PLACES * max(1, ceil(minutes))
    found: list[CandidatePassage] = []
    for place, contacts in places:
        if any(_is_beside(place, other) for other in (*asked, *map(_place, found))):
            continue
        if len(asked) == most:
            break
        asked.append(place)
        pattern = attempted(
            partial(_of_pattern, place, contacts, levels, terms),
            contacts, np.array([place[0] - place[1], place[0] + place[1]]),
        )  # fmt: skip
        if pattern is None or not pattern.passes:
            continue
        beside = [one for one in found if _is_beside(_place(one), _place(pattern))]
        others = [
            one.decision.probability for one in kept
            if _has_speed(one) and _is_beside(_place(one), _place(pattern))
            and not is_one(one, pattern)
        ]  # fmt: skip
        # of two patterns at one place the one that gains more
        gains = [one.rest_frame_evidence for one in beside]
        if pattern.decision.probability > max(
            others, default=0.0
        ) and pattern.rest_frame_evidence > max(gains, default=0.0):
            found = [one for one in found if not _is_beside(_place(one), _place(pattern))]
            found.append(pattern)
    return found + [
        one for one in kept if not any(_is_beside(_place(one), _place(other)) for other in found)
    ]


def _has_speed(item: CandidatePassage) -> bool:
    return not item.blocks.shift.is_empty and item.passes


def _place(item: CandidatePassage) -> Place:
    """Return time and R/v of a candidate, s."""
    return float(item.fit.theta[0, 0]), float(item.fit.range_over_speed_s[0])


def _is_beside(one: Place, other: Place) -> bool:
    """Tell whether two places lie within R/v of each other."""
    return abs(one[0] - other[0]) < max(one[1], other[1])


def _of_pattern(
    place: Place, contacts: tuple[int, ...], levels: Levels | None, terms: SearchTerms
) -> CandidatePassage | None:
    """Measure where the pattern of the sound is about a passage in air, and fit it.

    All that a vehicle radiates is one line, which is read along its Doppler law and not
    cut where it falls fastest.
    """
    assert terms.sound is not None  # noqa: S101 - asked before
    shown = doppler_evidence(terms.sound, *place)
    if shown is None or shown.evidence <= 0.0:
        return None
    law, course = shown.law, shown.course
    frequency_hz = course.tone_hz * np.exp(course.shift)
    overlap = overlap_correlation("frequency", course.overlap)
    data = with_frequency(
        contact_data(None, levels, ()), course.time_s, frequency_hz,
        frequency_hz * course.shift_std, float(overlap[:1].sum()),
    )  # fmt: skip
    speed_mps = law.mach * terms.medium.sound_speed_mps
    theta = np.array([[law.time_s, np.log(law.width_s), speed_mps, 0.0]])
    made = examine_from(
        data, (contacts, np.zeros(1, np.int64)), (theta, np.ones(1)),
        terms.medium, terms.probability, is_shown=True,
    )  # fmt: skip
    found = _checked(made, None, terms) if made else None
    if found is None:
        return None
    fit = replace(
        found.fit,
        covariance=WANDER**2 * found.fit.covariance,
        full_covariance=WANDER**2 * found.fit.full_covariance,
        rest_std_hz=np.hypot(WANDER * found.fit.rest_std_hz, course.tone_std_hz),
    )
    gain = asinh(0.5 * shown.evidence)
    return _with_hump(replace(found, fit=fit, rest_frame_evidence=gain), levels)


def _with_hump(item: CandidatePassage, levels: Levels | None) -> CandidatePassage:
    """Return a passage in air with what the level says of it."""
    if levels is None:
        return item
    time_s, width_s = _place(item)
    mach = float(item.fit.theta[0, 2]) / item.fit.medium.sound_speed_mps
    return item.measured(level=level_hump(levels, time_s + width_s * mach, width_s))


def _with_lines(
    alone: CandidatePassage,
    lines: Lines | None,
    contacts: list[int],
    levels: Levels,
    terms: SearchTerms,
) -> CandidatePassage:
    """Add the lines that follow a rise of the broadband, whether or not it passes alone."""
    best, gain = alone, SMALLEST_LINE_GAIN + np.log(max(len(contacts), 1))
    if lines is None or terms.asks_pattern:
        return alone
    for contact in contacts:
        part = (contact,)
        own = with_directions_of(levels, terms.directions, lines, part)
        joint = examine(
            contact_data(lines, own, part), part, lines_of(lines, part),
            terms.medium, terms.probability,
        )  # fmt: skip
        if joint is None:
            continue
        own_gain = _gain_of_line(joint, alone)
        told = _checked(joint, lines, terms) if own_gain > gain else None
        if told:
            best, gain = told, own_gain
    # neither may be sure alone; a line that follows by chance must not spoil what passes
    return best if best.passes else alone


def _gain_of_line(joint: CandidatePassage, alone: CandidatePassage) -> float:
    """Return what speaks for a line that follows a passage of the broadband, in nepers.

    What its frequencies gain, less what the broadband loses by its passage, and what its
    speed costs: noise that is followed moves as far as noise does, which hardly any vessel
    does. Its own levels count where they do not follow the range.
    """
    ratio = joint.likelihood_ratio
    lost = max(alone.likelihood_ratio.level - ratio.level, 0.0)
    lost += max(alone.likelihood_ratio.bearing - ratio.bearing, 0.0)
    return ratio.doppler - lost - cost_of_speed(joint.fit) + min(ratio.line_level, 0.0)


def _with_broadband(
    only: CandidatePassage, lines: Lines | None, levels: Levels, terms: SearchTerms
) -> CandidatePassage:
    """Fit the lines with the broadband, unless the two have different motions."""
    if terms.asks_pattern:
        return only  # it was weighed with the level already
    medium, probability = terms.medium, terms.probability
    levels = with_directions_of(levels, terms.directions, lines, only.contacts)
    wide = contact_data(None, levels, ())
    alone = examine(wide, only.contacts, np.empty(0, np.int64), medium, probability)
    if alone is not None and not agrees(alone, only):
        alone_shape = motion_likelihood(alone.blocks, alone.fit, alone.fit)
        flat = alone_shape - alone.likelihood_ratio.total
        if motion_likelihood(alone.blocks, alone.fit, only.fit) < flat:
            return only
    joint = examine(
        contact_data(_own_lines(lines, only), levels, only.contacts),
        only.contacts, only.line_ids,
        medium, probability,
    )  # fmt: skip
    if joint is None or _tells_less(joint, only):
        return only
    return _checked(joint, lines, terms) or only


def _own_lines(lines: Lines | None, item: CandidatePassage) -> Lines | None:
    """Return the lines without those of its contacts that it is not made of.

    A contact that was divided among two vessels has kept its lines in the table.
    """
    if lines is None:
        return None
    of_another = np.isin(lines.line_contact, item.contacts)
    of_another &= ~np.isin(lines.line_id, item.line_ids)
    return replace(lines, line_contact=np.where(of_another, 0, lines.line_contact))


def _tells_less(joint: CandidatePassage, only: CandidatePassage) -> bool:
    """Return whether lines tell more without a level that depends on direction."""
    if not joint.fit.medium.is_air:
        return False
    wider = consider_directivity(joint.fit, joint.blocks)
    return bool(wider.covariance[0, 1, 1] > only.fit.covariance[0, 1, 1])
