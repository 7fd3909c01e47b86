"""Arrays in the simulator: laws of plane waves, of isotropic noise and of towing."""

import numpy as np
import pytest

from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.flow.sample_recordings import write_simulation
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario
from uwtrack_cli.simulate.trajectories import array_place, track_trajectory

RATE_HZ, C = 1000.0, 1500.0
PLACES = [-4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5]
ARRAY = {
    "id": "tow", "kind": "array", "depth_m": 30.0, "full_scale_db": 160.0,
    "element_along_m": PLACES,
}  # fmt: skip
TURNING = {
    "course_deg": 30.0, "speed_mps": 3.0, "start_s": -100.0,
    "turn": [{"at_s": 0.0, "course_deg": 120.0, "rate_deg_per_s": 1.0}],
}  # fmt: skip


def scene(sensor, duration_s=20.0, **others):
    return make_scenario(
        {"seed": 5, "duration_s": duration_s, "sample_rate_hz": RATE_HZ,
         "sound_speed_mps": C, "sensor": [sensor], **others}
    )  # fmt: skip


def samples_of(scenario, block=50_000):
    (recording,) = simulate_recordings(scenario)
    return np.concatenate(list(recording.reader(block)))


@pytest.mark.parametrize("cone_deg", [0.0, 40.0, 90.0, 155.0])
def test_a_far_tone_arrives_as_a_plane_wave(cone_deg):
    heading, far = 70.0, 2e5
    bearing = np.radians(heading + cone_deg)
    track = {
        "east_m": far * float(np.sin(bearing)), "north_m": far * float(np.cos(bearing)),
        "course_deg": 0.0, "speed_mps": 0.0,
    }  # fmt: skip
    vessel = {
        "track": track, "source_depth_m": 30.0,
        "line": [{"frequency_hz": 200.0, "source_level_db": 220.0}],
    }  # fmt: skip
    heard = samples_of(scene({**ARRAY, "heading_deg": heading}, 4.0, vessel=[vessel]))
    turn = np.exp(-2j * np.pi * 200.0 * np.arange(len(heard)) / RATE_HZ)
    tone = (heard * turn[:, None]).sum(axis=0)
    phase = np.angle(tone / tone[3])
    wanted = 2.0 * np.pi * 200.0 * np.array(PLACES) * np.cos(np.radians(cone_deg)) / C
    assert np.angle(np.exp(1j * (phase - wanted))) == pytest.approx(0.0, abs=2e-3)


def test_ambient_noise_has_the_coherence_of_an_isotropic_field():
    noise = {"density_db": 80.0, "reference_hz": 100.0}
    heard = samples_of(scene(ARRAY, 120.0, noise=noise))
    frames = heard[: len(heard) // 500 * 500].reshape(-1, 500, len(PLACES))
    spectra = np.fft.rfft(frames * np.hanning(500)[None, :, None], axis=1)
    density_db = 10 * np.log10(
        2 * (np.abs(spectra) ** 2).mean() / (RATE_HZ * np.sum(np.hanning(500) ** 2))
    )
    assert density_db + 160.0 == pytest.approx(80.0, abs=0.1)
    distance = np.subtract.outer(PLACES, PLACES)
    for frequency_hz in (40.0, 150.0, 300.0, 440.0):
        near = spectra[:, round(frequency_hz / 2.0) + np.arange(-4, 5)]
        cross = np.einsum("tfi,tfj->ij", near, near.conj())
        power = np.sqrt(np.outer(np.diag(cross).real, np.diag(cross).real))
        coherence = cross / power
        wanted = np.sinc(2.0 * frequency_hz * distance / C)
        assert np.abs(coherence - wanted).max() < 0.1  # 5 deviations of 240 x 9 cells


def test_noise_of_the_hydrophones_is_shared_with_no_other():
    heard = samples_of(
        scene({**ARRAY, "element_noise_db": 90.0}, 60.0, noise={"density_db": -50.0})
    )
    correlation = np.corrcoef(heard.T) - np.eye(len(PLACES))
    assert np.abs(correlation).max() < 5.0 / np.sqrt(len(heard))
    density_db = 10 * np.log10(2.0 * heard.var(axis=0) / RATE_HZ) + 160.0
    assert density_db == pytest.approx(90.0, abs=0.2)


def test_every_place_follows_the_ships_way():
    plan = scene({**ARRAY, "track": TURNING, "tow_offset_m": 40.0}).sensors[0]
    ship = track_trajectory(plan.track)
    time_s = np.linspace(-60.0, 150.0, 40)
    fine_s = np.arange(-200.0, 160.0, 0.01)
    way = np.array(ship.at(fine_s)[:2])
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(way, axis=1))))
    for along_m in (PLACES[0], 0.0, PLACES[-1]):
        here = array_place(plan, (0.0, along_m, 0.0)).at(time_s)
        ships = np.interp(time_s, fine_s, length)
        behind = np.interp(ships - (40.0 - along_m), length, fine_s)
        there = ship.at(behind)
        assert np.hypot(here[0] - there[0], here[1] - there[1]).max() < 0.01


def test_block_size_changes_no_bit():
    noise = {"density_db": 70.0}
    scenario = scene({**ARRAY, "track": TURNING, "tow_offset_m": 40.0}, noise=noise)
    assert samples_of(scenario, 777).tobytes() == samples_of(scenario, 100_000).tobytes()


def test_the_files_say_what_the_owner_knows(tmp_path):
    scenario = scene({**ARRAY, "track": TURNING, "tow_offset_m": 40.0}, 5.0)
    written = write_simulation(scenario, tmp_path / "tow.wav")
    assert {p.name for p in written} == {
        "tow.wav", "tow.sensor.toml", "tow.nav.csv", "tow.truth.json",
    }  # fmt: skip
    sensor = load_sensor(tmp_path / "tow.sensor.toml")
    assert sensor.element_places_m.tolist() == PLACES
    assert (sensor.tow_offset_m, sensor.heading_source) == (40.0, "track")
    ship = track_trajectory(scenario.sensors[0].track)
    navigation = sensor.navigation
    assert navigation.time_s[0] < -(40.0 + 4.5) / 3.0  # the way the array follows
    east, north, *_ = ship.at(navigation.time_s)
    assert np.abs(navigation.east_m - east).max() < 1e-3
    assert np.abs(navigation.north_m - north).max() < 1e-3
    assert open_recording(tmp_path / "tow.wav", sensor=sensor).n_channels == 7


def test_a_fixed_array_states_its_heading(tmp_path):
    write_simulation(scene({**ARRAY, "heading_deg": 70.0}, 2.0), tmp_path / "bed.wav")
    sensor = load_sensor(tmp_path / "bed.sensor.toml")
    assert (sensor.heading_deg, sensor.heading_source) == (70.0, "fixed")
    assert sensor.tow_offset_m is None


@pytest.mark.parametrize(
    ("sensor", "noise", "words"),
    [
        ({**ARRAY, "element_along_m": []}, None, "element_along_m"),
        ({"id": "h", "depth_m": 9.0, "full_scale_db": 160.0, "tow_offset_m": 9.0}, None,
         'kind = "array"'),
        (ARRAY, {"density_db": 70.0, "clicks": {"rate_per_min": 6, "peak_db": 100}},
         "noise.clicks"),
        ({**ARRAY, "element_along_m": [-500.0, 500.0]}, {"density_db": 70.0},
         "lower the rate"),
        ({**ARRAY, "track": {"course_deg": 0.0, "speed_mps": 0.0}}, None, "one speed"),
    ],
)  # fmt: skip
def test_what_cannot_be_simulated_is_refused(sensor, noise, words):
    with pytest.raises(OptionError, match=words):
        simulate_recordings(scene(sensor, **({} if noise is None else {"noise": noise})))
