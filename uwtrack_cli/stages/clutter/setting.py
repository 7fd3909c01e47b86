"""Check the options of the clutter tracker and bind them for the filter.

**Conventions.** Every message says what is wrong, the value and what is accepted.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.scans import Roc
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.clutter.clutter_filter import ClutterSetting, ThresholdRule
from uwtrack_cli.estimation.clutter.operating_curve import (
    OperatingCurve,
    constant_curve,
    measured_curve,
    model_curve,
)
from uwtrack_cli.stages.clutter.policies import Detector, TargetMotion


def clutter_setting(
    detector: Detector,
    roc: Roc | None,
    dimension: int,
    *,
    rule: ThresholdRule,
    gate: float,
    clutter: str,
) -> ClutterSetting:
    """Return the filter's setting from the options, checked."""
    if not 0.0 < gate <= 10.0:
        msg = f"gate must be in (0, 10] standard deviations, got {gate}."
        raise OptionError(msg)
    if clutter not in {"cells", "count"}:
        msg = f"clutter must be 'cells' or 'count', got {clutter!r}."
        raise OptionError(msg)
    adaptive = rule != "fixed"
    if adaptive and clutter == "count":
        msg = (
            f"threshold {rule!r} chooses the density of clutter and cannot count it; "
            "use clutter 'cells', or threshold 'fixed'."
        )
        raise OptionError(msg)
    volume = detector.cell_volume
    if volume is None and clutter == "cells":
        msg = (
            "the volume of a resolution cell is needed: give detector.cell_volume "
            "(--detector-cell-volume), or a fixed threshold with clutter 'count'."
        )
        raise OptionError(msg)
    if volume is not None and not volume > 0.0:
        msg = f"detector.cell_volume must be above 0, got {volume}."
        raise OptionError(msg)
    curve = _curve(detector, roc, adaptive=adaptive)
    return ClutterSetting(
        rule=rule, curve=curve, dimension=dimension, gate=gate,
        cell_volume=np.nan if volume is None else volume,
        false_alarm=_within(detector.false_alarm_probability, curve),
        limits=_limits(detector, curve), count_clutter=clutter == "count",
    )  # fmt: skip


def _curve(detector: Detector, roc: Roc | None, *, adaptive: bool) -> OperatingCurve:
    if roc is not None:
        _check_roc(roc)
        return measured_curve(
            roc.false_alarm_probability, roc.detection_probability, roc.threshold
        )
    detection = detector.detection_probability
    if detection is not None and not adaptive:
        if not 0.0 < detection <= 1.0:
            msg = f"detector.detection_probability must be in (0, 1], got {detection}."
            raise OptionError(msg)
        return constant_curve(detection)
    if detector.snr_db is None:
        msg = (
            "how well the target is detected is not known: give detector.snr_db "
            "(--detector-snr-db) or a measured curve"
            + ("." if adaptive else ", or detector.detection_probability.")
        )
        raise OptionError(msg)
    return model_curve(detector.model, 10.0 ** (detector.snr_db / 10.0))


def _check_roc(roc: Roc) -> None:
    false_alarm, detection = roc.false_alarm_probability, roc.detection_probability
    threshold = roc.threshold
    if false_alarm.size < 2:
        msg = f"a measured curve needs two points or more, got {false_alarm.size}."
        raise DataError(msg)
    inside = (false_alarm > 0) & (false_alarm < 1) & (detection > 0) & (detection <= 1)
    if not inside.all():
        row = int(np.flatnonzero(~inside)[0])
        msg = (
            f"point {row + 1} of the measured curve is not a probability: "
            f"false alarm {false_alarm[row]}, detection {detection[row]}."
        )
        raise DataError(msg)
    if np.any(np.diff(false_alarm) <= 0) or np.any(np.diff(detection) < 0):
        msg = (
            "a measured curve must rise: order its points by false alarm probability, "
            "with detection probabilities that do not fall."
        )
        raise DataError(msg)
    if np.isfinite(threshold).all() and np.any(np.diff(threshold) >= 0):
        msg = "the thresholds of a measured curve must fall from point to point."
        raise DataError(msg)


def _within(false_alarm: float, curve: OperatingCurve) -> float:
    low, high = curve.limits
    if not (0.0 < false_alarm < 1.0 and low <= false_alarm <= high):
        msg = (
            f"detector.false_alarm_probability must be in (0, 1) and on the curve "
            f"({low:g} to {high:g}), got {false_alarm}."
        )
        raise OptionError(msg)
    return false_alarm


def _limits(detector: Detector, curve: OperatingCurve) -> tuple[float, float]:
    low, high = detector.false_alarm_range
    if not 0.0 < low < high < 1.0:
        msg = (
            "detector.false_alarm_range must be two rising probabilities in (0, 1), "
            f"got {low} and {high}."
        )
        raise OptionError(msg)
    low, high = max(low, curve.limits[0]), min(high, curve.limits[1])
    if not low < high:
        msg = (
            f"detector.false_alarm_range {detector.false_alarm_range} does not meet the "
            f"measured curve, which runs from {curve.limits[0]} to {curve.limits[1]}."
        )
        raise OptionError(msg)
    return low, high


def motion_models(motion: TargetMotion) -> list[float]:
    """Return the acceleration variance of each motion model, checked."""
    quiet, manoeuvre = motion.acceleration_std, motion.manoeuvre_std
    if quiet is None or not quiet > 0.0:
        msg = (
            "motion.acceleration_std (--motion-acceleration-std) must be given and "
            f"above 0, in units of the components per s^2; got {quiet}."
        )
        raise OptionError(msg)
    if manoeuvre is None:
        return [quiet**2]
    if not manoeuvre > quiet:
        msg = (
            f"motion.manoeuvre_std must be above acceleration_std ({quiet}), "
            f"got {manoeuvre}."
        )
        raise OptionError(msg)
    return [quiet**2, manoeuvre**2]


def switching(motion: TargetMotion) -> FloatArray:
    """Return the probabilities of changing from one motion model to another."""
    if motion.manoeuvre_std is None:
        return np.ones((1, 1))
    enter, leave = motion.manoeuvre_start_probability, motion.manoeuvre_stop_probability
    for name, value in (("start", enter), ("stop", leave)):
        if not 0.0 < value < 1.0:
            msg = f"motion.manoeuvre_{name}_probability must be in (0, 1), got {value}."
            raise OptionError(msg)
    return np.array([[1.0 - enter, enter], [leave, 1.0 - leave]])
