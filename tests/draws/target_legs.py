"""Coverage of every leg of a target that alters its velocity.

Own ship goes the three legs of the published scenario. The target has two or three legs of
random courses and speeds, and turns evenly from one to the next within half a minute to three.
Sound speed, compass and own navigation are drawn from what is told. Nothing of the package
makes the measurements. A quantity is covered when it lies within 1.96 stated deviations; of
legs at the times at which the answer says that they begin.

python -m tests.draws.target_legs both 2 7000 200
"""

import sys
import warnings
from dataclasses import dataclass, replace

import numpy as np

from tests.draws.motion_records import markov
from tests.draws.sonar_tables import heard, own_ship
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.motion.options import Nuisances
from uwtrack_cli.motion.tma import estimate_motion

STEP_S, ROWS, SOUND_MPS, CORRELATION_S = 20.0, 300, 1500.0, 100.0
BEARING_STD_DEG, FREQUENCY_STD_HZ, REST_HZ = 1.0, 0.1, 650.0
TOLD = {
    "sound_speed_std_mps": 5.0, "compass_std_deg": 0.5, "position_std_m": 10.0,
    "velocity_std_mps": 0.1,
}  # fmt: skip
NAMES = ("range", "bearing", "speed", "course")


@dataclass(frozen=True)
class Way:
    """The way of a target, sampled every second from ten seconds before time zero."""

    east_m: np.ndarray
    north_m: np.ndarray
    speed_mps: np.ndarray
    course_deg: np.ndarray
    altered_s: np.ndarray

    def at(self, time_s, values):
        """Values at times, s."""
        return np.interp(time_s, np.arange(-10.0, values.size - 10.0), values)


def draw_way(rng, legs):
    """Draw a target: start, legs, and the alterations between them."""
    end = STEP_S * ROWS
    while True:
        altered = np.sort(rng.uniform(0.15 * end, 0.85 * end, legs - 1))
        if legs <= 2 or np.diff(altered).min() > 0.2 * end:
            break
    seconds = np.arange(-10.0, end + 10.0)
    course = np.full(seconds.size, rng.uniform(0.0, 360.0))
    speed = np.full(seconds.size, rng.uniform(5.0, 15.0) * KNOT_MPS)
    for at in altered:
        share = np.clip((seconds - at) / rng.uniform(30.0, 180.0) + 0.5, 0.0, 1.0)
        course += share * rng.choice([-1, 1]) * rng.uniform(20.0, 120.0)
        speed += share * rng.uniform(-1.5, 1.5)
    start, range_m = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(6e3, 2e4)
    away = np.radians(course)
    places = [
        range_m * begin + np.cumsum(speed * of(away)) - 10.0 * speed[0] * of(away)[0]
        for begin, of in ((np.sin(start), np.sin), (np.cos(start), np.cos))
    ]
    return Way(*places, speed, course % 360.0, altered)


def own_at(time_s, own):
    """Own place at times, s."""
    return np.stack([np.interp(time_s, own.time_s, p) for p in (own.east_m, own.north_m)])


def draw(kind, legs, seed):
    """Return table, navigation and the target's way."""
    rng = np.random.default_rng([seed, legs])
    way, own = draw_way(rng, legs), own_ship("S1-T1")
    time = STEP_S * np.arange(ROWS)
    relative = []
    for step in (-1.0, 0.0, 1.0):
        at = time + step
        place = np.stack([way.at(at, way.east_m), way.at(at, way.north_m)])
        relative.append(place - own_at(at, own))
    distance = np.hypot(*np.array(relative).swapaxes(0, 1))
    rates = 0.5 * (distance[2] - distance[0])
    sound = SOUND_MPS + TOLD["sound_speed_std_mps"] * rng.standard_normal()
    bearing = np.degrees(np.arctan2(*relative[1]))
    bearing += TOLD["compass_std_deg"] * rng.standard_normal()
    bearing += BEARING_STD_DEG * rng.standard_normal(ROWS)
    frequency = REST_HZ * (1.0 - rates / sound)
    frequency += FREQUENCY_STD_HZ * rng.standard_normal(ROWS)
    if kind == "frequencies":
        bearing = np.full(ROWS, np.nan)
    if kind == "bearings":
        frequency = np.full(ROWS, np.nan)
    empty = np.full(ROWS, np.nan)
    table = replace(
        heard("S1-T1"), contact=np.ones(ROWS, np.int64), time_s=time,
        bearing_deg=bearing % 360.0, bearing_std_deg=np.full(ROWS, BEARING_STD_DEG),
        frequency_hz=frequency[:, None],
        frequency_std_hz=np.full((ROWS, 1), FREQUENCY_STD_HZ),
        level_db=empty, level_std_db=empty,
    )  # fmt: skip
    error = TOLD["position_std_m"] * markov(
        rng, own.time_s.size, float(np.median(np.diff(own.time_s))), CORRELATION_S, (2,)
    )
    return table, replace(own, east_m=own.east_m + error[0], north_m=own.north_m + error[1]), way


def seen(way, own, time_s):
    """True range, bearing, speed and course at times, s, shape (4, times)."""
    place = np.stack([way.at(time_s, way.east_m), way.at(time_s, way.north_m)])
    east, north = place - own_at(time_s, own)
    # whole seconds: a course must not be interpolated through north
    row = np.clip(np.rint(time_s + 10.0).astype(int), 0, way.speed_mps.size - 1)
    return np.stack([
        np.hypot(east, north), np.degrees(np.arctan2(east, north)),
        way.speed_mps[row], way.course_deg[row],
    ])  # fmt: skip


def deviations(value, std, truth):
    """Errors in stated deviations, nan where nothing was told; shape (4, legs)."""
    off = value - truth
    off[[1, 3]] = (off[[1, 3]] + 180.0) % 360.0 - 180.0
    return np.abs(off) / std


def columns(found, prefix, rows):
    """Values and deviations of the four quantities."""
    units = ("m", "deg", "mps", "deg")
    return tuple(
        np.stack([
            getattr(found, f"{prefix}{name}{part}_{unit}")[rows]
            for name, unit in zip(NAMES, units, strict=True)
        ])
        for part in ("", "_std")
    )  # fmt: skip


def score(kind, legs, seed):
    """Analyse a draw: legs found, and errors in deviations by mode.

    Of every mode: of the state at the first and at the last row, shape (4,) each, of its
    legs, shape (4, legs), or None where their number is wrong, and of their alterations.
    """
    table, own, way = draw(kind, legs, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = estimate_motion(
            table, None, own, sound_speed_mps=SOUND_MPS, updates=1, nuisances=Nuisances(**TOLD)
        )
    true_own = own_ship("S1-T1")
    modes = []
    for mode in range(found.mode.size):
        first, now = (
            deviations(
                *columns(found, prefix, slice(mode, mode + 1)), seen(way, true_own, np.array([at]))
            )
            for prefix, at in (("", 0.0), ("now_", table.time_s[-1]))
        )
        rows = np.flatnonzero(found.leg_motion == mode)
        by_leg, altered = None, None
        if rows.size == legs:
            begin = found.leg_start_s[rows]
            truth = seen(way, true_own, begin)
            # courses and speeds are those of the leg, wherever it is said to begin
            edges = np.concatenate([[0.0], way.altered_s, [table.time_s[-1]]])
            truth[2:] = seen(way, true_own, 0.5 * (edges[:-1] + edges[1:]))[2:]
            by_leg = deviations(*columns(found, "leg_", rows), truth)
            altered = np.abs(
                found.leg_alteration_time_s[rows[1:]] - way.altered_s
            ) / found.leg_alteration_time_std_s[rows[1:]]  # fmt: skip
        modes.append((first[:, 0], now[:, 0], by_leg, altered))
    count = int((found.leg_motion == 0).sum())
    return count, modes, found


def share(values):
    """Share of told values within 1.96 deviations, and how many were told, in words."""
    told = np.concatenate([np.ravel(one) for one in values] or [np.empty(0)])
    told = told[np.isfinite(told)]
    return f"{(told <= 1.96).mean() if told.size else np.nan:.3f} of {told.size}"


def worst(mode):
    """Largest error of the first and the last state; of what is not told nine."""
    return np.nan_to_num(np.concatenate(mode[:2]), nan=9.0).max()


def main(kind, legs, seed, count):
    """Write the coverage of so many draws; of several modes, of the one that is right."""
    legs, seed, count = int(legs), int(seed), int(count)
    found = [score(kind, legs, seed + k) for k in range(count)]
    chosen = [min(modes, key=worst) for _, modes, _ in found]
    right = [one for one in chosen if one[2] is not None]
    numbers = np.bincount([n for n, *_ in found]).tolist()
    several = sum(len(modes) > 1 for _, modes, _ in found)
    lines = [(f"{kind}, {legs} legs, seed {seed}: {count} draws, found {numbers}, "
             f"several modes {several}")]  # fmt: skip
    rows = [("first row", [one[0] for one in chosen])]
    rows += [("last row", [one[1] for one in chosen])]
    rows += [(f"leg {leg + 1}", [one[2][:, leg] for one in right]) for leg in range(legs)]
    for name, values in rows:
        told = (f"{key} {share([one[k] for one in values])}" for k, key in enumerate(NAMES))
        lines.append(f"  {name}: {', '.join(told)}")
    lines.append(f"  alterations: {share([one[3] for one in right])}")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
