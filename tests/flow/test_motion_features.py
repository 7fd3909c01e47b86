"""Motions on a map: where the target was, its region, and the way it went."""

import json
from dataclasses import replace

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from tests.draws.sensor_tables import buoys
from uwtrack_cli.errors import DataError
from uwtrack_cli.flow.exports.features import geographic_features
from uwtrack_cli.flow.exports.geojson import geojson_text
from uwtrack_cli.flow.exports.kml import kml_text
from uwtrack_cli.motion.tma import estimate_motion

LATITUDE, LONGITUDE = 35.0, 128.5


@pytest.fixture(scope="session")
def motions():
    found = estimate_motion(buoys(3, strange=0.0, std_deg=2.0)[0])
    place = np.full(found.time_s.size, LATITUDE), np.full(found.time_s.size, LONGITUDE)
    return replace(found, latitude=place[0], longitude=place[1])


def way(one, other):
    """Return distance and azimuth between two places, by the geodesic."""
    found = Geodesic.WGS84.Inverse(one[1], one[0], other[1], other[0])
    return found["s12"], found["azi1"] % 360.0


def test_a_motion_has_its_place_its_way_and_its_region(motions):
    features = geographic_features([motions], "p.h5")
    place, track, region = (
        next(one for one in features if one.kind == kind) for kind in ("motion", "track", "ellipse")
    )
    assert place.places == ((LONGITUDE, LATITUDE),)
    far, course = way(*track.places)
    lasted = motions.now_time_s[0] - motions.time_s[0]
    assert far == pytest.approx(motions.speed_mps[0] * lasted, rel=1e-3)
    assert course == pytest.approx(motions.course_deg[0], abs=0.1)
    # how far the region reaches along the bearing is 2.45 deviations of the range
    spread = [way((LONGITUDE, LATITUDE), corner) for corner in region.places]
    bearing = motions.bearing_deg[0]
    along = [d * np.cos(np.radians(azimuth - bearing)) for d, azimuth in spread]
    across = [d * np.sin(np.radians(azimuth - bearing)) for d, azimuth in spread]
    two = np.sqrt(5.991)
    std = np.sqrt(motions.covariance[0].diagonal())
    assert max(along) == pytest.approx(two * std[0], rel=0.01)
    turn_m = np.radians(std[1]) * motions.range_m[0]
    assert max(across) == pytest.approx(two * turn_m, rel=0.01)


def test_geojson_and_kml_have_the_state_with_its_deviations(motions):
    features = geographic_features([motions], "p.h5")
    known = json.loads(geojson_text(features))["features"][0]["properties"]
    assert known["kind"] == "motion"
    assert known["now_range_m"] == pytest.approx(motions.now_range_m[0])
    assert known["motion_model"] == "straight"
    text = kml_text(features, "p")
    assert "<name>Motions</name>" in text
    assert f"speed_std_mps: {motions.speed_std_mps[0]}" in text


def test_motions_on_a_local_grid_have_no_place_on_the_map(motions):
    nowhere = np.full(motions.time_s.size, np.nan)
    local = replace(motions, latitude=nowhere, longitude=nowhere)
    with pytest.raises(DataError, match="nothing with latitude and longitude"):
        geographic_features([local], "p.h5")
