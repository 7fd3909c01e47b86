"""JSON Schemas of everything that the program prints as JSON.

**Method.** A schema is derived from what defines the output itself: the columns and
single values of a container with their units and descriptions, or the fields of a
report's dataclass. So a schema cannot fall behind the program.

**Conventions.** ``VERSION`` counts changes that may break a reader: a key that goes or
changes its type. Within a version keys are only added, and readers must pass over keys
that they do not know. What is not known is null.
"""

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from inspect import getdoc
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.data.options import refuse_unknown
from uwtrack_cli.data.renamed import INNER_KEYS, KEYS
from uwtrack_cli.files.hdf5.layout import CONTAINERS, scalar_types
from uwtrack_cli.files.tables.json_rows import OBJECTS, object_keys

VERSION = 2
"""Version of all schemas; a reader finds it in ``$id``."""

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = dict[str, Any]

REPORTS: dict[str, tuple[str, bool]] = {
    "batch": ("uwtrack_cli.flow.batch:Outcome", True),
    "passages": ("uwtrack_cli.flow.passages:PassageRow", True),
    "forecast": ("uwtrack_cli.flow.forecast:ForecastRow", True),
    "diff": ("uwtrack_cli.flow.comparison:Difference", True),
    "score": ("uwtrack_cli.flow.scoring.score_product:ProductScore", False),
    "calibrate": ("uwtrack_cli.flow.calibration:Calibration", False),
    "study": ("uwtrack_cli.data.study:Study", False),
}
"""Outputs of commands: the dataclass of an object, and whether there is a list."""


def _maybe(kind: str, text: str = "") -> Schema:
    """Return the schema of a value that may be null."""
    return _told({"type": [kind, "null"]}, text)


def _told(schema: Schema, text: str) -> Schema:
    return {**schema, "description": text} if text else schema


def _list(items: Schema, text: str = "", kind: Any = "array") -> Schema:
    return _told({"type": kind, "items": items}, text)


def _object(
    properties: Mapping[str, Schema],
    text: str = "",
    kind: Any = "object",
    required: Sequence[str] | None = None,
) -> Schema:
    """Return the schema of an object; it has all of its keys unless told."""
    needed = list(properties if required is None else required)
    body = {"type": kind, "properties": dict(properties), "required": needed}
    return _told(body, text)


_TEXT: Schema = {"type": "string"}
_NUMBER: Schema = {"type": "number"}
_INTEGER: Schema = {"type": "integer"}
_TIME: Schema = {
    "type": ["string", "null"],
    "format": "date-time",
    "description": "UTC; null where the start of the recording is not known.",
}
_MADE: dict[str, Schema] = {
    "level_band_hz": _list(
        _NUMBER, "Lower and upper edge of the levels' band. [Hz]", ["array", "null"]
    ),
    "sensors": _list(_TEXT, "Identifiers of the sensors that contributed."),
    "east_std_m": _maybe("number", "Standard deviation of east_m. [m]"),
    "north_std_m": _maybe("number", "Standard deviation of north_m. [m]"),
    "probability_of_rows": _list(
        _maybe("number"),
        "Probability that each bearing is this contact's, in the order of time; null "
        "where all are.",
        ["array", "null"],
    ),
    "reasons": _told(
        {"type": "object", "additionalProperties": _TEXT}, "Why a value is null, by its key."
    ),
}
"""Keys of objects that `json_rows` makes of several columns, or in words of its own."""

_ALWAYS = {"ambiguity_weight", "evidence_nepers", "alternative_motion_model_probability"}
"""Columns of numbers that are known wherever the object that they are in is."""

_NUISANCES = (
    "What is not known exactly, by name with its unit: estimate, standard deviation, share "
    "of the variance."
)

_EVENT: dict[str, Schema] = {
    "event": {"enum": ["line", "presence", "encounter", "gap"]},
    "sensor": _TEXT,
    "time_s": _told(_NUMBER, "Where it begins, or the approach. [s]"),
    "time_utc": _TIME,
    "revision": _told(_INTEGER, "Number of earlier reports of it."),
    "final": {"type": "boolean", "description": "Whether it is decided."},
    "decided_s": _told(_NUMBER, "Length of the sound that had arrived. [s]"),
}
"""Keys of every event of live sound."""

_OF_LINES_AND_GAPS: dict[str, Schema] = {
    "step": _told(_TEXT, "Step that tracked the line."),
    "line": _told(_INTEGER, "Identifier of the line."),
    "end_time_s": _told(_NUMBER, "Last point of the line so far. [s]"),
    "frequency_hz": _told(_NUMBER, "Frequency at its last point. [Hz]"),
    "frequency_low_hz": _told(_NUMBER, "Lowest frequency so far. [Hz]"),
    "frequency_high_hz": _told(_NUMBER, "Highest frequency so far. [Hz]"),
    "snr_db": _maybe("number", "Median SNR. [dB]"),
    "n_points": _told(_INTEGER, "Points of the line so far."),
    "segment": _told(_INTEGER, "Number of a segment of presence."),
    "duration_s": _told(_NUMBER, "Length of the gap so far. [s]"),
    "reason": _told(_TEXT, "What disturbs the sound."),
}


def _events() -> Schema:
    """Return the schema of one line of `run - --json`.

    An encounter and a segment of presence have the keys of their containers, too.
    """
    encounter, presence = (
        _container(CONTAINERS[name])["items"]["properties"] for name in ("encounters", "presence")
    )
    keys = {**presence, **encounter, **_OF_LINES_AND_GAPS, **_EVENT}
    title = {"title": "An event of live sound: one JSON object per line."}
    return title | _object(keys, required=list(_EVENT))


def schema_names() -> list[str]:
    """Return the names of all outputs that have a schema."""
    return [*CONTAINERS, "info", "events", *REPORTS]


def json_schema(name: str) -> Schema:
    """Return the JSON Schema of an output.

    ``name``: a container (``show --format json``, ``--json``), or a command that prints
    a report: info, batch, diff, score, study.

    Raises
    ------
    OptionError
        There is no such output.
    """
    refuse_unknown({name: None}, dict.fromkeys(schema_names()), "--schema", "output")
    if name in CONTAINERS:
        body = _container(CONTAINERS[name])
    elif name == "info":
        body = _INFO
    elif name == "events":
        body = _events()
    else:
        module, _, kind = REPORTS[name][0].partition(":")
        body = _of_dataclass(getattr(import_module(module), kind))
        if name == "batch":
            body["properties"]["n_encounters"] = {"type": "integer"}
        if REPORTS[name][1]:
            body = {"title": body["title"], **_list(body)}
    head = {"$schema": DIALECT, "$id": f"urn:uwtrack:{name}:{VERSION}"}
    return head | _with_old_keys(body)


def _with_old_keys(schema: Schema, *, is_inner: bool = False) -> Schema:
    """Return a schema that also has the keys of the version before, as deprecated.

    ``is_inner``: whether it is that of the object which was called ``rival``.
    """
    found = dict(schema)
    if "items" in found:
        found["items"] = _with_old_keys(found["items"])
    if "properties" in found:
        now = {key: _with_old_keys(one) for key, one in found["properties"].items()}
        for before, after in (INNER_KEYS if is_inner else KEYS).items():
            if after in now:
                one = _with_old_keys(now[after], is_inner=before == "rival")
                now[before] = {**one, "deprecated": True}
        if is_inner:
            now = {key: now[key] for key in INNER_KEYS}
            found["required"] = list(INNER_KEYS)
        found["properties"] = now
    return found


def _container(kind: type[Container]) -> Schema:
    title = (getdoc(kind) or "").split("\n", 1)[0]
    if kind.NAME in OBJECTS:
        properties = {key: _documented(kind, key) for key in object_keys(kind)}
        return {"title": title, **_list(_object(properties))}
    facts = {
        name: _scalar(plain, kind.scalars()[name].metadata)
        for name, plain in scalar_types(kind).items()
    }
    properties = {"table": {"const": kind.NAME}, **facts}
    axes = dict.fromkeys(spec.axes[0] for spec in kind.columns().values())
    for axis in (a for a in axes if a != "reason"):
        key = f"{axis}_rows" if axis in properties else axis
        properties[key] = _list(_row(kind, axis))
    return {"title": title, **_object(properties)}


def _row(kind: type[Container], axis: str) -> Schema:
    columns = {n: s for n, s in kind.columns().items() if s.axes[0] == axis}
    needed = [name for name, spec in columns.items() if not spec.optional]
    return _object({n: _cell(s) for n, s in columns.items()}, required=needed)


def _cell(spec: Column, *, is_known: bool = False) -> Schema:
    """Return the schema of a value of a column, ``is_known`` for one that is never null."""
    text = _described(spec.description, spec.unit)
    may_miss = spec.dtype.kind == "f" or spec.unknown is not None
    names = {"f": "number", "b": "boolean", "U": "string"}
    kind = names.get(spec.dtype.kind, "integer")
    schema: Schema = {"type": [kind, "null"] if may_miss and not is_known else kind}
    if spec.choices:
        missing = [] if spec.unknown is None else [None]
        schema = {"enum": [*spec.choices, *missing]}
    for _ in spec.axes[1:]:
        schema = _list(schema)
    return {**schema, "description": text}


def _documented(kind: type[Container], key: str) -> Schema:
    """Return the schema of a key of the object of a row."""
    if key in _MADE:
        return _MADE[key]
    if key.endswith("_utc"):
        return _TIME
    columns, one = kind.columns(), kind.row_keys().get(key)
    if one is None:  # a single value that every row repeats
        (name,) = (n for n, f in kind.scalars().items() if f.metadata["key"] == key)
        plain, facts = scalar_types(kind)[name], kind.scalars()[name].metadata
        return {**_scalar(plain, facts), **(_TEXT if plain is str else {})}
    cells = {
        inner: _cell(columns[name], is_known=name in _ALWAYS) for inner, name in one.columns.items()
    }
    text = {"nuisances": _NUISANCES, **kind.OBJECTS}.get(key, "")
    body = cells.get("") or _object(cells)
    if one.names:
        return _told({"type": "object", "additionalProperties": body}, text)
    if one.owner:
        return _list(body, text)
    return body if "" in cells else _told({**body, "type": ["object", "null"]}, text)


def _scalar(plain: type, facts: Mapping[str, Any]) -> Schema:
    name = {float: "number", int: "integer", bool: "boolean", str: "string"}[plain]
    described = _described(facts["description"], facts["unit"])
    return {"type": [name, "null"], "description": described}


def _described(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit not in {"", "1"} else text


def _of_dataclass(kind: Any) -> Schema:
    hints = get_type_hints(kind)
    title = (getdoc(kind) or "").split("\n", 1)[0]
    body = _object({f.name: _of_hint(hints[f.name]) for f in fields(kind)})
    return {"title": title, **body}


def _of_hint(hint: Any) -> Schema:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in {Union, types.UnionType}:
        return {"anyOf": [_of_hint(one) for one in arguments]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if isinstance(hint, type) and is_dataclass(hint):
        return _of_dataclass(hint)
    if origin in {list, tuple, Sequence, frozenset}:
        inner = [a for a in arguments if a is not Ellipsis]
        same = len(set(map(str, inner))) == 1
        return _list(_of_hint(inner[0]) if same else {})
    if origin in {dict, Mapping}:
        return {"type": "object", "additionalProperties": _of_hint(arguments[1])}
    return _PLAIN.get(hint, dict[str, Any])()


_PLAIN: dict[Any, Callable[[], Schema]] = {
    float: lambda: {"type": ["number", "null"]},
    int: lambda: {"type": "integer"},
    bool: lambda: {"type": "boolean"},
    str: lambda: {"type": "string"},
    type(None): lambda: {"type": "null"},
}

_COLUMN = _object({"name": _TEXT, "shape": _list(_INTEGER), "units": _TEXT})
_INFO: Schema = {"title": "What a result file holds."} | _object({
    "file": _TEXT,
    "schema_version": _INTEGER,
    "program_version": _TEXT,
    "created_utc": {"type": "string", "format": "date-time"},
    "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
    "tables": _list(_object({
        "table": _TEXT,
        "sensor": _maybe("string"),
        "step": _TEXT,
        "columns": _list(_COLUMN),
    })),
    "history": _list(_object({
        "stage": _TEXT,
        "name": _TEXT,
        "inputs": _list(_TEXT),
        "options": {"type": "object"},
        "versions": {"type": "object", "additionalProperties": _TEXT},
        "sources": _list(_object({"name": _TEXT, "digest": _TEXT})),
    }, required=["stage", "options", "versions", "sources"])),
})  # fmt: skip
