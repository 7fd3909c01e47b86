"""Directions from the delays between the hydrophones of a small array.

**Method.** The slowness of a plane wave follows from the delays of all pairs by least
squares, with as many free components as the array has dimensions. Its length is a check
that costs nothing: of an array in space it must be that of the sound speed, of a plane
or a line at most that. A line, such as a pair of hydrophones, tells the angle from it: a
bearing on either side. Two sources, echoes, a wrong sound speed or channels in a wrong order show
there or in what the fit leaves, and such a frame has no direction.

**Conventions.** As in `direction_grid`: u = c s points to the source.

**References.** C. A. L. Szuberla & J. V. Olson, J. Acoust. Soc. Am. 115 (2004): least
squares of slowness from delays, and its uncertainty.
"""

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from uwtrack_cli.arrays.broadband_directions import FoundDirections
from uwtrack_cli.arrays.direction_grid import SpatialArray
from uwtrack_cli.arrays.direction_table import TableFacts, direction_table
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.directions import Delays, Directions
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import FULL_SCALE
from uwtrack_cli.errors import DataError, warn

BEYOND = 1.05
"""Largest delay as a share of the one along the pair; an error of place or speed."""

SURE_DEVIATIONS = 4.0
"""Deviations by which a delay, or a slowness, may be off."""

LENGTH_OFF = 0.1
"""Most by which the slowness may differ from that of the sound speed."""

SPEED_SHARE = 0.01
"""Deviation of a sound speed whose own is not known, as a share."""

MISFIT_PER_DEGREE = 16.0
"""Sum of squared residuals per degree of freedom from which a fit is refused."""

LARGEST_STD_DEG = 30.0
"""Deviation from which a direction tells nothing."""

REFUSED_SHARE = 0.5
"""Share of frames without a direction from which the order of channels is doubted."""

MOST_ORDERS = 5
"""Hydrophones up to which all orders of the channels are tried."""


class _Fit(NamedTuple):
    """Least squares of one frame."""

    toward: FloatArray
    """Direction times length, u = c s."""
    covariance: FloatArray
    """Its covariance."""
    is_sound: bool
    """Whether it can be one plane wave."""


@checked
def find_directions(delays: Delays, sensor: Sensor) -> Directions:
    """Estimate directions of arrival from the delays between hydrophones.

    Bearings and elevations go on into cpa, together with levels; those of a line, which
    may be to either side, into tma, and into locate with those of other arrays. A frame
    whose delays cannot be those of one distant source has none.

    Parameters
    ----------
    delays
        Delays of pairs of hydrophones, measured by this program or another.
    sensor
        The array: its positions name the channels.

    Returns
    -------
    Directions
        One row per time at which the delays agree.

    Raises
    ------
    DataError
        The sensor is no such array, a channel is not one of its own, or delays are
        longer than sound takes between the hydrophones.

    Notes
    -----
    tau_ab = (p_a - p_b).u / c with u towards the source. Delays of pairs that share a
    hydrophone share its error: variances are those of independent ones times
    (1 + N rho) / (1 + 2 rho), rho the ratio at one hydrophone, and N/2 of tables.
    """
    array = _array_of(sensor)
    names = list(sensor.channel_names)
    pairs = _pairs(delays, names, sensor.id)
    apart = array.centred_m[pairs[:, 0]] - array.centred_m[pairs[:, 1]]
    _check_reach(delays, apart, sensor)
    times, frame = np.unique(delays.time_s, return_inverse=True)
    rows_of = [np.flatnonzero(frame == k) for k in range(times.size)]
    fits = [_fit(array, delays, apart, rows, sensor) for rows in rows_of]
    sound = np.array([fit is not None and fit.is_sound for fit in fits], np.bool_)
    tried = np.array([fit is not None for fit in fits], np.bool_)
    if np.count_nonzero(sound) < (1.0 - REFUSED_SHARE) * np.count_nonzero(tried):
        _tell_inconsistent(array, delays, pairs, rows_of, sensor, sound, tried)
    if not tried.any():
        _tell_too_few(array, delays, times.size)
    kept = [fit for fit in fits if fit is not None and fit.is_sound]
    toward = np.array([fit.toward for fit in kept]).reshape(-1, 3)
    found = FoundDirections(
        frame=np.flatnonzero(sound),
        source=np.zeros(len(kept), np.int64),
        beam=np.zeros(len(kept), np.int64),
        toward=toward,
        covariance=np.array([fit.covariance for fit in kept]).reshape(-1, 3, 3),
        snr=np.full(len(kept), np.nan),
    )
    heading = sensor.heading_deg + sensor.compass_offset_deg
    facts = TableFacts(
        time_s=times,
        heading_deg=np.full(times.size, heading),
        first_frame=0,
        start_utc_ns=delays.start_utc_ns,
        probability=float("nan"),
        band_hz=(float("nan"), float("nan")),
        method="delays",
        reference=FULL_SCALE,
    )
    level = np.full(len(kept), np.nan)
    return direction_table(found, array, sensor, facts, level)


def _array_of(sensor: Sensor) -> SpatialArray:
    if not len(sensor.element_xyz_m):
        raise DataError(
            f"directions from delays need an array with element_along_m or "
            f"element_positions_m, and sensor {sensor.id!r} has none: give its sensor "
            f"file (--sensor)."
        )
    if sensor.heading_source != "fixed":
        raise DataError(
            f"directions from delays need a fixed array: give heading_deg in the sensor "
            f"file of {sensor.id!r} (0 if y of the positions is north, and of a "
            f"line the direction of its head), or use 'uwtrack "
            f"beamform' for one that moves."
        )
    return SpatialArray(sensor.element_xyz_m, sensor.sound_speed_mps)


def _pairs(delays: Delays, names: list[str], sensor: str) -> IntArray:
    """Return the numbers of the hydrophones of every row, shape (row, 2)."""
    known = {name: number for number, name in enumerate(names)}
    for name in np.unique([delays.channel_a, delays.channel_b]).tolist():
        if name not in known:
            raise DataError(
                f"the delays name channel {name!r}; sensor {sensor!r} has: {', '.join(names)}."
            )
    return np.array(
        [[known[a], known[b]] for a, b in zip(
            delays.channel_a.tolist(), delays.channel_b.tolist(), strict=True
        )], np.int64,
    ).reshape(-1, 2)  # fmt: skip


def _check_reach(delays: Delays, apart: FloatArray, sensor: Sensor) -> None:
    """Refuse delays that no wave can have."""
    longest = np.linalg.norm(apart, axis=1) / sensor.sound_speed_mps
    spare = BEYOND * longest + SURE_DEVIATIONS * delays.delay_std_s
    for row in np.flatnonzero(np.abs(delays.delay_s) > spare)[:1]:
        raise DataError(
            f"channels {delays.channel_a[row]} and {delays.channel_b[row]} are "
            f"{np.linalg.norm(apart[row]):.4g} m apart, which sound crosses in "
            f"{longest[row]:.4g} s, and their delay at {delays.time_s[row]:.3f} s is "
            f"{delays.delay_s[row]:.4g} s: are delays in seconds, positions in metres, "
            f"sound_speed_mps = {sensor.sound_speed_mps:g} right, and the channels in "
            f"their order?"
        )


def _fit(
    array: SpatialArray, delays: Delays, apart: FloatArray, rows: IntArray, sensor: Sensor
) -> _Fit | None:
    """Fit a plane wave to the delays of one time; None if they are too few."""
    design = apart[rows] / array.sound_speed_mps
    axes = array.measured_axes
    reduced = design @ axes.T / delays.delay_std_s[rows, None]
    if np.linalg.matrix_rank(reduced) < len(axes):
        return None
    values = delays.delay_s[rows] / delays.delay_std_s[rows]
    inverse = np.linalg.inv(reduced.T @ reduced)
    part = inverse @ (reduced.T @ values)
    left: FloatArray = values - reduced @ part
    freedom = rows.size - len(axes)
    misfit = float(left @ left) / max(freedom, 1)
    toward, length = axes.T @ part, float(np.linalg.norm(part))
    covariance = axes.T @ (inverse * _sharing(array, delays, rows)) @ axes
    along = toward / max(length, 1e-9)
    length_std = float(np.sqrt(max(float(along @ covariance @ along), 0.0)))
    share = (sensor.sound_speed_std_mps or 0.0) / array.sound_speed_mps or SPEED_SHARE
    spare = min(LENGTH_OFF, SURE_DEVIATIONS * float(np.hypot(length_std, share)))
    off = length - 1.0 if array.is_planar else abs(length - 1.0)
    is_sound = off <= spare and (freedom == 0 or misfit <= MISFIT_PER_DEGREE)
    if not array.is_planar:
        across = np.eye(3) - np.outer(along, along)
        covariance = across @ covariance @ across / max(length, 1e-9) ** 2
        toward = along
    widest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    is_sound = is_sound and widest < np.radians(LARGEST_STD_DEG)
    return _Fit(toward, covariance, bool(is_sound))


def _sharing(array: SpatialArray, delays: Delays, rows: IntArray) -> float:
    """Return the factor of variances for errors that pairs share."""
    n_elements = len(array.places_m)
    if rows.size < n_elements:
        return 1.0
    if delays.coherence is None:
        return 0.5 * n_elements
    seen = float(np.clip(np.mean(delays.coherence[rows]), 1e-3, 1.0 - 1e-6))
    rho = seen / (1.0 - seen)
    return (1.0 + n_elements * rho) / (1.0 + 2.0 * rho)


def _tell_too_few(array: SpatialArray, delays: Delays, n_frames: int) -> None:
    """Say that no frame has delays of pairs enough."""
    needed = len(array.measured_axes)
    if not n_frames:
        warn("there are no delays: no frame has a direction.")
        return
    shape = ("", " that do not lie in one line", " that do not lie in one plane")
    warn(
        f"none of {n_frames} frames has a direction: each needs delays of {needed} "
        f"pair{'s' * (needed > 1)}{shape[needed - 1]}, and "
        f"{delays.time_s.size} delays are there. Is a hydrophone dead or inverted, or the "
        f"sound too weak? 'uwtrack beamform' detects weaker sound."
    )


def _tell_inconsistent(
    array: SpatialArray,
    delays: Delays,
    pairs: IntArray,
    rows_of: Sequence[IntArray],
    sensor: Sensor,
    sound: BoolArray,
    tried: BoolArray,
) -> None:
    """Say that delays contradict the positions, and which order would agree."""
    names = sensor.channel_names
    some = [rows_of[k] for k in np.flatnonzero(tried)[:: max(1, tried.sum() // 50)]]
    hint = ""
    if len(names) <= MOST_ORDERS:
        best, count, given = names, 0, 0
        for order in permutations(range(len(names))):
            places = array.centred_m[list(order)]
            apart = places[pairs[:, 0]] - places[pairs[:, 1]]
            fits = [_fit(array, delays, apart, rows, sensor) for rows in some]
            agree = sum(fit is not None and fit.is_sound for fit in fits)
            given = agree if list(order) == sorted(order) else given
            if agree > count:
                best, count = tuple(names[k] for k in np.argsort(order)), agree
        if count > max(REFUSED_SHARE * len(some), 2.0 * given):
            hint = (
                f" They would agree if the positions belonged to the channels "
                f"{', '.join(best)}, in this order: is the order of the channels right?"
            )
    warn(
        f"the delays of {int(tried.sum() - sound.sum())} of {int(tried.sum())} frames "
        f"contradict the positions of sensor {sensor.id!r} or the sound speed, and have "
        f"no direction (noise, several sources and echoes do that, too).{hint}"
    )
