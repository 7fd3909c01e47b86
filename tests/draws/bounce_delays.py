"""Range of a target by delays of the bottom bounce, own ship going straight on.

Neither own ship nor the target alters, and there are no frequencies: bearings alone do not
tell the range. Sound speed, compass, own navigation and the depths are drawn from what is
told. Nothing of the package makes the measurements: paths are straight, from the image of the
source. The bound is that of bearings and delays with these errors as unknowns (numerical
partials by the truth).

python -m tests.draws.bounce_delays 9000 20
"""

import sys
import warnings
from dataclasses import replace

import numpy as np

from tests.draws.motion_records import markov
from tests.draws.sonar_tables import heard, own_ship
from tests.draws.target_legs import deviations
from uwtrack_cli.motion.options import BounceGeometry, Nuisances
from uwtrack_cli.motion.tma import estimate_motion

STEP_S, ROWS, EVERY, SOUND_MPS, CORRELATION_S = 20.0, 180, 3, 1500.0, 100.0
BEARING_STD_DEG, DELAY_STD_S = 1.0, 5e-4
TOLD = {
    "sound_speed_std_mps": 5.0, "compass_std_deg": 0.5, "position_std_m": 10.0,
    "velocity_std_mps": 0.1,
}  # fmt: skip
WATER_M, WATER_STD_M, SENSOR_M, SOURCE_M, SOURCE_STD_M = 400.0, 4.0, 80.0, 60.0, 20.0
GEOMETRY = BounceGeometry(
    water_depth_m=WATER_M, water_depth_std_m=WATER_STD_M, sensor_depth_m=SENSOR_M,
    source_depth_m=SOURCE_M, source_depth_std_m=SOURCE_STD_M,
)  # fmt: skip


def bounce_delay_s(east_m, north_m, source_m, water_m, sound_mps):
    """Delays of the bottom bounce by the image of the source below the bottom."""
    sensor = np.array([0.0, 0.0, SENSOR_M])
    place = np.stack([east_m, north_m, np.full_like(east_m, source_m)], -1)
    image = place * [1.0, 1.0, -1.0] + [0.0, 0.0, 2.0 * water_m]
    ways = [np.linalg.norm(one - sensor, axis=-1) for one in (image, place)]
    return (ways[0] - ways[1]) / sound_mps


def motions(state, time_s, own_mps):
    """Relative places of a target with (x, y, vx, vy), own ship going north."""
    return state[0] + state[2] * time_s, state[1] + (state[3] - own_mps) * time_s


def draw(seed):
    """Return table, navigation, and range, bearing, speed and course of the target."""
    rng = np.random.default_rng([seed, 45])
    time, own_mps = STEP_S * np.arange(ROWS), rng.uniform(2.0, 5.0)
    while True:
        angle, course = rng.uniform(0.0, 2.0 * np.pi, 2)
        range_m, speed = rng.uniform(2e3, 8e3), rng.uniform(2.0, 8.0)
        state = np.array([
            range_m * np.sin(angle), range_m * np.cos(angle),
            speed * np.sin(course), speed * np.cos(course),
        ])  # fmt: skip
        east, north = motions(state, time, own_mps)
        # one that comes over the array, or goes beyond all delays, tells other things
        away = np.hypot(east, north)
        if away.min() > 1e3 and away.max() < 2e4:
            break
    told = TOLD
    sound = SOUND_MPS + told["sound_speed_std_mps"] * rng.standard_normal()
    source = SOURCE_M + SOURCE_STD_M * np.clip(rng.standard_normal(), -2.9, 2.9)
    water = WATER_M + WATER_STD_M * rng.standard_normal()
    late = bounce_delay_s(east, north, source, water, sound)
    late += DELAY_STD_S * rng.standard_normal(ROWS)
    late[np.arange(ROWS) % EVERY > 0] = np.nan
    bearing = np.degrees(np.arctan2(east, north))
    bearing += told["compass_std_deg"] * rng.standard_normal()
    bearing += BEARING_STD_DEG * rng.standard_normal(ROWS)
    empty = np.full(ROWS, np.nan)
    table = replace(
        heard("S1-T1"), contact=np.ones(ROWS, np.int64), time_s=time,
        bearing_deg=bearing % 360.0, bearing_std_deg=np.full(ROWS, BEARING_STD_DEG),
        frequency_hz=np.empty((ROWS, 0)), frequency_std_hz=np.empty((ROWS, 0)),
        level_db=empty, level_std_db=empty,
        bounce_delay_s=np.where(late > 0.0, late, np.nan),
        bounce_delay_std_s=np.full(ROWS, DELAY_STD_S),
    )  # fmt: skip
    error = told["position_std_m"] * markov(rng, ROWS, STEP_S, CORRELATION_S, (2,))
    own = replace(
        own_ship("S1-T1"), time_s=time, east_m=error[0],
        north_m=own_mps * time + error[1], heading_deg=np.full(ROWS, np.nan),
    )  # fmt: skip
    truth = np.array([range_m, np.degrees(angle), speed, np.degrees(course)])
    return table, own, truth, bound_m(state, time, own_mps)


def bound_m(state, time_s, own_mps):
    """Cramer-Rao bound of the range, m, with depths and sound speed as unknowns."""

    def values(x):
        east, north = motions(x[:4], time_s, own_mps)
        late = bounce_delay_s(east, north, *x[4:7])[::EVERY]
        angle = np.degrees(np.arctan2(east, north)) + x[7]
        return np.concatenate([angle / BEARING_STD_DEG, late / DELAY_STD_S])

    x = np.array([*state, SOURCE_M, WATER_M, SOUND_MPS, 0.0])
    step = np.array([1.0, 1.0, 1e-3, 1e-3, 0.01, 0.01, 0.01, 1e-4])
    columns = []
    for move in np.diag(step):
        off = values(x + move) - values(x - move)
        turn = 360.0 / BEARING_STD_DEG
        off[: time_s.size] = (off[: time_s.size] + turn / 2) % turn - turn / 2
        columns.append(off / (2.0 * move.sum()))
    jacobian = np.array(columns).T
    stds = [SOURCE_STD_M, WATER_STD_M, TOLD["sound_speed_std_mps"], TOLD["compass_std_deg"]]
    prior = np.diag([0.0] * 4 + [std**-2.0 for std in stds])
    covariance = np.linalg.inv(jacobian.T @ jacobian + prior)
    sight = np.array(state[:2]) / np.hypot(*state[:2])
    return float(np.sqrt(sight @ covariance[:2, :2] @ sight))


def score(seed):
    """Errors in stated deviations, and error and deviation of the range over the bound."""
    table, own, truth, bound = draw(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = estimate_motion(
            table, None, own, sound_speed_mps=SOUND_MPS, updates=1,
            nuisances=Nuisances(**TOLD), bounce=GEOMETRY,
        )  # fmt: skip
    value = np.array(
        [found.range_m[0], found.bearing_deg[0], found.speed_mps[0], found.course_deg[0]]
    )
    std = np.array([
        found.range_std_m[0], found.bearing_std_deg[0], found.speed_std_mps[0],
        found.course_std_deg[0],
    ])  # fmt: skip
    return (
        deviations(value, std, truth), found.mode.size,
        (value[0] - truth[0]) / bound, std[0] / bound, bound / truth[0],
    )  # fmt: skip


def main(seed, count):
    """Write coverage of the first state, and the range's errors over their bound."""
    found = [score(int(seed) + k) for k in range(int(count))]
    off = np.array([one[0] for one in found])
    error, stated, relative = np.array([one[2:] for one in found]).T
    told = np.isfinite(off)
    inside = [f"{np.mean(o[t] <= 1.96):.2f}" for o, t in zip(off.T, told.T, strict=True)]
    told_error = error[told[:, 0]]
    sys.stdout.write(
        f"seed {seed}, {count} draws: range told in {told[:, 0].sum()}, "
        f"several modes in {sum(one[1] > 1 for one in found)}\n"
        f"  within 1.96 deviations: range, bearing, speed, course {', '.join(inside)}\n"
        f"  range error over bound: rms {np.sqrt(np.mean(told_error**2)):.2f}, stated "
        f"deviation over bound: median {np.nanmedian(stated):.2f}, bound: median "
        f"{np.median(relative):.1%} of the range\n"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
