"""Correlation of measurements: overlapping frames, and noise with a memory.

**Method.** A frame's small error is a weighted sum of the noise samples in it; frames
that overlap share samples, which gives their correlation in closed form. Noise with an
unknown memory (a shaft that does not turn evenly) is met by its long-run variance.

**References.** Newey and West (1987), Econometrica 55, 703 (Bartlett's weights);
Harris (1978), Proc. IEEE 66, 51, eq. 13 (overlap correlation).
"""

from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

Kind = Literal["frequency", "bearing", "level"]


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
    residual: FloatArray,
    precision: FloatArray,
    time_s: FloatArray,
    memory_s: float | None,
) -> FloatArray:
    """Return the variance that slow noise adds to each measurement, as if white.

    Added to every measurement's own variance, it makes the sums over a passage as
    uncertain as they are, though the noise is not white.

    Parameters
    ----------
    residual
        Residuals, shape (batch, n), in order of time.
    precision
        Inverse variances of the residuals if they were white; zero is missing.
    time_s
        Times in seconds, shape (n,).
    memory_s
        Length of Bartlett's window in seconds; None looks at single instants.

    Notes
    -----
    With weights a, Q = sum a_i a_j k_ij e_i e_j has the mean sum a_i^2 (V_i + x)
    for white noise V_i plus slow noise of long-run variance x; k is Bartlett's
    window on bins of a twelfth of its length. Solved for x with a = 1/(V + x),
    four rounds; zero where it is within one deviation of the estimate.
    """
    known = precision > 0
    variance = np.where(known, 1 / np.where(known, precision, 1.0), 1.0)
    starts, taper = _bartlett(time_s, memory_s)
    excess = np.zeros(residual.shape[:-1])
    a = precision
    for _ in range(4):
        quadratic = _quadratic(a * residual, starts, taper)
        share = a**2 * variance
        white = share.sum(axis=-1)
        if not np.any(quadratic > white):
            return np.zeros(white.shape)
        significant = quadratic - white > white * _relative_deviation(
            share, starts, taper
        )
        size = np.maximum((a**2).sum(axis=-1), 1e-300)
        excess = np.where(significant, (quadratic - white) / size, 0.0)
        if not excess.any():
            break
        a = np.where(known, 1 / (variance + excess[..., None]), 0.0)
    return excess


def _bartlett(
    time_s: FloatArray, memory_s: float | None
) -> tuple[IntArray | None, FloatArray | None]:
    """First measurement of every cell of time, and the window between cells."""
    if memory_s is None or time_s.size < 2:
        return None, None
    width = memory_s / 12
    cell = np.floor((time_s - time_s[0]) / width).astype(np.int64)
    filled, cell = np.unique(cell, return_inverse=True)
    starts = np.searchsorted(cell, np.arange(filled.size))
    distance = np.abs(filled[:, None] - filled[None, :])
    return starts, np.maximum(1 - distance / 12, 0.0)


def _quadratic(
    value: FloatArray, starts: IntArray | None, taper: FloatArray | None
) -> FloatArray:
    if starts is None or taper is None:
        single: FloatArray = (value**2).sum(axis=-1)
        return single
    cells = np.add.reduceat(value, starts, axis=-1)
    total: FloatArray = ((cells @ taper) * cells).sum(axis=-1)
    return total


def _relative_deviation(
    share: FloatArray, starts: IntArray | None, taper: FloatArray | None
) -> FloatArray:
    """Relative deviation of the quadratic form if the noise were white."""
    total = np.maximum(share.sum(axis=-1), 1e-300)
    if starts is None or taper is None:
        single: FloatArray = np.sqrt(2 * (share**2).sum(axis=-1)) / total
        return single
    cells = np.add.reduceat(share, starts, axis=-1)
    pairs = ((cells @ taper**2) * cells).sum(axis=-1)
    relative: FloatArray = np.sqrt(2 * pairs) / total
    return relative
