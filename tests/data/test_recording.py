"""Sound can be read again: from a file, from joined files, from what is held."""

from dataclasses import replace

import numpy as np
import pytest
import soundfile

from tests.support import OMNI, recording_of
from uwtrack_cli.data.recording import HeldSamples, Recording
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.flow.catalogue import STAGES
from uwtrack_cli.flow.concatenate import join_recordings
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.recipe import Recipe

RATE = 1000
SOUND = np.random.default_rng(5).uniform(-0.5, 0.5, (20 * RATE, 1)).astype("f4")


def wav(path, samples):
    soundfile.write(path, samples, RATE, subtype="FLOAT")
    return path


def test_a_segment_of_a_file_is_its_samples(tmp_path):
    recording = open_recording(wav(tmp_path / "a.wav", SOUND), sensor=OMNI, start_s=2.0)
    np.testing.assert_array_equal(recording.segment(1.5, 3.25), SOUND[3500:5250])
    np.testing.assert_array_equal(recording.segment(-5.0, 1.0), SOUND[2000:3000])
    np.testing.assert_array_equal(recording.segment(17.0, 99.0), SOUND[19000:])


def test_a_segment_of_joined_files_has_their_gap(tmp_path):
    parts = [
        open_recording(
            wav(tmp_path / f"{k}.wav", SOUND[5000 * k : 5000 * (k + 1)]),
            sensor=OMNI,
            start_utc_ns=start_s * 10**9,
        )
        for k, start_s in enumerate((0, 7))
    ]
    joined, _ = join_recordings(parts, slack_s=0.1)
    found = joined.segment(4.0, 8.0)
    np.testing.assert_array_equal(found[:1000], SOUND[4000:5000])
    assert np.isnan(found[1000:3000]).all()
    np.testing.assert_array_equal(found[3000:], SOUND[5000:6000])


def test_a_product_has_no_sound():
    recording = replace(recording_of(SOUND, RATE), reader=None)
    with pytest.raises(DataError, match="not at hand to be read again"):
        recording.segment(0.0, 1.0)


def loudest(levels: Levels, recording: Recording) -> Levels:
    """Read the sound of the loudest frame again, for the test of the engine."""
    frames = levels.frames
    at_s = frames.time_s[np.argmax(levels.level_db)]
    STRETCHES.append(recording.segment(at_s - 0.5, at_s + 0.5))
    return levels


STRETCHES: list[np.ndarray] = []


def test_a_stage_reads_a_segment_again_whatever_the_source(tmp_path, monkeypatch):
    monkeypatch.setitem(STAGES, "loudest", f"{__name__}:loudest")
    text = "[spectrogram]\n[levels]\nband_hz = [50.0, 400.0]\n[loudest]\n"
    recipe = Recipe.from_toml("again", text)
    sound = SOUND.copy()
    sound[12000:13000] *= 1.9
    opened = open_recording(wav(tmp_path / "a.wav", sound), sensor=OMNI)
    held = replace(opened, reader=HeldSamples(sound))
    STRETCHES.clear()
    for recording in (opened, held):
        run_recipe(recording, recipe)
    np.testing.assert_array_equal(STRETCHES[0], sound[12000:13000])
    np.testing.assert_array_equal(STRETCHES[1], sound[12000:13000])
