"""CPU time of a case beside a fixed reference, and its peak memory.

The reference is some numpy work of a fixed size, measured in the same process just
before: what the machine does besides slows both. Peak memory is that of the process,
which is forked for each case. Both are shown and stored, and never compared.
"""

import resource
import sys
import time

import numpy as np

REFERENCE_FFTS, REFERENCE_LOOPS = 24, 6000


def reference_s() -> float:
    """Return the CPU time of the reference: transforms, and many small array calls."""
    rng = np.random.default_rng(0)
    wide, small = rng.standard_normal(1 << 17), rng.standard_normal((6, 6))
    begin = time.process_time()
    for _ in range(REFERENCE_FFTS):
        wide = np.fft.irfft(np.fft.rfft(wide), wide.size)
    for _ in range(REFERENCE_LOOPS):
        small = np.linalg.solve(small @ small.T + np.eye(6), small)
    return time.process_time() - begin


def peak_mb() -> float:
    """Return the peak memory of this process."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)
