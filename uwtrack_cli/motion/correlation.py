"""Correlation of measurements: overlapping frames, and coloured noise.

**Method.** A frame's small error is a weighted sum of the noise samples in it; frames
that overlap share samples, which gives their correlation in closed form. Noise of unknown
correlation time (a shaft that does not turn evenly) is met by its long-run variance.

**References.** Newey and West (1987), Econometrica 55, 703 (Bartlett's weights);
Harris (1978), Proc. IEEE 66, 51, eq. 13 (overlap correlation).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

Kind = Literal["frequency", "bearing", "level"]

N_CELLS = 12
"""Cells of time in Bartlett's window."""


def overlap_correlation(kind: Kind, overlap: float) -> FloatArray:
    """Return the correlations of a frame's error with those of the next frames.

    Parameters
    ----------
    kind
        What is measured: the frequency of a line (its error weights the noise by
        time times window), the bearing of a line (window) or a noise level
        (square of the correlation of the window).
    overlap
        Shared part of two neighbouring frames, from 0 to below 1.

    Notes
    -----
    Harris (1978), eq. 13, with the kernels of small errors; Hann window.

    Examples
    --------
    Noise powers of Hann frames that overlap by half are almost independent.

    >>> overlap_correlation("level", 0.5).round(3).tolist()
    [0.028]
    """
    grid = np.linspace(-0.5, 0.5, 2001)
    window = np.cos(np.pi * grid) ** 2
    kernel = window * grid if kind == "frequency" else window
    lags = np.arange(1, int(np.ceil(1 / max(1 - overlap, 1e-3))))
    shifts = np.rint(lags * (1 - overlap) * 2000).astype(int)
    energy = float(kernel @ kernel)
    shared = [float(kernel[s:] @ kernel[: kernel.size - s]) / energy for s in shifts]
    correlation = np.array([value for value in shared if value != 0.0])
    return correlation**2 if kind == "level" else correlation


def long_run_excess(
    residual: FloatArray, precision: FloatArray, time_s: FloatArray, window_s: float | None
) -> FloatArray:
    """Return the variance that coloured noise adds to each measurement, as if white.

    Added to every measurement's own variance, it makes the sums over a passage as
    uncertain as they are, though the noise is not white.

    Parameters
    ----------
    residual
        Residuals, shape (..., n), in order of time.
    precision
        Inverse variances of the residuals if they were white; zero is missing.
    time_s
        Times in seconds, shape (n,).
    window_s
        Length of Bartlett's window in seconds; None looks at single instants.

    Notes
    -----
    With weights a, Q = sum a_i a_j k_ij e_i e_j has the mean sum a_i^2 (V_i + x)
    for white noise V_i plus coloured noise of long-run variance x; k is Bartlett's
    window on cells of a twelfth of its length. Solved for x with a = 1/(V + x),
    three rounds; zero where it is within one deviation of the estimate.
    """
    cells = _Cells.of(time_s, window_s)
    above = cells.quadratic(precision * residual) - precision.sum(axis=-1)
    if not np.any(above > 0):
        return np.zeros(above.shape)
    significant = above > cells.deviation(precision)
    if not significant.any():
        return np.zeros(above.shape)
    value, size = precision * residual, (precision**2).sum(axis=-1)
    for _ in range(2):
        excess = np.where(significant, above / np.maximum(size, 1e-300), 0.0)
        excess = np.maximum(excess, 0.0)
        share = 1 / (1 + precision * excess[..., None])
        weight = precision * share
        size = (weight**2).sum(axis=-1)
        above = cells.quadratic(value * share) - (weight * share).sum(axis=-1)
    excess = np.where(significant, above / np.maximum(size, 1e-300), 0.0)
    return np.maximum(excess, 0.0)


@dataclass(frozen=True)
class _Cells:
    """Cells of time: first measurement and number of each; none is every instant."""

    start: IntArray | None
    """First measurement of each occupied cell; None with every instant a cell."""
    number: IntArray | None
    """Number of each occupied cell in time."""

    @staticmethod
    def of(time_s: FloatArray, window_s: float | None) -> "_Cells":
        """Part the time into cells of a twelfth of Bartlett's window."""
        if window_s is None or time_s.size < 2:
            return _Cells(None, None)
        cell = np.floor((time_s - time_s[0]) * (N_CELLS / window_s)).astype(np.int64)
        start = np.flatnonzero(np.diff(cell, prepend=-1))
        return _Cells(start, cell[start])

    def sums(self, value: FloatArray) -> FloatArray:
        """Add up every cell, with as many empty ones around as the window is long."""
        if self.start is None or self.number is None:
            return value
        full = np.zeros((*value.shape[:-1], int(self.number[-1]) + 1 + 2 * N_CELLS))
        full[..., self.number + N_CELLS] = np.add.reduceat(value, self.start, axis=-1)
        return full

    def quadratic(self, value: FloatArray) -> FloatArray:
        """Sum products under Bartlett's window: mean square of sums of its length."""
        cells = self.sums(value)
        if self.start is None:
            return np.asarray((cells**2).sum(axis=-1))
        run = np.cumsum(cells, axis=-1)
        window = run[..., N_CELLS:] - run[..., :-N_CELLS]
        return np.asarray((window**2).sum(axis=-1) / N_CELLS)

    def deviation(self, share: FloatArray) -> FloatArray:
        """Return the deviation of the quadratic form if the noise were white."""
        cells = self.sums(share)
        if self.start is None:
            return np.asarray(np.sqrt(2 * (cells**2).sum(axis=-1)))
        power = np.abs(np.fft.rfft(cells)) ** 2
        products = np.fft.irfft(power, cells.shape[-1])[..., :N_CELLS]
        taper = 2 * (1 - np.arange(N_CELLS) / N_CELLS) ** 2
        taper[0] = 1.0
        return np.asarray(np.sqrt(2 * np.maximum(products @ taper, 0.0)))
