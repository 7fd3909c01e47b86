"""Sensor and deployment files: what they say is taken, what they misspell refused."""

import tomllib
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.files.tables.sensors import find_sensor, load_deployment, load_sensor

DOCUMENTED = """
id = "h1"
kind = "difar"                 # or "omni"
channels = ["omni", "east", "north"]
latitude = 35.0
longitude = 128.5
position_std_m = 10.0
depth_m = 22
sound_speed_mps = 1500.0
compass_offset_deg = 0.0
compass_std_deg = 2.0
clock_offset_s = 0.0
clock_std_s = 0.5
navigation = "nav.csv"
sensitivity_db_re_v_per_upa = -165.0
gain_db = 20.0
adc_peak_v = 1.5
"""
CALIBRATED = "sensitivity_db_re_v_per_upa = {}\ngain_db = {}\nadc_peak_v = {}\n"


@pytest.fixture
def load(tmp_path):
    """Load a sensor file from its text."""

    def load_text(text):
        (tmp_path / "s.toml").write_text(text)
        return load_sensor(tmp_path / "s.toml")

    return load_text


def test_documented_sensor_file_is_read_as_it_stands(load, tmp_path):
    (tmp_path / "nav.csv").write_text("time_s,east_m,north_m\n0,1,2\n5,3,4\n")
    sensor = load(DOCUMENTED)
    facts = tomllib.loads(DOCUMENTED)
    for key in set(facts) - {"channels", "navigation"}:
        assert getattr(sensor, key) == facts[key]
    assert sensor.channel_names == ("omni", "east", "north")
    assert sensor.navigation is not None
    np.testing.assert_array_equal(sensor.navigation.north_m, [2.0, 4.0])
    expected_upa = 1.5 * 10 ** (145 / 20)
    assert sensor.full_scale_upa == pytest.approx(expected_upa)


def test_full_scale_as_recorders_quote_it_is_the_three_terms_together(load):
    quoted = load('id = "h1"\nfull_scale_db = 176.2\ndepth_std_m = 0.5\nsound_speed_std_mps = 7.5')
    terms = load('id = "h1"\n' + CALIBRATED.format(-176.2, 0.0, 1.0))
    assert quoted.full_scale_upa == pytest.approx(terms.full_scale_upa)
    assert (quoted.depth_std_m, quoted.sound_speed_std_mps) == (0.5, 7.5)


def test_what_a_sensor_file_does_not_say_stays_unknown(load):
    assert load('id = "h1"').equals(Sensor(id="h1"))


@pytest.mark.parametrize("speed_mps", [343.0, 1500.0, 299_792_458.0])
def test_speed_in_air_water_and_of_light_pass_without_a_warning(load, speed_mps):
    assert load(f'id = "a"\nsound_speed_mps = {speed_mps}').sound_speed_mps == speed_mps


def test_speed_in_feet_per_second_is_remarked_on(load):
    with pytest.warns(UwtrackWarning, match="4921"):
        load('id = "a"\nsound_speed_mps = 4921')


BAD = {
    "": "is empty",
    "# nothing": "needs the key 'id'",
    'id = ""': "id must be a text",
    "id = 3": "id must be a text",
    'id = "a"\nlattitude = 3.0': "has no key 'lattitude'. Did you mean 'latitude'",
    'id = "a"\nlatitude = 35.0': "without longitude",
    'id = "a"\neast_m = 35.0': "without north_m",
    'id = "a"\nlatitude=1\nlongitude=1\neast_m=1\nnorth_m=1': "not both",
    'id = "a"\nlatitude = 95.0\nlongitude = 1.0': "at least -90, at most 90",
    'id = "a"\nlatitude = nan\nlongitude = 1.0': "at least -90, at most 90",
    'id = "a"\nlatitude = "35N"\nlongitude = 1.0': "must be a number",
    'id = "a"\ndepth_m = -22.0': "at least 0, at most 11000",
    'id = "a"\ndepth_m = true': "must be a number",
    'id = "a"\nsound_speed_mps = 1.5': "at least 100, at most",
    'id = "a"\nsound_speed_mps = 3e8': "at least 100, at most",
    'id = "a"\nposition_std_m = -1.0': "position_std_m must be a number (m, at least 0",
    'id = "a"\nkind = "sonar"': "must be one of 'omni', 'difar'",
    'id = "a"\nkind = "difar"': "needs channels",
    'id = "a"\nmultiplex = ["east", "north"]': 'give kind = "difar-multiplexed"',
    'id = "a"\nkind = "difar-multiplexed"\nmultiplex = ["east", "-east"]': "once",
    'id = "a"\nkind = "difar-multiplexed"\nmultiplex = ["east", "up"]': "one of 'east'",
    'id = "a"\nkind = "difar-multiplexed"\nchannels = ["omni"]': '"multiplex" once',
    'id = "a"\nkind = "difar-multiplexed"\nresponse_db = [[9, 0], [5, 1]]': "increase",
    'id = "a"\ndeclination_deg = 400.0': "at most 360",
    'id = "a"\ndeclination_deg = "here"': "must be a number",
    'id = "a"\nkind = "difar"\nchannels = ["omni", "east"]': "each once",
    'id = "a"\nkind = "difar"\nchannels = ["omni", "east", "y"]': "each once",
    'id = "a"\nkind = "difar"\nchannels = ["omni", "x", "y"]': "give heading_deg",
    'id = "a"\nchannels = ["omni", "omni"]': '"omni" once',
    'id = "a"\nchannels = ["left"]': '"omni" once',
    'id = "a"\nchannels = 3': "must be a list of values",
    'id = "a"\ngain_db = 20.0': "Give all three",
    'id = "a"\nnavigation = "gone.csv"': "does not exist",
    'id = "a"\nfull_scale_db = 300.0': "at most 240",
    'id = "a"\nfull_scale_db = 176.2\ngain_db = 20.0': "not both",
    'id = "a"\ndepth_std_m = -1.0': "depth_std_m must be a number (m, at least 0",
    'id = "a"\nsound_speed_std_mps = true': "sound_speed_std_mps must be a number",
    "id = = 3": "no valid TOML",
    "x = " + "[" * 5000: "no valid TOML",
    '[sensor]\nid = "a"': "one [[sensor]] table each",
    "sensor = [1, 2]": "one [[sensor]] table each",
    "sensor = []": "one [[sensor]] table each",
    'extra = 1\n[[sensor]]\nid = "a"\nfiles = "*"': "unknown key 'extra'",
    '[[sensor]]\nid="a"\nfiles="x"\n[[sensor]]\nid="a"\nfiles="y"': "needs its own",
    '[[sensor]]\nid="a"\nfiles="x"\n[[sensor]]\nid="b"\nfiles="y"': "2 sensors",
}


@pytest.mark.parametrize("text", BAD)
def test_wrong_sensor_file_is_refused_and_says_why(load, text):
    with pytest.raises(DataError) as caught:
        load(text)
    assert BAD[text] in str(caught.value)
    assert "s.toml" in str(caught.value) or "gone.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("terms", "culprit"),
    [
        ((-45.0, 0.0, 1.0), "sensitivity_db_re_v_per_upa = -45"),
        ((165.0, 0.0, 1.0), "sensitivity_db_re_v_per_upa = 165"),
        ((-165.0, 150.0, 1.0), "gain_db = 150"),
        ((-200.0, -90.0, 5.0), "gain_db = -90"),
        ((-200.0, 0.0, 5000.0), "adc_peak_v = 5000"),
    ],
)
def test_impossible_calibration_names_the_term_that_looks_wrong(load, terms, culprit):
    with pytest.raises(DataError) as caught:
        load('id = "a"\n' + CALIBRATED.format(*terms))
    assert culprit in str(caught.value)


@pytest.mark.parametrize("terms", [(-165.0, 0.0, 1.0), (-204.0, 20.0, 2.5),
                                   (-176.6, 0.0, 1.0), (-26.0 - 120.0, 30.0, 1.0)])  # fmt: skip
def test_calibrations_of_real_recorders_and_microphones_pass(load, terms):
    assert load('id = "a"\n' + CALIBRATED.format(*terms)).full_scale_upa is not None


def test_housing_axes_need_a_heading(load):
    text = 'id = "a"\nkind = "difar"\nchannels = ["y", "-", "omni", "x"]\n'
    sensor = load(text + "heading_deg = 12.0")
    assert sensor.channel_names == ("y", "-", "omni", "x")
    assert sensor.heading_deg == 12.0


def test_sensor_file_beside_the_recording_is_found_by_itself(tmp_path):
    recording = tmp_path / "pass.wav"
    assert find_sensor(recording) is None
    (tmp_path / "pass.sensor.toml").write_text('id = "h7"')
    found = find_sensor(recording)
    assert found is not None
    assert found.id == "h7"


DEPLOYMENT = """
[[sensor]]
id = "h1"
files = "h1/*.wav"
[[sensor]]
id = "h2"
files = ["h2_*.wav", "late/h2-?.flac"]
"""


def test_deployment_gives_each_recording_its_sensor(tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(DEPLOYMENT)
    assert [d.sensor.id for d in load_deployment(plan)] == ["h1", "h2"]
    for name, expected in {"h1/a.wav": "h1", "h2_b.wav": "h2", "data/late/h2-1.flac": "h2"}.items():
        sensor = find_sensor(tmp_path / name, plan)
        assert sensor is not None
        assert sensor.id == expected
    with pytest.raises(DataError, match="found none"):
        find_sensor(tmp_path / "other.wav", plan)
    plan.write_text(DEPLOYMENT.replace("h2_*", "*"))
    with pytest.raises(DataError, match="found 'h1', 'h2'"):
        find_sensor(tmp_path / "h1" / "a.wav", plan)


@settings(max_examples=60, deadline=None)
@given(
    place=st.integers(0, len(DOCUMENTED) - 1),
    piece=st.text(max_size=4) | st.sampled_from(["nan", "inf", "[[", '"""', "-1e999"]),
)
def test_any_damage_of_a_sensor_file_is_an_error_of_ours_or_none(place, piece, tmp_path_factory):
    path = tmp_path_factory.mktemp("s") / "s.toml"
    text = DOCUMENTED[:place] + piece + DOCUMENTED[place + len(piece) :]
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackWarning)
        try:
            load_sensor(path)
        except DataError as error:
            assert str(error)  # noqa: PT017
