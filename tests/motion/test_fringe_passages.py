"""Closest approaches by fringes: drawn images of a surface and a channel, and none.

Rates over many draws: tests/draws/fringe_rates.py.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.fringe_rates import MACH, draw_nothing
from tests.draws.fringe_sounds import draw_power, fringes_of, scene
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.association import PassageReport
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.evidence.fringes import FringeEvidence, evidence_of_levels, fringe_passages


@pytest.fixture(scope="module", params=[True, False], ids=["deep", "shallow"])
def passing(request):
    frequency, power, ship = draw_power(21, is_deep=request.param)
    sensor_m = scene(21, is_deep=request.param)[2].sensor_m
    width_s = ship.slant_m(sensor_m) / ship.speed_mps
    return fringes_of(frequency, power), ship.time_s, width_s


@pytest.mark.slow
def test_a_vessel_without_a_line_is_told_by_its_fringes(passing):
    fringes, time_s, width_s = passing
    table = find_encounters(fringes=fringes)
    assert table.status.tolist() == ["no-speed"]
    assert table.probability[0] > 0.9
    assert np.isnan(table.speed_mps[0])
    off_s = table.time_s[0] - time_s, table.range_over_speed_s[0] - width_s
    std_s = table.time_std_s[0], table.range_over_speed_std_s[0]
    assert abs(off_s[0]) < min(4.0 * std_s[0], 0.05 * width_s)
    assert abs(off_s[1]) < 4.0 * std_s[1]
    assert std_s[0] < 0.05 * width_s


@pytest.mark.slow
def test_bands_as_wide_as_half_of_what_is_heard_are_enough():
    # 4.6 kHz from one dark band to the next: rows that bend as they like explain them all
    frequency, power, ship = draw_power(9016, is_deep=True)
    sensor_m = scene(9016, is_deep=True)[2].sensor_m
    width_s = ship.slant_m(sensor_m) / ship.speed_mps
    (one,) = fringe_passages(fringes_of(frequency, power), MACH)
    assert one.panel.bend < 10.0
    std_s = np.sqrt(np.diag(one.covariance))
    assert abs(one.passage.time_s - ship.time_s) < 3.0 * std_s[0]
    assert abs(one.passage.width_s - width_s) < 3.0 * std_s[1]


def test_proposals_gain_most_at_the_passage(passing):
    fringes, time_s, width_s = passing
    evidence = FringeEvidence(fringes, MACH)
    places_s, gain = evidence.gains(width_s)
    near = np.abs(places_s - time_s) < 0.25 * width_s
    far = np.abs(places_s - time_s) > 2.0 * width_s
    assert gain[near].max() > max(20.0, 3.0 * gain[far].max())


@pytest.mark.slow
def test_a_line_of_the_vessel_hides_nothing_of_its_fringes():
    frequency, power, ship = draw_power(6000, is_deep=True)
    sensor_m = scene(6000, is_deep=True)[2].sensor_m
    width_s = ship.slant_m(sensor_m) / ship.speed_mps
    time_s = (np.arange(len(power)) + 1.0) * 0.25
    # 30 dB in 1 Hz, in the three bins of a window's line, at the edge of the band
    level = 1000.0 / (1.0 + ((time_s - ship.time_s) / width_s) ** 2)
    near = np.flatnonzero(np.abs(frequency - 104.0) < 3.0)
    power[:, near] += level[:, None] * power[:, near].mean(axis=0) * [0.1, 0.3, 0.1]
    (one,) = fringe_passages(fringes_of(frequency, power), MACH)
    assert abs(one.passage.width_s / width_s - 1.0) < 0.05


@pytest.mark.slow
def test_a_later_recording_has_its_passage_later():
    frequency, power, _ = draw_power(22, is_deep=True)
    fringes = fringes_of(frequency, power)
    later = replace(fringes, time_s=fringes.time_s + 1000.0)
    (one,), (other,) = (fringe_passages(each, MACH) for each in (fringes, later))
    assert other.passage.time_s - one.passage.time_s == pytest.approx(1000.0, abs=1e-3)
    assert other.passage.width_s == pytest.approx(one.passage.width_s, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("rain", 21),
        ("throttle", 21),
        ("leaving ship", 21),
        ("swinging machine", 7194),
        ("leaving ship", 9094),
    ],
)
def test_nothing_is_told_where_nothing_passes(kind, seed):
    assert fringe_passages(draw_nothing(kind, seed), MACH) == []


@pytest.fixture(scope="module")
def evident():
    """Return the image of a vessel over deep water, who she is, and her sensor."""
    frequency, power, ship = draw_power(104, is_deep=True)
    sensor_m = scene(104, is_deep=True)[2].sensor_m
    sensor = Sensor(id="h1", depth_m=sensor_m, depth_std_m=0.5)
    return fringes_of(frequency, power), ship, sensor


def test_the_surface_image_gives_range_and_speed_by_the_prior_of_the_depth(evident):
    fringes, ship, sensor = evident
    table = find_encounters(fringes=fringes, sensor=sensor)
    (range_m,), (std_m,) = table.slant_range_m, table.slant_range_std_m
    assert abs(range_m - ship.slant_m(sensor.depth_m)) < 2.0 * std_m
    assert abs(table.speed_mps[0] - ship.speed_mps) < 2.0 * table.speed_std_mps[0]
    assert 0.2 < std_m / range_m < 0.5  # no line: the prior is wide
    assert np.isnan(table.source_depth_m[0])
    assert "prior" in table.reasons(0)["source_depth_m"]


def test_the_delay_of_the_surface_image_is_that_of_the_two_ways(evident):
    fringes, ship, sensor = evident
    (one,) = fringe_passages(fringes, MACH)
    mirror = one.mirror
    assert mirror.is_evident
    near, far = (np.hypot(ship.flat_m, sensor.depth_m + k * ship.depth_m) for k in (-1.0, 1.0))
    off = mirror.delay_s / ((far - near) / 1500.0) - 1.0
    assert abs(off) < 2.0 * mirror.share < 0.1


def test_a_channel_in_which_no_comb_stands_out_tells_no_delay():
    frequency, power, _ = draw_power(7405, is_deep=False)
    fringes = fringes_of(frequency, power)
    (one,) = fringe_passages(fringes, MACH)
    assert not one.mirror.is_evident


@pytest.mark.slow
def test_a_passage_that_levels_tell_is_confirmed_by_the_pattern_at_its_law(evident):
    fringes, ship, sensor = evident
    width_s = ship.slant_m(sensor.depth_m) / ship.speed_mps
    report = PassageReport(ship.time_s, 1.0, width_s, 0.2 * width_s)
    assert evidence_of_levels(fringes, MACH, [], report) > 3.0
    # where nothing is loud, a vessel may show nothing
    report = report._replace(time_s=ship.time_s + 4.0 * width_s)
    known = fringe_passages(fringes, MACH)
    assert -0.5 < evidence_of_levels(fringes, MACH, known, report) < 0.1


def test_a_rise_of_rain_without_a_pattern_speaks_against_a_passage():
    fringes = draw_nothing("rain", 21)
    level = np.convolve(fringes.level_db, np.ones(31) / 31.0, "same")
    time_s = float(fringes.time_s[15:-15][np.argmax(level[15:-15])])
    report = PassageReport(time_s, 2.0, 30.0, 10.0)
    assert -2.0 < evidence_of_levels(fringes, MACH, [], report) < -0.3
