"""Envelopes of sub-bands, each divided by its own running mean, from a stream.

**Method.** Short Hann-windowed transforms are a bank of band-pass filters: the squared
magnitude of a cell over time is the decimated envelope of its sub-band, and a window of
0.8 over the highest rate keeps what is above half of the envelope's own sample rate
below -50 dB, so that nothing folds down. Each cell is divided by its running mean, with
weights that fall off within two seconds to either side: slow changes of level and the colour of the noise go, and a
cell with a strong line weighs no more than any other. Snaps and knocks are cut at a
multiple of the mean. The cells are averaged to a few bands of equal width.

**Conventions.** Everything lies on a grid of sample numbers, so how the sound is read
changes no bit. Envelopes have mean zero; a missing sample is zero, its mean.

**References.** Nielsen, "Sonar Signal Processing" (1991), chapter 3, for the chain;
Clark et al. (2010) and Chung et al. (2011), both as in `demon`, for bands.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.window import hann
from uwtrack_cli.spectra.frame_transform import lost_samples, windowed_spectra

WINDOW_RATES = 0.8
"""Length of a short window times the highest rate wanted: its modulation is received
at 0.77 of its depth, and that of three times the rate not at all."""

HOPS = 4
"""Short windows begin so many times per window length."""

MEAN_S = 2.0
"""Time to either side within which the weights of the running mean fall to zero, s: of
modulation at f Hz the share 1 - sinc(2 f)^2 is left, 0.5 Hz and above whole (a mean
with even weights would lift 0.75 Hz by 1.7 dB above its surroundings)."""

MEAN_STEP_S = 0.1
"""Distance of the instants at which the running mean is taken, s; it is interpolated
between them."""

LARGEST_EXCESS = 6.0
"""Multiple of the mean above which an envelope is cut: snaps and knocks."""


@dataclass(frozen=True)
class EnvelopePlan:
    """How sound becomes envelopes; lengths in samples of the sound."""

    sample_rate_hz: float
    """Sample rate of the sound, Hz."""
    window: int
    """Length of a short window, a multiple of `HOPS`."""
    cells: slice
    """Cells of the short transform within the band."""
    n_bands: int
    """Bands to which the cells are averaged."""

    @property
    def hop(self) -> int:
        """Distance of two short windows."""
        return self.window // HOPS

    @property
    def rate_hz(self) -> float:
        """Sample rate of the envelopes, Hz."""
        return self.sample_rate_hz / self.hop

    @property
    def step(self) -> int:
        """Envelope samples from one value of the running mean to the next."""
        return max(1, round(MEAN_STEP_S * self.rate_hz))

    @property
    def reach(self) -> int:
        """Steps to either side at which the weights of the running mean are zero."""
        return max(1, round(MEAN_S * self.rate_hz / self.step))

    @cached_property
    def groups(self) -> tuple[slice, ...]:
        """Cells of each band, counted from the first one kept."""
        count = self.cells.stop - self.cells.start
        edges = np.linspace(0, count, self.n_bands + 1).round().astype(int)
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges) if b > a)


class BandEnvelopes:
    """Takes blocks of sound, returns the envelopes that are final so far.

    Parameters
    ----------
    plan
        Windows and bands.
    channels
        Channels used: the omni one alone, or omni and two dipoles.
    """

    def __init__(self, plan: EnvelopePlan, channels: tuple[int, ...]) -> None:
        self._plan = plan
        self._channels = list(channels)
        self._sound = np.zeros((0, len(channels)), np.float32)
        n_cells = plan.cells.stop - plan.cells.start
        self._power = np.zeros((0, plan.step, len(channels), n_cells), np.float32)
        self._valid = np.zeros((0, plan.step), np.bool_)
        # steps before those held still count in the running mean
        self._means = np.zeros((0, len(channels), n_cells))
        self._weights = np.zeros(0)
        self._first_held = 0

    def feed(self, samples: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Add sound; return envelopes, shape (time, component, band), and which hold.

        The components are the envelope of the omni channel and, of a vector sensor,
        the active intensities along both dipoles over the same mean.
        """
        self._sound = np.concatenate([self._sound, samples[:, self._channels]])
        plan = self._plan
        hop, step = plan.hop, plan.step
        n_windows = (self._sound.shape[0] - plan.window) // hop + 1
        n_steps = max(0, n_windows) // step
        if n_steps:
            self._add(n_steps * step)
            self._sound = self._sound[n_steps * step * hop :]
        ready = self._means.shape[0] - plan.reach - 1
        return self._normalised(ready - self._first_held)

    def finish(self) -> tuple[FloatArray, BoolArray]:
        """Return the last envelopes; an incomplete step of the mean is left out."""
        return self._normalised(self._means.shape[0] - self._first_held)

    def _add(self, n_windows: int) -> None:
        """Transform whole steps, and note their means."""
        plan = self._plan
        used = self._sound[: (n_windows - 1) * plan.hop + plan.window]
        is_valid = lost_samples(used, plan.window, plan.hop, n_windows) == 0
        power = self._transformed(np.nan_to_num(used), n_windows)
        shape = (-1, plan.step)
        steps = power.reshape(*shape, *power.shape[1:])
        valid = is_valid.reshape(shape)
        weight = valid.sum(axis=1)
        steps[~valid] = 0.0
        sums = steps.astype(np.float64).sum(axis=1)
        self._means = np.concatenate([self._means, sums])
        self._weights = np.concatenate([self._weights, weight])
        self._power = np.concatenate([self._power, steps])
        self._valid = np.concatenate([self._valid, valid])

    def _transformed(self, sound: FloatArray, n_windows: int) -> FloatArray:
        """Return power and intensities, shape (window, component, cell), float32."""
        parts = [self._spectra(sound[:, k], n_windows) for k in range(sound.shape[1])]
        n_cells = self._plan.cells.stop - self._plan.cells.start
        out = np.empty((n_windows, len(parts), n_cells), np.float32)
        for (rows, omni), *dipoles in zip(*parts, strict=True):
            for k, other in enumerate([omni, *(d[1] for d in dipoles)]):
                out[rows, k] = omni.real * other.real + omni.imag * other.imag
        return out

    def _spectra(
        self, channel: FloatArray, n_windows: int
    ) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
        from scipy.fft import next_fast_len

        plan = self._plan
        window = np.asarray(hann(plan.window), np.float32)
        length = next_fast_len(plan.window, real=True)
        for rows, spectrum in windowed_spectra(channel, window, plan.hop, length, n_windows):
            yield rows, spectrum[:, plan.cells]

    def _normalised(self, n_ready: int) -> tuple[FloatArray, BoolArray]:
        """Divide the first steps held by the running mean and average to bands."""
        plan = self._plan
        n_ready = max(0, n_ready)
        width = len(plan.groups)
        if n_ready == 0:
            empty = np.zeros((0, len(self._channels), width), np.float32)
            return empty, np.zeros(0, np.bool_)
        means = self._running_means(n_ready)
        power, valid = self._power[:n_ready], self._valid[:n_ready]
        level = np.maximum(means[:, :, :1], 1e-37)  # of the omni channel
        excess = (power - means) / level
        # what exceeds the limit is cut, and the intensities with it
        over = excess[:, :, :1] + 1.0
        excess *= np.minimum(1.0, LARGEST_EXCESS / np.maximum(over, 1e-9))
        excess[~valid] = 0.0
        out = np.stack([excess[..., g].mean(axis=-1) for g in plan.groups], axis=-1)
        self._power, self._valid = self._power[n_ready:], self._valid[n_ready:]
        self._first_held += n_ready
        passed = max(0, self._first_held - plan.reach - 1)
        self._means, self._weights = self._means[passed:], self._weights[passed:]
        self._first_held -= passed
        flat = out.reshape(-1, *out.shape[2:]).astype(np.float32)
        return flat, valid.reshape(-1)

    def _running_means(self, n_ready: int) -> FloatArray:
        """Mean of the power about each envelope sample, as `_power` has its axes."""
        plan = self._plan
        first, reach = self._first_held, plan.reach
        numbers = np.clip(np.arange(first - 1, first + n_ready + 1), 0, self._means.shape[0] - 1)
        fall = 1.0 - np.abs(np.arange(-reach, reach + 1)) / reach
        centre = np.empty((numbers.size, *self._means.shape[1:]))
        for k, number in enumerate(numbers):  # ten a second; each with its own ends
            near = slice(max(0, number - reach), number + reach + 1)
            sums = self._means[near]
            weight = fall[near.start - number + reach :][: sums.shape[0]]
            count = float((weight * self._weights[near]).sum())
            centre[k] = (weight[:, None, None] * sums).sum(axis=0) / max(count, 1e-9)
        place = (np.arange(plan.step) + 0.5) / plan.step - 0.5
        earlier, middle, later = centre[:-2], centre[1:-1], centre[2:]
        share = np.abs(place)[:, None, None]
        before = middle[:, None] + share * (earlier - middle)[:, None]
        after = middle[:, None] + share * (later - middle)[:, None]
        is_before = (place < 0.0)[:, None, None]
        means: FloatArray = np.where(is_before, before, after)
        return means
