"""Fringes that the reflection of a source leaves in the parts of the band.

**Method.** The surface reflects the sound of a vessel, and the ground that of a vehicle
or an aircraft. Direct and reflected sound of a narrow part of the band interfere: where
the longer way takes a delay of tau, power at the frequency f is

    1 + s cos(2 pi f tau),  tau = tau0 (sqrt(1 + q + u^2) - sqrt(1 + u^2)) / (sqrt(1 + q) - 1)

times that of a free field, with u the time from the closest approach in d/v and q the
square of the longer way over the shorter there, less one; a part of the band has the
mean of it. A part falls where the law of the range rises, and others rise: no part has
the law by itself, and yet all have one tau0, q and s. They are searched on a grid, by the
likelihood of all parts together, each with the scatter of its own residuals, and taken
where they explain the parts beyond doubt. A gust, rain or a gain has no such fringes.

**Conventions.** Power; the strength s is below zero where the reflection turns the sound
round, as the surface of water does. Gains are log-likelihood ratios.

**References.** Urick (1983), Principles of Underwater Sound, section 5.8 (image
interference); Carey (2009), IEEE J. Oceanic Eng. 34, 478 (Lloyd mirror patterns).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray

DELAY_STEP = 0.12
"""First delay that is tried, and step, in cycles of the highest frequency."""

LARGEST_DELAY = 1.5
"""Largest delay, in cycles of the width of a part: beyond, its fringes fill up."""

NEARNESS = (0.0, 0.3, 1.0)
"""Squares of the longer way over the shorter at the closest approach, less one."""

STRENGTHS = (-0.8, 0.8)
"""Strengths that are tried first: images of half and of nine tenths have 0.8 and 0.99."""

MOST_INSTANTS = 240
"""Means of neighbours that are searched at most."""

LEAST_GAIN = 20.0
"""Gain in log-likelihood over the law without fringes from which they are taken: none of
160 drawn bands of noise, drifts and passages without an image has it, and 38 of 40 with
one (studies/constants/fringes.py). Gusts, squalls and doors have it now and then; they are told
from a passage afterwards, with what was gained here paid."""

SMALLEST_SHARE = 0.02
"""Deviation of power, as a share, that is assumed at least."""


class Image(NamedTuple):
    """Reflection of a source that passes."""

    delay_s: float
    """Delay of the reflected sound at the closest approach, s."""
    nearness: float
    """Square of its way over the direct one there, less one."""
    strength: float
    """Swing of the fringes of one frequency, -1 to 1."""

    def pattern(
        self, u: FloatArray, low_hz: FloatArray | float, high_hz: FloatArray | float
    ) -> FloatArray:
        """Return the power over that of a free field, the mean of a part of the band.

        Parameters
        ----------
        u
            Time from the closest approach over d/v.
        low_hz, high_hz
            Edges of the part, Hz; of a shape that u can be broadcast with.
        """
        square = 1.0 + u**2
        if self.nearness > 0.0:
            longer = np.sqrt(square + self.nearness) - np.sqrt(square)
            delay_s = self.delay_s * longer / (np.sqrt(1.0 + self.nearness) - 1.0)
        else:
            delay_s = self.delay_s / np.sqrt(square)
        middle_hz, width_hz = 0.5 * (low_hz + high_hz), np.subtract(high_hz, low_hz)
        waves = np.cos(2.0 * np.pi * middle_hz * delay_s)
        pattern: FloatArray = 1.0 + self.strength * waves * np.sinc(width_hz * delay_s)
        return pattern


def find_image(
    u: FloatArray, power: FloatArray, usual: FloatArray, basis: FloatArray, edges_hz: FloatArray
) -> Image | None:
    """Return the reflection whose fringes the parts have; None without any.

    Parameters are those of `likeliest_image`.
    """
    found, gain = likeliest_image(u, power, usual, basis, edges_hz)
    return found if gain > LEAST_GAIN else None


def likeliest_image(
    u: FloatArray, power: FloatArray, usual: FloatArray, basis: FloatArray, edges_hz: FloatArray
) -> tuple[Image, float]:
    """Return the reflection that explains the parts best, and what it gains, nepers.

    Parameters
    ----------
    u
        Time from the closest approach over d/v, shape (n,).
    power
        Power of the parts over the quiet time, shape (part, n).
    usual
        What their deviations are a share of, of the same shape.
    basis
        Background and laws of other passages, shape (1 + other, n).
    edges_hz
        Lower and upper edge of each part, Hz, shape (part, 2).
    """
    starts = np.arange(0, u.size, -(-u.size // MOST_INSTANTS))
    count = np.diff(np.append(starts, u.size))

    def means(rows: FloatArray) -> FloatArray:
        mean: FloatArray = np.add.reduceat(rows, starts, axis=-1) / count
        return mean

    u, power, usual, basis = means(u), means(power), means(usual), means(basis)
    law = 1.0 / (1.0 + u**2)
    plain = residuals(power, usual, basis, np.repeat(law[None, None], len(power), 0))
    longest_s = LARGEST_DELAY / float(np.ptp(edges_hz, axis=1).max())
    step_s = DELAY_STEP / float(edges_hz.max())
    delays = np.arange(step_s, longest_s, step_s).tolist()
    tried = [
        Image(delay_s, nearness, strength)
        for nearness in NEARNESS for strength in STRENGTHS for delay_s in delays
    ]  # fmt: skip
    parts = power, usual, basis
    found = _best(tried, u, law, parts, edges_hz)
    found = _best(_beside(found, step_s), u, law, parts, edges_hz)
    own = residuals(*parts, _columns([found], u, law, edges_hz))
    return found, gain_of(plain[:, 0], own[:, 0])


def _columns(
    images: list[Image], u: FloatArray, law: FloatArray, edges_hz: FloatArray
) -> FloatArray:
    """Return the law with the fringes of each image, shape (part, image, n)."""
    return np.array([[law * image.pattern(u, *edges) for image in images] for edges in edges_hz])


def _best(
    images: list[Image], u: FloatArray, law: FloatArray,
    parts: tuple[FloatArray, FloatArray, FloatArray],
    edges_hz: FloatArray,
) -> Image:  # fmt: skip
    """Return the image that leaves least, each part by its own scatter."""
    left = residuals(*parts, _columns(images, u, law, edges_hz))
    share = np.maximum(np.mean(left**2, axis=-1), SMALLEST_SHARE**2)
    return images[int(np.argmin(np.log(share).sum(axis=0)))]


def _beside(image: Image, step_s: float) -> list[Image]:
    """Return finer delays and strengths about an image."""
    return [
        image._replace(delay_s=image.delay_s + shift * step_s, strength=strength)
        for shift in np.linspace(-0.75, 0.75, 11).tolist()
        for strength in np.clip(image.strength + np.linspace(-0.3, 0.3, 7), -1, 1).tolist()
    ]


def residuals(
    power: FloatArray, usual: FloatArray, basis: FloatArray, columns: FloatArray
) -> FloatArray:
    """Return what columns leave of each part as shares, shape (part, column, n).

    Background and height are those of least squares; a height below zero is none.

    Parameters
    ----------
    power, usual, basis
        As of `find_image`.
    columns
        Shapes of every part, shape (part, column, n).
    """
    left = np.empty(columns.shape)
    for k, (row, unit, own) in enumerate(zip(power, usual, columns, strict=True)):
        ground, _ = np.linalg.qr((basis / unit).T)
        value = row / unit
        value = value - ground @ (ground.T @ value)
        free = own / unit
        free = free - (free @ ground) @ ground.T
        square = np.maximum((free**2).sum(axis=1), 1e-12)
        height = np.maximum(free @ value, 0.0) / square
        left[k] = value - height[:, None] * free
    return left


def gain_of(plain: FloatArray, left: FloatArray) -> float:
    """Return what residuals of the parts gain in log-likelihood over others.

    Neighbours that are alike count once: instants are divided by the sum of the
    correlations of what is left.

    Parameters
    ----------
    plain, left
        Residuals without and with what is asked about, as shares, shape (part, n).
    """
    total = 0.0
    for before, after in zip(plain, left, strict=True):
        square = max(float(np.mean(after**2)), SMALLEST_SHARE**2)
        correlation = correlation_sum(after, square)
        ratio = max(float(np.mean(before**2)), SMALLEST_SHARE**2) / square
        total += 0.5 * after.size / correlation * float(np.log(ratio))
    return total


def correlation_sum(residual: FloatArray, variance: float) -> float:
    """Return the sum of the correlations of neighbours, up to the first that is none.

    Parameters
    ----------
    residual
        Residuals in the order of time, shape (n,).
    variance
        Their variance.
    """
    total = 1.0
    for lag in range(1, residual.size // 4):
        share = float(np.mean(residual[lag:] * residual[:-lag])) / variance
        if share < 0.05:
            break
        total += 2.0 * share
    return total
