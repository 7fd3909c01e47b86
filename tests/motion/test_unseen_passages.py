"""The passages that are tried though none is seen."""

import numpy as np
from scipy.stats.qmc import Halton

from uwtrack_cli.motion.passage.readings.unseen_passages import PRIMES, radical_inverse


def test_they_are_drawn_by_haltons_sequence():
    wanted = Halton(d=len(PRIMES), scramble=False).random(1001)[1:]
    found = np.transpose([radical_inverse(1000, base) for base in PRIMES])
    assert np.array_equal(found, wanted)
