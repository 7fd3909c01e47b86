"""Sums of checks, starts, sensors and rows of bearings against what is written out."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import norm

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.motion import radiated
from uwtrack_cli.motion.fusion.motion_fit import (
    Approaches,
    clock_errors,
    fit_motion,
    motion_starts,
    predict_approaches,
)
from uwtrack_cli.motion.passage import moving_lines
from uwtrack_cli.motion.passage.checks import fit_checks, rest_frame
from uwtrack_cli.motion.passage.model.unknowns import RAMP, STEP, Change, law_of
from uwtrack_cli.motion.target_motion import association, model, starts
from uwtrack_cli.motion.target_motion.inputs import correlation_inflation, rounding_std
from uwtrack_cli.motion.target_motion.observability import STRAIGHT_M, is_manoeuvring


def least(columns, value, weight):
    """Return the weighted sum of squares that columns leave, and their factors."""
    root = np.sqrt(weight)
    found = np.linalg.lstsq(columns * root[:, None], value * root, rcond=None)[0]
    return (weight * (value - columns @ found) ** 2).sum(), found


def test_lines_that_move_together_gain_what_means_of_cells_say():
    rng = np.random.default_rng(1)
    row = np.repeat([0, 1], 150)
    time = np.tile(np.arange(150.0) * 0.4, 2)
    width, span, mach = 8.0, (20.0, 36.0), np.array([0.003, 0.006])
    bend = -(time - 28.0) / np.hypot(width, time - 28.0)
    value = 0.004 * bend + 1e-3 * rng.standard_normal(300)
    weight = rng.uniform(0.5, 1.5, 300) / 1e-3**2
    weight[row == 1] *= time[row == 1] > 26.0
    level = 2 - np.log1p(((time - 28.0) / width) ** 2) + 0.3 * rng.standard_normal(300)
    level[::7] = np.nan
    measured = moving_lines._Measured(np.array([4, 9]), row, time, value, weight, level, 3.0)
    found = moving_lines._gains(measured, width, span, mach)
    assert found.shape == (2, 8, 2)
    number = np.floor((time - span[0]) / 2.0).astype(int)
    share = 2.0 / 3.0

    def gain(own, size, y, w, law):
        """Over a constant about one place, by means of its cells."""
        cells = [(k, own & (number - place == k) & (w > 0)) for k in range(-16, 17)]
        used = [(k, np.average(y[c], weights=w[c]), w[c].sum()) for k, c in cells if c.any()]
        if not used:
            return 0.0
        k, mean, mass = map(np.array, zip(*used, strict=True))
        sides = (k < 0).sum(), (k > 0).sum()
        if min(sides) < 2 or sum(sides) < 4:
            return 0.0
        ones = np.ones((k.size, 1))
        still = least(ones, mean, mass)[0]
        moving = least(ones, mean - size * law(0.25 * k), mass)[0]
        return 0.5 * sum(sides) * share * np.log((still + 4) / (moving + 4))

    heard = np.where(np.isfinite(level), level, 0.0)
    level_weight = np.where(np.isfinite(level), 4.0, 0.0)
    is_zero = np.zeros((2, 8, 2), bool)
    for line in (0, 1):
        for place in range(8):
            own = row == line
            loud = gain(own, 1.0, heard, level_weight, lambda x: -np.log1p(x**2))
            for column, size in enumerate(mach):
                moved = gain(own, size, value, weight, lambda x: -x / np.hypot(1, x))
                both = moved + loud if moved > 0 and loud > -1.0 else 0.0
                is_zero[line, place, column] = both == 0.0
                ours = found[line, place, column]
                assert ours == pytest.approx(both, rel=1e-6, abs=1e-9)
    assert is_zero.any()
    assert not is_zero.all()


def test_a_level_over_its_background_is_what_exact_sums_say():
    """Received power is S / r^2 + B; of rows far away there are as many as are used."""
    time = np.arange(0.0, 1500.0)
    distance = np.hypot(120.0, 6.0 * (time - 700.0))
    source, background = np.array([1e14, 1e10]), np.array([1e6, 2e6])
    power = source / distance[:, None] ** 2 + background
    levels = SimpleNamespace(
        time_s=time, level_db=10 * np.log10(power), average_s=1.0, sensor="a",
        centre_hz=np.array([100.0, 200.0]), start_utc_ns=None,
    )  # fmt: skip
    one = radiated._Passage(1, "a", "ok", -1, None, 700.0, 20.0, 120.0, 6.0)
    found = radiated._bands(one, levels, [one], 20.0)
    np.testing.assert_allclose(found.level_db[0], 140.0, atol=0.1)
    np.testing.assert_allclose(found.background_db, 10 * np.log10(background), atol=0.02)
    assert np.isnan(found.level_db[1])  # 10 lg (1e10 / 120^2) is 3 dB below it
    assert found.reasons == ["", radiated.TOO_WEAK]
    # exact sound: five per cent of the range are 0.43 dB
    assert found.std_db[0] == pytest.approx(20 * np.log10(np.exp(0.05)), rel=0.05)
    near = radiated._nearest(time > 100.0, np.abs(time - 700.0), 1.0)
    assert near.sum() == 600
    assert np.abs(time[near] - 700.0).max() == 300.0


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_mean_of_correlated_rows_has_its_deviation(rho):
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((60, 4000))
    for k in range(1, 60):
        rows[k] = rho * rows[k - 1] + np.sqrt(1 - rho**2) * rows[k]
    stated = radiated._std_of_mean(rows)
    # the share is told low by 1 / 60 of (1 + 4 rho) (Kendall 1954), and none is below 0
    true = rows.mean(axis=0).std()
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(true, rel=0.08)


APPROACHES = Approaches(
    measured=np.array([[100.0, 30.0, 5.0, 0.4], [260.0, 45.0, np.nan, 2.0],
                       [310.0, 20.0, 6.0, np.nan]]),
    covariance=np.array([np.diag([4.0, 9.0, 0.2, 0.01]) + 0.02 * (k + 1) for k in range(3)]),
    turn=np.array([1.0, -1.0, 0.0]),
    sensor=np.array([[0.0, 0.0], [800.0, 100.0], [1300.0, -300.0]]),
    position_std_m=np.array([0.0, 30.0, 10.0]),
    height_m=np.array([0.0, 20.0, 60.0]),
    delay=np.array([0.0, 1 / 1500.0, 0.0]),
    velocity_mps=np.array([[0.0, 0.0], [0.5, -0.2], [-0.3, 0.4]]),
)  # fmt: skip
AT_S = 200.0


def seen_by_sensors(state):
    """Closest approaches found by a search in time."""
    rows = []
    for k in range(3):
        own = APPROACHES.velocity_mps[k]

        def away(t, k=k, own=own):
            there = state[:2] + (t - AT_S) * state[2:]
            return there - APPROACHES.sensor[k] - own * (t - APPROACHES.measured[k, 0])

        best = minimize_scalar(lambda t, f=away: f(t) @ f(t), bracket=(0.0, 400.0), tol=1e-12)
        speed = np.hypot(*(state[2:] - own))
        slant = np.hypot(np.hypot(*away(best.x)), APPROACHES.height_m[k])
        bearing = np.arctan2(*away(best.x))
        time = best.x + slant * APPROACHES.delay[k]
        rows.append([time, slant / speed, speed, bearing])
    return np.array(rows)


STATE = np.array([300.0, 160.0, 4.5, -1.5])


def test_closest_approaches_and_their_partials_are_those_of_a_search():
    predicted, slope = predict_approaches(STATE[None], APPROACHES, AT_S)
    off = predicted[0] - seen_by_sensors(STATE)
    off[:, 3] = np.angle(np.exp(1j * off[:, 3]))
    assert np.abs(off).max() < 1e-5
    for k, step in enumerate(np.diag([1e-2, 1e-2, 1e-5, 1e-5])):
        ends = [predict_approaches((STATE + s * step)[None], APPROACHES, AT_S)[0] for s in (1, -1)]
        change = (ends[0] - ends[1])[0] / (2 * step[k])
        np.testing.assert_allclose(slope[0, :, :, k], change, rtol=1e-5, atol=1e-7)


def test_starts_of_a_motion_give_the_approach_that_they_are_made_of():
    found = motion_starts(APPROACHES, AT_S)
    predicted, _ = predict_approaches(found, APPROACHES, AT_S)
    # the second has no speed of its own: the median of those that are known
    measured = APPROACHES.measured.copy()
    measured[1, 2] = 5.5
    counts = [1, 1, 72]
    assert len(found) == sum(counts)
    first = 0
    for row, count in enumerate(counts):
        own = predicted[first : first + count, row]
        known = np.isfinite(measured[row])
        delay = [measured[row, 1] * measured[row, 2] * APPROACHES.delay[row], 0, 0, 0]
        # the speed is over ground, and a moving sensor adds its own
        off = own - measured[row] - delay
        off[:, 3] = np.angle(np.exp(1j * off[:, 3]))
        assert np.abs(off[:, known]).max() < 1e-6
        first += count
    bearing = predicted[2:, 2, 3] % (2 * np.pi)
    assert np.unique(bearing.round(6)).size == 36


def test_clock_errors_are_those_of_unknowns_with_a_prior():
    """Henderson's equations: motion and clocks together, of measurements alone."""
    std = np.array([3.0, 0.0, 5.0])
    with_clocks = APPROACHES.covariance.copy()
    with_clocks[:, 0, 0] += std**2
    approaches = Approaches(
        measured=np.where(np.isfinite(APPROACHES.measured), seen_by_sensors(STATE), np.nan)
        + np.array([[1.5, 2.0, 0.1, 0.02], [-1.0, 1.0, 0.0, -0.03], [4.0, -1.0, 0.2, 0.0]]),
        covariance=with_clocks, turn=APPROACHES.turn, sensor=APPROACHES.sensor,
        position_std_m=APPROACHES.position_std_m, height_m=APPROACHES.height_m,
        delay=APPROACHES.delay,
    )  # fmt: skip
    fit = fit_motion(approaches, STATE[None], AT_S)
    state = fit.state[0]
    predicted, slope = predict_approaches(state[None], approaches, AT_S)
    rows, values = [], []
    for k in range(3):
        known = np.isfinite(approaches.measured[k])
        moved = slope[0, k, :, :2] * approaches.position_std_m[k]
        covariance = (APPROACHES.covariance[k] + moved @ moved.T)[np.ix_(known, known)]
        root = np.linalg.cholesky(np.linalg.inv(covariance)).T
        clock = np.zeros((4, 3))
        clock[0, k] = std[k]  # in its deviations
        design = np.concatenate([slope[0, k], clock], axis=1)[known]
        off = approaches.measured[k] - predicted[0, k]
        off[3] = np.angle(np.exp(1j * off[3]))
        rows.append(root @ design)
        values.append(root @ off[known])
    rows.append(np.eye(7)[4:])
    values.append(np.zeros(3))
    rows, values = np.concatenate(rows), np.concatenate(values)
    best, covariance = (np.linalg.lstsq(rows, values, rcond=None)[0], np.linalg.inv(rows.T @ rows))
    np.testing.assert_allclose(best[:4], 0.0, atol=1e-3)  # it is the fit already
    np.testing.assert_allclose(fit.covariance[0], covariance[:4, :4], rtol=1e-6, atol=1e-6)
    assert fit.chi_square[0] == pytest.approx(((values - rows @ best) ** 2).sum(), rel=1e-4)
    assert fit.degrees_of_freedom == 10 - 4
    offset, spread = clock_errors(approaches, state, AT_S, std)
    np.testing.assert_allclose(offset, std * best[4:], atol=1e-3)
    np.testing.assert_allclose(spread, covariance[4:, 4:] * np.outer(std, std), atol=1e-6)


def block(rng, times):
    value = 0.004 * np.tanh((times - 60.0) / 9.0) + 5e-4 * rng.standard_normal((3, 80))
    value = value + np.array([[0.02], [-0.01], [0.0]])
    weight = rng.uniform(0.5, 1.5, (3, 80)) / 5e-4**2
    weight[1, 10:25] = 0.0
    return SimpleNamespace(value=value[None], weight=weight[None])


@pytest.mark.parametrize("kind", [None, STEP, RAMP])
def test_the_rivals_of_a_passage_are_the_best_drift_and_step_of_least_squares(kind):
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 120.0, 80)
    blocks = SimpleNamespace(shift=block(rng, time), time_s=time)
    known, (heard, width) = np.array([True, True, False]), (55.0, 12.0)
    change = None if kind is None else Change(kind, np.array([66.0]), np.array([-1.0]))
    found = rest_frame._rivals(blocks, known, (heard, width), change)
    near = np.abs(time - heard) < rest_frame.REACH * width
    value = blocks.shift.value[0, :2][:, near].ravel()
    weight = blocks.shift.weight[0, :2][:, near].ravel()
    lines = np.repeat(np.eye(2), near.sum(), axis=0)
    about = np.linspace(-width, width, rest_frame.N_STEPS)

    def best(tried):
        fits = [
            least(np.column_stack([lines, np.tile(shape[near], 2)]), value, weight)
            for _, shape in tried
        ]
        first = int(np.argmin([left for left, _ in fits]))
        return tried[first][0], tried[first][1], fits[first][1][-1]

    steps = [*(heard + about), *([66.0] if kind == STEP else [])]
    at, shape, size = best([(s, (time > s) * 1.0) for s in steps])
    drift, step = found.shifts(time)
    assert found.step_s == pytest.approx(at)
    np.testing.assert_allclose(step, size * shape, atol=1e-12)
    bends = [(heard, time - heard)]
    if kind == RAMP:
        bends += [(66.0 + a, np.where(time < 66.0 + a, time - 66.0 - a, 0.0)) for a in about]
    at, shape, size = best(bends)
    assert found.from_s == pytest.approx(at)
    np.testing.assert_allclose(drift, size * shape, atol=1e-12)


def test_readings_reach_apart_by_half_of_what_their_ends_do():
    apart = 3.0 + 0.7 * np.linspace(-1.0, 1.0, 2001)
    assert rest_frame._reach(apart, np.ones(2001)) == pytest.approx(0.7, rel=2e-3)
    assert rest_frame._reach(apart, (apart > 3.35) * 5.0) == pytest.approx(0.175, rel=0.01)


def test_a_tone_gains_what_its_periodogram_does_over_noise():
    rng = np.random.default_rng(4)
    n, length, inner = 4096, 64, 0.1
    noise = (rng.standard_normal(n) + 1j * rng.standard_normal(n)) / np.sqrt(2)
    tone = 0.6 * np.exp(2j * np.pi * 0.083 * np.arange(n))
    assert rest_frame._gain(0.0 * tone, length, inner) == 0.0
    assert rest_frame._gain(noise, length, inner) < 8.0
    assert rest_frame._gain(noise + tone, length, 0.02) < 8.0  # beside the band
    frames = np.array([
        (noise + tone)[k : k + length] * np.hanning(length)
        for k in range(0, n - length + 1, length // 2)
    ])  # fmt: skip
    cells = np.arange(-length // 2, length // 2)
    wave = np.exp(-2j * np.pi * np.outer(cells, np.arange(length)) / length)
    power = np.abs(frames @ wave.T) ** 2
    floor = np.median(power[:, np.abs(cells) < 0.45 * length], axis=1) / np.log(2)
    usual = (power / floor[:, None])[:, np.abs(cells) <= inner * length].mean(axis=0)
    usual = np.maximum(usual, 1.0)
    each = len(frames) / 1.056 * (usual - 1 - np.log(usual)) - np.log(usual.size) - 2.0
    three = np.maximum(np.sort(each)[-3:], 0.0).sum()
    assert rest_frame._gain(noise + tone, length, inner) == pytest.approx(three)
    assert three > 100.0


def test_squares_about_the_middle_stop_at_three_deviations():
    value = np.array([[1.0, 2.0, 4.0, 90.0, 3.0], [5.0] * 5])
    weight = np.array([[1.0, 4.0, 1.0, 1.0, 0.0], [0.0] * 5])
    # the middle of 1, 2, 4, 90 is 3
    np.testing.assert_allclose(fit_checks._square(value, weight), [4 + 4 + 1 + 9, 0])


@pytest.mark.parametrize("kind", [STEP, RAMP])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_partials_beside_a_change_agree_with_central_differences(kind, sign):
    time, medium = np.linspace(0.0, 100.0, 40), Medium(1500.0, 15.0, height_std_m=2.0)
    change = Change(kind, np.array([60.3]), np.array([sign]))
    theta = np.array([[50.0, np.log(12.0), 7.0, -5.0, 15.0, 0.02]])
    if kind == RAMP:
        theta = np.append(theta, [[0.4]], axis=1) * [1, 1, 1, 1, 1, 0.01, 1]
    law = law_of(theta, time, medium, change)
    plain = law_of(theta[:, :5], time, medium)
    at = 60.3 + (0.4 if kind == RAMP else 0.0)
    lag = np.where(sign * (time - at) > 0, time - at if kind == RAMP else 1.0, 0.0)
    factor = 1 + theta[0, 5] * lag
    np.testing.assert_allclose(1 + law.shift[0], (1 + plain.shift[0]) * factor)
    for name in ("angle", "spread"):
        np.testing.assert_allclose(getattr(law, name), getattr(plain, name))
    places = [0, 1, 2, 4, *range(5, theta.shape[1])]
    for row, place in enumerate(places, 1):
        step = 1e-6 * np.eye(theta.shape[1])[place]
        ends = [law_of(theta + s * step, time, medium, change).shift[0] for s in (1, -1)]
        slope = (ends[0] - ends[1]) / 2e-6
        np.testing.assert_allclose(law.rows[0, 0, row], slope, atol=1e-6)


@pytest.mark.parametrize("circular", [False, True])
def test_blocks_hold_the_weighted_mean_or_the_median_of_their_rows(circular):
    rng = np.random.default_rng(5)
    data = (3.0 if circular else 100.0) + 0.3 * rng.standard_normal((2, 30))
    if circular:
        data = np.angle(np.exp(1j * data))
    weight = rng.uniform(0.5, 2.0, (2, 30))
    weight[0, 4:9] = 0.0
    weight[1, 10:17] = 0.0
    edges = np.array([0, 10, 17, 30])
    for robust in (False, True):
        mean, strength = starts._gather(data, weight, edges, robust=robust, circular=circular)
        for row in range(2):
            for k in range(3):
                cell = np.arange(edges[k], edges[k + 1])
                cell = cell[weight[row, cell] > 0]
                power = (weight[row, cell] ** 2).sum()
                assert strength[row, k] == pytest.approx(np.sqrt(power))
                if not cell.size:
                    continue
                value = np.mod(data[row, cell], 2 * np.pi) if circular else data[row, cell]
                usual = np.average(value, weights=weight[row, cell] ** 2)
                usual = np.median(value) if robust else usual
                off = mean[row, k] - usual
                off = np.angle(np.exp(1j * off)) if circular else off
                assert off == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("moving", [True, False])
def test_bearings_that_cross_give_the_motion_that_they_were_made_of(moving):
    rng = np.random.default_rng(6)
    time, place = np.sort(rng.uniform(0, 900, 40)), rng.uniform(-2000, 2000, (40, 2))
    truth = np.array([3000.0, 500.0, -3.0, 2.0]) * ([1, 1, 1, 1] if moving else [1, 1, 0, 0])
    way = truth[:2] + time[:, None] * truth[2:] - place
    angle = np.arctan2(*way.T)
    found = starts._crossings(
        rng, (time, place, angle, angle), 50, 6 if moving else 3, moving=moving
    )
    middle = np.median(found, axis=0)
    np.testing.assert_allclose(middle, truth, rtol=1e-3, atol=1e-3)


def test_a_grid_of_starts_covers_range_speed_and_course_evenly():
    limits = SimpleNamespace(
        lower=np.array([np.log(100.0), -9, -12, -12]), upper=np.array([np.log(1e5), 9, 12.0, 12.0])
    )
    problem = SimpleNamespace(bearing_weight=np.zeros((1, 5)), n_rows=5)
    motion = model.to_motion(starts.start_grid(problem, limits))
    step = np.log(1e3) / 10
    edges = np.log(100.0) + step * (np.arange(10) + 0.5)
    np.testing.assert_allclose(np.unique(np.log(motion[:, 0]).round(9)), edges)
    np.testing.assert_allclose(np.unique(motion[:, 2].round(9)), [1.5, 4.5, 7.5, 10.5])
    for column, count in ((1, 8), (3, 16)):
        angle = np.unique(np.degrees(motion[:, column]).round(6) % 360.0)
        np.testing.assert_allclose(angle, 360.0 / count * np.arange(count), atol=1e-5)


@pytest.mark.parametrize("polar", [False, True])
def test_coordinates_go_round_and_their_partials_are_differences(polar):
    q = np.array([[7.0, 1.2, 2.0, -3.0], [8.5, 4.0, -1.0, 0.5]])
    if polar:
        q = model.to_polar(q)
        np.testing.assert_allclose(q[:, 2] * np.sin(q[:, 3]), [2.0, -1.0])
    state = model.to_state(q, polar=polar)
    np.testing.assert_allclose(state[:, 0], np.exp(q[:, 0]) * np.sin(q[:, 1]))
    back = model.from_state(state)
    plain = back if not polar else model.from_motion(np.exp(q[:, 0]), *q[:, 1:].T)
    np.testing.assert_allclose(back, plain, atol=1e-12)
    jacobian = model.state_jacobian(q, polar=polar)
    motion = model.motion_jacobian(back)
    for k, step in enumerate(1e-6 * np.eye(4)):
        ends = [model.to_state(q + s * step, polar=polar) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, k], slope, rtol=1e-6, atol=1e-4)
        ends = [model.to_motion(back + s * step) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / 2e-6
        np.testing.assert_allclose(motion[:, :, k], slope, rtol=1e-6, atol=1e-6)
    # at rest any course will do: north, and the speed grows with the part of north
    still = model.motion_jacobian(np.array([[7.0, 1.2, 0.0, 0.0]]))
    assert still[0, 2, 2:].tolist() == [0.0, 1.0]
    assert np.isfinite(still).all()
    # a negative range is the opposite bearing
    turned = model.from_motion(
        -np.exp(back[:, 0]), back[:, 1] + np.pi, *model.to_motion(back)[:, 2:].T
    )
    np.testing.assert_allclose(turned, back, atol=1e-9)


def test_the_inflation_is_the_windowed_sum_of_correlations():
    """Bartlett's window over an eighth, and m / (m - 4) for the fit of a motion."""
    rng = np.random.default_rng(7)
    z = rng.standard_normal((2, 400))
    for k in range(1, 400):
        z[:, k] = 0.8 * z[:, k - 1] + 0.6 * z[:, k]
    z[0, 7] = 40.0
    heard = np.ones((2, 400))
    heard[1, 50:90] = 0.0
    heard[:, 200:203] = 0.0
    clipped = np.where(heard > 0, np.clip(z, -5, 5), 0.0)
    count = heard.sum(axis=0)
    both = clipped.sum(axis=0) / np.sqrt(np.maximum(count, 1))
    known = count > 0
    total = (both**2).sum() / known.sum()
    for lag in range(1, 50):
        pairs = (known[lag:] & known[:-lag]).sum()
        total += 2 * (1 - lag / 50) * (both[lag:] @ both[:-lag]) / pairs
    m = 1.5 * 400 / 50
    expected = total * m / (m - 4)
    assert expected > 5.0
    assert correlation_inflation(z, heard, 0) == pytest.approx(expected)


@pytest.mark.parametrize("decimals", [0, 1, 3])
def test_the_rounding_of_values_is_told_by_their_decimals(decimals):
    value = np.round(np.random.default_rng(8).uniform(10, 90, 50), decimals)
    value[3] = np.nan
    expected = 10.0**-decimals / np.sqrt(12.0)
    assert rounding_std(value) == pytest.approx(expected)
    assert rounding_std(np.sqrt(np.arange(2.0, 30.0))) == 0.0
    assert rounding_std(np.full(3, np.nan)) == 0.0


@pytest.mark.parametrize(("off", "expected"), [(0.9, False), (1.1, True)])
def test_own_ship_manoeuvres_when_it_leaves_a_straight_and_steady_track(off, expected):
    time = np.linspace(0.0, 600.0, 61)
    bow = off * STRAIGHT_M * 1.5 * (1 - (time / 300.0 - 1) ** 2)  # 1 above its own line
    bow = bow / np.abs(bow - np.polyval(np.polyfit(time, bow, 1), time)).max()
    bow = bow * off * STRAIGHT_M
    for east, north in ((3 * time + bow, -time), (3 * time, bow - time)):
        track = SimpleNamespace(time_s=time, east_m=east, north_m=north)
        assert is_manoeuvring(track) is expected


def test_rows_come_in_stretches_by_the_runs_test():
    """Wald and Wolfowitz (1940): four deviations too few runs, on both sides."""
    n, ones = 120, 40
    zeros = n - ones
    mean = 2 * ones * zeros / n + 1
    spread = np.sqrt(2 * ones * zeros * (2 * ones * zeros - n) / (n**2 * (n - 1)))
    last = int(np.floor(mean - 4 * spread))
    for pairs, expected in (((last - 1) // 2, True), ((last + 1) // 2, False)):
        strange = np.zeros(n, bool)
        firsts = np.linspace(0, n, pairs, endpoint=False).astype(int)
        sizes = np.full(pairs, ones // pairs)
        sizes[: ones - sizes.sum()] += 1
        for first, size in zip(firsts, sizes, strict=True):
            strange[first : first + size] = True
        strange = np.roll(strange, 1)
        assert strange.sum() == ones
        runs = 1 + np.count_nonzero(np.diff(strange.astype(int)))
        assert ((runs - mean) / spread < -4) == expected
        assert association._in_stretches(strange) is expected


def test_rows_are_weighed_by_the_odds_of_the_sources_and_of_chance():
    share, z = np.array([0.5, 0.2]), np.array([[0.3, 2.0, -1.0], [4.0, 0.1, 1.0]])
    weight = np.array([20.0, 30.0, 10.0])
    ours = association._densities(share, z, weight)
    theirs = share[:, None] * norm.pdf(z / weight, scale=1 / weight)
    np.testing.assert_allclose(ours, theirs)
    assert association._share_of_none(share) == pytest.approx(0.3)
