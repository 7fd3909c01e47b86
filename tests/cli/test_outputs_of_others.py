"""What a batch or a watch did not make itself is never replaced without being asked."""

import json

import h5py
import numpy as np
import pytest
import soundfile

RATE = 1000
BATCH = ("batch", "in", "-o", "out", "--jobs", 1, "--recipe", "vessel", "-q")
WATCH = ("watch", "in", "-o", "out", "--recipe", "vessel", "--settle-s", "0.1",
         "--idle-s", "0.3", "-q")  # fmt: skip


def record(path, seed=1):
    path.parent.mkdir(exist_ok=True)
    sound = 0.1 * np.random.default_rng(seed).standard_normal(5 * RATE)
    soundfile.write(path, sound, RATE, subtype="PCM_16")


@pytest.fixture
def folder(tmp_path):
    record(tmp_path / "in" / "a.wav")
    (tmp_path / "out").mkdir()
    return tmp_path


def statuses(folder):
    lines = (folder / "out" / "batch.jsonl").read_text().splitlines()
    return {row["source"][-5:]: row["status"] for row in map(json.loads, lines)}


def other_program(path):
    with h5py.File(path, "w") as file:
        file["depth_m"] = np.arange(9.0)


def notes(path):
    path.write_text("my notes")


@pytest.mark.parametrize("make", [notes, other_program])
@pytest.mark.parametrize(
    "words", [(*BATCH, "--resume"), (*BATCH, "--overwrite"), (*WATCH, "--overwrite")]
)
def test_a_file_that_is_no_product_stays(folder, uwtrack, make, words):
    path = folder / "out" / "a.run.h5"
    make(path)
    content = path.read_bytes()
    assert uwtrack(*words).exit_code == 3
    assert path.read_bytes() == content
    (report,) = folder.glob("out/*.jsonl")
    assert "was not written by uwtrack" in report.read_text()


@pytest.mark.parametrize("name", ["batch.csv", "batch.jsonl", "watch.jsonl"])
@pytest.mark.parametrize("content", ["my notes\n", "my notes", '{"a": 1}\n', "[]"])
def test_a_file_that_is_no_report_stays(folder, uwtrack, name, content):
    path = folder / "notes.txt"
    path.write_text(content)
    (folder / "out" / name).symlink_to(path)
    words = WATCH if name.startswith("watch") else BATCH
    done = uwtrack(*words, "--overwrite")
    assert done.exit_code == 1
    assert "was not written by uwtrack" in done.stderr
    assert path.read_text() == content
    assert list(folder.glob("out/*.h5")) == []


def test_the_report_of_another_batch_is_replaced_when_asked(folder, uwtrack):
    record(folder / "in" / "b.wav")
    record(folder / "other" / "c.wav", 2)
    assert uwtrack(*BATCH).exit_code == 0
    before = {p.name: p.read_bytes() for p in (folder / "out").iterdir()}
    for source in ("other", "in/a.wav"):
        done = uwtrack("batch", source, *BATCH[2:], "--resume")
        assert done.exit_code == 1
        assert "is the report of another batch" in done.stderr
        assert {p.name: p.read_bytes() for p in (folder / "out").iterdir()} == before
    assert uwtrack("batch", "other", *BATCH[2:], "--overwrite").exit_code == 0
    assert statuses(folder) == {"c.wav": "done"}


def test_a_folder_that_grows_and_shrinks_needs_no_flag(folder, uwtrack):
    assert uwtrack(*BATCH).exit_code == 0
    record(folder / "in" / "b.wav")
    assert uwtrack(*BATCH, "--resume").exit_code == 0
    (folder / "in" / "a.wav").unlink()
    record(folder / "in" / "c.wav")
    words = ("batch", "out/../in", *BATCH[2:], "--resume")
    assert uwtrack(*words).exit_code == 0
    assert statuses(folder) == {"b.wav": "resumed", "c.wav": "done"}


def test_another_recipe_replaces_products_when_asked(folder, uwtrack):
    assert uwtrack(*BATCH).exit_code == 0
    path = folder / "out" / "a.run.h5"
    content = path.read_bytes()
    other = (*BATCH, "--resume", "--set", "cpa.source_depth_m=4")
    assert uwtrack(*other).exit_code == 3
    assert (
        "was made by another recipe: give --overwrite" in (folder / "out" / "batch.csv").read_text()
    )
    assert path.read_bytes() == content
    assert uwtrack(*other, "--overwrite").exit_code == 0
    assert path.read_bytes() != content
    assert uwtrack(*other).exit_code == 0
    assert statuses(folder) == {"a.wav": "resumed"}


def test_a_recording_that_changed_is_run_again(folder, uwtrack):
    assert uwtrack(*BATCH).exit_code == 0
    record(folder / "in" / "a.wav", 2)
    assert uwtrack(*BATCH, "--resume").exit_code == 0
    assert statuses(folder) == {"a.wav": "done"}


def test_a_watch_does_not_go_on_in_the_output_of_another_folder(folder, uwtrack):
    assert uwtrack(*WATCH).exit_code == 0
    record(folder / "other" / "a.wav", 2)
    before = {p.name: p.read_bytes() for p in (folder / "out").iterdir()}
    done = uwtrack("watch", "other", *WATCH[2:])
    assert done.exit_code == 1
    assert "is the journal of another folder" in done.stderr
    assert {p.name: p.read_bytes() for p in (folder / "out").iterdir()} == before
    assert uwtrack("watch", "other", *WATCH[2:], "--overwrite").exit_code == 0
    assert (folder / "out" / "a.run.h5").read_bytes() != before["a.run.h5"]


def test_products_keep_their_names_whatever_arrives_beside_them(folder, uwtrack):
    assert uwtrack(*BATCH).exit_code == 0
    record(folder / "in" / "a.aiff", 2)
    assert uwtrack(*BATCH, "--resume").exit_code == 0
    assert statuses(folder) == {"a.wav": "resumed", ".aiff": "done"}
    names = {"a.run.h5", "a.aiff.run.h5"}
    assert {p.name for p in folder.glob("out/*.h5")} == names
    (folder / "in" / "a.wav").unlink()
    assert uwtrack(*BATCH, "--resume").exit_code == 0
    assert statuses(folder) == {".aiff": "resumed"}
    assert {p.name for p in folder.glob("out/*.h5")} == names
