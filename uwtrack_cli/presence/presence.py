"""Was there a vessel: what was heard, when, and why it is no closest approach.

**Method.** Lines of the sound tell of families, common motion and hum
(`tonal_segments`), lines of the envelope of shafts and blades, levels of
rises (`level_humps`). Rates of the shaft of a family join it as one contact. What passed
is marked with its closest approach, and what was taken for a passage and refused has
that reason.

Every line of the envelope over a small whole number is a candidate for the rate of the
shaft. The lines that lie on its multiples are its family; it is accepted when fewer
than `GREATEST_CHANCE` such families are expected from lines at random (number of false
alarms). The rate is refined by least squares; a multiple that is clearly stronger than
the shaft rate is the blade rate.

**Conventions.** Times count from the first sample. Inputs of several sensors are told
apart by their names; trackers of one sensor are put together.

Nothing below `LOWEST_RATE_HZ` is a rate: swell modulates, too.

**References.** Desolneux, Moisan & Morel (2008) for the number of false alarms;
Nielsen, "Sonar Signal Processing" (1991), chapter 3, for shaft and blades.
"""

from collections.abc import Sequence
from math import comb
from typing import NamedTuple

import numpy as np

from uwtrack_cli.constants import MAINS_HZ
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.presence import HUM, RATES, UNKNOWN, VESSEL, Presence
from uwtrack_cli.data.spectra import FULL_SCALE, MODULATION, Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.presence.level_humps import level_humps
from uwtrack_cli.presence.line_summary import LineSummary, common_bearing, summarise
from uwtrack_cli.presence.passage_segments import add_readings, add_refusals, mark_passages
from uwtrack_cli.presence.segment import SoundSegment, make_presence
from uwtrack_cli.presence.tonal_segments import tonal_segments

LOWEST_RATE_HZ = 0.5
"""Lowest rate that is called one."""

MOST_PARTS = 12
"""Greatest number by which a line is divided to seek the shaft."""

GREATEST_CHANCE = 0.1
"""Expected number of families by chance below which lines are one family."""

TOLERANCE_SIGMAS = 3.0
"""Distance from a multiple up to which a line is a member."""

LEAST_TOLERANCE = 0.25
"""The same in resolutions, at least: a shaft does not turn evenly."""

BLADE_DB = 3.0
"""Level of the blade rate above the shaft rate, dB, at least."""


class RateFamily(NamedTuple):
    """Rates of one shaft."""

    rows: IntArray
    """Members, as rows of what was given."""
    shaft_hz: float
    """Lowest common rate, Hz."""
    shaft_std_hz: float
    """Its standard deviation, Hz."""
    blade_hz: float
    """Multiple that is clearly stronger than the first, Hz; nan if none is."""
    chance: float
    """Expected number of such families among lines at random."""


def rate_families(
    rate_hz: FloatArray, std_hz: FloatArray, level_db: FloatArray, resolution_hz: FloatArray
) -> list[RateFamily]:
    """Group modulation rates by their shafts, most certain first.

    Of each line of the envelope: rate and deviation, Hz, level, dB, and the reciprocal
    of the length of its frames, Hz.

    Examples
    --------
    >>> rates = np.array([2.41, 7.3, 9.6, 19.2])
    >>> std_hz, level_db = np.full(4, 0.005), np.array([1.0, 2.0, 9.0, 4.0])
    >>> (one,) = rate_families(rates, std_hz, level_db, np.full(4, 0.125))
    >>> one.rows.tolist(), round(one.shaft_hz, 3), round(one.blade_hz, 2)
    ([0, 2, 3], 2.4, 9.6)
    """
    free = np.flatnonzero(rate_hz >= LOWEST_RATE_HZ)
    found: list[RateFamily] = []
    while free.size >= 2:
        best = _best(rate_hz, std_hz, level_db, resolution_hz, free)
        if best is None:
            break
        found.append(best)
        free = free[~np.isin(free, best.rows)]
    return found


def _best(
    rate_hz: FloatArray,
    std_hz: FloatArray,
    level_db: FloatArray,
    resolution_hz: FloatArray,
    free: IntArray,
) -> RateFamily | None:
    rate = rate_hz[free]
    tolerance = np.maximum(TOLERANCE_SIGMAS * std_hz[free], LEAST_TOLERANCE * resolution_hz[free])
    best: tuple[float, float, IntArray] | None = None
    for whole in rate:
        for parts in range(1, MOST_PARTS + 1):
            shaft = float(whole) / parts
            if shaft < LOWEST_RATE_HZ:
                break
            order = np.rint(rate / shaft)
            is_member = (order >= 1) & (np.abs(rate - order * shaft) <= tolerance)
            share = np.minimum(1.0, 2.0 * tolerance / shaft)
            count = int(is_member.sum())
            if count < 2:
                continue
            shares = np.sort(share[is_member])[1:]  # one of them gave the shaft
            ways = _ways(rate.size, count)
            chance = float(rate.size * parts * ways * np.prod(shares))
            if best is None or chance < best[0]:
                best = (chance, shaft, np.flatnonzero(is_member))
    if best is None or best[0] > GREATEST_CHANCE:
        return None
    chance, shaft, members = best
    order = np.rint(rate[members] / shaft)
    weight = 1.0 / std_hz[free][members] ** 2
    refined = float((weight * order * rate[members]).sum() / (weight * order**2).sum())
    std = float(1.0 / np.sqrt((weight * order**2).sum()))
    level = level_db[free][members]
    strongest = int(np.argmax(level))
    first = level[order == 1].max(initial=-np.inf)
    is_blade = level[strongest] > first + BLADE_DB
    blade = order[strongest] * refined if is_blade else np.nan
    return RateFamily(free[members], refined, std, float(blade), chance)


def _ways(n: int, k: int) -> float:
    """Return in how many ways k - 1 further members can be chosen among n - 1."""
    return float(comb(n - 1, k - 1))


SAME_RATE = 0.004
"""Relative distance of a rate from a multiple of a spacing, or the reverse, that is one
shaft."""

MOST_TURNS = 12
"""Greatest whole number between a rate and a spacing of one shaft."""

SAME_BEARING_DEG = 20.0
"""Difference of bearings, beside three of their spreads, beyond which a rate and a
family are not of one vessel."""

RATES_ALONE = "rates of shaft and blades alone show no closest approach"
SINGLE_RATE = "a single modulation rate: shaft and blades make several"
TOO_SLOW = f"slower than {LOWEST_RATE_HZ:g} Hz: swell modulates, too"
MAINS_RATE = "the rate of mains, which modulate amplifiers and pumps"


@checked
def find_presence(
    lines: list[Lines] | None = None,
    levels: list[Levels] | None = None,
    encounters: list[Encounters] | None = None,
) -> Presence:
    """Report what was detected, and when: vessels, lines, hum, rain and others.

    Lists everything that was detected. If there is no closest approach, the reason is
    given.

    Parameters
    ----------
    lines
        Tracked lines of the sound and of its envelope, from any number of trackers.
    levels
        Broadband levels.
    encounters
        Closest approaches, and what was refused as one.

    Returns
    -------
    Presence
        One row per segment, in the order of time.

    Raises
    ------
    DataError
        There is nothing to work on.
    """
    lines, levels, encounters = lines or [], levels or [], encounters or []
    if not (lines or levels or encounters):
        raise DataError(
            "presence needs lines, levels or encounters, got none: run 'uwtrack track' "
            "or 'uwtrack levels' first."
        )
    starts: dict[str, int | None] = {}
    for frames in [*(one.frames for one in lines), *(one.frames for one in levels)]:
        starts.setdefault(frames.sensor, frames.start_utc_ns)
    for table in encounters:
        for row in range(table.n_encounters):
            time_ns = int(table.time_utc_ns[row])
            begin = time_ns - round(float(np.nan_to_num(table.time_s[row])) * 1e9)
            known = None if time_ns < 0 else begin
            starts.setdefault(str(table.sensor[row]), known)
    segments = {
        sensor: _of_sensor(
            [one for one in lines if one.frames.sensor == sensor],
            [one for one in levels if one.frames.sensor == sensor],
            [one.of_sensor(sensor) for one in encounters],
        )
        for sensor in starts
    }
    references = [one.reference for one in lines if one.reference != MODULATION]
    references += [one.reference for one in levels]
    return make_presence(segments, starts, references[0] if references else FULL_SCALE)


def _of_sensor(
    lines: Sequence[Lines], levels: Sequence[Levels], encounters: Sequence[Encounters]
) -> list[SoundSegment]:
    sound = [one for one in lines if one.reference != MODULATION]
    envelope = [one for one in lines if one.reference == MODULATION]
    found = tonal_segments(sound) if sound else []
    for one in envelope:
        _add_rates(one, found)
    for own in levels:
        found += level_humps(own)
    begins, ends = _span(lines, levels)
    for table in encounters:
        mark_passages(table, found)
        add_refusals(table, found)
        add_readings(table, found)
    for segment in found:  # a passage is longer than what was heard of it
        segment.from_s = float(np.clip(segment.from_s, begins, ends))
        segment.to_s = float(np.clip(segment.to_s, begins, ends))
    return found


def _span(lines: Sequence[Lines], levels: Sequence[Levels]) -> tuple[float, float]:
    """Return where the sound begins and ends that there are frames of, s."""
    frames = [*(one.frames for one in lines), *(one.frames for one in levels)]
    frames = [one for one in frames if one.n_frames]
    if not frames:
        return -np.inf, np.inf
    half_s = [0.5 * one.window_s for one in frames]
    begins = [float(f.time_s[0]) - h for f, h in zip(frames, half_s, strict=True)]
    ends = [float(f.time_s[-1]) + h for f, h in zip(frames, half_s, strict=True)]
    return min(begins), max(ends)


def _add_rates(envelope: Lines, found: list[SoundSegment]) -> None:
    """Join the rates of each shaft to the vessel of its lines, or add them."""
    if not envelope.line_id.size:
        return
    lines = summarise(envelope)
    families = rate_families(
        lines.frequency_hz, lines.frequency_std_hz, lines.level_db, lines.resolution_hz
    )
    rest = np.ones(lines.frequency_hz.size, np.bool_)
    for family in families:
        rest[family.rows] = False
        rows = family.rows
        bearing, spread = common_bearing(lines, rows)
        made = SoundSegment(
            kind=RATES,
            from_s=float(lines.from_s[rows].min()),
            to_s=float(lines.to_s[rows].max()),
            spacing_hz=family.shaft_hz,
            spacing_std_hz=family.shaft_std_hz,
            blade_rate_hz=family.blade_hz,
            bearing_deg=bearing,
            bearing_std_deg=spread,
            probability_of_chance=min(1.0, family.chance),
            rates_hz=[float(rate) for rate in lines.frequency_hz[rows]],
            reason=RATES_ALONE,
        )
        if _is_mains(made.spacing_hz):
            made.kind, made.reason = HUM, MAINS_RATE
        vessel = next((one for one in found if _is_of_shaft(made, one)), None)
        if vessel is None:
            found.append(made)
        else:
            _join(vessel, made)
    found += [_single_rate(lines, int(row)) for row in np.flatnonzero(rest)]


def _single_rate(lines: LineSummary, row: int) -> SoundSegment:
    """Return a line of the envelope that has no others of its shaft."""
    rate = float(lines.frequency_hz[row])
    kind, reason = UNKNOWN, SINGLE_RATE
    if rate < LOWEST_RATE_HZ:
        reason = TOO_SLOW
    elif _is_mains(rate):
        kind, reason = HUM, MAINS_RATE
    bearing, spread = common_bearing(lines, np.array([row]))
    return SoundSegment(
        kind=kind,
        from_s=float(lines.from_s[row]),
        to_s=float(lines.to_s[row]),
        bearing_deg=bearing,
        bearing_std_deg=spread,
        rates_hz=[rate],
        reason=reason,
    )


def _is_mains(rate_hz: float) -> bool:
    """Tell whether a rate is that of mains, or twice that: power follows the square."""
    return any(
        abs(rate_hz / mains - round(rate_hz / mains)) * mains < 0.1
        and round(rate_hz / mains) in {1, 2}
        for mains in MAINS_HZ
    )


def _is_of_shaft(rates: SoundSegment, vessel: SoundSegment) -> bool:
    """Tell whether rates are of the shaft that a family's spacing is a multiple of."""
    if vessel.kind != VESSEL or not np.isfinite(vessel.spacing_hz):
        return False
    if not vessel.overlaps(rates.from_s, rates.to_s):
        return False
    if not _is_one_bearing(rates, vessel):
        return False
    for rate in (rates.spacing_hz, rates.blade_rate_hz):
        for ratio in (rate / vessel.spacing_hz, vessel.spacing_hz / rate):
            if not np.isfinite(ratio) or not 0.5 < ratio < MOST_TURNS + 0.5:
                continue
            if abs(ratio / round(ratio) - 1.0) < SAME_RATE:
                return True
    return False


def _is_one_bearing(rates: SoundSegment, vessel: SoundSegment) -> bool:
    off = abs(float(wrap_deg(np.array(vessel.bearing_deg - rates.bearing_deg))))
    spread = float(np.hypot(vessel.bearing_std_deg, rates.bearing_std_deg))
    return not off > SAME_BEARING_DEG + 3.0 * spread  # also where one is not known


def _join(vessel: SoundSegment, rates: SoundSegment) -> None:
    """Give a vessel the rates of its shaft."""
    vessel.rates_hz += rates.rates_hz
    vessel.from_s = min(vessel.from_s, rates.from_s)
    vessel.to_s = max(vessel.to_s, rates.to_s)
    both = vessel.probability_of_chance * rates.probability_of_chance
    vessel.probability_of_chance = max(both, 1e-300)
    if not np.isfinite(vessel.blade_rate_hz):
        vessel.blade_rate_hz = rates.blade_rate_hz
    if rates.spacing_hz < vessel.spacing_hz * (1.0 - SAME_RATE):
        if not np.isfinite(vessel.blade_rate_hz):
            vessel.blade_rate_hz = vessel.spacing_hz
        vessel.spacing_hz = rates.spacing_hz
        vessel.spacing_std_hz = rates.spacing_std_hz
