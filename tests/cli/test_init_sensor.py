"""A sensor file that is asked for, or made of options, is read back as it was meant."""

import pytest

from uwtrack_cli.cli.init_sensor_command import KEYS, sensor_file
from uwtrack_cli.files.tables.sensors import DeployedSensorTable, load_sensor


def test_every_key_is_one_of_a_sensor_file():
    assert set(KEYS) <= set(DeployedSensorTable.__dataclass_fields__)


def test_what_is_given_stands_in_the_file_and_the_rest_as_comments(uwtrack, tmp_path):
    done = uwtrack("init-sensor", "h1", "--depth-m", 30, "--full-scale-db", 176.2)
    assert done.exit_code == 0, done.output
    (tmp_path / "h1.sensor.toml").write_text(done.stdout)
    sensor = load_sensor(tmp_path / "h1.sensor.toml")
    assert (sensor.id, sensor.kind, sensor.depth_m) == ("h1", "omni", 30.0)
    assert sensor.full_scale_db == 176.2
    lines = done.stdout.splitlines()
    assert sum(line.startswith("# ") for line in lines) == len(KEYS) - 4  # no files
    assert all("#" in line for line in lines[1:])


def test_a_comment_that_is_taken_off_is_read(tmp_path):
    text = sensor_file({"id": "h1", "kind": "omni"})
    for key in ("latitude", "longitude", "position_std_m", "depth_std_m", "clock_std_s"):
        text = text.replace(f"# {key} =", f"{key} =")
    (tmp_path / "a.toml").write_text(text)
    assert load_sensor(tmp_path / "a.toml").longitude == 128.5


def test_an_array_and_a_vector_sensor_have_their_channels(uwtrack, tmp_path):
    done = uwtrack("init-sensor", "v", "--kind", "difar", "-o", "v.toml")
    assert done.exit_code == 0, done.output
    assert load_sensor(tmp_path / "v.toml").channel_names == ("omni", "east", "north")
    places = "0,0,0.8; 0,0.6,0; 0.5,-0.3,0; -0.5,-0.3,0"
    done = uwtrack("init-sensor", "a", "--kind", "array", "--channels", "a,b,c,d",
                   "--element-positions-m", places, "--heading-deg", 0, "-o", "a.toml")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert load_sensor(tmp_path / "a.toml").element_xyz_m.shape == (4, 3)


def test_a_deployment_file_grows_sensor_by_sensor(uwtrack, tmp_path):
    text = ""
    for name in ("a", "b"):
        text += uwtrack("init-sensor", name, "--files", f"{name}.*.wav").stdout
    (tmp_path / "all.toml").write_text(text)
    from uwtrack_cli.files.tables.sensors import load_deployment

    assert [one.sensor.id for one in load_deployment(tmp_path / "all.toml")] == ["a", "b"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--latitude", "3"], "latitude is given without longitude"),
        (["--kind", "array"], "an array needs a channel"),
        (["--kind", "dipole"], "must be one of"),
        (["--element-along-m", "1,two"], "numbers with commas between them, got '1,two'"),
    ],
)
def test_what_the_program_would_not_read_is_refused(uwtrack, words, told):
    done = uwtrack("init-sensor", "h1", *words, "-o", "h1.toml")
    assert done.exit_code == 2
    assert told in " ".join(done.stderr.split())


def test_a_file_is_never_replaced(uwtrack, tmp_path):
    (tmp_path / "h1.toml").write_text("mine")
    done = uwtrack("init-sensor", "h1", "--depth-m", 3, "-o", "h1.toml")
    assert done.exit_code == 1
    assert (tmp_path / "h1.toml").read_text() == "mine"


def test_on_a_terminal_it_asks_again_what_is_not_accepted(monkeypatch, tmp_path):
    from uwtrack_cli.cli import init_sensor_command as command

    answers = iter(["dipole", "omni", "91", "35", "128.5", "deep", "22", ""])
    monkeypatch.setattr(command.typer, "prompt", lambda *_, **__: next(answers))
    monkeypatch.setattr(command.os, "isatty", lambda _: True)
    command.init_sensor(identifier="h1", output=tmp_path / "h1.toml")
    sensor = load_sensor(tmp_path / "h1.toml")
    assert (sensor.latitude, sensor.longitude, sensor.depth_m) == (35.0, 128.5, 22.0)
    assert sensor.full_scale_db is None
