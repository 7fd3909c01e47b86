"""Passages that are not of one straight vessel at one speed, with sound of their own.

Speed and shaft change together by 20 to 40 % over minutes; the course swings by 15
degrees to either side; one line is that of two vessels; the vessel passes overhead.
Generators of `moving_sources`.
"""

import numpy as np

from tests.draws.moving_sources import GRID_S, LEAD_S, Path, ambient, arriving, closest, straight
from tests.draws.recordings import Drawn, sensor_facts
from tests.draws.vehicle_sounds import coloured, wander

KINDS = ("speed and shaft", "s-turn", "shared line", "overhead")
RATE_HZ, SECONDS = 2000.0, 300.0


def along(speed_mps: np.ndarray, course_rad: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Sum up a path from speeds and courses on a grid, shape (2, time)."""
    steps = speed_mps * np.stack([np.sin(course_rad), np.cos(course_rad)])
    way = np.cumsum(steps * (grid[1] - grid[0]), axis=1)
    return way - way[:, [0]]


def past(way: np.ndarray, grid: np.ndarray, at_s: float, range_m: float,
         course_rad: float, turn: float) -> Path:  # fmt: skip
    """Shift a way so that it passes the sensor at a time, at a range, to one side."""
    here = np.array([np.interp(at_s, grid, row) for row in way])
    starboard = np.array([np.cos(course_rad), -np.sin(course_rad)])
    moved = way - here[:, None] - turn * range_m * starboard[:, None]
    return lambda emitted: np.stack([np.interp(emitted, grid, row) for row in moved])


def lines(
    rng: np.random.Generator, rest_hz: list[float], factor: np.ndarray | float, n: int
) -> np.ndarray:
    """Draw lines of one machine with a slight common wander, each of unit amplitude."""
    sway = 1e-4 * wander(rng, n, RATE_HZ, rng.uniform(10.0, 40.0))
    turns = np.cumsum((1.0 + sway) * factor) / RATE_HZ
    return sum(
        10.0 ** (rng.uniform(-6.0, 0.0) / 20.0) * np.cos(2.0 * np.pi * (one * turns + rng.random()))
        for one in rest_hz
    )


def draw(kind: str, seed: int) -> Drawn:
    """Draw a recording of one kind."""
    rng = np.random.default_rng([seed, 62, KINDS.index(kind)])
    sensor_kind = "omni" if kind == "s-turn" else "difar"
    depth = rng.uniform(18.0, 40.0)
    n = int(SECONDS * RATE_HZ)
    size = n + int((LEAD_S + 1.0) * RATE_HZ)
    grid = np.arange(-LEAD_S - 1.0, SECONDS + 1.0, GRID_S)
    clock = np.arange(size) / RATE_HZ - LEAD_S
    sound = ambient(rng, n, RATE_HZ, sensor_kind)
    passages = []
    shared_hz = rng.uniform(90.0, 160.0)
    for number in range(2 if kind == "shared line" else 1):
        speed, at = rng.uniform(3.5, 7.5), SECONDS * rng.uniform(0.42, 0.58)
        flat = float(np.exp(rng.uniform(*np.log([60.0, 250.0]))))
        course, turn = rng.uniform(0.0, 2.0 * np.pi), rng.choice([-1.0, 1.0])
        base = rng.uniform(30.0, 70.0)
        rest, factor, path = [base * k for k in range(2, 7)], 1.0, None
        if kind == "speed and shaft":
            change = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.4)
            lasts, begins = rng.uniform(80.0, 160.0), at - rng.uniform(30.0, 80.0)

            def share(time, change=change, lasts=lasts, begins=begins):
                return 1.0 + change * np.clip((time - begins) / lasts, 0.0, 1.0)

            way = along(speed * share(grid), np.full(grid.size, course), grid)
            path = past(way, grid, at, flat, course, turn)
            factor = share(clock)
        elif kind == "s-turn":
            period = rng.uniform(150.0, 300.0)
            swing = np.radians(15.0) * np.sin(2 * np.pi * (grid / period + rng.random()))
            way = along(np.full(grid.size, speed), course + swing, grid)
            path = past(way, grid, at, flat, course, turn)
        elif kind == "overhead":
            path = straight(at, speed, rng.uniform(0.0, 5.0), np.degrees(course), turn)
        else:
            # an hour of the same generator on two vessels that pass to either side
            rest = [shared_hz, *[base * k for k in range(2, 4)]]
            at = SECONDS * ((0.3, 0.7)[number] + rng.uniform(-0.06, 0.06))
            course, turn = 1.0 + np.pi * 0.55 * number, (-1.0, 1.0)[number]
            path = straight(at, speed, flat, np.degrees(course), turn)
        made = lines(rng, rest, factor, size)
        made += rng.uniform(0.5, 2.0) * coloured(rng, size, RATE_HZ, -3.0, 50.0, 900.0)
        source = rng.uniform(1.0, 6.0)
        heard = arriving(
            made, path, source_m=source, sensor_m=depth, rate=RATE_HZ, seconds=SECONDS,
            image=rng.uniform(0.5, 0.9), kind=sensor_kind,
        )  # fmt: skip
        reach = np.hypot(flat, depth) if kind != "overhead" else depth
        sound += 10.0 ** (rng.uniform(-2.0, 8.0) / 20.0) * reach * heard
        passages.append(closest(path, SECONDS, depth - source))
    facts = sensor_facts(rng, sensor_kind, depth)
    return Drawn(RATE_HZ, 0.9 * sound / np.abs(sound).max(), tuple(passages), facts)
