"""Names that are no text, folders for files, headers without a length, lost power."""

import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.opening import sound_facts
from uwtrack_cli.files.audio.recording_file import open_recording

RATE = 1000
pytestmark = pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")


def sound(seconds, seed=1, channels=1):
    noise = np.random.default_rng(seed).standard_normal((seconds * RATE, channels))
    return 0.1 * noise


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="names are text there")
def test_a_name_that_is_not_utf_8_goes_through_the_whole_chain(uwtrack, tmp_path):
    name = os.fsdecode(b"p\xff.wav")
    soundfile.write(tmp_path / "a.wav", sound(10), RATE)
    (tmp_path / "a.wav").rename(tmp_path / name)
    product = name.replace(".wav", ".run.h5")
    spectrogram = name.replace(".wav", ".spectrogram.h5")
    peaks = name.replace(".wav", ".peaks.h5")
    for words in (
        ["run", name],
        ["info", product],
        ["verify", product],
        ["show", product, "recording"],
        ["plot", product, "-o", name + ".png"],
        ["report", product],
        ["export", product, "--to", "csv"],
        ["rerun", product],
        ["spectrogram", name],
        ["peaks", spectrogram],
        ["rerun", peaks],
        ["batch", name, "-o", "out", "--jobs", "2"],
        ["batch", ".", "-o", "out", "--resume", "--jobs", "1"],
    ):
        done = uwtrack(*words)
        assert done.exit_code == 0, (words, done.output)
        assert "\\udcff" in done.stdout + done.stderr or words[0] == "rerun"
    again = name.replace(".wav", ".rerun.run.h5")
    assert uwtrack("diff", product, again).exit_code == 0


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_a_folder_for_a_file_is_named_in_a_sentence(uwtrack, folder):
    for words in (
        ["run", folder], ["spectrogram", folder], ["peaks", folder], ["cpa", folder],
        ["info", folder], ["rerun", folder],
        ["export", folder, "--to", "csv"], ["plot", folder, "-o", "a.png"],
        ["simulate", folder, "-o", "a.wav"],
    ):  # fmt: skip
        done = uwtrack(*words)
        assert done.exit_code == 1, (words, done.output)
        assert f"error: {folder} is a folder" in done.stderr, (words, done.stderr)
    assert "uwtrack batch" in uwtrack("run", folder).stderr


def without_length(path, start=None):
    """Let the header of a WAV file say that no sound follows."""
    content = bytearray(path.read_bytes())
    at = content.index(b"data") + 4
    content[at : at + 4] = bytes(4)
    if start is not None:
        content[4:8] = start
    path.write_bytes(content)


@pytest.mark.parametrize("start", [None, bytes(4)])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT"])
def test_sound_behind_a_header_without_a_length_is_taken_when_asked_for(
    tmp_path, subtype, channels, start
):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(5, channels=channels), RATE, subtype=subtype)
    wanted, _ = soundfile.read(path, dtype="float32", always_2d=True)
    without_length(path, start)
    before = path.read_bytes()
    assert soundfile.info(str(path)).frames == 0
    with pytest.raises(DataError, match=r"5\.000 s follow .* --allow-truncated"):
        open_recording(path, channel=1)
    recording = open_recording(path, channel=channels, allow_truncated=True)
    assert recording.n_samples == len(wanted) == sound_facts(path).n_samples
    for block in (100, 5000):
        found = np.concatenate(list(recording.reader(block)))
        np.testing.assert_array_equal(found[:, 0], wanted[:, channels - 1])
    assert path.read_bytes() == before


def test_a_header_without_a_length_and_without_sound_has_none(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(0), RATE, subtype="PCM_16")
    for more in (b"", b"LIST\x04\0\0\0INFO"):
        path.write_bytes(path.read_bytes() + more)
        with pytest.raises(DataError, match="holds no samples"):
            open_recording(path, allow_truncated=True)


@pytest.mark.slow
def test_a_product_of_such_a_recording_is_that_of_the_whole_one(uwtrack, tmp_path):
    soundfile.write(tmp_path / "a.wav", sound(10), RATE, subtype="PCM_16")
    shutil.copy(tmp_path / "a.wav", tmp_path / "b.wav")
    without_length(tmp_path / "b.wav")
    assert uwtrack("run", "a.wav").exit_code == 0
    assert uwtrack("run", "b.wav").exit_code == 1
    done = uwtrack("run", "b.wav", "--allow-truncated")
    assert done.exit_code == 0, done.output
    assert "does not say how much sound it holds" in done.stderr
    found = uwtrack("diff", "a.run.h5", "b.run.h5")
    assert found.exit_code == 0, found.output


@pytest.mark.parametrize("name", ["SIGTERM", "SIGKILL"])
def test_a_report_that_is_ended_leaves_nothing(start, timed_run, tmp_path, name):
    shutil.copy(timed_run, tmp_path / "a.run.h5")
    (tmp_path / "temporary").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    for delay_s in (0.1, 0.3, 0.6):
        running = start(
            "report", "a.run.h5", "--overwrite", cwd=tmp_path, env=environment,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        time.sleep(delay_s)
        running.send_signal(getattr(signal, name))
        _, said = running.communicate(timeout=250)
        assert "Traceback" not in said
        assert list((tmp_path / "temporary").iterdir()) == []
        assert {path.name for path in tmp_path.iterdir()} <= ({"a.run.h5", "temporary", "a.html"})
