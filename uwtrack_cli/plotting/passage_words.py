"""What a picture says of a passage in words: title, numbers, what to mind."""

import re
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.files.tables.json_rows import Row
from uwtrack_cli.files.tables.summaries import Head, utc_text
from uwtrack_cli.plotting.view import Units

MARKED_MISFIT = 0.2
"""Misfit from which a page warns: half of what refuses a passage."""

UNIT = re.compile(r"_(m|mps|deg|s|hz|db)$")
"""Unit at the end of a column's name."""

LEAST_CHANCE = 0.005
"""Probability of another explanation below which it is not said."""

SURE = 0.9
"""Probability below which a passage is marked."""


def passage_title(row: Row, units: Units) -> str:
    """Return when, how fast, how near and who, with deviations.

    ``row``: the passage, as `json_rows` gives it. ``units``: unit of the speed.
    """
    std = row["time_std_s"]
    if row["time_utc"]:
        digits = 0 if std is None or std >= 1.0 else 1
        parts = [f"{utc_text(row['time_utc'], digits)} UTC"]
    else:
        parts = [f"closest at {value_text(row, 'time_s', 1)} s"]
    parts += filter(None, [speed_text(row, units), _range(row)])
    return "   ".join([*parts, *([row["vessel"]["name"]] if row["vessel"] else [])])


def value_text(row: Row, key: str, digits: int) -> str:
    """Return a value with its deviation, for a column whose name ends in its unit."""
    stem, _, unit = key.rpartition("_")
    return Head("", key, digits, f"{stem}_std_{unit}").text(row)


def speed_text(row: Row, units: Units, key: str = "speed_mps") -> str:
    """Return a speed with its deviation in a unit; empty where it is not known."""
    if row.get(key) is None:
        return ""
    scale = KNOT_MPS if units == "kn" else 1.0
    std = row.get(key.replace("_mps", "_std_mps"))
    shown = {"v": row[key] / scale, "s": None if std is None else std / scale}
    return f"{Head('', 'v', 1, 's').text(shown)} {units}"


def _range(row: Row) -> str:
    if row["slant_range_m"] is not None:
        return f"{value_text(row, 'slant_range_m', 0)} m"
    if row["range_over_speed_s"] is None:
        return ""
    return f"range/speed {value_text(row, 'range_over_speed_s', 1)} s"


def _otherwise(row: Row) -> str:
    """Return what else a passage is likeliest to be; empty for nothing that is known."""
    code = row.get("alternative") or ""
    return "" if code == "not-significant" else str(code).replace("-", " ")


def cautions(row: Row) -> list[str]:
    """Return what a reader of a passage must not overlook, a sentence each."""
    found = []
    chance = row.get("probability")
    if chance is not None and chance < SURE:
        other = _otherwise(row)
        found.append(f"uncertain: it passes with a probability of {chance:.2f}"
                     + (f", else {other}" if other else ""))  # fmt: skip
    if (row["misfit"] or 0.0) >= MARKED_MISFIT:
        found.append(
            f"the lines leave the fit by {100 * row['misfit']:.0f} % of the Doppler "
            f"shift beyond their noise"
        )
    if row["extrapolated"]:
        found.append("extrapolated: the closest approach was not recorded")
    return found


FACTS = (
    ("slant range", "slant_range_m", 1, "m"),
    ("horizontal range", "horizontal_range_m", 1, "m"),
    ("range/speed", "range_over_speed_s", 2, "s"),
    ("source depth", "source_depth_m", 1, "m"),
    ("course", "course_deg", 1, "deg"),
    ("bearing", "bearing_deg", 1, "deg"),
    ("received level", "received_level_db", 1, "dB re {}"),
    ("source level", "source_level_db", 1, "dB re {}"),
)
"""What stands beside the panels: name, key, decimals, unit."""


def fact_lines(row: Row, units: Units) -> list[tuple[str, str]]:
    """Return what is known of a passage, by name, as text with units.

    ``row``: the passage, as `json_rows` gives it. ``units``: unit of the speed.
    """
    found = [("speed", speed_text(row, units))] if row["speed_mps"] is not None else []
    found += [
        (name, f"{value_text(row, key, digits)} {unit.format(row['level_reference'])}")
        for name, key, digits, unit in FACTS
        if row.get(key) is not None
    ]
    if row.get("probability") is not None:
        found.append(("probability", f"{row['probability']:.2f} that it passes"))
        chance = row.get("alternative_probability")
        other = _otherwise(row)
        if other and (chance is None or chance >= LEAST_CHANCE):
            shown = "" if chance is None else f", {chance:.2f}"
            found.append(("else", f"{other}{shown}"))
    if row["misfit"] is not None:
        left = f"{100 * row['misfit']:.0f} % of the shift unexplained"
        follows = row["misfit"] < MARKED_MISFIT
        found.append(("lines", "follow the fit" if follows else left))
    rest = [f"{f:.2f}" for f in sorted(f for f in row["rest_frequencies_hz"] if f)]
    if rest:
        found.append(("at rest", f"{', '.join(rest)} Hz"))
    if row.get("motion_model") not in {None, "straight"}:  # as in the table
        weight = Head("", "motion_model_probability", 2).text(row)
        found.append(("motion", f"{row['motion_model']}, weight {weight}"))
    return [*found, ("sound speed", f"{row['sound_speed_mps']:g} m/s")]


def reasons_once(rows: Sequence[Row]) -> list[str]:
    """Return why values are not known: each reason once, with the passages it is of.

    ``rows``: passages, as `numbered` gives them, or motions.
    """
    known = defaultdict[tuple[str, str], list[str]](list)
    for row in rows:
        by_reason = defaultdict[str, list[str]](list)
        for key, reason in row["reasons"].items():
            if key not in {"vessel", "time_utc"}:
                by_reason[reason].append(UNIT.sub("", key).replace("_", " "))
        for reason, keys in by_reason.items():
            owner = str(row.get("passage", row["contact"]))
            known[(", ".join(sorted(keys)), reason)].append(owner)
    return [
        f"No {keys}: {reason}"
        + ("." if len(owners) == len(rows) else
           f" (passage{'s' * (len(owners) > 1)} {', '.join(owners)}).")
        for (keys, reason), owners in known.items()
    ]  # fmt: skip


def title_lines(row: Row, number: int, units: Units) -> list[tuple[str, bool]]:
    """Return the lines above the page of a passage, and which of them warn."""
    second: list[Any] = [f"passage {number}", f"sensor {row['sensor']}"]
    if row["course_deg"] is not None:
        second.append(f"course {value_text(row, 'course_deg', 0)}\u00b0")
    if row["side"]:
        second.append(f"sensor to {row['side']}")
    n_lines = len(row["rest_frequencies_hz"])
    second.append(f"{n_lines or 'no'} line{'' if n_lines == 1 else 's'}")
    second.append(row["status"])
    found = [(passage_title(row, units), False), (" \u00b7 ".join(second), False)]
    return found + [(f"\u26a0 {text}", True) for text in cautions(row)]
