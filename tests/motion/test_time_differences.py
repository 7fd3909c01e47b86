"""Places by the delays between synchronised recorders."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.delay_scenes import HALF_95, scene, score
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.fusion.time_differences import fit_time_differences
from uwtrack_cli.motion.locate import locate_vessels


@pytest.mark.parametrize("recorders", [3, 4])
def test_the_ellipse_holds_the_source(recorders):
    distance2, std = score(231, recorders=recorders, frames=30)
    assert distance2 < HALF_95
    assert (std < 20.0).all()


def test_delays_without_errors_give_the_way_itself():
    delays, sensor, place = scene(33, frames=30, clock_std_s=0.0, std_s=1e-9)
    exact = replace(sensor, position_std_m=0.0)
    found = locate_vessels(sensors=[exact], delays=[delays], at=["60"])
    # places of a metre and sound speeds of .5 % were drawn: the sound speed is an unknown
    off = np.hypot(found.east_m[0] - place[0], found.north_m[0] - place[1])
    assert off < 10.0


def test_worse_clocks_widen_the_ellipse():
    delays, sensor, _ = scene(32, recorders=4, frames=6)
    (good, *_) = fit_time_differences(delays, sensor)
    worse = replace(delays, clock_std_s=np.full(delays.time_s.size, 0.05))
    (bad, *_) = fit_time_differences(worse, sensor)
    assert np.trace(bad.covariance[:2, :2]) > 4.0 * np.trace(good.covariance[:2, :2])


def test_two_recorders_do_not_place_a_source():
    delays, sensor, _ = scene(30)
    two = delays.take("delay", np.flatnonzero(delays.channel_b == "r1"))
    with pytest.raises(DataError, match="three recorders"):
        fit_time_differences(two, sensor)


def test_delays_of_one_array_are_no_places():
    delays, sensor, _ = scene(30)
    one = replace(delays, clock_std_s=None)
    with pytest.raises(DataError, match="uwtrack directions"):
        locate_vessels(sensors=[sensor], delays=[one])
