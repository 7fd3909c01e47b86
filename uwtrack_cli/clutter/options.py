"""Options of detector, motion and start of a target in clutter, bound for the filter.

**Conventions.** Numbers are in the units of the measured components; times in s.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, ThresholdRule
from uwtrack_cli.clutter.sensing import Sensing
from uwtrack_cli.data.base import FloatArray, TextArray
from uwtrack_cli.data.options import AtLeast, AtMost, Below, Increasing, OptionGroup, Unit
from uwtrack_cli.data.scans import Roc
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.constant_velocity import constant_velocity, coordinated_turn
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
    detection_probability: Annotated[float | None, Unit("1"), AtLeast(1e-12), AtMost(1.0)] = None
    cell_volume: Annotated[float | None, AtLeast(1e-12), AtMost(1e24)] = None
    false_alarm_range: Annotated[
        tuple[float, float], Unit("1"), AtLeast(1e-12), Below(1.0), Increasing()
    ] = (1e-4, 0.3)


@dataclass(frozen=True)
class TargetMotion(OptionGroup):
    """How the target moves: nearly constant velocity, perhaps with manoeuvres or turns.

    Parameters
    ----------
    acceleration_std
        Standard deviation of the acceleration in units of the components per s^2,
        constant between two scans; needed.
    manoeuvre_std
        The same during manoeuvres; when given, a quiet and a manoeuvring filter
        interact.
    manoeuvre_start_probability
        Probability per scan that a quiet target begins to manoeuvre or to turn.
    manoeuvre_stop_probability
        Probability per scan that a manoeuvre or a turn ends.
    turn_rate_degps
        Rate of a turn to either side in a plane, in degrees per s; when given, filters
        that turn left and right interact with the others.
    """

    acceleration_std: Deviation | None = None
    manoeuvre_std: Deviation | None = None
    manoeuvre_start_probability: Probability = 0.02
    manoeuvre_stop_probability: Probability = 0.2
    turn_rate_degps: Annotated[float | None, Unit("degree/s"), AtLeast(1e-6), AtMost(360.0)] = None

    def __post_init__(self) -> None:
        """Refuse a manoeuvre that is no stronger than the quiet motion."""
        super().__post_init__()
        quiet, manoeuvre = self.acceleration_std, self.manoeuvre_std
        if quiet is not None and manoeuvre is not None and not manoeuvre > quiet:
            raise OptionError(
                f"motion.manoeuvre_std must be above acceleration_std ({quiet}), got {manoeuvre}."
            )


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
    range_m
        Least and greatest range at which a track may begin from bearings alone, in m;
        needed there without a position.
    """

    position: list[Coordinate] | None = None
    velocity: list[Coordinate] | None = None
    position_std: Deviation | None = None
    velocity_std: Deviation | None = None
    time_s: Annotated[float | None, Unit("s"), AtLeast(-1e12), AtMost(1e12)] = None
    range_m: Annotated[
        tuple[float, float] | None, Unit("m"), AtLeast(1e-3), AtMost(1e9), Increasing()
    ] = None


def clutter_setting(
    detector: Detector,
    roc: Roc | None,
    dimension: int,
    *,
    rule: ThresholdRule,
    gate: float,
    clutter: str,
    sensing: Sensing,
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
        raise OptionError(
            f"threshold {rule!r} chooses the density of clutter and cannot count it; "
            "use clutter 'cells', or threshold 'fixed'."
        )
    volume = detector.cell_volume
    if volume is None and clutter == "cells":
        raise OptionError(
            "the volume of a resolution cell is needed: give detector.cell_volume "
            "(--detector-cell-volume), or a fixed threshold with clutter 'count'."
        )
    curve = _curve(detector, roc, adaptive=adaptive)
    return ClutterSetting(
        rule=rule, curve=curve, dimension=dimension, gate=gate,
        period=sensing.period, sensing=sensing.kind,
        cell_volume=np.nan if volume is None else volume,
        false_alarm=_within(detector.false_alarm_probability, curve),
        limits=_limits(detector, curve), count_clutter=clutter == "count",
    )  # fmt: skip


def _curve(detector: Detector, roc: Roc | None, *, adaptive: bool) -> OperatingCurve:
    if roc is not None:
        _check_roc(roc)
        return measured_curve(roc.false_alarm_probability, roc.detection_probability, roc.threshold)
    detection = detector.detection_probability
    if detection is not None and not adaptive:
        return constant_curve(detection)
    if detector.snr_db is None:
        raise OptionError(
            "how well the target is detected is not known: give detector.snr_db "
            "(--detector-snr-db) or a measured curve"
            + ("." if adaptive else ", or detector.detection_probability.")
        )
    return model_curve(detector.model, 10.0 ** (detector.snr_db / 10.0))


def _check_roc(roc: Roc) -> None:
    false_alarm, detection = roc.false_alarm_probability, roc.detection_probability
    threshold = roc.threshold
    if false_alarm.size < 2:
        raise DataError(f"a measured curve needs two points or more, got {false_alarm.size}.")
    inside = (false_alarm > 0) & (false_alarm < 1) & (detection > 0) & (detection <= 1)
    if not inside.all():
        row = int(np.flatnonzero(~inside)[0])
        raise DataError(
            f"point {row + 1} of the measured curve is not a probability: "
            f"false alarm {false_alarm[row]}, detection {detection[row]}."
        )
    if np.any(np.diff(false_alarm) <= 0) or np.any(np.diff(detection) < 0):
        raise DataError(
            "a measured curve must rise: order its points by false alarm probability, "
            "with detection probabilities that do not fall."
        )
    if np.isfinite(threshold).all() and np.any(np.diff(threshold) >= 0):
        raise DataError("the thresholds of a measured curve must fall from point to point.")


def _within(false_alarm: float, curve: OperatingCurve) -> float:
    low, high = curve.limits
    if not low <= false_alarm <= high:
        raise OptionError(
            "detector.false_alarm_probability must be on the measured curve "
            f"({low:g} to {high:g}), got {false_alarm}."
        )
    return false_alarm


def _limits(detector: Detector, curve: OperatingCurve) -> tuple[float, float]:
    low, high = detector.false_alarm_range
    low, high = max(low, curve.limits[0]), min(high, curve.limits[1])
    if not low < high:
        raise OptionError(
            f"detector.false_alarm_range {detector.false_alarm_range} does not meet the "
            f"measured curve, which runs from {curve.limits[0]} to {curve.limits[1]}."
        )
    return low, high


class MotionModels(NamedTuple):
    """Ways in which a target may move, quiet first."""

    acceleration_variance: tuple[float, ...]
    """Variance of the acceleration of each."""
    turn_rate_radps: tuple[float, ...]
    """Rate of its turn, 0 for none."""
    switching: FloatArray
    """Probabilities of changing from that of the row to that of the column."""
    prior: FloatArray
    """Probabilities at the start, ``(model,)``."""

    def each(self, count: int) -> "MotionModels":
        """Let every model have a number of filters that never change into each other."""
        return MotionModels(
            tuple(np.repeat(self.acceleration_variance, count).tolist()),
            tuple(np.repeat(self.turn_rate_radps, count).tolist()),
            np.kron(self.switching, np.eye(count)),
            np.repeat(self.prior, count) / count,
        )

    def carry(self, interval_s: float, dimension: int) -> tuple[FloatArray, FloatArray]:
        """Return F, common or of each model, and Q of each over an interval."""
        steps = [
            constant_velocity(interval_s, variance, dimension)
            for variance in self.acceleration_variance
        ]
        noise = np.array([each for _, each in steps])
        if not any(self.turn_rate_radps):
            return steps[0][0], noise
        turned = [
            coordinated_turn(interval_s, rate) if rate else straight
            for rate, (straight, _) in zip(self.turn_rate_radps, steps, strict=True)
        ]
        return np.array(turned), noise


def motion_models(motion: TargetMotion, component_unit: TextArray) -> MotionModels:
    """Return the motion models of a target with components of some units.

    Raises
    ------
    OptionError
        The quiet acceleration is missing, or turns are told outside a plane.
    """
    quiet, manoeuvre = motion.acceleration_std, motion.manoeuvre_std
    if quiet is None:
        raise OptionError(
            "motion.acceleration_std (--motion-acceleration-std) must be given, in units "
            "of the components per s^2."
        )
    variance, turn = [quiet**2], [0.0]
    if manoeuvre is not None:
        variance, turn = [*variance, manoeuvre**2], [*turn, 0.0]
    if motion.turn_rate_degps is not None:
        if component_unit.size != 2 or component_unit[0] != component_unit[1]:
            raise OptionError(
                "motion.turn_rate_degps is of a target in a plane, whose two components "
                f"have one unit; these have {', '.join(map(repr, component_unit.tolist()))}."
            )
        rate = float(np.radians(motion.turn_rate_degps))
        variance, turn = [*variance, quiet**2, quiet**2], [*turn, rate, -rate]
    others = len(variance) - 1
    if not others:
        return MotionModels((*variance,), (*turn,), np.ones((1, 1)), np.ones(1))
    enter, leave = motion.manoeuvre_start_probability, motion.manoeuvre_stop_probability
    switching = np.diag(np.full(others + 1, 1.0 - leave))
    switching[0] = enter / others
    switching[1:, 0] = leave
    switching[0, 0] = 1.0 - enter
    prior = np.array([0.9, *(0.1 / others,) * others])
    return MotionModels((*variance,), (*turn,), switching, prior)
