"""Reports: reasons once, warnings first, a folder at a glance, and safe text."""

from html.parser import HTMLParser

import numpy as np

from uwtrack_cli.flow.deployment import Deployment, Listened
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.flow.sound_hours import SoundSpan
from uwtrack_cli.plotting.deployment_report import calendar_figure, deployment_html
from uwtrack_cli.plotting.report import reasons_once

HOUR_NS = 3600 * 10**9
DAY = 1_714_521_600 * 10**9
"""2024-05-01T00:00:00Z."""


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.tags, self.addresses, self.text = [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        names = {"src", "href", "srcset", "action", "data", "poster"}
        self.addresses += [value for name, value in attrs if name in names]

    def handle_data(self, data):
        self.text += data


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
    for word in (
        "2024-05-01",
        "2024-05-02",
        "FERRY",
        "Without a start time",
        "a.run.h5",
    ):
        assert word in page.text
    assert page.tags.count("img") == 1
    assert len(page.addresses) == 2
    assert all(a.startswith("data:image/png;base64,") for a in page.addresses)


def test_the_calendar_cuts_sound_at_midnight():
    upper = calendar_figure(deployment(), 11.0).axes[0]
    bars = sorted((p.get_x(), p.get_width(), round(p.get_y() + p.get_height() / 2, 6))
                  for p in upper.patches)  # fmt: skip
    lengths = [width for _, width, _ in bars]
    np.testing.assert_allclose(lengths, [1.0, 1.0, 1.0])  # two of sound, one of vessels
    assert [x for x, _, _ in bars] == [0.0, 23.0, 23.0]
    (marks,) = [line for line in upper.lines if line.get_linestyle() == "None"]
    np.testing.assert_allclose(marks.get_xdata(), [23.5, 0.5])
    assert [t.get_text() for t in upper.get_yticklabels()] == [
        "2024-05-01",
        "2024-05-02",
    ]


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
    assert said == [
        "No course_deg, side: no bearing.", "No speed_mps: no line (passage 2)."
    ]  # fmt: skip


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
