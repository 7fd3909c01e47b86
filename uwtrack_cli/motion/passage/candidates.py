"""From the measurements of contacts to candidate passages, one per vessel.

**Method.** A contact is fitted by itself. Contacts whose measurements agree with the
motion of a stronger one are parts of the same vessel (a tracker may split its lines)
and are fitted together, the more so where they are teeth of one comb. Contacts that show
no passage by themselves and may be two gears of one machine are fitted together, too:
either has too little of the passage. Conversely, vessels that pass close together on like courses
look like one contact until their closest approach is fitted: a line whose residuals,
less what all lines share, still follow the partials of the passage has a motion of
its own. Where there is such a line, all that leave the common motion are fitted alone, and
lines that agree are fitted together again; the contact is divided only if two vessels with two
lines each result, neither of which accepts the other's motion.

Whether a vessel passes is decided from all that was measured of a candidate (`motion/decision.py`).

**Conventions.** Agreement is a difference of log-likelihoods, robust against coloured
noise; see `likelihood_ratio`. The strongest vessel keeps the contact number.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import STILL
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.association import PassageReport, same_vessel
from uwtrack_cli.motion.decision import (
    DUPLICATE,
    LEAST_PROBABILITY,
    Evidence,
    PassageDecision,
    Rejection,
    decide,
    reject,
    why_not,
)
from uwtrack_cli.motion.passage.failed_fits import attempted
from uwtrack_cli.motion.passage.fit.estimator import (
    PassageFit,
    correct_frequencies,
    fit_passage,
    fit_with_coloured_noise,
    level_misfit,
    take_rows,
)
from uwtrack_cli.motion.passage.fit.initial_estimates import find_initial_estimates
from uwtrack_cli.motion.passage.fit.likelihood_ratio import (
    LikelihoodRatio,
    motion_likelihood,
    passage_likelihood_ratio,
)
from uwtrack_cli.motion.passage.model.law import slant_over_speed_s
from uwtrack_cli.motion.passage.model.measurements import (
    Blocks,
    PassageData,
    condense,
    contact_data,
    contact_ids,
    lines_of,
    make_blocks,
    thin,
)
from uwtrack_cli.motion.passage.readings.change_priors import VESSEL_MPS
from uwtrack_cli.motion.passage.readings.competing_readings import (
    FREQUENCY_CHANGES,
    STRAIGHT_READING,
    TWO_TARGETS,
    Reading,
    Tried,
    may_hide_passage,
    read_passage,
    read_still,
    try_readings,
    weigh_readings,
)
from uwtrack_cli.motion.passage.same_machine import contact_ends, is_next_gear, is_of_comb

FEWEST_MEASUREMENTS = 8
"""Instants with a measurement below which nothing is fitted."""

LARGEST_LEVEL_MISFIT = 4.0
"""Variance of level residuals, slow changes included, over what is expected: beyond it
the levels are left out where lines or bearings determine the passage."""

AGREEMENT = 9.2
"""Loss of log-likelihood that another contact's motion may cost: 99.9 % of the true
ones cost less (chi-square with four degrees of freedom)."""


@dataclass(frozen=True)
class CandidatePassage:
    """A significant fit of one vessel's measurements."""

    contacts: tuple[int, ...]
    """Contact numbers that the measurements came from."""
    line_ids: IntArray
    """Lines, in the order of the rows of frequencies."""
    data: PassageData
    """Measurements, condensed about the passage."""
    blocks: Blocks
    """The same in the units of the fit."""
    fit: PassageFit
    """Fit of one row."""
    likelihood_ratio: LikelihoodRatio
    """Gains over readings without a passage."""
    other_turn: float
    """Weight of the opposite side, 0 to 1."""
    rest_frame_evidence: float = np.nan
    """Evidence of the sound for the passage, nepers; nan if it was not asked."""
    misfit: float = np.nan
    """Misfit of its lines: see `fit_checks`; nan if it was not checked."""
    duplicate_of: int = 0
    """Contact that reports the same passage; 0 for none."""
    reading: Reading = STRAIGHT_READING
    """How its measurements are read."""
    evidence: Evidence = field(default_factory=dict)
    """What each check measured, by name: see `motion/decision.py`."""

    def measured(self, **found: float) -> Self:
        """Return the same with what a check has measured."""
        return replace(self, evidence={**self.evidence, **found})

    @cached_property
    def decision(self) -> PassageDecision:
        """How sure it is that a vessel passes, from all that was measured so far."""
        return decide(passage_evidence(self))

    @property
    def passes(self) -> bool:
        """Whether a vessel rather passes than not, and is reported here alone."""
        return not self.duplicate_of and self.decision.probability > LEAST_PROBABILITY

    @property
    def rejection(self) -> Rejection:
        """The explanation that wins where no vessel passes, with its sentence."""
        if self.duplicate_of:
            return reject(DUPLICATE, contact=self.duplicate_of)
        return why_not(self.decision, passage_evidence(self))


def passage_evidence(candidate: CandidatePassage) -> Evidence:
    """Return all that was measured of a candidate, by name: gains and costs in nepers."""
    fit, blocks, ratio = candidate.fit, candidate.blocks, candidate.likelihood_ratio
    width_s, time_s = float(fit.range_over_speed_s[0]), float(fit.theta[0, 0])
    variance = np.diag(fit.covariance[0])
    std = np.sqrt(np.where(variance > 0, variance, np.inf))
    extent = np.array(measured_extent(blocks))
    ends = (extent - time_s) / width_s
    has_lines = not blocks.shift.is_empty
    return {
        "gain": ratio.total - ratio.threshold,
        "gain_over_line": ratio.over_line - ratio.threshold,
        "gain_over_break": ratio.over_break - ratio.threshold,
        "bearing": ratio.bearing,
        "level": ratio.level,
        "line_level": ratio.line_level,
        "log_odds": candidate.reading.log_odds,
        "time_s": time_s,
        "time_std_s": std[0],
        "range_over_speed_s": width_s,
        "relative_width_std": std[1] / width_s,
        "before": -ends[0],
        "after": ends[1],
        "speed_mps": float(fit.theta[0, 2]),
        "range_m": float(fit.theta[0, 2]) * width_s,
        "speed_std_mps": std[2] if has_lines else np.nan,
        "is_air": float(fit.medium.is_air),
        "is_water": float(fit.medium.is_water),
        "has_lines": float(has_lines),
        **candidate.evidence,
    }


class Still(NamedTuple):
    """A contact that is not told to pass, and what it is read as."""

    contact: int
    """Contact number, from 1."""
    from_s: float
    """Time of its first measurement, s."""
    to_s: float
    """Time of its last measurement, s."""
    reading: Reading
    """Its likeliest reading; a passage that is not significant may be it."""


class Unclaimed(NamedTuple):
    """What was fitted and is no significant passage."""

    contacts: tuple[int, ...]
    """Contact numbers that the measurements came from."""
    fit: PassageFit
    """Straight fit of one row."""
    blocks: Blocks
    """The measurements."""
    tried: Tried | None
    """What it was read as beside a change; None if none could hide a passage."""

    def read(self) -> list[Still]:
        """Return what it is read as; nothing if that fails."""
        used = (self.blocks.weight[0] > 0).any(axis=0)
        time_s = self.blocks.time_s[used]
        reading = attempted(
            lambda: read_still(self.fit, self.blocks, self.tried), self.contacts, time_s
        )
        if reading is None:
            return []
        return [Still(self.contacts[0], float(time_s[0]), float(time_s[-1]), reading)]


def examine(
    data: PassageData,
    contacts: tuple[int, ...],
    line_ids: IntArray,
    medium: Medium,
    false_alarm_probability: float,
    *,
    only_straight: bool = False,
) -> CandidatePassage | None:
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
    only_straight
        Whether a passage that a change of frequencies hides is left there.
    """
    found = fit_contact(
        data, contacts, line_ids, medium, false_alarm_probability, only_straight=only_straight
    )
    return found if isinstance(found, CandidatePassage) else None


def fit_contact(
    data: PassageData,
    contacts: tuple[int, ...],
    line_ids: IntArray,
    medium: Medium,
    false_alarm_probability: float,
    *,
    only_straight: bool = False,
) -> CandidatePassage | Unclaimed | None:
    """Fit one contact; None if too little of it was measured, or if the fit fails.

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
    only_straight
        Whether a passage that a change of frequencies hides is left there.
    """
    owner = contacts, line_ids
    return attempted(
        lambda: _fit_alone(
            data, owner, medium, false_alarm_probability, only_straight=only_straight
        ),
        contacts,
        data.time_s,
    )


def _fit_alone(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    medium: Medium,
    false_alarm_probability: float,
    *,
    only_straight: bool,
) -> CandidatePassage | Unclaimed | None:
    """Fit measurements from starts of their own."""
    thinned = thin(data)
    blocks = make_blocks(thinned)
    used = np.zeros(thinned.time_s.size, np.bool_)
    for block in (blocks.shift, blocks.bearing, blocks.level):
        used |= (block.weight[0] > 0).any(axis=0)
    if used.sum() < FEWEST_MEASUREMENTS:
        return None
    rough, other = best_start(blocks, medium)
    if rough is None:
        return _nowhere(owner[0], blocks, medium)
    return _fit_from(
        thinned, owner, (rough.theta, rough.turn), medium, false_alarm_probability, other,
        only_straight=only_straight,
    )  # fmt: skip


def _nowhere(contacts: tuple[int, ...], blocks: Blocks, medium: Medium) -> Unclaimed | None:
    """Fit what has no start of a passage at all, for the noise in which it is read."""
    span_s = float(np.ptp(blocks.time_s))
    speed_mps = 0.0 if blocks.shift.is_empty else VESSEL_MPS
    middle_s = float(blocks.time_s[0]) + 0.5 * span_s
    theta = np.array([[middle_s, np.log(0.1 * span_s), speed_mps, 0.0]])
    fit = fit_passage(blocks, theta, np.ones(1), medium)
    is_sane = bool(np.isfinite(fit.theta).all() and np.isfinite(fit.cost).all())
    return Unclaimed(contacts, fit, blocks, None) if is_sane else None


def examine_from(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    start: tuple[FloatArray, FloatArray],
    medium: Medium,
    false_alarm_probability: float,
    other_turn: float = 0.0,
    *,
    is_shown: bool = False,
) -> CandidatePassage | None:
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
    is_shown
        Whether the sound itself has shown the passage over what passes nowhere.
    """
    found = attempted(
        lambda: _fit_from(
            data, owner, start, medium, false_alarm_probability, other_turn, is_shown=is_shown
        ),
        owner[0],
        data.time_s,
    )
    return found if isinstance(found, CandidatePassage) else None


def _fit_from(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    start: tuple[FloatArray, FloatArray],
    medium: Medium,
    false_alarm_probability: float,
    other_turn: float,
    *,
    is_shown: bool = False,
    only_straight: bool = False,
) -> CandidatePassage | Unclaimed:
    """Fit measurements from a known start."""
    theta, turn = start
    height = medium.height_m if theta[0, 2] else 0.0
    width = slant_over_speed_s(np.exp(theta[0, 1]), theta[0, 2], height)
    short = condense(data, float(theta[0, 0]), float(width))
    blocks = make_blocks(short)
    white = fit_passage(blocks, theta, turn, medium)
    blocks = correct_frequencies(blocks, white)
    fit = fit_with_coloured_noise(white, blocks)
    # lines that jitter pull a fit of white noise off the levels: ask the better one
    if _is_misfit(white, blocks) and _is_misfit(fit, blocks):
        short = replace(short, level_db=np.full_like(short.level_db, np.nan))
        blocks = correct_frequencies(make_blocks(short), fit)
        fit = fit_passage(blocks, fit.theta, fit.turn, medium)
        fit = fit_with_coloured_noise(fit, blocks)
    likelihood_ratio = passage_likelihood_ratio(
        fit, blocks, false_alarm_probability, is_shown=is_shown
    )
    reading = STRAIGHT_READING
    moves_on = blocks.shift.is_empty or bool(fit.theta[0, 2] > 0)
    is_passage = likelihood_ratio.is_passage and _is_resolved(fit, blocks, data)
    if not (moves_on and (is_passage or is_shown)):
        # a change of all frequencies larger than their Doppler shift hides a passage
        if only_straight or not may_hide_passage(fit, blocks, likelihood_ratio.threshold):
            return Unclaimed(owner[0], fit, blocks, None)
        straight, tried = fit, try_readings(fit, blocks, FREQUENCY_CHANGES)
        fit, reading = weigh_readings(tried, blocks)
        if fit.change is None:
            return Unclaimed(owner[0], straight, blocks, tried)
        likelihood_ratio = passage_likelihood_ratio(fit, blocks, false_alarm_probability)
        if not (likelihood_ratio.is_passage and _is_resolved(fit, blocks, data)):
            return Unclaimed(owner[0], straight, blocks, tried)
    return CandidatePassage(
        *owner, short, blocks, fit, likelihood_ratio, other_turn, reading=reading
    )


def _is_resolved(fit: PassageFit, blocks: Blocks, data: PassageData) -> bool:
    """Tell whether the frequencies fall slower than from one measurement to the next.

    Between two measurements a passage and a step of the engine look alike.
    """
    if blocks.shift.is_empty:
        return True
    spacing_s = float(np.median(np.diff(data.time_s)))
    return bool(fit.range_over_speed_s[0] > spacing_s)


def read(candidate: CandidatePassage) -> CandidatePassage:
    """Return a candidate by its likeliest reading.

    Parameters
    ----------
    candidate
        A significant fit; one that is not straight was read already. One of two
        targets may have changed something, too.
    """
    if candidate.fit.change is not None:
        return candidate
    fit, reading = read_passage(candidate.fit, candidate.blocks)
    if candidate.reading.name == TWO_TARGETS and fit.change is None:
        both, has_rival = candidate.reading, reading.rival in STILL
        reading = reading._replace(
            name=TWO_TARGETS,
            weight=both.weight * (1.0 - reading.nothing),
            rival=reading.rival if has_rival else "",
            rival_weight=reading.rival_weight if has_rival else 0.0,
        )
    return replace(candidate, fit=fit, reading=reading)


def _is_misfit(fit: PassageFit, blocks: Blocks) -> bool:
    """Return whether levels follow another law, and other kinds determine the passage.

    Fringes of the surface image and other spreading laws leave correlated residuals.
    """
    if blocks.level.is_empty or (blocks.shift.is_empty and blocks.bearing.is_empty):
        return False
    return level_misfit(fit, blocks) > LARGEST_LEVEL_MISFIT


def best_start(blocks: Blocks, medium: Medium) -> tuple[PassageFit | None, float]:
    """Fit one data set from many starts, and weigh the opposite turn.

    Parameters
    ----------
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    """
    starts = find_initial_estimates(blocks, medium)
    fixed = replace(medium, height_std_m=0.0)
    if not starts.turn.size:
        return None, 0.0
    fits = fit_passage(blocks, starts.theta, starts.turn, fixed, with_coloured_noise=False)
    sane = np.isfinite(fits.cost)
    if not blocks.shift.is_empty:
        sane &= fits.theta[:, 2] > 0
    if not sane.any():  # a rise of all frequencies may hide their fall
        sane = np.isfinite(fits.cost)
    cost = np.where(sane, fits.cost, np.inf)
    if not np.isfinite(cost).any():
        return None, 0.0
    best = int(np.argmin(cost))
    opposite = cost[starts.turn != starts.turn[best]]
    behind = float(opposite.min() - cost[best]) if opposite.size else np.inf
    weight = 0.0 if blocks.bearing.is_empty else 1 / (1 + np.exp(min(behind, 50.0)))
    return take_rows(fits, [best]), float(weight)


def examine_contacts(
    lines: Lines, medium: Medium, false_alarm_probability: float
) -> tuple[list[CandidatePassage], list[Still]]:
    """Examine the lines of every contact; contacts that are one vessel are joined.

    Parameters
    ----------
    lines
        Tracked lines.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.

    Returns
    -------
    list[CandidatePassage]
        Those that pass.
    list[Still]
        What the others are read as; too little was measured of what is in neither.
    """

    def fitted(contacts: tuple[int, ...]) -> CandidatePassage | Unclaimed | None:
        return fit_contact(
            contact_data(lines, None, contacts), contacts, lines_of(lines, contacts),
            medium, false_alarm_probability,
        )  # fmt: skip

    def of(contacts: tuple[int, ...]) -> CandidatePassage | None:
        found = fitted(contacts)
        return found if isinstance(found, CandidatePassage) else None

    alone, still = dict[int, CandidatePassage | None](), list[Still]()
    for contact in contact_ids(lines):
        one = fitted((contact,))
        alone[contact] = one if isinstance(one, CandidatePassage) else None
        still += one.read() if isinstance(one, Unclaimed) else []
    of_gears = _of_gears(alone, lines, of)
    told = {contact for item in of_gears for contact in item.contacts}
    found = [item for contact, item in alone.items() if item and contact not in told]
    still = [one for one in still if one.contact not in told]
    return _merge(found + of_gears, of), still


def _of_gears(
    alone: dict[int, CandidatePassage | None],
    lines: Lines,
    of: Callable[[tuple[int, ...]], CandidatePassage | None],
) -> list[CandidatePassage]:
    """Examine contacts without a passage of their own as gears of one machine.

    A gear follows the one before it, so that three of them are one machine, too.
    """
    times = lines.frames.time_s
    if not times.size:
        return []
    limits = RecordingSpan(lines.frames.window_s, float(times[0]), float(times[-1]))
    silent = [
        contact for contact, item in alone.items()
        if not item or not has_closest_approach(item.fit, item.blocks, limits)
    ]  # fmt: skip
    ends = contact_ends(lines, silent)
    chains: list[tuple[int, ...]] = []
    for contact in silent:
        own = ends[contact]
        last = next((c for c in chains if is_next_gear(ends[c[-1]], own, limits.window_s)), None)
        if last is None:
            chains.append((contact,))
        else:
            chains[chains.index(last)] = (*last, contact)
    made = [of(chain) for chain in chains if len(chain) > 1]
    return [item for item in made if item and has_closest_approach(item.fit, item.blocks, limits)]


def _merge(
    found: list[CandidatePassage], of: Callable[[tuple[int, ...]], CandidatePassage | None]
) -> list[CandidatePassage]:
    """Join contacts that agree with the motion of a stronger one.

    A part of a line agrees with many motions: it goes with the one that explains it best.
    Lines of the comb of a stronger one are taken for its own as long as they would be if
    the tracker had given them the same contact.
    """
    left = sorted(found, key=lambda item: -item.likelihood_ratio.total)
    kept: list[CandidatePassage] = []
    while left:
        leader, *left = left
        alike = [
            agrees(item, leader)
            or (_is_of_comb(item, leader) and _loss(item, leader) < DISAGREEMENT)
            for item in left
        ]
        rivals = [item for item, is_like in zip(left, alike, strict=True) if not is_like]
        same = [
            item for item, is_like in zip(left, alike, strict=True)
            if is_like and not _suits_better(item, leader, rivals)
        ]  # fmt: skip
        if same:
            contacts = tuple(number for item in (leader, *same) for number in item.contacts)
            leader = of(contacts) or leader
            left = [item for item in left if item not in same]
        kept.append(leader)
    return kept


def _is_of_comb(item: CandidatePassage, leader: CandidatePassage) -> bool:
    one, other = leader.fit, item.fit
    return is_of_comb(one.rest_hz[0], one.rest_std_hz[0], other.rest_hz[0], other.rest_std_hz[0])


def _suits_better(
    item: CandidatePassage, leader: CandidatePassage, rivals: list[CandidatePassage]
) -> bool:
    """Tell whether a stronger candidate explains one better than the leader does."""
    strength = item.likelihood_ratio.total
    stronger = [one for one in rivals if one.likelihood_ratio.total > strength]
    if not stronger:
        return False
    return min(_loss(item, one) for one in stronger) < _loss(item, leader)


Join = Callable[[CandidatePassage, CandidatePassage], CandidatePassage | None]
"""Fits the lines of two candidates together, and checks them; None without a passage."""


def tell_once(found: list[CandidatePassage], join: Join | None = None) -> list[CandidatePassage]:
    """Return the candidates, one for those that claim the same passage.

    Lines of one vessel that were followed in their own ways may not agree by their
    likelihoods, which keep them apart; `association.same_vessel` holds their answers
    against each other.
    All their lines tell the passage together where their joint fit passes; else the
    weaker candidate is a duplicate.

    Parameters
    ----------
    found
        Candidates that were examined and checked.
    join
        What fits two of them together; without it the weaker one is rejected.
    """
    kept: list[CandidatePassage] = []
    for item in sorted(found, key=lambda item: -item.likelihood_ratio.total):
        places = [k for k, one in enumerate(kept) if one.passes]
        first = next((k for k in places if is_one(item, kept[k])), None)
        if first is None or not item.passes:
            kept.append(item)
            continue
        leader = kept[first]
        joint = join(leader, item) if join else None
        if joint is not None and joint.passes and is_one(joint, leader):
            kept[first] = joint
            continue
        kept.append(replace(item, duplicate_of=leader.contacts[0]))
    return kept


def is_one(item: CandidatePassage, leader: CandidatePassage) -> bool:
    """Return whether two candidates claim one passage.

    Parameters
    ----------
    item, leader
        Candidates with lines.
    """
    if min(float(one.fit.theta[0, 2]) for one in (item, leader)) <= 0.0:
        return False
    return same_vessel(_closest_approach(item), _closest_approach(leader)) > 0.0


def _closest_approach(item: CandidatePassage) -> PassageReport:
    """Return what a candidate claims."""
    fit = item.fit
    std = np.sqrt(np.diag(fit.covariance[0])[:4])
    bearing = (float("nan"), float("nan"))
    if not item.blocks.bearing.is_empty:
        bearing = float(fit.bearing_deg[0]), float(std[3])
    return PassageReport(
        float(fit.theta[0, 0]), float(std[0]), float(fit.range_over_speed_s[0]),
        float(std[1]), float(fit.theta[0, 2]), float(std[2]), *bearing,
    )  # fmt: skip


def agrees(item: CandidatePassage, leader: CandidatePassage) -> bool:
    """Return whether a candidate's measurements agree with another's motion.

    Parameters
    ----------
    item
        Candidate whose measurements are tried.
    leader
        Candidate whose motion is tried.
    """
    own = motion_likelihood(item.blocks, item.fit, item.fit)
    other = motion_likelihood(item.blocks, item.fit, leader.fit)
    return own - other < AGREEMENT


LARGEST_RELATIVE_WIDTH = 1.0 / 3.0
"""A bend whose d/v is less certain than this is no passage: machinery drifts, too."""

LEAST_TURN_DEG = 30.0
"""Turn of the line of sight that must be measured: over less of a passage lines bend
hardly, levels stay, and machinery that drifts is the same."""

ONE_SIDE = 0.3
"""Share of d/v that must be measured on either side of the closest approach."""


@dataclass(frozen=True)
class RecordingSpan:
    """Length of the frames, and first and last instant of the recording, s."""

    window_s: float
    """Length of the frames, s; 0 for tables."""
    first_s: float
    """First instant, s."""
    last_s: float
    """Last instant, s."""


def has_closest_approach(fit: PassageFit, blocks: Blocks, limits: RecordingSpan) -> bool:
    """Return whether time and width of a fit are rather those of a passage than of the ends.

    A quick look during the search; whether a vessel passes is for `decision`.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements.
    limits
        Length of the frames and ends of the recording.
    """
    width, closest = float(fit.range_over_speed_s[0]), float(fit.theta[0, 0])
    std = np.sqrt(np.maximum(np.diag(fit.covariance[0])[:2], 0.0))
    first, last = measured_extent(blocks)
    turn = np.ptp(np.arctan((np.array([first, last]) - closest) / width))
    slack = 0.1 * (limits.last_s - limits.first_s) + 2 * limits.window_s
    begins_there = closest - ONE_SIDE * width < first and first > limits.first_s + slack
    ends_there = closest + ONE_SIDE * width > last and last < limits.last_s - slack
    return bool(
        np.isfinite(std).all()
        and width >= limits.window_s
        and std[1] <= LARGEST_RELATIVE_WIDTH * width
        and std[0] <= width
        and np.degrees(turn) >= LEAST_TURN_DEG
        and first - width < closest < last + width
        and not begins_there
        and not ends_there
    )


def measured_extent(blocks: Blocks) -> tuple[float, float]:
    """Return first and last instant with a measurement, s."""
    used = np.zeros(blocks.time_s.size, np.bool_)
    for block in (blocks.shift, blocks.bearing, blocks.level):
        used |= (block.weight[0] > 0).any(axis=0)
    times = blocks.time_s[used]
    return float(times[0]), float(times[-1])


FEWEST_LINES = 2
"""Lines that a vessel must have to be separated from another in the same contact."""

SUSPICION = 30.0
"""Gain of a line's own motion (half a chi-square) beyond which the lines are tried."""

DISAGREEMENT = 3.0 * AGREEMENT
"""Loss that the other vessel's motion must cost either."""

N_ASSIGNMENTS = 3
"""How often lines are given to the motion that explains them best."""

SURE = 100.0
"""Loss beyond which nothing is gained; so many ways to divide the lines are tried as
there are subsets of them."""


def split(
    candidate: CandidatePassage, medium: Medium, false_alarm_probability: float
) -> list[CandidatePassage]:
    """Divide a contact whose lines have two motions; else return it alone.

    Levels, and bearings that are not those of a line, hold both and are left out.

    Parameters
    ----------
    candidate
        Fit of the lines of a contact.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    """
    if candidate.line_ids.size < 2 * FEWEST_LINES:
        return [candidate]
    gain = own_motion_gain(candidate)
    if gain.max() < SUSPICION:
        return [candidate]
    owner, apart = (candidate.contacts, candidate.line_ids), gain > AGREEMENT
    found = take_apart(candidate.data, owner, medium, false_alarm_probability, apart)
    return found or [candidate]


def take_apart(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    medium: Medium,
    false_alarm_probability: float,
    apart: BoolArray | None = None,
) -> list[CandidatePassage]:
    """Divide the lines of a contact among two vessels, each with two lines or more.

    Parameters
    ----------
    data
        Measurements of the contact.
    owner
        Contact numbers and lines that they came from.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    apart
        Lines whose motion is not the common one, shape (lines,): the others are one vessel.
        None if it is not known of any.

    Returns
    -------
    list[CandidatePassage]
        Two vessels, neither of which accepts the other's motion; empty if there are none.
    """
    count = owner[1].size
    if count < 2 * FEWEST_LINES:
        return []
    rows = np.arange(count)
    alone = rows if apart is None else rows[apart]
    pieces = [np.setdiff1d(rows, alone), *alone[:, None]]
    groups = _groups(data, owner, medium, false_alarm_probability, pieces)
    whole = [item for item in groups if item.line_ids.size >= FEWEST_LINES]
    if len(whole) < 2:
        return []
    first, second = whole[:2]
    loss = min(_loss(first, second), _loss(second, first))
    if loss < DISAGREEMENT:
        return []
    weight = 1 / (1 + np.exp(count * np.log(2.0) - min(loss, SURE)))
    reading = Reading(TWO_TARGETS, float(weight))
    return [replace(item, reading=reading) for item in (first, second)]


def own_motion_gain(candidate: CandidatePassage) -> FloatArray:
    """Return for each line what a motion of its own would gain, half a chi-square.

    Parameters
    ----------
    candidate
        Fit of several lines.
    """
    fit, blocks = candidate.fit, candidate.blocks
    law = fit.law(blocks.time_s)
    shift = blocks.shift.value[0] - law.shift[0]
    angle = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    bearing = wrap_rad(blocks.bearing.value[0] - angle)
    gain = np.zeros(candidate.line_ids.size)
    centred = _centred(shift, blocks.shift.weight[0])
    kinds = [(centred, blocks.shift, 0, law.shift_d[0, :, :3])]
    if blocks.count[0] == blocks.count[1]:  # every line has its own
        kinds.append((bearing, blocks.bearing, 1, law.angle_d[0, :, :3]))
    for residual, block, noise, slope in kinds:
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


def _projected(residual: FloatArray, weight: FloatArray, slope: FloatArray) -> FloatArray:
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
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    medium: Medium,
    probability: float,
    pieces: list[IntArray],
) -> list[CandidatePassage]:
    """Fit pieces of lines alone, and together again those that agree; strongest first.

    A piece goes with the motion that explains it best, once with those of single pieces
    and once with those of the groups; one that none explains is left out.
    """
    made = [
        (rows, _of_rows(data, owner, rows, medium, probability)) for rows in pieces if rows.size
    ]
    known = [(rows, item) for rows, item in made if item is not None]
    leaders: list[CandidatePassage] = []
    for _, item in sorted(known, key=lambda one: -one[1].likelihood_ratio.total):
        if not any(agrees(item, leader) for leader in leaders):
            leaders.append(item)
    former: list[IntArray] = []
    for _ in range(N_ASSIGNMENTS):
        chosen = np.full(owner[1].size, -1)
        for rows, item in known:
            losses = [_loss(item, leader) for leader in leaders]
            if losses and min(losses) < AGREEMENT:
                chosen[rows] = int(np.argmin(losses))
        groups = [np.flatnonzero(chosen == number) for number in range(len(leaders))]
        if len(groups) == len(former) and all(map(np.array_equal, groups, former)):
            break
        joint = [
            _of_rows(data, owner, group, medium, probability) for group in groups if group.size
        ]
        former = [group for group in groups if group.size]
        former = [group for group, item in zip(former, joint, strict=True) if item]
        leaders = [item for item in joint if item is not None]
    return sorted(leaders, key=lambda item: -item.likelihood_ratio.total)


def _of_rows(
    data: PassageData,
    owner: tuple[tuple[int, ...], IntArray],
    rows: IntArray,
    medium: Medium,
    probability: float,
) -> CandidatePassage | None:
    """Fit some of the lines of a contact by themselves."""
    is_each_heard = data.bearing_deg.shape[-2] == data.frequency_hz.shape[-2]
    heard = rows if is_each_heard else rows[:0]

    def own(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[rows]

    some = replace(
        data,
        frequency_hz=data.frequency_hz[rows],
        frequency_std_hz=data.frequency_std_hz[rows],
        bearing_deg=data.bearing_deg[heard],
        bearing_std_deg=data.bearing_std_deg[heard],
        level_db=np.full_like(data.level_db, np.nan),
        line_level_db=own(data.line_level_db),
        frame_s=own(data.frame_s),
    )
    # a line alone is asked which motion it has, not what else may have happened to it
    return examine(
        some, owner[0], owner[1][rows], medium, probability, only_straight=rows.size == 1
    )


def _loss(item: CandidatePassage, other: CandidatePassage) -> float:
    own = motion_likelihood(item.blocks, item.fit, item.fit)
    return own - motion_likelihood(item.blocks, item.fit, other.fit)
