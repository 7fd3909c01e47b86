"""The chosen thresholds against published optima and brute force."""

import numpy as np
import pytest
from scipy.stats import chi2

from studies.rows import load_reference
from uwtrack_cli.estimation.detection_threshold import (
    background_extrema,
    best_posterior,
    best_prior,
    prior_rule,
)
from uwtrack_cli.estimation.information_reduction import information_reduction
from uwtrack_cli.estimation.operating_curve import model_curve
from uwtrack_cli.estimation.probabilistic_association import associate, correct, innovate

OPTIMA = load_reference("clutter")["prior_optimum"]
MODELS = {"power": "fluctuating", "gaussian": "gaussian"}
LIMITS = (1e-4, 0.3)


@pytest.mark.parametrize(
    "point", OPTIMA, ids=lambda p: f"{p['model']} {p['snr']:.3g} N={p['cells']:g}"
)
def test_the_published_optimum_before_the_scan_is_met(point):
    snr = point["snr"] if point["model"] == "power" else point["snr"] ** 2 / 2.0
    curve = model_curve(MODELS[point["model"]], snr)
    cells = np.array([point["cells"]])
    false_alarm = best_prior(curve, cells, (1e-5, 0.96))
    q2 = information_reduction(curve.detection(false_alarm), false_alarm * cells)
    assert false_alarm[0] == pytest.approx(point["false_alarm_probability"], rel=0.01)
    assert q2[0] == pytest.approx(point["q2"], abs=1e-5)


def test_the_tabulated_rule_loses_nothing_against_the_exact_optimum():
    curve = model_curve("fluctuating", 10.0)
    cells = np.geomspace(0.3, 3000.0, 23)
    quick = prior_rule(curve, LIMITS, dimension=2, gate=4.0)(cells)
    exact = best_prior(curve, cells, LIMITS)
    q2 = [information_reduction(curve.detection(p), p * cells) for p in (quick, exact)]
    np.testing.assert_allclose(q2[0], q2[1], atol=1e-5)


def _scans(runs, points, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(0.0, 3.0, (runs, 4, 4))
    covariance = root @ np.swapaxes(root, -1, -2) + 20.0 * np.eye(4)
    measured = rng.normal(0.0, 9.0, (runs, points, 2))
    amplitude = rng.rayleigh(1.6, (runs, points))
    present = rng.random((runs, points)) < 0.8
    innovation = innovate(np.zeros((runs, 4)), covariance, measured, present, 5.0 * np.eye(2)[None])
    return covariance, innovation, amplitude, innovation.distance2 < 16.0


@pytest.mark.parametrize(("model", "signal_to_noise"), [("fluctuating", 10.0), ("gaussian", 4.5)])
def test_the_threshold_after_the_scan_is_never_below_a_fine_grid(model, signal_to_noise):
    curve = model_curve(model, signal_to_noise)
    covariance, innovation, amplitude, gated = _scans(300, 6, seed=1)
    inside = chi2.cdf(16.0, 2)
    before = np.trace(covariance, axis1=1, axis2=2)
    point, gain = best_posterior(
        curve, LIMITS, innovation, amplitude, gated, cell_volume=900.0, gate=4.0,
        extrema=background_extrema(curve, LIMITS, inside),
    )  # fmt: skip

    def realised(false_alarm, allowed):
        association = associate(
            innovation, allowed, clutter_density=false_alarm / 900.0,
            detection_probability=curve.detection(false_alarm), gate_probability=inside,
        )  # fmt: skip
        after = correct(np.zeros((300, 4)), covariance, innovation, association)[1]
        return before - np.trace(after, axis1=1, axis2=2)

    np.testing.assert_allclose(
        realised(point.false_alarm, point.allowed), gain, rtol=1e-9, atol=1e-9
    )
    for false_alarm in np.geomspace(*LIMITS, 1500):
        allowed = gated & (amplitude > curve.threshold(false_alarm))
        fixed = realised(np.full(300, false_alarm), allowed)
        assert np.all(gain >= fixed - 1e-9)


def test_an_empty_gate_gives_no_gain_and_no_measurement():
    curve = model_curve("fluctuating", 10.0)
    _, innovation, amplitude, gated = _scans(5, 3, seed=2)
    point, gain = best_posterior(
        curve, LIMITS, innovation, amplitude, np.zeros_like(gated), cell_volume=900.0,
        gate=4.0, extrema=np.empty(0),
    )  # fmt: skip
    assert not point.allowed.any()
    np.testing.assert_array_equal(gain, 0.0)
    assert np.all((point.false_alarm > 0.99e-4) & (point.false_alarm < 0.301))


def test_cells_of_any_shape_have_the_optimum_of_each():
    curve = model_curve("fluctuating", 10.0)
    cells = np.array([[1.0, 5.0, 20.0], [2.0, 50.0, 200.0]])
    found = best_prior(curve, cells, (1e-4, 0.3))
    one_by_one = [best_prior(curve, np.array([c]), (1e-4, 0.3))[0] for c in cells.flat]
    np.testing.assert_allclose(found.ravel(), one_by_one, rtol=1e-12)
