"""Where the gain of fringes comes from: drawn parts of a band, with a reflection and without.

Draws eight parts of a band about a rise, in noise of 30 to 120 cells a level: a passage
without an image, one whose parts wander by a decibel of their own besides, every shape of
`sub_bands.RIVALS`, ambient sound that drifts together, noise alone; and passages whose
sound and its image are summed as pressures, frequency by frequency (shares of 0.5 to 1,
sources 0.4 to 7 m deep, sensors 9 to 60 m). Prints by quantiles what the likeliest image
gains, and how many are above each height (`surface_image.LEAST_GAIN`). Its numbers are
draws of each kind and the first seed:
python -m studies.constants.fringes 40 220000
"""

import sys
from itertools import pairwise

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.checks.sub_bands import RIVALS
from uwtrack_cli.motion.passage.checks.surface_image import LEAST_GAIN, likeliest_image

EDGES_HZ = np.linspace(100.0, 900.0, 9)
PARTS = np.array(list(pairwise(EDGES_HZ)))
SOUND_MPS = 1500.0
HEIGHTS = (5.0, 10.0, 15.0, LEAST_GAIN, 30.0, 50.0)
QUANTILES = (0.5, 0.9, 0.99, 1.0)
REACH = 3.0
"""d/v on either side, as `sub_bands` takes them."""


def wander(rng: np.random.Generator, u: FloatArray, memory: float) -> FloatArray:
    """Draw rough noise of unit variance that forgets within so many d/v, as u."""
    keep = np.exp(-(u[1] - u[0]) / memory)
    path = np.empty(u.size)
    path[0] = rng.normal()
    for k in range(1, u.size):
        path[k] = keep * path[k - 1] + np.sqrt(1 - keep**2) * rng.normal()
    return path


def reflected(rng: np.random.Generator, u: FloatArray) -> FloatArray:
    """Power of direct and reflected sound in each part, shape (part, n)."""
    sensor, source = np.exp(rng.uniform(*np.log([9.0, 60.0]))), rng.uniform(0.4, 7.0)
    source = min(source, 0.8 * sensor)
    range_m = np.hypot(np.exp(rng.uniform(*np.log([20.0, 400.0]))), sensor - source)
    aside = np.sqrt(np.maximum(range_m**2 - (sensor - source) ** 2, 1.0))
    aside = np.hypot(aside, range_m * u)
    share = rng.uniform(0.5, 1.0)
    direct, image = np.hypot(aside, sensor - source), np.hypot(aside, sensor + source)
    rows = []
    for low, high in PARTS:
        wave = 2 * np.pi * np.linspace(low, high, 61)[:, None] / SOUND_MPS
        field = np.exp(-1j * wave * direct) / direct
        field = field - share * np.exp(-1j * wave * image) / image
        rows.append((np.abs(range_m * field) ** 2).mean(axis=0))
    return np.array(rows)


def drawn(kind: str, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw u and the power of the parts over the quiet time, shape (part, n)."""
    u = np.linspace(-REACH, REACH, int(rng.integers(30, 200)))
    law = np.repeat((1 / (1 + u**2))[None], len(PARTS), axis=0)
    if kind == "image":
        law = reflected(rng, u)
    elif kind == "own wander":
        law = law * 10 ** (np.array([wander(rng, u, 0.7) for _ in PARTS]) / 10)
    elif kind == "noise":
        law = 0.0 * law
    elif kind == "drift":
        law = np.repeat(10 ** (4.0 * wander(rng, u, 2.0) / 10)[None], len(PARTS), axis=0)
    elif kind in RIVALS:
        shape = RIVALS[kind]((u - rng.normal(0.0, 0.3)) / rng.uniform(0.6, 1.6))
        law = np.repeat(shape[None], len(PARTS), axis=0)
    height = 10 ** ((rng.uniform(4.0, 20.0) - rng.uniform(0.0, 6.0, len(PARTS))) / 10)
    power = 1.0 + height[:, None] * law
    cells = rng.uniform(30.0, 120.0)
    return u, power * rng.gamma(cells, 1 / cells, power.shape)


def gain(kind: str, seed: int, number: int) -> float:
    """Return what the likeliest image of a draw gains."""
    u, power = drawn(kind, np.random.default_rng([seed, number]))
    smooth = np.array([np.convolve(row, np.ones(5) / 5, mode="same") for row in power])
    usual, ground = np.maximum(smooth, 1.0), np.ones((1, u.size))
    return likeliest_image(u, power, usual, ground, PARTS)[1]


def main(count: int, seed: int) -> None:
    """Print the gains of so many draws of each kind."""
    out = sys.stdout
    out.write("| kind | " + " | ".join(f"{100 * q:g} %" for q in QUANTILES))
    out.write(" | " + " | ".join(f"above {h:g}" for h in HEIGHTS) + " |\n")
    out.write("|---" * (1 + len(QUANTILES) + len(HEIGHTS)) + "|\n")
    kinds = ("noise", "drift", *RIVALS, "passage", "own wander", "image")
    for number, kind in enumerate(kinds):
        gains = np.array([gain(kind, one, number) for one in range(seed, seed + count)])
        words = [f"{value:.1f}" for value in np.quantile(gains, QUANTILES)]
        words += [f"{np.count_nonzero(gains > h)} of {count}" for h in HEIGHTS]
        out.write(f"| {kind} | " + " | ".join(words) + " |\n")
        out.flush()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
