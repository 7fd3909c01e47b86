"""Names that look like markup, formulas or escape sequences do nothing anywhere."""

import csv
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import soundfile
from matplotlib.figure import Figure

from uwtrack_cli.cli.console import put, say, show_table
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.text_escaping import csv_cell, figure_text, plain_text, xml_text

SENSOR = '=HYPERLINK("http://x";"y")[/x][b]a$^$b<i>&amp;'
NAME = "pass[left][bold]\x1b[31m\n\x9b$^$<b>=1.wav"
ESCAPED = r"pass[left][bold]\u001b[31m\u000a\u009b$^$<b>=1.wav"
EVERYTHING = "".join(map(chr, [*range(0x300), *range(0x2000, 0x2070), 0xD800, 0xFFFE]))
STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\ud800-\udfff]")


@pytest.fixture(scope="session")
def hostile(tmp_path_factory, short_pass):
    """A product of a recording and a sensor with such names."""
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("hostile")
    shutil.copy(short_pass, folder / NAME)
    (folder / "sensor.toml").write_text(
        f"id = '{SENSOR}'\ndepth_m = 20.0\nlatitude = 50.0\nlongitude = -4.0\n"
        'kind = "difar"\nchannels = ["omni", "east", "north"]\n'
    )
    words = ["run", folder / NAME, "--sensor", folder / "sensor.toml", "-v"]
    done = CliRunner().invoke(app, [*map(str, words), "-o", str(folder / "p\x1b.run.h5")])
    assert done.exit_code == 0, done.output
    assert f"wrote {folder}" in done.stderr
    assert SENSOR in done.stderr.replace("\n", "").replace(" ", "")
    return folder / "p\x1b.run.h5"


def test_a_terminal_shows_names_and_obeys_none(uwtrack, hostile):
    for words in (["info", hostile], ["show", hostile, "lines"], ["verify", hostile],
                  ["show", hostile, "encounters", "--format", "json"]):  # fmt: skip
        done = uwtrack(*words)
        assert done.exit_code == 0, done.output
        assert not STEERING.search(done.stdout + done.stderr)


@pytest.mark.slow
def test_a_batch_says_the_names_and_its_report_is_read_back(uwtrack, hostile, tmp_path):
    (tmp_path / "in").mkdir()
    shutil.copy(hostile.parent / NAME, tmp_path / "in" / NAME)
    (tmp_path / "in" / "x[left]\x1b[31m.wav").write_text("no sound")
    sensor = ("--sensor", hostile.with_name("sensor.toml"))
    words = ["in", "-o", "out", "--jobs", 1, "-v", *sensor, "--recipe", "vessel"]
    done = uwtrack("batch", *words)
    assert done.exit_code == 3, done.output
    assert "1 done, 1 failed" in done.stderr
    shown = re.sub(r"\s", "", done.stderr)
    assert "pass[left][bold]\\u001b[31m\\u000a\\u009b$^$<b>=1.wav" in shown
    assert r"x[left]\u001b[31m.wav" in shown
    raw = (tmp_path / "out" / "batch.jsonl").read_text()
    assert not STEERING.search(raw)
    names = [Path(json.loads(line)["source"]).name for line in raw.splitlines()]
    assert NAME in names
    rows = csv.DictReader((tmp_path / "out" / "batch.csv").read_text().splitlines())
    assert any(row["source"].endswith(ESCAPED) for row in rows)


def test_a_spreadsheet_finds_no_formula(uwtrack, hostile):
    for form in ("csv", "raven"):
        target = hostile.with_name(f"out.{form}")
        words = ["--to", form, "-o", target]
        if form == "csv":
            words += ["--table", "encounters"]
        done = uwtrack("export", hostile, *words)
        assert done.exit_code == 0, done.output
        text = target.read_text()
        assert not STEERING.search(text)
        delimiter = "," if form == "csv" else "\t"
        cells = [c for row in csv.reader(io.StringIO(text), delimiter=delimiter) for c in row]
        assert f"'{SENSOR}" in cells
        assert not [c for c in cells if c.startswith("=")]
        if form == "raven":
            assert ESCAPED in cells


@pytest.mark.slow
def test_maps_and_pages_show_the_names_as_text(uwtrack, hostile):
    for form in ("kml", "geojson"):
        target = hostile.with_name(f"out.{form}")
        done = uwtrack("export", hostile, "--to", form, "-o", target)
        assert done.exit_code == 0, done.output
    names = [e.text for e in ET.parse(hostile.with_name("out.kml")).iter()  # noqa: S314 - our own
             if e.tag.endswith("name")]  # fmt: skip
    assert SENSOR in names
    features = json.loads(hostile.with_name("out.geojson").read_text())["features"]
    assert SENSOR in {feature["properties"].get("id") for feature in features}
    page = hostile.with_name("out.html")
    done = uwtrack("report", hostile, "-o", page)
    assert done.exit_code == 0, done.output
    assert not STEERING.search(page.read_text())
    parser = Tags()
    parser.feed(page.read_text())
    assert not parser.tags & {"i", "x"}
    assert SENSOR in parser.text
    assert ESCAPED in parser.text


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = set(), ""

    def handle_starttag(self, tag, _):
        self.tags.add(tag)

    def handle_data(self, data):
        self.text += data


def test_a_picture_shows_the_names_as_text(uwtrack, hostile):
    done = uwtrack("plot", hostile, "-o", hostile.with_name("out.svg"))
    assert done.exit_code == 0, done.output


def test_no_output_obeys_any_character():
    assert not STEERING.search(plain_text(EVERYTHING))
    assert json.loads(plain_text(json.dumps(EVERYTHING, ensure_ascii=False)))
    ET.fromstring(ET.tostring(element(xml_text(EVERYTHING))))  # noqa: S314
    for text in ("Grönland 東京 Ω", "a b", "ok", "-", "-1e3", "5"):
        assert csv_cell(text) == plain_text(text) == text
    for text in ("=1", "+A1", "-A1", "@SUM(1)"):
        assert csv_cell(text) == f"'{text}"
    assert csv_cell("\t=1") == "\\u0009=1"


def element(text):
    made = ET.Element("a")
    made.text = text
    return made


def test_matplotlib_sets_no_formula():
    from matplotlib.cbook import is_math_text

    for text in ("a$^$b", r"\$$", "$x$", "$$$", "a\\"):
        safe = figure_text(text)
        assert not is_math_text(safe)
        assert safe.replace(r"\$", "$") == text
    figure = Figure()
    figure.text(0.5, 0.5, figure_text("a$^$b"))
    figure.savefig(io.BytesIO())


def test_the_console_takes_no_markup(capsys):
    show_table(["name"], [["pass[left].wav"], ["[/x]"], [":smile:"], ["\x1b[2J"]])
    say("[/x]\x1b[2J", -1)
    put(["\x1b[2J"])
    written = capsys.readouterr()
    for text in ("pass[left].wav", "[/x]", ":smile:", r"\u001b[2J"):
        assert text in written.err
    assert "\x1b" not in written.err + written.out


def test_the_names_in_the_product_stay_what_they_are(hostile):
    with read_product(hostile) as product:
        lines = product.read(Lines, SENSOR)
    assert lines.frames.sensor == SENSOR
    assert np.isfinite(lines.time_s).all()


def test_a_name_without_marks_is_not_changed(uwtrack, tmp_path):
    path = tmp_path / "pass[left].wav"
    soundfile.write(path, np.zeros(4000) + 1e-3, 1000)
    done = uwtrack("batch", path, "-o", "out", "--jobs", 1)
    assert "pass[left].wav" in done.stderr
