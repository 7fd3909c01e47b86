"""How exactly `peaks` measures a tone in one frame, against the Cramer-Rao bound.

**Method.** A second of white noise with a tone at a random place between two cells goes
through `spectrogram` and `peaks`; the loudest peak within two cells counts, and errors
up to one cell, as in the reference.

**Conventions.** SNR is the tone's power over the noise in 1 Hz, dB. The bound of a tone
of unknown phase over T seconds is sqrt(3 / (2 pi^2 T^3 SNR)).

**References.** Rife & Boorstyn, IEEE Trans. IT 20(5), 591-598 (1974); the reference
figures are the best Hann row of the specification's section D.1.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.flow.studies.line_rows import root_row
from uwtrack_cli.flow.studies.line_sound import sound_blocks
from uwtrack_cli.flow.studies.table import StudyRow
from uwtrack_cli.stages.peaks import find_peaks

RATE_HZ = 1024
_PER_RUN = 100
_BATCH = 500
_NEAR_HZ, _GROSS_HZ = 2.5, 1.0


def frequency_rows(
    reference: dict[str, Any], runs: int, seed: int
) -> Iterator[StudyRow]:
    """Repeat section D.1: error over the bound, and over what is stated.

    Parameters
    ----------
    reference
        Reference figures of the study.
    runs
        A hundred tones come to a run.
    seed
        Seed of all random numbers.
    """
    for snr, known in reference["frame_error"].items():
        rng = np.random.default_rng([seed, int(snr)])
        error, stated = frame_errors(float(snr), _PER_RUN * runs, rng)
        bound = np.sqrt(3.0 / (2.0 * np.pi**2 * 10.0 ** (float(snr) / 10.0)))
        case = f"D.1 one frame, {snr} dB"
        yield from root_row(case, "error over bound", known, (error / bound) ** 2)
        yield from root_row(
            case, "error over stated", reference["stated_error_ratio"],
            (error / stated) ** 2,
        )  # fmt: skip


def frame_errors(
    snr_db: float, trials: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return errors and stated deviations of tones in single frames, Hz.

    Parameters
    ----------
    snr_db
        Power of the tone over the noise in 1 Hz, dB.
    trials
        Number of tones.
    rng
        Generator.
    """
    errors, stated = [], []
    amplitude = np.sqrt(2.0 * 10.0 ** (snr_db / 10.0))
    time = (np.arange(RATE_HZ) - RATE_HZ / 2) / RATE_HZ
    while trials > 0:
        size = min(trials, _BATCH)
        trials -= size
        frequency = 200.0 + rng.uniform(0.0, 1.0, size)
        phase = rng.uniform(0.0, 2.0 * np.pi, size)
        tones = amplitude * np.cos(
            2.0 * np.pi * frequency[:, None] * time + phase[:, None]
        )
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
