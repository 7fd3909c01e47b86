"""Planar and volume arrays against a delay-and-sum in time, simulated truth, real sound."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import resample

from tests.draws.array_scenes import TETRAHEDRON, sensor_of
from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.arrays.direction_grid import SpatialArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.errors import OptionError, UwtrackWarning
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.tables.sensors import SensorTable, find_sensor
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario

pytestmark = pytest.mark.filterwarnings("ignore:hydrophones .* are sparse")

C, RATE_HZ, FINE = 1500.0, 2000.0, 8
SQUARE = np.array([[0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, 0.5, 0], [-0.5, -0.5, 0]])


def plane_wave(places, azimuth_deg, elevation_deg, *, snr_db, duration_s, seed=1):
    """Broadband sound from one direction and noise of each hydrophone's own."""
    rng = np.random.default_rng(seed)
    n = round(duration_s * RATE_HZ)
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    toward = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation),
              np.sin(elevation)]  # fmt: skip
    source = np.fft.rfft(rng.standard_normal(n)) * 10.0 ** (snr_db / 20.0)
    frequency_hz = np.fft.rfftfreq(n, 1.0 / RATE_HZ)
    early_s = places @ np.array(toward) / C
    heard = [np.fft.irfft(source * np.exp(2j * np.pi * frequency_hz * t), n) for t in early_s]
    return np.stack(heard, axis=1) + rng.standard_normal((n, len(places)))


def record_of(samples, sensor, rate_hz=RATE_HZ, **options):
    recording = recording_of(samples, rate_hz, sensor)
    given = {
        "band_hz": (60.0, 900.0),
        "zero_padding": 1,
        "false_alarm_probability": 1e-3,
        **options,
    }
    return BearingTime.join(list(form_beams(recording, **given)))


def delay_and_sum(samples, places, azimuths_deg, elevations_deg):
    """Direction of the loudest beam of a beamformer in time."""
    time = np.arange(len(samples))
    found = {}
    for azimuth_deg in azimuths_deg:
        for elevation_deg in elevations_deg:
            azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
            toward = np.array([np.sin(azimuth) * np.cos(elevation),
                               np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])  # fmt: skip
            total = np.zeros(len(samples))
            for channel, place in zip(samples.T, places, strict=True):
                total += np.interp(time - place @ toward / C * FINE * RATE_HZ, time, channel)
            found[azimuth_deg, elevation_deg] = np.mean(total[50:-50] ** 2)
    return max(found, key=found.__getitem__)


@pytest.mark.slow
def test_the_direction_is_that_of_a_delay_and_sum_in_time():
    samples = plane_wave(TETRAHEDRON, 217.0, -24.0, snr_db=10.0, duration_s=2.0)
    fine = resample(samples, FINE * len(samples))
    wanted = delay_and_sum(fine, TETRAHEDRON, range(200, 236, 2), range(-40, -8, 2))
    found = record_of(samples, sensor_of(TETRAHEDRON), overlap=0.0).directions
    assert found.bearing_deg == pytest.approx(wanted[0], abs=1.5)
    assert found.elevation_deg == pytest.approx(wanted[1], abs=1.5)
    turned = record_of(samples, sensor_of(TETRAHEDRON, heading_deg=100.0)).directions
    assert turned.bearing_deg == pytest.approx((wanted[0] + 100.0) % 360.0, abs=1.5)


@pytest.mark.parametrize("snr_db", [0.0, pytest.param(15.0, marks=pytest.mark.long)])
def test_directions_err_as_stated_and_near_the_bound(snr_db):
    samples = plane_wave(TETRAHEDRON, 40.0, 20.0, snr_db=snr_db, duration_s=60.0)
    found = record_of(samples, sensor_of(TETRAHEDRON), overlap=0.0).directions
    assert found.frame.size == 60
    error = {
        "bearing": (found.bearing_deg - 40.0, found.bearing_std_deg),
        "elevation": (found.elevation_deg - 20.0, found.elevation_std_deg),
    }
    rho, n = 10.0 ** (snr_db / 10.0), len(TETRAHEDRON)
    frequency_hz = np.arange(60.0, 900.0)
    ratio = n * rho**2 / (1.0 + n * rho) / 1.5  # a Hann window of 1 s
    turn = 2.0 * np.pi * frequency_hz / C
    bound = 1.0 / np.sqrt(2.0 * np.sum(ratio * turn**2 * 0.5))  # sum dp dp' = I / 2
    for name, (off, std) in error.items():
        across = off * (np.cos(np.radians(20.0)) if name == "bearing" else 1.0)
        rms = np.sqrt(np.mean(across**2))
        assert rms < 1.5 * np.degrees(bound)
        scatter = np.sqrt(np.mean((off / std) ** 2))
        assert 0.8 / 1.3 < scatter < 1.25 * 1.3  # three deviations of an rms of 60
        assert abs(off.mean()) < 5.0 * off.std() / np.sqrt(off.size)


def several(sources, places=TETRAHEDRON, duration_s=10.0):
    """Directions of an array whose hydrophones are at the places, of several sources."""
    samples = sum(
        plane_wave(places, azimuth, elevation, snr_db=snr_db, duration_s=duration_s, seed=k)
        - plane_wave(places, 0.0, 0.0, snr_db=-300.0, duration_s=duration_s, seed=k)
        for k, (azimuth, elevation, snr_db) in enumerate(sources)
    )
    noise = np.random.default_rng(9).standard_normal(samples.shape)
    return record_of(samples + noise, sensor_of(TETRAHEDRON), overlap=0.0).directions


@pytest.mark.slow
@pytest.mark.parametrize("sources", [((40, 0, 10), (85, 0, 10)), ((40, 10, 20), (130, 0, 0))])
def test_two_sources_of_a_frame_are_told_apart(sources):
    """The first pair is half of a beam's width apart, the second 20 dB."""
    found = several(sources)
    assert found.source.tolist() == 10 * [1, 2]
    assert np.all(np.diff(found.time_s) >= 0.0)
    for azimuth, *_ in sources:
        off = np.abs((found.bearing_deg - azimuth + 180.0) % 360.0 - 180.0)
        near = off < 20.0
        assert near.sum() == 10
        # an rms of ten is within a factor of 1.6 of its value in 99.5 %; beams state 1.2
        assert 0.5 < np.sqrt(np.mean((off / found.bearing_std_deg)[near] ** 2)) < 2.0
    assert found.strongest().frame.size == 10


def test_a_strong_source_is_one_even_where_places_are_wrong():
    wrong = TETRAHEDRON + np.random.default_rng(5).normal(0.0, 0.02, TETRAHEDRON.shape)
    found = several([(40, 10, 20)], places=wrong)
    assert found.source.tolist() == 10 * [1]


def test_more_sources_than_hydrophones_tell_are_no_directions():
    found = several([(40, 10, 10), (160, 0, 10), (280, 0, 8)], duration_s=6.0)
    assert found.frame.size == 0


@pytest.mark.slow
def test_a_plane_hears_to_the_horizon():
    """Beams next to directions along the plane lay at the rim, and were none."""
    samples = plane_wave(SQUARE, 90.0, 5.0, snr_db=10.0, duration_s=4.0)
    found = record_of(samples, sensor_of(SQUARE), overlap=0.0, band_hz=(60.0, 700.0)).directions
    assert found.frame.size == 4
    assert found.bearing_deg == pytest.approx(90.0, abs=3.0)


@pytest.mark.slow
@pytest.mark.parametrize(("density_db", "own_db"), [(-60.0, 60.0), (60.0, 48.0)])
def test_noise_gives_directions_at_the_stated_rate(density_db, own_db):
    array = {
        "id": "a", "kind": "array", "depth_m": 30.0, "full_scale_db": 140.0,
        "element_positions_m": TETRAHEDRON.tolist(), "element_noise_db": own_db,
    }  # fmt: skip
    table = {"seed": 5, "duration_s": 200.0, "sample_rate_hz": 600.0,
             "sensor": [array], "noise": {"density_db": density_db}}  # fmt: skip
    (recording,) = simulate_recordings(make_scenario(table))
    blocks = form_beams(
        recording, overlap=0.0, zero_padding=1, band_hz=(60.0, 270.0),
        false_alarm_probability=0.1, kept_probability=0.1,
    )  # fmt: skip
    found = BearingTime.join(list(blocks)).directions
    # 20 of 200 frames are due: rates of 0.08 and 0.125 give 6 to 40 in 99.9 %
    assert 6 <= found.frame.size <= 40


@pytest.mark.filterwarnings("ignore:hydrophone e2 is")
def test_a_gust_at_one_hydrophone_is_no_direction():
    rng = np.random.default_rng(3)
    samples = rng.standard_normal((100_000, 4))
    samples[20_000:30_000, 2] *= 12.0
    found = record_of(samples, sensor_of(SQUARE), overlap=0.0).directions
    assert found.frame.size <= 2


def test_a_level_plane_lists_the_image_below():
    samples = plane_wave(SQUARE, 290.0, 35.0, snr_db=10.0, duration_s=4.0)
    record = record_of(samples, sensor_of(SQUARE), overlap=0.0, band_hz=(60.0, 700.0))
    found = record.directions
    assert record.ambiguity == found.ambiguity == "elevation"
    assert found.bearing_deg == pytest.approx(290.0, abs=3.0)
    assert found.elevation_deg == pytest.approx(35.0, abs=4.0)
    assert found.slowness_ratio == pytest.approx(np.cos(np.radians(35.0)), abs=0.06)
    assert found.lobe_elevation_deg == pytest.approx(-found.elevation_deg)
    assert found.lobe_bearing_deg == pytest.approx(found.bearing_deg)
    assert found.lobe_weight == pytest.approx(0.5)


def test_an_upright_plane_lists_the_bearing_behind():
    upright = SQUARE[:, [0, 2, 1]]  # starboard and up
    samples = plane_wave(upright, 50.0, 10.0, snr_db=10.0, duration_s=4.0)
    found = record_of(samples, sensor_of(upright), overlap=0.0, band_hz=(60.0, 700.0)).directions
    assert found.ambiguity == "plane"
    both = np.stack([found.bearing_deg, found.lobe_bearing_deg])
    assert np.sort(both, axis=0).mean(axis=1) == pytest.approx([50.0, 130.0], abs=3.0)


def test_grating_lobes_are_listed_where_they_are():
    """Four hydrophones 1.5 wavelengths apart: u and u - c / (f d) look alike."""
    places = 3.0 * SQUARE
    samples = plane_wave(places, 90.0, 0.0, snr_db=10.0, duration_s=4.0)
    with pytest.warns(UserWarning, match="sparse for this band"):
        found = record_of(
            samples, sensor_of(places), overlap=0.0, band_hz=(745.0, 755.0)
        ).directions
    assert found.frame.size == 4
    apart = C / (750.0 * 3.0)
    seen = np.concatenate([found.lobe_bearing_deg, found.bearing_deg])
    assert np.abs(seen - 90.0).min() < 4.0
    image = np.degrees(np.arccos(np.clip(1.0 - apart, -1, 1)))
    listed = found.lobe_elevation_deg[np.abs(found.lobe_bearing_deg - 90.0) < 5.0]
    assert np.abs(np.abs(listed) - image).min() < 6.0


def test_lines_have_bearings_and_elevations_that_err_as_stated():
    n = round(60.0 * RATE_HZ)
    rng = np.random.default_rng(2)
    time_s = np.arange(n)[:, None] / RATE_HZ
    azimuth, elevation = np.radians([310.0, 25.0])
    toward = np.array([np.sin(azimuth) * np.cos(elevation),
                       np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])  # fmt: skip
    early_s = TETRAHEDRON @ toward / C
    samples = rng.standard_normal((n, 4))
    for frequency_hz in (353.3, 641.7):
        samples += 0.5 * np.cos(2.0 * np.pi * frequency_hz * (time_s + early_s))
    peaks = record_of(samples, sensor_of(TETRAHEDRON), overlap=0.0, band_hz=(300.0, 700.0)).peaks
    for frequency_hz in (353.3, 641.7):
        near = np.abs(peaks.frequency_hz - frequency_hz) < 1.0
        assert np.count_nonzero(near) > 50
        for name, wanted in (("bearing", 310.0), ("elevation", 25.0)):
            off = getattr(peaks, f"{name}_deg")[near] - wanted
            std = getattr(peaks, f"{name}_std_deg")[near]
            # the median of 60, 0.67, within three deviations; noise beside is no line
            assert 0.4 < np.median(np.abs(off / std)) < 0.97


@pytest.mark.parametrize("places", [TETRAHEDRON, SQUARE])
def test_deviation_of_a_tone_is_the_inverse_information(places):
    array = SpatialArray(places, C)
    snr, frequency_hz = np.array([40.0]), np.array([600.0])
    covariance = array.tone_covariance(snr, frequency_hz, np.full(4, 0.25))[0]
    phases = 2.0 * np.pi * 600.0 / C * (places - places.mean(axis=0))
    # u from phases of deviation 1 / sqrt(2 rho) by least squares, one by one
    gain = np.linalg.pinv(phases)
    wanted = gain @ gain.T / (2.0 * 10.0)
    assert covariance == pytest.approx(wanted, abs=1e-12)


@pytest.mark.slow
def test_a_passage_by_four_hydrophones_is_found(samples):
    path = samples / "small-array.wav"
    recording = open_recording(path, sensor=find_sensor(path), start_s=20.0, stop_s=75.0)
    made = run_recipe(recording, load_recipe("small-array"))
    (encounters,) = (one for one in made if isinstance(one, Encounters))
    assert encounters.time_s.size == 1
    truth = {"time_s": 27.0, "speed_mps": 5.0, "course_deg": 75.0, "horizontal_range_m": 60.0}
    for name, wanted in truth.items():
        stem, unit = name.rsplit("_", 1)
        std = getattr(encounters, f"{stem}_std_{unit}")[0]
        assert abs(getattr(encounters, name)[0] - wanted) < 3.0 * std
        assert std < 0.05 * wanted


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"element_positions_m": [[0.0, k, 2.0 * k] for k in range(4)]}, "on one line"),
        ({"element_along_m": [0.0, 1.0, 2.0, 3.0]}, "not both"),
        ({"element_positions_m": [[0.0, 0.0, 0.0]] * 4}, "two hydrophones at 0 0 0"),
        ({"element_positions_m": (1e4 * SQUARE).tolist()}, "in metres"),
        ({"channels": ["a", "b", "c"]}, "3 channels to use and 4 places"),
    ],
)
def test_positions_that_cannot_be_are_refused(change, words):
    table = {
        "id": "a", "kind": "array", "channels": ["a", "b", "c", "d"],
        "element_positions_m": SQUARE.tolist(),
    }  # fmt: skip
    with pytest.raises(OptionError, match=words):
        SensorTable(**{**table, **change})


def test_options_of_a_line_are_refused():
    samples = plane_wave(SQUARE, 0.0, 0.0, snr_db=0.0, duration_s=2.0)
    for option in ({"beams": 65}, {"shading": "hann"}):
        with pytest.raises(OptionError, match="those of a line array"):
            record_of(samples, sensor_of(SQUARE), **option)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "limit"),
    [(SQUARE, "MOST_VALUES"), (TETRAHEDRON, "MOST_BEAMS")],
    ids=["plane", "volume"],
)
def test_the_band_ends_where_beams_grow_too_many(shape, limit, monkeypatch):
    """Beams a quarter of c / (f D) apart over a disc, or a sphere, of directions."""
    wide = 60.0 * shape
    array = SpatialArray(wide, C)
    needed = array.beams_needed(np.array([100.0, 160.0]))
    made = [array.grid(highest_hz).n_beams for highest_hz in (100.0, 160.0)]
    assert made == pytest.approx(needed, rel=0.03)
    most = {"MOST_BEAMS": 400, "MOST_VALUES": 4000}[limit]
    monkeypatch.setattr(f"uwtrack_cli.arrays.beamform.{limit}", most)
    samples = plane_wave(wide, 0.0, 0.0, snr_db=0.0, duration_s=4.0)
    with pytest.warns(UwtrackWarning, match="the band ends at"):
        record = record_of(samples, sensor_of(wide), band_hz=(10.0, 1000.0))
    ends = np.array([record.band_high_hz, record.band_high_hz + 1.0])
    values = array.beams_needed(ends)
    if limit == "MOST_VALUES":
        values *= ends - 9.0  # cells of 1 Hz from the tenth
    assert values[0] <= most < values[1]


REAL = os.environ.get("UWTRACK_REAL_DATA")


@pytest.mark.skipif(not REAL, reason="UWTRACK_REAL_DATA is not set")
def test_a_real_array_hears_the_published_arrivals():
    """LANL-Seismoacoustics/infrapy: 18:07:05 UTC, 318.2 degrees at 371 m/s; then near 250
    degrees at 660 to 800 s and near 323 degrees at 805 to 890 s."""
    folder = Path(REAL or "") / "array"
    table = np.loadtxt(folder / "infrasound_brp.positions.csv", delimiter=",", skiprows=1)
    places = np.column_stack([table[:, 1:], np.zeros(4)])
    sensor = replace(sensor_of(places), sound_speed_mps=345.0)
    recording = open_recording(folder / "infrasound_brp.wav", sensor=sensor)
    options = {"band_hz": (1.0, 5.0), "window_s": 20.0, "false_alarm_probability": 0.01}
    found = BearingTime.join(
        list(form_beams(recording, kept_probability=0.01, **options))
    ).directions
    assert {1, 2} == set(found.source.tolist())  # 248 and 333 degrees about 600 s
    found = found.strongest()

    def between(first_s, last_s):
        rows = (found.time_s >= first_s) & (found.time_s <= last_s)
        assert np.count_nonzero(rows) >= 0.9 * (last_s - first_s) / 10.0
        return found.bearing_deg[rows], found.slowness_ratio[rows]

    bearing, slowness = between(420.0, 430.0)
    assert bearing == pytest.approx(318.2, abs=4.0)
    assert 345.0 / slowness == pytest.approx(371.0, abs=20.0)
    assert np.median(between(660.0, 800.0)[0]) == pytest.approx(250.0, abs=4.0)
    assert np.median(between(805.0, 890.0)[0]) == pytest.approx(322.0, abs=4.0)
    # hydrophones a minute and more apart in time share no sound, but keep their noise
    (samples,) = recording.reader(recording.n_samples)
    apart = np.stack([np.roll(samples[:, k], 5730 * k) for k in range(4)], axis=1)
    noise = record_of(apart, sensor, 100.0, **options, kept_probability=0.01)
    assert noise.directions.frame.size <= 6  # of 119 frames at 1 %
