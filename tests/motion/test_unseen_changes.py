"""Changes too small to be seen, and intervals of answers that are far apart."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from tests.draws.measured_passages import analyse, draw
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.estimation.normal_mixture import half_width
from uwtrack_cli.motion.passage.model.unknowns import STEP
from uwtrack_cli.motion.passage.readings.change_priors import ODDS, SIZES
from uwtrack_cli.motion.passage.readings.change_scores import Scores
from uwtrack_cli.motion.passage.readings.unseen_changes import unseen_change

SPEED_MPS, WIDTH_S, HEIGHT_M = 6.0, 30.0, 19.0
MOVES = np.array([50.0, 2.0, 400.0, 0.0, 30.0])
"""What time, ln d/v, speed, depth and bearing move by for each unit of a step."""


def straight():
    theta = np.array([[300.0, np.log(WIDTH_S), SPEED_MPS, 0.0, HEIGHT_M]])
    covariance = np.diag([0.5, 0.5, 0.05, 1.0])[None] ** 2
    return SimpleNamespace(theta=theta, covariance=covariance, medium=Medium(1500.0, HEIGHT_M))


def scores(best, std):
    """Stand for the score of a step of known size at one instant."""
    information = np.array([[[std**-2.0]]])
    return Scores(
        STEP, np.array([0.5 * (best / std) ** 2]), np.array([200.0]), np.ones(1),
        np.zeros((1, 6)), np.ones(1), np.array([[best / std**2]]), information,
        MOVES[None, :, None],
    )  # fmt: skip


def prior(size):
    low, high = SIZES[STEP]
    return 0.5 / (max(abs(size), low) * (np.log(high / low) + 1.0))


@pytest.mark.parametrize("best", [0.0, 6e-4, -1.2e-3])
def test_the_evidence_of_an_unseen_change_is_the_integral_over_its_prior(best):
    std = 6e-4
    low, high = SIZES[STEP]
    marks = [-high, -10 * std, -low, low, 10 * std, high]

    def average(value):
        return sum(
            quad(
                lambda x: value(x) * prior(x) * np.exp((best * x - x**2 / 2) / std**2),
                *ends, limit=200,
            )[0]
            for ends in pairwise(marks)
        )  # fmt: skip

    found = unseen_change(scores(best, std), straight(), SimpleNamespace())
    total = average(lambda _: 1.0)
    assert found.log_evidence == pytest.approx(np.log(total) - ODDS[STEP], abs=0.03)
    square = average(lambda x: x**2) / total
    moved = MOVES[[0, 1, 2, 4, 3]] * [1.0, WIDTH_S, 1.0, 1.0, 1.0]
    assert np.diag(found.flat) == pytest.approx(square * moved**2, rel=0.05)
    # half a deviation of the speed, which moves farthest
    edge = 0.5 * 0.05 / MOVES[2]
    share = average(lambda x: float(abs(x) > edge)) / total
    assert found.share == pytest.approx(share, abs=0.05)


def test_a_change_that_would_leave_the_linear_law_is_none():
    """Without information every size is alike, and most would move the speed too far."""
    found = unseen_change(scores(0.0, 1e3), straight(), SimpleNamespace())
    assert np.sqrt(found.flat[2, 2]) < 0.5 * SPEED_MPS
    assert found.log_evidence < -ODDS[STEP]


@pytest.mark.parametrize(
    ("share", "mean", "std"),
    [([1.0], [0.0], [2.0]), ([0.9, 0.1], [0.0, 8.0], [1.0, 1.0]),
     ([0.97, 0.03], [0.0, 8.0], [1.0, 1.0]), ([0.5, 0.5], [0.0, -3.0], [1.0, 0.4])],
)  # fmt: skip
def test_the_half_width_holds_95_percent_of_what_is_drawn(share, mean, std):
    rng = np.random.default_rng(5)
    part = rng.choice(len(share), size=200_000, p=share)
    drawn = rng.normal(np.array(mean)[part], np.array(std)[part])
    half = half_width(*map(np.array, (share, mean, std)))
    # three deviations of the share among so many
    assert (np.abs(drawn) < half).mean() == pytest.approx(0.95, abs=0.0015)


def test_a_straight_passage_is_not_certain_to_be_one():
    found = analyse(draw("straight", 121001))
    assert found.motion_model[0] == "straight"
    assert 0.9 < found.motion_model_probability[0] < 0.995
