"""Passages that are too faint to be seen, and what they leave open.

**Method.** Where nothing is told to pass, something may pass all the same: too fast or
too far for its closest approach to stand out, or beside a change of the shaft that does.
Passages drawn from their prior (time, width, speed, turn and floor, by Halton's sequence)
are tried beside every way in which the frequencies may change without one; the mean of
their likelihoods is the evidence for a passage that was not seen, whose likelihood has no
peak for Laplace's method to stand on.

**Conventions.** Log-likelihoods in nepers. One data set, the fit's one row.

**References.** Halton (1960), Numer. Math. 2, 84; Hammersley and Handscomb (1964), Monte
Carlo Methods, ch. 5 (means over a prior).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.presence import JOINED
from uwtrack_cli.motion.coloured_noise import gains_of_shapes
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.likelihood_ratio import (
    is_wrapped,
    measured_series,
    passage_residuals,
    resting_values,
)
from uwtrack_cli.motion.passage.model.law import Passage, passage_law
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import RAMP, STEP
from uwtrack_cli.motion.passage.readings.change_priors import (
    ODDS,
    STRAIGHT,
    TAIL_FREEDOM,
    VESSEL_MPS,
    VESSEL_STD_MPS,
)
from uwtrack_cli.motion.passage.readings.still_readings import StillFrequencies, still_others

N_PASSAGES = 400
"""Passages that are tried."""

SLOWEST_MPS, FASTEST_MPS = 0.3, 60.0
"""Speeds that are tried."""

PRIMES = (2, 3, 5, 7, 11)
"""Base of Halton's sequence for each of the five unknowns that are drawn."""

FLOORS = (-5.0, 2.0)
"""Bounds of the logarithm of the floor over the level at closest approach."""


def unseen_passages(
    fit: PassageFit, blocks: Blocks, frequencies: StillFrequencies | None
) -> dict[str, float]:
    """Return the evidence of passages that were not seen, over the likelihood of a fit.

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
        By reading: 'straight', and with lines 'frequency-step' and 'frequency-ramp'.
    """
    law, turn, floor = _drawn(fit, blocks)
    others = np.zeros(N_PASSAGES)
    levels = np.logaddexp(law.spread, floor[:, None])
    for number, shapes in ((1, turn[:, None] * law.angle), (2, levels)):
        others += _gains(number, shapes, fit, blocks)
    rest = still_others(fit, blocks)
    if frequencies is None:
        return {STRAIGHT: rest + _log_mean(others)}
    used = np.isin(blocks.time_s, frequencies.time_s)
    shapes = law.shift[:, used].T
    found: dict[str, list[float]] = {STRAIGHT: [], STEP: [], RAMP: []}
    for variant, value in zip(frequencies.variants, frequencies.values, strict=True):
        if variant.reading == JOINED:
            continue
        gains = gains_of_shapes(
            variant.series, variant.columns, shapes, frequencies.precision,
            frequencies.time_s, frequencies.width_s,
            with_coloured_noise=variant.is_coloured is not False, smooth=True,
        )  # fmt: skip
        found[variant.change or STRAIGHT].append(float(value) + _log_mean(gains + others))
    # white and coloured noise are halves of one reading; instants of a change are not
    ways = {STRAIGHT: 1, STEP: len(found[STEP]), RAMP: len(found[RAMP])}
    return {
        name: rest + float(np.logaddexp.reduce(values) - np.log(ways[name])) - ODDS.get(name, 0.0)
        for name, values in found.items()
        if values
    }


def _gains(number: int, shapes: FloatArray, fit: PassageFit, blocks: Blocks) -> FloatArray:
    """Return what passages gain in bearings or levels over what stays."""
    block = (blocks.shift, blocks.bearing, blocks.level)[number]
    weight = block.weight[0]
    if block.is_empty or (number == 1 and is_wrapped(passage_residuals(fit, blocks)[1], weight)):
        return np.zeros(N_PASSAGES)
    still, constants, precision, used = measured_series(
        resting_values(blocks)[number], weight, fit.noises[number].scale[0]
    )
    return gains_of_shapes(
        still, constants, shapes[:, used].T, precision, blocks.time_s[used],
        float(fit.range_over_speed_s[0]), with_coloured_noise=True,
    )  # fmt: skip


def _drawn(fit: PassageFit, blocks: Blocks) -> tuple[Passage, FloatArray, FloatArray]:
    """Return the passages that are tried, their turns and the logarithms of floors."""
    from scipy.special import stdtrit

    share = np.array([radical_inverse(N_PASSAGES, base) for base in PRIMES])
    used = (blocks.weight[0] > 0).any(axis=0)
    time_s = blocks.time_s[used]
    span_s, spacing_s = float(np.ptp(time_s)), float(np.median(np.diff(time_s)))
    square = np.log1p((VESSEL_STD_MPS / VESSEL_MPS) ** 2)
    middle = np.log(VESSEL_MPS) - 0.5 * square
    speed = np.exp(middle + np.sqrt(square) * stdtrit(TAIL_FREEDOM, share[2]))
    theta = np.column_stack([
        time_s[0] + span_s * share[0],
        np.log(spacing_s) + np.log(span_s / spacing_s) * share[1],
        np.clip(speed, SLOWEST_MPS, FASTEST_MPS),
    ])  # fmt: skip
    if blocks.shift.is_empty:
        theta[:, 2] = 0.0
    medium = fit.medium
    height_m = medium.height_m if not blocks.shift.is_empty else 0.0
    law = passage_law(blocks.time_s, theta, medium.sound_speed_mps, height_m)
    floor = FLOORS[0] + (FLOORS[1] - FLOORS[0]) * share[4]
    return law, np.where(share[3] < 0.5, -1.0, 1.0), floor


def radical_inverse(count: int, base: int) -> FloatArray:
    """Return the numbers from 1 to count, their digits mirrored at the point.

    Examples
    --------
    >>> radical_inverse(5, 2).tolist()
    [0.5, 0.25, 0.75, 0.125, 0.625]
    """
    rest, found, place = np.arange(1, count + 1), np.zeros(count), 1.0 / base
    while rest.any():
        rest, digit = np.divmod(rest, base)
        found += digit * place
        place /= base
    return found


def _log_mean(gains: FloatArray) -> float:
    return float(np.logaddexp.reduce(gains) - np.log(gains.size))
