"""The result of a study: published figures beside measured ones."""

from dataclasses import dataclass


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
