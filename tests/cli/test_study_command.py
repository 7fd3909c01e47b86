"""`study`: its list, its table, its refusals; the computing itself is stubbed here."""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from studies import line_comb, line_sound, line_tracking
from studies.catalogue import STUDIES
from studies.line_sound import LineTrial
from studies.line_tracking import RunFigures
from studies.rows import load_reference

TRACKING = {"fixed", "moving", "parts", "dense", "other"}
"""Experiments of the trackers: the first word of their cases."""


@pytest.fixture
def quick_lines(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every row of the study of lines, from figures that are as long as they get."""
    figures = RunFigures(*np.linspace(5123.4567, 5223.4567, 11))
    monkeypatch.setattr(line_tracking, "run_figures", lambda *_: figures)
    chances = -np.linspace(0.0, 3.0, 300)
    monkeypatch.setattr(line_comb, "noise_chances", lambda *_: chances)
    monkeypatch.setattr(line_comb, "family_chances", lambda *_, **__: chances)
    errors = np.linspace(-0.05, 0.05, 50)
    monkeypatch.setattr(line_sound, "frame_errors", lambda *_: (errors, errors))
    detected = LineTrial(True, 1.2345e-3, 1.2345, 0.95)
    monkeypatch.setattr(line_sound, "detect_line", lambda *_: detected)
    monkeypatch.setattr(line_sound, "count_false", lambda *_: 1)
    line_tracking._run.cache_clear()
    yield
    line_tracking._run.cache_clear()


@pytest.mark.usefixtures("quick_lines")
def test_the_table_of_lines_fits_a_hundred_columns(uwtrack) -> None:
    done = uwtrack("study", "lines", "--runs", 2)
    assert done.exit_code == 0, done.output
    rows = done.stdout.splitlines()
    assert rows[0].startswith("lines: Choi (2014)")
    assert "2 runs, seed 1" in rows[0]
    assert max(map(len, rows)) <= 100
    sections = {row.split()[0] for row in rows[2:]}
    assert sections == TRACKING | {"noise", "comb", "whole", "one", "minute"}
    assert not any("nan" in row or "inf" in row for row in rows)


@pytest.mark.usefixtures("quick_lines")
def test_every_reference_figure_has_a_row_and_json_holds_the_same(uwtrack) -> None:
    done = uwtrack("study", "lines", "--runs", 2, "--json")
    rows = json.loads(done.stdout)["rows"]
    known = load_reference("lines")["tracking"]
    figures = sum(len(v) for case in known for v in case["settings"].values())
    assert sum(row["case"].split()[0] in TRACKING for row in rows) == figures
    assert len({(row["case"], row["quantity"]) for row in rows}) == len(rows)


def test_without_a_name_all_studies_are_listed(uwtrack) -> None:
    done = uwtrack("study")
    assert [row.split()[0] for row in done.stdout.splitlines()] == list(STUDIES)


@pytest.mark.parametrize(
    ("words", "said"),
    [(("nothing",), "there is no study 'nothing'"), (("lines", "--runs", 0), "got 0")],
)
def test_what_cannot_be_studied_is_refused(uwtrack, words, said) -> None:
    done = uwtrack("study", *words)
    assert done.exit_code == 2
    assert said in done.stderr


def test_without_a_checkout_the_experiments_say_where_they_are(
    uwtrack, monkeypatch, tmp_path
) -> None:
    monkeypatch.setattr("uwtrack_cli.__file__", str(tmp_path / "uwtrack_cli" / "x.py"))
    done = uwtrack("study", "lines")
    assert done.exit_code == 1
    assert "clone the project" in done.stderr
