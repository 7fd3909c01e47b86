"""The sample recordings: remade alike, within their size, as their files say."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from uwtrack_cli.errors import DataError, OptionError, OutputError, UwtrackWarning
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.tables.sensors import find_sensor, load_sensor
from uwtrack_cli.flow.sample_recordings import (
    read_scenario,
    remake_samples,
    sensor_text,
    write_simulation,
)
from uwtrack_cli.simulate import simulate_recordings, truth

SAMPLES = Path(__file__).parents[2] / "sample_data"
NAMES = (
    "pass", "two-sensors-h1", "two-sensors-h2", "mono", "propeller", "noise",
    "towed-array", "small-array",
)  # fmt: skip
MADE = "fringes"
"""A sample whose sound is not kept: `uwtrack sample` makes it."""


@pytest.fixture(scope="session")
def remade(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    (folder / "pass.wav").touch()  # made again, it is replaced
    remake_samples(SAMPLES, folder)
    return folder


def test_samples_are_remade_to_within_one_quantisation_step(remade):
    for name in NAMES:
        shipped, rate = soundfile.read(SAMPLES / f"{name}.wav", dtype="int16")
        again, same_rate = soundfile.read(remade / f"{name}.wav", dtype="int16")
        assert rate == same_rate, name
        assert shipped.shape == again.shape, name
        assert abs(shipped.astype(int) - again).max() <= 1, name
        assert 0.15 < abs(shipped.astype(int)).max() / 2**15 < 1.0, name


def test_files_beside_a_sample_are_those_of_its_scenario(remade):
    for name in (*NAMES, MADE):
        text = (SAMPLES / f"{name}.sensor.toml").read_text(encoding="utf-8")
        again = (remade / f"{name}.sensor.toml").read_text(encoding="utf-8")
        assert tomllib.loads(text) == tomllib.loads(again), name
        text = (SAMPLES / f"{name}.truth.json").read_text(encoding="utf-8")
        again = (remade / f"{name}.truth.json").read_text(encoding="utf-8")
        assert_close(json.loads(text), json.loads(again))


def assert_close(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_close(one[key], other[key])
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_close(a, b)
    elif isinstance(one, float):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-6)
    else:
        assert one == other


def test_samples_stay_below_thirteen_megabytes():
    kept = [path for path in SAMPLES.iterdir() if path.name != f"{MADE}.wav"]
    assert sum(path.stat().st_size for path in kept) < 13_000_000


def test_samples_hold_the_passages_that_their_readme_tells_of():
    def encounters(name):
        return json.loads((SAMPLES / f"{name}.truth.json").read_text())["encounters"]

    (passage,) = encounters("pass")
    assert passage["speed_mps"] == pytest.approx(6.0)
    assert passage["horizontal_range_m"] == pytest.approx(250.0)
    assert passage["rest_frequencies_hz"] == [63.0, 126.0, 189.0, 310.0]
    both = encounters("two-sensors")
    assert [e["sensor"] for e in both] == ["h1", "h2"]
    assert [e["side"] for e in both] == ["starboard", "port"]
    assert encounters("two-sensors-h2") == both[1:]
    assert len(encounters("mono")) == 1
    assert encounters("noise") == []
    (quick,) = encounters(MADE)
    assert quick["time_s"] == pytest.approx(27.0)
    assert quick["rest_frequencies_hz"] == []


@pytest.mark.parametrize("name", NAMES)
def test_sample_opens_with_its_sensor_and_without_a_warning(name):
    sound = SAMPLES / f"{name}.wav"
    sensor = find_sensor(sound)
    assert sensor is not None
    recording = open_recording(sound, sensor=sensor)
    scenario = SAMPLES / f"{name.removesuffix('-h1').removesuffix('-h2')}.scenario.toml"
    made = {r.sensor.id: r for r in simulate_recordings(read_scenario(scenario))}
    asked = made[sensor.id]
    assert recording.n_samples == asked.n_samples
    assert recording.n_channels == asked.n_channels
    assert sensor.full_scale_upa == pytest.approx(asked.sensor.full_scale_upa)


MOVING = """
seed = 3
duration_s = 4.0
sample_rate_hz = 500.0
[[sensor]]
id = "boat"
kind = "difar"
axes = "housing"
depth_m = 5.0
full_scale_db = 150.0
[sensor.track]
course_deg = 20.0
speed_kn = 6.0
[noise]
density_db = 60.0
"""


def test_moving_platform_is_written_with_its_navigation(tmp_path):
    (tmp_path / "boat.toml").write_text(MOVING)
    scenario = read_scenario(tmp_path / "boat.toml")
    written = write_simulation(scenario, tmp_path / "boat.wav")
    assert [path.name for path in written] == [
        "boat.wav",
        "boat.sensor.toml",
        "boat.truth.json",
        "boat.nav.csv",
    ]
    facts = tomllib.loads(written[1].read_text())
    assert facts["navigation"] == "boat.nav.csv"
    assert facts["channels"] == ["omni", "x", "y"]
    assert "sensitivity_db_re_v_per_upa" not in facts
    rows = np.genfromtxt(written[3], delimiter=",", names=True)
    assert rows["heading_deg"] == pytest.approx(20.0)
    assert np.hypot(rows["east_m"], rows["north_m"])[4] == pytest.approx(12.3467, abs=1e-3)
    sensor = find_sensor(written[0])
    assert sensor is not None
    assert sensor.navigation is not None
    exact = simulate_recordings(scenario)[0].sensor.navigation
    assert exact is not None
    np.testing.assert_allclose(sensor.navigation.east_m, exact.east_m, atol=1e-4)
    np.testing.assert_allclose(sensor.navigation.time_s, exact.time_s, atol=1e-3)
    assert json.loads(written[2].read_text()) == json.loads(json.dumps(truth(scenario, "boat")))
    with pytest.raises(OutputError, match="boat"):
        write_simulation(scenario, tmp_path / "boat.wav")


def test_sensor_file_of_a_sample_reads_back_what_was_written(tmp_path):
    scenario = read_scenario(SAMPLES / "pass.scenario.toml")
    sensor = simulate_recordings(scenario)[0].sensor
    (tmp_path / "s.toml").write_text(sensor_text(sensor))
    assert load_sensor(tmp_path / "s.toml").equals(sensor)
    # axes that turn with the housing are nothing without its heading, compass axes have none
    housed = replace(sensor, channels="omni,x,y", heading_deg=33.0)
    (tmp_path / "h.toml").write_text(sensor_text(housed))
    assert load_sensor(tmp_path / "h.toml").equals(housed)


def test_scenario_file_that_cannot_be_used_is_refused(tmp_path):
    with pytest.raises(DataError, match="does not exist"):
        read_scenario(tmp_path / "missing.toml")
    (tmp_path / "bad.toml").write_text("seed = = 3")
    with pytest.raises(DataError, match="no valid TOML"):
        read_scenario(tmp_path / "bad.toml")
    (tmp_path / "typo.toml").write_text(MOVING.replace("seed", "sede"))
    with pytest.raises(OptionError, match="no key 'sede'"):
        read_scenario(tmp_path / "typo.toml")
    with pytest.raises(DataError, match="holds no file"):
        remake_samples(tmp_path)


def test_scenario_of_the_readme_is_accepted_and_can_be_heard(tmp_path):
    prose = (SAMPLES / "README.md").read_text(encoding="utf-8")
    text = prose.split("```toml\n")[1].split("```")[0]
    (tmp_path / "readme.toml").write_text(text, encoding="utf-8")
    scenario = read_scenario(tmp_path / "readme.toml")
    (recording,) = simulate_recordings(scenario)
    assert recording.reader is not None
    loudest = max(abs(block).max() for block in recording.reader(65_536))
    assert 0.01 < loudest < 1.0
    assert {e["vessel"] for e in truth(scenario)["encounters"]} == {1, 2}


def test_disturbances_of_the_readme_are_accepted_and_can_be_made(tmp_path):
    prose = (SAMPLES / "README.md").read_text(encoding="utf-8")
    text = prose.split("```toml\n")[-1].split("```")[0]
    (tmp_path / "readme.toml").write_text(text, encoding="utf-8")
    scenario = read_scenario(tmp_path / "readme.toml")
    (recording,) = simulate_recordings(scenario)
    loudest = max(abs(block).max() for block in recording.reader(65_536))
    assert 0.001 < loudest < 1.0
    keys = {name for name, value in vars(scenario.noise).items() if value}
    assert keys >= set(vars(scenario.noise)) - {"hum", "clicks"}


def test_clipped_simulation_says_by_how_much(tmp_path):
    text = MOVING.replace("full_scale_db = 150.0", "full_scale_db = 80.0")
    (tmp_path / "loud.toml").write_text(text)
    scenario = read_scenario(tmp_path / "loud.toml")
    with pytest.warns(UwtrackWarning, match="raise full_scale_db"):
        write_simulation(scenario, tmp_path / "loud.wav")
    samples, _ = soundfile.read(tmp_path / "loud.wav", dtype="int16")
    assert abs(samples.astype(int)).max() >= 2**15 - 1
