"""The test between contacts: truth at the stated rates, laws, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from studies.discrimination_study import run_scenario
from studies.repeater import RepeaterScene
from tests.draws.contact_pairs import contact_pair as _case
from uwtrack_cli.data.scans import Contacts
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.discrimination.discriminate import discriminate_contacts
from uwtrack_cli.discrimination.options import ContactErrors, ContactFilters
from uwtrack_cli.errors import DataError, OptionError

SCENE = RepeaterScene(aspect_deg=140.0, turns=True)


def _decide(contacts, navigation, **options):
    return discriminate_contacts(
        contacts, navigation, **({"miss": 0.005, "false_alarm": 0.005} | options)
    )


@pytest.mark.slow
def test_the_source_is_found_moving_at_the_published_rate():
    found = [_decide(*_case(seed=seed)).verdict[0] for seed in range(30)]
    assert sum(verdict == "first moves" for verdict in found) >= 27


def test_the_single_run_equals_the_study_that_steps_many():
    decision = _decide(*_case(seed=3))
    study = run_scenario(2, 140.0, ContactFilters(), False, runs=1, seed=3)
    assert {-1: "first moves", 0: "undecided", 1: "second moves"}[
        int(study.decision[0])
    ] == decision.verdict[0]
    assert study.scans[0] == decision.decision_scan[0]


def test_names_exchanged_give_the_same_contact_and_the_opposite_odds():
    one = _decide(*_case(seed=2))
    other = _decide(*_case(seed=2, source=2, repeater=1))
    assert one.moving_contact == 1
    assert other.moving_contact == 2
    np.testing.assert_allclose(one.log_odds, -other.log_odds, atol=1e-9)
    np.testing.assert_allclose(one.consistency[0], other.consistency[0, [3, 2, 1, 0]])


def test_the_four_terms_add_up_to_the_log_odds_and_thresholds_are_walds():
    decision = _decide(*_case(seed=4))
    signs = np.array([-1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(decision.log_likelihood @ signs, decision.log_odds)
    assert decision.upper_threshold == pytest.approx(5.2933, abs=1e-4)
    at = decision.decision_scan[0] - 1
    assert abs(decision.log_odds[at]) >= decision.upper_threshold
    assert np.all(np.abs(decision.log_odds[:at]) < decision.upper_threshold)
    assert decision.decision_time_s[0] == decision.scan_time_s[at]
    assert decision.probability[0] > 0.995


def test_turning_the_compass_and_moving_the_grid_change_nothing():
    contacts, navigation = _case(seed=5)
    angle = np.deg2rad(50.0)
    east = np.cos(angle) * navigation.east_m + np.sin(angle) * navigation.north_m
    north = -np.sin(angle) * navigation.east_m + np.cos(angle) * navigation.north_m
    turned = replace(
        contacts, bearing_deg=contacts.bearing_deg + 50.0, time_s=contacts.time_s + 500.0
    )
    moved = replace(
        navigation, east_m=east + 2e4, north_m=north - 1e4, time_s=navigation.time_s + 500.0
    )
    one, other = _decide(contacts, navigation), _decide(turned, moved)
    np.testing.assert_allclose(one.log_odds, other.log_odds, atol=1e-5)
    np.testing.assert_allclose(one.scan_time_s + 500.0, other.scan_time_s)


def test_a_few_scans_end_undecided_with_the_odds_so_far():
    contacts, navigation = _case(seed=1)
    few = contacts.take("row", np.flatnonzero(contacts.time_s <= 62.0))
    decision = _decide(few, navigation)
    assert decision.verdict.tolist() == ["undecided"]
    assert decision.moving_contact == 0
    assert np.isnan(decision.decision_time_s[0])
    assert 0.5 <= decision.probability[0] < 0.995
    assert "decision_time_s" in decision.reasons(0)


def test_own_ship_heading_for_the_repeater_is_reported_as_unobservable():
    scene = RepeaterScene(aspect_deg=0.0)
    decision = _decide(*_case(scene, seed=6), miss=1e-6, false_alarm=1e-6)
    assert not decision.observable[0, 0]
    assert "inverse_range_2" in decision.reasons(0)
    across = _decide(*_case(RepeaterScene(aspect_deg=90.0), seed=6))
    assert across.observable[0, 0]


@pytest.mark.slow
def test_a_source_that_turns_as_the_repeater_separates_is_found():
    scene = RepeaterScene(aspect_deg=60.0, range_m=400.0, interval_s=1.0, turns=True)
    models = ContactFilters(acceleration_std_mps2=1.0, manoeuvre_std_mps2=10.0)
    for filters in (ContactFilters(), models):
        found = [_decide(*_case(scene, seed=s), filters=filters) for s in range(20)]
        assert sum(d.verdict[0] == "first moves" for d in found) >= 18
    steady = _decide(*_case(scene), filters=ContactFilters(acceleration_std_mps2=0.5))
    assert steady.verdict[0] == "neither fits"
    assert "may have manoeuvred" in steady.reasons(0)["verdict"]


@pytest.mark.slow
def test_own_ships_turn_between_rows_of_her_navigation_rejects_no_right_reading():
    clock = np.arange(0.0, 90.5, 0.5)
    course = np.deg2rad(90.0) * np.clip((clock - 66.0) / 4.0, 0.0, 1.0)
    rate = 10.0 * np.stack([np.sin(course), np.cos(course)], axis=1)
    way = np.cumsum(0.25 * (rate[1:] + rate[:-1]), axis=0)
    own = np.concatenate([np.zeros((1, 2)), way])
    at = np.arange(0, clock.size, 4)
    buoy, start, velocity = (np.array(v) for v in ([700, 900], [-600, 1500], [6, -5]))
    contacts = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rows = []
        for number, place, moves in ((1, start, velocity), (2, buoy, 0 * velocity)):
            line = place + np.multiply.outer(clock[at], moves) - own[at]
            distance = np.hypot(*line.T)
            radial = ((moves - rate[at]) * line).sum(axis=1) / distance
            late = number == 2
            rows.append(np.stack([
                np.full(at.size, number), clock[at], distance + late * 4.0 * clock[at],
                np.rad2deg(np.arctan2(*line.T)), radial + late * 4.0,
            ]))  # fmt: skip
        number, time_s, *seen = np.concatenate(rows, axis=1)
        noise = rng.standard_normal((3, time_s.size)) * [[5.0], [2.0], [0.5]]
        deviations = [np.full(time_s.size, s) for s in (5.0, 2.0, 0.5)]
        contacts.append(
            Contacts(
                contact=number.astype(int), time_s=time_s, range_m=seen[0] + noise[0],
                bearing_deg=seen[1] + noise[1], range_rate_mps=seen[2] + noise[2],
                range_std_m=deviations[0], bearing_std_deg=deviations[1],
                range_rate_std_mps=deviations[2],
            )
        )  # fmt: skip
    for every in (1, 20):
        rows = slice(0, None, every)
        navigation = Navigation(
            time_s=clock[rows], east_m=own[rows, 0], north_m=own[rows, 1],
            heading_deg=np.full(clock[rows].size, np.nan),
        )  # fmt: skip
        verdicts = [discriminate_contacts(one, navigation).verdict[0] for one in contacts]
        assert sum(verdict == "first moves" for verdict in verdicts) >= 18


@pytest.mark.slow
def test_two_vessels_near_by_are_both_found_moving():
    scene = RepeaterScene(
        aspect_deg=40.0, range_m=400.0, interval_s=1.0, turns=True, vessel_course_deg=120.0
    )
    found = [_decide(*_case(scene, seed=seed)) for seed in range(20)]
    assert sum(d.verdict[0] == "both move" for d in found) >= 18
    decision = next(d for d in found if d.verdict[0] == "both move")
    assert decision.moving_contact == 0
    assert np.isnan([decision.probability[0], decision.decision_time_s[0]]).all()
    assert decision.decision_scan[0] == 0
    assert "neither fits a stationary repeater" in decision.reasons(0)["verdict"]
    assert "decision_time_s" not in decision.reasons(0)
    assert "both contacts move" in decision.statements[0]


@pytest.mark.slow
def test_a_source_and_its_repeater_are_hardly_ever_called_anything_else():
    for scene in (RepeaterScene(aspect_deg=80.0), SCENE):
        found = [_decide(*_case(scene, seed=s), miss=0.05, false_alarm=0.05) for s in range(60)]
        other = [d.verdict[0] in {"both move", "neither fits"} for d in found]
        assert sum(other) <= 2  # a fifth of 5 % is 0.6 of 60


def test_measurements_that_jump_fit_neither_reading():
    contacts, navigation = _case(seed=3)
    late = contacts.time_s > 74.0
    jumped = replace(
        contacts,
        bearing_deg=contacts.bearing_deg + np.where(late, 40.0, 0.0),
        range_m=contacts.range_m + np.where(late, 300.0, 0.0),
    )
    decision = _decide(jumped, navigation)
    assert decision.verdict[0] == "neither fits"
    assert "neither hypothesis fits" in decision.reasons(0)["verdict"]
    assert "neither hypothesis fits" in decision.statements[0]


def test_overwhelming_odds_end_in_a_verdict():
    contacts, navigation = _case(RepeaterScene(aspect_deg=140.0), seed=3)
    exact = replace(
        contacts,
        range_std_m=contacts.range_std_m / 1e4,
        bearing_std_deg=contacts.bearing_std_deg / 1e4,
        range_rate_std_mps=contacts.range_rate_std_mps / 1e4,
    )
    decision = _decide(exact, navigation)
    assert abs(decision.log_odds[-1]) > 1e5
    assert 1.0 <= decision.fixed_scans[0] <= decision.scan_time_s.size
    assert decision.fixed_verdict[0] in {"first moves", "second moves"}
    assert np.isfinite(decision.expected_scans[0])


def _with_jumps(contact, times_s, jump_m, range_m=1000.0, seed=1, **names):
    """Decide a run whose contact has ranges that are wrong at some scans."""
    scene = RepeaterScene(aspect_deg=80.0, range_m=range_m)
    contacts, navigation = _case(scene, seed=seed, **names)
    at = (contacts.contact == contact) & np.isin(contacts.time_s, times_s)
    jumped = replace(contacts, range_m=contacts.range_m + np.where(at, jump_m, 0.0))
    return _decide(jumped, navigation)


def test_one_scan_that_a_manoeuvre_would_explain_is_named():
    alone = _with_jumps(2, [78.0], 40.0)
    assert alone.verdict[0] == "first moves"
    said = alone.reasons(0)["verdict"]
    assert said.startswith("contact 2 was improbable as a moving one at 78 s alone")
    other = _with_jumps(1, [78.0], 40.0, source=2, repeater=1)
    assert other.verdict[0] == "second moves"
    assert other.reasons(0)["verdict"].startswith("contact 1 was improbable")
    assert "verdict" not in _with_jumps(2, [78.0], 0.0).reasons(0)
    assert "verdict" not in _with_jumps(2, [70.0, 78.0], 60.0).reasons(0)


def test_a_verdict_whose_own_filter_fits_badly_says_so():
    decision = _with_jumps(1, [84.0, 88.0], 40.0, range_m=4000.0, seed=7)
    assert decision.verdict[0] == "first moves"
    assert decision.consistency[0, 0] < 0.05 < decision.consistency[0, 2]
    assert "decided for does not fit" in decision.reasons(0)["verdict"]


def test_readings_are_rejected_below_a_tenth_of_the_accepted_error():
    contacts, navigation = _case(seed=3)
    at = (contacts.contact == 1) & (contacts.time_s == 84.0)
    jumped = replace(contacts, range_m=contacts.range_m + np.where(at, 28.0, 0.0))
    fits = _decide(jumped, navigation).consistency[0]
    assert fits[2] < 1e-6 < fits[0] < 0.04
    assert fits[1] > 0.05
    below, above = 10.0 * fits[0] / 1.02, 10.0 * fits[0] * 1.02
    for miss, verdict in ((below, "first moves"), (above, "neither fits")):
        found = _decide(jumped, navigation, miss=miss, false_alarm=0.49)
        assert found.verdict[0] == verdict


def test_a_scan_without_its_range_rate_does_not_count():
    contacts, navigation = _case(seed=9)
    at = (contacts.contact == 2) & (contacts.time_s == 66.0)
    bare = replace(contacts, range_rate_mps=np.where(at, np.nan, contacts.range_rate_mps))
    decision = _decide(bare, navigation)
    at = np.flatnonzero(decision.scan_time_s == 66.0)[0]
    assert decision.log_odds[at] == decision.log_odds[at - 1]
    assert decision.log_odds[at + 1] != decision.log_odds[at]


def test_the_test_begins_where_both_contacts_are_first_complete():
    contacts, navigation = _case(seed=9)
    at = (contacts.contact == 2) & (contacts.time_s == 60.0)
    bare = replace(contacts, range_rate_mps=np.where(at, np.nan, contacts.range_rate_mps))
    assert _decide(contacts, navigation).scan_time_s[0] == 60.0
    assert _decide(bare, navigation).scan_time_s[0] == 62.0


def test_what_came_before_helps_if_it_is_of_one_contact_whatever_its_number():
    contacts, navigation = _case(seed=9)
    early = contacts.time_s < 60.0
    other = replace(contacts, contact=np.where(early, 2, contacts.contact))
    late = early & (contacts.time_s > 30.0)
    both = replace(contacts, contact=np.where(late, 2, contacts.contact))
    expected, found, apart = (_decide(one, navigation) for one in (contacts, other, both))
    assert found.log_odds[1] == expected.log_odds[1] != apart.log_odds[1]
    words = "there was no single contact before the two"
    assert [words in " ".join(one.reasons(0).values())
            for one in (expected, found, apart)] == [False, False, True]  # fmt: skip


def test_the_fixed_test_needs_more_scans_than_the_sequential_one():
    decision = _decide(*_case(seed=7))
    assert decision.fixed_scans[0] > decision.expected_scans[0] > 1.0


def test_three_contacts_are_tested_in_pairs_with_a_smaller_budget_each():
    contacts, navigation = _case(seed=8)
    second = contacts.take("row", np.flatnonzero(contacts.contact == 2))
    rng = np.random.default_rng(1)
    third = replace(
        second, contact=np.full(second.contact.size, 3),
        bearing_deg=second.bearing_deg + rng.normal(0, 2.0, second.contact.size),
    )  # fmt: skip
    decision = _decide(Contacts.join([contacts, third]), navigation)
    pairs = zip(decision.first_contact, decision.second_contact, strict=True)
    assert [(int(a), int(b)) for a, b in pairs] == [(1, 2), (1, 3), (2, 3)]
    assert decision.miss_probability == pytest.approx(0.0025)
    assert decision.upper_threshold == pytest.approx(np.log(0.9975 / 0.0025))
    assert decision.moving_contact == 1


def test_contacts_of_unequal_length_are_compared_where_both_were_seen():
    contacts, navigation = _case(seed=9)
    gap = (contacts.contact == 2) & np.isin(contacts.time_s, [66.0, 90.0])
    decision = _decide(contacts.take("row", np.flatnonzero(~gap)), navigation)
    assert decision.scan_time_s[-1] == 88.0
    at = np.flatnonzero(decision.scan_time_s == 66.0)[0]
    assert decision.log_odds[at] == decision.log_odds[at - 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: {"miss": 0.0}, "miss must be a number"),
        (lambda: {"false_alarm": 0.7}, "false_alarm must be a number"),
        (lambda: {"errors": ContactErrors(range_std_m=-1.0)}, "range_std_m must be a number"),
        (lambda: {"filters": ContactFilters(drift_std_mps=0.0)}, "drift_std_mps must be a number"),
        (lambda: {"filters": ContactFilters(manoeuvre_std_mps2=1.0)}, "must be above acceler"),
        (
            lambda: {"filters": ContactFilters(manoeuvre_stop_probability=1.0)},
            "stop_probability must be a number",
        ),
    ],
)
def test_a_bad_option_is_refused_with_what_is_accepted(change, message):
    with pytest.raises(OptionError, match=message):
        _decide(*_case(), **change())


def test_deviations_may_come_from_options_and_must_come_from_somewhere():
    contacts, navigation = _case(seed=2)
    unknown = np.full(contacts.time_s.size, np.nan)
    bare = replace(
        contacts, range_std_m=unknown, bearing_std_deg=unknown, range_rate_std_mps=unknown
    )
    with pytest.raises(DataError, match="--errors-range-std-m"):
        _decide(bare, navigation)
    errors = ContactErrors(5.0, SCENE.bearing_std_deg, 1.0)
    np.testing.assert_array_equal(
        _decide(bare, navigation, errors=errors).log_odds, _decide(contacts, navigation).log_odds
    )


def test_data_that_cannot_be_used_are_refused_with_the_reason():
    contacts, navigation = _case(seed=1)
    rows = np.arange(contacts.time_s.size)
    with pytest.raises(DataError, match="two contacts or more"):
        _decide(contacts.take("row", rows[contacts.contact == 1]), navigation)
    with pytest.raises(DataError, match="share 1 complete scans"):
        _decide(contacts.take("row", rows[contacts.time_s <= 60.0]), navigation)
    negative = replace(contacts, range_std_m=-contacts.range_std_m)
    with pytest.raises(DataError, match=r"row 1 .* range_std_m is -5\.0"):
        _decide(negative, navigation)
    with pytest.raises(DataError, match=r"row 1 .* range_m is -"):
        _decide(replace(contacts, range_m=-contacts.range_m), navigation)
    twice = Contacts.join([contacts, contacts])
    with pytest.raises(DataError, match="two measurements at"):
        _decide(twice, navigation)


def test_navigation_that_does_not_match_is_refused():
    contacts, navigation = _case(seed=1)
    short = navigation.take("row", slice(0, 500))
    with pytest.raises(DataError, match=r"contacts run from 2 to 90 s.*must cover"):
        _decide(contacts, short)
    with pytest.raises(DataError, match="two rows or more"):
        _decide(contacts, navigation.take("row", slice(0, 1)))
    with pytest.raises(DataError, match="rising times"):
        _decide(contacts, navigation.take("row", slice(None, None, -1)))
    with pytest.raises(DataError, match="both in time_utc"):
        _decide(replace(contacts, start_utc_ns=5), navigation)


def test_two_clocks_with_known_utc_are_brought_together():
    contacts, navigation = _case(seed=1)
    late = replace(navigation, time_s=navigation.time_s - 100.0,
                   start_utc_ns=1_000_000_000_000 + 100_000_000_000)  # fmt: skip
    known = replace(contacts, start_utc_ns=1_000_000_000_000)
    np.testing.assert_allclose(
        _decide(known, late).log_odds, _decide(contacts, navigation).log_odds, atol=1e-6
    )
