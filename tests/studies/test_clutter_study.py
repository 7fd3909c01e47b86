"""The clutter study in short: its figures within the reference's bands."""

import math

import pytest

from studies.clutter_runs import EXPERIMENTS, run_scene
from studies.clutter_study import one_step, study_clutter
from studies.rows import load_reference

REFERENCE = load_reference("clutter")
RUNS = 150


@pytest.fixture(scope="session")
def matched():
    return run_scene(EXPERIMENTS[1], runs=RUNS, seed=11)


@pytest.mark.parametrize(
    "method",
    ["KF-clean", "KF-detect", "NN.05", "fix.1", "fix.03", "fix.01", "prior", "post", "TS-lit"],
)
def test_the_share_of_lost_tracks_is_the_references(matched, method):
    known = REFERENCE["tracks"][EXPERIMENTS[1].name][method]["lost_percent"] / 100.0
    spread = math.sqrt(known * (1.0 - known) * (1.0 / RUNS + 1.0 / 1000.0))
    assert abs(matched[method].lost.mean() - known) <= 3.5 * spread + 1e-9


def test_the_rules_rank_as_in_the_reference_on_the_same_scans(matched):
    lost = {name: tally.lost.sum() for name, tally in matched.items()}
    assert lost["NN.05"] > lost["prior"]
    assert lost["post"] > lost["prior"]
    assert lost["TS-lit"] > lost["prior"]
    kept = {name: t.means[:, ~t.lost].mean(axis=1) for name, t in matched.items()}
    assert kept["post"][2] < kept["prior"][2]


def test_the_kalman_filter_on_the_target_alone_is_consistent(matched):
    position, velocity, *_, nees = matched["KF-clean"].means.mean(axis=1)
    assert math.sqrt(position) == pytest.approx(math.sqrt(2 * 4.02603), rel=0.03)
    assert math.sqrt(velocity) == pytest.approx(3.97, rel=0.03)
    assert nees == pytest.approx(4.0, abs=0.25)


def test_lost_tracks_are_flagged_and_kept_ones_are_not(matched):
    lost, flagged = matched["fix.1"].lost, matched["fix.1"].flagged
    assert flagged[lost].mean() > 0.8
    assert flagged[~lost].mean() < 0.1


@pytest.mark.parametrize("variance", [25.0, 100.0])
def test_one_scan_gives_what_q2_promises_and_the_small_region_less(variance):
    entry = next(
        e for e in REFERENCE["one_step"]
        if e["detector"] == "S 15dB" and e["innovation_variance_m2"] == variance
    )  # fmt: skip
    found = one_step(EXPERIMENTS[0], variance, runs=4000, seed=3)
    for rule, ours in found.items():
        reported, true = entry["rows"][rule]
        assert abs(ours.reported - reported) < 4.0 * ours.reported_error + 1e-3
        assert abs(ours.true - true) < 4.0 * ours.true_error
    assert found["posterior"].reported - found["posterior"].true > 0.03
    if variance == 100.0:
        assert found["two-step lit"].true < found["prior"].true - 0.2


@pytest.mark.slow
def test_the_study_computes_another_seed_changes_its_figures():
    first, second = (study_clutter(runs=4, seed=seed) for seed in (1, 2))
    assert [r.reference for r in first.rows] != [r.ours for r in first.rows]
    names = ("one scan", "matched", "man")
    ours = [
        {(r.case, r.quantity): r.ours for r in s.rows if r.case.startswith(names)}
        for s in (first, second)
    ]
    shared = ours[0].keys() & ours[1].keys()
    assert sum(ours[0][key] != ours[1][key] for key in shared) > 0.6 * len(shared)
    assert any("percentage points" in remark for remark in first.remarks)


@pytest.mark.long
@pytest.mark.parametrize("scene", EXPERIMENTS[:2], ids=lambda s: s.name)
def test_a_thousand_tracks_lie_in_every_band_of_the_reference(scene):
    tallies = run_scene(scene, runs=1000, seed=21)
    for method, known in REFERENCE["tracks"][scene.name].items():
        if method in tallies:
            share = known["lost_percent"] / 100.0
            band = 3.0 * math.sqrt(2.0 * share * (1.0 - share) / 1000.0)
            assert abs(tallies[method].lost.mean() - share) <= band
