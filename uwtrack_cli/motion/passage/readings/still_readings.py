"""Readings in which nothing passes: constant, machinery, and lines that were joined.

**Method.** What does not pass competes with the readings of a passage by the same
measure: likelihood with noise of its own best strength, less what its unknowns and its
search cost. A `constant` has steady frequencies in white noise. `Machinery` keeps its
place and changes its speed: its frequencies wander (coloured noise, rough or smooth),
drift, step or ramp, all of them by the same share. `Joined` is a line that ends where
another begins close to it, beside lines that stay. Bearings and levels stay or drift, in coloured noise:
what moves them is not the source. The instants of steps are sought among all
measurements, noise taken as white, by the sums before and behind each of them.

The size of a change is uniform in its logarithm between two bounds (Jaynes 1968). With a
gain g its deviation is the size over the root of 2 g, so that its cost (Occam's factor)
depends on the gain alone. A passage pays for its time, width and speed by the volume of
their posterior over that of their priors (Laplace's method). All readings are as likely before
the measurements, but for the odds against a change beside a passage; what comes of that
is counted by studies/constants/still_readings.py.

**Conventions.** Log-likelihoods in nepers. One data set, the fit's one row.

**References.** Jaynes (1968), IEEE Trans. Syst. Sci. Cybern. 4, 227 (priors of scales);
MacKay (2003), Information Theory, ch. 28 (Laplace's method, Occam factors).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.presence import CONSTANT, JOINED, MACHINERY, STILL
from uwtrack_cli.estimation.least_squares import orthonormal
from uwtrack_cli.estimation.row_offsets import Design, padded
from uwtrack_cli.motion.coloured_noise import likelihoods_by_noise
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.likelihood_ratio import (
    is_wrapped,
    measured_series,
    passage_residuals,
    resting_values,
)
from uwtrack_cli.motion.passage.fit.residual_noise import clip_wild
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import RAMP, STEP
from uwtrack_cli.motion.passage.readings.change_priors import SIZES, SPEED_MASS

COLOUR_COST = 3.0
"""What strength and memory of coloured noise cost, nepers: one in twenty of those that are
tried fits."""

DRIFTS = {"bearing": (0.01, np.pi), "level": (0.05, 5.0)}
"""Bounds of what bearings (rad) and levels (nepers) drift by within the measurements."""

N_RAMPS, EDGE = 21, 0.03
"""Instants at which a ramp may begin or end, and the share of the measurements at either
end in which nothing is sought."""

CONTRAST = 8
"""Measurements on either side of a step that a slow wander of the shaft leaves alike."""

SPEED_STD_MPS = 10.0
"""Deviation of the speed before it is measured, for the volume of what is left of it."""


class Variant(NamedTuple):
    """One way in which frequencies change where nothing passes."""

    reading: str
    """The reading that it is part of."""
    series: FloatArray
    """One value for each instant, shape (n,)."""
    columns: Design
    """What is free of it, or known in part."""
    is_coloured: bool | None
    """Whether its noise is coloured; None if it may be either."""
    change: str = ""
    """What changes at an unknown instant, 'frequency-step' or 'frequency-ramp'; empty if
    nothing does."""
    profile: FloatArray | None = None
    """Gains of all instants at which that may be, noise taken as white."""
    n_rows: int = 1
    """Lines that may be the one that changes."""
    within: float = 0.0
    """Gain of what the lines do not share."""

    def value(self, white: float, coloured: float, base: float) -> float:
        """Return the logarithm of its evidence.

        Parameters
        ----------
        white, coloured
            Log-likelihood with either noise.
        base
            That of constants with both.
        """
        coloured = coloured - COLOUR_COST
        found = float(np.logaddexp(white, coloured))
        if self.is_coloured is not None:
            found = coloured if self.is_coloured else white
        found += self.within - float(np.log(2.0))
        if not self.change:
            return found
        gain = found - base
        found -= _cost_of_size(gain, *SIZES[self.change]) + float(np.log(self.n_rows))
        return found if self.profile is None else found - _search(self.profile, gain)


class StillFrequencies(NamedTuple):
    """Frequencies as they are where nothing passes."""

    variants: list[Variant]
    """Every way in which they may change."""
    values: FloatArray
    """Evidence of each over the likelihood of the passage that was fitted, nepers."""
    precision: FloatArray
    """Precision of the instants, shape (n,)."""
    time_s: FloatArray
    """The instants, s."""
    width_s: float
    """Range over speed of the passage that was fitted, s."""


def still_evidences(
    fit: PassageFit, blocks: Blocks, frequencies: StillFrequencies | None
) -> dict[str, float]:
    """Return the logarithm of the evidence of each reading without a passage.

    Parameters
    ----------
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    frequencies
        What `still_frequencies` returns; None without lines.

    Returns
    -------
    dict[str, float]
        By reading, over the likelihood of the fit; `joined` is there with lines alone.
    """
    others = still_others(fit, blocks)
    if frequencies is None:
        return dict.fromkeys((CONSTANT, MACHINERY), others)
    found = dict[str, float]()
    for name in STILL:
        own = [
            float(value)
            for variant, value in zip(frequencies.variants, frequencies.values, strict=True)
            if variant.reading == name
        ]
        if own:
            mean = float(np.logaddexp.reduce(own) - np.log(len(own)))
            found[name] = mean + others
    return found


def still_others(fit: PassageFit, blocks: Blocks) -> float:
    """Return the evidence that bearings and levels stay or drift, over that of a fit.

    Parameters
    ----------
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    """
    width_s = float(fit.range_over_speed_s[0])
    passing, resting = passage_residuals(fit, blocks), resting_values(blocks)
    total = 0.0
    for number, name in ((1, "bearing"), (2, "level")):
        block = (blocks.shift, blocks.bearing, blocks.level)[number]
        weight, scale = block.weight[0], fit.noises[number].scale[0]
        if block.is_empty or (number == 1 and is_wrapped(passing[1], weight)):
            continue
        series, constants, precision, used = measured_series(passing[number], weight, scale)
        still = measured_series(resting[number], weight, scale)[0]
        lag = _lag(blocks.time_s[used])
        moves, stays, drifts = likelihoods_by_noise(
            [(series, constants), (still, constants), (still, constants.beside(lag))],
            precision, blocks.time_s[used], width_s,
        ).max(axis=0)  # fmt: skip
        drifts -= _cost_of_size(drifts - stays, *DRIFTS[name])
        total += float(np.logaddexp(stays, drifts) - np.log(2.0) - moves)
    return total


def cost_of_motion(fit: PassageFit, blocks: Blocks) -> float:
    """Return what time, width and speed of a passage cost: prior over posterior volume.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements that it was made from.

    Returns
    -------
    float
        Nepers. The time is uniform within the measurements, the width in its logarithm
        from the spacing to the length of them; the prior density of the speed is
        `speed_prior`. Either turn of the bearing is as likely.
    """
    _, span_s, decades = _extent(blocks)
    count = 2 if blocks.shift.is_empty else 3
    prior = np.diag([span_s**2 / 12, decades**2 / 12, SPEED_STD_MPS**2][:count])
    unit = np.array([1.0, 1.0 / float(fit.range_over_speed_s[0]), 1.0])[:count]
    own = fit.covariance[0, :count, :count] * np.outer(unit, unit)
    left = prior
    if np.isfinite(own).all():
        left = prior - prior @ np.linalg.solve(prior + own, prior)
    volume = 0.5 * (count * np.log(2 * np.pi) + np.linalg.slogdet(left)[1])
    sides = 0.0 if blocks.bearing.is_empty else float(np.log(2.0))
    return float(np.log(span_s * decades) + sides + SPEED_MASS - volume)


def prior_of_place(fit: PassageFit, blocks: Blocks) -> float:
    """Return the log-density of time and width of a fit, over that in the middle.

    Normal, with the variances of the uniform priors of `cost_of_motion`: a closest
    approach far outside the measurements is no likelier with a change than without.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        The measurements that it was made from.
    """
    first_s, span_s, decades = _extent(blocks)
    off = (float(fit.theta[0, 0]) - first_s) / span_s - 0.5
    width = np.log(float(fit.range_over_speed_s[0]) / span_s) / decades + 0.5
    return float(-6.0 * (off**2 + width**2))


def _extent(blocks: Blocks) -> tuple[float, float, float]:
    """Return begin and length of the measurements, s, and the logarithm of their number."""
    time_s = blocks.time_s[(blocks.weight[0] > 0).any(axis=0)]
    span_s = float(np.ptp(time_s))
    return float(time_s[0]), span_s, float(np.log(span_s / np.median(np.diff(time_s))))


def still_frequencies(fit: PassageFit, blocks: Blocks) -> StillFrequencies | None:
    """Return how the frequencies change where nothing passes; None without lines.

    Parameters
    ----------
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    """
    if blocks.shift.is_empty:
        return None
    passing, resting = passage_residuals(fit, blocks)[0], blocks.shift.value[0]
    weight, scale = blocks.shift.weight[0], fit.noises[0].scale[0]
    series, constants, precision, used = measured_series(passing, weight, scale)
    time_s, width_s = blocks.time_s[used], float(fit.range_over_speed_s[0])
    row_precision = (weight / scale[:, None] ** 2)[:, used]
    values = resting[:, used]

    def without(change: FloatArray) -> FloatArray:
        # wild values are held back about what is left, or a step would be cut off
        left = resting.copy()
        left[:, used] -= change
        return measured_series(left, weight, scale)[0]

    still = without(np.zeros(time_s.size))

    def beside(change: str, shape: FloatArray, profile: FloatArray | None) -> Variant:
        size = _size(still, constants, precision, shape)
        return Variant(
            MACHINERY, without(size * shape), constants.beside(shape), None, change, profile
        )

    steps = _Steps(values, row_precision)
    variants = [
        Variant(CONSTANT, still, constants, is_coloured=False),
        Variant(MACHINERY, still, constants, is_coloured=True),
        beside(RAMP, _lag(time_s), None),
        beside(RAMP, *_ramp(still, constants, precision, time_s)),
        *(beside(STEP, late, profile) for late, profile in steps.shared()),
    ]
    for changed, profile, row in steps.of_one():
        left = without(values - changed)
        gain = steps.gain_within(row, values[row] - changed[row], time_s, width_s)
        count = len(values)
        variants.append(Variant(JOINED, left, constants, None, STEP, profile, count, gain))
    white, coloured = likelihoods_by_noise(
        [(series, constants), *((one.series, one.columns) for one in variants)],
        precision, time_s, width_s, smooth=True,
    )  # fmt: skip
    both = np.logaddexp(white, coloured - COLOUR_COST) - np.log(2.0)
    found = [
        one.value(float(white[k + 1]), float(coloured[k + 1]), float(both[1])) - both[0]
        for k, one in enumerate(variants)
    ]
    return StillFrequencies(variants, np.array(found), precision, time_s, width_s)


class _Steps:
    """Where the lines step, all of them or one, by the sums about every instant."""

    def __init__(self, value: FloatArray, precision: FloatArray) -> None:
        """Take values and precisions of lines, shape (lines, n)."""
        self.value, self.precision = value, precision
        count = value.shape[1]
        edge = max(int(EDGE * count), 2)
        self.places = np.arange(edge, count - edge)

    def shared(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the steps of all lines by the same share that gain most.

        One by all that comes before and behind, one by what is near: columns, shape (n,),
        with the gains of all instants.
        """
        found = []
        for reach in (None, CONTRAST):
            right, information = self._score(self.value, self.precision, reach)
            total = information.sum(axis=0)
            gain = 0.5 * right.sum(axis=0) ** 2 / np.maximum(total, 1e-300)
            if not gain.size:
                continue
            place = int(self.places[np.argmax(gain)])
            late = (np.arange(self.value.shape[1]) >= place).astype(float)
            found.append((late, gain))
        return found

    def of_one(self) -> list[tuple[FloatArray, FloatArray, int]]:
        """Return values without the likeliest step of one line, its gains and its row.

        One by the line itself, and one by its distance from what the others share.
        """
        found = []
        readings = [(self.value, self.precision)]
        if self.value.shape[0] > 1:
            readings.append(self._apart())
        for value, precision in readings:
            right, information = self._score(value, precision, None)
            gain = 0.5 * right**2 / np.maximum(information, 1e-300)
            if not gain.size:
                continue
            row, at = np.unravel_index(int(np.argmax(gain)), gain.shape)
            size = right[row, at] / max(float(information[row, at]), 1e-300)
            changed = self.value.copy()
            changed[row, self.places[at] :] -= size
            found.append((changed, gain[row], int(row)))
        return found

    def gain_within(self, row: int, step: FloatArray, time_s: FloatArray, width_s: float) -> float:
        """Return what a step of one line gains in its distance from the others.

        The distance has noise of its own, white or coloured: a line that wanders by
        itself does so whatever passes, and no step is credited with it. What the others
        do not share among themselves is the same with the step and without.
        """
        value, precision = (part[row] for part in self._apart())
        used = precision > 0
        if not used.any():  # nobody is heard beside it
            return 0.0
        value, precision = value[used], precision[used]
        left = [
            clip_wild(one - (precision @ one) / precision.sum(), precision)
            for one in (value, value - step[used])
        ]
        constant = Design.free(np.ones((value.size, 1)))
        white, coloured = likelihoods_by_noise(
            [(one, constant) for one in left], precision, time_s[used], width_s, smooth=True
        )
        stays, steps = np.logaddexp(white, coloured - COLOUR_COST)
        return float(steps - stays)

    def _apart(self) -> tuple[FloatArray, FloatArray]:
        """Return each line less the mean of the others, with its precision."""
        middle = _middle(self.value, self.precision)
        centred = self.value - middle[:, None]
        total = self.precision.sum(axis=0)
        others = total - self.precision
        mean = (self.precision * centred).sum(axis=0) - self.precision * centred
        has_both = (others > 0) & (self.precision > 0)
        safe = np.where(has_both, others, 1.0)
        value = np.where(has_both, centred - mean / safe, 0.0)
        precision = np.where(has_both, self.precision * others / np.maximum(total, 1e-300), 0.0)
        return value, precision

    def _score(
        self, value: FloatArray, precision: FloatArray, reach: int | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return score and information of a step of each line at each instant."""
        sums = np.cumsum(np.stack([precision, precision * value]), axis=-1)
        sums = np.pad(sums, ((0, 0), (0, 0), (1, 0)))
        last = value.shape[1]
        begin = np.zeros_like(self.places)
        end = np.full_like(self.places, last)
        if reach is not None:
            begin = np.maximum(self.places - reach, 0)
            end = np.minimum(self.places + reach, last)
        early = sums[..., self.places] - sums[..., begin]
        late = sums[..., end] - sums[..., self.places]
        information = early[0] * late[0] / np.maximum(early[0] + late[0], 1e-300)
        step = late[1] / np.maximum(late[0], 1e-300)
        step = step - early[1] / np.maximum(early[0], 1e-300)
        return np.asarray(information * step), np.asarray(information)


def _middle(value: FloatArray, precision: FloatArray) -> FloatArray:
    """Return the weighted mean of every line."""
    total = np.maximum(precision.sum(axis=1), 1e-300)
    return np.asarray((precision * value).sum(axis=1) / total)


def _size(value: FloatArray, constants: Design, precision: FloatArray, shape: FloatArray) -> float:
    """Return the size of a change beside constants by least squares."""
    root = np.sqrt(precision)
    rows = constants.beside(shape).rows(root)
    found, *_ = np.linalg.lstsq(rows, padded(value * root, len(rows)), rcond=None)
    return float(found[-1])


def _ramp(
    still: FloatArray, constants: Design, precision: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest ramp, and the gains of all."""
    first, last = np.quantile(time_s, [EDGE, 1 - EDGE])
    at = np.linspace(first, last, N_RAMPS)[:, None]
    shapes = np.concatenate(
        [np.maximum(sign * (time_s - at), 0.0) / np.ptp(time_s) for sign in (1.0, -1.0)]
    )
    root = np.sqrt(precision)
    basis = orthonormal(constants.rows(root))
    free = padded(shapes * root, len(basis))
    free = free - (free @ basis) @ basis.T
    value = padded(still * root, len(basis))
    gain = 0.5 * (free @ value) ** 2 / np.maximum((free**2).sum(axis=1), 1e-300)
    best = int(np.argmax(gain))
    return shapes[best], gain


def _search(profile: FloatArray, gain: float) -> float:
    """Return what a search over instants is worth, from the gains in white noise.

    Parameters
    ----------
    profile
        Gains of all instants, noise taken as white.
    gain
        Gain of the best of them with noise of its own.
    """
    best = max(float(profile.max()), 1e-300)
    share = float(np.clip(gain / best, 0.0, 1.0))
    return float(-np.log(np.mean(np.exp(share * (profile - best)))))


def _cost_of_size(gain: float, low: float, high: float) -> float:
    """Return what a size costs that gains so much, uniform in its logarithm."""
    deviations = np.sqrt(2 * max(float(gain), 0.0))
    mass = float(np.log(high / low)) + 1.0
    return max(float(np.log(max(2 * mass * deviations, 1.0) / np.sqrt(2 * np.pi))), 0.0)


def _lag(time_s: FloatArray) -> FloatArray:
    return np.asarray((time_s - time_s.mean()) / max(float(np.ptp(time_s)), 1e-300))
