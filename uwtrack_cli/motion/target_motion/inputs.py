"""From containers to the measurements of each contact, checked on the way.

**Method.** Deviations that nobody stated come from the scatter of second differences;
those of measurements that overlap are raised by the correlation of the residuals.
"""

from collections.abc import Callable
from dataclasses import dataclass
from warnings import warn

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, UwtrackNote
from uwtrack_cli.estimation.robust import FEWEST_VALUES, white_scatter
from uwtrack_cli.motion.target_motion.own_ship import OwnPath

LONGEST_EXTRAPOLATION_S = 60.0
"""Beyond the last row of navigation own ship may have turned."""


@dataclass(frozen=True, eq=False)
class Platforms:
    """The sensors of a table: each is a stream of bearings of its own."""

    name: tuple[str, ...]
    """Identifiers."""
    sensor: IntArray
    """Sensor of every row, shape (rows,)."""
    east_m: FloatArray
    """Where it was at every row, east of the origin, m, shape (rows,)."""
    north_m: FloatArray
    """The same, north of the origin, m, shape (rows,)."""
    compass_std_deg: FloatArray
    """Deviation of each compass, degrees, shape (sensors,); nan if not told."""
    position_std_m: FloatArray
    """Deviation of each coordinate of each place, m, shape (sensors,); nan if not
    told."""
    origin: Origin | None
    """Latitude and longitude of the grid's origin; None on a local grid."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """All that was measured of one contact; nan is "not measured"."""

    contact: int
    """Contact number."""
    time_s: FloatArray
    """Times of the rows, s, shape (rows,)."""
    bearing_deg: FloatArray
    """Bearings, degrees, shape (streams, rows)."""
    bearing_std_deg: FloatArray
    """Their deviations, degrees; nan if not stated."""
    frequency_hz: FloatArray
    """Frequencies, Hz, shape (lines, rows)."""
    frequency_std_hz: FloatArray
    """Their deviations, Hz; nan if not stated."""
    line_id: IntArray
    """Identifiers of the lines, shape (lines,)."""
    start_utc_ns: int | None
    """UTC epoch of time zero, ns; None if unknown."""
    window_s: float | None
    """Length of the frames, s; None for tables."""
    overlap_rows: int
    """Distance in rows within which measurements share samples."""
    mirrored_bearing_deg: FloatArray | None = None
    """Bearings that the array cannot tell from the first, degrees, shape (streams,
    rows); nan where the side is resolved; None: no array."""
    platforms: Platforms | None = None
    """The sensors of the table; None for one platform."""
    bounce_delay_s: FloatArray | None = None
    """Delays of the reflected path behind the direct one, s, shape (rows,); None: there
    are none."""
    bounce_delay_std_s: FloatArray | None = None
    """Their deviations, s, same shape; nan if not stated."""
    table_row: IntArray | None = None
    """Row of the table that each row was, from 0, shape (rows,); None for lines."""
    begin_of_table_row: Callable[[int], str] | None = None
    """How a sentence about a row of the table begins; None for lines."""

    def begin_of(self, meant: BoolArray) -> str:
        """Return how a sentence about some rows begins: file and line of the first.

        ``meant`` has the shape (rows,) or (streams or lines, rows).
        """
        if self.table_row is None or self.begin_of_table_row is None:
            return ""
        rows = np.flatnonzero(np.atleast_2d(meant).any(axis=0))
        return self.begin_of_table_row(int(self.table_row[rows[0]]))


def measurements_from_series(series: Series) -> list[Measurements]:
    """Take a table apart into contacts, dropping rows and lines without values."""
    found = []
    for contact in np.unique(series.contact):
        rows = np.flatnonzero(series.contact == contact)
        order = np.argsort(series.time_s[rows], kind="stable")
        # rows of several sensors share one clock, and follow each other as they like
        if series.sensor is None and np.any(np.diff(order) < 0):
            msg = f"the rows of contact {contact} were not in order of time: sorted."
            warn(msg, UwtrackNote, stacklevel=4)
        rows = rows[order]
        heard = ~np.isnan(series.bearing_deg[rows])
        tone = ~np.isnan(series.frequency_hz[rows])
        lines = np.flatnonzero(tone.any(0))
        late, late_std = (
            np.full(rows.size, np.nan) if values is None else values[rows]
            for values in (series.bounce_delay_s, series.bounce_delay_std_s)
        )
        kept = heard | tone.any(1) | ~np.isnan(late)
        rows, late, late_std = rows[kept], late[kept], late_std[kept]
        has_delays = bool(np.isfinite(late).any())
        platforms = _platforms(series, rows)
        mirrored = series.mirrored_bearing_deg
        found.append(
            Measurements(
                contact=int(contact),
                time_s=series.time_s[rows],
                bearing_deg=_streams(series.bearing_deg, rows, platforms),
                bearing_std_deg=_streams(series.bearing_std_deg, rows, platforms),
                mirrored_bearing_deg=(
                    None if mirrored is None else _streams(mirrored, rows, platforms)
                ),
                platforms=platforms,
                table_row=rows,
                begin_of_table_row=series.begin_of,
                frequency_hz=series.frequency_hz[np.ix_(rows, lines)].T,
                frequency_std_hz=series.frequency_std_hz[np.ix_(rows, lines)].T,
                line_id=lines + 1,
                start_utc_ns=series.start_utc_ns,
                window_s=None,
                overlap_rows=0,
                bounce_delay_s=late if has_delays else None,
                bounce_delay_std_s=late_std if has_delays else None,
            )
        )
    return found


def check_sensors(series: Series) -> None:
    """Refuse a table that names sensors whose places nobody gave.

    Raises
    ------
    DataError
        No sensor has a place.
    """
    if series.sensor is None or series.sensor_east_m is not None:
        return
    names = ", ".join(np.unique(series.sensor).tolist()[:10])
    raise DataError(
        f"{series.begin_of(0)}the table names its sensors ({names}), but not where they "
        f"are: give "
        f"--sensors SENSORS.toml, or columns sensor_latitude and sensor_longitude."
    )


def _platforms(series: Series, rows: IntArray) -> Platforms | None:
    """Return the sensors of some rows of a table; None where it names none."""
    columns = (series.sensor, series.sensor_east_m, series.sensor_north_m)
    if columns[0] is None or columns[1] is None or columns[2] is None:
        return None
    names, sensor = np.unique(columns[0][rows], return_inverse=True)
    told = {} if series.sensor_id is None else {
        str(name): number for number, name in enumerate(series.sensor_id)
    }  # fmt: skip

    def of_each(values: FloatArray | None) -> FloatArray:
        known = np.full(len(told), np.nan) if values is None else values
        return np.array([known[told[str(name)]] if str(name) in told else np.nan for name in names])

    return Platforms(
        name=tuple(map(str, names)),
        sensor=sensor,
        east_m=columns[1][rows],
        north_m=columns[2][rows],
        compass_std_deg=of_each(series.sensor_compass_std_deg),
        position_std_m=of_each(series.sensor_position_std_m),
        origin=(
            None
            if series.origin_latitude is None or series.origin_longitude is None
            else Origin(series.origin_latitude, series.origin_longitude)
        ),
    )


def _streams(values: FloatArray, rows: IntArray, platforms: Platforms | None) -> FloatArray:
    """Spread a column over the streams of the sensors, (streams, rows)."""
    if platforms is None:
        return values[np.newaxis, rows]
    table = np.full((len(platforms.name), rows.size), np.nan)
    table[platforms.sensor, np.arange(rows.size)] = values[rows]
    return table


def measurements_from_lines(lines: Lines) -> list[Measurements]:
    """Take lines apart into contacts, without unassigned and stationary ones.

    Raises
    ------
    DataError
        The points of a contact are of frames of several lengths.
    """
    frames = lines.frames
    lasting = (lines.line_contact > 0) & (lines.line_status != "hum")
    found = []
    for contact in np.unique(lines.line_contact[lasting]):
        ids = lines.line_id[lasting & (lines.line_contact == contact)]
        measured = ~np.isnan(lines.measured_frequency_hz)
        measured |= ~np.isnan(lines.measured_bearing_deg)
        points = np.flatnonzero(np.isin(lines.line, ids) & measured)
        if points.size == 0:
            continue
        windows_s = np.unique(lines.point_window_s[points])
        if windows_s.size > 1:
            lengths = ", ".join(f"{window_s:g}" for window_s in windows_s)
            raise DataError(
                f"contact {contact} has points of frames of {lengths} s, and target "
                "motion is estimated from one length: name the step of one rung with "
                "--step ('uwtrack info' lists the steps)."
            )
        time, row = np.unique(lines.time_s[points], return_inverse=True)
        line = np.searchsorted(np.sort(ids), lines.line[points])

        def spread(
            values: FloatArray,
            place: tuple[IntArray, IntArray] = (line, row),
            shape: tuple[int, int] = (ids.size, time.size),
            points: IntArray = points,
        ) -> FloatArray:
            table = np.full(shape, np.nan)
            table[place] = values[points]
            return table

        found.append(
            Measurements(
                contact=int(contact),
                time_s=time,
                bearing_deg=spread(lines.measured_bearing_deg),
                bearing_std_deg=spread(lines.measured_bearing_std_deg),
                frequency_hz=spread(lines.measured_frequency_hz),
                frequency_std_hz=spread(lines.measured_frequency_std_hz),
                line_id=np.sort(ids),
                start_utc_ns=frames.start_utc_ns,
                window_s=float(windows_s[0]),
                overlap_rows=-(-frames.window_samples // frames.hop_samples) - 1,
            )
        )
    return found


def check_measurements(data: Measurements) -> None:
    """Refuse what cannot be a record of bearings and frequencies.

    Raises
    ------
    DataError
        Times do not increase, units are off by a known factor, or a line changes
        by more than Doppler can.
    """
    who = f"contact {data.contact}"
    if data.time_s.size == 0:
        raise DataError(f"{who} has neither bearings nor frequencies.")
    steps = np.diff(data.time_s)
    is_behind = ~(steps >= 0) if data.platforms is not None else ~(steps > 0)
    if np.any(is_behind):
        row = int(np.flatnonzero(is_behind)[0])
        at = data.begin_of(np.arange(data.time_s.size) == row + 1)
        raise DataError(
            f"{at}{who} has more than one row at {data.time_s[row]:g} s: give each "
            f"contact its own number in a column 'contact'."
        )
    _check_bearings(data, who)
    _check_frequencies(data, who)


def _check_bearings(data: Measurements, who: str) -> None:
    bearing, std = data.bearing_deg, data.bearing_std_deg
    if np.isnan(bearing).all():
        return
    is_far = (bearing < -360.0) | (bearing > 720.0)
    if np.any(is_far):
        worst = bearing.T[is_far.T][0]
        raise DataError(
            f"{data.begin_of(is_far)}a bearing of {who} is {worst:g} degrees; 0 to 360 is accepted."
        )
    _check_positive(data, std, f"bearing_std_deg of {who}")
    for stream in range(len(bearing)):
        of = "" if data.platforms is None else f" by {data.platforms.name[stream]}"
        heard = ~np.isnan(bearing[stream])
        at = data.begin_of(heard) if heard.any() else ""
        _check_degrees(bearing[stream], std[stream], f"{at}the bearings of {who}{of}")


def _check_degrees(bearing: FloatArray, std: FloatArray, which: str) -> None:
    """Refuse bearings of one sensor that are radians; others may be degrees."""
    heard, stated = bearing[~np.isnan(bearing)], std[~np.isnan(std)]
    if heard.size == 0 or np.any(np.abs(heard) > 2.0 * np.pi + 1e-6):
        return
    scatter = np.degrees(white_scatter(np.radians(bearing), circular=True))
    small_std = stated.size > 0 and np.median(stated) < 0.1
    # as degrees, the scatter of radians falls short of its deviation 57-fold
    too_smooth = stated.size > 0 and 0.0 < scatter < np.median(stated) / 25.0
    if small_std or too_smooth:
        raise DataError(
            f"{which} lie between {heard.min():.3g} and {heard.max():.3g} with a "
            f"scatter of {scatter:.2g} and a deviation of {np.median(stated):.2g}: they "
            f"seem to be radians; degrees are accepted."
        )


def _check_frequencies(data: Measurements, who: str) -> None:
    _check_positive(data, data.frequency_std_hz, f"frequency_std_hz of {who}")
    for line, values in zip(data.line_id, data.frequency_hz, strict=True):
        heard = values[~np.isnan(values)]
        if np.any(values <= 0):
            at = data.begin_of(values <= 0)
            low = values[values <= 0][0]
            raise DataError(f"{at}line {line} of {who} has a frequency of {low:g} Hz.")
        if heard.size < FEWEST_VALUES:
            continue
        low, middle, high = np.percentile(heard, [25.0, 50.0, 75.0])
        if (high - low) / middle > 0.1:
            at = data.begin_of(~np.isnan(values))
            raise DataError(
                f"{at}half of the values of line {line} of {who} spread over {high - low:.3g} "
                f"Hz about {middle:.4g} Hz, more than the Doppler shift of any vessel: does the column hold several lines?"
            )


def _check_positive(data: Measurements, std: FloatArray, name: str) -> None:
    wrong = ~np.isnan(std) & ~(std > 0)
    if np.any(wrong):
        at = data.begin_of(wrong)
        raise DataError(f"{at}{name} must be positive, got {std.T[wrong.T][0]:g}.")


def own_path(navigation: Navigation | None, data: Measurements) -> OwnPath:
    """Return own ship's path in the clock of the measurements, or a fixed place.

    Raises
    ------
    DataError
        The navigation is not in order, does not cover the measurements, or moves
        faster than a ship.
    """
    if navigation is None:
        zero = np.zeros(1)
        return OwnPath(zero, zero, zero, np.full(1, np.nan))
    shift = 0.0
    if navigation.start_utc_ns is not None and data.start_utc_ns is not None:
        shift = (navigation.start_utc_ns - data.start_utc_ns) / NANOSECONDS
    time = navigation.time_s + shift
    _check_navigation(time, navigation, data)
    return OwnPath(time, navigation.east_m, navigation.north_m, np.radians(navigation.heading_deg))


def sensor_paths(data: Measurements, platforms: Platforms) -> list[OwnPath]:
    """Return the path of every sensor of a table, through the places of its rows."""
    paths = []
    for number in range(len(platforms.name)):
        rows = np.flatnonzero(platforms.sensor == number)
        time, first = np.unique(data.time_s[rows], return_index=True)
        rows = rows[first]
        unknown = np.full(time.size, np.nan)
        paths.append(OwnPath(time, platforms.east_m[rows], platforms.north_m[rows], unknown))
    return paths


def _check_navigation(time: FloatArray, navigation: Navigation, data: Measurements) -> None:
    steps = np.diff(time)
    if time.size == 0 or np.any(~(steps > 0)):
        raise DataError("the times of the navigation must increase from row to row.")
    first, last = float(data.time_s[0]), float(data.time_s[-1])
    slack = _extrapolation(steps, data.time_s)
    if first < time[0] - slack or last > time[-1] + slack:
        raise DataError(
            f"the navigation covers {time[0]:.6g} to {time[-1]:.6g} s, but contact "
            f"{data.contact} was measured from {first:.6g} to {last:.6g} s: do both "
            f"count from the same start (give both time_utc, or one clock)? The last "
            f"leg needs a row at its end."
        )
    if time.size < 2:
        return
    speed = np.hypot(np.diff(navigation.east_m), np.diff(navigation.north_m)) / steps
    if np.median(speed) > 40.0:
        raise DataError(
            f"own ship moves at {np.median(speed):.3g} m/s by its navigation; ships "
            f"stay below 40 m/s. Are the positions in metres and the speeds in the "
            f"unit of their column (speed_mps or speed_kn)?"
        )


def _extrapolation(steps: FloatArray, measured_s: FloatArray) -> float:
    """Return how far own ship may be taken straight on beyond its last row, s."""
    if steps.size == 0:
        return np.inf
    spacing = float(np.median(np.diff(measured_s))) if measured_s.size > 1 else 0.0
    return max(2.0 * spacing, min(float(steps.max()), LONGEST_EXTRAPOLATION_S))


FITTED = 4
"""Parameters of a motion, that the residuals were fitted with."""


MOST_DECIMALS = 6


def rounding_std(values: FloatArray) -> float:
    """Return the deviation that rounding gives to values; 0 if they are not rounded.

    Notes
    -----
    The step over the root of 12, the step being the largest power of ten that all
    values are multiples of, one at most.

    Examples
    --------
    >>> round(rounding_std(np.array([12.0, 15.0, 18.0])), 3)
    0.289
    """
    known = values[~np.isnan(values)]
    for decimals in range(MOST_DECIMALS):
        if known.size and np.all(np.abs(known - np.round(known, decimals)) < 1e-9):
            return float(10.0**-decimals / np.sqrt(12.0))
    return 0.0


def correlation_inflation(z: FloatArray, heard: FloatArray, fewest_lags: int) -> float:
    """Return the variance factor that correlated measurements need, at least 1.

    Measurements of overlapping windows share samples for ``fewest_lags`` rows, and all
    lines of a vessel vary with the speed of its shaft: neither is independent. Whitened
    residuals and weights have the shape (stream, row); zero where nothing was measured.

    Notes
    -----
    Power of the residuals at zero frequency, s^2 (1 + 2 sum (1 - l/L) rho_l), with
    Bartlett's window over an eighth of the record (Newey & West 1987), for the sum
    over streams: correlation between streams counts as well. The window holds
    m = 1.5 n / L independent values of that power, and the fit of a motion has taken
    four of them away: the sum is raised by m / (m - 4).
    """
    valid = heard > 0
    count = np.count_nonzero(valid, axis=0)
    known = count > 0
    if np.count_nonzero(known) < FEWEST_VALUES:
        return 1.0
    # outliers are for the loss to weigh, not for the deviations
    pooled = np.where(valid, np.clip(z, -5.0, 5.0), 0.0).sum(0)
    pooled = pooled / np.sqrt(np.maximum(count, 1))
    power = float((pooled**2).sum() / np.count_nonzero(known))
    total = power
    width = max(fewest_lags + 1, known.size // 8)
    for lag in range(1, width):
        pairs = np.count_nonzero(known[lag:] & known[:-lag])
        if pairs < FEWEST_VALUES:
            break
        shared = float((pooled[lag:] * pooled[:-lag]).sum() / pairs)
        total += 2.0 * (1.0 - lag / width) * shared
    bands = 1.5 * known.size / width
    return float(max(total * bands / max(bands - FITTED, 1.0), power, 1.0))
