"""What a change beside a passage would gain at each of many instants, and move.

**Method.** The unknowns of a change are added to the passage, which is linear about its
fit; its own unknowns and constants are projected out (score test). What is left tells
the size of the change with its information, the gain in log-likelihood with noise taken
as white, and by how much the answers move for each unit of it.

**Conventions.** Log-likelihoods in nepers. One data set, the fit's one row.

**References.** Rao (1948), Proc. Camb. Phil. Soc. 44, 50; Davies (1987), Biometrika 74,
33.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.row_offsets import padded
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.likelihood_ratio import measured_series, passage_residuals
from uwtrack_cli.motion.passage.fit.normal_equations import FLOOR_PRIOR_DEVIATION
from uwtrack_cli.motion.passage.model.law import Passage
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import (
    CHANGED,
    FLOOR,
    HEIGHT,
    MANOEUVRE,
    RAMP,
    TURN,
    Change,
)

N_INSTANTS = 41
"""Instants at which something may have changed."""

EDGE = 0.03
"""Share of the measurements at either end in which no change is sought."""

NEAR_WIDTHS, N_NEAR_INSTANTS = 2.0, 17
"""d/v about the closest approach in which more instants of a manoeuvre are tried."""

TURN_WIDTHS, TURN_SPACING = (1.5, 4.0, 10.0), 3
"""How long a steady turn is tried to last, in d/v, and which share of the instants its
middle is tried at: it changes nothing at once."""

N_MOTION = 5
"""Columns of the passage's own unknowns: motion, depth difference and floor."""

SMALLEST_HEIGHT_STD_M, SMALLEST_SINGULAR = 1e-3, 1e-7
"""Deviation that stands for an exact depth, and singular values that count as zero."""

FARTHEST_S, FARTHEST_LOG = 2.0, 1.0
"""Largest first step of a start, in d/v, and in the logarithm of d/v."""


class Scores(NamedTuple):
    """Gains of a change over a straight passage, and where each would start from."""

    kind: str
    """Kind of the change."""
    gain: FloatArray
    """Gain in log-likelihood of every instant and direction, shape (n,)."""
    time_s: FloatArray
    """Those instants, s."""
    sign: FloatArray
    """Those directions."""
    theta: FloatArray
    """Unknowns by the linearised model, shape (n, unknowns)."""
    spacing_s: FloatArray
    """Distance of neighbouring instants there, s, shape (n,)."""
    right: FloatArray
    """What the measurements say of the sizes: the information times their best values,
    shape (n, unknowns of the change)."""
    information: FloatArray
    """Inverse covariance of the sizes, shape (n, unknowns of the change, same)."""
    moves: FloatArray
    """What t0 (s), ln d/v, v (m/s), the depth difference (m) and the bearing (degrees)
    move by for each unit of the sizes, shape (n, 5, unknowns of the change)."""

    def search(self, gain: float) -> float:
        """Return what the search over instants is worth, nepers.

        Parameters
        ----------
        gain
            Gain of the best instant with coloured noise.
        """
        best = float(self.gain.max())
        share = np.clip(gain / best, 0.0, 1.0)
        chance = np.exp(share * (self.gain - best))
        return float(-np.log(np.average(chance, weights=self.spacing_s)))


class _Linear(NamedTuple):
    """A passage and many changes, linear about its fit, whitened with the priors."""

    value: FloatArray
    """Residuals, shape (n,)."""
    base: FloatArray
    """Columns of the passage: t0, ln d/v, v, depth difference, floor, then the
    constants; shape (n, columns)."""
    extra: FloatArray
    """Columns of the changes, shape (changes, unknowns, n)."""
    bearing: FloatArray
    """What each column adds to the mean bearing, rad, shape (columns,)."""


def score_changes(kind: str, fit: PassageFit, blocks: Blocks) -> Scores:
    """Return what a change at each of many instants would gain, noise taken as white.

    Parameters
    ----------
    kind
        Kind of the change.
    fit
        Straight fit of one row.
    blocks
        The measurements that it was made from.
    """
    change = instants(kind, fit, blocks)
    theta = np.zeros((change.time_s.size, CHANGED + change.std.size))
    if kind == TURN:
        n_middles = change.time_s.size // len(TURN_WIDTHS)
        lasts = float(fit.range_over_speed_s[0]) * np.array(TURN_WIDTHS)
        theta[:, CHANGED + 1] = np.repeat(lasts, n_middles)
    theta[:, : fit.theta.shape[1]] = fit.theta
    theta[:, HEIGHT] = fit.height_m
    linear = _linearised(change, theta, fit, blocks)
    value, base, extra = linear.value, linear.base, linear.extra
    scale = np.sqrt((base**2).sum(axis=0))
    scale[scale == 0] = 1.0
    basis, singular, turn = np.linalg.svd(base / scale, full_matrices=False)
    good = singular > SMALLEST_SINGULAR * singular[0]
    basis, singular, turn = basis[:, good], singular[good], turn[good]
    free = extra - (extra @ basis) @ basis.T
    normal = free @ np.swapaxes(free, 1, 2)
    information = normal.copy()
    normal[:, range(change.std.size), range(change.std.size)] += change.std**-2.0
    right = free @ (value - basis @ (basis.T @ value))
    size = np.linalg.solve(normal, right[..., None])[..., 0]
    # what the passage itself moves by when the change is let in
    slope = -((extra @ basis) / singular) @ turn / scale
    at_rest = ((value @ basis) / singular) @ turn / scale
    moved = at_rest[: N_MOTION - 1] + np.einsum("ik,ikp->ip", size, slope[..., : N_MOTION - 1])
    width = float(fit.range_over_speed_s[0])
    speed = float(fit.theta[0, 2])
    reach = np.array([FARTHEST_S * width, FARTHEST_LOG, 0.5 * abs(speed)])
    theta[:, :3] += np.clip(moved[:, :3], -reach, reach * [1.0, 1.0, 2.0])
    theta[:, CHANGED:] += np.clip(size, -4 * change.std, 4 * change.std)
    distinct = np.unique(change.time_s)
    spacing = np.gradient(distinct)[np.searchsorted(distinct, change.time_s)]
    gain = 0.5 * (right * size).sum(axis=-1)
    return Scores(
        kind, gain, change.time_s, change.sign, theta, spacing, right, information,
        np.swapaxes(_with_bearing(slope, linear.bearing), 1, 2),
    )  # fmt: skip


def _with_bearing(slope: FloatArray, bearing: FloatArray) -> FloatArray:
    """Return partials of the motion, the depth difference and the bearing in degrees."""
    turned = np.rad2deg(slope @ bearing)
    return np.concatenate([slope[..., : N_MOTION - 1], turned[..., None]], axis=-1)


def instants(kind: str, fit: PassageFit, blocks: Blocks) -> Change:
    """Return one kind of change at many instants."""
    used = (blocks.weight[0] > 0).any(axis=0)
    first, last = np.quantile(blocks.time_s[used], [EDGE, 1 - EDGE])
    instants = np.linspace(first, last, N_INSTANTS)
    sign = np.ones(N_INSTANTS)
    if kind in (MANOEUVRE, TURN):
        # near the closest approach the place changes fast
        reach = NEAR_WIDTHS * float(fit.range_over_speed_s[0])
        near = fit.theta[0, 0] + reach * np.linspace(-1, 1, N_NEAR_INSTANTS)
        near = near[(near > first) & (near < last)]
        if reach < 0.5 * (last - first):
            instants = np.unique(np.append(instants, near))
        sign = np.where(instants > fit.theta[0, 0], 1.0, -1.0)
    if kind == TURN:
        instants = np.tile(instants[::TURN_SPACING], len(TURN_WIDTHS))
        sign = np.ones(instants.size)
    elif kind == RAMP:
        instants, sign = np.tile(instants, 2), np.append(sign, -sign)
    return Change(kind, instants, sign)


def _linearised(change: Change, theta: FloatArray, fit: PassageFit, blocks: Blocks) -> _Linear:
    straight = replace(fit, theta=theta[:1, :CHANGED]).law(blocks.time_s)
    every = Passage(np.repeat(straight.rows, theta.shape[0], axis=0))
    rows = change.law(every, theta, blocks.time_s, fit.medium).rows
    floor = fit.theta[:, FLOOR : FLOOR + 1]
    share = np.exp(straight.spread - np.logaddexp(straight.spread, floor))[0]
    factors = (1.0, float(fit.turn[0]), share)
    kinds = (blocks.shift, blocks.bearing, blocks.level)
    base = np.zeros((2, N_MOTION + sum(block.value.shape[1] for block in kinds)))
    base[0, N_MOTION - 2] = 1 / max(fit.medium.height_std_m, SMALLEST_HEIGHT_STD_M)
    base[1, N_MOTION - 1] = 1 / FLOOR_PRIOR_DEVIATION
    values, bases = list[FloatArray]([np.zeros(2)]), [base]
    extras = list[FloatArray]([np.zeros((theta.shape[0], change.std.size, 2))])
    begin, bearing = N_MOTION, np.zeros(base.shape[1])
    for number, (residual, block, noise) in enumerate(
        zip(passage_residuals(fit, blocks), kinds, fit.noises, strict=True)
    ):
        value, constants, precision, kept = measured_series(
            residual, block.weight[0], noise.scale[0]
        )
        root = np.sqrt(precision)
        partials = (rows[:, number, 1:] * factors[number])[..., kept] * root
        offsets = constants.rows(root)
        part = np.zeros((len(offsets), base.shape[1]))
        part[: value.size, : N_MOTION - 1] = partials[0, : N_MOTION - 1].T
        if number == 2:
            part[: value.size, N_MOTION - 1] = root * (1 - share[kept])
        end = begin + offsets.shape[1]
        part[:, begin:end] = offsets
        if number == 1:
            mean = precision @ constants.columns
            bearing[begin:end] = mean / max(float(precision.sum()), 1e-300)
        begin = end
        values.append(padded(root * value, len(offsets)))
        bases.append(part)
        extras.append(padded(partials[:, N_MOTION - 1 :], len(offsets)))
    return _Linear(
        np.concatenate(values), np.concatenate(bases), np.concatenate(extras, axis=-1), bearing
    )
