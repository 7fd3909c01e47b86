"""The medium between source and receiver: sound speed, depths, loss of level.

**Conventions.** The law of spreading is its loss in dB per decade of range: 20 in free
water, 10 in a layer that keeps all sound, 15 a usual compromise. Levels at the source
are at 1 m. Absorption is left out: at 1 kHz it is below 0.1 dB per km.

**References.** Urick (1983), Principles of Underwater Sound, section 5.2.
"""

from dataclasses import dataclass

import numpy as np

AIR_MPS = (250.0, 450.0)
"""Sound speeds of air."""

WATER_MPS = (1300.0, 1700.0)
"""Sound speeds of water."""


@dataclass(frozen=True)
class Medium:
    """Sound speed and depths that a passage or a target is modelled with."""

    sound_speed_mps: float
    """Sound speed, m/s."""
    height_m: float = 0.0
    """Depth of the sensor below the source, m; 0 where it is unknown."""
    is_delayed: bool = True
    """Whether sound takes its time; else it arrives at once."""
    height_std_m: float = 0.0
    """Deviation of the prior of `height_m`, m; 0 means known exactly."""
    most_m: float = float("inf")
    """Largest depth difference, m: that of a source at the surface."""

    @property
    def slowness_spm(self) -> float:
        """Inverse sound speed, s/m; 0 for sound that arrives at once."""
        return 1.0 / self.sound_speed_mps if self.is_delayed else 0.0

    @property
    def is_air(self) -> bool:
        """Whether this is air: there vehicles pass, whose engines are no steady ones."""
        return AIR_MPS[0] < self.sound_speed_mps < AIR_MPS[1]

    @property
    def is_water(self) -> bool:
        """Whether this is water, in which nothing is as fast as in air."""
        return WATER_MPS[0] < self.sound_speed_mps < WATER_MPS[1]


def spreading_loss_db(
    range_m: float, range_std_m: float, spreading_db: float
) -> tuple[float, float]:
    """Return the loss from 1 m to a slant range, and its deviation, in dB.

    The law is the loss per decade of range.

    Examples
    --------
    >>> loss, std = spreading_loss_db(100.0, 1.0, 20.0)
    >>> round(loss, 6), round(std, 4)
    (40.0, 0.0869)
    """
    loss = spreading_db * float(np.log10(range_m))
    return loss, spreading_db / float(np.log(10.0)) * range_std_m / range_m
