"""A stretch while it is being filled in, and the table of all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import flatten, reason_columns
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.presence.line_summary import LineSummary, common_bearing

NUMBERS = (
    "from_s", "to_s", "spacing_hz", "spacing_std_hz", "blade_rate_hz", "level_db",
    "bearing_deg", "bearing_std_deg", "probability_of_chance", "reading_weight",
    "rival_weight",
)  # fmt: skip
"""Columns of `Presence` that are numbers of a stretch."""

MISSING: Mapping[str, str] = {
    "spacing_hz": "no harmonic family",
    "blade_rate_hz": "no multiple of a spacing or rate stands out",
    "level_db": "the rates of an envelope have no level",
    "bearing_deg": "no bearing channel, or no bearing that stands out",
    "probability_of_chance": "it was not tested against noise",
    "reading_weight": "its lines have no motion model in common",
}
"""Why a number is missing where nothing more is known."""


@dataclass
class Stretch:
    """What was heard between two times."""

    kind: str
    """One of the kinds of `Presence`."""
    from_s: float
    """Begin, s."""
    to_s: float
    """End, s."""
    contact: int = 0
    """Contact of its lines; 0 for none."""
    encounter: int = 0
    """Contact of its closest approach; 0 for none."""
    spacing_hz: float = np.nan
    """Spacing of its family, Hz."""
    spacing_std_hz: float = np.nan
    """Standard deviation of the spacing, Hz."""
    blade_rate_hz: float = np.nan
    """Multiple that stands out, Hz."""
    level_db: float = np.nan
    """Level, dB."""
    bearing_deg: float = np.nan
    """Mean bearing, degrees."""
    bearing_std_deg: float = np.nan
    """Spread of the bearings, degrees."""
    probability_of_chance: float = np.nan
    """Probability in noise alone."""
    tones: LineSummary | None = None
    """Its lines; None where no line tells of it."""
    rates_hz: list[float] = field(default_factory=list)
    """Modulation rates, Hz."""
    reading: str = ""
    """What its contacts are read as; empty if they are not read as one."""
    reading_weight: float = np.nan
    """Probability of that reading."""
    rival: str = ""
    """The next reading; empty if it has less than 5 %."""
    rival_weight: float = np.nan
    """Probability of that one."""
    reason: str = ""
    """Why it is no closest approach; empty where it is one."""

    @property
    def frequencies_hz(self) -> list[float]:
        """Frequencies of its lines, Hz."""
        return [] if self.tones is None else [float(f) for f in self.tones.frequency_hz]

    @property
    def contacts(self) -> set[int]:
        """All contacts that its lines were given by their tracker."""
        given = [] if self.tones is None else self.tones.contact.tolist()
        return {contact for contact in given if contact > 0}

    def hold(self, tones: LineSummary) -> None:
        """Take lines for its own, with their times, level, bearing and contact."""
        self.tones = tones
        self.from_s, self.to_s = float(tones.from_s.min()), float(tones.to_s.max())
        self.level_db = float(10 * np.log10((10 ** (tones.level_db / 10)).sum()))
        every = np.arange(tones.frequency_hz.size)
        self.bearing_deg, self.bearing_std_deg = common_bearing(tones, every)
        given = tones.contact[tones.contact > 0].tolist()
        self.contact = max(set(given), key=given.count) if given else 0

    def read_as(
        self, reading: str, weight: float, rival: str, rival_weight: float
    ) -> None:
        """Take a reading, its probability, and the same of its rival."""
        self.reading, self.reading_weight = reading, weight
        self.rival, self.rival_weight = rival, rival_weight

    def overlaps(self, from_s: float, to_s: float) -> bool:
        """Tell whether it shares time with another stretch."""
        return self.from_s <= to_s and from_s <= self.to_s

    def reasons(self) -> dict[str, str]:
        """Return why values are missing, by key."""
        found = {} if self.encounter else {"encounter": self.reason}
        found |= {
            name: text
            for name, text in MISSING.items()
            if not np.isfinite(getattr(self, name))
        }
        if "reading_weight" in found:  # under the keys of the object of a row
            why = found.pop("reading_weight")
            found |= {"motion_model": why, "motion_model_probability": why}
        return found


def stretch_of_lines(
    kind: str, tones: LineSummary, chance: float, reason: str
) -> Stretch:
    """Return the stretch of lines, its chance in noise and why it is no passage."""
    made = Stretch(kind, np.nan, np.nan, probability_of_chance=chance, reason=reason)
    made.hold(tones)
    return made


def make_presence(
    stretches: Mapping[str, Sequence[Stretch]],
    start_utc_ns: Mapping[str, int | None],
    reference: str,
) -> Presence:
    """Gather the stretches of every sensor into the container, in the order of time.

    The first sample of a sensor may have an UTC epoch, ns.
    """
    pairs = [(sensor, one) for sensor, own in stretches.items() for one in own]
    pairs.sort(key=lambda pair: (pair[1].from_s, pair[1].to_s))
    rows = [one for _, one in pairs]
    starts = [start_utc_ns.get(sensor) for sensor, _ in pairs]

    def utc(times_s: Sequence[float]) -> list[int]:
        return [
            -1 if start is None else start + round(float(time) * NANOSECONDS)
            for start, time in zip(starts, times_s, strict=True)
        ]

    line_owner, frequencies = flatten(sorted(one.frequencies_hz) for one in rows)
    rate_owner, rates = flatten(sorted(one.rates_hz) for one in rows)
    return Presence(
        **{name: np.array([getattr(r, name) for r in rows], float) for name in NUMBERS},
        contact=np.array([one.contact for one in rows], np.int64),
        encounter=np.array([one.encounter for one in rows], np.int64),
        sensor=np.array([sensor for sensor, _ in pairs], np.str_),
        kind=np.array([one.kind for one in rows], np.str_),
        reading=np.array([one.reading for one in rows], np.str_),
        rival=np.array([one.rival for one in rows], np.str_),
        from_utc_ns=np.array(utc([one.from_s for one in rows]), np.int64),
        to_utc_ns=np.array(utc([one.to_s for one in rows]), np.int64),
        n_lines=np.array([len(one.frequencies_hz) for one in rows], np.int64),
        frequency_stretch=line_owner,
        frequency_hz=np.array(frequencies, float),
        rate_stretch=rate_owner,
        rate_hz=np.array(rates, float),
        **reason_columns("reason_stretch", [one.reasons() for one in rows]),
        reference=reference,
    )
