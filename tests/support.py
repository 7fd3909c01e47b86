"""What several tests need: recordings made of arrays."""

from collections.abc import Iterator

import numpy as np

from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor

DIFAR = Sensor(id="h1", kind="difar", channels="omni,east,north")
OMNI = Sensor(id="h1")


def recording_of(
    samples: np.ndarray, rate_hz: float, sensor: Sensor = OMNI, block: int | None = None
) -> Recording:
    """A recording that reads from memory, in blocks of any size."""
    table = np.asarray(samples, np.float32).reshape(len(samples), -1)

    def reader(n_samples: int) -> Iterator[Samples]:
        step = block or n_samples
        for start in range(0, len(table), step):
            yield table[start : start + step]

    return Recording(
        sensor=sensor,
        name="memory.wav",
        sample_rate_hz=rate_hz,
        n_samples=len(table),
        n_channels=table.shape[1],
        reader=reader,
    )


def white_noise(n: int, seed: int, density: float = 1.0, rate_hz: float = 4000.0):
    """White noise of a one-sided power density."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal(n) * np.sqrt(density * rate_hz / 2.0)
