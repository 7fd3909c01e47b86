"""GOSPA and OSPA against Stone Soup, and against every assignment there is."""

import datetime as dt
from itertools import permutations

import numpy as np
import pytest
from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
from stonesoup.types.state import State

from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.scoring.track_scores import gospa, ospa

NOW = dt.datetime(2024, 5, 1, tzinfo=dt.UTC)
SIZES = [(0, 3), (2, 0), (1, 1), (3, 3), (4, 2), (2, 5)]


def states(points):
    return [State(point.reshape(2, 1), timestamp=NOW) for point in points]


def sets(n, m, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 100, (n, 2)), rng.uniform(0, 100, (m, 2))


@pytest.mark.parametrize(("n", "m"), SIZES)
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_gospa_is_that_of_stone_soup(n, m, order):
    for seed in range(5):
        found, true = sets(n, m, seed)
        metric, _ = GOSPAMetric(p=order, c=40.0).compute_gospa_metric(states(found), states(true))
        ours = gospa(found, true, cutoff_m=40.0, order=order)
        assert ours.distance_m == pytest.approx(metric.value["distance"], abs=1e-9)


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_ospa_of_order_one_is_that_of_stone_soup(n, m):
    for seed in range(5):
        found, true = sets(n, m, seed)
        theirs = OSPAMetric(p=1.0, c=40.0).compute_OSPA_distance(states(found), states(true))
        assert ospa(found, true, cutoff_m=40.0, order=1.0) == pytest.approx(theirs.value)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 3), (4, 2), (2, 5)])
def test_ospa_of_order_two_is_the_least_over_all_assignments(n, m):
    found, true = sets(n, m, 9)
    small, large = (found, true) if n <= m else (true, found)
    least = min(
        sum(min(np.linalg.norm(small[i] - large[j]), 40.0) ** 2 for i, j in enumerate(order))
        for order in permutations(range(len(large)), len(small))
    )
    expected = np.sqrt((least + 40.0**2 * abs(n - m)) / max(n, m))
    assert ospa(found, true, cutoff_m=40.0) == pytest.approx(expected)


def test_two_empty_sets_are_the_same():
    assert ospa(np.zeros((0, 2)), np.zeros((0, 2)), cutoff_m=1.0) == 0.0
    assert gospa(np.zeros((0, 2)), np.zeros((0, 2)), cutoff_m=1.0).distance_m == 0.0


def test_a_cutoff_must_be_positive():
    with pytest.raises(OptionError, match="cutoff_m must be positive"):
        gospa(np.zeros((1, 2)), np.zeros((1, 2)), cutoff_m=0.0)
