"""What all readings of a passage cost over the straight one alone, in CPU time.

Each drawn passage is analysed twice; without readings neither changes are tried nor
passages sought beside them, and what stays is not read. Two of each kind take a minute:
python -m tests.motion.reading_cost 2 960001
"""

import sys
import time
import warnings
from unittest.mock import patch

import numpy as np

from tests.motion.drawn_readings import KINDS, analyse, draw
from uwtrack_cli.motion.passage import candidates
from uwtrack_cli.motion.passage.readings.competing_readings import STRAIGHT_READING


def seconds(drawn):
    """Return the CPU time of an analysis, s."""
    begin = time.process_time()
    analyse(drawn)
    return time.process_time() - begin


def straight_alone(drawn):
    """Return the CPU time of an analysis that reads nothing else, s."""
    with (
        patch.object(
            candidates, "read_passage", lambda fit, *_: (fit, STRAIGHT_READING)
        ),
        patch.object(candidates, "may_hide_passage", lambda *_: False),
        patch.object(candidates, "read_still", lambda *_: STRAIGHT_READING),
    ):
        return seconds(drawn)


def main(count, first):
    """Print the ratio of both, for every kind and for all."""
    warnings.simplefilter("ignore")
    seconds(draw("straight", first))
    total = np.zeros(2)
    for kind in KINDS:
        drawn = [draw(kind, first + k) for k in range(count)]
        both = np.array([(seconds(one), straight_alone(one)) for one in drawn]).sum(0)
        total += both
        sys.stdout.write(f"{kind}: {both[0] / both[1]:.1f} times\n")
    sys.stdout.write(f"all: {total[0] / total[1]:.2f} times\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
