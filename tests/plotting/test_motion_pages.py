"""Pages of target motion and maps show what the containers say, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.draws.sonar_tables import heard, own_ship
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.series import read_series
from uwtrack_cli.motion.target_motion.inputs import measurements_from_series
from uwtrack_cli.motion.tma import estimate_motion
from uwtrack_cli.plotting.analysis_pages import draw_motion_map, draw_ranges, motion_residuals
from uwtrack_cli.plotting.maps import scale_length, sensor_places
from uwtrack_cli.plotting.page import pages_of
from uwtrack_cli.plotting.style import draw_ellipse
from uwtrack_cli.plotting.view import Scene, View


def motions(**changes):
    count = 2
    values = {}
    for name, spec in Motions.columns().items():
        axis = spec.axes[0]
        if spec.optional:
            continue
        size = {"motion": count, "update": 3, "rest_line": 1, "reason": 0}[axis]
        shape = (size, *(4 for _ in spec.axes[1:]))
        kind = "U1" if spec.dtype.kind == "U" else spec.dtype
        values[name] = np.zeros(shape, dtype=kind)
    values |= {
        "contact": [1, 1], "mode": [1, 2], "weight": [0.9, 0.1],
        "range_m": [1000.0, 2000.0], "bearing_deg": [90.0, 0.0],
        "speed_mps": [5.0, 5.0], "course_deg": [0.0, 90.0],
        "now_time_s": [100.0, 100.0], "observable": [True, True],
        "covariance": np.stack([np.diag([100.0, 1.0, 0.1, 1.0])] * 2),
        "update_contact": [1, 1, 1], "update_time_s": [10.0, 50.0, 100.0],
        "update_range_m": [1500.0, 900.0, 1000.0],
        "update_range_std_m": [1e9, 200.0, 10.0],
    }  # fmt: skip
    facts = {"solver": "mle", "loss": "squares", "doppler": "interval",
             "propagation": "instant", "sound_speed_mps": 1500.0,
             "statement": ""}  # fmt: skip
    return Motions(**{**values, **facts, **changes})


@pytest.fixture
def ax():
    return Figure().add_subplot()


def ways(ax):
    return [line.get_xydata() for line in ax.lines if line.get_linestyle() == "-"
            and len(line.get_xdata()) == 2]  # fmt: skip


def test_every_mode_is_drawn_where_it_starts_and_ends(ax):
    draw_motion_map(motions(), [], ax)
    first, second = ways(ax)[:2]
    np.testing.assert_allclose(first, [[1000.0, 0.0], [1000.0, 500.0]], atol=1e-9)
    np.testing.assert_allclose(second, [[0.0, 2000.0], [500.0, 2000.0]], atol=1e-9)
    assert "1, mode 2 (10 %)" in [t.get_text() for t in ax.texts]


def test_an_untold_range_is_a_ray_along_the_bearing(ax):
    draw_motion_map(motions(observable=[False, False], range_m=[np.nan, np.nan]), [], ax)
    rays = [line.get_xydata() for line in ax.lines if line.get_linestyle() == ":"]
    assert rays[0][1, 0] > 0
    assert rays[0][1, 1] == pytest.approx(0.0, abs=1e-9)
    assert not ax.patches


def legs():
    """Two legs of the first mode, with an alteration of ten seconds between them."""
    north, east = [1000.0, 90.0], [1030.0, 80.0]
    told = {
        "motion": [0, 0], "number": [1, 2], "start_s": [0.0, 55.0], "end_s": [45.0, 100.0],
        "range_m": [north[0], east[0]], "range_std_m": [10.0, 20.0],
        "bearing_deg": [north[1], east[1]], "bearing_std_deg": [1.0, 1.0],
        "speed_mps": [5.0, 5.0], "speed_std_mps": [0.1, 0.1], "course_deg": [0.0, 90.0],
        "course_std_deg": [1.0, 1.0], "alteration_time_s": [np.nan, 50.0],
        "alteration_time_std_s": [np.nan, 3.0],
    }  # fmt: skip
    return {f"leg_{key}": values for key, values in told.items()}


def test_legs_are_drawn_and_joined_by_the_alteration(ax):
    """45 s north at 5 m/s, a quarter of a circle in 10 s, and 45 s east."""
    draw_motion_map(motions(**legs()), [], ax)
    first, second = ways(ax)[:2]
    corner = 5.0 * 10.0 / (0.5 * np.pi)  # radius of that circle, m
    begin = [1000.0 + corner, 225.0 + corner]
    np.testing.assert_allclose(first, [[1000.0, 0.0], [1000.0, 225.0]], atol=1e-6)
    np.testing.assert_allclose(second, [begin, [begin[0] + 225.0, begin[1]]], atol=1e-6)
    (dashed,) = [one.get_xydata() for one in ax.lines if one.get_linestyle() == "--"]
    np.testing.assert_allclose(dashed, [first[1], second[0]], atol=1e-6)
    assert len(ax.patches) >= 3  # regions of both legs and of the end


def test_the_page_says_the_legs_and_parts_their_residuals():
    series, navigation = heard("S1-T1"), own_ship("S1-T1")
    found = estimate_motion(series, navigation=navigation, updates=2)
    told = legs() | {
        "leg_range_m": [found.range_m[0], 21_000.0], "leg_speed_mps": [4.1, 5.0],
        "leg_start_s": [0.0, 3020.0], "leg_end_s": [2980.0, 5994.0],
        "leg_alteration_time_s": [np.nan, 3000.0],
    }  # fmt: skip
    altered = replace(found, **{key: np.array(value) for key, value in told.items()})
    (page,) = pages_of([altered, series, navigation])
    figure = page.draw(View())
    words = " ".join(text.get_text() for text in figure.findobj(Text))
    assert "leg 2 of 2 from 3000 \u00b1 3 s" in words
    assert "not known exactly" in words
    assert "sound speed" in words
    residuals = [ax for ax in figure.axes if "residual" in ax.get_ylabel()]
    for ax in residuals:
        assert 3000.0 in [line.get_xdata()[0] for line in ax.lines]
    assert len(residuals) == 2


def test_estimates_before_the_range_is_observable_are_left_out(ax):
    draw_ranges(motions(), ax)
    assert ax.lines[0].get_xdata().tolist() == [50.0, 100.0]


def test_an_ellipse_holds_95_percent(ax):
    covariance = np.array([[400.0, 150.0], [150.0, 100.0]])
    draw_ellipse(ax, np.array([10.0, -5.0]), covariance, "#000000")
    rng = np.random.default_rng(2)
    points = rng.multivariate_normal([10.0, -5.0], covariance, 20_000)
    share = ax.patches[0].get_path().contains_points(points).mean()
    assert share == pytest.approx(0.95, abs=0.006)  # four deviations of the draws


def test_residuals_of_the_sample_are_as_large_as_its_deviations(samples):
    series = read_series(samples / "bearings.csv")
    navigation = read_navigation(samples / "own-ship.csv")
    found = estimate_motion(series, navigation=navigation, updates=3)
    scene = Scene([found, series, navigation])
    (data,) = measurements_from_series(series)
    left = motion_residuals(scene, found, data)
    for values, std in (
        (left.bearing_deg, data.bearing_std_deg),
        (left.frequency_hz, data.frequency_std_hz),
    ):
        scaled = values / std
        assert abs(scaled.mean()) < 4 / np.sqrt(scaled.size)
        assert scaled.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * scaled.size))
    (page,) = pages_of([found, series, navigation])
    figure = page.draw(View())
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert sum("residual" in label for label in labels) == 2
    assert all(ax.has_data() for ax in figure.axes)


def test_residuals_of_a_table_of_sensors_count_from_each_of_them(tmp_path):
    rng = np.random.default_rng(2)
    places = {"b1": (0.0, 0.0), "b2": (2000.0, 300.0), "b3": (900.0, -1500.0)}
    rows = ["time_s,sensor,sensor_east_m,sensor_north_m,bearing_deg,bearing_std_deg"]
    for time_s in np.arange(0.0, 900.0, 15.0):
        for name, (east, north) in places.items():
            away = (-500.0 + 3.5 * time_s - east, -700.0 + 2.0 * time_s - north)
            bearing = (np.degrees(np.arctan2(*away)) + rng.normal(0.0, 2.0)) % 360
            rows.append(f"{time_s},{name},{east},{north},{bearing:.3f},2")
    (tmp_path / "b.csv").write_text("\n".join(rows) + "\n")
    series = read_series(tmp_path / "b.csv")
    found = estimate_motion(series, updates=2)
    (data,) = measurements_from_series(series)
    left = motion_residuals(Scene([found, series]), found, data).bearing_deg
    scaled = left[np.isfinite(left)] / 2.0
    assert scaled.size == 180
    assert scaled.std() == pytest.approx(1.0, abs=4 / np.sqrt(360))
    (page,) = pages_of([found, series])
    map_texts = [t.get_text() for t in page.draw(View()).axes[0].texts]
    assert set(places) <= set(map_texts)
    assert "own ship" not in map_texts


def test_nothing_known_of_own_ship_leaves_no_residuals():
    scene = Scene([motions()])
    (page,) = pages_of([motions()])
    assert not any("residual" in ax.get_ylabel() for ax in page.draw(View()).axes)
    assert scene.first(Navigation) is None
    nothing = motions().take("motion", slice(0)).take("update", slice(0))
    with pytest.raises(DataError, match="no motion"):
        pages_of([nothing])[0].draw(View())


def test_sensors_with_latitude_stand_apart_on_the_map():
    there = Geodesic.WGS84.Direct(35.0, 128.5, 30.0, 800.0)
    sensors = [
        Sensor(id="a", latitude=35.0, longitude=128.5),
        Sensor(id="b", latitude=there["lat2"], longitude=there["lon2"]),
    ]
    places = sensor_places(sensors, None)
    assert np.hypot(*np.subtract(places["b"], places["a"])) == pytest.approx(800.0, abs=0.01)
    assert Fixes.NAME == "fixes"


@pytest.mark.parametrize("most_m", [0.5, 3.0, 49.0, 51.0, 999.0, 20_001.0])
def test_a_scale_is_a_round_length_near_its_limit(most_m):
    length = scale_length(most_m)
    assert most_m / 2.5 <= length <= most_m
    assert f"{length:e}"[0] in "125"
