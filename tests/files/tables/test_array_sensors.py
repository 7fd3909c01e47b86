"""Sensor files of arrays: what they say, and what is refused with its remedy."""

import numpy as np
import pytest
import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.tables.sensors import load_sensor

FACTS = {
    "id": '"tow1"', "kind": '"array"', "channels": '["e1", "-", "e2", "e3"]',
    "element_along_m": "[1.0, 0.0, -1.0]", "tow_offset_m": "150.0",
    "heading_source": '"way"', "navigation": '"nav.csv"',
}  # fmt: skip


@pytest.fixture
def write(tmp_path):
    (tmp_path / "nav.csv").write_text("time_s,east_m,north_m\n0,0,0\n100,0,300\n", encoding="utf-8")

    def written(**changes):
        facts = {k: v for k, v in {**FACTS, **changes}.items() if v is not None}
        path = tmp_path / "tow1.sensor.toml"
        path.write_text("".join(f"{k} = {v}\n" for k, v in facts.items()))
        return path

    return written


def test_an_array_keeps_its_channels_in_the_order_of_the_file(write, tmp_path):
    sensor = load_sensor(write())
    assert sensor.is_array
    assert sensor.element_places_m.tolist() == [1.0, 0.0, -1.0]
    samples = np.arange(4)[None, :] / 8.0 + np.zeros((100, 1))
    soundfile.write(tmp_path / "a.wav", samples, 1000, subtype="FLOAT")
    recording = open_recording(tmp_path / "a.wav", sensor=sensor)
    block = next(recording.reader(100))
    assert block[0].tolist() == [0.0, 0.25, 0.375]
    assert recording.sensor.channels == "e1,e2,e3"
    assert recording.file_channels == "1,3,4"


def test_one_channel_of_an_array_is_a_hydrophone(write, tmp_path):
    soundfile.write(tmp_path / "a.wav", np.zeros((100, 4)), 1000)
    one = open_recording(tmp_path / "a.wav", sensor=load_sensor(write()), channel=3)
    assert (one.sensor.kind, one.sensor.element_along_m) == ("omni", None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"element_along_m": "[1.0, 0.0]"}, "3 channels to use and 2 places"),
        ({"element_along_m": None}, "3 channels to use and 0 places"),
        ({"channels": None}, "0 channels to use"),
        ({"channels": '["a", "-", "b", "a"]'}, "names of their own"),
        ({"element_along_m": "[1.0, 0.0, 0.0]"}, "two hydrophones at 0 m"),
        ({"element_along_m": "[7500.0, 0.0, -7500.0]"}, "Are the places in metres"),
        ({"element_along_m": "[0.001, 0.0, -0.001]"}, "Are the places in metres"),
        ({"tow_offset_m": None}, "needs tow_offset_m"),
        ({"heading_source": None}, "needs heading_source"),
        ({"heading_source": '"gyro"'}, "'track', 'way', 'compass'"),
        ({"heading_deg": "20.0"}, "not both"),
        ({"kind": '"omni"', "channels": '["omni"]'}, 'kind = "array"'),
    ],
)
def test_what_cannot_be_an_array_is_refused(write, changes, words):
    with pytest.raises(DataError, match=words):
        load_sensor(write(**changes))
