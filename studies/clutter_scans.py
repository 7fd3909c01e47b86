"""Scans of one target among false measurements, for any number of runs at once.

**Method.** False measurements are Poisson in number and uniform in a window about the
target; their amplitudes are those of noise that crossed the lowest threshold. The target
crosses it or not by the amplitude drawn for it.

**Conventions.** Amplitudes are in deviations of the noise per quadrature. Measurements of
a scan are ordered by falling amplitude, so that any higher threshold is a slice.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray


@dataclass(frozen=True)
class ClutterScene:
    """A detector with resolution cells, looking at a window about the target.

    Parameters
    ----------
    target
        Amplitude of the target: "fluctuating" is Rayleigh with the mean power 1 + SNR,
        "gaussian" has mean ``sqrt(2 SNR)`` and unit deviation, "steady" is Rician.
    signal_to_noise
        Power ratio of the target, above 0.
    noise_std
        Standard deviation of each measured component.
    cell_volume
        Volume of a resolution cell.
    false_alarm
        Highest false alarm probability per cell that the scans must serve.
    half_width
        Half the width of the window in each component.
    dimension
        Number of measured components, from 1.
    """

    target: Literal["fluctuating", "gaussian", "steady"] = "fluctuating"
    signal_to_noise: float = 10.0
    noise_std: float = 5.0**0.5
    cell_volume: float = 900.0
    false_alarm: float = 0.3
    half_width: float = 400.0
    dimension: int = 2


@dataclass(frozen=True)
class SimulatedScan:
    """One scan of each run, padded to the longest."""

    measured: FloatArray
    """``(run, k, m)``; nan where padded."""
    amplitude: FloatArray
    """``(run, k)``, falling; -inf where padded."""
    from_target: BoolArray
    """Which of them is the target's."""


def simulate_scan(
    rng: np.random.Generator, position: FloatArray, scene: ClutterScene
) -> SimulatedScan:
    """Draw one scan for each run.

    ``position``: true components of the target, ``(run, m)``.

    Returned: measurements by falling amplitude.
    """
    runs = position.shape[0]
    width = 2.0 * scene.half_width
    cells = width**scene.dimension / scene.cell_volume
    count = np.asarray(rng.poisson(scene.false_alarm * cells, runs))
    size = (runs, int(count.max(initial=0)))
    places = position[:, None] + width * (rng.random((*size, scene.dimension)) - 0.5)
    # Noise given that it crossed: P(amplitude > a) is uniform below the false alarm rate.
    noise = np.sqrt(-2.0 * np.log(scene.false_alarm * (1.0 - rng.random(size))))
    noise = np.where(np.arange(size[1]) < count[:, None], noise, -np.inf)
    own = position + scene.noise_std * rng.standard_normal(position.shape)
    strength = _target_amplitude(rng, runs, scene)
    lowest = np.sqrt(-2.0 * np.log(scene.false_alarm))
    strength = np.where(strength > lowest, strength, -np.inf)
    amplitude = np.concatenate([strength[:, None], noise], axis=1)
    measured = np.concatenate([own[:, None], places], axis=1)
    order = np.argsort(-amplitude, axis=1)
    amplitude = np.take_along_axis(amplitude, order, axis=1)
    measured = np.take_along_axis(measured, order[..., None], axis=1)
    present = np.isfinite(amplitude)
    measured = np.where(present[..., None], measured, np.nan)
    return SimulatedScan(measured, amplitude, (order == 0) & present)


def _target_amplitude(rng: np.random.Generator, runs: int, scene: ClutterScene) -> FloatArray:
    if scene.target == "fluctuating":
        power = rng.standard_exponential(runs)
        rayleigh: FloatArray = np.sqrt(2.0 * (1.0 + scene.signal_to_noise) * power)
        return rayleigh
    in_phase: FloatArray = rng.standard_normal(runs)
    in_phase = in_phase + np.sqrt(2.0 * scene.signal_to_noise)
    if scene.target == "gaussian":
        return in_phase
    rician: FloatArray = np.hypot(in_phase, rng.standard_normal(runs))
    return rician


def constant_velocity_truth(
    rng: np.random.Generator,
    start: FloatArray,
    *,
    scans: int,
    interval_s: float,
    acceleration_std: float,
) -> FloatArray:
    """Draw true states under random acceleration, ``(scan, run, n)``.

    ``start``: states before the first scan, ``(run, n)``: z_1, v_1, z_2, v_2 ...
    ``scans``: number of scans, from 1. ``interval_s``: time between scans in s.
    ``acceleration_std``: deviation of the acceleration, constant between scans, per
    component.
    """
    state = np.array(start, dtype=np.float64)
    states = np.empty((scans, *state.shape))
    for scan in range(scans):
        push = acceleration_std * rng.standard_normal(state[:, ::2].shape)
        state[:, ::2] += interval_s * state[:, 1::2] + 0.5 * interval_s**2 * push
        state[:, 1::2] += interval_s * push
        states[scan] = state
    return states
