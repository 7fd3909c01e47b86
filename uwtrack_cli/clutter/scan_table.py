"""A table of scans: checked, cut into scans, and the start of a track in it.

**Conventions.** Every message names the row (from 1), what is wrong and what is accepted.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Scan
from uwtrack_cli.clutter.options import TargetStart
from uwtrack_cli.clutter.several_targets import ScanRows
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray, TextArray
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.imm import Belief

DEGREES = ("deg", "degree", "degrees", "°")
"""Units of an angle."""


def check_scans(
    scans: Scans, measured_std: list[float] | None, *, adaptive: bool
) -> FloatArray:
    """Check the table and return the deviations of all measurements."""
    measured = has_measurement(scans)
    if not measured.any():
        n_scans = np.unique(scans.scan).size
        msg = f"all {n_scans} scans are empty: there is no measurement to follow."
        raise DataError(msg)
    torn = ~measured & np.asarray(np.isfinite(scans.measured).any(axis=1))
    _refuse(
        np.asarray(torn), "has only some of its components; give all of them or none"
    )
    step, later = np.diff(scans.scan), np.diff(scans.time_s)
    _refuse(_later(step < 0), "belongs to an earlier scan than the row before")
    _refuse(_later((step == 0) & (later != 0)), "has another time than its scan")
    _refuse(
        _later((step > 0) & ~(later > 0)) | ~np.isfinite(scans.time_s),
        "has a time that is not later than the scan before; order the scans by time",
    )
    given = scans.measured_std
    if measured_std is not None:
        if len(measured_std) != given.shape[1]:
            msg = (
                f"measured_std must be {given.shape[1]} numbers, one for each "
                f"component, got {measured_std}."
            )
            raise OptionError(msg)
        given = np.where(np.isnan(given), measured_std, given)
    bad = measured[:, None] & ~(given > 0.0)
    _refuse(
        np.asarray(bad.any(axis=1)),
        "has a standard deviation that is missing or not above 0; "
        "correct it, or give measured_std (--measured-std)",
    )
    if adaptive:
        _refuse(
            measured & np.isnan(scans.amplitude),
            "has no amplitude, which an adaptive threshold needs; "
            "give the column, or use threshold 'fixed'",
        )
    return given


def has_measurement(scans: Scans) -> BoolArray:
    """Tell which rows hold a measurement; the others stand for empty scans."""
    return np.asarray(np.isfinite(scans.measured).all(axis=1))


def _later(bad: BoolArray) -> BoolArray:
    """Ascribe a fault between two rows to the later one."""
    return np.concatenate([[False], bad])


def _refuse(bad: BoolArray, what: str) -> None:
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        msg = f"row {row + 1} of the scans {what}."
        raise DataError(msg)


def split_scans(scans: Scans) -> list[IntArray]:
    """Return the rows of each scan."""
    edges = np.flatnonzero(np.diff(scans.scan)) + 1
    return list(np.split(np.arange(scans.scan.size), edges))


@dataclass(frozen=True)
class ScanTable:
    """Measurements as the filter takes them, with their covariances."""

    measured: FloatArray
    """Components, ``(row, m)``; nan in an empty scan."""
    covariance: FloatArray
    """Covariance of each measurement, ``(row, m, m)``."""
    component: TextArray
    """Name of each component."""
    component_unit: TextArray
    """Unit of each component."""
    origin: FloatArray | None = None
    """Where each was measured from, east and north in m, ``(row, 2)``."""


def is_polar(units: TextArray) -> bool:
    """Tell whether the components are a range in metres and a bearing in degrees."""
    return units.size == 2 and "m" in units and bool(np.isin(units, DEGREES).any())


def component_period(units: TextArray) -> FloatArray | None:
    """Return the period of each tracked component, infinite for none.

    None where no component is an angle, or where it becomes east and north.
    """
    is_angle = np.isin(units, DEGREES)
    if is_polar(units) or not is_angle.any():
        return None
    return np.where(is_angle, 360.0, np.inf)


def scan_table(
    scans: Scans, deviation: FloatArray, origin: FloatArray | None = None
) -> ScanTable:
    """Return the measurements in components in which targets move straight.

    A range in metres and a bearing in degrees become east and north, from ``origin``,
    ``(row, 2)``, where that is told; anything else is kept, and angles keep their period.

    Notes
    -----
    Without bias, with l = exp(-s^2/2), l' = exp(-2 s^2) and the bearing t and its
    deviation s in radians: east = r sin t / l, north = r cos t / l and the covariance
    R_ee = (l^-2 - 2) r^2 sin^2 t + (r^2 + s_r^2)(1 - l' cos 2t) / 2, likewise the others
    (Longbin, Xiaoquan, Yizhong, Kang and Bar-Shalom 1998, IEEE Trans. AES 34, 1023).
    """
    units = scans.component_unit
    if not is_polar(units):
        covariance = (deviation**2)[..., None] * np.eye(units.size)
        return ScanTable(scans.measured, covariance, scans.component, units)
    angle = int(np.isin(units, DEGREES).argmax())
    distance, spread = scans.measured[:, 1 - angle], deviation[:, 1 - angle]
    bearing, std = np.radians(scans.measured[:, angle]), np.radians(deviation[:, angle])
    once, twice = np.exp(-0.5 * std**2), np.exp(-2.0 * std**2)
    sine, cosine = np.sin(bearing), np.cos(bearing)
    less, more = (once**-2 - 2.0) * distance**2, 0.5 * (distance**2 + spread**2)
    covariance = np.empty((distance.size, 2, 2))
    covariance[:, 0, 0] = less * sine**2 + more * (1.0 - twice * np.cos(2 * bearing))
    covariance[:, 1, 1] = less * cosine**2 + more * (1.0 + twice * np.cos(2 * bearing))
    both = less * sine * cosine + more * twice * np.sin(2 * bearing)
    covariance[:, 0, 1] = covariance[:, 1, 0] = both
    place = np.stack([sine, cosine], axis=1) * (distance / once)[:, None]
    if origin is not None:
        place += origin
    names, metres = np.array(["east", "north"]), np.array(["m", "m"])
    return ScanTable(place, covariance, names, metres, origin)


def _origin(table: ScanTable, row: IntArray) -> FloatArray | None:
    """Return where a scan was measured from, which its rows share."""
    return None if table.origin is None else table.origin[row[0]]


def scan_arrays(
    scans: Scans, table: ScanTable, rows: Iterable[IntArray]
) -> Iterator[Scan]:
    """Yield scans as the filter takes them, with an axis for the one target."""
    everywhere = has_measurement(scans)
    told = table.covariance[everywhere]
    # In an empty scan only the size of the region needs a noise.
    usual = told.mean(axis=0)[None]
    is_common = bool((told == told[0]).all())
    for row in rows:
        present, noise = everywhere[row], told[:1]
        if not is_common:
            noise = _scan_noise(table.covariance[row], present, usual)
        yield Scan(
            table.measured[row][None], present[None], scans.amplitude[row][None],
            noise[None], _origin(table, row),
        )  # fmt: skip


def scan_rows(
    scans: Scans, table: ScanTable, rows: Iterable[IntArray], least: float
) -> Iterator[ScanRows]:
    """Yield scans as several targets take them, from an amplitude on."""
    usable = usable_rows(scans, least)
    told = table.covariance[usable]
    usual = told[0] if (told == told[:1]).all() else told.mean(axis=0)
    for row in rows:
        own = row[usable[row]]
        yield ScanRows(
            float(scans.time_s[row[0]]), own, table.measured[own],
            table.covariance[own], usual, _origin(table, row),
        )  # fmt: skip


def least_amplitude(setting: ClutterSetting) -> float:
    """Return the amplitude from which a measurement counts."""
    if setting.rule != "fixed":
        return -np.inf
    return float(setting.curve.threshold(np.array(setting.false_alarm)))


def usable_rows(scans: Scans, least: float) -> BoolArray:
    """Tell which rows hold a measurement that is not below an amplitude."""
    return has_measurement(scans) & ~(scans.amplitude < least)


def _scan_noise(noise: FloatArray, present: BoolArray, usual: FloatArray) -> FloatArray:
    """Return the covariances of a scan's measurements, one where they are equal."""
    known: FloatArray = noise[present]
    if known.size == 0:
        return usual
    if (known == known[0]).all():
        return known[:1]
    return np.where(present[:, None, None], noise, usual)


class FirstState(NamedTuple):
    """The states that tracks start from."""

    belief: Belief
    """State and covariance under every model, ``(model, target, ...)``."""
    first_scan: int
    """Scan to begin with."""
    time_s: float
    """Time of the states, s."""


def start_belief(
    scans: Scans,
    table: ScanTable,
    rows: list[IntArray],
    start: TargetStart,
    begin: Callable[[FloatArray, FloatArray], Belief],
) -> FirstState:
    """Return the states that the tracks of told positions start from.

    Without a position it is the strongest measurement of the first scan that has one.
    """
    dimension = scans.measured.shape[1]
    if start.position is None:
        first, row = _strongest(scans, rows)
        place, time_s = table.measured[row][None], float(scans.time_s[row])
        spread = table.covariance[row][None]
    else:
        place = _by_target(start.position, "position", dimension)
        deviation = _needed(start.position_std, "position_std")
        spread = np.tile(deviation**2 * np.eye(dimension), (len(place), 1, 1))
        first, time_s = 0, float(scans.time_s[0])
        if start.time_s is not None:
            time_s = start.time_s
            first = int(sum(scans.time_s[index[0]] < time_s for index in rows))
    if first >= len(rows):
        msg = f"there is no scan after the start of the track at {time_s:g} s."
        raise DataError(msg)
    return FirstState(begin(place, spread), first, time_s)


def begin_tracks(
    place: FloatArray, spread: FloatArray, start: TargetStart, n_models: int
) -> Belief:
    """Return tracks at places, ``(target, m)``, of covariances, ``(target, m, m)``."""
    count, dimension = place.shape
    mean = np.zeros((count, 2 * dimension))
    covariance = np.zeros((count, 2 * dimension, 2 * dimension))
    rate = np.arange(1, 2 * dimension, 2)
    mean[:, ::2], covariance[:, ::2, ::2] = place, spread
    covariance[:, rate, rate] = _needed(start.velocity_std, "velocity_std") ** 2
    if start.velocity is not None:
        velocity = _by_target(start.velocity, "velocity", dimension)
        # one velocity is that of all, those of told targets are theirs alone
        if len(velocity) in {1, count}:
            mean[:, 1::2] = velocity
    prior = np.array([[1.0]] if n_models == 1 else [[0.9], [0.1]])
    return Belief(
        np.tile(mean, (n_models, 1, 1)), np.tile(covariance, (n_models, 1, 1, 1)),
        np.tile(prior, (1, count)),
    )  # fmt: skip


def _strongest(scans: Scans, rows: list[IntArray]) -> tuple[int, int]:
    """Return the scan after the first that is not empty, and its strongest row."""
    measured = has_measurement(scans)
    scan = next(i for i, index in enumerate(rows) if measured[index].any())
    index = rows[scan][measured[rows[scan]]]
    amplitude = scans.amplitude[index]
    if index.size > 1 and np.isnan(amplitude).any():
        msg = (
            f"scan {int(scans.scan[index[0]])} has {index.size} measurements without "
            "amplitude, and any may be the target: give start.position "
            "(--start-position)."
        )
        raise DataError(msg)
    best = 0 if index.size == 1 else int(amplitude.argmax())
    return scan + 1, int(index[best])


def n_told(start: TargetStart, dimension: int) -> int:
    """Return the number of targets whose position was told."""
    count = 0
    if start.position is not None:
        count = len(_by_target(start.position, "position", dimension))
    if start.velocity is not None:
        rates = len(_by_target(start.velocity, "velocity", dimension))
        if rates not in {1, count}:
            msg = (
                f"start.velocity must be {dimension} numbers for all targets or for "
                f"each of the {count} told, got {start.velocity}."
            )
            raise OptionError(msg)
    return count


def _by_target(values: list[float], name: str, dimension: int) -> FloatArray:
    """Return the components that were told for each target, ``(target, m)``."""
    if not values or len(values) % dimension:
        msg = f"start.{name} must be {dimension} numbers for each target, got {values}."
        raise OptionError(msg)
    return np.array(values, dtype=np.float64).reshape(-1, dimension)


def _needed(value: float | None, name: str) -> float:
    if value is None:
        msg = f"start.{name} (--start-{name.replace('_', '-')}) must be given."
        raise OptionError(msg)
    return value
