"""How well fringes tell the depth of a source whose range is known, by the surface's image.

Draws the passages of `fringe_rates` in power, and prints for each whose image is evident
the depth that its delay, the true range and a sensor's depth known to 0.5 m give, with its
deviation over the truth; at last how many of the 95 % intervals hold:
python -m tests.draws.fringe_depths 7300 7312
"""

import sys
from collections.abc import Callable
from functools import partial

import numpy as np

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import SOUND_MPS, draw_power, fringes_of, scene
from uwtrack_cli.motion.evidence.fringes import fringe_passages


def main(first: int, last: int, say: Callable[[str], None]) -> None:
    """Print depths of draws."""
    held: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for seed in range(first, last):
        for is_deep, told in held.items():
            frequency, power, ship = draw_power(seed, is_deep=is_deep)
            sensor_m = scene(seed, is_deep=is_deep)[2].sensor_m
            rows = fringe_passages(fringes_of(frequency, power), MACH)
            for row in rows[:1]:
                mirror = row.mirror
                if mirror is None or not mirror.is_evident:
                    continue
                known_m = sensor_m + np.random.default_rng(seed).normal(0.0, 0.5)
                depth_m = ship.slant_m(sensor_m) * SOUND_MPS * mirror.delay_s
                depth_m /= 2.0 * known_m
                off = depth_m / ship.depth_m - 1.0
                told.append((off, off / np.hypot(mirror.share, 0.5 / known_m)))
                say(f"{seed} deep={is_deep}: {off:+.3f}, {told[-1][1]:+.2f} deviations")
    for is_deep, told in held.items():
        off = np.abs(np.array(told).reshape(-1, 2))
        say(
            f"deep={is_deep}: evident {len(off)} of {last - first}; within 20 % "
            f"{np.sum(off[:, 0] < 0.2)}; 95 % hold {np.sum(off[:, 1] < 1.96)}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), partial(print, flush=True))
