"""The answers of target motion analysis as one table, with its observability report."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.acoustics.geodesy import to_latitude_longitude
from uwtrack_cli.constants import KNOT_MPS, NANOSECONDS
from uwtrack_cli.data.base import FloatArray, flatten, reason_columns
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.contact import ContactAnswer
from uwtrack_cli.motion.target_motion.contact_pairing import Pairings
from uwtrack_cli.motion.target_motion.cross_fix import grid_state
from uwtrack_cli.motion.target_motion.error_budget import BOUNCE_DEPTHS
from uwtrack_cli.motion.target_motion.model import to_motion
from uwtrack_cli.motion.target_motion.modes import Interval, ModeAnswer, TmaOptions
from uwtrack_cli.motion.target_motion.problem import MotionPrior

LARGEST_LOG_RANGE_STD = 1.0
"""Deviation of ln R above which the range is not given."""

MOTION = ("range_m", "bearing_deg", "speed_mps", "course_deg")
NOW = tuple(f"now_{name}" for name in MOTION)

PAIRED = ("sensor_contacts", "pairing_probability")
"""Columns of what was joined across sensors."""

WHOLE_CIRCLE_DEG = 359.9
"""Width from which an interval of the course is the whole circle."""

LARGEST_SPEED_STD_MPS = 5.0
LARGEST_COURSE_STD_RAD = np.radians(60.0)


OWN_NOISE = "own ship: the sound comes from where the ship is that tows the array, without Doppler"
"""Why nothing is stated of a contact that is the own ship."""


def reasons_of(mode: ModeAnswer, answer: ContactAnswer) -> dict[str, str]:
    """Return why a value is not observable, by column."""
    observable = mode.observability.observable.copy()
    # what scales or turns freely drags speed and course along, even where their
    # slopes happen to vanish
    observable[2:4] &= observable[0] & observable[1]
    motion = to_motion(mode.q)
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    spans = mode.intervals
    cause = _cause(mode, answer)
    reasons: dict[str, str] = {}
    if not observable[0]:
        reasons["range_m"] = cause
    elif spans["range"].open_high or std[0] > LARGEST_LOG_RANGE_STD * motion[0]:
        low = "" if spans["range"].open_low else _at_least(np.exp(spans["range"].low))
        reasons["range_m"] = f"the data do not bound the range yet{low}; {cause}"
    if "range_m" in reasons and mode.at_limit_m is not None and observable[0]:
        reasons["range_m"] = (
            f"the best fit lies on the limit of the search, {mode.at_limit_m:.0f} m: "
            f"widen range_limits_m, or the data do not bound the range"
        )
    if not observable[1]:
        reasons["bearing_deg"] = "no bearings: only the shape of the pass is observable"
    reasons |= {
        key: cause
        for key, hidden in (
            ("speed_mps", not observable[2] or std[2] > LARGEST_SPEED_STD_MPS),
            ("course_deg", not observable[3] or std[3] > LARGEST_COURSE_STD_RAD),
            ("rest_frequencies_hz", not observable[mode.q.size :].all()),
        )
        if hidden
    }
    if answer.is_own_noise:
        reasons |= dict.fromkeys(("range_m", "speed_mps", "course_deg"), OWN_NOISE)
    now = dict(zip(NOW, MOTION, strict=True))
    return reasons | {key: reasons[of] for key, of in now.items() if of in reasons}


def _at_least(range_m: float) -> str:
    return f" (at least {range_m:.0f} m)" if range_m >= 1.0 else ""


def _cause(mode: ModeAnswer, answer: ContactAnswer) -> str:
    """Name what is missing for the range to be observable."""
    weakest = mode.observability.weakest
    n_parameters = mode.observability.n_parameters
    if answer.n_values < n_parameters:
        return f"{answer.n_values} values cannot fix {n_parameters} parameters"
    if _has_no_bearing(answer):
        return f"frequencies alone do not fix the motion: {weakest} fits alike"
    if mode.observability.rank < n_parameters and not answer.manoeuvring:
        if answer.data.line_id.size == 0:
            missing = "there are no frequency lines and own ship does not manoeuvre"
        else:
            missing = "the bearing does not change and own ship does not manoeuvre"
        return f"{missing}: {weakest} fits alike"
    return f"too little change of bearing and frequency so far: {weakest} is one sigma"


def ellipse_agrees(mode: ModeAnswer) -> bool:
    """Return whether deviations say what the likelihood says: each, and all together."""
    if not mode.ellipse_holds:
        return False
    motion = to_motion(mode.q)
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    centres = {"range": np.log(motion[0]), "speed": motion[2], "course": motion[3]}
    widths = {"range": std[0] / motion[0], "speed": std[2], "course": std[3]}
    for name, span in mode.intervals.items():
        if span.is_open:
            return False
        centre = centres[name]
        if name == "course":  # the interval counts on from where it began
            middle = 0.5 * (span.low + span.high)
            centre = middle + float(wrap_rad(centre - middle))
        half = max(span.high - centre, centre - span.low)
        other = min(span.high - centre, centre - span.low)
        if half > 1.25 * 1.96 * widths[name] or other < 0.75 * 1.96 * widths[name]:
            return False
    return True


def _has_no_bearing(answer: ContactAnswer) -> bool:
    """Return whether frequencies alone were measured.

    They tell a motion from its mirror image by the small differences that own ship's
    alterations make, and errors of own navigation make as large ones.
    """
    return bool(np.isnan(answer.data.bearing_deg).all())


def report_of(
    mode: ModeAnswer, answer: ContactAnswer, reasons: dict[str, str], *, manoeuvre_needed: bool
) -> str:
    """Describe in a few sentences what the data determine."""
    seen = mode.observability
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    motion = to_motion(mode.q)
    known = [
        f"{name} to {value:.2g} {unit}"
        for name, key, value, unit in (
            ("range", "range_m", 100.0 * std[0] / motion[0], "%"),
            ("speed", "speed_mps", std[2] / KNOT_MPS, "kn"),
            ("course", "course_deg", np.degrees(std[3]), "deg"),
        )
        if key not in reasons
    ]
    parts = [f"{seen.rank} of {seen.n_parameters} parameters are observable"]
    if np.isfinite(seen.condition):
        parts[0] += f" (condition {seen.condition:.3g})"
    if "range_m" in reasons:
        parts.append(f"range is not observable: {reasons['range_m']}")
    if known:
        parts.append(f"known (one sigma): {', '.join(known)}")
    parts.append(f"weakest direction: {seen.weakest}")
    if manoeuvre_needed:
        parts.append("a manoeuvre of own ship is needed")
    elif source := _source_of_range(answer):
        parts.append(f"own ship does not manoeuvre: the range rests on {source}")
    parts.append(
        f"chance of range within 10 %, speed within 3 kn and course within 7 deg: "
        f"{seen.probability:.3f}"
    )
    parts += _words_of_legs(mode, answer)
    parts += _complaints(mode, answer) + _shares(answer)
    if "range_m" in reasons:
        return "; ".join(parts) + "."
    return "; ".join(parts + _sound_speed_effect(mode) + _doubts(mode, answer)) + "."


def _source_of_range(answer: ContactAnswer) -> str:
    """Return what tells the range where own ship goes straight on; empty: nothing."""
    if answer.manoeuvring:
        return ""
    if answer.data.bounce_delay_s is not None:
        return "the bounce"
    return "Doppler" if answer.data.line_id.size else ""


def _doubts(mode: ModeAnswer, answer: ContactAnswer) -> list[str]:
    """Say why the deviations are not to be trusted, if they are not."""
    if _has_no_bearing(answer):
        return ["frequencies alone hardly tell a side from the other: a bearing would"]
    if not ellipse_agrees(mode):
        return ["the standard deviations are misleading here: use the intervals"]
    return []


LEAST_EFFECT_PERCENT = 0.01
"""Change of the range by a sound speed wrong by 1 % below which nothing is said of it."""


def _sound_speed_effect(mode: ModeAnswer) -> list[str]:
    """Say what the sound speed does to the range; nothing where bearings alone cross."""
    percent = mode.range_per_sound_speed
    if not abs(percent) >= LEAST_EFFECT_PERCENT:
        return []
    return [f"a sound speed wrong by 1 % moves the range by {percent:+.2g} %"]


def _shares(answer: ContactAnswer) -> list[str]:
    """Say how many of the bearings are the contact's, if not all."""
    if answer.probability is None:
        return []
    heard = answer.probability[~np.isnan(answer.probability)]
    words = f"{heard.sum():.0f} of {heard.size} bearings are of this contact"
    if answer.n_sources > 1:
        words += f", of {answer.n_sources} sources in these rows"
    return [words]


def _complaints(mode: ModeAnswer, answer: ContactAnswer) -> list[str]:
    """Say when the residuals are larger than the deviations allow."""
    freedom = answer.n_values - mode.observability.n_parameters
    if freedom < 1:
        return []
    ratio = mode.value / freedom
    if ratio < 1.0 + 5.0 * np.sqrt(2.0 / freedom):
        return []
    words = (
        f"the misfit is {ratio:.3g} times what the standard deviations explain: "
        f"outliers (try a robust loss), a manoeuvre of the target, or standard "
        f"deviations that are too small"
    )
    return [words]


DEGREES = np.array([1.0, np.degrees(1.0), 1.0, np.degrees(1.0)])

STATEMENT = (
    "Range and speed rest on the assumed sound speed ({speed:g} m/s) and on one-way "
    "Doppler. Between straight tracks neither leaves a trace in the residuals: 1 % of "
    "sound speed is then 1 % of range, and frequencies that carry the two-way shift of "
    "an echo double the range."
)
NAVIGATION_STATEMENT = (
    "Own navigation is assumed to be accurate to {position:g} m and {velocity:g} m/s, "
    "because its accuracy is not given: standard deviations are too large if it is "
    "better, and too small if it is worse (--nuisances-position-std-m, "
    "--nuisances-velocity-std-mps, or navigation_position_std_m and "
    "navigation_velocity_std_mps of the sensor file; 0 is exact)."
)
BOUNCE_STATEMENT = (
    "Delays of a reflected path count as ranges ({}): they take the reflecting plane to be "
    "level and rays to be straight, and a depth that is wrong by more than was told leaves "
    "no trace."
)
SENSORS_STATEMENT = (
    "Positions depend on those of the sensors and on their compasses: an error of all "
    "compasses alike turns the motion about the sensors, and leaves little trace."
)


def motions_table(
    answers: list[ContactAnswer], options: TmaOptions, pairings: Pairings | None = None
) -> Motions:
    """Gather the answers of all contacts, and which contacts of sensors were joined."""
    rows = [
        _row(answer, mode, number)
        for answer in answers
        for number, mode in enumerate(answer.modes, start=1)
    ]
    reasons = [row["reasons"] for row in rows]
    columns = {
        name: _column(name, [row[name] for row in rows])
        for name, spec in Motions.columns().items()
        if spec.axes[0] == "motion" and name not in PAIRED
    }
    if pairings is not None:
        columns |= pairings.columns_of(columns["contact"]) | pairings.table()
    return Motions(
        **columns,
        **_rest_table(answers, reasons),
        **reason_columns("reason_motion", reasons),
        **_update_table(answers),
        **_nuisance_table(answers, options),
        **_row_table(answers),
        **_offset_table(answers),
        **_leg_table(answers),
        solver=options.solver,
        loss=options.misfit.loss,
        doppler=options.model.doppler,
        propagation="delayed" if options.delayed else "instant",
        sound_speed_mps=options.sound_speed_mps,
        statement=_statement(answers, options, pairings),
    )


def _statement(answers: list[ContactAnswer], options: TmaOptions, pairings: Pairings | None) -> str:
    """Say what no residual reveals: bearings that cross need no sound speed."""
    joined = [] if pairings is None else [pairings.statement]
    crossing = [
        answer.data.platforms is not None and not answer.data.line_id.size for answer in answers
    ]
    if answers and all(crossing):
        return " ".join([*joined, SENSORS_STATEMENT, *_expected(options.prior)])
    words = [*joined, STATEMENT.format(speed=options.sound_speed_mps)]
    own = options.nuisances
    words += _expected(options.prior)
    if options.bounce is not None:
        words.append(BOUNCE_STATEMENT.format(options.bounce.words))
    if own.is_usual_navigation and not any(crossing):
        words.append(
            NAVIGATION_STATEMENT.format(position=own.own_position_m, velocity=own.own_velocity_mps)
        )
    return " ".join(words)


def _expected(prior: MotionPrior) -> list[str]:
    """Say what an analyst's limits brought into the result."""
    parts = []
    if prior.log_range is not None:
        middle, factor = np.exp([prior.log_range.mean, prior.log_range.std])
        parts.append(f"a range of {middle:.0f} m within a factor of {factor:.2g}")
    if prior.speed_mps is not None:
        told = _told(prior.speed_mps.mean, prior.speed_mps.std, "m/s", 1)
        parts.append(f"a speed of {told} on every leg")
    if prior.course_rad is not None:
        mean, std = np.degrees([prior.course_rad.mean, prior.course_rad.std])
        parts.append(f"a course of {_told(mean % 360.0, std, 'degrees', 0)} at first")
    if not parts:
        return []
    return [f"The limits that were given count as measurements: {', '.join(parts)}."]


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    spec = Motions.columns()[name]
    if not values:
        shape = (0, *(4 for _ in spec.axes[1:]))
        return np.empty(shape, dtype="U1" if spec.dtype.kind == "U" else spec.dtype)
    return np.array(values, dtype=None if spec.dtype.kind == "U" else spec.dtype)


def _row(answer: ContactAnswer, mode: ModeAnswer, number: int) -> dict[str, Any]:
    data = answer.data
    covariance = mode.covariance[:4, :4]
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    reasons = reasons_of(mode, answer)
    spans = mode.intervals
    first = float(data.time_s[0])
    values = {
        "contact": data.contact,
        "mode": number,
        "weight": mode.weight,
        "time_s": first,
        "time_utc_ns": _utc(data.start_utc_ns, first),
        **_with_std(to_motion(mode.q)[:4], std),
        "range_low_m": np.nan if spans["range"].open_low else np.exp(spans["range"].low),
        "range_high_m": (np.nan if spans["range"].open_high else np.exp(spans["range"].high)),
        "speed_low_mps": spans["speed"].low,
        "speed_high_mps": np.nan if spans["speed"].open_high else spans["speed"].high,
        **course_ends(spans["course"]),
        "covariance": covariance * np.outer(DEGREES, DEGREES),
        "now_time_s": float(data.time_s[-1]),
        **_with_std(mode.now, mode.now_std, "now_"),
        "ellipse_trusted": ellipse_agrees(mode) and not _has_no_bearing(answer),
        "misfit": mode.value,
        "n_values": answer.n_values,
        "reasons": dict(sorted(reasons.items())),
        **_absolute(answer, mode, reasons),
        **_observability(answer, mode, reasons),
    }
    _blank(values, reasons)
    return values


def course_ends(span: Interval) -> dict[str, float]:
    """Return an interval in rad clockwise, in degrees; the whole circle is 0 to 360.

    Examples
    --------
    >>> course_ends(Interval(-3.5, 3.5, True, True))
    {'course_low_deg': 0.0, 'course_high_deg': 360.0}
    """
    low, high = np.degrees(span.low), np.degrees(span.high)
    if high - low >= WHOLE_CIRCLE_DEG:
        return {"course_low_deg": 0.0, "course_high_deg": 360.0}
    return {"course_low_deg": low % 360.0, "course_high_deg": high % 360.0}


def _std_key(name: str) -> str:
    """Return the name of the deviation of a column."""
    stem, unit = name.rsplit("_", 1)
    return f"{stem}_std_{unit}"


def _with_std(state: FloatArray, std: FloatArray, when: str = "") -> dict[str, Any]:
    """Return the columns of motions in SI, shape (..., 4), with their deviations."""
    found: dict[str, Any] = {}
    columns = ((one * DEGREES).T for one in (state, std))
    for key, value, spread in zip(MOTION, *columns, strict=True):
        found |= {f"{when}{key}": value, _std_key(f"{when}{key}"): spread}
    return found


def _utc(start_utc_ns: int | None, time_s: float) -> int:
    if start_utc_ns is None:
        return -1
    return start_utc_ns + int(np.rint(time_s * NANOSECONDS))


def _observability(
    answer: ContactAnswer, mode: ModeAnswer, reasons: dict[str, str]
) -> dict[str, Any]:
    seen = mode.observability
    observable = "range_m" not in reasons
    is_altered = len(mode.legs) > 1
    needed = not (observable or answer.manoeuvring or is_altered)
    return {
        "motion_model": "manoeuvre" if is_altered else "straight",
        "manoeuvre_time_s": (
            float(answer.data.time_s[0]) + mode.legs[1].altered_s if is_altered else np.nan
        ),
        "manoeuvre_gain": answer.legs.gain,
        "manoeuvre_probability": answer.legs.probability,
        "observable": observable,
        "rank": seen.rank,
        "n_parameters": seen.n_parameters,
        "condition_number": seen.condition if np.isfinite(seen.condition) else np.nan,
        "criterion_probability": seen.probability,
        "range_per_sound_speed": mode.range_per_sound_speed,
        "manoeuvre_needed": needed,
        "weakest_direction": seen.weakest,
        "report": report_of(mode, answer, reasons, manoeuvre_needed=needed),
    }


LEAST_WORTH_SAYING = 0.05
"""Probability of an alteration from which a report of a straight motion speaks of it."""


def _words_of_legs(mode: ModeAnswer, answer: ContactAnswer) -> list[str]:
    """Say when the target altered, or that it may have."""
    first = float(answer.data.time_s[0])
    chance = answer.legs.probability
    if len(mode.legs) == 1:
        if chance < LEAST_WORTH_SAYING:
            return []
        doubt = (
            f"that the target altered its velocity has a probability of {chance:.2g}, "
            f"and the standard deviations allow for it"
        )
        return [doubt]
    words = [
        f"the target altered its velocity at {first + leg.altered_s:.0f} +- "
        f"{leg.altered_std_s:.0f} s, and then has "
        f"{_told(leg.state[2], leg.std[2], 'm/s', 2)} and a course of "
        f"{_told(np.degrees(leg.state[3]), np.degrees(leg.std[3]), 'degrees', 1)}"
        for leg in mode.legs[1:]
    ]
    words[0] = f"{len(mode.legs)} legs: {words[0]}"
    return words


def _told(value: float, std: float, unit: str, decimals: int) -> str:
    return f"{value:.{decimals}f} +- {std:.{decimals}f} {unit}"


def _blank(values: dict[str, Any], reasons: dict[str, str]) -> None:
    """Take out what is not observable, with everything that depends on it."""
    covariance = np.array(values["covariance"])
    for key in reasons:
        if key not in values:
            continue
        values[key] = values[_std_key(key)] = np.nan
        if key in MOTION:
            place = MOTION.index(key)
            covariance[place, :] = covariance[:, place] = np.nan
    if "course_deg" in reasons:
        values["course_low_deg"] = values["course_high_deg"] = np.nan
    values["covariance"] = covariance


def _absolute(answer: ContactAnswer, mode: ModeAnswer, reasons: dict[str, str]) -> dict[str, Any]:
    """Return the place at the first measurement where sensors give one."""
    names = ("east_m", "north_m", "latitude", "longitude")
    values: dict[str, Any] = {**dict.fromkeys(names, np.nan), "reference": ""}
    platforms = answer.data.platforms
    if platforms is None:
        return values
    values["reference"] = platforms.name[int(platforms.sensor[0])]
    if "range_m" in reasons or "bearing_deg" in reasons:
        return values
    state, _ = grid_state(mode, platforms)
    values["east_m"], values["north_m"] = map(float, state[:2])
    if platforms.origin is not None:
        place = to_latitude_longitude(state[:1], state[1:2], platforms.origin)
        values["latitude"], values["longitude"] = (float(one[0]) for one in place)
    return values


def _row_table(answers: list[ContactAnswer]) -> dict[str, NDArray[Any]]:
    """Return every bearing of a table with its probability and residual."""
    parts = []
    for answer in answers:
        rows = answer.data.table_row
        if rows is None:
            continue
        heard = np.flatnonzero(~np.isnan(answer.data.bearing_deg).all(axis=0))
        own = np.ones(rows.size) if answer.probability is None else answer.probability
        told = np.stack([rows + 1.0, answer.data.time_s, own, answer.modes[0].bearing_residual_deg])
        parts.append(np.insert(told[:, heard], 0, answer.data.contact, axis=0))
    table = np.concatenate([np.empty((5, 0)), *parts], axis=1)
    return {
        "row_contact": table[0].astype(np.int64),
        "row_number": table[1].astype(np.int64),
        "row_time_s": table[2],
        "row_probability": table[3],
        "row_residual_deg": table[4],
    }


def _offset_table(answers: list[ContactAnswer]) -> dict[str, NDArray[Any]]:
    """Return the offset of every sensor in every mode."""
    owner, rows = flatten(
        ()
        if answer.data.platforms is None
        else zip(answer.data.platforms.name, mode.offset_deg, strict=True)
        for answer in answers
        for mode in answer.modes
    )
    return {
        "offset_motion": owner,
        "offset_sensor": np.array([name for name, _ in rows], np.str_),
        "offset_deg": np.array([value for _, value in rows], float),
    }


def _leg_table(answers: list[ContactAnswer]) -> dict[str, NDArray[Any]]:
    """Return every leg of every mode."""
    owner, rows = flatten(
        enumerate(_leg_rows(answer, mode), start=1) for answer in answers for mode in answer.modes
    )
    table: dict[str, NDArray[Any]] = {
        "leg_motion": owner,
        "leg_number": np.array([number for number, _ in rows], np.int64),
    }
    for name in LEG:
        table[f"leg_{name}"] = np.array([one[name] for _, one in rows], np.float64)
    return table


LEG = (
    "start_s", "end_s", "range_m", "range_std_m", "bearing_deg", "bearing_std_deg",
    "speed_mps", "speed_std_mps", "course_deg", "course_std_deg", "alteration_time_s",
    "alteration_time_std_s",
)  # fmt: skip
"""What is told of every leg."""


def _leg_rows(answer: ContactAnswer, mode: ModeAnswer) -> list[dict[str, float]]:
    first, found = float(answer.data.time_s[0]), []
    observable = mode.observability.observable
    for leg in mode.legs:
        values = {
            "start_s": first + leg.begin_s,
            "end_s": first + leg.end_s,
            **_with_std(leg.state, leg.std),
            "alteration_time_s": first + leg.altered_s,
            "alteration_time_std_s": leg.altered_std_s,
        }
        spread = leg.std / [
            LARGEST_LOG_RANGE_STD * leg.state[0], np.inf, LARGEST_SPEED_STD_MPS,
            LARGEST_COURSE_STD_RAD,
        ]  # fmt: skip
        hidden = (spread > 1.0) | ~observable[:4]
        for key, is_hidden in zip(MOTION, hidden, strict=True):
            if is_hidden:
                values[key] = values[_std_key(key)] = np.nan
        found.append(values)
    return found


def _rest_table(
    answers: list[ContactAnswer], reasons: list[dict[str, str]]
) -> dict[str, NDArray[Any]]:
    rows: list[tuple[int, int, float, float]] = []
    number = 0
    for answer in answers:
        for mode in answer.modes:
            lines = slice(mode.q.size, mode.q.size + answer.data.line_id.size)
            std = np.sqrt(np.maximum(np.diagonal(mode.covariance)[lines], 0.0))
            hidden = "rest_frequencies_hz" in reasons[number]
            rows += [
                (number, int(line), np.nan if hidden else float(f), float(s))
                for line, f, s in zip(
                    answer.data.line_id, mode.rest_hz[: std.size], std, strict=True
                )
            ]
            number += 1
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    table[np.isnan(table[:, 2]), 3] = np.nan
    return {
        "rest_motion": table[:, 0].astype(np.int64),
        "rest_line_id": table[:, 1].astype(np.int64),
        "rest_frequency_hz": table[:, 2],
        "rest_frequency_std_hz": table[:, 3],
    }


def _nuisance_table(answers: list[ContactAnswer], options: TmaOptions) -> dict[str, NDArray[Any]]:
    deviations = options.nuisances.values()
    deviations["sensor_position_m"] = max(
        (_sensor_position_std(answer) for answer in answers), default=np.nan
    )
    if options.bounce is not None:
        deviations[BOUNCE_DEPTHS] = 100.0 * options.bounce.relative_std
    means = {"sound_speed_mps": options.sound_speed_mps}
    owner, rows = flatten(
        mode.nuisance_shares.items() for answer in answers for mode in answer.modes
    )
    names = [name for name, _ in rows]
    return {
        "nuisance_motion": owner,
        "nuisance_name": np.array(names, np.str_),
        "nuisance_value": np.array([means.get(name, 0.0) for name in names]),
        "nuisance_std": np.array([deviations[name] for name in names]),
        "nuisance_share": np.array([share for _, share in rows], float),
    }


def _sensor_position_std(answer: ContactAnswer) -> float:
    """Return the largest deviation of a sensor's place that was told; nan for none."""
    platforms = answer.data.platforms
    told = np.empty(0) if platforms is None else platforms.position_std_m
    return float(np.nanmax(told)) if np.isfinite(told).any() else np.nan


def _update_table(answers: list[ContactAnswer]) -> dict[str, NDArray[Any]]:
    empty, none = np.empty((0, 4)), np.empty(0)
    motion = np.concatenate([empty, *(a.update_motion for a in answers)])
    std = np.concatenate([empty, *(a.update_std for a in answers)])
    contact = [np.full(a.update_rows.size, a.data.contact) for a in answers]
    return {
        "update_contact": np.concatenate([none, *contact]).astype(np.int64),
        "update_time_s": np.concatenate([none, *(a.data.time_s[a.update_rows] for a in answers)]),
        **_with_std(motion, std, "update_"),
    }
