"""A sensor whose bearings count otherwise than the others' is named, and none else."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.draws.sensor_tables import buoys
from uwtrack_cli.errors import UwtrackNote
from uwtrack_cli.motion.tma import estimate_motion

# what was written for the compass bearing b, degrees
WRITTEN = {
    "from the target to the sensor": lambda b: b + 180.0,
    "counter-clockwise from east": lambda b: 90.0 - b,
    "counter-clockwise from north": lambda b: -b,
    "in radians": np.radians,
}


@pytest.mark.parametrize("name", WRITTEN)
def test_the_sensor_and_its_convention_are_named(name):
    series, *_ = buoys(5, rows=15, std_deg=2.0, strange=0.0)
    bearing = series.bearing_deg.copy()
    is_other = series.sensor == "b2"
    bearing[is_other] = WRITTEN[name](bearing[is_other]) % 360.0
    series = replace(series, bearing_deg=bearing, where=lambda row: f"line {row + 2}")
    if name == "in radians":  # those of a told deviation are refused
        series = replace(series, bearing_std_deg=np.full(bearing.size, np.nan))
    with pytest.warns(match=f"line 4: .* sensor b2 miss .* counted {name}"):
        estimate_motion(series)


@pytest.mark.parametrize("others", [0.0, 0.35])
def test_bearings_of_one_convention_are_left_alone(others):
    # a tenth from anywhere, or a third of another boat's
    series, *_ = buoys(5, rows=20, of_another=others)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UwtrackNote)
        estimate_motion(series)


def test_a_sensor_that_hears_another_source_is_not_blamed_for_its_convention():
    series, *_ = buoys(5, rows=15, std_deg=2.0, strange=0.0)
    other, *_ = buoys(6, rows=15, std_deg=2.0, strange=0.0)
    bearing = np.where(series.sensor == "b2", other.bearing_deg, series.bearing_deg)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UwtrackNote)
        estimate_motion(replace(series, bearing_deg=bearing))
