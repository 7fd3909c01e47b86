"""Reduce the sample rate of a stream, block by block, without an edge in it.

**Method.** A linear-phase low pass (Kaiser window, 80 dB, pass band to 0.8 of the new
Nyquist frequency) whose output is taken at every d-th sample. The delay of the filter
is removed, so times do not move.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

PASS_SHARE = 0.8
"""Share of the new Nyquist frequency that passes unharmed."""


class Decimator:
    """Takes blocks of shape (sample, channel), returns the thinned samples so far."""

    def __init__(self, factor: int) -> None:
        self._factor = factor
        self._taps = _low_pass(factor)
        self._half = self._taps.size // 2
        self._kept: FloatArray | None = None

    def feed(self, samples: FloatArray) -> FloatArray:
        """Add a block of samples and return what can be computed from it."""
        if self._factor == 1:
            return samples
        if self._kept is None:
            self._kept = np.zeros((self._half, samples.shape[1]), np.float32)
        self._kept = np.concatenate([self._kept, samples])
        n_out = (self._kept.shape[0] - self._taps.size) // self._factor + 1
        if n_out <= 0:
            return samples[:0]
        out = self._filtered(n_out)
        self._kept = self._kept[n_out * self._factor :]
        return out

    def finish(self, n_channels: int) -> FloatArray:
        """Return the last samples, with silence after the end."""
        tail = np.zeros((self._half, n_channels), np.float32)
        return self.feed(tail)

    def _filtered(self, n_out: int) -> FloatArray:
        assert self._kept is not None  # noqa: S101 - feed has filled it
        view = np.lib.stride_tricks.sliding_window_view(
            self._kept, self._taps.size, axis=0
        )[: n_out * self._factor : self._factor]
        # not a matrix product: its rounding depends on the number of rows
        filtered: FloatArray = np.multiply(view, self._taps).sum(axis=-1)
        return filtered


def _low_pass(factor: int) -> FloatArray:
    if factor == 1:
        return np.ones(1, np.float32)
    from scipy.signal import firwin, kaiserord

    transition = 2.0 * (1.0 - PASS_SHARE) / factor
    length, beta = kaiserord(80.0, transition / 2.0)
    length |= 1
    cutoff = (PASS_SHARE + 1.0) / 2.0 / factor
    taps = firwin(length, cutoff, window=("kaiser", beta))
    return np.asarray(taps, np.float32)
