"""Contacts of a line array by their broadband sound: bearings over time.

**Method.** The bearing-time record is averaged over some seconds. Directions in which it
stands out of those beside it, by more than its own noise and the sidelobes of the loudest,
are followed from average to average by a Kalman filter of the bearing on either side.
Without a turn of the array both sides fit; in a turn the bearing goes on smoothly on one
of them, and leads. What is heard in most averages is a contact; one that moves with the
lines of another has its number.

**Conventions.** As in `beamform`: cosine 1 is ahead; bearings are written for the side of
the record.

**References.** W. A. Struzinski & E. D. Lowe, J. Acoust. Soc. Am. 76 (1984): noise
background normalisation; Y. Bar-Shalom & X.-R. Li, Multitarget-Multisensor Tracking
(1995), chapter 2, for confirmation by m of n.
"""

from dataclasses import dataclass
from itertools import compress
from typing import Annotated

import numpy as np

from uwtrack_cli.arrays.beam_peaks import BENT_DEG, SPARE_DB
from uwtrack_cli.arrays.line_array import UNIFORM_SIDELOBE_DB, angle_std_deg
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.angles import interpolate_deg, wrap_deg
from uwtrack_cli.estimation.assignment import assign
from uwtrack_cli.estimation.kalman import KalmanState, predict, update
from uwtrack_cli.estimation.robust import white_scatter
from uwtrack_cli.estimation.window import cell_correlation, parabola_offset

SURE_DEVIATIONS = 5.0
"""Deviations of the record's noise by which a direction must stand out: the first at which
noise does so in fewer than one of ten thousand averages (0.3 in ten thousand; 62 at 4; see
studies/constants/bearing_contacts.py, as for the next two)."""

ACCELERATION_DENSITY = 1e-4
"""Density of the noise that changes the rate of a bearing, degree^2/s^3: by 0.1 degrees
a second, that of a vessel of 5 m/s at 2.9 km, within 100 s. Of drawn vessels 98 % are one
contact, and 84 % in pairs; with a tenth of it 93 and 75 %, with ten times 100 and 83 %."""

START_RATE_DEGPS = 0.5
"""Deviation of a rate that is not known, degrees per second."""

MOST_MISFIT = 50.0
"""What one side may have fitted worse than the other, at most, in squared deviations."""

TURNING_DEG = 2.0
"""Turn of the array within an average from which it tells no directions, degrees: 8 % of the
bearings at the edges of turns lie beyond 1.96 deviations, and 14 % if it is doubled."""

ROUNDS = 5
"""Fits of the background, each without the beams that the last one leaves above it."""

GATE = 4.0
"""Deviations within which a direction may belong to a contact."""

MOST_MISSED_S = 90.0
"""A contact that is not heard for so long has ended, s."""

FEWEST_POINTS = 8
"""Directions that make a contact."""

HEARD_SHARE = 0.5
"""Share of the averages of its time in which a contact is heard at least."""

BEAM_STEPS = 2.0
"""Half the width of a beam in steps of the cosine from beam to beam (see `line_array`)."""

SAME_DEG = 3.0
"""Bearings that differ by less, in the median and beside their own deviations, are those
of one contact."""


@checked
def track_bearings(
    bearing_time: BearingTime,
    lines: Lines | None = None,
    *,
    average_s: Annotated[float, Unit("s"), AtLeast(0.1), AtMost(3600)] = 10.0,
) -> Series:
    """Track the bearings of broadband sources on a line array.

    A vessel without lines stands out of the bearing-time record by its noise alone. Its
    bearings over time are a contact for tma, which finds its range after own ship has
    turned. A contact that lines show already keeps their number.

    Parameters
    ----------
    bearing_time
        Record of a line array.
    lines
        Lines that it heard; contacts with the same bearings keep their numbers.
    average_s
        Time over which the record is averaged: a longer time detects weaker contacts,
        as long as none moves by half a beam within it.

    Returns
    -------
    Series
        A row per contact and average in which it was heard.

    Raises
    ------
    DataError
        The record is of an array that is no line.
    OptionError
        An option is out of range.

    Notes
    -----
    A direction stands out by its prominence, the least by which it exceeds the lower
    ways to higher ones. Deviations come from the scatter of each contact's cosines
    about a smooth course, as a share of how much they stand out.
    """
    if bearing_time.cos_angle is None:
        raise DataError(
            "this record is of an array that is no line: its broadband directions are "
            "measured already ('uwtrack show FILE directions'); 'cpa' and 'locate' take "
            "them."
        )
    averages = _averages(bearing_time, bearing_time.cos_angle, average_s)
    side = 1.0 if bearing_time.side == "starboard" else -1.0
    tracks = [
        found
        for rows in _follow(averages)
        if (found := _measured(averages, rows, side)) is not None
    ]
    width = BEAM_STEPS * averages.step
    return _series(tracks, lines, bearing_time.frames, average_s, width)


@dataclass(frozen=True, eq=False)
class _Averages:
    """Averages of the record, and what stands out of them."""

    time_s: FloatArray
    """Middle of each, s, shape (average,)."""
    heading_deg: FloatArray
    """Heading of the array there; 0 where it has none."""
    step: float
    """Cosine from beam to beam."""
    average: IntArray
    """Average of every direction that stands out, ascending, shape (direction,)."""
    cosine: FloatArray
    """The directions."""
    height: FloatArray
    """By how many deviations of the noise each stands out."""


@dataclass(frozen=True, eq=False)
class _BearingTrack:
    """Bearings of a contact."""

    time_s: FloatArray
    """Times, s."""
    angle_rad: FloatArray
    """Angles from the array's head, positive clockwise, on the side of the record."""
    bearing_deg: FloatArray
    """Bearings on the side of the record."""
    bearing_std_deg: FloatArray
    """Their deviations."""


def _averages(record: BearingTime, cos_angle: FloatArray, average_s: float) -> _Averages:
    frames = record.frames
    hop_s = frames.hop_samples / frames.sample_rate_hz
    count = max(1, round(average_s / hop_s))
    power = 10.0 ** (record.excess_db.astype(np.float64) / 10.0)
    power -= _background(power, record.diffuse_power)
    heading = np.nan_to_num(record.heading_deg)
    silent = ~np.isfinite(power).all(axis=1) | (record.bend_deg > BENT_DEG)
    sidelobe_db = record.sidelobe_db or UNIFORM_SIDELOBE_DB
    spare = 10.0 ** (-(sidelobe_db - SPARE_DB) / 10.0)
    time_s, found = [], []
    for number, start in enumerate(range(0, frames.n_frames, count)):
        at = slice(start, start + count)
        time_s.append(float(frames.time_s[at].mean()))
        turned = np.ptp(np.unwrap(heading[at], period=360.0))
        rows = power[at][~silent[at]]
        if turned > TURNING_DEG or 2 * len(rows) < count:
            continue
        noise = _noise(rows, hop_s / frames.window_s)
        place, height = _standing_out(rows.mean(axis=0), noise, spare)
        found.append((np.full(place.size, number), place, height))
    nothing = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    average, place, height = (np.concatenate(each) for each in zip(nothing, *found, strict=True))
    step = float(cos_angle[1] - cos_angle[0])
    middle = np.array(time_s)
    return _Averages(
        time_s=middle,
        heading_deg=interpolate_deg(middle, frames.time_s, heading),
        step=step,
        average=average.astype(np.int64),
        cosine=np.clip(cos_angle[0] + step * place, -1.0, 1.0),
        height=height,
    )


def _background(power: FloatArray, diffuse: FloatArray | None) -> FloatArray:
    """Return what noise from all around and of each hydrophone gives in each beam.

    Noise from all around is weaker in the beams ahead and astern: left in, its slope
    would move every direction to the side. It is as much of it as explains what most
    beams have in most frames.
    """
    usual = np.nanmedian(power, axis=0)
    model = np.ones((usual.size, 1))
    if diffuse is not None and np.ptp(diffuse) > 0.0:
        model = np.column_stack([model[:, 0], diffuse])
    weight = np.ones(usual.size)
    for _ in range(ROUNDS):
        scaled = model * weight[:, None]
        share, *_ = np.linalg.lstsq(scaled, weight * usual, rcond=None)
        excess = usual - model @ share
        spread = max(1.4826 * float(np.median(np.abs(excess))), 1e-9)
        weight = np.where(excess > 2.0 * spread, 0.0, 1.0)  # a steady contact
    return np.asarray(model @ share)


def _noise(power: FloatArray, hop_windows: float) -> float:
    """Deviation of the mean of some frames, from the change between frames."""
    apart = min(max(1, round(1.0 / hop_windows)), len(power) - 1)
    change = np.abs(power[apart:] - power[:-apart])
    one = float(np.median(change)) / (0.6745 * np.sqrt(2.0)) if apart else 1.0
    shared = sum(cell_correlation(0.0, k * hop_windows) for k in range(1, apart + 1))
    return one * float(np.sqrt((1.0 + 2.0 * shared) / len(power)))


def _standing_out(power: FloatArray, noise: float, spare: float) -> tuple[FloatArray, FloatArray]:
    """Return places between beams of what stands out, and by how many deviations."""
    least = SURE_DEVIATIONS * np.sqrt(2.0) * noise
    top, height = prominent_peaks(power, max(least, spare * float(np.ptp(power))))
    part = parabola_offset(power[top - 1], power[top], power[top + 1])
    return top + part, height / max(noise, 1e-12)


def prominent_peaks(values: FloatArray, least: float) -> tuple[IntArray, FloatArray]:
    """Return where values have peaks, and by how much each one stands out.

    A peak stands out by what separates it from higher ones, or from the ends, on the side
    where that is less; ``least`` of it is asked for. Of a flat top the middle is returned.
    """
    begin = np.flatnonzero(np.diff(values, prepend=np.nan))
    level = values[begin]  # of each run of equal values
    is_top = np.zeros(begin.size, dtype=bool)
    is_top[1:-1] = (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
    found = [
        ((begin[k] + begin[k + 1] - 1) // 2, height)
        for k in np.flatnonzero(is_top)
        if (height := level[k] - max(_lowest(level[k::-1]), _lowest(level[k:]))) >= least
    ]
    return np.array([k for k, _ in found], np.int64), np.array([h for _, h in found])


def _lowest(level: FloatArray) -> float:
    """Return the least value from a peak, the first one, up to what is higher."""
    higher = np.flatnonzero(level > level[0])
    return float(level[: higher[0] if higher.size else None].min())


def _follow(averages: _Averages) -> list[IntArray]:
    """Return the directions of every contact that is followed, in the order of time."""
    members: list[list[int]] = []
    active, heard_s = np.zeros(0, np.int64), np.zeros(0)
    state = KalmanState(*(np.zeros((2, 0)) for _ in KalmanState._fields))
    misfit = np.zeros((2, 0))
    before_s = 0.0
    for k, time_s in enumerate(averages.time_s):
        state = predict(state, time_s - before_s, np.array(ACCELERATION_DENSITY))
        before_s = time_s
        here = np.flatnonzero(averages.average == k)
        seen, variance = _on_both_sides(averages, here, averages.heading_deg[k])
        away = wrap_deg(seen[:, None, :] - state.position[:, :, None])
        fit = away**2 / (state.variance[:, :, None] + variance)
        # a side that has fitted worse so far counts less
        fit += (misfit - misfit.min(axis=0))[:, :, None]
        cost = fit.min(axis=0)
        track, at = np.nonzero(cost < GATE**2)
        chosen = assign(track, at, cost[track, at])
        track, at = track[chosen], at[chosen]
        innovation = np.zeros(state.position.shape)
        noise = np.full(state.position.shape, np.inf)
        innovation[:, track], noise[:, track] = away[:, track, at], variance[at]
        unlikely = innovation**2 / (state.variance + noise)
        misfit = np.minimum(misfit + unlikely, misfit.min(axis=0) + MOST_MISFIT)
        state = update(state, innovation, noise)
        heard_s[track] = time_s
        for which, one in zip(active[track], here[at], strict=True):
            members[which].append(int(one))
        new = np.setdiff1d(np.arange(here.size), at)
        lasting = time_s - heard_s <= MOST_MISSED_S
        zero = np.zeros((2, new.size))
        begun = KalmanState(
            seen[:, new], zero, zero + variance[new], zero, zero + START_RATE_DEGPS**2
        )
        state = KalmanState(*(
            np.append(old[:, lasting], add, axis=1)
            for old, add in zip(state, begun, strict=True)
        ))  # fmt: skip
        misfit = np.append(misfit[:, lasting], zero, axis=1)
        active = np.append(active[lasting], np.arange(len(members), len(members) + new.size))
        heard_s = np.append(heard_s[lasting], np.full(new.size, time_s))
        members += [[int(one)] for one in here[new]]
    return [np.array(rows) for rows in members]


def _on_both_sides(
    averages: _Averages, rows: IntArray, heading_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Return bearings of directions on starboard and port, and their variance."""
    cosine = averages.cosine[rows]
    cone_deg = np.degrees(np.arccos(cosine))
    std_deg = angle_std_deg(cosine, np.full(rows.size, 0.5 * averages.step))
    return np.stack([heading_deg + cone_deg, heading_deg - cone_deg]), std_deg**2


def _measured(averages: _Averages, rows: IntArray, side: float) -> _BearingTrack | None:
    """Return the bearings of a contact; None for what is heard too seldom to be one."""
    number = averages.average[rows]
    if rows.size < FEWEST_POINTS or rows.size < HEARD_SHARE * (np.ptp(number) + 1):
        return None
    cosine, height = averages.cosine[rows], averages.height[rows]
    # the weaker it stands out, the more its place is moved by noise
    scatter = white_scatter(cosine)
    std = np.maximum(scatter, 1e-6) * np.median(height) / height
    cone_deg = np.degrees(np.arccos(cosine))
    return _BearingTrack(
        time_s=averages.time_s[number],
        angle_rad=np.radians(side * cone_deg),
        bearing_deg=(averages.heading_deg[number] + side * cone_deg) % 360.0,
        bearing_std_deg=angle_std_deg(cosine, std),
    )


def _series(
    tracks: list[_BearingTrack], lines: Lines | None, frames: Frames, average_s: float, width: float
) -> Series:
    """Join the contacts, numbered as those of lines with the same bearings.

    A contact of its own must be heard where no line is within half a beam's width, in
    cosines: there its direction is that of a sum.
    """
    numbers = [0 if lines is None else _contact_of(track, lines) for track in tracks]
    if lines is not None:
        own = [
            number > 0 or np.count_nonzero(_apart(track, lines, average_s, width)) >= FEWEST_POINTS
            for number, track in zip(numbers, tracks, strict=True)
        ]
        numbers, tracks = list(compress(numbers, own)), list(compress(tracks, own))
    unused = max([0, *numbers, *([] if lines is None else lines.line_contact.tolist())])
    for k, number in enumerate(numbers):
        if not number:
            unused += 1
            numbers[k] = unused
    time_s, bearing, std = (
        np.concatenate([np.zeros(0), *(getattr(track, name) for track in tracks)])
        for name in ("time_s", "bearing_deg", "bearing_std_deg")
    )
    contact = np.repeat(np.array(numbers, np.int64), [t.time_s.size for t in tracks])
    order = np.lexsort((contact, time_s))
    nothing, no_lines = np.full(time_s.size, np.nan), np.zeros((time_s.size, 0))
    return Series(
        contact=contact[order],
        time_s=time_s[order],
        bearing_deg=bearing[order],
        bearing_std_deg=std[order],
        frequency_hz=no_lines,
        frequency_std_hz=no_lines,
        level_db=nothing,
        level_std_db=nothing,
        start_utc_ns=frames.start_utc_ns,
    )


def _apart(track: _BearingTrack, lines: Lines, average_s: float, width: float) -> BoolArray:
    """Return which bearings of a track lie half a beam or more from all lines of contacts."""
    own = np.isin(lines.line, lines.line_id[lines.line_contact > 0])
    own &= np.isfinite(lines.measured_bearing_deg)
    order = np.flatnonzero(own)[np.argsort(lines.time_s[own], kind="stable")]
    heard_s, heard_deg = lines.time_s[order], lines.measured_bearing_deg[order]
    begin, end = (
        np.searchsorted(heard_s, track.time_s + half)
        for half in (-0.5 * average_s, 0.5 * average_s)
    )
    apart = np.ones(track.time_s.size, np.bool_)
    for k, (first, stop) in enumerate(zip(begin, end, strict=True)):
        turn = np.radians(heard_deg[first:stop] - track.bearing_deg[k])
        off = np.cos(track.angle_rad[k] + turn) - np.cos(track.angle_rad[k])
        apart[k] = not (np.abs(off) < width).any()
    return apart


def _contact_of(track: _BearingTrack, lines: Lines) -> int:
    """Return the contact whose lines have the same bearings; 0 if there is none."""
    best, number = SAME_DEG, 0
    for contact in np.unique(lines.line_contact[lines.line_contact > 0]):
        own = np.isin(lines.line, lines.line_id[lines.line_contact == contact])
        own &= np.isfinite(lines.measured_bearing_deg)
        own &= (lines.time_s >= track.time_s[0]) & (lines.time_s <= track.time_s[-1])
        if np.count_nonzero(own) < FEWEST_POINTS:
            continue
        nearest = np.abs(lines.time_s[own][:, None] - track.time_s).argmin(axis=1)
        apart = wrap_deg(lines.measured_bearing_deg[own] - track.bearing_deg[nearest])
        # a pair of hydrophones scatters by more than that
        spread = np.hypot(lines.measured_bearing_std_deg[own], track.bearing_std_deg[nearest])
        off = float(np.median(np.abs(apart) / np.hypot(1.0, spread / SAME_DEG)))
        if off < best:
            best, number = off, int(contact)
    return number
