"""How often fringes tell a passage, how well, and how often where nothing passes.

Draws two passages of `fringe_sounds` for each seed in power, one in deep and one in
shallow water, and two recordings of the kinds of `nothing_passes.KINDS` by turns, made
again in the band of fringes; prints each row, and at last what was found of those whose
bound says that they can be, what was false, and how many of the 95 % intervals hold. The
constants of `motion/evidence/fringes.py` were set by the seeds from 1 to 6, 100 to 105, 300 to 311 and 700 to 702:
python -m tests.draws.fringe_rates 100 106
"""

import sys
from collections.abc import Callable
from functools import partial

import numpy as np

from tests.draws.fringe_sounds import (
    LEAD_S,
    RATE_HZ,
    SOUND_MPS,
    Source,
    expected,
    fringes_of,
    images,
    noisy,
    scene,
    time_bound_s,
)
from tests.draws.nothing_passes import KINDS, hump
from tests.draws.vehicle_sounds import wander
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.motion.evidence.fringes import FringePassage, fringe_passages

MACH = (5.5 / 1500.0, 3.5 / 1500.0)
DUE = 0.05
"""Bound of the time over R/v below which a passage is due to be found."""
WINDOW_S = 0.5
HOP_S = 0.5 * WINDOW_S


def draw_nothing(kind: str, seed: int) -> Fringes:
    """Draw an image of sound in which nothing passes."""
    rng = np.random.default_rng([seed, 4911, KINDS.index(kind)])
    seconds = float(rng.uniform(300.0, 600.0))
    time = (np.arange(int(seconds / HOP_S) - 1) + 1) * HOP_S
    frequency = np.arange(1, int(0.44 * RATE_HZ * WINDOW_S)) / WINDOW_S
    slope_db = rng.uniform(-5.0, -2.0)
    sea = (frequency / 1e3) ** (slope_db / 3.01)
    swing_db = rng.uniform(0.0, 1.5) * wander(rng, time.size, 1.0 / HOP_S, 20.0)
    density = sea * 10.0 ** (swing_db / 10.0)[:, None]
    if kind in {"rain", "squall"}:
        density = density + _weather(rng, kind, time, frequency) * sea.min()
    elif kind == "leaving ship":
        density = density + _leaving(rng, time, frequency, slope_db) * sea.sum()
    else:
        density = density + _machine(rng, kind, time, frequency)
    return fringes_of(frequency, noisy(rng, density))


def _weather(
    rng: np.random.Generator, kind: str, time: np.ndarray, frequency: np.ndarray
) -> np.ndarray:
    edge_hz = rng.uniform(300.0, 900.0) if kind == "rain" else 20.0
    slope_db = 0.0 if kind == "rain" else rng.uniform(-6.0, -3.0)
    shape = (frequency / 1e3) ** (slope_db / 3.01) / (1.0 + (edge_hz / frequency) ** 8)
    rise = hump(rng, time) * 10.0 ** (rng.uniform(16.0, 28.0) / 10.0)
    if kind == "squall":
        gusts = rng.uniform(1.0, 3.0) * wander(rng, time.size, 1.0 / HOP_S, 4.0)
        rise = rise * 10.0 ** (gusts / 10.0)
    return rise[:, None] * shape


def _machine(
    rng: np.random.Generator, kind: str, time: np.ndarray, frequency: np.ndarray
) -> np.ndarray:
    """Draw a machine that stays, its hiss with the fringes of where it is."""
    away_m, sensor_m = rng.uniform(200.0, 800.0), rng.uniform(12.0, 40.0)
    longer = np.hypot(away_m, sensor_m + 3.0) - np.hypot(away_m, sensor_m - 3.0)
    fringes = 1.64 - 1.6 * np.cos(2.0 * np.pi * frequency * longer / SOUND_MPS)
    hiss = (frequency / 1e3) ** (rng.uniform(-6.0, -2.0) / 3.01) * fringes
    if kind == "throttle":
        push = np.clip(hump(rng, time) * rng.uniform(0.5, 1.0), 0.0, 1.0)
        factor = 1.0 + rng.uniform(0.1, 0.5) * push
        loud = 10.0 ** (rng.uniform(8.0, 18.0) * push / 10.0)
    else:
        large = rng.random() < 0.5
        depth = rng.uniform(0.05, 0.3) if large else rng.uniform(1e-3, 6e-3)
        turns = time / rng.uniform(120.0, 500.0) + rng.random()
        factor, loud = 1.0 + depth * np.sin(2.0 * np.pi * turns), np.ones(time.size)
    level = 10.0 ** (rng.uniform(-10.0, 8.0) / 10.0)
    density = 0.3 * level * loud[:, None] * hiss
    shaft_hz, teeth = rng.uniform(8.0, 30.0), int(rng.integers(5, 60))
    step_hz = frequency[1] - frequency[0]
    for tooth in range(1, teeth + 1):
        line_hz = tooth * shaft_hz * factor
        own = np.interp(tooth * shaft_hz, frequency, hiss)
        power = level * loud * own * 10.0 ** (rng.uniform(5.0, 25.0) / 10.0)
        nearest = np.rint(line_hz / step_hz).astype(int) - 1
        for bins in (-1, 0, 1):
            cell = nearest + bins
            rows = np.flatnonzero((cell >= 0) & (cell < frequency.size))
            off = ((cell + 1) * step_hz - line_hz)[rows] / step_hz
            share = np.sinc(off) / (1.0 - np.where(np.abs(off**2 - 1) < 1e-6, 0, off) ** 2)
            density[rows, cell[rows]] += power[rows] * share**2
    return density


def _leaving(
    rng: np.random.Generator, time: np.ndarray, frequency: np.ndarray, slope_db: float
) -> np.ndarray:
    """Draw a ship whose closest approach was one and a half to four R/v before."""
    speed, flat_m = rng.uniform(4.0, 9.0), rng.uniform(100.0, 500.0)
    began_s = -rng.uniform(1.5, 4.0) * flat_m / speed
    ship = Source(began_s, speed, flat_m, 4.0, 0.8)
    sensor_m = rng.uniform(12.0, 40.0)
    water_m = None if rng.random() < 0.5 else sensor_m + rng.uniform(11.0, 40.0)
    emitted = np.arange(-LEAD_S, time[-1] + LEAD_S, 0.05)
    flat = np.hypot(flat_m, speed * (emitted - began_s))
    field = np.zeros((time.size, frequency.size), complex)
    for height, share in images(ship, sensor_m, water_m, 6.0, 2):
        slant = np.hypot(flat, height)
        begun = np.interp(time, emitted + slant / SOUND_MPS, emitted)
        cycles = frequency * (time - begun)[:, None]
        gain = share / np.interp(begun, emitted, slant)
        field += gain[:, None] * np.exp(-2j * np.pi * cycles)
    power = np.abs(field) ** 2
    power *= (frequency / 1e3) ** ((slope_db + rng.uniform(-1.0, 1.0)) / 3.01)
    loudest = power[: time.size // 4].mean(axis=0).sum()
    return 10.0 ** (rng.uniform(0.0, 8.0) / 10.0) * power / loudest


def main(first: int, last: int, say: Callable[[str], None]) -> None:
    """Print what fringes tell of draws."""
    found, due, false, held, bounds = 0, 0, 0, [], []
    for seed in range(first, last):
        for is_deep in (True, False):
            rng, ship, known = expected(seed, is_deep=is_deep)
            image = fringes_of(known.frequency_hz, noisy(rng, known.sea + known.vessel))
            place = scene(seed, is_deep=is_deep)[2]
            width_s = ship.slant_m(place.sensor_m) / ship.speed_mps
            bound = time_bound_s(ship, known) / width_s
            rows = fringe_passages(image, MACH)
            near = [r for r in rows if abs(r.passage.time_s - ship.time_s) < width_s]
            false += len(rows) - bool(near)
            due += bound < DUE
            found += bool(near) and bound < DUE
            told = "missed"
            for row in near[:1]:
                held.append(_errors(row, ship.time_s, width_s))
                bounds.append(bound)
                told = ", ".join(f"{value:.4f}" for value in held[-1])
            say(f"{seed} deep={is_deep} w={width_s:.0f} bound={bound:.5f}: {told}")
        for kind in (KINDS[2 * seed % 5], KINDS[(2 * seed + 1) % 5]):
            rows = fringe_passages(draw_nothing(kind, seed), MACH)
            false += len(rows)
            for row in rows:
                say(f"{kind} {seed} is false: {row.passage}, {row.log_odds:.1f}")
    table = np.array(held)
    off = np.abs(table[:, 1::2])
    std = np.abs(table[:, 0] / table[:, 1])
    say(
        f"found {found} of {due} due; {len(held)} of {2 * (last - first)} in all; "
        f"false {false}; time within .05 R/v {np.sum(np.abs(table[:, 0]) <= 0.05)}; "
        f"95 % hold {np.sum(off < 1.96, axis=0)} (time, R/v); "
        f"median error over deviation {np.median(off, axis=0)}; largest "
        f"{off.max(axis=0)}; deviation over bound {np.median(std / bounds):.1f}"
    )


def _errors(row: FringePassage, time_s: float, width_s: float) -> tuple[float, ...]:
    """Return errors of time and R/v as shares of R/v, each with that over its deviation."""
    off = row.passage.time_s - time_s, row.passage.width_s - width_s
    std = np.sqrt(np.diag(row.covariance))
    return off[0] / width_s, off[0] / std[0], off[1] / width_s, off[1] / std[1]


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), partial(print, flush=True))
