"""What was detected, in sentences.

**Conventions.** Rows are those of `json_rows`. Times are UTC where known, else seconds
from the first sample.
"""

from collections.abc import Sequence
from typing import Any

from uwtrack_cli.data.presence import (
    BROADBAND,
    HUM,
    KINDS,
    LINES,
    OF_VESSELS,
    RAIN,
    RATES,
    UNKNOWN,
    VESSEL,
)
from uwtrack_cli.files.utc import format_utc, parse_utc

Row = dict[str, Any]

DETECTED = {
    VESSEL: "a vessel is detected",
    RATES: "shaft and blades of a vessel are detected",
    LINES: "lines without a family are detected",
    BROADBAND: "a rise of the broadband is detected",
    HUM: "mains hum is detected",
    RAIN: "rain is detected",
    UNKNOWN: "something unknown is detected",
}
"""What is said of each kind."""

MOST_SENTENCES = 3
"""Segments that are told one by one."""

NOBODY = "no vessel was found"
NO_PASSAGE = "no closest approach"


def presence_sentences(
    rows: Sequence[Row], *, is_passed: bool, suggestions: Sequence[str] = ()
) -> list[str]:
    """Say what was detected beside the closest approaches.

    ``is_passed``: whether there are closest approaches, which are told elsewhere.
    ``suggestions``: what to try next, which is told where no vessel was found.
    """
    rest = [row for row in rows if row["encounter"] is None]
    rest.sort(key=lambda row: (KINDS.index(row["kind"]), row["from_s"]))
    vessels = [row for row in rest if row["kind"] in {VESSEL, RATES}]
    others = [row for row in rest if row["kind"] in OF_VESSELS]
    known = dict.fromkeys(DETECTED[r["kind"]] for r in rest if r["kind"] in {HUM, RAIN})
    if is_passed:
        told, start = vessels, "also: "
    elif vessels or others:
        told, start = vessels or others, f"{NO_PASSAGE}; "
    else:
        return ["; ".join([NOBODY, *known]), *suggestions]
    sentences = [f"{start}{segment_words(row)}" for row in told[:MOST_SENTENCES]]
    if len(told) > MOST_SENTENCES:
        more = len(told) - MOST_SENTENCES
        sentences.append(f"{more} more: uwtrack show FILE presence")
    return sentences if vessels or is_passed else [*sentences, *known, *suggestions]


def why_no_passage(rows: Sequence[Row]) -> list[str]:
    """Say of each segment that is no closest approach why it is none.

    Examples
    --------
    >>> why_no_passage([{"kind": "hum", "from_s": 4.0, "from_utc": None,
    ...                  "reasons": {"encounter": "mains of the electronics, no vessel"}}])
    ['hum from 4 s: mains of the electronics, no vessel']
    """
    return [
        f"{row['kind']} from {_time(row, 'from')}: {row['reasons']['encounter']}"
        for row in rows
        if "encounter" in (row["reasons"] or {})
    ]


def segment_words(row: Row) -> str:
    """Say what was detected in a segment, and when.

    Examples
    --------
    >>> row = {"kind": "vessel", "from_s": 12.0, "to_s": 80.4, "from_utc": None,
    ...        "spacing_hz": 6.268, "blade_rate_hz": None, "n_lines": 29,
    ...        "rates_hz": [], "to_utc": None}
    >>> segment_words(row)
    'a vessel is detected from 12 s to 80 s (spacing 6.27 Hz, 29 lines)'
    """
    known = []
    if row["spacing_hz"] is not None:
        name = "shaft" if row["kind"] == RATES else "spacing"
        known.append(f"{name} {row['spacing_hz']:.2f} Hz")
    if row["blade_rate_hz"] is not None:
        known.append(f"blades {row['blade_rate_hz']:.2f} Hz")
    for count, one, many in (
        (row["n_lines"], "line", "lines"),
        (len(row["rates_hz"]), "rate", "rates"),
    ):
        if count:
            known.append(f"{count} {one if count == 1 else many}")
    details = f" ({', '.join(known)})" if known else ""
    return f"{DETECTED[row['kind']]} from {_time(row, 'from')} to {_time(row, 'to')}{details}"


def _time(row: Row, end: str) -> str:
    utc = row[f"{end}_utc"]
    if utc is None:
        return f"{row[f'{end}_s']:.0f} s"
    second = 10**9
    whole = format_utc((parse_utc(utc) + second // 2) // second * second)
    return whole[11:19]
