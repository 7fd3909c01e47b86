"""What frames and the surface image do to frequencies, and passages freed of it."""

from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.motion.passage.fit.estimator import (
    correct_frequencies,
    fit_passage,
    fit_with_coloured_noise,
)
from uwtrack_cli.motion.passage.model.law import passage_law
from uwtrack_cli.motion.passage.model.measurements import FRAME_VARIANCE, PassageData, make_blocks

TIME_S = np.arange(0.0, 200.0, 2.0)
SPEED_MPS, WIDTH_S, CLOSEST_S, REST_HZ = 5.0, 8.0, 100.0, 120.0


def data_of(frequency_hz, std_hz, frame_s=4.0):
    """Return one line in frames of one length."""
    none = np.full((1, TIME_S.size), np.nan)
    std = np.full((1, TIME_S.size), std_hz)
    given = PassageData(TIME_S, frequency_hz[None], std, none, none, none, none)
    return replace(given, frame_s=np.full((1, TIME_S.size), frame_s))


def test_the_peak_of_a_frame_is_a_mean_over_its_length():
    """By the spectrum of a tone whose frequency bends, in a Hann window of four seconds."""
    rate_hz, length_s, bend = 500.0, 4.0, 0.02
    time_s = (np.arange(int(rate_hz * length_s)) + 0.5) / rate_hz - 0.5 * length_s
    phase = 2 * np.pi * (100.0 * time_s + bend * time_s**3 / 6.0)
    window = np.cos(np.pi * time_s / length_s) ** 2
    grid_hz = np.linspace(99.5, 100.5, 20_001)
    power = np.abs(np.exp(-2j * np.pi * np.outer(grid_hz, time_s)) @ (window * np.exp(1j * phase)))
    off_hz = grid_hz[np.argmax(power)] - 100.0
    assert off_hz == pytest.approx(0.5 * bend * FRAME_VARIANCE * length_s**2, rel=0.05)


def test_a_short_passage_in_long_frames_keeps_its_width():
    std_s = np.sqrt(FRAME_VARIANCE) * 4.0
    lags, weights = np.polynomial.hermite_e.hermegauss(15)
    theta = np.array([CLOSEST_S, np.log(WIDTH_S), SPEED_MPS])
    shift = np.stack([passage_law(TIME_S + std_s * lag, theta, 1500.0).shift for lag in lags])
    blurred = REST_HZ * (1 + weights @ shift / weights.sum())
    blocks, medium = make_blocks(data_of(blurred, 1e-3)), Medium(1500.0)
    start = np.append(theta, 0.0)[None]
    white = fit_passage(blocks, start, np.ones(1), medium)
    sharp = fit_passage(correct_frequencies(blocks, white), start, np.ones(1), medium)
    off_s = [float(fit.range_over_speed_s[0]) - WIDTH_S for fit in (white, sharp)]
    assert off_s[0] > 0.004 * WIDTH_S
    assert abs(off_s[1]) < 0.1 * off_s[0]


@pytest.mark.parametrize(("reflection", "source_m"), [(0.95, 5.0), (0.9, 7.0), (0.0, 4.0)])
def test_intervals_of_a_source_with_its_image_hold_its_range(reflection, source_m):
    """By the phase of both paths; without the image R/v is beyond five of its deviations."""
    sensor_m, flat_m, std_hz = 20.0, 40.0, 2e-3
    wave_number = 2 * np.pi * REST_HZ / 1500.0

    def sound(at_s):
        flat = np.hypot(flat_m, SPEED_MPS * (at_s - CLOSEST_S))
        near, far = np.hypot(flat, sensor_m - source_m), np.hypot(flat, sensor_m + source_m)
        image = reflection * np.exp(-1j * wave_number * far) / far
        return np.exp(-1j * wave_number * near) / near - image

    turn = np.angle(sound(TIME_S + 0.01) / sound(TIME_S - 0.01))
    noise = std_hz * np.random.default_rng(4).standard_normal(TIME_S.size)
    frequency = REST_HZ + turn / (2 * np.pi * 0.02) + noise
    medium = Medium(1500.0, sensor_m - 5.0, height_std_m=3.0, most_m=sensor_m)
    start = np.array([[CLOSEST_S, np.log(WIDTH_S), SPEED_MPS, 0.0]])
    blocks = make_blocks(data_of(frequency, std_hz, 1e-3))
    white = fit_passage(blocks, start, np.ones(1), medium)
    fit = fit_with_coloured_noise(white, correct_frequencies(blocks, white))
    due_s = np.hypot(flat_m, sensor_m - source_m) / SPEED_MPS
    off = [
        (one.range_over_speed_s[0] - due_s) / np.sqrt(one.covariance[0, 1, 1])
        for one in (white, fit)
    ]
    assert abs(off[1]) < 2.5
    assert reflection == 0.0 or off[0] > 5.0
