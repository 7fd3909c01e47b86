"""Process noise and width of every line, found from its own innovations.

**Method.** The innovations of a filter whose noises are right are white and have the
variance that it expects. A process noise that is too small leaves them correlated from
one frame to the next, one that is too large turns the correlation around; so its
logarithm follows the product of neighbouring innovations. What is left of a variance
that is too large, and not correlated, is the width of the line: a real machine's ridge
scatters by more than its height promises. Each peak counts by the probability that it
is the line's own.

**Conventions.** Innovations are in deviations. The process noise stays between a share
of the machine's own drift and that of a vessel nearby; a line begins with the drift of
its machine alone. `studies/constants/lines.py` tries other gains.

**References.** Mehra (1970), IEEE Trans. Automatic Control 15, 175-184 (correlation of
the innovations); Myers & Tapley (1976), IEEE Trans. Automatic Control 21, 520-523
(variance of the measurements).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.lines.tracker_options import ProcessNoise
from uwtrack_cli.lines.tracking.track_store import TrackStore

STEADY_SHARE = 1e-3
"""Least process noise of a line over the usual drift of a machine."""

RISE = 3.0
"""Gain of a correlation beyond one deviation: a line that bends must not be lost."""

GREATEST_WIDTH = 100.0
"""Greatest variance of a line's peaks over what their heights promise."""

WIDTH_SHARE = 0.25
"""Gain of the width over that of the process noise."""

FARTHEST = 4.0
"""Bound of squares and products of innovations: a stray peak must not decide."""

BOUNDED_MEAN = 0.94
"""Mean of the square of a unit Gaussian that is bounded there."""


def adapt_noise(
    store: TrackStore,
    slots: IntArray,
    innovation: FloatArray,
    probability: FloatArray,
    motion: ProcessNoise,
    window_s: float,
) -> None:
    """Let process noise and width of some lines follow their innovations.

    Parameters
    ----------
    store
        The lines.
    slots
        Lines that have a peak in this frame.
    innovation
        Their innovations of frequency in deviations, shape (line,).
    probability
        Probability that the peak is the line's own, shape (line,).
    motion
        Limits and pace of the process noise.
    window_s
        Length of the frames in s.
    """
    product = innovation * store.last_innovation[slots]
    product = np.minimum(np.maximum(product, -FARTHEST), FARTHEST)
    store.innovation[slots] = innovation
    pace = motion.adaptation * probability
    push = product + (RISE - 1.0) * np.maximum(product - 1.0, 0.0)
    own = motion.own_density(window_s)
    greatest = motion.frequency_density(store.frequency_hz[slots], window_s)
    density = store.noise_density[0, slots] * np.exp(pace * push)
    density = np.minimum(np.maximum(density, STEADY_SHARE * own), greatest)
    store.noise_density[0, slots] = density
    surplus = np.minimum(innovation**2, FARTHEST) - BOUNDED_MEAN
    surplus -= product  # a variance that is correlated is motion
    width = store.width[slots] * np.exp(WIDTH_SHARE * pace * surplus)
    store.width[slots] = np.minimum(np.maximum(width, 1.0), GREATEST_WIDTH)
