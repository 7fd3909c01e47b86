"""Delays and the directions from them, against scipy, the bound and bad input."""

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from scipy.signal import correlate

from tests.arrays.test_spatial_array import RATE_HZ, SQUARE, TETRAHEDRON, C, plane_wave, sensor_of
from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.arrays.delays import measure_delays
from uwtrack_cli.arrays.directions import find_directions
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.errors import DataError, OptionError

pytestmark = pytest.mark.filterwarnings("ignore:hydrophones .* are sparse")

TRIPOD = np.array([[0, 0, 0.8], [0, 0.58, 0], [0.5, -0.29, 0], [-0.5, -0.29, 0]])


def delays_of(samples, sensor, **options):
    recording = recording_of(samples, RATE_HZ, sensor)
    given = {"band_hz": (60.0, 900.0), "overlap": 0.0, **options}
    return Delays.join(list(measure_delays(recording, **given)))


def test_delays_are_those_of_a_cross_correlation_in_time():
    places = 40.0 * TETRAHEDRON  # many samples apart
    samples = plane_wave(places, 130.0, 15.0, snr_db=10.0, duration_s=1.0)
    delays = delays_of(samples, sensor_of(places), band_hz=(1.0, 990.0))
    for row in range(6):
        a, b = (int(name[row][1:]) for name in (delays.channel_a, delays.channel_b))
        lag = correlate(samples[:, b], samples[:, a]).argmax() - (len(samples) - 1)
        assert delays.delay_s[row] == pytest.approx(lag / RATE_HZ, abs=0.6 / RATE_HZ)


@pytest.mark.parametrize(
    ("weighting", "most"), [("ml", 1.4), ("scot", 1.4), ("phat", 1.9), ("plain", 1.4)]
)
def test_directions_err_as_stated_and_near_the_bound(weighting, most):
    sensor = sensor_of(TETRAHEDRON)
    samples = plane_wave(TETRAHEDRON, 250.0, 10.0, snr_db=5.0, duration_s=100.0)
    found = find_directions(delays_of(samples, sensor, weighting=weighting), sensor)
    assert found.frame.size == 100
    rho, n = 10.0**0.5, 4
    turn = 2.0 * np.pi * np.arange(60.0, 900.0) / C
    information = 2.0 * np.sum(n * rho**2 / (1 + n * rho) / 1.5 * turn**2 * 0.5)
    bound_deg = np.degrees(1.0 / np.sqrt(information))
    for wanted, got, std in (
        (250.0, found.bearing_deg, found.bearing_std_deg),
        (10.0, found.elevation_deg, found.elevation_std_deg),
    ):
        rms = np.sqrt(np.mean((got - wanted) ** 2))
        assert rms < most * bound_deg * 1.2  # three deviations of an rms of 100
        assert 0.8 / 1.25 < np.sqrt(np.mean(((got - wanted) / std) ** 2)) < 1.25 * 1.25
    assert found.slowness_ratio == pytest.approx(1.0)


def test_noise_has_delays_at_most_at_the_stated_rate_and_no_direction():
    rng = np.random.default_rng(4)
    sensor = sensor_of(TETRAHEDRON)
    samples = rng.standard_normal((200_000, 4))
    delays = delays_of(samples, sensor, false_alarm_probability=0.05)
    assert delays.time_s.size < 50  # 600 pairs at 5 %: 30, and four deviations
    with pytest.warns(UserWarning, match="none of .* frames has a direction|no delays"):
        found = find_directions(delays_of(samples, sensor), sensor)
    assert found.frame.size == 0


def test_a_table_gives_what_the_geometry_says(uwtrack, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    azimuth, elevation = np.radians([200.0, 40.0])
    toward = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation),
              np.sin(elevation)]  # fmt: skip
    early_s = TRIPOD @ toward / C
    rows = [
        f"0.5,e{a},e{b},{float(early_s[a] - early_s[b])!r},2e-6" for a in range(4) for b in range(a)
    ]
    head = "time_s,channel_a,channel_b,delay_s,delay_std_s"
    (tmp_path / "d.csv").write_text("\n".join([head, *rows]) + "\n")
    places = TRIPOD.tolist()
    (tmp_path / "s.toml").write_text(
        'id = "t"\nkind = "array"\nchannels = ["e0", "e1", "e2", "e3"]\n'
        f"element_positions_m = {places}\nheading_deg = 100.0\ndepth_m = 30.0\n"
        "depth_std_m = 0.1\nlatitude = 54.0\nlongitude = 10.0\nposition_std_m = 2.0\n"
        "compass_std_deg = 3.0\n"
    )
    done = uwtrack("directions", "d.csv", "--sensor", "s.toml", "-o", "d.h5")
    assert done.exit_code == 0, done.output
    shown = uwtrack("show", "d.h5", "directions", "--format", "csv").stdout.splitlines()
    row = dict(zip(shown[0].split(","), shown[1].split(","), strict=True))
    assert float(row["bearing_deg"]) == pytest.approx(300.0, abs=1e-6)
    assert float(row["elevation_deg"]) == pytest.approx(40.0, abs=1e-6)
    level_m = float(row["range_m"]) * np.tan(elevation)
    assert abs(level_m - 30.0) < 8.0  # the depth of the source is not known
    far = float(row["range_m"])
    place = float(row["east_m"]), float(row["north_m"])
    assert place == pytest.approx((-far * np.sqrt(0.75), 0.5 * far))
    line = Geodesic.WGS84.Inverse(54.0, 10.0, float(row["latitude"]), float(row["longitude"]))
    assert (line["s12"], line["azi1"] % 360.0) == pytest.approx((far, 300.0), abs=1e-3)
    spread = np.array([float(row[f"covariance_m2_{i}_{j}"]) for i, j in np.ndindex(2, 2)])
    across = np.array([0.5, np.sqrt(0.75)])  # the array's place and its compass alone
    across_m2 = across @ spread.reshape(2, 2) @ across
    assert across_m2 == pytest.approx(2.0**2 + (far * np.radians(3.0)) ** 2, rel=0.01)
    bad = ["0.5,e1,e0,0.004,2e-6", *rows[1:]]
    (tmp_path / "bad.csv").write_text("\n".join([head, *bad]) + "\n")
    done = uwtrack("directions", "bad.csv", "--sensor", "s.toml", "-o", "b.h5")
    assert done.exit_code == 1
    assert "which sound crosses in" in " ".join(done.output.split())
    done = uwtrack("directions", "d.csv", "-o", "n.h5")
    assert done.exit_code == 1
    assert "Traceback" not in done.output


def test_a_wrong_order_of_channels_is_said_and_the_right_one_named():
    uneven = np.array([[0, 0, 0], [1.2, 0, 0], [0, 0.7, 0], [0, 0, 0.5]])
    turned = np.concatenate(
        [
            plane_wave(uneven, azimuth, 10.0, snr_db=15.0, duration_s=8.0)
            for azimuth in (70.0, 290.0)
        ]
    )
    sensor = sensor_of(uneven)
    swapped = turned[:, [1, 0, 2, 3]]
    with pytest.warns(UserWarning, match="e1, e0, e2, e3") as told:
        found = find_directions(delays_of(swapped, sensor), sensor)
    assert "order of the channels" in str(told[0].message)
    assert found.frame.size < 8


def test_a_dead_hydrophone_is_said_and_left_out():
    samples = plane_wave(SQUARE, 200.0, 0.0, snr_db=15.0, duration_s=4.0)
    samples[:, 2] = 0.0
    sensor = sensor_of(SQUARE)
    with pytest.warns(UserWarning, match="hydrophone e2 is silent"):
        delays = delays_of(samples, sensor)
    assert not np.isin("e2", [delays.channel_a, delays.channel_b])
    found = find_directions(delays, sensor)
    assert found.bearing_deg == pytest.approx(200.0, abs=3.0)


@pytest.mark.slow
def test_a_channel_without_a_number_is_a_dead_hydrophone():
    """It made a gap of every frame, and nothing was heard."""
    samples = plane_wave(SQUARE, 200.0, 0.0, snr_db=15.0, duration_s=4.0)
    samples[:, 2] = np.nan
    sensor = sensor_of(SQUARE)
    with pytest.warns(UserWarning, match="hydrophone e2 is silent"):
        found = find_directions(delays_of(samples, sensor), sensor)
    assert found.frame.size >= 3
    assert found.bearing_deg == pytest.approx(200.0, abs=3.0)
    beams = form_beams(recording_of(samples, RATE_HZ, sensor), band_hz=(60.0, 700.0))
    with pytest.warns(UserWarning, match="hydrophone e2 is silent"):
        record = BearingTime.join(list(beams))
    heard = record.directions.strongest()
    assert heard.bearing_deg == pytest.approx(200.0, abs=3.0)


def test_three_hydrophones_of_four_in_space_give_no_delays_enough_and_it_is_said():
    samples = plane_wave(TETRAHEDRON, 200.0, 0.0, snr_db=15.0, duration_s=4.0)
    samples[:, 2] = 0.0
    sensor = sensor_of(TETRAHEDRON)
    with pytest.warns(UserWarning, match="hydrophone e2 is silent"):
        delays = delays_of(samples, sensor)
    with pytest.warns(UserWarning, match="needs delays of 3 pairs that do not lie in"):
        assert find_directions(delays, sensor).frame.size == 0


def test_positions_in_millimetres_are_doubted():
    samples = plane_wave(SQUARE, 200.0, 0.0, snr_db=15.0, duration_s=4.0)
    recording = recording_of(samples, RATE_HZ, sensor_of(1000.0 * SQUARE))
    with pytest.raises(OptionError, match=r"positions in metres\? Else give --window-s 1"):
        delays_of(samples, sensor_of(1000.0 * SQUARE))
    with pytest.raises(OptionError, match="are the positions in metres"):
        list(form_beams(recording, band_hz=(60.0, 700.0)))


def test_delays_of_other_channels_are_refused():
    sensor = sensor_of(TETRAHEDRON)
    delays = Delays(
        time_s=np.zeros(1), channel_a=np.array(["e0"]), channel_b=np.array(["x"]),
        delay_s=np.zeros(1), delay_std_s=np.ones(1),
    )  # fmt: skip
    with pytest.raises(DataError, match=r"channel 'x'; sensor 'a' has: e0"):
        find_directions(delays, sensor)
