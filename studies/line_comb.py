"""How often the comb test finds families in noise, and how often real ones.

**Method.** Peaks at random over 600 Hz, with or without a comb of L teeth of which each is
seen with a probability and a jitter. Detection is counted at the threshold that noise
exceeds once in a hundred (a thousand) sets, as in the reference.

**Conventions.** One set of peaks is one frame without bearings.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from studies.rows import share_row
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.study import StudyRow
from uwtrack_cli.lines.families.comb_test import CombRule, comb_tests

LOW_HZ, BAND_HZ = 400.0, 600.0
JITTER_HZ, SEEN = 0.25, 0.75
LEVELS = (1.0, 0.1, 0.01)
COMMON, RARE = 0.01, 0.001
"""Shares of the sets of noise that exceed the two thresholds of detection."""

_FEWEST_SETS = 300
_FEWEST_RARE = 5000
"""Sets of noise below which one in a thousand is not looked for."""

_JITTER_DENSITY = 12.0
_DETECTIONS = (
    ("comb", "comb_detection", SEEN, COMMON),
    ("comb", "comb_detection_rare", SEEN, RARE),
    ("whole comb", "comb_complete", 1.0, COMMON),
)


@dataclass
class _Noise:
    """Sets of noise, made once per density and jitter."""

    sets: int
    """Number of sets."""
    seed: int
    """Seed of the sets."""
    known: dict[tuple[float, float], FloatArray] = field(default_factory=dict)
    """Least chances by density and jitter."""

    def chances(self, density: float, jitter_hz: float) -> FloatArray:
        """Return their least chances."""
        key = density, jitter_hz
        if key not in self.known:
            rng = np.random.default_rng([self.seed, int(100 * density)])
            self.known[key] = noise_chances(density, self.sets, rng, jitter_hz)
        return self.known[key]

    def threshold(self, density: float, jitter_hz: float, share: float) -> float:
        """Return what a share of them exceeds."""
        return float(np.quantile(self.chances(density, jitter_hz), share))


@dataclass
class _Families:
    """Sets with a family, made once of each kind."""

    sets: int
    """Number of sets."""
    seed: int
    """Seed of the sets."""
    known: dict[tuple[int, float, float, float], FloatArray] = field(default_factory=dict)
    """Least chances by teeth, density, jitter and share of teeth seen."""

    def chances(self, teeth: int, density: float, jitter_hz: float, seen: float) -> FloatArray:
        """Return their least chances."""
        key = teeth, density, jitter_hz, seen
        if key not in self.known:
            rng = np.random.default_rng([self.seed, 1, *(int(100 * k) for k in key)])
            self.known[key] = family_chances(
                teeth, density, self.sets, rng, jitter_hz=jitter_hz, seen=seen
            )
        return self.known[key]


def comb_rows(reference: dict[str, Any], runs: int, seed: int) -> Iterator[StudyRow]:
    """Repeat the comb test: false families, families found.

    ``runs``: 50 sets of noise and 10 with a family come to a run.
    """
    noise = _Noise(max(50 * runs, _FEWEST_SETS), seed)
    families = _Families(max(10 * runs, _FEWEST_SETS // 3), seed)
    yield from _false_rows(reference["comb_false"], noise)
    for case, key, seen, share in _DETECTIONS:
        if share == RARE and noise.sets < _FEWEST_RARE:
            continue
        yield from _found_rows(case, reference[key], seen, share, noise, families)
    for teeth, by_jitter in reference["comb_jitter"].items():
        for jitter, known in by_jitter.items():
            threshold = noise.threshold(_JITTER_DENSITY, float(jitter), COMMON)
            found = families.chances(int(teeth), _JITTER_DENSITY, float(jitter), SEEN)
            yield share_row(
                f"comb {teeth} teeth, 12 of noise, {jitter} Hz",
                f"found at {100 * COMMON:g} % false", known, found < threshold,
            )  # fmt: skip


def _false_rows(known: dict[str, dict[str, list[float]]], noise: _Noise) -> Iterator[StudyRow]:
    for jitter, by_density in known.items():
        for density, shares in by_density.items():
            found = noise.chances(float(density), float(jitter))
            for level, share in zip(LEVELS, shares, strict=True):
                yield share_row(
                    f"noise {density} peaks of noise, {jitter} Hz",
                    f"share with NFA < {level:g}", share, found < np.log10(level),
                )  # fmt: skip


def _found_rows(
    case: str,
    known: dict[str, dict[str, float]],
    seen: float,
    share: float,
    noise: _Noise,
    families: _Families,
) -> Iterator[StudyRow]:
    for density, by_teeth in known.items():
        threshold = noise.threshold(float(density), JITTER_HZ, share)
        for teeth, value in by_teeth.items():
            found = families.chances(int(teeth), float(density), JITTER_HZ, seen)
            yield share_row(
                f"{case} {teeth} teeth, {density} of noise",
                f"found at {100 * share:g} % false", value, found < threshold,
            )  # fmt: skip


def least_chance(frequency_hz: FloatArray, jitter_hz: float = JITTER_HZ) -> float:
    """Return log10 of the least expected number of a comb among the peaks."""
    if frequency_hz.size < 3:
        return np.inf
    peaks = np.sort(frequency_hz)
    rule = CombRule((15.0, 60.0), 14, jitter_hz, 180.0, BAND_HZ)
    chance = comb_tests(peaks, np.full(peaks.size, np.nan), rule).log10_chance
    return float(chance.min(initial=np.inf))


def noise_chances(
    density: float, sets: int, rng: np.random.Generator, jitter_hz: float = JITTER_HZ
) -> FloatArray:
    """Least chances of sets of peaks at random."""
    return np.array(
        [
            least_chance(rng.uniform(LOW_HZ, LOW_HZ + BAND_HZ, rng.poisson(density)), jitter_hz)
            for _ in range(sets)
        ]
    )


def family_chances(
    n_teeth: int,
    density: float,
    sets: int,
    rng: np.random.Generator,
    *,
    jitter_hz: float = JITTER_HZ,
    seen: float = SEEN,
) -> FloatArray:
    """Least chances of sets that hold a family among peaks at random.

    ``n_teeth``: teeth of the family. ``density``: mean number of peaks at random.
    ``jitter_hz``: deviation of a tooth's frequency in Hz. ``seen``: probability that a
    tooth is seen.
    """
    return np.array([
        least_chance(
            np.append(
                _family(n_teeth, rng, jitter_hz, seen),
                rng.uniform(LOW_HZ, LOW_HZ + BAND_HZ, rng.poisson(density)),
            ),
            jitter_hz,
        )
        for _ in range(sets)
    ])  # fmt: skip


def _family(n_teeth: int, rng: np.random.Generator, jitter_hz: float, seen: float) -> FloatArray:
    spacing = rng.uniform(15.0, min(60.0, (BAND_HZ - 1.0) / (n_teeth - 1)))
    room = BAND_HZ - (n_teeth - 1) * spacing
    teeth = LOW_HZ + rng.uniform(0.0, room) + spacing * np.arange(n_teeth)
    teeth = teeth[rng.random(n_teeth) < seen]
    return teeth + jitter_hz * rng.standard_normal(teeth.size)
