"""Commands of the stages: their help, their lists of numbers, what a page shows."""

import json
import shutil

import pytest

from uwtrack_cli.cli.command_factory import spread_values
from uwtrack_cli.flow.catalogue import find_stage


def test_negative_numbers_are_values_of_a_list(uwtrack, samples):
    words = (
        "pdaf", samples / "scans.csv", "--detector-cell-volume", 900,
        "--detector-snr-db", 15, "--motion-acceleration-std", 3.16,
        "--start-velocity-std", 100,
    )  # fmt: skip
    together = uwtrack(*words, "--start-velocity", 50, -50, "-o", "one.h5")
    assert together.exit_code == 0, together.output
    apart = uwtrack(*words, "--start-velocity", 50, "--start-velocity", -50, "-o", "two.h5")
    assert apart.exit_code == 0, apart.output
    assert uwtrack("diff", "one.h5", "two.h5").exit_code == 0
    info = json.loads(uwtrack("info", "one.h5", "--json").stdout)
    start = info["history"][-1]["options"]["start"]
    assert start["velocity"] == [50.0, -50.0]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("a.csv --start-velocity 1 -2 b", "a.csv --start-velocity 1 --start-velocity -2 b"),
        ("--start-velocity 1 -o x", "--start-velocity 1 -o x"),
        ("--gate 4 -50", "--gate 4 -50"),
    ],
)
def test_only_options_with_lists_take_several_values(given, expected):
    assert spread_values(find_stage("pdaf"), given.split()) == expected.split()


def test_help_shows_range_and_unit_in_panels(uwtrack):
    text = " ".join(uwtrack("track", "--help").stdout.replace("│", " ").split())
    assert "Expert options: gates:" in text
    assert "Expert options: feedback:" in text
    assert "above 0, at most 360)" in text
    text = " ".join(uwtrack("spectrogram", "--help").stdout.replace("│", " ").split())
    assert "at most 3600" in text


def test_a_second_product_that_a_page_would_not_show_is_refused(
    uwtrack, short_run, timed_run, tmp_path
):
    shutil.copy(short_run, tmp_path / "one.run.h5")
    shutil.copy(timed_run, tmp_path / "two.run.h5")
    done = uwtrack("plot", "one.run.h5", "two.run.h5", "-o", "page.png")
    assert done.exit_code == 1
    said = " ".join(done.stderr.split())
    assert "one.run.h5 and two.run.h5 both hold" in said
    assert uwtrack("plot", "one.run.h5", "one.run.h5", "-o", "p.png").exit_code == 0


def test_show_alone_prints_the_table_of_the_command(uwtrack, samples, timed_result):
    run, done = timed_result
    shown = uwtrack("show", run).stdout
    assert "speed m/s" in shown
    assert shown in done.stderr
    located = uwtrack("locate", run, "--at", 300, "-o", "one.fixes.h5")
    shown = uwtrack("show", "one.fixes.h5").stdout
    assert "\u00b1 east m" in shown
    assert shown in located.stderr
    uwtrack("spectrogram", samples / "noise.wav", "-o", "s.spectrogram.h5")
    none = uwtrack("show", "s.spectrogram.h5")
    assert none.exit_code == 1
    assert "holds no result" in none.stderr
