"""One table over many results: each passage once, nothing lost, read once."""

import csv
import gzip
import io
import json
import sys
from dataclasses import fields, replace
from pathlib import Path

import duckdb
import h5py
import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.data.decidecades import RadiatedLevels
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum
from uwtrack_cli.files.hdf5.product import write_product
from uwtrack_cli.flow import passages
from uwtrack_cli.flow.passages import PassageRow, collect_passages, count_passages
from uwtrack_cli.flow.sound_hours import SoundSpan

START_NS = 1_714_564_800 * 10**9  # 2024-05-01T12:00:00Z


def write_result(
    path, day=0, times=(100.0,), sensor="h1", place=(35.0, 128.5), more=(), start_ns=None, **facts
):
    """Write a product with passages at some times of a day."""
    start = START_NS + day * 86_400 * 10**9 if start_ns is None else start_ns
    own = Sensor(id=sensor, latitude=place[0], longitude=place[1])
    recording = Recording(
        sensor=own, name=f"{path.stem}.wav", sample_rate_hz=1000.0, n_samples=600_000,
        n_channels=1, start_utc_ns=start, **{"digest": f"{day:064x}", **facts},
    )  # fmt: skip
    rows = [
        {"sensor": sensor, "time_s": t, "time_utc_ns": start + round(t * 1e9),
         "speed_mps": 6.0, "speed_std_mps": 0.1}
        for t in times
    ]  # fmt: skip
    found = encounters_of(*rows)
    write_product(path, [recording, own, found, *more], overwrite=True)
    return path


def levels_of(contact, sensor="h1", heard=168.25):
    """Radiated levels of a passage in two bands, one of them not heard."""
    return RadiatedLevels(
        contact=np.full(2, contact), sensor=np.array([sensor, sensor]),
        time_utc_ns=np.full(2, -1), centre_hz=np.array([63.0, 1000.0]),
        radiated_noise_level_db=np.array([heard, np.nan]),
        radiated_noise_level_std_db=np.array([0.5, np.nan]),
        received_level_db=np.array([120.0, 90.0]),
        background_level_db=np.array([100.0, 89.0]), reason_level=np.array([1]),
        reason_key=np.array(["radiated_noise_level_db"]), reason_text=np.array(["weak"]),
        spreading_db=20.0, reference="1 uPa",
    )  # fmt: skip


def test_levels_stand_beside_their_passages(tmp_path, uwtrack):
    folder = tmp_path / "r"
    folder.mkdir()
    write_result(folder / "a.h5", 0, (100.0, 300.0), more=[levels_of(2)])
    write_result(folder / "b.h5", 1, (100.0,), more=[levels_of(1, heard=171.0)])
    table = collect_passages([folder])
    assert [(r.contact, r.centre_hz, r.radiated_noise_level_db) for r in table.levels] == [
        (2, 63.0, 168.25), (2, 1000.0, None), (1, 63.0, 171.0), (1, 1000.0, None)
    ]  # fmt: skip
    assert table.levels[0].time_utc == table.passages[1].time_utc
    shown = uwtrack("passages", folder, "--bands")
    assert "168.2 ± 0.5" in shown.stdout
    assert "not ISO 17208" in shown.stderr
    again = uwtrack("passages", folder, "--bands", "--to", "csv").stdout
    assert len(list(csv.DictReader(io.StringIO(again)))) == 4
    query = (
        "SELECT p.contact, max(l.radiated_noise_level_db) AS top FROM passages p "
        "JOIN levels l USING (file, contact) GROUP BY ALL ORDER BY top"
    )
    found = uwtrack("passages", folder, "--sql", query, "--to", "json").stdout
    assert json.loads(found) == [{"contact": 2, "top": 168.25}, {"contact": 1, "top": 171}]
    target = tmp_path / "l.parquet"
    uwtrack("passages", folder, "--bands", "--to", "parquet", "-o", target)
    assert len(duckdb.read_parquet(str(target)).fetchall()) == 4


def test_passages_without_levels_say_what_they_need(tmp_path, uwtrack):
    path = write_result(tmp_path / "a.h5")
    done = uwtrack("passages", path, "--bands")
    assert "need a calibrated sensor" in done.stderr


@pytest.fixture
def folder(tmp_path):
    """Three days with two passages each, and what else lies in such a folder."""
    for day in range(3):
        write_result(tmp_path / f"day{day}.run.h5", day, times=(100.0, 400.0))
    (tmp_path / "notes.txt").write_text("nothing")
    return tmp_path


def test_every_passage_is_a_row_in_the_order_of_time(folder):
    table = collect_passages([folder])
    assert [row.time_utc[:16] for row in table.passages] == [
        f"2024-05-0{day}T12:{minute}" for day in (1, 2, 3) for minute in ("01", "06")
    ]
    assert not table.problems
    assert table.n_read == 3
    row = table.passages[0]
    assert row.speed_mps == pytest.approx(6.0)
    assert row.recording == "day0.run.wav"


def test_several_views_of_a_recording_count_once(folder):
    write_result(folder / "day0.encounters.h5", 0, times=(100.0, 400.0))
    write_result(folder / "day0.levels.h5", 0, times=())
    assert len(collect_passages([folder]).passages) == 6
    write_result(folder / "other.run.h5", 0, times=(100.0,), first_sample=7)
    assert len(collect_passages([folder]).passages) == 7  # another segment of it


def test_a_damaged_product_is_named_and_left_out(folder):
    path = folder / "day1.run.h5"
    path.write_bytes(path.read_bytes()[:5000])
    table = collect_passages([folder])
    assert len(table.passages) == 4
    assert "day1.run.h5" in table.problems[0]


def test_a_product_that_lacks_what_is_read_is_named(folder):
    path = folder / "day1.run.h5"
    data = io.BytesIO(path.read_bytes()[:-LINE_BYTES])
    with h5py.File(data, "r+") as file:
        del file["h1/sensor"].attrs["kind"]
    append_checksum(data)
    path.write_bytes(data.getvalue())
    (problem,) = collect_passages([folder]).problems
    assert problem.startswith(f"left out: {path}: ")
    assert "lacks the attribute 'kind'" in problem


def test_results_of_every_layout_stand_in_one_table(folder):
    old = Path(__file__).parents[1] / "files" / "hdf5" / "version-2.h5.gz"
    (folder / "old.h5").write_bytes(gzip.decompress(old.read_bytes()))
    table = collect_passages([folder])
    assert not table.problems
    assert len(table.passages) > 6


def test_one_identifier_at_two_places_is_said(folder):
    write_result(folder / "far.run.h5", 4, place=(36.0, 128.5))
    (problem,) = collect_passages([folder]).problems
    assert "'h1'" in problem
    assert "different ids" in problem


def test_only_what_is_new_is_read(folder, tmp_path):
    cache = tmp_path / "cache" / "p.sqlite"
    first = collect_passages([folder], cache=cache)
    again = collect_passages([folder], cache=cache)
    assert again.n_read == 0
    assert again.passages == first.passages
    write_result(folder / "day1.run.h5", 1, times=(100.0,))
    (folder / "day2.run.h5").unlink()
    write_result(folder / "day5.run.h5", 5)
    third = collect_passages([folder], cache=cache)
    assert third.n_read == 2
    assert len(third.passages) == 4
    cache.write_bytes(b"no database")
    assert len(collect_passages([folder], cache=cache).passages) == 4


def test_a_remembered_product_is_named_as_it_is_named_now(folder, tmp_path, monkeypatch):
    """A report of a folder finds its products from any other one."""
    cache = tmp_path / "cache" / "p.sqlite"
    monkeypatch.chdir(folder)
    collect_passages([Path()], cache=cache)
    monkeypatch.chdir(tmp_path)
    again = collect_passages([folder], cache=cache)
    assert again.n_read == 0
    assert {Path(row.file).parent for row in again.passages} == {folder}


def test_what_was_read_before_an_interrupt_is_not_read_again(folder, tmp_path, monkeypatch):
    cache = tmp_path / "p.sqlite"
    whole = passages.read_many

    def until_the_last(function, paths):
        for path, value in zip(paths, whole(function, paths), strict=True):
            if path.name == "day2.run.h5":
                raise KeyboardInterrupt
            yield value

    monkeypatch.setattr(passages, "read_many", until_the_last)
    with pytest.raises(KeyboardInterrupt):
        collect_passages([folder], cache=cache)
    monkeypatch.setattr(passages, "read_many", whole)
    assert collect_passages([folder], cache=cache).n_read == 1


def test_counts_are_per_day_month_and_sensor(folder):
    """Ten minutes a day, half an hour of a recording without a start time."""
    table = collect_passages([folder])
    row = table.passages[0]
    table.passages.append(replace(row, time_utc=None, sensor="h2"))
    table.sound.append(SoundSpan("h2", "x.wav", 0, 1800 * 10**9))
    a_day = {"passages": 2, "hours": 0.167, "passages_per_hour": 12.0}
    assert count_passages(table, "day") == [
        {"day": "2024-05-01", **a_day},
        {"day": "2024-05-02", **a_day},
        {"day": "2024-05-03", **a_day},
        {"day": "unknown", "passages": 1, "hours": 0.5, "passages_per_hour": 2.0},
    ]
    assert count_passages(table, "month")[0] == {
        "month": "2024-05", "passages": 6, "hours": 0.5, "passages_per_hour": 12.0
    }  # fmt: skip
    h1, h2 = count_passages(table, "sensor")
    assert (h1["sensor"], h1["hours"]) == ("h1", 0.5)
    assert (h2["sensor"], h2["hours"]) == ("h2", 0.5)
    assert count_passages(table, "vessel") == [{"vessel": "unknown", "passages": 7}]


def test_sound_that_several_results_read_is_counted_once(tmp_path, uwtrack):
    """Two recordings of ten minutes, the second begins five minutes into the first."""
    write_result(tmp_path / "a.run.h5", 0, times=())
    half = START_NS + 300 * 10**9
    write_result(tmp_path / "b.run.h5", 0, start_ns=half, times=(), digest="b" * 64)
    write_result(tmp_path / "c.run.h5", 0, times=(), sensor="h2")
    words = ("passages", tmp_path, "--fresh", "--to", "json", "--per")
    (day,) = json.loads(uwtrack(*words, "day").stdout)
    assert day == {"day": "2024-05-01", "passages": 0, "hours": 0.417, "passages_per_hour": 0.0}
    rows = json.loads(uwtrack(*words, "sensor").stdout)
    assert [row["hours"] for row in rows] == [0.25, 0.167]
    assert uwtrack("report", tmp_path, "-o", "r.html").exit_code == 0
    assert "no passages in 0.4 hours" in (tmp_path / "r.html").read_text()


@pytest.fixture
def listed(uwtrack, monkeypatch, folder):
    """Run the command over the folder, with a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))

    def run(*words):
        done = uwtrack("passages", folder, *words)
        assert done.exit_code == 0, done.output
        return done

    return run


def test_the_command_prints_tables_that_others_read(listed, folder):
    assert listed().stdout.count("2024-05-0") == 6
    rows = list(csv.DictReader(io.StringIO(listed("--to", "csv").stdout)))
    assert len(rows) == 6
    assert float(rows[0]["speed_mps"]) == pytest.approx(6.0)
    lines = listed("--to", "jsonl").stdout.splitlines()
    assert [json.loads(line)["sensor"] for line in lines] == ["h1"] * 6
    listed("--to", "parquet", "-o", folder / "p.parquet")
    found = duckdb.read_parquet(str(folder / "p.parquet")).fetchall()
    assert len(found) == 6
    assert str(found[0][0]).startswith("2024-05-01 12:01")
    counted = listed("--per", "month", "--to", "csv").stdout.splitlines()
    assert counted == ["month,passages,hours,passages_per_hour", "2024-05,6,0.5,12"]


def test_sql_sees_the_table_and_nothing_else(listed, uwtrack, folder):
    query = "SELECT sensor, count(*) AS n, avg(speed_mps) AS v FROM passages GROUP BY 1"
    (row,) = json.loads(listed("--sql", query, "--to", "json").stdout)
    assert row == {"sensor": "h1", "n": 6, "v": pytest.approx(6.0)}
    secret = folder / "secret.csv"
    secret.write_text("a\n1\n")
    for bad in (f"FROM '{secret}'", "SELECT nothing FROM passages", "DROP"):
        done = uwtrack("passages", folder, "--sql", bad)
        assert done.exit_code == 2, done.output
        assert "is not understood" in done.stderr


@pytest.mark.parametrize(
    ("columns", "n_shown"), [(None, len(fields(PassageRow))), ("100", 9), ("40", 3)]
)
def test_a_wide_query_is_not_wrapped(listed, monkeypatch, columns, n_shown):
    """As many columns as fit a screen, and the others named; a pipe takes all."""
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns is not None:
        monkeypatch.setenv("COLUMNS", columns)
    done = listed("--sql", "SELECT * FROM passages")
    lines = done.stdout.splitlines()
    assert len(lines) == 7  # a line a row, and the heads
    assert len(lines[0].split()) == n_shown
    assert columns is None or max(map(len, lines)) <= int(columns)
    assert ("no room for" in done.stderr) == (columns is not None)


def test_a_passage_is_named_by_recording_and_contact(listed):
    heads, first, *_ = listed().stdout.splitlines()
    assert heads.split()[-2:] == ["recording", "contact"]
    assert first.split()[-2:] == ["day0.run.wav", "1"]


@pytest.mark.parametrize("words", [("--sql", "SELECT 1"), ("--to", "parquet")])
def test_without_duckdb_its_install_command_is_said_before_the_work(
    uwtrack, folder, monkeypatch, words
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setitem(sys.modules, "duckdb", None)
    done = uwtrack("passages", folder, *words, "-o", "p.out")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "pip install 'uwtrack[catalogue]'" in done.stderr
    assert not (folder / "cache").exists()  # nothing was read


@pytest.mark.parametrize(
    ("words", "text", "code"),
    [
        (("--per", "day", "--sql", "SELECT 1"), "give one.", 2),
        (("--bands", "--per", "day"), "give one.", 2),
        (("--bands", "--to", "geojson"), "levels go to table", 2),
        (("--to", "parquet"), "name its file with --output", 2),
        (("--per", "day", "--to", "geojson"), "holds passages", 2),
        (("--ais", "none.csv"), "none.csv", 1),
    ],
)
def test_what_does_not_fit_is_refused(uwtrack, folder, words, text, code):
    done = uwtrack("passages", folder, *words)
    assert done.exit_code == code
    assert text in " ".join(done.stderr.split())


def test_an_empty_folder_and_a_missing_file_are_named(uwtrack, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "holds no result file" in uwtrack("passages", "empty").stderr
    assert "does not exist" in uwtrack("passages", "nowhere.h5").stderr


def test_a_run_is_in_the_table_with_its_position(uwtrack, pass_run, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    features = json.loads(uwtrack("passages", pass_run, "--to", "geojson").stdout)
    (feature,) = features["features"]
    assert feature["properties"]["status"] == "ok"
    assert np.abs(np.array(feature["geometry"]["coordinates"])).max() > 1.0
