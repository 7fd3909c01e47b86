"""Is it a passage? Evidence of a fit against "nothing passes".

**Method.** With the weights of the fit (robust, slow noise included) every kind of
measurement is fitted by a constant and by a straight line in time as well; the gain is
the difference of half chi-squares. A hum has no gain; a slow drift none over the
line. The threshold follows from the false-alarm probability and the number of
independent places that the search could have hit.

**Conventions.** Gains are in units of half a chi-square, per data set.

**References.** Davies (1987), Biometrika 74, 33: a search over a nuisance parameter.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.passage_data import Blocks
from uwtrack_cli.estimation.passage_fit import PassageFit
from uwtrack_cli.estimation.passage_normal import Medium
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import passage_law

LARGEST_RELATIVE_DEVIATION = 0.5
"""A quantity less certain than this is not given."""

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
    angle = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    bearing = wrap_rad(blocks.bearing.value[0] - angle) + angle
    level = np.logaddexp(law.spread[0], fit.theta[0, 3])
    gains = [
        _gains(values, weight[0], model, blocks.time_s)
        for values, weight, model in (
            (blocks.shift.value[0], fit.frequency_noise.weight, law.shift[0]),
            (bearing, fit.bearing_noise.weight, angle),
            (blocks.level.value[0], fit.level_noise.weight, level),
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


def _gains(
    value: FloatArray, weight: FloatArray, model: FloatArray, time_s: FloatArray
) -> tuple[float, float]:
    """Gain of the model over a constant, and over a line, summed over the rows."""
    lag = (time_s - time_s.mean()) / max(float(np.ptp(time_s)), 1e-300)
    residual = value - model
    own, _ = _cost(residual, weight, lag)
    constant, line = _cost(value, weight, lag)
    return float((constant - own).sum()), float((line - own).sum())


def _cost(
    value: FloatArray, weight: FloatArray, lag: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Half the weighted square sum about a constant per row, and a shared slope."""
    size = weight.sum(axis=-1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    centred = value - (weight * value).sum(axis=-1, keepdims=True) / size
    centred_lag = lag - (weight * lag).sum(axis=-1, keepdims=True) / size
    square = 0.5 * (weight * centred**2).sum(axis=-1)
    along = (weight * centred_lag * centred).sum()
    length = (weight * centred_lag**2).sum()
    saved = 0.5 * along**2 / length if length > 0 else 0.0
    share = np.full(square.shape, saved / max(square.size, 1))
    return square, square - share


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
