"""Tables of bearings of several drifting sensors, with offsets and strange bearings."""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.series import Series


def buoys(seed, *, n=4, rows=60, std_deg=8.0, strange=0.1, moving=True,
          speeds_mps=(1.0, 5.0), of_another=0.0):  # fmt: skip
    """Return a table of drifting buoys, and the truth: place and velocity at time 0.

    A source that moves has a speed drawn uniformly from a span, m/s. A share of the rows
    may be strange, from anywhere, and another one of a second boat that passes.
    """
    draw = np.random.default_rng(seed)
    turn = np.radians(360.0 / n * np.arange(n) + draw.uniform(-20, 20, n))
    out = draw.uniform(700, 2100, n)
    start = np.stack([out * np.sin(turn), out * np.cos(turn)], -1)
    drift = draw.normal(0, 0.2, (n, 2))
    course = draw.uniform(0, 2 * np.pi)
    speed = draw.uniform(*speeds_mps) if moving else 0.0
    velocity = speed * np.array([np.sin(course), np.cos(course)])
    place = draw.uniform(-800, 800, 2) - 600.0 * velocity
    time = np.repeat(np.linspace(0, 1200, rows), n)
    which = np.tile(np.arange(n), rows)
    own = start[which] + drift[which] * time[:, None]
    way = place + velocity * time[:, None] - own
    offset = draw.uniform(-15, 15, n)
    bearing = np.degrees(np.arctan2(*way.T)) + offset[which]
    bearing += std_deg * draw.standard_normal(time.size)
    wrong = draw.random(time.size) < strange
    bearing[wrong] = draw.uniform(0, 360, np.count_nonzero(wrong))
    if of_another:
        course, speed = draw.uniform(0, 2 * np.pi), draw.uniform(1, 5)
        other = speed * np.array([np.sin(course), np.cos(course)])
        there = draw.uniform(-1500, 1500, 2) + other * (time - 600.0)[:, None] - own
        theirs = ~wrong & (draw.random(time.size) < of_another)
        heard = np.degrees(np.arctan2(*there.T)) + offset[which]
        heard += std_deg * draw.standard_normal(time.size)
        bearing[theirs] = heard[theirs]
        wrong |= theirs
    unknown = np.full(time.size, np.nan)
    names = np.array([f"b{i}" for i in range(n)])
    series = Series(
        contact=np.ones(time.size, np.int64),
        time_s=time,
        bearing_deg=bearing % 360.0,
        bearing_std_deg=np.full(time.size, std_deg),
        frequency_hz=np.zeros((time.size, 0)),
        frequency_std_hz=np.zeros((time.size, 0)),
        level_db=unknown,
        level_std_db=unknown,
        sensor=names[which],
        sensor_east_m=own[:, 0],
        sensor_north_m=own[:, 1],
        sensor_id=names,
        sensor_compass_std_deg=np.full(n, 15.0 / np.sqrt(3.0)),
        sensor_position_std_m=np.zeros(n),
        origin="grid",
        contact_numbers="common",
    )
    return series, place, velocity, wrong


def untold(series):
    """Return a table of which no deviation is known."""
    return replace(
        series,
        bearing_std_deg=np.full(series.time_s.size, np.nan),
        sensor_compass_std_deg=np.full(len(series.sensor_id), np.nan),
    )
