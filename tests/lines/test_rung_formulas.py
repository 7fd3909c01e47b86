"""What rungs, measured paths and lasting families are made of, against plain counts."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import expon

from uwtrack_cli.lines import multi_resolution
from uwtrack_cli.lines.contacts import ContactSamples
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import Comb
from uwtrack_cli.lines.families.lasting_families import FamilyRegister
from uwtrack_cli.lines.paths.path_ends import MeasuredPaths
from uwtrack_cli.lines.paths.path_tracer import PathTracer
from uwtrack_cli.lines.paths.trace_window import Measured, WindowData, measure, smooth_window
from uwtrack_cli.lines.rungs.best_basis import RungLines, _covering, _evidence, beside
from uwtrack_cli.lines.rungs.rung_links import _steps_told, joined_jumps
from uwtrack_cli.lines.rungs.same_line import SAME_LINE, line_evidence
from uwtrack_cli.lines.stitching import NO_ENDS, PieceEnds
from uwtrack_cli.lines.tracker_options import Gates
from uwtrack_cli.lines.tracking.tracker import LastLook


def rung_of(window_s, lines, ratio=4.0):
    """Lines of one rung: (times, frequencies) each."""
    row = np.concatenate([np.full(t.size, k) for k, (t, _) in enumerate(lines)])
    time_s = np.concatenate([t for t, _ in lines])
    return RungLines(
        window_s, 0.5 * window_s, np.arange(1, len(lines) + 1),
        np.full(len(lines), -1), np.searchsorted(row, np.arange(len(lines) + 1)),
        row, time_s, np.concatenate([f for _, f in lines]),
        np.full(time_s.size, ratio), np.argsort(time_s, kind="stable"),
    )  # fmt: skip


@pytest.mark.parametrize(("n", "ratio"), [(3.0, 2.0), (10.0, 0.5), (5.0, 0.01)])
def test_the_evidence_of_a_line_is_that_of_its_mean_power(n, ratio):
    """Of n exponential powers whose mean is known and one, less what was chosen."""
    power = np.array([1.0 + ratio])
    gain = expon.logpdf(power, scale=1.0 + ratio) - expon.logpdf(power)
    assert line_evidence(n, ratio, 0.05) == pytest.approx(n * max(gain[0] - 0.05, 0.0))


def test_finer_points_beside_a_line_are_within_its_resolution_and_time():
    rng = np.random.default_rng(1)
    fine = rung_of(0.5, [
        (0.25 * np.arange(200), 100.0 + rng.normal(0.0, 0.4, 200)),
        (0.25 * np.arange(40, 90), 101.0 + rng.normal(0.0, 0.4, 50)),
    ])  # fmt: skip
    middle = rung_of(1.0, [(0.5 * np.arange(100), 100.2 + 0.01 * np.arange(100))])
    time_s = np.arange(10.0, 31.0, 1.0)
    coarse = rung_of(2.0, [(time_s, 90.0 + 0.0 * time_s), (time_s, 99.5 + 0.05 * time_s)])
    found = beside([fine, middle, coarse], 2, 1)
    for number, rung in ((0, fine), (1, middle)):
        half_s = 0.5 * rung.hop_s
        wanted = [
            k for k in range(rung.time_s.size)
            if 10.0 - half_s <= rung.time_s[k] <= 30.0 + half_s
            and abs(rung.frequency_hz[k] - 99.5 - 0.05 * np.clip(rung.time_s[k], 10, 30))
            < SAME_LINE / 2.0
        ]  # fmt: skip
        own = found.point[found.rung == number]
        assert sorted(own.tolist()) == wanted
        assert wanted
    assert beside([fine], 0, 0).point.size == 0


def test_a_time_is_told_by_a_finer_point_within_half_a_hop():
    rng = np.random.default_rng(2)
    for _ in range(30):
        finer_s, hop_s = rng.uniform(0, 60, 8), rng.choice([0.5, 4.0, 20.0], 8)
        time_s = np.sort(rng.uniform(0, 60, 40))
        found = _covering(time_s, finer_s, hop_s)
        inside = np.abs(time_s[:, None] - finer_s) <= 0.5 * hop_s
        assert np.array_equal(found >= 0, inside.any(axis=1))
        told = found >= 0
        assert inside[told, found[told]].all()


def test_evidence_in_a_cell_is_that_of_its_independent_frames():
    rung = rung_of(2.0, [(1.0 * np.arange(9), np.full(9, 50.0))])
    rung.ratio[:] = np.arange(9.0)
    found = _evidence(rung, np.arange(1, 6), np.array([3, 3, 4, 4, 4]), np.array([3, 4, 7]))
    wanted = [
        float(line_evidence(count * 0.5, mean, 0.2))
        for count, mean in ((2, 1.5), (3, 4.0), (0, 0.0))
    ]
    assert found == pytest.approx(wanted)


@pytest.mark.parametrize("hop_s", [0.5, 1.0, 2.0])
def test_a_line_is_told_half_a_hop_about_its_points_that_stand_and_do_not_coast(hop_s):
    """As counted on a grid much finer than the steps."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        time_s = hop_s * (0.5 + np.sort(rng.choice(60, 30, replace=False)))
        rung = rung_of(2.0 * hop_s, [(time_s, np.full(30, 50.0))])
        assert rung.hop_s == hop_s
        rung.ratio[rng.random(30) < 0.2] = 0.0
        stands = rng.random(30) < 0.8
        grid = np.arange(0.0, 130.0, 0.01) + 0.005
        own = time_s[stands & (rung.ratio > 0.0)]
        inside = (np.abs(grid[:, None] - own) < 0.5 * hop_s).any(axis=1)
        found = _steps_told(rung, stands, 0, 0.5)
        assert 0.5 * found.size == pytest.approx(0.01 * np.count_nonzero(inside))
        assert np.array_equal(found, np.unique(np.floor(grid[inside] / 0.5)))
    assert _steps_told(rung, np.zeros(30, bool), 0, 0.5).size == 0


@pytest.mark.parametrize(
    ("late_s", "off", "is_one"),
    [(8.0, 0.0, True), (8.1, 0.0, False), (0.0, 0.0149, True), (0.0, -0.0151, False)],
)
def test_jumps_of_two_rungs_are_one_by_time_and_ratio(late_s, off, is_one):
    def told(count, time_s, ratio, std):
        return SimpleNamespace(
            line_id=np.array([3, 5]), line_contact=np.array([1, 2]),
            jump_line_count=np.array([count]), jump_time_s=np.array([time_s]),
            jump_ratio=np.array([ratio]), jump_ratio_std=np.array([std]),
            jump_contact=np.array([1]),
        )  # fmt: skip

    rungs = [SimpleNamespace(window_s=w, names=np.array([3, 5])) for w in (8.0, 2.0)]
    lines = [told(3, 100.0 + late_s, 1.05 + off, 0.004), told(4, 100.0, 1.05, 0.003)]
    found = joined_jumps(lines, rungs, [np.array([2, 1])] * 2, np.array([7, 8]))
    assert found["jump_time_s"].tolist() == [100.0] + [100.0 + late_s] * (not is_one)
    assert found["jump_line_count"].tolist() == [4] + [3] * (not is_one)
    assert set(found["jump_contact"].tolist()) == {8}  # that of line 3, which is number 2


def test_joined_points_have_the_nearest_frame_of_the_shortest():
    frames = SimpleNamespace(n_frames=5, time_s=np.array([1.0, 2.0, 4.0, 7.0, 8.0]), first_frame=10)
    at_s = np.array([-3.0, 1.4, 1.6, 2.9, 3.1, 5.4, 5.6, 7.6, 99.0])
    away = np.abs(frames.time_s - at_s[:, None])
    found = multi_resolution._nearest_frame(frames, at_s)
    assert found.tolist() == (10 + away.argmin(axis=1)).tolist()
    single = SimpleNamespace(n_frames=1, time_s=np.array([1.0]), first_frame=3)
    assert multi_resolution._nearest_frame(single, at_s).tolist() == [3] * at_s.size


def test_the_usual_length_of_frames_holds_half_of_the_time():
    points = {"window_s": np.repeat([0.5, 2.0, 8.0], [30, 10, 5])}  # 15, 20 and 40 s
    assert multi_resolution._usual_window_s(points) == 8.0
    points = {"window_s": np.repeat([0.5, 2.0, 8.0], [60, 20, 5])}  # 30, 40 and 40 s
    assert multi_resolution._usual_window_s(points) == 2.0
    assert multi_resolution._usual_window_s({"window_s": np.zeros(0)}) == 1.0


def test_lines_are_compared_on_a_grid_where_they_have_points_about():
    time_s = np.array([0.9, 1.4, 2.2, 3.0, 9.5, 10.4, 16.0])
    n = time_s.size
    covariance = np.zeros((n, 2, 2))
    covariance[:, 0, 0] = np.arange(n)
    points = {
        "time_s": time_s, "frequency_hz": 100.0 + time_s, "window_s": np.full(n, 0.5),
        "frequency_covariance": covariance, "bearing_deg": 10.0 * np.arange(n),
        "bearing_covariance": np.where(np.arange(n) == 3, np.nan, 1.0)[:, None, None]
        * np.ones((2, 2)),
    }  # fmt: skip
    found = multi_resolution._on_grid(7, points, slice(0, n), 2.0)
    # grid at 2, 4, 6 ... 16 s; a point within two seconds, the nearest
    assert found.frame.tolist() == [1, 2, 4, 5, 6, 7, 8]
    assert found.time_s.tolist() == [2.0, 4.0, 8.0, 10.0, 12.0, 14.0, 16.0]
    assert found.frequency_hz == pytest.approx(100.0 + found.time_s)
    near = np.abs(time_s - found.time_s[:, None]).argmin(axis=1)
    assert found.state[:, 2, 0].tolist() == near.tolist()
    assert found.state[:, 0, 1].tolist() == (10.0 * near).tolist()
    assert found.state[:, 2, 1].tolist() == np.where(near == 3, np.inf, 1.0).tolist()
    assert set(found.line.tolist()) == {7}


def window_of(power, *, window_s=2.0, per_bin=2, east=None, north=None):
    n_frames, n_cells = power.shape
    return WindowData(
        frame=np.arange(n_frames), time_s=0.5 * window_s * np.arange(n_frames),
        is_valid=np.ones(n_frames, bool),
        frequency_hz=50.0 + np.arange(n_cells) / (per_bin * window_s),
        power=power, floor=np.ones_like(power), east=east, north=north,
        window_s=window_s, cells_per_bin=per_bin,
        exponent=np.zeros(n_frames),
    )  # fmt: skip


@pytest.mark.parametrize("window_s", [0.5, 2.0])
def test_a_strong_lines_frequency_is_hanns_and_its_bearing_that_of_its_vector(window_s):
    """Three lines at their true places between cells, powers by Hann's main lobe."""
    n_cells, per_bin = 60, 2
    place = np.array([20.3, 40.0, 50.6])  # cells; the paths run beside two of them
    bins = (np.arange(n_cells)[None] - place[:, None]) / per_bin
    with np.errstate(divide="ignore", invalid="ignore"):
        lobe = np.sinc(bins) / (1.0 - bins**2)
    lobe[np.abs(np.abs(bins) - 1.0) < 1e-9] = 0.5
    shape = np.where(np.abs(bins) < 2.0, lobe**2, 0.0)
    power = np.tile(1e-3 + 400.0 * shape.sum(axis=0), (6, 1))
    bearing = np.radians([30.0, 200.0, 310.0])
    east, north = (
        np.tile(400.0 * (f(bearing)[:, None] * shape).sum(axis=0), (6, 1)) for f in (np.sin, np.cos)
    )
    data = window_of(power, window_s=window_s, east=east, north=north)
    cells = np.tile([21, 40, 50], (6, 1))
    is_line = np.ones((6, 3), bool)
    is_line[4:, 1] = False
    found = measure(data, cells, is_line)
    bin_hz = 1.0 / window_s
    truth = 50.0 + place * bin_hz / per_bin
    assert np.abs(found.position[0] - truth).max() < 0.03 * bin_hz
    assert np.abs((found.position[1] - np.degrees(bearing) + 180) % 360 - 180).max() < 1.0
    along = np.take_along_axis(power, cells, axis=1)
    level = 10.0 * np.log10(along * 1.5 * bin_hz)
    assert found.raw[4] == pytest.approx(level, abs=0.01)
    assert found.raw[5] == pytest.approx(10.0 * np.log10(along - 1.0), abs=0.01)
    snr = along[0] - 1.0
    assert found.raw[3][0] == pytest.approx(np.degrees(np.sqrt((1.0 + 1.0 / snr) / (6.0 * snr))))
    assert found.variance == pytest.approx(np.where(is_line, found.raw[[1, 3]] ** 2, np.inf))


@pytest.mark.parametrize(("ratio", "strength"), [(2.4, 1.4), (1.3, 0.3), (1.05, 0.1)])
def test_a_weak_lines_frequency_is_that_of_its_cell(ratio, strength):
    """Less than 2 dB over the noise, and taken for a tenth of it at least."""
    power = np.ones((8, 30))
    power[:, 11] = ratio
    power[:, 12] = 9.0
    found = measure(window_of(power), np.full((8, 1), 11), np.ones((8, 1), bool))
    assert found.position[0] == pytest.approx(50.0 + 11 * 0.25)
    step = 0.5
    std = 0.5 * 3.0 * np.hypot(0.29 * step, 0.31 / strength)
    assert found.raw[1] == pytest.approx(std)
    assert np.isnan(found.position[1]).all()
    assert np.isinf(found.variance[1]).all()


def test_a_smoothed_window_is_weighted_least_squares_without_process_noise():
    """A straight course, measured twice as well later; bearings across north."""
    rng = np.random.default_rng(4)
    n, std = 40, np.array([[0.2], [6.0]])
    time_s = 2.0 * np.arange(n)
    truth = np.stack([100.0 + 0.01 * time_s, 355.0 + 0.3 * time_s])
    spread = std * np.where(np.arange(n) < 20, 1.0, 0.5)
    value = truth + spread * rng.normal(size=(2, n))
    spread[:, 5:9] = np.inf
    position = np.stack([value[0], value[1] % 360.0])[..., None]
    measured = Measured(position, (spread**2)[..., None], np.zeros((6, n, 1)))
    states = smooth_window(measured, time_s, np.zeros((2, 1)), np.array([9.0, 90.0]))
    use = np.isfinite(spread[0])
    for k, unit in enumerate((1.0, 1.0)):
        fit, covariance = np.polyfit(
            time_s[use], value[k, use], 1, w=1.0 / spread[k, use], cov="unscaled"
        )
        line = np.polyval(fit, time_s)
        found = states[:, 0, k, 0]
        assert (found - line + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=unit * 1e-2)
        assert states[:, 1, k, 0] == pytest.approx(fit[0], rel=1e-2)
        at_end = np.array([time_s[-1], 1.0])
        assert states[-1, 2, k, 0] == pytest.approx(at_end @ covariance @ at_end, rel=1e-2)
        assert states[-1, 4, k, 0] == pytest.approx(covariance[0, 0], rel=1e-2)


def test_the_end_of_a_path_is_the_straight_course_there():
    n = 60
    data = window_of(np.ones((n, 8)))
    value = 70.0 + 0.02 * data.time_s
    position = np.stack([value, np.full(n, 40.0)])[..., None]
    variance = np.full((2, n, 1), 0.01)
    variance[0, 30] = np.inf
    raw = np.zeros((6, n, 1))
    states = np.zeros((n, 5, 2, 1))
    states[:, 0, 1], states[:, 2, 1] = np.arange(n)[:, None], 7.0
    paths = MeasuredPaths(data, Measured(position, variance, raw), states, np.array([2.0, 3.0]))
    end = paths.piece(3, 0, slice(49, None, -1)).take(0)
    assert (end.line, end.time_s) == (3, data.time_s[49])
    assert end.noise_density.tolist() == [2.0, 3.0]
    assert end.kalman.position == pytest.approx([value[49], 49.0])
    assert end.kalman.rate[0] == pytest.approx(0.02)
    assert paths.piece(3, 0, slice(6, None, -1)).line.size == 0  # too few frames
    use = data.time_s[10:50] - data.time_s[49]  # forty frames, and one is not known
    use = np.delete(use, 20)
    use = np.append(data.time_s[9] - data.time_s[49], use)
    _, covariance = np.polyfit(use, value[:40], 1, w=np.full(40, 10.0), cov="unscaled")
    assert end.kalman.variance == pytest.approx([covariance[1, 1], 7.0], rel=1e-4)
    assert end.kalman.covariance[0] == pytest.approx(covariance[0, 1], rel=1e-4)
    assert end.kalman.rate_variance[0] == pytest.approx(covariance[0, 0], rel=1e-4)
    points = paths.points(3, 0, slice(28, 33))
    assert points.frame.tolist() == list(range(28, 33))
    assert np.unique(points.association[[0, 1, 3, 4]]).size == 1
    assert points.association[2] != points.association[0]


def test_lines_that_may_be_heard_again_are_remembered_for_two_minutes():
    def end_of(line, at_s):
        n = len(line)
        return PieceEnds(np.array(line), np.array(at_s), np.zeros((n, 5, 2)), np.zeros((n, 2)))

    tracer = SimpleNamespace(ended=end_of([1, 2, 3], [79.9, 80.1, 190.0]), silence_s=120.0)
    assert Gates().silence_s == 120.0
    fresh = [SimpleNamespace(end=NO_ENDS), SimpleNamespace(end=end_of([4], [199.0]))]
    PathTracer._remember(tracer, fresh, SimpleNamespace(time_s=np.array([200.0])))
    assert tracer.ended.line.tolist() == [2, 3, 4]


@pytest.mark.parametrize(("stride", "wanted"), [(1, 8.0), (4, 2.0), (20, 1.0)])
def test_errors_are_correlated_over_so_many_samples_of_the_grid(stride, wanted):
    samples = ContactSamples(stride).samples(np.zeros(0, np.int64), 8.0)
    assert samples.correlation_samples == wanted


def comb(members, spacing_hz, chance=-9.0):
    return Comb(np.array(members), np.arange(len(members)), spacing_hz, chance)


def test_families_of_many_looks_are_one_by_lines_and_spacing():
    register = FamilyRegister()
    lines = np.arange(1, 11)
    frequency = 50.0 + 10.0 * np.arange(10)

    def look(*combs, shift=0.0):
        register.note(7, list(combs), lines, frequency + shift, 0.05)

    look(comb([0, 1, 2, 3], 10.0, -3.0))
    look(comb([1, 2, 3, 4], 10.0, -6.0), shift=0.5)
    look(comb([1, 2, 3], 10.0, -2.0))
    assert len(register.families) == 1
    look(Comb(np.array([0, 2, 4]), np.arange(3), 20.0, -1.0))  # every second tooth
    assert len(register.families) == 1
    frequency = np.where(np.arange(10) >= 5, 55.5 + 7.3 * np.arange(10), frequency)
    look(comb([5, 6, 7, 8], 7.3, -1.6))
    assert len(register.families) == 2
    families, family = register.lasting(lines, 0.1)
    # of five looks, a chance of one in ten in all: -1.6 is not enough, -6 is
    assert families.family.tolist() == [1]
    assert families.log10_chance == pytest.approx([-6.0 + np.log10(5.0)])
    assert families.spacing_hz == pytest.approx([10.0])
    assert families.frame.tolist() == [7]
    assert family.tolist() == [1, 1, 1, 1, 1, -1, -1, -1, -1, -1]
    assert families.n_members.tolist() == [5]
    register.rename(5, 77)
    _, family = register.lasting(np.array([5, 77]), 0.1)
    assert family.tolist() == [-1, 1]
    _, family = register.lasting(lines, 0.5)
    assert family[5:].tolist() == [2, 2, 2, 2, -1]


def test_families_are_sought_again_when_something_has_changed(monkeypatch):
    looks = []
    monkeypatch.setattr(
        "uwtrack_cli.lines.tracking.tracker.find_combs",
        lambda *told: looks.append(told) or ([], np.zeros(3)),
    )
    look = LastLook()
    lines, hz, unknown = np.arange(3), 100.0 * np.arange(1.0, 4.0), np.full(3, np.nan)

    def n_new(lines=lines, hz=hz, bearing=unknown, sigma_hz=0.1):
        before = len(looks)
        look.find_combs(lines, hz, bearing, CombRule((2, 60), 9, sigma_hz, 9, 900), 0.1)
        return len(looks) - before

    assert n_new() == 1
    assert n_new() == 0
    assert n_new(sigma_hz=0.1049) == 0
    assert n_new(sigma_hz=0.0951) == 0
    assert n_new(sigma_hz=0.1051) == 1
    assert n_new() == 0
    assert n_new(lines=lines + 1) == 1
    assert n_new() == 1
    assert n_new(bearing=np.array([1.0, np.nan, np.nan])) == 1
    from uwtrack_cli.lines.tracking.tracker import MOVED

    assert n_new(hz=hz + 0.99 * MOVED * 0.1) == 0
    assert n_new(hz=hz - [0.0, 1.01 * MOVED * 0.1, 0.0]) == 1
