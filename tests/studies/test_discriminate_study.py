"""The discriminate study in short: its figures within the reference's bands."""

import math

import pytest

from studies.discrimination_study import TWO_MODELS, run_scenario, study_discriminate
from studies.rows import load_reference
from uwtrack_cli.discrimination.options import ContactFilters

REFERENCE = load_reference("discriminate")
CASES = [row for row in REFERENCE["scenarios"] if row[3] is not None]
RUNS = 300


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"{c[0]}@{c[1]}")
def test_the_share_of_right_decisions_is_the_references(case):
    scenario, aspect, right, *_, scans = case
    found = run_scenario(scenario, aspect, ContactFilters(), True, runs=RUNS, seed=5)
    spread = math.sqrt(right * (1.0 - right) * (1.0 / RUNS + 1.0 / 2000.0))
    # The split scan's timing is the source's only by the reference's own reading.
    assert abs((found.decision < 0).mean() - right) <= 3.0 * spread + 0.02
    assert found.scans[found.decision < 0].mean() == pytest.approx(scans, abs=0.6)


def test_the_aspect_at_which_the_turn_spoils_the_test_is_shown():
    plain = run_scenario(2, 60, ContactFilters(), True, runs=RUNS, seed=6)
    steady = run_scenario(1, 80, ContactFilters(), True, runs=RUNS, seed=6)
    assert (plain.decision < 0).mean() < 0.15
    assert plain.improbable.mean() > 0.4
    assert steady.improbable.mean() < 0.05


def test_two_models_gain_at_one_aspect_and_cost_at_another():
    gain = [
        (run_scenario(3, 60, filters, True, runs=RUNS, seed=7).decision < 0).mean()
        for filters in (ContactFilters(), TWO_MODELS)
    ]
    cost = [
        (run_scenario(3, 140, filters, True, runs=RUNS, seed=7).decision < 0).mean()
        for filters in (ContactFilters(), TWO_MODELS)
    ]
    assert gain[1] > gain[0] + 0.3
    assert cost[1] < cost[0]


def test_the_sequential_test_errs_less_than_one_of_fixed_length():
    found = run_scenario(2, 140, ContactFilters(), True, runs=RUNS, seed=8)
    assert (found.decision > 0).mean() < 0.5 * found.fixed_wrong.mean()


@pytest.mark.slow
def test_the_study_computes_another_seed_changes_its_figures():
    one, other = (study_discriminate(runs=20, seed=seed) for seed in (1, 2))
    assert [r.case for r in one.rows]
    ours = [{(r.case, r.quantity): r.ours for r in s.rows} for s in (one, other)]
    changed = [key for key in ours[0] if ours[0][key] != ours[1].get(key)]
    assert len(changed) > 0.3 * len(ours[0])


@pytest.mark.long
@pytest.mark.parametrize(
    ("scenario", "aspect", "low", "high"),
    [(1, 80, 0.91, 0.957), (2, 140, 0.979, 0.999), (3, 140, 0.979, 0.999)],
)
def test_two_thousand_runs_lie_in_the_published_band(scenario, aspect, low, high):
    found = run_scenario(scenario, aspect, ContactFilters(), True, runs=2000, seed=9)
    assert low <= (found.decision < 0).mean() <= high
