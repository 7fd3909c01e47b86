"""Older layouts, read as if they were of today's.

**Method.** What changed from each version to the next stands here once: columns that
got another name, columns that were split into several, and element types. A reader
asks under which name a column is stored, and passes what it read through all changes
that follow the file's version. The file itself is never changed.

Version 1 kept every column of lines in double precision. Versions 1 and 2 kept reasons
and ambiguities as JSON texts, one per row.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import TextArray, flatten, reason_columns
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.errors import DataError

Columns = dict[str, NDArray[Any]]

RENAMED_IN: Mapping[int, Mapping[tuple[str, str], str]] = {
    3: {
        ("frames", "valid_fraction"): "effort",
        ("target", "loss_cusum"): "loss_evidence",
    },
}
"""By version: container and new name of a column, and the name it had before."""


ADDED_IN: Mapping[int, frozenset[tuple[str, str]]] = {
    4: frozenset(
        [
            *(
                ("encounters", name)
                for name in (
                    "probability",
                    "alternative",
                    "alternative_probability",
                    "evidence_encounter",
                    "evidence_alternative",
                    "evidence_nepers",
                    "refused_probability",
                )
            ),
            *(
                ("sensor", name)
                for name in ("north", "multiplex", "response", "clock_error_ppm")
            ),
            *(
                ("target", name)
                for name in (
                    "target_id",
                    "association_target_id",
                    "false_tracks_per_hour",
                    "confirming_score",
                    "crowded_scans",
                    "clutter_ratio",
                    "clutter_ratio_std",
                )
            ),
        ]
    ),
    3: frozenset(
        [
            *(
                ("sensor", name)
                for name in (
                    "depth_std_m",
                    "sound_speed_std_mps",
                    "full_scale_db",
                    "element_along_m",
                    "element_positions_m",
                    "tow_offset_m",
                    "heading_source",
                    "navigation_position_std_m",
                    "navigation_velocity_std_mps",
                    "dipole_gains",
                    "dipole_crosstalk",
                    "omni_crosstalk",
                )
            ),
            ("fixes", "statement"),
            ("frames", "array_heading_deg"),
            *(("encounters", f"ais_{key}") for key in ("name", "digest", "within_m")),
            ("files", "first_sample"),
            ("files", "own_start_utc_ns"),
            ("files", "own_stop_utc_ns"),
            ("peaks", "cone_deg"),
            ("peaks", "cone_std_deg"),
            ("peaks", "is_aliased"),
            ("peaks", "elevation_deg"),
            ("peaks", "elevation_std_deg"),
            ("lines", "measured_false_lines_per_khz_hour"),
            ("levels", "tilt_db"),
            ("levels", "part_excess_db"),
            *(
                (kind.NAME, name)
                for kind in (Encounters, Lines, Motions)
                for name, spec in kind.columns().items()
                if spec.optional
            ),
        ]
    ),
}
"""By version: container and name of single values, and of optional columns, that older
files do not have."""


def is_later(version: int, container: str, name: str) -> bool:
    """Tell whether a value came after a version: it has its default then, or is None."""
    return any(
        (container, name) in added
        for newer, added in ADDED_IN.items()
        if version < newer
    )


def stored_name(version: int, container: str, column: str) -> str:
    """Return the name that a column has in a file of a version."""
    for newer in sorted(RENAMED_IN, reverse=True):
        if version < newer:
            column = RENAMED_IN[newer].get((container, column), column)
    return column


def migrate(
    version: int, container: str, column: str, values: NDArray[Any]
) -> NDArray[Any]:
    """Turn elements of a column as a version stores them into those of today's.

    ``version``: version of the layout of the file that was read. ``column``: name of
    the column today. ``values``: elements as they are stored.
    """
    if version > 1 or container != Lines.NAME or column not in Lines.columns():
        return values
    now = Lines.columns()[column].dtype
    if now.kind not in "if" or values.dtype.kind != now.kind:
        return values
    with np.errstate(over="ignore"):  # a variance beyond single precision is infinite
        return values.astype(now, copy=False)


def split_columns(
    version: int, container: str
) -> Mapping[str, Callable[[TextArray], Columns]]:
    """Return the columns of a version's container that are several today.

    Each comes with the function that makes today's columns of its decoded elements.
    """
    return SPLIT_IN_3.get(container, {}) if version < 3 else {}


def _reasons(owner: str) -> Callable[[TextArray], Columns]:
    def split(texts: TextArray) -> Columns:
        parsed = [_parsed(text, dict) for text in texts]
        return reason_columns(
            owner, [{str(k): str(v) for k, v in row.items()} for row in parsed]
        )

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
        msg = f"the ambiguities of an encounter are not readable ({error!r})"
        raise DataError(msg) from error


def _parsed(text: str, kind: type) -> Any:
    try:
        value = json.loads(text) if text else kind()
    except (ValueError, RecursionError) as error:
        msg = f"a JSON text of an older version is not readable ({error})"
        raise DataError(msg) from error
    if not isinstance(value, kind):
        msg = f"a JSON text of an older version holds no {kind.__name__}"
        raise DataError(msg)
    return value


SPLIT_IN_3: Mapping[str, Mapping[str, Callable[[TextArray], Columns]]] = {
    "encounters": {
        "reasons": _reasons("reason_encounter"),
        "ambiguities": _ambiguities,
    },
    "motions": {"reasons": _reasons("reason_motion")},
    "decision": {"reasons": _reasons("reason_pair")},
}
"""Containers whose JSON texts became ragged tables in version 3."""
