"""Names of vessels by AIS reach every output; the vessels of the truth are found."""

import csv
import json
import re

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.files.hdf5.product import read_product

START = "2024-05-01T12:01:30Z"  # the middle of the sample's passage
CLOSEST_S, RANGE_M, SPEED_MPS, COURSE_DEG = 148.0, 249.98, 6.0, 81.0
"""The vessel of the sample passage, on the port side of which the sensor lies."""


@pytest.fixture(scope="session")
def ais(tmp_path_factory, samples):
    """The sample's vessel by geodesics, another one a mile off, and what agencies add."""
    facts = dict(
        line.split("#")[0].split(" = ")
        for line in (samples / "pass.sensor.toml").read_text().splitlines()
        if " = " in line
    )
    place = float(facts["latitude"]), float(facts["longitude"])
    rows = []
    for mmsi, name, range_m, late_s in (
        ("235000001", "FERRY", RANGE_M, 0.0), ("235000002", "FAR", 1900.0, 100.0)
    ):  # fmt: skip
        at = Geodesic.WGS84.Direct(*place, COURSE_DEG + 90.0, range_m)
        for k, second in enumerate(range(0, 300, 20)):
            along = SPEED_MPS * (second - CLOSEST_S - late_s)
            here = Geodesic.WGS84.Direct(at["lat2"], at["lon2"], COURSE_DEG, along)
            time = f"2024-05-01T12:{second // 60:02d}:{second % 60:02d}"
            told = "" if k == 0 else name  # as position reports without static data
            rows.append(
                (
                    mmsi,
                    time,
                    f"{here['lat2']:.7f}",
                    f"{here['lon2']:.7f}",
                    f"{SPEED_MPS / 0.514444:.2f}",
                    COURSE_DEG,
                    told,
                    60,
                    110,
                )
            )
    rows += rows[3:6]  # received twice
    rng = np.random.default_rng(1)
    path = tmp_path_factory.mktemp("ais") / "AIS_2024_05_01.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("MMSI", "BaseDateTime", "LAT", "LON", "SOG", "COG",
                         "VesselName", "VesselType", "Length"))  # fmt: skip
        writer.writerows(rows[k] for k in rng.permutation(len(rows)))
    return path


@pytest.fixture
def named(uwtrack, short_pass, ais):
    """A product with names, and what its run printed."""
    words = ["run", short_pass, "--start-utc", START, "-o", "pass.run.h5"]
    done = uwtrack(*words, "--ais", ais, "--json")
    assert done.exit_code == 0, done.output
    return done


@pytest.mark.slow
def test_a_name_reaches_every_output_of_a_run(uwtrack, named, short_pass, ais):
    (row,) = json.loads(named.stdout)
    assert row["vessel"]["name"] == "FERRY"
    assert row["vessel"]["mmsi"] == "235000001"
    assert 0.95 < row["vessel"]["probability"] <= 1.0
    assert "vessel" not in row["reasons"]
    with read_product("pass.run.h5") as product:
        assert product.read(Encounters).ais_name == ais.name
    assert re.search(r"FERRY \d+ %", uwtrack("show", "pass.run.h5").stdout)
    (passage,) = json.loads(uwtrack("passages", "pass.run.h5", "--to", "json", "--fresh").stdout)
    assert (passage["vessel"], passage["mmsi"]) == ("FERRY", "235000001")
    assert passage["vessel_probability"] == row["vessel"]["probability"]
    for form in ("csv", "geojson"):
        words = ["export", "pass.run.h5", "--to", form, "-o", f"out.{form}"]
        words += ["--table", "encounters"] if form == "csv" else []
        assert uwtrack(*words).exit_code == 0
        with open(f"out.{form}") as file:  # noqa: PTH123 - beside the command
            assert "FERRY" in file.read()
    words = ["rerun", "pass.run.h5", "-o", "again.h5", "--source", short_pass]
    again = uwtrack(*words, "--source", ais)
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", "pass.run.h5", "again.h5").exit_code == 0


@pytest.mark.slow
def test_a_report_names_what_was_found_without_a_table(uwtrack, timed_run, ais):
    done = uwtrack("report", timed_run, "-o", "named.html", "--ais", ais)
    assert done.exit_code == 0, done.output
    with open("named.html") as file:  # noqa: PTH123 - beside the command
        assert "FERRY" in file.read()


@pytest.mark.slow
def test_a_batch_names_and_makes_again_what_another_table_named(
    uwtrack, samples, short_pass, ais, tmp_path
):
    (tmp_path / "in").mkdir()
    sound = tmp_path / "in" / "h1_20240501_120130.wav"
    sound.write_bytes(short_pass.read_bytes())
    (tmp_path / "h1.toml").write_text((samples / "pass.sensor.toml").read_text())
    words = ["batch", "in", "-o", "out", "--jobs", 1, "--sensor", "h1.toml", "--resume"]
    words += ["--recipe", "vessel"]
    statuses = []
    for more in ([], ["--ais", ais], ["--ais", ais], ["--ais", ais, "--within-m", 100]):
        done = uwtrack(*words, *more, "--json")
        assert done.exit_code == 0, done.output
        (row,) = json.loads(done.stdout)
        names = [e["vessel"] and e["vessel"]["name"] for e in row["encounters"]]
        statuses.append((row["status"], *names))
    assert statuses == [("done", None), ("done", "FERRY"), ("resumed", "FERRY"), ("done", None)]
    (encounter,) = row["encounters"]
    assert encounter["reasons"]["vessel"].endswith("within 100 m fits")


def test_what_ais_cannot_name_is_refused_before_the_work(
    uwtrack, samples, short_pass, ais, tmp_path
):
    no_place = uwtrack("run", samples / "mono.wav", "--ais", ais, "-o", "m.h5")
    assert no_place.exit_code == 1
    assert "latitude and longitude" in no_place.stderr
    no_start = uwtrack("run", short_pass, "--ais", ais, "-o", "p.h5")
    assert no_start.exit_code == 1
    assert "--start-utc" in no_start.stderr
    assert not [*tmp_path.glob("*.h5")]
    live = uwtrack("run", "-", "-o", "l.h5", "--ais", ais)
    assert live.exit_code == 2
    assert "passages --ais" in live.stderr


def test_a_table_of_another_time_is_told_with_its_times(uwtrack, short_pass, ais, tmp_path):
    other = tmp_path / "other.csv"
    other.write_text(ais.read_text().replace("2024-05-01", "2023-05-01"))
    words = ["run", short_pass, "--start-utc", START, "-o", "p.run.h5"]
    words += ["--recipe", "vessel"]
    told = "other.csv has messages from 2023-05-01 12:00 to 2023-05-01 12:04 UTC"
    assert told in uwtrack(*words, "--ais", other).stderr
    done = uwtrack("passages", "p.run.h5", "--ais", other, "--fresh")
    assert f"no passage has a name: {told}" in done.stderr


@pytest.mark.slow
def test_a_passage_without_a_place_keeps_its_row(uwtrack, samples, ais):
    words = ["run", samples / "mono.wav", "--recipe", "vessel", "-o", "mono.run.h5"]
    assert uwtrack(*words, "-q").exit_code == 0
    words = ["passages", "mono.run.h5", "--ais", ais, "--to", "json", "--fresh"]
    done = uwtrack(*words)
    assert done.exit_code == 0, done.output
    assert [row["vessel"] for row in json.loads(done.stdout)] == [None]
    assert "without names of vessels" in done.stderr
