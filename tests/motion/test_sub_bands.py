"""The parts of the band: one passage, or something else that is loud for a while."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

from tests.draws.passage_truth import Scene
from tests.motion.passing_vessel import frames_of, lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.checks.sub_bands import (
    ENOUGH_SUB_BANDS,
    Rise,
    _exceeded,
    agreement,
    is_one_with_fringes,
)
from uwtrack_cli.motion.passage.checks.surface_image import find_image

TIME = np.arange(240) + 0.5
PLACE_S, WIDTH_S = 120.0, 8.0
LAG = (TIME - PLACE_S) / WIDTH_S
LAW = 1 / (1 + LAG**2)
RATIO_DB = (16.0, 14.0, 12.0, 12.0, 10.0, 10.0, 8.0, 8.0)
"""Height of the rise in each part at the closest approach."""
N_CELLS = 60.0
"""Independent cells behind a level: it deviates by 13 %."""


def levels_of(power, seed=1):
    """Levels whose parts have a power over the quiet time, shape (part, n)."""
    rng = np.random.default_rng(seed)
    measured = power * rng.gamma(N_CELLS, 1 / N_CELLS, power.shape)
    whole = measured.mean(axis=0)
    none = np.full(TIME.size, np.nan)
    return Levels(
        frames=frames_of(TIME.size),
        level_db=10 * np.log10(whole),
        excess_db=10 * np.log10(whole),
        excess_std_db=np.full(TIME.size, 4.34 / np.sqrt(8 * N_CELLS)),
        tilt_db=np.zeros(TIME.size),
        bearing_deg=none,
        bearing_std_deg=none,
        part_excess_db=10 * np.log10(measured.T),
        band_low_hz=100.0,
        band_high_hz=900.0,
        reference="1 uPa",
    )


def heights():
    return 10 ** (np.array(RATIO_DB)[:, None] / 10)


def encounters(levels):
    return find_encounters(None, levels, Sensor(id="h1"))


def test_a_passage_is_one_in_every_part_of_the_band():
    levels = levels_of(1 + heights() * LAW)
    told = agreement(levels, PLACE_S, WIDTH_S)
    assert told.is_passage
    assert told.n_parts == len(RATIO_DB)
    (row,) = encounters(levels).status.tolist()
    assert row == "level-only"


RANGE_M, SENSOR_M, SOURCE_M, SOUND_MPS = 110.0, 28.0, 6.0, 1500.0
EDGES_HZ = np.linspace(100.0, 900.0, len(RATIO_DB) + 1)


def reflected(share):
    """Power of direct and reflected sound in each part, summed over its frequencies."""
    aside = np.hypot(RANGE_M, RANGE_M * LAG)
    direct = np.hypot(aside, SENSOR_M - SOURCE_M)
    image = np.hypot(aside, SENSOR_M + SOURCE_M)
    rows = []
    for low, high in pairwise(EDGES_HZ):
        wave = 2 * np.pi * np.linspace(low, high, 101)[:, None] / SOUND_MPS
        field = np.exp(-1j * wave * direct) / direct
        field = field - share * np.exp(-1j * wave * image) / image
        rows.append((np.abs(RANGE_M * field) ** 2).mean(axis=0))
    return np.array(rows)


def test_parts_with_the_fringes_of_one_reflection_are_one_passage():
    """No part has the law by itself; all have the delay of the image's path."""
    power = 1 + heights() * reflected(0.8)
    levels = levels_of(power)
    told = agreement(levels, PLACE_S, WIDTH_S)
    assert told.is_passage
    assert told.n_parts > ENOUGH_SUB_BANDS
    edges = np.array(list(pairwise(EDGES_HZ)))
    measured = 10 ** (levels.part_excess_db.T / 10)
    usual, ground = np.maximum(power, 1.0), np.ones((1, TIME.size))
    found = find_image(LAG, measured, usual, ground, edges)
    longer = np.hypot(RANGE_M, SENSOR_M + SOURCE_M)
    delay_s = (longer - np.hypot(RANGE_M, SENSOR_M - SOURCE_M)) / SOUND_MPS
    assert found.delay_s == pytest.approx(delay_s, rel=0.05)
    assert found.strength < -0.6


def test_what_is_not_reflected_has_no_fringes():
    edges, ground = np.array(list(pairwise(EDGES_HZ))), np.ones((1, TIME.size))
    for seed, made in enumerate((rain, squall, gain, reflected)):
        power = 1 + heights() * (made() if made is not reflected else reflected(0.0))
        measured = 10 ** (levels_of(power, seed).part_excess_db.T / 10)
        assert find_image(LAG, measured, power, ground, edges) is None


def test_a_rise_with_fringes_is_one_passage_and_two_passages_are_two():
    own, halves = Rise(PLACE_S, WIDTH_S), [
        Rise(PLACE_S + side * 0.6 * WIDTH_S, 0.5 * WIDTH_S) for side in (-1, 1)
    ]  # fmt: skip
    fringed = levels_of(1 + heights() * reflected(0.8))
    assert is_one_with_fringes(fringed, own, halves)
    laws = [1 / (1 + ((TIME - one.time_s) / one.width_s) ** 2) for one in halves]
    assert not is_one_with_fringes(levels_of(1 + heights() * sum(laws)), own, halves)


def test_a_rise_that_the_recording_ends_in_may_be_a_drift():
    levels = levels_of(1 + heights() / (1 + ((TIME - 235.0) / WIDTH_S) ** 2))
    told = agreement(levels, 235.0, WIDTH_S)
    assert told.flank == pytest.approx((TIME[-1] - 235.0) / WIDTH_S)
    assert not told.is_passage
    assert encounters(levels).n_encounters == 0


@pytest.mark.parametrize("kind", ["turning", "steady"])
def test_bearings_stand_for_the_parts_only_where_they_turn(kind):
    """One gain for all parts is none of a passage; a bearing that turns shows one."""
    gain = 1 + 10 * np.clip(1 - np.abs(LAG) / 2, 0, None)
    bearing = np.degrees(np.arctan(LAG)) if kind == "turning" else 0.0 * LAG
    rng = np.random.default_rng(3)
    levels = replace(
        levels_of(np.repeat(gain[None], len(RATIO_DB), axis=0)),
        bearing_deg=(bearing + 4.0 * rng.standard_normal(TIME.size)) % 360.0,
        bearing_std_deg=np.full(TIME.size, 4.0),
    )
    found = find_encounters(None, levels, Sensor(id="h1", kind="difar"))
    assert found.n_encounters == (1 if kind == "turning" else 0)


def test_the_chance_of_disagreement_is_that_of_chi_square():
    """Under the law the probability of a larger chi-square is even, or larger: the law's
    own deviation makes it so."""
    chances = [
        agreement(levels_of(1 + heights() * LAW, seed), PLACE_S, WIDTH_S).probability
        for seed in range(6)
    ]
    assert min(chances) > 0.01
    scipy_says = chi2.sf([1.0, 9.0, 30.0], [2, 6, 14])
    ours = [_exceeded(*pair) for pair in ((1.0, 2), (9.0, 6), (30.0, 14))]
    np.testing.assert_allclose(ours, scipy_says, rtol=1e-9)


def rain():
    """White above the middle of the band alone."""
    return heights() * np.array([0, 0, 0, 0, 0, 1, 1, 1])[:, None] * LAW


def parts_apart():
    """Each part rises at a time of its own: several sources, or none that passes."""
    place = PLACE_S + np.array([-16, 12, -8, 16, 8, -12, 4, -20])[:, None]
    return heights() / (1 + ((TIME - place) / WIDTH_S) ** 2)


def gust():
    return heights() * np.where(np.abs(LAG) < 2, np.cos(np.pi * LAG / 4) ** 2, 0.0)


def squall():
    ramps = np.minimum(1 + 2 * LAG, 1 - 0.5 * LAG)
    return heights() * np.clip(ramps, 0.0, 1.0)


def bell():
    """A squall whose level is a bell in decibels, and goes slower than it comes."""
    level_db = 15 * np.exp(-((LAG / np.where(LAG < 0, 1.3, 2.4)) ** 2))
    return 0.3 * heights() * (10 ** (level_db / 10) - 1) / (10**1.5 - 1)


def gain():
    """The recorder turns everything up by 12 dB and down again."""
    swing = np.where(np.abs(LAG) < 2, np.cos(np.pi * LAG / 4) ** 2, 0.0)
    return np.ones((8, 1)) * (10 ** (1.2 * swing) - 1)


def drift():
    """The ambient sound drifts, straight in decibels between some moments."""
    level_db = np.interp(TIME, [0, 70, 105, 118, 140, 170, 240], [0, 1, 6, 9, 2, 0, 1])
    return np.ones((8, 1)) * (10 ** (level_db / 10) - 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "rival"),
    [(rain, ""), (gust, ""), (bell, "a squall that goes slowly"), (drift, "one gain for all")],
)
def test_what_is_loud_for_a_while_is_no_passage(made, rival):
    levels = levels_of(1 + made())
    told = agreement(levels, PLACE_S, WIDTH_S)
    assert not told.is_passage
    assert not rival or told.rival == rival
    assert encounters(levels).n_encounters == 0


def test_a_passage_is_asked_beside_what_else_passes():
    """The flank of another is none of its own rise."""
    other = Rise(PLACE_S + 2.5 * WIDTH_S, WIDTH_S)
    law = 1 / (1 + ((TIME - other.time_s) / other.width_s) ** 2)
    levels = levels_of(1 + heights() * LAW + 20.0 * heights()[::-1] * law)
    assert agreement(levels, PLACE_S, WIDTH_S, [other]).is_passage
    assert agreement(levels, PLACE_S, WIDTH_S).is_passage is False


def test_one_squall_is_not_told_as_passages_beside_each_other():
    begin, rise, fall = PLACE_S - 2 * WIDTH_S, 2 * WIDTH_S, 6 * WIDTH_S
    risen = np.clip((TIME - begin) / rise, 0, 1)
    left = np.clip((begin + rise + fall - TIME) / fall, 0, 1)
    share = np.sin(0.5 * np.pi * np.minimum(risen, left)) ** 2
    others = [Rise(PLACE_S + k * 1.5 * WIDTH_S, WIDTH_S) for k in (-1, 1, 2)]
    levels = levels_of(1 + heights() * share)
    told = agreement(levels, PLACE_S, WIDTH_S, others)
    assert told.rival == "one squall"
    assert not told.is_passage


def test_parts_that_rise_apart_are_no_passage():
    told = agreement(levels_of(1 + parts_apart()), PLACE_S, WIDTH_S)
    assert told.probability < 0.01


@pytest.mark.slow
def test_a_bearing_that_turns_needs_no_parts():
    """Of a vector sensor the bearings tell that something passes."""
    levels = levels_of(1 + rain())
    turned = replace(
        levels,
        bearing_deg=90.0 + np.degrees(np.arctan(LAG)),
        bearing_std_deg=np.full(TIME.size, 3.0),
    )
    assert encounters(turned).n_encounters == 1


def test_levels_of_an_older_product_are_taken_as_they_are():
    levels = replace(levels_of(1 + heights() * LAW), part_excess_db=None)
    assert agreement(levels, PLACE_S, WIDTH_S) is None
    assert encounters(levels).n_encounters == 1


def test_few_frames_or_parts_are_no_passage():
    levels = levels_of(1 + heights() * LAW)
    few = replace(levels, part_excess_db=levels.part_excess_db[:, : int(ENOUGH_SUB_BANDS) - 1])
    assert not agreement(few, PLACE_S, WIDTH_S).is_passage
    assert agreement(levels, PLACE_S, 0.5).n_parts == 0


CROSSING = Scene(speed_mps=6.0, range_m=60.0, closest_s=118.0, length_s=240.0, rest_hz=(120.0,))


@pytest.mark.slow
@pytest.mark.parametrize(("late_s", "n_found"), [(0.0, 1), (45.0, 0)])
def test_a_line_and_a_rise_that_are_in_doubt_are_judged_together(late_s, n_found):
    """A line whose level hardly follows, and a rise in three parts of eight: each by
    itself is none, and both are a passage where they tell the same one."""
    lines = lines_of_scenes([CROSSING], np.random.default_rng(2), has_bearing=False)
    mean = lines.measured_level_db.mean()
    flat = mean + 0.4 * (lines.measured_level_db - mean)
    lines = replace(lines, measured_level_db=flat)
    width_s = CROSSING.range_m / CROSSING.speed_mps
    heard_s = CROSSING.closest_s + CROSSING.range_m / CROSSING.sound_speed_mps
    law = 1 / (1 + ((TIME - heard_s - late_s) / width_s) ** 2)
    share = np.array([0, 0, 0, 0, 0, 1, 1, 1])[:, None]
    levels = levels_of(1 + 4 * heights() * share * law)
    sensor = Sensor(id="h1")
    assert find_encounters(lines, None, sensor).n_encounters == 0
    assert encounters(levels).n_encounters == 0
    found = find_encounters(lines, levels, sensor)
    assert found.n_encounters == n_found
    if n_found:
        assert found.status.tolist() == ["ok"]
        off = abs(found.speed_mps[0] - CROSSING.speed_mps)
        assert off < 3 * found.speed_std_mps[0]
