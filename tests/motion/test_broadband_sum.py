"""Sums of passages: partials, exact data, and what one source alone would give."""

import numpy as np

from uwtrack_cli.motion.passage.broadband_sum import (
    BroadbandSeries,
    KnownSources,
    alone,
    fit_sources,
    no_sources,
    sum_residuals,
    widening,
)

TIME_S = np.arange(0.0, 400.0, 1.0)
TRUTH = ((120.0, 30.0, 8.0, 0.5, 1.0), (260.0, 20.0, 5.0, 2.5, -1.0))
NONE_KNOWN = KnownSources(np.empty((0, TIME_S.size)), np.empty((0, TIME_S.size)))


def source(time, width, power, bearing, turn):
    """Power and complex intensity of one passage."""
    x = (TIME_S - time) / width
    heard = power / (1 + x**2)
    return heard, heard * np.exp(1j * (bearing + turn * np.arctan(x)))


def together(truth, noise=0.0):
    """Sound of some passages over a background of one."""
    parts = [source(*row) for row in truth]
    rng = np.random.default_rng(1)
    level = np.log(1.0 + sum(power for power, _ in parts))
    angle = np.angle(sum(vector for _, vector in parts))
    ones = np.full(TIME_S.size, 0.1)
    return BroadbandSeries(
        TIME_S, level + noise * rng.normal(size=TIME_S.size), ones,
        angle + noise * rng.normal(size=TIME_S.size), ones,
    )  # fmt: skip


def start(truth):
    rows = [(t + 4.0, np.log(r) + 0.2, np.log(p), b) for t, r, p, b, _ in truth]
    return np.array([[0.1, 1.1, 0.0, 0.0, *np.ravel(rows)]]), np.array([[row[-1] for row in truth]])


def test_exact_sums_are_taken_apart_exactly():
    sources = fit_sources(together(TRUTH), NONE_KNOWN, *start(TRUTH))
    expected = [(t, np.log(r), np.log(p), b) for t, r, p, b, _ in TRUTH]
    np.testing.assert_allclose(sources.motion, expected, atol=2e-3)
    assert abs(sources.background) < 1e-3


def test_what_one_source_alone_would_give_is_what_it_gives_alone():
    sound = together(TRUTH)
    sources = fit_sources(sound, NONE_KNOWN, *start(TRUTH))
    for row in range(2):
        own, truth = (alone(sources, row, sound, NONE_KNOWN), together(TRUTH[row : row + 1]))
        np.testing.assert_allclose(own.power, truth.power, atol=5e-3)
        kept = np.isfinite(own.bearing)
        assert kept.sum() > 100
        turn = np.exp(1j * (own.bearing[kept] - truth.bearing[kept]))
        np.testing.assert_allclose(np.angle(turn), 0.0, atol=5e-3)
        assert np.all(own.power_std >= sound.power_std * (1 - 1e-9))


def test_the_joint_fit_has_no_bias():
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        sound = together(TRUTH)
        noisy = BroadbandSeries(
            TIME_S, sound.power + 0.1 * rng.normal(size=TIME_S.size), sound.power_std,
            sound.bearing + 0.1 * rng.normal(size=TIME_S.size), sound.bearing_std,
        )  # fmt: skip
        sources = fit_sources(noisy, NONE_KNOWN, *start(TRUTH))
        errors.append(sources.motion[:, 0] - [120.0, 260.0])
    errors = np.array(errors)
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * errors.std(axis=0) / np.sqrt(60))
    assert np.all(errors.std(axis=0) < 1.0)


def test_a_known_source_takes_its_power_only():
    power, _ = source(*TRUTH[0])
    spread = np.log(power / TRUTH[0][2])[None]
    known = KnownSources(spread, (TRUTH[0][3] + np.arctan((TIME_S - 120) / 30))[None])
    sources = no_sources(together(TRUTH[:1]), known)
    expected = [0.0, 1.0, 0.0, 0.0, np.log(8.0), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(sources.theta, expected, atol=2e-3)


def test_a_source_far_from_others_is_not_widened_and_a_near_one_is():
    near = (TRUTH[0], (150.0, 30.0, 8.0, 2.0, 1.0))
    for truth, most in ((TRUTH, 1.5), (near, 5.0)):
        sound = together(truth, noise=0.1)
        sources = fit_sources(sound, NONE_KNOWN, *start(truth))
        wider = widening(sources, sound, NONE_KNOWN)
        assert np.all((wider >= 1.0) & (wider < most))
    assert wider[:, :2].max() > 1.5


def test_partials_are_those_of_the_residuals():
    """Central differences, of all unknowns: those of a known source and its deviations."""
    rng = np.random.default_rng(3)
    n = TIME_S.size
    known = KnownSources(*rng.normal(size=(2, 2, n)), *rng.normal(size=(2, 2, n, 3)))
    theta, turn = start(TRUTH)
    head = [[0.1, 1.1, 0.2, -0.3, *rng.normal(size=8)]]
    theta = np.concatenate([head, theta[:, 4:]], axis=1)
    sound = together(TRUTH)
    slope = sum_residuals(theta, turn, sound, known)[1]
    for k in range(theta.shape[1]):
        step = 1e-6 * np.eye(theta.shape[1])[k]
        ends = [sum_residuals(theta + s * step, turn, sound, known)[0] for s in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, slope[..., k], atol=1e-6)


def test_what_moves_a_known_source_within_its_deviations_is_no_other():
    """A passage known 2 s and 5 % off, beside noise that comes from one side."""
    power, vector = source(*TRUTH[0])
    flow = 0.4 * np.exp(0.3j)
    ones = np.full(TIME_S.size, 0.02)
    sound = BroadbandSeries(TIME_S, np.log(1.0 + power), ones, np.angle(vector + flow), ones)

    def heard(time, width):
        seen = np.unwrap(np.angle(source(time, width, *TRUTH[0][2:])[1]))
        return -np.log1p(((TIME_S - time) / width) ** 2), seen

    at, width = 122.0, 30.0 * 1.05
    slopes = np.zeros((2, 1, TIME_S.size, 3))
    for place, ends in enumerate((
        (heard(at + 1, width), heard(at - 1, width)),
        (heard(at, width * 1.025), heard(at, width / 1.025)),
    )):  # fmt: skip
        for kind in range(2):
            slopes[kind, 0, :, place] = ends[0][kind] - ends[1][kind]
    spread, bearing = heard(at, width)
    exact = KnownSources(spread[None], bearing[None])
    loose = KnownSources(spread[None], bearing[None], *slopes, np.eye(3)[None])
    left = no_sources(sound, loose)
    assert left.cost < 0.05 * no_sources(sound, exact).cost
    np.testing.assert_allclose(left.theta[2:4], [flow.real, flow.imag], atol=0.05)
    np.testing.assert_allclose(left.theta[5:7], [-1.0, -1.0], atol=0.15)
