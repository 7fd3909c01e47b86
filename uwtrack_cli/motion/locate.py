"""Positions: where a vessel was, is and will be, from closest approaches or bearings.

**Method.** One sensor whose lines gave a speed fixes the motion by itself; several
sensors are fused by weighted least squares, without Doppler too. Encounters belong
together if a chi-square gate says so; what remains ambiguous is listed with weights.
A state is carried to other times along a straight line, along the other leg of a
manoeuvre, or along an even turn (`steady_turn`); what is not certain of the manoeuvre
widens its covariance, by differences in a turn.

**Conventions.** Straight motion; east and north in metres on the grid of the sensors,
latitude and longitude where the sensors have them. The covariance grows with the time
from the closest approaches.

**References.** Choi et al. (2014), eqs. 1-2 and 8-19 corrected.
"""

import warnings
from contextlib import suppress
from datetime import UTC, datetime
from itertools import combinations
from typing import Annotated

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin
from uwtrack_cli.constants import NANOSECONDS, SOUND_SPEED_WATER_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.directions import Delays, Directions
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, OptionError, UwtrackNote
from uwtrack_cli.estimation.constant_velocity import carried_on
from uwtrack_cli.motion.fix_table import FixRows, fix_rows, fix_table
from uwtrack_cli.motion.fusion.motion_fit import clock_errors
from uwtrack_cli.motion.fusion.sensor_table import (
    EvenTurn,
    OtherLeg,
    Passages,
    bearings_of_arrays,
    gather_passages,
)
from uwtrack_cli.motion.fusion.time_differences import fit_time_differences
from uwtrack_cli.motion.fusion.track_to_track import Mode, group_encounters, list_modes
from uwtrack_cli.motion.options import Probability
from uwtrack_cli.motion.passage.model.steady_turn import SteadyTurn, turned_way
from uwtrack_cli.motion.target_motion.contact import ContactAnswer, analyse_contacts
from uwtrack_cli.motion.target_motion.contact_pairing import ContactNumbers, pair_contacts
from uwtrack_cli.motion.target_motion.cross_fix import fixes_of_answers
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.inputs import check_sensors, measurements_from_series
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.target_motion.motion_table import reasons_of


@checked
def locate_vessels(  # noqa: PLR0913 (five inputs that may be absent)
    encounters: list[Encounters] | None = None,
    sensors: list[Sensor] | None = None,
    series: Series | None = None,
    directions: list[Directions] | None = None,
    delays: list[Delays] | None = None,
    *,
    at: list[str] | None = None,
    every_s: Annotated[float | None, Unit("s"), AtLeast(1e-3), AtMost(1e7)] = None,
    until: str | None = None,
    gate_probability: Probability = 0.999,
    contact_numbers: ContactNumbers = "auto",
) -> Fixes:
    """Locate vessels from closest approaches, or from the bearings of several sensors.

    With a single sensor the lines must determine the speed; with several sensors they
    need not. Without --at or --every-s, the positions are those at the closest
    approaches, or for a table of bearings those at its first and last row.

    Parameters
    ----------
    encounters
        Closest approaches, of any number of sensors and recordings.
    sensors
        The sensors, found by their identifiers.
    series
        Bearings measured elsewhere, each with its sensor.
    directions
        Directions that several arrays heard, where no closest approaches are given.
    delays
        Delays between three synchronised recorders or more, each with its place: those
        of one set of recorders.
    at
        Times of the positions: UTC such as 2026-01-31T12:00:00Z, or seconds from
        the first sample.
    every_s
        Interval of regular times.
    until
        End of the regular times: UTC, or seconds from the first sample; by default
        the last closest approach.
    gate_probability
        Probability that encounters of one vessel are joined.
    contact_numbers
        Whose the contact numbers of a table of bearings are: each sensor's own, so that
        contacts are joined by the evidence of one motion, or common to all sensors;
        auto is own, but for tables without contacts and files of `export`.

    Returns
    -------
    Fixes
        One row per vessel, time and mode.

    Raises
    ------
    DataError
        Sensors are missing, or their positions or clocks cannot be combined.
    OptionError
        An option is out of its range.

    Notes
    -----
    Choi et al. (2014), eq. 1 with the side per sensor; eqs. 15-16 with
    ``A = t_d^2 - |D|^2`` as the start without Doppler; weighted least squares on times,
    widths, speeds and bearings with the deviations of position, clock and compass.
    """
    if until is not None and every_s is None:
        raise OptionError(f"until ({until}) needs every_s: the interval of the times.")
    if series is None and not encounters and directions:
        series = bearings_of_arrays(directions, sensors or [])
    if series is not None:
        if encounters:
            raise DataError(
                "positions come from closest approaches or from a table of bearings, got both."
            )
        return _cross_fixes(series, at, every_s, until, contact_numbers)
    if not encounters and delays:
        if len(delays) > 1:
            raise DataError(
                f"the delays are of {len(delays)} recordings: positions come from those "
                f"of one set of recorders, or from the directions of several arrays "
                f"('uwtrack directions' of each first)."
            )
        return _fixes_of_delays(delays[0], sensors or [], at, every_s, until)
    if encounters is None:
        raise DataError("positions need closest approaches, or a table of bearings with sensors.")
    return _fixes_of_passages(
        gather_passages(encounters, sensors or []), gate_probability, at, every_s, until
    )


def _fixes_of_passages(
    passages: Passages,
    gate_probability: float,
    at: list[str] | None,
    every_s: float | None,
    until: str | None,
) -> Fixes:
    """Locate vessels by their closest approaches."""
    parts: list[FixRows] = []
    clocks: list[str] = []
    vessel = 0
    groups = group_encounters(passages, gate_probability)
    listed = list_modes(passages, groups, gate_probability)
    for members, modes in zip(groups, listed, strict=True):
        if not modes:
            names = ", ".join(passages.sensor[row] for row in members)
            msg = (
                f"no position for the encounter of sensor {names}: one sensor needs "
                "a speed and a bearing; give the encounters of more sensors."
            )
            warnings.warn(msg, UwtrackNote, stacklevel=3)
            continue
        vessel += 1
        clocks += _clock_statements(passages, modes[0])
        contact = passages.contact[members[0]] if _keeps_numbers(passages) else vessel
        times = fix_times(
            passages.approaches.measured[list(members), 0],
            passages.start_utc_ns, at, every_s, until,
        )  # fmt: skip
        parts += [
            _rows(contact, number, mode, times, passages) for number, mode in enumerate(modes, 1)
        ]
    grid = passages.grid.name, passages.grid.origin
    return fix_table(parts, passages.start_utc_ns, grid, " ".join(clocks))


def _cross_fixes(
    series: Series,
    at: list[str] | None,
    every_s: float | None,
    until: str | None,
    numbers: ContactNumbers,
) -> Fixes:
    """Locate the contacts of a table of sensors, where their range is determined."""
    if series.sensor is None:
        raise DataError(
            "the table has no column sensor: positions need bearings of several "
            "sensors; 'uwtrack tma' finds the motion for one platform."
        )
    check_sensors(series)
    options = TmaOptions(
        nuisances=NuisanceDeviations(
            sound_speed_mps=NOMINAL_SOUND_SPEED_STD * SOUND_SPEED_WATER_MPS,
            own_position_m=UNTOLD_POSITION_STD_M,
        ),
        sound_speed_mps=SOUND_SPEED_WATER_MPS,
        is_table=True,
    )
    series, pairings = pair_contacts(series, options, numbers)
    answers: list[tuple[ContactAnswer, FloatArray]] = []
    unplaced: list[str] = []
    for answer in analyse_contacts(measurements_from_series(series), options):
        contact = answer.data.contact
        reason = reasons_of(answer.modes[0], answer).get("range_m")
        if reason is not None:
            unplaced.append(f"No position for contact {contact}: {reason}.")
            continue
        own = answer.data.time_s
        times = fix_times(own[[0, -1]], series.start_utc_ns, at, every_s, until)
        answers.append((answer, times))
    if unplaced and not answers:
        unplaced.append(_what_is_missing(series))
    return fixes_of_answers(answers, series, unplaced, pairings)


def _what_is_missing(series: Series) -> str:
    """Say which rows a table without a position has, what they lack, and what to do."""
    heard: list[str] = []
    spans: list[tuple[float, float]] = []
    for name in np.unique(sensor := np.asarray(series.sensor)).tolist():
        time_s = series.time_s[sensor == name]
        spans.append((float(time_s.min()), float(time_s.max())))
        rows = f"{time_s.size} row" + "s" * (time_s.size > 1)
        heard.append(f"{name} {rows} from {spans[-1][0]:.0f} to {spans[-1][1]:.0f} s")
    missing = (
        "their bearings cross at too small an angle, or are too uncertain, or are not "
        "known to be of one vessel (--contact-numbers common)"
    )
    if len(spans) == 1:
        missing = "positions need the bearings of a second sensor of the same time"
    elif all(one[1] < other[0] or other[1] < one[0] for one, other in combinations(spans, 2)):
        missing = "no two sensors have rows of the same time"
    return (
        f"The table has of {'; '.join(heard)}: {missing}. 'uwtrack tma' of the same "
        f"table gives the motions that fit, with the intervals of their ranges; longer "
        f"records and frequencies narrow them."
    )


def _fixes_of_delays(
    delays: Delays,
    sensors: list[Sensor],
    at: list[str] | None,
    every_s: float | None,
    until: str | None,
) -> Fixes:
    """Locate the source of the delays between synchronised recorders."""
    sensor = next((one for one in sensors if one.id == delays.sensor), None)
    if sensor is None or delays.clock_std_s is None:
        raise DataError(
            "positions need delays between recorders at several places, measured as "
            "'uwtrack delays A.wav B.wav C.wav'; those of one array give its directions: "
            "'uwtrack directions'."
        )
    ways = fit_time_differences(delays, sensor)
    ends = np.array([delays.time_s.min(), delays.time_s.max()])
    times = fix_times(ends, delays.start_utc_ns, at, every_s, until)
    origin = None
    if sensor.latitude is not None and sensor.longitude is not None:
        origin = Origin(sensor.latitude, sensor.longitude)
    first = np.array([sensor.east_m or 0.0, sensor.north_m or 0.0, 0.0, 0.0])
    first = first if origin is None else np.zeros(4)
    parts = [
        fix_rows(
            *carried_on(way.state + first, way.covariance, times), times, contact=1,
            mode=number, weight=way.weight, sensors=sensor.channels,
        )
        for number, way in enumerate(ways, 1)
    ]  # fmt: skip
    name = "grid" if origin is None else f"sensor {sensor.channel_names[0]}"
    return fix_table(parts, delays.start_utc_ns, (name, origin), "")


def _clock_statements(passages: Passages, mode: Mode) -> list[str]:
    """Name the differences of clocks that a vessel heard by several sensors shows."""
    rows = list(mode.members)
    prior = passages.clock_std_s[rows]
    if len(rows) < 2 or not (prior > 0).any():
        return []
    offset, spread = clock_errors(
        passages.approaches.take(rows), mode.state, mode.reference_s, prior
    )
    found = []
    for second in range(1, len(rows)):
        change: FloatArray = np.zeros(len(rows))
        change[[0, second]] = -1.0, 1.0
        difference = float(change @ offset)
        std = float(np.sqrt(max(float(change @ spread @ change), 0.0)))
        expected = float(np.hypot(prior[0], prior[second]))
        if std > CLOCK_SHARE * expected or abs(difference) < CLOCK_DEVIATIONS * std:
            continue
        one, other = passages.sensor[rows[0]], passages.sensor[rows[second]]
        found.append(
            f"The clocks of {one} and {other} differ by {abs(difference):.1f} +- "
            f"{std:.1f} s: {other if difference > 0 else one} is ahead."
        )
    return found


def _keeps_numbers(passages: Passages) -> bool:
    """Tell whether the contacts of one sensor, each named once, keep their numbers."""
    return len(set(passages.sensor)) <= 1 and len(set(passages.contact)) == len(passages.contact)


def _rows(contact: int, number: int, mode: Mode, times: FloatArray, passages: Passages) -> FixRows:
    """Predict one mode at all times: state and covariance grow with the lag."""
    legs = [passages.other_leg[row] for row in mode.members]
    leg = next((one for one in legs if one is not None), None)
    bends = [passages.even_turn[row] for row in mode.members]
    bend = next((one for one in bends if one is not None), None)
    state, covariance = mode.at(times)
    if bend is not None and np.isfinite(bend.turn):
        state, covariance = turned_way_of(mode, bend, times)
    elif bend is not None:
        ends = bend.values[2] + bend.values[1] * np.array([-0.5, 0.5])
        is_same = np.clip(times, *ends) == np.clip(bend.closest_s, *ends)
        times, state, covariance = (values[is_same] for values in (times, state, covariance))
        msg = (
            f"contact {contact} turned between {ends[0]:.0f} and {ends[1]:.0f} s, and "
            f"to which side is not known: it has no positions on its other course."
        )
        warnings.warn(msg, UwtrackNote, stacklevel=3)
    elif leg is not None:
        is_other = (times - leg.time_s > 0) == leg.is_later
        if not np.isfinite(leg.along_away_mps).all():
            times, state, covariance = (values[~is_other] for values in (times, state, covariance))
            msg = (
                f"contact {contact} manoeuvred at {leg.time_s:.0f} s and its other "
                f"course is not known: it has no positions there."
            )
            warnings.warn(msg, UwtrackNote, stacklevel=3)
        elif is_other.any():
            state[is_other], covariance[is_other] = other_leg_way(mode, leg, times[is_other])
    names = sorted({passages.sensor[row] for row in mode.members})
    return fix_rows(
        state, covariance, times, contact=contact, mode=number, weight=mode.weight,
        sensors=",".join(names),
    )  # fmt: skip


NOMINAL_SOUND_SPEED_STD = 0.01
"""Relative deviation of a sound speed that nobody gave."""

UNTOLD_POSITION_STD_M = 10.0
"""Deviation of each coordinate of a place that a table gives without one."""

CLOCK_SHARE, CLOCK_DEVIATIONS = 0.5, 3.0
"""A difference of clocks is named when its deviation is this share of the prior one, and
it is this many deviations from zero."""

FARTHEST_S = 1e9
"""Times farther from the first sample (thirty years) are taken for a slip."""

MOST_TIMES = 100_000
"""Regular times beyond this number are taken for a slip."""


def fix_times(
    approach_s: FloatArray,
    start_utc_ns: int | None,
    at: list[str] | None,
    every_s: float | None,
    until: str | None,
) -> FloatArray:
    """Return the times of the positions, s, in order: single and regular ones.

    Examples
    --------
    >>> fix_times(np.array([10.0]), None, ["60", "30.5"], None, None).tolist()
    [30.5, 60.0]
    """
    wanted = [parse_time(text, start_utc_ns) for text in at or []]
    if every_s is not None:
        first = float(np.min(approach_s))
        last = float(np.max(approach_s))
        end = parse_time(until, start_utc_ns) if until is not None else last
        count = int(np.floor(max(end - first, 0.0) / every_s)) + 1
        if count > MOST_TIMES:
            raise OptionError(
                f"every_s {every_s} until {until} makes {count} times; at most "
                f"{MOST_TIMES} are accepted."
            )
        wanted += [first + every_s * number for number in range(count)]
    return np.unique(np.array(wanted or approach_s, float))


def parse_time(text: str, start_utc_ns: int | None) -> float:
    """Return seconds from the first sample of a time, UTC or such seconds, as text.

    Examples
    --------
    >>> parse_time("1970-01-01T00:01:00Z", 0)
    60.0
    """
    seconds = None
    with suppress(ValueError):
        seconds = float(text)
    if seconds is not None:
        if not abs(seconds) <= FARTHEST_S:
            raise OptionError(
                f"the time {text} is no number of seconds within {FARTHEST_S:g} of the "
                f"first sample."
            )
        return seconds
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise OptionError(
            f"cannot read the time {text!r}: give UTC such as 2026-01-31T12:00:00Z "
            "or seconds from the first sample."
        ) from error
    if start_utc_ns is None:
        raise DataError(
            f"the time {text!r} is UTC, but the recording has no start time: give "
            "seconds from the first sample, or run again with --start-utc."
        )
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    whole = (since.days * 86400 + since.seconds) * NANOSECONDS
    return (whole + since.microseconds * 1000 - start_utc_ns) / NANOSECONDS


TURN_STEPS = (1e-4, 1e-2, 1e-2)
"""Steps of the differences by the angle (rad), the duration and the middle (s)."""


def turned_way_of(mode: Mode, bend: EvenTurn, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states and covariances of a mode that turns evenly."""
    (at,), (spread,) = mode.at(np.array([bend.closest_s]))
    course = np.radians(bend.course_deg)
    # in a mode of the opposite side the vessel goes the opposite way
    turn = bend.turn * np.sign(at[2:] @ [np.sin(course), np.cos(course)])
    away = -turn * np.array([[0.0, 1.0], [-1.0, 0.0]])
    # the turn itself, then a small step of its angle, its duration and its middle
    steps = np.concatenate([np.zeros((1, 3)), np.diag(TURN_STEPS)])
    turns = SteadyTurn(*(bend.values + steps).T)
    way, heading = turned_way(times, bend.closest_s, turns)
    moved = np.zeros((4, times.size, 4, 4))
    moved[:, :, range(4), range(4)] = [1.0, 1.0, 0.0, 0.0]
    both = np.stack([way, heading])[..., None, None]
    for rows, part in zip((slice(0, 2), slice(2, 4)), both, strict=True):
        moved[:, :, rows, 2:] = part.real * np.eye(2) + part.imag * away
    states = moved @ at
    slope = (states[1:] - states[0]) / np.array(TURN_STEPS)[:, None, None]
    covariance = moved[0] @ spread @ np.swapaxes(moved[0], 1, 2)
    covariance += np.einsum("ptx,pq,qty->txy", slope, bend.covariance, slope)
    return states[0], covariance


def other_leg_way(mode: Mode, leg: OtherLeg, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states and covariances of a mode on the other side of its manoeuvre."""
    (at,), (spread,) = mode.at(np.array([leg.time_s]))
    along = mode.state[2:] / np.hypot(*mode.state[2:])
    course = np.radians(leg.course_deg)
    # in a mode of the opposite side the vessel goes the opposite way
    turn = leg.turn * np.sign(along @ [np.sin(course), np.cos(course)])
    away = -turn * np.array([along[1], -along[0]])
    velocity = leg.along_away_mps[0] * along + leg.along_away_mps[1] * away
    unit = velocity / max(float(np.hypot(*velocity)), 1e-9)
    axes = np.stack([unit, [unit[1], -unit[0]]], axis=1) * leg.std_mps
    own = axes @ axes.T
    turned = np.outer(velocity - mode.state[2:], velocity - mode.state[2:])
    lag = (times - leg.time_s)[:, None]
    state = np.concatenate([at[:2] + lag * velocity, np.tile(velocity, (times.size, 1))], axis=1)
    covariance = np.zeros((times.size, 4, 4))
    place = spread[:2, :2] + leg.time_std_s**2 * turned
    covariance[:, :2, :2] = place + lag[..., None] ** 2 * own
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = lag[..., None] * own
    covariance[:, 2:, 2:] = own
    return state, covariance
