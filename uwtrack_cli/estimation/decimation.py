"""Reduce the sample rate of sound, block by block, without an edge in it.

**Method.** Halvings, one after the other, and one more step for what is odd in the
factor. Each is a linear-phase low pass of polyphase form that is zero at every multiple of
its ratio. The last one, a sinc under a Kaiser window, passes `PASS_SHARE` of the new
Nyquist frequency. Those before it need only keep clear the narrow band that is left in the
end: each stops its image alone, by zeros at Chebyshev's places in it, and has two to four
pairs of taps. What folds into the pass band is 80 dB down or more; between its end and the
new Nyquist frequency sound folds, and nothing there is to be used. Delays are removed, so
times do not move. A sample that is lost (nan) takes along those that are made of it.

**Conventions.** Sample k of the result lies at sample k times the factor of the sound, and
there are as many as whole factors; silence lies before the first sample and after the
last one. Products are added one tap after the other, never by a matrix product, whose rounding
depends on the number of rows: the size of the blocks changes no bit.

**References.** Crochiere & Rabiner, Multirate Digital Signal Processing (1983), sections
4.3 (half-band filters) and 5.1 (several steps); Kaiser (1974) for length and window; Rivlin
(1974), The Chebyshev Polynomials, for the zeros.
"""

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Reader, Recording, Samples

PASS_SHARE = 0.8
"""Share of the new Nyquist frequency that passes unharmed."""

STOPPED_DB = 86.0
"""Attenuation that the filters are designed for, dB."""

LEAST_RATE_HZ = 10_000.0
"""Rate below which a spectrum is no longer what costs, so that sound is left as it is."""

STRIP_VALUES = 1 << 15
"""Values that are filtered at once: they stay in the cache."""

STRETCH_VALUES = 1 << 20
"""Values (samples times channels) of a stretch that are read at once."""


def usual_decimation(
    rate_hz: float, highest_hz: float | None, least_rate_hz: float = LEAST_RATE_HZ
) -> int:
    """Return the factor, a power of two, by which a sample rate can be reduced.

    ``highest_hz``: highest frequency that is used; None for all. ``least_rate_hz``: rate
    below which it is not reduced.

    Examples
    --------
    >>> [usual_decimation(rate_hz, 4000.0) for rate_hz in (4e3, 44.1e3, 96e3, 576e3)]
    [1, 4, 8, 32]
    """
    factor = 1
    if highest_hz is None:
        return factor
    needed_hz = max(2.0 * highest_hz / PASS_SHARE, least_rate_hz)
    while rate_hz / (2 * factor) >= needed_hz:
        factor *= 2
    return factor


class Decimator:
    """Takes blocks of shape (sample, channel), returns the samples of lower rate so far.

    Parameters
    ----------
    factor
        Ratio of the rates, 1 or more.
    """

    def __init__(self, factor: int) -> None:
        self._factor = factor
        self._steps = [_Step(*each) for each in _steps(factor)]
        self._n_taken = self._n_given = 0

    def feed(self, samples: Samples) -> Samples:
        """Add a block of samples and return what can be computed from it."""
        self._n_taken += samples.shape[0]
        for step in self._steps:
            samples = step.feed(samples)
        self._n_given += samples.shape[0]
        return samples

    def finish(self, n_channels: int) -> Samples:
        """Return the last samples, with silence after the end."""
        wanted = self._n_taken // self._factor - self._n_given
        parts = [np.zeros((0, n_channels), np.float32)]
        while sum(len(part) for part in parts) < wanted:
            silence = np.zeros((self._factor, n_channels), np.float32)
            for step in self._steps:
                silence = step.feed(silence)
            parts.append(silence)
        return np.concatenate(parts)[:wanted]


class _Step:
    """One reduction by a prime or odd ratio.

    ``taps``: of its low pass, from the middle one on.
    """

    def __init__(self, ratio: int, taps: tuple[np.float32, ...]) -> None:
        self._ratio = ratio
        self._steps = (len(taps) - 1) // ratio + 1
        """Results on either side whose time the filter reaches."""
        self._middle = taps[0]
        self._taps = [(k, tap) for k, tap in enumerate(taps) if k and tap]
        self._kept: Samples | None = None

    def feed(self, samples: Samples) -> Samples:
        ratio, reach = self._ratio, self._steps
        if self._kept is None:
            self._kept = np.zeros((ratio * reach, samples.shape[1]), np.float32)
        sound = np.concatenate([self._kept, samples])
        count = max(0, (sound.shape[0] - 1) // ratio - 2 * reach + 1)
        self._kept = sound[count * ratio :]
        made = np.empty((count, samples.shape[1]), np.float32)
        if count:
            phases = self._phases(sound, count)
            strip = max(1, STRIP_VALUES // samples.shape[1])
            for first in range(0, count, strip):
                self._filter(phases, made, first, min(first + strip, count))
        return made

    def _phases(self, sound: Samples, count: int) -> list[Samples]:
        """Return every so many-th sample, from each of the first ones on."""
        last = self._ratio * (count + 2 * self._steps - 1) + 1
        return [
            np.ascontiguousarray(sound[phase : last : self._ratio]) for phase in range(self._ratio)
        ]

    def _filter(self, phases: list[Samples], made: Samples, first: int, stop: int) -> None:
        """Make the results from one on to another."""

        def shifted(k: int) -> Samples:
            lag, phase = divmod(k, self._ratio)
            return phases[phase][first + self._steps + lag : stop + self._steps + lag]

        out = np.multiply(shifted(0), self._middle, out=made[first:stop])
        pair = np.empty_like(out)
        for k, tap in self._taps:
            np.add(shifted(-k), shifted(k), out=pair)
            np.multiply(pair, tap, out=pair)
            np.add(out, pair, out=out)


@cache
def _steps(factor: int) -> tuple[tuple[int, tuple[np.float32, ...]], ...]:
    """Return ratio and low pass of each step of a reduction."""
    found = []
    while factor % 2 == 0 and factor > 2:
        factor //= 2
        found.append((2, _half_band(PASS_SHARE / factor)))
    if factor > 1:
        found.append((factor, _low_pass(factor)))
    return tuple(found)


def _half_band(share: float) -> tuple[np.float32, ...]:
    """Return a half-band filter that keeps a share of the new Nyquist frequency clear.

    Its image is the band of the same width below the old one; pass band and image err
    alike (Crochiere & Rabiner).
    """
    edge = 0.5 * np.pi * share
    for count in range(2, 9):
        odd = 2 * np.arange(count) + 1
        zeros = np.pi - edge * np.cos(odd * np.pi / (4 * count))
        half = np.linalg.solve(2.0 * np.cos(np.outer(zeros, odd)), np.full(count, -0.5))
        image = np.pi - edge * np.linspace(0.0, 1.0, 500)
        left = np.abs(0.5 + 2.0 * np.cos(np.outer(image, odd)) @ half).max()
        if left < 10.0 ** (-STOPPED_DB / 20.0):
            break
    taps = np.zeros(2 * count)
    taps[0], taps[1::2] = 0.5, half
    return tuple((taps / (2.0 * taps.sum() - taps[0])).astype(np.float32))


def _low_pass(ratio: int) -> tuple[np.float32, ...]:
    """Return a low pass that keeps `PASS_SHARE` of the new Nyquist frequency clear."""
    transition = 2.0 * np.pi * (1.0 - PASS_SHARE) / ratio
    half = int(np.ceil((STOPPED_DB - 7.95) / (2.285 * transition) / 2.0))
    beta = 0.1102 * (STOPPED_DB - 8.7)
    place = np.arange(half + 1)
    taps = np.sinc(place / ratio) * np.i0(beta * np.sqrt(1.0 - (place / half) ** 2))
    taps[ratio::ratio] = 0.0
    taps /= 2.0 * taps.sum() - taps[0]
    return tuple(taps.astype(np.float32))


def decimated_blocks(reader: Reader, factor: int, block_samples: int) -> Iterator[Samples]:
    """Yield the sound of a reader at a lower rate, in blocks of any length.

    ``block_samples``: samples that are read at once, before the rate is reduced. A reader
    that shares its sound with others may reduce the rate itself: it has a method
    ``decimated(factor)``, which returns the reader of the lower rate.
    """
    if factor == 1:
        yield from reader(block_samples)
        return
    shared = getattr(reader, "decimated", None)
    if shared is not None:
        yield from shared(factor)(max(1, block_samples // factor))
        return
    decimator, samples = Decimator(factor), None
    for samples in reader(block_samples):
        yield decimator.feed(samples)
    if samples is not None:
        yield decimator.finish(samples.shape[1])


class DecimatedStretch(NamedTuple):
    """A stretch of a recording's first channel at a lower rate."""

    blocks: Iterator[FloatArray]
    """Consecutive samples, shape (n,), read when they are asked for."""
    rate_hz: float
    """Samples per second."""
    start_s: float
    """Time of the first sample in the recording, s."""


def decimated_stretch(
    recording: Recording, start_s: float, stop_s: float, factor: int
) -> DecimatedStretch:
    """Return a stretch of a recording at a lower rate.

    Silence lies outside of the stretch, and where sound is lost; what its first part shows of an
    offset is taken off, so that nothing jumps there. `DataError` is raised with the
    first block if the sound is not at hand.
    """
    rate_hz = recording.sample_rate_hz
    first = factor * max(0, int(np.ceil(start_s * rate_hz / factor)))
    last = min(round(stop_s * rate_hz), recording.n_samples)
    blocks = _stretch_blocks(recording, first, last, factor)
    return DecimatedStretch(blocks, rate_hz / factor, first / rate_hz)


def _stretch_blocks(
    recording: Recording, first: int, last: int, factor: int
) -> Iterator[FloatArray]:
    rate_hz = recording.sample_rate_hz
    step = max(1, STRETCH_VALUES // recording.n_channels)
    decimator, offset = Decimator(factor), None
    for begin in range(first, last, step):
        stop = min(begin + step, last)
        sound = recording.segment(begin / rate_hz, stop / rate_hz)[:, :1]
        if offset is None:
            known = sound[np.isfinite(sound)]
            offset = np.float32(known.mean(dtype=np.float64) if known.size else 0.0)
        yield decimator.feed(np.nan_to_num(sound - offset))[:, 0]
    yield decimator.finish(1)[:, 0]
