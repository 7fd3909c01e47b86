"""Operating curves against the reference table, scipy and the simulated detector."""

import math

import numpy as np
import pytest
from scipy.stats import ncx2

from studies.clutter_scans import ClutterScene, simulate_scan
from studies.rows import load_reference
from uwtrack_cli.estimation.operating_curve import (
    measured_curve,
    model_curve,
    rayleigh_false_alarm,
    rayleigh_threshold,
)

TABLE = np.array(load_reference("clutter")["detector"]["rows"])


@pytest.mark.parametrize(
    ("model", "signal_to_noise", "column"),
    [
        ("fluctuating", 4.5, 2),
        ("fluctuating", 10.0, 3),
        ("fluctuating", 31.6228, 4),
        ("gaussian", 4.5, 5),
        ("steady", 4.5, 6),
    ],
)
def test_the_reference_table_is_met_to_every_digit(model, signal_to_noise, column):
    curve = model_curve(model, signal_to_noise)
    np.testing.assert_allclose(curve.threshold(TABLE[:, 0]), TABLE[:, 1], atol=6e-6)
    np.testing.assert_allclose(curve.detection(TABLE[:, 0]), TABLE[:, column], atol=6e-6)


def test_marcums_function_is_the_noncentral_chi_square_tail():
    tau = rayleigh_threshold(TABLE[:, 0])
    ours = model_curve("steady", 8.0).detection(TABLE[:, 0])
    np.testing.assert_allclose(ours, ncx2.sf(tau**2, 2, 16.0), rtol=1e-9)


def test_threshold_and_false_alarm_are_inverse():
    probability = np.geomspace(1e-8, 0.9, 30)
    back = rayleigh_false_alarm(rayleigh_threshold(probability))
    np.testing.assert_allclose(back, probability, rtol=1e-12)


def test_a_measured_curve_is_read_between_its_points_and_back():
    curve = measured_curve(
        np.array([1e-3, 1e-2, 1e-1]), np.array([0.2, 0.5, 0.8]), np.array([30.0, 20, 10])
    )
    middle = np.array(10.0**-1.5)
    assert curve.detection(middle) == pytest.approx(0.65)
    assert curve.threshold(middle) == pytest.approx(15.0)
    assert curve.false_alarm(np.array(15.0)) == pytest.approx(middle)


@pytest.mark.parametrize("model", ["fluctuating", "gaussian", "steady"])
def test_simulated_amplitudes_cross_at_the_stated_rates(model):
    scene = ClutterScene(target=model, signal_to_noise=4.5, half_width=60.0)
    runs = 20_000
    scan = simulate_scan(np.random.default_rng(1), np.zeros((runs, 2)), scene)
    cells = 120.0**2 / 900.0
    for false_alarm in np.array([0.3, 0.1, 0.01]):
        crossed = scan.amplitude > rayleigh_threshold(false_alarm)
        expected = float(model_curve(model, 4.5).detection(false_alarm))
        error = math.sqrt(expected * (1.0 - expected) / runs)
        assert abs((crossed & scan.from_target).sum() / runs - expected) < 4.0 * error
        clutter = (crossed & ~scan.from_target).sum() / runs
        mean = float(false_alarm) * cells
        assert abs(clutter - mean) < 4.0 * math.sqrt(mean / runs)
