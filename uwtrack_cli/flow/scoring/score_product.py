"""Everything in a product that truth can be held against."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import ContainerKey, Product
from uwtrack_cli.files.tables.ais import read_ais
from uwtrack_cli.files.tables.truth import read_truth
from uwtrack_cli.flow.branches import refuse_unknown_step, sole_keys
from uwtrack_cli.flow.scoring.encounter_scores import (
    EncounterScores,
    Identity,
    Score,
    apply_limits,
    score_encounters,
)
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors, start_of_rows
from uwtrack_cli.flow.scoring.tolerances import Requirements
from uwtrack_cli.flow.scoring.track_scores import TrackScores, score_fixes

C = TypeVar("C", Encounters, Fixes)


@dataclass(frozen=True)
class ProductScore:
    """Scores of a product, and the limits that it does not meet."""

    scores: tuple[Score, ...]
    """Scores of all quantities of encounters and fixes."""
    identities: tuple[Identity, ...]
    """Which vessel each encounter was."""
    missed: tuple[str, ...]
    """True passages without an encounter, in words."""
    false: tuple[str, ...]
    """Encounters without a true passage, in words."""
    gospa_m: float | None
    """GOSPA of the fixes, m; None without fixes."""
    ospa_m: float | None
    """OSPA of the fixes, m; None without fixes."""
    n_times: int
    """Number of times at which positions were compared."""
    problems: tuple[str, ...]
    """Limits that are not met, in words."""
    ambiguous: tuple[str, ...] = ()
    """Contacts whose positions were ambiguous, and which mode was compared, in words."""


def read_any_truth(path: Path) -> Truth:
    """Read a truth file, or a table of AIS messages, by the ending of its name."""
    return read_truth(path) if path.suffix.lower() == ".json" else read_ais(path)


def score_product(
    product: Product,
    truth: Truth,
    wanted: Requirements | None = None,
    *,
    step: str | None = None,
    within_m: float = 2000.0,
    cutoff_m: float = 500.0,
) -> ProductScore:
    """Score the encounters and positions of a product.

    ``within_m``: largest range at which AIS vessels are expected to be detected, m.
    ``cutoff_m``: cut-off of GOSPA and OSPA, m.

    Raises
    ------
    DataError
        The product holds neither encounters nor fixes, or those of several steps, or
        nothing tells the clock.
    """
    refuse_unknown_step([product], step)
    keys = sole_keys(product, step, {Encounters.NAME, Fixes.NAME})
    recordings = product.read_all(Recording)
    there = {key.name: key for key in keys}
    encounters = _read(product, Encounters, there)
    recorded = RecordedSensors(product.read_all(Sensor), recordings, encounters)
    fixes = _read(product, Fixes, there)
    if encounters is None and fixes is None:
        raise DataError(f"{product.name} holds neither encounters nor fixes to score.")
    passed = EncounterScores((), (), (), ())
    if encounters is not None:
        passed = score_encounters(encounters, truth, recorded, within_m=within_m)
    tracks: TrackScores | None = None
    if fixes is not None and fixes.time_s.size:
        starts = [r.start_utc_ns for r in recordings if r.start_utc_ns is not None]
        start = start_of_rows(fixes)
        start = min(starts, default=None) if start is None else start
        tracks = score_fixes(fixes, truth, start, cutoff_m=cutoff_m)
    scores = (*passed.scores, *(tracks.scores if tracks else ()))
    if wanted is not None:
        scores = apply_limits(scores, wanted)
    return ProductScore(
        scores,
        passed.identities,
        passed.missed,
        passed.false,
        tracks.gospa_m if tracks else None,
        tracks.ospa_m if tracks else None,
        tracks.n_times if tracks else 0,
        tuple(_problems(scores, passed, tracks, wanted)) if wanted else (),
        tracks.ambiguous if tracks else (),
    )


def _read(product: Product, kind: type[C], there: Mapping[str, ContainerKey]) -> C | None:
    key = there.get(kind.NAME)
    return None if key is None else product.read(kind, key.sensor, key.step)


def _problems(
    scores: tuple[Score, ...],
    passed: EncounterScores,
    tracks: TrackScores | None,
    wanted: Requirements,
) -> list[str]:
    found = [
        f"contact {s.contact} of {s.sensor}, {s.quantity}: {s.outside}" for s in scores if s.outside
    ]
    counts = {"missed": (passed.missed, wanted.missed), "false": (passed.false, wanted.false)}
    for word, (items, most) in counts.items():
        if most is not None and len(items) > most:
            found.append(f"{len(items)} encounters {word}, {most} accepted")
    for key in ("gospa_m", "ospa_m"):
        limits = wanted.limits.get("fixes", {}).get(key)
        value = getattr(tracks, key) if tracks else np.nan
        excess = limits.excess(value, 0.0, 0.0) if limits else ""
        if excess:
            found.append(f"{key}: {excess}")
    return found
