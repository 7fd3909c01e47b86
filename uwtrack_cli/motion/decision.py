"""Whether a vessel passes: the probability of a candidate, and every reason against one.

**Method.** A candidate is held against every explanation of `ALTERNATIVES`. The log odds
that a vessel passes as it has it are those before anything was measured, and the sum of
all log evidences, each to a power below one: kinds of data share their errors, and no
model is right. None speaks for or against a passage by more than `MOST_NEPERS`, since the list of
explanations is never complete. Odds and powers are those that drawn recordings near the
threshold ask for: `studies/constants/passage_probability.py` draws and fits them, and says how
far probabilities are right on others.

A check that speaks against a candidate returns a `Rejection`: a code that a script can
rely on, and the sentence that people read. All of them stand in `REASONS`, so that they
can be compared, counted and replaced by the alternatives that they stand for.
"""

from collections.abc import Mapping
from math import exp, isnan
from typing import NamedTuple

from uwtrack_cli.data.encounters import MAINS, TOO_FAST
from uwtrack_cli.data.presence import CONSTANT, JOINED, MACHINERY
from uwtrack_cli.motion import alternatives
from uwtrack_cli.motion.alternatives import Alternative

UNDETERMINED = "undetermined"
SHORTER_THAN_FRAMES = "shorter-than-frames"
TOO_LITTLE = "too-little-recorded"
SMALL_TURN = "small-turn-of-sight"
FAR_OUTSIDE = "far-outside"
BEGINS_AT_CLOSEST = "begins-at-closest"
ENDS_AT_CLOSEST = "ends-at-closest"
OUTSIDE_WITHOUT_DOPPLER = "outside-without-doppler"
SENSOR_TURNED = "sensor-turned"
NOTHING_PASSES = "nothing-passes"
NOT_SIGNIFICANT = "not-significant"
DUPLICATE = "duplicate"
OTHER_RESOLUTION = "other-resolution"
MISFIT = "misfit"
HALVES = "halves-disagree"
STATIONARY_LINES = "stationary-lines"
LINE_LEVELS = "line-levels"
LONE_CHANGE = "lone-line-changes"
ENGINE_WANDER = "engine-wander"
OTHER_LEVEL = "other-level"
REST_FRAME = "rest-frame"
NO_TONES = "no-tones"
SHORT_FLANK = "short-flank"
FEW_SUB_BANDS = "few-sub-bands"
SUB_BANDS_DISAGREE = "sub-bands-disagree"
OTHER_RISE = "other-rise"
FIT_FAILED = "fit-failed"

REASONS = {
    UNDETERMINED: "the measurements do not tell time and width of a passage apart",
    SHORTER_THAN_FRAMES: (
        "the change within {width_s:.3g} s is shorter than the frames "
        "({window_s:.3g} s): use a shorter window_s"
    ),
    TOO_LITTLE: "too little of the passage is in the recording",
    SMALL_TURN: (
        "the line of sight turns by {turn_deg:.0f} degrees within the recording, "
        "and a drift looks alike below {least_deg:g}"
    ),
    FAR_OUTSIDE: "the closest approach lies far outside the recording",
    BEGINS_AT_CLOSEST: "the measurements begin at the closest approach",
    ENDS_AT_CLOSEST: "the measurements end at the closest approach",
    OUTSIDE_WITHOUT_DOPPLER: (
        "the closest approach lies outside, and no Doppler shift shows it"
    ),
    SENSOR_TURNED: (
        "the sensor turned: it left a straight track by {departure_m:.3g} m "
        "during the passage; 'uwtrack tma' follows its navigation"
    ),
    CONSTANT: "its frequencies stay: nothing passes",
    MACHINERY: "its frequencies change as those of a machine that keeps its place",
    JOINED: "a line that ends where another begins: nothing passes",
    NOTHING_PASSES: (
        "its measurements are read as {alternative}: nothing passes with a "
        "probability of {probability:.2f}"
    ),
    NOT_SIGNIFICANT: "noise alone looks like this passage too often for one to be told",
    DUPLICATE: "the passage of contact {contact}, with its time and speed",
    MISFIT: (
        "its lines leave the passage by {percent:.0f} % of the Doppler shift "
        "beyond their noise"
    ),
    HALVES: (
        "its two halves tell {first_mps:.3g} and {second_mps:.3g} m/s, "
        "{apart:.1f} deviations apart"
    ),
    STATIONARY_LINES: "{n_stationary} of its {n_lines} lines stand still",
    LINE_LEVELS: (
        "the levels of its {whose} do not rise and fall as the range would: "
        "{slope:.2f} +- {std:.2f} dB for each dB"
    ),
    LONE_CHANGE: (
        "its only line changes its frequency besides, and its levels do not show the "
        "passage: they gain {gain:.1f} nepers by it, and {least:g} are needed"
    ),
    TOO_FAST: (
        "its lines tell {speed_mps:.3g} m/s, and nothing in water is as fast; "
        "sound in air needs --sound-speed-mps 343"
    ),
    MAINS: "its lines are multiples of {mains_hz:g} Hz: mains that wander",
    ENGINE_WANDER: (
        "its lines tell {speed_mps:.2g} m/s, and engines in air wander by as "
        "much as {least_mps:.2g} m/s would shift them"
    ),
    OTHER_LEVEL: (
        "the level rises and falls otherwise: as of a passage at {time_s:.2f} s "
        "with {width_s:.2g} s of range over speed"
    ),
    REST_FRAME: (
        "in the vessel's own time its lines are no steadier than as {rival} "
        "(rest-frame evidence {evidence:.2f})"
    ),
    NO_TONES: (
        "in the vessel's own time its lines are no tones: they gain "
        "{gain:.1f} nepers over noise, and {least:g} are needed"
    ),
    SHORT_FLANK: (
        "the level alone makes a passage with {least:g} d/v recorded "
        "before and after it, got {flank:.2g}"
    ),
    FEW_SUB_BANDS: (
        "{count} parts of the band rise by themselves, and the level "
        "alone makes a passage with {least}"
    ),
    SUB_BANDS_DISAGREE: (
        "the parts of the band tell different times or widths (chance "
        "{probability:.1g})"
    ),
    OTHER_RISE: "its levels rise and fall more as {rival} than as a passage",
    OTHER_RESOLUTION: "frames of another length show another passage, {better}",
    FIT_FAILED: "its fit failed ({kind}: {error})",
}
"""Sentence of every code of a rejection, with the names of what it states."""


Evidence = Mapping[str, float]
"""What the checks of a candidate measured, by name."""


class Rejection(NamedTuple):
    """What speaks against a passage."""

    code: str
    """A key of `REASONS`."""
    sentence: str
    """The same for people, with what was measured."""


def reject(code: str, **values: object) -> Rejection:
    """Return the rejection of a code, whose sentence states some values.

    Examples
    --------
    >>> reject("stationary-lines", n_stationary=2, n_lines=3).sentence
    '2 of its 3 lines stand still'
    """
    return Rejection(code, REASONS[code].format(**values))


LOG_ODDS_OF_LINES, LOG_ODDS_OF_LEVELS, LOG_ODDS_IN_AIR = -1.27, -0.71, -0.18
"""Log odds of a candidate before anything was measured: with lines, by level or bearing
alone, and what is added in air."""

MOST_NEPERS = 8.0
"""Log evidence beyond which an explanation is as good as refused, or proved."""

ALTERNATIVES = (
    Alternative(NOTHING_PASSES, alternatives.stationary_bearing, 0.54),
    Alternative(LINE_LEVELS, alternatives.stationary_levels, 0.20),
    Alternative(STATIONARY_LINES, alternatives.stationary_lines, 0.91),
    Alternative(HALVES, alternatives.halves, 0.10),
    Alternative(REST_FRAME, alternatives.other_time, 0.23),
    Alternative(TOO_FAST, alternatives.unusual_speed, 1.00),
    Alternative(OTHER_RISE, alternatives.other_rise, 0.18),
    Alternative(TOO_LITTLE, alternatives.undetermined, 1.05),
    Alternative(SMALL_TURN, alternatives.small_turn, 0.16),
    Alternative(SHORTER_THAN_FRAMES, alternatives.short_frames, 0.16),
)
"""Every explanation in which no vessel passes as the row has it."""


class PassageDecision(NamedTuple):
    """How sure it is that a vessel passes."""

    probability: float
    """That a vessel passes as the candidate has it."""
    alternative: str
    """Code of the explanation that speaks most against it; empty if none does."""
    alternative_probability: float
    """Of that explanation."""
    nepers: tuple[tuple[str, float], ...]
    """Log evidence over every explanation, as it is weighed, by code."""


UNDECIDED = PassageDecision(float("nan"), "", float("nan"), ())
"""Nothing was asked."""


def decide(measured: Evidence) -> PassageDecision:
    """Return the probability that a vessel passes, from all that was measured.

    Parameters
    ----------
    measured
        What the checks of a candidate measured, by name.
    """
    odds = LOG_ODDS_OF_LINES if measured["has_lines"] else LOG_ODDS_OF_LEVELS
    odds += LOG_ODDS_IN_AIR * measured["is_air"]
    nepers = []
    for one in ALTERNATIVES:
        value = one.log_evidence(measured)
        if not isnan(value):
            held = max(-MOST_NEPERS, min(MOST_NEPERS, value))
            nepers.append((one.code, one.exponent * held))
    odds += sum(value for _, value in nepers)
    probability = 1.0 / (1.0 + exp(-odds))
    against = [(value, code) for code, value in nepers if value < 0.0]
    if not against:
        return PassageDecision(probability, "", 0.0, tuple(nepers))
    least, code = min(against)
    share = exp(-least) / sum(exp(-value) for value, _ in against)
    return PassageDecision(
        probability, code, (1.0 - probability) * share, tuple(nepers)
    )
