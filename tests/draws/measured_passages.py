"""Passages beside which something changed, drawn by chance, and what they are read as.

Measurements of one vessel are drawn with an independent law: the path of two straight
legs, whose time of emission is found by Newton's method, or one that bends evenly and is
summed up, and rest frequencies that step or ramp. Depths, sound speed and compass are drawn from the priors that the program is
told. Two vessels in one contact have the rest of their facts drawn alike.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.cpa import find_encounters

KINDS = (
    "straight", "jitter", "frequency-step", "frequency-ramp", "turn", "speed-change",
    "machinery",
)  # fmt: skip
BEND = "bend"
"""Kind of the draws whose course changes evenly for a long time."""
TWO_TARGETS = "two-targets"
"""Kind of the draws that have two vessels in one contact."""
STILL = ("machinery", "constant", "joined")
"""Kinds of the draws in which nothing passes: a machine that changes its speed and jitters,
one that hums, and one of whose lines ends where another begins close to it."""
DRAWS = (*KINDS, "two-targets", "bend", "constant", "joined")
"""Kinds in the order of their numbers in seeds."""
READ_AS = {
    "straight": "straight", "jitter": "straight", "turn": "manoeuvre",
    "speed-change": "manoeuvre", "bend": "manoeuvre",
}  # fmt: skip
MANOEUVRES = ("turn", "speed-change")
QUANTITIES = ("time", "speed", "range", "range over speed", "course")
LENGTH_S, CLOSEST_S, STEP_S = 600.0, 300.0, 1.0
SENSOR_DEPTH_M, SENSOR_STD_M, SOUND_STD_MPS, COMPASS_STD_DEG = 22.0, 0.5, 7.5, 2.0


@dataclass(frozen=True)
class Facts:
    """What a bound must know of a drawn passage: medium, change and noise."""

    height_m: float
    sound_mps: float
    change: np.ndarray
    frequency_std: np.ndarray
    wander: tuple
    bearing_std_deg: np.ndarray
    level_gain: float


@dataclass(frozen=True)
class Drawn:
    """One drawn passage: its truth, in the order of `QUANTITIES`, and its table."""

    kind: str
    truth: np.ndarray
    side: str
    series: Series
    change_s: float
    nearest_m: float
    flat_m: float = 0.0
    other_mps: tuple = ()
    facts: Facts | None = None


def draw(kind, seed):
    """Draw one passage (or a machine that only changes its speed)."""
    rng = np.random.default_rng([seed, DRAWS.index(kind)])
    depth = -1.0
    while depth <= 0:
        depth = rng.normal(3.0, 2.0)
    height = SENSOR_DEPTH_M + SENSOR_STD_M * rng.normal() - depth
    sound = 1500.0 + SOUND_STD_MPS * rng.normal()
    speed = rng.uniform(2.5, 8.0)
    flat = np.exp(rng.uniform(np.log(30.0), np.log(400.0)))
    course, turn = rng.uniform(0.0, 360.0), rng.choice([-1.0, 1.0])
    slant = float(np.hypot(flat, height))
    at = CLOSEST_S + rng.choice([-1, 1]) * slant / speed * rng.uniform(0.2, 3.0)
    at = float(np.clip(at, 60.0, LENGTH_S - 60.0))
    time = np.arange(STEP_S / 2, LENGTH_S, STEP_S)
    if kind in STILL:
        x, y, ratio, far = 0 * time, 0 * time + 1, 0 * time + 1, 0 * time + 1
    else:
        legs = np.array([speed, 0.0]), _other(kind, speed, rng)
        if kind == BEND:
            bend = _bend(slant / speed, rng)
            x, y, rate = bent(time, flat, height, sound, speed, bend)
        else:
            x, y, rate = received(time, flat, height, sound, at, legs)
        ratio = 1.0 / (1.0 + rate / sound)
        far = np.sqrt(x**2 + y**2 + height**2) / slant
    factor, size, wander = _factor(kind, time, at, rng)
    ratio = ratio * factor
    bearing = course - turn * 90.0 + turn * np.degrees(np.arctan2(x, y))
    truth = np.array([CLOSEST_S, speed, slant, slant / speed, course])
    side = "starboard" if turn > 0 else "port"
    series, noise = _measured(time, ratio, bearing, far, rng)
    if kind == "joined":
        jump = rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(3e-4), np.log(3e-2)))
        frequency = series.frequency_hz.copy()
        frequency[time > at, 0] *= 1 + jump
        series = replace(series, frequency_hz=frequency)
    other = () if kind in STILL else tuple(legs[1])
    nearest = slant * float(far.min())
    change = np.array(other if kind in MANOEUVRES else size)
    if kind == BEND:
        change, at = np.array(bend[1:]), bend[0]
    facts = Facts(height, sound, change, noise[0], wander, *noise[1:])
    return Drawn(kind, truth, side, series, at, nearest, float(flat), other, facts)


@dataclass(frozen=True)
class Pair:
    """Two drawn passages in one contact: truths, the lines of each, and their table."""

    truths: np.ndarray
    lines: np.ndarray
    series: Series


def draw_pair(seed):
    """Draw two straight passages whose lines were taken for one contact.

    The second passes within a minute of the first, and with a course within 60 degrees
    of it, as contacts that are formed by mistake do; the broadband is the sum of both,
    and its bearing that of their summed intensities.
    """
    rng = np.random.default_rng([seed, len(KINDS)])
    sound = 1500.0 + SOUND_STD_MPS * rng.normal()
    course = rng.uniform(0.0, 360.0)
    turn = rng.choice([-1.0, 1.0])
    time = np.arange(STEP_S / 2, LENGTH_S, STEP_S)
    truths, columns, powers, vectors = [], [], [], []
    for number in range(2):
        depth = -1.0
        while depth <= 0:
            depth = rng.normal(3.0, 2.0)
        height = SENSOR_DEPTH_M + SENSOR_STD_M * rng.normal() - depth
        speed, flat = rng.uniform(2.5, 8.0), np.exp(rng.uniform(*np.log([30.0, 400.0])))
        own = course + number * rng.uniform(-60.0, 60.0)
        late = number * rng.uniform(-60.0, 60.0)
        slant = float(np.hypot(flat, height))
        legs = np.array([speed, 0.0]), np.array([speed, 0.0])
        x, y, rate = received(time - late, flat, height, sound, 0.0, legs)
        far = np.sqrt(x**2 + y**2 + height**2) / slant
        density = 10 ** (rng.uniform(26.0, 36.0) / 10) / far**2
        sigma = np.sqrt(3 / (2 * np.pi**2 * density * STEP_S**3))
        sigma = np.where(density * STEP_S >= 10, sigma, np.nan)
        for order in range(2, 4 + int(rng.integers(0, 2))):
            rest = rng.uniform(40.0, 90.0) * order
            error = sigma * rng.normal(size=time.size)
            columns.append((rest / (1.0 + rate / sound) + error, sigma, number))
        bearing = np.radians(own - turn * 90.0) + turn * np.arctan2(x, y)
        powers.append(10 ** (rng.uniform(0.0, 1.5)) / far**2)
        vectors.append(powers[-1] * np.exp(1j * bearing))
        truths.append([CLOSEST_S + late, speed, slant, slant / speed, own % 360.0])
    frequency, deviation, owner = (list(part) for part in zip(*columns, strict=True))
    order = rng.permutation(len(owner))
    std = rng.uniform(1.5, 6.0) * 1.5 * np.ones(time.size)
    bearing = np.degrees(np.angle(sum(vectors))) + std * rng.normal(size=time.size)
    if rng.random() < 0.4:
        bearing, std = np.full((2, time.size), np.nan)
    level = 10 * np.log10(sum(powers) + 1) + rng.normal(size=time.size)
    series = Series(
        contact=np.ones(time.size, np.int64), time_s=time,
        frequency_hz=np.array(frequency).T[:, order],
        frequency_std_hz=np.array(deviation).T[:, order],
        bearing_deg=(bearing - COMPASS_STD_DEG * rng.normal()) % 360.0,
        bearing_std_deg=std, level_db=level, level_std_db=np.ones(time.size),
    )  # fmt: skip
    return Pair(np.array(truths), np.array(owner)[order], series)


def place(drawn, time_s):
    """Return east and north of the drawn vessel at a time, the sensor at the origin."""
    speed, course = drawn.truth[1], np.radians(drawn.truth[4])
    along = np.array([np.sin(course), np.cos(course)])
    away = np.array([-along[1], along[0]]) * (1 if drawn.side == "starboard" else -1)
    lag = time_s - CLOSEST_S
    if (time_s > drawn.change_s) == (drawn.change_s > CLOSEST_S):
        lag = drawn.change_s - CLOSEST_S
        left = time_s - drawn.change_s
    else:
        left = 0.0
    x = speed * lag + drawn.other_mps[0] * left
    return x * along + (drawn.flat_m + drawn.other_mps[1] * left) * away


def _bend(width_s, rng):
    """Draw middle (s), duration (s) and angle away from the sensor (rad) of a turn."""
    lasts = width_s * np.exp(rng.uniform(*np.log([2.0, 10.0])))
    middle = CLOSEST_S + rng.uniform(-0.5, 0.5) * lasts
    # a course that turned faster round the sensor would not be closest there
    most = min(90.0, np.degrees(0.5 * lasts / width_s))
    angle = np.radians(rng.uniform(20.0, max(most, 20.0))) * rng.choice([-1.0, 1.0])
    return middle, lasts, angle


def bent(time, flat, height, sound, speed, bend):
    """Return place and range rate at emission on a path that bends evenly.

    The path is summed up in steps of 20 ms from the closest approach, and the time of
    emission found by interpolation.
    """
    middle, lasts, angle = bend
    ends = middle - 0.5 * lasts, middle + 0.5 * lasts
    instant = CLOSEST_S + 0.02 * np.arange(-45_000, 45_001)
    course = angle / lasts * (np.clip(instant, *ends) - np.clip(CLOSEST_S, *ends))
    way = speed * 0.02 * np.stack([np.cos(course), np.sin(course)])
    # trapezoids
    path = np.cumsum(0.5 * (way[:, 1:] + way[:, :-1]), axis=1)
    path = np.pad(path, ((0, 0), (1, 0)))
    path -= path[:, [45_000]] - np.array([[0.0], [flat]])
    distance = np.sqrt((path**2).sum(axis=0) + height**2)
    emitted = np.interp(time, instant + distance / sound, instant)
    x, y = (np.interp(emitted, instant, row) for row in path)
    vx, vy = (np.interp(emitted, instant, row / 0.02) for row in way)
    return x, y, (x * vx + y * vy) / np.sqrt(x**2 + y**2 + height**2)


def _other(kind, speed, rng):
    """Draw the velocity of the other leg, along the course and away from the sensor."""
    if kind == "turn":
        angle = np.radians(rng.uniform(10.0, 90.0) * rng.choice([-1.0, 1.0]))
        return speed * np.array([np.cos(angle), np.sin(angle)])
    change = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.5)
    return np.array([speed * (1.0 + change * (kind == "speed-change")), 0.0])


def _factor(kind, time, at, rng):
    """Draw what happens to all rest frequencies; also its size and the jitter."""
    factor, sign = np.ones_like(time), rng.choice([-1, 1])
    size, drawn = [], ()
    if kind in ("frequency-step", "machinery"):
        size = [sign * np.exp(rng.uniform(np.log(3e-4), np.log(3e-2)))]
        factor += size[0] * (time > at)
    if kind == "frequency-ramp":
        whole = sign * np.exp(rng.uniform(np.log(5e-4), np.log(2e-2)))
        size = [whole / (LENGTH_S - at)]
        factor += size[0] * np.maximum(time - at, 0.0)
    if kind in ("jitter", "machinery"):
        memory_s, strength = rng.uniform(5.0, 60.0), 10 ** rng.uniform(-4.5, -3.3)
        wander, decay = np.empty_like(time), np.exp(-STEP_S / memory_s)
        wander[0] = rng.normal()
        for k in range(1, time.size):
            wander[k] = decay * wander[k - 1] + np.sqrt(1 - decay**2) * rng.normal()
        factor += strength * wander
        drawn = strength, memory_s
    return factor, size, drawn


def _measured(time, ratio, bearing, far, rng):
    """Return the table of noisy measurements; four of ten sensors have no bearings."""
    count = int(rng.integers(1, 5))
    rest = rng.uniform(40.0, 90.0) * np.arange(2, 2 + count)
    density = 10 ** (rng.uniform(22.0, 34.0) / 10) / far**2
    sigma = np.sqrt(3 / (2 * np.pi**2 * density * STEP_S**3))
    sigma = np.where(density * STEP_S >= 10, sigma, np.nan)[:, None]
    frequency = rest * ratio[:, None] + sigma * rng.normal(size=(time.size, count))
    bearing_std = rng.uniform(1.5, 6.0) * far
    bearing = bearing + bearing_std * rng.normal(size=time.size)
    bearing = bearing - COMPASS_STD_DEG * rng.normal()
    if rng.random() < 0.4:
        bearing, bearing_std = np.full((2, time.size), np.nan)
    gain = 10 ** (rng.uniform(0.0, 1.5))
    level = 10 * np.log10(gain / far**2 + 1)
    series = Series(
        contact=np.ones(time.size, np.int64), time_s=time, frequency_hz=frequency,
        frequency_std_hz=np.tile(sigma, count), bearing_deg=bearing % 360.0,
        bearing_std_deg=bearing_std, level_db=level + rng.normal(size=time.size),
        level_std_db=np.ones(time.size),
    )  # fmt: skip
    return series, (sigma / (rest * ratio[:, None]), bearing_std, gain)


def received(time, flat, height, sound, at, legs):
    """Return place and range rate at the time of emission, by Newton's method.

    The first leg has the closest approach, at `CLOSEST_S`; the other one goes before or
    follows it from the instant ``at``.
    """
    (speed, _), other = legs
    emitted = time - np.hypot(flat, height) / sound
    for _ in range(40):
        on = (emitted > at) == (at > CLOSEST_S)
        lag = emitted - at
        straight = speed * (emitted - CLOSEST_S)
        x = np.where(on, speed * (at - CLOSEST_S) + other[0] * lag, straight)
        y = np.where(on, flat + other[1] * lag, flat)
        vx, vy = np.where(on, other[0], speed), np.where(on, other[1], 0.0)
        distance = np.sqrt(x**2 + y**2 + height**2)
        rate = (x * vx + y * vy) / distance
        error = emitted + distance / sound - time
        emitted = emitted - error / (1 + rate / sound)
    return x, y, rate


def is_clear(drawn):
    """Whether the drawn closest approach is that of the whole path."""
    return drawn.nearest_m > 0.98 * drawn.truth[2]


SENSOR = Sensor(
    id="h1", depth_m=SENSOR_DEPTH_M, depth_std_m=SENSOR_STD_M,
    sound_speed_std_mps=SOUND_STD_MPS, compass_std_deg=COMPASS_STD_DEG,
)  # fmt: skip


def analyse(drawn):
    """Return the encounters of a drawn passage."""
    return find_encounters(series=drawn.series, sensor=SENSOR)


def errors(drawn, found, row=0):
    """Return errors and deviations of a row, nan where it gives nothing."""
    names = ("time{}_s", "speed{}_mps", "slant_range{}_m", "range_over_speed{}_s", "course{}_deg")
    value, std = (
        np.array([getattr(found, name.format(part))[row] for name in names])
        for part in ("", "_std")
    )
    error = value - drawn.truth
    error[4] = (error[4] + 180.0) % 360.0 - 180.0
    return error, std


class Scored(NamedTuple):
    """What came of one drawn vessel or machine."""

    reading: str
    """What it was read as; 'refused', or 'nothing'."""
    error: np.ndarray
    """Errors of the quantities; nan where they are not given."""
    std: np.ndarray
    """Their stated deviations."""
    is_wrong: bool
    """Whether the side is wrong."""
    bound: np.ndarray
    """Bounds of the quantities; nan where none was computed."""
    slant_m: float
    """Slant range at closest approach, m."""
    weight: float
    """Stated probability of the reading; nan without one."""


def score(kind, seed):
    """Return what came of the vessels of one draw."""
    from tests.draws.measured_bounds import bounds

    if kind == TWO_TARGETS:
        pair = draw_pair(seed)
        found = find_encounters(series=pair.series, sensor=SENSOR)
        return score_pair(pair, found)
    number = seed
    drawn = draw(kind, number)
    while not is_clear(drawn):
        number += 1_000_000
        drawn = draw(kind, number)
    found = analyse(drawn)
    bound = np.full(5, np.nan) if kind in STILL else bounds(drawn)
    slant = float(drawn.truth[2])
    if not found.n_encounters:
        return [_without(found, bound, slant)]
    error, std = errors(drawn, found)
    reading = "straight" if found.motion_model is None else str(found.motion_model[0])
    weight = float(found.motion_model_probability[0])
    is_wrong = found.side[0] not in ("", drawn.side)
    return [Scored(reading, error, std, is_wrong, bound, slant, weight)]


def score_pair(pair, found):
    """Return what came of both vessels of a pair, each by the row that is nearest."""
    left, scored = list(range(found.n_encounters)), []
    for truth in pair.truths:
        drawn = Drawn("straight", truth, "", pair.series, 0.0, 0.0)
        apart = [abs(found.time_s[row] - truth[0]) / truth[3] for row in left]
        if not left:
            scored.append(_without(found, np.full(5, np.nan), float(truth[2])))
            continue
        row = left.pop(int(np.argmin(apart)))
        error, std = errors(drawn, found, row)
        scored.append(Scored(
            str(found.motion_model[row]), error, std, False, np.full(5, np.nan),
            float(truth[2]), float(found.motion_model_probability[row]),
        ))  # fmt: skip
    return scored


def _without(found, bound, slant):
    """Return the score of what is not found."""
    name, nothing = "refused" if found.refusals() else "nothing", np.full(5, np.nan)
    return Scored(name, nothing, nothing, False, bound, slant, np.nan)
