"""Containers as rows of plain values: what `--json` and `show` print.

**Conventions.** What is not known is None (null), never nan; every such value of
an encounter, a fix or a motion has its reason under its own key. The keys of encounters,
fixes, motions and presence follow from their columns (see `data.base`); what else a row
of them has is made here.
"""

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from uwtrack_cli.data.base import Container, HasReasons
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.renamed import KEYS
from uwtrack_cli.files.utc import format_utc

Row = dict[str, Any]

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
    if container.NAME not in OBJECTS:
        return list(axis_rows(container, container.ROW))
    complete, _ = OBJECTS[container.NAME]
    keys, facts_by_key = object_keys(type(container)), _scalar_keys(type(container))
    found = []
    for row in range(container.sizes().get(container.ROW, 0)):
        values = dict.fromkeys(keys)
        values |= {k: _under_key(container, k, row) for k in container.row_keys()}
        values |= {k: plain(getattr(container, n)) for k, n in facts_by_key.items()}
        complete(container, row, values)
        _name_reasons_anew(values.get("reasons") or {})
        found.append(values)
    return found


def _name_reasons_anew(reasons: dict[str, str]) -> None:
    """Put reasons of an older file under the keys that values have now."""
    for before, now in KEYS.items():
        if before in reasons:
            reasons[now] = reasons.pop(before)


def object_keys(kind: type[Container]) -> list[str]:
    """Return the keys of the objects that stand for the rows of a container."""
    _, order = OBJECTS[kind.NAME]
    return list(dict.fromkeys([*order.split(), *kind.row_keys(), *_scalar_keys(kind)]))


def _scalar_keys(kind: type[Container]) -> dict[str, str]:
    """Return the single values that every object of a row repeats, by their keys."""
    told = ((field.metadata["key"], name) for name, field in kind.scalars().items())
    return {key: name for key, name in told if key}


def _under_key(container: Container, key: str, row: int) -> Any:
    """Return what the object of a row has under a key; None where it is not known."""
    one = container.row_keys()[key]
    if one.owner:
        return plain(container.ragged(key, row))
    cells = {inner: _cell(container, name, row) for inner, name in one.columns.items()}
    if "" in cells:
        return cells[""]
    is_known = next(iter(cells.values())) not in {None, ""}
    return cells if is_known else None


def _cell(container: Container, name: str, row: int) -> Any:
    """Return the value of a column in a row, a time since 1970 as text."""
    values, spec = getattr(container, name), container.columns()[name]
    if values is None:
        return None
    value = plain(values[row])
    if name.endswith("_utc_ns"):
        return _utc(value)
    return None if spec.unknown is not None and value == spec.unknown else value


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


def _encounter(container: Encounters, _: int, values: Row) -> None:
    band = (container.band_low_hz, container.band_high_hz)
    values["level_band_hz"] = None if None in band else list(band)
    _say_no_start(values)
    if values["vessel"] is None:
        values["reasons"].setdefault("vessel", _why_no_vessel(container))


def _why_no_vessel(encounters: Encounters) -> str:
    if not encounters.ais_name:
        return "no AIS table was given"
    return f"no vessel of {encounters.ais_name} within {encounters.ais_within_m:g} m fits"


def _fix(container: Fixes, i: int, values: Row) -> None:
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.diagonal(container.covariance_m2[i]))
    values["east_std_m"], values["north_std_m"] = plain(std[:2])
    values["sensors"] = [name for name in values["sensors"].split(",") if name]
    why = {
        "time_utc": NO_START, "course_deg": NO_COURSE, "latitude": NO_LATITUDE,
        "longitude": NO_LATITUDE,
    }  # fmt: skip
    values["reasons"] = {key: why[key] for key in why if values[key] is None}


def _motion(container: Motions, _: int, values: Row) -> None:
    _say_no_start(values)
    values["probability_of_rows"] = _probabilities(container, values["contact"])


def _probabilities(motions: Motions, contact: int) -> Any:
    """Return the probability of every bearing; None where all are the contact's."""
    own, values = motions.row_contact, motions.row_probability
    if own is None or values is None:
        return None
    chosen = values[own == contact]
    return plain(chosen) if np.any(chosen < 1.0) else None


def _presence(_container: Presence, _: int, values: Row) -> None:
    _say_no_start(values, "from_utc", "to_utc")


def _say_no_start(values: Row, *keys: str) -> None:
    for key in keys or ("time_utc",):
        if values[key] is None:
            values["reasons"].setdefault(key, NO_START)


Complete = Callable[[Any, int, Row], None]
"""Adds what a row of a container has beside its columns: container, row, its values."""

OBJECTS: dict[str, tuple[Complete, str]] = {
    "encounters": (
        _encounter,
        (
            "contact sensor status time_utc time_s time_std_s arrival_time_s speed_mps "
            "speed_std_mps slant_range_m slant_range_std_m horizontal_range_m range_over_speed_s "
            "range_over_speed_std_s course_deg course_std_deg bearing_deg bearing_std_deg side "
            "rest_frequencies_hz rest_frequencies_std_hz sound_speed_mps received_level_db "
            "extrapolated ambiguities reasons received_level_std_db source_level_db "
            "source_level_std_db spreading_db level_reference level_band_hz "
            "horizontal_range_std_m horizontal_range_over_speed_s "
            "horizontal_range_over_speed_std_s source_depth_m source_depth_std_m nuisances rest_frame_evidence misfit probability "
            "alternative alternative_probability evidence vessel motion_model "
            "motion_model_probability alternative_motion_model change covariance"
        ),
    ),
    "fixes": (
        _fix,
        (
            "contact mode weight time_utc time_s east_m north_m latitude longitude east_std_m "
            "north_std_m covariance_m2 speed_mps course_deg sensors motion_model "
            "motion_model_probability alternative_motion_model reasons sensor_contacts "
            "pairing_probability"
        ),
    ),
    "motions": (
        _motion,
        (
            "contact mode weight time_utc range_m range_std_m bearing_deg bearing_std_deg "
            "speed_mps speed_std_mps course_deg course_std_deg rest_frequencies_hz observable "
            "reasons rest_frequencies_std_hz time_s range_low_m range_high_m speed_low_mps "
            "speed_high_mps course_low_deg course_high_deg covariance ellipse_trusted now_time_s "
            "now_range_m now_range_std_m now_bearing_deg now_bearing_std_deg now_speed_mps "
            "now_speed_std_mps now_course_deg now_course_std_deg misfit n_values nuisances "
            "motion_model manoeuvre_time_s manoeuvre_gain manoeuvre_probability legs east_m north_m "
            "latitude longitude reference offsets_deg probability_of_rows sensor_contacts "
            "pairing_probability"
        ),
    ),
    "presence": (
        _presence,
        (
            "contact sensor kind from_utc to_utc from_s to_s spacing_hz spacing_std_hz "
            "blade_rate_hz frequencies_hz rates_hz n_lines level_db level_reference bearing_deg "
            "bearing_std_deg probability_of_chance encounter motion_model "
            "motion_model_probability alternative_motion_model reasons"
        ),
    ),
}
"""Containers whose rows are objects with documented keys: what completes a row, and the order
that its keys have had; those of later columns follow."""


def _utc(time_ns: int) -> str | None:
    """Return a time to the millisecond, finer than any clock at sea."""
    return None if time_ns < 0 else format_utc((time_ns + 500_000) // 10**6 * 10**6)
