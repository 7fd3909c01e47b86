"""What the console says: little when all is well, each thing once, on a narrow screen."""

from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.cli import console
from uwtrack_cli.cli.console import show_table
from uwtrack_cli.cli.result_output import print_result
from uwtrack_cli.errors import UwtrackNote
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.sources import open_with_options


@pytest.fixture(scope="session")
def found(samples):
    """Progress and result of a run over one hydrophone."""
    recording = open_with_options(samples / "mono.wav", {})
    told: list[float] = []
    with pytest.warns(UwtrackNote, match="no position"):
        made = run_recipe(recording, load_recipe("vessel"), progress=told.append)
    (encounters,) = [c for c in made if c.NAME == "encounters"]
    return recording, told, encounters


def test_a_run_says_the_result_and_its_file(timed_result):
    path, done = timed_result
    wrote, head, row = done.stderr.splitlines()
    assert max(len(head), len(row)) <= 80
    assert wrote == f"wrote {path}"
    assert head.split()[:2] == ["passage", "status"]
    assert row.split()[:2] == ["1", "ok"]
    assert done.stdout == ""


def test_a_note_is_said_where_details_are_asked_for(capsys, monkeypatch):
    for verbosity, said in ((0, ""), (1, "note: no bearing\n")):
        monkeypatch.setattr(console, "_verbosity", verbosity)
        console._show_warning("no bearing", UwtrackNote)
        assert capsys.readouterr().err == said


def test_a_reason_is_said_once_for_all_contacts(found, capsys):
    encounters = found[2]
    both = type(encounters).join([encounters, encounters])
    print_result(both, as_json=False)
    said = capsys.readouterr().err
    assert said.count("no bearing channel") == 1
    assert "no bearing_deg, course_deg, side: no bearing channel" in said


def test_a_reason_of_some_contacts_names_them(found, capsys):
    encounters = found[2]
    other = encounters.take("encounter", [0])
    known = type(encounters).join([encounters, other])
    keep = known.reason_encounter == 0
    mixed = replace(
        known,
        contact=known.contact + np.array([0, 6]),
        reason_encounter=known.reason_encounter[keep],
        reason_key=known.reason_key[keep],
        reason_text=known.reason_text[keep],
    )
    print_result(mixed, as_json=False)
    assert "passage 1: no bearing_deg, course_deg, side" in capsys.readouterr().err


def test_the_progress_is_whole_when_the_fits_are_done(found):
    recording, told, _ = found
    assert told == sorted(told)
    assert told[-1] == pytest.approx(recording.duration_s)
    streamed = [seconds for seconds in told if seconds <= 0.8 * recording.duration_s]
    # cpa, radiated, locate and presence follow the sound
    assert len(told) - len(streamed) == 4


def test_tables_fit_eighty_columns(uwtrack, samples, pass_run):
    for words in (
        ["show", pass_run],
        ["passages", pass_run, "--fresh"],
        ["score", pass_run, "--truth", samples / "pass.truth.json"],
    ):
        done = uwtrack(*words)
        assert done.exit_code == 0, done.output
        assert max(map(len, done.output.splitlines())) <= 80


def test_a_table_leaves_out_what_it_can_spare_and_breaks_no_word(capsys):
    heads = ("name", "long", "value")
    rows = [("a", "x" * 60, "1"), ("b", "y" * 70, "2" * 10)]
    show_table(heads, rows, is_data=True, spare=("value", "long"))
    assert capsys.readouterr().out.splitlines()[0].split() == ["name", "long"]
    show_table(heads, rows, is_data=True)
    assert "y" * 70 in capsys.readouterr().out


def test_a_warning_that_many_recordings_share_is_said_once(uwtrack, noise_wav, tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a", "b", "c"):
        target = tmp_path / "in" / f"{name}.wav"
        target.write_bytes(noise_wav.read_bytes())
    done = uwtrack("batch", "in", "-o", "out", "--jobs", 1, "--recipe", "vessel")
    assert done.exit_code == 0
    assert done.stderr.count("has no sensor file") == 1
    assert "(and 2 more like it)" in done.stderr
    assert "3 done; 0 passages" in done.stderr
