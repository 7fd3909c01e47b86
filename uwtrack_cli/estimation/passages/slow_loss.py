"""What slow noise takes from the information of a series.

**Method.** Slow noise is taken as constant within the cells in which its strength and
memory were found. Its covariance is then P K P' with one row of P per instant, and
Woodbury's identity gives the inverse of white plus slow noise as
W - W P (K^-1 + P' W P)^-1 P' W: sums over cells, and a matrix as small as the cells
are few, instead of one as large as the series is long.

**Conventions.** One series; zero precision is a missing value; time in seconds.

**References.** Woodbury (1950), Memorandum Report 42, Princeton.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.passages.slow_noise import SlowNoise, cell_starts


@dataclass(frozen=True)
class SlowLoss:
    """The inverse covariance of the white noise less that of white and slow noise.

    ``core`` (cells, cells) is (K^-1 + P' W P)^-1; ``starts`` are the first instants
    of the cells.
    """

    weight: FloatArray
    starts: IntArray
    core: FloatArray
    inflation: float

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
        kept = weighted * (1.0 - 1.0 / self.inflation)
        if not self.starts.size:
            return kept
        shared = np.add.reduceat(weighted, self.starts, axis=-1) @ self.core
        lengths = np.diff(self.starts, append=self.weight.size)
        spread = np.repeat(shared, lengths, axis=-1)
        spread *= self.weight / self.inflation
        spread += kept
        return spread


def slow_loss(
    weight: FloatArray, time_s: FloatArray, noise: SlowNoise, width_s: float
) -> SlowLoss:
    """Find what slow noise takes from the information of a series.

    Parameters
    ----------
    weight
        Inverse variances of the white part, shape (n,); zero is missing.
    time_s
        Times in seconds.
    noise
        Strength and memory of the slow part.
    width_s
        Range over speed in seconds, as when the noise was found.
    """
    if not noise.variance.size:
        empty = np.empty((0, 0))
        return SlowLoss(weight, np.empty(0, np.int64), empty, noise.inflation)
    used = np.flatnonzero(weight > 0)
    starts = used[cell_starts(time_s[used], width_s)]
    starts[0] = 0
    size = np.add.reduceat(weight, starts)
    time = np.add.reduceat(weight * time_s, starts) / size
    lag = np.abs(time[:, None] - time[None, :])
    kernel = np.zeros_like(lag)
    for variance, memory in zip(noise.variance, noise.memory_s, strict=True):
        kernel += variance * np.exp(-lag / memory)
    root = np.sqrt(size)
    outer = root[:, None] * root[None, :]
    unit = np.eye(size.size)
    core = (unit - np.linalg.inv(unit + outer * kernel)) / outer
    return SlowLoss(weight, starts, core, noise.inflation)
