"""Vehicles: engines that change gear or wander, and levels that depend on direction."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.nuisance_coverage import holds_on_both_sides
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.encounters import TOO_FAST
from uwtrack_cli.motion.passage.candidates import examine
from uwtrack_cli.motion.passage.checks.known_sounds import mains_of
from uwtrack_cli.motion.passage.fit.directivity import consider_directivity
from uwtrack_cli.motion.passage.fit.estimator import fit_passage, fit_with_coloured_noise
from uwtrack_cli.motion.passage.fit.source_patterns import AHEAD_STD_DB, ALONG_STD_DB, SPREADING_STD
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks

AIR, WATER = Medium(343.0), Medium(1500.0)
CAR = Scene(speed_mps=20.0, range_m=10.0, closest_s=6.0, height_m=0.0, sound_speed_mps=343.0)
TIME = np.arange(0.05, 12.0, 0.05)
RATIO, ANGLE, DISTANCE = received(CAR, TIME, true_motion(CAR))
LEVEL_DB = 10 * np.log10((CAR.range_m / DISTANCE) ** 2 + 1e-2)
REST_HZ = np.array([80.0, 160.0])
LINES = np.arange(1, 3)
NONE = np.full((1, TIME.size), np.nan)


def measured(ratio, level_db=NONE[0], spread=2e-3, seed=3):
    """Lines with a given ratio to their rest frequencies, and the broadband."""
    rng = np.random.default_rng(seed)
    lines = REST_HZ[:, None] * ratio * (1 + spread * rng.standard_normal((2, TIME.size)))
    level = level_db + 0.3 * rng.standard_normal(TIME.size)
    std_hz = np.broadcast_to(spread * REST_HZ[:, None], lines.shape)
    return PassageData(TIME, lines, std_hz, NONE, NONE, level[None], np.full((1, TIME.size), 0.3))


def passage_of(data, medium=AIR):
    return examine(data, (1,), LINES, medium, 1e-3)


def gear_change(lasts_s):
    """An engine that runs a quarter slower after half a turn of a sine."""
    turn = np.pi * np.clip((TIME - 6.0) / lasts_s, -0.5, 0.5)
    return np.exp(-0.125 * (1 + np.sin(turn)))


@pytest.fixture(scope="module")
def car():
    return passage_of(measured(RATIO))


def test_sound_in_air_is_no_passage_in_water():
    """A car of 35 m/s would have 153 m/s there; one of 20 m/s has 87 and may be told."""
    fast = Scene(speed_mps=35.0, range_m=10.0, closest_s=6.0, height_m=0.0, sound_speed_mps=343.0)
    ratio = received(fast, TIME, true_motion(fast))[0]
    in_water, in_air = (passage_of(measured(ratio), one) for one in (WATER, AIR))
    assert in_water.rejection.code == TOO_FAST
    assert "--sound-speed-mps 343" in in_water.rejection.sentence
    assert TOO_FAST not in dict(in_air.decision.nepers)
    racing = dict(in_air.decision.nepers)["unusual-speed"]
    assert racing == 0.0  # vehicles are as fast
    slow = passage_of(measured(RATIO), WATER)
    assert slow.fit.theta[0, 2] > 80.0
    odds = [dict(one.decision.nepers)[TOO_FAST] for one in (in_water, slow)]
    assert odds[0] < odds[1] < -1.0


def test_mains_that_wander_are_told_from_a_generator_on_board():
    """A grid stays within 1e-3; a vessel's shifts by v/c, here of 3 m/s, or is 0.5 % off."""
    lag = np.linspace(-5, 5, 200)
    orders = np.array([12.0, 16.0, 19.0])
    wander, passage = 4e-4 * np.sin(lag), 2e-3 * lag / np.hypot(1, lag)
    for mains_hz in (50.0, 60.0):
        hum, board = (list(mains_hz * orders[:, None] * (1 - shift)) for shift in (wander, passage))
        assert mains_of(hum)[0] == mains_hz
        assert mains_of(hum)[1] < 1e-3
        assert mains_of(board) is None
        assert mains_of([1.005 * line for line in hum]) is None
        assert mains_of([*hum, hum[0] + 7.0]) is None
        # one line of a vessel is there by chance
        assert mains_of(hum[-1:])[1] > 1e-2


def test_a_change_of_gear_is_no_passage():
    assert passage_of(measured(gear_change(0.4))) is None


def test_a_car_is_a_passage_beside_all_changes_of_gear(car):
    found = car
    assert found.fit.theta[0, 2] == pytest.approx(
        20.0, abs=3 * np.sqrt(found.fit.covariance[0, 2, 2])
    )
    assert found.fit.range_over_speed_s[0] == pytest.approx(0.5, abs=0.05)


NEAR = (CAR.range_m / DISTANCE) ** 2
PATTERNS_DB = np.array([
    AHEAD_STD_DB * np.sin(ANGLE), ALONG_STD_DB * np.sin(ANGLE) ** 2,
    SPREADING_STD * 10 * np.log10(NEAR),
])  # fmt: skip


def fit_of(level_db, medium=AIR, lines_hz=None):
    """The optimum of levels, and of lines where they are given."""
    data = measured(RATIO, level_db)
    if lines_hz is None:
        data = replace(data, frequency_hz=np.full_like(data.frequency_hz, np.nan))
    else:
        data = replace(data, frequency_hz=lines_hz)
    blocks = make_blocks(data)
    start = np.array([[6.0, np.log(0.5), 20.0 * (lines_hz is not None), np.log(1e-2)]])
    for _ in range(3):
        fit = fit_passage(blocks, start, np.ones(1), medium, with_coloured_noise=False)
        start = fit.theta
    return fit, blocks


def test_what_is_considered_is_what_patterns_do_to_a_fit():
    """A little of each pattern, put into the levels, moves the answer by as little."""
    share = 0.05
    fit, blocks = fit_of(LEVEL_DB)
    moved = []
    for pattern_db in PATTERNS_DB:
        power = NEAR * 10 ** (share * pattern_db / 10)
        other, _ = fit_of(10 * np.log10(power + 1e-2))
        moved.append([
            other.theta[0, 0] - fit.theta[0, 0],
            other.range_over_speed_s[0] - fit.range_over_speed_s[0],
        ])  # fmt: skip
    wider = consider_directivity(fit, blocks)
    added = np.diag(wider.covariance[0] - fit.covariance[0])[:2]
    due = (np.square(moved) / share**2).sum(axis=0)
    np.testing.assert_allclose(np.sqrt(added), np.sqrt(due), rtol=0.1)
    assert (np.sqrt(added) > 0.05).all()


def test_in_water_and_beside_lines_nothing_is_considered():
    fit, blocks = fit_of(LEVEL_DB)
    in_water = replace(fit, medium=WATER)
    assert consider_directivity(in_water, blocks) is in_water
    fit, blocks = fit_of(LEVEL_DB, lines_hz=REST_HZ[:, None] * RATIO)
    assert consider_directivity(fit, blocks) is fit


@pytest.mark.slow
@pytest.mark.parametrize("is_one_sided", [True, False])
def test_lines_beside_a_level_of_unknown_pattern_are_as_wrong_as_stated(is_one_sided):
    """Neither more nor less, where patterns are drawn; without them, several times."""
    errors = []
    for seed in range(12):
        rng = np.random.default_rng([seed, is_one_sided])
        noise = 2e-3 * rng.standard_normal((2, TIME.size))
        lines = REST_HZ[:, None] * RATIO * (1 + noise)
        if is_one_sided:
            lines[:, TIME < 5.7] = np.nan
        pattern_db = rng.standard_normal(3) @ PATTERNS_DB
        level_db = 10 * np.log10(NEAR * 10 ** (pattern_db / 10) + 1e-2)
        level_db += 0.5 * rng.standard_normal(TIME.size)
        white, blocks = fit_of(level_db, lines_hz=lines)
        errors += [
            np.array(
                [fit.theta[0, 0] - 6.0, fit.range_over_speed_s[0] - 0.5, fit.theta[0, 2] - 20.0]
            )
            / np.sqrt(np.diag(fit.covariance[0])[:3])
            for fit in (white, fit_with_coloured_noise(white, blocks))
        ]
    assert np.mean(np.square(errors[::2]), axis=0).max() > 4.0
    assert holds_on_both_sides(errors[1::2])
