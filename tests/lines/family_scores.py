"""Which lines are told as families: two ships and twenty stray lines.

Two minutes of two ships at once, spacings of 6 to 40 Hz, each with 8 to 14 neighbouring
multiples between 100 and 1750 Hz, and 20 lines anywhere there, none of them moving, at 8
to 16 dB over the noise in 1 Hz. *Recall* is the share of the ships' lines told in the
family that most of their ship's lines are in, *precision* the share of the lines in
families that are of the ship of most lines of that family. ``python -m
tests.lines.family_scores 12 0`` prints a row for `track` and one for `trace`.
"""

import sys
from collections import Counter

import numpy as np

from tests.lines.line_scores import BAND_HZ, RATE_HZ, Scene
from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

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


def main(runs: int, seed: int) -> None:
    """Print recall and precision of both stages."""
    total = {"track": np.zeros(4), "trace": np.zeros(4)}
    for one in range(seed, seed + runs):
        scene, ship = draw(one)
        sound = recording_of(scene.sound(np.random.default_rng([772, one])), RATE_HZ)
        blocks = list(compute_spectrogram(sound, band_hz=BAND_HZ))
        for name, made in (
            ("track", track_lines(find_peaks(block) for block in blocks)),
            ("trace", trace_lines(iter(blocks))),
        ):
            total[name] += count(scene, ship, Lines.join(list(made)))
    print("| stage | teeth | recall | lines in families | precision |")
    print("|---|---|---|---|---|")
    for name, (teeth, found, told, right) in total.items():
        print(
            f"| {name} | {teeth:.0f} | {found / teeth:.2f} | {told:.0f} | "
            f"{right / max(told, 1):.2f} |"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
