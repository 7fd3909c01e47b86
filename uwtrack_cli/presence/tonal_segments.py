"""Lines of the sound to segments: vessels by their families, hum, and other lines.

**Method.** The lines of all trackers are put together; one that another tracker has
found, too, counts once. Families that share lines, and whose spacings are small whole
multiples of each other, are one. Their spacing is that of the comb on which all of
their lines lie; a multiple whose own multiples have nearly all of the power
is the blade rate. Lines of one contact that move together are a vessel without a family.
What is left is mains hum, lines, or what noise gives by itself.

The mean frequencies of a comb are fitted by least squares with a spacing, and with an
offset unless the family is harmonic. Frames of several lengths, and machines that do not
turn evenly, make lines miss their teeth by more than they state; the scatter that is left
counts as a variance that all lines share, so that one line of a small deviation does not
outweigh a dozen (Paule and Mandel). A family is harmonic where its offset is none within
what the fit leaves open. Where the lines between its teeth lie half-way, or on thirds, by
more than chance, that part of the spacing is the spacing.

**Conventions.** A line that lasts n independent frames at a power ratio s has the
evidence n (s - ln(1 + s) - 1) nepers against noise, which may choose its path.

**References.** Paule & Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982), for the
variance that is shared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb, exp, gcd
from typing import NamedTuple

import numpy as np

from uwtrack_cli.constants import MAINS_HZ, MAINS_TOLERANCE
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import HUM, LINES, UNKNOWN, VESSEL
from uwtrack_cli.lines.contacts import LEAST_EVIDENCE
from uwtrack_cli.lines.rungs.same_line import SAME_LINE, is_one_family, line_evidence
from uwtrack_cli.presence.line_summary import LineSummary, summarise
from uwtrack_cli.presence.segment import SoundSegment, segment_of_lines

TOOTH = 0.1
"""Least distance from a tooth, in resolutions, up to which a line is on it."""

TOOTH_SHARE = 0.2
"""The same at most, in spacings."""

TOOTH_SIGMAS = 3.0
"""The same in standard deviations of the line's frequency; also of an offset that is
none."""

LARGEST_REACH = 1.5
"""Multiple of a family's highest line up to which others may lie on its teeth."""

MOST_PARTS = 3
"""Parts of a spacing that are tried."""

BETWEEN_SHARE = 4.0 / 9.0
"""Share of what lies between the teeth that is near those of a third; of a half, less."""

PART_CHANCE = 1e-3
"""Probability by chance up to which lines between the teeth lie on those of a part."""

OPEN_OFFSET = 0.15
"""Deviation of an offset, in spacings, from which on it says nothing."""

HALVINGS = 20
"""Halvings in which the shared variance is found, to a millionth of the greatest."""

MOST_UNKNOWNS = 2
"""Unknowns of a fit, spacing and offset: more teeth must be there."""

ROUNDS = 3
"""Rounds of fitting, and of asking which lines lie on the teeth."""

MOST_BLADES = 8
"""Greatest multiple of a spacing that is asked whether it stands out."""

BLADE_SHARE = 0.9
"""Share of the power of all lines that the multiples of the blade rate have."""


class LineComb(NamedTuple):
    """A comb and the lines on its teeth."""

    spacing_hz: float
    """Distance of neighbouring teeth, Hz."""
    spacing_std_hz: float
    """Its standard deviation, Hz."""
    offset_hz: float
    """Frequency of tooth 0, Hz; 0 for a harmonic family."""
    rows: IntArray
    """Its lines, as rows of the summary."""
    tooth: IntArray
    """Tooth of each, shape (row,)."""


def fit_comb(
    lines: LineSummary, own: IntArray, free: BoolArray, spacing_hz: float, offset_hz: float = 0.0
) -> LineComb:
    """Fit a comb to the lines of a family, and to the free ones on its teeth.

    ``own`` are at least three rows; ``free`` are lines of no other family, shape
    (line,). The spacing is as the family's tracker told it; tooth 0 of a harmonic
    family is at 0 Hz.
    """
    there = free & (lines.status != "hum")
    begin, end = lines.from_s[own].min(), lines.to_s[own].max()
    there &= (lines.from_s <= end) & (lines.to_s >= begin)
    # further up a line would lie on some tooth by chance
    there &= lines.frequency_hz <= LARGEST_REACH * lines.frequency_hz[own].max()
    spacing_hz /= _parts(lines.frequency_hz[own], spacing_hz, offset_hz)
    spacing, std, offset = spacing_hz, np.nan, offset_hz
    rows = own
    for _ in range(ROUNDS):
        tooth, miss_hz = _nearest(lines.frequency_hz, spacing, offset)
        on_tooth = np.abs(miss_hz) <= _reach(lines, spacing)
        rows = np.union1d(own, np.flatnonzero(on_tooth & there))
        near = np.abs(miss_hz[rows]) <= TOOTH_SHARE * spacing
        is_enough = np.unique(tooth[rows[near]]).size > MOST_UNKNOWNS
        fitted = rows[near] if is_enough else rows
        spacing, std, offset = _fitted(
            tooth[fitted], lines.frequency_hz[fitted], lines.frequency_std_hz[fitted],
            is_harmonic=offset == 0.0,
        )  # fmt: skip
    tooth, _ = _nearest(lines.frequency_hz[rows], spacing, offset)
    # a comb of every second tooth has twice the spacing
    first = int(tooth.min()) if offset else 0
    common = max(1, gcd(*(tooth - first).tolist()))
    offset += first * spacing
    tooth = (tooth - first) // common
    return LineComb(spacing * common, std * common, offset, rows, tooth)


def _nearest(
    frequency_hz: FloatArray, spacing_hz: float, offset_hz: float
) -> tuple[IntArray, FloatArray]:
    """Return the nearest tooth of each frequency, and by how much it is missed."""
    lowest = 0 if offset_hz else 1
    tooth = np.maximum(np.rint((frequency_hz - offset_hz) / spacing_hz), lowest)
    return tooth.astype(np.int64), frequency_hz - offset_hz - tooth * spacing_hz


def _reach(lines: LineSummary, spacing_hz: float) -> FloatArray:
    own_hz = TOOTH_SIGMAS * lines.frequency_std_hz
    least_hz = TOOTH * lines.resolution_hz
    return np.asarray(np.clip(own_hz, least_hz, TOOTH_SHARE * spacing_hz))


def _parts(frequency_hz: FloatArray, spacing_hz: float, offset_hz: float) -> int:
    """Return into how many parts the spacing is to be divided: 1 unless lines ask it.

    Of the lines between the teeth so many lie near the teeth of a part as lines at
    random would not (a binomial: the reach of all teeth covers a fixed share).
    """
    _, miss_hz = _nearest(frequency_hz, spacing_hz, offset_hz)
    between = frequency_hz[np.abs(miss_hz) > TOOTH_SHARE * spacing_hz]
    count = between.size
    for parts in range(2, MOST_PARTS + 1):
        part_hz = spacing_hz / parts
        _, miss_hz = _nearest(between, part_hz, offset_hz)
        hits = int((np.abs(miss_hz) <= TOOTH_SHARE * part_hz).sum())
        share = BETWEEN_SHARE
        chance = sum(
            comb(count, k) * share**k * (1.0 - share) ** (count - k) for k in range(hits, count + 1)
        )
        if chance <= PART_CHANCE:
            return parts
    return 1


def _fitted(
    tooth: IntArray, frequency_hz: FloatArray, std_hz: FloatArray, *, is_harmonic: bool
) -> tuple[float, float, float]:
    """Return spacing, its deviation, and offset; an offset that is none is 0."""
    design = tooth[:, None].astype(float)
    if not is_harmonic:
        design = np.hstack([design, np.ones_like(design)])
    values, covariance = _least_squares(design, frequency_hz, std_hz)
    spacing, std = float(values[0]), float(np.sqrt(covariance[0, 0]))
    if is_harmonic:
        return spacing, std, 0.0
    order = round(values[1] / spacing)
    lever = np.array([-order, 1.0])
    left_std = float(np.sqrt(lever @ covariance @ lever))
    left = abs(float(lever @ values))
    if left <= TOOTH_SIGMAS * left_std < OPEN_OFFSET * spacing:
        return _fitted(tooth + order, frequency_hz, std_hz, is_harmonic=True)
    return spacing, std, float(values[1])


def _least_squares(
    design: FloatArray, frequency_hz: FloatArray, std_hz: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted least squares with a shared variance, and their covariance."""
    n_free = len(frequency_hz) - design.shape[1]

    def solve(shared: float) -> tuple[FloatArray, FloatArray, float]:
        weight = 1.0 / (std_hz**2 + shared)
        covariance = np.linalg.pinv(design.T @ (weight[:, None] * design))
        values = covariance @ (design.T @ (weight * frequency_hz))
        chi2 = float((weight * (frequency_hz - design @ values) ** 2).sum())
        return values, covariance, chi2

    values, covariance, chi2 = solve(0.0)
    if n_free < 1 or chi2 <= n_free:
        return values, covariance
    low, high = 0.0, float((std_hz**2).max()) * chi2 / n_free
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solve(middle)[2] > n_free else (low, middle)
    values, covariance, _ = solve(high)
    return values, covariance


def standing_multiple(tooth: IntArray, level_db: FloatArray) -> int:
    """Return the greatest multiple of teeth with nearly all of the power; 0 for none.

    Examples
    --------
    >>> standing_multiple(np.array([4, 5, 8, 12]), np.array([30.0, 2.0, 25.0, 20.0]))
    4
    """
    power = 10 ** (level_db / 10)
    for multiple in range(MOST_BLADES, 1, -1):
        own = tooth % multiple == 0
        if own.sum() >= 3 and power[own].sum() >= BLADE_SHARE * power.sum():
            return multiple
    return 0


PATH_CHOICE = 1.0
"""Evidence that noise has in each frame, nepers, because it may choose its path."""

FEWEST_TOGETHER = 3
"""Lines that must move together to be a vessel without a family."""

GREATEST_CHANCE = 0.05
"""Probability in noise alone above which lines are no sign of anything."""

VESSEL_CHANCE = 1e-3
"""Expected number by chance above which a family, or lines that move together, are no
vessel: one in a thousand recordings has one then."""

STEADY = "its lines keep their frequencies: no closest approach within the recording"
MOVING = "its lines move, but as no passage does"
MAINS = "mains of the electronics, no vessel"
NO_FAMILY = "lines without a family or a common motion"
BY_CHANCE = "noise alone gives as many lines of this strength"


@dataclass(frozen=True)
class _Pool:
    """Lines of all trackers, each once."""

    lines: LineSummary
    """The lines."""
    families: list[set[tuple[int, int]]]
    """Families of each line, as tracker and number."""
    chance: FloatArray
    """Probability of each line by chance, shape (line,)."""


@dataclass(frozen=True)
class _Family:
    """A family while it is being put together."""

    spacing_hz: float
    """Distance of neighbouring lines, Hz."""
    offset_hz: float
    """Frequency of the comb below its first spacing, Hz; 0 if it is harmonic."""
    log10_chance: float
    """Logarithm of the probability by chance."""
    rows: IntArray
    """Its lines among those of the pool."""


def tonal_segments(trackers: Sequence[Lines]) -> list[SoundSegment]:
    """Return what the lines of one sensor tell; contacts are the first tracker's."""
    used = [lines for lines in trackers if lines.line_id.size]
    if not used:
        return []
    pool = _pool(used, trackers[0])
    free = np.ones(pool.lines.frequency_hz.size, np.bool_)
    told_hum = pool.lines.status == "hum"
    made = [
        _family_segment(family, pool, free, told_hum) for family in _joined_families(pool, used)
    ]
    found = [one for one in made if one is not None]
    lines = pool.lines
    mains = _mains(lines, free, told_hum)
    is_moving = (lines.status == "moving") & (pool.chance <= GREATEST_CHANCE)
    n_free = np.count_nonzero(free & ~mains & is_moving)
    for contact in np.unique(lines.contact[free & (lines.contact > 0)]).tolist():
        rows: IntArray = np.flatnonzero(free & ~mains & (lines.contact == contact))
        moving = is_moving[rows]
        n_moving = np.count_nonzero(moving)
        joined = chance_together(int(n_moving), int(n_free))
        if n_moving >= FEWEST_TOGETHER and joined <= VESSEL_CHANCE:
            free[rows] = False
            chance = max(joined, float(pool.chance[rows].min()))
            found.append(segment_of_lines(VESSEL, lines.take(rows), chance, MOVING))
    hum = np.flatnonzero(free & mains)
    if hum.size:
        found.append(_hum_segment(lines.take(hum), float(pool.chance[hum].min())))
        free[hum] = False
    certain = free & (pool.chance <= GREATEST_CHANCE)
    for kind, chosen, reason in (
        (LINES, certain, NO_FAMILY),
        (UNKNOWN, free & ~certain, BY_CHANCE),
    ):
        for rows in _at_one_time(lines, np.flatnonzero(chosen)):
            chance = float(pool.chance[rows].min())
            found.append(segment_of_lines(kind, lines.take(rows), chance, reason))
    return found


def chance_together(n_joined: int, n_lines: int) -> float:
    """Return a bound on how many groups of so many lines of all are joined by chance.

    Notes
    -----
    A likelihood ratio exceeds e^x with a probability of at most e^-x where the lines
    have nothing to do with each other (Markov's inequality). To join k of n lines takes
    k - 1 such ratios, and there are "n choose k" ways to choose them.
    """
    if n_joined < 1:
        return 1.0
    return min(1.0, comb(n_lines, n_joined) * exp(-LEAST_EVIDENCE * (n_joined - 1)))


def _mains(lines: LineSummary, free: BoolArray, told_hum: BoolArray) -> BoolArray:
    """Mark the lines of mains: those told, and their harmonics."""
    is_hum: BoolArray = free & told_hum
    for nominal in MAINS_HZ:
        mains = _mains_frequency(lines.take(np.flatnonzero(is_hum)), nominal)
        if mains is not None:
            exact, std = mains
            order = np.rint(lines.frequency_hz / nominal)
            reach = 3.0 * np.hypot(lines.frequency_std_hz, order * std)
            reach = np.maximum(reach, TOOTH * lines.resolution_hz)
            near = np.abs(lines.frequency_hz - order * exact) <= reach
            is_hum = np.logical_or(is_hum, free & (order >= 1) & near)
    return is_hum


def _mains_frequency(hum: LineSummary, nominal: float) -> tuple[float, float] | None:
    """Return the frequency of mains and its deviation, Hz; None without such lines."""
    own = _on_mains(hum.frequency_hz, hum.frequency_std_hz, nominal)
    if not own.any():
        return None
    frequency, std = hum.frequency_hz[own], hum.frequency_std_hz[own]
    order = np.rint(frequency / nominal)
    weight = (order / std) ** 2
    exact = float((weight * frequency / order).sum() / weight.sum())
    return exact, float(1.0 / np.sqrt(weight.sum()))


def _hum_segment(hum: LineSummary, chance: float) -> SoundSegment:
    """Return mains hum, with the frequency of the mains if all lines are of one."""
    made = segment_of_lines(HUM, hum, chance, MAINS)
    for nominal in MAINS_HZ:
        if _on_mains(hum.frequency_hz, hum.frequency_std_hz, nominal).all():
            exact = _mains_frequency(hum, nominal)
            assert exact is not None  # noqa: S101 - all are
            made.spacing_hz, made.spacing_std_hz = exact
            break
    return made


def _on_mains(frequency: FloatArray, std: FloatArray, nominal: float) -> BoolArray:
    """Tell which lines are multiples of mains, within what a grid may be off."""
    order = np.rint(frequency / nominal)
    reach = 3.0 * std + MAINS_TOLERANCE * frequency
    on: BoolArray = (order >= 1) & (np.abs(frequency - order * nominal) <= reach)
    return on


def is_mains_comb(found: LineComb) -> bool:
    """Tell whether a harmonic family has the spacing of mains, or twice that."""
    spacing = np.array([found.spacing_hz])
    orders = [round(found.spacing_hz / nominal) for nominal in MAINS_HZ]
    on = [_on_mains(spacing, np.zeros(1), nominal)[0] for nominal in MAINS_HZ]
    is_near = any(one and order <= 2 for one, order in zip(on, orders, strict=True))
    return found.offset_hz == 0.0 and is_near


def _pool(trackers: Sequence[Lines], main: Lines) -> _Pool:
    parts = [summarise(lines) for lines in trackers]
    chances = [_chances(lines, part) for lines, part in zip(trackers, parts, strict=True)]
    order = [
        (number, row) for number, part in enumerate(parts) for row in range(part.frequency_hz.size)
    ]
    kept: list[tuple[int, int]] = []
    families: list[set[tuple[int, int]]] = []
    chance: list[float] = []
    for number, row in order:
        part = parts[number]
        own = {(number, int(part.family[row]))} if part.family[row] >= 0 else set()
        twin = _twin(parts, kept, number, row)
        if twin is None:
            kept.append((number, row))
            families.append(own)
            chance.append(float(chances[number][row]))
        else:
            families[twin] |= own
            chance[twin] = min(chance[twin], float(chances[number][row]))
    first = np.cumsum([0, *(part.frequency_hz.size for part in parts)])
    rows = np.array([first[number] + row for number, row in kept], np.int64)
    lines = LineSummary.join(parts).take(rows)
    # the coarsest tracker decides, but where rungs are joined each line has its own
    coarsest = max(float(part.resolution_hz.min(initial=np.inf)) for part in parts)
    if np.isfinite(coarsest):
        resolution_hz = np.maximum(lines.resolution_hz, coarsest)
        lines = replace(lines, resolution_hz=resolution_hz)
    is_main = np.array([trackers[n] is main for n, _ in kept], np.bool_)
    contact = np.where(is_main, lines.contact, 0)
    lines = replace(lines, contact=contact, family=np.full(len(kept), -1))
    return _Pool(lines, families, np.array(chance, float))


def _twin(
    parts: Sequence[LineSummary], kept: Sequence[tuple[int, int]], number: int, row: int
) -> int | None:
    """Return the line of an earlier tracker that is the same one."""
    own = parts[number]
    for k, (other, there) in enumerate(kept):
        if other == number:
            continue
        part = parts[other]
        reach = SAME_LINE * max(part.resolution_hz[there], own.resolution_hz[row])
        near = abs(part.frequency_hz[there] - own.frequency_hz[row]) < reach
        together = part.from_s[there] <= own.to_s[row] and own.from_s[row] <= part.to_s[there]
        if near and together:
            return k
    return None


def _chances(lines: Lines, part: LineSummary) -> FloatArray:
    """Return the probability of each line in noise alone."""
    frames = lines.frames
    hours = frames.n_frames * frames.hop_s / 3600.0
    band_hz = 0.5 * frames.sample_rate_hz
    if frames.band_high_hz.size:
        band_hz = float(frames.band_high_hz.max() - frames.band_low_hz.min())
    expected = lines.false_lines_per_khz_hour * band_hz / 1e3 * hours
    any_line = -np.expm1(-expected)
    overlap = lines.overlap_frames
    # as many frames as of this line's length fit into the recording
    n_frames = hours * 3600.0 * overlap * part.resolution_hz
    places = np.maximum(1.0, band_hz / part.resolution_hz * n_frames)
    measured = np.isfinite(lines.measured_snr_db)
    out = np.empty(part.line_id.size)
    for k, name in enumerate(part.line_id):
        points = slice(
            int(np.searchsorted(lines.line, name, "left")),
            int(np.searchsorted(lines.line, name, "right")),
        )
        used = measured[points]
        ratio = 10 ** (float(np.median(lines.measured_snr_db[points][used])) / 10)
        evidence = float(line_evidence(used.sum() / overlap, ratio, PATH_CHOICE))
        log_chance = min(float(np.log(places[k])) - evidence, 0.0)
        out[k] = min(any_line, float(np.exp(max(log_chance, -700.0))))
    return out


def _joined_families(pool: _Pool, trackers: Sequence[Lines]) -> list[_Family]:
    """Join the trackers' families to those of one source, most certain first."""
    keys = sorted(set().union(*pool.families))
    families = []
    for number, row in keys:
        table = trackers[number].families
        rows = [k for k, own in enumerate(pool.families) if (number, row) in own]
        offset = 0.0 if table.is_harmonic[row] else float(table.offset_hz[row])
        families.append(
            _Family(
                float(table.spacing_hz[row]), offset, float(table.log10_chance[row]),
                np.array(rows, np.int64),
            )
        )  # fmt: skip
    families.sort(key=lambda family: family.log10_chance)
    joined: list[_Family] = []
    for family in families:
        for k, other in enumerate(joined):
            spacings_hz = family.spacing_hz, other.spacing_hz
            if is_one_family(spacings_hz, family.rows, other.rows):
                finer = min((other, family), key=lambda one: one.spacing_hz)
                is_harmonic = 0.0 in (other.offset_hz, family.offset_hz)
                offset_hz = 0.0 if is_harmonic else finer.offset_hz
                joined[k] = _Family(
                    finer.spacing_hz, offset_hz, other.log10_chance,
                    np.union1d(other.rows, family.rows),
                )  # fmt: skip
                break
        else:
            joined.append(family)
    return joined


def _family_segment(
    family: _Family, pool: _Pool, free: BoolArray, told_hum: BoolArray
) -> SoundSegment | None:
    """Return a family with what lies on its teeth; None if others have its lines.

    Nor is a family returned that noise or mains give; lines of mains are marked.
    """
    lines = pool.lines
    own = family.rows[free[family.rows]]
    is_chance = family.log10_chance > np.log10(VESSEL_CHANCE)
    if own.size < FEWEST_TOGETHER or is_chance:
        return None
    comb = fit_comb(lines, own, free, family.spacing_hz, family.offset_hz)
    rows = comb.rows
    if is_mains_comb(comb):
        told_hum[rows] = True
    if np.count_nonzero(told_hum[rows]) >= 0.5 * rows.size:
        return None
    free[rows] = False
    moves = np.count_nonzero(lines.status[rows] == "moving") > 0.5 * rows.size
    chance = min(1.0, 10.0 ** max(family.log10_chance, -300.0))
    reason = MOVING if moves else STEADY
    made = segment_of_lines(VESSEL, lines.take(rows), chance, reason)
    made.spacing_hz, made.spacing_std_hz = comb.spacing_hz, comb.spacing_std_hz
    if comb.offset_hz == 0.0:
        blades = standing_multiple(comb.tooth, lines.level_db[rows])
        made.blade_rate_hz = comb.spacing_hz * blades if blades else np.nan
    return made


def _at_one_time(lines: LineSummary, rows: IntArray) -> list[IntArray]:
    """Divide lines into groups between which there is time without any."""
    groups: list[list[int]] = []
    end = -np.inf
    for row in rows[np.argsort(lines.from_s[rows], kind="stable")]:
        if lines.from_s[row] > end or not groups:
            groups.append([])
        groups[-1].append(int(row))
        end = max(end, float(lines.to_s[row]))
    return [np.array(group, np.int64) for group in groups]
