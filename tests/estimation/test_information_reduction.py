"""The factor q2 against published tables, limits and a direct simulation."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from studies.rows import load_reference
from uwtrack_cli.estimation.information_reduction import (
    gate_probability,
    information_reduction,
    unit_ball_volume,
)

TABLES = load_reference("clutter")["information_reduction"]


@pytest.mark.parametrize("table", TABLES, ids=lambda t: f"M={t['dimension']},g={t['gate']:g}")
def test_every_entry_of_the_reference_table_is_met_to_1e_5(table):
    ours = information_reduction(
        np.array(table["detection_probability"])[:, None],
        np.array(table["expected_clutter"]),
        dimension=table["dimension"],
        gate=table["gate"],
    )
    np.testing.assert_allclose(ours, table["q2"], rtol=0.0, atol=1e-5)


@pytest.mark.parametrize(("dimension", "gate"), [(1, 3.0), (2, 4.0), (3, 4.0), (4, 5.0)])
def test_without_clutter_only_misses_and_the_gate_cost_information(dimension, gate):
    expected = 0.7 * chi2.cdf(gate**2, dimension + 2)
    ours = information_reduction(0.7, 0.0, dimension=dimension, gate=gate)
    assert ours == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
def test_the_gate_probability_is_the_chi_square_distribution(dimension):
    assert gate_probability(2.5, dimension) == pytest.approx(chi2.cdf(6.25, dimension))


def test_the_unit_ball_has_its_textbook_volume():
    assert [unit_ball_volume(m) for m in (1, 2, 3)] == pytest.approx(
        [2.0, math.pi, 4.0 * math.pi / 3.0]
    )


def test_more_clutter_and_fewer_detections_never_help():
    detection = np.linspace(0.05, 1.0, 20)[:, None]
    clutter = np.concatenate([[0.0], np.logspace(-3, 2, 20)])
    q2 = information_reduction(detection, clutter)
    assert np.all(np.diff(q2, axis=0) > 0.0)
    assert np.all(np.diff(q2, axis=1) < 0.0)


def test_a_wider_gate_never_loses_information_at_a_given_clutter_density():
    reference = np.array(load_reference("clutter")["gate_size"])
    for gate, _, q2, *_ in reference:
        ours = information_reduction(0.8, 2.0 * (gate / 4.0) ** 2, gate=gate)
        assert ours == pytest.approx(q2, abs=1e-5)


def test_a_direct_simulation_of_the_association_gives_the_same_factor():
    detection, clutter, gate, runs = 0.8, 2.0, 4.0, 40_000
    rng = np.random.default_rng(5)
    count = rng.poisson(clutter, runs)
    places = rng.uniform(-gate, gate, (runs, 60, 2))
    inside = (places**2).sum(axis=-1) < gate**2
    inside &= np.cumsum(inside, axis=1) <= count[:, None]
    target = rng.standard_normal((runs, 1, 2))
    seen = (rng.random((runs, 1)) < detection) & ((target**2).sum(-1) < gate**2)
    points = np.concatenate([target, places], axis=1)
    weight = np.where(
        np.concatenate([seen, inside], axis=1), np.exp(-0.5 * (points**2).sum(-1)), 0.0
    )
    background = 2.0 * clutter / gate**2 * (1 - detection * gate_probability(gate, 2)) / detection
    weight /= background + weight.sum(axis=1, keepdims=True)
    gained = ((weight[..., None] * points).sum(axis=1) ** 2).sum(axis=-1) / 2.0
    error = gained.std() / math.sqrt(runs)
    assert abs(gained.mean() - information_reduction(detection, clutter)) < 3.0 * error
