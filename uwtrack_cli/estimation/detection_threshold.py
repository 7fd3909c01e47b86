"""Choose the detection threshold that leaves the least variance after a scan.

**Method.** *Prior*: before the scan is looked at, the false alarm rate that maximises
the factor q2 for the predicted validation region; the optimum depends on the region's
size in cells alone and is tabulated once. *Posterior*: after the scan, the threshold
whose measurements give the smallest covariance; between two amplitudes the set of
measurements is constant and the criterion convex, so the ends of the intervals (and the
extrema of the background) are enumerated exactly.

**Conventions.** As in `uwtrack_cli.estimation.probabilistic_association`. In the trace of a covariance, rates
count with a time of 1 s.

**References.** Gelfand, Fortmann and Bar-Shalom (1996); Choi, Kim and Hong (2001),
equations 22-30 as corrected.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.estimation.information_reduction import gate_probability, information_reduction
from uwtrack_cli.estimation.operating_curve import OperatingCurve
from uwtrack_cli.estimation.probabilistic_association import Innovation

_CELLS = np.logspace(-2.0, 6.0, 81)
_COARSE, _FINE, _ZOOMS = 48, 13, 3


@dataclass(frozen=True)
class OperatingPoint(Rows):
    """Where the detector is set, per run."""

    false_alarm: FloatArray
    """False alarm probability per cell, ``(...)``."""
    detection: FloatArray
    """Detection probability of the target, ``(...)``."""
    allowed: BoolArray
    """Measurements above the threshold and in the gate, ``(..., k)``."""


def best_prior(
    curve: OperatingCurve,
    cells: FloatArray,
    limits: tuple[float, float],
    *,
    dimension: int = 2,
    gate: float = 4.0,
) -> FloatArray:
    """Find the false alarm probabilities that maximise q2 before a scan.

    Parameters
    ----------
    curve
        The detector.
    cells
        Size of the validation region in resolution cells, any shape, above 0.
    limits
        Least and greatest false alarm probability to consider.
    dimension
        Number of measured components, from 1.
    gate
        Radius of the gate in standard deviations.

    Returns
    -------
    FloatArray
        False alarm probabilities, in the shape of ``cells``.

    Notes
    -----
    max over P_F of q2(P_D(P_F), P_F V / V_c) (Choi et al. 2001, eqs. 22-24), by a grid in
    ln P_F that is refined around its best point.
    """
    low = np.full(cells.shape, np.log(limits[0]))
    high = np.full(cells.shape, np.log(limits[1]))
    best = low
    for zoom in range(_ZOOMS):
        share = np.linspace(0.0, 1.0, _COARSE if zoom == 0 else _FINE)
        trial = low[..., None] + (high - low)[..., None] * share
        probability = np.exp(trial)
        q2 = information_reduction(
            curve.detection(probability), probability * cells[..., None],
            dimension=dimension, gate=gate,
        )  # fmt: skip
        top = q2.argmax(axis=-1)[..., None]
        best = np.take_along_axis(trial, top, axis=-1)[..., 0]
        last = share.size - 1
        low = np.take_along_axis(trial, np.maximum(top - 1, 0), -1)[..., 0]
        high = np.take_along_axis(trial, np.minimum(top + 1, last), -1)[..., 0]
    found: FloatArray = np.exp(best)
    return found


@lru_cache(maxsize=16)
def prior_rule(
    curve: OperatingCurve, limits: tuple[float, float], *, dimension: int, gate: float
) -> Callable[[FloatArray], FloatArray]:
    """Tabulate `best_prior` and return it as a fast function of the region's cells."""
    # The table reaches beyond the limits: a kink where they begin would not be met.
    wide = (
        max(0.1 * limits[0], curve.limits[0]),
        max(limits[1], min(3.0 * limits[1], 0.9, curve.limits[1])),
    )
    table = np.log(best_prior(curve, _CELLS, wide, dimension=dimension, gate=gate))
    grid = np.log(_CELLS)

    def rule(cells: FloatArray) -> FloatArray:
        chosen: FloatArray = np.exp(np.interp(np.log(cells), grid, table))
        return np.clip(chosen, *limits)

    return rule


@lru_cache(maxsize=16)
def background_extrema(
    curve: OperatingCurve, limits: tuple[float, float], inside: float
) -> FloatArray:
    """Return the thresholds at which the background b has a local extremum.

    The target's measurement lies in the gate with the probability ``inside``, P_G.
    """
    probability = np.geomspace(*limits, 1500)
    detection = curve.detection(probability)
    rising = np.diff(_background(probability, detection, inside)) > 0.0
    turns = 1 + np.flatnonzero(rising[1:] != rising[:-1])
    return curve.threshold(probability[turns])


def best_posterior(
    curve: OperatingCurve,
    limits: tuple[float, float],
    innovation: Innovation,
    amplitude: FloatArray,
    gated: BoolArray,
    *,
    cell_volume: FloatArray | float,
    gate: float,
    extrema: FloatArray,
) -> tuple[OperatingPoint, FloatArray]:
    """Find the threshold that gives the smallest covariance after a scan.

    Parameters
    ----------
    curve
        The detector.
    limits
        Least and greatest false alarm probability to consider.
    innovation
        The scan against the prediction.
    amplitude
        Amplitudes of the measurements, ``(..., k)``.
    gated
        Measurements in the gate, ``(..., k)``.
    cell_volume
        Volume of a resolution cell in measurement space, ``(...)``.
    gate
        Radius of the gate in standard deviations.
    extrema
        Thresholds from `background_extrema`.

    Returns
    -------
    tuple
        The operating point and the decrease of the trace.

    Notes
    -----
    With the m strongest measurements and x = 1 / (b(tau) + sum e_j) the trace falls by
    d x + e x^2, d = sum e_j (tr W S W' - |W nu_j|^2), e = |sum e_j W nu_j|^2: convex, as
    e is a squared norm (Choi et al. 2001, eqs. 29-30, corrected).
    """
    inside = gate_probability(gate, innovation.residual.shape[-1])
    sets = _strongest_sets(innovation, amplitude, gated)
    # A set is taken by the thresholds from the next amplitude to its weakest member's.
    lowest, highest = _threshold_limits(curve, limits)
    level = np.minimum(np.maximum(sets.weakest, lowest), highest)
    low, high = level[..., 1:, None], level[..., :-1, None]
    n_sets, n_turns = low.shape[-2], extrema.size
    tau = level
    if n_turns:
        turns = np.broadcast_to(extrema, (*level.shape[:-1], n_turns))
        tau = np.concatenate([level, turns], axis=-1)
    probability = curve.false_alarm(tau)
    detection = curve.detection(probability)
    background = _background(probability, detection, inside)
    background /= np.asarray(cell_volume)[..., None]
    x = np.empty((*level.shape[:-1], n_sets, 2 + n_turns))
    x[..., 0], x[..., 1] = background[..., 1 : n_sets + 1], background[..., :n_sets]
    x[..., 2:] = background[..., None, n_sets + 1 :]
    x += sets.density[..., None]
    np.divide(1.0, np.maximum(x, _TINY, out=x), out=x)
    gain = sets.square[..., None] * x
    gain += sets.linear[..., None]
    gain *= x
    # No threshold within the limits may separate a set from the rest.
    np.copyto(gain, -np.inf, where=low >= high)
    if n_turns:
        np.copyto(gain[..., 2:], -np.inf, where=(extrema < low) | (extrema > high))
    runs, shape = gain[..., 0, 0].size, level.shape[:-1]
    flat = gain.reshape(runs, -1)
    best = flat.argmax(axis=-1)
    run = np.arange(runs)
    own = _thresholds(n_sets, n_turns)[best] + run * tau.shape[-1]
    last = sets.weakest.reshape(runs, -1)[run, best // (2 + n_turns)]
    point = OperatingPoint(
        probability.take(own).reshape(shape),
        detection.take(own).reshape(shape),
        gated & (amplitude >= last.reshape((*shape, 1))),
    )
    return point, flat[run, best].reshape(shape)


_TINY = float(np.finfo(np.float64).tiny)


@lru_cache(maxsize=16)
def _threshold_limits(curve: OperatingCurve, limits: tuple[float, float]) -> tuple[float, float]:
    """Return the least and the greatest threshold within the limits."""
    lowest, highest = curve.threshold(np.array(limits[::-1])).tolist()
    return lowest, highest


@lru_cache(maxsize=256)
def _thresholds(n_sets: int, n_turns: int) -> IntArray:
    """Return which threshold is that of each set's ends, lower first, and extrema."""
    first = np.arange(n_sets)[:, None]
    turns = np.broadcast_to(n_sets + 1 + np.arange(n_turns), (n_sets, n_turns))
    return np.concatenate([first + 1, first, turns], axis=1).ravel()


@dataclass(frozen=True)
class _StrongestSets:
    """The m strongest measurements in the gate, m = 0 ... k, and sums over them."""

    weakest: FloatArray
    """Amplitude of the weakest member, ``(..., k + 2)``: inf for none, -inf where the
    gate holds fewer, and at the end."""
    density: FloatArray
    """Sum of the densities, ``(..., k + 1)``; of sets that the gate holds, as all sums."""
    linear: FloatArray
    """Sum of e (tr W S W' - |W nu|^2), ``(..., k + 1)``."""
    square: FloatArray
    """|sum of e W nu|^2, ``(..., k + 1)``."""


def _strongest_sets(
    innovation: Innovation, amplitude: FloatArray, gated: BoolArray
) -> _StrongestSets:
    """Sum what decides the trace over every set by one product with its members."""
    shape = amplitude.shape
    faintness = np.where(gated, -amplitude, np.inf)
    order = np.empty((*shape[:-1], shape[-1] + 2))
    order[..., 0], order[..., 1:-1], order[..., -1] = -np.inf, faintness, np.inf
    order.sort(axis=-1)
    move = innovation.move
    terms = np.empty((*shape, 2 + move.shape[-1]))
    terms[..., 0] = 1.0
    trace = innovation.reduction.trace(axis1=-2, axis2=-1)
    np.subtract(trace, (move * move).sum(axis=-1), out=terms[..., 1])
    terms[..., 2:] = move
    terms *= innovation.density[..., None]
    members = faintness[..., None, :] <= order[..., :-1, None]
    sums: FloatArray = np.matmul(members, terms)
    vector = sums[..., 2:]
    return _StrongestSets(-order, sums[..., 0], sums[..., 1], (vector * vector).sum(axis=-1))


def _background(probability: FloatArray, detection: FloatArray, inside: float) -> FloatArray:
    """Return b per unit of 1/V_c: P_F (1 - P_D P_G) / P_D."""
    return probability * (1.0 - detection * inside) / detection
