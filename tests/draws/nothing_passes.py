"""Recordings in which nothing passes, drawn to look like a passage.

Rain and squalls rise and fall as a vessel does, a throttle raises level and lines, a
ship goes away all the time, and machines swing as smoothly as a passage bends a line.
Generators of `moving_sources` and `ship_sounds`.
"""

import numpy as np

from tests.draws.moving_sources import LEAD_S, ambient, arriving, straight
from tests.draws.recordings import Drawn, Passage, sensor_facts
from tests.draws.ship_sounds import cavitation, comb
from tests.draws.vehicle_sounds import coloured, wander

KINDS = ("rain", "throttle", "squall", "leaving ship", "swinging machine")
RATE_HZ, SECONDS = 4000.0, 300.0


def hump(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
    """Draw a rise and a fall in power, 0 to 1, whose flanks differ."""
    middle = rng.uniform(0.25, 0.75) * time_s[-1]
    flanks = rng.uniform(15.0, 70.0, 2)
    lag = (time_s - middle) / flanks[(time_s > middle).astype(int)]
    return np.exp(-(np.abs(lag) ** rng.uniform(1.2, 2.5)))


def draw(kind: str, seed: int) -> Drawn:
    """Draw a recording of one kind."""
    rng = np.random.default_rng([seed, 63, KINDS.index(kind)])
    sensor_kind = ("omni", "difar")[seed % 2]
    n = int(SECONDS * RATE_HZ)
    size = n + int((LEAD_S + 1.0) * RATE_HZ)
    time = np.arange(n) / RATE_HZ
    depth = rng.uniform(12.0, 40.0)
    sound = ambient(rng, n, RATE_HZ, sensor_kind)
    passages = []
    if kind in {"rain", "squall"}:
        # rain falls everywhere above; squalls are wind, low and gusty
        edge = rng.uniform(300.0, 900.0) if kind == "rain" else 20.0
        slope = 0.0 if kind == "rain" else rng.uniform(-6.0, -3.0)
        rise = np.sqrt(hump(rng, time) * 10.0 ** (rng.uniform(6.0, 18.0) / 10.0))
        if kind == "squall":
            rise *= 10.0 ** (rng.uniform(1.0, 3.0) * wander(rng, n, RATE_HZ, 4.0) / 20)
        for channel in range(sound.shape[1]):
            own = rise * coloured(rng, n, RATE_HZ, slope, edge, 0.48 * RATE_HZ)
            sound[:, channel] += own / (np.sqrt(3.0) if channel else 1.0)
    elif kind in {"throttle", "swinging machine"}:
        made = _still(rng, kind, size)
        made = arriving(
            made, straight(0.0, 1e-9, rng.uniform(200.0, 800.0), 0.0, 1.0),
            source_m=3.0, sensor_m=depth, rate=RATE_HZ, seconds=SECONDS, image=0.8,
            kind=sensor_kind,
        )  # fmt: skip
        sound += 10.0 ** (rng.uniform(0.0, 10.0) / 20.0) * made / made[:, 0].std()
    else:
        shaft = rng.uniform(5.0, 12.0)
        made = comb(rng, size, RATE_HZ, shaft_hz=shaft, teeth=int(rng.integers(8, 30)))
        made += rng.uniform(0.3, 1.0) * cavitation(rng, size, RATE_HZ, shaft)
        speed, flat = rng.uniform(4.0, 9.0), rng.uniform(100.0, 500.0)
        began = -rng.uniform(1.5, 4.0) * flat / speed
        path = straight(began, speed, flat, rng.uniform(0.0, 360.0), 1.0)
        heard = arriving(
            made, path, source_m=4.0, sensor_m=depth, rate=RATE_HZ, seconds=SECONDS,
            image=0.8, kind=sensor_kind,
        )  # fmt: skip
        sound += 10.0 ** (rng.uniform(0.0, 8.0) / 20.0) * heard / heard[: n // 4].std()
        slant = float(np.hypot(flat, depth - 4.0))
        passages = [Passage(began, speed, slant, is_due=False)]
    facts = sensor_facts(rng, sensor_kind, depth)
    scaled = 0.9 * sound / np.abs(sound).max()
    return Drawn(RATE_HZ, scaled, tuple(passages), facts)


def _still(rng: np.random.Generator, kind: str, size: int) -> np.ndarray:
    """Draw the sound of a machine that stays where it is."""
    time = np.arange(size) / RATE_HZ
    if kind == "throttle":
        push = np.clip(hump(rng, time) * rng.uniform(0.5, 1.0), 0.0, 1.0)
        factor = 1.0 + rng.uniform(0.1, 0.5) * push
        loud = 10.0 ** (rng.uniform(8.0, 18.0) * push / 20.0)
    else:
        # one half swings by far more, the other by no more than a passage shifts a line
        depth = rng.uniform(0.05, 0.3) if rng.random() < 0.5 else rng.uniform(1e-3, 6e-3)
        swing = np.sin(2 * np.pi * (time / rng.uniform(120.0, 500.0) + rng.random()))
        factor, loud = 1.0 + depth * swing, 1.0
    shaft, teeth = rng.uniform(8.0, 30.0), int(rng.integers(5, 60))
    teeth = int(min(teeth, 0.4 * RATE_HZ / shaft / 1.5))
    made = comb(rng, size, RATE_HZ, shaft_hz=shaft, teeth=teeth, factor=factor)
    return loud * (made + 0.5 * cavitation(rng, size, RATE_HZ, shaft))
