"""Sums that the search, the parts and the readings are made of, against least squares."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from tests.draws.measured_passages import CLOSEST_S, bent
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.estimation.row_offsets import Design, mean_of_rows
from uwtrack_cli.motion.passage.broadband_sum import (
    BroadbandSeries,
    KnownSources,
    SourceFit,
    alone,
    sum_residuals,
)
from uwtrack_cli.motion.passage.checks import sub_bands
from uwtrack_cli.motion.passage.checks.sub_bands import RIVALS, Rise, _Parts
from uwtrack_cli.motion.passage.fit import initial_estimates as search
from uwtrack_cli.motion.passage.model.direction_bearings import _Heard
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks
from uwtrack_cli.motion.passage.model.unknowns import RAMP, STEP, TURN, Change
from uwtrack_cli.motion.passage.readings import still_readings as still
from uwtrack_cli.motion.passage.readings.change_priors import speed_prior
from uwtrack_cli.motion.passage.readings.competing_readings import _cost, _exchanged, _mirrored

SOUND_MPS = 1500.0


def least(columns, value, weight):
    """Return half the weighted sum of squares that columns leave, and their factors."""
    root = np.sqrt(weight)
    found = np.linalg.lstsq(columns * root[:, None], value * root, rcond=None)[0]
    return 0.5 * (weight * (value - columns @ found) ** 2).sum(), found


def coarse(rng):
    """Measurements of a passage beside a step, two lines, some of it not heard."""
    time = np.cumsum(rng.uniform(2.0, 6.0, 26))
    x = (time - 50.0) / 14.0
    shift = -6.0 / SOUND_MPS * x / np.hypot(1, x) + 2e-3 * (time > 75.0)
    shift = shift + np.array([[1e-3], [-2e-3]]) + 2e-4 * rng.standard_normal((2, 26))
    weight = rng.uniform(0.5, 2.0, (2, 26)) / 2e-4**2
    weight[1, ::4] = 0.0
    bearing = 0.4 + np.arctan(x) + 0.1 * rng.standard_normal(26)
    level = -np.log1p(x**2) + 0.2 * rng.standard_normal(26)
    return search._Coarse(
        time, shift, weight, rng.uniform(20, 90, 26) * np.exp(1j * bearing),
        level, rng.uniform(10, 30, 26),
    )  # fmt: skip


@pytest.mark.parametrize("passes", [True, False])
def test_the_gains_of_the_search_are_those_of_least_squares(passes):
    rng = np.random.default_rng(1)
    data = coarse(rng)
    if not passes:
        noise = np.random.default_rng(3).standard_normal(data.shift.shape)
        data = replace(data, shift=1e-3 * noise)
    grid = search._grid(data.time)
    gain, speed = search._doppler_gain(grid, data, SOUND_MPS)
    clockwise, counter = search._bearing_gain(grid, data)
    level, floor = search._level_gain(grid, data)
    lines = np.repeat(np.eye(2), data.time.size, axis=0)
    value, weight = data.shift.ravel(), data.shift_weight.ravel()
    ones = np.ones((data.time.size, 1))
    resting = least(lines, value, weight)[0]
    quiet = least(ones, data.level, data.level_weight)[0]
    assert (gain > 0).any()
    assert passes or (gain == 0).any()
    for k in range(0, grid.time.size, 7):
        x = (data.time - grid.time[k]) / grid.width[k]
        law = np.tile(x / np.hypot(1, x), 2)
        left, found = least(np.column_stack([lines, law]), value, weight)
        own = max(-SOUND_MPS * found[-1], 0.0)
        if own > 0.8 * SOUND_MPS:
            own = 0.0
        assert speed[k] == pytest.approx(own, rel=1e-6, abs=1e-9)
        assert gain[k] == pytest.approx((resting - left) * (own > 0), rel=1e-6)
        for ours, sign in ((clockwise[k], 1.0), (counter[k], -1.0)):
            turned = np.abs((data.vector * np.exp(-1j * sign * np.arctan(x))).sum())
            assert ours == pytest.approx(turned - np.abs(data.vector.sum()), rel=1e-6)
        fits = [
            quiet
            - least(ones, data.level - np.log(1 / (1 + x**2) + np.exp(f)), data.level_weight)[0]
            for f in search.FLOORS
        ]
        assert level[k] == pytest.approx(max(fits), rel=1e-6)
        assert floor[k] == search.FLOORS[int(np.argmax(fits))]


@pytest.mark.parametrize("unit", [1.0, 1e-12])
@pytest.mark.parametrize("kind", [STEP, RAMP])
def test_passages_beside_changes_are_those_of_least_squares_over_all_pairs(kind, unit):
    """A step leaves out the cell in which it lies; weights have any unit."""
    rng = np.random.default_rng(2)
    data, medium = coarse(rng), Medium(SOUND_MPS, 12.0)
    data = replace(data, shift_weight=unit * data.shift_weight)
    grid = search._grid(data.time)
    others = unit * rng.uniform(0.0, 3.0, grid.time.size)
    floor = np.full(grid.time.size, -6.0)
    instants = np.linspace(*data.time[[3, -4]], 9)
    sign = np.where(np.arange(9) % 2, 1.0, -1.0) if kind == RAMP else np.ones(9)
    found = search.find_changed_estimates(
        search.PassageSearch(data, grid, others, floor, SOUND_MPS), medium,
        Change(kind, instants, sign), n_starts=1,
    )  # fmt: skip
    total = data.shift_weight.sum(0)
    value, offsets = mean_of_rows(data.shift, data.shift_weight)
    known = np.diag(offsets.known)[offsets.known > 0]

    def fit(kept, *shapes):
        columns = np.column_stack([offsets.columns, *shapes])[kept]
        own = np.pad(known, ((0, 0), (0, len(shapes))))
        nothing, sure = np.zeros(len(own)), np.ones(len(own))
        return least(
            np.concatenate([columns, own]), np.append(value[kept], nothing),
            np.append(total[kept], sure),
        )  # fmt: skip

    resting = fit(slice(None))[0]
    if kind == STEP:
        cells = np.flatnonzero((data.time >= instants[0]) & (data.time <= instants[-1]))
        instants, sign = data.time[cells], np.ones(cells.size)
    best = (-np.inf,)
    for number, (at, way) in enumerate(zip(instants, sign, strict=True)):
        lag = data.time - at
        shape = np.where(way * lag > 0, lag if kind == RAMP else 1.0, 0.0)
        kept = lag != 0.0 if kind == STEP else np.ones(lag.size, bool)
        for cell in range(grid.time.size):
            x = (data.time - grid.time[cell]) / grid.width[cell]
            left, sizes = fit(kept, shape, x / np.hypot(1, x))
            speed = -SOUND_MPS * sizes[-1]
            if 0.0 < speed < 0.8 * SOUND_MPS:
                gain = resting - left + others[cell]
                if gain > best[0]:
                    best = gain, number, cell, speed, sizes[-2]
    _, number, cell, speed, size = best
    assert found.time_s[0] == instants[number]
    assert found.sign[0] == sign[number]
    assert found.others[0] == others[cell]
    assert found.size[0] == pytest.approx(size, rel=1e-6)
    flat = np.sqrt(max(grid.width[cell] ** 2 - (12.0 / speed) ** 2, (0.1 * grid.width[cell]) ** 2))
    expected = [grid.time[cell], np.log(flat), speed, -6.0]
    np.testing.assert_allclose(found.theta[0], expected, rtol=1e-6)


def parts_of(rng, n=60):
    time = np.arange(n) + 0.5
    law = 1 / (1 + ((time - 30.0) / 6.0) ** 2)
    power = 1 + np.array([[9.0], [4.0], [2.0]]) * law
    power = power * (1 + 0.1 * rng.standard_normal(power.shape))
    other = 1 / (1 + ((time - 75.0) / 20.0) ** 2)
    basis = np.stack([np.ones(n), other])
    edges = np.array([[100.0, 200.0], [200.0, 300.0], [300.0, 400.0]])
    return _Parts(time, power, rng.uniform(50.0, 150.0, power.shape), basis, edges)


def test_the_parts_cost_what_least_squares_leave_of_them():
    rng = np.random.default_rng(3)
    parts = parts_of(rng)
    places, widths = np.array([20.0, 30.0, 41.0]), np.log([3.0, 6.0])
    columns = sub_bands._columns(parts, RIVALS["a squall"], places, widths)
    expected = []
    for place in places:
        for width in np.exp(widths):
            bell = 0.5 ** (((parts.time_s - place) / width) ** 2)
            total = 0.0
            for power, weight in zip(parts.power, parts.weight, strict=True):
                left, found = least(np.column_stack([*parts.basis, bell]), power, weight)
                alone = least(parts.basis.T, power, weight)[0]
                total += left if found[-1] > 0 else alone
            expected.append(total)
    np.testing.assert_allclose(sub_bands._costs(parts, columns), expected, rtol=1e-9)
    best, cost = sub_bands._least(parts, sub_bands._law, (27.0, np.log(8.0)), 8.0)

    def law_cost(by):
        at, log_width = best[0] + np.exp(best[1]) * by[0], best[1] + by[1]
        columns = sub_bands._columns(parts, sub_bands._law, np.array([at]), np.array([log_width]))
        return float(sub_bands._costs(parts, columns)[0])

    assert cost == pytest.approx(law_cost((0.0, 0.0)))
    for step in ((0.03, 0.0), (-0.03, 0.0), (0.0, 0.05), (0.0, -0.05)):
        assert law_cost(step) > cost - 0.02
    h = 0.01
    ends = [[law_cost((h * a, h * b)) for b in (-1, 0, 1)] for a in (-1, 0, 1)]
    second = [ends[2][1] + ends[0][1] - 2 * cost, ends[1][2] + ends[1][0] - 2 * cost]
    mixed = (ends[2][2] - ends[2][0] - ends[0][2] + ends[0][0]) / 4
    curvature = np.array([[second[0], mixed], [mixed, second[1]]]) / h**2
    ours = sub_bands._curvature(parts, best)
    np.testing.assert_allclose(ours, curvature, rtol=0.02, atol=0.02 * curvature.max())


HALVES = {
    "a gust": (-1.0, 1.0), "a door that opens and shuts": (-1.5, 1.5),
    "rain that begins and dies away": (-0.25, 1.0),
    "what swells and stops": (-1.0, 0.25), "a squall": (-1.0, 1.0),
    "a squall that goes slowly": (-0.625, 1.6),
    "a squall that comes slowly": (-1.6, 0.625),
}  # fmt: skip


@pytest.mark.parametrize("name", HALVES)
def test_a_rival_is_half_as_high_where_it_says_and_falls_to_nothing(name):
    shape = RIVALS[name]
    np.testing.assert_allclose(shape(np.array(HALVES[name])), 0.5)
    u = np.linspace(-8.0, 8.0, 1601)
    value = shape(u)
    top = int(np.argmax(value))
    assert value[top] == pytest.approx(1.0)
    assert abs(u[top]) <= 1.0
    assert np.all(np.diff(value[: top + 1]) >= 0)
    assert np.all(np.diff(value[np.flatnonzero(value > 1 - 1e-12)[-1] :]) <= 0)
    assert max(value[0], value[-1]) < 1e-6


def test_parts_disagree_by_the_chi_square_of_their_common_value():
    rng = np.random.default_rng(4)
    told = 0.3 * rng.standard_normal((5, 2))
    root = rng.standard_normal((5, 2, 2))
    information = 20.0 * root @ np.swapaxes(root, 1, 2) + 5.0 * np.eye(2)
    rows, values = [], []
    for one, matrix in zip(told, information, strict=True):
        variance = np.linalg.inv(matrix) + sub_bands.LAW_SHARE**2 * np.eye(2)
        factor = np.linalg.cholesky(np.linalg.inv(variance)).T
        rows.append(factor)
        values.append(factor @ one)
    cost = least(np.concatenate(rows), np.concatenate(values), np.ones(10))[0]
    assert sub_bands._disagreement(told, information) == pytest.approx(2 * cost)


@pytest.mark.parametrize("rho", [0.0, 0.3])
def test_means_of_bins_scatter_by_what_their_weights_say(rho):
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((4, 3000))
    for k in range(1, 3000):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    time = 0.5 * np.arange(3000)
    power = np.array([[2.0], [5.0], [9.0], [1.0]]) * (1 + 0.2 * noise)
    basis = np.stack([np.ones(3000), time])
    parts = _Parts(time, power, np.ones_like(power), basis, np.zeros((4, 2)))
    kept = np.ones(3000, bool)
    kept[100:109] = False  # of the bin of ten, one frame is left
    less = parts._replace(
        time_s=time[kept], power=power[:, kept], weight=parts.weight[:, kept], basis=basis[:, kept]
    )
    binned = sub_bands._binned(less, 20.0)
    assert binned.time_s.size == 299
    np.testing.assert_allclose(np.delete(binned.time_s, slice(9, 12))[:3], [2.25, 7.25, 12.25])
    np.testing.assert_allclose(binned.basis[1], binned.time_s)
    z = (binned.power - [[2.0], [5.0], [9.0], [1.0]]) * np.sqrt(binned.weight)
    # 1196 means, 4 % of a variance; neighbours count once, their own neighbours do not
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.1 if rho == 0.0 else 0.3)
    few = sub_bands._binned(
        parts._replace(time_s=time[:50], power=power[:, :50], basis=basis[:, :50]), 20.0
    )
    assert few is None


def test_a_gain_for_all_is_what_two_ways_of_least_squares_leave():
    parts = parts_of(np.random.default_rng(6), 120)
    rise = Rise(30.0, 12.0)
    binned = sub_bands._binned(parts, rise.width_s)
    n_parts, n_bins = binned.power.shape
    weight = (binned.weight * binned.power**2).ravel()
    columns = np.column_stack(
        [np.repeat(np.eye(n_parts), n_bins, axis=0), np.tile(np.eye(n_bins), (n_parts, 1))]
    )
    cost = least(columns, np.log(binned.power).ravel(), weight)[0]
    law = sub_bands._least(binned, sub_bands._law, (30.0, np.log(rise.width_s)), rise.width_s)[1]
    # the law has place, width, and a height and a basis of two in each part; its
    # heights and the parts' own levels are as many
    more = n_bins - 1 - 2 * n_parts - 2
    assert more > 0
    expected = cost - law + 0.5 * more
    assert sub_bands._gain_over_law(parts, rise) == pytest.approx(expected, rel=1e-6)


def test_partials_of_a_sum_of_sources_agree_with_central_differences():
    """A source whose motion is known within its deviations, two free ones, and what is
    always there, from one side more than from others."""
    time = np.linspace(0.0, 100.0, 21)
    rng = np.random.default_rng(7)
    ones = np.ones(21)
    x = (time - 60.0) / 30.0
    by_spread, by_bearing = 0.1 * rng.standard_normal((2, 1, 21, 3))
    known = KnownSources(-np.log1p(x**2)[None], (0.5 - np.arctan(x))[None], by_spread, by_bearing)
    theta = np.array([[0.3, 1.2, 0.2, -0.1, 1.1, 0.4, -0.3, 0.2,
                       40.0, 2.5, 1.7, -0.8, 75.0, 2.0, 1.0, 2.2]])  # fmt: skip
    turn = np.array([[1.0, -1.0]])
    sound = BroadbandSeries(time, rng.normal(2, 1, 21), ones, rng.normal(0, 1, 21), ones)
    residual, slope = sum_residuals(theta, turn, sound, known)
    whole, intensity = np.exp(0.3), np.exp(0.3) * (0.2 - 0.1j)
    for row, way in ((theta[0, 8:12], 1.0), (theta[0, 12:], -1.0)):
        u = (time - row[0]) / np.exp(row[1])
        own = np.exp(row[2]) / (1 + u**2) ** 1.2
        whole = whole + own
        intensity = intensity + own * np.exp(1j * (row[3] + way * np.arctan(u)))
    off = theta[0, 5:8]
    steady = np.exp(1.1 + 1.2 * (by_spread[0] @ off)) / (1 + x**2) ** 1.2
    ahead = known.bearing[0] + by_bearing[0] @ off
    intensity = intensity + steady * np.exp(1j * ahead)
    np.testing.assert_allclose(residual[0, :21], sound.power - np.log(whole + steady), atol=1e-12)
    turned = np.angle(np.exp(1j * (sound.bearing - np.angle(intensity))))
    np.testing.assert_allclose(residual[0, 21:], turned, atol=1e-12)
    for k, step in enumerate(1e-5 * np.eye(16)):
        ends = [sum_residuals(theta + s * step, turn, sound, known)[0] for s in (1, -1)]
        change = np.angle(np.exp(1j * (ends[0] - ends[1])))[0] / 2e-5
        np.testing.assert_allclose(slope[0, :, k], change, atol=1e-6)
    # what a source alone would have given follows the measurement by its deviations
    fit = SourceFit(theta[0], turn[0], 0.0, 1)
    for row in range(3):
        middle = alone(fit, row, sound, known)
        louder = alone(
            fit, row, BroadbandSeries(time, sound.power + 0.1, ones, sound.bearing, ones), known
        )
        np.testing.assert_allclose((louder.power - middle.power) / 0.1, middle.power_std)
        model = np.angle(intensity)
        ends = [
            alone(fit, row, BroadbandSeries(time, sound.power, ones, model + s, ones), known)
            for s in (1e-3, 0.0)
        ]
        moved = np.angle(np.exp(1j * (ends[0].bearing - ends[1].bearing))) / 1e-3
        np.testing.assert_allclose(moved, ends[0].bearing_std, rtol=1e-6)


def lines_of_a_step(rng, lines=3, n=40):
    value = np.where(np.arange(n) >= 22, 1.5, 0.0) + rng.standard_normal((lines, n))
    value += np.array([[3.0], [-1.0], [0.5]])[:lines]
    precision = rng.uniform(0.5, 2.0, (lines, n))
    precision[1, 5:9] = 0.0
    value[0, 30:] += 2.0
    return value, precision


@pytest.mark.parametrize("reach", [None, still.CONTRAST])
def test_steps_gain_what_least_squares_say_by_all_and_by_what_is_near(reach):
    value, precision = lines_of_a_step(np.random.default_rng(8))
    steps = still._Steps(value, precision)
    late, gain = steps.shared()[0 if reach is None else 1]
    expected = []
    for place in steps.places:
        near = np.abs(np.arange(40) - place + 0.5) < (reach or 99)
        lines = np.repeat(np.eye(3), near.sum(), axis=0)
        step = np.tile((np.arange(40) >= place)[near], 3).astype(float)
        y, w = value[:, near].ravel(), precision[:, near].ravel()
        expected.append(least(lines, y, w)[0] - least(np.column_stack([lines, step]), y, w)[0])
    np.testing.assert_allclose(gain, expected, rtol=1e-8)
    assert np.flatnonzero(late)[0] == steps.places[int(np.argmax(expected))]
    # of one line: the likeliest of all, taken out by its size
    changed, gains, its_row = steps.of_one()[0]
    tried = {}
    for row in range(3):
        for place in steps.places:
            step = (np.arange(40) >= place).astype(float)
            both = np.column_stack([np.ones(40), step])
            y, w = value[row], precision[row]
            left, found = least(both, y, w)
            tried[row, place] = least(both[:, :1], y, w)[0] - left, found[1]
    row, place = max(tried, key=lambda key: tried[key][0])
    assert its_row == row
    np.testing.assert_allclose(gains, [tried[row, p][0] for p in steps.places])
    away = np.zeros((3, 40))
    away[row, place:] = tried[row, place][1]
    np.testing.assert_allclose(value - changed, away, atol=1e-9)


def test_ramps_gain_what_least_squares_say():
    rng = np.random.default_rng(9)
    time = np.cumsum(rng.uniform(0.5, 1.5, 50))
    value = 0.4 * np.maximum(time - 30.0, 0.0) + rng.standard_normal(50)
    weight = rng.uniform(0.5, 2.0, 50)
    share = rng.uniform(0.0, 1.0, 50)
    constants = np.column_stack([share, 1 - share])
    shape, gain = still._ramp(value, Design.free(constants), weight, time)
    resting = least(constants, value, weight)[0]
    ends = np.quantile(time, [still.EDGE, 1 - still.EDGE])
    shapes = [
        np.maximum(sign * (time - at), 0.0)
        for sign in (1.0, -1.0) for at in np.linspace(*ends, still.N_RAMPS)
    ]  # fmt: skip
    gains = [resting - least(np.column_stack([constants, s]), value, weight)[0] for s in shapes]
    np.testing.assert_allclose(gain, gains, rtol=1e-7)
    best = shapes[int(np.argmax(gains))]
    np.testing.assert_allclose(shape, best / np.ptp(time))
    size = least(np.column_stack([constants, shape]), value, weight)[1][-1]
    assert still._size(value, Design.free(constants), weight, shape) == pytest.approx(size)


def test_a_motion_costs_its_prior_over_its_posterior():
    """Laplace's method; the prior of the speed is integrated."""

    def density(speed):
        fit = SimpleNamespace(theta=np.array([[0.0, 0.0, speed]]), change=None)
        return np.exp(speed_prior(fit))

    mass = quad(density, 0.0, 60.0)[0] + quad(density, 60.0, np.inf, limit=200)[0]
    assert np.log(mass) == pytest.approx(still.SPEED_MASS, abs=2e-3)
    time = np.arange(0.0, 300.0, 2.0)
    weight = np.ones((1, 1, time.size))
    weight[..., :5] = 0.0
    used = time[5:]
    own = np.diag([4.0, 25.0, 0.5]) + 0.3
    fit = SimpleNamespace(range_over_speed_s=np.array([40.0]), covariance=np.pad(own, (0, 1))[None])
    blocks = SimpleNamespace(
        weight=weight, time_s=time, shift=SimpleNamespace(is_empty=False),
        bearing=SimpleNamespace(is_empty=True),
    )  # fmt: skip
    span, decades = used[-1] - used[0], np.log((used[-1] - used[0]) / 2.0)
    for count in (3, 2):
        for sided in (False, True):
            blocks.shift.is_empty, blocks.bearing.is_empty = count == 2, not sided
            scale = np.array([1.0, 40.0, 1.0])[:count]
            posterior = own[:count, :count] / np.outer(scale, scale)
            prior = np.array([span**2 / 12, decades**2 / 12, 100.0])[:count]
            both = np.linalg.inv(np.linalg.inv(posterior) + np.diag(1 / prior))
            volume = 0.5 * np.log(np.linalg.det(2 * np.pi * both))
            expected = np.log(span * decades) + still.SPEED_MASS - volume
            expected += np.log(2.0) * sided
            assert still.cost_of_motion(fit, blocks) == pytest.approx(expected)


def legs(theta, time_s, change_s, sign):
    """Place along the course at closest approach and away from the sensor, m."""
    start = np.stack([theta[2] * (time_s - theta[0]), 0 * time_s])
    start[1] += theta[2] * np.exp(theta[1])
    is_other = sign * (time_s - change_s) > 0
    return start + theta[5:, None] * np.where(is_other, time_s - change_s, 0.0)


def test_a_manoeuvre_told_from_its_other_leg_or_mirrored_has_the_same_ranges():
    time_s = np.linspace(0.0, 600.0, 61)
    theta = np.array([[280.0, np.log(40.0), 5.0, -6.0, 10.0, 1.2, -2.5],
                      [310.0, np.log(60.0), 4.0, -6.0, 10.0, -1.5, 3.0]])  # fmt: skip
    change_s, sign = np.array([330.0, 250.0]), np.array([1.0, -1.0])
    other, is_same = _exchanged(theta, change_s)
    mirrored = _mirrored(theta, change_s)
    for row in range(2):
        place = legs(theta[row], time_s, change_s[row], sign[row])
        seen = legs(other[row], time_s, change_s[row], -sign[row])
        np.testing.assert_allclose(np.hypot(*seen), np.hypot(*place), rtol=1e-9)
        # on the same side a turn of the whole way, on the other one its mirror
        cross = [p[0, 0] * p[1, 30] - p[1, 0] * p[0, 30] for p in (place, seen)]
        assert (np.sign(cross[0]) == np.sign(cross[1])) == is_same[row]
        seen = legs(mirrored[row], time_s, change_s[row], sign[row])
        np.testing.assert_allclose(np.hypot(*seen), np.hypot(*place), rtol=1e-9)
        assert np.abs(seen - place).max() > 10.0


@pytest.mark.parametrize(
    ("angle", "duration", "middle"),
    [
        (1.2, 60.0, 300.0),
        (-0.5, 60.0, 300.0),
        (-1.2, 30.0, 300.0),
        (-1.2, 30.0, 310.0),
        (-1.2, 30.0, 330.0),
    ],
)
def test_a_turn_that_makes_the_closest_approach_the_farthest_place_is_none(angle, duration, middle):
    theta = np.array([[CLOSEST_S, np.log(30.0), 6.0, -6.0, 0.0, angle, duration, 0.0]])
    time_s = CLOSEST_S + np.array([-4.0, 0.0, 4.0])
    x, y, _ = bent(time_s, 180.0, 0.0, 1e12, 6.0, (middle, duration, angle))
    distance = np.hypot(x, y)
    fit = SimpleNamespace(
        theta=theta, cost=np.zeros(1), full_covariance=np.ones((1, 8, 8)),
        change=Change(TURN, np.array([middle]), np.ones(1)),
    )  # fmt: skip
    assert np.isfinite(_cost(fit))[0] == (distance[1] < distance[[0, 2]].min())


def test_a_foreseen_bearing_is_that_of_a_steady_walk_and_bayes():
    """Five frames at once or two and three; a bearing adds its information."""
    spread = np.array([[9.0, 1.0], [1.0, 4.0]])
    heard = _Heard(350.0, 3.0, spread, 7.0)
    far, stepwise = heard.at(5.0), heard.at(2.0).at(3.0)
    assert far.bearing_deg == stepwise.bearing_deg == 365.0
    np.testing.assert_allclose(far.spread, stepwise.spread)
    noise = far.spread - [[1.0, 5.0], [0.0, 1.0]] @ spread @ [[1.0, 0.0], [5.0, 1.0]]
    assert noise[1, 1] > 0
    bayes = np.linalg.inv(np.linalg.inv(far.spread) + np.diag([1 / 2.5, 0.0]))
    with_one = far.with_bearing(12.0, 2.5, 12.0)
    np.testing.assert_allclose(with_one.spread, bayes)
    mean = bayes @ (np.linalg.solve(far.spread, [365.0, 3.0]) + np.array([372.0 / 2.5, 0.0]))
    np.testing.assert_allclose([with_one.bearing_deg, with_one.rate_deg], mean)
    assert with_one.time_s == 12.0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_starts_by_frequencies_or_levels_turn_as_the_bearings_there_do(way):
    rng = np.random.default_rng(10)
    time = np.arange(0.0, 120.0, 2.0)
    x = (time - 55.0) / 12.0
    data = PassageData(
        time,
        100.0 * (1 - 5.0 / SOUND_MPS * (x / np.hypot(1, x))[None])
        + 0.01 * rng.standard_normal((1, time.size)),
        0.01 + 0.0 * time[None],
        (40.0 + way * np.degrees(np.arctan(x)))[None] % 360.0,
        2.0 + 0.0 * time[None],
        60.0 - 10 * np.log10(1 + x**2)[None],
        1.0 + 0.0 * time[None],
    )
    blocks = make_blocks(data)
    found = search.find_initial_estimates(blocks, Medium(SOUND_MPS), n_starts=2)
    grid = search._grid(blocks.time_s)
    coarse_data = search._condense(blocks)
    doppler, _ = search._doppler_gain(grid, coarse_data, SOUND_MPS)
    level, _ = search._level_gain(grid, coarse_data)
    turned = search._bearing_gain(grid, coarse_data)
    against = turned[1 if way > 0 else 0]
    opposite = {*search._best(grid, doppler + level + against, 2), *search._best(grid, against, 2)}
    starts = {
        (time_s, round(log_width, 9), turn)
        for (time_s, log_width), turn in zip(found.theta[:, :2].tolist(), found.turn, strict=True)
    }
    count = 0
    for cell in {*search._best(grid, doppler, 2), *search._best(grid, level, 2)}:
        own = float(grid.time[cell]), round(float(np.log(grid.width[cell])), 9)
        assert (turned[0][cell] > turned[1][cell]) == (way > 0)
        assert (*own, way) in starts
        if cell not in opposite:
            assert (*own, -way) not in starts
            count += 1
    assert count > 0


def test_the_best_cells_are_apart_by_a_width_in_time_or_by_its_double():
    grid = search._grid(np.arange(0.0, 200.0, 4.0))
    width = np.unique(grid.width)[5]

    def hill(time_s, scale, height):
        away = (grid.time - time_s) / grid.width, np.log(grid.width / width / scale)
        return height * np.exp(-2.0 * away[0] ** 2 - 2.0 * away[1] ** 2)

    for other, scale in ((60.0 + 3.0 * width, 1.0), (60.0, 1.5**4)):
        gain = hill(60.0, 1.0, 10.0) + hill(other, scale, 6.0)
        first, second = search._best(grid, gain, 2)
        assert abs(grid.time[first] - 60.0) < 0.5 * width
        assert abs(np.log(grid.width[first] / width)) < 0.3
        assert abs(grid.time[second] - other) < 0.6 * grid.width[second]
        assert abs(np.log(grid.width[second] / width / scale)) < 0.5
    assert search._best(grid, 0.0 * gain, 2) == []
