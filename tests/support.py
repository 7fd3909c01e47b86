"""What several tests need: recordings of arrays, exact intervals of counts, our modules."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.stats import beta, chi2

import uwtrack_cli
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


def binomial_interval(hits: int, count: int) -> tuple[float, float]:
    """Exact 95 % interval of a share (Clopper and Pearson 1934)."""
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return float(low), float(high)


def poisson_interval(count: int) -> tuple[float, float]:
    """Exact 95 % interval of the mean of a Poisson count (Garwood 1936)."""
    low = 0.5 * chi2.ppf(0.025, 2 * count) if count else 0.0
    return float(low), float(0.5 * chi2.ppf(0.975, 2 * count + 2))


@functools.cache
def package_modules() -> dict[Path, ast.Module]:
    """Every module of the package as a tree, by its place below the package."""
    package = Path(uwtrack_cli.__file__).parent
    return {
        path.relative_to(package): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(package.rglob("*.py"))
    }


def cells_of(ax):
    """Return the edges in time and frequency, and the levels, of a panel's picture."""
    (image,) = ax.images
    left, right, low, high = image.get_extent()
    levels = image.get_array()
    space = np.linspace
    if ax.get_yscale() == "log":
        (low, high), space = ax.get_ylim(), np.geomspace
    rows, columns = levels.shape
    return (np.linspace(left, right, columns + 1), space(low, high, rows + 1), levels)
