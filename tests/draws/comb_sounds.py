"""Combs in white noise: tones of a level over it in 1 Hz, steady or with one Doppler.

Each tone is a sine whose phase is integrated from its own frequency, sample by sample.
"""

import numpy as np

from tests.support import recording_of, white_noise
from uwtrack_cli.data.recording import Recording

RATE_HZ = 1000.0


def comb_sound(tones_hz: np.ndarray, level_db: float, *, seconds: float, seed: int) -> Recording:
    """Return the recording of `comb_samples`."""
    sound = comb_samples(tones_hz, level_db, seconds=seconds, seed=seed)
    return recording_of(sound, RATE_HZ)


def comb_samples(
    tones_hz: np.ndarray,
    level_db: float | np.ndarray,
    *,
    seconds: float,
    seed: int,
    factor: np.ndarray | None = None,
) -> np.ndarray:
    """Return noise of unit density with tones; ``factor`` is the Doppler of all samples."""
    rng = np.random.default_rng([seed, 1])
    size = round(seconds * RATE_HZ)
    turns = np.cumsum(np.ones(size) if factor is None else factor) / RATE_HZ
    sound = white_noise(size, seed, rate_hz=RATE_HZ)
    levels = np.broadcast_to(level_db, tones_hz.shape)
    for tone, level in zip(tones_hz, levels, strict=True):
        phase = 2.0 * np.pi * (tone * turns + rng.random())
        sound += np.sqrt(2.0 * 10.0 ** (0.1 * level)) * np.sin(phase)
    return np.asarray(0.005 * sound)


def passage_factor(seconds: float, time_s: float, speed_mps: float, range_m: float) -> np.ndarray:
    """Return f/f0 at every sample of a straight passage at a time and slant range.

    By the retarded time: of each emission time the arrival, and back by interpolation.
    """
    sound_speed_mps = 1500.0
    emitted = np.arange(-30.0, seconds + 30.0, 0.05)
    along = speed_mps * (emitted - time_s)
    arrival = emitted + np.hypot(along, range_m) / sound_speed_mps
    arrival -= range_m / sound_speed_mps
    factor = np.diff(emitted) / np.diff(arrival)
    middle = 0.5 * (arrival[1:] + arrival[:-1])
    return np.interp(np.arange(round(seconds * RATE_HZ)) / RATE_HZ, middle, factor)
