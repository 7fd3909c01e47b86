"""The result of a study: published figures beside measured ones, with intervals.

**Conventions.** A row is one figure: where it was measured (``case``), what it is
(``quantity`` with its unit), the reference (None where the source gives none), ours
and the 95 % interval of ours: normal for a mean, Wilson's for a share. Reference
figures live in JSON files under ``studies/reference``, so that no code can return
them as results.

**References.** Wilson, J. Am. Stat. Assoc. 22, 209-212 (1927).
"""

import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray


@dataclass(frozen=True)
class StudyRow:
    """One figure of a study beside its reference."""

    case: str
    """Where the figure was measured."""
    quantity: str
    """What it is, with its unit."""
    reference: float | None
    """Figure of the source; None where it gives none."""
    ours: float
    """Figure measured here."""
    low: float
    """Lower end of its 95 % interval."""
    high: float
    """Upper end of its 95 % interval."""


@dataclass(frozen=True)
class Study:
    """A study's name, its rows and what a reader must know to judge them."""

    name: str
    """Name of the study."""
    source: str
    """Publication whose figures stand beside ours."""
    runs: int
    """Number of runs asked for."""
    seed: int
    """Seed of all random numbers."""
    rows: tuple[StudyRow, ...]
    """Figures."""
    remarks: tuple[str, ...] = ()
    """Sentences that a reader needs to judge the figures."""


def load_reference(name: str) -> Any:
    """Return the reference figures of a study from its JSON file.

    Parameters
    ----------
    name
        Name of the study, for instance ``lines``.
    """
    text = (files("uwtrack_cli.studies") / "reference" / f"{name}.json").read_text(
        encoding="utf-8"
    )
    return json.loads(text)


Z95 = 1.96


def mean_row(
    case: str, quantity: str, known: float | None, values: FloatArray
) -> list[StudyRow]:
    """Return the row of a mean over runs; none when no run has a value."""
    values = values[np.isfinite(values)]
    if not values.size:
        return []
    mean = float(values.mean())
    # one value tells nothing of its own spread
    spread = float(values.std(ddof=1)) if values.size > 1 else np.inf
    half = Z95 * spread / np.sqrt(values.size)
    return [StudyRow(case, quantity, known, mean, mean - half, mean + half)]


def share_row(
    case: str,
    quantity: str,
    known: float | None,
    is_hit: BoolArray,
    *,
    percent: bool = False,
) -> StudyRow:
    """Return the row of a share, in percent if wanted."""
    n, p = is_hit.size, float(is_hit.mean())
    middle = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2)) / (1 + Z95**2 / n)
    unit = 100.0 if percent else 1.0
    low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    return StudyRow(case, quantity, known, unit * p, unit * low, unit * high)


def exact_row(case: str, quantity: str, known: float | None, value: float) -> StudyRow:
    """Return the row of a figure without random error."""
    return StudyRow(case, quantity, known, value, value, value)


def error_row(
    case: str, quantity: str, known: float | None, value: float, error: float
) -> StudyRow:
    """Return the row of a figure with a standard error."""
    half = Z95 * error
    return StudyRow(case, quantity, known, value, value - half, value + half)


def root_row(
    case: str, quantity: str, known: float | None, squares: FloatArray
) -> list[StudyRow]:
    """Return the row of a root mean square over trials; none without a value."""
    return [
        StudyRow(
            case, quantity, known,
            *(float(np.sqrt(max(v, 0.0))) for v in (row.ours, row.low, row.high)),
        )
        for row in mean_row(case, quantity, known, squares)
    ]  # fmt: skip
