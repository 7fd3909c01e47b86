"""The picture of the program is true: no circles, few modules with one user, its page."""

import ast
import functools
import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.support import package_modules
from tests.test_rooms import ROOMS

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "uwtrack_cli"

MOST_ALONE = {"small": 7, "all": 63}
"""Modules with one user in their own room that there may be, and those of them that are
small; this only falls."""

SMALL_LINES = 100
"""Length up to which a module is small."""


def name_of(path: Path) -> str:
    """Name of a module by its place in the package."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@functools.cache
def graph() -> dict[str, set[str]]:
    """Return the modules of the package that each module imports, by their names."""
    trees = {name_of(path): tree for path, tree in package_modules().items()}
    found: dict[str, set[str]] = {name: set() for name in trees}
    for name, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                package, _, inside = node.module.partition(".")
                if package == "uwtrack_cli":
                    whole = [f"{inside}.{a.name}".strip(".") for a in node.names]
                    found[name] |= {w if w in trees else inside for w in whole}
        found[name] -= {name, ""}
    return found


def circle(joins: dict[str, set[str]]) -> list[str]:
    """Return a circle of a graph, nothing where there is none."""
    try:
        TopologicalSorter(joins).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_files_import_each_other_in_a_circle():
    assert circle(graph()) == []


def test_no_folders_import_each_other_in_a_circle():
    """A room's stages stand above its folders, and both use what the room shares: what
    counts are circles between folders of which none lies within the other."""
    joins: dict[str, set[str]] = defaultdict(set)
    for name, used in graph().items():
        own = name.rpartition(".")[0]
        for other in {used_name.rpartition(".")[0] for used_name in used}:
            is_within = f"{own}.".startswith(f"{other}.") or f"{other}.".startswith(f"{own}.")
            if own and other and not is_within:
                joins[own].add(other)
    assert circle(joins) == []


def listed() -> set[str]:
    """Return the modules that a list of the program names: stages, commands, names."""
    text = "".join(
        (PACKAGE / place).read_text(encoding="utf-8")
        for place in ("__init__.py", "flow/catalogue.py", "cli/app.py", "files/hdf5/layout.py")
    )
    strings = re.findall(r'"([a-z0-9_.]+)(?::\w+)?"', text)
    rooms = ("", "cli.", "data.")
    return {f"{room}{s.removeprefix('uwtrack_cli.')}" for s in strings for room in rooms}


def test_few_modules_have_one_user():
    """One that is no idea of its own belongs into its user, where both share a room."""
    users: dict[str, set[str]] = defaultdict(set)
    for name, used in graph().items():
        for other in used:
            users[other].add(name)
    lines = {
        name_of(path): len((PACKAGE / path).read_text(encoding="utf-8").splitlines())
        for path in package_modules()
    }
    alone = [
        name
        for name, own in users.items()
        if len(own) == 1
        and name not in listed()
        and name.split(".")[0] == next(iter(own)).split(".")[0]
    ]
    small = [name for name in alone if lines[name] <= SMALL_LINES]
    assert len(small) <= MOST_ALONE["small"], sorted(small)
    assert len(alone) <= MOST_ALONE["all"], sorted(alone)


def test_the_page_says_what_a_room_may_import():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|.*\| ([^|]*) \|$", text, re.MULTILINE)
    told = {room: set(re.findall(r"`(\w+)`", allowed)) for room, allowed in rows}
    assert told == ROOMS
