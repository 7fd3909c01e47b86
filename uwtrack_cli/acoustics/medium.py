"""The medium between source and receiver, as every model of motion takes it."""

from dataclasses import dataclass


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
