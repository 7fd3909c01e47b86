"""How often the comb test finds families in noise, and how often real ones.

**Method.** Peaks at random over 600 Hz, with or without a comb of L teeth of which each is
seen with probability 0.75 and a jitter of 0.25 Hz. Detection is counted at the
threshold that noise exceeds once in a hundred sets, as in the reference.

**Conventions.** One set of peaks is one frame without bearings.

**References.** The reference figures are the specification's section C.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.comb_test import CombRule, comb_tests

LOW_HZ, BAND_HZ = 400.0, 600.0
JITTER_HZ, SEEN = 0.25, 0.75
RULE = CombRule((15.0, 60.0), 14, JITTER_HZ, 180.0, BAND_HZ)


def least_chance(frequency_hz: FloatArray) -> float:
    """Return log10 of the least expected number of a comb among the peaks."""
    if frequency_hz.size < 3:
        return np.inf
    peaks = np.sort(frequency_hz)
    chance = comb_tests(peaks, np.full(peaks.size, np.nan), RULE)[3]
    return float(chance.min(initial=np.inf))


def noise_chances(density: float, sets: int, rng: np.random.Generator) -> FloatArray:
    """Least chances of sets of peaks at random."""
    return np.array(
        [
            least_chance(rng.uniform(LOW_HZ, LOW_HZ + BAND_HZ, rng.poisson(density)))
            for _ in range(sets)
        ]
    )


def family_chances(
    n_teeth: int, density: float, sets: int, rng: np.random.Generator
) -> FloatArray:
    """Least chances of sets that hold a family among peaks at random."""
    return np.array([
        least_chance(np.append(
            _family(n_teeth, rng),
            rng.uniform(LOW_HZ, LOW_HZ + BAND_HZ, rng.poisson(density)),
        ))
        for _ in range(sets)
    ])  # fmt: skip


def _family(n_teeth: int, rng: np.random.Generator) -> FloatArray:
    spacing = rng.uniform(15.0, min(60.0, (BAND_HZ - 1.0) / (n_teeth - 1)))
    room = BAND_HZ - (n_teeth - 1) * spacing
    teeth = LOW_HZ + rng.uniform(0.0, room) + spacing * np.arange(n_teeth)
    seen = teeth[rng.random(n_teeth) < SEEN]
    return seen + JITTER_HZ * rng.standard_normal(seen.size)
