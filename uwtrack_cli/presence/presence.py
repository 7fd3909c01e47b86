"""Was there a vessel: what was heard, when, and why it is no closest approach.

**Method.** Lines of the sound tell of families, common motion and hum
(`tonal_stretches`), lines of the envelope of shafts and blades (`rate_families`), levels of
rises (`level_humps`). Rates of the shaft of a family join it as one contact. What passed
is marked with its closest approach, and what was taken for a passage and refused has
that reason.

**Conventions.** Times count from the first sample. Inputs of several sensors are told
apart by their names; trackers of one sensor are put together.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.constants import MAINS_HZ
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.presence import HUM, RATES, UNKNOWN, VESSEL, Presence
from uwtrack_cli.data.spectra import FULL_SCALE, MODULATION, Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.presence.level_humps import level_humps
from uwtrack_cli.presence.line_summary import LineSummary, common_bearing, summarise
from uwtrack_cli.presence.passage_stretches import (
    add_readings,
    add_refusals,
    mark_passages,
)
from uwtrack_cli.presence.rate_families import LOWEST_RATE_HZ, rate_families
from uwtrack_cli.presence.stretch import Stretch, make_presence
from uwtrack_cli.presence.tonal_stretches import tonal_stretches

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
    """Tell what was heard and when: vessels, rates, lines, hum, rain, unknown.

    Everything that was found is here, closest approaches as well as what is none, with
    the reason.

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
        One row per stretch, in the order of time.

    Raises
    ------
    DataError
        There is nothing to work on.
    """
    lines, levels, encounters = lines or [], levels or [], encounters or []
    if not (lines or levels or encounters):
        msg = (
            "presence needs lines, levels or encounters, got none: run 'uwtrack track' "
            "or 'uwtrack levels' first."
        )
        raise DataError(msg)
    starts: dict[str, int | None] = {}
    for frames in [*(one.frames for one in lines), *(one.frames for one in levels)]:
        starts.setdefault(frames.sensor, frames.start_utc_ns)
    for table in encounters:
        for row in range(table.n_encounters):
            time_ns = int(table.time_utc_ns[row])
            begin = time_ns - round(float(np.nan_to_num(table.time_s[row])) * 1e9)
            known = None if time_ns < 0 else begin
            starts.setdefault(str(table.sensor[row]), known)
    stretches = {
        sensor: _of_sensor(
            [one for one in lines if one.frames.sensor == sensor],
            [one for one in levels if one.frames.sensor == sensor],
            [one.of_sensor(sensor) for one in encounters],
        )
        for sensor in starts
    }
    references = [one.reference for one in lines if one.reference != MODULATION]
    references += [one.reference for one in levels]
    return make_presence(stretches, starts, references[0] if references else FULL_SCALE)


def _of_sensor(
    lines: Sequence[Lines], levels: Sequence[Levels], encounters: Sequence[Encounters]
) -> list[Stretch]:
    sound = [one for one in lines if one.reference != MODULATION]
    envelope = [one for one in lines if one.reference == MODULATION]
    found = tonal_stretches(sound) if sound else []
    for one in envelope:
        _add_rates(one, found)
    for own in levels:
        found += level_humps(own)
    begins, ends = _span(lines, levels)
    for table in encounters:
        mark_passages(table, found)
        add_refusals(table, found)
        add_readings(table, found)
    for stretch in found:  # a passage is longer than what was heard of it
        stretch.from_s = float(np.clip(stretch.from_s, begins, ends))
        stretch.to_s = float(np.clip(stretch.to_s, begins, ends))
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


def _add_rates(envelope: Lines, found: list[Stretch]) -> None:
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
        made = Stretch(
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


def _single_rate(lines: LineSummary, row: int) -> Stretch:
    """Return a line of the envelope that has no others of its shaft."""
    rate = float(lines.frequency_hz[row])
    kind, reason = UNKNOWN, SINGLE_RATE
    if rate < LOWEST_RATE_HZ:
        reason = TOO_SLOW
    elif _is_mains(rate):
        kind, reason = HUM, MAINS_RATE
    bearing, spread = common_bearing(lines, np.array([row]))
    return Stretch(
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


def _is_of_shaft(rates: Stretch, vessel: Stretch) -> bool:
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


def _is_one_bearing(rates: Stretch, vessel: Stretch) -> bool:
    off = abs(float(wrap_deg(np.array(vessel.bearing_deg - rates.bearing_deg))))
    spread = float(np.hypot(vessel.bearing_std_deg, rates.bearing_std_deg))
    return not off > SAME_BEARING_DEG + 3.0 * spread  # also where one is not known


def _join(vessel: Stretch, rates: Stretch) -> None:
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
