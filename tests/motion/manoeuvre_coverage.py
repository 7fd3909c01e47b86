"""How often the state now holds of a target that changed its velocity half way.

The table in tests/baselines/manoeuvres.md is made by (records of each case, first seed):
python -m tests.motion.manoeuvre_coverage 12 100
"""

import sys
import warnings

import numpy as np

from tests.motion.nuisance_coverage import interval
from tests.motion.test_target_manoeuvre import (
    error_now,
    motions_of,
    state_at_the_end,
    turning,
)

SCENARIO = "S1-T1"
CHANGES = ((10.0, 0.0), (30.0, 0.0), (90.0, 0.0), (0.0, 1.0), (0.0, 4.0))
"""Turns in degrees and changes of speed in knots; the target goes 8 kn."""

QUANTITIES = ("range", "bearing", "speed", "course")


def main(count, first):
    """Print a row for each noise and change, and one of all."""
    warnings.simplefilter("ignore")
    head = (
        "noise", "turn deg", "faster kn", "records", "told", "state given",
        *QUANTITIES, "95 % of all four", "beyond 5",
    )  # fmt: skip
    sys.stdout.write("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|\n")
    every = []
    for noise in (1.0, 5.0):
        for change in CHANGES:
            told, found = 0, []
            for seed in range(first, first + count):
                motions = motions_of(
                    turning(SCENARIO, *change, noise, seed), SCENARIO
                )  # fmt: skip
                if motions.reading[0] != "manoeuvre":
                    continue
                told += 1
                off = error_now(motions, state_at_the_end(SCENARIO, *change))
                if np.isfinite(off).all():
                    found.append(off)
            every += found
            _write(found, f"{noise:g}", *(f"{x:g}" for x in change), count, told)
    _write(every, "all", "", "", 2 * len(CHANGES) * count, "")


def _write(found, *cells):
    off = np.abs(np.reshape(found, (-1, 4)))
    inside = off < 1.96
    low, high = interval(int(inside.sum()), inside.size) if inside.size else (0, 1)
    cells = [*map(str, cells), str(len(off))]
    cells += [f"{share:.0%}" for share in inside.mean(0)] if len(off) else ["-"] * 4
    cells += [f"{low:.0%} to {high:.0%}", str(int((off > 5).sum()))]
    sys.stdout.write("| " + " | ".join(cells) + " |\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
