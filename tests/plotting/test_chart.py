"""The map: sensors stand where they are, and an empty map says why."""

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from matplotlib.figure import Figure

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.plotting.chart import draw_map


def encounters(course_deg):
    values = {
        name: np.full((1,) * len(spec.axes), np.nan if spec.dtype.kind == "f" else 0)
        for name, spec in Encounters.columns().items()
        if not spec.optional
    }
    values |= {
        name: np.array([""])
        for name, spec in Encounters.columns().items()
        if spec.dtype.kind == "U" and not spec.optional
    }
    values |= {
        "contact": [1], "sensor": ["b"], "slant_range_m": [100.0],
        "bearing_deg": [90.0], "course_deg": [course_deg],
        "covariance": np.full((1, 4, 4), np.nan),
    }  # fmt: skip
    return Encounters(reference="1 uPa", **values)


def test_sensors_with_latitude_stand_apart_on_the_map():
    there = Geodesic.WGS84.Direct(35.0, 128.5, 30.0, 800.0)
    sensors = [
        Sensor(id="a", latitude=35.0, longitude=128.5),
        Sensor(id="b", latitude=there["lat2"], longitude=there["lon2"]),
    ]
    ax = draw_map(encounters(0.0), sensors, None, Figure().subplots())
    marks = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "^"]
    assert np.hypot(*(marks[1] - marks[0])) == pytest.approx(800.0, abs=0.01)
    track = next(line for line in ax.lines if line.get_marker() == "None")
    middle = track.get_xydata().mean(axis=0)
    assert middle == pytest.approx(marks[1] + [100.0, 0.0], abs=0.01)


def test_a_map_without_a_course_invents_no_place():
    ax = draw_map(encounters(np.nan), [Sensor(id="a")], None, Figure().subplots())
    assert not ax.lines
    assert "no course" in ax.texts[0].get_text()
