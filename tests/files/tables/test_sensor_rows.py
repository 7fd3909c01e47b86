"""Tables that name the sensor of every row, and where the sensors were."""

import numpy as np
import pytest

from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, UwtrackNote
from uwtrack_cli.files.tables.series import read_series

ROWS = "time_s,sensor,bearing_deg\n10,a,45\n0,b,315\n10,b,300\n"
A = Sensor(id="a", latitude=35.0, longitude=129.0, compass_offset_deg=2.0)
B = Sensor(id="b", latitude=35.01, longitude=129.0, position_std_m=5.0)


def read(tmp_path, text, *sensors):
    path = tmp_path / "b.csv"
    path.write_text(text, encoding="utf-8")
    return read_series(path, sensors=sensors)


def test_rows_stand_where_the_sensor_file_says(tmp_path):
    series = read(tmp_path, ROWS, A, B)
    assert series.sensor.tolist() == ["a", "b", "b"]
    np.testing.assert_allclose(series.sensor_north_m, [0, 1109.4, 1109.4], atol=0.1)
    assert series.bearing_deg.tolist() == [47.0, 315.0, 300.0]
    assert series.sensor_position_std_m.tolist() == [0.0, 5.0]
    assert np.isnan(series.sensor_compass_std_deg).all()


def test_a_drifting_sensor_is_where_its_navigation_was(tmp_path):
    way = Navigation(
        time_s=np.array([0.0, 20.0]), east_m=np.array([0.0, 40.0]),
        north_m=np.zeros(2), heading_deg=np.full(2, np.nan),
        origin_latitude=35.01, origin_longitude=129.0,
    )  # fmt: skip
    series = read(tmp_path, ROWS, A, Sensor(id="b", navigation=way))
    np.testing.assert_allclose(series.sensor_east_m, [0.0, 0.0, 20.0], atol=0.01)
    late = ROWS + "500,b,300\n"
    with pytest.raises(DataError, match=r"line 5: the navigation of sensor 'b' covers"):
        read(tmp_path, late, A, Sensor(id="b", navigation=way))


def test_rows_may_place_their_sensors_themselves(tmp_path):
    text = (
        "time_s,sensor,bearing_deg,array_heading_deg,sensor_east_m,sensor_north_m\n"
        "0,a,45,0,0,0\n0,b,315,,100,50\n0,b,315,,100,50\n"
    )
    with pytest.warns(UwtrackNote, match="1 repeated rows are left out, .* line 4"):
        series = read(tmp_path, text)
    assert series.sensor_east_m.tolist() == [0.0, 100.0]
    assert series.mirrored_bearing_deg[0] == 315.0
    assert np.isnan(series.mirrored_bearing_deg[1])


@pytest.mark.parametrize(
    ("text", "sensors", "words"),
    [
        (ROWS, (A,), r"line 3: sensor 'b' is not in the sensor file, which has a"),
        (ROWS, (A, Sensor(id="b")), r"line 3: .* does not say where sensor 'b' is"),
        (ROWS, (A, Sensor(id="b", east_m=0.0, north_m=0.0)), r"line 3: .* of one kind"),
        (ROWS.replace("0,b", "0,"), (A, B), r"line \d: .* not named"),
        (ROWS.replace("45", "north"), (A, B), r"line 2: bearing_deg must be a number"),
        ("time_s,bearing_deg\n0,1\n", (A, B), "no column sensor"),
    ],
)
def test_what_cannot_be_placed_is_refused(text, sensors, words, tmp_path):
    with pytest.raises(DataError, match=words):
        read(tmp_path, text, *sensors)
