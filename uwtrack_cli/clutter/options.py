"""Options of detector, motion and start of a target in clutter, bound for the filter.

**Conventions.** Numbers are in the units of the measured components; times in s.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, ThresholdRule
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import (
    AtLeast,
    AtMost,
    Below,
    Increasing,
    OptionGroup,
    Unit,
)
from uwtrack_cli.data.scans import Roc
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.operating_curve import (
    OperatingCurve,
    constant_curve,
    measured_curve,
    model_curve,
)

Probability = Annotated[float, Unit("1"), AtLeast(1e-12), Below(1.0)]
Deviation = Annotated[float, AtLeast(1e-12), AtMost(1e12)]
Coordinate = Annotated[float, AtLeast(-1e12), AtMost(1e12)]


@dataclass(frozen=True)
class Detector(OptionGroup):
    """How the measurements were detected.

    Parameters
    ----------
    model
        Behaviour of the target's amplitude: "fluctuating" (Rayleigh, detection
        probability P_F^(1/(1+SNR))), "gaussian" (mean A, unit deviation; the paper's
        figure 1) or "steady" (Rician); a measured curve replaces it.
    snr_db
        Signal-to-noise ratio A^2/2 of the target in dB; needed unless the detection
        probability or a measured curve is given.
    false_alarm_probability
        False alarm probability per cell and scan of the fixed threshold.
    detection_probability
        Detection probability at the fixed threshold; follows from the model
        when not given.
    cell_volume
        Volume of a resolution cell in the units of the measured components (metres times
        degrees for range and bearing); needed unless the
        threshold is fixed and the clutter is counted.
    false_alarm_range
        Least and greatest false alarm probability that an adaptive threshold may
        choose; the greatest must be the one at which the scans were recorded.
    """

    model: Literal["fluctuating", "gaussian", "steady"] = "fluctuating"
    snr_db: Annotated[float | None, Unit("dB"), AtLeast(-60.0), AtMost(120.0)] = None
    false_alarm_probability: Probability = 0.01
    detection_probability: Annotated[
        float | None, Unit("1"), AtLeast(1e-12), AtMost(1.0)
    ] = None
    cell_volume: Annotated[float | None, AtLeast(1e-12), AtMost(1e24)] = None
    false_alarm_range: Annotated[
        tuple[float, float], Unit("1"), AtLeast(1e-12), Below(1.0), Increasing()
    ] = (1e-4, 0.3)


@dataclass(frozen=True)
class TargetMotion(OptionGroup):
    """How the target moves: nearly constant velocity, perhaps with manoeuvres.

    Parameters
    ----------
    acceleration_std
        Standard deviation of the acceleration in units of the components per s^2,
        constant between two scans; needed.
    manoeuvre_std
        The same during manoeuvres; when given, a quiet and a manoeuvring filter
        interact.
    manoeuvre_start_probability
        Probability per scan that a quiet target begins to manoeuvre.
    manoeuvre_stop_probability
        Probability per scan that a manoeuvre ends.
    """

    acceleration_std: Deviation | None = None
    manoeuvre_std: Deviation | None = None
    manoeuvre_start_probability: Probability = 0.02
    manoeuvre_stop_probability: Probability = 0.2

    def __post_init__(self) -> None:
        """Refuse a manoeuvre that is no stronger than the quiet motion."""
        super().__post_init__()
        quiet, manoeuvre = self.acceleration_std, self.manoeuvre_std
        if quiet is not None and manoeuvre is not None and not manoeuvre > quiet:
            msg = (
                f"motion.manoeuvre_std must be above acceleration_std ({quiet}), "
                f"got {manoeuvre}."
            )
            raise OptionError(msg)


@dataclass(frozen=True)
class TargetStart(OptionGroup):
    """Where the tracks begin.

    Parameters
    ----------
    position
        Components at the start in their units, one number each, one target after the
        other; the strongest measurement of the first scan that has one, when not given.
    velocity
        Their rates in units per s, for each target or for all; zero when not given.
    position_std
        Standard deviation of each component of a given position in its units; needed
        with a position.
    velocity_std
        Standard deviation of each rate in units per s; needed.
    time_s
        Time of the given position in s; the first scan's when not given.
    """

    position: list[Coordinate] | None = None
    velocity: list[Coordinate] | None = None
    position_std: Deviation | None = None
    velocity_std: Deviation | None = None
    time_s: Annotated[float | None, Unit("s"), AtLeast(-1e12), AtMost(1e12)] = None


def clutter_setting(
    detector: Detector,
    roc: Roc | None,
    dimension: int,
    *,
    rule: ThresholdRule,
    gate: float,
    clutter: str,
    period: FloatArray | None,
    is_polar: bool,
) -> ClutterSetting:
    """Return the filter's setting from the options.

    Raises
    ------
    DataError
        The measured curve is no operating curve.
    OptionError
        Two options exclude each other, or a needed one is missing.
    """
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
    curve = _curve(detector, roc, adaptive=adaptive)
    return ClutterSetting(
        rule=rule, curve=curve, dimension=dimension, gate=gate,
        period=period, is_polar=is_polar,
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
    if not low <= false_alarm <= high:
        msg = (
            "detector.false_alarm_probability must be on the measured curve "
            f"({low:g} to {high:g}), got {false_alarm}."
        )
        raise OptionError(msg)
    return false_alarm


def _limits(detector: Detector, curve: OperatingCurve) -> tuple[float, float]:
    low, high = detector.false_alarm_range
    low, high = max(low, curve.limits[0]), min(high, curve.limits[1])
    if not low < high:
        msg = (
            f"detector.false_alarm_range {detector.false_alarm_range} does not meet the "
            f"measured curve, which runs from {curve.limits[0]} to {curve.limits[1]}."
        )
        raise OptionError(msg)
    return low, high


def motion_models(motion: TargetMotion) -> list[float]:
    """Return the acceleration variance of each motion model."""
    quiet, manoeuvre = motion.acceleration_std, motion.manoeuvre_std
    if quiet is None:
        msg = (
            "motion.acceleration_std (--motion-acceleration-std) must be given, in units "
            "of the components per s^2."
        )
        raise OptionError(msg)
    if manoeuvre is None:
        return [quiet**2]
    return [quiet**2, manoeuvre**2]


def switching(motion: TargetMotion) -> FloatArray:
    """Return the probabilities of changing from one motion model to another."""
    if motion.manoeuvre_std is None:
        return np.ones((1, 1))
    enter, leave = motion.manoeuvre_start_probability, motion.manoeuvre_stop_probability
    return np.array([[1.0 - enter, enter], [leave, 1.0 - leave]])
