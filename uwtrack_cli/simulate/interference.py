"""Sound that no vessel makes: mains hum of the electronics, and clicks.

**Method.** Hum is a sum of harmonics of the mains whose frequency may vary; every
channel has its own gains and phases, since it is not sound. A click is a short burst
that decays; it comes from a direction of its own, so that a vector sensor measures a bearing.

**Conventions.** Levels in dB re 1 uPa: root mean square for hum, peak for clicks.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.simulate.frequency_jitter import JitterSeries
from uwtrack_cli.simulate.noise import TILE
from uwtrack_cli.simulate.scenario import Clicks, Hum
from uwtrack_cli.simulate.trajectories import Array

CLICK_SAMPLES = 256


@dataclass(frozen=True)
class HumSound:
    """Mains hum in every channel."""

    plan: Hum
    """Levels of the harmonics."""
    seed: tuple[int, ...]
    """Seed of phases and gains."""
    n_channels: int
    """Number of channels."""
    sample_rate_hz: float
    """Sample rate, Hz."""
    jitter: JitterSeries | None
    """Variation of the mains frequency; None is none."""

    def tile(self, number: int) -> Array:
        """Return the hum during a tile, uPa, shape (sample, channel)."""
        generator = np.random.default_rng(self.seed)
        shape = (len(self.plan.levels_db), self.n_channels)
        phases, gains = generator.random(shape), generator.uniform(0.3, 1.0, shape)
        gains[:, 0] = 1.0
        time_s = np.arange(number * TILE, (number + 1) * TILE) / self.sample_rate_hz
        if self.jitter is not None:
            time_s = time_s + self.jitter.excess_s(time_s)
        total = np.zeros((TILE, self.n_channels))
        for i, level_db in enumerate(self.plan.levels_db):
            cycles = (i + 1) * self.plan.mains_hz * time_s[:, None] + phases[i]
            peak = np.sqrt(2.0) * 10.0 ** (level_db / 20.0) * gains[i]
            total += peak * np.cos(2.0 * np.pi * (cycles - np.floor(cycles)))
        return total


@dataclass
class ClickSound:
    """Clicks in every channel; tiles must be asked for in sequence."""

    plan: Clicks
    """Rate and peak pressure."""
    seed: tuple[int, ...]
    """Seed of times and directions."""
    n_channels: int
    """Number of channels."""
    sample_rate_hz: float
    """Sample rate, Hz."""

    def __post_init__(self) -> None:
        """Start with nothing left over from an earlier tile."""
        self._rest: Array = np.zeros((CLICK_SAMPLES, self.n_channels))
        generator = np.random.default_rng([104, *self.seed])
        burst = generator.standard_normal(CLICK_SAMPLES)
        burst *= np.exp(-np.arange(CLICK_SAMPLES) / 32.0)
        self._burst = burst * 10.0 ** (self.plan.peak_db / 20.0) / abs(burst).max()

    def tile(self, number: int) -> Array:
        """Return the clicks during a tile, uPa, shape (sample, channel)."""
        generator = np.random.default_rng([*self.seed, number])
        mean = self.plan.rate_per_min / 60.0 * TILE / self.sample_rate_hz
        count = generator.poisson(mean)
        begin = generator.integers(0, TILE, count)
        bearing = generator.uniform(0.0, 2.0 * np.pi, count)
        gains = np.stack([np.ones(count), np.sin(bearing), np.cos(bearing)], axis=1)
        total = np.zeros((TILE + CLICK_SAMPLES, self.n_channels))
        total[:CLICK_SAMPLES] = self._rest
        rows = begin[:, None] + np.arange(CLICK_SAMPLES)
        bursts = self._burst[:, None] * gains[:, None, : self.n_channels]
        np.add.at(total, rows, bursts)
        self._rest = total[TILE:].copy()
        return total[:TILE]
