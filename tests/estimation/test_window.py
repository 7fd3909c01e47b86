"""The Hann window's closed forms against the transform itself."""

import numpy as np
import pytest

from uwtrack_cli.estimation.window import (
    NOISE_BANDWIDTH_BINS,
    cell_correlation,
    hann,
    peak_offset_bins,
    response,
)


def test_noise_bandwidth_is_one_and_a_half_bins():
    window = hann(4096)
    measured = window.size * np.sum(window**2) / np.sum(window) ** 2
    assert measured == pytest.approx(NOISE_BANDWIDTH_BINS, rel=1e-6)


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5, 1.0, 1.5])
def test_response_is_the_transform_of_the_window(offset):
    window, n = hann(2048), np.arange(2048)
    transform = np.abs(np.sum(window * np.exp(-2j * np.pi * offset * n / 2048)))
    assert response(np.array(offset)) == pytest.approx(transform / window.sum(), abs=1e-5)


@pytest.mark.parametrize("step", [1.0, 0.5])
def test_interpolation_of_a_pure_tone_has_no_bias(step):
    truth = np.linspace(-0.49, 0.49, 99) * step
    three = [response(truth - k * step) ** 2 for k in (-1, 0, 1)]
    np.testing.assert_allclose(peak_offset_bins(*three, step), truth, atol=1e-5)


@pytest.mark.parametrize(("bins", "windows"), [(1.0, 0.0), (0.5, 0.0), (0.0, 0.5)])
def test_correlation_of_cells_is_that_of_simulated_noise(bins, windows):
    rng = np.random.default_rng(1)
    n, trials = 256, 20_000
    shift = round(windows * n)
    noise = rng.standard_normal((trials, n + shift))
    phase = np.exp(-2j * np.pi * np.arange(n) / n * 40.0)
    other = np.exp(-2j * np.pi * np.arange(n) / n * (40.0 + bins))
    a = np.abs(noise[:, :n] @ (hann(n) * phase)) ** 2
    b = np.abs(noise[:, shift:] @ (hann(n) * other)) ** 2
    measured = np.corrcoef(a, b)[0, 1]
    assert measured == pytest.approx(cell_correlation(bins, windows), abs=0.03)
