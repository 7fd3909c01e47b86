"""Which lines are told as families: two ships and twenty stray lines.

Two minutes of two ships at once, spacings of 6 to 40 Hz, each with 8 to 14 neighbouring
multiples between 100 and 1750 Hz, and 20 lines anywhere there, none of them moving, at 8
to 16 dB over the noise in 1 Hz. *Recall* is the share of the ships' lines told in the
family that most of their ship's lines are in, *precision* the share of the lines in
families that are of the ship of most lines of that family.
"""

from collections import Counter

import numpy as np

from tests.draws.line_sounds import Scene
from uwtrack_cli.data.lines import Lines

FRAMES, STRAYS = 240, 20


def draw(seed: int) -> tuple[Scene, np.ndarray]:
    """Return a scene and the ship of each of its lines, -1 for a stray one."""
    rng = np.random.default_rng([771, seed])
    frequency_hz: list[float] = []
    ship: list[int] = []
    for one in (0, 1):
        spacing = float(np.exp(rng.uniform(np.log(6.0), np.log(40.0))))
        n_teeth = int(rng.integers(8, 15))
        first = int(rng.integers(100 // spacing + 1, 1750 // spacing - n_teeth))
        teeth = spacing * (first + np.arange(n_teeth))
        frequency_hz += teeth.tolist()
        ship += [one] * n_teeth
    frequency_hz += rng.uniform(100.0, 1750.0, STRAYS).tolist()
    ship += [-1] * STRAYS
    course = np.repeat(np.array(frequency_hz)[:, None], FRAMES, axis=1)
    return Scene(course, rng.uniform(8.0, 16.0, len(ship))), np.array(ship)


def count(scene: Scene, ship: np.ndarray, lines: Lines) -> np.ndarray:
    """Return teeth, teeth told right, lines in families, and those told right."""
    true_hz = scene.frequency_hz[:, 0]
    told: list[tuple[int, int]] = []
    for line, family in zip(lines.line_id, lines.line_family, strict=True):
        apart = np.abs(true_hz - np.median(lines.frequency_hz[lines.line == line]))
        nearest = int(np.argmin(apart)) if apart.min() < 1.0 else -1
        if family >= 0:
            told.append((int(family), nearest))
    main = {
        family: Counter(
            int(ship[k]) if k >= 0 else -1 for own, k in told if own == family
        ).most_common(1)[0][0]
        for family in {own for own, _ in told}
    }
    right = [(own, k) for own, k in told if k >= 0 and ship[k] == main[own] >= 0]
    found = 0
    for one in (0, 1):
        teeth = Counter(own for own, k in set(right) if ship[k] == one)
        found += max(teeth.values(), default=0)
    return np.array([np.count_nonzero(ship >= 0), found, len(told), len(right)])
