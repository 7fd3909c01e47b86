"""Line arrays: published windows, closed forms of gain, bounds and grating lobes."""

import warnings

import numpy as np
import pytest
from scipy.signal.windows import chebwin

from uwtrack_cli.arrays.line_array import LineArray, angle_std_deg, chebyshev_window

C = 1500.0


def line(n, spacing_m=1.0):
    return LineArray((np.arange(n) - 0.5 * (n - 1)) * spacing_m, C)


GAINS = {  # N, f: for each shading independent | isotropic at 90, 45 and 0 degrees
    (16, 250.0): [(12.04, 7.41, 7.54, 10.33), (10.54, 5.77, 6.12, 8.78),
                  (11.39, 6.64, 6.81, 9.64)],
    (16, 500.0): [(12.04, 10.33, 10.41, 13.24), (10.54, 8.78, 8.79, 11.79),
                  (11.39, 9.64, 9.64, 12.63)],
    (16, 900.0): [(12.04, 12.80, 10.24, 11.11), (10.54, 11.34, 8.89, 9.57),
                  (11.39, 12.18, 9.64, 10.43)],
    (32, 250.0): [(15.05, 10.36, 10.44, 13.31), (13.42, 8.65, 8.66, 11.66),
                  (14.47, 9.74, 9.74, 12.73)],
    (32, 750.0): [(15.05,) * 4, (13.42,) * 4, (14.47,) * 4],
}  # fmt: skip


@pytest.mark.parametrize(("n", "frequency_hz"), GAINS)
def test_gain_of_steered_weights_is_that_of_the_tables(n, frequency_hz):
    array = line(n)
    apart = np.subtract.outer(array.along_m, array.along_m)
    isotropic = np.sinc(2.0 * frequency_hz * apart / C)
    for shading, wanted in zip(
        ("uniform", "hann", "chebyshev"), GAINS[n, frequency_hz], strict=True
    ):
        weights = array.weights(shading, 30.0)
        cosines = np.cos(np.radians([90.0, 45.0, 0.0]))
        steered = array.steering(np.array([frequency_hz]), cosines, weights)[0]
        steered = steered.astype(np.complex128)
        gains = [1.0 / np.sum(weights**2)]
        gains += [1.0 / (w.conj() @ isotropic @ w).real for w in steered]
        assert 10.0 * np.log10(gains) == pytest.approx(wanted, abs=0.02)


@pytest.mark.parametrize("n", [5, 8, 16, 31])
@pytest.mark.parametrize("sidelobe_db", [25.0, 30.0, 60.0])
def test_chebyshev_weights_are_those_of_scipy(n, sidelobe_db):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of low sidelobes, for spectra
        wanted = chebwin(n, sidelobe_db)
    mine = chebyshev_window(n, sidelobe_db)
    assert mine / mine.max() == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("n", [16, 32])
def test_stated_deviation_is_the_bound_for_equal_weights(n):
    array, frequency_hz, rho = line(n), 700.0, 10.0
    stated = array.cosine_std(
        np.array([n * rho]), np.array([frequency_hz]), array.weights("uniform", 30.0)
    )
    turn = 2.0 * np.pi * frequency_hz / C
    bound = np.sqrt(6.0 / (rho * turn**2 * n * (n**2 - 1)))
    assert stated[0] == pytest.approx(bound, rel=1e-12)
    published_deg = {16: 0.237, 32: 0.084}[n]
    assert np.degrees(stated[0]) == pytest.approx(published_deg, abs=6e-4)


@pytest.mark.parametrize(("shading", "factor"), [("chebyshev", 1.08), ("hann", 1.41)])
def test_shading_widens_the_deviation_as_measured(shading, factor):
    array, frequency_hz = line(16), np.array([700.0])
    rho = np.array([10.0])
    uniform, shaded = (
        array.cosine_std(rho / np.sum(w**2), frequency_hz, w)[0]
        for w in (array.weights("uniform", 30.0), array.weights(shading, 30.0))
    )
    assert shaded / uniform == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize("times_design", [0.7, 1.2, 2.01])
def test_directions_a_lobes_distance_apart_look_alike(times_design):
    array, frequency_hz = line(16), np.array([times_design * 750.0])
    apart = array.lobe_cosine(frequency_hz)[0]
    assert apart == pytest.approx(2.0 / times_design)  # c / (f d)
    weights = array.weights("uniform", 30.0)
    steering = array.steering(
        frequency_hz, np.array([0.2, 0.2 - apart, 0.2 - 0.5 * apart]), weights
    )
    alike = np.abs(steering[0] @ steering[0, 0].conj())
    assert alike[1] == pytest.approx(alike[0])
    assert alike[2] < 1e-6 * alike[0]


def test_sidelobes_are_those_of_the_hydrophones_that_are_used():
    array = line(16)
    # Harris 1978, table 1, and Dolph 1946
    for shading, published_db in (("uniform", 13.2), ("hann", 31.5), ("chebyshev", 30.0)):
        found = array.sidelobe_db(array.weights(shading, 30.0))
        assert found == pytest.approx(published_db, abs=0.1)
    # a hole of one in N of equal weights: sin(N x / 2) / sin(x / 2) less one, over N - 1
    weights = np.where(np.arange(16) == 8, 0.0, 1.0 / 15.0)
    turn = np.linspace(2.0 * np.pi / 16, np.pi, 100_000)
    pattern = np.sin(8 * turn) / np.sin(turn / 2) * np.exp(-7.5j * turn) - np.exp(-8j * turn)
    past = np.abs(pattern) / 15.0
    rising = np.flatnonzero(np.diff(past) > 0.0)[0]
    assert array.sidelobe_db(weights) == pytest.approx(
        -20 * np.log10(past[rising:].max()), abs=0.05
    )
    assert line(2).sidelobe_db(np.array([0.5, 0.5])) == 80.0


def test_an_uneven_line_has_no_lobes_of_full_height():
    even, uneven = (
        LineArray(np.array(places), C) for places in ([0, 1, 2, 4, 5.0], [0, 1, 1.4, 3.7, 4.3])
    )
    assert even.lobe_cosine(np.array([1000.0])) == pytest.approx(1.5)
    assert np.isinf(uneven.lobe_cosine(np.array([1000.0]))).all()


def test_deviation_of_an_angle_stays_finite_at_the_ends():
    std = angle_std_deg(np.array([0.0, 1.0, -1.0, 1.0]), np.array([1e-3] * 3 + [9.0]))
    assert std[0] == pytest.approx(np.degrees(1e-3))
    assert std[1:3] == pytest.approx(np.degrees(np.sqrt(1e-3)))
    assert std[3] == 30.0
