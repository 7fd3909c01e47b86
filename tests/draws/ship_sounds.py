"""Ships as they sound: combs of 40 to 200 teeth, and broadband that the blades modulate.

As in recordings of the North Sea (papers of 2021, SoundTrap): one shaft or engine whose
speed wanders moves all teeth together, each tooth fades by itself, the broadband swells
with blades and shaft, and the surface reflects all of it. Such a recording costs the
program many times what a few tones cost. Generators of `moving_sources`.
"""

import numpy as np

from tests.draws.moving_sources import LEAD_S, ambient, arriving, closest, straight
from tests.draws.recordings import Drawn, sensor_facts
from tests.draws.vehicle_sounds import coloured, wander

RATE_HZ, SECONDS = 4000.0, 180.0


def comb(
    rng: np.random.Generator, n: int, rate: float, *, shaft_hz: float, teeth: int,
    factor: np.ndarray | float = 1.0,
) -> np.ndarray:  # fmt: skip
    """Draw the comb of one machine, unit variance: common wander, each tooth fades.

    ``factor``: what the shaft's speed is multiplied by, a number or shape (n,).
    """
    sway = rng.uniform(2e-4, 1e-3) * wander(rng, n, rate, rng.uniform(10.0, 60.0))
    turns = np.cumsum(shaft_hz * (1.0 + sway) * factor) / rate
    blades = int(rng.integers(3, 6))
    tilt_db = rng.uniform(2.0, 5.0)
    sound = np.zeros(n)
    for number in range(1, teeth + 1):
        if rng.random() < 0.15:
            continue  # real combs have gaps
        level_db = -tilt_db * np.log2(number) / 2.0 + 3.0 * rng.standard_normal()
        level_db += 5.0 * (number % blades == 0)
        fade_db = rng.uniform(1.5, 4.0) * wander(rng, n, rate, rng.uniform(2.0, 20.0))
        wave = np.cos(2.0 * np.pi * (number * turns + rng.random()))
        sound += 10.0 ** ((level_db + fade_db) / 20.0) * wave
    return sound / sound.std()


def cavitation(rng: np.random.Generator, n: int, rate: float, shaft_hz: float) -> np.ndarray:
    """Draw broadband of unit variance that shaft and blades modulate."""
    turns = shaft_hz * np.arange(n) / rate
    blades = int(rng.integers(3, 6))
    depth = rng.uniform(0.1, 0.4)
    swell = 1.0 + depth * np.cos(2 * np.pi * blades * turns)
    swell += 0.5 * depth * np.cos(2 * np.pi * turns + 2 * np.pi * rng.random())
    sound = swell * coloured(rng, n, rate, rng.uniform(-4.0, -2.0), 60.0, 0.45 * rate)
    return sound / sound.std()


def draw(seed: int, n_ships: int = 1, seconds: float = SECONDS) -> Drawn:
    """Draw a recording of ships that pass."""
    rng = np.random.default_rng([seed, 61, n_ships])
    kind = ("omni", "difar")[seed % 2]
    depth = rng.uniform(15.0, 40.0)
    n = int(seconds * RATE_HZ)
    size = n + int((LEAD_S + 1.0) * RATE_HZ)
    sound = ambient(rng, n, RATE_HZ, kind)
    passages = []
    for number in range(n_ships):
        shaft = rng.uniform(5.0, 12.0)
        teeth = int(min(rng.integers(40, 201), 0.45 * RATE_HZ / shaft))
        made = comb(rng, size, RATE_HZ, shaft_hz=shaft, teeth=teeth)
        made += rng.uniform(0.3, 1.0) * cavitation(rng, size, RATE_HZ, shaft)
        flat = float(np.exp(rng.uniform(*np.log([100.0, 400.0]))))
        time = seconds * (rng.uniform(0.35, 0.65) if n_ships == 1 else
                          (0.3, 0.7)[number] + rng.uniform(-0.08, 0.08))  # fmt: skip
        path = straight(
            time, rng.uniform(3.0, 9.0), flat, rng.uniform(0.0, 360.0), rng.choice([-1.0, 1.0])
        )
        source = rng.uniform(2.0, 6.0)
        heard = arriving(
            made, path, source_m=source, sensor_m=depth, rate=RATE_HZ, seconds=seconds,
            image=rng.uniform(0.5, 0.95), kind=kind,
        )  # fmt: skip
        # so loud over the sea that the strongest teeth stand far above it
        loud = 10.0 ** (rng.uniform(2.0, 12.0) / 20.0) * flat
        sound += loud * heard
        passages.append(closest(path, seconds, depth - source))
    facts = sensor_facts(rng, kind, depth)
    return Drawn(RATE_HZ, 0.9 * sound / np.abs(sound).max(), tuple(passages), facts)
