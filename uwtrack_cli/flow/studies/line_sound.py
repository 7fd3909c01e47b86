"""Weak lines in sound: how often each method hears them, and how exactly.

**Method.** Minutes of white noise with one line, f = f0 + r t + A sin, through the
spectrogram and a stage. A line counts as heard when one that the stage reports lies
within 1.5 Hz of it for more than half of the frames (for counted hits: at all).

**Conventions.** SNR is the line's power over the noise in 1 Hz, dB.

**References.** The reference figures are the specification's section D.2.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.stages.lines.policies import CountLogic, Feedback, Motion, ScoreLogic
from uwtrack_cli.stages.peaks import find_peaks
from uwtrack_cli.stages.spectrogram import compute_spectrogram
from uwtrack_cli.stages.trace import trace_lines
from uwtrack_cli.stages.track import track_lines

RATE_HZ, LENGTH_S = 1024.0, 60.5
FALSE_LINES_PER_KHZ_HOUR = 2.4
"""One false line in a hundred minutes of 250 Hz, as in the reference."""

TRACE_FALSE_LINES = 4.8
"""The same for `trace`, whose windows overlap by half: a minute is one of two."""

NEAR_HZ = 1.5
_STEADY = Motion(frequency_hz2ps3=2e-4, doppler_ps3=0.0, frequency_rate_hzps=0.2)
_ALONE = Feedback(classifier="none")


@dataclass(frozen=True)
class Heard:
    """Whether the line was heard, and the error of the smoothed frequency."""

    is_heard: bool
    square_error_hz2: float


def trace(blocks: list[Spectrogram]) -> Lines:
    """Track before detect."""
    return Lines.join(list(trace_lines(
        iter(blocks), false_lines_per_khz_hour=TRACE_FALSE_LINES,
        motion=_STEADY,
    )))  # fmt: skip


def score(blocks: list[Spectrogram]) -> Lines:
    """Track peaks by their score."""
    peaks = [find_peaks(block, kept_probability=0.1) for block in blocks]
    rule = ScoreLogic(FALSE_LINES_PER_KHZ_HOUR, design_snr_db=1.8)
    return Lines.join(list(track_lines(
        iter(peaks), score=rule, feedback=_ALONE, motion=_STEADY
    )))  # fmt: skip


def count(blocks: list[Spectrogram]) -> Lines:
    """Track peaks by three hits of five, at a threshold of equal false lines."""
    level = COUNT_FALSE_ALARM
    peaks = [
        find_peaks(block, false_alarm_probability=level, kept_probability=level)
        for block in blocks
    ]
    return Lines.join(list(track_lines(
        iter(peaks), initiation="count", count=CountLogic(), feedback=_ALONE,
        motion=_STEADY,
    )))  # fmt: skip


COUNT_FALSE_ALARM = 1.4e-3
"""Cell false-alarm rate at which 3 of 5 starts about 2.4 false lines per kHz hour."""

Method = Callable[[list[Spectrogram]], Lines]
METHODS: dict[str, Method] = {"trace": trace, "score": score, "count": count}


def minute(snr_db: float, seed: int) -> tuple[list[Spectrogram], FloatArray]:
    """Make a minute of sound; return its spectrogram and the true frequency."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ
    rate, swing = rng.uniform(-0.1, 0.1), rng.uniform(0.0, 1.0)
    period, phase = rng.uniform(60.0, 120.0), rng.uniform(0.0, 2.0 * np.pi)
    frequency = (
        rng.uniform(150.0, 350.0)
        + rate * time
        + swing * np.sin(2.0 * np.pi * time / period + phase)
    )
    # noise of variance 1: one-sided density 2 / rate
    amplitude = np.sqrt(2.0 * 10.0 ** (snr_db / 10.0) * 2.0 / RATE_HZ)
    angle = 2.0 * np.pi * np.cumsum(frequency) / RATE_HZ + rng.uniform(0.0, 6.28)
    sound = 0.1 * (rng.standard_normal(time.size) + amplitude * np.cos(angle))
    blocks = list(compute_spectrogram(_recording(sound.astype(np.float32))))
    middles = np.concatenate([block.frames.time_s for block in blocks])
    return blocks, np.interp(middles, time, frequency)


def _recording(sound: Samples) -> Recording:
    def read(block: int) -> Iterator[Samples]:
        for start in range(0, sound.size, block):
            yield sound[start : start + block, None]

    return Recording(
        sensor=Sensor(id="study"), name="minute", sample_rate_hz=RATE_HZ,
        n_samples=sound.size, n_channels=1, reader=read,
    )  # fmt: skip


def listen(method: str, snr_db: float, seed: int) -> Heard:
    """Run one method over one minute."""
    blocks, truth = minute(snr_db, seed)
    lines = METHODS[method](blocks)
    off = lines.frequency_hz - truth[lines.frame]
    near = lines.line[np.abs(off) < NEAR_HZ]
    ids, counts = np.unique(near, return_counts=True)
    # the reference asks of counted lines only that they were confirmed
    least = 0.0 if method == "count" else 0.5 * truth.size
    if not counts.size or counts.max() <= least:
        return Heard(is_heard=False, square_error_hz2=np.nan)
    own = lines.line == ids[np.argmax(counts)]
    return Heard(is_heard=True, square_error_hz2=float(np.mean(off[own] ** 2)))
