"""Reports: reasons once, warnings first, a folder at a glance, and safe text."""

import io
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
import soundfile

from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.files.audio.recording_file import flac_bytes
from uwtrack_cli.flow.deployment import Deployment, Listened
from uwtrack_cli.flow.long_term import by_hour, hour_levels
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.flow.sound_hours import SoundSpan
from uwtrack_cli.plotting.deployment_report import calendar_figure, deployment_html
from uwtrack_cli.plotting.html_page import in_band
from uwtrack_cli.plotting.passage import reasons_once
from uwtrack_cli.plotting.view import View

HOUR_NS = 3600 * 10**9
DAY = 1_714_521_600 * 10**9
"""2024-05-01T00:00:00Z."""


class Page(HTMLParser):
    """Tags, addresses, texts for who cannot see, and rows of tables by their heading."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.addresses, self.alternatives, self.text = [], [], [], ""
        self.rows, self.heading = {}, ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        names = {"src", "href", "srcset", "action", "data", "poster"}
        self.addresses += [value for name, value in attrs if name in names]
        self.alternatives += [value for name, value in attrs if name == "alt"]
        if tag == "h2":
            self.heading = ""
        if tag == "tr":
            self.rows.setdefault(self.heading, []).append([])

    def handle_data(self, data):
        self.text += data
        if self.tags and self.tags[-1] == "h2":
            self.heading += data.strip()
        if self.tags and self.tags[-1] in {"td", "th"} and data.strip():
            self.rows[self.heading][-1].append(data)


def passage(time_utc, sensor="h1", vessel=None, **more):
    return PassageRow(
        time_utc=time_utc, sensor=sensor, contact=1, status="ok", vessel=vessel,
        speed_mps=5.0, speed_std_mps=0.1, file="x/a.run.h5", **more,
    )  # fmt: skip


def deployment(**changes):
    listened = [
        Listened("a.wav", "h1", (DAY + 23 * HOUR_NS, DAY + 25 * HOUR_NS),
                 ((DAY + 23 * HOUR_NS, DAY + 24 * HOUR_NS),)),
        Listened("b.wav", "h2", None),
    ]  # fmt: skip
    sound = [SoundSpan("h1", "", DAY + 23 * HOUR_NS, DAY + 25 * HOUR_NS),
             SoundSpan("h2", "b.wav", 0, HOUR_NS)]  # fmt: skip
    rows = [passage("2024-05-01T23:30:00Z", vessel="FERRY"),
            passage("2024-05-02T00:30:00Z"), passage(None, "h2")]  # fmt: skip
    facts = {"listened": listened, "passages": rows, "sound": sound}
    return Deployment(**{**facts, **changes})


def test_a_folder_is_told_at_a_glance():
    page = Page(deployment_html(deployment(), "spring"))
    assert "3 passages in 3.0 hours of sound" in page.text
    for word in ("2024-05-01", "2024-05-02", "FERRY", "Without a start time", "a.run.h5"):
        assert word in page.text
    assert page.tags.count("img") == 2  # the calendar, and the histograms
    assert len(page.addresses) == 4
    assert all(a.startswith("data:image/png;base64,") for a in page.addresses)


def test_the_calendar_cuts_sound_at_midnight():
    upper = calendar_figure(deployment(), View()).axes[0]
    bars = sorted((p.get_x(), p.get_width(), round(p.get_y() + p.get_height() / 2, 6))
                  for p in upper.patches)  # fmt: skip
    lengths = [width for _, width, _ in bars]
    np.testing.assert_allclose(lengths, [1.0, 1.0, 1.0])  # two of sound, one of vessels
    assert [x for x, _, _ in bars] == [0.0, 23.0, 23.0]
    (marks,) = [line for line in upper.lines if line.get_linestyle() == "None"]
    np.testing.assert_allclose(marks.get_xdata(), [23.5, 0.5])
    assert [t.get_text() for t in upper.get_yticklabels()] == ["2024-05-01", "2024-05-02"]


def test_names_of_a_folder_are_text_and_nothing_more():
    bad = "<script>alert(1)</script>\x1b[31m$^$"
    made = deployment(
        passages=[passage("2024-05-01T23:30:00Z", sensor=bad, vessel=bad)],
        problems=[bad],
        listened=[Listened(bad, bad, (DAY, DAY + HOUR_NS))],
        sound=[SoundSpan(bad, "", DAY, DAY + HOUR_NS)],
    )
    text = deployment_html(made, bad)
    page = Page(text)
    assert "script" not in page.tags
    assert "\x1b" not in text
    assert "<script>" in page.text


def test_an_empty_folder_report_has_no_calendar():
    page = Page(deployment_html(Deployment(), "empty"))
    assert "no passages in 0.0 hours" in page.text
    assert "img" not in page.tags


def test_a_reason_is_said_once_with_its_passages():
    def row(contact, **reasons):
        return {"contact": contact, "reasons": reasons}

    said = reasons_once([
        row(1, course_deg="no bearing", side="no bearing", time_utc="unknown"),
        row(2, course_deg="no bearing", side="no bearing", speed_mps="no line"),
    ])  # fmt: skip
    assert said == ["No course, side: no bearing.", "No speed: no line (passage 2)."]


def test_a_folder_is_reported_by_the_command(uwtrack, noise_wav, tmp_path):
    assert uwtrack("report", ".").exit_code == 1
    assert uwtrack("run", noise_wav, "-q").exit_code == 0
    done = uwtrack("report", ".")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "report.html").read_text()
    assert "0.0 hours of sound" in text
    again = uwtrack("report", ".")
    assert again.exit_code == 1
    assert "--overwrite" in again.stderr
    assert uwtrack("report", ".", "--step", "cpa", "-o", "b.html").exit_code == 2


@pytest.mark.slow
def test_a_folder_leads_to_the_pages_of_its_passages(uwtrack, timed_run, tmp_path):
    """Each passage has a picture, a link to the page of its product, and its sound."""
    shutil.copy(timed_run, tmp_path / "a.run.h5")
    done = uwtrack("report", ".", "--pages")
    assert done.exit_code == 0, done.output
    page = Page((tmp_path / "report.html").read_text())
    assert "a.run.html#passage-1" in page.addresses
    assert 'id="passage-1"' in (tmp_path / "a.run.html").read_text()
    for word in ("1 passage in 0.0 hours", "Levels by the hour", "Map", "all"):
        assert word in page.text
    assert "audio" not in page.tags
    assert page.tags.count("img") == len(page.alternatives)
    assert all(len(text) > 20 for text in page.alternatives)
    (tmp_path / "a.run.html").unlink()
    assert uwtrack("report", ".", "--overwrite").exit_code == 0
    page = Page((tmp_path / "report.html").read_text())
    assert "#passage-1" in page.addresses  # it is shown at large in its place


def test_counts_of_a_folder_add_up():
    page = Page(deployment_html(deployment(), "spring"))
    assert page.rows["Days"][-1] == ["all", "3.0", "3"]
    assert sum(float(row[1]) for row in page.rows["Days"][1:-1]) == 3.0
    assert sum(int(row[-1]) for row in page.rows["Days"][1:-1]) == 3
    assert page.rows["Vessels"][1:] == [["not named", "2"], ["FERRY", "1"], ["all", "3"]]
    heads, *rows = page.rows["Passages"]
    assert "speed kn" in heads
    assert rows[0][heads.index("speed kn")] == "9.7 ± 0.2"
    page = Page(deployment_html(deployment(), "spring", units="m/s"))
    assert "5.00 ± 0.10" in page.text


def test_hours_are_medians_and_references_never_mix():
    """The median of an hour counts each file as often as it has rows."""
    rng = np.random.default_rng(3)
    level = rng.normal(80.0, 3.0, (3600, 2)).astype(np.float32)

    def part(rows, reference="1 uPa"):
        return Decidecades(
            time_s=np.arange(3600.0)[rows] + 0.5, centre_hz=np.array([100.0, 125.9]),
            level_db=level[rows], average_s=1.0, reference=reference, sensor="h1",
            start_utc_ns=DAY,
        )  # fmt: skip

    (whole,) = by_hour(hour_levels(part(slice(None))))
    np.testing.assert_allclose(whole.median_db, np.median(level, axis=0), atol=1e-5)
    power = 10 * np.log10(np.sum(10 ** (level / 10), axis=1))
    np.testing.assert_allclose(whole.whole_db, np.quantile(power, [0.1, 0.5, 0.9]))
    parts = [part(slice(0, 1200)), part(slice(1200, 2400)), part(slice(2400, None))]
    (joined,) = by_hour(h for one in parts for h in hour_levels(one))
    assert joined.rows == 3600
    np.testing.assert_allclose(joined.median_db, whole.median_db, atol=0.3)
    other = [*parts, part(slice(0, 100), "full scale")]
    assert len(by_hour(h for one in other for h in hour_levels(one))) == 2


@pytest.mark.parametrize("speed_up", [1.0, 4.0])
def test_an_ear_hears_the_band_of_a_passage(speed_up):
    """A tone in the band keeps its frequency times the speed, one outside is gone."""
    rate = 32_000.0
    time_s = np.arange(round(4 * rate)) / rate
    sound = np.sin(2 * np.pi * 100.0 * time_s) + np.sin(2 * np.pi * 6000.0 * time_s)
    cut, rate_hz = in_band(sound, rate, (60.0, 300.0))
    content = flac_bytes(cut, round(rate_hz * speed_up))
    heard, played_hz = soundfile.read(io.BytesIO(content))
    power = np.abs(np.fft.rfft(heard)) ** 2
    frequency = np.fft.rfftfreq(heard.size, 1.0 / played_hz)
    assert frequency[np.argmax(power)] == pytest.approx(100.0 * speed_up, rel=0.01)
    near = np.abs(frequency - 100.0 * speed_up) < 5.0 * speed_up
    assert power[~near].sum() < 1e-3 * power.sum()
    assert np.abs(heard).max() == pytest.approx(0.9, abs=0.01)
    assert heard.size / played_hz == pytest.approx(4.0 / speed_up, rel=0.01)


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--speed-up", "4"], "with --sound"), (["--within-m", "9"], "with --ais"),
     (["--sound", "--speed-up", "99"], "at least 0.1, at most 32"), (["--pages"], "one result file")],
)  # fmt: skip
def test_what_a_report_would_not_use_is_refused(uwtrack, timed_run, words, said, tmp_path):
    done = uwtrack("report", timed_run, *words, "-o", "r.html")
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert not (tmp_path / "r.html").exists()


@pytest.mark.slow
def test_a_report_carries_the_sound_of_a_passage(uwtrack, timed_run, tmp_path):
    done = uwtrack("report", timed_run, "--sound", "--speed-up", "4", "-o", "r.html")
    assert done.exit_code == 0, done.output
    page = Page((tmp_path / "r.html").read_text())
    sounds = [a for a in page.addresses if a.startswith("data:audio/flac;base64,")]
    assert len(sounds) == 1
    assert "4 times faster" in page.text
    assert not any(a.startswith(("http", "//")) for a in page.addresses)
