"""By how much R/v is too long in water with a bottom, and how well the pattern tells one.

Draws passages of `fringe_sounds` in deep and shallow water, 8 dB below the sea, and takes
R/v as it is fitted before anything is said of a bottom. Of draws in shallow water whose pattern has a rest beside one comb, prints by
how much the logarithm of R/v is long: the mean (`CHANNEL_LONGER`), and the deviation of
which 95 % are within 1.96 (`CHANNEL_WIDTH`). It is half the square of what the bottom's
images are deeper by, over the range, and so has a long tail of near vessels; neither range
nor depth of the water is known to fringes. Prints besides the share of errors of R/v within
1.96 deviations after both are allowed for, with their median (0.67 is exact). Its numbers
are the first seed and the one after the last:
python -m studies.constants.fringe_water 9000 9050
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import draw_power, fringes_of, scene
from uwtrack_cli.motion.evidence import fringes


@dataclass(frozen=True)
class Told:
    """A passage as it was fitted."""

    is_deep: bool
    alone: float
    """Evidence that nothing is beside one comb, nepers."""
    longer: float
    """By how much the logarithm of R/v is too long before a bottom is allowed for."""
    error: float
    """What it is off by after that, in deviations."""


def drawn(first: int, last: int) -> Iterator[Told]:
    """Yield the passages that are found in deep and shallow water."""
    for seed in range(first, last):
        for is_deep in (True, False):
            frequency, power, ship = draw_power(seed, is_deep=is_deep)
            width_s = ship.slant_m(scene(seed, is_deep=is_deep)[2].sensor_m)
            width_s /= ship.speed_mps
            with patch.object(fringes, "in_water", lambda one: one):
                rows = fringes.fringe_passages(fringes_of(frequency, power), MACH)
            for row in rows[:1]:
                after = fringes.in_water(row)
                off_s = after.passage.width_s - width_s
                yield Told(
                    is_deep, row.mirror.alone,
                    float(np.log(row.passage.width_s / width_s)),
                    float(off_s / np.sqrt(after.covariance[1, 1])),
                )  # fmt: skip


def main(first: int, last: int) -> None:
    """Print the constants, and what errors are by them."""
    told = []
    for one in drawn(first, last):
        told.append(one)
        print(one, flush=True)
    off = np.array([o.longer for o in told if not o.is_deep and o.alone < 0.0])
    longer = float(off.mean())
    std = float(np.quantile(np.abs(off - longer), 0.95)) / 1.96
    print(f"CHANNEL_LONGER {longer:.3f}, CHANNEL_WIDTH {std:.3f}")
    for is_deep in (True, False):
        size = np.array([abs(one.error) for one in told if one.is_deep == is_deep])
        print(
            f"deep={is_deep}: {np.sum(size < 1.96)} of {size.size} hold, "
            f"median {np.median(size):.2f}, largest {size.max():.1f}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
