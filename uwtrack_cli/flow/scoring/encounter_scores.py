"""Score a result against truth: errors in units, percent and standard deviations.

**Method.** Encounters are matched to the true passages of their sensor with
probabilities; each pair is compared quantity by quantity. The deviation of an error is
that of the estimate together with that of the truth. Fixes are compared with the
track of the vessel that their contact was matched to, or the nearest one.

They are matched together: each encounter is of one of the passages known, or of a vessel that the
truth does not list; each passage made at most one encounter, or went unheard. The
marginal probabilities of this joint assignment come from belief propagation, which
converges always and is exact for a single encounter.

**Conventions.** A quantity that the result does not tell is left out, not counted as
an error. ``percent`` is of the true value, and nan for times and angles.

**References.** Williams and Lau (2014), IEEE Trans. Aerospace and Electronic Systems
50(4), 2942: eqs. 25-30.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.truth import TruePassage, Truth
from uwtrack_cli.flow.scoring.ais_passages import ais_passages
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors
from uwtrack_cli.flow.scoring.tolerances import Limits, Requirements

MAX_ITERATIONS = 1000
PRECISION = 1e-9
CERTAIN = 60.0
"""Logarithm of a ratio beyond which nothing changes."""


@dataclass(frozen=True, eq=False)
class Matching:
    """Probabilities per encounter (row) and passage (column), and the best pairs."""

    probability: FloatArray
    """Probability of each pair, shape (estimate, truth + 1); the last column is 'none of them'."""
    unlisted: FloatArray
    """Probability of each encounter to be of none of the passages."""
    pairs: tuple[tuple[int, int], ...]
    """Truth of each estimate in the most probable matching; -1 for none."""


def match_encounters(log_ratio: FloatArray) -> Matching:
    """Match encounters and passages one to one.

    ``log_ratio``: logarithm of how much likelier an encounter (row) is of a passage
    (column) than of an unlisted vessel while the passage went unheard; -inf if it
    cannot be.

    Examples
    --------
    >>> found = match_encounters(np.array([[3.0, -np.inf]]))
    >>> round(float(found.probability[0, 0]), 4)  # exp(3) / (1 + exp(3))
    0.9526
    """
    from scipy.optimize import linear_sum_assignment

    ratio = np.exp(np.clip(log_ratio, -CERTAIN, CERTAIN))
    ratio[~np.isfinite(log_ratio)] = 0.0
    probability = _marginals(ratio)
    gain = np.log1p(ratio)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    pairs = tuple((int(i), int(j)) for i, j in zip(rows, columns, strict=True) if ratio[i, j] > 1.0)
    unlisted = np.clip(1.0 - probability.sum(axis=1), 0.0, 1.0)
    return Matching(probability, unlisted, pairs)


def _marginals(ratio: FloatArray) -> FloatArray:
    """Return the association probabilities by belief propagation."""
    to_encounter = np.ones_like(ratio)
    # sums over all others as products: a difference would lose the small ones
    other_rows, other_columns = (1.0 - np.eye(size) for size in ratio.shape)
    for _ in range(MAX_ITERATIONS):
        to_passage = ratio / (1.0 + (ratio * to_encounter) @ other_columns)
        new = 1.0 / (1.0 + other_rows @ to_passage)
        change = np.abs(new - to_encounter).max(initial=0.0)
        to_encounter = new
        if change < PRECISION:
            break
    weighted = ratio * to_encounter
    result: FloatArray = weighted / (1.0 + weighted.sum(axis=1, keepdims=True))
    return result


SCORED = ("ok", "extrapolated", "level-only", "no-speed")
"""Statuses of encounters that claim a vessel."""

QUANTITIES = (
    "time_s", "speed_mps", "slant_range_m", "horizontal_range_m",
    "range_over_speed_s", "course_deg", "bearing_deg",
)  # fmt: skip
NO_PERCENT = frozenset({"time_s", "course_deg", "bearing_deg"})
MATCHED: dict[str, tuple[float, float]] = {
    "time_s": (5.0, 0.0), "speed_mps": (0.5, 20.0), "slant_range_m": (50.0, 2000.0),
    "course_deg": (5.0, 360.0), "bearing_deg": (5.0, 360.0),
}  # fmt: skip
"""Quantities that tell which vessel it was: least deviation, and the span over which
those of an unlisted vessel spread (0: the recording). An estimate that is a little
overconfident so still finds its vessel."""

DETECTION_PROBABILITY = 0.5
UNLISTED_VESSELS = 1.0
"""Unlisted vessels expected in a recording."""

GATE = 50.0
"""Sum of squared deviations beyond which two do not belong together."""


@dataclass(frozen=True)
class Score:
    """One quantity of one result beside its truth."""

    container: str
    """'encounters' or 'fixes'."""
    contact: int
    """Contact of the estimate."""
    sensor: str
    """Identifier of the sensor."""
    vessel: str
    """Vessel of the truth that it was matched with."""
    quantity: str
    """Name of the quantity, with its unit."""
    estimate: float | str
    """Estimated value."""
    truth: float | str
    """True value."""
    error: float = float("nan")
    """Estimate less truth, in the quantity's unit."""
    percent: float = float("nan")
    """Error in percent of the truth; nan where that means nothing."""
    std: float = float("nan")
    """Standard deviation stated with the estimate."""
    sigmas: float = float("nan")
    """Error over the standard deviation."""
    outside: str = ""
    """Which limit is passed; empty if none is."""


@dataclass(frozen=True)
class Identity:
    """Which vessel an encounter was, with the probability of each candidate."""

    contact: int
    """Contact."""
    sensor: str
    """Identifier of the sensor."""
    vessel: str | None
    """Most probable vessel; empty if it is none of those known."""
    candidates: tuple[tuple[str, float], ...]
    """Vessels with their probabilities, most probable first."""
    unlisted: float
    """Probability that it is a vessel not in the truth."""
    motion_model: str = ""
    """Its motion model; empty where the result has none."""
    motion_model_probability: float = float("nan")
    """Probability of that motion model."""
    alternative_motion_model: str = ""
    """The next motion model; empty if it has less than 5 %."""


@dataclass(frozen=True)
class EncounterScores:
    """The scores of all encounters, and what is missed or invented."""

    scores: tuple[Score, ...]
    """Scores of all quantities."""
    identities: tuple[Identity, ...]
    """Which vessel each encounter was."""
    missed: tuple[str, ...]
    """True passages without an encounter, in words."""
    false: tuple[str, ...]
    """Encounters without a true passage, in words."""


def score_encounters(
    encounters: Encounters, truth: Truth, recorded: RecordedSensors, *, within_m: float = 2000.0
) -> EncounterScores:
    """Match encounters to the passages of the truth and compare them.

    ``recorded``: sensors and recordings of the result. ``within_m``: largest range at
    which AIS vessels are expected to be detected, m.
    """
    scores: list[Score] = []
    identities: list[Identity] = []
    missed: list[str] = []
    false: list[str] = []
    for sensor in _sensors(encounters, truth, recorded):
        rows = [
            int(row)
            for row in np.flatnonzero(encounters.sensor == sensor)
            if encounters.status[row] in SCORED
        ]
        passages = _passages(truth, recorded, sensor, within_m)
        matching = match_encounters(_log_ratios(encounters, rows, passages, recorded))
        found = dict(matching.pairs)
        for k, row in enumerate(rows):
            identities.append(_identity(encounters, row, passages, matching, k))
            if k in found:
                scores += _compare(encounters, row, passages[found[k]])
            else:
                false.append(_where(encounters, row))
        missed += [
            f"{p.vessel} at sensor {sensor}, {p.values['time_s']:.1f} s"
            for j, p in enumerate(passages)
            if p.inside and j not in found.values()
        ]
    return EncounterScores(tuple(scores), tuple(identities), tuple(missed), tuple(false))


def apply_limits(scores: Sequence[Score], wanted: Requirements) -> tuple[Score, ...]:
    """Mark every score that is outside the limits of its quantity."""
    checked = []
    for score in scores:
        table = wanted.limits.get(score.container, {})
        limits = table.get(score.quantity.partition("[")[0])
        checked.append(score if limits is None else replace(score, outside=_excess(score, limits)))
    return tuple(checked)


def _excess(score: Score, limits: Limits) -> str:
    if isinstance(score.estimate, str):
        return "" if score.estimate == score.truth else "differs"
    percent = 0.0 if np.isnan(score.percent) else score.percent
    return limits.excess(score.error, percent, score.sigmas)


def _sensors(encounters: Encounters, truth: Truth, recorded: RecordedSensors) -> list[str]:
    told = {p.sensor for p in truth.passages or ()}
    there = {sensor.id for sensor in recorded.sensors}
    return sorted({*map(str, encounters.sensor), *(told & there or set()), *there})


def _passages(
    truth: Truth, recorded: RecordedSensors, sensor: str, within_m: float
) -> list[TruePassage]:
    """Return the true passages of a sensor on the clock of its recording."""
    shift_s = recorded.shift_s(sensor, truth)
    recording = recorded.recording(sensor)
    length_s = recording.duration_s if recording is not None else np.inf
    if truth.passages is None:
        span = (-shift_s, -shift_s + min(length_s, 1e7))
        if recording is None:  # a table does not say how long it listened
            ends = [float(track.time_s[-1]) for track in truth.tracks]
            span = (span[0], min(span[1], max(ends, default=span[0])))
        found = list(ais_passages(truth, recorded.sensor(sensor), span, within_m))
    else:
        found = [p for p in truth.passages if p.sensor == sensor]
    shifted = []
    for passage in found:
        values = dict(passage.values)
        for key in ("time_s", "arrival_time_s"):
            if key in values:
                values[key] += shift_s
        inside = passage.inside and 0.0 <= values["time_s"] <= length_s
        shifted.append(replace(passage, values=values, inside=inside))
    return shifted


def _log_ratios(
    encounters: Encounters,
    rows: Sequence[int],
    passages: Sequence[TruePassage],
    recorded: RecordedSensors,
) -> np.ndarray:
    ratios = np.full((len(rows), len(passages)), -np.inf)
    odds = DETECTION_PROBABILITY / (1.0 - DETECTION_PROBABILITY) / UNLISTED_VESSELS
    for i, row in enumerate(rows):
        recording = recorded.recording(str(encounters.sensor[row]))
        span_s = recording.duration_s if recording is not None else 3600.0
        for j, passage in enumerate(passages):
            ratios[i, j] = np.log(odds) + _log_likelihood(encounters, row, passage, span_s)
    return ratios


def _log_likelihood(encounters: Encounters, row: int, passage: TruePassage, span_s: float) -> float:
    """Return the log density under a passage over that of an unlisted vessel."""
    total, distance = 0.0, 0.0
    for key, (least, span) in MATCHED.items():
        value, std = _estimate(encounters, row, key)
        if not np.isfinite(value) or key not in passage.values:
            continue
        std = float(np.hypot(max(std, least), passage.std.get(key, 0.0)))
        deviations = _error(key, value, passage.values[key]) / std
        distance += deviations**2
        density = 1.0 / (std * np.sqrt(2.0 * np.pi))
        total += float(np.log(density * (span or span_s))) - 0.5 * deviations**2
    return total if distance < GATE else -np.inf


def _estimate(encounters: Encounters, row: int, key: str) -> tuple[float, float]:
    """Return a quantity of an encounter with its deviation (0 if not given)."""
    name, _, unit = key.rpartition("_")
    column = getattr(encounters, f"{name}_std_{unit}", None)
    if key == "horizontal_range_m":  # the height is known, so the errors are the same
        column = encounters.slant_range_std_m
    std = float("nan") if column is None else float(column[row])
    value = float(getattr(encounters, key)[row])
    return value, 0.0 if np.isnan(std) else std


def _error(key: str, value: float, true: float) -> float:
    error = value - true
    return (error + 180.0) % 360.0 - 180.0 if key.endswith("_deg") else error


def _compare(encounters: Encounters, row: int, passage: TruePassage) -> Iterator[Score]:
    of = ("encounters", int(encounters.contact[row]), str(encounters.sensor[row]))
    for key in QUANTITIES:
        value, std = _estimate(encounters, row, key)
        if np.isfinite(value) and key in passage.values:
            std = float(np.hypot(std, passage.std.get(key, 0.0)))
            yield _score((*of, passage.vessel), key, value, (passage.values[key], std))
    if encounters.side[row] and passage.side:
        side = str(encounters.side[row])
        yield Score(*of, passage.vessel, "side", side, passage.side)
    if not passage.rest_frequencies_hz:
        return
    true = np.array(passage.rest_frequencies_hz)
    for k in np.flatnonzero(encounters.rest_encounter == row):
        value = float(encounters.rest_frequency_hz[k])
        nearest = float(true[np.argmin(np.abs(true - value))])
        std = float(encounters.rest_frequency_std_hz[k])
        quantity = f"rest_frequency_hz[{nearest:g}]"
        yield _score((*of, passage.vessel), quantity, value, (nearest, std))


def _score(
    of: tuple[str, int, str, str], key: str, value: float, true: tuple[float, float]
) -> Score:
    error, std = _error(key, value, true[0]), true[1]
    relative = key not in NO_PERCENT and true[0] != 0.0
    return Score(
        *of, key, value, true[0], error,
        100.0 * error / true[0] if relative else float("nan"),
        std if std > 0.0 else float("nan"),
        error / std if std > 0.0 else float("nan"),
    )  # fmt: skip


def _identity(
    encounters: Encounters, row: int, passages: Sequence[TruePassage], matching: Matching, k: int
) -> Identity:
    chance: dict[str, float] = {}
    for passage, value in zip(passages, matching.probability[k], strict=True):
        chance[passage.vessel] = chance.get(passage.vessel, 0.0) + float(value)
    ranked = sorted(chance.items(), key=lambda item: -item[1])
    best = dict(matching.pairs).get(k)
    model: tuple[str, float, str] = ("", float("nan"), "")
    if encounters.motion_model is not None and encounters.alternative_motion_model is not None:
        weight = encounters.motion_model_probability
        model = (
            str(encounters.motion_model[row]),
            float("nan") if weight is None else float(weight[row]),
            str(encounters.alternative_motion_model[row]),
        )
    return Identity(
        int(encounters.contact[row]),
        str(encounters.sensor[row]),
        None if best is None else passages[best].vessel,
        tuple((name, value) for name, value in ranked if value >= 0.001),
        float(matching.unlisted[k]),
        *model,
    )


def _where(encounters: Encounters, row: int) -> str:
    return (
        f"contact {encounters.contact[row]} of sensor {encounters.sensor[row]} at "
        f"{encounters.time_s[row]:.1f} s"
    )
