"""Tracks through clutter by the hundred: one scene, every method, the same scans.

**Method.** All runs are stepped together; the methods see the same measurements, so that
differences between them are paired. A track is lost when its position is more than
100 m wrong or its position variance exceeds (100 m)^2 at any scan from the seventh on;
errors and variances are averaged over the runs that were kept.

**References.** Choi, Kim and Hong (2001), section IV, with the resolutions of everything
that the paper leaves open.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from studies.clutter_scans import (
    ClutterScene,
    SimulatedScan,
    constant_velocity_truth,
    simulate_scan,
)
from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Scan, ThresholdRule, step
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.imm import Belief, advance, moments
from uwtrack_cli.estimation.operating_curve import OperatingCurve, TargetModel, model_curve
from uwtrack_cli.estimation.probabilistic_association import Association, correct, innovate
from uwtrack_cli.estimation.track_score import track_score

N_SCANS = 50
_SETTLED = 6
_LOST_M = 100.0
_VARIANCE_M2, _CELL_M2, _GATE = 5.0, 900.0, 4.0
_LIMITS = (1e-4, 0.3)
_START = (-10_000.0, 50.0, 10_000.0, -50.0)
_START_STD = 10.0
_NEAREST_FALSE_ALARM = 0.05
_LOSS_SCORE = 10.0


class Estimate(NamedTuple):
    """What a method has after a scan, for every run."""

    mean: FloatArray
    """State, ``(run, 4)``."""
    covariance: FloatArray
    """Its covariance, ``(run, 4, 4)``."""
    log_likelihood_ratio: FloatArray
    """Logarithm of the scan's likelihood with the target over without, ``(run,)``."""


@dataclass(frozen=True)
class ClutterExperiment:
    """One experiment: detector, truth and the filters' process noise."""

    name: str
    """Name in the reference tables."""
    target: TargetModel
    """Behaviour of the target's amplitude."""
    signal_to_noise: float
    """Power ratio of the target."""
    acceleration_variance: float = 10.0
    """Variance of the filters' acceleration, m^2/s^4."""
    manoeuvre: bool = False
    """Whether the target manoeuvres from 20 s to 25 s."""

    @property
    def curve(self) -> OperatingCurve:
        """The detector's operating curve."""
        return model_curve(self.target, self.signal_to_noise)


EXPERIMENTS = (
    ClutterExperiment("matched S15dB", "fluctuating", 10.0**1.5),
    ClutterExperiment("matched S10dB", "fluctuating", 10.0),
    ClutterExperiment("matched Fig1", "gaussian", 4.5),
    ClutterExperiment("man Q225 S20dB", "fluctuating", 100.0, 225.0, manoeuvre=True),
    ClutterExperiment("man Q225 G6 (s=6)", "gaussian", 18.0, 225.0, manoeuvre=True),
)


@dataclass
class TrackTally:
    """What a method did in each run, gathered scan by scan."""

    lost: BoolArray
    """Whether the track was lost at any scan, ``(run,)``."""
    sums: FloatArray
    """Squared position and velocity error, both variances and NEES, ``(5, run)``."""
    ratios: list[FloatArray] = field(default_factory=list)
    """Log likelihood ratio of each scan, ``(run,)`` each."""

    @classmethod
    def empty(cls, runs: int) -> "TrackTally":
        """Return a tally before the first scan."""
        return cls(np.zeros(runs, dtype=bool), np.zeros((5, runs)))

    def add(self, number: int, truth: FloatArray, estimate: Estimate) -> None:
        """Count one scan."""
        mean, covariance, ratio = estimate
        self.ratios.append(ratio)
        if number < _SETTLED:
            return
        error = mean - truth
        variance = np.diagonal(covariance, axis1=-2, axis2=-1)
        place = (error[:, ::2] ** 2).sum(axis=-1)
        spread = variance[:, ::2].sum(axis=-1)
        whitened = np.linalg.solve(covariance, error[..., None])[..., 0]
        self.lost = self.lost | (place > _LOST_M**2) | (spread > _LOST_M**2)
        self.sums += np.stack([
            place, (error[:, 1::2] ** 2).sum(axis=-1), spread,
            variance[:, 1::2].sum(axis=-1), (error * whitened).sum(axis=-1),
        ])  # fmt: skip

    @property
    def flagged(self) -> BoolArray:
        """Runs whose test for a loss was above its limit at any scan."""
        _, cusum = track_score(np.stack(self.ratios))
        return np.asarray((cusum > _LOSS_SCORE).any(axis=0))

    @property
    def means(self) -> FloatArray:
        """Averages over the settled scans, ``(5, run)``."""
        return self.sums / (N_SCANS - _SETTLED)


class MethodRun:
    """A filter with its own belief about every run."""

    def __init__(
        self, belief: Belief, setting: ClutterSetting, variances: tuple[float, ...]
    ) -> None:
        models = [constant_velocity(1.0, each, 2) for each in variances]
        count = len(models)
        self.belief = Belief(
            np.repeat(belief.mean, count, axis=0),
            np.repeat(belief.covariance, count, axis=0),
            np.repeat(belief.probability / count, count, axis=0),
        )
        self.setting = setting
        self.transition = models[0][0]
        self.noise = np.stack([noise for _, noise in models])
        stay = np.array([[0.98, 0.02], [0.2, 0.8]])
        self.switching = stay if count > 1 else np.ones((1, 1))

    def step(self, scan: SimulatedScan) -> Estimate:
        """Take a scan with clutter."""
        fixed = self.setting.rule == "fixed"
        lowest = self.setting.false_alarm if fixed else _LIMITS[1]
        outcome = step(
            self.belief, _cut(scan, lowest), self.setting, transition=self.transition,
            noise=self.noise, switching=self.switching,
        )  # fmt: skip
        self.belief = outcome.belief
        ratio = outcome.association.log_likelihood_ratio
        return Estimate(outcome.mean, outcome.covariance, ratio)

    def step_nearest(
        self, measured: FloatArray, present: BoolArray, gate: float = _GATE
    ) -> Estimate:
        """Take the nearest measurement in the gate as the target's, for certain."""
        predicted = advance(self.belief, self.transition, self.noise)
        noise = _VARIANCE_M2 * np.eye(2)[None]
        each = innovate(predicted.mean, predicted.covariance, measured, present, noise)
        distance2 = each.distance2
        nearest = distance2 == distance2.min(axis=-1, keepdims=True)
        weight = (nearest & (distance2 < gate**2)).astype(np.float64)
        miss = 1.0 - weight.sum(axis=-1)
        certain = Association(miss, weight, np.zeros_like(miss))
        state, spread = correct(predicted.mean, predicted.covariance, each, certain)
        self.belief = Belief(state, spread, predicted.probability)
        return Estimate(*moments(self.belief), np.zeros(miss.shape[-1]))


def run_scene(scene: ClutterExperiment, *, runs: int, seed: int) -> dict[str, TrackTally]:
    """Run every method through a scene's scans.

    ``runs``: number of independent runs, from 1.

    Returned: a tally per method, named as in the reference tables.
    """
    rng = np.random.default_rng(seed)
    start = np.tile(_START, (runs, 1))
    truth = _manoeuvre(start) if scene.manoeuvre else constant_velocity_truth(
        rng, start, scans=N_SCANS, interval_s=1.0,
        acceleration_std=math.sqrt(scene.acceleration_variance),
    )  # fmt: skip
    methods = _methods(scene, start + _START_STD * rng.standard_normal(start.shape))
    tallies = {name: TrackTally.empty(runs) for name in methods}
    detector = ClutterScene(
        target=scene.target, signal_to_noise=scene.signal_to_noise,
        noise_std=math.sqrt(_VARIANCE_M2), cell_volume=_CELL_M2, false_alarm=_LIMITS[1],
    )  # fmt: skip
    for number, state in enumerate(truth):
        scan = simulate_scan(rng, state[:, ::2], detector)
        own = state[:, None, ::2] + math.sqrt(_VARIANCE_M2) * rng.standard_normal((runs, 1, 2))
        for name, method in methods.items():
            if name == "KF-clean":
                estimate = method.step_nearest(own, np.ones((runs, 1), bool), np.inf)
            elif name in {"KF-detect", "NN.05"}:
                part = _cut(scan, _NEAREST_FALSE_ALARM)
                mine = scan.from_target[:, : part.present.shape[1]]
                clean = name == "KF-detect"
                estimate = method.step_nearest(
                    part.measured,
                    part.present & mine if clean else part.present,
                    np.inf if clean else _GATE,
                )
            else:
                estimate = method.step(scan)
            tallies[name].add(number, state, estimate)
    return tallies


def setting_of(
    rule: ThresholdRule, curve: OperatingCurve, false_alarm: float = 0.01
) -> ClutterSetting:
    """Return the paper's detector and gate with a threshold rule."""
    return ClutterSetting(
        rule=rule, curve=curve, dimension=2, gate=_GATE, cell_volume=_CELL_M2,
        false_alarm=false_alarm, limits=_LIMITS,
    )  # fmt: skip


def _methods(scene: ClutterExperiment, start: FloatArray) -> dict[str, MethodRun]:
    runs = start.shape[0]
    covariance = np.tile(_START_STD**2 * np.eye(4), (1, runs, 1, 1))
    belief = Belief(start[None], covariance, np.ones((1, runs)))
    curve, variances = scene.curve, (scene.acceleration_variance,)
    fixed = setting_of("fixed", curve)
    prior = setting_of("prior", curve)
    settings = {
        "KF-clean": fixed,
        "KF-detect": fixed,
        "NN.05": fixed,
        "fix.1": setting_of("fixed", curve, 0.1),
        "fix.03": setting_of("fixed", curve, 0.03),
        "fix.01": fixed,
        "prior": prior,
        "post": setting_of("posterior", curve),
        "TS-lit": setting_of("region", curve),
    }
    methods = {name: MethodRun(belief, setting, variances) for name, setting in settings.items()}
    if scene.manoeuvre:
        methods["prior, two models"] = MethodRun(belief, prior, (1.0, *variances))
    return methods


def _cut(scan: SimulatedScan, false_alarm: float) -> Scan:
    """Keep the columns that some run needs at a false alarm probability."""
    above = scan.amplitude >= math.sqrt(-2.0 * math.log(false_alarm))
    columns = max(1, int(above.sum(axis=1).max(initial=0)))
    return Scan(
        scan.measured[:, :columns], above[:, :columns], scan.amplitude[:, :columns],
        _VARIANCE_M2 * np.eye(2)[None],
    )  # fmt: skip


def _manoeuvre(start: FloatArray) -> FloatArray:
    """Return the paper's truth: 30 and 15 m/s^2 from 20 s to 25 s, else straight."""
    transition, _ = constant_velocity(1.0, 0.0, 2)
    states, state = [], np.array(start)
    for number in range(N_SCANS):
        push = np.array([15.0, 30.0, 7.5, 15.0]) if 20 <= number < 25 else 0.0
        state = state @ transition.T + push
        states.append(state)
    return np.stack(states)
