"""A target that turns or changes its speed is told, a straight one is not suspected."""

from dataclasses import replace

import numpy as np
import pytest

from tests.motion.sonar_tables import heard, own_ship
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.motion.options import MotionModel, Nuisances
from uwtrack_cli.motion.tma import estimate_motion
from uwtrack_cli.studies.tma_scenarios import (
    COUNT,
    REST_HZ,
    SOUND_SPEED_MPS,
    STEP_S,
    TARGETS,
    make_scenario,
)

TURN_S = STEP_S * 500


def seen(place, own):
    relative = place - own
    distance = np.hypot(*relative.T)
    rate = np.diff(distance) / STEP_S
    bearing = np.degrees(np.arctan2(relative[1:, 0], relative[1:, 1]))
    return bearing, REST_HZ * (1 - rate / SOUND_SPEED_MPS)


def turning(name, turn_deg, faster_kn, noise):
    """The published scenario, its target with another velocity from the middle on."""
    scenario = make_scenario(name)
    time = STEP_S * np.arange(-1, COUNT)
    course, start = np.radians([scenario.course_deg, scenario.bearing_deg])
    before = scenario.speed_mps * np.array([np.sin(course), np.cos(course)])
    speed, course = (
        scenario.speed_mps + faster_kn * KNOT_MPS, course + np.radians(turn_deg)
    )  # fmt: skip
    after = speed * np.array([np.sin(course), np.cos(course)])
    place = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = place + time[:, np.newaxis] * before
    place += np.maximum(time - TURN_S, 0.0)[:, np.newaxis] * (after - before)
    bearing, frequency = seen(
        place, np.stack([scenario.own_east_m, scenario.own_north_m], axis=1)
    )
    draw = np.random.default_rng(3).standard_normal((2, COUNT))
    return replace(
        heard(name, noise=noise),
        bearing_deg=(bearing + noise * draw[0]) % 360.0,
        frequency_hz=(frequency + 0.25 * noise * draw[1])[:, np.newaxis],
    )


def motions_of(series, name):
    return estimate_motion(
        series, None, own_ship(name), sound_speed_mps=SOUND_SPEED_MPS, updates=1,
        model=MotionModel(doppler="interval"), nuisances=Nuisances(0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize("name", TARGETS)
def test_a_straight_target_is_not_suspected(name):
    motions = motions_of(heard(name), name)
    assert motions.reading.tolist() == ["straight"] * motions.mode.size
    assert motions.manoeuvre_gain[0] < 13.0
    assert np.isnan(motions.manoeuvre_time_s).all()


@pytest.mark.parametrize(
    ("turn_deg", "faster_kn", "noise"),
    [(10.0, 0.0, 1.0), (0.0, 1.0, 1.0), (90.0, 0.0, 1.0), (30.0, 0.0, 5.0)],
)
def test_a_target_that_changes_its_velocity_is_told_and_its_state_is_not_given(
    turn_deg, faster_kn, noise
):
    motions = motions_of(turning("S1-T1", turn_deg, faster_kn, noise), "S1-T1")
    assert set(motions.reading) == {"manoeuvre"}
    # a turn of ten degrees at one sigma: the published gain is 160
    assert motions.manoeuvre_gain[0] > 20.0
    if turn_deg < 90.0:
        assert motions.manoeuvre_time_s[0] == pytest.approx(TURN_S, abs=600.0)
    for name in ("range_m", "speed_mps", "course_deg", "now_range_m", "range_low_m"):
        assert np.isnan(getattr(motions, name)).all()
    assert "manoeuvre, state not given" in motions.reasons(0)["range_m"]
    assert not motions.manoeuvre_needed[0]
