"""One scan of the clutter filter: rules and models, against what follows by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Scan, step
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.estimation.operating_curve import model_curve
from uwtrack_cli.estimation.track_score import track_score

CURVE = model_curve("fluctuating", 10.0)
QUIET, LIVELY = 1.0, 400.0


def setting(rule, **changes):
    """Return the facts of a detector in the plane."""
    facts = {
        "rule": rule, "curve": CURVE, "dimension": 2, "gate": 4.0, "cell_volume": 30.0,
        "false_alarm": 0.05, "limits": (1e-4, 0.3),
    }  # fmt: skip
    return ClutterSetting(**(facts | changes))


def scan_of(points, amplitudes):
    """Return one scan of measurements with unit deviations."""
    measured = np.array(points, dtype=float)[None]
    present = np.ones(measured.shape[:2], dtype=bool)
    return Scan(measured, present, np.array(amplitudes)[None], np.eye(2)[None, None])


def take(variances, scan, facts, probability, switching=None):
    """Carry filters of some acceleration variances over a scan after 1 s."""
    n = len(variances)
    models = [constant_velocity(1.0, variance, 2) for variance in variances]
    belief = Belief(
        np.zeros((n, 1, 4)), np.tile(np.eye(4), (n, 1, 1, 1)),
        np.array(probability, dtype=float)[:, None],
    )  # fmt: skip
    return step(
        belief, scan, facts, transition=models[0][0],
        noise=np.stack([noise for _, noise in models]),
        switching=np.eye(n) if switching is None else switching,
    )  # fmt: skip


def test_two_models_that_never_change_are_the_mixture_of_their_filters():
    scan = scan_of([[1.0, -0.5], [2.5, 1.5]], [4.0, 3.0])
    both = take([QUIET, LIVELY], scan, setting("fixed"), [0.7, 0.3])
    one = take([QUIET], scan, setting("fixed"), [1.0]).association
    two = take([LIVELY], scan, setting("fixed"), [1.0]).association
    ratios = np.array([one.log_likelihood_ratio[0], two.log_likelihood_ratio[0]])
    weights = np.array([0.7, 0.3]) * np.exp(ratios)
    found = both.association
    assert found.log_likelihood_ratio[0] == pytest.approx(math.log(weights.sum()))
    after = weights / weights.sum()
    np.testing.assert_allclose(both.belief.probability[:, 0], after)
    assert found.miss[0] == pytest.approx(after @ [one.miss[0], two.miss[0]])
    np.testing.assert_allclose(found.weight[0], after @ np.stack([one.weight[0], two.weight[0]]))


@pytest.mark.parametrize("rule", ["fixed", "prior", "posterior"])
def test_a_measurement_that_one_model_expects_is_validated(rule):
    scan = scan_of([[25.0, 0.0]], [6.0])
    assert not take([QUIET], scan, setting(rule), [1.0]).point.allowed.any()
    both = take([QUIET, LIVELY], scan, setting(rule), [0.5, 0.5])
    assert both.point.allowed.all()
    assert both.belief.probability[1, 0] > 0.51


def test_the_region_is_searched_where_the_widest_model_reaches():
    scan = scan_of([[0.0, 0.0]], [5.0])
    both = take([QUIET, LIVELY], scan, setting("fixed"), [0.5, 0.5])
    wide = take([LIVELY], scan, setting("fixed"), [1.0])
    np.testing.assert_allclose(both.gate_volume, wide.gate_volume)


@pytest.mark.parametrize(
    ("cell", "snr"),
    [(3.0, 10.0), (30.0, 10.0), (30.0, 4.5), (90.0, 10.0), (150.0, 10.0), (1e4, 10.0)],
)
def test_the_two_step_rule_shrinks_to_the_smaller_radius_but_not_below_a_cell(cell, snr):
    from scipy.stats import norm

    scan = scan_of([[0.0, 0.0]], [5.0])
    facts = {"cell_volume": cell, "curve": model_curve("fluctuating", snr)}
    found = take([QUIET], scan, setting("region", **facts), [1.0])
    prior = take([QUIET], scan, setting("prior", **facts), [1.0])
    chosen = float(found.point.false_alarm[0])
    assert chosen == float(prior.point.false_alarm[0])
    size = math.sqrt(np.linalg.det(2.25 * np.eye(2) + np.eye(2)))
    assert float(prior.gate_volume[0]) == pytest.approx(math.pi * 16.0 * size)
    radii = (3.0 - norm.ppf(float(found.point.detection[0])), math.sqrt(-2.0 * math.log(chosen)))
    one_cell = math.sqrt(cell / (math.pi * size))
    expected = min(max(min(radii), one_cell), 4.0)
    assert float(found.gate[0]) == pytest.approx(expected, rel=1e-9)
    assert float(found.gate_volume[0]) == pytest.approx(math.pi * expected**2 * size)


def test_a_scan_of_unequal_deviations_is_searched_with_the_mean_of_their_noise():
    scan = scan_of([[0.0, 0.0], [1.0, 1.0]], [5.0, 4.0])
    noise = np.array([[np.diag([1.0, 4.0]), np.diag([3.0, 2.0])]])
    found = take([QUIET], replace(scan, noise=noise), setting("fixed"), [1.0])
    size = math.sqrt(np.linalg.det(2.25 * np.eye(2) + np.diag([2.0, 3.0])))
    assert float(found.gate_volume[0]) == pytest.approx(math.pi * 16.0 * size)


def test_page_s_test_follows_its_recursion():
    ratios = np.random.default_rng(1).normal(0.4, 2.0, 200)
    score, cusum = track_score(ratios)
    expected, value = [], 0.0
    for ratio in ratios:
        value = max(0.0, value + 0.5 - ratio)
        expected.append(value)
    np.testing.assert_allclose(cusum, expected, atol=1e-9)
    np.testing.assert_allclose(score, np.cumsum(ratios))
