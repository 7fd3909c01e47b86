"""What slow noise takes from the information of a series.

**Method.** Measurements are averaged over cells much shorter than the passage, and the
covariance of the means is that of white and slow noise. What differs within a cell is
left out: slow noise is rough, so that a slope within a cell tells little, though the
white noise alone would let it look exact. Sums over cells and one small matrix stand
for a matrix as large as the series is long; a short series has a cell per instant.

**Conventions.** One series; zero precision is a missing value; time in seconds.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.passages.slow_noise import SlowNoise

MOST_CELLS = 600
"""Cells of a long series: instants a few times as many lose less than 3 % (a test)."""


@dataclass(frozen=True)
class SlowLoss:
    """The inverse covariance of the white noise less that of white and slow noise.

    ``core`` (cells, cells) is the inverse covariance of the means of the cells, over
    the weights of both; ``starts`` are the first instants of the cells.
    """

    weight: FloatArray
    starts: IntArray
    core: FloatArray

    def times(self, rows: FloatArray) -> FloatArray:
        """Multiply rows by the loss.

        Parameters
        ----------
        rows
            Shape (..., n).

        Returns
        -------
        FloatArray
            Of the same shape.
        """
        weighted = rows * self.weight
        kept = np.add.reduceat(weighted, self.starts, axis=-1) @ self.core
        lengths = np.diff(self.starts, append=self.weight.size)
        return weighted - self.weight * np.repeat(kept, lengths, axis=-1)


def slow_loss(weight: FloatArray, time_s: FloatArray, noise: SlowNoise) -> SlowLoss:
    """Find what slow noise takes from the information of a series.

    Parameters
    ----------
    weight
        Inverse variances of the white part, shape (n,); zero is missing.
    time_s
        Times in seconds.
    noise
        Strength and memory of the slow part.
    """
    used = np.flatnonzero(weight > 0)
    count = min(used.size, MOST_CELLS)
    starts = used[np.linspace(0, used.size, count, endpoint=False).astype(int)]
    starts[:1] = 0
    size = np.add.reduceat(weight, starts)
    time = np.add.reduceat(weight * time_s, starts) / size
    lag = np.abs(time[:, None] - time[None, :])
    kernel = np.zeros_like(lag)
    for variance, memory in zip(noise.variance, noise.memory_s, strict=True):
        kernel += variance * np.exp(-lag / memory)
    root = np.sqrt(size)
    outer = root[:, None] * root[None, :]
    inverse = np.linalg.inv(np.eye(size.size) + outer * kernel)
    return SlowLoss(weight, starts, inverse / (outer * noise.inflation))
