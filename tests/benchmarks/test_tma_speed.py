"""CPU time of the target-motion solvers as ratios to scipy's on the same misfit."""

import numpy as np
import pytest

from studies.tma_runs import PAPER, cpu_of, one_record, solve_by_descent, solve_by_peer
from tests.draws.sonar_tables import heard, own_ship
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.target_motion.solvers.recursive import estimate_recursively
from uwtrack_cli.motion.tma import estimate_motion

pytestmark = pytest.mark.benchmark


@pytest.fixture(scope="session")
def record():
    return one_record("S3", 1.0, seed=1)


@pytest.fixture(scope="session")
def evolution_s(record):
    """Median CPU time of three differential-evolution solves, s."""
    return float(
        np.median([
            cpu_of(lambda seed=seed: solve_by_peer(
                record, "differential_evolution", seed))
            for seed in (1, 2, 3)
        ])
    )  # fmt: skip


def test_the_descent_is_twenty_times_faster_than_differential_evolution(record, evolution_s):
    assert evolution_s / cpu_of(lambda: solve_by_descent(record), 5) >= 20.0


def test_the_whole_call_is_five_times_faster_than_differential_evolution(evolution_s):
    table, ship = heard("S3"), own_ship("S3")

    def whole():
        return estimate_motion(
            table, None, ship, sound_speed_mps=1480.0, updates=1,
            model=MotionModel(doppler="interval"),
            nuisances=Nuisances(0.0, 0.0, 0.0, 0.0),
        )  # fmt: skip

    whole()
    ratio = evolution_s / cpu_of(whole, 5)
    print(f"\ntma, whole call: {ratio:.1f} times faster than differential evolution")
    assert ratio >= 5.0


def test_the_descent_is_forty_times_faster_than_dual_annealing(record):
    annealing_s = np.median([
        cpu_of(lambda seed=seed: solve_by_peer(record, "dual_annealing", seed))
        for seed in (1, 2, 3)
    ])  # fmt: skip
    assert annealing_s / cpu_of(lambda: solve_by_descent(record), 5) >= 40.0


def test_a_thousand_recursive_updates_take_less_than_two_evolution_solves(record, evolution_s):
    updates_s = cpu_of(lambda: estimate_recursively(record, PAPER), 3)
    assert updates_s <= 2.0 * evolution_s
