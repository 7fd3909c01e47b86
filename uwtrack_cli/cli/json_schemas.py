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
from uwtrack_cli.data.presence import KINDS
from uwtrack_cli.files.hdf5.layout import CONTAINERS, scalar_types
from uwtrack_cli.files.tables.json_rows import CHANGE_KEYS, SPECIAL

VERSION = 1
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
    "study": ("uwtrack_cli.studies.study:Study", False),
}
"""Outputs of commands: the dataclass of an object, and whether there is a list."""

_TEXT: Schema = {"type": "string"}
_TIME: Schema = {
    "type": ["string", "null"],
    "format": "date-time",
    "description": "UTC; null where the start of the recording is not known.",
}
_REASONS: Schema = {
    "type": "object",
    "additionalProperties": _TEXT,
    "description": "Why a value is null, by its key.",
}

_NUISANCES: Schema = {
    "type": "object",
    "additionalProperties": {
        "type": "object",
        "properties": {
            "value": {"type": ["number", "null"]},
            "std": {"type": ["number", "null"]},
            "share": {"type": ["number", "null"]},
        },
        "required": ["value", "std", "share"],
    },
    "description": "What is not known exactly, by name with its unit: estimate, "
    "standard deviation, share of the variance.",
}

_READING: Schema = {
    "enum": [
        "straight",
        "frequency-step",
        "frequency-ramp",
        "manoeuvre",
        "two-targets",
        "constant",
        "machinery",
        "joined",
        None,
    ],
    "description": "How the measurements are read; nothing passes in the last three, "
    "which no closest approach is. Null in older files, and where nothing was read.",
}

_RIVAL: Schema = {
    "type": ["object", "null"],
    "properties": {"reading": _TEXT, "weight": {"type": "number"}},
    "required": ["reading", "weight"],
    "description": "Next reading with its weight; null if none has 5 %.",
}

_DERIVED: dict[str, dict[str, Schema]] = {
    "encounters": {
        "side": {
            "enum": ["port", "starboard", None],
            "description": "Side of the vessel on which the sensor lies.",
        },
        "ambiguities": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {"side": _TEXT, "weight": {"type": "number"}},
                "required": ["side", "weight"],
            },
            "description": "Other solutions with their weights.",
        },
        "vessel": {
            "type": ["object", "null"],
            "properties": {
                "name": _TEXT,
                "mmsi": {"type": ["string", "null"]},
                "probability": {"type": ["number", "null"]},
            },
            "required": ["name", "mmsi", "probability"],
            "description": "Vessel by AIS, and the probability that it was that one.",
        },
        "reading": _READING,
        "rival": _RIVAL,
        "change": {
            "type": ["object", "null"],
            "properties": {
                name: {"type": ["number", "null"]}
                for name in ("time_s", "time_std_s", *CHANGE_KEYS)
            }
            | {"follows": {"type": "boolean"}},
            "required": ["time_s", "time_std_s", "follows", *CHANGE_KEYS],
            "description": "What changed beside a passage, and when; null if nothing.",
        },
        "level_reference": {**_TEXT, "description": "'1 uPa' or 'full scale'."},
        "level_band_hz": {
            "type": ["array", "null"],
            "items": {"type": "number"},
            "description": "Lower and upper edge of the levels' band. [Hz]",
        },
    },
    "fixes": {
        "sensors": {
            "type": "array",
            "items": _TEXT,
            "description": "Identifiers of the sensors that contributed.",
        },
        "east_std_m": {
            "type": ["number", "null"],
            "description": "Standard deviation of east_m. [m]",
        },
        "north_std_m": {
            "type": ["number", "null"],
            "description": "Standard deviation of north_m. [m]",
        },
        "reading": {
            "enum": ["still", "moving", None],
            "description": "How bearings that cross are read; null where not asked.",
        },
        "rival": {
            "type": ["object", "null"],
            "properties": {"reading": _TEXT, "weight": {"type": "number"}},
            "required": ["reading", "weight"],
            "description": "The other reading; null if it has less than 5 %.",
        },
    },
    "motions": {
        "reference": {
            "type": ["string", "null"],
            "description": "Sensor from which range and bearing count; null: own ship.",
        },
        "offsets_deg": {
            "type": "object",
            "additionalProperties": {"type": ["number", "null"]},
            "description": "What the bearings of each sensor of a table must be turned "
            "by, by its name. [degree]",
        },
        "probability_of_rows": {
            "type": ["array", "null"],
            "items": {"type": ["number", "null"]},
            "description": "Probability that each bearing is this contact's, in the "
            "order of time; null where all are.",
        },
    },
    "presence": {
        "contact": {
            "type": ["integer", "null"],
            "description": "Contact of its lines, from 1; null for none.",
        },
        "encounter": {
            "type": ["integer", "null"],
            "description": "Contact of the closest approach within it; null for none.",
        },
        "reading": _READING,
        "rival": _RIVAL,
        "kind": {
            "enum": list(KINDS),
            "description": "What was heard, as far as it can be told.",
        },
        "from_utc": _TIME,
        "to_utc": _TIME,
        "level_reference": {**_TEXT, "description": "'1 uPa' or 'full scale'."},
    },
}
"""Keys of documented objects that are not columns of their own."""

_LISTS = {"rest_frequencies_hz": "rest_frequency_hz",
          "rest_frequencies_std_hz": "rest_frequency_std_hz",
          "frequencies_hz": "frequency_hz", "rates_hz": "rate_hz"}  # fmt: skip
"""Keys that hold the rows of a ragged table, with its column."""


_NUMBER: Schema = {"type": "number"}

_EVENT: dict[str, Schema] = {
    "event": {"enum": ["line", "presence", "encounter", "gap"]},
    "sensor": _TEXT,
    "time_s": {**_NUMBER, "description": "Where it begins, or the approach. [s]"},
    "time_utc": _TIME,
    "revision": {"type": "integer", "description": "How often it was told before."},
    "final": {"type": "boolean", "description": "Whether it is decided."},
    "decided_s": {**_NUMBER, "description": "Sound that had come when told. [s]"},
}
"""Keys of every event of live sound."""

_OF_LINES_AND_GAPS: dict[str, Schema] = {
    "step": {**_TEXT, "description": "Step that tracked the line."},
    "line": {"type": "integer", "description": "Identifier of the line."},
    "end_time_s": {**_NUMBER, "description": "Last point of the line so far. [s]"},
    "frequency_hz": {**_NUMBER, "description": "Frequency at its last point. [Hz]"},
    "frequency_low_hz": {**_NUMBER, "description": "Lowest frequency so far. [Hz]"},
    "frequency_high_hz": {**_NUMBER, "description": "Highest frequency so far. [Hz]"},
    "snr_db": {"type": ["number", "null"], "description": "Median SNR. [dB]"},
    "n_points": {"type": "integer", "description": "Points of the line so far."},
    "stretch": {"type": "integer", "description": "Number of a stretch of presence."},
    "duration_s": {**_NUMBER, "description": "Length of the gap so far. [s]"},
    "reason": {**_TEXT, "description": "What disturbs the sound."},
}


def _events() -> Schema:
    """Return the schema of one line of `run - --json`.

    An encounter and a stretch of presence have the keys of their containers, too.
    """
    encounter, presence = (
        _container(CONTAINERS[name])["items"]["properties"]
        for name in ("encounters", "presence")
    )
    return {
        "title": "An event of live sound: one JSON object per line.",
        "type": "object",
        "properties": {**presence, **encounter, **_OF_LINES_AND_GAPS, **_EVENT},
        "required": list(_EVENT),
    }


def schema_names() -> list[str]:
    """Return the names of all outputs that have a schema."""
    return [*CONTAINERS, "info", "events", *REPORTS]


def json_schema(name: str) -> Schema:
    """Return the JSON Schema of an output.

    Parameters
    ----------
    name
        A container (``show --format json``, ``--json``), or a command that prints a
        report: info, batch, diff, score, study.

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
            body = {"title": body["title"], "type": "array", "items": body}
    return {"$schema": DIALECT, "$id": f"urn:uwtrack:{name}:{VERSION}", **body}


def _container(kind: type[Container]) -> Schema:
    title = (getdoc(kind) or "").split("\n", 1)[0]
    if kind.NAME in SPECIAL:
        keys = SPECIAL[kind.NAME][0]
        properties = {key: _documented(kind, key) for key in keys}
        row = {"type": "object", "properties": properties, "required": list(keys)}
        return {"title": title, "type": "array", "items": row}
    facts = {
        name: _scalar(plain, kind.scalars()[name].metadata)
        for name, plain in scalar_types(kind).items()
    }
    properties = {"container": {"const": kind.NAME}, **facts}
    required = ["container", *facts]
    axes = dict.fromkeys(spec.axes[0] for spec in kind.columns().values())
    for axis in (a for a in axes if a != "reason"):
        key = f"{axis}_rows" if axis in properties else axis
        properties[key] = {"type": "array", "items": _row(kind, axis)}
        required.append(key)
    return {"title": title, "type": "object", "properties": properties,
            "required": required}  # fmt: skip


def _row(kind: type[Container], axis: str) -> Schema:
    columns = {n: s for n, s in kind.columns().items() if s.axes[0] == axis}
    return {
        "type": "object",
        "properties": {name: _cell(spec) for name, spec in columns.items()},
        "required": [name for name, spec in columns.items() if not spec.optional],
    }


def _cell(spec: Column) -> Schema:
    names: Schema = {"f": ["number", "null"], "b": "boolean", "U": "string"}
    schema: Schema = {"type": names.get(spec.dtype.kind, "integer")}
    for _ in spec.axes[1:]:
        schema = {"type": "array", "items": schema}
    return {**schema, "description": _described(spec.description, spec.unit)}


def _documented(kind: type[Container], key: str) -> Schema:
    """Return the schema of a documented key: its own, a column's or a single value's."""
    common = {"time_utc": _TIME, "reasons": _REASONS, "nuisances": _NUISANCES}
    known = {**common, **_DERIVED[kind.NAME]}
    columns = kind.columns()
    if key in known:
        return known[key]
    if key in _LISTS:
        return {"type": "array", "items": _cell(columns[_LISTS[key]])}
    if key in columns:
        return _cell(columns[key])
    return _scalar(scalar_types(kind)[key], kind.scalars()[key].metadata)


def _scalar(plain: type, facts: Mapping[str, Any]) -> Schema:
    name = {float: "number", int: "integer", bool: "boolean", str: "string"}[plain]
    described = _described(facts["description"], facts["unit"])
    return {"type": [name, "null"], "description": described}


def _described(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit not in {"", "1"} else text


def _of_dataclass(kind: Any) -> Schema:
    hints = get_type_hints(kind)
    names = [f.name for f in fields(kind)]
    return {
        "title": (getdoc(kind) or "").split("\n", 1)[0],
        "type": "object",
        "properties": {name: _of_hint(hints[name]) for name in names},
        "required": names,
    }


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
        return {"type": "array", "items": _of_hint(inner[0]) if same else {}}
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

_INFO: Schema = {
    "title": "What is inside a product.",
    "type": "object",
    "properties": {
        "file": _TEXT,
        "schema_version": {"type": "integer"},
        "program_version": _TEXT,
        "created_utc": {"type": "string", "format": "date-time"},
        "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "containers": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "container": _TEXT,
                    "sensor": {"type": ["string", "null"]},
                    "step": _TEXT,
                    "columns": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "properties": {
                                "name": _TEXT,
                                "shape": {"type": "array", "items": {"type": "integer"}},
                                "units": _TEXT,
                            },
                            "required": ["name", "shape", "units"],
                        },
                    },
                },
                "required": ["container", "sensor", "step", "columns"],
            },
        },
        "history": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "stage": _TEXT,
                    "name": _TEXT,
                    "inputs": {"type": "array", "items": _TEXT},
                    "options": {"type": "object"},
                    "versions": {"type": "object", "additionalProperties": _TEXT},
                    "sources": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "properties": {"name": _TEXT, "digest": _TEXT},
                            "required": ["name", "digest"],
                        },
                    },
                },
                "required": ["stage", "options", "versions", "sources"],
            },
        },
    },
    "required": [
        "file", "schema_version", "program_version", "created_utc", "sha256",
        "containers", "history",
    ],
}  # fmt: skip
