"""Memory of directions by beams over all of the sky."""

import tracemalloc

import numpy as np
import pytest

from tests.arrays.test_spatial_array import SQUARE, C, plane_wave, record_of, sensor_of
from uwtrack_cli.arrays import broadband_directions
from uwtrack_cli.arrays.direction_grid import SpatialArray


@pytest.mark.benchmark
def test_memory_is_that_of_sixteen_frames_of_beams(monkeypatch):
    """A whole block of 32, with floors and pressures of its own, takes more than 4."""
    monkeypatch.setattr(broadband_directions, "DRAWN_FRAMES", (32, 32))
    places = 2.0 * SQUARE
    samples = plane_wave(places, 40.0, 0.0, snr_db=10.0, duration_s=17.0)
    array = SpatialArray(places, C)
    tile_bytes = 4 * 16 * 841 * float(array.beams_needed(np.array(900.0)))
    record_of(samples[:4000], sensor_of(places))  # imports, and directions of noise
    tracemalloc.start()
    record = record_of(samples, sensor_of(places))
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert record.frames.n_frames == 33
    assert tile_bytes > 1.5e7  # large beside all else
    assert peak_bytes < 4.0 * tile_bytes
