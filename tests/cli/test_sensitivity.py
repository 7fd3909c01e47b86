"""What could have been found is said, with -v, by every command that follows lines."""

import json
import re

import pytest

PROMISE = re.compile(
    r"h1: \d+ lines; noise alone gives ([\d.]+) per kHz and hour at most; a steady "
    r"line of (-?[\d.]+) dB over the noise in its cell is found within a minute every "
    r"other time(; the detection threshold is ([\d.]+) dB)?"
)

MEASURED = re.compile(r"; the recording's own noise gives ([\d.]+) per kHz and hour, as measured")


@pytest.fixture
def spectrogram(uwtrack, short_pass):
    done = uwtrack("spectrogram", short_pass, "-o", "p.spectrogram.h5", "-q")
    assert done.exit_code == 0
    return "p.spectrogram.h5"


def test_track_and_trace_say_what_they_would_have_found(uwtrack, spectrogram):
    assert uwtrack("peaks", spectrogram, "-q").exit_code == 0
    tracked = PROMISE.search(uwtrack("track", "p.peaks.h5", "-v").stderr)
    done = uwtrack("trace", spectrogram, "-o", "t.lines.h5", "-v")
    traced = PROMISE.search(done.stderr)
    assert tracked is not None
    assert traced is not None
    assert float(tracked[1]) == float(traced[1]) == 1.0
    # tracing hears weaker lines; 1e-4 in a cell is 9.2 dB, more above an estimate
    assert float(traced[2]) < float(tracked[2])
    assert 9.0 < float(tracked[4]) < 11.0
    assert traced[4] is None
    measured = MEASURED.search(done.stderr)
    assert measured is not None
    assert 0.1 < float(measured[1]) < 10.0
    shown = uwtrack("show", "t.lines.h5", "lines", "--format", "json").stdout
    stated = json.loads(shown)["measured_false_lines_per_khz_hour"]
    assert stated == pytest.approx(float(measured[1]), rel=0.06)


@pytest.mark.slow
def test_a_run_says_it_when_details_are_asked_for(uwtrack, short_pass):
    command = ["run", short_pass, "--recipe", "vessel", "--stop-s", 20]
    loud = uwtrack(*command, "-o", "a.h5", "-v", "--set",
                   "track.score.false_lines_per_khz_hour=0.25")  # fmt: skip
    said = PROMISE.search(loud.stderr)
    assert said is not None
    assert said[1] == "0.25"
    for words in ([], ["-q"]):
        quiet = uwtrack(*command, "-o", "b.h5", "--overwrite", *words)
        assert quiet.exit_code == 0
        assert PROMISE.search(quiet.stderr) is None
