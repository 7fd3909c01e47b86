"""The spectrogram of a sound file: its levels, its frames, its options, its refusals."""

import tracemalloc

import numpy as np
import pytest
import soundfile
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from tests.support import cells_of
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.plotting.sound_pages import sound_figure
from uwtrack_cli.plotting.view import View

RATE = 8000
FULL_SCALE_DB = 170.0
TONE_HZ, AMPLITUDE = 400.0, 0.5
pytestmark = pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")


class Picture:
    """What a figure shows: the levels, their edges, and its words."""

    def __init__(self, figure):
        self.figure = figure
        (self.ax,) = [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]
        (self.bar,) = [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]
        self.image = self.ax.images[0]
        self.time_s, self.frequency_hz, self.level_db = cells_of(self.ax)

    @property
    def middle_hz(self):
        return 0.5 * (self.frequency_hz[1:] + self.frequency_hz[:-1])

    @property
    def words(self):
        return "\n".join(t.get_text() for sub in self.figure.subfigs for t in sub.texts)


@pytest.fixture
def plotted(uwtrack, monkeypatch):
    """Run `plot`, and return what it drew."""
    figures = []
    save = Figure.savefig

    def keep(self, *args, **options):
        figures.append(self)
        save(self, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep)

    def run(*words):
        done = uwtrack("plot", *words, "--overwrite")
        assert done.exit_code == 0, done.output
        return Picture(figures[-1])

    return run


@pytest.fixture
def tone(tmp_path):
    """Twelve seconds of a tone over weak white noise, of a calibrated hydrophone."""
    time_s = np.arange(12 * RATE) / RATE
    noise = 1e-3 * np.random.default_rng(3).standard_normal(time_s.size)
    sound = AMPLITUDE * np.sin(2 * np.pi * TONE_HZ * time_s) + noise
    soundfile.write(tmp_path / "tone.wav", sound, RATE, subtype="FLOAT")
    facts = f'id = "h1"\nfull_scale_db = {FULL_SCALE_DB}\n'
    (tmp_path / "tone.sensor.toml").write_text(facts)
    return "tone.wav"


def test_a_calibrated_tone_lies_at_its_frequency_and_level(plotted, tone):
    """A sine of amplitude A has A^2 / 2 in the 1.5 / T of a Hann window (Harris 1978)."""
    found = plotted(tone, "--window-s", 0.5, "--band-hz", 380, 420)
    rows = found.level_db.mean(axis=1)
    top = int(np.argmax(rows))
    assert found.middle_hz[top] == pytest.approx(TONE_HZ, abs=0.6)
    density = AMPLITUDE**2 / 2 * 0.5 / 1.5
    expected = FULL_SCALE_DB + 10 * np.log10(density)
    assert rows[top] == pytest.approx(expected, abs=0.05)
    assert found.bar.get_ylabel() == "dB re 1 µPa²/Hz"
    assert "window 0.5 s (bandwidth 3 Hz)" in found.words


@pytest.mark.parametrize("axis", ["--linear", "--log"])
def test_the_picture_holds_the_mean_square_of_the_sound(plotted, tone, axis):
    """Parseval: density times bandwidth is power, whatever the cells are."""
    found = plotted(tone, axis)
    density = np.mean(10.0 ** (found.level_db / 10.0), axis=1)
    power = density @ np.diff(found.frequency_hz)
    expected = 10 ** (FULL_SCALE_DB / 10) * (AMPLITUDE**2 / 2 + 1e-6)
    assert 10 * np.log10(power / expected) == pytest.approx(0.0, abs=0.25)


def test_frames_follow_from_the_length(plotted, tmp_path):
    noise = np.random.default_rng(1).standard_normal(600 * 1000)
    for seconds in (0.2, 3, 600):
        part = 0.1 * noise[: round(seconds * 1000)]
        soundfile.write(tmp_path / "noise.wav", part, 1000, subtype="FLOAT")
        found = plotted("noise.wav")
        assert found.level_db.shape[1] <= 830
        assert found.level_db.shape[1] > (100 if seconds < 1 else 700)
        assert found.time_s[0] == 0.0
        assert found.time_s[-1] == pytest.approx(seconds)
        assert np.isfinite(found.level_db.filled(np.nan)).all()
        power = np.mean(10.0 ** (found.level_db / 10.0), axis=1)
        density = power @ np.diff(found.frequency_hz) / np.ptp(found.frequency_hz)
        # white noise of 0.01 in 500 Hz; half a dB are four deviations of 3 s
        if seconds >= 3:
            assert 10 * np.log10(density / (0.01 / 500)) == pytest.approx(0.0, abs=0.5)
    assert "not calibrated" in found.bar.get_ylabel()


def test_the_axis_follows_from_the_band(plotted, tone):
    cases = [
        ((), "log", (10.0, 4000.0)),
        (("--band-hz", 20, 2000), "log", (20.0, 2000.0)),
        (("--band-hz", 200, 2000), "linear", (200.0, 2000.0)),
        (("--band-hz", 0, 9000), "linear", (0.0, 4000.0)),
        (("--band-hz", 20, 2000, "--linear"), "linear", (20.0, 2000.0)),
    ]
    for words, scale, ends in cases:
        found = plotted(tone, *words, "--dpi", 30)
        assert found.ax.get_yscale() == scale, words
        low, high = found.ax.get_ylim()
        assert high == pytest.approx(ends[1])
        assert low == pytest.approx(ends[0])


def test_range_colours_and_size_are_those_asked_for(plotted, tone):
    words = ("--db-range", 40, "--colormap", "magma", "--size", 5, 3, "--dpi", 50)
    found = plotted(tone, *words, "-o", "small.png")
    dark, bright = found.image.get_clim()
    assert bright - dark == pytest.approx(40.0)
    assert found.image.get_cmap().name == "magma"
    from matplotlib.image import imread

    assert imread("small.png").shape[:2] == (150, 250)


def test_a_part_is_drawn_on_the_clock_of_the_recording(plotted, tone):
    start = ("--start-utc", "2024-05-01T12:00:00Z")
    found = plotted(tone, *start, "--from", "12:00:03", "--to", "9")
    assert (found.time_s[0], found.time_s[-1]) == (3.0, 9.0)
    assert "2024-05-01 12:00:03 to 12:00:09 UTC" in found.words
    assert found.ax.get_xlabel() == "UTC 2024-05-01"
    found = plotted(tone, *start, "--start-s", 3, "--stop-s", 9)
    assert (found.time_s[0], found.time_s[-1]) == (0.0, 6.0)
    assert "2024-05-01 12:00:03 to 12:00:09 UTC" in found.words


def test_the_channel_asked_for_is_drawn(plotted, tmp_path):
    time_s = np.arange(4 * RATE) / RATE
    both = [0.1 * np.sin(2 * np.pi * hertz * time_s) for hertz in (500, 1500)]
    soundfile.write(tmp_path / "two.flac", np.stack(both, axis=1), RATE)
    for channel, hertz in ((1, 500), (2, 1500)):
        found = plotted("two.flac", "--channel", channel, "--band-hz", 300, 2000)
        top = found.middle_hz[np.argmax(found.level_db.mean(axis=1))]
        assert top == pytest.approx(hertz, abs=10)


def test_where_there_is_no_sound_the_picture_is_grey(plotted, tmp_path):
    sound = 0.1 * np.random.default_rng(2).standard_normal(12 * RATE)
    sound[3 * RATE : 5 * RATE] = 0.05
    sound[7 * RATE : 9 * RATE] = np.nan
    soundfile.write(tmp_path / "gaps.wav", sound, RATE, subtype="FLOAT")
    found = plotted("gaps.wav", "--window-s", 0.1)
    middle = 0.5 * (found.time_s[1:] + found.time_s[:-1])
    is_grey = np.ma.getmaskarray(found.level_db).all(axis=0)
    # a column is grey if its frame of 0.1 s touches what is lost
    from_gap_s = np.minimum(np.abs(middle - 4), np.abs(middle - 8)) - 1
    assert is_grey[from_gap_s < 0].all()
    assert not is_grey[from_gap_s > 0.06].any()
    assert found.ax.get_facecolor() == to_rgba("#d9d9d9")


def test_a_day_is_read_in_blocks():
    """A day at 250 Hz is 86 MB of samples; what is held at once does not grow with it."""
    rate_hz, n_samples = 250, 86_400 * 250
    block = np.random.default_rng(4).standard_normal((1 << 18, 1)).astype(np.float32)

    def reader(size):
        assert size <= len(block)
        for first in range(0, n_samples, size):
            yield block[: min(size, n_samples - first)]

    day = Recording(
        sensor=Sensor(id="h1"), name="day.wav", sample_rate_hz=rate_hz,
        n_samples=n_samples, n_channels=1, reader=reader,
    )  # fmt: skip
    tracemalloc.start()
    figure = sound_figure(day, View())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6
    assert Picture(figure).level_db.shape[1] == pytest.approx(800, abs=30)


BAD = {
    "--window-s 20": "--window-s 20 is longer than what is drawn, 12 s",
    "--window-s 0.001": "--window-s 0.001 holds 8 samples at 8000 Hz",
    "--window-s -1": "--window-s must be",
    "--db-range 0": "--db-range must be",
    "--colormap mist": "--colormap takes a name of matplotlib such as viridis",
    "--dpi 5": "--dpi must be",
    "--size 1 3": "--size must be",
    "--size 50 50 --dpi 1000": "makes 2500 million dots",
    "--band-hz 5000 6000": "holds 0 to 4000 Hz, nothing of 5000 to 6000 Hz",
    "--band-hz 300 200": "--band-hz must be increasing",
    "--from 12:00": "needs the start of the recording in UTC",
    "--from 20": "nothing was recorded from 20",
    "--from 1 --to 1.001": "what is drawn holds 8 samples",
    "--contact 1": "--contact belongs to a result file",
    "--lines": "--lines/--no-lines belongs to a result file",
    "--within-m 2000": "--within-m belongs to a result file",
    "--step track": "--step belongs to a result file",
    "tone.wav": "is drawn by itself",
    "--sensor none.toml": "none.toml",
    "--channel 3": "channel",
    "-o tone.bmp": "a picture is written as",
}
"""Words behind a recording that `plot` refuses, and what it says."""


@pytest.mark.parametrize("words", BAD)
def test_what_does_not_fit_a_recording_is_one_sentence(uwtrack, tone, words):
    done = uwtrack("plot", tone, *words.split())
    assert done.exit_code in {1, 2}
    assert done.stderr.count("error:") == 1
    assert BAD[words] in done.stderr
    assert "Traceback" not in done.output


@pytest.mark.parametrize(
    "words", ["--window-s 1", "--db-range 30", "--colormap magma",
              "--channel 1", "--start-s 1", "--allow-truncated", "--time-zone UTC"],
)  # fmt: skip
def test_what_only_recordings_have_is_refused_with_a_product(uwtrack, words):
    done = uwtrack("plot", "pass.run.h5", "-o", "a.png", *words.split())
    assert done.exit_code in {1, 2}
    assert f"{words.split()[0]} belongs to a recording" in done.stderr


def test_dots_per_inch_are_those_of_products_too(uwtrack, tone, tmp_path):
    from matplotlib.image import imread

    assert uwtrack("spectrogram", tone, "-o", "a.h5").exit_code == 0
    done = uwtrack("plot", "a.h5", "-o", "a.png", "--dpi", 40)
    assert done.exit_code == 0, done.output
    assert imread(tmp_path / "a.png").shape[1] == 11 * 40
