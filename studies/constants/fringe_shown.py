"""How often a vessel that is far louder than the sea shows a pattern: `MOST_SHOWN`.

Draws the passages of `fringe_sounds` over deep water, 20 dB above the sea at the closest
approach, under surfaces as rough as those of the oceans are: of the reflected sound the
part exp(-2 (k h sin g)^2) is coherent, with the wave number k, the root mean square height
h of the surface and the grazing angle g, and the rest is scattered without a pattern
(Brekhovskikh and Lysanov, Fundamentals of Ocean Acoustics, chapter 9). The significant
height 4 h is log-normal with a median of 2 m and a factor of two, as in Young (1999), Int.
J. Climatol. 19, 931. Sensors are 3 to 100 m deep, as recorders are hung or laid: near the
surface the first dark band lies above what is heard. Prints what is found of them, and how
often. Its numbers are the first seed and the one after the last:
python -m studies.constants.fringe_shown 8000 8040
"""

import sys

import numpy as np

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import RATE_HZ, SOUND_MPS, fringes_of, noisy, scene
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.evidence.fringes import fringe_passages

MEDIAN_M, FACTOR = 2.0, 2.0
"""Significant wave height: its median, and how many times that one deviation is."""

SENSORS_M = (3.0, 100.0)
"""Depths of sensors, whose logarithm is uniform."""

SNR_DB, HOP_S, WINDOW_S = 20.0, 0.25, 0.5


def is_shown(seed: int) -> tuple[float, bool]:
    """Return the significant height of a draw, m, and whether its passage is found."""
    rng, source, place = scene(seed, is_deep=True)
    sensor_m = float(np.exp(rng.uniform(*np.log(SENSORS_M))))
    height_m = MEDIAN_M * FACTOR ** float(rng.standard_normal())
    time = HOP_S * np.arange(1, int(place.seconds / HOP_S))[:, None]
    frequency = np.arange(1, int(0.44 * RATE_HZ * WINDOW_S)) / WINDOW_S
    flat = np.hypot(source.flat_m, source.speed_mps * (time - source.time_s))
    straight_m, image_m = sensor_m - source.depth_m, sensor_m + source.depth_m
    near, far = np.hypot(flat, straight_m), np.hypot(flat, image_m)
    wave = 2.0 * np.pi * frequency / SOUND_MPS
    rough: FloatArray = np.exp(-2.0 * (wave * 0.25 * height_m * image_m / far) ** 2)
    vessel = 1.0 / near**2 + (source.image / far) ** 2
    vessel = vessel - 2.0 * rough * source.image / near / far * np.cos(wave * (far - near))
    vessel *= (frequency / 1e3) ** (place.vessel_slope_db / 3.01)
    sea = (frequency / 1e3) ** (place.sea_slope_db / 3.01)
    nearest = int(np.argmin(flat))
    vessel *= 10.0 ** (SNR_DB / 10.0) * sea.sum() / vessel[nearest].sum()
    rows = fringe_passages(fringes_of(frequency, noisy(rng, sea + vessel)), MACH)
    width_s = source.slant_m(sensor_m) / source.speed_mps
    off_s = [abs(row.passage.time_s - source.time_s) for row in rows]
    return height_m, min(off_s, default=np.inf) < width_s


def main(first: int, last: int) -> None:
    """Print what is found, and how often."""
    shown = []
    for seed in range(first, last):
        height_m, found = is_shown(seed)
        shown.append(found)
        print(f"{seed}: {height_m:.1f} m, {'shown' if found else 'not shown'}", flush=True)
    share, count = np.mean(shown), len(shown)
    print(f"MOST_SHOWN {share:.2f} +- {np.sqrt(share * (1.0 - share) / count):.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
