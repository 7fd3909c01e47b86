"""Features as GPX, for chart plotters and handheld receivers.

**References.** Topografix, GPX 1.1 schema (2004).
"""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from uwtrack_cli.files.text_escaping import xml_text
from uwtrack_cli.flow.exports.features import Feature


def gpx_text(features: Sequence[Feature]) -> str:
    """Return points as waypoints and lines as tracks; regions are left out."""
    root = ET.Element(
        "gpx",
        version="1.1",
        creator="uwtrack",
        xmlns="http://www.topografix.com/GPX/1/1",
    )
    for feature in (f for f in features if f.shape == "Point"):
        _named(_point(root, "wpt", feature.places[0]), feature)
    for feature in (f for f in features if f.shape == "LineString"):
        track = ET.SubElement(root, "trk")
        _named(track, feature)
        segment = ET.SubElement(track, "trkseg")
        for place in feature.places:
            _point(segment, "trkpt", place)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _point(parent: ET.Element, tag: str, place: tuple[float, float]) -> ET.Element:
    return ET.SubElement(parent, tag, lat=f"{place[1]:.8f}", lon=f"{place[0]:.8f}")


def _named(item: ET.Element, feature: Feature) -> None:
    ET.SubElement(item, "name").text = xml_text(feature.name)
