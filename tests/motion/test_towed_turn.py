"""Bearings of a towed array count for less until it has passed own ship's turn."""

from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.options import Misfit, MotionModel, Nuisances
from uwtrack_cli.motion.target_motion.own_ship import OwnPath, bend_rad
from uwtrack_cli.motion.tma import estimate_motion

SPEED_MPS, TURN_S, TURN_DEG, TOW_M = 4.0, 300.0, 60.0, 400.0


def ship(time_s):
    """Return east and north of own ship, which turns once, at a corner."""
    before = np.minimum(time_s, TURN_S) * SPEED_MPS
    after = np.maximum(time_s - TURN_S, 0.0) * SPEED_MPS
    angle = np.radians(TURN_DEG)
    return after * np.sin(angle), before + after * np.cos(angle)


def towed(seed, *, rows=180):
    """Return bearings that take the array to lie along own course, and the truth."""
    time = np.linspace(0.0, 900.0, rows)
    target = np.array([[2500.0], [1500.0]]) + np.array([[-3.0], [2.0]]) * time
    east, north = ship(time)
    bearing = np.degrees(np.arctan2(target[0] - east, target[1] - north))
    course = np.where(time < TURN_S, 0.0, TURN_DEG)
    tail = np.stack(ship(time - TOW_M / SPEED_MPS))
    chord = np.degrees(np.arctan2(east - tail[0], north - tail[1]))
    draw = np.random.default_rng(seed).standard_normal(rows)
    unknown = np.full(rows, np.nan)
    series = Series(
        contact=np.ones(rows, np.int64), time_s=time,
        # the angle from the array's head, which is not where own ship points
        bearing_deg=(bearing - chord + course + draw) % 360.0,
        bearing_std_deg=np.ones(rows),
        frequency_hz=np.zeros((rows, 0)), frequency_std_hz=np.zeros((rows, 0)),
        level_db=unknown, level_std_db=unknown,
    )  # fmt: skip
    corners = np.array([-200.0, TURN_S, 1000.0])
    places = ship(corners)
    navigation = Navigation(
        time_s=corners, east_m=places[0], north_m=places[1], heading_deg=np.full(3, np.nan)
    )
    return series, navigation


def as_table(series, heading_deg):
    """Return the bearings as a table of a sensor, each with the other side's."""
    east, north = ship(series.time_s)
    return replace(
        series,
        mirrored_bearing_deg=(2.0 * heading_deg - series.bearing_deg) % 360.0,
        sensor=np.full(series.time_s.size, "towed"),
        sensor_east_m=east, sensor_north_m=north, sensor_id=np.array(["towed"]),
        sensor_compass_std_deg=np.zeros(1), sensor_position_std_m=np.zeros(1),
        origin="grid",
    )  # fmt: skip


@pytest.mark.parametrize(("seed", "is_table"), [(1, False), (2, True)])
def test_a_turn_of_own_ship_does_not_pull_the_course(seed, is_table):
    series, navigation = towed(seed)
    if is_table:
        course = np.where(series.time_s < TURN_S, 0.0, TURN_DEG)
        series, navigation = as_table(series, course), None
    exact = Nuisances(0.0, 0.0, 0.0, 0.0)
    due = np.degrees(np.arctan2(-3.0, 2.0)) % 360.0
    off = {}
    for tow_m in (0.0, TOW_M):
        motions = estimate_motion(
            series, None, navigation, nuisances=exact, updates=1,
            model=MotionModel(tow_length_m=tow_m), misfit=Misfit(loss="squares"),
        )  # fmt: skip
        error = (motions.course_deg[0] - due + 180.0) % 360.0 - 180.0
        off[tow_m] = abs(error), motions.course_std_deg[0]
        if tow_m:
            assert motions.motion_model[0] == "straight"
            assert motions.range_m[0] == pytest.approx(
                np.hypot(2500.0, 1500.0), abs=4.0 * motions.range_std_m[0]
            )
    assert off[TOW_M][0] < 3.0 * off[TOW_M][1]
    assert off[0.0][0] > 3.0 * off[0.0][1] or np.isnan(off[0.0][0])


def test_an_array_whose_own_heading_is_in_the_table_is_taken_at_its_word():
    series, _ = towed(3)
    course = np.where(series.time_s < TURN_S, 0.0, TURN_DEG)
    (east, north), tail = ship(series.time_s), ship(series.time_s - TOW_M / SPEED_MPS)
    chord = np.degrees(np.arctan2(east - tail[0], north - tail[1]))
    right = replace(series, bearing_deg=(series.bearing_deg - course + chord) % 360.0)
    found = [
        estimate_motion(as_table(right, chord), updates=1, model=MotionModel(tow_length_m=tow_m))
        for tow_m in (0.0, TOW_M)
    ]
    assert found[0].range_std_m == found[1].range_std_m
    assert found[0].motion_model[0] == "straight"


def test_the_bend_lasts_until_the_array_has_passed_the_turn():
    path = OwnPath(
        np.array([0.0, 300.0, 900.0]),
        *np.array([ship(t) for t in (0.0, 300.0, 900.0)]).T,
        np.full(3, np.nan),
    )
    time = np.array([100.0, 299.0, 320.0, 390.0, 420.0, 800.0])
    bent = np.degrees(bend_rad(path, time, TOW_M))
    assert bent == pytest.approx([0.0, 0.0, 60.0, 60.0, 0.0, 0.0], abs=1e-6)
    assert np.all(bend_rad(path, time, 0.0) == 0.0)
