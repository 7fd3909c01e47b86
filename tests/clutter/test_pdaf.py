"""The clutter tracker: recorded runs, Stone Soup, laws, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from studies.clutter_scans import ClutterScene, constant_velocity_truth, simulate_scan
from studies.rows import load_reference
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Roc, Scans
from uwtrack_cli.errors import DataError, OptionError

GOLDEN = load_reference("clutter_golden")
MOTION = TargetMotion(acceleration_std=math.sqrt(10.0))
DETECTOR = Detector(
    snr_db=15.0, false_alarm_probability=GOLDEN["PF"],
    detection_probability=GOLDEN["PD"], cell_volume=GOLDEN["Vc"],
)  # fmt: skip


def _scans(lists, amplitudes=None, std=5.0**0.5):
    """Return scans at 1, 2 ... s from lists of measurements, with empty rows."""
    rows, number, strength = [], [], []
    for scan, measured in enumerate(lists, start=1):
        points = np.asarray(measured, dtype=float).reshape(-1, 2)
        given = None if amplitudes is None else amplitudes[scan - 1]
        if len(points) == 0:
            points, given = np.full((1, 2), np.nan), [np.nan]
        rows.append(points)
        number += [scan] * len(points)
        strength += [np.nan] * len(points) if given is None else list(given)
    measured = np.concatenate(rows)
    return Scans(
        scan=number, time_s=np.array(number, dtype=float), measured=measured,
        measured_std=np.full(measured.shape, std), amplitude=strength,
        component=["east", "north"], component_unit=["m", "m"],
    )  # fmt: skip


def _golden_scans(track):
    return _scans([step["Z"] for step in track["steps"]])


def _golden_start(track):
    return TargetStart(
        position=track["x0"][::2], velocity=track["x0"][1::2], position_std=10.0,
        velocity_std=10.0, time_s=0.0,
    )  # fmt: skip


def _simulated(seed=1, scans=30, **scene):
    """Return scans with amplitudes, the true states and a start near the truth."""
    rng = np.random.default_rng(seed)
    start = np.array([[0.0, 20.0, 500.0, -10.0]])
    truth = constant_velocity_truth(
        rng, start, scans=scans, interval_s=1.0, acceleration_std=math.sqrt(10.0)
    )
    detector = ClutterScene(signal_to_noise=10**1.5, **scene)
    drawn = [simulate_scan(rng, state[:, ::2], detector) for state in truth]
    table = _scans(
        [d.measured[0][d.amplitude[0] > 0] for d in drawn],
        [d.amplitude[0][d.amplitude[0] > 0] for d in drawn],
    )
    begin = TargetStart(
        position=list(start[0, ::2]), velocity=list(start[0, 1::2]),
        position_std=10.0, velocity_std=10.0, time_s=0.0,
    )  # fmt: skip
    return table, truth[:, 0], begin


@pytest.mark.parametrize("track", GOLDEN["tracks"], ids=lambda t: f"seed {t['seed']}")
def test_the_recorded_tracks_are_met_to_1e_9(track):
    target = track_in_clutter(
        _golden_scans(track), threshold="fixed", detector=DETECTOR, motion=MOTION,
        start=_golden_start(track),
    )  # fmt: skip
    steps = track["steps"]
    np.testing.assert_allclose(target.state, [s["x"] for s in steps], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        target.state_covariance, [s["P"] for s in steps], rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(target.miss_probability, [s["b0"] for s in steps], atol=1e-9)
    for step, number in zip(steps, target.scan, strict=True):
        ours = target.association_probability[target.association_scan == number]
        theirs = np.array(step["beta"])
        np.testing.assert_allclose(ours, theirs[theirs > 0.0], atol=1e-9)


@pytest.mark.parametrize("rule", ["fixed", "prior", "posterior", "region"])
def test_every_rule_follows_a_clear_target_within_its_stated_deviation(rule):
    scans, truth, begin = _simulated(seed=2, half_width=200.0, false_alarm=0.05)
    target = track_in_clutter(
        scans, threshold=rule, motion=MOTION, start=begin,
        detector=Detector(
            snr_db=15.0, cell_volume=900.0, false_alarm_range=(1e-4, 0.05)
        ),
    )  # fmt: skip
    error = target.state - truth
    nees = np.einsum("si,sij,sj->s", error, np.linalg.inv(target.state_covariance), error)
    assert 1.0 < nees.mean() < 9.0
    assert not target.lost.any()


def test_the_probabilities_of_a_scan_sum_to_one():
    scans, _, begin = _simulated(seed=3)
    target = track_in_clutter(
        scans, motion=MOTION, start=begin, detector=Detector(snr_db=15.0, cell_volume=900.0)
    )
    total = target.miss_probability.copy()
    np.add.at(total, target.association_scan - 1, target.association_probability)
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    assert np.all(np.diff(target.association_row) > 0)


def test_the_adaptive_threshold_rises_as_the_region_grows():
    scans, _, begin = _simulated(seed=4)
    target = track_in_clutter(
        scans, motion=MOTION, start=begin, detector=Detector(snr_db=15.0, cell_volume=900.0)
    )
    order = np.argsort(target.gate_volume)
    assert np.all(np.diff(target.threshold[order]) >= -1e-12)
    assert np.ptp(target.threshold) > 0.1


def test_a_shift_in_time_and_place_shifts_the_track_only():
    scans, _, begin = _simulated(seed=5)
    moved = replace(
        scans, time_s=scans.time_s + 1000.0, measured=scans.measured + np.array([512.0, -256.0])
    )
    start = replace(
        begin, time_s=1000.0, position=[p + d for p, d in zip(
            begin.position, (512.0, -256.0), strict=True)],
    )  # fmt: skip
    options = {"motion": MOTION, "detector": Detector(snr_db=15.0, cell_volume=900.0)}
    here = track_in_clutter(scans, start=begin, **options)
    there = track_in_clutter(moved, start=start, **options)
    np.testing.assert_allclose(there.state, here.state + np.array([512.0, 0, -256.0, 0]), atol=1e-7)
    np.testing.assert_allclose(there.time_s, here.time_s + 1000.0)


def test_an_empty_scan_coasts_on_the_prediction():
    track = GOLDEN["tracks"][0]
    lists = [step["Z"] for step in track["steps"]][:6]
    lists[3] = []
    target = track_in_clutter(
        _scans(lists), threshold="fixed", detector=DETECTOR, motion=MOTION,
        start=_golden_start(track),
    )  # fmt: skip
    forward = np.array(GOLDEN["F"])
    np.testing.assert_allclose(target.state[3], forward @ target.state[2])
    assert target.miss_probability[3] == 1.0
    assert target.validated[3] == 0
    grown = np.trace(target.state_covariance, axis1=1, axis2=2)
    assert grown[3] > grown[2]
    assert grown[4] < grown[3]


def test_a_target_that_vanishes_is_lost_and_its_score_says_so():
    scans, _, begin = _simulated(seed=6, scans=40, half_width=150.0, false_alarm=0.02)
    lists = [scans.measured[scans.scan == n] for n in range(1, 41)]
    rng = np.random.default_rng(8)
    for scan in range(20, 40):
        lists[scan] = lists[19][:1] + rng.uniform(-150.0, 150.0, (2, 2))
    target = track_in_clutter(
        _scans(lists), threshold="fixed", motion=MOTION, start=begin,
        detector=Detector(snr_db=15.0, false_alarm_probability=0.02, cell_volume=900.0),
    )  # fmt: skip
    assert not target.lost[:20].any()
    assert target.lost[-1]


def test_the_track_begins_at_the_strongest_measurement_when_no_start_is_given():
    scans, truth, _ = _simulated(seed=7, half_width=200.0, false_alarm=0.02)
    target = track_in_clutter(
        scans,
        motion=MOTION,
        start=TargetStart(velocity_std=30.0),
        detector=Detector(snr_db=15.0, cell_volume=900.0, false_alarm_range=(1e-4, 0.02)),
    )
    error = target.state[:, ::2] - truth[-len(target.scan) :, ::2]
    assert np.hypot(*error[-1]) < 5.0 * target.state_std[-1, ::2].max()


def test_two_interacting_models_follow_a_turn_that_loses_the_quiet_filter():
    rng = np.random.default_rng(9)
    state = np.array([0.0, 50.0, 0.0, -50.0])
    scene = ClutterScene(signal_to_noise=100.0, half_width=200.0, false_alarm=0.01)
    lists, strengths, truth = [], [], []
    for scan in range(40):
        push = np.array([30.0, 15.0]) if 15 <= scan < 20 else np.zeros(2)
        state[::2] += state[1::2] + 0.5 * push
        state[1::2] += push
        drawn = simulate_scan(rng, state[None, ::2], scene)
        lists.append(drawn.measured[0][drawn.amplitude[0] > 0])
        strengths.append(drawn.amplitude[0][drawn.amplitude[0] > 0])
        truth.append(state.copy())
    common = {
        "threshold": "prior",
        "detector": Detector(
            snr_db=20.0, cell_volume=900.0, false_alarm_range=(1e-4, 0.01)
        ),
        "start": TargetStart(position=[0.0, 0.0], velocity=[50.0, -50.0],
                             position_std=10.0, velocity_std=10.0, time_s=0.0),
    }  # fmt: skip
    scans = _scans(lists, strengths)
    quiet = track_in_clutter(scans, motion=TargetMotion(acceleration_std=1.0), **common)
    two = track_in_clutter(
        scans, motion=TargetMotion(acceleration_std=1.0, manoeuvre_std=20.0), **common
    )
    last = np.array(truth)[-1, ::2]
    assert np.hypot(*(quiet.state[-1, ::2] - last)) > 100.0
    assert np.hypot(*(two.state[-1, ::2] - last)) < 15.0
    assert two.model_probability[16:20, 1].max() > 0.9
    assert two.model_probability[-1, 0] > 0.5
    np.testing.assert_allclose(two.model_probability.sum(axis=1), 1.0)


def test_a_measured_curve_of_the_model_gives_the_models_track():
    scans, _, begin = _simulated(seed=10, scans=15)
    false_alarm = np.geomspace(1e-4, 0.3, 400)
    roc = Roc(
        false_alarm_probability=false_alarm,
        detection_probability=false_alarm ** (1.0 / (1.0 + 10**1.5)),
        threshold=np.full(400, np.nan),
    )
    options = {"motion": MOTION, "start": begin}
    model = track_in_clutter(scans, detector=Detector(snr_db=15.0, cell_volume=900.0), **options)
    table = track_in_clutter(scans, roc, detector=Detector(cell_volume=900.0), **options)
    np.testing.assert_allclose(table.state, model.state, atol=0.01)


def test_a_component_in_one_dimension_is_followed_too():
    rng = np.random.default_rng(11)
    true = 100.0 + 0.5 * np.arange(1, 41)
    rows = [np.append(rng.uniform(60, 160, 3), t + rng.normal(0, 0.5)) for t in true]
    scans = Scans(
        scan=np.repeat(np.arange(1, 41), 4), time_s=np.repeat(np.arange(1.0, 41.0), 4),
        measured=np.concatenate(rows)[:, None], measured_std=np.full((160, 1), 0.5),
        amplitude=np.full(160, np.nan), component=["frequency"], component_unit=["Hz"],
    )  # fmt: skip
    target = track_in_clutter(
        scans, threshold="fixed", clutter="count",
        detector=Detector(detection_probability=0.95),
        motion=TargetMotion(acceleration_std=0.05),
        start=TargetStart(position=[100.0], position_std=1.0, velocity_std=1.0, time_s=0),
    )  # fmt: skip
    assert abs(target.state[-1, 0] - true[-1]) < 4.0 * target.state_std[-1, 0]
    assert target.state_std[-1, 0] < 0.5


def _valid():
    return {
        "threshold": "fixed", "detector": DETECTOR, "motion": MOTION,
        "start": _golden_start(GOLDEN["tracks"][0]),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: {"gate": 0.0}, "gate must be a number .*at most 10"),
        (lambda: {"measured_std": [1.0]}, "measured_std must be 2 numbers"),
        (lambda: {"measured_std": [1.0, -1.0]}, "measured_std must be a number"),
        (lambda: {"loss_score": 0.0}, "loss_score must be a number"),
        (lambda: {"clutter": "guess"}, "clutter must be one of"),
        (lambda: {"threshold": "prior", "clutter": "count"}, "cannot count it"),
        (lambda: {"motion": TargetMotion()}, "--motion-acceleration-std"),
        (lambda: {"motion": TargetMotion(acceleration_std=-1.0)}, "at least 1e-12"),
        (lambda: {"motion": TargetMotion(acceleration_std=2.0, manoeuvre_std=1.0)}, "above acc"),
        (lambda: {"motion": TargetMotion(1.0, 2.0, 1.5)}, "manoeuvre_start_probability"),
        (lambda: {"start": TargetStart()}, "--start-velocity-std"),
        (lambda: {"start": TargetStart([1.0, 2.0], None, -1.0, 1.0)}, "position_std"),
        (lambda: {"start": TargetStart([1.0], None, 1.0, 1.0)}, "start.position must be 2"),
        (lambda: {"detector": Detector(snr_db=3.0)}, "--detector-cell-volume"),
        (lambda: {"detector": Detector(cell_volume=1.0)}, "--detector-snr-db"),
        (lambda: {"detector": Detector(snr_db=3.0, cell_volume=-1.0)}, "cell_volume must be"),
        (lambda: {"detector": replace(DETECTOR, detection_probability=1.5)}, "detection_probability must be a number"),
        (lambda: {"detector": replace(DETECTOR, false_alarm_probability=0.0)}, "false_alarm_pro"),
        (lambda: {"detector": replace(DETECTOR, false_alarm_range=(0.3, 0.1))}, "range must be increasing"),
    ],
)  # fmt: skip
def test_a_bad_option_is_refused_with_what_is_accepted(change, message):
    scans = _golden_scans(GOLDEN["tracks"][0])
    with pytest.raises(OptionError, match=message):
        track_in_clutter(scans, **(_valid() | change()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scan": lambda v: v[::-1]}, "row .* belongs to an earlier scan"),
        ({"time_s": lambda v: -v}, "not later than the scan before"),
        ({"time_s": lambda v: v + np.arange(v.size)}, "another time than its scan"),
        ({"measured": lambda v: v * np.nan}, "all 50 scans are empty"),
        ({"measured": lambda v: v * [1.0, np.nan]}, "all 50 scans are empty"),
        ({"measured_std": lambda v: -v}, "row 1 .* missing or not above 0"),
        ({"measured_std": lambda v: v * np.nan}, "--measured-std"),
    ],
)
def test_bad_scans_are_refused_with_the_row(change, message):
    scans = _golden_scans(GOLDEN["tracks"][0])
    changed = {name: edit(getattr(scans, name)) for name, edit in change.items()}
    with pytest.raises(DataError, match=message):
        track_in_clutter(replace(scans, **changed), **_valid())


def test_half_a_measurement_is_refused_with_the_row():
    scans = _golden_scans(GOLDEN["tracks"][0])
    measured = scans.measured.copy()
    measured[4, 1] = np.nan
    with pytest.raises(DataError, match=r"row 5 .* only some of its components"):
        track_in_clutter(replace(scans, measured=measured), **_valid())


def test_an_adaptive_threshold_without_amplitudes_is_refused():
    scans = _golden_scans(GOLDEN["tracks"][0])
    with pytest.raises(DataError, match="has no amplitude"):
        track_in_clutter(scans, **(_valid() | {"threshold": "prior"}))


def test_a_start_after_the_last_scan_is_refused():
    start = replace(_golden_start(GOLDEN["tracks"][0]), time_s=99.0)
    with pytest.raises(DataError, match="no scan after the start"):
        track_in_clutter(_golden_scans(GOLDEN["tracks"][0]), **(_valid() | {"start": start}))


def test_a_start_among_equals_without_amplitude_must_be_given():
    with pytest.raises(DataError, match="--start-position"):
        track_in_clutter(
            _golden_scans(GOLDEN["tracks"][0]),
            **(_valid() | {"start": TargetStart(velocity_std=10.0)}),
        )


@pytest.mark.parametrize(
    ("false_alarm", "detection", "message"),
    [
        ([0.1], [0.5], "two points"),
        ([0.0, 0.1], [0.5, 0.6], "point 1 .* not a probability"),
        ([0.1, 0.05], [0.5, 0.6], "must rise"),
        ([0.05, 0.1], [0.6, 0.5], "must rise"),
    ],
)
def test_a_bad_measured_curve_is_refused(false_alarm, detection, message):
    roc = Roc(
        false_alarm_probability=false_alarm, detection_probability=detection,
        threshold=np.full(len(detection), np.nan),
    )  # fmt: skip
    with pytest.raises(DataError, match=message):
        track_in_clutter(_golden_scans(GOLDEN["tracks"][0]), roc, **_valid())


def test_a_curve_with_rising_thresholds_is_refused():
    roc = Roc(
        false_alarm_probability=[0.01, 0.1], detection_probability=[0.5, 0.6], threshold=[1.0, 2.0]
    )
    with pytest.raises(DataError, match="thresholds"):
        track_in_clutter(_golden_scans(GOLDEN["tracks"][0]), roc, **_valid())


def test_a_shrunk_region_is_never_smaller_than_a_resolution_cell():
    scans, _, begin = _simulated(seed=2, scans=20)
    detector = Detector(snr_db=15.0, cell_volume=400.0)
    target = track_in_clutter(
        scans, threshold="region", detector=detector, motion=MOTION, start=begin
    )
    cells = target.gate_volume / 400.0
    assert cells.min() == pytest.approx(1.0)
    assert np.count_nonzero(np.isclose(cells, 1.0)) >= 5
    assert np.all(target.gate <= 4.0)


def test_an_adaptive_threshold_stays_below_the_false_alarms_that_were_recorded():
    scans, _, begin = _simulated(seed=2, scans=10)
    detector = Detector(snr_db=15.0, cell_volume=1e6)
    target = track_in_clutter(scans, detector=detector, motion=MOTION, start=begin)
    np.testing.assert_allclose(target.false_alarm_probability, 0.3)


def test_a_measured_curve_that_only_touches_the_range_is_refused():
    scans, _, begin = _simulated(seed=2, scans=10)
    roc = Roc(
        false_alarm_probability=[0.2, 0.5], detection_probability=[0.8, 0.9],
        threshold=[np.nan, np.nan],
    )  # fmt: skip
    detector = Detector(
        cell_volume=900.0, false_alarm_probability=0.3, false_alarm_range=(0.1, 0.2)
    )
    with pytest.raises(OptionError, match="does not meet the measured curve"):
        track_in_clutter(scans, roc, detector=detector, motion=MOTION, start=begin)


def test_a_measured_curve_without_all_thresholds_takes_those_of_rayleigh_noise():
    scans, _, begin = _simulated(seed=2, scans=10)
    options = {
        "detector": Detector(cell_volume=900.0, false_alarm_probability=0.01),
        "motion": MOTION, "start": begin,
    }  # fmt: skip
    facts = {
        "false_alarm_probability": [1e-4, 1e-2, 0.3],
        "detection_probability": [0.75, 0.86, 0.96],
    }
    partly = Roc(threshold=[1.0, np.nan, 2.0], **facts)
    none = Roc(threshold=[np.nan] * 3, **facts)
    np.testing.assert_array_equal(
        track_in_clutter(scans, partly, **options).threshold,
        track_in_clutter(scans, none, **options).threshold,
    )


def test_a_measured_curve_may_end_in_certainty_but_not_stand_still():
    scans, _, begin = _simulated(seed=2, scans=10)
    detector = Detector(cell_volume=900.0, false_alarm_probability=0.01)
    facts = {
        "false_alarm_probability": [1e-4, 1e-2, 0.3],
        "detection_probability": [0.75, 0.9, 1.0],
    }
    options = {"detector": detector, "motion": MOTION, "start": begin}
    track_in_clutter(scans, Roc(threshold=[4.3, 3.0, 1.5], **facts), **options)
    with pytest.raises(DataError, match="thresholds of a measured curve must fall"):
        track_in_clutter(scans, Roc(threshold=[3.0, 3.0, 1.5], **facts), **options)
