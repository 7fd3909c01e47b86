"""Target motion from data with outliers, started from many points."""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.base import BoolArray
from uwtrack_cli.estimation.target_motion.information import information
from uwtrack_cli.estimation.target_motion.problem import Loss, Problem
from uwtrack_cli.estimation.target_motion.starts import Effort, multistart
from uwtrack_cli.flow.studies.tma_runs import WIDE, motion_errors, succeeded
from uwtrack_cli.flow.studies.tma_scenarios import REST_HZ, make_problem, make_scenario

SHARE = 0.1
LARGEST_HZ = 5.0


def with_outliers(problem: Problem, seed: int) -> Problem:
    """Replace a tenth of bearings by any, and of frequencies within 5 Hz of rest."""
    rng = np.random.default_rng(seed)
    bearing, frequency = problem.bearing_rad, problem.frequency_hz
    anywhere = rng.uniform(-np.pi, np.pi, bearing.shape)
    within = REST_HZ + rng.uniform(-LARGEST_HZ, LARGEST_HZ, frequency.shape)
    return replace(
        problem,
        bearing_rad=np.where(rng.random(bearing.shape) < SHARE, anywhere, bearing),
        frequency_hz=np.where(rng.random(frequency.shape) < SHARE, within, frequency),
    )


def robust_fits(
    name: str, loss: Loss, runs: int, seed: int, *, clean: bool = False
) -> tuple[float, BoolArray]:
    """Fit records with outliers; the error of the range over the clean bound.

    Parameters
    ----------
    name
        Scenario, at one sigma.
    loss
        Loss of a residual.
    runs
        Number of records.
    seed
        Seed of noise and outliers.
    clean
        Whether the outliers are left out.
    """
    scenario = make_scenario(name)
    plain = make_problem(scenario, noise=1.0, runs=runs, seed=seed)
    covariance = information(plain.record(0), scenario.solution()).covariance()
    problem = plain if clean else with_outliers(plain, seed + 1)
    problem = replace(problem, loss=loss)
    found = [
        multistart(problem.record(i), WIDE, effort=Effort(12, 2)).q[0]
        for i in range(runs)
    ]
    errors = motion_errors(np.stack(found), scenario)
    rms = np.sqrt(np.mean(errors[:, 0] ** 2))
    return float(rms / np.sqrt(covariance[0, 0])), succeeded(errors)
