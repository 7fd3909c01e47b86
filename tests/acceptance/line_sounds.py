"""Part of frequency lines: sensitivity, false lines, ids through fades, families."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.acceptance.outcomes import Outcome, command, run, scored
from tests.acceptance.outcomes import score as score_rows
from tests.draws.line_noises import BAND_HZ, KINDS, false_lines
from tests.draws.line_sounds import SCENES, bursts, score, tracked
from tests.draws.long_lines import N_LINES, lines_heard
from tests.draws.recordings import Drawn
from tests.draws.shaft_sounds import draw as draw_shaft
from tests.draws.ship_families import count as count_families
from tests.draws.ship_families import draw as draw_families
from uwtrack_cli.lines.multi_resolution import join_rungs
from uwtrack_cli.simulate import make_scenario, simulate_recordings

Case = Callable[[Path], Outcome]

STAGES = ("track", "trace")
LEVELS_DB = {"track": (1.0, 1.5, 2.0, 2.5), "trace": (0.0, 0.5, 1.0, 1.5)}
"""Levels of bursts about that at which half of them are followed."""

RUNS = 8
"""Scenes of eight bursts at each level."""

KEEPING = {
    "track": (
        "fades of 10 s at 10 dB", "fades of 20 s at 20 dB", "stops of 20 s",
        "crossings at 0.05 Hz/s", "pairs 2 bins apart", "sweeps of 0.5 bins a frame",
        "sweeps of 2 bins a frame", "jumps of 2 %",
    ),
    "trace": (
        "fades of 10 s at 10 dB", "fades of 20 s at 20 dB", "crossings at 0.05 Hz/s",
        "pairs 2 bins apart", "jumps of 2 %",
    ),
}  # fmt: skip
"""Scenes of which cover, purity and ids are held."""

NOISES = ("white", "6 dB an octave", "swell of 6 dB at 0.11 Hz", "gusts below 200 Hz")
NOISE_HOURS = 0.5
LONG = {("track", 8.0): -7.0, ("trace", 8.0): -10.0}
"""Levels of steady lines of ten minutes, by command and length of frames, s."""


def sensitivity(stage: str, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the bursts that are followed in half of their frames, at each level."""
    counts = {}
    for level in LEVELS_DB[stage]:
        covers = []
        for k in range(RUNS):
            rng = np.random.default_rng([seed, k, int(10 * level)])
            scene = bursts(rng, level)
            covers.append(score(scene, tracked(scene, seed + 1000 * k, stage)).cover)
        heard = np.concatenate(covers) > 0.5
        counts[f"{stage} at {level:g} dB"] = [int(heard.sum()), heard.size]
    share = np.array([hits / of for hits, of in counts.values()])
    half = np.interp(0.5, np.maximum.accumulate(share), LEVELS_DB[stage])
    return {"counts": counts, "scores": {"SNR50 dB": scored(half, "less", 0.3)}}


def keeping(stage: str, name: str, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Score cover, purity and ids of one scene."""
    scene = SCENES[name](np.random.default_rng(seed))
    one = score(scene, tracked(scene, seed, stage))
    found = int((one.cover > 0.5).sum())
    return {
        "scores": {
            "cover": scored(one.cover.mean(), "more", 0.01),
            "purity": scored(one.purity, "more", 0.01),
            "ids a line": scored(one.ids, "less", 0.13),
        },
        "counts": {"ids beyond one a line": [round((one.ids - 1.0) * found), found]},
    }


def noise(name: str, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the false lines of both stages in noise alone; the second number is kHz h."""
    khz_hours = 1e-3 * (BAND_HZ[1] - BAND_HZ[0]) * NOISE_HOURS
    found = false_lines(KINDS[name], NOISE_HOURS, seed)
    return {"counts": {f"false by {k}": [n, khz_hours] for k, n in found.items()}}


def joined(seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Score the lines of a scene in frames of two lengths, joined to one table."""
    scene = SCENES["stops of 20 s"](np.random.default_rng(seed))
    rungs = [tracked(scene, seed, window_s=window_s) for window_s in (1.0, 4.0)]
    lines = join_rungs(rungs)
    one = score(scene, lines)
    return {"scores": {
        "cover": scored(one.cover.mean(), "more", 0.01),
        "purity": scored(one.purity, "more", 0.01),
        "ids a line": scored(one.ids, "less", 0.13),
        "false lines stated": scored(lines.false_lines_per_khz_hour, "same", 1e-9),
    }}  # fmt: skip


def families(stage: str, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count teeth and lines of families of two ships among stray lines."""
    teeth, found, told, right = (0, 0, 0, 0)
    for number in range(seed, seed + 3):
        scene, ship = draw_families(number)
        lines = tracked(scene, number, stage)
        one = count_families(scene, ship, lines)
        teeth, found, told, right = (
            int(a + b) for a, b in zip((teeth, found, told, right), one, strict=True)
        )
    return {"counts": {f"teeth by {stage}": [found, teeth], f"families by {stage}": [right, told]}}


def long_lines(stage: str, window_s: float, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the steady lines of ten minutes that are heard in long frames."""
    level = LONG[stage, window_s]
    heard = sum(lines_heard(stage, window_s, level, seed + k) for k in range(3))
    return {"counts": {f"{stage} at {level:g} dB, {window_s:g} s": [heard, 3 * N_LINES]}}


def shaft(seed: int, folder: Path) -> Outcome:
    """Name the spacing of a slow shaft far off, by the default recipe."""
    table, shaft_hz = draw_shaft(seed)
    (recording,) = simulate_recordings(make_scenario(table))
    assert recording.reader is not None
    sound = np.concatenate(list(recording.reader(1 << 18)))
    path = folder / "shaft.wav"
    Drawn(recording.sample_rate_hz, sound).write(path)
    rows, _ = run(path)
    told = json.loads(command("show", path.with_suffix(".run.h5"), "presence", "--format", "json"))
    named = [one for one in told if abs((one["spacing_hz"] or 0.0) - shaft_hz) < 0.02]
    return {**score_rows(rows, ()), "counts": {"shafts named": [int(bool(named)), 1]}}


def cases(seed: int) -> dict[str, Case]:
    """Return all cases of lines."""
    made: dict[str, Case] = {}
    for stage in STAGES:
        made[f"sensitivity of {stage}"] = partial(sensitivity, stage, seed)
        made[f"families of {stage}"] = partial(families, stage, seed)
        for name in KEEPING[stage]:
            made[f"{stage}: {name}"] = partial(keeping, stage, name, seed)
    made["two lengths of frames joined"] = partial(joined, seed)
    for number, name in enumerate(NOISES):
        made[f"noise: {name}"] = partial(noise, name, seed + number)
    for stage, window_s in LONG:
        made[f"long lines of {stage}"] = partial(long_lines, stage, window_s, seed)
    for number in range(seed, seed + 4):
        made[f"shaft {number}"] = partial(shaft, number)
    return made
