"""What the levels of a passage have of its source and way: patterns, not noise.

**Method.** The level of a passage is that of a source which sounds alike to all sides
and spreads by one law. Sound of a vessel, with its image in the surface, and that of a
vehicle over ground that reflects, spread by laws of their own; engines, tyres and
propellers sound otherwise ahead and behind, along the way and abeam. A pattern has one
size for the whole passage: noise of any colour that levels show by themselves does not
hold it, since the fit has taken it for time and width of the passage. So each is an
unknown of the levels with a prior of its own, and eliminated: with C the covariance of
their noise and p its course over a deviation, C + p p' is that of both. Lines then tell
time and width where they know better than a level whose source is not known.

Deviations of drawn vehicles are told by `studies/constants/vehicle_levels.py`. In water the
exponent has the prior that levels of lines have, and d/v that of a level alone; what a
ship radiates ahead and astern is not asked here, where bearings and lines tell time.

**Conventions.** Levels in nepers of power (ln).

**References.** Woodbury's identity; Jonasson (2007), Acta Acustica 93, 173 (directivity
of road vehicles); Urick (1983), Principles of Underwater Sound, section 5.8 (spreading
of a source and its image).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.coloured_noise import InformationLoss
from uwtrack_cli.motion.passage.fit.line_levels import EXPONENT_STD
from uwtrack_cli.motion.passage.model.law import Passage
from uwtrack_cli.motion.passage.model.measurements import NEPER_DB
from uwtrack_cli.motion.passage.model.unknowns import FLOOR

AHEAD_STD_DB = 1.5
"""Deviation of half the difference of the levels ahead and behind in air, dB."""

ALONG_STD_DB = 1.5
"""Deviation of the difference of the levels along the way and abeam in air, dB."""

SPREADING_STD = 0.25
"""Deviation of the law of spreading in air, as a share: from 15 to 25 dB a decade."""

LAW_SHARE = 0.3
"""Deviation of d/v, as a share, that levels tell in water: with 15 log R instead of
20 log R it is 27 to 87 % too long, and fringes of the image in the surface do as much."""


def source_patterns(theta: FloatArray, law: Passage, medium: Medium) -> FloatArray:
    """Return the patterns that levels may have, each of one deviation.

    Parameters
    ----------
    theta
        Unknowns of one passage, shape (1, 4 or more).
    law
        The passage at the times of the levels.
    medium
        Air or water.

    Returns
    -------
    FloatArray
        Shape (patterns, n), nepers.
    """
    share = np.exp(law.spread[0] - np.logaddexp(law.spread[0], theta[0, FLOOR]))
    if not medium.is_air:
        wider = 2.0 * LAW_SHARE * -np.expm1(law.spread[0])  # by the partial of ln d/v
        return np.asarray(share * np.stack([EXPONENT_STD * law.spread[0], wider]))
    along = np.sin(law.angle[0])
    return np.asarray(share * np.array([
        AHEAD_STD_DB / NEPER_DB * along,
        ALONG_STD_DB / NEPER_DB * along**2,
        SPREADING_STD * law.spread[0],
    ]))  # fmt: skip


@dataclass(frozen=True)
class PatternLoss:
    """Inverse covariance of white noise less that of all noise and of the patterns."""

    noise: InformationLoss | None
    """What coloured noise takes; None without any."""
    patterns: FloatArray
    """Patterns of one deviation times the inverse covariance of all noise, shape
    (patterns, n)."""
    covariance: FloatArray
    """What the levels leave of the patterns' sizes, shape (patterns, patterns)."""

    def times(self, rows: FloatArray) -> FloatArray:
        """Multiply rows, shape (..., n), by the loss."""
        told = rows @ self.patterns.T @ self.covariance @ self.patterns
        return told if self.noise is None else told + self.noise.times(rows)


Loss = InformationLoss | PatternLoss | None
"""Information that coloured noise and patterns take; None is white noise."""


def with_patterns(
    weight: FloatArray, noise: InformationLoss | None, patterns: FloatArray
) -> PatternLoss:
    """Return what patterns and noise take from the information of the levels.

    Parameters
    ----------
    weight
        Inverse variances of the white noise, shape (n,).
    noise
        What coloured noise takes.
    patterns
        Patterns of one deviation, shape (patterns, n).
    """
    weighted = weight * patterns
    if noise is not None:
        weighted = weighted - noise.times(patterns)
    inner = np.eye(patterns.shape[0]) + patterns @ weighted.T
    return PatternLoss(noise, weighted, np.linalg.inv(inner))
