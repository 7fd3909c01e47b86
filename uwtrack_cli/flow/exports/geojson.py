"""Features as GeoJSON; shapes across the antimeridian are cut there.

**References.** RFC 7946 (2016), The GeoJSON Format.
"""

import json
from collections.abc import Sequence
from typing import Any

from uwtrack_cli.files.text_escaping import plain_text
from uwtrack_cli.flow.exports.antimeridian import cut_at_antimeridian
from uwtrack_cli.flow.exports.features import Feature


def geojson_text(features: Sequence[Feature]) -> str:
    """Return features as a GeoJSON feature collection.

    Parameters
    ----------
    features
        What is on the map.
    """
    collection = {
        "type": "FeatureCollection",
        "features": [_feature(feature) for feature in features],
    }
    return (
        plain_text(json.dumps(collection, ensure_ascii=False, allow_nan=False)) + "\n"
    )


def _feature(feature: Feature) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": _geometry(feature),
        "properties": {
            "kind": feature.kind, "name": feature.name, **feature.properties,
        },
    }  # fmt: skip


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
