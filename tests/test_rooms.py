"""Imports point down only, libraries live in their rooms, and names mean one thing."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import uwtrack_cli

ROOT = Path(uwtrack_cli.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

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
    "studies": {
        "data", "acoustics", "estimation", "simulate", "spectra", "arrays", "lines", "motion",
        "presence", "clutter", "discrimination", "files", "flow",
    },
    "cli": {"data", "files", "flow", "plotting", "studies"},
}  # fmt: skip
"""What a room may import beside itself and the ground (errors, constants)."""

LIBRARIES = {
    "h5py": {"files"},
    "soundfile": {"files"},
    "typer": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"plotting"},
    "distributed": {"flow"},
    "duckdb": {"flow"},
    "geographiclib": {"acoustics", "files"},
}
"""Rooms in which a library may be imported."""


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
    return names


def room_of(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else ""


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_down(path):
    room = room_of(path)
    if not room:
        return
    allowed = ROOMS[room] | {room}
    for name in imported(path):
        parts = name.split(".")
        if parts[0] == "uwtrack_cli" and len(parts) > 1 and parts[1] in ROOMS:
            assert parts[1] in allowed, f"{room} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_libraries_stay_in_their_rooms(path):
    room = room_of(path)
    for name in imported(path):
        library = name.split(".")[0]
        if library in LIBRARIES:
            assert room in LIBRARIES[library], f"{room} imports {library}"
        assert library != "click", "Typer vendors click: it is not ours to import"


def test_nothing_is_unpickled():
    for path in MODULES:
        assert not imported(path) & {"pickle", "dill", "cloudpickle", "joblib"}, path


def classes(path: Path) -> list[ast.ClassDef]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def test_no_two_public_classes_have_one_name():
    names = Counter(
        one.name
        for path in MODULES
        for one in classes(path)
        if not one.name.startswith("_")
    )
    assert [name for name, count in names.items() if count > 1] == []


def unexplained(record: ast.ClassDef) -> Iterator[str]:
    """Yield the fields of a record that nothing describes."""
    described = ast.get_docstring(record) or ""
    for field, after in zip(record.body, [*record.body[1:], None], strict=True):
        if not (
            isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        ):
            continue
        name = field.target.id
        value = "" if field.value is None else ast.unparse(field.value)
        is_column = value.startswith(
            ("column(", "deviation(", "scalar(")
        )  # they carry a text
        is_constant = "ClassVar" in ast.unparse(field.annotation)
        has_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if not (is_column or is_constant or has_text or name in described):
            yield f"{record.name}.{name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_field_of_a_record_says_what_it_is(path):
    records = [
        one
        for one in classes(path)
        if any("dataclass" in ast.unparse(mark) for mark in one.decorator_list)
        or any(ast.unparse(base) == "NamedTuple" for base in one.bases)
    ]
    assert [name for one in records for name in unexplained(one)] == []
