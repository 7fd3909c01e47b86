"""Vector sensors with faults: corrected as told, and measured by a known passage."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import soundfile
from geographiclib.geodesic import Geodesic

from tests.benchmarks.difar_figures import (
    DIFAR,
    ambient_pull,
    direction_error,
    drawn_passage,
    line_pull,
    weighed,
)
from tests.support import recording_of, white_noise
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.flow.calibration import calibrate_sensor
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.peak_bearings import angle_by_whitened
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

FAULTS = {"dipole_gains": "0.8,1.3", "dipole_crosstalk": 0.1, "omni_crosstalk": "0.2,-0.1"}


def heard_by(faults, bearing_deg, axes="east,north", **facts):
    """Return the bearing of a sound of one direction, recorded with the faults."""
    rng = np.random.default_rng(4)
    sound, angle = rng.standard_normal(8000), np.radians(bearing_deg)
    first, second = np.sin(angle), np.cos(angle)
    gains = [0.8, 1.3] if faults else [1.0, 1.0]
    cross, leak = (0.1, (0.2, -0.1)) if faults else (0.0, (0.0, 0.0))
    samples = np.stack(
        [
            sound,
            gains[0] * sound * (first + cross * second + leak[0]),
            gains[1] * sound * (cross * first + second + leak[1]),
        ],
        axis=1,
    )
    sensor = Sensor(id="h1", kind="difar", channels=f"omni,{axes}", **facts)
    (made,) = compute_spectrogram(recording_of(samples, 2000.0, sensor))
    angle = np.arctan2(made.intensity_east.sum(), made.intensity_north.sum())
    return np.degrees(angle) % 360.0


@pytest.mark.parametrize("bearing_deg", [10.0, 100.0, 190.0, 280.0])
def test_told_faults_are_taken_off(bearing_deg):
    assert heard_by(True, bearing_deg, **FAULTS) == pytest.approx(bearing_deg, abs=0.01)
    assert abs(heard_by(True, bearing_deg) - bearing_deg) > 3.0
    turned = heard_by(True, bearing_deg, axes="x,y", heading_deg=30.0, **FAULTS)
    assert turned == pytest.approx((bearing_deg + 30.0) % 360.0, abs=0.01)


def test_a_known_passage_measures_what_the_sensor_does_to_bearings():
    recording, truth, due = drawn_passage(10)
    found, sensor = calibrate_sensor(recording, truth)
    before = Sensor(id="h1", kind="difar", channels="omni,east,north")
    assert direction_error(before, due) > 5.0
    left = direction_error(sensor, due)
    assert left < 2.5
    assert left < 3.0 * found.compass_std_deg
    off = np.array([one.value for one in found.quantities]) - due
    # in the units of its stated deviations; two of six beyond 2 are one in 30 such tests
    far = np.abs(off / [one.std for one in found.quantities])
    assert np.count_nonzero(far > 2.0) < 2
    assert far.max() < 4.0
    assert found.error_after_deg < found.error_before_deg / 3.0


@pytest.mark.parametrize(
    ("channels", "words"),
    [([0, 2, 1], "exchanged"), ([0, -1, 2], "inverted"), ([0, 1, -2], "inverted")],
)
def test_exchanged_and_inverted_dipoles_are_told(channels, words):
    recording, truth, _ = drawn_passage(10)
    reader = recording.reader

    def wrong(n_samples):
        for block in reader(n_samples):
            yield np.stack([np.sign(c or 1) * block[:, abs(c)] for c in channels], axis=1)

    with pytest.raises(DataError, match=words):
        calibrate_sensor(replace(recording, reader=wrong), truth)


def test_a_silent_or_distant_passage_is_refused():
    recording, truth, _ = drawn_passage(10)
    with pytest.raises(DataError, match="within 10 m"):
        calibrate_sensor(recording, truth, within_m=10.0)
    with pytest.raises(DataError, match="exactly one vessel"):
        calibrate_sensor(recording, truth, vessel="tug")
    noise = np.random.default_rng(1).standard_normal((200_000, 3))
    quiet = recording_of(noise, 2000.0, recording.sensor)
    with pytest.raises(DataError, match="needs 30 frames"):
        calibrate_sensor(quiet, truth)
    with pytest.raises(DataError, match="no dipoles"):
        calibrate_sensor(recording_of(noise[:, :1], 2000.0), truth)


SCENARIO = """
seed = 11
duration_s = 200.0
sample_rate_hz = 1000.0
start_utc = "2024-05-01T12:00:00Z"
[[sensor]]
id = "h1"
kind = "difar"
latitude = 35.0
longitude = 128.5
depth_m = 22.0
full_scale_db = 140.0
compass_error_deg = 12.0
dipole_gain_errors = [-0.2, 0.15]
omni_crosstalk = [0.1, -0.05]
[[vessel]]
name = "ferry"
[vessel.closest_approach]
time_s = 100.0
horizontal_range_m = 120.0
speed_mps = 6.0
course_deg = 81.0
side = "port"
[[vessel.line]]
frequency_hz = 63.0
cn0_db_hz = 35.0
[vessel.broadband]
band_hz = [50.0, 450.0]
snr_db = 12.0
[noise]
density_db = 70.0
"""


def test_the_command_writes_a_new_sensor_file_and_never_over_another(uwtrack, tmp_path):
    (tmp_path / "a.toml").write_text(SCENARIO)
    assert uwtrack("simulate", "a.toml", "-o", "a.wav").exit_code == 0
    words = ["calibrate", "a.wav", "--truth", "a.truth.json", "--band-hz", 60, 400]
    done = uwtrack(*words, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["vessel"].startswith("ferry")
    assert found["error_after_deg"] < 3.0 < found["error_before_deg"]
    sensor = load_sensor(tmp_path / "a.calibrated.sensor.toml")
    assert sensor.compass_offset_deg == found["compass_offset_deg"]
    # the error is what the stated correction leaves: that of the file must take it off
    off = sensor.compass_offset_deg + 12.0
    assert abs(off) < 3.0 * found["compass_std_deg"] + 0.5
    again = uwtrack(*words)
    assert again.exit_code == 1
    assert "replaces no sensor file" in again.stderr
    other = uwtrack(*words, "-o", "b.sensor.toml")
    assert other.exit_code == 0
    assert "orientation_deg" in other.stderr
    (tmp_path / "ais.csv").write_text(ais_of(json.loads((tmp_path / "a.truth.json").read_text())))
    words[3] = "ais.csv"
    known = ["--start-utc", "2024-05-01T12:00:00Z", "--vessel", "ferry"]
    done = uwtrack(*words, *known, "-o", "c.sensor.toml", "--json")
    assert done.exit_code == 0, done.output
    by_ais = json.loads(done.stdout)
    assert abs(by_ais["compass_offset_deg"] + 12.0) < 3.0 * by_ais["compass_std_deg"] + 0.5
    assert by_ais["compass_std_deg"] > found["compass_std_deg"]  # of places and clocks
    # written anew, the sound says no more when it began
    soundfile.write(tmp_path / "a.wav", *soundfile.read(tmp_path / "a.wav"))
    unknown = uwtrack(*words, "-o", "d.sensor.toml")
    assert unknown.exit_code == 1
    assert "--start-utc" in unknown.stderr


def ais_of(truth):
    """Write the track of a truth file as AIS messages, ten seconds apart."""
    track = truth["vessels"][0]["track"]
    lines = ["MMSI,time_utc,latitude,longitude,SOG,COG,VesselName"]
    for k in range(0, len(track["time_s"]), 10):
        east, north = track["east_m"][k], track["north_m"][k]
        azimuth = np.degrees(np.arctan2(east, north))
        place = Geodesic.WGS84.Direct(35.0, 128.5, azimuth, np.hypot(east, north))
        clock = datetime(2024, 5, 1, 12, tzinfo=UTC) + timedelta(seconds=track["time_s"][k])
        lines.append(
            f"123456789,{clock:%Y-%m-%dT%H:%M:%S}Z,{place['lat2']:.6f},"
            f"{place['lon2']:.6f},11.66,81.0,FERRY"
        )
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--band-hz", 400, 60], "--band-hz must be increasing"),
        (["--window-s", 0], "--window-s must be"),
        (["--within-m", -1], "--within-m must be"),
    ],
)
def test_options_out_of_range_are_refused(uwtrack, words, told):
    done = uwtrack("calibrate", "a.wav", "--truth", "a.json", *words)
    assert done.exit_code == 2
    assert told in done.stderr


def test_faults_of_dipoles_need_dipoles(tmp_path):
    path = tmp_path / "h.toml"
    path.write_text('id = "h"\ndipole_gains = [1.0, 1.1]\n')
    with pytest.raises((DataError, OptionError), match="belongs to a sensor with dipoles"):
        load_sensor(path)


@pytest.mark.parametrize("snr_db", [0.0, 6.0])
def test_directed_ambient_sound_does_not_draw_broadband_bearings(snr_db):
    """Left in, the ambient draws them by 27 degrees at 0 dB, and by 7 at 6 dB."""
    error, std = ambient_pull(snr_db, share=0.5, quiet_s=160.0, loud_s=64.0)
    mean, spread, ratio = weighed(error, std)
    assert abs(mean) < 0.5 + 3.0 * spread
    assert 0.8 < ratio < 1.25


@pytest.mark.parametrize(
    ("share", "snr_db", "apart_deg"), [(0.5, 0.0, 90.0), (0.9, 3.0, 90.0), (0.5, 6.0, 45.0)]
)
def test_directed_ambient_sound_draws_no_bearing_of_a_weak_line(share, snr_db, apart_deg):
    """Without what foretells the noise, 0, 6 and 3 dB gave 38, 10 and 36 degrees.

    45 degrees aside, the directions of single frames gave 12 and 6 degrees at 3 and 6 dB,
    with deviations 1.5 and 1.4 times too small.
    """
    error, std = line_pull(snr_db, share=share, apart_deg=apart_deg, length_s=1600.0, seed=5)
    mean, spread, ratio = weighed(error, std)
    assert error.size > 200
    assert abs(mean) < 0.15 * np.median(std) + 3.0 * spread
    assert 0.65 < ratio < 1.45


def test_angles_follow_those_in_white_noise_as_differences_say():
    angle = np.radians(np.arange(-170.0, 171.0, 10.0))
    size, ratio, step = 0.6, 1.0 / 3.0, 1e-5
    stretch = np.sqrt((ratio + size) / ratio)
    white = [
        np.arctan2(stretch * np.sin(d), np.cos(d) - size)
        for d in (angle - step, angle, angle + step)
    ]
    near = np.unwrap(np.array(white), axis=0)
    up, down = step / (near[2] - near[1]), step / (near[1] - near[0])
    slope, bend = angle_by_whitened(angle, np.full(angle.size, size), ratio)
    assert slope == pytest.approx(0.5 * (up + down), rel=1e-4)
    between = 0.5 * (near[2] - near[0])
    assert bend == pytest.approx((up - down) / between, abs=2e-3)


def test_a_vessel_that_is_heard_in_the_quiet_time_is_no_ambient_sound():
    """Taken off, its own faint sound afterwards would turn its bearings."""
    rate, seconds = 1000.0, 512
    time_s = np.arange(int(rate * seconds)) / rate
    noise = [white_noise(time_s.size, k, rate_hz=rate) for k in range(3)]
    lag = (time_s - 60.0) / 20.0
    bearing = np.radians(90.0) + np.arctan(lag)
    ship = white_noise(time_s.size, 3, rate_hz=rate) * np.sqrt(4.0 / (1.0 + lag**2))
    samples = np.stack(
        [ship + noise[0], *(ship * f(bearing) + part / np.sqrt(3)
         for f, part in zip((np.sin, np.cos), noise[1:], strict=True))],
        axis=1,
    )  # fmt: skip
    blocks = compute_spectrogram(recording_of(samples, rate, DIFAR))
    made = Levels.join(list(measure_levels(blocks, band_hz=(50.0, 450.0))))
    near = made.frames.time_s < 120.0
    truth = np.interp(made.frames.time_s, time_s, np.degrees(bearing))
    error = made.bearing_deg[near] - truth[near]
    mean, spread, ratio = weighed(error, made.bearing_std_deg[near])
    assert abs(mean) < 3.0 * spread
    assert 0.8 < ratio < 1.25
