"""Tones of varying frequency in white noise, for one hydrophone.

**Method.** Each tone's phase is the sum of its frequency over the samples, so that any
course of the frequency may be asked for.

**Conventions.** The noise has a one-sided density of one unit per Hz. A tone's strength is
the ratio of its power to the noise in the equivalent noise bandwidth of a Hann window of
one second, 1.5 Hz.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

_HANN_BANDWIDTH_HZ = 1.5


def simulate_tones(
    rng: np.random.Generator,
    frequency_hz: FloatArray,
    snr_db: FloatArray | float,
    *,
    sample_rate_hz: float,
) -> FloatArray:
    """Draw the samples of some tones in white noise.

    ``frequency_hz``: frequency of every tone at every sample, ``(tone, sample)``; nan
    is silence. ``snr_db``: power of each tone over the noise in 1.5 Hz, in dB.
    ``sample_rate_hz``: sample rate in Hz.
    """
    n_tones, n_samples = frequency_hz.shape
    sounding = np.isfinite(frequency_hz)
    turns = np.cumsum(np.where(sounding, frequency_hz, 0.0), axis=1) / sample_rate_hz
    phase = 2.0 * np.pi * (turns + rng.random((n_tones, 1)))
    power = _HANN_BANDWIDTH_HZ * 10.0 ** (np.asarray(snr_db) / 10.0)
    amplitude = np.broadcast_to(np.sqrt(2.0 * power), (n_tones,))[:, None]
    noise = rng.standard_normal(n_samples) * np.sqrt(0.5 * sample_rate_hz)
    samples: FloatArray = noise + (amplitude * sounding * np.sin(phase)).sum(axis=0)
    return samples
