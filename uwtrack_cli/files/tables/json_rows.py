"""Containers as rows of plain values: what `--json` and `show` print.

**Conventions.** What is not known is None (null), never nan; every such value of
an encounter, a fix or a motion has its reason under its own key. The keys of encounters,
fixes and motions are those of the command line's documentation.
"""

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from uwtrack_cli.data.base import Container, HasReasons
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.files.utc import format_utc

Row = dict[str, Any]

ENCOUNTER_KEYS = (
    "contact", "sensor", "status", "time_utc", "time_s", "time_std_s",
    "arrival_time_s", "speed_mps", "speed_std_mps", "slant_range_m",
    "slant_range_std_m", "horizontal_range_m", "range_over_speed_s",
    "range_over_speed_std_s", "course_deg", "course_std_deg", "bearing_deg",
    "bearing_std_deg", "side", "rest_frequencies_hz", "rest_frequencies_std_hz",
    "sound_speed_mps", "received_level_db", "extrapolated", "ambiguities", "reasons",
    "received_level_std_db", "source_level_db", "source_level_std_db", "spreading_db",
    "level_reference", "level_band_hz", "horizontal_range_std_m",
    "horizontal_range_over_speed_s", "horizontal_range_over_speed_std_s",
    "source_depth_m", "source_depth_std_m", "nuisances",
    "rest_frame_evidence", "misfit", "probability", "alternative",
    "alternative_probability", "evidence",
    "vessel", "reading", "reading_weight", "rival", "change", "covariance",
)  # fmt: skip
FIX_KEYS = (
    "contact", "mode", "weight", "time_utc", "time_s", "east_m", "north_m",
    "latitude", "longitude", "east_std_m", "north_std_m", "covariance_m2",
    "speed_mps", "course_deg", "sensors", "reading", "reading_weight", "rival",
    "reasons",
)  # fmt: skip
MOTION_KEYS = (
    "contact", "mode", "weight", "time_utc", "range_m", "range_std_m", "bearing_deg",
    "bearing_std_deg", "speed_mps", "speed_std_mps", "course_deg", "course_std_deg",
    "rest_frequencies_hz", "observable", "reasons", "rest_frequencies_std_hz",
    "time_s", "range_low_m", "range_high_m", "speed_low_mps", "speed_high_mps",
    "course_low_deg", "course_high_deg", "covariance", "ellipse_trusted",
    "now_time_s", "now_range_m", "now_range_std_m", "now_bearing_deg",
    "now_bearing_std_deg", "now_speed_mps", "now_speed_std_mps", "now_course_deg",
    "now_course_std_deg", "misfit", "n_values", "nuisances",
    "reading", "manoeuvre_time_s", "manoeuvre_gain",
    "east_m", "north_m", "latitude", "longitude", "reference", "offsets_deg",
    "probability_of_rows",
)  # fmt: skip
PRESENCE_KEYS = (
    "contact", "sensor", "kind", "from_utc", "to_utc", "from_s", "to_s", "spacing_hz",
    "spacing_std_hz", "blade_rate_hz", "frequencies_hz", "rates_hz", "n_lines",
    "level_db", "level_reference", "bearing_deg", "bearing_std_deg",
    "probability_of_chance", "encounter", "reading", "reading_weight", "rival",
    "reasons",
)  # fmt: skip
NO_START = "the start time of the recording is not known"
NO_COURSE = "the source is read as still"
NO_LATITUDE = "the positions are on a local grid"


def plain(value: Any) -> Any:
    """Return a value as JSON has it: nan and infinity are None, within it, too."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def json_rows(container: Container) -> list[Row]:
    """Return one object per row of a container's main axis.

    Encounters, fixes, motions and presence have their documented keys; any other container
    has its columns, and one without columns is a single row of its single values.
    """
    if not container.columns():
        return [facts(container)]
    rows = list(axis_rows(container, container.ROW))
    if container.NAME not in SPECIAL:
        return rows
    keys, complete = SPECIAL[container.NAME]
    for i, values in enumerate(rows):
        if "time_utc_ns" in values:
            values["time_utc"] = _utc(values["time_utc_ns"])
        values["rival"] = _rival(values)
        complete(container, i, values)
    return [{key: values.get(key) for key in keys} for values in rows]


def axes_of(container: Container) -> list[str]:
    """Return the axes that have rows of their own, the main one first."""
    first = [spec.axes[0] for spec in container.columns().values()]
    return sorted(dict.fromkeys(first), key=lambda axis: axis != container.ROW)


def axis_rows(container: Container, axis: str) -> Iterator[Row]:
    """Yield the rows of an axis: its columns by name, matrices as lists.

    Rows of the main axis that have reasons carry them as one JSON text.
    """
    columns = {
        name: getattr(container, name)
        for name, spec in container.columns().items()
        if spec.axes[0] == axis and getattr(container, name) is not None
    }
    is_main = axis == container.ROW
    for row in range(container.sizes().get(axis, 0)):
        values = {name: plain(values[row]) for name, values in columns.items()}
        if is_main and isinstance(container, HasReasons):
            values["reasons"] = json.dumps(container.reasons(row))
        yield values


def facts(container: Container) -> Row:
    """Return the single values of a container."""
    return {
        name: plain(getattr(container, name))
        for name in container.scalars()
        if not callable(getattr(container, name))
    }


def nested(container: Container) -> Row:
    """Return all values of a container, with those of its parts as objects within."""
    parts = ((name, getattr(container, name)) for name in container.parts())
    columns = {name: plain(getattr(container, name)) for name in container.columns()}
    return (
        facts(container)
        | columns
        | {name: None if part is None else nested(part) for name, part in parts}
    )


def _encounter(container: Encounters, i: int, values: Row) -> None:
    own = container.rest_encounter == i
    values["side"] = values["side"] or None
    values["rest_frequencies_hz"] = plain(container.rest_frequency_hz[own])
    values["rest_frequencies_std_hz"] = plain(container.rest_frequency_std_hz[own])
    values["ambiguities"] = plain(container.ambiguities(i))
    values["spreading_db"] = container.spreading_db
    values["level_reference"] = container.reference
    band = (container.band_low_hz, container.band_high_hz)
    values["level_band_hz"] = None if None in band else list(band)
    values["nuisances"] = plain(container.nuisances(i))
    values["alternative"] = values.get("alternative") or None
    values["evidence"] = plain(container.evidence(i))
    values["change"] = _change(values)
    values["vessel"] = _vessel(values)
    values["reasons"] = _reasons(container, i, values)
    if values["vessel"] is None:
        values["reasons"].setdefault("vessel", _why_no_vessel(container))


CHANGE_KEYS = (
    "frequency_change", "frequency_change_std", "frequency_slope_per_s",
    "frequency_slope_std_per_s", "other_leg_speed_mps", "other_leg_speed_std_mps",
    "other_leg_course_deg", "other_leg_course_std_deg", "turn_away_deg",
    "turn_away_std_deg", "turn_duration_s", "turn_duration_std_s", "turn_correlation",
)  # fmt: skip


def _rival(values: Row) -> Row | None:
    """Return the next reading of a row, None where it has less than 5 %."""
    if not values.get("rival"):
        return None
    return {"reading": values["rival"], "weight": values["rival_weight"]}


def _change(values: Row) -> Row | None:
    """Return what changed beside a passage, None for a straight one."""
    if values.get("change_time_s") is None:
        return None
    change = {
        "time_s": values["change_time_s"], "time_std_s": values["change_time_std_s"],
        "follows": values["change_follows"],
    }  # fmt: skip
    return change | {key: values.get(key) for key in CHANGE_KEYS}


def _vessel(values: Row) -> Row | None:
    """Return the vessel of an encounter by AIS, None where none is known."""
    if not values.get("vessel_name"):
        return None
    return {
        key: values[f"vessel_{key}"] or None for key in ("name", "mmsi", "probability")
    }


def _why_no_vessel(encounters: Encounters) -> str:
    if not encounters.ais_name:
        return "no AIS table was given"
    return (
        f"no vessel of {encounters.ais_name} within {encounters.ais_within_m:g} m fits"
    )


def _fix(container: Fixes, i: int, values: Row) -> None:
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.diagonal(container.covariance_m2[i]))
    values["east_std_m"], values["north_std_m"] = plain(std[:2])
    values["sensors"] = [name for name in values["sensors"].split(",") if name]
    values["reading"] = values.get("reading") or None
    why = {
        "time_utc": NO_START, "course_deg": NO_COURSE, "latitude": NO_LATITUDE,
        "longitude": NO_LATITUDE,
    }  # fmt: skip
    values["reasons"] = {key: why[key] for key in why if values[key] is None}


def _motion(container: Motions, i: int, values: Row) -> None:
    own = container.rest_motion == i
    values["rest_frequencies_hz"] = plain(container.rest_frequency_hz[own])
    values["rest_frequencies_std_hz"] = plain(container.rest_frequency_std_hz[own])
    values["reasons"] = _reasons(container, i, values)
    values["nuisances"] = plain(container.nuisances(i))
    values["reference"] = values.get("reference") or None
    values["offsets_deg"] = _offsets(container, i)
    values["probability_of_rows"] = _probabilities(container, values["contact"])


def _offsets(motions: Motions, row: int) -> Row:
    """Return what the bearings of each sensor must be turned by, by its name."""
    names, values = motions.offset_sensor, motions.offset_deg
    if motions.offset_motion is None or names is None or values is None:
        return {}
    own = np.flatnonzero(motions.offset_motion == row)
    return {str(names[i]): plain(values[i]) for i in own}


def _probabilities(motions: Motions, contact: int) -> Any:
    """Return the probability of every bearing; None where all are the contact's."""
    own, values = motions.row_contact, motions.row_probability
    if own is None or values is None:
        return None
    chosen = values[own == contact]
    return plain(chosen) if np.any(chosen < 1.0) else None


def _presence(container: Presence, i: int, values: Row) -> None:
    lines = container.owned_rows("frequency_stretch", i)
    rates = container.owned_rows("rate_stretch", i)
    reasons = container.reasons(i)
    for key in ("from", "to"):
        values[f"{key}_utc"] = _utc(values[f"{key}_utc_ns"])
        if values[f"{key}_utc"] is None:
            reasons.setdefault(f"{key}_utc", NO_START)
    values["frequencies_hz"] = plain(container.frequency_hz[lines])
    values["rates_hz"] = plain(container.rate_hz[rates])
    values["level_reference"] = container.reference
    values["encounter"] = values["encounter"] or None
    values["contact"] = values["contact"] or None
    values["reading"] = values.get("reading") or None
    values["reasons"] = reasons


Complete = Callable[[Any, int, Row], None]
"""Adds what a row of a container has beside its columns: container, row, its values."""

SPECIAL: dict[str, tuple[tuple[str, ...], Complete]] = {
    "encounters": (ENCOUNTER_KEYS, _encounter),
    "fixes": (FIX_KEYS, _fix),
    "motions": (MOTION_KEYS, _motion),
    "presence": (PRESENCE_KEYS, _presence),
}
"""Containers whose objects have documented keys, with how the rows are completed."""


def _utc(time_ns: int) -> str | None:
    """Return a time to the millisecond, finer than any clock at sea."""
    return None if time_ns < 0 else format_utc((time_ns + 500_000) // 10**6 * 10**6)


def _reasons(container: HasReasons, row: int, values: Row) -> dict[str, str]:
    reasons = container.reasons(row)
    if values["time_utc"] is None:
        reasons.setdefault("time_utc", NO_START)
    return reasons
