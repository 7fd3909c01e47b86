"""Speed of the clutter tracker against Stone Soup, and of q2 against scipy.

Both sides run in this process and are compared by CPU time. Stone Soup is the oracle,
too: the tracks must agree before the times are compared. The figures in docs/measured.md are
printed by `python -m tests.benchmarks.test_pdaf_speed`.
"""

import math
import time
from datetime import datetime, timedelta

import numpy as np
import pytest

from studies.clutter_runs import setting_of
from studies.rows import load_reference
from tests.clutter import test_several_targets as several
from tests.draws.crossing_targets import crossing
from uwtrack_cli.clutter.clutter_filter import Scan, step
from uwtrack_cli.clutter.options import Detector, TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.estimation.information_reduction import gate_probability, information_reduction
from uwtrack_cli.estimation.operating_curve import constant_curve

GOLDEN = load_reference("clutter_golden")
BEGIN = datetime(2001, 8, 27)  # noqa: DTZ001 - Stone Soup compares naive times
SCANS = 50


def _scans(track):
    return [np.array(s["Z"], dtype=float).reshape(-1, 2) for s in track["steps"][:SCANS]]


def _stone_soup(track):
    """Return state and covariance after every scan, and the CPU time."""
    from stonesoup.dataassociator.probability import PDA
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.probability import PDAUpdater

    sensor = LinearGaussian(4, (0, 2), np.array(GOLDEN["R"]))
    motion = LinearGaussianTimeInvariantTransitionModel(
        np.array(GOLDEN["F"]), covariance_matrix=np.array(GOLDEN["Q"])
    )
    updater = PDAUpdater(sensor)
    associator = PDA(
        PDAHypothesiser(
            KalmanPredictor(motion), updater, clutter_spatial_density=GOLDEN["lam"],
            prob_detect=GOLDEN["PD"], prob_gate=GOLDEN["PG"],
        )
    )  # fmt: skip
    state = np.array(track["x0"])[:, None]
    followed = Track([GaussianState(state, 100.0 * np.eye(4), timestamp=BEGIN)])
    states = []
    detections = [
        {
            Detection(z[:, None], timestamp=BEGIN + timedelta(seconds=k), measurement_model=sensor)
            for z in scan
        }
        for k, scan in enumerate(_scans(track), start=1)
    ]
    begin = time.process_time()
    for number, scan in enumerate(detections, start=1):
        now = BEGIN + timedelta(seconds=number)
        hypotheses = associator.associate({followed}, scan, now)
        followed.append(updater.update(hypotheses[followed]))
        states.append(followed[-1])
    spent = time.process_time() - begin
    return (
        np.array([np.asarray(s.mean, dtype=float)[:, 0] for s in states]),
        np.array([np.asarray(s.covar, dtype=float) for s in states]),
        spent,
    )


def _ours(track, copies):
    """Step a number of equal tracks; return the first one's states and the CPU time."""
    setting = setting_of("fixed", constant_curve(GOLDEN["PD"]), GOLDEN["PF"])
    transition, noise = constant_velocity(1.0, 10.0, 2)
    belief = Belief(
        np.tile(np.array(track["x0"]), (1, copies, 1)),
        np.tile(100.0 * np.eye(4), (1, copies, 1, 1)), np.ones((1, copies)),
    )  # fmt: skip
    scans = [
        Scan(
            np.tile(z, (copies, 1, 1)), np.ones((copies, len(z)), dtype=bool),
            np.full((copies, len(z)), np.nan), np.array(GOLDEN["R"])[None, None],
        )
        for z in _scans(track)
    ]  # fmt: skip
    states, covariances = [], []
    begin = time.process_time()
    for scan in scans:
        outcome = step(
            belief, scan, setting, transition=transition, noise=noise[None],
            switching=np.ones((1, 1)),
        )  # fmt: skip
        belief = outcome.belief
        states.append(outcome.mean[0])
        covariances.append(outcome.covariance[0])
    spent = time.process_time() - begin
    return np.array(states), np.array(covariances), spent


@pytest.fixture(scope="session")
def stone_soup():
    return _stone_soup(GOLDEN["tracks"][0])


@pytest.mark.parametrize("number", [0, 1, 2])
def test_stone_soup_finds_the_same_states_to_1e_9(number):
    track = GOLDEN["tracks"][number]
    mean, covariance, _ = _stone_soup(track)
    ours, spread, _ = _ours(track, 1)
    np.testing.assert_allclose(ours, mean, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(spread, covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.benchmark
@pytest.mark.parametrize(("copies", "times"), [(1, 5.0), (100, 50.0)])
def test_a_scan_costs_a_fraction_of_stone_soups(stone_soup, copies, times):
    track = GOLDEN["tracks"][0]
    _ours(track, copies)
    per_track = min(_ours(track, copies)[2] for _ in range(5)) / copies
    assert stone_soup[2] / per_track >= times


def _stage(threshold):
    """Follow the track of the first scans by the whole stage; return the CPU time."""
    track = GOLDEN["tracks"][0]
    measured = _scans(track)
    number = np.repeat(np.arange(1, SCANS + 1), [len(z) for z in measured])
    scans = Scans(
        scan=number, time_s=number.astype(float), measured=np.concatenate(measured),
        measured_std=np.full((number.size, 2), math.sqrt(GOLDEN["R"][0][0])),
        amplitude=np.linspace(5.0, 3.0, number.size),
        component=np.array(["z_1", "z_2"]), component_unit=np.array(["m", "m"]),
    )  # fmt: skip
    begin = time.process_time()
    track_in_clutter(
        scans, threshold=threshold, detector=Detector(snr_db=15.0, cell_volume=900.0),
        motion=TargetMotion(acceleration_std=math.sqrt(10.0)),
        start=TargetStart(
            position=track["x0"][::2], velocity=track["x0"][1::2], position_std=10.0,
            velocity_std=10.0, time_s=0.0,
        ),
    )  # fmt: skip
    return time.process_time() - begin


STAGE_TIMES = {"fixed": 5.0, "prior": 5.0, "region": 5.0, "posterior": 4.7}
"""By how much a stage of each threshold must be faster than Stone Soup's filter."""


@pytest.mark.benchmark
def test_the_stage_costs_a_fraction_of_stone_soups_filter():
    """All run in turn, so that a busy spell meets all alike; a region of its own size in
    each scan needs no long quadrature."""
    for threshold in STAGE_TIMES:
        _stage(threshold)
    rounds = [[_stone_soup(GOLDEN["tracks"][0])[2], *map(_stage, STAGE_TIMES)] for _ in range(9)]
    theirs, *spent = np.median(np.array(rounds), axis=0)
    ours = dict(zip(STAGE_TIMES, spent, strict=True))
    for threshold, times in STAGE_TIMES.items():
        assert theirs / ours[threshold] >= times, threshold
    assert ours["region"] < 2.0 * ours["prior"]


def _two_targets(angle_deg):
    """Follow two that cross, here and by Stone Soup; return both CPU times."""
    scans, ways = crossing(1, angle_deg)
    begin = time.process_time()
    track_in_clutter(
        scans, threshold="fixed", detector=several.DETECTOR, motion=several.MOTION,
        start=several.told(ways),
    )  # fmt: skip
    middle = time.process_time()
    several.stone_soup(scans, several.told(ways))
    return middle - begin, time.process_time() - middle


@pytest.mark.benchmark
@pytest.mark.parametrize("angle_deg", [10.0, 90.0])
def test_a_joint_association_costs_a_fraction_of_stone_soups(angle_deg):
    _two_targets(angle_deg)
    spent = np.median([_two_targets(angle_deg) for _ in range(9)], axis=0)
    assert spent[1] / spent[0] >= 5.0


@pytest.mark.benchmark
def test_q2_is_a_hundred_times_faster_than_adaptive_quadrature_at_its_accuracy():
    from scipy.integrate import dblquad

    detection, clutter, gate = 0.8, 2.0, 4.0
    inside = gate_probability(gate, 2)
    background = 2.0 * clutter / gate**2 * (1.0 - detection * inside) / detection

    def phi(s):
        low, high = s * math.exp(-0.5 * gate**2), s
        return _exponential_integral_mean(low, high, gate)

    def integrand(r, log_s):
        s = math.exp(log_s)
        damped = math.exp(-s * background + clutter * (phi(s) - 1.0))
        return s * damped * r**3 * math.exp(-(r**2) - s * math.exp(-0.5 * r**2))

    begin = time.process_time()
    peer, _ = dblquad(integrand, -20.0, 12.0, 0.0, gate, epsabs=2e-6, epsrel=1e-6)
    spent = time.process_time() - begin
    peer *= detection / 2.0
    grid = np.linspace(0.3, 0.99, 40)[:, None]
    around = np.linspace(0.0, 10.0, 25)
    information_reduction(0.5, 0.5)
    begin = time.process_time()
    information_reduction(grid, around)
    each = (time.process_time() - begin) / 1000.0
    assert float(information_reduction(detection, clutter)) == pytest.approx(peer, abs=1e-5)
    assert spent / each >= 100.0


def _exponential_integral_mean(low, high, gate):
    """Return phi(s) for two dimensions in closed form: a difference of E1."""
    from scipy.special import exp1

    return float(2.0 / gate**2 * (exp1(low) - exp1(high)))


def main():
    """Print how many times cheaper than Stone Soup's filter each scan is."""
    track = GOLDEN["tracks"][0]
    for threshold in ("fixed", "prior", "region", "posterior"):
        _stage(threshold)
        pairs = [(_stone_soup(track)[2], _stage(threshold)) for _ in range(15)]
        theirs, ours = np.median(np.array(pairs), axis=0)
        print(f"whole stage, {threshold}: {theirs / ours:.1f} times")
    for angle_deg in (0.0, 10.0, 90.0):
        pairs = [_two_targets(angle_deg) for _ in range(9)]
        ours, theirs = np.median(np.array(pairs), axis=0)
        print(f"two targets at {angle_deg:g} degrees: {theirs / ours:.1f} times")
    for copies in (1, 100):
        _ours(track, copies)
        pairs = [(_stone_soup(track)[2], _ours(track, copies)[2] / copies) for _ in range(9)]
        theirs, ours = np.median(np.array(pairs), axis=0)
        print(f"filter alone, {copies} at once: {theirs / ours:.1f} times")


if __name__ == "__main__":
    main()
