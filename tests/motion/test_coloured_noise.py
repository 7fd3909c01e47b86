"""Coloured noise, correlation of frames, robust scales."""

import numpy as np
import pytest

from uwtrack_cli.estimation.robust import bisquare_weight, median_scale, neighbour_scale
from uwtrack_cli.estimation.row_offsets import Design
from uwtrack_cli.motion.coloured_noise import (
    ColouredNoise,
    fit_coloured_noise,
    information_loss,
    likelihoods_by_noise,
)
from uwtrack_cli.motion.correlation import long_run_excess, overlap_correlation
from uwtrack_cli.motion.passage.fit.doppler import doppler_sums, line_sums
from uwtrack_cli.motion.passage.fit.source_patterns import with_patterns
from uwtrack_cli.motion.passage.model.law import passage_law

TIME = np.arange(600.0)


def drifting(rng, correlation_time_s, deviation):
    decay = np.exp(-1 / correlation_time_s)
    value = np.zeros(TIME.size)
    value[0] = rng.normal()
    for k in range(1, TIME.size):
        value[k] = decay * value[k - 1] + np.sqrt(1 - decay**2) * rng.normal()
    return deviation * value


def test_what_has_inertia_is_told_from_what_has_none():
    """Draws of both kinds of wander: rough after Uhlenbeck and Ornstein, smooth as a sum
    of waves with the spectrum of Matern's 3/2, 1 / (3 / T^2 + w^2)^2."""
    rng = np.random.default_rng(4)
    omega = 2 * np.pi * np.fft.rfftfreq(4 * TIME.size)
    smooth_gain = 1 / (3 / 60.0**2 + omega**2)
    for smooth in (True, False):
        gain = 0.0
        for _ in range(5):
            value = drifting(rng, 60.0, 5.0)
            if smooth:
                wave = rng.standard_normal((2, omega.size))
                value = np.fft.irfft((wave[0] + 1j * wave[1]) * smooth_gain)
                value = 5.0 * value[: TIME.size] / value.std()
            one = [(value + rng.standard_normal(TIME.size), Design.free(PASSAGE[3:].T))]
            every = [
                likelihoods_by_noise(one, np.ones(TIME.size), TIME, 40.0, smooth=s)[1, 0]
                for s in (True, False)
            ]
            gain += every[0] - every[1]
        # two ways cost ln 2 each
        assert (gain > 30.0) if smooth else (-5.01 * np.log(2) < gain < 10.0)


def information(weight, time_s, noise):
    lag = np.abs(time_s[:, None] - time_s[None, :])
    slow = sum(
        variance * np.exp(-lag / correlation_time)
        for variance, correlation_time in zip(noise.variance, noise.correlation_time_s, strict=True)
    )
    return np.linalg.inv(noise.inflation * (np.diag(1 / weight) + slow))


LAG_S = np.array([10.0, 40.0])
X = (TIME - 300.0) / 40.0
PASSAGE = np.stack([1 / (1 + X**2) ** 1.5, X / (1 + X**2) ** 1.5, X / np.hypot(1, X), X**0])
"""What time, width, speed and rest frequency of a passage of 40 s do to a line."""


def found_in(series, columns):
    nothing = (np.zeros(0), np.zeros((0, columns.shape[1])))
    return fit_coloured_noise(series, np.ones(TIME.size), TIME, columns, 40.0, nothing)


def estimate(series, noise):
    """Generalised least squares of a passage: values and deviations."""
    every = np.ones(TIME.size)
    rows = PASSAGE
    if not noise.is_white:
        rows = PASSAGE - information_loss(every, TIME, noise).times(PASSAGE)
    inverse = np.linalg.inv(rows @ PASSAGE.T)
    return inverse @ (rows @ series), np.sqrt(np.diag(inverse))


@pytest.mark.parametrize("has_colour", [False, True])
def test_patterns_take_what_the_inverse_of_the_whole_covariance_lacks(has_colour):
    """Noise, and patterns of sizes with unit variance: inverted as one matrix."""
    rng = np.random.default_rng(2)
    time = TIME[:60]
    weight = np.where(rng.random(time.size) < 0.2, 0.0, rng.uniform(0.5, 2.0, time.size))
    noise = ColouredNoise(np.array([0.8]), np.array([9.0])) if has_colour else None
    own = information_loss(weight, time, noise) if has_colour else None
    patterns = np.stack([np.sin(time / 9.0), time / 60.0])
    taken = with_patterns(weight, own, patterns).times(np.eye(time.size))
    heard = np.flatnonzero(weight)
    covariance = np.diag(1 / weight[heard]) + (patterns.T @ patterns)[np.ix_(heard, heard)]
    if has_colour:
        covariance += 0.8 * np.exp(-np.abs(np.subtract.outer(heard, heard)) / 9.0)
    whole = np.diag(weight)
    whole[np.ix_(heard, heard)] -= np.linalg.inv(covariance)
    np.testing.assert_allclose(taken, whole, atol=1e-9)


def test_what_slow_noise_does_within_a_passage_is_found():
    """Half the mean square of differences, at lags as long as a passage is wide."""
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        series = rng.normal(size=TIME.size) + drifting(rng, 20.0, 1.5)
        noise = found_in(series, np.ones((TIME.size, 1)))
        part = 1 - np.exp(-LAG_S / noise.correlation_time_s[:, None])
        found.append(noise.inflation * noise.variance @ part)
    true = 2.25 * (1 - np.exp(-LAG_S / 20.0))
    assert np.median(found, axis=0) == pytest.approx(true, rel=0.35)


def test_white_noise_alone_widens_a_passage_little():
    """It may be coloured: by a tenth in time and width, more where it looks alike."""
    plain = estimate(TIME, ColouredNoise(np.empty(0), np.empty(0)))[1]
    wider = []
    for seed in range(16):
        series = np.random.default_rng(seed).normal(size=TIME.size)
        wider.append(estimate(series, found_in(series, PASSAGE.T))[1] / plain)
    assert np.median(wider, axis=0)[:2].max() < 1.25
    assert np.max(wider, axis=0)[:2].max() < 1.6
    assert np.min(wider) > 1 - 1e-9


def test_slow_noise_too_weak_to_be_seen_is_in_the_deviation():
    """A third of the white noise of an instant; alone that is half of what is due."""
    ratio = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        series = rng.normal(size=TIME.size) + drifting(rng, 30.0, 0.35)
        value, std = estimate(series, found_in(series, PASSAGE.T))
        ratio.append(value[:3] / std[:3])
    assert 0.7 < np.sqrt(np.mean(np.square(ratio))) < 1.3


@pytest.mark.parametrize("inflation", [1.0, 1.7])
def test_the_loss_is_that_of_white_and_slow_noise(inflation):
    """White precision less the inverse of a covariance that is written out."""
    noise = ColouredNoise(np.array([1.5, 0.4]), np.array([12.0, 90.0]), inflation)
    weight = np.where(TIME % 7 == 0, 0.0, 0.5 + TIME % 3)
    used = np.flatnonzero(weight > 0)
    expected = np.diag(weight)
    expected[np.ix_(used, used)] -= information(weight[used], TIME[used], noise)
    found = information_loss(weight, TIME, noise).times(np.eye(TIME.size))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("is_coloured", [False, True])
def test_lines_without_their_rest_frequencies_cost_what_least_squares_say(is_coloured):
    """The normal equations are those of a covariance that is written out."""
    time = np.linspace(0.0, 60.0, 40)
    rng = np.random.default_rng(3)
    weight = 1e8 * rng.uniform(0.2, 1.0, (1, 2, time.size))
    weight[0, 1, ::5] = 0.0
    shift = 1e-3 * rng.standard_normal((1, 2, time.size))
    size = weight[0].sum(axis=0)
    noise = ColouredNoise(np.array([2e-8]), np.array([9.0]))
    loss = information_loss(size, time, noise) if is_coloured else None
    precision = np.diag(weight.ravel())
    if is_coloured:  # it moves both lines, and is told from what they have in common
        share = np.hstack([np.diag(row / size) for row in weight[0]])
        lost = np.diag(size) - information(size, time, noise)
        precision = precision - share.T @ lost @ share

    def law_at(theta):
        return passage_law(time, theta[None], 1500.0, 5.0, with_height=True)

    def least(theta):
        """The least cost over the rest frequencies, and where it is."""
        model = law_at(theta).shift[0]
        rows = np.kron(np.eye(2), 1 + model).T
        left = (shift[0] - model).ravel()
        rest = np.linalg.solve(rows.T @ precision @ rows, rows.T @ precision @ left)
        left = left - rows @ rest
        return 0.5 * left @ precision @ left, rest

    theta = np.array([28.0, np.log(8.0), 6.0])
    found = doppler_sums(law_at(theta), shift, weight, line_sums(shift, weight), loss)
    cost, rest = least(theta)
    np.testing.assert_allclose(found.cost, cost, rtol=1e-6)
    np.testing.assert_allclose(found.rest[0], rest, rtol=1e-6)
    steps = 1e-4 * np.eye(3)
    ways = [(least(theta + h), least(theta - h)) for h in steps]
    slope = [(plus[0] - minus[0]) / 2e-4 for plus, minus in ways]
    np.testing.assert_allclose(found.gradient[0, :3], slope, rtol=1e-4)
    law = law_at(theta)
    rows = np.kron(np.eye(2), 1 + law.shift[0]).T
    motion = np.concatenate([(1 + one) * law.shift_d[0] for one in rest])
    inverse = np.linalg.inv(rows.T @ precision @ rows)
    cross = rows.T @ precision @ motion
    matrix = motion.T @ precision @ motion - cross.T @ inverse @ cross
    np.testing.assert_allclose(found.matrix[0], matrix, rtol=1e-6)
    np.testing.assert_allclose(found.variance[0], np.diag(inverse), rtol=1e-6)
    np.testing.assert_allclose(found.follow[0], inverse @ cross, rtol=1e-6)


@pytest.mark.parametrize(
    ("correlation_time_s", "variance"), [(5.0, 1e4), (20.0, 1.0), (200.0, 1e-2)]
)
def test_a_long_series_keeps_its_information_in_cells(correlation_time_s, variance):
    """Neither more than there is, nor 3 % less, on time, width and speed."""
    time = np.arange(0.0, 600.0, 0.4)
    noise = ColouredNoise(np.array([variance]), np.array([correlation_time_s]))
    x = (time - 300.0) / 40.0
    rows = np.stack([1 / (1 + x**2) ** 1.5, x / (1 + x**2) ** 1.5, x / np.hypot(1, x)])
    weight = np.ones(time.size)
    exact = rows @ information(weight, time, noise) @ rows.T
    found = (rows * weight - information_loss(weight, time, noise).times(rows)) @ rows.T
    share = np.linalg.eigvals(np.linalg.solve(exact, found)).real
    assert share.min() > 0.97
    assert share.max() < 1 + 1e-6


def test_stronger_white_noise_alone_takes_a_share_of_everything():
    noise = ColouredNoise(np.empty(0), np.empty(0), 4.0)
    weight = np.where(TIME % 7 == 0, 0.0, 1.0)
    found = information_loss(weight, TIME, noise).times(np.ones(TIME.size))
    np.testing.assert_allclose(found, 0.75 * weight)


def test_the_long_run_excess_is_the_power_at_frequency_zero():
    """An exponential correlation time of 5 s at unit variance adds 2 x 5 s at 1-s steps."""
    rng = np.random.default_rng(2)
    series = np.stack([rng.normal(size=TIME.size) + drifting(rng, 5.0, 1.0) for _ in range(60)])
    excess = long_run_excess(series, np.ones(series.shape), TIME, 60.0)
    assert np.mean(excess) == pytest.approx(10.0, rel=0.25)


@pytest.mark.parametrize(
    ("kind", "overlap", "expected"),
    [("bearing", 0.5, 1 / 6), ("bearing", 0.75, 0.6591), ("level", 0.5, 1 / 36)],
)
def test_overlap_correlation_of_hann_frames_is_that_of_harris(kind, overlap, expected):
    """Harris (1978), table I: 16.7 % at 50 % overlap, 65.9 % at 75 %."""
    assert overlap_correlation(kind, overlap)[0] == pytest.approx(expected, abs=1e-3)


def test_robust_scales_are_unbiased_and_hardly_moved_by_wild_values():
    rng = np.random.default_rng(3)
    clean = 2.0 * rng.normal(size=(50, 600))
    wild = np.where(rng.random(clean.shape) < 0.1, 100.0, clean)
    ones = np.ones(clean.shape)
    assert median_scale(clean, ones).mean() == pytest.approx(2.0, rel=0.02)
    assert neighbour_scale(clean, ones).mean() == pytest.approx(2.0, rel=0.03)
    assert median_scale(wild, ones).mean() == pytest.approx(2.0, rel=0.2)
    assert neighbour_scale(wild, ones).mean() == pytest.approx(2.0, rel=0.25)
    assert np.all(bisquare_weight(np.array([7.0, 50.0])) == 0)


def test_missing_values_do_not_count_for_scales():
    rng = np.random.default_rng(4)
    value = rng.normal(size=(20, 900))
    weight = np.where(rng.random(value.shape) < 0.4, 0.0, 1.0)
    value = np.where(weight > 0, value, 1e6)
    assert median_scale(value, weight).mean() == pytest.approx(1.0, rel=0.05)
    assert neighbour_scale(value, weight).mean() == pytest.approx(1.0, rel=0.05)
