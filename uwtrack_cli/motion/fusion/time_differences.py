"""Where a source was by the differences of its arrival times at several recorders.

**Method.** A source on a straight way is fitted to the delays of all pairs. What is not
known of the recorders takes part with its prior: the offset of each clock, each place, and
the sound speed. Starts are places at rest that fit the first and the second half of the
delays on a grid; minima that remain are modes. Delays that lie far beyond their deviations
(echoes, other sources) count less (Huber's loss). Deviations that are too small are raised to
what the residuals show; delays of overlapping frames and of all pairs repeat each other, which
is counted by the number of independent ones.

**Conventions.** East and north from the first recorder, m. A delay is seen from where the
source was when the sound left.

**References.** Chan & Ho 1994, IEEE Trans. Signal Process. 42, 1905 (hyperbolic places);
Huber 1981.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.fusion.sensor_table import CLOCK_STD_S
from uwtrack_cli.motion.target_motion.place_readings import VESSEL_VELOCITY_STD_MPS

NOMINAL_SOUND_SPEED_STD = 0.01
"""Relative deviation of a sound speed that nobody gave."""

GRID_RANGES, GRID_BEARINGS, NEAREST, FARTHEST = 40, 72, 0.05, 30.0
"""Places that the search begins from: numbers of ranges and bearings about the middle of the
recorders, nearest and farthest range in units of their spread."""

STARTS, NEIGHBOURS = 4, 0.3
"""Places of each half of the delays that are paired to starts, and the share of its distance
from the middle of the recorders within which another place is the same."""

HUBER = 3.0
"""Deviations beyond which a delay counts less."""

SMALLEST_WEIGHT, APART = 1e-3, 1.0
"""Weight of a mode, and deviations from a better one, that it must have."""

FEWEST_DELAYS = 8
"""Delays below which no way is fitted."""


@dataclass(frozen=True, eq=False)
class SourceWay:
    """A straight way that explains the delays."""

    state: FloatArray
    """East and north, m, and their rates, m/s, at time zero, shape (4,)."""
    covariance: FloatArray
    """Their covariance, shape (4, 4)."""
    weight: float
    """Probability of this mode."""


@dataclass(frozen=True, eq=False)
class _Heard:
    """Delays between recorders, as numbers."""

    time_s: FloatArray
    """Centre of each delay's frame from the middle of all, s, shape (delays,)."""
    first: IntArray
    """First recorder of each, from 0, same shape."""
    second: IntArray
    """Second recorder of each, same shape."""
    delay_s: FloatArray
    """Delay, s, same shape."""
    std_s: FloatArray
    """Its deviation, s, same shape."""
    place_m: FloatArray
    """Places of the recorders, east, north and up, m, shape (recorders, 3)."""
    slowness: float
    """Inverse of the sound speed, s/m."""


def fit_time_differences(delays: Delays, sensor: Sensor) -> list[SourceWay]:
    """Return the ways of a source that explain the delays between recorders, best first.

    Raises
    ------
    DataError
        Fewer than three recorders share sound, or there are too few delays.
    """
    names = sensor.channel_names
    known = {name: n for n, name in enumerate(names)}
    used = sorted({*delays.channel_a.tolist(), *delays.channel_b.tolist()})
    if len(used) < 3 or delays.delay_s.size < FEWEST_DELAYS:
        raise DataError(
            f"{delays.delay_s.size} delays between {', '.join(used) or 'no recorders'} "
            f"do not place a source: three recorders that hear it are needed."
        )
    middle_s = float(0.5 * (delays.time_s.min() + delays.time_s.max()))
    # pairs repeat each other: N recorders have N - 1 delays that are independent
    repeats = len(used) * (len(used) - 1) / 2.0 / (len(used) - 1)
    heard = _Heard(
        delays.time_s - middle_s,
        np.array([known[name] for name in delays.channel_a]),
        np.array([known[name] for name in delays.channel_b]),
        delays.delay_s,
        delays.delay_std_s * np.sqrt(repeats),
        sensor.element_xyz_m,
        1.0 / sensor.sound_speed_mps,
    )
    nuisance_std = np.concatenate([
        [_slowness_std(sensor)], _clock_stds(delays, heard),
        np.full(2 * len(names), sensor.position_std_m),
    ])  # fmt: skip
    ways = _fitted(heard, nuisance_std)
    back = np.eye(4)
    back[:2, 2:] -= middle_s * np.eye(2)  # from the middle to time zero
    return [SourceWay(back @ way.state, back @ way.covariance @ back.T, way.weight) for way in ways]


def _slowness_std(sensor: Sensor) -> float:
    """Return the relative deviation of the sound speed."""
    std = sensor.sound_speed_std_mps
    return NOMINAL_SOUND_SPEED_STD if std is None else std / sensor.sound_speed_mps


def _clock_stds(delays: Delays, heard: _Heard) -> FloatArray:
    """Return the deviation of each recorder's clock, s.

    Those of pairs are the roots of the sums of two squares.
    """
    from scipy.optimize import nnls

    count = len(heard.place_m)
    if delays.clock_std_s is None:
        return np.zeros(count)
    told = np.nan_to_num(delays.clock_std_s, nan=np.sqrt(2.0) * CLOCK_STD_S)
    pairs, row = np.unique(np.stack([heard.first, heard.second]), axis=1, return_index=True)
    matrix = np.zeros((row.size, count))
    matrix[np.arange(row.size), pairs[0]] = 1.0
    matrix[np.arange(row.size), pairs[1]] = 1.0
    return np.sqrt(nnls(matrix, told[row] ** 2)[0])


def _delays_of(heard: _Heard, state: FloatArray, nuisances: FloatArray) -> FloatArray:
    """Return the delays that a way and the errors of the recorders make, s.

    Nuisances are the relative error of the sound speed, the offset of each clock and the
    errors of the places, east and north of each recorder.
    """
    count = len(heard.place_m)
    clock_s = nuisances[1 : 1 + count]
    place = heard.place_m.copy()
    place[:, :2] += nuisances[1 + count :].reshape(count, 2)
    slowness = heard.slowness * (1.0 - nuisances[0])
    late_s: FloatArray = np.zeros(heard.time_s.size)
    ranges = np.zeros((2, heard.time_s.size))
    for _ in range(2):  # the source is seen where it was when the sound left
        way = state[:2] + state[2:] * (heard.time_s - late_s)[:, np.newaxis]
        for row, recorder in enumerate((heard.first, heard.second)):
            away = way - place[recorder, :2]
            depth = place[recorder, 2] + SOURCE_DEPTH_M
            ranges[row] = np.sqrt((away**2).sum(1) + depth**2)
        late_s = slowness * ranges.mean(axis=0)
    apart_s = clock_s[heard.second] - clock_s[heard.first]
    return np.asarray(slowness * (ranges[1] - ranges[0]) + apart_s)


def _fitted(heard: _Heard, nuisance_std: FloatArray) -> list[SourceWay]:
    """Descend from all starts; nuisances are counted in their deviations."""
    from scipy.optimize import least_squares

    def residual(unknowns: FloatArray) -> FloatArray:
        state, nuisances = unknowns[:4], unknowns[4:]
        model = _delays_of(heard, state, nuisance_std * nuisances)
        off = (model - heard.delay_s) / heard.std_s
        size = np.abs(off)
        # Huber's loss as the square of a residual
        tail = np.sqrt(2.0 * HUBER * np.maximum(size, HUBER) - HUBER**2)
        off = np.where(size > HUBER, np.sign(off) * tail, off)
        return np.concatenate([off, state[2:] / VESSEL_VELOCITY_STD_MPS, nuisances])

    ends: list[tuple[float, FloatArray, FloatArray]] = []
    for start in _starts(heard):
        begin = np.append(start, np.zeros(nuisance_std.size))
        found = least_squares(residual, begin, x_scale="jac", max_nfev=60)
        ends.append((float(found.cost), found.x, np.array(found.jac, float)))
    ends.sort(key=lambda one: one[0])
    count = heard.delay_s.size
    scale2 = max(2.0 * ends[0][0] / max(count - 4, 1), 1.0)
    kept: list[tuple[float, FloatArray, FloatArray]] = []
    for cost, unknowns, jacobian in ends:
        log_weight = (ends[0][0] - cost) / scale2
        if log_weight < np.log(SMALLEST_WEIGHT):
            break
        jacobian[:count] /= np.sqrt(scale2)
        size = np.maximum(np.sqrt((jacobian**2).sum(0)), 1e-300)
        normal = (jacobian / size).T @ (jacobian / size)
        covariance = np.linalg.pinv(normal, hermitian=True) / np.outer(size, size)
        state, covariance = unknowns[:4], covariance[:4, :4]
        if all(_is_apart(state, *other[1:]) for other in kept):
            kept.append((log_weight, state, covariance))
    weight = np.exp([one[0] for one in kept])
    return [
        SourceWay(state, covariance, float(share))
        for (_, state, covariance), share in zip(kept, weight / weight.sum(), strict=True)
    ]


def _is_apart(state: FloatArray, other: FloatArray, covariance: FloatArray) -> bool:
    step = state - other
    distance = float(step @ np.linalg.pinv(covariance, hermitian=True) @ step)
    return distance > APART


def _starts(heard: _Heard) -> FloatArray:
    """Return ways between places that fit the delays of both halves best."""
    centre = heard.place_m[:, :2].mean(axis=0)
    spread = np.sqrt(np.var(heard.place_m[:, :2], axis=0).sum())
    ranges = np.geomspace(NEAREST, FARTHEST, GRID_RANGES) * max(float(spread), 1.0)
    angles = np.linspace(0.0, 2.0 * np.pi, GRID_BEARINGS, endpoint=False)
    circle = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    grid = centre + (ranges[:, np.newaxis, np.newaxis] * circle).reshape(-1, 2)
    away = np.linalg.norm(grid[:, np.newaxis] - heard.place_m[:, :2], axis=-1)
    usual: Callable[[FloatArray], float] = np.median
    halves = []
    for half in (heard.time_s <= 0.0, heard.time_s > 0.0):
        first, second = heard.first[half], heard.second[half]
        off = heard.slowness * (away[:, second] - away[:, first]) - heard.delay_s[half]
        value = np.abs(off).mean(axis=1)
        halves.append((_apart(grid, value, centre), usual(heard.time_s[half])))
    (before, early_s), (after, late_s) = halves
    starts = [np.append(one, np.zeros(2)) for one in before]
    for one in before:
        for other in after:
            velocity = (other - one) / max(late_s - early_s, 1e-3)
            velocity = np.clip(velocity, -20.0, 20.0)
            starts.append(np.append(one - early_s * velocity, velocity))
    return np.array(starts)


def _apart(grid: FloatArray, value: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the best places of a grid, none of which is the neighbour of another."""
    kept: list[FloatArray] = []
    for place in grid[np.argsort(value)]:
        reach = NEIGHBOURS * float(np.hypot(*(place - centre)))
        if all(float(np.hypot(*(place - other))) > reach for other in kept):
            kept.append(place)
        if len(kept) == STARTS:
            break
    return np.array(kept)
