"""Where tracks begin: at told positions, or at measurements.

**Method.** A measured place begins a track there, at rest but for a measured range rate. A
bearing alone begins one filter for each of some ranges, equally apart in ratio, which
later bearings weigh: each is narrow enough for them to be linear in its range.

**References.** Peach (1995), IEE Proc. Radar, Sonar and Navigation 142, 73, for filters
at several ranges.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.clutter.options import MotionModels, TargetStart
from uwtrack_cli.clutter.scan_table import ScanTable, has_measurement
from uwtrack_cli.clutter.sensing import Sensing, expect
from uwtrack_cli.clutter.several_targets import ScanRows
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.imm import Belief

RANGE_SHARE = 0.15
"""Deviation of the range of a filter over the range, as with contacts."""


class FirstState(NamedTuple):
    """The states that tracks start from."""

    belief: Belief
    """State and covariance under every model, ``(model, target, ...)``."""
    first_scan: int
    """Scan to begin with."""
    time_s: float
    """Time of the states, s."""


class TrackStarts(NamedTuple):
    """How tracks begin."""

    start: TargetStart
    """The options."""
    sensing: Sensing
    """What is measured and tracked."""
    models: MotionModels
    """Motion models, each with its filters."""
    range_m: FloatArray
    """Ranges of the filters of a model, ``(filter,)``; one that does not matter where
    more than bearings are measured, or all positions are told."""

    def at(self, place: FloatArray, spread: FloatArray) -> Belief:
        """Return tracks at places, ``(target, m)``, with covariances."""
        count, dimension = place.shape
        mean = np.zeros((count, 2 * dimension))
        covariance = np.zeros((count, 2 * dimension, 2 * dimension))
        rate = np.arange(1, 2 * dimension, 2)
        mean[:, ::2], covariance[:, ::2, ::2] = place, spread
        covariance[:, rate, rate] = _needed(self.start.velocity_std, "velocity_std") ** 2
        if self.start.velocity is not None:
            velocity = _by_target(self.start.velocity, "velocity", dimension)
            # one velocity is that of all, those of told targets are theirs alone
            if len(velocity) in {1, count}:
                mean[:, 1::2] = velocity
        n_models = self.models.prior.size
        return Belief(
            np.tile(mean, (n_models, 1, 1)), np.tile(covariance, (n_models, 1, 1, 1)),
            np.tile(self.models.prior[:, None], (1, count)),
        )  # fmt: skip

    def at_measurements(self, scan: ScanRows, chosen: BoolArray) -> Belief:
        """Return tracks that begin at some of a scan's measurements."""
        measured, noise = scan.measured[chosen], scan.noise[chosen]
        if self.sensing.kind == "bearings":
            return self._on_lines(measured[:, 0], noise[:, 0, 0], scan.own)
        found = self.at(measured[:, :2], noise[:, :2, :2])
        if self.sensing.kind != "places and rates":
            return self.at(measured, noise)
        # the range rate corrects the velocity, as the place is known
        expected = expect(found.mean, self.sensing.kind, scan.own)
        if expected is None:
            return found
        slope = expected.slope[..., 2, :]
        cross = (found.covariance @ slope[..., None])[..., 0]
        gain = cross / ((slope * cross).sum(axis=-1) + noise[:, 2, 2])[..., None]
        off = measured[:, 2] - expected.measured[..., 2]
        return Belief(
            found.mean + gain * off[..., None],
            found.covariance - gain[..., :, None] * cross[..., None, :],
            found.probability,
        )

    def _on_lines(
        self, bearing_deg: FloatArray, variance: FloatArray, own: FloatArray | None
    ) -> Belief:
        """Return tracks on lines of bearing, with a filter at each range."""
        bearing = np.radians(bearing_deg)
        along = np.stack([np.sin(bearing), np.cos(bearing)], axis=1)
        across = np.stack([along[:, 1], -along[:, 0]], axis=1)
        origin = np.zeros(2) if own is None else own[:2]
        parts = []
        for distance in self.range_m:
            sigma = np.stack([np.full(bearing.size, RANGE_SHARE), np.radians(np.sqrt(variance))])
            spread = sum(
                (distance * one) ** 2 * line.T[:, None] * line.T[None]
                for one, line in zip(sigma, (along, across), strict=True)
            )
            place = origin + distance * along
            parts.append(self.at(place, np.moveaxis(np.asarray(spread), -1, 0)))
        n_ranges = self.range_m.size
        # of all models and ranges, those of a range are the same
        row = np.arange(self.models.prior.size)
        return Belief(
            np.stack([parts[i % n_ranges].mean[i] for i in row]),
            np.stack([parts[i % n_ranges].covariance[i] for i in row]),
            parts[0].probability,
        )


def track_starts(
    start: TargetStart, sensing: Sensing, models: MotionModels, *, begins: bool
) -> TrackStarts:
    """Return how tracks begin, the motion models with the filters that this takes.

    ``begins``: whether measurements may begin tracks beside those told.
    """
    ranges: FloatArray = np.ones(1)
    needs_ranges = sensing.kind == "bearings" and (begins or start.position is None)
    if start.range_m is not None and not needs_ranges:
        raise OptionError(
            "start.range_m (--start-range-m) belongs to tracks that begin at bearings "
            "alone, with own ship's navigation and without a position; leave it out."
        )
    if needs_ranges:
        if start.range_m is None:
            raise OptionError(
                "bearings alone do not tell where a track begins: give start.range_m "
                "(--start-range-m LEAST GREATEST) or start.position (--start-position)."
            )
        low, high = np.log(start.range_m)
        # neighbours meet one deviation from their middles
        step = 2.0 * np.log1p(RANGE_SHARE)
        count = max(int(np.ceil((high - low) / step)), 1)
        ranges = np.exp(low + (np.arange(count) + 0.5) * (high - low) / count)
    return TrackStarts(start, sensing, models.each(ranges.size), ranges)


def told_starts(
    scans: Scans, table: ScanTable, rows: list[IntArray], starts: TrackStarts
) -> FirstState:
    """Return the states that the tracks of told positions start from.

    Without a position it is the strongest measurement of the first scan that has one.
    """
    start = starts.start
    if start.position is None:
        first, row = _strongest(scans, rows)
        time_s = float(scans.time_s[row])
        own = None if table.own is None else table.own[row]
        one = np.array([row])
        scan = ScanRows(
            time_s, one, table.measured[one], table.covariance[one], table.covariance[row], own
        )
        belief = starts.at_measurements(scan, np.ones(1, dtype=bool))
    else:
        dimension = starts.sensing.component.size
        place = _by_target(start.position, "position", dimension)
        deviation = _needed(start.position_std, "position_std")
        spread = np.tile(deviation**2 * np.eye(dimension), (len(place), 1, 1))
        belief = starts.at(place, spread)
        first, time_s = 0, float(scans.time_s[0])
        if start.time_s is not None:
            time_s = start.time_s
            first = int(sum(scans.time_s[index[0]] < time_s for index in rows))
    if first >= len(rows):
        raise DataError(f"there is no scan after the start of the track at {time_s:g} s.")
    return FirstState(belief, first, time_s)


def _strongest(scans: Scans, rows: list[IntArray]) -> tuple[int, int]:
    """Return the scan after the first that is not empty, and its strongest row."""
    measured = has_measurement(scans)
    scan = next(i for i, index in enumerate(rows) if measured[index].any())
    index = rows[scan][measured[rows[scan]]]
    amplitude = scans.amplitude[index]
    if index.size > 1 and np.isnan(amplitude).any():
        raise DataError(
            f"scan {int(scans.scan[index[0]])} has {index.size} measurements without "
            "amplitude, and any may be the target: give start.position "
            "(--start-position)."
        )
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
            raise OptionError(
                f"start.velocity must be {dimension} numbers for all targets or for "
                f"each of the {count} told, got {start.velocity}."
            )
    return count


def _by_target(values: list[float], name: str, dimension: int) -> FloatArray:
    """Return the components that were told for each target, ``(target, m)``."""
    if not values or len(values) % dimension:
        raise OptionError(
            f"start.{name} must be {dimension} numbers for each target, got {values}."
        )
    return np.array(values, dtype=np.float64).reshape(-1, dimension)


def _needed(value: float | None, name: str) -> float:
    if value is None:
        raise OptionError(f"start.{name} (--start-{name.replace('_', '-')}) must be given.")
    return value
