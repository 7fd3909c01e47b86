"""The result of a study: published figures beside measured ones.

**Conventions.** A row is one figure: where it was measured (``case``), what it is
(``quantity`` with its unit), the reference (None where the source gives none), ours
and the 95 % interval of ours. Reference figures live in JSON files under
``flow/studies/reference``, so that no code can return them as results.
"""

import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any


@dataclass(frozen=True)
class StudyRow:
    """One figure of a study beside its reference."""

    case: str
    quantity: str
    reference: float | None
    ours: float
    low: float
    high: float


@dataclass(frozen=True)
class Study:
    """A study's name, its rows and what a reader must know to judge them."""

    name: str
    source: str
    runs: int
    seed: int
    rows: tuple[StudyRow, ...]
    remarks: tuple[str, ...] = ()


def load_reference(name: str) -> Any:
    """Return the reference figures of a study from its JSON file.

    Parameters
    ----------
    name
        Name of the study, for instance ``lines``.
    """
    text = (files("uwtrack_cli.flow.studies") / "reference" / f"{name}.json").read_text(
        encoding="utf-8"
    )
    return json.loads(text)
