"""Radiated noise levels of passages in decidecade bands.

**Method.** While the vessel is within 30 degrees of its closest approach, the mean square
in each band less that of the background is referred to 1 m by the range at that moment.
The background is that of the sound far from every passage, less what the vessel still adds
there. A band that is less than 3 dB over it is not given. The deviation holds the scatter of the
rows, with its correlation, the scatter of the background and the deviation of the range.

**Conventions.** Spherical spreading unless told; the surface image is part of the level.
One passage, one hydrophone and a depth and range as they happen: not ISO 17208, which asks
for several of each.

**References.** ISO 17208-1 (2016), sections 6 and 7 (data window of 30 degrees, background
of 3 dB); ISO 18405 (2017), 3.3.2.2 (radiated noise level).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import BoolArray, FloatArray, flatten
from uwtrack_cli.data.decidecades import Decidecades, RadiatedLevels
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.spectra import MICROPASCAL
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.options import Spreading

WINDOW = float(np.tan(np.radians(30.0)))
"""Half width of the data window over the range at closest approach."""

FEWEST_ROWS = 3
"""Fewest rows in the data window: from fewer the scatter is not known."""

FAR = 3.0
"""Distance from a closest approach, over its range, beyond which there is background."""

DIRECTIVITY = 0.5
"""Deviation of what a vessel adds to the background far away, over what it should."""

NEAR = 2.0
"""Distance within which another vessel spoils the data window, over its range."""

MOST_BACKGROUND_S = 600.0
"""Time of background that is used, s: the nearest."""

FEWEST_BACKGROUND = 10
"""Fewest rows of background."""

LEAST_EXCESS = 10.0**0.3
"""Least mean square over that of the background (ISO 17208-1: 3 dB)."""

PASSED = frozenset({"ok", "extrapolated"})
"""Status of encounters whose range and speed are known."""

TOO_WEAK = "less than 3 dB over the background"


@checked
def estimate_radiated_levels(
    decidecades: list[Decidecades], encounters: list[Encounters], *, spreading_db: Spreading = 20.0
) -> RadiatedLevels:
    """Estimate the radiated noise level of each passage in decidecade bands.

    Only calibrated recordings have such levels. They come from one passage past one
    hydrophone, and do not conform to ISO 17208.

    Parameters
    ----------
    decidecades
        Levels of the sound in decidecade bands.
    encounters
        Closest approaches.
    spreading_db
        Loss of level per decade of range, in dB; 20 is that of the definition.

    Returns
    -------
    RadiatedLevels
        One row per passage and band; none of a recording that is not calibrated.

    Raises
    ------
    DataError
        There are no levels of a sensor that has closest approaches.
    OptionError
        ``spreading_db`` is out of range.

    Notes
    -----
    S = mean((p^2 - B) r^s) over the window with r^2 = d^2 + v^2 (t - t0)^2, and B the mean of
    p^2 - S / r^s far from every passage.
    """
    known = [one for one in decidecades if one.reference == MICROPASCAL]
    passages = [
        _Passage.of(table, row)
        for table in encounters
        for row in range(table.n_encounters)
        if np.isfinite(table.range_over_speed_s[row])
    ]
    parts = [
        _bands(passage, _levels_of(passage, known), passages, spreading_db)
        for passage in passages
        if known and passage.status in PASSED
    ]
    return _joined(parts, spreading_db)


@dataclass(frozen=True)
class _Passage:
    """What the levels need to know of an encounter."""

    contact: int
    """Number of the contact."""
    sensor: str
    """Name of the sensor."""
    status: str
    """How far the encounter is known."""
    time_utc_ns: int
    """Closest approach, ns since 1970-01-01 UTC; -1 if unknown."""
    start_utc_ns: int | None
    """First sample of its recording."""
    arrival_s: float
    """Arrival of the sound of the closest approach, s."""
    width_s: float
    """Range over speed, s."""
    range_m: float
    """Slant range there, m."""
    range_std_m: float
    """Its standard deviation, m."""

    @classmethod
    def of(cls, table: Encounters, row: int) -> "_Passage":
        utc_ns, time_s = int(table.time_utc_ns[row]), float(table.time_s[row])
        start = None if utc_ns < 0 else utc_ns - round(time_s * NANOSECONDS)
        return cls(
            int(table.contact[row]), str(table.sensor[row]), str(table.status[row]),
            utc_ns, start, float(table.arrival_time_s[row]),
            float(table.range_over_speed_s[row]), float(table.slant_range_m[row]),
            float(table.slant_range_std_m[row]),
        )  # fmt: skip

    def is_in(self, levels: Decidecades) -> bool:
        """Tell whether the passage is of the sound of these levels."""
        if levels.sensor != self.sensor:
            return False
        if None in (levels.start_utc_ns, self.start_utc_ns):
            return True
        apart_ns = (levels.start_utc_ns or 0) - (self.start_utc_ns or 0)
        return abs(apart_ns) < NANOSECONDS

    def distance(self, time_s: FloatArray) -> FloatArray:
        """Return the distance from the closest approach, in ranges."""
        return np.asarray(np.abs(time_s - self.arrival_s) / self.width_s)


@dataclass(frozen=True)
class _Bands:
    """Levels of a passage in all bands; arrays of shape (band,)."""

    passage: _Passage
    """The passage."""
    centre_hz: FloatArray
    """Centre frequencies, Hz."""
    level_db: FloatArray
    """Radiated noise levels, dB."""
    std_db: FloatArray
    """Their standard deviations, dB."""
    received_db: FloatArray
    """Received levels, dB."""
    background_db: FloatArray
    """Levels of the background, dB."""
    reasons: list[str]
    """Why a band has no level; empty where it has."""


def _levels_of(passage: _Passage, levels: list[Decidecades]) -> Decidecades:
    for one in levels:
        if passage.is_in(one):
            return one
    raise DataError(
        f"there are no levels in decidecade bands of sensor {passage.sensor!r} for its "
        f"contact {passage.contact}; they are of: "
        f"{', '.join(sorted({one.sensor for one in levels}))}."
    )


def _bands(
    passage: _Passage, levels: Decidecades, passages: list[_Passage], spreading_db: float
) -> _Bands:
    time_s = levels.time_s
    power = 10.0 ** (0.1 * levels.level_db.astype(float))
    has_sound = np.isfinite(power).all(axis=1)
    others = [p for p in passages if p is not passage and p.is_in(levels)]
    window = has_sound & (passage.distance(time_s) <= WINDOW)
    far = has_sound & (passage.distance(time_s) >= FAR)
    for other in others:
        far &= other.distance(time_s) >= FAR
    far = _nearest(far, np.abs(time_s - passage.arrival_s), levels.average_s)
    nothing = np.full(levels.centre_hz.size, np.nan)
    received = power[window].mean(axis=0) if window.any() else nothing
    reason = _unfit(passage, time_s, window, far, others, levels.average_s)
    if reason:
        return _Bands(
            passage, levels.centre_hz, nothing, nothing, _db(received), nothing,
            [reason] * nothing.size,
        )  # fmt: skip
    ratio = np.hypot(1.0, passage.distance(time_s)) * passage.range_m
    gain = (ratio ** (spreading_db / 10.0))[:, None]
    background = np.median(power[far], axis=0)
    for _ in range(3):
        source = ((power[window] - background) * gain[window]).mean(axis=0)
        source = np.maximum(source, 0.0)
        rest = power[far] - source / gain[far]
        background = np.maximum(rest.mean(axis=0), 0.0)
    rows = (power[window] - background) * gain[window]
    added = DIRECTIVITY * (source / gain[far]).mean(axis=0)
    background_std = np.hypot(_std_of_mean(rest), added)
    std = np.hypot(_std_of_mean(rows), background_std * gain[window].mean())
    is_loud = received >= LEAST_EXCESS * background
    safe = np.where(is_loud, source, np.nan)
    to_db = 10.0 / np.log(10.0)
    range_db = spreading_db / np.log(10.0) * passage.range_std_m / passage.range_m
    return _Bands(
        passage, levels.centre_hz, _db(safe), np.hypot(to_db * std / safe, range_db),
        _db(received), _db(background),
        ["" if loud else TOO_WEAK for loud in is_loud],
    )  # fmt: skip


def _unfit(
    passage: _Passage,
    time_s: FloatArray,
    window: BoolArray,
    far: BoolArray,
    others: list[_Passage],
    average_s: float,
) -> str:
    """Return why a passage has no levels in any band, nothing if it has."""
    if not np.isfinite(passage.range_m):
        return "the range is not known"
    begin, end = passage.arrival_s + WINDOW * passage.width_s * np.array([-1.0, 1.0])
    if not time_s.size or begin < time_s[0] - average_s or end > time_s[-1] + average_s:
        return "the closest approach is not whole in the recording"
    if window.sum() < FEWEST_ROWS:
        return (
            f"the vessel was within 30 degrees for {end - begin:.2g} s, less than "
            f"{FEWEST_ROWS} rows of {average_s:g} s"
        )
    near = [p for p in others if (p.distance(time_s[window]) < NEAR).any()]
    if near:
        return f"contact {near[0].contact} passes at the same time"
    if far.sum() < FEWEST_BACKGROUND:
        return "there is no sound without a vessel nearby for the background"
    return ""


def _nearest(far: BoolArray, away_s: FloatArray, average_s: float) -> BoolArray:
    """Keep of the rows of background those nearest in time."""
    rows = np.flatnonzero(far)
    most = max(int(MOST_BACKGROUND_S / average_s), FEWEST_BACKGROUND)
    kept = np.zeros_like(far)
    kept[rows[np.argsort(away_s[rows], kind="stable")[:most]]] = True
    return kept


def _std_of_mean(rows: FloatArray) -> FloatArray:
    """Return the deviation of the mean of correlated rows, shape (band,)."""
    centred = rows - rows.mean(axis=0)
    n = rows.shape[0]
    variance = (centred**2).sum(axis=0) / (n - 1)
    product = (centred[1:] * centred[:-1]).sum(axis=0) / (n - 1)
    share = np.clip(product / np.maximum(variance, 1e-300), 0.0, 0.95)
    count = np.maximum(n * (1.0 - share) / (1.0 + share), 1.0)
    return np.asarray(np.sqrt(variance / count))


def _db(power: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.where(power > 0.0, 10.0 * np.log10(np.maximum(power, 1e-300)), np.nan)


def _joined(parts: list[_Bands], spreading_db: float) -> RadiatedLevels:
    def column(name: str) -> FloatArray:
        return np.concatenate([np.zeros(0), *(getattr(part, name) for part in parts)])

    counts = [part.centre_hz.size for part in parts]
    reasons = [text for part in parts for text in part.reasons]
    owner, texts = flatten([text] if text else [] for text in reasons)
    return RadiatedLevels(
        contact=np.repeat(np.array([p.passage.contact for p in parts], np.int64), counts),
        sensor=np.repeat(np.array([p.passage.sensor for p in parts], np.str_), counts),
        time_utc_ns=np.repeat(np.array([p.passage.time_utc_ns for p in parts], np.int64), counts),
        centre_hz=column("centre_hz"),
        radiated_noise_level_db=column("level_db"),
        radiated_noise_level_std_db=column("std_db"),
        received_level_db=column("received_db"),
        background_level_db=column("background_db"),
        reason_level=owner,
        reason_key=np.array(["radiated_noise_level_db"] * len(texts), np.str_),
        reason_text=np.array(texts, np.str_),
        spreading_db=spreading_db,
        reference=MICROPASCAL,
    )
