"""Whether a vessel passes: the probability of a candidate, and the reason against one.

**Method.** A candidate is held against every explanation of `ALTERNATIVES`. The log odds
that a vessel passes as it has it are those before anything was measured, and the sum of
all log evidences, each to a power of its own: kinds of data share their errors, and no
model is right. None speaks for or against a passage by more than `MOST_NEPERS`, since the list of
explanations is never complete. Odds and powers are those that drawn recordings near the
threshold ask for: `studies/constants/passage_probability.py` draws and fits them, and says how
far probabilities are right on others.

Where no vessel rather passes, the explanation that has gained most is the reason, and where
all have gained less than what nobody thought of has to begin with, it is none of them: a
code that a script can rely on, and the sentence that people read. All stand in `REASONS`.
"""

from collections.abc import Mapping
from math import exp, expm1, isnan
from typing import NamedTuple

from uwtrack_cli.data.encounters import MAINS, TOO_FAST
from uwtrack_cli.data.presence import CONSTANT, JOINED, MACHINERY
from uwtrack_cli.motion import alternatives
from uwtrack_cli.motion.alternatives import Alternative

TOO_LITTLE = "too-little-recorded"
SENSOR_TURNED = "sensor-turned"
NOTHING_PASSES = "nothing-passes"
NOT_SIGNIFICANT = "not-significant"
DUPLICATE = "duplicate"
OTHER_RESOLUTION = "other-resolution"
STATIONARY_LINES = "stationary-lines"
LINE_LEVELS = "line-levels"
LEVEL = "level"
UNUSUAL_SPEED = "unusual-speed"
UNUSUAL_RANGE = "unusual-range"
OTHER_RISE = "other-rise"
PART_OF_ANOTHER = "part-of-another"
FIT_FAILED = "fit-failed"
FRINGES = "fringes"

REASONS = {
    TOO_LITTLE: "too little of the passage is in the recording",
    SENSOR_TURNED: (
        "the sensor turned: it left a straight track by {departure_m:.3g} m "
        "during the passage; 'uwtrack tma' follows its navigation"
    ),
    CONSTANT: "its frequencies stay: nothing passes",
    MACHINERY: "its frequencies change as those of a machine that keeps its place",
    JOINED: "a line that ends where another begins: nothing passes",
    NOTHING_PASSES: "its bearings stay or drift: nothing passes",
    NOT_SIGNIFICANT: "what was measured speaks too little for a passage",
    DUPLICATE: "the passage of contact {contact}, with its time and speed",
    STATIONARY_LINES: "{stationary_share:.0%} of its lines stand still",
    LINE_LEVELS: (
        "the levels of its lines do not rise and fall as the range would (by "
        "{line_level:.1f} nepers)"
    ),
    LEVEL: "the level does not rise and fall as the range would",
    TOO_FAST: (
        "its lines have {speed_mps:.3g} m/s, and little in water is as fast; "
        "sound in air needs --sound-speed-mps 343"
    ),
    UNUSUAL_SPEED: "a speed of {speed_mps:.3g} m/s is unusual",
    UNUSUAL_RANGE: "a range of {range_m:.3g} m at the closest approach is unusual",
    MAINS: "its lines are multiples of {mains_hz:g} Hz: mains that wander",
    OTHER_RISE: "its levels rise and fall more as rain, a squall or a machine would",
    PART_OF_ANOTHER: "it rises within {apart_s:.3g} s of a larger rise: rather a part of it",
    OTHER_RESOLUTION: "frames of another length show another passage, {better}",
    FRINGES: "its spectrum changes more as that of a source that stays, or passes otherwise",
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
    >>> reject("stationary-lines", stationary_share=0.5, n_lines=4).sentence
    '50% of its lines stand still'
    """
    return Rejection(code, REASONS[code].format(**values))


LOG_ODDS = {
    "lines in water": -0.53, "levels in water": 0.02,
    "lines in air": -1.1, "levels in air": 3.34, "as given": 2.0,
}  # fmt: skip
"""Log odds of a candidate before anything was measured, by what shows it: lines, or the
level or bearing alone. Chosen for what is taken as it is given: tables, whose measurements
are somebody's of a contact, and levels without sub-bands."""

MOST_NEPERS = 8.0
"""Log evidence beyond which an explanation is as good as refused, or proved."""

ALTERNATIVES = (
    Alternative(NOTHING_PASSES, alternatives.stationary_bearing, 0.35),
    Alternative(LINE_LEVELS, alternatives.stationary_levels, 0.56),
    Alternative(LEVEL, alternatives.stationary_level, 0.53),
    Alternative(STATIONARY_LINES, alternatives.stationary_lines, 0.50),
    Alternative(LEVEL, alternatives.engine_level, 0.60),
    Alternative(MACHINERY, alternatives.stationary_source, 0.11),
    Alternative(MACHINERY, alternatives.engine, 0.53),
    Alternative(TOO_FAST, alternatives.too_fast, 1.00),
    Alternative(UNUSUAL_SPEED, alternatives.unusual_speed, 1.00),
    Alternative(UNUSUAL_RANGE, alternatives.unusual_range, 0.27),
    Alternative(MAINS, alternatives.mains, 0.20),
    Alternative(OTHER_RISE, alternatives.other_rise, 0.31),
    Alternative(PART_OF_ANOTHER, alternatives.part_of_another, 1.00),
    Alternative(TOO_LITTLE, alternatives.undetermined, 1.11),
)
"""Every explanation in which no vessel passes as the row has it."""


class PassageDecision(NamedTuple):
    """How sure it is that a vessel passes."""

    probability: float
    """That a vessel passes as the candidate has it."""
    alternative: str
    """Code of the explanation that is likeliest otherwise; `NOT_SIGNIFICANT` for none."""
    alternative_probability: float
    """Of that explanation."""
    nepers: tuple[tuple[str, float], ...]
    """Log evidence over every explanation, as it is weighed, by code."""


LEAST_PROBABILITY = 0.5
"""Probability above which a vessel rather passes than not: the one threshold."""

UNDECIDED = PassageDecision(float("nan"), "", float("nan"), ())
"""Nothing was asked."""


def kind_of(measured: Evidence) -> str:
    """Return what shows a candidate, a key of `LOG_ODDS`."""
    if measured.get("as_given"):
        return "as given"
    shown = "lines" if measured["has_lines"] else "levels"
    return f"{shown} in {'air' if measured['is_air'] else 'water'}"


def decide(measured: Evidence) -> PassageDecision:
    """Return the probability that a vessel passes, from all that was measured.

    Parameters
    ----------
    measured
        What the checks of a candidate measured, by name.
    """
    odds = LOG_ODDS[kind_of(measured)]
    nepers = []
    for one in ALTERNATIVES:
        value = one.log_evidence(measured)
        if not isnan(value):
            held = max(-MOST_NEPERS, min(MOST_NEPERS, value))
            nepers.append((one.code, one.exponent * held))
    odds += sum(value for _, value in nepers)
    probability = 1.0 / (1.0 + exp(-odds))
    shares = {code: expm1(max(-value, 0.0)) for code, value in nepers}
    # the list is never complete: what nobody thought of has a share that is fixed
    shares[NOT_SIGNIFICANT] = 1.0
    code = max(shares, key=lambda one: (shares[one], one))
    share = shares[code] / sum(shares.values())
    return PassageDecision(probability, code, (1.0 - probability) * share, tuple(nepers))


def weigh_more(decision: PassageDecision, code: str, nepers: float) -> PassageDecision:
    """Return a decision with one more log evidence, of an explanation of some code."""
    held = max(-MOST_NEPERS, min(MOST_NEPERS, nepers))
    before = min(decision.probability, 1.0 - 1e-12)
    odds = before / (1.0 - before) * exp(held)
    probability = odds / (1.0 + odds)
    other = decision._replace(probability=probability, nepers=(*decision.nepers, (code, held)))
    if held < 0.0 and probability < before:
        share = 1.0 - exp(held)
        return other._replace(alternative=code, alternative_probability=(1.0 - probability) * share)
    share = (1.0 - probability) / (1.0 - before)
    return other._replace(alternative_probability=decision.alternative_probability * share)


def why_not(decision: PassageDecision, measured: Evidence) -> Rejection:
    """Return the explanation that wins where no vessel passes.

    Parameters
    ----------
    decision
        What was decided.
    measured
        What it was decided from, which the sentence states.
    """
    return reject(decision.alternative, **measured)
