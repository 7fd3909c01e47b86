"""The answers of target motion analysis as one table, with words and reasons."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import TextArray
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.estimation.target_motion.coordinates import to_motion
from uwtrack_cli.stages.motion.contact import ContactAnswer
from uwtrack_cli.stages.motion.modes import Analysis, ModeAnswer
from uwtrack_cli.stages.motion.words import ellipse_agrees, reasons_of, report_of

DEGREES = np.array([1.0, np.degrees(1.0), 1.0, np.degrees(1.0)])

STATEMENT = (
    "Range and speed rest on the assumed sound speed ({speed:g} m/s) and on one-way "
    "Doppler. Between straight tracks neither leaves a trace in the residuals: 1 % of "
    "sound speed is then 1 % of range, and frequencies that carry the two-way shift of "
    "an echo double the range."
)


def motions_table(answers: list[ContactAnswer], analysis: Analysis) -> Motions:
    """Gather the answers of all contacts."""
    rows = [
        _row(answer, mode, number)
        for answer in answers
        for number, mode in enumerate(answer.modes, start=1)
    ]
    columns = {
        name: _column(name, [row[name] for row in rows])
        for name, spec in Motions.columns().items()
        if spec.axes[0] == "motion"
    }
    return Motions(
        **columns,
        **_rest_table(answers, columns["reasons"]),
        **_update_table(answers),
        solver=analysis.solver,
        loss=analysis.misfit.loss,
        doppler=analysis.model.doppler,
        propagation="delayed" if analysis.delayed else "instant",
        sound_speed_mps=analysis.sound_speed_mps,
        statement=STATEMENT.format(speed=analysis.sound_speed_mps),
    )


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    spec = Motions.columns()[name]
    if not values:
        shape = (0, *(4 for _ in spec.axes[1:]))
        return np.empty(shape, dtype="U1" if spec.dtype.kind == "U" else spec.dtype)
    return np.array(values, dtype=None if spec.dtype.kind == "U" else spec.dtype)


def _row(answer: ContactAnswer, mode: ModeAnswer, number: int) -> dict[str, Any]:
    data = answer.data
    motion = to_motion(mode.q) * DEGREES
    covariance = mode.covariance[:4, :4] * np.outer(DEGREES, DEGREES)
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
        **_with_std("range", "m", motion[0], std[0]),
        **_with_std("bearing", "deg", motion[1], std[1]),
        **_with_std("speed", "mps", motion[2], std[2]),
        **_with_std("course", "deg", motion[3], std[3]),
        "range_low_m": np.nan
        if spans["range"].open_low
        else np.exp(spans["range"].low),
        "range_high_m": (
            np.nan if spans["range"].open_high else np.exp(spans["range"].high)
        ),
        "speed_low_mps": spans["speed"].low,
        "speed_high_mps": np.nan if spans["speed"].open_high else spans["speed"].high,
        "course_low_deg": np.degrees(spans["course"].low) % 360.0,
        "course_high_deg": np.degrees(spans["course"].high) % 360.0,
        "covariance": covariance,
        "now_time_s": float(data.time_s[-1]),
        **_with_std("now_range", "m", mode.now[0], mode.now_std[0]),
        **_with_std("now_bearing", "deg", *np.degrees([mode.now[1], mode.now_std[1]])),
        "ellipse_trusted": ellipse_agrees(mode),
        "misfit": mode.value,
        "n_values": answer.n_values,
        "reasons": json.dumps(reasons, sort_keys=True),
        **_observability(answer, mode, reasons),
    }
    _blank(values, reasons)
    return values


def _with_std(name: str, unit: str, value: float, std: float) -> dict[str, float]:
    return {f"{name}_{unit}": float(value), f"{name}_std_{unit}": float(std)}


def _utc(start_utc_ns: int | None, time_s: float) -> int:
    if start_utc_ns is None:
        return -1
    return start_utc_ns + int(np.rint(time_s * NANOSECONDS))


def _observability(
    answer: ContactAnswer, mode: ModeAnswer, reasons: dict[str, str]
) -> dict[str, Any]:
    seen = mode.observability
    observable = "range_m" not in reasons
    needed = not observable and not answer.manoeuvring
    return {
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


def _blank(values: dict[str, Any], reasons: dict[str, str]) -> None:
    """Take out what cannot be told, with everything that hangs on it."""
    order = ["range_m", "bearing_deg", "speed_mps", "course_deg"]
    covariance = np.array(values["covariance"])
    for key in reasons:
        if key not in values:
            continue
        stem, unit = key.rsplit("_", 1)
        values[key] = values[f"{stem}_std_{unit}"] = np.nan
        if key in order:
            place = order.index(key)
            covariance[place, :] = covariance[:, place] = np.nan
    if "course_deg" in reasons:
        values["course_low_deg"] = values["course_high_deg"] = np.nan
    values["covariance"] = covariance


def _rest_table(
    answers: list[ContactAnswer], reasons: TextArray
) -> dict[str, NDArray[Any]]:
    rows: list[tuple[int, int, float, float]] = []
    number = 0
    for answer in answers:
        for mode in answer.modes:
            std = np.sqrt(np.maximum(np.diagonal(mode.covariance)[4:], 0.0))
            hidden = "rest_frequencies_hz" in json.loads(str(reasons[number]))
            rows += [
                (number, int(line), np.nan if hidden else float(f), float(s))
                for line, f, s in zip(
                    answer.data.line_id, mode.rest_hz, std, strict=True
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


def _update_table(answers: list[ContactAnswer]) -> dict[str, NDArray[Any]]:
    empty = np.empty((0, 4))
    motion = np.concatenate([empty, *(a.update_motion for a in answers)]) * DEGREES
    std = np.concatenate([empty, *(a.update_std for a in answers)]) * DEGREES
    names = ("range_m", "bearing_deg", "speed_mps", "course_deg")
    table: dict[str, NDArray[Any]] = {
        "update_contact": np.concatenate(
            [np.empty(0, dtype=np.int64)]
            + [np.full(a.update_rows.size, a.data.contact) for a in answers]
        ),
        "update_time_s": np.concatenate(
            [np.empty(0), *(a.data.time_s[a.update_rows] for a in answers)]
        ),
    }
    for place, name in enumerate(names):
        stem, unit = name.rsplit("_", 1)
        table[f"update_{name}"] = motion[:, place]
        table[f"update_{stem}_std_{unit}"] = std[:, place]
    return table
