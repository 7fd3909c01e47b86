"""What is exported is read back by another program's reader, with the same numbers."""

import csv
import json
import shutil
import subprocess
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from fastkml import KML, Placemark
from fastkml.utils import find_all
from geographiclib.geodesic import Geodesic
from geojson_pydantic import FeatureCollection
from typer.testing import CliRunner

from tests.draws.sensor_tables import buoys
from tests.files.synthetic_containers import synthetic
from uwtrack_cli.cli.app import app
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.hdf5.netcdf import write_netcdf
from uwtrack_cli.files.hdf5.product import read_product

SPACE = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture
def exported(uwtrack, pass_run, tmp_path):
    """Export the passage, and return the file."""

    def export(form, *words):
        path = tmp_path / f"out.{form}"
        done = uwtrack("export", pass_run, "--to", form, "-o", path, *words)
        assert done.exit_code == 0, done.output
        assert done.stdout == ""
        return path

    return export


@pytest.fixture
def found(pass_run):
    with read_product(pass_run) as opened:
        return opened.read(Encounters), opened.read(Fixes)


def test_csv_is_read_by_pandas(exported, found):
    table = pd.read_csv(exported("csv"))
    assert table["latitude"].to_numpy() == pytest.approx(found[1].latitude)
    lines = pd.read_csv(exported("csv", "--table", "lines", "--overwrite"))
    assert {"line", "time_s", "frequency_hz"} <= set(lines.columns)


def test_what_lies_still_has_no_course_in_any_form(uwtrack, tmp_path):
    series, *_ = buoys(11, moving=False, rows=15, std_deg=2.0, strange=0.0)
    rows = zip(
        series.time_s, series.sensor, series.bearing_deg,
        50.0 + series.sensor_north_m / 111_000.0, series.sensor_east_m / 71_700.0,
        strict=True,
    )  # fmt: skip
    head = "time_utc,sensor,bearing_deg,sensor_latitude,sensor_longitude,bearing_std_deg"
    begin = np.datetime64("2024-05-01T00:00:00", "ms")
    (tmp_path / "still.csv").write_text("\n".join([head, *(
        f"{begin + np.timedelta64(round(1e3 * t), 'ms')}Z,{n},{b:.2f},{y:.7f},{x:.7f},2"
        for t, n, b, y, x in rows
    )]))  # fmt: skip
    fixes = tmp_path / "still.fixes.h5"
    done = uwtrack("locate", "still.csv", "--at", "600", "-o", fixes, "--json")
    (row,) = json.loads(done.stdout)
    assert (row["motion_model"], row["course_deg"]) == ("stationary", None)
    assert row["reasons"] == {"course_deg": "the source is read as still"}

    def export(form):
        path = tmp_path / f"out.{form}"
        done = uwtrack("export", fixes, "--to", form, "-o", path)
        assert done.exit_code == 0, done.output
        return path

    assert pd.read_csv(export("csv"))["course_deg"].isna().all()
    first = json.loads(export("geojson").read_text())["features"][0]["properties"]
    assert (first["course_deg"], first["motion_model"]) == (None, "stationary")
    page = export("kml").read_text()
    assert "motion_model: stationary" in page
    assert "course_deg" not in page
    # the region has its time, too, lest those of several times be taken for one
    assert page.count("<when>2024-05-01T00:10:00.000Z</when>") == 2
    # REP has no empty field: course and speed of what lies still are 0
    track = [line for line in export("rep").read_text().splitlines() if "CONTACT" in line]
    assert track[0].split()[-3:] == ["0.0", "0.00", "0"]


def ring_area(ring):
    x, y = np.array(ring).T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def test_geojson_follows_its_standard(exported, found):
    content = json.loads(exported("geojson").read_text())
    assert set(content) == {"type", "features"}
    assert content["type"] == "FeatureCollection"
    by_kind = {}
    for feature in content["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        geometry = feature["geometry"]
        assert set(geometry) == {"type", "coordinates"}
        by_kind.setdefault(feature["properties"]["kind"], []).append(geometry)
        if geometry["type"] == "Polygon":
            (ring,) = geometry["coordinates"]
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            assert ring_area(ring) > 0.0  # right-hand rule, RFC 7946 section 3.1.6
    assert set(by_kind) == {"sensor", "encounter", "track", "fix", "ellipse"}
    longitude, latitude = by_kind["encounter"][0]["coordinates"]
    line = Geodesic.WGS84.Inverse(35.0, 128.5, latitude, longitude)
    assert line["s12"] == pytest.approx(found[0].horizontal_range_m[0], abs=0.01)
    assert line["azi1"] % 360 == pytest.approx(found[0].bearing_deg[0], abs=0.01)


def test_geojson_is_accepted_by_a_schema(exported):
    text = exported("geojson").read_text()
    found = FeatureCollection.model_validate_json(text)
    shapes = [feature.geometry.type for feature in found.features]
    assert shapes == ["Point", "Point", "LineString", "Point", "Polygon"]


def test_the_ellipse_is_that_of_the_covariance(exported, found):
    content = json.loads(exported("geojson").read_text())
    (ellipse,) = [f for f in content["features"] if f["properties"]["kind"] == "ellipse"]
    fixes = found[1]
    inverse = np.linalg.inv(fixes.covariance_m2[0])
    for longitude, latitude in ellipse["geometry"]["coordinates"][0]:
        line = Geodesic.WGS84.Inverse(fixes.latitude[0], fixes.longitude[0], latitude, longitude)
        angle = np.radians(line["azi1"])
        off = line["s12"] * np.array([np.sin(angle), np.cos(angle)])
        assert off @ inverse @ off == pytest.approx(5.991, rel=2e-3)  # chi2, 95 %


def test_kml_is_a_document_of_placemarks(exported, found):
    root = ET.parse(exported("kml")).getroot()  # noqa: S314 - our own file
    assert root.tag == f"{SPACE}kml"
    marks = root.findall(f".//{SPACE}Placemark")
    points = {m.findtext(f"{SPACE}name"): m.find(f"{SPACE}Point") for m in marks}
    x, y = points["contact 1, mode 1"].findtext(f"{SPACE}coordinates").split(",")
    assert float(x) == pytest.approx(found[1].longitude[0])
    assert float(y) == pytest.approx(found[1].latitude[0])
    assert root.findtext(f".//{SPACE}when").startswith("2024-05-01T12:02:2")


def test_kml_is_valid_and_read_by_fastkml(exported, found):
    document = KML.parse(exported("kml"), validate=True)
    marks = {mark.name: mark for mark in find_all(document, of_type=Placemark)}
    mark = marks["contact 1, mode 1"]
    assert mark.geometry.x == pytest.approx(found[1].longitude[0])
    assert mark.geometry.y == pytest.approx(found[1].latitude[0])
    assert mark.times.timestamp.dt.isoformat().startswith("2024-05-01T12:02:28")


@pytest.mark.slow
def test_the_name_of_a_recording_is_no_formula(uwtrack, short_pass, tmp_path):
    shutil.copy(short_pass, tmp_path / "=1+1.wav")
    assert uwtrack("run", "./=1+1.wav", "-o", "a.h5", "--channel", 1, "-q").exit_code == 0
    assert uwtrack("export", "a.h5", "--to", "raven", "-o", "a.txt").exit_code == 0
    lines = (tmp_path / "a.txt").read_text().splitlines()
    rows = list(csv.DictReader(lines, delimiter="\t"))
    assert {row["Begin File"] for row in rows} == {"'=1+1.wav"}


def test_a_raven_selection_table_is_read_by_pandas(exported):
    table = pd.read_csv(exported("raven"), sep="\t")
    assert list(table["Selection"]) == list(range(1, len(table) + 1))
    assert (table["End Time (s)"] > table["Begin Time (s)"]).all()
    assert (table["High Freq (Hz)"] > table["Low Freq (Hz)"]).all()
    assert set(table["Begin File"]) == {"pass.wav"}
    assert table["File Offset (s)"].to_numpy() == pytest.approx(table["Begin Time (s)"].to_numpy())
    for rest_hz in (63.0, 126.0, 189.0, 310.0):
        inside = (table["Low Freq (Hz)"] < rest_hz) & (table["High Freq (Hz)"] > rest_hz)
        assert inside.any()


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # crowsetta's own use
def test_a_raven_selection_table_is_read_by_crowsetta(exported):
    crowsetta = pytest.importorskip("crowsetta")
    path = exported("raven")
    boxes = crowsetta.formats.bbox.Raven.from_file(
        path.rename(path.with_suffix(".txt")), annot_col="Status"
    ).to_bbox()
    assert {box.label for box in boxes} == {"moving"}
    for rest_hz in (63.0, 126.0, 189.0, 310.0):
        (box,) = [b for b in boxes if b.low_freq < rest_hz < b.high_freq]
        assert box.onset < 148.0 < box.offset


@pytest.mark.slow
def test_netcdf_is_opened_by_xarray_with_its_times(exported, found):
    with xr.open_dataset(exported("netcdf"), engine="h5netcdf") as data:
        assert data.attrs["Conventions"].startswith("CF-")
        expected = np.array(found[1].time_utc_ns, "datetime64[ns]")
        apart = np.abs(data["fixes_time_s"].to_numpy() - expected)
        assert (apart < np.timedelta64(1, "us")).all()
        np.testing.assert_array_equal(data["fixes_latitude"], found[1].latitude)
        assert data["fixes_latitude"].attrs["units"] == "degrees_north"
        np.testing.assert_array_equal(data["encounters_status"], found[0].status)
        assert data["h1_sensor"].attrs["depth_m"] == 22.0
        assert "h1_lines_frequency_hz" in data
        assert data["h1_overview_shade"].dims == ("time", "frequency")
        assert data["frequency"].attrs == {"units": "Hz", "standard_name": "sound_frequency"}
        assert data["time"].dtype.kind == "M"


@pytest.mark.parametrize("kind", CONTAINERS.values(), ids=list(CONTAINERS))
def test_netcdf_takes_every_container(tmp_path, kind):
    """No column has the name of a dimension, as `association_row` once had."""
    made = synthetic(kind, 3)
    write_netcdf(tmp_path / "x.nc", [(made, "")], [])
    with xr.open_dataset(tmp_path / "x.nc", engine="h5netcdf", decode_times=False) as held:
        for name in made.columns():
            if getattr(made, name) is not None:
                assert any(k.endswith(f"{made.NAME}_{name}") for k in held.variables)


@pytest.mark.parametrize("form", ["geojson", "kml"])
def test_a_map_needs_a_place_on_earth(uwtrack, noise_wav, form):
    assert uwtrack("run", noise_wav, "-q", "-o", "n.h5").exit_code == 0
    done = uwtrack("export", "n.h5", "--to", form)
    assert done.exit_code == 1
    assert "latitude and longitude" in done.stderr


def test_an_export_never_replaces_a_file_unasked(uwtrack, pass_run, tmp_path):
    (tmp_path / "mine.csv").write_text("mine")
    done = uwtrack("export", pass_run, "--to", "csv", "-o", "mine.csv")
    assert done.exit_code == 1
    assert "--overwrite" in done.stderr
    assert (tmp_path / "mine.csv").read_text() == "mine"
    words = ["export", pass_run, "--to", "csv", "-o", pass_run, "--overwrite"]
    assert uwtrack(*words).exit_code == 1


class Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.addresses, self.text = [], [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        names = {"src", "href", "action", "data", "srcset", "poster", "background"}
        self.addresses += [value for name, value in attrs if name in names]

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="session")
def page_file(pass_run):
    path = pass_run.with_name("page.html")
    done = CliRunner().invoke(app, ["report", str(pass_run), "-o", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture
def page(page_file):
    return page_file.read_text()


def test_a_report_refers_to_no_address(page):
    parsed = Page()
    parsed.feed(page)
    assert parsed.addresses
    assert all(a.startswith("data:image/png;base64,") for a in parsed.addresses)
    assert "://" not in page
    assert "@import" not in page
    assert "url(" not in page
    assert not set(parsed.tags) & {"script", "link", "iframe", "object", "embed"}


def test_a_report_tells_results_facts_and_history(page, found):
    parsed = Page()
    parsed.feed(page)
    for word in ("pass.wav", "2000 Hz", "Passages", "speed kn", "dB re 1 uPa", "port", "track", "SHA-256",
                 f"{found[0].speed_mps[0] / KNOT_MPS:.2f} ± ", "63.00"):  # fmt: skip
        assert word in parsed.text


@pytest.mark.slow
def test_names_in_a_report_are_text_and_nothing_more(uwtrack, noise_wav, tmp_path):
    noise_wav.rename(tmp_path / "<script>alert(1)<.wav")
    assert uwtrack("run", "<script>alert(1)<.wav", "-q", "-o", "n.h5").exit_code == 0
    assert uwtrack("report", "n.h5", "-o", "n.html").exit_code == 0
    text = (tmp_path / "n.html").read_text()
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


@pytest.mark.slow
def test_a_report_of_two_sensors_draws_each_of_them(uwtrack, two_sensors_run, tmp_path):
    fused = two_sensors_run / "two-sensors-h1.fixes.h5"
    assert uwtrack("report", fused, "-o", "two.html").exit_code == 0
    parsed = Page()
    parsed.feed((tmp_path / "two.html").read_text())
    assert parsed.text.count("h1") > 1
    assert parsed.text.count("h2") > 1
    # one page of both sensors and a card each, in a wide and a narrow rendering
    assert parsed.tags.count("img") == 3
    assert len(set(parsed.addresses)) == 6


BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_report_is_drawn_by_a_browser(page_file, tmp_path):
    done = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
         "--disable-background-networking", "--disable-component-update",
         "--disable-sync", f"--user-data-dir={tmp_path / 'profile'}",
         f"--screenshot={tmp_path / 'page.png'}", page_file],
        capture_output=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0
    assert (tmp_path / "page.png").stat().st_size > 10_000


def test_residuals_of_a_table_are_exported(uwtrack, samples, tmp_path):
    for name in ("bearings.csv", "own-ship.csv"):
        (tmp_path / name).write_bytes((samples / name).read_bytes())
    words = ["tma", "bearings.csv", "--own-ship", "own-ship.csv", "-q", "-o", "b.h5"]
    assert uwtrack(*words, "--sound-speed-mps", 1480).exit_code == 0
    rows = ["--table", "motions", "--axis", "row"]
    done = uwtrack("export", "b.h5", "--to", "csv", *rows, "-o", "rows.csv")
    assert done.exit_code == 0, done.output
    head, *lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert head.split(",")[-1] == "row_residual_deg"
    assert len(lines) == len((tmp_path / "bearings.csv").read_text().splitlines()) - 1
    assert uwtrack("show", "b.h5", "motions", "--axis", "row").exit_code == 0
    alone = uwtrack("export", "b.h5", "--to", "csv", "--axis", "row", "-o", "c.csv")
    assert alone.exit_code == 2
    assert "needs --table" in alone.stderr
    wrong = uwtrack("show", "b.h5", "motions", "--axis", "lobe")
    assert wrong.exit_code == 2
    assert "it has motion" in wrong.stderr
    assert uwtrack("show", "b.h5", "--axis", "row").exit_code == 2
