"""Where the gains of `moving_lines` come from: drawn lines of machines and of vessels.

Draws tables of ten minutes with two to five lines each, known to 0.01 to 1 Hz, in frames
of a second: lines in white noise whose levels fade, pieces of such lines, a machine whose
speed wanders (rough, 1e-4 to 1e-3 within 5 to 60 s) while its levels fade or swell
together, and vessels that pass (2 to 13 m/s, d/v of 3 to 40 s) with jitter of 1e-5 to
1e-4. Prints

* how many candidates an hour gain more than each height without a vessel, and how many
  vessels do at their own place (`LEAST_GAIN`);
* what a line gains by the best speed, at a place of its own without a vessel and at that
  of a vessel that passes, by its frequency (`LINE_COST`) and by its level (`STEADIER`).

Its numbers are tables of each kind and the first seed; one takes a fifth of a second:
python -m studies.constants.moving_lines 60 220000
"""

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.draws.passage_truth import Scene
from tests.motion.crowded_sound import drift
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.motion.passage import moving_lines
from uwtrack_cli.motion.passage.moving_lines import (
    APART,
    CELL,
    LEAST_GAIN,
    LINE_COST,
    SPEEDS_MPS,
    STEADIER,
    _gains,
    _measured,
    lines_together,
)

SOUND_MPS, LENGTH_S = 1500.0, 600.0
KINDS = ("noise", "pieces", "machine", "swelling machine", "vessel")
HEIGHTS = (6.0, 9.0, LEAST_GAIN, 15.0, 20.0, 30.0)
LOWEST = 4.0
"""Gain from which candidates are counted."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99)


def scene_of(rng: np.random.Generator) -> Scene:
    """Draw a vessel that passes well within the table."""
    speed, width = rng.uniform(2.0, 13.0), np.exp(rng.uniform(*np.log([3.0, 40.0])))
    rest = rng.uniform(15.0, 60.0) * np.arange(1, 1 + rng.integers(2, 6))
    return Scene(
        speed_mps=speed, range_m=max(speed * width, 20.0), rest_hz=tuple(rest),
        closest_s=rng.uniform(0.3, 0.7) * LENGTH_S, length_s=LENGTH_S,
    )  # fmt: skip


def drawn(kind: str, rng: np.random.Generator) -> tuple[Lines, Scene]:
    """Draw a table, and the vessel that passes or whose lines these would be."""
    scene = scene_of(rng)
    lines = lines_of_scenes([scene], rng, has_bearing=False)
    time, rest = np.unique(lines.time_s), np.array(scene.rest_hz)[lines.line - 1]
    size, std_hz = lines.time_s.size, np.exp(rng.uniform(*np.log([0.01, 1.0])))

    def common(size_of: float, memory_s: float) -> FloatArray:
        course = size_of * drift(rng, time, memory_s)
        return np.asarray(np.interp(lines.time_s, time, course))

    fading = np.concatenate([1.5 * drift(rng, time, rng.uniform(2.0, 20.0)) for _ in lines.line_id])
    order = np.argsort(np.argsort(lines.line, kind="stable"), kind="stable")
    level, frequency = fading[order] + 94.0, rest.copy()
    if kind == "vessel":
        jitter = common(10 ** rng.uniform(-5.0, -4.0), rng.uniform(5.0, 60.0))
        frequency = lines.measured_frequency_hz * (1 + jitter)
        level = level - 94.0 + lines.measured_level_db
    elif "machine" in kind:
        frequency *= 1 + common(10 ** rng.uniform(-4.0, -3.0), rng.uniform(5.0, 60.0))
        level += common(3.0 * (kind != "machine"), rng.uniform(10.0, 60.0))
    frequency = frequency + std_hz * rng.standard_normal(size)
    heard = np.ones(size, np.bool_)
    if kind == "pieces":
        for number in lines.line_id:
            begin, lasts = rng.uniform(0.0, LENGTH_S), rng.uniform(20.0, 200.0)
            own = (lines.time_s > begin) & (lines.time_s < begin + lasts)
            heard &= (lines.line != number) | own
    return replace(
        lines,
        measured_frequency_hz=np.where(heard, frequency, np.nan),
        measured_frequency_std_hz=np.full(size, std_hz),
        measured_level_db=level,
        measured_snr_db=level - level.max() + rng.uniform(10.0, 30.0),
    ), scene


def line_gains(lines: Lines, scene: Scene) -> Iterator[tuple[float, float]]:
    """Yield what each line gains at a place by frequency, by the best speed, and level."""
    width_s = scene.range_m / scene.speed_mps
    heard_s = scene.closest_s + scene.range_m / SOUND_MPS
    span_s = heard_s - 0.5 * CELL * width_s, heard_s + 0.5 * CELL * width_s
    points = np.flatnonzero(np.isfinite(lines.measured_frequency_hz))
    measured = _measured(lines, points)
    mach = SPEEDS_MPS / SOUND_MPS
    both = _gains(measured, width_s, span_s, mach).max(axis=1)
    silent = measured._replace(level=np.full_like(measured.level, np.nan))
    shifts = _gains(silent, width_s, span_s, mach).max(axis=1)
    best = np.argmax(shifts, axis=1)
    for line, speed in enumerate(best.tolist()):
        own = float(shifts[line, speed])
        yield own, float(both[line, speed]) - own if own > 0.0 else np.nan


def told(name: str, values: list[float], limit: float) -> str:
    """Tell quantiles, and the share above a limit."""
    known = np.array(values)[np.isfinite(values)]
    if not known.size:
        return f"{name}: none gains\n"
    words = ", ".join(f"{value:.1f}" for value in np.quantile(known, QUANTILES))
    share = 100 * np.mean(known > limit)
    return f"{name}, at {', '.join(f'{100 * q:g}' for q in QUANTILES)} %: {words}; {share:.0f} % above {limit:g}\n"


def main(count: int, seed: int) -> None:
    """Print the gains of so many tables of each kind."""
    out = sys.stdout
    moving_lines.LEAST_GAIN, moving_lines.STEADIER = LOWEST, STEADIER
    hours = count * LENGTH_S / 3600.0
    single: dict[str, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    out.write("| kind | " + " | ".join(f"above {h:g}" for h in HEIGHTS) + " |\n")
    out.write("|---" * (1 + len(HEIGHTS)) + "|\n")
    for number, kind in enumerate(KINDS):
        gains: list[float] = []
        for one in range(seed, seed + count):
            lines, scene = drawn(kind, np.random.default_rng([one, number]))
            found = lines_together(lines, SOUND_MPS)
            if kind == "vessel":
                width_s = scene.range_m / scene.speed_mps
                at_s = scene.closest_s + scene.range_m / SOUND_MPS
                found = [
                    item for item in found
                    if abs(item.time_s - at_s) < APART * max(width_s, item.width_s)
                ]  # fmt: skip
                gains.append(max((item.gain for item in found), default=0.0))
            else:
                gains += [item.gain for item in found]
            moving_lines.STEADIER = np.inf
            single[kind] += line_gains(lines, scene)
            moving_lines.STEADIER = STEADIER
        above = [int(np.count_nonzero(np.array(gains) > h)) for h in HEIGHTS]
        words = [
            f"{n} of {count}" if kind == "vessel" else f"{n / hours:.1f} an hour" for n in above
        ]
        out.write(f"| {kind} | " + " | ".join(words) + " |\n")
        out.flush()
    out.write("\n")
    for kind, pairs in single.items():
        shifts, levels = (list(map(float, part)) for part in zip(*pairs, strict=True))
        out.write(told(f"{kind}, frequency of a line", shifts, LINE_COST))
        out.write(told(f"{kind}, its level", levels, -STEADIER))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
