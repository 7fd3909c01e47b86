"""Check a table of scans, cut it into scans and find where a track begins.

**Conventions.** Every message names the row (from 1), what is wrong and what is accepted.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.clutter.clutter_filter import Scan
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.stages.clutter.policies import TargetStart


def check_scans(
    scans: Scans, measured_std: list[float] | None, *, adaptive: bool
) -> FloatArray:
    """Check the table and return the deviations of all measurements."""
    seen = has_measurement(scans)
    if not seen.any():
        n_scans = np.unique(scans.scan).size
        msg = f"all {n_scans} scans are empty: there is no measurement to follow."
        raise DataError(msg)
    torn = ~seen & np.asarray(np.isfinite(scans.measured).any(axis=1))
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
        if len(measured_std) != given.shape[1] or not np.all(
            np.array(measured_std) > 0
        ):
            msg = (
                f"measured_std must be {given.shape[1]} numbers above 0, one for each "
                f"component, got {measured_std}."
            )
            raise OptionError(msg)
        given = np.where(np.isnan(given), measured_std, given)
    bad = seen[:, None] & ~(given > 0.0)
    _refuse(
        np.asarray(bad.any(axis=1)),
        "has a standard deviation that is missing or not above 0; "
        "correct it, or give measured_std (--measured-std)",
    )
    if adaptive:
        _refuse(
            seen & np.isnan(scans.amplitude),
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


def scan_arrays(scans: Scans, deviation: FloatArray, rows: IntArray) -> Scan:
    """Return one scan as the filter takes it, with an axis for the one target."""
    dimension = scans.measured.shape[1]
    present = has_measurement(scans)[rows]
    variance = deviation[rows] ** 2
    known: FloatArray = variance[present]
    if known.size == 0:  # an empty scan: only the size of the region needs a noise
        everywhere = has_measurement(scans)
        variance = (deviation[everywhere] ** 2).mean(axis=0)[None]
    elif (known == known[0]).all():
        variance = known[:1]
    noise = variance[..., None] * np.eye(dimension)
    return Scan(
        scans.measured[rows][None], present[None], scans.amplitude[rows][None],
        noise[None],
    )  # fmt: skip


def start_belief(
    scans: Scans,
    deviation: FloatArray,
    rows: list[IntArray],
    start: TargetStart,
    n_models: int,
) -> tuple[Belief, int, float]:
    """Return the first state, the scan to begin with and the state's time."""
    dimension = scans.measured.shape[1]
    mean, spread = np.zeros(2 * dimension), np.empty(2 * dimension)
    spread[1::2] = _needed(start.velocity_std, "velocity_std")
    if start.velocity is not None:
        mean[1::2] = _components(start.velocity, "velocity", dimension)
    if start.position is not None:
        mean[::2] = _components(start.position, "position", dimension)
        spread[::2] = _needed(start.position_std, "position_std")
        first, time_s = 0, float(scans.time_s[0])
        if start.time_s is not None:
            time_s = start.time_s
            first = sum(scans.time_s[index[0]] < time_s for index in rows)
    else:
        first, row = _strongest(scans, rows)
        mean[::2], spread[::2] = scans.measured[row], deviation[row]
        time_s = float(scans.time_s[row])
    if first >= len(rows):
        msg = f"there is no scan after the start of the track at {time_s:g} s."
        raise DataError(msg)
    belief = Belief(
        np.tile(mean, (n_models, 1, 1)),
        np.tile(np.diag(spread**2), (n_models, 1, 1, 1)),
        np.array([[1.0]] if n_models == 1 else [[0.9], [0.1]]),
    )
    return belief, int(first), time_s


def _strongest(scans: Scans, rows: list[IntArray]) -> tuple[int, int]:
    """Return the scan after the first that is not empty, and its strongest row."""
    seen = has_measurement(scans)
    scan = next(i for i, index in enumerate(rows) if seen[index].any())
    index = rows[scan][seen[rows[scan]]]
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


def _components(values: list[float], name: str, dimension: int) -> FloatArray:
    if len(values) != dimension:
        msg = f"start.{name} must be {dimension} numbers, got {values}."
        raise OptionError(msg)
    return np.array(values, dtype=np.float64)


def _needed(value: float | None, name: str) -> float:
    if value is None or not value > 0.0:
        msg = (
            f"start.{name} (--start-{name.replace('_', '-')}) must be given and above 0, "
            f"got {value}."
        )
        raise OptionError(msg)
    return value
