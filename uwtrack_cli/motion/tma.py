"""Target motion from bearings and Doppler: range, course and speed of a contact.

**Method.** The motion of a target on a straight track is fitted to raw bearings and
frequencies by maximum likelihood (Chang et al. 2003, corrected; Nardone, Lindgren &
Gong 1984), with rest frequencies projected out, from many starts. Every motion
within the likelihood-ratio region is returned as a mode, and what the data cannot
tell is said, with the reason. Delays of a bottom or surface bounce, where a table has them,
enter the same fit as ranges (see `target_motion.bounce`). Alterations of the target's velocity are always tried, and
its legs are given where the evidence asks for them (see `target_motion.legs`).

**Conventions.** The state is that at the contact's first measurement; bearings are
compass degrees from own ship to the target, ranges horizontal. A platform without
navigation stands still. A sensor of known depth hears a source at the depth of a
surface vessel's propeller.

**References.** Chang, Park, Kim, Ryu & Kim 2003, J. Acoust. Soc. Korea; Jauffret &
Pillon 1996, IEEE Trans. Aerosp. Electron. Syst. 32; Golub & Pereyra 1973, SIAM J.
Numer. Anal. 10.
"""

from typing import Annotated, Literal
from warnings import warn

import numpy as np

from uwtrack_cli.constants import SOUND_SPEED_WATER_MPS, SOURCE_DEPTH_M
from uwtrack_cli.data.bearing_time import MIRROR, BearingTime
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.sensor import Navigation, Sensor, SoundSpeed
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, OptionError, UwtrackNote
from uwtrack_cli.motion.options import BounceGeometry, Misfit, MotionModel, Nuisances, Search
from uwtrack_cli.motion.passage.fit.nuisances import COMPASS_STD_DEG
from uwtrack_cli.motion.passage.model.direction_bearings import bearing_series
from uwtrack_cli.motion.sound_speed import sound_speed_std
from uwtrack_cli.motion.target_motion.bounce import Bounce, bounce_of
from uwtrack_cli.motion.target_motion.contact import analyse_contacts
from uwtrack_cli.motion.target_motion.contact_pairing import ContactNumbers, pair_contacts
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.inputs import (
    Measurements,
    check_sensors,
    measurements_from_lines,
    measurements_from_series,
)
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.target_motion.motion_table import motions_table
from uwtrack_cli.motion.target_motion.problem import Expectation, MotionPrior

DEFAULT_MODEL, DEFAULT_SEARCH, DEFAULT_MISFIT = MotionModel(), Search(), Misfit()
DEFAULT_NUISANCES, DEFAULT_BOUNCE = Nuisances(), BounceGeometry()

OWN_COMPASS_STD_DEG, OWN_POSITION_STD_M, OWN_VELOCITY_STD_MPS = 1.0, 10.0, 0.1
"""Deviations of own ship's compass and navigation where none are given."""


@checked
def estimate_motion(  # noqa: PLR0913 (four inputs that may be absent)
    series: Series | None = None,
    lines: Lines | None = None,
    navigation: Navigation | None = None,
    sensor: Sensor | None = None,
    bearing_time: BearingTime | None = None,
    directions: Directions | None = None,
    *,
    solver: Literal["mle", "recursive", "genetic", "annealing"] = "mle",
    array_heading: Literal["auto", "none", "course", "heading"] = "auto",
    sound_speed_mps: SoundSpeed | None = None,
    range_limits_m: Annotated[
        tuple[float, float] | None, Unit("m"), AtLeast(1), AtMost(1e7), Increasing()
    ] = None,
    speed_limits_mps: Annotated[
        tuple[float, float] | None, Unit("m/s"), AtLeast(0), AtMost(100), Increasing()
    ] = None,
    course_limits_deg: Annotated[
        tuple[float, float] | None, Unit("degree"), AtLeast(0), AtMost(360)
    ] = None,
    contact_numbers: ContactNumbers = "auto",
    updates: Annotated[int, AtLeast(1), AtMost(100_000)] = 20,
    seed: Annotated[int, AtLeast(0), AtMost(2**32 - 1)] = 1,
    misfit: Misfit = DEFAULT_MISFIT,
    model: MotionModel = DEFAULT_MODEL,
    search: Search = DEFAULT_SEARCH,
    nuisances: Nuisances = DEFAULT_NUISANCES,
    bounce: BounceGeometry = DEFAULT_BOUNCE,
) -> Motions:
    """Estimate range, course and speed of contacts from bearings and Doppler.

    A passive sonar measures bearings and frequencies, not ranges. Over time they
    determine the range, best with a manoeuvre of own ship. The result lists every
    motion that fits about equally well, and says which quantities are not observable.

    Parameters
    ----------
    series
        Bearings and frequencies measured elsewhere, or the bearings of broadband
        contacts that an array follows beside the lines.
    lines
        Tracked frequency lines; their raw measurements are fitted.
    navigation
        Own ship; by default that of the sensor, or a platform that stands still.
    sensor
        The sensor that recorded the lines: its navigation, sound speed and compass.
    bearing_time
        Record of the array that heard the lines: where it was, and how it pointed.
    directions
        Directions that an array heard, from delays, where there is nothing else: those
        of a line, such as two hydrophones, are fitted on both sides.
    solver
        How the minimum is found: mle descends from many starts, is exact and the
        fastest; recursive updates the estimate with every row and is the fastest for
        an estimate after each; genetic and annealing search the whole box as the paper
        does (scipy's differential evolution and dual annealing) and descend from the
        best point, which finds the same, several times slower.
    array_heading
        Direction of a line array that cannot resolve left from right: own course, the
        heading of own ship (of a fixed sensor: its own), or none for bearings that
        resolve the side; auto is the heading for lines of such an array, else none.
    sound_speed_mps
        Sound speed; by default that of the sensor, or 1500 m/s. Sea water has about
        1500, air 340.
    range_limits_m
        Least and greatest range at the first measurement that an analyst expects. Like
        the other two limits it counts as a measurement: of the middle (of the
        logarithm), with the deviation of what lies anywhere between the limits.
    speed_limits_mps
        Least and greatest speed on every leg that an analyst expects.
    course_limits_deg
        Courses of the first leg that an analyst expects, clockwise from the first to
        the second.
    contact_numbers
        Whose the contact numbers of a table of several sensors are: each sensor's own,
        so that contacts are joined by the evidence of one motion, or common to all
        sensors; auto is own, but for tables without contacts and files of `export`.
    updates
        Number of estimates over time, of growing parts of the record.
    seed
        Seed of the random solvers.
    misfit
        Deviations of the measurements and loss of residuals.
    model
        Model of Doppler and propagation.
    search
        Limits of the search and of the modes.
    nuisances
        Deviations of sound speed, compass and own ship.
    bounce
        Depths by which the delays of a table tell the range.

    Returns
    -------
    Motions
        One row per contact and mode, best first; estimates over time.

    Raises
    ------
    DataError
        There are no measurements, two kinds of them, or they cannot be right.
    OptionError
        An option is outside what is accepted.

    Notes
    -----
    The misfit is the sum over rows and lines of the loss of
    (theta_k(p) - theta_k) / sigma and (f_nk(p) - f_nk) / sigma with
    f = f0 (1 - rate / c) (Chang et al. 2003, eqs 1-4, corrected).
    """
    contacts = _contacts(series, lines, directions, is_array=bearing_time is not None)
    is_of_sensors = series is not None and series.sensor is not None
    if series is not None and is_of_sensors:
        check_sensors(series)
        _check_sensor_options(navigation, solver)
    is_moving = navigation is not None or is_of_sensors
    if bearing_time is not None:
        is_moving = sensor is not None and sensor.navigation is not None
        navigation = _array_navigation(bearing_time, navigation, sensor)
    if array_heading == "auto":
        is_open = bearing_time is not None and bearing_time.ambiguity == MIRROR
        array_heading = "heading" if is_open else "none"
    if navigation is None and sensor is not None:
        navigation = sensor.navigation
        is_moving = navigation is not None
    speed = sound_speed_mps
    if speed is None:
        speed = SOUND_SPEED_WATER_MPS if sensor is None else sensor.sound_speed_mps
    is_table = lines is None and bearing_time is None
    propagation = model.propagation
    if propagation == "auto":
        propagation = "instant" if is_table else "delayed"
    reflected = _bounce(series, sensor, bounce)
    analysis = TmaOptions(
        navigation=navigation,
        towing=_towing(bearing_time, sensor),
        solver=solver,
        array_heading=array_heading,
        design_frequency_hz=_design_frequency_hz(bearing_time) if lines is not None else None,
        fixed_heading_deg=None if sensor is None else sensor.heading_deg,
        nuisances=_deviations(nuisances, sensor, is_moving, sound_speed_mps),
        height_m=_height(sensor) if reflected is None else reflected.height_m,
        sound_speed_mps=speed,
        delayed=propagation == "delayed",
        is_table=is_table,
        updates=updates,
        seed=seed,
        misfit=misfit,
        model=model,
        search=search,
        prior=_prior(range_limits_m, speed_limits_mps, course_limits_deg),
        compass_std_deg=nuisances.compass_std_deg,
        bounce=reflected,
    )
    pairings = None
    if series is not None and is_of_sensors:
        series, pairings = pair_contacts(series, analysis, contact_numbers)
        contacts = measurements_from_series(series)
    return motions_table(analyse_contacts(contacts, analysis), analysis, pairings)


def _design_frequency_hz(bearing_time: BearingTime | None) -> float | None:
    """Return that of a line array; others have no lobes at equal distances."""
    if bearing_time is None or bearing_time.ambiguity != MIRROR:
        return None
    return bearing_time.design_frequency_hz


def _prior(
    range_m: tuple[float, float] | None,
    speed_mps: tuple[float, float] | None,
    course_deg: tuple[float, float] | None,
) -> MotionPrior:
    """Return what an analyst's limits say before the fit."""
    course = None
    if course_deg is not None:
        first, width = course_deg[0], (course_deg[1] - course_deg[0]) % 360.0
        course = Expectation.between(*np.radians([first, first + width]).tolist())
    return MotionPrior(
        log_range=None if range_m is None else Expectation.between(*np.log(range_m)),
        speed_mps=None if speed_mps is None else Expectation.between(*speed_mps),
        course_rad=course,
    )


def _check_sensor_options(navigation: Navigation | None, solver: str) -> None:
    """Refuse what a table of several sensors cannot be combined with."""
    if navigation is not None:
        raise OptionError(
            "the table names its sensors, and --own-ship is the way of one platform: "
            "leave one of the two out; a sensor's way is the navigation of the sensor "
            "file."
        )
    if solver == "recursive":
        raise OptionError(
            "solver 'recursive' follows one platform; a table of sensors takes 'mle'."
        )


def _deviations(
    given: Nuisances, sensor: Sensor | None, is_moving: bool, sound_speed_mps: float | None
) -> NuisanceDeviations:
    """Fill in what the options leave open."""
    sound = given.sound_speed_std_mps
    if sound is None:
        sound = sound_speed_std(sensor or Sensor(id="own ship"), sound_speed_mps)
    compass = given.compass_std_deg
    if compass is None and sensor is not None:
        compass = sensor.compass_std_deg
    if compass is None:
        compass = OWN_COMPASS_STD_DEG if sensor is None else COMPASS_STD_DEG
    position, velocity = given.position_std_m, given.velocity_std_mps
    if position is None and sensor is not None:
        position = sensor.navigation_position_std_m
    if velocity is None and sensor is not None:
        velocity = sensor.navigation_velocity_std_mps
    usual = (OWN_POSITION_STD_M, OWN_VELOCITY_STD_MPS) if is_moving else (0.0, 0.0)
    return NuisanceDeviations(
        sound_speed_mps=sound,
        compass_deg=compass,
        own_position_m=usual[0] if position is None else position,
        own_velocity_mps=usual[1] if velocity is None else velocity,
        correlation_time_s=given.correlation_time_s,
        is_usual_navigation=is_moving and (position is None or velocity is None),
    )


def _towing(record: BearingTime | None, sensor: Sensor | None) -> Navigation | None:
    """Return the way of the ship that tows the array; None: it is the array's own."""
    if record is None or sensor is None or not sensor.tow_offset_m:
        return None
    return sensor.navigation


def _array_navigation(
    record: BearingTime, given: Navigation | None, sensor: Sensor | None
) -> Navigation | None:
    """Return the way of the array itself; None for one that nobody placed."""
    own = None if sensor is None else sensor.navigation
    if given is not None and (own is None or not given.equals(own)):
        raise DataError(
            "these lines are of an array whose own track is in the file; the ship's "
            "would be wrong by the length of the tow. Leave out --own-ship here, "
            "or give it to 'uwtrack beamform'."
        )
    if np.isnan(record.heading_deg).any() or np.isnan(record.east_m).any():
        return None
    return Navigation(
        time_s=record.frames.time_s,
        east_m=record.east_m,
        north_m=record.north_m,
        heading_deg=record.heading_deg,
    )


def _bounce(series: Series | None, sensor: Sensor | None, given: BounceGeometry) -> Bounce | None:
    """Return the reflected path whose delays a table has; None without delays."""
    late = None if series is None else series.bounce_delay_s
    if late is None or np.isnan(late).all():
        if given != DEFAULT_BOUNCE:
            raise OptionError(
                "--bounce options are for delays of a reflected path, and there is no "
                "column bounce_delay_s."
            )
        return None
    if series is not None and series.sensor is not None:
        raise DataError(
            "bounce_delay_s is of one platform, and the table names its sensors: leave "
            "out one of the two columns."
        )
    return bounce_of(given, sensor)


def _height(sensor: Sensor | None) -> float:
    """Depth between the sensor and a surface vessel; 0 when unknown."""
    if sensor is None or sensor.depth_m is None:
        return 0.0
    return sensor.depth_m - SOURCE_DEPTH_M


def _contacts(
    series: Series | None, lines: Lines | None, directions: Directions | None, *, is_array: bool
) -> list[Measurements]:
    """Take the inputs apart; contacts of an array that have no lines come after."""
    if series is None and lines is None and directions is not None:
        return measurements_from_series(bearing_series(directions))
    if directions is not None:
        used = "lines" if series is None else "table"
        msg = f"the directions are not used: the motion is fitted to the {used}."
        warn(msg, UwtrackNote, stacklevel=4)
    if (series is None) == (lines is None) and not (is_array and series is not None):
        found = "neither" if series is None else "both"
        raise DataError(
            f"target motion needs either a table of bearings and frequencies or "
            f"tracked lines, got {found}; make lines with 'uwtrack track' or "
            f"'uwtrack trace', or directions with 'uwtrack directions', which are taken "
            f"where there are neither."
        )
    contacts = [] if lines is None else measurements_from_lines(lines)
    if series is None:
        return contacts
    if series.time_s.size == 0 and lines is None and not is_array:
        raise DataError("the table of bearings and frequencies has no rows.")
    known = {one.contact for one in contacts}
    told = measurements_from_series(series)
    return contacts + [one for one in told if one.contact not in known]
