"""Names that version 0.3 replaced: each is understood for one more version.

**Conventions.** Every table maps the old name to the new one. The program writes new
names; in JSON alone it writes the old key, too. `docs/migration.md` lists all of them.
"""

from collections.abc import Mapping
from typing import Any

from uwtrack_cli.errors import OptionError

STAGES = {"ladder": "multi-resolution", "rises": "transients"}
"""Commands, stages, recipes and steps."""

TABLES = {"rises": "transients"}
"""Tables of a result file."""

OPTIONS = {("cpa", "ask_sound"): "rest_frame_test"}
"""Options of a stage, in recipes and in the history of a file."""

VALUES = {("pdaf", "targets"): {"told": "given"}}
"""Values of an option of a stage, in recipes and in the history of a file."""

FLAGS = {
    ("export", "--container"): "--table",
    ("cpa", "--ask-sound"): "--rest-frame-test",
    ("cpa", "--no-ask-sound"): "--no-rest-frame-test",
}
"""Options on the command line."""

WORDS = {("pdaf", "--targets"): {"told": "given"}}
"""Values of an option on the command line."""

PYTHON = {"Rises": "Transients", "find_rises": "find_transients"}
"""Names of the package."""

KEYS = {
    "reading": "motion_model",
    "reading_weight": "motion_model_probability",
    "rival": "alternative_motion_model",
    "stretch": "segment",
    "rise": "transient",
    "container": "table",
    "containers": "tables",
}
"""Keys of JSON objects."""

INNER_KEYS = {"reading": "motion_model", "weight": "probability"}
"""Keys within ``alternative_motion_model``, which was ``rival``."""


def with_old_options(stage: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options of a stage under the names that they have now.

    Raises
    ------
    OptionError
        An option is given under its old and its new name.
    """
    found: dict[str, Any] = {}
    for name, value in given.items():
        new = OPTIONS.get((stage, name), name)
        if new in found or (new != name and new in given):
            raise OptionError(f"{stage}.{name} is now called {new}, and both are given: give one.")
        words = VALUES.get((stage, new), {}) if isinstance(value, str) else {}
        found[new] = words.get(value, value) if words else value
    return found


def with_old_keys(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object for JSON with the old names of its keys beside the new ones.

    Examples
    --------
    >>> with_old_keys({"motion_model": "straight"})
    {'motion_model': 'straight', 'reading': 'straight'}
    """
    old = {before: row[now] for before, now in KEYS.items() if now in row}
    if isinstance(other := old.get("rival"), Mapping):
        old["rival"] = {before: other[now] for before, now in INNER_KEYS.items()}
    if isinstance(why := row.get("reasons"), Mapping):
        old["reasons"] = with_old_keys(why)
    return {**row, **old}
