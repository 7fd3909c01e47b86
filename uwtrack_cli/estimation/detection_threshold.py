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
from uwtrack_cli.estimation.information_reduction import (
    gate_probability,
    information_reduction,
)
from uwtrack_cli.estimation.operating_curve import OperatingCurve
from uwtrack_cli.estimation.probabilistic_association import Innovation

_CELLS = np.logspace(-2.0, 6.0, 81)
_COARSE, _FINE, _ZOOMS = 48, 13, 3


@dataclass(frozen=True)
class OperatingPoint:
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
    curve: OperatingCurve,
    limits: tuple[float, float],
    *,
    dimension: int,
    gate: float,
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


def background_extrema(
    curve: OperatingCurve, limits: tuple[float, float], inside: float
) -> FloatArray:
    """Return the thresholds at which the background b has a local extremum.

    Parameters
    ----------
    curve
        The detector.
    limits
        Least and greatest false alarm probability to consider.
    inside
        Probability P_G that the target's measurement lies in the gate.
    """
    probability = np.geomspace(*limits, 1500)
    rising = np.diff(_background(curve, probability, inside)) > 0.0
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
    terms = _ranked_sums(innovation, amplitude, gated)
    strongest, weakest = curve.threshold(np.array(limits))
    # Intervals (next amplitude, this amplitude], from "none" to "all of the gate".
    level = np.clip(terms.amplitude, weakest, strongest)
    upper = _join(strongest, level)
    lower = _join(level, weakest)
    inner = np.clip(extrema, lower[..., None], upper[..., None])
    tau = np.concatenate([lower[..., None], upper[..., None], inner], axis=-1)
    probability = curve.false_alarm(tau)
    volume = np.asarray(cell_volume)[..., None, None]
    background = _background(curve, probability, inside) / volume
    total = background + terms.density[..., None]
    x = 1.0 / np.maximum(total, np.finfo(np.float64).tiny)
    gain = terms.linear[..., None] * x + terms.square[..., None] * x**2
    # No threshold within the limits may separate a set from the rest.
    member, other = _join(np.inf, terms.amplitude), _join(terms.amplitude, -np.inf)
    possible = (member >= weakest) & (other < strongest)
    gain = np.where(possible[..., None], gain, -np.inf)
    flat = gain.reshape(*gain.shape[:-2], -1)
    best = flat.argmax(axis=-1)[..., None]
    chosen = np.take_along_axis(probability.reshape(flat.shape), best, -1)[..., 0]
    count = best // tau.shape[-1]
    allowed = gated & (terms.rank < count)
    point = OperatingPoint(chosen, curve.detection(chosen), allowed)
    return point, np.take_along_axis(flat, best, -1)[..., 0]


@dataclass(frozen=True)
class _RankedSums:
    """Sums over the m strongest measurements, m = 0 ... k."""

    amplitude: FloatArray
    """Amplitudes in falling order, ``(..., k)``."""
    rank: IntArray
    """Rank of each measurement, 0 the strongest, ``(..., k)``."""
    density: FloatArray
    """Sum of the densities, ``(..., k + 1)``."""
    linear: FloatArray
    """Sum of e (tr W S W' - |W nu|^2), ``(..., k + 1)``."""
    square: FloatArray
    """|sum of e W nu|^2, ``(..., k + 1)``."""


def _ranked_sums(
    innovation: Innovation, amplitude: FloatArray, gated: BoolArray
) -> _RankedSums:
    strength = np.where(gated, amplitude, -np.inf)
    order = np.argsort(-strength, axis=-1, kind="stable")
    rank = np.argsort(order, axis=-1, kind="stable")
    exponent = innovation.log_density_peak - 0.5 * innovation.distance2
    density = np.where(gated, np.exp(np.where(gated, exponent, 0.0)), 0.0)
    move = innovation.move
    trace = np.trace(innovation.reduction, axis1=-2, axis2=-1)
    linear = density * (trace - (move**2).sum(axis=-1))
    vector = _cumulate(density[..., None] * move, order[..., None], -2)
    ordered = np.take_along_axis(strength, order, -1)
    return _RankedSums(
        ordered, rank, _cumulate(density, order, -1), _cumulate(linear, order, -1),
        (vector**2).sum(axis=-1),
    )  # fmt: skip


def _join(first: FloatArray | float, last: FloatArray | float) -> FloatArray:
    """Join a column of numbers and a table along the last axis."""
    rows = np.shape(first if np.ndim(first) else last)[:-1]
    return np.concatenate(
        [
            part if np.ndim(part) else np.full((*rows, 1), part)
            for part in (first, last)
        ],
        axis=-1,
    )


def _cumulate(values: FloatArray, order: IntArray, axis: int) -> FloatArray:
    """Sum in the given order, from no member to all."""
    total = np.cumsum(np.take_along_axis(values, order, axis=axis), axis=axis)
    shape = list(total.shape)
    shape[axis] = 1
    return np.concatenate([np.zeros(shape), total], axis=axis)


def _background(
    curve: OperatingCurve, probability: FloatArray, inside: float
) -> FloatArray:
    """Return b per unit of 1/V_c: P_F (1 - P_D P_G) / P_D."""
    detection = curve.detection(probability)
    return probability * (1.0 - detection * inside) / detection
