"""Nothing on a map runs around the world because it crosses the antimeridian."""

import json

import numpy as np
import pytest
from geojson_pydantic import FeatureCollection
from hypothesis import given
from hypothesis import strategies as st

from uwtrack_cli.flow.exports.features import Feature
from uwtrack_cli.flow.exports.geojson import cut_at_antimeridian, geojson_text


def ring_around(longitude, radius_deg, turn=1.0):
    angle = turn * np.linspace(0.0, 2.0 * np.pi, 33)
    x = longitude + radius_deg * np.cos(angle)
    wrapped = (x + 180.0) % 360.0 - 180.0
    ring = [(float(a), float(b)) for a, b in zip(wrapped, 20 + np.sin(angle), strict=True)]
    return [*ring[:-1], ring[0]]


def area(ring):
    x, y = np.array(ring).T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


@given(st.floats(-180.0, 180.0), st.sampled_from([1.0, -1.0]))
def test_the_parts_of_a_ring_are_rings_of_the_same_area_and_sense(longitude, turn):
    parts = cut_at_antimeridian(ring_around(longitude, 0.5, turn))
    whole = area([(x + 1.0, y) for x, y in ring_around(0.0, 0.5, turn)])
    assert len(parts) <= 2
    for part in parts:
        assert part[0] == part[-1]
        assert all(-180.0 <= x <= 180.0 for x, _ in part)
        assert np.ptp([x for x, _ in part]) <= 1.0 + 1e-9
        assert area(part) * whole > -1e-12
    assert sum(map(area, parts)) == pytest.approx(whole, abs=1e-9)


def test_a_track_and_an_ellipse_become_two_parts_each():
    track = [(-179.9, 5.0), (179.9, 5.2)]
    features = [
        Feature("track", "LineString", "t", track, {}),
        Feature("ellipse", "Polygon", "e", ring_around(179.9, 0.5), {}),
    ]
    text = geojson_text(features)
    assert FeatureCollection.model_validate_json(text).length == 2
    found = [feature["geometry"] for feature in json.loads(text)["features"]]
    assert [g["type"] for g in found] == ["MultiLineString", "MultiPolygon"]
    first, second = found[0]["coordinates"]
    assert {round(first[-1][0]), round(second[0][0])} == {-180, 180} or {
        round(first[0][0]), round(second[-1][0])
    } == {-180, 180}  # fmt: skip
    for (ring,) in found[1]["coordinates"]:
        assert ring[0] == ring[-1]
