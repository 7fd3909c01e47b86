"""Bearings, levels and frequencies, each by itself."""

import numpy as np
import pytest

from tests.motion.single_fits import fit_bearings, fit_doppler, fit_envelope
from uwtrack_cli.errors import DataError

TIME = np.arange(0.5, 600.0)
ARRIVAL, WIDTH = 280.0, 40.0
X = (TIME - ARRIVAL) / WIDTH


def test_bearings_tell_time_width_and_turn_despite_a_compass_error():
    rng = np.random.default_rng(1)
    std = 3 * np.sqrt(1 + X**2)
    noise = std * rng.normal(size=TIME.size)
    bearing = 350.0 - np.rad2deg(np.arctan(X)) + noise
    plain = fit_bearings(TIME, bearing % 360, std)
    turned = fit_bearings(TIME, (bearing + 17.0) % 360, std)
    assert plain.turn == -1
    assert abs(plain.arrival_time_s - ARRIVAL) < 4 * plain.arrival_time_std_s
    assert abs(plain.range_over_speed_s - WIDTH) < 4 * plain.range_over_speed_std_s
    assert turned.range_over_speed_s == pytest.approx(plain.range_over_speed_s, rel=1e-5)
    assert (turned.bearing_deg - plain.bearing_deg) % 360 == pytest.approx(17, abs=1e-3)


def test_the_envelope_is_as_good_as_its_bound():
    """Closed form of section 3 with level, time and width free, no floor."""
    reach = 300.0 / WIDTH
    i1 = np.arctan(reach) + reach / (1 + reach**2)
    bound = 0.115 / np.sqrt(WIDTH) / np.sqrt(i1 - (2 * np.arctan(reach)) ** 2 / 2 / reach)
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        level = -10 * np.log10(1 + ((TIME - 300) / WIDTH) ** 2)
        fit = fit_envelope(TIME, level + rng.normal(size=TIME.size), np.ones(TIME.size))
        errors.append(fit.range_over_speed_s / WIDTH - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 1.45 * bound


def test_fringes_show_as_misfit_of_the_envelope():
    rng = np.random.default_rng(2)
    level = -10 * np.log10(1 + X**2) + rng.normal(size=TIME.size)
    fringes = 5 * np.cos(12 / np.sqrt(1 + X**2))
    plain = fit_envelope(TIME, level, np.ones(TIME.size))
    image = fit_envelope(TIME, level + fringes, np.ones(TIME.size))
    assert plain.misfit < 2
    assert image.misfit > 4


def test_several_lines_share_one_motion():
    rng = np.random.default_rng(3)
    rest = np.array([60.0, 133.0, 287.0])[:, None]
    clean = rest * (1 - 6 / 1500 * X / np.sqrt(1 + X**2))
    noisy = clean + 0.01 * rng.normal(size=clean.shape)
    fit = fit_doppler(TIME, noisy, np.full(clean.shape, 0.01), 1500.0)
    assert abs(fit.speed_mps - 6.0) < 4 * fit.speed_std_mps
    assert abs(fit.range_over_speed_s - WIDTH) < 4 * fit.range_over_speed_std_s


def test_the_errors_of_a_wrong_side_and_wild_values_do_no_harm():
    rng = np.random.default_rng(4)
    std = np.full(TIME.size, 2.0)
    bearing = 90.0 + np.rad2deg(np.arctan(X)) + 2 * rng.normal(size=TIME.size)
    wild = rng.random(TIME.size) < 0.15
    bearing = np.where(wild, 360 * rng.random(TIME.size), bearing)
    fit = fit_bearings(TIME, bearing % 360, std)
    assert fit.turn == 1
    assert abs(fit.range_over_speed_s - WIDTH) < 4 * fit.range_over_speed_std_s


def test_nothing_measured_is_refused():
    nothing = np.full(TIME.size, np.nan)
    with pytest.raises(DataError, match="no passage"):
        fit_bearings(TIME, nothing, nothing)
