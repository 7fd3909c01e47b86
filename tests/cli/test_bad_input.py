"""Bad input gets one clear sentence, the right exit code, and leaves no file."""

import h5py
import numpy as np
import pytest
import soundfile

MAKERS = {}


def case(code, text):
    def keep(function):
        MAKERS[function.__name__] = (function, code, text)
        return function

    return keep


def two_recordings(folder):
    """Write two recordings and a sensor file for one."""
    sound = np.random.default_rng(1).normal(0, 0.1, 20_000)
    for name in ("a.wav", "b.wav"):
        soundfile.write(folder / name, sound, 2000)
    (folder / "h1.toml").write_text('id = "h1"\n')
    return ["a.wav", "b.wav"]


@case(2, "2 recordings take one --sensor each")
def one_sensor_file_for_two_recordings(folder):
    return ["run", *two_recordings(folder), "--sensor", "h1.toml"]


@case(2, "got 3 sensor files")
def three_sensor_files_for_two_recordings(folder):
    sensors = ["--sensor", "h1.toml"] * 3
    return ["run", *two_recordings(folder), *sensors]


@case(2, "would both be written to a.run.h5")
def one_recording_twice(folder):
    two_recordings(folder)
    return ["run", "a.wav", "a.wav"]


@case(2, "has no step 'trace'")
def a_setting_of_a_step_that_is_not_in_the_recipe(folder):
    two_recordings(folder)
    return ["run", "a.wav", "--set", "trace.window_s=3"]


@case(2, "fine-track.gates.sigmas must be a number (at least 0.1, at most 100)")
def a_wrong_setting_of_a_named_step(folder):
    two_recordings(folder)
    steps = "[spectrogram]\n[peaks]\n[fine-track]\nstage = 'track'\n"
    (folder / "fine.toml").write_text(steps)
    fine = "fine-track.gates.sigmas=1e9"
    return ["run", "a.wav", "--recipe", "fine.toml", "--set", fine]


@case(2, "--band-hz takes two numbers with spaces between them, got '400,900'")
def a_band_written_with_a_comma(folder):
    two_recordings(folder)
    return ["demon", "a.wav", "--band-hz", "400,900"]


@case(2, "reaches above 1000 Hz, all that a.wav holds")
def an_envelope_of_a_band_above_all_sound(folder):
    two_recordings(folder)
    return ["demon", "a.wav", "--band-hz", "5000", "9000"]


@case(2, "--sound-speed-mps must be a number (m/s, at least 100")
def a_sound_speed_beyond_all_speeds(folder):
    two_recordings(folder)
    return ["run", "a.wav", "--sound-speed-mps", "1e308"]


@case(2, "[track] of recipe gap reads families or peaks")
def a_recipe_with_a_gap(folder):
    two_recordings(folder)
    (folder / "gap.toml").write_text("[spectrogram]\n[track]\n[cpa]\n")
    return ["run", "a.wav", "--recipe", "gap.toml"]


@case(2, "name the recipe with --graph")
def a_picture_of_no_recipe(_folder):
    return ["recipes", "-o", "graph.png"]


@case(1, "nowhere.wav does not exist")
def missing_file(_folder):
    return ["run", "nowhere.wav"]


@case(1, "is a folder, not a file")
def a_directory(folder):
    (folder / "sounds.wav").mkdir()
    return ["run", "sounds.wav"]


@case(1, "no recording that can be read")
def a_text_named_wav(folder):
    (folder / "letter.wav").write_text("Dear founder,\n")
    return ["run", "letter.wav"]


@case(1, "")
def an_empty_wav(folder):
    (folder / "empty.wav").write_bytes(b"")
    return ["run", "empty.wav"]


@case(1, "holds no samples")
def a_wav_without_samples(folder):
    soundfile.write(folder / "none.wav", np.zeros(0), 2000)
    return ["run", "none.wav"]


@case(1, "--allow-truncated")
def a_truncated_wav(folder):
    path = folder / "cut.wav"
    soundfile.write(path, np.random.default_rng(1).normal(0, 0.1, 20_000), 2000)
    path.write_bytes(path.read_bytes()[:20_000])
    return ["run", "cut.wav"]


@case(1, "less than one window")
def a_recording_shorter_than_a_window(folder):
    soundfile.write(folder / "short.wav", np.full(500, 0.1), 2000)
    return ["run", "short.wav"]


@case(2, "has channels 1 to 3, got channel 4")
def a_channel_that_is_not_there(folder):
    noise = np.random.default_rng(1).normal(0, 0.1, (20_000, 3))
    soundfile.write(folder / "three.wav", noise, 2000)
    return ["run", "three.wav", "--channel", "4"]


@case(1, "not an HDF5 file")
def a_recording_given_as_a_product(folder):
    soundfile.write(folder / "x.wav", np.zeros(2000), 2000)
    return ["peaks", "x.wav"]


@case(1, "newer")
def a_product_of_a_newer_schema(folder):
    _spectrogram(folder)
    with h5py.File(folder / "s.spectrogram.h5", "r+") as file:
        file.attrs["schema_version"] = np.int64(99)
    return ["peaks", "s.spectrogram.h5"]


@case(1, "need lines, levels or a series")
def the_product_of_another_stage(folder):
    _spectrogram(folder)
    return ["cpa", "s.spectrogram.h5"]


@case(1, "--overwrite")
def an_existing_output(folder):
    _wav(folder)
    (folder / "s.run.h5").write_text("precious")
    return ["run", "s.wav"]


@case(1, "")
def an_unwritable_target(folder):
    _wav(folder)
    return ["run", "s.wav", "-o", "/proc/nowhere/s.run.h5"]


@case(1, "")
def a_target_below_a_regular_file(folder):
    _wav(folder)
    return ["run", "s.wav", "-o", "s.wav/s.run.h5"]


@case(2, "no recipe 'cruiser'")
def an_unknown_recipe(folder):
    _wav(folder)
    return ["run", "s.wav", "--recipe", "cruiser"]


@case(2, "has no option 'loudness'. It has: false_alarm_probability")
def an_unknown_recipe_option(folder):
    _wav(folder)
    (folder / "r.toml").write_text("[spectrogram]\n[peaks]\nloudness = 3\n")
    return ["run", "s.wav", "--recipe", "r.toml"]


@case(2, "there is no stage 'speaks'")
def an_unknown_recipe_stage(folder):
    _wav(folder)
    (folder / "r.toml").write_text("[spectrogram]\n[speaks]\n")
    return ["run", "s.wav", "--recipe", "r.toml"]


@case(2, "not readable as TOML")
def a_recipe_that_is_no_toml(folder):
    _wav(folder)
    (folder / "r.toml").write_text("[spectrogram\n")
    return ["run", "s.wav", "--recipe", "r.toml"]


@case(2, "overlap must be a number (at least 0, at most 0.999), got 1.5")
def an_option_out_of_range(folder):
    _wav(folder)
    return ["spectrogram", "s.wav", "--overlap", "1.5"]


@case(2, "at most 3600), got 'long'")
def a_setting_of_the_wrong_type(folder):
    _wav(folder)
    return ["run", "s.wav", "--set", "spectrogram.window_s=long"]


@case(2, "STEP.OPTION=VALUE")
def a_setting_without_a_value(folder):
    _wav(folder)
    return ["run", "s.wav", "--set", "spectrogram"]


@case(2, "run has no option --loudness")
def an_unknown_option(folder):
    _wav(folder)
    return ["run", "s.wav", "--loudness", "3"]


@case(2, "there is no table 'vessels'")
def an_unknown_container(folder):
    _spectrogram(folder)
    return ["show", "s.spectrogram.h5", "vessels"]


@case(2, "no sample 'whale'")
def an_unknown_sample(_folder):
    return ["sample", "whale"]


@case(2, "a picture is written as .png")
def a_picture_of_an_unknown_kind(folder):
    _spectrogram(folder)
    return ["plot", "s.spectrogram.h5", "-o", "s.bmp"]


@case(2, "--set spectrogram.band_hz=[10,1000]")
def an_option_of_a_step(_folder):
    return ["run", "s.wav", "--band-hz", "10", "1000"]


@case(2, "--set track.gates.sigmas=4")
def an_option_of_a_group_of_a_step(_folder):
    return ["batch", "s.wav", "--gates-sigmas", "4", "-o", "out"]


@case(2, "--channel must be a whole number, got 'omni'")
def a_word_for_a_number(_folder):
    return ["run", "s.wav", "--channel", "omni"]


@case(2, "--format must be one of table, csv, json, jsonl, got 'xml'")
def a_choice_that_is_not_there(_folder):
    return ["show", "s.run.h5", "lines", "--format=xml"]


@case(2, "--to is missing: Format to write (csv, geojson")
def a_needed_option_left_out(_folder):
    return ["export", "s.run.h5"]


@case(2, "SOURCES is missing: Result files, or folders with them. See uwtrack help passages.")
def nothing_to_work_on(_folder):
    return ["passages"]


@case(2, "the file comes first: uwtrack show s.spectrogram.h5 lines")
def container_before_file(_folder):
    return ["show", "lines", "s.spectrogram.h5"]


@case(2, "--json and the result file would both go to standard output")
def json_and_a_product_on_standard_output(folder):
    _wav(folder)
    return ["run", "s.wav", "--json", "-o", "-"]


@case(2, "name the study to repeat")
def runs_of_no_study(_folder):
    return ["study", "--runs", "5"]


@case(2, "no sample 'pas'. Did you mean 'pass'?")
def a_sample_mistyped(_folder):
    return ["sample", "pas"]


@case(1, "s.spectrogram.h5 is a result file (HDF5), not a recording")
def a_product_given_as_a_recording(folder):
    _spectrogram(folder)
    return ["run", "s.spectrogram.h5"]


@case(1, "uwtrack run s.wav makes one of a recording")
def a_recording_shown(folder):
    _wav(folder)
    return ["show", "s.wav"]


@case(1, "s.wav is not an HDF5 file")
def a_table_of_passages_over_a_recording(folder):
    _wav(folder)
    return ["passages", "s.wav"]


@case(1, "it is no text in UTF-8")
def a_recording_given_as_a_sensor_file(folder):
    _wav(folder)
    return ["run", "s.wav", "--sensor", "s.wav"]


@case(1, "lacks the columns time_utc, mmsi, latitude, longitude")
def a_table_that_is_not_ais(folder):
    _wav(folder)
    (folder / "way.csv").write_text("time_s,speed_kn,course_deg\n0,5,300\n")
    return ["run", "s.wav", "--ais", "way.csv"]


@case(1, "results is a folder of result files; uwtrack passages")
def results_asked_as_a_folder_of_recordings(folder):
    _spectrogram(folder)
    (folder / "results").mkdir()
    (folder / "s.spectrogram.h5").rename(folder / "results" / "s.run.h5")
    return ["info", "results"]


@case(1, "s.wav is a file; --output names the folder")
def a_batch_into_a_file(folder):
    _wav(folder)
    return ["batch", "s.wav", "-o", "s.wav"]


def _wav(folder):
    noise = np.random.default_rng(1).normal(0, 0.1, 20_000)
    soundfile.write(folder / "s.wav", noise, 2000)


def _spectrogram(folder):
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    _wav(folder)
    assert CliRunner().invoke(app, ["spectrogram", "s.wav"]).exit_code == 0


@pytest.mark.parametrize("name", MAKERS)
def test_bad_input_is_answered_in_one_sentence(uwtrack, tmp_path, name):
    make, code, text = MAKERS[name]
    words = make(tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    done = uwtrack(*words)
    assert done.exit_code == code, done.output
    assert "Traceback" not in done.output
    assert text in " ".join(done.stderr.split())
    errors = [line for line in done.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert done.stdout == ""
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_the_traceback_comes_with_debug_only(uwtrack):
    from uwtrack_cli.errors import DataError

    assert isinstance(uwtrack("run", "nowhere.wav", "--debug").exception, DataError)
