"""A segment while it is being filled in, and the table of all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import flatten, reason_columns
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.presence.line_summary import LineSummary, common_bearing

NUMBERS = (
    "from_s", "to_s", "spacing_hz", "spacing_std_hz", "blade_rate_hz", "level_db",
    "bearing_deg", "bearing_std_deg", "probability_of_chance", "motion_model_probability",
    "alternative_motion_model_probability",
)  # fmt: skip
"""Columns of `Presence` that are numbers of a segment."""

MISSING: Mapping[str, str] = {
    "spacing_hz": "no harmonic family",
    "blade_rate_hz": "no multiple of a spacing or rate stands out",
    "level_db": "the rates of an envelope have no level",
    "bearing_deg": "no bearing channel, or no bearing that stands out",
    "probability_of_chance": "it was not tested against noise",
    "motion_model_probability": "its lines have no motion model in common",
}
"""Why a number is missing where nothing more is known."""


@dataclass
class SoundSegment:
    """What was detected between two times."""

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
    motion_model: str = ""
    """Motion model of its contacts; empty if they have none in common."""
    motion_model_probability: float = np.nan
    """Probability of that motion model."""
    alternative_motion_model: str = ""
    """The next motion model; empty if it has less than 5 %."""
    alternative_motion_model_probability: float = np.nan
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

    def read_as(self, name: str, probability: float, other: str, rest: float) -> None:
        """Take a motion model and its probability, and the same of the next one."""
        self.motion_model, self.motion_model_probability = name, probability
        self.alternative_motion_model = other
        self.alternative_motion_model_probability = rest

    def overlaps(self, from_s: float, to_s: float) -> bool:
        """Tell whether it shares time with another segment."""
        return self.from_s <= to_s and from_s <= self.to_s

    def reasons(self) -> dict[str, str]:
        """Return why values are missing, by key."""
        found = {} if self.encounter else {"encounter": self.reason}
        found |= {
            name: text for name, text in MISSING.items() if not np.isfinite(getattr(self, name))
        }
        if why := found.get("motion_model_probability"):
            found["motion_model"] = why
        return found


def segment_of_lines(kind: str, tones: LineSummary, chance: float, reason: str) -> SoundSegment:
    """Return the segment of lines, its chance in noise and why it is no passage."""
    made = SoundSegment(kind, np.nan, np.nan, probability_of_chance=chance, reason=reason)
    made.hold(tones)
    return made


def make_presence(
    segments: Mapping[str, Sequence[SoundSegment]],
    start_utc_ns: Mapping[str, int | None],
    reference: str,
) -> Presence:
    """Gather the segments of every sensor into the container, in the order of time.

    The first sample of a sensor may have an UTC epoch, ns.
    """
    pairs = [(sensor, one) for sensor, own in segments.items() for one in own]
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
        motion_model=np.array([one.motion_model for one in rows], np.str_),
        alternative_motion_model=np.array([one.alternative_motion_model for one in rows], np.str_),
        from_utc_ns=np.array(utc([one.from_s for one in rows]), np.int64),
        to_utc_ns=np.array(utc([one.to_s for one in rows]), np.int64),
        n_lines=np.array([len(one.frequencies_hz) for one in rows], np.int64),
        frequency_segment=line_owner,
        frequency_hz=np.array(frequencies, float),
        rate_segment=rate_owner,
        rate_hz=np.array(rates, float),
        **reason_columns("reason_segment", [one.reasons() for one in rows]),
        reference=reference,
    )
