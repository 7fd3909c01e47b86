"""Is it a passage? Likelihood ratio of a fit against "nothing passes".

**Method.** A generalised likelihood ratio: every kind of measurement is read as a
passage, as a constant and as a straight line in time, each with white noise and
coloured noise of its own best strength and correlation time; frequencies are read as
two constants with a break, too. Hum has no gain over a constant, a slow drift none over
a line, a line with frequency jitter none over its coloured noise, and two steady lines
that were joined none over a break. In air a break may take as long as a change of gear (`gear_changes`).
The threshold follows from the false-alarm probability and the number of places that
the search could have hit.

**Conventions.** Gains are differences of log-likelihood.

**References.** Davies (1987), Biometrika 74, 33: a search over a nuisance parameter.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.robust import median_centred, median_scale, neighbour_scale
from uwtrack_cli.estimation.row_offsets import Design, mean_of_rows
from uwtrack_cli.motion.coloured_noise import coloured_likelihoods
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.gear_changes import (
    frequency_steps,
    shift_lengths_s,
    step_speeds,
)
from uwtrack_cli.motion.passage.fit.residual_noise import clip_wild
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import FLOOR, RAMP

WIDEST_SCATTER_RAD = 1.2
"""Bearings that scatter more than this (69 degrees) carry no information: they wrap."""

Series = tuple[FloatArray, Design, FloatArray, BoolArray]
"""Values of the instants used, columns of the rows' offsets, precision, use."""

LEVELS_SHARE = 2.0 / 3.0
"""Share of the threshold that the levels of the lines may give at most, chosen: pumps
that are switched and fading rise and fall, too, and are no passage."""

FEWEST_LEVELS = 4
"""Levels of a line below which they tell nothing."""

N_BREAKS = 17
"""Instants within d/v of the closest approach at which a line may be two."""

N_ANYWHERE = 25
"""Instants of the whole record at which a change that is claimed may be all there is."""


class _Changes(NamedTuple):
    """When and how frequencies may change without a passage."""

    breaks_s: FloatArray
    """Instants at which they may break, s."""
    bends_s: FloatArray
    """Instants at which they may begin or end to drift, s."""
    shifts_s: FloatArray
    """Instants at which all may step together, and take their time for it, s."""
    shift_lengths_s: tuple[float, ...]
    """How long that may take, s."""


@dataclass(frozen=True)
class LikelihoodRatio:
    """Gains of the kinds over a constant, over a straight line and over a break.

    Only frequencies may break: over it, the other kinds gain what they do over a
    constant.
    """

    doppler: float
    """Gain of the frequencies over constants."""
    bearing: float
    """Gain of the bearings over a constant."""
    level: float
    """Gain of the levels over a constant."""
    over_line: float
    """Gain of all kinds over straight lines in time."""
    over_break: float
    """Gain over constants, with one break in the frequencies."""
    threshold: float
    """Gain that noise exceeds with the false-alarm probability."""
    line_level: float = 0.0
    """Gain of the levels of the lines over constants and over straight lines in time."""

    @property
    def total(self) -> float:
        """Gain of all kinds over constants."""
        return self.doppler + self.bearing + self.level

    @property
    def is_passage(self) -> bool:
        """Whether something passes, at the stated false-alarm probability.

        The levels of the lines are measured apart from the other kinds: what they gain
        adds to theirs, up to a share of the threshold, and lessens nothing.
        """
        gain = min(self.total, self.over_line, self.over_break)
        by_levels = min(max(self.line_level, 0.0), LEVELS_SHARE * self.threshold)
        return gain + by_levels > self.threshold


def passage_likelihood_ratio(
    fit: PassageFit, blocks: Blocks, false_alarm_probability: float, *, is_shown: bool = False
) -> LikelihoodRatio:
    """Weigh the fit of one data set against "nothing passes".

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements that it was made from.
    false_alarm_probability
        Probability of a passage in noise alone.
    is_shown
        Whether the sound has shown a passage, so that all gains are wanted. Else breaks
        are asked about only where they decide: `over_break` is the total without them.
    """
    passing = passage_residuals(fit, blocks)
    series = [
        (
            measured_series(one, block.weight[0], noise.scale[0]),
            measured_series(other, block.weight[0], noise.scale[0])[0],
        )
        for one, other, block, noise in zip(
            passing, resting_values(blocks),
            (blocks.shift, blocks.bearing, blocks.level), fit.noises, strict=True,
        )
    ]  # fmt: skip
    width_s = float(fit.range_over_speed_s[0])
    gains = [_gains(*pair, blocks.time_s, width_s) for pair in series]
    if is_wrapped(passing[1], blocks.bearing.weight[0]):
        gains[1] = (0.0, 0.0)
    over_constant = [gain[0] for gain in gains]
    ratio = LikelihoodRatio(
        over_constant[0], over_constant[1], over_constant[2],
        sum(gain[1] for gain in gains), sum(over_constant),
        float(np.log(_independent_places(blocks) / false_alarm_probability)),
        _gain_of_line_levels(fit, blocks),
    )  # fmt: skip
    if not (is_shown or ratio.is_passage):
        return ratio  # what is no passage over a line is none over breaks either
    broken = _gains(*series[0], blocks.time_s, width_s, _changes(fit, blocks.time_s))
    return replace(ratio, over_break=sum([min(broken), *over_constant[1:]]))


def _gain_of_line_levels(fit: PassageFit, blocks: Blocks) -> float:
    """Return what the levels of the lines gain by the passage's spherical spreading.

    They stay, or drift, where nothing passes. Every line has a level of its own at the
    source, and what fades is noise of any colour to all readings. In air they say
    nothing: a vehicle that passes is louder, too, where its engine changes its speed.
    """
    if blocks.line_level is None or blocks.shift.is_empty or fit.theta[0, 2] <= 0:
        return 0.0
    if fit.medium.is_air:
        return 0.0
    level = blocks.line_level[0]
    weight = np.isfinite(level).astype(float)
    weight[weight.sum(axis=1) < FEWEST_LEVELS] = 0.0
    if not weight.any():
        return 0.0
    still = np.where(weight > 0, level, 0.0)
    moving = np.where(weight > 0, still - fit.law(blocks.time_s).spread[0], 0.0)
    scale = neighbour_scale(median_centred(moving, weight), weight)
    gains = _gains(
        measured_series(moving, weight, scale),
        measured_series(still, weight, scale)[0],
        blocks.time_s,
        float(fit.range_over_speed_s[0]),
    )
    return min(gains)


def motion_likelihood(blocks: Blocks, own: PassageFit, motion: PassageFit) -> float:
    """Return the log-likelihood of measurements under a given motion.

    Rest frequencies, level and the bearing at closest approach are free; bearings
    count only if both motions have them.

    Parameters
    ----------
    blocks
        Measurements of one contact.
    own
        Its own fit: floor, bearing and scales of the noise.
    motion
        The fit whose time, width, speed and turn are tried.
    """
    width_s = float(own.range_over_speed_s[0])
    theta = motion.theta.copy()
    theta[:, FLOOR] = own.theta[:, FLOOR]
    tried = replace(
        own, theta=theta, medium=motion.medium, turn=motion.turn,
        bearing_deg=motion.bearing_deg, change=motion.change,
    )  # fmt: skip
    if not np.isfinite(motion.covariance[0, 3, 3]):
        tried = replace(tried, turn=own.turn, bearing_deg=own.bearing_deg)
    total = 0.0
    kinds = (blocks.shift, blocks.bearing, blocks.level)
    for reading, block, noise in zip(
        passage_residuals(tried, blocks), kinds, own.noises, strict=True
    ):
        series, constants, precision, used = measured_series(
            reading, block.weight[0], noise.scale[0]
        )
        if used.any():
            total += float(
                coloured_likelihoods(
                    [(series, constants)], precision, blocks.time_s[used], width_s
                )[0]
            )
    return total


def passage_residuals(fit: PassageFit, blocks: Blocks) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Subtract the passage from the measurements, but for its constants."""
    law = fit.law(blocks.time_s)
    angle = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    return (
        blocks.shift.value[0] - law.shift[0],
        wrap_rad(blocks.bearing.value[0] - angle),
        blocks.level.value[0] - np.logaddexp(law.spread[0], fit.theta[0, 3]),
    )


def resting_values(blocks: Blocks) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the measurements as those of what stays, but for its constants.

    Parameters
    ----------
    blocks
        Frequencies, bearings and levels.
    """
    bearing = blocks.bearing
    mean = _mean_direction(bearing.value[0], bearing.weight[0])
    return (blocks.shift.value[0], wrap_rad(bearing.value[0] - mean), blocks.level.value[0])


def _mean_direction(bearing: FloatArray, weight: FloatArray) -> float:
    return float(np.angle((weight * np.exp(1j * bearing)).sum()))


def is_wrapped(residual: FloatArray, weight: FloatArray) -> bool:
    """Return whether bearings scatter all round: then they carry no information."""
    scatter = median_scale(residual, weight)
    return float(np.min(scatter, initial=np.inf)) > WIDEST_SCATTER_RAD


def measured_series(reading: FloatArray, weight: FloatArray, scale: FloatArray) -> Series:
    """Condense rows to one value per instant, less what the rows tell of their offsets."""
    precision = weight / scale[:, None] ** 2
    total = precision.sum(axis=0)
    used = total > 0
    clipped = clip_wild(median_centred(reading, weight), precision)
    return *mean_of_rows(clipped[:, used], precision[:, used]), total[used], used


def _gains(
    passing: Series,
    still: FloatArray,
    time_s: FloatArray,
    width_s: float,
    changes: _Changes | None = None,
) -> tuple[float, ...]:
    """Compute what "passes" gains over a constant per row and a line, or over changes."""
    moving, constants, precision, used = passing
    if not used.any():
        return 0.0, 0.0
    time = time_s[used]
    unit = max(float(np.ptp(time_s)), 1e-300)
    rivals = [constants]
    if changes is None:
        lag = (time - time.mean()) / unit
        rivals.append(constants.beside(lag))
    else:
        rivals += [constants.beside((time > at).astype(float)) for at in changes.breaks_s]
        rivals += [
            constants.beside(np.maximum(sign * (time - at), 0.0) / unit)
            for at in changes.bends_s
            for sign in (1.0, -1.0)
        ]
        rivals += [
            constants.beside(step, speed)
            for length in changes.shift_lengths_s
            for step, speed in zip(
                frequency_steps(time, changes.shifts_s, length),
                step_speeds(time, changes.shifts_s, length),
                strict=True,
            )
        ]
    likelihood = coloured_likelihoods(
        [(moving, constants), *((still, columns) for columns in rivals)], precision, time, width_s
    )
    return tuple((likelihood[0] - likelihood[1:]).tolist())


def _changes(fit: PassageFit, time_s: FloatArray) -> _Changes:
    """Return when frequencies may break, and when they may bend, without a passage.

    They may break near the closest approach. Where a passage is claimed beside a change
    of its own, that change may be all there is, at any instant and first of all at its
    own.
    """
    width_s = float(fit.range_over_speed_s[0])
    near = float(fit.theta[0, 0]) + width_s * np.linspace(-1.0, 1.0, N_BREAKS)
    lengths = shift_lengths_s(fit.medium, width_s)
    if fit.change is None:
        return _Changes(near, near[:0], near[::2], lengths)
    first, last = time_s[0], time_s[-1]
    own = float(fit.change.time_s[0]) + 0.5 * width_s * np.linspace(-1, 1, N_BREAKS)
    more = np.concatenate([own, np.linspace(first, last, N_ANYWHERE + 2)[1:-1]])
    more = more[(more > first) & (more < last)]
    is_ramp = fit.change.kind == RAMP
    every = np.concatenate([near, more])
    return _Changes(every, more if is_ramp else more[:0], near[::2], lengths)


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
