"""Delays of a source that passes three recorders, with wrong clocks, places and sound speed.

`python -m tests.draws.delay_scenes SEED COUNT` prints how many ellipses hold the source.
"""

import sys

import numpy as np

from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.locate import locate_vessels

HALF_95 = 5.99


def scene(seed, *, recorders=3, frames=60, clock_std_s=1e-3, std_s=2e-4):
    """Return delays, their sensor, and the place of the source at 60 s.

    Frames are two seconds apart; every error is drawn with its deviation.
    """
    draw = np.random.default_rng(seed)
    turn = np.radians(360.0 / recorders * np.arange(recorders))
    turn = turn + np.radians(draw.uniform(-20.0, 20.0, recorders))
    out = draw.uniform(200.0, 500.0, recorders)
    told = np.stack([out * np.sin(turn), out * np.cos(turn)], -1)
    told = told - told[0]
    true = told + draw.normal(0.0, 1.0, told.shape)
    clock_s = draw.normal(0.0, clock_std_s, recorders)
    sound_mps = 1500.0 * (1.0 + draw.normal(0.0, 0.005))
    course, speed = draw.uniform(0.0, 2.0 * np.pi), draw.uniform(1.0, 6.0)
    velocity = speed * np.array([np.sin(course), np.cos(course)])
    middle = told.mean(axis=0) + draw.uniform(-500.0, 500.0, 2)
    time = 2.0 * np.arange(frames) + 1.0
    rows = []
    for at in time:
        for a in range(recorders):
            for b in range(a + 1, recorders):
                # windows of one time have in common what left in the middle of both ways
                left = at
                for _ in range(4):
                    way = middle + (left - 60.0) * velocity - true[[a, b]]
                    late_s = np.sqrt((way**2).sum(1) + 16.0**2) / sound_mps
                    left = at - late_s.mean()
                delay = late_s[1] - late_s[0] + clock_s[b] - clock_s[a]
                rows.append((at, a, b, delay + std_s * draw.standard_normal()))
    at, a, b, delay = np.array(rows).T
    names = np.array([f"r{k}" for k in range(recorders)])
    sensor = Sensor(
        id="+".join(names), kind="array", channels=",".join(names), east_m=0.0,
        north_m=0.0, position_std_m=1.0, sound_speed_std_mps=7.5,
        element_positions_m=";".join(f"{e},{n},-20.0" for e, n in told),
    )  # fmt: skip
    delays = Delays(
        time_s=at, channel_a=names[a.astype(int)], channel_b=names[b.astype(int)],
        delay_s=delay, delay_std_s=np.full(at.size, std_s),
        clock_std_s=np.full(at.size, np.sqrt(2.0) * clock_std_s), sensor=sensor.id,
    )  # fmt: skip
    return delays, sensor, middle


def score(seed, **given):
    """Return the squared deviations of the best mode's place at 60 s, and its deviations."""
    delays, sensor, place = scene(seed, **given)
    found = locate_vessels(sensors=[sensor], delays=[delays], at=["60"])
    off = np.array([found.east_m[0], found.north_m[0]]) - place
    spread = found.covariance_m2[0]
    return float(off @ np.linalg.solve(spread, off)), np.sqrt(np.diagonal(spread))


if __name__ == "__main__":
    first, count = map(int, sys.argv[1:3])
    for recorders in (3, 4):
        found = [score(first + n, recorders=recorders) for n in range(count)]
        held = sum(distance < HALF_95 for distance, _ in found)
        middle = np.median([np.hypot(*std) for _, std in found])
        print(f"{recorders} recorders: {held} of {count} held, {middle:.1f} m")  # noqa: T201
