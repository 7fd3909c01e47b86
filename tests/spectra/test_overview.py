"""The overview: nothing strong is lost, and blocks have no influence."""

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.spectra import Overview, Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.spectra.overview import pool_overview
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 1000.0


def spectrogram(seconds, seed=1):
    samples = white_noise(int(RATE_HZ * seconds), seed)
    return Spectrogram.join(list(compute_spectrogram(recording_of(samples, RATE_HZ), window_s=0.5)))


@pytest.mark.parametrize("max_pixels", [16, 50, 1024])
def test_a_pixel_is_the_strongest_cell_that_it_covers(max_pixels):
    whole = spectrogram(60.0)
    picture = Overview.join(list(pool_overview(iter([whole]), max_pixels=max_pixels)))
    n_rows, n_columns = picture.shade.shape
    assert n_rows <= max_pixels
    assert n_columns <= max_pixels
    group = -(-whole.frames.n_frames // n_rows)
    group = 1 << (group - 1).bit_length()
    wide = -(-whole.frequency_hz.size // max_pixels)
    strongest = [
        10 * np.log10(
            whole.power_density[r * group : (r + 1) * group, c * wide : (c + 1) * wide].max()
        )
        for r in range(n_rows)
        for c in range(n_columns)
    ]  # fmt: skip
    step = (picture.ceiling_db - picture.floor_db) / 255.0
    shown = picture.floor_db + picture.shade.ravel() * step
    expected = np.maximum(strongest, picture.floor_db)
    np.testing.assert_allclose(shown, expected, atol=0.51 * step)


def test_a_spectrogram_without_frames_is_an_empty_picture():
    nothing = spectrogram(2.0).take("frame", slice(0, 0))
    picture = Overview.join(list(pool_overview(iter([nothing]))))
    assert picture.shade.shape[0] == 0


@pytest.mark.parametrize("n_frames", [1, 7, 64])
def test_blocks_change_no_bit(n_frames):
    whole = spectrogram(100.0)
    n = whole.frames.n_frames
    cut = [whole.take("frame", slice(k, k + n_frames)) for k in range(0, n, n_frames)]
    first = Overview.join(list(pool_overview(iter(cut), max_pixels=32)))
    assert first.equals(Overview.join(list(pool_overview(iter([whole]), max_pixels=32))))


def test_too_many_pixels_are_refused():
    with pytest.raises(OptionError, match="at least 16, at most 4096"):
        list(pool_overview(iter([spectrogram(5.0)]), max_pixels=5))
