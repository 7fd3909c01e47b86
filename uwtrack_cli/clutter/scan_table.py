"""A table of scans: checked, in components that are tracked, and cut into scans.

**Conventions.** Every message names the row (from 1), what is wrong and what is accepted.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Scan
from uwtrack_cli.clutter.sensing import DEGREES, SensedKind
from uwtrack_cli.clutter.several_targets import ScanRows
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.errors import DataError, OptionError


def check_scans(scans: Scans, measured_std: list[float] | None, *, adaptive: bool) -> FloatArray:
    """Check the table and return the deviations of all measurements."""
    measured = has_measurement(scans)
    if not measured.any():
        n_scans = np.unique(scans.scan).size
        raise DataError(f"all {n_scans} scans are empty: there is no measurement to follow.")
    torn = ~measured & np.asarray(np.isfinite(scans.measured).any(axis=1))
    _refuse(np.asarray(torn), "has only some of its components; give all of them or none")
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
            raise OptionError(
                f"measured_std must be {given.shape[1]} numbers, one for each "
                f"component, got {measured_std}."
            )
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
        raise DataError(f"row {row + 1} of the scans {what}.")


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
    own: FloatArray | None = None
    """Own ship's east, north and their rates at each, ``(row, 4)``."""


def scan_table(
    scans: Scans, deviation: FloatArray, kind: SensedKind, own: FloatArray | None = None
) -> ScanTable:
    """Return the measurements in components in which targets move straight.

    A range in metres and a bearing in degrees become east and north, from own ship, ``(row,
    4)``, where she is told; anything else is kept, and angles keep their period.

    Notes
    -----
    Without bias, with l = exp(-s^2/2), l' = exp(-2 s^2) and the bearing t and its
    deviation s in radians: east = r sin t / l, north = r cos t / l and the covariance
    R_ee = (l^-2 - 2) r^2 sin^2 t + (r^2 + s_r^2)(1 - l' cos 2t) / 2, likewise the others
    (Longbin, Xiaoquan, Yizhong, Kang and Bar-Shalom 1998, IEEE Trans. AES 34, 1023).
    """
    units = scans.component_unit
    if not kind.startswith("places"):
        covariance = (deviation**2)[..., None] * np.eye(units.size)
        return ScanTable(scans.measured, covariance, own)
    is_angle = np.isin(units, DEGREES)
    angle, reach = int(is_angle.argmax()), int((units == "m").argmax())
    distance, spread = scans.measured[:, reach], deviation[:, reach]
    bearing, std = np.radians(scans.measured[:, angle]), np.radians(deviation[:, angle])
    once, twice = np.exp(-0.5 * std**2), np.exp(-2.0 * std**2)
    sine, cosine = np.sin(bearing), np.cos(bearing)
    less, more = (once**-2 - 2.0) * distance**2, 0.5 * (distance**2 + spread**2)
    covariance = np.zeros((distance.size, units.size, units.size))
    covariance[:, 0, 0] = less * sine**2 + more * (1.0 - twice * np.cos(2 * bearing))
    covariance[:, 1, 1] = less * cosine**2 + more * (1.0 + twice * np.cos(2 * bearing))
    both = less * sine * cosine + more * twice * np.sin(2 * bearing)
    covariance[:, 0, 1] = covariance[:, 1, 0] = both
    place = np.stack([sine, cosine], axis=1) * (distance / once)[:, None]
    if own is not None:
        place += own[:, :2]
    if kind == "places and rates":
        rate = int((~is_angle & (units != "m")).argmax())
        place = np.concatenate([place, scans.measured[:, rate, None]], axis=1)
        covariance[:, 2, 2] = deviation[:, rate] ** 2
    return ScanTable(place, covariance, own)


def _own(table: ScanTable, row: IntArray) -> FloatArray | None:
    """Return own ship at a scan, which its rows share."""
    return None if table.own is None else table.own[row[0]]


def scan_arrays(scans: Scans, table: ScanTable, rows: Iterable[IntArray]) -> Iterator[Scan]:
    """Yield scans as the filter takes them, with an axis for the one target."""
    everywhere = has_measurement(scans)
    told = table.covariance[everywhere]
    # In an empty scan only the size of the region needs a noise.
    usual = told.mean(axis=0)[None]
    is_common = bool((told == told[0]).all())
    for row in rows:
        one = slice(row[0], row[-1] + 1)  # the rows of a scan follow each other
        present, noise = everywhere[one], told[:1]
        if not is_common:
            noise = _scan_noise(table.covariance[one], present, usual)
        yield Scan(
            table.measured[None, one], present[None], scans.amplitude[None, one],
            noise[None], _own(table, row),
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
            table.covariance[own], usual, _own(table, row),
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
