"""Follow one target through false measurements, with an adaptive threshold.

**Method.** A probabilistic data association filter with nearly constant velocity (two
interacting motion models on request). Before or after each scan the detection threshold
may be chosen so that the variance after the scan is least.

**Conventions.** Components of a measurement are positions in any unit; rates are per
second. Angles in degrees go round the circle; a range in metres with a bearing in
degrees becomes east and north of the sensor. The track's score is the log likelihood ratio of a target being there against
clutter alone; a target is lost when the score no longer rises.

**References.** Bar-Shalom and Tse (1975); Gelfand, Fortmann and Bar-Shalom (1996); Choi,
Kim and Hong (2001), corrected; Sittler (1964) for the score.
"""

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, ScanUpdate, step
from uwtrack_cli.clutter.options import (
    Detector,
    Deviation,
    TargetMotion,
    TargetStart,
    clutter_setting,
    motion_models,
    switching,
)
from uwtrack_cli.clutter.scan_table import (
    ScanTable,
    check_scans,
    component_period,
    is_polar,
    scan_arrays,
    scan_table,
    split_scans,
    start_belief,
)
from uwtrack_cli.clutter.track_score import track_score
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.scans import Roc, Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.information_reduction import information_reduction


@checked
def track_in_clutter(  # noqa: PLR0913 - two containers and eight options
    scans: Scans,
    roc: Roc | None = None,
    *,
    threshold: Literal["fixed", "prior", "posterior", "region"] = "prior",
    clutter: Literal["cells", "count"] = "cells",
    gate: Annotated[float, Unit("1"), AtLeast(1e-3), AtMost(10.0)] = 4.0,
    measured_std: list[Deviation] | None = None,
    loss_score: Annotated[float, Unit("1"), AtLeast(1e-3), AtMost(1e9)] = 10.0,
    detector: Detector = Detector(),  # noqa: B008 - frozen
    motion: TargetMotion = TargetMotion(),  # noqa: B008 - frozen
    start: TargetStart = TargetStart(),  # noqa: B008 - frozen
) -> Target:
    """Follow one target through false measurements.

    A scan brings many measurements and at most one of them is the vessel's. The filter
    weighs all that are near enough, and the detection threshold may follow its need: low
    while the track is sharp, high when the region to be searched has grown.

    Parameters
    ----------
    scans
        Measurements, scan by scan. A bearing (unit deg) may be one of the components; a
        range (m) and a bearing (deg) from a sensor at rest are tracked as east and north
        of it, and the start's position and velocity are then east and north, too.
    roc
        Measured operating curve of the detector, in place of a model.
    threshold
        Rule for the detection threshold: "fixed"; "prior" (least expected variance,
        chosen before each scan; loses fewest tracks); "posterior" (least variance after
        looking; reports a variance that is too small and loses more tracks than prior);
        "region" (the published two-step rule that also shrinks the validation region;
        loses several times more tracks than prior).
    clutter
        Density of false measurements: "cells" (false alarm probability per resolution
        cell) or "count" (number of measurements in the region over its volume).
    gate
        Radius of the validation region in standard deviations.
    measured_std
        Standard deviation of each component in its unit, where the table has none.
    loss_score
        Sum at which the target counts as lost: the score's shortfall against a rise of
        one half per scan (Page 1954).
    detector
        How the measurements were detected.
    motion
        How the target moves.
    start
        Where the track begins.

    Returns
    -------
    Target
        The track with covariances, associations and thresholds.

    Raises
    ------
    DataError
        The scans are out of order, hold no measurement, or lack what the rule needs.
    OptionError
        An option is out of range, or a needed one is missing.

    Notes
    -----
    beta_i = e_i / (b + sum e_j), b = lambda (1 - P_D P_G) / P_D with the exact gate
    probability P_G. A scan without measurements leaves the prediction as it is.
    """
    units = scans.component_unit
    setting = clutter_setting(
        detector, roc, units.size, rule=threshold, gate=gate, clutter=clutter,
        period=component_period(units), is_polar=is_polar(units),
    )  # fmt: skip
    models = motion_models(motion)
    deviation = check_scans(scans, measured_std, adaptive=threshold != "fixed")
    table = scan_table(scans, deviation)
    rows = split_scans(scans)
    belief, first, time_s = start_belief(scans, table, rows, start, len(models))
    switch = switching(motion)
    outcomes = []
    known: dict[float, tuple[FloatArray, FloatArray]] = {}
    later = rows[first:]
    for index, scan in zip(later, scan_arrays(scans, table, later), strict=True):
        interval = float(scans.time_s[index[0]]) - time_s
        time_s += interval
        if interval not in known:
            steps = [
                constant_velocity(interval, variance, setting.dimension)
                for variance in models
            ]
            known[interval] = steps[0][0], np.array([noise for _, noise in steps])
        transition, noise = known[interval]
        outcome = step(
            belief, scan, setting, transition=transition, noise=noise, switching=switch
        )
        outcomes.append(outcome)
        belief = outcome.belief
    return _target(scans, table, later, outcomes, setting, loss_score)


def _target(
    scans: Scans,
    table: ScanTable,
    rows: list[IntArray],
    outcomes: list[ScanUpdate],
    setting: ClutterSetting,
    loss_score: float,
) -> Target:
    """Gather the scans into the container."""

    def column(read: Callable[[ScanUpdate], FloatArray]) -> FloatArray:
        return np.concatenate([read(outcome) for outcome in outcomes])

    first = np.array([index[0] for index in rows])
    taken = np.concatenate([outcome.point.allowed[0] for outcome in outcomes])
    number = np.repeat(np.arange(len(rows)), [index.size for index in rows])
    row = np.concatenate(rows)[taken]
    false_alarm = column(lambda o: o.point.false_alarm)
    detection = column(lambda o: o.point.detection)
    gate, expected = column(lambda o: o.gate), column(lambda o: o.expected_clutter)
    score, cusum = track_score(column(lambda o: o.association.log_likelihood_ratio))
    return Target(
        scan=scans.scan[first],
        time_s=scans.time_s[first],
        state=_in_circle(column(lambda o: o.mean), setting.period),
        state_covariance=column(lambda o: o.covariance),
        model_probability=column(lambda o: o.belief.probability.T),
        false_alarm_probability=false_alarm,
        detection_probability=detection,
        threshold=setting.curve.threshold(false_alarm),
        gate=gate,
        gate_volume=column(lambda o: o.gate_volume),
        expected_clutter=expected,
        validated=np.bincount(number[taken], minlength=len(rows)),
        miss_probability=column(lambda o: o.association.miss),
        information_reduction=_expected_reduction(
            detection, expected, gate, setting.dimension
        ),
        score=score,
        loss_cusum=cusum,
        lost=cusum > loss_score,
        association_scan=scans.scan[row],
        association_row=row,
        association_probability=np.concatenate(
            [outcome.association.weight[0] for outcome in outcomes]
        )[taken],
        component=table.component,
        component_unit=table.component_unit,
        threshold_rule=setting.rule,
        start_utc_ns=scans.start_utc_ns,
    )


def _in_circle(state: FloatArray, period: FloatArray | None) -> FloatArray:
    """Bring angles to where compass bearings lie, from 0 up to 360."""
    if period is None:
        return state
    for i in np.flatnonzero(np.isfinite(period)):
        state[:, 2 * i] %= period[i]
    return state


def _expected_reduction(
    detection: FloatArray, expected: FloatArray, gate: FloatArray, dimension: int
) -> FloatArray:
    """Return q2 of each scan; the region rule has a gate of its own per scan."""
    reduction = np.empty_like(detection)
    for radius in np.unique(gate):
        same = gate == radius
        reduction[same] = information_reduction(
            detection[same], expected[same], dimension=dimension, gate=float(radius)
        )
    return reduction
