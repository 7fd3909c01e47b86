"""Is it a passage? Evidence of a fit against "nothing passes".

**Method.** A generalised likelihood ratio: every kind of measurement is read as a
passage, as a constant and as a straight line in time, each with white noise and slow
noise of its own best strength and memory. A hum has no gain; a slow drift none over
the line; a line that wanders none over its own wander. The threshold follows from
the false-alarm probability and the number of places that the search could have hit.

**Conventions.** Gains are differences of log-likelihood.

**References.** Davies (1987), Biometrika 74, 33: a search over a nuisance parameter.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.block_noise import clip_wild
from uwtrack_cli.estimation.passage_data import Blocks
from uwtrack_cli.estimation.passage_fit import PassageFit
from uwtrack_cli.estimation.passage_normal import Medium
from uwtrack_cli.estimation.robust import median_scale
from uwtrack_cli.estimation.slow_noise import slow_likelihoods
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import passage_law

LARGEST_RELATIVE_DEVIATION = 0.5
"""A quantity less certain than this is not given."""

WIDEST_SCATTER_RAD = 1.2
"""Bearings that scatter more than this (69 degrees) are no evidence: they wrap."""

SMALLEST_SPEED_DEVIATIONS = 3.0
"""A speed within so many deviations of zero is not given."""


@dataclass(frozen=True)
class Evidence:
    """Gains of the kinds over a constant and over a straight line; the threshold."""

    doppler: float
    bearing: float
    level: float
    over_line: float
    threshold: float

    @property
    def total(self) -> float:
        """Gain of all kinds over constants."""
        return self.doppler + self.bearing + self.level

    @property
    def is_passage(self) -> bool:
        """Whether something passes, at the stated false-alarm probability."""
        return min(self.total, self.over_line) > self.threshold


def passage_evidence(
    fit: PassageFit, blocks: Blocks, medium: Medium, false_alarm_probability: float
) -> Evidence:
    """Weigh the fit of one data set against "nothing passes".

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements that it was made from.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    """
    law = passage_law(
        blocks.time_s, fit.theta[:, :3], medium.sound_speed_mps, medium.height_m
    )
    time_s, width_s = blocks.time_s, float(fit.range_over_speed_s[0])
    angle = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    bearing = blocks.bearing.value[0]
    level = np.logaddexp(law.spread[0], fit.theta[0, 3])
    gains = [
        _gains(
            passing, resting, block.weight[0], noise.scale[0], time_s, (widest, width_s)
        )
        for passing, resting, block, noise, widest in (
            (
                blocks.shift.value[0] - law.shift[0],
                blocks.shift.value[0],
                blocks.shift,
                fit.noises[0],
                np.inf,
            ),
            (
                wrap_rad(bearing - angle),
                wrap_rad(bearing - _mean_direction(bearing, blocks.bearing.weight[0])),
                blocks.bearing,
                fit.noises[1],
                WIDEST_SCATTER_RAD,
            ),
            (
                blocks.level.value[0] - level,
                blocks.level.value[0],
                blocks.level,
                fit.noises[2],
                np.inf,
            ),
        )
    ]
    places = _independent_places(blocks)
    return Evidence(
        gains[0][0],
        gains[1][0],
        gains[2][0],
        sum(gain[1] for gain in gains),
        float(np.log(places / false_alarm_probability)),
    )


def _mean_direction(bearing: FloatArray, weight: FloatArray) -> float:
    return float(np.angle((weight * np.exp(1j * bearing)).sum()))


def _gains(
    passing: FloatArray,
    resting: FloatArray,
    weight: FloatArray,
    scale: FloatArray,
    time_s: FloatArray,
    limits: tuple[float, float],
) -> tuple[float, float]:
    """Compute the gain of "passes" over a constant per row, and over a line.

    All rows are condensed to one value per instant; a row's constant enters it
    with the row's share of the weight.
    """
    widest, width_s = limits
    if float(np.min(median_scale(passing, weight), initial=np.inf)) > widest:
        return 0.0, 0.0
    precision = weight / scale[:, None] ** 2
    total = precision.sum(axis=0)
    used = total > 0
    if not used.any():
        return 0.0, 0.0
    share = precision[:, used] / total[used]
    series = [
        (share * clip_wild(centred, precision)[:, used]).sum(axis=0)
        for centred in (_centred(passing, weight), _centred(resting, weight))
    ]
    lag = (time_s[used] - time_s[used].mean()) / max(float(np.ptp(time_s)), 1e-300)
    constants = share.T
    line = np.concatenate([constants, lag[:, None]], axis=1)
    likelihood = slow_likelihoods(
        [(series[0], constants), (series[1], constants), (series[1], line)],
        total[used],
        time_s[used],
        width_s,
    )
    return (
        float(likelihood[0] - likelihood[1]),
        float(likelihood[0] - likelihood[2]),
    )


def _centred(value: FloatArray, weight: FloatArray) -> FloatArray:
    """Take the median of every row from it."""
    known = np.where(weight > 0, value, np.nan)
    measured = np.isfinite(known).any(axis=-1, keepdims=True)
    middle = np.nanmedian(np.where(measured, known, 0.0), axis=-1, keepdims=True)
    centred: FloatArray = np.where(weight > 0, value - middle, 0.0)
    return centred


def _independent_places(blocks: Blocks) -> float:
    """Count the places and widths at which noise could look like a passage."""
    used = (
        (
            (blocks.shift.weight[0] > 0).any(axis=0)
            | (blocks.bearing.weight[0] > 0).any(axis=0)
            | (blocks.level.weight[0] > 0).any(axis=0)
        )
        if blocks.time_s.size
        else np.zeros(0, np.bool_)
    )
    return 2.0 * max(int(used.sum()), 2)


def not_a_passage(fit: PassageFit, time_s: FloatArray) -> str | None:
    """Return why a fit that moves has no closest approach to give, or None.

    Parameters
    ----------
    fit
        Fit of one row.
    time_s
        Times of the measurements in seconds.
    """
    width = float(fit.range_over_speed_s[0])
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance[0])[:2], 0.0))
    if not np.all(np.isfinite(deviation)):
        return "the measurements do not tell time and width of a passage apart"
    if deviation[1] > LARGEST_RELATIVE_DEVIATION * width or deviation[0] > width:
        return "too little of the passage is in the recording"
    first, last = float(time_s[0]), float(time_s[-1])
    if not first - width < float(fit.theta[0, 0]) < last + width:
        return "the closest approach lies far outside the recording"
    return None
