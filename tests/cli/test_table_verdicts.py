"""`pdaf` and `discriminate` say their verdict in words, and in JSON as `show` does."""

import json

import numpy as np
import pytest

from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.targets import Target

PDAF = (
    "--detector-cell-volume", 900, "--detector-snr-db", 15,
    "--motion-acceleration-std", 3.16, "--start-velocity-std", 100,
)  # fmt: skip


@pytest.fixture
def commands(samples):
    """The command of each verdict, without its ending."""
    return {
        "target": ("pdaf", samples / "scans.csv", *PDAF),
        "decision": (
            "discriminate", samples / "contacts.csv",
            "--own-ship", samples / "observer.csv",
        ),
    }  # fmt: skip


def test_the_target_is_stated_with_its_last_position(uwtrack, commands, tmp_path):
    done = uwtrack(*commands["target"], "-o", tmp_path / "t.h5")
    assert done.exit_code == 0, done.output
    first, second, *_ = done.stderr.splitlines()
    assert first == "the target was followed through 49 scans to 50 s."
    assert second.startswith("at the last scan: z_1 = ")
    assert " ± " in second
    assert " m/s" in second


@pytest.mark.parametrize("kind", ["target", "decision"])
def test_show_prints_the_statements_as_data(uwtrack, commands, tmp_path, kind):
    done = uwtrack(*commands[kind], "-o", tmp_path / "t.h5")
    shown = uwtrack("show", tmp_path / "t.h5")
    assert shown.exit_code == 0, shown.output
    assert shown.stdout
    assert done.stderr.startswith(shown.stdout)


def test_the_moving_contact_is_stated_with_its_probability(uwtrack, commands, tmp_path):
    done = uwtrack(*commands["decision"], "-o", tmp_path / "d.h5")
    assert done.exit_code == 0, done.output
    assert done.stderr.startswith("contact 1 moves, contact 2 is a stationary repeater")
    assert "probability 0.97" in done.stderr
    assert "after 4 scans at 66 s" in done.stderr


@pytest.mark.parametrize("kind", [Target, Decision])
def test_json_is_that_of_show(uwtrack, commands, tmp_path, kind):
    done = uwtrack(*commands[kind.NAME], "-o", tmp_path / "x.h5", "--json")
    assert done.exit_code == 0, done.output
    shown = uwtrack("show", tmp_path / "x.h5", kind.NAME, "--format", "json")
    assert done.stdout == shown.stdout
    whole = json.loads(done.stdout)
    assert whole["container"] == kind.NAME
    names = {key for rows in whole.values() if isinstance(rows, list) for key in rows[0]}
    ragged = {"reason_pair", "reason_key", "reason_text"}
    assert names - {"reasons"} == set(kind.columns()) - ragged


def test_json_of_a_target_lists_the_associations_of_each_scan(uwtrack, commands, tmp_path):
    done = uwtrack(*commands["target"], "-o", tmp_path / "x.h5", "--json")
    whole = json.loads(done.stdout)
    for row in whole["scan"]:
        own = [a for a in whole["association"] if a["association_scan"] == row["scan"]]
        total = sum(each["association_probability"] for each in own)
        assert total + row["miss_probability"] == pytest.approx(1.0)


def test_json_of_a_decision_adds_up_to_its_log_odds(uwtrack, commands, tmp_path):
    done = uwtrack(*commands["decision"], "-o", tmp_path / "x.h5", "--json")
    whole = json.loads(done.stdout)
    signs = np.array([-1.0, -1.0, 1.0, 1.0])
    for row in whole["scan"]:
        assert row["log_odds"] == pytest.approx(signs @ row["log_likelihood"])
    (pair,) = whole["pair"]
    assert pair["verdict"] == "first moves"
    assert set(json.loads(pair["reasons"])) == {"inverse_range_1"}


def test_a_lost_target_is_stated_as_lost(uwtrack, samples, tmp_path):
    lines = (samples / "scans.csv").read_text().splitlines()
    kept = [line for line in lines[1:] if float(line.split(",")[1]) <= 25.0]
    far = [f"{scan},{scan},5e5,5e5,9,2,2" for scan in range(26, 51)]
    (tmp_path / "cut.csv").write_text("\n".join([lines[0], *kept, *far]) + "\n")
    done = uwtrack("pdaf", tmp_path / "cut.csv", *PDAF)
    assert done.exit_code == 0, done.output
    assert "the target is lost from scan" in done.stderr
    assert "its score no longer rises" in done.stderr


def test_targets_that_nobody_told_are_numbered_in_every_form(uwtrack, samples, tmp_path):
    done = uwtrack(
        "pdaf", samples / "scans.csv", *PDAF, "--targets", "auto", "--threshold", "fixed",
        "--detector-false-alarm-probability", 0.03, "-o", tmp_path / "t.h5", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    whole = json.loads(done.stdout)
    assert {row["target_id"] for row in whole["scan"]} == {1}
    assert {row["association_target_id"] for row in whole["association"]} == {1}
    assert whole["false_tracks_per_hour"] == 1.0
    shown = uwtrack("show", tmp_path / "t.h5")
    assert shown.stdout.splitlines()[2].startswith("tracks begin at a score of 11.")
    table = uwtrack("show", tmp_path / "t.h5", "target", "--format", "csv")
    assert table.stdout.startswith("target_id,scan,time_s")


def test_a_wrong_density_of_clutter_is_said(uwtrack, commands, tmp_path):
    """The sample was recorded at 0.03, not at 0.3 that the range ends with."""
    wrong = uwtrack(*commands["target"], "-o", tmp_path / "t.h5")
    assert "0.10 ± 0.01 times as many false measurements as given" in wrong.stderr
    right = uwtrack(
        *commands["target"], "--detector-false-alarm-range", 1e-4, 0.03, "-o", tmp_path / "u.h5"
    )
    assert "as told" not in right.stderr
