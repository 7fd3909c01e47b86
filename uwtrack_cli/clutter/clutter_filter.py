"""One scan of the probabilistic data association filter, thresholds included.

**Method.** Predict every motion model, choose the detection threshold for the predicted
validation region (or after looking, or shrink the region), associate, correct, weigh the
models. Any number of targets, each with its own scan, is stepped together.

**Conventions.** As in `uwtrack_cli.estimation.probabilistic_association`; leading axis of a belief: model.

**References.** Gelfand, Fortmann and Bar-Shalom (1996); Choi, Kim and Hong (2001);
Houles and Bar-Shalom (1989) for interacting models with data association.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from uwtrack_cli.clutter.sensing import SensedKind, expect
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.detection_threshold import (
    OperatingPoint,
    background_extrema,
    best_posterior,
    prior_rule,
)
from uwtrack_cli.estimation.imm import Belief, advance, mix, moments, reweigh
from uwtrack_cli.estimation.information_reduction import gate_probability, unit_ball_volume
from uwtrack_cli.estimation.operating_curve import OperatingCurve
from uwtrack_cli.estimation.probabilistic_association import (
    Association,
    Innovation,
    associate,
    correct,
    innovate,
)

ThresholdRule = Literal["fixed", "prior", "posterior", "region"]

_PAPER_SHIFT = 3.0
"""Mean of the target's amplitude in the paper's Fig. 1, in noise deviations."""


@dataclass(frozen=True)
class ClutterSetting:
    """Facts of detector, clutter and gate."""

    rule: ThresholdRule
    """How the detection threshold is chosen."""
    curve: OperatingCurve
    """Operating curve of the detector."""
    dimension: int
    """Number of measured components."""
    gate: float
    """Greatest radius of the validation region in standard deviations."""
    cell_volume: float
    """Volume of a resolution cell; nan with a fixed threshold and density by count."""
    false_alarm: float
    """Operating point of the fixed rule."""
    limits: tuple[float, float]
    """False alarm probabilities that the other rules may choose."""
    period: FloatArray | None = None
    """Period of each component, infinite for none; None where no component has one."""
    sensing: SensedKind = "components"
    """What the measurements are of the state; a cell of ranges in metres times bearings
    in degrees grows with the range."""
    count_clutter: bool = False
    """Take the density from the number of measurements in the gate."""
    prior: Callable[[FloatArray], FloatArray] = field(init=False, repr=False)
    """Best false alarm probability by the region's size in cells."""
    extrema: FloatArray = field(init=False, repr=False)
    """Thresholds at which the background has a local extremum."""

    def __post_init__(self) -> None:
        """Tabulate what the rule needs, once."""
        nothing: FloatArray = np.empty(0)
        extrema = nothing
        if self.rule in {"prior", "region"}:
            rule = prior_rule(self.curve, self.limits, dimension=self.dimension, gate=self.gate)
            object.__setattr__(self, "prior", rule)
        if self.rule == "posterior":
            inside = gate_probability(self.gate, self.dimension)
            extrema = background_extrema(self.curve, self.limits, inside)
        object.__setattr__(self, "extrema", extrema)


@dataclass(frozen=True)
class Scan:
    """One scan per target, padded to the longest."""

    measured: FloatArray
    """Components of the measurements, ``(..., k, m)``."""
    present: BoolArray
    """Which of them exist, ``(..., k)``."""
    amplitude: FloatArray
    """Amplitudes in noise deviations, ``(..., k)``; nan passes every fixed threshold."""
    noise: FloatArray
    """Covariances of the measurements, ``(..., k or 1, m, m)``."""
    own: FloatArray | None = None
    """Own ship's east, north and their rates, ``(4,)``; None where she lies at the
    origin."""


class ScanUpdate(NamedTuple):
    """The filter after a scan, with threshold, gate and associations of the scan."""

    belief: Belief
    """State of every motion model's filter."""
    mean: FloatArray
    """State over the models, ``(..., n)``."""
    covariance: FloatArray
    """Its covariance, ``(..., n, n)``."""
    point: OperatingPoint
    """Operating point of the detector."""
    gate: FloatArray
    """Radius of the validation region in standard deviations, ``(...)``."""
    gate_volume: FloatArray
    """Volume of the region, ``(...)``."""
    expected_clutter: FloatArray
    """Mean number of false measurements in it, ``(...)``."""
    association: Association
    """Probabilities of the hypotheses, averaged over the models."""

    def take(self, kept: BoolArray) -> "ScanUpdate":
        """Return the update of some of the targets."""
        return ScanUpdate(
            self.belief.take(kept), self.mean[kept], self.covariance[kept],
            self.point.take(kept), self.gate[kept], self.gate_volume[kept], self.expected_clutter[kept],
            self.association.take(kept),
        )  # fmt: skip


class Look(NamedTuple):
    """A scan against the predictions, before it is associated."""

    predicted: Belief
    """State of every motion model's filter at the time of the scan."""
    each: Innovation
    """The scan against every model."""
    point: OperatingPoint
    """Operating point of the detector."""
    gate: FloatArray
    """Radius of the validation region in standard deviations, ``()`` or ``(...)``."""
    volume: FloatArray
    """Volume of the region, ``(...)``."""
    density: FloatArray
    """False measurements per unit of measurement space, ``(...)``."""
    inside: float
    """Probability that the target's measurement lies in the region."""


def step(
    belief: Belief,
    scan: Scan,
    setting: ClutterSetting,
    *,
    transition: FloatArray,
    noise: FloatArray,
    switching: FloatArray,
) -> ScanUpdate:
    """Carry the filters over one scan by F, and Q and switching of the models."""
    seen = look(advance(mix(belief, switching), transition, noise), scan, setting)
    association = associate(
        seen.each, seen.point.allowed[None], clutter_density=seen.density[None],
        detection_probability=seen.point.detection[None], gate_probability=seen.inside,
    )  # fmt: skip
    return learn(seen, association)


def look(predicted: Belief, scan: Scan, setting: ClutterSetting) -> Look:
    """Compare a scan with predictions and choose threshold and gate."""
    each = innovate(
        predicted.mean, predicted.covariance, scan.measured, scan.present, scan.noise,
        setting.period, expect(predicted.mean, setting.sensing, scan.own),
    )  # fmt: skip
    cell = _cell_volume(predicted, setting, scan.own)
    point, gate = _operate(predicted, each, scan, setting, cell)
    # A target may be where any of the models expects it.
    sizes = _region_size(each, scan.noise)
    size = sizes[0] if len(sizes) == 1 else sizes.max(axis=0)
    volume = unit_ball_volume(setting.dimension) * gate**setting.dimension * size
    if setting.count_clutter:
        density = point.allowed.sum(axis=-1) / volume
    else:
        density = point.false_alarm / cell
    # The published rule shrinks the region and keeps P_G = 1.
    shrinks = setting.rule == "region"
    inside = 1.0 if shrinks else gate_probability(setting.gate, setting.dimension)
    return Look(predicted, each, point, gate, volume, density, inside)


def learn(seen: Look, association: Association) -> ScanUpdate:
    """Correct the filters by the associations, and weigh the models by the scan."""
    predicted = seen.predicted
    state, spread = correct(predicted.mean, predicted.covariance, seen.each, association)
    weight = reweigh(predicted, association.log_likelihood_ratio)
    after = Belief(state, spread, weight)
    return ScanUpdate(
        after, *moments(after), seen.point, np.full(seen.volume.shape, seen.gate),
        seen.volume, seen.density * seen.volume,
        _average(association, weight, predicted.probability),
    )  # fmt: skip


def shrunk_gate(
    false_alarm: FloatArray, detection: FloatArray, one_cell: FloatArray, gate: float
) -> FloatArray:
    """Return the radius of the validation region in the two-step rule.

    After the prior-optimal false alarm rate is found, the radius is set to one of two
    numbers derived from the operating point, whichever promises the larger q2 by a
    fitted formula, and the target is taken to lie in the region with certainty.

    Parameters
    ----------
    false_alarm
        False alarm probability of the first step.
    detection
        Detection probability of the first step.
    one_cell
        Radius at which the region is one resolution cell.
    gate
        Greatest radius.

    Returns
    -------
    FloatArray
        Radius in standard deviations, between one cell and ``gate``.

    Notes
    -----
    gamma_1 = 3 - Phi^-1(P_D), gamma_2 = sqrt(-2 ln P_F). The fitted q2, 0.997 P_D / (1 +
    0.37 P_D^-1.57 mu), falls with the clutter mu in the region at a given operating
    point, so that the larger q2 is always that of the smaller radius (Choi et al. 2001,
    section III and Figs. 1-2, with the formula of Kershaw and Evans). Shrinking cannot
    help: q2 never falls when the gate widens at a given clutter density. The rule is
    kept because it is the paper's; it reports a smaller variance and loses more tracks
    than the prior rule (``uwtrack study clutter``).

    Examples
    --------
    >>> float(shrunk_gate(np.array(0.03222), np.array(0.7318), np.array(1.7), 4.0).round(3))
    2.382
    """
    from scipy.special import ndtri

    from_detection = _PAPER_SHIFT - ndtri(detection)
    from_false_alarm = np.sqrt(-2.0 * np.log(false_alarm))
    smaller = np.minimum(from_detection, from_false_alarm)
    radius: FloatArray = np.minimum(np.maximum(smaller, one_cell), gate)
    return radius


def _cell_volume(predicted: Belief, setting: ClutterSetting, own: FloatArray | None) -> FloatArray:
    """Return the volume of a resolution cell where the target is expected.

    ``(...)``, or one that is the same everywhere.
    """
    volume = np.asarray(setting.cell_volume)
    if setting.sensing.startswith("places"):
        place = moments(predicted)[0][..., ::2]
        if own is not None:
            place = place - own[:2]
        volume = volume * np.radians(np.hypot(place[..., 0], place[..., 1]))
    return volume


def _merged(predicted: Belief, scan: Scan, setting: ClutterSetting) -> Innovation:
    """Compare the scan with the prediction over all models."""
    mean, covariance = moments(predicted)
    return innovate(
        mean, covariance, scan.measured, scan.present, scan.noise, setting.period,
        expect(mean, setting.sensing, scan.own),
    )  # fmt: skip


def _region_size(innovation: Innovation, noise: FloatArray) -> FloatArray:
    """Return |S|^(1/2) with the mean noise of the scan's measurements."""
    if noise.shape[-3] == 1:
        return np.asarray(np.sqrt(innovation.determinant[..., 0]))
    spread = innovation.covariance[..., :1, :, :] - noise[..., :1, :, :]
    mean = spread[..., 0, :, :] + noise.mean(axis=-3)
    return np.asarray(np.sqrt(np.linalg.det(mean)))


def _in_gate(each: Innovation, gate: FloatArray) -> BoolArray:
    """Tell which measurements lie in the region of any of the models."""
    near = each.distance2 < gate[..., None] ** 2
    return near[0] if len(near) == 1 else np.asarray(near.any(axis=0))


def _operate(
    predicted: Belief,
    each: Innovation,
    scan: Scan,
    setting: ClutterSetting,
    cell_volume: FloatArray,
) -> tuple[OperatingPoint, FloatArray]:
    """Choose the operating point and the gate of this scan."""
    gate, curve = np.asarray(setting.gate), setting.curve
    runs = predicted.mean.shape[1:-1]
    if setting.rule == "posterior":
        merged, amplitude = each, scan.amplitude[None]
        allowed = _in_gate(each, gate)[None]
        if len(predicted.probability) > 1:
            merged = _merged(predicted, scan, setting)
            amplitude, allowed = scan.amplitude, allowed[0]
        point, _ = best_posterior(
            curve, setting.limits, merged, amplitude, allowed,
            cell_volume=cell_volume, gate=setting.gate, extrema=setting.extrema,
        )  # fmt: skip
        if merged is each:
            point = OperatingPoint(point.false_alarm[0], point.detection[0], point.allowed[0])
        return point, gate
    if setting.rule == "fixed":
        false_alarm = np.full(runs, setting.false_alarm)
    else:
        if len(predicted.probability) == 1:
            size = _region_size(each, scan.noise)[0]
        else:
            merged = _merged(predicted, scan, setting)
            size = _region_size(merged, scan.noise)
        cells = unit_ball_volume(setting.dimension) * size / cell_volume
        false_alarm = setting.prior(cells * setting.gate**setting.dimension)
    detection = curve.detection(false_alarm)
    if setting.rule == "region":
        one_cell = cells ** (-1.0 / setting.dimension)
        gate = shrunk_gate(false_alarm, detection, one_cell, setting.gate)
    threshold = curve.threshold(false_alarm)
    allowed = _in_gate(each, gate) & ~(scan.amplitude < threshold[..., None])
    return OperatingPoint(false_alarm, detection, allowed), gate


def _average(association: Association, after: FloatArray, before: FloatArray) -> Association:
    """Average the hypotheses' probabilities over the models."""
    ratio = association.log_likelihood_ratio
    if after.shape[0] == 1:
        return Association(association.miss[0], association.weight[0], ratio[0])
    top = ratio.max(axis=0)
    ratio_over_models = top + np.log((before * np.exp(ratio - top)).sum(axis=0))
    return Association(
        (after * association.miss).sum(axis=0),
        (after[..., None] * association.weight).sum(axis=0),
        ratio_over_models,
    )
