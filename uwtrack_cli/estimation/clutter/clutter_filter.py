"""One scan of the probabilistic data association filter, thresholds included.

**Method.** Predict every motion model, choose the detection threshold for the predicted
validation region (or after looking, or shrink the region), associate, correct, weigh the
models. Any number of targets, each with its own scan, is stepped together.

**Conventions.** As in `uwtrack_cli.estimation.clutter.pda`; leading axis of a belief: model.

**References.** Gelfand, Fortmann and Bar-Shalom (1996); Choi, Kim and Hong (2001);
Houles and Bar-Shalom (1989) for interacting models with data association.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.clutter.detection_threshold import (
    OperatingPoint,
    background_extrema,
    best_posterior,
    prior_rule,
)
from uwtrack_cli.estimation.clutter.information_reduction import (
    gate_probability,
    unit_ball_volume,
)
from uwtrack_cli.estimation.clutter.operating_curve import OperatingCurve
from uwtrack_cli.estimation.clutter.pda import (
    Association,
    Innovation,
    associate,
    correct,
    innovate,
)
from uwtrack_cli.estimation.clutter.validation_region import shrunk_gate
from uwtrack_cli.estimation.imm import Belief, advance, mix, moments, reweigh

ThresholdRule = Literal["fixed", "prior", "posterior", "region"]


@dataclass(frozen=True)
class ClutterSetting:
    """What the filter is told about detector, clutter and gate."""

    rule: ThresholdRule
    curve: OperatingCurve
    dimension: int
    gate: float
    cell_volume: float
    """Volume of a resolution cell; nan with a fixed threshold and density by count."""
    false_alarm: float
    """Operating point of the fixed rule."""
    limits: tuple[float, float]
    """False alarm probabilities that the other rules may choose."""
    count_clutter: bool = False
    """Take the density from the number of measurements in the gate."""
    prior: Callable[[FloatArray], FloatArray] = field(init=False, repr=False)
    extrema: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Tabulate what the rule needs, once."""
        nothing: FloatArray = np.empty(0)
        extrema = nothing
        if self.rule in {"prior", "region"}:
            rule = prior_rule(
                self.curve, self.limits, dimension=self.dimension, gate=self.gate
            )
            object.__setattr__(self, "prior", rule)
        if self.rule == "posterior":
            inside = gate_probability(self.gate, self.dimension)
            extrema = background_extrema(self.curve, self.limits, inside)
        object.__setattr__(self, "extrema", extrema)


@dataclass(frozen=True)
class Scan:
    """One scan per target, padded to the longest."""

    measured: FloatArray
    """``(..., k, m)``."""
    present: BoolArray
    """``(..., k)``."""
    amplitude: FloatArray
    """``(..., k)``; nan passes every fixed threshold."""
    noise: FloatArray
    """Covariances of the measurements, ``(..., k or 1, m, m)``."""


@dataclass(frozen=True)
class Outcome:
    """The filter after a scan, and how it came there."""

    belief: Belief
    mean: FloatArray
    covariance: FloatArray
    point: OperatingPoint
    gate: FloatArray
    gate_volume: FloatArray
    expected_clutter: FloatArray
    association: Association
    """Averaged over the models."""


def step(
    belief: Belief,
    scan: Scan,
    setting: ClutterSetting,
    *,
    transition: FloatArray,
    noise: FloatArray,
    switching: FloatArray,
) -> Outcome:
    """Carry the filters over one scan.

    Parameters
    ----------
    belief
        The filters after the last scan.
    scan
        What was measured.
    setting
        Detector, clutter and gate.
    transition
        F of the time step.
    noise
        Q of each model.
    switching
        Probabilities of changing the model in the time step.

    Returns
    -------
    Outcome
        The filters after this scan with the association's probabilities.
    """
    predicted = advance(mix(belief, switching), transition, noise)
    each = innovate(
        predicted.mean, predicted.covariance, scan.measured, scan.present, scan.noise
    )
    point, gate = _operate(predicted, each, scan, setting)
    # A target may be where any of the models expects it.
    size = _region_size(predicted.covariance, scan).max(axis=0)
    volume = unit_ball_volume(setting.dimension) * gate**setting.dimension * size
    if setting.count_clutter:
        density = point.allowed.sum(axis=-1) / volume
    else:
        density = point.false_alarm / setting.cell_volume
    # The paper shrinks the region and keeps P_G = 1; its cost is shown by the study.
    shrinks = setting.rule == "region"
    inside = 1.0 if shrinks else gate_probability(setting.gate, setting.dimension)
    association = associate(
        each, point.allowed[None], clutter_density=density[None],
        detection_probability=point.detection[None], gate_probability=inside,
    )  # fmt: skip
    state, spread = correct(predicted.mean, predicted.covariance, each, association)
    weight = reweigh(predicted, association.log_likelihood_ratio)
    after = Belief(state, spread, weight)
    return Outcome(
        after, *moments(after), point, np.broadcast_to(gate, size.shape), volume,
        density * volume, _average(association, weight, predicted.probability),
    )  # fmt: skip


def _region_size(covariance: FloatArray, scan: Scan) -> FloatArray:
    """Return |S|^(1/2) with the mean noise of the scan's measurements."""
    shared = scan.noise.shape[-3] == 1
    noise = scan.noise[..., 0, :, :] if shared else scan.noise.mean(axis=-3)
    spread = covariance[..., ::2, ::2] + noise
    size: FloatArray = np.sqrt(np.linalg.det(spread))
    return size


def _operate(
    predicted: Belief, each: Innovation, scan: Scan, setting: ClutterSetting
) -> tuple[OperatingPoint, FloatArray]:
    """Choose the operating point and the gate of this scan."""
    gate, curve = np.asarray(setting.gate), setting.curve
    mean, covariance = moments(predicted)
    if setting.rule == "posterior":
        merged = innovate(mean, covariance, scan.measured, scan.present, scan.noise)
        point, _ = best_posterior(
            curve, setting.limits, merged, scan.amplitude,
            np.asarray((each.distance2 < setting.gate**2).any(axis=0)),
            cell_volume=setting.cell_volume, gate=setting.gate, extrema=setting.extrema,
        )  # fmt: skip
        return point, gate
    if setting.rule == "fixed":
        false_alarm = np.full(mean.shape[:-1], setting.false_alarm)
    else:
        unit = unit_ball_volume(setting.dimension)
        cells = unit * _region_size(covariance, scan) / setting.cell_volume
        false_alarm = setting.prior(cells * setting.gate**setting.dimension)
    detection = curve.detection(false_alarm)
    if setting.rule == "region":
        one_cell = cells ** (-1.0 / setting.dimension)
        gate = shrunk_gate(false_alarm, detection, one_cell, setting.gate)
    gated = np.asarray((each.distance2 < gate[..., None] ** 2).any(axis=0))
    threshold = curve.threshold(false_alarm)
    allowed = gated & ~(scan.amplitude < threshold[..., None])
    return OperatingPoint(false_alarm, detection, allowed), gate


def _average(
    association: Association, after: FloatArray, before: FloatArray
) -> Association:
    """Average the hypotheses' probabilities over the models."""
    if after.shape[0] == 1:
        return Association(
            association.miss[0], association.weight[0],
            association.log_likelihood_ratio[0],
        )  # fmt: skip
    ratio = association.log_likelihood_ratio
    top = ratio.max(axis=0)
    evidence = top + np.log((before * np.exp(ratio - top)).sum(axis=0))
    return Association(
        (after * association.miss).sum(axis=0),
        (after[..., None] * association.weight).sum(axis=0),
        evidence,
    )
