"""Local grids by geodesics."""

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid, to_latitude_longitude


def test_distance_from_the_origin_is_the_published_geodesic():
    """Karney's GeographicLib documentation: Wellington to Salamanca."""
    east, north = to_grid(40.96, -5.50, Origin(-41.32, 174.81))
    assert abs(np.hypot(east, north) - 19959679.267353821) < 1e-4


def test_positions_return_from_the_grid_to_a_tenth_of_a_millimetre():
    origin = Origin(35.0, 128.5)
    east, north = np.array([0.0, 12345.6, -800.0]), np.array([0.0, -500.0, 40000.0])
    latitude, longitude = to_latitude_longitude(east, north, origin)
    back = [to_grid(a, b, origin) for a, b in zip(latitude, longitude, strict=True)]
    np.testing.assert_allclose(back, np.stack([east, north], axis=1), atol=1e-4)
