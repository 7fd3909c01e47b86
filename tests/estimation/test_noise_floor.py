"""The noise floor: unbiased on noise, unmoved by lines, edges and gaps."""

import numpy as np
import pytest

from uwtrack_cli.estimation.noise_floor import independent_cells, noise_floor, threshold_factor


def cells(shape, seed=1):
    return np.random.default_rng(seed).exponential(size=shape).astype(np.float32)


def test_the_floor_of_noise_is_its_mean():
    floor = noise_floor(cells((160, 1000)), np.ones(160))
    assert floor.mean() == pytest.approx(1.0, abs=0.01)


def test_strong_lines_move_the_floor_little():
    power = cells((64, 1000))
    power[:, 100:1000:16] *= 1000.0
    power[:, 101:1000:16] *= 300.0
    floor = noise_floor(power, np.ones(64))
    assert 10 * np.log10(floor[:, 150:].mean()) == pytest.approx(0.0, abs=0.5)


def test_a_loud_frame_has_its_own_floor():
    power = cells((32, 2000))
    power[5] *= 100.0
    floor = noise_floor(power, np.ones(32))
    assert floor[5].mean() == pytest.approx(100.0, rel=0.1)
    assert floor[6].mean() == pytest.approx(1.0, rel=0.1)


def test_in_swell_the_floor_is_that_of_every_frame():
    frame = np.arange(640)
    gain = 10 ** (0.6 * np.sin(2 * np.pi * frame / 18.0))  # +-6 dB
    power = cells((640, 1000)) * gain[:, None].astype(np.float32)
    floor = noise_floor(power, np.ones(640))
    # pooled before the gains are taken out, it is 2.2 dB too low
    off_db = 10 * np.log10(floor.mean(axis=1) / gain)
    assert off_db.mean() == pytest.approx(0.0, abs=0.05)
    rate = (power > threshold_factor(1e-3, 1e3) * floor).mean()
    assert rate <= 1.2e-3


def test_gusts_at_low_frequencies_pass_as_seldom_as_steady_noise():
    rng = np.random.default_rng(5)
    gust_db = np.zeros(1600)
    for k in range(1, gust_db.size):
        gust_db[k] = 0.85 * gust_db[k - 1] + np.sqrt(1 - 0.85**2) * rng.normal(0, 10)
    power = cells((1600, 1000))
    power[:, :192] *= 10 ** (gust_db[:, None].astype(np.float32) / 10)
    factor = threshold_factor(1e-4, 1e3)
    high = power > factor * noise_floor(power, np.ones(1600))
    # one gain for all frequencies lets 40 times as many pass below the corner
    assert high[:, :192].mean() <= 4e-4
    assert high.mean() <= 1.5e-4


@pytest.mark.parametrize("edge", [402, 404, 408, 412, 414])
@pytest.mark.parametrize("is_rise", [False, True], ids=["fall", "rise"])
def test_beside_an_edge_the_floor_is_that_of_its_side(edge, is_rise):
    # wherever the edge lies within the tile from 400 to 416
    power = cells((320, 800))
    power[:, :edge] *= 1e-3 if is_rise else 1.0
    power[:, edge:] *= 1.0 if is_rise else 1e-3
    floor = noise_floor(power, np.ones(320))
    loud = slice(edge, edge + 16) if is_rise else slice(edge - 16, edge)
    quiet = slice(edge - 19, edge - 3) if is_rise else slice(edge + 3, edge + 19)
    # of a tile that is three quarters loud the median is 4 dB low, and a tracker finds
    # lines in what passes
    assert 10 * np.log10(floor[:, loud]).min(axis=1).mean() > -1.0
    assert (10 * np.log10(floor[:, loud]) < -2.0).mean() < 0.01
    assert (10 * np.log10(floor[:, quiet]) > -28.0).mean() < 0.01


def test_frames_of_a_gap_neither_have_a_floor_nor_lower_it():
    power, valid_fraction = cells((32, 500)), np.ones(32)
    power[4:12], valid_fraction[4:12] = 0.0, 0.0
    floor = noise_floor(power, valid_fraction)
    assert np.isnan(floor[4:12]).all()
    assert np.nanmean(floor) == pytest.approx(1.0, abs=0.03)


def test_a_gain_scales_the_floor_and_nothing_else():
    power = cells((16, 300))
    np.testing.assert_allclose(
        noise_floor(power * 8.0, np.ones(16)), 8.0 * noise_floor(power, np.ones(16)), rtol=1e-6
    )


def test_the_threshold_over_a_known_floor_is_that_of_exponential_noise():
    assert threshold_factor(1e-4, 1e7) == pytest.approx(-np.log(1e-4), rel=1e-3)


@pytest.mark.parametrize("probability", [0.5, 1e-3, 1e-9])
@pytest.mark.parametrize("n", [7, 301, 100_001])
def test_the_threshold_solves_the_product_of_rohling(probability, n):
    excess = np.longdouble(threshold_factor(probability, float(n))) / np.log(2.0)
    others = np.arange(n, (n - 1) // 2, -1, dtype=np.longdouble)
    rate = np.log1p(-excess / (others + excess)).sum()
    assert float(rate / np.log(probability) - 1.0) == pytest.approx(0.0, abs=1e-13)


@pytest.mark.parametrize("probability", [1e-1, 1e-2, 1e-3])
def test_the_threshold_over_a_median_of_few_cells_keeps_the_rate(probability):
    rng = np.random.default_rng(2)
    n = 41
    median = np.median(rng.exponential(size=(150_000, n)), axis=1)
    factor = threshold_factor(probability, float(n))
    rate = np.exp(-factor * median / np.log(2.0)).mean()
    assert rate == pytest.approx(probability, rel=0.05)


def test_overlap_and_padding_leave_fewer_independent_cells():
    plain = independent_cells(16, 1000, zero_padding=1, hop_windows=1.0)
    padded = independent_cells(16, 2000, zero_padding=2, hop_windows=1.0)
    overlapped = independent_cells(16, 1000, zero_padding=1, hop_windows=0.25)
    assert padded == pytest.approx(plain, rel=0.4)
    assert overlapped < plain


@pytest.mark.parametrize("step_db", [10.0, 20.0, 40.0])
@pytest.mark.parametrize("edge", [480, 488, 495])
def test_beside_a_sharp_edge_noise_passes_as_often_as_elsewhere(step_db: float, edge: int) -> None:
    rng = np.random.default_rng(9)
    level = np.where(np.arange(960) < edge, 1.0, 10.0 ** (-step_db / 10.0))
    passed = []
    for shape in (level, level[::-1]):
        power = (shape * rng.exponential(1.0, (640, 960))).astype(np.float32)
        factor = threshold_factor(1e-2, 100.0)
        passed.append(power > factor * noise_floor(power, np.ones(640)))
    high = passed[0] | passed[1][:, ::-1]
    # 24 bins on the loud side, two of margin left out on the quiet one
    for side in (slice(edge - 24, edge), slice(edge + 4, edge + 28)):
        rate = 0.5 * high[:, side].mean()
        assert 0.004 <= rate <= 0.016


def test_a_weak_line_just_beyond_an_edge_stands_out() -> None:
    rng = np.random.default_rng(10)
    level = np.where(np.arange(960) < 488, 100.0, 1.0)
    level[495] += 10.0
    power = (level * rng.exponential(1.0, (640, 960))).astype(np.float32)
    floor = noise_floor(power, np.ones(640))
    assert 0.7 < np.median(floor[:, 495]) < 1.4


@pytest.mark.parametrize(("height_db", "width"), [(15.0, 30.0), (-20.0, 40.0)])
def test_on_steep_ground_the_floor_is_no_staircase(height_db, width):
    """A bump and a notch rise by up to 5 dB in 16 bins, and have no edge."""
    shape_db = height_db * np.exp(-0.5 * ((np.arange(640) - 325.0) / width) ** 2)
    shape = 10.0 ** (shape_db / 10.0)
    power = (cells((960, 640)) * shape).astype(np.float32)
    off_db = 10.0 * np.log10(noise_floor(power, np.ones(960)).mean(axis=0) / shape)
    steep = np.abs(np.gradient(shape_db)) > 0.15
    # stairs were 2.7 dB off, and noise on them passed several times as often
    assert np.abs(off_db[steep]).max() < 0.9
    high = power > threshold_factor(1e-3, 1e3) * noise_floor(power, np.ones(960))
    assert high[:, steep].mean() < 1.6e-3


@pytest.mark.parametrize(("order", "corner"), [(3, 0.45), (4, 0.4), (6, 0.35), (6, 0.47)])
def test_on_the_slope_of_a_recorder_noise_passes_about_as_seldom(order, corner):
    """A digital Butterworth filter falls without end below half the sample rate."""
    turn = np.arange(1000) / 2000.0 * np.pi
    law = 1.0 / (1.0 + (np.tan(turn) / np.tan(corner * np.pi)) ** (2 * order))
    # single precision rounds in the deepest part
    power = cells((640, 1000), 7) * law.astype(np.float32) + np.float32(1e-13)
    high = power > threshold_factor(1e-4, 1e3) * noise_floor(power, np.ones(640))
    # floors of stairs let up to 50 times as many pass there, and 500 times at the end
    assert high[:, :700].mean() <= 1.5e-4
    assert high[:, 700:900].mean() <= 4e-4
    assert high[:, 900:960].mean() <= 3e-4
    assert high[:, 960:].mean() <= 15e-4


@pytest.mark.parametrize("silent", [4, 9, 12])
def test_frames_of_digital_silence_are_no_part_of_the_floor_beside_them(silent):
    power = cells((16, 1000))
    power[-silent:] = 0.0
    given = np.where(np.arange(16) < 16 - silent, 1.0, 0.0)
    floor = noise_floor(power, np.ones(16))
    assert np.array_equal(floor[:-silent], noise_floor(power, given)[:-silent])
    assert floor[:-silent].mean() == pytest.approx(1.0, abs=0.1)
    assert floor[-silent:].max() < 1e-30


def test_ground_that_falls_into_silence_has_a_floor_without_a_warning():
    power = cells((16, 400)) * np.float32(1e-3)
    power[:, 100:] *= 10.0 ** -np.linspace(0.0, 4.0, 300, dtype=np.float32)
    power[:, 250:] = 0.0
    floor = noise_floor(power, np.ones(16))
    assert np.isfinite(floor).all()
    assert floor[:, :80].mean() == pytest.approx(1e-3, rel=0.2)
