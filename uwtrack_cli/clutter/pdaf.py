"""Follow targets through false measurements, one with an adaptive threshold.

**Method.** A probabilistic data association filter with nearly constant velocity
(interacting motion models for manoeuvres and turns on request). Before or after each scan
the detection threshold may be chosen so that the variance after the scan is least.
Several targets are associated jointly at a fixed threshold; their tracks may begin and end
by themselves. What is found may be smoothed by later scans.

**Conventions.** Components of a measurement are positions in any unit; rates are per
second. Angles in degrees go round the circle; a range in metres with a bearing in
degrees becomes east and north of the sensor, and so does the place of a target of which
own ship under way has bearings alone. The track's score is the log likelihood
ratio of a target being there against clutter alone; a target is lost when the score no
longer rises.

**References.** Bar-Shalom and Tse (1975); Gelfand, Fortmann and Bar-Shalom (1996); Choi,
Kim and Hong (2001), corrected; Sittler (1964) for the score; Fortmann, Bar-Shalom and
Scheffe (1983) for several targets.
"""

from collections.abc import Callable
from functools import cache
from typing import Annotated, Literal

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, step
from uwtrack_cli.clutter.options import (
    Detector,
    Deviation,
    TargetMotion,
    TargetStart,
    clutter_setting,
    motion_models,
)
from uwtrack_cli.clutter.scan_table import (
    ScanTable,
    check_scans,
    least_amplitude,
    scan_arrays,
    scan_rows,
    scan_table,
    split_scans,
    usable_rows,
)
from uwtrack_cli.clutter.sensing import Sensing, sensing_of
from uwtrack_cli.clutter.several_targets import FollowedScan, TrackRule, follow_several
from uwtrack_cli.clutter.track_start import (
    FirstState,
    TrackStarts,
    n_told,
    told_starts,
    track_starts,
)
from uwtrack_cli.clutter.track_table import Ending, Smoothing, target_table
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.scans import Roc, Scans
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.own_ship import own_motion


@checked
def track_in_clutter(  # noqa: PLR0913 - three containers and eleven options
    scans: Scans,
    roc: Roc | None = None,
    navigation: Navigation | None = None,
    *,
    targets: Literal["given", "auto"] = "given",
    false_tracks_per_hour: Annotated[float, Unit("1/h"), AtLeast(1e-9), AtMost(1e9)] = 1.0,
    threshold: Literal["fixed", "prior", "posterior", "region"] = "prior",
    clutter: Literal["cells", "count"] = "cells",
    gate: Annotated[float, Unit("1"), AtLeast(1e-3), AtMost(10.0)] = 4.0,
    measured_std: list[Deviation] | None = None,
    loss_score: Annotated[float, Unit("1"), AtLeast(1e-3), AtMost(1e9)] = 10.0,
    smoothing_scans: Annotated[int, AtLeast(0), AtMost(10**9)] = 0,
    detector: Detector = Detector(),  # noqa: B008 - frozen
    motion: TargetMotion = TargetMotion(),  # noqa: B008 - frozen
    start: TargetStart = TargetStart(),  # noqa: B008 - frozen
) -> Target:
    """Track one or several targets through false measurements (PDAF).

    A scan brings many measurements and at most one of them is the vessel's. The filter
    weighs all that are near enough, and the detection threshold may follow its need: low
    while the track is sharp, high when the region to be searched has grown. Several
    targets are associated jointly, at a fixed threshold: a measurement belongs to one of
    them at most.

    Parameters
    ----------
    scans
        Measurements, scan by scan. A bearing (unit deg) may be one of the components; a
        range (m) and a bearing (deg, from north), perhaps with a range rate (m/s, opening
        positive), are tracked as east and north of the sensor, and the start's position
        and velocity are then east and north, too.
    roc
        Measured operating curve of the detector, in place of a model.
    navigation
        Own ship's position where bearings, alone or with ranges, are measured from her
        under way: places are then east and north of the navigation's origin.
    targets
        Which targets there are: "given" (one, or one for each position of the start) or
        "auto" (tracks begin at measurements and end by their score; targets of given
        positions are there from the start).
    false_tracks_per_hour
        Bound on the tracks that clutter begins per hour, with targets "auto".
    threshold
        Rule for the detection threshold: "fixed"; "prior" (least expected variance,
        chosen before each scan; loses fewest tracks); "posterior" (least variance after
        looking; reports a variance that is too small and loses more tracks than prior);
        "region" (the published two-step rule that also shrinks the validation region;
        loses several times more tracks than prior). Several targets need "fixed".
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
    smoothing_scans
        Number of later scans that each state learns from, too: 0 for the filter alone, a
        fixed lag, or all of the record from the number of its scans on.
    detector
        How the measurements were detected.
    motion
        How the target moves.
    start
        Where the tracks begin.

    Returns
    -------
    Target
        The tracks with covariances, associations and thresholds.

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

    A track is confirmed at the score ln(b / r), with b measurements per hour that may
    begin a track and the rate r of false ones: clutter of the density told has a mean
    likelihood ratio of one, and reaches a score s at any time with probability exp(-s)
    at most (Ville 1939; Wald 1947). Not more than r false tracks per hour follow.
    """
    units, is_under_way = scans.component_unit, navigation is not None
    sensing = sensing_of(scans.component, units, is_under_way=is_under_way)
    setting = clutter_setting(
        detector, roc, units.size, rule=threshold, gate=gate, clutter=clutter, sensing=sensing
    )
    begins = targets == "auto"
    starts = track_starts(
        start, sensing, motion_models(motion, sensing.component_unit), begins=begins
    )
    deviation = check_scans(scans, measured_std, adaptive=threshold != "fixed")
    own = _own_ship(scans, navigation, sensing)
    table = scan_table(scans, deviation, sensing.kind, own)
    rows = split_scans(scans)

    @cache
    def carry(interval_s: float) -> tuple[FloatArray, FloatArray]:
        return starts.models.carry(interval_s, sensing.component.size)

    count = n_told(start, sensing.component.size)
    nowhere: FloatArray = np.empty((0, sensing.component.size))
    told = FirstState(
        starts.at(nowhere, nowhere[..., None] * nowhere[:, None]), 0, float(scans.time_s[0])
    )
    if count or not begins:
        told = told_starts(scans, table, rows, starts)
    later = rows[told.first_scan :]
    ending = Ending(loss_score)
    if count <= 1 and not begins:
        past = _follow_one(scans, table, later, told, setting, carry, starts)
    else:
        _refuse_of_several(threshold, clutter, begins=begins)
        least = least_amplitude(setting)
        confirming = np.inf
        if begins:
            able = usable_rows(scans, least)[np.concatenate(later)].sum()
            confirming = _confirming_score(scans, later, int(able), false_tracks_per_hour)
        followed = follow_several(
            scan_rows(scans, table, later, least), told.belief, told.time_s, setting,
            TrackRule(begins, confirming, loss_score), motion=carry,
            switching=starts.models.switching, begin=starts.at_measurements,
        )  # fmt: skip
        past = followed.scans
        ending = Ending(
            loss_score, followed.ended, false_tracks_per_hour if begins else None,
            confirming if begins else None, followed.n_crowded,
        )  # fmt: skip
    smoothing = Smoothing(smoothing_scans, carry, starts)
    return target_table(scans, table, later, past, setting, ending, smoothing)


def _own_ship(scans: Scans, navigation: Navigation | None, sensing: Sensing) -> FloatArray | None:
    """Return own ship's place and velocity at each row, if she is under way."""
    if navigation is None:
        return None
    if sensing.kind == "components":
        raise OptionError(
            "own ship's navigation belongs to scans of bearings in deg, alone or with a "
            "range in m and perhaps a range rate in m/s, these have "
            f"{', '.join(map(repr, scans.component_unit.tolist()))}; leave --own-ship out."
        )
    found = own_motion(navigation, scans.time_s, scans.start_utc_ns, "scans")
    return np.concatenate([found.position, found.velocity], axis=1)


def _refuse_of_several(threshold: str, clutter: str, *, begins: bool) -> None:
    """Refuse what several targets cannot have."""
    if threshold != "fixed":
        raise OptionError(
            f"threshold {threshold!r} is chosen for the region of one target; "
            "several need threshold 'fixed' (--threshold fixed)."
        )
    if begins and clutter == "count":
        raise OptionError(
            "the rate of false tracks rests on a density of clutter that is told: use "
            "clutter 'cells' with targets 'auto'."
        )


def _follow_one(
    scans: Scans,
    table: ScanTable,
    rows: list[IntArray],
    told: FirstState,
    setting: ClutterSetting,
    carry: Callable[[float], tuple[FloatArray, FloatArray]],
    starts: TrackStarts,
) -> list[FollowedScan]:
    """Follow one target by the threshold's rule."""
    belief, time_s = told.belief, told.time_s
    track = np.ones(1, np.int64)
    past = []
    for place, (index, scan) in enumerate(zip(rows, scan_arrays(scans, table, rows), strict=True)):
        interval = float(scans.time_s[index[0]]) - time_s
        time_s += interval
        transition, noise = carry(interval)
        update = step(
            belief, scan, setting, transition=transition, noise=noise,
            switching=starts.models.switching,
        )  # fmt: skip
        past.append(FollowedScan(place, track, update, index[None]))
        belief = update.belief
    return past


def _confirming_score(
    scans: Scans, rows: list[IntArray], starts: int, false_tracks_per_hour: float
) -> float:
    """Return the score that clutter reaches at the rate told, at most.

    Any of the measurements may begin a track.
    """
    if len(rows) < 2:
        raise DataError("targets 'auto' need two scans or more, got one.")
    span = float(scans.time_s[rows[-1][0]] - scans.time_s[rows[0][0]])
    hours = span * len(rows) / (len(rows) - 1) / 3600.0
    return max(float(np.log(max(starts, 1) / hours / false_tracks_per_hour)), 0.0)
