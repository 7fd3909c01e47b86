"""Imports point down only, libraries live in their rooms, and names mean one thing."""

import ast
import functools
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from tests.support import package_modules

ROOT = Path(__file__).parent.parent

ROOMS = {
    "data": set(),
    "acoustics": {"data"},
    "estimation": {"data"},
    "simulate": {"data"},
    "spectra": {"data", "acoustics", "estimation"},
    "arrays": {"data", "acoustics", "estimation", "spectra"},
    "lines": {"data", "acoustics", "estimation"},
    "motion": {"data", "acoustics", "estimation"},
    "presence": {"data", "acoustics", "estimation", "lines"},
    "clutter": {"data", "acoustics", "estimation"},
    "discrimination": {"data", "acoustics", "estimation"},
    "files": {"data", "acoustics"},
    "flow": {
        "data", "acoustics", "estimation", "simulate", "spectra", "arrays", "lines", "motion",
        "presence", "clutter", "discrimination", "files",
    },
    "plotting": {
        "data", "acoustics", "estimation", "spectra", "arrays", "motion", "files", "flow",
    },
    "cli": {"data", "files", "flow", "plotting"},
}  # fmt: skip
"""What a room may import beside itself and the ground (errors, constants)."""

LIBRARIES = {
    "h5py": {"files"},
    "soundfile": {"files"},
    "typer": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"plotting"},
    "jinja2": {"plotting"},
    "distributed": {"flow"},
    "duckdb": {"flow"},
    "geographiclib": {"acoustics", "files"},
}
"""Rooms in which a library may be imported."""


@functools.cache
def imports() -> dict[Path, set[str]]:
    """What every module imports, by its place."""
    found: dict[Path, set[str]] = {}
    for path, tree in package_modules().items():
        names = found.setdefault(path, set())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
    return found


def room_of(path: Path) -> str:
    return path.parts[0] if len(path.parts) > 1 else ""


def test_imports_point_down():
    wrong = [
        f"{path} imports {name}"
        for path, names in imports().items()
        for room in [room_of(path)]
        for name in names
        for parts in [name.split(".")]
        if room and parts[0] == "uwtrack_cli" and len(parts) > 1
        and parts[1] in ROOMS.keys() - ROOMS[room] - {room}
    ]  # fmt: skip
    assert wrong == []


def test_libraries_stay_in_their_rooms():
    used = {(path, name.split(".")[0]) for path, names in imports().items() for name in names}
    wrong = [
        f"{path} imports {library}"
        for path, library in sorted(used)
        if room_of(path) not in LIBRARIES.get(library, {room_of(path)})
    ]
    assert wrong == []
    # Typer vendors click: it is not ours to import
    strange = {"click", "pickle", "dill", "cloudpickle", "joblib"}
    assert not strange & {library for _, library in used}


def test_what_is_imported_is_declared():
    """The extras are asked for where they are needed; they are declared, too."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = chain.from_iterable(project["optional-dependencies"].values())
    told = [*project["dependencies"], *extras]
    declared = {re.split(r"[<>=\[ ]", text, maxsplit=1)[0] for text in told}
    used = {name.split(".")[0] for names in imports().values() for name in names}
    others = used - sys.stdlib_module_names - {"uwtrack_cli", "studies"}
    assert {"numpy", "scipy", "matplotlib"} <= others <= declared


def classes() -> Iterator[ast.ClassDef]:
    for tree in package_modules().values():
        yield from (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))


def test_no_two_public_classes_have_one_name():
    names = Counter(one.name for one in classes() if not one.name.startswith("_"))
    assert [name for name, count in names.items() if count > 1] == []


def unexplained(record: ast.ClassDef) -> Iterator[str]:
    """Yield the fields of a record that nothing describes."""
    described = ast.get_docstring(record) or ""
    for field, after in zip(record.body, [*record.body[1:], None], strict=True):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        name = field.target.id
        value = "" if field.value is None else ast.unparse(field.value)
        is_column = value.startswith(("column(", "deviation(", "scalar("))  # they carry a text
        is_constant = "ClassVar" in ast.unparse(field.annotation)
        has_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if not (is_column or is_constant or has_text or name in described):
            yield f"{record.name}.{name}"


def test_every_field_of_a_record_says_what_it_is():
    records = [
        one
        for one in classes()
        if any("dataclass" in ast.unparse(mark) for mark in one.decorator_list)
        or any(ast.unparse(base) == "NamedTuple" for base in one.bases)
    ]
    assert [name for one in records for name in unexplained(one)] == []


PRIVATE = {"lines": 6, "flow": 9, "motion": 13, "spectra": 1}
"""Private names that tests still import, by the room that they are of, those first that
acceptance holds best; this only falls, and a room without any leaves."""


def test_tests_import_ever_fewer_private_names():
    used = Counter[str]()
    for path in (ROOT / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                package, _, inside = node.module.partition(".")
                names = [a.name for a in node.names if re.match("_[^_]", a.name)]
                if package == "uwtrack_cli":
                    used[inside.split(".")[0]] += len(names)
    assert +used == Counter(PRIVATE)
