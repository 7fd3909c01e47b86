"""Levels of the lines: what they tell of a passage beside its other measurements.

**Method.** Every line has a free level at the source. Its level follows the range with
spherical spreading of the direct sound and of the image in the surface, which takes
most of the sound away where the two paths differ by little (40 dB a decade, Lloyd's
mirror). Fringes nearer than that are not resolved: how deep the source is is known too
little, and their mean over its prior is taken. What is not known of the law (strength
and place of the image, exponent, how the vessel radiates to its sides) has a prior and
is eliminated with it: it adds to the covariance of the noise.

The levels are averaged over eighths of d/v, and over the lines: one series whose
fading is coloured noise. Its strength (6 dB at first) and its correlation time are
weighed by the restricted likelihood, and the covariance is the mean over all that are
likely. Levels that follow another law than this one lose their weight by that: what they
are off by is fading to the likelihood.

**Conventions.** Levels in natural logarithms of power. One data set, the fit's one row.

**References.** Urick (1983), Principles of Underwater Sound, ch. 5 and 6 (surface
image, fading); Carey (2009), Acoustics Today 5(2), 14; Patterson and Thompson (1971),
Biometrika 58, 545 (REML).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS, Passage
from uwtrack_cli.motion.passage.model.measurements import NEPER_DB, Blocks
from uwtrack_cli.motion.passage.model.unknowns import Change, heights_m, law_of, motion_places

REACH, BLOCK = 4.0, 0.125
"""d/v on either side of the closest approach whose levels are used, and over which they
are averaged."""

FEWEST_BLOCKS = 12
"""Averages below which the levels tell nothing that is worth it."""

LEAST_PRESENT = 0.5
"""Share of the time of an average in which a line must be measured: it is lost where it
fades, and the rest is too loud."""

REFLECTIONS, THEIR_WEIGHTS = (0.0, 0.6, 0.95), (0.25, 0.25, 0.5)
"""Strengths of the surface image over the direct sound, and how likely each is."""

ENDS = (0.25, 0.5, 0.25)
"""Weights of the depths as they are told and a deviation of the scale to either side."""

SCALE_STD, LARGEST_SCALE_STD = 0.3, 1.0
"""Deviation of the logarithm of the range at which the image becomes strong, beside that
of the depths, and at most."""

DEPTHS_M = (3.0, 30.0)
"""Depths of source and sensor where that of the sensor is not known."""

SHALLOWEST_M = 0.5
"""Depth of a source at least."""

EXPONENT_STD = 0.15
"""Deviation of the exponent of spreading: 3 dB in 20 dB a decade."""

SIDES_STD = 2.0 / NEPER_DB
"""Deviation of the level ahead over that astern, and abeam over both."""

FADING, FADING_SPREAD = 6.0 / NEPER_DB, 0.7
"""Strength of the fading before it is estimated, and deviation of its logarithm."""

STRENGTHS = np.array([2.0, 3.0, 4.5, 6.5, 9.5, 14.0]) / NEPER_DB
"""Strengths of the fading to try."""

N_MEMORIES, LONGEST_MEMORY = 6, 4.0
"""Correlation times of the fading to try, and the longest of them in d/v."""

WHITE = 0.7 / NEPER_DB
"""Deviation of an average that has no memory."""


@dataclass(frozen=True)
class SurfaceImage:
    """How the image in the surface changes levels, for what it may be."""

    wave_number: FloatArray
    """Of each line, rad/m, shape (lines,)."""
    depths_m2: float
    """Product of the depths of source and sensor, m^2."""
    std: float
    """Deviation of its logarithm."""

    def _cases(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return reflection, product of the depths and weight of each, shape (cases, 1, 1)."""
        scale = np.exp(self.std * np.array([-1.0, 0.0, 1.0]))
        parts = *np.meshgrid(REFLECTIONS, self.depths_m2 * scale), np.outer(ENDS, THEIR_WEIGHTS)
        reflection, product, weight = (part.reshape(-1, 1, 1) for part in parts)
        return reflection, product, weight

    def laws(self, log_range: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return level, partial by ln of the range, and weight of everything it may be.

        Parameters
        ----------
        log_range
            ln of the slant range in m, shape (n,).

        Returns
        -------
        tuple[FloatArray, FloatArray, FloatArray]
            Shapes (cases, lines, n), the same, and (cases,).

        Notes
        -----
        The power of 1/R - g exp(i k (R2 - R)) / R2 with R2^2 = R^2 + 4 z_s z_r; the
        cosine of the phase p by its mean over the depths, cos(p) exp(-(s p)^2 / 2).
        """
        reflection, product, weight = self._cases()
        near = np.exp(log_range)
        far = np.sqrt(near**2 + 4.0 * product)
        ratio = near / far
        phase = self.wave_number[:, None] * (4.0 * product / (near + far))
        smear = np.exp(-0.5 * (self.std * phase) ** 2)
        cosine = np.cos(phase) * smear
        by_phase = -np.sin(phase) * smear - self.std**2 * phase * cosine
        both = reflection * ratio
        power = 1.0 + both**2 - 2.0 * both * cosine
        bend = 1.0 - ratio**2
        slope = 2.0 * both**2 * bend
        slope = slope - 2.0 * both * (bend * cosine - by_phase * ratio * phase)
        return np.log(power) - 2.0 * log_range, slope / power - 2.0, weight.ravel()

    def shifts(self, log_range: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the image does to frequencies, and what is not known of it.

        The sound of both paths has the phase of a source between source and image.

        Parameters
        ----------
        log_range
            ln of the slant range in m, shape (n,).
        shift
            Doppler shift of the direct sound, f/f0 - 1, shape (n,).

        Returns
        -------
        tuple[FloatArray, FloatArray]
            Mean change of f/f0, shape (lines, n), and its standard deviations, one pattern
            for each case of the image, shape (cases, lines, n).

        Notes
        -----
        With 1 - z = 1 - g (R / R2) exp(-i k (R2 - R)), the phase of the direct sound is
        changed by a = arg(1 - z), and f/f0 by -(f/f0 - 1) (da / d ln R) / (k R). The cases
        hold what is not known of the depths; only `SCALE_STD` washes fringes out.
        """
        reflection, product, weight = self._cases()
        near = np.exp(log_range)
        ratio = near / np.sqrt(near**2 + 4.0 * product)
        wave_number = self.wave_number[:, None]
        phase = wave_number * (4.0 * product / (near + near / ratio))
        image = reflection * ratio * np.exp(-1j * phase - 0.5 * (SCALE_STD * phase) ** 2)
        bend = 1.0 - ratio**2 + ratio * phase * (SCALE_STD**2 * phase + 1j)
        case = np.imag(image * bend / (1.0 - image)) * (shift / (wave_number * near))
        mean = (weight * case).sum(axis=0)
        return mean, np.sqrt(weight) * (case - mean)


@dataclass(frozen=True)
class LineLevels:
    """Mean levels of the lines, and the inverse of their covariance."""

    time_s: FloatArray
    """Times of the means, s, shape (n,)."""
    value: FloatArray
    """Mean levels of the lines that are heard then, shape (n,)."""
    share: FloatArray
    """Share of each line in them, shape (lines, n)."""
    image: SurfaceImage
    """How the surface changes them."""
    log_slant: float
    """ln of the slant range at closest approach that places the image, m."""
    precision: FloatArray
    """Inverse covariance, levels at the source eliminated, shape (n, n)."""

    def rows(
        self, theta: FloatArray, medium: Medium, change: Change | None
    ) -> tuple[Passage, FloatArray, FloatArray, FloatArray]:
        """Return the passage, residuals, their partials and what is not known of them.

        Parameters
        ----------
        theta
            Unknowns, shape (1, 4 or more).
        medium
            Sound speed and depth difference.
        change
            What changed beside the passage.

        Returns
        -------
        tuple[Passage, FloatArray, FloatArray, FloatArray]
            The passage at the times of the means, and shapes (n,), (n, unknowns) and
            (n, cases of the image).
        """
        law = law_of(theta, self.time_s, medium, change)
        spread, slopes = law.rows[0, 2, 0], law.rows[0, 2, 1:]
        case, slope, weight = self.image.laws(self.log_slant - 0.5 * spread)
        each = (self.share * case).sum(axis=1)
        mean = weight @ each
        partials = np.zeros((spread.size, theta.shape[1]))
        by_spread = -0.5 * (weight @ (self.share * slope).sum(axis=1))
        places = motion_places(theta)
        partials[:, places] = -(by_spread * slopes).T
        cases = (np.sqrt(weight)[:, None] * (each - mean)).T
        return law, self.value - mean, partials, cases

    def normal(
        self, theta: FloatArray, medium: Medium, change: Change | None
    ) -> tuple[float, FloatArray, FloatArray]:
        """Return cost, gradient and Gauss-Newton matrix at one set of unknowns.

        Parameters
        ----------
        theta
            Unknowns, shape (1, 4 or more).
        medium
            Sound speed and depth difference.
        change
            What changed beside the passage.
        """
        _, residual, partials, _ = self.rows(theta, medium, change)
        weighted = self.precision @ partials
        cost = 0.5 * float(residual @ self.precision @ residual)
        return cost, residual @ weighted, partials.T @ weighted


def line_levels(
    theta: FloatArray, blocks: Blocks, medium: Medium, change: Change | None
) -> LineLevels | None:
    """Return the levels of the lines about a passage with the covariance of their noise.

    Parameters
    ----------
    theta
        Unknowns that all else tells, shape (1, 4 or more).
    blocks
        Measurements in fit units, one row.
    medium
        Sound speed and depth difference.
    change
        What changed beside the passage.

    Returns
    -------
    LineLevels | None
        None where there are too few.
    """
    speed = max(abs(float(theta[0, 2])), SLOWEST_MPS)
    flat_s = float(np.exp(theta[0, 1]))
    height = float(np.ravel(heights_m(theta, medium))[0])
    width = float(np.hypot(flat_s, height / speed))
    slant = width * speed
    means = _means(blocks, float(theta[0, 0]) + slant / medium.sound_speed_mps, width)
    if means is None:
        return None
    time, value, share = means
    image = surface_image(medium, blocks.mean_hz[0])
    none = np.zeros((time.size, time.size))
    levels = LineLevels(time, value, share, image, float(np.log(slant)), none)
    law, residual, partials, cases = levels.rows(theta, medium, change)
    angle = law.angle[0]
    unknown = [
        cases,
        EXPONENT_STD * law.spread[0][:, None],
        SIDES_STD * np.sin(angle)[:, None],
        SIDES_STD * np.cos(2 * angle)[:, None],
    ]
    known = np.concatenate(unknown, axis=1)
    free = share.T
    if change is not None:  # another speed of shaft or vessel has another level
        free = np.column_stack([free, change.shape(time)[0]])
    kernels = _kernels(time, width)
    base = known @ known.T + WHITE**2 * np.eye(time.size)
    noise = _fading(residual, np.column_stack([free, partials[:, :2]]), base, kernels)
    inverse = np.linalg.inv(base + noise)
    return replace(levels, precision=_without(inverse, free))


def surface_image(medium: Medium, frequency_hz: FloatArray) -> SurfaceImage:
    """Return the image in the surface that some lines may have.

    Parameters
    ----------
    medium
        Sound speed, and depths as far as they are known.
    frequency_hz
        Frequencies of the lines, Hz, shape (lines,).
    """
    wave_number = 2 * np.pi * frequency_hz / medium.sound_speed_mps
    return SurfaceImage(wave_number, *_depths(medium))


def _depths(medium: Medium) -> tuple[float, float]:
    """Return the product of both depths, m^2, and the deviation of its logarithm."""
    if not np.isfinite(medium.most_m):
        source, sensor = DEPTHS_M
        return source * sensor, LARGEST_SCALE_STD
    sensor = medium.most_m
    source = max(sensor - medium.height_m, SHALLOWEST_M)
    std = float(np.hypot(SCALE_STD, medium.height_std_m / source))
    return source * sensor, min(std, LARGEST_SCALE_STD)


def _means(
    blocks: Blocks, heard_s: float, width_s: float
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return times, mean levels and the shares of the lines in them; None if too few."""
    if blocks.line_level is None:
        return None
    number = np.floor((blocks.time_s - heard_s) / (BLOCK * width_s))
    near = np.abs(number + 0.5) < REACH / BLOCK
    level, time = blocks.line_level[0][:, near], blocks.time_s[near]
    number = (number[near] + REACH / BLOCK).astype(int)
    count = round(2 * REACH / BLOCK)
    size, total, when = np.zeros((3, level.shape[0], count))
    for line, row in enumerate(level):
        heard = np.isfinite(row)
        at, own = number[heard], time[heard]
        if at.size < 2:  # too few for a block, and of no spacing
            continue
        size[line] = np.bincount(at, minlength=count)
        total[line] = np.bincount(at, row[heard], count)
        when[line] = np.bincount(at, own, count)
        spacing = float(np.median(np.diff(own)))
        size[line, size[line] * spacing < LEAST_PRESENT * BLOCK * width_s] = 0.0
    size[np.count_nonzero(size, axis=1) < FEWEST_BLOCKS] = 0.0
    heard = size > 0
    used = heard.any(axis=0)
    if np.count_nonzero(used) < FEWEST_BLOCKS:
        return None
    kept = heard[:, used]
    share = kept / kept.sum(axis=0)
    part = np.where(kept, size[:, used], 1.0)
    value = (share * total[:, used] / part).sum(axis=0)
    return (share * when[:, used] / part).sum(axis=0), value, share


def _kernels(time_s: FloatArray, width_s: float) -> FloatArray:
    """Return correlations of the fading to try, shape (correlation times, n, n)."""
    memory = np.geomspace(0.5 * BLOCK, LONGEST_MEMORY, N_MEMORIES) * width_s
    lag = np.abs(time_s[:, None] - time_s)
    return np.exp(-lag / memory[:, None, None])


def _fading(
    residual: FloatArray, design: FloatArray, base: FloatArray, kernels: FloatArray
) -> FloatArray:
    """Return the mean covariance of the fading, over all that is likely.

    Parameters
    ----------
    residual
        Residuals, shape (n,).
    design
        What a fit can absorb, shape (n, columns).
    base
        Covariance without fading, shape (n, n).
    kernels
        Correlations to try, shape (correlation times, n, n).
    """
    likelihood = np.empty((STRENGTHS.size, kernels.shape[0]))
    scale = np.sqrt((design**2).sum(axis=0))
    columns, size, _ = np.linalg.svd(design / np.where(scale > 0, scale, 1.0), False)
    columns = columns[:, size > 1e-6 * size[0]]
    for row, strength in enumerate(STRENGTHS):
        whole = base + strength**2 * kernels
        inverse = np.linalg.inv(whole)
        right = inverse @ columns
        normal = columns.T @ right
        follow = right.transpose(0, 2, 1) @ residual
        square = np.einsum("i,kij,j->k", residual, inverse, residual)
        square -= (follow * np.linalg.solve(normal, follow[..., None])[..., 0]).sum(-1)
        logs = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(normal)[1]
        prior = (np.log(strength / FADING) / FADING_SPREAD) ** 2
        likelihood[row] = -0.5 * (square + logs + prior)
    chance = np.exp(likelihood - likelihood.max())
    chance /= chance.sum()
    return np.asarray(np.tensordot(STRENGTHS**2 @ chance, kernels, 1))


def _without(inverse: FloatArray, free: FloatArray) -> FloatArray:
    """Eliminate free constants from an inverse covariance."""
    right = inverse @ free
    return np.asarray(inverse - right @ np.linalg.pinv(free.T @ right) @ right.T)
