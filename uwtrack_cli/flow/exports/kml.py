"""Features as KML, for a globe.

**References.** OGC 12-007r2 (2015), KML 2.3.
"""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from uwtrack_cli.files.text_escaping import xml_text
from uwtrack_cli.flow.exports.features import Feature

NAMESPACE = "http://www.opengis.net/kml/2.2"
FOLDERS = {
    "sensor": "Sensors", "encounter": "Closest approaches", "track": "Tracks",
    "fix": "Positions", "motion": "Motions", "ellipse": "95 % regions",
}  # fmt: skip
SHOWN = (
    "status", "time_utc", "speed_mps", "speed_std_mps", "course_deg", "course_std_deg",
    "slant_range_m", "slant_range_std_m", "side", "weight", "depth_m",
    "motion_model", "motion_model_probability", "alternative_motion_model", "misfit", "now_range_m", "now_range_std_m",
    "now_bearing_deg", "now_bearing_std_deg",
)  # fmt: skip


def kml_text(features: Sequence[Feature], name: str) -> str:
    """Return features as a KML document with a folder for each kind."""
    root = ET.Element("kml", xmlns=NAMESPACE)
    document = ET.SubElement(root, "Document")
    _text(document, "name", name)
    for kind, title in FOLDERS.items():
        own = [feature for feature in features if feature.kind == kind]
        if own:
            folder = ET.SubElement(document, "Folder")
            _text(folder, "name", title)
            for feature in own:
                _placemark(folder, feature)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _placemark(folder: ET.Element, feature: Feature) -> None:
    mark = ET.SubElement(folder, "Placemark")
    _text(mark, "name", feature.name)
    known = feature.properties
    facts = [f"{key}: {known[key]}" for key in SHOWN if known.get(key) is not None]
    if facts:
        _text(mark, "description", *facts)
    if known.get("time_utc"):
        _text(ET.SubElement(mark, "TimeStamp"), "when", known["time_utc"])
    parent = ET.SubElement(mark, feature.shape)
    if feature.shape == "LineString":
        _text(parent, "tessellate", "1")
    if feature.shape == "Polygon":
        boundary = ET.SubElement(parent, "outerBoundaryIs")
        parent = ET.SubElement(boundary, "LinearRing")
    places = " ".join(f"{x:.8f},{y:.8f}" for x, y in feature.places)
    _text(parent, "coordinates", places)


def _text(parent: ET.Element, tag: str, *lines: str) -> None:
    """Add an element with lines of text."""
    ET.SubElement(parent, tag).text = "\n".join(map(xml_text, lines))
