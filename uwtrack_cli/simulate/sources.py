"""What sounds: a vessel with its lines, its broadband sound, and its way.

**Conventions.** Levels in dB re 1 uPa (at 1 m for a source); C/N0 in dB-Hz and the
in-band ratio in dB hold at closest approach against the ambient noise.
"""

from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.table import exactly_one, fact
from uwtrack_cli.simulate.ways import ClosestApproach, Track, Turn, check_turns

RAMP_S = 5.0
"""Time in which a vessel's sound rises and falls at the ends of ``sounding_s``."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A tone, or a fundamental with harmonics (each weaker by a fixed step)."""

    frequency_hz: float | None = fact(None, low=0.1)
    fundamental_hz: float | None = fact(None, low=0.1)
    harmonics: int = fact(1, low=1, high=1000)
    step_db: float = fact(0.0, low=-60.0, high=60.0)
    cn0_db_hz: float | None = fact(None, low=-60.0, high=150.0)
    source_level_db: float | None = fact(None, low=-100.0, high=300.0)

    def __post_init__(self) -> None:
        """Refuse a line without frequency or level, or with two of one."""
        exactly_one(self, "frequency_hz", "fundamental_hz")
        exactly_one(self, "cn0_db_hz", "source_level_db")
        if self.frequency_hz is not None and self.harmonics > 1:
            msg = "harmonics go with fundamental_hz, not with frequency_hz."
            raise OptionError(msg)


@dataclass(frozen=True, kw_only=True)
class Wander:
    """Fractional wander of the shaft speed, shared by all lines of a vessel."""

    fraction: float = fact(0.0, low=0.0, high=0.05)
    correlation_s: float = fact(20.0, low=1.0, high=1e5)


@dataclass(frozen=True, kw_only=True)
class Broadband:
    """Gaussian noise of the vessel in a band, from its ratio or its source level."""

    band_hz: tuple[float, float] = fact(low=0.0)
    snr_db: float | None = fact(None, low=-100.0, high=100.0)
    source_level_db: float | None = fact(None, low=-100.0, high=300.0)
    slope_db_per_decade: float = fact(0.0, low=-60.0, high=60.0)

    def __post_init__(self) -> None:
        """Refuse an empty band and a level given twice or not at all."""
        exactly_one(self, "snr_db", "source_level_db")
        if not self.band_hz[0] < self.band_hz[1]:
            msg = f"band_hz must rise from low to high, got {list(self.band_hz)}."
            raise OptionError(msg)


@dataclass(frozen=True, kw_only=True)
class Vessel:
    """A sound source on the move; ratios hold at its closest approach.

    It sounds at all times, or between the two times of ``sounding_s`` (at the source),
    with ramps of `RAMP_S` at both ends.
    """

    name: str = fact("")
    source_depth_m: float = fact(SOURCE_DEPTH_M, low=0.0, high=12e3)
    surface_image: float = fact(0.0, low=0.0, high=1.0)
    spreading_db_per_decade: float = fact(20.0, low=0.0, high=60.0)
    closest_approach: ClosestApproach | None = None
    track: Track | None = None
    turns: tuple[Turn, ...] = fact((), key="turn")
    lines: tuple[Line, ...] = fact((), key="line")
    wander: Wander = field(default=Wander())
    broadband: Broadband | None = None
    sounding_s: tuple[float, float] | None = fact(None)

    def __post_init__(self) -> None:
        """Refuse a vessel whose way is open or given twice."""
        exactly_one(self, "closest_approach", "track")
        if self.closest_approach is None and self.turns:
            msg = "turns of a vessel with a track belong into its track."
            raise OptionError(msg)
        if self.closest_approach is not None:
            check_turns(self.turns, self.closest_approach.time_s)
        if self.sounding_s and np.diff(self.sounding_s) < 2.0 * RAMP_S:
            msg = f"sounding_s must last {2.0 * RAMP_S:g} s or more."
            raise OptionError(msg)
