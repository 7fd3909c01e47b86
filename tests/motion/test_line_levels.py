"""Levels of the lines: the surface image, their fading, and what they add to a fit."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.line_level_coverage import alone, draw, transmission
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.passage.candidates import examine_contacts
from uwtrack_cli.motion.passage.fit import line_levels
from uwtrack_cli.motion.passage.fit.estimator import fit_with_line_levels
from uwtrack_cli.motion.passage.fit.line_levels import REFLECTIONS, SurfaceImage
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import condense, contact_data, make_blocks
from uwtrack_cli.motion.passage.readings.competing_readings import read_passage

SOURCE_M, SENSOR_M = 3.0, 22.0
WAVE_NUMBER = 2 * np.pi * np.array([60.0, 150.0]) / 1500.0
SCENE = Scene(rest_hz=(120.0,))
OMNI = Sensor(id="h1", depth_m=SENSOR_M)
MEDIUM = nuisance_priors(OMNI, None, None, SOURCE_M, 2.0).medium


def candidate_of(lines):
    (one,), _ = examine_contacts(lines, MEDIUM, 1e-3)
    return one


def with_coarse_frequencies(scene):
    """Lines whose Doppler shift does not tell everything: 0.1 Hz of noise."""
    lines = lines_of_scenes([scene], np.random.default_rng(2), has_bearing=False)
    noise = 0.1 * np.random.default_rng(5).normal(size=lines.line.size)
    return replace(
        lines,
        measured_frequency_hz=lines.measured_frequency_hz + noise,
        measured_frequency_std_hz=np.full(lines.line.size, 0.1),
    )


def test_levels_are_those_of_two_sources_whose_depths_are_known():
    flat = np.geomspace(5.0, 3000.0, 200)
    slant = np.hypot(flat, SENSOR_M - SOURCE_M)
    exact = SurfaceImage(WAVE_NUMBER, SOURCE_M * SENSOR_M, 0.0)
    level = exact.laws(np.log(slant))[0]
    for case, reflection in enumerate(REFLECTIONS):
        for line, number in enumerate(WAVE_NUMBER):
            heard = transmission(flat, (SOURCE_M, SENSOR_M), number, reflection, 0.0, 50.0)
            due = 2 * np.log(np.abs(heard))
            np.testing.assert_allclose(level[case, line], due, atol=1e-6)


def test_depths_that_are_not_known_leave_the_mean_power_of_the_fringes():
    rng = np.random.default_rng(3)
    std, slant = 0.4, np.geomspace(30.0, 2000.0, 40)
    image = SurfaceImage(WAVE_NUMBER, SOURCE_M * SENSOR_M, std)
    level = image.laws(np.log(slant))[0]
    middle = 3 + REFLECTIONS.index(0.6)  # the depths as they are told
    ratio = slant / np.sqrt(slant**2 + 4 * SOURCE_M * SENSOR_M)
    path = slant / ratio - slant
    for line, number in enumerate(WAVE_NUMBER):
        phase = number * path * (1 + std * rng.normal(size=(40_000, 1)))
        power = np.abs(1 - 0.6 * ratio * np.exp(1j * phase)) ** 2
        due = np.log(power.mean(axis=0)) - 2 * np.log(slant)
        np.testing.assert_allclose(level[middle, line], due, atol=0.02)


def test_the_partial_is_the_slope_of_the_levels():
    at, step = np.log(np.geomspace(20.0, 5000.0, 100)), 1e-5
    image = SurfaceImage(WAVE_NUMBER, SOURCE_M * SENSOR_M, 0.5)
    rise = image.laws(at + step)[0] - image.laws(at - step)[0]
    np.testing.assert_allclose(image.laws(at)[1], rise / (2 * step), atol=1e-6)


def test_far_from_a_soft_surface_levels_fall_by_forty_decibels_a_decade():
    """And by twenty without an image, or for a wave far shorter than the paths differ."""
    low, high = SurfaceImage(np.array([2.0, 400.0]), SOURCE_M * SENSOR_M, 0.3).laws(
        np.log(np.array([800.0]))
    )[1][3 + REFLECTIONS.index(0.95), :, 0]
    assert low == pytest.approx(-4.0, abs=0.25)
    assert high == pytest.approx(-2.0, abs=0.05)


@pytest.mark.parametrize("name", ["one line", "lines, jitter, channel"])
def test_levels_by_themselves_hold_the_truth_where_they_fade(name, monkeypatch):
    drawn = [draw(name, 400 + seed) for seed in range(16)]
    pull, std = np.array([alone(one) for one in drawn]).T
    # 5 % of them are due beyond 5.99: four or more of 16 would be 1 % or less
    assert np.count_nonzero(pull > 5.99) <= 3
    assert 0.2 < np.median(std) < 1.0
    # levels that fade and are taken not to are far off
    monkeypatch.setattr(line_levels, "STRENGTHS", np.array([0.03]))
    monkeypatch.setattr(line_levels, "SIDES_STD", 1e-9)
    bold = np.array([alone(one) for one in drawn])[:, 0]
    assert np.count_nonzero(bold > 5.99) >= 8


def test_levels_narrow_a_passage():
    wide = with_coarse_frequencies(SCENE)
    one = candidate_of(wide)
    both = fit_with_line_levels(one.fit, one.blocks)
    variance = [float(fit.covariance[0, 1, 1]) for fit in (one.fit, both)]
    assert variance[1] < 0.97 * variance[0]
    assert both.before_levels is one.fit
    due = SCENE.range_m / SCENE.speed_mps
    assert abs(both.range_over_speed_s[0] - due) < 3 * np.sqrt(variance[1])
    read = read_passage(one.fit, one.blocks)[0]
    assert read.before_levels is not None


def test_levels_of_another_law_lose_their_weight():
    lines = with_coarse_frequencies(SCENE)
    one = candidate_of(replace(lines, measured_level_db=np.roll(lines.measured_level_db, 60)))
    both = fit_with_line_levels(one.fit, one.blocks)
    moved = abs(both.theta[0, :3] - one.fit.theta[0, :3])
    own = np.sqrt(np.diag(one.fit.full_covariance[0])[:3]) / [1, one.fit.range_over_speed_s[0], 1]
    assert np.all(moved < 0.6 * own)


def test_too_few_levels_leave_a_fit_as_it_is():
    one = candidate_of(with_coarse_frequencies(SCENE))
    level = one.blocks.line_level.copy()
    level[:, :, 15:] = np.nan
    few = replace(one.blocks, line_level=level)
    assert fit_with_line_levels(one.fit, few) is one.fit
    none = replace(one.blocks, line_level=None)
    assert fit_with_line_levels(one.fit, none) is one.fit


def test_levels_are_freed_of_noise_and_averaged_with_the_rest():
    lines = lines_of_scenes([SCENE], np.random.default_rng(2), has_bearing=False)
    snr_db = np.full(lines.line.size, 10.0)
    snr_db[:5] = 3.0
    some = replace(lines, measured_snr_db=snr_db)
    data = contact_data(some, None, (1,))
    assert np.isnan(data.line_level_db[0, :5]).all()
    due = lines.measured_level_db[5:] - 10 * np.log10(1.1)
    np.testing.assert_allclose(data.line_level_db[0, 5:], due, atol=1e-4)
    short = condense(data, SCENE.closest_s, 40.0, most=100)
    assert short.line_level_db.shape == (1, short.time_s.size)
    level = make_blocks(short).line_level[0, 0]
    near = np.interp(short.time_s, data.time_s[5:], due) * np.log(10) / 10
    np.testing.assert_allclose(level[2:], near[2:], atol=0.1)


def test_frequencies_are_those_of_the_phase_of_both_paths(monkeypatch):
    """By differences of the phase of the sum of both, along a passage at 40 m."""
    monkeypatch.setattr(line_levels, "SCALE_STD", 0.0)
    time_s, speed_mps, step_s = np.linspace(-60.0, 60.0, 241), 5.0, 1e-3
    exact = SurfaceImage(WAVE_NUMBER, SOURCE_M * SENSOR_M, 0.0)

    def ranges_m(at_s):
        flat = np.hypot(40.0, speed_mps * at_s)
        return np.hypot(flat, SENSOR_M - SOURCE_M), np.hypot(flat, SENSOR_M + SOURCE_M)

    def phase(at_s, number, reflection):
        near, far = ranges_m(at_s)
        return np.exp(-1j * number * near) / near - reflection * np.exp(-1j * number * far) / far

    near = ranges_m(time_s)[0]
    direct = -(speed_mps**2) * time_s / near / 1500.0
    mean, patterns = exact.shifts(np.log(near), direct)
    weight = np.outer([0.25, 0.5, 0.25], line_levels.THEIR_WEIGHTS).ravel()
    cases = mean + patterns / np.sqrt(weight)[:, None, None]
    for case, reflection in enumerate(REFLECTIONS):
        for line, number in enumerate(WAVE_NUMBER):
            ends = (phase(time_s + lag, number, reflection) for lag in (-step_s, step_s))
            before, after = ends
            rate = np.angle(after / before) / (2 * step_s)
            shift = rate / (number * 1500.0) - direct
            np.testing.assert_allclose(cases[case, line], shift, atol=2e-6)
    np.testing.assert_allclose(
        (np.sqrt(weight)[:, None, None] * patterns).sum(axis=0), 0, atol=1e-12
    )
