"""Imports point down only, and each slow library lives on its own floor."""

import ast
from pathlib import Path

import pytest

import uwtrack_cli

ROOT = Path(uwtrack_cli.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))

FLOORS = {
    "data": set(),
    "physics": {"data"},
    "estimation": {"data", "physics"},
    "stages": {"data", "physics", "estimation"},
    "simulate": {"data"},
    "files": {"data", "simulate"},
    "flow": {"data", "physics", "estimation", "stages", "simulate", "files"},
    "plotting": {"data", "physics", "estimation", "stages", "files"},
    "cli": {"data", "files", "flow", "plotting"},
}
"""What a floor may import beside itself and the ground (errors, constants)."""

LIBRARIES = {
    "h5py": {"files"},
    "soundfile": {"files"},
    "typer": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"plotting"},
    "distributed": {"flow"},
    "geographiclib": {"physics", "files"},
}
"""Floors on which a library may be imported."""


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
    return names


def floor_of(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else ""


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_down(path):
    floor = floor_of(path)
    if not floor:
        return
    allowed = FLOORS[floor] | {floor}
    for name in imported(path):
        parts = name.split(".")
        if parts[0] == "uwtrack_cli" and len(parts) > 1 and parts[1] in FLOORS:
            assert parts[1] in allowed, f"{floor} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_libraries_stay_on_their_floors(path):
    floor = floor_of(path)
    for name in imported(path):
        library = name.split(".")[0]
        if library in LIBRARIES:
            assert floor in LIBRARIES[library], f"{floor} imports {library}"
        assert library != "click", "Typer vendors click: it is not ours to import"


def test_nothing_is_unpickled():
    for path in MODULES:
        assert not imported(path) & {"pickle", "dill", "cloudpickle", "joblib"}, path
