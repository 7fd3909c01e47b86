"""One scan from a Gaussian prediction: what a rule reports and what it achieves.

**Method.** The target lies where the prediction's covariance says. One scan is taken, and
the decrease of the variance that the filter reports is compared with the decrease of the
squared error that really came of it, both over the decrease without clutter.

**References.** Choi, Kim and Hong (2001), section III: the claim under test is that a
smaller validation region leaves less variance.
"""

import math
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.clutter.clutter_filter import ClutterSetting, Scan, step
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.flow.studies.clutter_runs import Scene, setting_of
from uwtrack_cli.simulate.clutter import ClutterScene, simulate_scan

INNOVATION_VARIANCES_M2 = (25.0, 100.0, 400.0)
_NOISE_M2, _HIGHEST = 5.0, 0.3


@dataclass(frozen=True)
class OneStep:
    """Factors of variance reduction with their standard errors."""

    reported: float
    reported_error: float
    true: float
    true_error: float


def one_step(
    scene: Scene, innovation_variance: float, *, runs: int, seed: int
) -> dict[str, OneStep]:
    """Take one scan under every rule.

    Parameters
    ----------
    scene
        The detector.
    innovation_variance
        Variance S of each component of the innovation in m^2, above 5.
    runs
        Number of independent scans, from 1.
    seed
        Seed of all random numbers.

    Returns
    -------
    dict
        Reported and true factor per rule, named as in the reference table.
    """
    rng = np.random.default_rng(seed)
    spread = innovation_variance - _NOISE_M2
    truth = math.sqrt(spread) * rng.standard_normal((runs, 2))
    detector = ClutterScene(
        target=scene.target, signal_to_noise=scene.signal_to_noise,
        noise_std=math.sqrt(_NOISE_M2), false_alarm=_HIGHEST,
        half_width=8.0 * math.sqrt(innovation_variance),
    )  # fmt: skip
    drawn = simulate_scan(rng, truth, detector)
    scan = Scan(
        drawn.measured, np.isfinite(drawn.amplitude), drawn.amplitude,
        _NOISE_M2 * np.eye(2)[None],
    )  # fmt: skip
    best = 2.0 * spread**2 / innovation_variance
    return {
        name: _factors(setting, scan, truth, spread, best)
        for name, setting in _settings(scene).items()
    }


def _settings(scene: Scene) -> dict[str, ClutterSetting]:
    curve = scene.curve
    return {
        **{
            f"fixed {level:g}": setting_of("fixed", curve, level)
            for level in (0.3, 0.1, 0.03, 0.01)
        },
        "prior": setting_of("prior", curve),
        "two-step lit": setting_of("region", curve),
        "posterior": setting_of("posterior", curve),
    }


def _factors(
    setting: ClutterSetting,
    scan: Scan,
    truth: FloatArray,
    spread: float,
    best: float,
) -> OneStep:
    runs = truth.shape[0]
    prediction = np.tile(np.diag([spread, 0.0, spread, 0.0]), (1, runs, 1, 1))
    outcome = step(
        Belief(np.zeros((1, runs, 4)), prediction, np.ones((1, runs))), scan, setting,
        transition=np.eye(4), noise=np.zeros((1, 4, 4)), switching=np.ones((1, 1)),
    )  # fmt: skip
    after = np.trace(outcome.covariance, axis1=1, axis2=2)
    reported = (2.0 * spread - after) / best
    left = ((outcome.mean[:, ::2] - truth) ** 2).sum(axis=1)
    true = ((truth**2).sum(axis=1) - left) / best
    root = math.sqrt(runs)
    return OneStep(
        float(reported.mean()), float(reported.std() / root),
        float(true.mean()), float(true.std() / root),
    )  # fmt: skip
