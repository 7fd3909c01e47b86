"""Passages of seconds sought in the sound itself, in the vessel's own time.

**Method.** A tracker needs lines that stand out frame by frame; a passage of seconds by
weak lines has none, or pieces of them. But time and width of a closest approach and the
speed say how time is stretched: sound emitted at tau is heard at tau + r(tau) / c. The
low band of the recording, made white in time and frequency, is read along this law and
weighted by the inverse range: if the law is true, every line of the vessel, tracked or
not, becomes one cell of one transform as long as the passage, whose power over noise is
a log-likelihood ratio (a matched filter). Where lines rise and fall again in frames of a
second, time, width and speed are searched on a grid and refined.

The same lines are then read as what passes nowhere: tones that stay, with the levels of
the passage or with levels that stay too; the movement with levels that stay; the movement
upside down; a drift of all tones by any slope; a step of any height at some instants. What
the passage gains over the best of these, in nepers and as a share, decides whether it is
taken. What is taken is measured: the frequencies that are left of its lines in its own
time, in frames of d/v, are so fine that a joint fit with all its checks follows.

**Conventions.** Times count from the first sample. Gains in nepers. The low band is that
in which passages of seconds are but few wave lengths long: above it the grid would have
to be finer than is affordable, and lines are tracked.

**References.** Weiss (1994), IEEE Signal Processing Magazine 11, 13 (time-scale
processing); Kay (1998), Fundamentals of Statistical Signal Processing II, section 7.6
(a tone of unknown amplitude, phase and frequency); Rife and Boorstyn (1974), IEEE
Trans. Inf. Theory 20, 591 (deviation of a measured frequency).
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.decimation import decimated_stretch
from uwtrack_cli.estimation.noise_floor import LN2
from uwtrack_cli.motion.passage.model.measurements import PassageData

LEAST_RATE_HZ = 250.0
"""Samples per second of the low band, at least."""

BAND_HZ = (6.0, 100.0)
"""The low band, Hz: where it is filtered evenly at the rate above."""

FRAME_S = 1.0
"""Frames in which the noise is measured and lines rise, s."""

NOISE_CELLS, NOISE_FRAMES = 17, 3
"""Cells and frames whose median is the noise."""

SMALLEST_NOISE = 1e-6
"""Noise of a cell, over that of the median one, that is assumed at least: silence."""

NARROWEST_S, WIDEST_S, WIDTH_RATIO = 1.5, 10.0, 1.6
"""Widths in which lines are looked at for rises, s. Passages that last longer are
tracked."""

LINE_RISE, LEAST_RISE, MOST_LINES = 3.0, 8.0, 8
"""Gain in nepers above which a rise of a line counts, that of all lines from which a
place is searched, and lines that count."""

SOFTENED_RISE, SOFTENED_GAIN = 20.0, 60.0
"""Nepers beyond which rises, and gains of lines, count by their logarithm: one loud
machine would outweigh all lines of a vessel."""

MOST_PLACES = 14
"""Places that are searched in each stretch."""

STRETCH_S = 600.0
"""Length of the stretches that are searched, s."""

REACH = 4.0
"""d/v on either side of the closest approach that are read: where the inverse range
leaves 6 % of the power."""

WIDTHS, TIMES = (0.7, 1.0, 1.4), (-0.8, -0.4, 0.0, 0.4, 0.8)
"""Widths over that of a rise, and times from its middle in widths, that are tried."""

SPEEDS_MPS, SPEEDS_PER_S, FEWEST_SPEEDS, MOST_SPEEDS = (1.2, 14.0), 4.0, 8, 40
"""Smallest and largest speed that are tried, m/s, how many for each second of d/v, and
how many at least and at most."""

FASTEST_MPS, SLOWEST_MPS, SHORTEST_S, LONGEST_S = 20.0, 0.8, 1.0, 20.0
"""Ends of speeds, m/s, and of widths, s, in the refinement."""

ROUNDS, FINER = 7, 0.62
"""Rounds of the refinement, and the ratio of their steps."""

OVERSAMPLED = 4
"""Samples in one of the low band between which the sound is a straight line: it loses 3 %
of the power of its highest tones by that."""

TONE = 9.0
"""Nepers over noise from which a cell is a tone: one in eight thousand of noise is."""

CELL_HZ = 1.0
"""Width of the bands of which each has at most one tone."""

SIDELOBE = 0.05
"""Share of a tone within three such bands below which another is its sidelobe."""

RIVAL_ROUNDS = 4
"""Rounds in which the best drift and the best step are refined."""

LEAST_GAIN = 25.0
"""Softened gain of the tones from which a place of the grid is refined."""

LEAST_EVIDENCE, LEAST_SHARE = 35.0, 0.1
"""Nepers by which the tones of a passage must exceed those of its best rival, and the
logarithm of their ratio. Of 24 drawn recordings of ten minutes without a passage the
largest is 23 nepers."""

FEWEST_TONES = 2
"""Tones that a passage must have: one machine that wanders has a line alike."""

APART = 2.0
"""d/v between two passages: nearer ones are one."""

BLOCK, HOP = 1.0, 0.25
"""Frames in which its lines are measured, and their distance, in d/v."""

NEIGHBOURS = 0.28
"""Correlation of the frequencies of such neighbours: the overlap of the weights of two
regressions of phase on time."""

MOST_TONES = 6
"""Strongest tones that are measured."""

LEAST_POWER = 6.0
"""Nepers over noise that a line must have in a frame to be measured there."""

PADDING = 8
"""Frequencies that are tried in each cell of such a frame."""

Law = tuple[float, float, float]
"""Time of the closest approach, s, slant range over speed, s, and speed, m/s."""


class OwnTime(NamedTuple):
    """A passage that the sound tells."""

    law: Law
    """Time, width and speed."""
    tones_hz: FloatArray
    """Rest frequencies of its lines, Hz, shape (line,)."""
    evidence: float
    """Nepers by which they exceed those of the best rival."""


class LowSound:
    """The low band of a stretch of sound, white in time and frequency.

    Parameters
    ----------
    samples
        Low band, shape (n,).
    rate_hz
        Samples per second.
    start_s
        Time of the first sample in the recording, s.
    sound_speed_mps
        Sound speed, m/s.
    """

    def __init__(
        self, samples: FloatArray, rate_hz: float, start_s: float, sound_speed_mps: float
    ) -> None:
        self.start_s, self.sound_speed_mps = start_s, sound_speed_mps
        self._rate_hz = rate_hz
        self._size = 2 * round(0.5 * FRAME_S * rate_hz)
        frames = self._frames(samples)
        spectrum = np.fft.rfft(frames, axis=1)
        frequency_hz = np.fft.rfftfreq(self._size, 1 / rate_hz)
        self._used = (frequency_hz >= BAND_HZ[0]) & (frequency_hz <= BAND_HZ[1])
        power = np.abs(spectrum) ** 2
        noise = _median_about(power) / LN2
        noise = np.maximum(noise, SMALLEST_NOISE * max(float(np.median(noise)), 1e-30))
        self._power = np.minimum(power / noise, 1e6)[:, self._used]
        white = np.fft.irfft(spectrum / np.sqrt(noise), self._size, axis=1)
        self._noise_db = np.log(noise[:, self._used]).mean(axis=1)
        hop = self._size // 2
        self.frame_s = start_s + hop / rate_hz * np.arange(frames.shape[0])
        sound = self._scaled(self._added(white, samples.size))
        fine = np.fft.irfft(np.fft.rfft(sound), OVERSAMPLED * sound.size)
        self._fine = (OVERSAMPLED * fine).astype(np.float32)
        self.stop_s = start_s + samples.size / rate_hz

    def _frames(self, samples: FloatArray) -> FloatArray:
        """Cut overlapping frames whose windows add up to one."""
        hop = self._size // 2
        count = -(-samples.size // hop) + 1
        padded = np.zeros((count + 1) * hop)
        padded[hop : hop + samples.size] = samples
        window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(self._size) / self._size)
        cut = np.lib.stride_tricks.sliding_window_view(padded, self._size)[::hop]
        return np.asarray(cut * window)

    def _added(self, frames: FloatArray, n_samples: int) -> FloatArray:
        hop = self._size // 2
        total = np.zeros((frames.shape[0] + 1) * hop)
        total[: frames.shape[0] * hop] += frames[:, :hop].ravel()
        total[hop:] += frames[:, hop:].ravel()
        return total[hop : hop + n_samples]

    def _scaled(self, sound: FloatArray) -> FloatArray:
        """Give the noise a power of one in every cell of a transform."""
        size = min(1 << 14, sound.size)
        blocks = sound[: sound.size // size * size].reshape(-1, size)
        power = np.abs(np.fft.rfft(blocks, axis=1)) ** 2 / size
        frequency_hz = np.fft.rfftfreq(size, 1 / self._rate_hz)
        inside = (frequency_hz > BAND_HZ[0]) & (frequency_hz < BAND_HZ[1])
        usual = float(np.median(power[:, inside])) / LN2
        return np.asarray(sound / np.sqrt(max(usual, 1e-30)))

    def rises(self, width_s: float) -> FloatArray:
        """Return what lines gain by rising for so long, softened, shape (frame,)."""
        half = max(1, round(width_s / (0.5 * FRAME_S)))
        count = self._power.shape[0]
        place = np.arange(count)
        total = np.concatenate([np.zeros((1, self._power.shape[1])), self._power.cumsum(axis=0)])

        def mean(first: int, last: int) -> FloatArray:
            low, high = (np.clip(place + k, 0, count) for k in (first, last + 1))
            size = high - low
            known = size >= 0.5 * (last - first + 1)
            ratio = (total[high] - total[low]) / np.maximum(size, 1)[:, None]
            return np.where(known[:, None], ratio, 0.0)

        side = np.maximum(mean(-5 * half, -2 * half - 1), mean(2 * half + 1, 5 * half))
        ratio = np.maximum(mean(-half, half) / np.maximum(side, 1.0), 1.0)
        # neighbouring frames overlap: three have the independent noise of two
        gain = (2 * half + 1) / 1.5 * (ratio - 1.0 - np.log(ratio))
        beside = np.pad(gain, ((0, 0), (1, 1)))
        gain[gain < np.maximum(beside[:, :-2], beside[:, 2:])] = 0.0
        over = np.sort(np.maximum(gain - LINE_RISE, 0.0), axis=1)[:, -MOST_LINES:]
        return np.asarray(SOFTENED_RISE * np.log1p(over / SOFTENED_RISE).sum(axis=1))

    def own_times(self, law: Law) -> FloatArray:
        """Return the instants of the vessel's own time about a passage, s."""
        time_s, width_s, speed = law
        delay_s = 2.0 * width_s * (REACH + 1.0) * speed / self.sound_speed_mps
        first = max(self.start_s, time_s - REACH * width_s)
        last = min(self.stop_s - delay_s, time_s + REACH * width_s)
        count = max(0, int((last - first) * self._rate_hz))
        return first + np.arange(count) / self._rate_hz

    def read(self, heard_s: FloatArray) -> FloatArray:
        """Return the sound at any instants, shape as theirs."""
        place = (heard_s - self.start_s) * (OVERSAMPLED * self._rate_hz)
        np.clip(place, 0.0, self._fine.size - 2.0, out=place)
        first = place.astype(np.int32)
        share = (place - first).astype(np.float32)
        here = self._fine[first]
        return np.asarray(here + share * (self._fine[first + 1] - here))

    def weight(self, own_s: FloatArray) -> FloatArray:
        """Return amplitudes of a steady tone once the noise is made white."""
        log = np.interp(own_s, self.frame_s, self._noise_db)
        return np.asarray(np.exp(-0.5 * (log - log.min())))

    def delays(self, own_s: FloatArray, law: Law, speeds: FloatArray) -> FloatArray:
        """Return the time that sound takes at each speed, s, shape (speed, n)."""
        time_s, width_s, _ = law
        slant_s = width_s * np.hypot(1.0, (own_s - time_s) / width_s)
        return np.asarray(speeds[:, None] * slant_s / self.sound_speed_mps)

    def tones(
        self, own_s: FloatArray, delay_s: FloatArray, amplitude: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the largest power over noise in bands of `CELL_HZ`, and where.

        Parameters
        ----------
        own_s
            Instants of own time, s, shape (n,).
        delay_s
            When they are heard after that, s, shape (reading, n).
        amplitude
            Weights, shape (n,).

        Returns
        -------
        tuple[FloatArray, FloatArray]
            Nepers, and frequencies in Hz, shape (reading, band).
        """
        from scipy.fft import next_fast_len, rfft

        size = next_fast_len(round(1.5 * own_s.size), real=True)
        taken = self.read(own_s + delay_s) * amplitude.astype(np.float32)
        power = np.abs(rfft(taken, size, axis=1)) ** 2 / float((amplitude**2).sum())
        step_hz = self._rate_hz / size
        low, each = round(BAND_HZ[0] / step_hz), max(1, round(CELL_HZ / step_hz))
        count = int((BAND_HZ[1] - BAND_HZ[0]) / (each * step_hz))
        bands = power[:, low : low + count * each].reshape(-1, count, each)
        place = low + each * np.arange(count) + bands.argmax(axis=2)
        return bands.max(axis=2).astype(np.float64), place * step_hz

    def gains(self, law: Law, speeds: FloatArray) -> FloatArray:
        """Return the softened gain of all tones at each speed, shape (speed,).

        Tones that are stronger where nothing moves are another's.
        """
        own_s = self.own_times(law)
        if own_s.size < 2 * self._size:
            return np.zeros(speeds.size)
        amplitude = self.weight(own_s) / np.hypot(1.0, (own_s - law[0]) / law[1])
        moving = np.append(0.0, speeds)
        power, _ = self.tones(own_s, self.delays(own_s, law, moving), amplitude)
        passing = power[1:]
        own = (passing > TONE) & (passing > power[0]) & _is_peak(passing, 1)
        gain = np.where(own, passing - TONE, 0.0)
        return np.asarray(SOFTENED_GAIN * np.log1p(gain / SOFTENED_GAIN).sum(axis=1))


def own_time_passages(
    recording: Recording, sound_speed_mps: float, known: Sequence[tuple[float, float]] = ()
) -> list[OwnTime]:
    """Return the passages of seconds that a recording's sound tells, by time.

    Parameters
    ----------
    recording
        The recording; one whose sound is not at hand, or still coming, has none.
    sound_speed_mps
        Sound speed, m/s.
    known
        Time and d/v of passages that are known, s: none is sought within them.
    """
    # of live sound the end is not known, nor how much is held
    if recording.is_live or not recording.can_be_read_again:
        return []
    if recording.sample_rate_hz < LEAST_RATE_HZ:
        return []
    count = max(1, int(np.ceil(recording.duration_s / STRETCH_S)))
    edges = np.linspace(0.0, recording.duration_s, count + 1).tolist()
    margin_s = 2 * REACH * WIDEST_S
    found: list[OwnTime] = []
    for first_s, last_s in pairwise(edges):
        sound = low_sound(recording, first_s - margin_s, last_s + margin_s, sound_speed_mps)
        if sound is None:
            continue
        told = search(sound, known)
        found += [one for one in told if first_s <= one.law[0] < last_s or count == 1]
    return sorted(found, key=lambda one: one.law[0])


def low_sound(
    recording: Recording, start_s: float, stop_s: float, sound_speed_mps: float
) -> LowSound | None:
    """Return the low band of a stretch; None where its sound is not at hand.

    Parameters
    ----------
    recording
        The recording.
    start_s, stop_s
        Where the stretch begins and ends, s; what lies outside is left out.
    sound_speed_mps
        Sound speed, m/s.
    """
    factor = int(recording.sample_rate_hz // LEAST_RATE_HZ)
    blocks, rate_hz, start_s = decimated_stretch(recording, start_s, stop_s, factor)
    try:
        low = np.concatenate(list(blocks)).astype(np.float64)
    except DataError:
        return None
    if low.size < 2 * REACH * NARROWEST_S * rate_hz or not low.any():
        return None
    return LowSound(low - low.mean(), rate_hz, start_s, sound_speed_mps)


def search(sound: LowSound, known: Sequence[tuple[float, float]] = ()) -> list[OwnTime]:
    """Return the passages of a stretch of sound, the strongest rise first.

    Parameters
    ----------
    sound
        Its low band.
    known
        Time and d/v of passages that are known, s: none is sought within them.
    """
    found: list[OwnTime] = []
    for time_s, width_s in _places(sound):
        if any(abs(time_s - at_s) < max(width_s, wide_s) for at_s, wide_s in known):
            continue
        if any(abs(one.law[0] - time_s) < one.law[1] for one in found):
            continue
        law = _of_grid(sound, time_s, width_s)
        one = judged(sound, refined(sound, law)) if law else None
        if one is not None:
            found.append(one)
    kept: list[OwnTime] = []
    for one in sorted(found, key=lambda one: -one.evidence):
        if all(
            abs(one.law[0] - other.law[0]) > APART * max(one.law[1], other.law[1]) for other in kept
        ):
            kept.append(one)
    return kept


def _places(sound: LowSound) -> list[tuple[float, float]]:
    """Return times and widths at which lines rise and fall again."""
    every: list[tuple[float, float, float]] = []
    width_s = NARROWEST_S
    while width_s <= WIDEST_S:
        height = sound.rises(width_s)
        for _ in range(MOST_PLACES):
            best = int(np.argmax(height))
            if height[best] < LEAST_RISE:
                break
            time_s = float(sound.frame_s[best])
            every.append((float(height[best]), time_s, width_s))
            height[np.abs(sound.frame_s - time_s) < 1.5 * width_s] = 0.0
        width_s *= WIDTH_RATIO
    kept: list[tuple[float, float]] = []
    for _, time_s, width_s in sorted(every, reverse=True):
        if all(
            abs(time_s - other_s) > max(width_s, other)
            or max(width_s / other, other / width_s) > 1.5
            for other_s, other in kept
        ):
            kept.append((time_s, width_s))
    return kept[:MOST_PLACES]


def _of_grid(sound: LowSound, time_s: float, width_s: float) -> Law | None:
    """Return the best law about a rise; None if no tones gain enough."""
    best, law = LEAST_GAIN, None
    for factor in WIDTHS:
        wide_s = factor * width_s
        count = round(np.clip(SPEEDS_PER_S * wide_s, FEWEST_SPEEDS, MOST_SPEEDS))
        speeds = np.geomspace(*SPEEDS_MPS, count)
        for lag in TIMES:
            at_s = time_s + lag * wide_s
            if not sound.start_s <= at_s < sound.stop_s:
                continue
            gain = sound.gains((at_s, wide_s, 0.0), speeds)
            top = int(np.argmax(gain))
            if gain[top] > best:
                best, law = float(gain[top]), (at_s, wide_s, float(speeds[top]))
    return law


def refined(sound: LowSound, law: Law) -> Law:
    """Return the law of most gain near one, by steps along each unknown.

    Parameters
    ----------
    sound
        Low band.
    law
        Where to begin.
    """

    def gain(x: FloatArray) -> float:
        own = (float(x[0]), float(np.exp(x[1])), float(x[2]))
        return float(sound.gains(own, x[2:])[0])

    x = np.array([law[0], np.log(law[1]), law[2]])
    step = np.array([0.25 * law[1], 0.15, 0.15 * law[2] + 0.2])
    least = np.array([sound.start_s, np.log(SHORTEST_S), SLOWEST_MPS])
    most = np.array([sound.stop_s, np.log(LONGEST_S), FASTEST_MPS])
    best = gain(x)
    for _ in range(ROUNDS):
        for axis in range(3):
            for sign in (1.0, -1.0):
                tried = x.copy()
                tried[axis] += sign * step[axis]
                if not least[axis] <= tried[axis] <= most[axis]:
                    continue
                own = gain(tried)
                if own > best:
                    x, best = tried, own
                    break
        step *= FINER
    return float(x[0]), float(np.exp(x[1])), float(x[2])


def judged(sound: LowSound, law: Law) -> OwnTime | None:
    """Return a law with its tones, if they tell it and nothing else.

    Parameters
    ----------
    sound
        Low band.
    law
        Time, width and speed.
    """
    own_s = sound.own_times(law)
    time_s, width_s, speed = law
    u = (own_s - time_s) / width_s
    level = sound.weight(own_s)
    amplitude = level / np.hypot(1.0, u)
    delay_s = sound.delays(own_s, law, np.array([speed]))
    power, tones_hz = (each[0] for each in sound.tones(own_s, delay_s, amplitude))
    own = (power > TONE) & _is_peak(power[None], 1)[0]
    own &= power > SIDELOBE * _largest_about(power[None], 3)[0]
    still = np.zeros((1, own_s.size))
    # tones that are stronger where nothing moves are another's
    for each in (amplitude, level):
        own &= power > sound.tones(own_s, still, each)[0][0]
    if np.count_nonzero(own) < FEWEST_TONES:
        return None

    def rival(delay_s: FloatArray, amplitude: FloatArray) -> FloatArray:
        # a tone of another movement may lie in the next band
        found = _largest_about(sound.tones(own_s, delay_s, amplitude)[0], 1)
        return np.asarray(np.maximum(found[:, own], 1.0).sum(axis=1))

    unit = width_s * speed / sound.sound_speed_mps  # shifts as large as the passage's

    def drift(x: FloatArray) -> FloatArray:
        return np.asarray(unit * x[:, :1] * 0.5 * u**2)

    def step(x: FloatArray) -> FloatArray:
        return np.asarray(unit * x[:, :1] * np.maximum(u - x[:, 1:], 0.0))

    slopes = np.linspace(-1.0, 1.0, 21)[:, None]
    heights, instants = np.meshgrid(np.linspace(-2.5, 2.5, 24), np.linspace(-1.5, 1.5, 7))
    steps = np.stack([heights.ravel(), instants.ravel()], axis=1)
    best = max(
        float(rival(still, amplitude)[0]),
        float(rival(still, level)[0]),
        float(rival(delay_s, level)[0]),
        float(rival(delay_s.max() - delay_s, amplitude)[0]),
        _most(lambda x: rival(drift(x), amplitude), slopes, (0.1,)),
        _most(lambda x: rival(step(x), amplitude), steps, (0.2, 0.5)),
    )
    gain = float(power[own].sum())
    if gain - best < LEAST_EVIDENCE or np.log(gain / best) < LEAST_SHARE:
        return None
    tones = np.flatnonzero(own)
    tones = np.sort(tones[np.argsort(-power[tones])[:MOST_TONES]])
    return OwnTime(law, tones_hz[tones], gain - best)


def _most(
    value: Callable[[FloatArray], FloatArray], grid: FloatArray, step: tuple[float, ...]
) -> float:
    """Return the largest value on a grid that is refined about its best point.

    ``value`` takes points of shape (n, axes), and ``step`` are the grid's.
    """
    found = value(grid)
    best, most = grid[int(np.argmax(found))], float(found.max())
    near = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * len(step)), -1).reshape(-1, len(step))
    size = 0.5 * np.array(step)
    for _ in range(RIVAL_ROUNDS):
        tried = best + near * size
        found = value(tried)
        if found.max() > most:
            best, most = tried[int(np.argmax(found))], float(found.max())
        size = 0.5 * size
    return most


def measured(sound: LowSound, passage: OwnTime) -> PassageData:
    """Measure the lines of a passage in frames of its own time.

    Parameters
    ----------
    sound
        Low band.
    passage
        Its law and rest frequencies.

    Returns
    -------
    PassageData
        Frequencies as they were received, with their deviations, and levels.
    """
    time_s, width_s, speed = passage.law
    own_s = sound.own_times(passage.law)
    delay_s = sound.delays(own_s, passage.law, np.array([speed]))[0]
    taken, amplitude = sound.read(own_s + delay_s), sound.weight(own_s)
    u = (own_s - time_s) / width_s
    middles = np.arange(np.ceil(u[0] / HOP), np.floor(u[-1] / HOP) + 1) * HOP
    middles = middles[(middles - 0.5 * BLOCK >= u[0]) & (middles + 0.5 * BLOCK <= u[-1])]
    frequency, deviation, level = np.full((3, passage.tones_hz.size, middles.size), np.nan)
    mach = speed / sound.sound_speed_mps
    for column, middle in enumerate(middles):
        here = np.abs(u - middle) <= 0.5 * BLOCK
        noise_db = 20.0 * np.log10(float(amplitude[here].mean()))
        for row, tone_hz in enumerate(passage.tones_hz):
            off_hz, power = _peak(taken[here], own_s[here], tone_hz, BLOCK * width_s)
            if power < LEAST_POWER:
                continue
            # what is left is added to the law at the middle of the frame
            shift = 1.0 + mach * middle / np.hypot(1.0, middle)
            frequency[row, column] = (tone_hz + off_hz) / shift
            # Rife and Boorstyn (1974), eq. 13
            spread_hz = np.sqrt(6.0 / power) / (2 * np.pi * BLOCK * width_s)
            deviation[row, column] = spread_hz
            level[row, column] = 10.0 * np.log10(power - 1.0) - noise_db
    slant_s = width_s * np.hypot(1.0, middles)
    when = time_s + width_s * middles + mach * slant_s
    none = np.full((0, when.size), np.nan)
    nothing = np.full((1, when.size), np.nan)
    return PassageData(
        when, frequency, deviation, none, none, nothing, nothing,
        frequency_correlation=NEIGHBOURS, line_level_db=level,
    )  # fmt: skip


def _peak(
    sound: FloatArray, own_s: FloatArray, tone_hz: float, length_s: float
) -> tuple[float, float]:
    """Return how far a tone is from its frequency, Hz, and its power over noise."""
    off_hz = np.linspace(-1.0, 1.0, 2 * PADDING + 1) / length_s
    turn = np.exp(-2j * np.pi * np.outer(tone_hz + off_hz, own_s - own_s[0]))
    power = np.abs(turn @ sound) ** 2 / sound.size
    best = int(np.argmax(power))
    if 0 < best < power.size - 1:
        left, middle, right = power[best - 1 : best + 2]
        bend = left - 2 * middle + right
        if bend < 0:
            shift = 0.5 * (left - right) / bend
            return float(off_hz[best] + shift * (off_hz[1] - off_hz[0])), float(middle)
    return 0.0, 0.0


def _median_about(power: FloatArray) -> FloatArray:
    """Return the median of the cells and frames about each, shape (frame, cell)."""
    edges = ((NOISE_FRAMES // 2,) * 2, (NOISE_CELLS // 2,) * 2)
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(power, edges, mode="edge"), (NOISE_FRAMES, NOISE_CELLS)
    )
    return np.asarray(np.median(around, axis=(-2, -1)))


def _largest_about(power: FloatArray, reach: int) -> FloatArray:
    """Return the largest of the bands about each, shape (reading, band)."""
    padded = np.pad(power, ((0, 0), (reach, reach)))
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=1)
    return np.asarray(around.max(axis=-1))


def _is_peak(power: FloatArray, reach: int) -> BoolArray:
    return np.asarray(power >= _largest_about(power, reach), np.bool_)
