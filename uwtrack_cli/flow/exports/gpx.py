"""Positions of vessels as GPX 1.1 waypoints, for chart plotters.

**References.** Topografix, GPX 1.1 Schema Documentation (2004).
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

from uwtrack_cli.files.text_escaping import xml_text
from uwtrack_cli.flow.exports.features import Feature

NAMESPACE = "http://www.topografix.com/GPX/1/1"


def gpx_text(features: Sequence[Feature]) -> str:
    """Return the points among features as a GPX document."""
    root = ET.Element("gpx", xmlns=NAMESPACE, version="1.1", creator="uwtrack")
    for feature in features:
        if feature.shape == "Point":
            east, north = feature.places[0]
            at = {"lat": f"{north:.8f}", "lon": f"{east:.8f}"}
            mark = ET.SubElement(root, "wpt", at)
            ET.SubElement(mark, "name").text = xml_text(feature.name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
