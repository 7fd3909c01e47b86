"""Closest approaches by fringes: drawn images of a surface and a channel, and none.

Rates over many draws: tests/draws/fringe_rates.py.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.fringe_rates import MACH, draw_nothing
from tests.draws.fringe_sounds import draw_power, fringes_of, scene
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.evidence.fringes import FringeEvidence, fringe_passages


@pytest.fixture(scope="module", params=[True, False], ids=["deep", "shallow"])
def passing(request):
    frequency, power, ship = draw_power(21, is_deep=request.param)
    sensor_m = scene(21, is_deep=request.param)[2].sensor_m
    width_s = ship.slant_m(sensor_m) / ship.speed_mps
    return fringes_of(frequency, power), ship.time_s, width_s


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


def test_proposals_gain_most_at_the_passage(passing):
    fringes, time_s, width_s = passing
    evidence = FringeEvidence(fringes, MACH)
    places_s, gain = evidence.gains(width_s)
    near = np.abs(places_s - time_s) < 0.25 * width_s
    far = np.abs(places_s - time_s) > 2.0 * width_s
    assert gain[near].max() > max(20.0, 3.0 * gain[far].max())


def test_a_later_recording_has_its_passage_later():
    frequency, power, _ = draw_power(22, is_deep=True)
    fringes = fringes_of(frequency, power)
    later = replace(fringes, time_s=fringes.time_s + 1000.0)
    (one,), (other,) = (fringe_passages(each, MACH) for each in (fringes, later))
    assert other.passage.time_s - one.passage.time_s == pytest.approx(1000.0, abs=1e-3)
    assert other.passage.width_s == pytest.approx(one.passage.width_s, rel=1e-5)


@pytest.mark.parametrize("kind", ["rain", "throttle", "leaving ship"])
def test_nothing_is_told_where_nothing_passes(kind):
    assert fringe_passages(draw_nothing(kind, 21), MACH) == []
