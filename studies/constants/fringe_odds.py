"""How much better a passage explains fringes than its rivals do: `PRIOR_LOG_ODDS`.

Draws the passages of `fringe_sounds` in deep and shallow water and the recordings of
`fringe_rates` in which nothing passes, and prints for each the log odds of the likeliest
passage without that prior; at last the lowest of passages and the highest of recordings
without one, in order, between which the prior lies. Passages whose strongest rival is one
outside the recording are left out, since its prior is not asked. Its numbers are the first
seed and the one after the last:
python -m studies.constants.fringe_odds 9000 9030
"""

import sys

import numpy as np

from tests.draws.fringe_rates import MACH, draw_nothing
from tests.draws.fringe_sounds import draw_power, fringes_of
from tests.draws.nothing_passes import KINDS
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.motion.evidence import fringes

SHOWN = 6
"""Log odds that are printed of each."""


def log_odds(image: Fringes) -> float:
    """Return the log odds of the likeliest passage without the prior; nan without one."""
    one = fringes.likeliest_fit(fringes.FringeEvidence(image, MACH))
    if one is None or one.rival == fringes.OUTSIDE_ALONE:
        return float("nan")
    return one.log_odds - fringes.PRIOR_LOG_ODDS


def main(first: int, last: int) -> None:
    """Print the log odds of draws."""
    passing, nothing = [], []
    for seed in range(first, last):
        for is_deep in (True, False):
            frequency, power, _ = draw_power(seed, is_deep=is_deep)
            passing.append(log_odds(fringes_of(frequency, power)))
            print(f"{seed} deep={is_deep}: {passing[-1]:.1f}", flush=True)
        for kind in (KINDS[2 * seed % 5], KINDS[(2 * seed + 1) % 5]):
            nothing.append(log_odds(draw_nothing(kind, seed)))
            print(f"{seed} {kind}: {nothing[-1]:.1f}", flush=True)
    low, high = (np.sort(each) for each in (passing, nothing))
    high = high[np.isfinite(high)]
    print(f"passages, lowest {low[:SHOWN]}; without one, highest {high[-SHOWN:]}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
