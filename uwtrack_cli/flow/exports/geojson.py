"""Features as GeoJSON; shapes across the antimeridian are cut there.

**Method.** Longitudes are made continuous, and what lies beyond the antimeridian is
clipped off against it (Sutherland and Hodgman) and put on the other side of the map.
Both parts of a convex ring are rings, both parts of a line are lines.

**References.** RFC 7946 (2016), The GeoJSON Format, section 3.1.9 for the antimeridian;
Sutherland & Hodgman (1974), Reentrant polygon clipping, CACM 17, 32-42.
"""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from uwtrack_cli.files.text_escaping import plain_text
from uwtrack_cli.flow.exports.features import Feature


def geojson_text(features: Sequence[Feature]) -> str:
    """Return features as a GeoJSON feature collection."""
    return collection_text(map(_feature, features))


def collection_text(features: Iterable[dict[str, Any]]) -> str:
    """Return GeoJSON features as the text of a collection."""
    collection = {"type": "FeatureCollection", "features": list(features)}
    return plain_text(json.dumps(collection, ensure_ascii=False, allow_nan=False)) + "\n"


def _feature(feature: Feature) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": _geometry(feature),
        "properties": {"kind": feature.kind, "name": feature.name, **feature.properties},
    }


def _geometry(feature: Feature) -> dict[str, Any]:
    parts: list[Any] = [
        [list(place) for place in part] for part in cut_at_antimeridian(feature.places)
    ]
    if feature.shape == "Point":
        ((place,),) = parts
        return {"type": "Point", "coordinates": place}
    if feature.shape == "Polygon":
        parts = [[ring] for ring in parts]
    if len(parts) == 1:
        return {"type": feature.shape, "coordinates": parts[0]}
    return {"type": f"Multi{feature.shape}", "coordinates": parts}


Place = tuple[float, float]
"""Longitude and latitude in degrees."""


def cut_at_antimeridian(places: Sequence[Place]) -> list[list[Place]]:
    """Return the parts of a line or convex ring, each on its own side of the map.

    ``places``: corners in order; the last one of a ring is its first.

    Examples
    --------
    >>> cut_at_antimeridian([(179.0, 10.0), (-179.0, 12.0)])
    [[(179.0, 10.0), (180.0, 11.0)], [(-180.0, 11.0), (-179.0, 12.0)]]
    >>> cut_at_antimeridian([(5.0, 10.0), (6.0, 12.0)])
    [[(5.0, 10.0), (6.0, 12.0)]]
    """
    longitude = np.unwrap([place[0] for place in places], period=360.0)
    longitude -= 360.0 * np.floor((longitude[0] + 180.0) / 360.0)
    path = [(float(x), place[1]) for x, place in zip(longitude, places, strict=True)]
    is_ring = len(places) > 3 and places[0] == places[-1]
    if is_ring:
        path[-1] = path[0]  # whatever the rounding on the way around
    highest, lowest = max(path)[0], min(path)[0]
    if lowest >= -180.0 and highest <= 180.0:
        return [path]
    edge = 180.0 if highest > 180.0 else -180.0
    parts = []
    for side in (-1.0, 1.0):
        part = list(_clipped(path, edge, side))
        if is_ring and part and part[0] != part[-1]:
            part.append(part[0])
        turn = -2.0 * edge if side == np.sign(edge) else 0.0
        parts.append([(x + turn, y) for x, y in part])
    return [part for part in parts if len(part) > (3 if is_ring else 1)]


def _clipped(path: Sequence[Place], edge: float, side: float) -> Iterator[Place]:
    """Yield the corners on one side of a meridian, and where the path crosses it."""
    if side * (path[0][0] - edge) >= 0.0:
        yield path[0]
    for (x0, y0), (x1, y1) in itertools.pairwise(path):
        if (x0 - edge) * (x1 - edge) < 0.0:
            yield edge, y0 + (y1 - y0) * (edge - x0) / (x1 - x0)
        if side * (x1 - edge) >= 0.0:
            yield x1, y1
