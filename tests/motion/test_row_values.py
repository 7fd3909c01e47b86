"""What rows of encounters and motions say of a fit, by geometry and both sides of limits."""

import re
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.motion.passage import encounter_rows as rows
from uwtrack_cli.motion.passage.model.moving_sensor import over_ground, sensor_motion
from uwtrack_cli.motion.passage.model.unknowns import MANOEUVRE, RAMP, STEP, TURN, Change
from uwtrack_cli.motion.target_motion import motion_table as table
from uwtrack_cli.motion.target_motion.modes import Interval

SPEED_MPS, WIDTH_S, COURSE_DEG, SOUND_MPS = 6.0, 30.0, 70.0, 1500.0


def spread(size, seed=1):
    root = np.random.default_rng(seed).standard_normal((size, size))
    return 1e-3 * (root @ root.T + np.eye(size))


def fit_of(changed=(), kind=None, *, sign=1.0, turn=1, change_s=130.0, std=None):
    count = 5 + len(changed)
    full = spread(count)
    if std is not None:
        full = np.diag(np.square([*std, *([0.1] * (count - 4))]))
    return SimpleNamespace(
        theta=np.array([[100.0, np.log(25.0), SPEED_MPS, -5.0, 20.0, *changed]]),
        range_over_speed_s=np.array([WIDTH_S]), bearing_deg=np.array([COURSE_DEG - 90.0]),
        turn=np.array([turn]), covariance=full[None, :4, :4], full_covariance=full[None],
        change=kind and Change(kind, np.array([change_s]), np.array([sign])),
        rest_hz=np.array([[50.0, 80.0]]), rest_std_hz=np.array([[0.1, np.nan]]),
    )  # fmt: skip


def row_of(**values):
    row = rows.Row(1, rows.OK)
    row.values |= {"speed_mps": SPEED_MPS, "speed_std_mps": 0.2, "course_deg": COURSE_DEG} | values
    row.side = "starboard"
    return row


def context_of(sensor=None, **other):
    return SimpleNamespace(
        sensor=sensor or Sensor(id="a", depth_m=20.0), start_utc_ns=None,
        sound_speed_mps=SOUND_MPS, reference="1 uPa", spreading_db=20.0, **other,
    )  # fmt: skip


def by_difference(function, at, covariance):
    """Deviations of values by their partials at a point (delta method)."""
    steps = 1e-5 * np.eye(len(at))
    slope = np.stack([(function(at + s) - function(at - s)) / 2e-5 for s in steps], 1)
    return np.sqrt(np.diag(slope @ covariance @ slope.T))


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("change", [(1.0, -2.0), (-9.0, 1.0)])
def test_the_other_leg_of_a_manoeuvre_is_its_velocity_over_ground(change, turn):
    """Away from the sensor is to port of the course if the sensor is to starboard."""
    fit, row = fit_of(change, MANOEUVRE, turn=turn, sign=-1.0), row_of()
    rows._add_change(row, fit)

    def leg(by):
        """Speed and course by speed, course in degrees, and the change."""
        angle = np.radians(by[1])
        ahead = np.array([np.sin(angle), np.cos(angle)])
        port = np.array([-ahead[1], ahead[0]])
        velocity = (by[0] + by[2]) * ahead + turn * by[3] * port
        return np.array([np.hypot(*velocity), np.degrees(np.arctan2(*velocity))])

    at = np.array([SPEED_MPS, COURSE_DEG, *change])
    speed, course = leg(at)
    v = row.values
    assert v["other_leg_speed_mps"] == pytest.approx(speed)
    assert v["other_leg_course_deg"] == pytest.approx(course % 360.0)
    places = [2, 3, 5, 6]
    std = by_difference(leg, at, fit.full_covariance[0][np.ix_(places, places)])
    ours = v["other_leg_speed_std_mps"], v["other_leg_course_std_deg"]
    np.testing.assert_allclose(ours, std, rtol=1e-5)
    assert (v["change_time_s"], row.change_follows) == (130.0, False)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("lag_s", [-50.0, -20.0, 20.0, 50.0])
def test_a_steady_turn_has_another_leg_where_it_is_over_at_the_closest_approach(lag_s, turn):
    fit = fit_of((0.5, 60.0, 0.0), TURN, change_s=100.0 + lag_s, turn=turn)
    row, own = row_of(), fit.full_covariance[0][5:7, 5:7]
    rows._add_change(row, fit)
    v, std = row.values, np.sqrt(np.diag(own))
    assert row.change_follows is (lag_s > 0)
    assert v["turn_away_deg"] == pytest.approx(np.degrees(0.5))
    assert v["turn_away_std_deg"] == pytest.approx(np.degrees(std[0]))
    assert (v["turn_duration_s"], v["turn_duration_std_s"]) == (60.0, std[1])
    assert v["turn_correlation"] == pytest.approx(own[0, 1] / std.prod())
    if abs(lag_s) < 30.0:
        assert np.isnan(v["other_leg_speed_mps"])
        return
    way = np.sign(lag_s)

    def course(by):
        return np.array([by[0] - turn * np.degrees(way * by[1])])

    at = np.array([COURSE_DEG, 0.5])
    assert v["other_leg_course_deg"] == pytest.approx(course(at)[0] % 360.0)
    (expected,) = by_difference(course, at, fit.full_covariance[0][np.ix_([3, 5], [3, 5])])
    assert v["other_leg_course_std_deg"] == pytest.approx(expected)
    assert (v["other_leg_speed_mps"], v["other_leg_speed_std_mps"]) == (SPEED_MPS, 0.2)


@pytest.mark.parametrize(
    ("kind", "names"),
    [(STEP, ("frequency_change", "frequency_change_std")),
     (RAMP, ("frequency_slope_per_s", "frequency_slope_std_per_s"))],
)  # fmt: skip
def test_a_change_of_frequencies_has_its_size_where_there_is_a_speed(kind, names):
    fit = fit_of((0.01,) if kind == STEP else (0.01, 0.0), kind)
    row = row_of()
    rows._add_change(row, fit)
    std = np.sqrt(fit.full_covariance[0, 5, 5])
    assert [row.values[name] for name in names] == pytest.approx([0.01, std])
    assert row.change_follows
    unknown = row_of(speed_mps=np.nan)
    rows._add_change(unknown, fit)
    assert np.isnan(unknown.values[names[0]])


def test_ranges_have_the_deviations_of_products():
    fit, row = fit_of(), rows.Row(1, rows.OK)
    rows._add_speed(row, fit, context_of(), np.array([4, 7]))
    v, full = row.values, fit.full_covariance[0]

    def product(by):
        return np.array([by[0] * by[1]])

    assert v["slant_range_m"] == pytest.approx(WIDTH_S * SPEED_MPS)
    (std,) = by_difference(product, np.array([WIDTH_S, SPEED_MPS]), full[1:3, 1:3])
    assert v["slant_range_std_m"] == pytest.approx(std)
    assert v["horizontal_range_m"] == pytest.approx(25.0 * SPEED_MPS)
    (std,) = by_difference(product, np.array([25.0, SPEED_MPS]), full[1:3, 1:3])
    assert v["horizontal_range_std_m"] == pytest.approx(std)
    assert v["horizontal_range_over_speed_s"] == pytest.approx(25.0)
    assert v["horizontal_range_over_speed_std_s"] == pytest.approx(np.sqrt(full[1, 1]))
    assert row.rest == [(4, 50.0, 0.1)]


@pytest.mark.parametrize(
    ("std", "status", "has_range"),
    [((1, 1, 1.9, 1), "ok", True), ((1, 1, 2.1, 1), "level-only", False),
     ((1, 12.0, 1.6, 1), "ok", True), ((1, 14.5, 1.6, 1), "ok", False)],
)  # fmt: skip
def test_speed_is_three_deviations_from_zero_and_a_range_two(std, status, has_range):
    row = rows.Row(1, rows.OK)
    rows._add_speed(row, fit_of(std=std), context_of(), np.array([4, 7]))
    assert row.status == status
    assert np.isfinite(row.values["slant_range_m"]) == has_range
    assert ("slant_range_m" in row.reasons) != has_range


@pytest.mark.parametrize(("std_deg", "given"), [(59.0, True), (61.0, False)])
def test_a_bearing_stands_out_up_to_sixty_degrees(std_deg, given):
    row = rows.Row(1, rows.OK)
    row.covariance = np.eye(4)
    rows._add_direction(row, fit_of(std=(1, 1, 1, std_deg)), context_of())
    assert np.isfinite(row.values["bearing_deg"]) == given
    assert np.isfinite(row.covariance[3, 3]) == given
    if given:
        assert row.values["course_deg"] == pytest.approx(COURSE_DEG)
        assert row.side == "starboard"


def test_without_a_speed_the_closest_approach_was_earlier_by_what_sound_takes():
    row = rows.Row(1, rows.LEVEL_ONLY)
    row.side = "port"
    row.values |= {"time_s": 100.0, "range_over_speed_s": WIDTH_S}
    row.covariance, row.horizontal_covariance = np.eye(4), np.eye(4)
    rows._without_speed(row, fit_of(), context_of())
    each_s = WIDTH_S / SOUND_MPS
    assert row.values["time_s"] == pytest.approx(100.0 - 5.5 * each_s)
    std = np.hypot(1.0, 3.5 * each_s)
    assert row.values["time_std_s"] == pytest.approx(std)
    for covariance in (row.covariance, row.horizontal_covariance):
        assert covariance[0, 0] == pytest.approx(std**2)
    assert row.values["horizontal_range_over_speed_s"] == pytest.approx(25.0)
    assert row.values["horizontal_range_over_speed_std_s"] == 1.0
    rows._add_law(row)
    expected = np.hypot(1.0, 0.3 * WIDTH_S)
    assert row.values["range_over_speed_std_s"] == pytest.approx(expected)


@pytest.mark.parametrize("shares", [(1.9, None), (2.1, "long"), (0.09, None), (0.08, "short")])
def test_frames_are_advised_where_they_are_far_from_what_would_suit(shares):
    share, wrong = shares
    row = row_of(slant_range_m=300.0)
    row.rest = [(1, 20.0, 0.1), (2, 60.0, 0.1)]
    # the fastest line sweeps by f v^2 / (c d); a frame of 0.8 over its root suits
    best_s = 0.8 / np.sqrt(60.0 * SPEED_MPS**2 / (SOUND_MPS * 300.0))
    assert best_s > rows.LONGEST_S
    row.rest.append((3, 6000.0, 0.1))
    best_s = 0.8 / np.sqrt(6000.0 * SPEED_MPS**2 / (SOUND_MPS * 300.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rows.advise_frames(row, context_of(), share * best_s)
    assert len(caught) == (wrong is not None)
    if wrong:
        assert issubclass(caught[0].category, UwtrackWarning)
        assert f"too {wrong}" in str(caught[0].message)
        given = float(re.search(r"window_s = ([\d.]+)", str(caught[0].message))[1])
        assert given == pytest.approx(best_s, rel=0.05)


def test_the_motion_of_a_sensor_is_the_line_through_its_way_and_its_departure():
    time = np.linspace(0.0, 1000.0, 201)
    bow = 4.0 * np.sin(2 * np.pi * time / 50.0)
    way = Navigation(
        time_s=time, east_m=50.0 + 2.0 * time, north_m=-30.0 - time + bow,
        heading_deg=np.full(201, np.nan),
    )  # fmt: skip
    found = sensor_motion(way, None, 500.0, 40.0)
    assert found.velocity_mps == pytest.approx([2.0, -1.0], abs=0.02)
    assert found.place_m == pytest.approx([1050.0, -530.0], abs=0.5)
    assert found.departure_m == pytest.approx(4.0, rel=0.1)
    later = replace(way, start_utc_ns=10**9)
    moved = sensor_motion(later, 3 * 10**9, 500.0, 40.0)
    assert moved.place_m[0] == pytest.approx(1054.0, abs=0.1)
    for at in (-0.1, 1000.1):
        with pytest.raises(DataError, match="covers 0 to 1000 s"):
            sensor_motion(way, None, at, 40.0)


def test_a_motion_over_ground_has_the_deviations_of_a_sum_of_velocities():
    covariance, own = np.array([[0.04, 0.1], [0.1, 9.0]]), np.array([1.5, -0.7])
    found = over_ground(4.0, 130.0, 40.0, covariance, own)

    def total(by):
        angle = np.radians(by[1])
        velocity = by[0] * np.array([np.sin(angle), np.cos(angle)]) + own + by[2:]
        return np.array([np.hypot(*velocity), np.degrees(np.arctan2(*velocity))])

    at = np.array([4.0, 130.0, 0.0, 0.0])
    np.testing.assert_allclose((found.speed_mps, found.course_deg), total(at))
    full = np.zeros((4, 4))
    full[:2, :2] = covariance
    plain = by_difference(total, at, full)
    full[2:, 2:] = 0.05**2 * np.eye(2)
    wide = by_difference(total, at, full)
    ours = np.array([found.speed_std_mps, found.course_std_deg])
    assert np.all((ours >= plain * (1 - 1e-6)) & (ours < 1.2 * wide))
    assert found.is_starboard  # 40 degrees from the sensor: it is to the right of 130
    assert not over_ground(4.0, 310.0, 40.0, covariance, own).is_starboard


def mode_of(half=1.0, other=1.0, *, std=(200.0, 0.02, 0.3, 0.1), turns=0.0, **changed):
    """A mode whose intervals are so many of 1.96 deviations wide on either side."""
    motion = np.array([5000.0, 1.0, 4.0, 0.05])
    q = np.array([np.log(5000.0), 1.0, 4.0 * np.sin(0.05), 4.0 * np.cos(0.05)])
    widths = {"range": std[0] / 5000.0, "speed": std[2], "course": std[3]}
    centres = {"range": np.log(5000.0), "speed": 4.0, "course": motion[3] + turns}
    spans = {
        name: Interval(centres[name] - 1.96 * other * w, centres[name] + 1.96 * half * w,
                       False, False)
        for name, w in widths.items()
    }  # fmt: skip
    seen = SimpleNamespace(
        observable=np.ones(5, bool), rank=5, n_parameters=5, weakest="range +1 %",
        condition=10.0, probability=0.5,
    )  # fmt: skip
    told = {
        "q": q, "covariance": np.diag(np.square([*std, 0.1])), "intervals": spans,
        "ellipse_holds": True, "observability": seen, "at_limit_m": None, "value": 50.0,
        "range_per_sound_speed": 1.0, "legs": (None,), "weight": 1.0,
    }  # fmt: skip
    return SimpleNamespace(**(told | changed))


@pytest.mark.parametrize(
    ("half", "other", "expected"),
    [(1.0, 1.0, True), (1.24, 0.76, True), (1.26, 1.0, False), (1.0, 0.74, False),
     (0.76, 1.24, True), (0.74, 1.0, False), (1.0, 1.26, False)],
)  # fmt: skip
@pytest.mark.parametrize("turns", [0.0, 2 * np.pi, -2 * np.pi])
def test_an_ellipse_agrees_within_a_quarter_on_either_side(half, other, expected, turns):
    assert table.ellipse_agrees(mode_of(half, other, turns=turns)) is expected
    assert not table.ellipse_agrees(mode_of(half, other, ellipse_holds=False))
    spans = dict(mode_of().intervals)
    for name, span in spans.items():
        cut = spans | {name: Interval(span.low, span.high, False, True)}
        assert not table.ellipse_agrees(mode_of(intervals=cut))


def answer_of(**changed):
    told = {
        "legs": SimpleNamespace(probability=0.01), "n_values": 40, "manoeuvring": True, "probability": None, "n_sources": 1,
        "is_own_noise": False,
        "data": SimpleNamespace(
            bearing_deg=np.ones(20), line_id=np.ones(1), time_s=np.arange(20.0),
            bounce_delay_s=None,
        ),
    }  # fmt: skip
    return SimpleNamespace(**(told | changed))


@pytest.mark.parametrize(
    ("std", "hidden"),
    [((4990.0, 0.1, 1, 0.1), ()), ((5010.0, 0.1, 1, 0.1), ("range_m",)),
     ((200, 0.1, 4.9, 0.1), ()), ((200, 0.1, 5.1, 0.1), ("speed_mps",)),
     ((200, 0.1, 1, np.radians(59)), ()), ((200, 0.1, 1, np.radians(61)), ("course_deg",))],
)  # fmt: skip
def test_what_is_less_certain_than_its_limit_is_not_given(std, hidden):
    found = table.reasons_of(mode_of(std=std), answer_of())
    assert set(found) == {*hidden, *(f"now_{name}" for name in hidden)}
    assert all("too little change of bearing" in why for why in found.values())


def test_a_contact_that_is_the_towing_ship_is_named_so_and_has_no_motion():
    answer, mode = answer_of(is_own_noise=True), mode_of()
    found = table.reasons_of(mode, answer)
    named = {name for name in found if not name.startswith("now_")}
    assert named == {"range_m", "speed_mps", "course_deg"}
    told = table.report_of(mode, answer, found, manoeuvre_needed=False)
    assert "range is not observable: own ship: the sound comes from" in told


@pytest.mark.parametrize(
    ("lost", "hidden"),
    [((0,), ("range_m", "speed_mps", "course_deg")),
     ((1,), ("bearing_deg", "speed_mps", "course_deg")), ((2,), ("speed_mps",)),
     ((3,), ("course_deg",)), ((4,), ("rest_frequencies_hz",))],
)  # fmt: skip
def test_what_a_singular_direction_touches_is_not_given(lost, hidden):
    """What scales or turns freely drags speed and course along."""
    mode = mode_of()
    mode.observability.observable[list(lost)] = False
    found = table.reasons_of(mode, answer_of())
    assert {name for name in found if not name.startswith("now_")} == set(hidden)


def test_an_open_range_says_how_far_it_is_at_least_and_what_is_missing():
    mode, spans = mode_of(), dict(mode_of().intervals)
    spans["range"] = Interval(np.log(3000.0), 12.0, False, True)
    mode.intervals = spans
    assert "(at least 3000 m); too" in table.reasons_of(mode, answer_of())["range_m"]
    mode.at_limit_m = 77_000.0
    assert "limit of the search, 77000 m" in table.reasons_of(mode, answer_of())["range_m"]
    mode.at_limit_m = None
    spans["range"] = Interval(np.log(3000.0), 12.0, True, True)
    assert "at least" not in table.reasons_of(mode, answer_of())["range_m"]
    nothing, mode.observability.rank = np.full(20, np.nan), 4
    for answer, words in (
        (answer_of(n_values=4), "4 values cannot fix 5 parameters"),
        (answer_of(data=SimpleNamespace(bearing_deg=nothing, line_id=np.ones(1))),
         "frequencies alone"),
        (answer_of(manoeuvring=False), "the bearing does not change"),
        (answer_of(manoeuvring=False, data=SimpleNamespace(
            bearing_deg=np.ones(3), line_id=np.zeros(0))),
         "no frequency lines"),
    ):  # fmt: skip
        assert words in table.reasons_of(mode, answer)["range_m"]
    mode.observability.rank = 5
    plain = table.reasons_of(mode, answer_of(manoeuvring=False, n_values=5))
    assert "too little change" in plain["range_m"]


@pytest.mark.parametrize(("off", "complains"), [(-0.01, False), (0.01, True)])
def test_a_misfit_of_five_deviations_is_told(off, complains):
    freedom = 35
    value = freedom * (1 + 5 * np.sqrt(2 / freedom) + off)
    words = table._complaints(mode_of(value=value), answer_of())
    assert bool(words) is complains
    assert table._complaints(mode_of(value=1e9), answer_of(n_values=5)) == []
    assert table._complaints(mode_of(value=1e9), answer_of(n_values=6)) != []


def test_a_report_says_what_is_known_in_its_units():
    words = table.report_of(mode_of(), answer_of(), {}, manoeuvre_needed=False)
    assert "range to 4 %" in words
    assert "speed to 0.58 kn" in words  # 0.3 m/s
    assert "course to 5.7 deg" in words
    assert "moves the range by +1 %" in words
    assert "Doppler" not in words
    quiet = mode_of(range_per_sound_speed=0.009, observability=mode_of().observability)
    words = table.report_of(quiet, answer_of(manoeuvring=False), {}, manoeuvre_needed=False)
    assert "sound speed" not in words
    assert "the range rests on Doppler" in words
    counted = answer_of(probability=np.array([1.0, 0.5, np.nan, 0.75]), n_sources=2)
    (words,) = table._shares(counted)
    assert words == "2 of 3 bearings are of this contact, of 2 sources in these rows"
