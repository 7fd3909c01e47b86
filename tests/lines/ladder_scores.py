"""Lines of a ladder of frames of a tenth, one and eight seconds, joined to one table.

Three questions, each beside the single rungs: are steady lines heard that are too weak
for a second, are lines that move followed as well as by the rung that hears them best,
and what does joining cost? Steady lines are those of `long_frames`, sweeps and the other
scenes those of `line_scores`; a point counts for the time up to the next frame of its
own length. A line is heard when a tenth of its time is told.

The table in tests/baselines/ladder.md is made by:
python -m tests.lines.ladder_scores 4 700
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from tests.lines.line_scores import SCENES, STEP_S, Scene, Score, score, tracked
from tests.lines.long_frames import N_LINES, SECONDS, steady_lines, told
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.ladder import join_rungs

WINDOWS_S = (0.1, 1.0, 8.0)
LEVELS_DB = {
    "track": (-9.0, -8.0, -7.0, -6.0, -4.0),
    "trace": (-11.0, -10.0, -9.5, -8.0),
}
"""Levels over the noise in 1 Hz, by command."""

USED_S = {"track": WINDOWS_S, "trace": (1.0, 8.0)}
"""Rungs of steady lines: `trace` needs more cells than a tenth of a second has there."""

SWEEPS = tuple(f"sweeps of {bins} bins a frame" for bins in (0.1, 0.5, 1, 2))
OTHERS = (
    "steady at 6 dB",
    "fades of 10 s at 10 dB",
    "stops of 20 s",
    "crossings at 0.05 Hz/s",
    "pairs 1 bins apart",
    "pairs 2 bins apart",
    "jumps of 2 %",
)
"""Scenes beside the sweeps, for `track`."""


@dataclass(frozen=True)
class Spread:
    """Points at every step of a scene that they stand for."""

    line: np.ndarray
    time_s: np.ndarray
    frequency_hz: np.ndarray


def spread(lines: Lines) -> Spread:
    """Let every point stand for the time up to the next frame of its own length."""
    hop_s = lines.point_window_s / lines.overlap_frames
    count = np.maximum(1, np.rint(hop_s / STEP_S).astype(int))
    row = np.repeat(np.arange(count.size), count)
    number = np.arange(row.size) - np.repeat(np.cumsum(count) - count, count)
    off_s = (number - count[row] // 2) * STEP_S
    frequency = lines.frequency_hz[row] + lines.frequency_rate_hzps[row] * off_s
    return Spread(lines.line[row], lines.time_s[row] + off_s, frequency)


def rungs_of(
    scene: Scene,
    seed: int,
    stage: str = "track",
    windows_s: Sequence[float] = WINDOWS_S,
) -> list[Lines]:
    """Follow the lines of a scene in frames of each length."""
    return [tracked(scene, seed, stage, window_s=window_s) for window_s in windows_s]


def doubled_share(lines: Lines) -> float:
    """Share of the told time of all lines that a line of another rung tells again."""
    hop_s = lines.point_window_s / lines.overlap_frames
    again = 0.0
    for name in lines.line_id:
        own = np.flatnonzero(lines.line == name)
        time_s, step_s = lines.time_s[own], hop_s[own]
        other = np.append(step_s[1:] != step_s[:-1], False)
        reach = 0.5 * np.minimum(step_s, np.append(step_s[1:], step_s[-1:]))
        again += float(
            (reach * (other & (np.diff(time_s, append=np.inf) < reach))).sum()
        )
    return again / max(float(hop_s.sum()), 1e-9)


def heard(stage: str, level_db: float, seed: int) -> tuple[int, list[float]]:
    """Return how many steady lines the ladder tells, and CPU seconds of rungs and join."""
    recording, frequency_hz = steady_lines(level_db, seed)
    spent, rungs = [], []
    for window_s in USED_S[stage]:
        begin = time.process_time()
        rungs.append(told(stage, window_s, recording))
        spent.append(time.process_time() - begin)
    begin = time.process_time()
    lines = join_rungs(rungs)
    spent.append(time.process_time() - begin)
    hop_s = lines.point_window_s / lines.overlap_frames
    off = np.abs(lines.frequency_hz - frequency_hz[:, None])
    told_s = ((off < 0.75 / lines.point_window_s) * hop_s).sum(axis=1)
    return int(np.count_nonzero(told_s > 0.1 * SECONDS)), spent


def steady_rows(n_seeds: int, first: int) -> Iterator[str]:
    """Yield the rows of steady lines."""
    n = n_seeds * N_LINES
    for stage, levels in LEVELS_DB.items():
        for level_db in levels:
            made = [heard(stage, level_db, s) for s in range(first, first + n_seeds)]
            count = sum(one for one, _ in made)
            spent = np.sum([cpu for _, cpu in made], axis=0)
            low, high = binomtest(count, n).proportion_ci()
            yield (
                f"| `{stage}` | {level_db:g} | {count} of {n} | {100 * low:.0f} to "
                f"{100 * high:.0f} | {spent.sum() / spent[:-1].sum():.3f} |"
            )


def scene_rows(
    stage: str, names: Sequence[str], n_seeds: int, first: int
) -> Iterator[str]:
    """Yield the rows of scenes: the ladder, and the rung that does best alone."""
    for name in names:
        joined: list[Score] = []
        single: list[list[Score]] = []
        doubled: list[float] = []
        for seed in range(first, first + n_seeds):
            scene = SCENES[name](np.random.default_rng([seed, 7]))
            rungs = rungs_of(scene, seed, stage)
            lines = join_rungs(rungs)
            joined.append(score(scene, spread(lines)))
            single.append([score(scene, spread(one)) for one in rungs])
            doubled.append(doubled_share(lines))
        covers = [
            np.mean([s.cover.mean() for s in own]) for own in zip(*single, strict=True)
        ]
        best = int(np.argmax(covers))
        alone = [own[best] for own in single]
        yield (
            f"| `{stage}` | {name} | {_figures(joined)} | {WINDOWS_S[best]:g} s | "
            f"{_figures(alone)} | {np.mean(doubled):.3f} |"
        )


def _figures(found: Sequence[Score]) -> str:
    cover = np.mean([one.cover.mean() for one in found])
    purity = np.mean([one.purity for one in found])
    ids = np.nanmean([one.ids for one in found])
    return f"{cover:.3f} | {purity:.3f} | {ids:.2f}"


def main(n_seeds: int, first: int) -> None:
    """Print the tables."""
    print("| command | dB in 1 Hz | heard | 95 % | CPU over the sum of the rungs |")
    print("|---|---|---|---|---|")
    for row in steady_rows(n_seeds, first):
        print(row, flush=True)
    print(
        "\n| command | scene | cover | purity | ids | best rung | its cover |", end=""
    )
    print(" its purity | its ids | doubled |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for stage, names in (("track", (*SWEEPS, *OTHERS)), ("trace", SWEEPS)):
        for row in scene_rows(stage, names, n_seeds, first):
            print(row, flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
