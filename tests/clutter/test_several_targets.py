"""Several targets: Stone Soup's joint association, laws, and drawn scenes with exact limits."""

import math
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from tests.draws.crossing_targets import (
    DENSITY,
    DETECTION,
    DETECTOR,
    REACH_M,
    STD_M,
    at_end,
    crossing,
    ends_of_both,
    false_only,
    table_of,
)
from tests.support import binomial_interval, poisson_interval
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.flow.scoring.track_scores import gospa

MOTION = TargetMotion(acceleration_std=0.3)
AUTO = {
    "targets": "auto", "threshold": "fixed", "detector": DETECTOR, "motion": MOTION,
    "start": TargetStart(velocity_std=30.0),
}  # fmt: skip


def told(ways):
    """The start of every target where it is."""
    return TargetStart(
        position=np.concatenate([way[0] for way in ways]).tolist(),
        velocity=np.concatenate([way[1] - way[0] for way in ways]).tolist(),
        position_std=STD_M, velocity_std=2.0, time_s=-1.0,
    )  # fmt: skip


def stone_soup(scans, start):
    """Return the states of Stone Soup's joint association, (target, scan, 4)."""
    from scipy.stats import chi2
    from stonesoup.dataassociator.probability import JPDA
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.probability import PDAUpdater

    one = np.array([[0.25, 0.5], [0.5, 1.0]]) * MOTION.acceleration_std**2
    motion = LinearGaussianTimeInvariantTransitionModel(
        np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]), covariance_matrix=np.kron(np.eye(2), one)
    )
    sensor = LinearGaussian(4, (0, 2), np.eye(2) * STD_M**2)
    updater = PDAUpdater(sensor)
    associator = JPDA(
        PDAHypothesiser(
            KalmanPredictor(motion), updater, clutter_spatial_density=DENSITY,
            prob_detect=DETECTION, prob_gate=chi2.cdf(16.0, 2),
        )
    )  # fmt: skip
    begin = datetime(2001, 8, 27)  # noqa: DTZ001 - Stone Soup compares naive times
    places, rates = (np.reshape(start.position, (-1, 2)), np.reshape(start.velocity, (-1, 2)))
    spread = np.diag([STD_M**2, start.velocity_std**2] * 2)
    tracks = [
        Track([GaussianState(np.stack([p, v], 1).reshape(4, 1), spread, timestamp=begin)])
        for p, v in zip(places, rates, strict=True)
    ]
    for time_s in np.unique(scans.time_s):
        now = begin + timedelta(seconds=float(time_s) + 1.0)
        rows = scans.measured[(scans.time_s == time_s) & np.isfinite(scans.measured[:, 0])]
        heard = {Detection(z[:, None], timestamp=now, measurement_model=sensor) for z in rows}
        hypotheses = associator.associate(set(tracks), heard, now)
        for track in tracks:
            track.append(updater.update(hypotheses[track]))
    return np.array([[np.asarray(s.mean, float)[:, 0] for s in track[1:]] for track in tracks])


@pytest.mark.parametrize("angle_deg", [0.0, 10.0, 90.0])
def test_stone_soup_finds_the_same_states_to_1e_9(angle_deg):
    """So losses, cardinality and GOSPA are the same, too."""
    for seed in range(3):
        scans, ways = crossing(seed, angle_deg)
        ours = track_in_clutter(
            scans, threshold="fixed", detector=DETECTOR, motion=MOTION, start=told(ways)
        )
        theirs = stone_soup(scans, told(ways))
        for one, states in zip(ours.targets, theirs, strict=True):
            np.testing.assert_allclose(one.state, states, rtol=0.0, atol=1e-9)


def test_targets_far_apart_are_each_followed_as_one_alone():
    """The law of a product: what shares no measurement is independent."""
    first, ways = crossing(1, 90.0)
    second, _ = crossing(2, 90.0)
    far = np.array([5e4, 0.0])
    number = np.concatenate([first.scan, second.scan]) - 1
    order = np.argsort(number, kind="stable")
    place = np.concatenate([first.measured, second.measured + far])[order]
    both = table_of(number[order], place, 1.0)
    options = {
        "threshold": "fixed", "detector": DETECTOR,
        "motion": TargetMotion(acceleration_std=0.3, manoeuvre_std=3.0),
    }  # fmt: skip
    start = told([ways[0], ways[0] + far])
    joint = track_in_clutter(both, start=start, **options)
    single = [
        track_in_clutter(first, start=told(ways[:1]), **options),
        track_in_clutter(second, start=told(ways[:1]), **options),
    ]
    for one, alone, shift in zip(joint.targets, single, [0.0, 5e4], strict=True):
        np.testing.assert_allclose(one.state - [shift, 0, 0, 0], alone.state, atol=1e-6)
        for name in ("state_covariance", "model_probability", "score", "validated",
                     "miss_probability", "association_probability"):  # fmt: skip
            np.testing.assert_allclose(
                getattr(one, name), getattr(alone, name), rtol=1e-6, atol=1e-6
            )


def test_the_order_of_the_told_targets_changes_their_numbers_only():
    scans, ways = crossing(5, 10.0)
    options = {"threshold": "fixed", "detector": DETECTOR, "motion": MOTION}
    one = track_in_clutter(scans, start=told(ways), **options)
    two = track_in_clutter(scans, start=told(ways[::-1]), **options)
    for first, second in zip(one.targets, two.targets[::-1], strict=True):
        np.testing.assert_allclose(first.state, second.state, atol=1e-9)


@pytest.mark.slow
def test_a_target_that_crosses_at_10_degrees_takes_no_track_over():
    """In 23 of 200 it does where only one of them is followed."""
    taken = sum(ends_of_both(seed, 10.0) != [0, 1] for seed in range(200))
    assert binomial_interval(taken, 200)[1] <= 0.02


@pytest.mark.slow
def test_tracks_that_begin_by_themselves_cross_without_a_takeover_or_a_loss():
    before, crossed, swapped = 18, 0, 0
    for seed in range(100):
        scans, ways = crossing(seed, 10.0)
        for track in track_in_clutter(scans, **AUTO).targets:
            at = np.flatnonzero(track.scan == before)
            if not at.size:
                continue  # it begins later, or has ended: counted below
            away = [np.hypot(*(track.state[at[0], [0, 2]] - way[before - 1])) for way in ways]
            crossed += 1
            swapped += at_end(track, ways) != int(np.argmin(away))
    assert crossed >= 190
    assert binomial_interval(swapped, crossed)[0] <= 0.01
    assert swapped <= 2


@pytest.mark.long
def test_of_a_thousand_crossings_at_10_degrees_hardly_any_is_a_takeover():
    taken = sum(ends_of_both(seed, 10.0) != [0, 1] for seed in range(1000, 2000))
    assert binomial_interval(taken, 1000)[1] <= 0.02


def test_targets_are_found_and_counted_nearly_as_if_their_starts_were_told():
    """GOSPA (cut off at 50 m) of tracks without any start against Stone Soup's with."""
    found, best, excess = [], [], []
    for seed in range(8):
        scans, ways = crossing(seed, 40.0)
        auto = track_in_clutter(scans, **AUTO)
        theirs = stone_soup(scans, told(ways))
        for scan in range(5, 50):
            true = np.array([way[scan] for way in ways])
            here = auto.state[auto.scan == scan + 1][:, ::2]
            found.append(gospa(here, true, cutoff_m=50.0).distance_m)
            best.append(gospa(theirs[:, scan, ::2], true, cutoff_m=50.0).distance_m)
            excess.append(len(here) - 2)
    assert np.mean(found) < 1.1 * np.mean(best)
    assert np.mean(np.array(excess) != 0) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("density", "detection", "rate"), [(1e-5, 0.9, 100.0), (3e-5, 0.6, 100.0)])
def test_clutter_begins_no_more_tracks_an_hour_than_stated(density, detection, rate):
    """Ville's bound, whatever the scores do on their way to it."""
    scans = false_only(11, 1500, density, 10.0)
    target = track_in_clutter(
        scans, targets="auto", threshold="fixed", false_tracks_per_hour=rate,
        detector=Detector(
            detection_probability=detection, cell_volume=900.0,
            false_alarm_probability=900.0 * density,
        ),
        motion=TargetMotion(acceleration_std=0.01), start=TargetStart(velocity_std=3.0),
    )  # fmt: skip
    hours = 1500 * 10.0 / 3600.0
    starts = np.isfinite(scans.measured[:, 0]).sum()
    assert target.confirming_score == pytest.approx(math.log(starts / hours / rate))
    low, high = poisson_interval(len(target.targets))
    assert low / hours <= rate
    assert high / hours >= 0.02 * rate  # the bound is not idle


def test_a_track_begins_with_its_target_and_ends_with_it():
    draw = np.random.default_rng(21)
    late, off, pieces = [], [], []
    for seed in range(20):
        false = false_only(100 + seed, 80, DENSITY, 1.0)
        scan = np.arange(25, 55)
        way = np.stack([10.0 * (scan - 40), -100.0 + 4.0 * (scan - 25)], axis=1)
        heard = draw.random(scan.size) < DETECTION
        own = (way + STD_M * draw.standard_normal(way.shape))[heard]
        number = np.concatenate([false.scan - 1, scan[heard]])
        order = np.argsort(number, kind="stable")
        place = np.concatenate([false.measured, own])[order]
        target = track_in_clutter(table_of(number[order], place, 1.0), **AUTO)
        tracks = target.targets
        track = max(tracks, key=lambda one: one.scan.size)
        pieces.append(len(tracks))
        late.append(tracks[0].scan[0] - 26)
        off.append(track.scan[-1] - 55)
        assert np.hypot(*(track.state[15, [0, 2]] - way[track.scan[15] - 26])) < 6 * STD_M
    assert np.mean(np.array(pieces) > 1) <= 0.1
    assert np.median(late) <= 2
    assert max(late) <= 10
    assert abs(np.median(off)) <= 1
    assert max(np.abs(off)) <= 10


@pytest.mark.parametrize(("factor", "is_said"), [(1.0, False), (2.0 / 3.0, True), (2.0, True)])
def test_a_density_of_clutter_that_is_not_the_one_told_is_said(factor, is_said):
    """Of a density told a third too low, and of the right one."""
    density, said, ratios = 1e-4, [], []
    draw = np.random.default_rng(5)
    for seed in range(20):
        false = false_only(seed, 50, density, 1.0)
        own = STD_M * draw.standard_normal((50, 2))
        number = np.concatenate([false.scan - 1, np.arange(50)])
        order = np.argsort(number, kind="stable")
        place = np.concatenate([false.measured, own])[order]
        target = track_in_clutter(
            table_of(number[order], place, 1.0), threshold="fixed", motion=MOTION,
            detector=replace(DETECTOR, false_alarm_probability=900.0 * density * factor),
            start=TargetStart([0.0, 0.0], None, STD_M, 2.0),
        )  # fmt: skip
        ratios.append((target.clutter_ratio * factor - 1.0) / (target.clutter_ratio_std * factor))
        said.append(any("times as many false" in text for text in target.statements))
    assert np.mean(said) >= 0.95 if is_said else not any(said)
    assert abs(np.mean(ratios)) < 4.0 / math.sqrt(20)
    assert 0.5 < np.std(ratios) < 1.6


def test_nothing_but_clutter_is_no_target():
    target = track_in_clutter(false_only(3, 50, DENSITY, 1.0), **AUTO)
    assert target.targets == ()
    assert target.statements[0].startswith("no target was found")
    assert target.association_row.size == 0


def test_targets_without_any_measurement_coast():
    scans, ways = crossing(1, 90.0)
    measured = scans.measured.copy()
    measured[np.isin(scans.scan, [4, 5])] = np.nan
    target = track_in_clutter(
        replace(scans, measured=measured), threshold="fixed", detector=DETECTOR,
        motion=MOTION, start=told(ways),
    )  # fmt: skip
    for track in target.targets:
        np.testing.assert_array_equal(track.validated[3:5], 0)
        ahead = track.state[3, ::2] + track.state[3, 1::2]
        np.testing.assert_allclose(track.state[4, ::2], ahead)


def test_ranges_and_bearings_of_several_are_tracked_as_east_and_north():
    draw = np.random.default_rng(8)
    scan = np.repeat(np.arange(30), 2)
    place = np.stack(
        [np.where(np.arange(60) % 2, 800.0, -700.0) + 4.0 * scan, 1500.0 - 3.0 * scan], axis=1
    )
    distance = np.hypot(*place.T) + 5.0 * draw.standard_normal(60)
    bearing = np.degrees(np.arctan2(*place.T)) + 0.2 * draw.standard_normal(60)
    scans = replace(
        table_of(scan, np.stack([distance, bearing % 360.0], axis=1), 1.0),
        measured_std=np.tile([5.0, 0.2], (60, 1)), component_unit=np.array(["m", "deg"]),
    )  # fmt: skip
    target = track_in_clutter(
        scans, **(AUTO | {"start": TargetStart(velocity_std=10.0),
                          "detector": replace(DETECTOR, cell_volume=30.0)})
    )  # fmt: skip
    assert len(target.targets) == 2
    ends = sorted(track.state[-1, 0] for track in target.targets)
    np.testing.assert_allclose(ends, [-584.0, 916.0], atol=15.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"threshold": "prior", "detector": Detector(snr_db=15.0, cell_volume=900.0)},
         "has no amplitude"),
        ({"clutter": "count"}, "use clutter 'cells'"),
        ({"start": TargetStart()}, "--start-velocity-std"),
        ({"start": TargetStart([1.0], None, 1.0, 1.0)}, "2 numbers for each target"),
        ({"start": TargetStart(None, [1.0] * 4, None, 1.0)}, "each of the 0 told"),
        ({"false_tracks_per_hour": 0.0}, "false_tracks_per_hour"),
        ({"targets": "all"}, "targets must be one of"),
    ],
)  # fmt: skip
def test_bad_options_are_refused_with_what_is_accepted(change, message):
    scans, _ = crossing(1, 90.0)
    with pytest.raises((OptionError, DataError), match=message):
        track_in_clutter(scans, **(AUTO | change))


def test_an_adaptive_threshold_of_several_is_refused():
    scans, ways = crossing(1, 90.0)
    loud = replace(scans, amplitude=np.full(scans.scan.size, 9.0))
    with pytest.raises(OptionError, match="--threshold fixed"):
        track_in_clutter(
            loud, detector=Detector(snr_db=15.0, cell_volume=900.0), motion=MOTION, start=told(ways)
        )


def test_one_scan_begins_no_track():
    scans = table_of(np.zeros(2, int), np.array([[0.0, 0.0], [REACH_M, 0.0]]), 1.0)
    with pytest.raises(DataError, match="two scans or more"):
        track_in_clutter(scans, **AUTO)
