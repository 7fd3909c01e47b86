"""The Hann window: bandwidth, correlation of neighbouring cells, interpolation.

**Conventions.** Windows are periodic (DFT-even). A *cell* is one frequency of one
frame; with zero padding ``p`` cells lie 1/p of a natural bin (1/T) apart.

**References.** Harris 1978, "On the use of windows", table 1 (equivalent noise
bandwidth 1.5 bins); Rife & Boorstyn 1974 for the bound of a tone's frequency.
"""

from functools import lru_cache

import numpy as np

from uwtrack_cli.data.base import FloatArray

NOISE_BANDWIDTH_BINS = 1.5
"""Equivalent noise bandwidth of the Hann window in natural bins (Harris 1978)."""

BIN_CORRELATION = 1.944
"""Correlation sum of natural bins, 1 + 2 (4/9 + 1/36)."""


@lru_cache(maxsize=16)
def hann(n_samples: int) -> FloatArray:
    """Return a periodic Hann window of ``n_samples`` samples, read-only."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n_samples) / n_samples)
    window.flags.writeable = False
    return window


def response(offset_bins: FloatArray) -> FloatArray:
    """Return the magnitude of the window's spectrum -2 to 2 natural bins from a tone.

    Notes
    -----
    |W(x)| = sinc(x) / (1 - x^2) (Harris 1978, the transform of the Hann window).
    """
    x = np.where(np.isclose(np.abs(offset_bins), 1.0), 1.0 + 1e-9, offset_bins)
    return np.abs(np.sinc(x) / (1.0 - x**2))


def cell_correlation(lag_bins: float, lag_windows: float) -> float:
    """Return the squared correlation of noise in two cells, bins and windows apart."""
    grid = hann(512)
    shift = round(abs(lag_windows) * grid.size)
    if shift >= grid.size:
        return 0.0
    product = grid[shift:] * grid[: grid.size - shift]
    phase = np.exp(-2j * np.pi * lag_bins * np.arange(product.size) / grid.size)
    return float(np.abs(np.sum(product * phase)) ** 2 / np.sum(grid**2) ** 2)


@lru_cache(maxsize=8)
def _offset_table(step_bins: float) -> tuple[FloatArray, FloatArray]:
    truth = np.linspace(-0.5, 0.5, 401) * step_bins
    left, centre, right = (np.log(response(truth - k * step_bins)) for k in (-1.0, 0.0, 1.0))
    return parabola_offset(left, centre, right), truth


def parabola_offset(left: FloatArray, centre: FloatArray, right: FloatArray) -> FloatArray:
    """Return where a parabola through three neighbours is largest, in their distance."""
    curvature = np.minimum(left + right - 2.0 * centre, -1e-12)
    return np.clip(0.5 * (left - right) / curvature, -0.5, 0.5)


def peak_offset_bins(
    left: FloatArray, centre: FloatArray, right: FloatArray, step_bins: float
) -> FloatArray:
    """Interpolate a tone from the power in three cells, the largest in the middle.

    Returns its offset from that cell in natural bins, which lie ``step_bins`` apart.

    Notes
    -----
    A parabola through the logarithms, whose bias on a pure tone is removed by the
    inverse of its own response to the window (as XQIFFT does by exponents, Werner &
    Germain 2016). Without noise the error is below 1e-5 bins.
    """
    logs = [0.5 * np.log(np.maximum(p, 1e-37)) for p in (left, centre, right)]
    estimate, truth = _offset_table(step_bins)
    return np.interp(parabola_offset(*logs), estimate, truth)


def frequency_std_hz(snr: FloatArray, window_s: float) -> FloatArray:
    """Return the standard deviation of a tone's interpolated frequency.

    SNR is its power over the noise in one cell at its frequency.

    Notes
    -----
    The bound of a rectangular window, sqrt(3 / (2 pi^2 C/N0 T^3)) (Rife & Boorstyn
    1974), times 1.53 for the Hann window, with C/N0 = 1.5 SNR / T; the term in
    1/SNR stands for the noise times noise part, which matters below 10 dB.
    """
    ratio = np.maximum(snr, 1e-3)
    carrier = NOISE_BANDWIDTH_BINS * ratio / window_s
    bound = np.sqrt(3.0 / (2.0 * np.pi**2 * carrier * window_s**3))
    return 1.531 * bound * np.sqrt(1.0 + 1.0 / ratio)
