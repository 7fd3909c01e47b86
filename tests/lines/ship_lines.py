"""Lines of the real ships against a long-average spectrum: what is missed and invented.

The reference uses nothing of the program: `scipy.signal.welch` in frames of 1 s over the
whole recording, its level over a running median, and the gamma law of an average of
exponential cells. A line of the reference stands above what noise gives once in ten
recordings; one of `track` or `trace` is invented when the average over its own time
does not stand out within 1 Hz of it at a chance of 1 %.
"""

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import welch
from scipy.stats import gamma

BAND_HZ = (10.0, 2000.0)
NEAR_HZ = 1.0
FALSE_PER_RECORDING, INVENTED_CHANCE = 0.1, 0.01
SHIPS = ("kennicott_31", "nave_orbit_10", "ruby_princess_5")


def average(samples: np.ndarray, rate: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, power over the running median, and independent averages."""
    frequency, power = welch(samples, rate, nperseg=rate, noverlap=rate // 2)
    ratio = power / median_filter(power, 33)
    # half-overlapped Hann frames hardly repeat each other (Welch 1967: correlation 1/36)
    frames = max(2 * samples.size // rate - 1, 1)
    independent = max(frames / (1.0 + 2.0 / 36.0), 1.0)
    inside = (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])
    return frequency[inside], ratio[inside], independent


def least_ratio(chance: float, independent: float) -> float:
    """Ratio to the median that an average of noise exceeds by this chance."""
    law = gamma(independent)
    return float(law.isf(chance) / law.median())


def reference(samples: np.ndarray, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and decibels over the median of the lines of the long average."""
    frequency, ratio, independent = average(samples, rate)
    limit = least_ratio(FALSE_PER_RECORDING / frequency.size, independent)
    top = (ratio[1:-1] >= ratio[:-2]) & (ratio[1:-1] > ratio[2:]) & (ratio[1:-1] > limit)
    at = np.flatnonzero(top) + 1
    return frequency[at], 10.0 * np.log10(ratio[at])
