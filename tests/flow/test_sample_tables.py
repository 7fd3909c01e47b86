"""The sample tables: made again to the byte, and answered with their truth."""

import json

import pytest

from studies.sample_tables import write_sample_tables


def test_the_tables_are_made_again_to_the_byte(tmp_path, samples):
    for path in write_sample_tables(tmp_path):
        assert path.read_bytes() == (samples / path.name).read_bytes()


def test_target_motion_finds_the_vessel_of_the_bearings(uwtrack, samples):
    done = uwtrack(
        "tma", samples / "bearings.csv", "--own-ship", samples / "own-ship.csv",
        "--sound-speed-mps", 1480, "--json", "-o", "m.h5",
    )  # fmt: skip
    best = json.loads(done.stdout)[0]
    truth = json.loads((samples / "bearings.truth.json").read_text())
    assert best["observable"]
    for name in ("range_m", "bearing_deg", "speed_mps", "course_deg"):
        std = best[name.replace("_m", "_std_m").replace("_deg", "_std_deg")]
        assert best[name] == pytest.approx(truth[name], abs=4 * std), name


def test_the_contact_that_moves_is_told_from_the_repeater(uwtrack, samples):
    words = ["contacts.csv", "--own-ship", "observer.csv"]
    words = [samples / w if w.endswith(".csv") else w for w in words]
    assert uwtrack("discriminate", *words, "-o", "d.h5").exit_code == 0
    decision = json.loads(uwtrack("show", "d.h5", "decision", "--format", "json").stdout)
    assert decision["moving_contact"] == 1


def test_the_target_in_clutter_is_followed(uwtrack, samples):
    done = uwtrack(
        "pdaf", samples / "scans.csv", "-o", "t.h5", "--detector-cell-volume", 900,
        "--detector-snr-db", 15, "--motion-acceleration-std", 3.16,
        "--start-velocity-std", 100,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    target = json.loads(uwtrack("show", "t.h5", "target", "--format", "json").stdout)
    rows = target["scan"]
    truth = json.loads((samples / "scans.truth.json").read_text())
    true_m = dict(zip(truth["time_s"], truth["z_1_m"], strict=True))
    sigmas = [
        abs(row["state"][0] - true_m[round(row["time_s"])]) / row["state_covariance"][0][0] ** 0.5
        for row in rows
    ]
    assert len(rows) > 45
    assert sum(sigma < 3.0 for sigma in sigmas) > 0.9 * len(rows)
