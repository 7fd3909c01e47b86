"""Ambient noise, hum and clicks against scipy's Welch and against statistics."""

import numpy as np
import pytest

from tests.simulate.scenes import DIFAR, OMNI, listen, scene, vessel

AMBIENT = {"density_db": 70.0, "reference_hz": 100.0, "slope_db_per_decade": -17.0}


def density_db(pressure, rate=1000.0, size=1000):
    from scipy.signal import welch

    hertz, density = welch(pressure, rate, nperseg=size, detrend=False, axis=0)
    return hertz, 10.0 * np.log10(density)


def test_ambient_density_agrees_with_welch_in_every_third_of_an_octave():
    heard = listen(scene(noise=AMBIENT, duration_s=600.0))[:, 0]
    hertz, level = density_db(heard)
    for centre in 1000.0 * 2.0 ** (np.arange(-15, -3) / 3.0):
        band = (hertz > centre / 2 ** (1 / 6)) & (hertz < centre * 2 ** (1 / 6))
        expected = 70.0 - 17.0 * np.log10(np.maximum(hertz[band], 20.0) / 100.0)
        assert np.mean(level[band] - expected) == pytest.approx(0.0, abs=0.12)


def test_white_noise_has_its_density_up_to_the_edges():
    heard = listen(scene(noise={"density_db": 60.0}, duration_s=600.0))[:, 0]
    hertz, level = density_db(heard)
    inside = level[(hertz > 2) & (hertz < 498)]
    assert inside.mean() == pytest.approx(60.0, abs=0.03)
    assert abs(inside - 60.0).max() < 1.2


def test_dipoles_hear_a_third_of_isotropic_noise_and_are_independent():
    heard = listen(scene(noise=AMBIENT, sensor=[DIFAR], duration_s=600.0))
    covariance = np.cov(heard.T)
    ratio = np.diag(covariance)[1:] / covariance[0, 0]
    np.testing.assert_allclose(ratio, 1.0 / 3.0, rtol=0.03)
    correlation = covariance / np.sqrt(np.outer(*[np.diag(covariance)] * 2))
    assert abs(correlation[np.triu_indices(3, 1)]).max() < 0.02


def test_noise_is_gaussian_without_a_seam_between_tiles():
    from scipy.stats import kurtosis

    from uwtrack_cli.simulate.noise import TILE

    heard = listen(scene(noise=AMBIENT, duration_s=40 * TILE / 1000.0))[:, 0]
    assert abs(kurtosis(heard)) < 0.05
    steps = np.diff(heard)
    seams = steps[TILE - 1 :: TILE]
    assert seams.size == 39
    assert seams.std() == pytest.approx(steps.std(), rel=0.35)


def test_ratios_at_closest_approach_are_those_stated():
    line = {"frequency_hz": 200.0, "cn0_db_hz": 40.0}
    hiss = {"band_hz": [250.0, 450.0], "snr_db": 6.0, "slope_db_per_decade": -20.0}
    way = {"time_s": 300.0, "slant_range_m": 400.0, "speed_mps": 0.05}
    way |= {"course_deg": 10.0, "side": "port"}
    source = vessel(closest_approach=way, line=[line], broadband=hiss)
    quiet = listen(scene(noise=AMBIENT, duration_s=600.0))[:, 0]
    heard = listen(scene(noise=AMBIENT, vessel=[source], duration_s=600.0))[:, 0]
    hertz, level = density_db(heard - quiet)
    power = 10.0 ** (level / 10.0)
    near = abs(hertz - 200.0) <= 3.0
    ambient = 10.0 ** ((70.0 - 17.0 * np.log10(2.0)) / 10.0)
    ratio = 10.0 * np.log10(power[near].sum() / ambient)
    assert ratio == pytest.approx(40.0, abs=0.05)
    band = (hertz >= 250.0) & (hertz <= 450.0)
    noise = 10.0 ** ((70.0 - 17.0 * np.log10(hertz[band] / 100.0)) / 10.0)
    snr = 10.0 * np.log10(power[band].sum() / noise.sum())
    assert snr == pytest.approx(6.0, abs=0.1)


def test_hum_has_its_levels_at_the_harmonics_of_the_mains():
    hum = {"mains_hz": 60.0, "levels_db": [120.0, 110.0, 115.0]}
    heard = listen(scene(noise={"density_db": 0.0, "hum": hum}))[:, 0]
    hertz, level = density_db(heard)
    for harmonic, stated in ((60, 120.0), (120, 110.0), (180, 115.0)):
        near = abs(hertz - harmonic) <= 3.0
        power = 10.0 * np.log10(np.sum(10.0 ** (level[near] / 10.0)))
        assert power == pytest.approx(stated, abs=0.01)


def test_clicks_come_at_their_rate_with_their_peak():
    clicks = {"rate_per_min": 6.0, "peak_db": 140.0}
    table = {"density_db": 0.0, "clicks": clicks}
    heard = listen(scene(noise=table, duration_s=6000.0, sensor=[DIFAR]))
    # a burst is 256 samples long; two within two lengths count as one
    loud = abs(heard[:, 0]) > 1e3
    starts = np.flatnonzero(np.diff(loud.astype(int)) > 0)
    bursts = 1 + np.count_nonzero(np.diff(starts) > 256)
    expected = 600 * np.exp(-0.1 * 0.512)
    assert bursts == pytest.approx(expected, abs=4 * np.sqrt(600))
    assert 20.0 * np.log10(abs(heard[:, 0]).max()) == pytest.approx(140.0, abs=6.0)


def test_frequency_jitter_has_its_deviation_and_correlation_time():
    from uwtrack_cli.simulate.frequency_jitter import draw_jitter

    paths = [draw_jitter((1, n), 1e-3, 20.0, 0.0, 400.0).deviation for n in range(400)]
    table = np.array(paths)
    assert table.std() == pytest.approx(1e-3, rel=0.03)
    lag = round(20.0 * 16 / 20.0)
    product = (table[:, :-lag] * table[:, lag:]).mean()
    assert product / table.var() == pytest.approx(np.exp(-1.0), abs=0.04)


def test_frequency_jitter_shifts_all_lines_of_a_vessel_by_one_fraction():
    still = {"east_m": 250.0, "course_deg": 0.0, "speed_mps": 0.0}
    lines = [
        {"frequency_hz": f, "source_level_db": level}
        for f, level in ((100.0, 170.0), (300.0, 150.0))
    ]
    jitter = {"fraction": 1e-3, "correlation_s": 20.0}
    source = vessel(closest_approach=None, track=still, line=lines, frequency_jitter=jitter)
    heard = listen(scene(vessel=[source], duration_s=120.0))[:, 0]
    time_s = np.arange(heard.size) / 1000.0
    fractions = []
    for near in (100.0, 300.0):
        beat = heard * np.exp(-2j * np.pi * near * time_s)
        phase = np.unwrap(np.angle(beat.reshape(-1, 500).mean(axis=1)))
        fractions.append(np.diff(phase) / (2 * np.pi * 0.5 * near))
    np.testing.assert_allclose(*fractions, atol=1e-4)  # the other line leaks in
    assert 2e-4 < np.std(fractions[0]) < 2e-3


def test_another_seed_gives_other_noise_and_the_same_seed_the_same():
    one, same = (listen(scene(noise=AMBIENT)) for _ in range(2))
    other = listen(scene(noise=AMBIENT, seed=8))
    assert np.array_equal(one, same)
    assert abs(np.corrcoef(one[:, 0], other[:, 0])[0, 1]) < 0.05


def test_sensors_of_one_scenario_hear_independent_noise():
    pair = scene(noise=AMBIENT, sensor=[OMNI, OMNI | {"id": "h2"}])
    one, other = listen(pair, 0)[:, 0], listen(pair, 1)[:, 0]
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.05
