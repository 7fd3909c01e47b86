"""Every experiment that is written can be run by name."""

import ast
from pathlib import Path

import studies
from studies.catalogue import STUDIES


def test_every_study_is_in_the_catalogue() -> None:
    """A function ``study_*`` without a name in the catalogue cannot be reached."""
    folder = Path(studies.__path__[0])
    written = {
        f"studies.{path.stem}:{node.name}"
        for path in folder.glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("study_")
    }
    assert written == set(STUDIES.values())
