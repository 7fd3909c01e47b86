"""Several lengths of frames on the command line: one file, one pass, one set of lines."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from tests.support import white_noise
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.files.hdf5.product import read_product

RATE_HZ = 1000


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Two minutes of a steady weak line and one that sweeps."""
    time_s = np.arange(120 * RATE_HZ) / RATE_HZ
    samples = white_noise(time_s.size, 11, rate_hz=RATE_HZ)
    samples += np.sqrt(2.0 * 10.0**0.4) * np.sin(2.0 * np.pi * 150.0 * time_s)
    sweep_hz = 300.0 + 40.0 * np.abs((time_s / 30.0) % 2.0 - 1.0)
    phase = 2.0 * np.pi * np.cumsum(sweep_hz) / RATE_HZ
    samples += np.sqrt(2.0 * 10.0**1.8) * np.sin(phase)
    path = tmp_path_factory.mktemp("multi-resolution") / "two.wav"
    soundfile.write(path, samples / np.abs(samples).max(), RATE_HZ, subtype="PCM_16")
    return path


@pytest.fixture
def ladder(uwtrack, sound):
    """Spectrogram and peaks of three lengths of frames, in the working folder."""
    words = ("--window-s", 0.1, "--window-s", 1, "--window-s", 8)
    for call in (
        ("spectrogram", sound, *words, "-o", "two.spectrogram.h5"),
        ("peaks", "two.spectrogram.h5"),
    ):
        done = uwtrack(*call)
        assert done.exit_code == 0, done.output
    return Path("two.peaks.h5")


@pytest.mark.slow
def test_lines_of_all_rungs_are_one_table(uwtrack, sound, ladder):
    assert uwtrack("track", ladder).exit_code == 0
    assert uwtrack("spectrogram", sound, "-o", "one.spectrogram.h5").exit_code == 0
    assert uwtrack("peaks", "one.spectrogram.h5").exit_code == 0
    with read_product(ladder) as product, read_product("one.peaks.h5") as single:
        assert [key.step for key in product.paths if key.name == "peaks"] == [
            "peaks-100ms", "peaks-1s", "peaks-8s",
        ]  # fmt: skip
        own = product.read(Peaks, step="peaks-1s")
        assert own.equals(single.read(Peaks))  # one pass gives what each alone does
    with read_product("two.lines.h5") as product:
        assert [key.name for key in product.paths].count("lines") == 1
        lines = product.read(Lines)
    steady = lines.window_s[np.abs(lines.frequency_hz - 150.0) < 1.0]
    moving = lines.window_s[np.abs(lines.frequency_hz - 320.0) < 25.0]
    assert np.median(steady) == 8.0
    assert np.median(moving) < 8.0
    # --step selects one rung: what is shown, exported and drawn, and what is read
    shown = uwtrack("show", "two.lines.h5", "lines", "--step", "track-8s", "--format", "csv")
    told = [line.rsplit(",", 1)[1] for line in shown.stdout.splitlines()]
    assert told == ["window_s", *["8.0"] * np.count_nonzero(lines.window_s == 8.0)]
    out = ("--to", "csv", "--table", "lines", "-o", "one.csv")
    assert uwtrack("export", "two.lines.h5", *out, "--step", "track-8s").exit_code == 0
    assert Path("one.csv").read_text().count("\n") == len(told)
    assert uwtrack("track", ladder, "--step", "peaks-1s", "-o", "one.lines.h5").exit_code == 0
    with read_product("one.lines.h5") as product:
        assert product.read(Lines).window_s is None
    # what follows takes them, or says what to do
    done = uwtrack("presence", "two.lines.h5")
    assert done.exit_code == 0, done.output
    again = uwtrack("rerun", "two.lines.h5", "--source", sound, "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", "two.lines.h5", "again.h5").exit_code == 0
    refused = uwtrack("levels", "two.spectrogram.h5")
    assert refused.exit_code == 1
    assert "spectrogram-8s; name one of them with --step" in refused.stderr


@pytest.mark.usefixtures("ladder")
def test_a_picture_of_each_rung_is_drawn(uwtrack):
    done = uwtrack("plot", "two.spectrogram.h5", "-o", "usual.png")
    assert done.exit_code == 0, done.output
    done = uwtrack("plot", "two.spectrogram.h5", "--step", "spectrogram-8s", "-o", "8.png")
    assert done.exit_code == 0, done.output
    assert Path("8.png").read_bytes() != Path("usual.png").read_bytes()


@pytest.mark.parametrize(
    ("windows", "code", "text"),
    [
        ((1, 1), 2, "--window-s 1 is given twice; each rung has frames of another"),
        ((1, "nan"), 2, "spectrogram.window_s must be a finite number"),
        ((8, 1), 0, "the rungs are taken in the order of their lengths: 1, 8 s."),
        ((1, 8, 500), 0, "the rung of 500 s is left out: it is longer than two.wav"),
        ((0.001, 1), 2, "window_s = 0.001 s holds 1 samples"),
    ],
)
def test_windows_that_make_no_ladder_are_told(uwtrack, sound, windows, code, text):
    words = [word for window in windows for word in ("--window-s", window)]
    done = uwtrack("spectrogram", sound, "--stop-s", 30, *words, "-o", "x.h5")
    assert done.exit_code == code, done.output
    assert text in done.stderr
    assert Path("x.h5").exists() == (code == 0)
