"""One answer to each passage from the answers of several resolutions.

**Method.** Frames of different lengths see one passage, each in its own way: tables of
closest approaches are added one after the other, and a row competes with those of the
tables before it that claim the same time. Rows that agree are one passage, and the one
with the smaller deviations is kept. The difference of an efficient estimate from another
one of the same data has the variance by which both differ (Hausman 1978); a larger
difference adds to the variance of what is kept. Where they do not agree, the more probable
one wins. Lines beat levels, since the sound itself was asked of them.
What loses is no closest approach any more, and the reason says so.

**Conventions.** Rows of one table never compete: they are told apart already. Times
count from the first sample.

**References.** Hausman (1978), Econometrica 46, 1251: two estimates of one quantity.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.motion.association import PassageReport, same_vessel
from uwtrack_cli.motion.decision import OTHER_RESOLUTION, Rejection, reject

DEVIATIONS = 3.0
"""Standard deviations of time within which two rows claim the same sound."""

WIDTHS = 1.0
"""d/v, of the shorter passage, within which two rows claim the same time."""

SLANT = ("time_s", "range_over_speed_s", "speed_mps", "bearing_deg")
HORIZONTAL = ("time_s", "horizontal_range_over_speed_s", "speed_mps", "bearing_deg")
RANGES = ("slant_range_m", "horizontal_range_m", "course_deg")
"""Quantities of both covariances in their order, and others that have a deviation."""

SAME_LINE_HZ = 0.5
"""Difference of rest frequencies up to which a line is one in frames of two lengths: half of
what frames of a second resolve."""

DETERMINED = ("time_std_s", "range_over_speed_std_s", "speed_std_mps")
"""Columns that say how well a passage is determined."""

LEVEL_ONLY = "level-only"

LEVELS = (
    "received_level_db", "received_level_std_db", "source_level_db", "source_level_std_db",
)  # fmt: skip
"""Columns of the levels in the band of a table."""

STAYS = Rejection("", "")
"""What says that a row is not beaten by another."""


def compete(
    first: Encounters,
    others: Sequence[Encounters],
    highest_contact: int = 0,
    *,
    keeps_first: bool = False,
) -> Encounters:
    """Let the rows of several tables compete for the passages of one recording.

    Parameters
    ----------
    first
        Table that keeps its contact numbers.
    others
        Further tables, in any order; their rows get numbers that are free.
    highest_contact
        Highest contact number that is taken, by lines that passed nobody.
    keeps_first
        Whether the lines of the first table are those that are kept, and its levels those
        of its band: a sharper row of another table takes the contact number and the levels
        of the only one that it agrees with.

    Returns
    -------
    Encounters
        One row per passage, in the order of time.
    """
    kept = first
    for other in others:
        losers: dict[int, Rejection | None] = {}
        winners, same = list[int](), dict[int, int]()
        for row in range(other.n_encounters):
            rivals = [k for k in range(kept.n_encounters) if overlaps(kept, k, other, row)]
            reasons = [_beaten(kept, k, other, row) for k in rivals]
            if STAYS in reasons:
                continue
            if reasons == [None] and keeps_first and rivals[0] not in losers:
                same[row] = rivals[0]
            winners.append(row)
            losers |= dict(zip(rivals, reasons, strict=True))
        if winners:
            won = _with_those_of(other, kept, same)
            kept = _exchanged(
                kept, losers, won.take("encounter", np.array(winners)), highest_contact
            )
    return kept.take("encounter", np.argsort(np.nan_to_num(kept.time_s, nan=np.inf)))


def overlaps(one: Encounters, k: int, two: Encounters, n: int) -> bool:
    """Tell whether row k of one table and row n of another claim the same time."""
    widths = (one.range_over_speed_s[k], two.range_over_speed_s[n])
    known = [width for width in widths if np.isfinite(width)]
    reach = WIDTHS * min(known, default=0.0)
    reach += DEVIATIONS * _spread(one.time_std_s[k], two.time_std_s[n])
    return bool(abs(one.time_s[k] - two.time_s[n]) < reach)


def _with_those_of(table: Encounters, kept: Encounters, same: dict[int, int]) -> Encounters:
    """Return rows with contact, lines and levels of the kept rows of the same passages.

    ``same`` has the kept row of each row of the table that is the same passage. Other rows
    have the contact 0. Deviations grow by how far both rows are apart.
    """
    rows, places = np.array(list(same), np.int64), np.array(list(same.values()), np.int64)
    columns = {name: getattr(table, name).copy() for name in LEVELS}
    columns["contact"] = np.zeros_like(table.contact)
    for name, values in columns.items():
        values[rows] = getattr(kept, name)[places]
    columns["rest_line_id"] = table.rest_line_id.copy()
    for row, place in same.items():
        own, other = table.rest_encounter == row, kept.rest_encounter == place
        if other.any():
            off_hz = np.abs(table.rest_frequency_hz[own, None] - kept.rest_frequency_hz[other])
            lines = kept.rest_line_id[other][off_hz.argmin(axis=1)]
            columns["rest_line_id"][own] = np.where(off_hz.min(axis=1) < SAME_LINE_HZ, lines, 0)
    return _widened(replace(table, **columns), kept, rows, places)


def _widened(table: Encounters, kept: Encounters, rows: IntArray, places: IntArray) -> Encounters:
    """Return rows whose deviations hold how far the kept rows in their places are off."""
    columns: dict[str, Any] = {}
    factor: dict[str, FloatArray] = {}
    for name in dict.fromkeys((*SLANT, *HORIZONTAL, *RANGES)):
        quantity, unit = name.rsplit("_", 1)
        std = f"{quantity}_std_{unit}"
        if getattr(table, name) is None or getattr(kept, name) is None:
            continue
        own, other = getattr(table, std)[rows], getattr(kept, std)[places]
        off = getattr(table, name)[rows] - getattr(kept, name)[places]
        off = wrap_deg(off) if unit == "deg" else off
        # either may be the efficient one in a single quantity
        more = np.maximum(np.nan_to_num(off**2 - np.abs(other**2 - own**2)), 0.0)
        factor[name] = np.sqrt(1.0 + more / np.where(own > 0.0, own, np.inf) ** 2)
        columns[std] = getattr(table, std).copy()
        columns[std][rows] = own * factor[name]
    for column, names in (("covariance", SLANT), ("horizontal_covariance", HORIZONTAL)):
        if all(name in factor for name in names) and getattr(table, column) is not None:
            scale = np.stack([factor[name] for name in names], axis=-1)
            columns[column] = getattr(table, column).copy()
            columns[column][rows] *= scale[:, :, None] * scale[:, None]
    return replace(table, **columns)


def _spread(one: float, two: float) -> float:
    return float(np.hypot(np.nan_to_num(one), np.nan_to_num(two)))


def _beaten(one: Encounters, k: int, two: Encounters, n: int) -> Rejection | None:
    """Return why the second row beats the first, None if both agree; `STAYS` if not."""
    sharper = _log_size(two, n, one, k) < 0.0
    have_lines = [one.status[k] != LEVEL_ONLY, two.status[n] != LEVEL_ONLY]
    odds = [_probability(*pair) for pair in ((one, k), (two, n))]
    if have_lines[0] != have_lines[1]:
        wins, words = have_lines[1], "which lines confirm"
    elif _agree(one, k, two, n):
        return None if sharper else STAYS
    else:
        wins = odds[1] > odds[0]
        words = f"which is more probable ({odds[1]:.2f} against {odds[0]:.2f})"
    return reject(OTHER_RESOLUTION, better=words) if wins else STAYS


def _log_size(one: Encounters, k: int, two: Encounters, n: int) -> float:
    """Return the logarithm of the ratio of what two rows leave open, in all that both know."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = [np.log(getattr(one, std)[k] / getattr(two, std)[n]) for std in DETERMINED]
    return float(sum(ratio for ratio in ratios if np.isfinite(ratio)))


def _probability(table: Encounters, row: int) -> float:
    """Return the probability of a row, zero where none is stated."""
    return float(np.nan_to_num(table.probability[row])) if (table.probability is not None) else 0.0


def _agree(one: Encounters, k: int, two: Encounters, n: int) -> bool:
    """Tell whether two rows are of one vessel."""
    return same_vessel(closest_approach(one, k), closest_approach(two, n)) > 0.0


def closest_approach(table: Encounters, row: int) -> PassageReport:
    """Return what a row reports; its lines are those of its own frames."""
    values = [
        float(getattr(table, name)[row])
        for name in PassageReport._fields
        if name != "rest_frequencies_hz"
    ]
    return PassageReport._make([*values, ()])


def _exchanged(
    kept: Encounters, losers: dict[int, Rejection | None], winners: Encounters, highest: int
) -> Encounters:
    """Put winners into the place of losers; a contact of 0 gets a number of its own."""
    highest = max(highest, int(kept.contact.max(initial=0)))
    if kept.refused_contact is not None:
        highest = max(highest, int(kept.refused_contact.max(initial=0)))
    stay = np.setdiff1d(np.arange(kept.n_encounters), list(losers))
    reasons = {k: reason for k, reason in losers.items() if reason is not None}
    told = list(reasons)
    is_new = winners.contact == 0
    numbers: IntArray = np.where(is_new, highest + np.cumsum(is_new), winners.contact)
    winners = replace(
        winners,
        contact=numbers,
        refused_contact=kept.contact[told],
        refused_sensor=kept.sensor[told],
        refused_from_s=(kept.time_s - kept.range_over_speed_s)[told],
        refused_to_s=(kept.time_s + kept.range_over_speed_s)[told],
        refused_reason=np.array([one.sentence for one in reasons.values()], np.str_),
        refused_code=np.array([one.code for one in reasons.values()], np.str_),
        refused_probability=None if kept.probability is None else kept.probability[told],
        refused_motion_model=np.full(len(told), ""),
        refused_motion_model_probability=np.full(len(told), np.nan),
        refused_alternative_motion_model=np.full(len(told), ""),
        refused_alternative_motion_model_probability=np.full(len(told), np.nan),
    )
    return Encounters.join([winners, kept.take("encounter", stay)])
