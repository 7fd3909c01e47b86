"""Why fits use raw measurements: coverage of a Doppler fit, raw and smoothed."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from tests.lines.line_scenes import doppler, line_peaks, some_frames
from uwtrack_cli.data.lines import COASTED, Lines
from uwtrack_cli.lines.track import track_lines

TRUE = (310.0, 150.0, 6.0, 250.0)
"""Rest frequency, time of closest approach, speed, range."""


def curve(time: np.ndarray, *parameters: float) -> np.ndarray:
    rest, closest, speed, reach = parameters
    return rest * (1.0 + doppler(time, closest, speed, reach))


def coverage(runs: int) -> tuple[float, float]:
    """Share of 95 % intervals that hold the truth, raw and smoothed."""
    inside = np.zeros((runs, 2, 4), dtype=bool)
    for seed in range(runs):
        frequency = curve(some_frames(600).time_s, *TRUE)[:, None]
        peaks = line_peaks(frequency, seed=seed, clutter=0.0, std_hz=0.15)
        lines = Lines.join(list(track_lines(iter([peaks]))))
        hit = lines.association != COASTED
        fits = (
            (lines.time_s[hit], lines.measured_frequency_hz[hit],
             lines.measured_frequency_std_hz[hit]),
            (lines.time_s, lines.frequency_hz,
             np.sqrt(lines.frequency_covariance[:, 0, 0])),
        )  # fmt: skip
        for k, (time, value, std) in enumerate(fits):
            found, covariance = curve_fit(
                curve, time, value, p0=TRUE, sigma=std, absolute_sigma=True
            )
            score = (found - np.array(TRUE)) / np.sqrt(np.diag(covariance))
            inside[seed, k] = np.abs(score) < 1.96
    return float(inside[:, 0].mean()), float(inside[:, 1].mean())


@pytest.mark.slow
def test_raw_measurements_hold_their_intervals_and_smoothed_states_do_not() -> None:
    raw, smoothed = coverage(10)
    # 40 intervals: two deviations of 0.95 are 0.07
    assert raw >= 0.88
    assert smoothed <= 0.75
    assert raw - smoothed >= 0.2
