"""A steady line in noise: its likelihood, its detection, and the weakest one found.

**Method.** A line of constant amplitude in Gaussian noise is compared with the noise
alone by the power of a cell (Rice). The weakest line is the steady one that is started with probability one
half within a minute: where its expected score reaches the threshold, or where M of N
hits come about every other time. False lines of counted hits follow from the rate of
noise peaks and the size of a tentative line's gate.

**Conventions.** SNRs are power over noise in the line's cell; times are in seconds.
``power_ratio`` is the power of a cell over the noise in it, linear.

**References.** Rice (1945) for the amplitude of a line in noise; Wald (1947); Johnson
(1959), Biometrika 46, 352, for the noncentral chi-square as a mixture.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.noise_floor import LN2

MINUTE_S = 60.0

_GRID_DB = np.arange(-8.0, 25.0, 0.1)
_TENTATIVE_GATE = 2.2
"""Full width of a tentative line's gate in resolutions, with the usual gates."""

_SPATIAL_LOSS = 0.6
"""Mean loss of a hit by its distance, in nepers: half of chi-square, and its tails."""


def amplitude_log_ratio(
    power_ratio: FloatArray, design_snr: float | FloatArray | np.floating[Any]
) -> FloatArray:
    """Logarithm of the amplitude's likelihood, steady line against noise.

    Notes
    -----
    ln I0(2 sqrt(d y)) - d for a line of power ratio d and a cell of ratio y.
    """
    from scipy.special import i0e

    argument = 2.0 * np.sqrt(design_snr * np.maximum(power_ratio, 0.0))
    return np.log(i0e(argument)) + argument - design_snr


def detection_probability(threshold: float, design_snr: float) -> float:
    """Probability that a steady line's cell exceeds a power ratio."""
    return float(detection_probabilities(threshold, np.array([design_snr]))[0])


def detection_probabilities(threshold: float, snr: FloatArray) -> FloatArray:
    """Probabilities that cells of steady lines exceed a power ratio, shape (snr,).

    Notes
    -----
    Marcum's Q1(sqrt(2 d), sqrt(2 t)): a cell of k quanta, Poisson with mean d, exceeds t
    with the probability that another count of mean t is at most k (Johnson 1959).
    """
    from scipy.special import gammaln, pdtr, xlogy

    most = float(snr.max(initial=0.0))
    quanta = np.arange(most + 12.0 * np.sqrt(most) + 40.0)[:, None]
    chance = np.exp(xlogy(quanta, snr) - snr - gammaln(quanta + 1.0))
    exceeds = (chance * pdtr(quanta, threshold)).sum(axis=0)
    return np.asarray(exceeds / chance.sum(axis=0))


def line_power_density(snr: FloatArray, power_ratio: FloatArray) -> FloatArray:
    """Return p(y) of a line's power ratio y, shape (snr, y).

    Notes
    -----
    exp(-y - d) I0(2 sqrt(d y)) (Rice 1945), from the likelihood ratio.
    """
    ratio = amplitude_log_ratio(power_ratio[None, :], snr[:, None])
    return np.exp(ratio - power_ratio[None, :])


@functools.lru_cache(maxsize=2)
def _density_above(threshold: float) -> tuple[FloatArray, FloatArray]:
    """Return power ratios from a threshold on and their density, shape (snr, power).

    The trackers of one run share the threshold, and the Bessel functions are dear.
    """
    power = np.linspace(threshold, threshold + 60.0, 1500)
    return power, line_power_density(10.0 ** (_GRID_DB / 10.0), power)


def weakest_by_score(
    gain: Callable[[FloatArray], FloatArray],
    threshold: float,
    detection: float,
    least_score: float,
    n_frames: float,
) -> float:
    """Return the SNR in dB at which the expected score comes up in a minute.

    Parameters
    ----------
    gain
        Log-likelihood ratio of a hit from its SNR in dB, in nepers.
    threshold
        Power ratio above which peaks are kept.
    detection
        Probability with which the line looked for has a peak beyond those of noise.
    least_score
        Score that starts a line, in nepers.
    n_frames
        Independent frames in a minute.
    """
    power, density = _density_above(threshold)
    step = power[1] - power[0]
    seen = np.minimum(density.sum(axis=1) * step, 1.0)
    gained = gain(10.0 * np.log10(np.maximum(power - 1.0, 0.1))) - _SPATIAL_LOSS
    ratio = np.log(1.0 - detection + np.exp(gained))
    drift = (density * ratio).sum(axis=1) * step + (1.0 - seen) * np.log1p(-detection)
    return _first_above(drift * n_frames, least_score)


def weakest_by_count(threshold: float, hits: int, frames: int, n_frames: float) -> float:
    """Return the SNR in dB at which M of N hits come in a minute every other time."""
    from scipy.special import bdtrc

    seen = detection_probabilities(threshold, 10.0 ** (_GRID_DB / 10.0))
    started = seen * bdtrc(hits - 2, frames - 1, seen)
    return _first_above(-np.log1p(-np.minimum(started, 1 - 1e-12)) * n_frames, LN2)


def false_lines_by_count(
    peaks_per_frame_khz: float, resolution_hz: float, hits: int, frames: int, hop_s: float
) -> float:
    """Return the expected rate of false lines by M of N, per kHz and hour."""
    from scipy.special import bdtrc

    in_gate = -np.expm1(-peaks_per_frame_khz * 1e-3 * _TENTATIVE_GATE * resolution_hz)
    births_per_hour = peaks_per_frame_khz * 3600.0 / hop_s
    return float(births_per_hour * bdtrc(hits - 2, frames - 1, in_gate))


@functools.cache
def _mean_path_score() -> FloatArray:
    """Return what a frame adds to the score of a steady line's path, shape (snr,)."""
    power = np.linspace(1e-3, 80.0, 4000)
    density = line_power_density(10.0 ** (_GRID_DB / 10.0), power)
    score = np.minimum(amplitude_log_ratio(power, 1.5), 4.0)
    return np.asarray((density * score).sum(axis=1) * (power[1] - power[0]))


def weakest_by_path(least_score: float, n_frames: int, path_gain: float) -> float:
    """Return the SNR in dB at which the expected score of a path comes up.

    ``path_gain`` is what it gains per frame by its choice among cells, in nepers.
    """
    return _first_above(n_frames * (_mean_path_score() + path_gain), least_score)


def _first_above(values: FloatArray, level: float) -> float:
    above = np.flatnonzero(values > level)
    return float(_GRID_DB[above[0]]) if above.size else float(_GRID_DB[-1])
