"""Features as GeoJSON.

**References.** RFC 7946 (2016), The GeoJSON Format.
"""

import json
from collections.abc import Sequence
from typing import Any

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
    return json.dumps(collection, ensure_ascii=False, allow_nan=False) + "\n"


def _feature(feature: Feature) -> dict[str, Any]:
    places: Any = [list(place) for place in feature.places]
    if feature.shape == "Point":
        places = places[0]
    elif feature.shape == "Polygon":
        places = [places]
    return {
        "type": "Feature",
        "geometry": {"type": feature.shape, "coordinates": places},
        "properties": {
            "kind": feature.kind, "name": feature.name, **feature.properties,
        },
    }  # fmt: skip
