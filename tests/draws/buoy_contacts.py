"""Boats heard by drifting buoys, each of which numbers its contacts on its own.

`python -m tests.draws.buoy_contacts BOATS SEED COUNT [frequencies] [alter] [no_bearings]`
prints how many contacts are paired right, and how many of the ellipses of `locate` hold the
boats.
"""

import sys
import warnings
from itertools import combinations
from time import process_time
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import UwtrackNote
from uwtrack_cli.motion.locate import locate_vessels

HALF_95 = 5.99
"""Squared deviations of an ellipse of 95 %."""


def scene(seed, *, boats=2, buoys=4, rows=40, std_deg=4.0, miss=0.1, frequencies=False,
          alter=False, drift_mps=0.2, no_bearings=False):  # fmt: skip
    """Return a table, its truth and the places of the boats at 600 s, shape (boats, 2).

    The truth is the boat of every sensor and number. Each buoy misses a contact with a
    probability, and numbers those that it hears at random from 1 to 9. With frequencies
    every boat has a line, near that of the others. Without bearings that line is all.
    """
    frequencies = frequencies or no_bearings
    draw = np.random.default_rng(seed)
    turn = np.radians(360.0 / buoys * np.arange(buoys) + draw.uniform(-20, 20, buoys))
    out = draw.uniform(700, 2100, buoys)
    start = np.stack([out * np.sin(turn), out * np.cos(turn)], -1)
    drift = draw.normal(0, drift_mps, (buoys, 2))
    time = np.linspace(0.0, 1200.0, rows)
    offset = draw.normal(0.0, 5.0, buoys)
    rest_hz = 60.0 * (1.0 + draw.uniform(-0.05, 0.05, boats))
    columns = {name: [] for name in ("contact", "time_s", "sensor", "own", "theta", "f")}
    boat_of, places = {}, []
    numbers = [draw.permutation(np.arange(1, 10))[:boats] for _ in range(buoys)]
    for boat in range(boats):
        course, speed = draw.uniform(0, 2 * np.pi), draw.uniform(1.0, 5.0)
        velocity = speed * np.array([np.sin(course), np.cos(course)])
        middle = draw.uniform(-1500, 1500, 2)
        way = middle + (time - 600.0)[:, None] * velocity
        rate = np.broadcast_to(velocity, way.shape)
        if alter:
            change = draw.normal(0.0, 2.0, 2)
            at = draw.uniform(300.0, 900.0)
            way = way + np.maximum(time - at, 0.0)[:, None] * change
            rate = rate + (time > at)[:, None] * change
        places.append([np.interp(600.0, time, axis) for axis in way.T])
        for buoy in range(buoys):
            if draw.random() < miss:
                continue
            own = start[buoy] + time[:, None] * drift[buoy]
            away = way - own
            bearing = np.degrees(np.arctan2(*away.T)) + offset[buoy]
            bearing = bearing + std_deg * draw.standard_normal(rows)
            closing = ((rate - drift[buoy]) * away).sum(1) / np.hypot(*away.T)
            tone = rest_hz[boat] * (1.0 - closing / 1500.0)
            tone = tone + 0.02 * draw.standard_normal(rows)
            number = int(numbers[buoy][boat])
            boat_of[f"b{buoy}", number] = boat
            columns["contact"] += [number] * rows
            columns["time_s"] += time.tolist()
            columns["sensor"] += [f"b{buoy}"] * rows
            columns["own"] += own.tolist()
            columns["theta"] += bearing.tolist()
            columns["f"] += tone.tolist()
    count = len(columns["time_s"])
    own = np.reshape(columns["own"], (count, 2))
    unknown = np.full(count, np.nan)
    tone = np.array(columns["f"])[:, None] if frequencies else np.zeros((count, 0))
    order = np.argsort(columns["time_s"], kind="stable")
    series = Series(
        contact=np.array(columns["contact"], np.int64),
        time_s=np.array(columns["time_s"]),
        bearing_deg=unknown if no_bearings else np.array(columns["theta"]) % 360.0,
        bearing_std_deg=unknown if no_bearings else np.full(count, std_deg),
        frequency_hz=tone,
        frequency_std_hz=np.full(tone.shape, 0.02),
        level_db=unknown,
        level_std_db=unknown,
        sensor=np.array(columns["sensor"]),
        sensor_east_m=own[:, 0],
        sensor_north_m=own[:, 1],
        sensor_id=np.array([f"b{k}" for k in range(buoys)]),
        sensor_compass_std_deg=np.full(buoys, 5.0),
        sensor_position_std_m=np.zeros(buoys),
        origin="grid",
    ).take("row", order)
    return series, boat_of, np.array(places)


def pairs_of(boat_of, members):
    """Return pairs of contacts rightly joined, and those of one boat or said to be one.

    ``members``: sensor/number of every contact that was found.
    """
    said = {one: n for n, text in enumerate(members) for one in text.split()}
    named = {f"{sensor}/{number}": boat for (sensor, number), boat in boat_of.items()}
    right = count = 0
    for one, other in combinations(named, 2):
        is_same, is_said = named[one] == named[other], said[one] == said[other]
        count += is_same or is_said
        right += is_same and is_said
    return right, count


class Score(NamedTuple):
    """What `locate` made of one scene."""

    right: int
    pairs: int
    held: int
    """Ellipses that hold the boat that most of their contacts are of."""
    ellipses: int
    due: int
    """Boats that two buoys hear or more."""
    seconds: float


def score(seed, **given):
    """Locate the boats of one scene."""
    series, boat_of, places = scene(seed, **given)
    begin = process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackNote)
        found = locate_vessels(series=series, at=["600"])
    seconds = process_time() - begin
    if found.pairing_contact is None:  # one buoy alone hears anything
        return Score(0, 0, 0, 0, 0, seconds)
    members = {
        int(n): [f"{s}/{k}" for c, s, k, p in zip(
            found.pairing_contact, found.pairing_sensor, found.pairing_number,
            found.pairing_share, strict=True) if c == n and p > 0.5]
        for n in np.unique(found.pairing_contact)
    }  # fmt: skip
    right, pairs = pairs_of(boat_of, [" ".join(m) for m in members.values()])
    held = ellipses = 0
    for row in np.flatnonzero(found.mode == 1):
        own = members.get(int(found.contact[row]), [])
        boats = [boat_of[s, int(k)] for s, k in (one.split("/") for one in own)]
        if not boats:  # a further source of its rows
            boats = [-1]
        boat = max(set(boats), key=boats.count)
        ellipses += 1
        if boat < 0:
            continue
        off = np.array([found.east_m[row], found.north_m[row]]) - places[boat]
        held += bool(off @ np.linalg.solve(found.covariance_m2[row], off) < HALF_95)
    heard = list(boat_of.values())
    due = sum(heard.count(boat) > 1 for boat in range(len(places)))
    return Score(right, pairs, held, ellipses, due, seconds)


if __name__ == "__main__":
    boats, first, count = map(int, sys.argv[1:4])
    given = dict.fromkeys(sys.argv[4:], True)
    total = np.zeros(len(Score._fields))
    for seed in range(first, first + count):
        one = score(seed, boats=boats, **given)
        total += one
        if one.right < one.pairs or one.held < one.ellipses or one.ellipses < one.due:
            print(seed, one, flush=True)  # noqa: T201
    print(dict(zip(Score._fields, total.tolist(), strict=True)))  # noqa: T201
