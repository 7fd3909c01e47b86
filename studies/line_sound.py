"""Lines in sound: how exactly one frame measures a tone, and which weak lines are found.

**Method.** *One frame*: a second of white noise with a tone at a random place between
two cells goes through `spectrogram` and `peaks`; the loudest peak within two cells
counts, and errors up to one cell, as in the reference. *Minutes*: white noise with one
line, f = f0 + r t + A sin, goes through the spectrogram and a stage. A line counts as
detected when one that the stage reports lies within 1.5 Hz of it for more than half of
the frames (for counted hits: at all). Minutes without a line tell how often each method
reports one all the same.

**Conventions.** SNR is the line's power over the noise in 1 Hz, dB. The bound of a tone
of unknown phase over T seconds is sqrt(3 / (2 pi^2 T^3 SNR)). A gate is 250 Hz for a
minute. The interval of an SNR comes from resampling trials (bootstrap).

**References.** Rife & Boorstyn, IEEE Trans. IT 20(5), 591-598 (1974); Efron &
Tibshirani, "An Introduction to the Bootstrap" (1993).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from studies.rows import mean_row, rate_row, root_row
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.data.study import StudyRow
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracker_options import CountLogic, Feedback, ProcessNoise
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, LENGTH_S = 1024.0, 60.5
TRACE_FALSE_LINES = 4.8
"""Rate for one false line in a hundred minutes of 250 Hz, as in the reference: windows of
`trace` overlap by half, and a minute is one of two."""

NEAR_HZ = 1.5
GATE_HZ = 250.0
SNR_GRIDS = {
    "trace": (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0),
    "score": (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0),
    "count": (3.0, 4.0, 5.0, 6.0, 7.0, 8.0),
}
"""SNRs at which minutes are detected, by method, dB."""

STATED_SNRS = {"trace": (3.0, 6.0, 10.0), "score": (6.0, 10.0)}
"""SNRs at which errors are set against the deviations stated with them, dB."""

_N_RESAMPLES = 200
_TRIALS_PER_RUN, _TRACED_PER_RUN = 4, 2
_SEED_STEP = 7_919
_STEADY = ProcessNoise(frequency_hz2ps3=2e-4, doppler_ps3=0.0, frequency_rate_hzps=0.2)
_ALONE = Feedback(classifier="none")


@dataclass(frozen=True)
class LineTrial:
    """What a method made of a minute.

    Attributes
    ----------
    is_detected
        Whether the line was detected.
    square_error_hz2
        Mean squared error of the smoothed frequency; nan if it was not.
    square_score
        The same with every error over its stated deviation.
    share_within
        Share of the points within 1.96 stated deviations.
    """

    is_detected: bool
    square_error_hz2: float = np.nan
    square_score: float = np.nan
    share_within: float = np.nan


def sound_rows(reference: dict[str, Any], runs: int, seed: int) -> Iterator[StudyRow]:
    """Repeat the minutes of sound: which lines are detected, and how exactly they are followed.

    ``runs``: four minutes at an SNR come to a run, and two of the smoothed frequency.
    """
    trials, traced = _TRIALS_PER_RUN * runs, _TRACED_PER_RUN * runs
    for method, grid in SNR_GRIDS.items():
        detected = np.array(
            [[trial.is_detected for trial in _trials(method, snr, trials, seed)] for snr in grid]
        )
        for level, known in reference["detection_snr_db"][method].items():
            yield detection_row(
                f"minute {method}", known, np.array(grid), detected, float(level),
                np.random.default_rng(seed),
            )  # fmt: skip
        false = [count_false(method, _SEED_STEP * seed + k) for k in range(trials)]
        gates = 0.5 * RATE_HZ / GATE_HZ
        yield rate_row(
            f"minute {method}, noise alone", "false lines per gate",
            reference["false_per_gate"], sum(false), gates * trials,
        )  # fmt: skip
    for snr, known in reference["trace_rmse_hz"].items():
        found = _trials("trace", float(snr), traced, seed)
        yield from root_row(
            f"minute trace, {snr} dB", "frequency error Hz", known,
            np.array([trial.square_error_hz2 for trial in found]),
        )  # fmt: skip
    for method, snrs in STATED_SNRS.items():
        for snr in snrs:
            yield from _stated_rows(
                f"minute {method}, {snr:g} dB", reference, _trials(method, snr, traced, seed)
            )


def _stated_rows(
    case: str, reference: dict[str, Any], found: list[LineTrial]
) -> Iterator[StudyRow]:
    yield from root_row(
        case, "error over stated", reference["stated_error_ratio"],
        np.array([trial.square_score for trial in found]),
    )  # fmt: skip
    yield from mean_row(
        case, "within 1.96 stated", reference["share_within"],
        np.array([trial.share_within for trial in found]),
    )  # fmt: skip


def _trials(method: str, snr: float, trials: int, seed: int) -> list[LineTrial]:
    return [detect_line(method, snr, _SEED_STEP * seed + k) for k in range(trials)]


def trace(blocks: list[Spectrogram]) -> Lines:
    """Track before detect."""
    return Lines.join(
        list(trace_lines(iter(blocks), false_lines_per_khz_hour=TRACE_FALSE_LINES, motion=_STEADY))
    )


def score(blocks: list[Spectrogram]) -> Lines:
    """Track peaks as the commands do by default."""
    return Lines.join(list(track_lines(find_peaks(block) for block in blocks)))


def count(blocks: list[Spectrogram]) -> Lines:
    """Track peaks by three hits of five, at a threshold of equal false lines."""
    level = COUNT_FALSE_ALARM
    peaks = [
        find_peaks(block, false_alarm_probability=level, kept_probability=level) for block in blocks
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
    blocks = sound_blocks(sound.astype(np.float32), RATE_HZ)
    middles = np.concatenate([block.frames.time_s for block in blocks])
    return blocks, np.interp(middles, time, frequency)


def sound_blocks(sound: Samples, rate_hz: float, **options: Any) -> list[Spectrogram]:
    """Return the spectrogram of some samples of one channel."""

    def read(block: int) -> Iterator[Samples]:
        for start in range(0, sound.size, block):
            yield sound[start : start + block, None]

    recording = Recording(
        sensor=Sensor(id="study"), name="study", sample_rate_hz=rate_hz,
        n_samples=sound.size, n_channels=1, reader=read,
    )  # fmt: skip
    return list(compute_spectrogram(recording, **options))


def count_false(method: str, seed: int) -> int:
    """Return how many lines a method reports in a minute of noise alone."""
    blocks, _ = minute(-np.inf, seed)
    return METHODS[method](blocks).line_id.size


@cache
def detect_line(method: str, snr_db: float, seed: int) -> LineTrial:
    """Run one method over one minute."""
    blocks, truth = minute(snr_db, seed)
    lines = METHODS[method](blocks)
    off = lines.frequency_hz - truth[lines.frame]
    near = lines.line[np.abs(off) < NEAR_HZ]
    ids, counts = np.unique(near, return_counts=True)
    # the reference asks of counted lines only that they were confirmed
    least = 0.0 if method == "count" else 0.5 * truth.size
    if not counts.size or counts.max() <= least:
        return LineTrial(is_detected=False)
    own = lines.line == ids[np.argmax(counts)]
    score = off[own] ** 2 / lines.frequency_covariance[own, 0, 0]
    return LineTrial(
        True, float(np.mean(off[own] ** 2)), float(np.mean(score)), float(np.mean(score < 1.96**2))
    )


RATE_HZ = 1024
_PER_RUN = 100
_BATCH = 500
_NEAR_HZ, _GROSS_HZ = 2.5, 1.0


def frequency_rows(reference: dict[str, Any], runs: int, seed: int) -> Iterator[StudyRow]:
    """Repeat the single frames: error over the bound, and over what is stated.

    ``runs``: a hundred tones come to a run.
    """
    for snr, known in reference["frame_error"].items():
        rng = np.random.default_rng([seed, int(snr)])
        error, stated = frame_errors(float(snr), _PER_RUN * runs, rng)
        bound = np.sqrt(3.0 / (2.0 * np.pi**2 * 10.0 ** (float(snr) / 10.0)))
        case = f"one frame, {snr} dB"
        yield from root_row(case, "error over bound", known, (error / bound) ** 2)
        yield from root_row(
            case, "error over stated", reference["stated_error_ratio"], (error / stated) ** 2
        )


def frame_errors(
    snr_db: float, trials: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return errors and stated deviations of tones in single frames, Hz.

    ``snr_db``: power of the tone over the noise in 1 Hz, dB.
    """
    errors, stated = [], []
    amplitude = np.sqrt(2.0 * 10.0 ** (snr_db / 10.0))
    time = (np.arange(RATE_HZ) - RATE_HZ / 2) / RATE_HZ
    while trials > 0:
        size = min(trials, _BATCH)
        trials -= size
        frequency = 200.0 + rng.uniform(0.0, 1.0, size)
        phase = rng.uniform(0.0, 2.0 * np.pi, size)
        tones = amplitude * np.cos(2.0 * np.pi * frequency[:, None] * time + phase[:, None])
        # noise of one-sided density 1
        tones += rng.standard_normal(tones.shape) * np.sqrt(RATE_HZ / 2)
        sound = tones.ravel().astype(np.float32)
        for block in sound_blocks(sound, float(RATE_HZ), overlap=0.0):
            peaks = find_peaks(block, kept_probability=0.5, false_alarm_probability=0.5)
            error = peaks.frequency_hz - frequency[peaks.frame]
            near = np.flatnonzero(np.abs(error) < _NEAR_HZ)
            near = near[np.argsort(-peaks.level_db[near], kind="stable")]
            _, first = np.unique(peaks.frame[near], return_index=True)
            kept = near[first]
            kept = kept[np.abs(error[kept]) < _GROSS_HZ]
            errors.append(error[kept])
            stated.append(peaks.frequency_std_hz[kept].astype(float))
    return np.concatenate(errors), np.concatenate(stated)


def detection_row(
    case: str,
    known: float,
    grid_db: FloatArray,
    detected: BoolArray,
    level: float,
    rng: np.random.Generator,
) -> StudyRow:
    """Return the row of the SNR at which a share of the lines is detected.

    ``known``: reference figure, dB. ``grid_db``: SNRs of the trials, ascending.
    ``detected``: whether the line was detected, ``(SNR, trial)``. ``level``: the share,
    0 to 1.
    """
    ours = detection_snr_db(grid_db, detected.mean(axis=1), level)
    draws = rng.integers(0, detected.shape[1], (_N_RESAMPLES, detected.shape[1]))
    again = [detection_snr_db(grid_db, detected[:, draw].mean(axis=1), level) for draw in draws]
    low, high = np.quantile(again, [0.025, 0.975])
    quantity = f"SNR at {level:.0%} found, dB".replace("%", " %")
    return StudyRow(case, quantity, known, ours, float(low), float(high))


def detection_snr_db(grid_db: FloatArray, share: FloatArray, level: float = 0.5) -> float:
    """Interpolate the SNR at which a share is detected; the ends if it is outside.

    Examples
    --------
    >>> round(detection_snr_db(np.array([0.0, 2.0]), np.array([0.25, 0.75])), 6)
    1.0
    """
    rising = np.maximum.accumulate(share)
    # ties are spread, since interpolation wants strictly rising shares
    rising = rising + 1e-9 * np.arange(rising.size)
    return float(np.interp(level, rising, grid_db))
