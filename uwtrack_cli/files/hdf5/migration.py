"""Older layouts, read as if they were of today's.

**Method.** What changed from each version to the next stands here once: columns that
got another name, columns that were split into several, and element types. A reader
asks under which name a column is stored, and passes what it read through all changes
that follow the file's version. The file itself is never changed. What came later needs no
entry: an optional column that a file lacks is None, and so is a single value its default,
where that says nothing (see `reader`).

Version 1 kept every column of lines in double precision. Versions 1 and 2 kept reasons
and ambiguities as JSON texts, one per row. Version 5 has the columns of the motion model and
of segments under the names that JSON has.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import TextArray, flatten, reason_columns
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.errors import DataError

Columns = dict[str, NDArray[Any]]

_MOTION_MODEL = {
    "motion_model": "reading",
    "motion_model_probability": "reading_weight",
    "alternative_motion_model": "rival",
    "alternative_motion_model_probability": "rival_weight",
}

RENAMED_IN: Mapping[int, Mapping[tuple[str, str], str]] = {
    5: {
        **{
            (kind, now): before
            for now, before in _MOTION_MODEL.items()
            for kind in ("encounters", "presence", "fixes")
        },
        **{
            ("encounters", f"refused_{now}"): f"refused_{before}"
            for now, before in _MOTION_MODEL.items()
        },
        **{
            ("presence", f"{owner}_segment"): f"{owner}_stretch"
            for owner in ("frequency", "rate", "reason")
        },
        ("motions", "motion_model"): "reading",
    },
    3: {("frames", "valid_fraction"): "effort", ("target", "loss_cusum"): "loss_evidence"},
}
"""By version: container and new name of a column, and the name it had before."""

WORDS_IN_5: Mapping[tuple[str, str], Mapping[bytes, bytes]] = {
    ("fixes", "motion_model"): {b"still": b"stationary"},
    ("fixes", "alternative_motion_model"): {b"still": b"stationary"},
    ("decision", "verdict"): {b"neither reading": b"neither fits"},
}
"""By container and column: texts that have another name since version 5."""


def stored_name(version: int, container: str, column: str) -> str:
    """Return the name that a column has in a file of a version."""
    for newer in sorted(RENAMED_IN, reverse=True):
        if version < newer:
            column = RENAMED_IN[newer].get((container, column), column)
    return column


def migrate(version: int, container: str, column: str, values: NDArray[Any]) -> NDArray[Any]:
    """Turn elements of a column as a version stores them into those of today's.

    ``version``: version of the layout of the file that was read. ``column``: name of
    the column today. ``values``: elements as they are stored.
    """
    words = WORDS_IN_5.get((container, column), {}) if version < 5 else {}
    if words and values.size:
        return np.array([words.get(one, one) for one in values.tolist()], np.bytes_)
    if version > 1 or container != Lines.NAME or column not in Lines.columns():
        return values
    now = Lines.columns()[column].dtype
    if now.kind not in "if" or values.dtype.kind != now.kind:
        return values
    with np.errstate(over="ignore"):  # a variance beyond single precision is infinite
        return values.astype(now, copy=False)


def split_columns(version: int, container: str) -> Mapping[str, Callable[[TextArray], Columns]]:
    """Return the columns of a version's container that are several today.

    Each comes with the function that makes today's columns of its decoded elements.
    """
    return SPLIT_IN_3.get(container, {}) if version < 3 else {}


def _reasons(owner: str) -> Callable[[TextArray], Columns]:
    def split(texts: TextArray) -> Columns:
        parsed = [_parsed(text, dict) for text in texts]
        return reason_columns(owner, [{str(k): str(v) for k, v in row.items()} for row in parsed])

    return split


def _ambiguities(texts: TextArray) -> Columns:
    rows, items = flatten(_parsed(text, list) for text in texts)
    try:
        return {
            "ambiguity_encounter": rows,
            "ambiguity_side": np.array([str(item["side"]) for item in items], np.str_),
            "ambiguity_weight": np.array([float(item["weight"]) for item in items]),
        }
    except (TypeError, KeyError, ValueError) as error:
        raise DataError(f"the ambiguities of an encounter are not readable ({error!r})") from error


def _parsed(text: str, kind: type) -> Any:
    try:
        value = json.loads(text) if text else kind()
    except (ValueError, RecursionError) as error:
        raise DataError(f"a JSON text of an older version is not readable ({error})") from error
    if not isinstance(value, kind):
        raise DataError(f"a JSON text of an older version holds no {kind.__name__}")
    return value


SPLIT_IN_3: Mapping[str, Mapping[str, Callable[[TextArray], Columns]]] = {
    "encounters": {"reasons": _reasons("reason_encounter"), "ambiguities": _ambiguities},
    "motions": {"reasons": _reasons("reason_motion")},
    "decision": {"reasons": _reasons("reason_pair")},
}
"""Containers whose JSON texts became ragged tables in version 3."""
