"""Rate of directions in noise, and how many directions noise fills at which height.

`python -m studies.constants.directions [FRAMES [SEED]]` prints for each array and kind of noise the
frames in which noise has a direction at rates of 0.1 and 0.01, over what is stated, with the
interval of 95 % (Clopper & Pearson); then how many directions noise fills at the height of 0.1,
and at those of 0.3, 0.2, 0.02 and 0.01 over that. `FILLED_AT` and `GROWTH` of
`uwtrack_cli.arrays.broadband_directions` are from these columns (8192 frames, seeds 101 and 202).
"""

import sys

import numpy as np
from scipy.special import gammaincc
from scipy.stats import beta

from uwtrack_cli.arrays.broadband_directions import BIN_CORRELATION, DirectionSearch
from uwtrack_cli.arrays.direction_grid import SpatialArray
from uwtrack_cli.arrays.steering import Steering

SQUARE = np.array([[0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, 0.5, 0], [-0.5, -0.5, 0]])
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 8.0**0.5
WIDE = np.array([[0, 0, 0], [34.09, 122.52, 0], [154.72, 22.47, 0], [77.36, 33.49, 0]])

HOUSE = np.array([[0, 0, 0], [0.8, 0, 0.1], [0.1, 0.9, 0], [0, 0.2, 0.7], [0.6, 0.6, 0.5]])
RING = np.array([[np.cos(a), np.sin(a), 0] for a in 2.0 * np.pi * np.arange(6) / 6.0])

SCENES = (
    ("square", SQUARE, 1500.0, (60.0, 700.0), 1.0, 1600.0),
    ("tetrahedron", TETRAHEDRON, 1500.0, (60.0, 900.0), 1.0, 2000.0),
    ("wide plane", WIDE, 345.0, (1.0, 5.0), 20.0, 100.0),
    ("five in a volume", HOUSE, 1500.0, (100.0, 600.0), 0.5, 1400.0),
    ("ring of six", RING, 1500.0, (100.0, 500.0), 0.5, 1200.0),
)
"""Name, places, sound speed, band, window and sample rate."""

AT_ONCE = 32
"""Frames of a block."""


def heights(
    places: np.ndarray, speed_mps: float, band_hz: tuple[float, float], window_s: float,
    rate_hz: float, share: float, n_frames: int, seed: int,
) -> tuple[np.ndarray, dict[float, np.ndarray], int]:  # fmt: skip
    """Return the highest sum of every frame of noise, the thresholds, and the bins.

    The sound of every frame is drawn in time, and weighted by the window.
    """
    rng = np.random.default_rng(seed)
    array = SpatialArray(places, speed_mps)
    grid = array.grid(band_hz[1])
    n = round(window_s * rate_hz)
    frequency_hz = np.fft.rfftfreq(n, 1.0 / rate_hz)
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    searches = {p: DirectionSearch(array, grid, frequency_hz[inside], p) for p in (0.1, 0.01)}
    turns = Steering(frequency_hz[inside], array.lead_s(grid.toward))
    mixed = (1.0 - share) * np.eye(len(places)) + share * array.isotropic_coherence(
        frequency_hz[inside]
    )
    root, alive = np.linalg.cholesky(mixed), np.ones(len(places), np.bool_)
    best: list[np.ndarray] = []
    limits: dict[float, list[float]] = {p: [] for p in searches}
    for _ in range(n_frames // AT_ONCE):
        noise = rng.standard_normal((AT_ONCE, len(places), n)) * np.hanning(n)
        spectra = np.fft.rfft(noise, axis=2)[:, :, inside].transpose(2, 1, 0)
        spectra = (root @ spectra).astype(np.complex64)
        height, _, seen = searches[0.1]._heights(spectra, turns, alive)  # noqa: SLF001
        best.append(searches[0.1]._best(height))  # noqa: SLF001
        for p, search in searches.items():
            limits[p] += AT_ONCE * [search._threshold(turns, alive, seen)]  # noqa: SLF001
    thresholds = {p: np.array(values) for p, values in limits.items()}
    return np.concatenate(best), thresholds, int(inside.sum())


def main(n_frames: int = 8192, seed: int = 1) -> None:
    """Print rates over stated ones, and the directions that noise fills."""
    for name, *scene in SCENES:
        for share in (0.0, 0.5, 0.95):
            best, limits, n_bins = heights(*scene, share, n_frames, seed)
            rates = [rate(int((best > limits[p]).sum()), best.size, p) for p in limits]
            law = gammaincc(n_bins / BIN_CORRELATION, np.maximum(best, 0.0) / BIN_CORRELATION)
            shares = (0.1, 0.3, 0.2, 0.02, 0.01)
            filled = [-np.log1p(-p) / np.quantile(law, p) for p in shares]
            over = [f"{one / filled[0]:.2f}" for one in filled[1:]]
            print(name, share, *rates, "directions", round(filled[0], 1),
                  "times", *over, flush=True)  # fmt: skip


def rate(count: int, n_frames: int, stated: float) -> str:
    """Return counts, and the rate over the stated one with its interval."""
    low = beta.ppf(0.025, count, n_frames - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, n_frames - count)
    share = count / n_frames / stated
    return f"{count} at {stated}: {share:.2f} ({low / stated:.2f}-{high / stated:.2f})"


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
