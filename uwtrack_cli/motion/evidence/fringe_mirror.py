"""The delay of a vessel's image in the surface, out of the pattern of its fringes.

**Method.** Where sound comes straight and by the surface alone, the pattern at the closest
approach is a comb over frequency: dark at zero and at every multiple of one over the
delay, since the surface turns the sound round. A channel's bottom adds combs of other
delays. Both are held against each other: one comb, its strength and that of its harmonics
free and smooth over log frequency, beside a rest that is free, or the free rest alone; and
combs of another phase, as of a reflection that turns nothing. What a rest is free to be
(its variance) the image tells, as for any pattern; where it is nothing, no bottom sounds.
The logarithm of two ways' interference has many harmonics where the vessel is loud.

**Conventions.** Delays in s, evidence in nepers, divided by the misfit of the passage.

**References.** Urick (1983), Principles of Underwater Sound, section 5.8 (image
interference); Rasmussen and Williams (2006), section 2.7 (explicit basis functions).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.evidence.fringe_panel import Panel
from uwtrack_cli.motion.evidence.fringe_template import FringeModel, Hypothesis, Template

RESTS = (0.0005, 0.002, 0.008, 0.03, 0.12)
"""Variances of what a pattern has beside its comb, nepers^2."""

NOTHING, CHANNEL = (0.0, 0.003, 0.01), (0.1, 0.3, 1.0, 3.0)
"""The same as shares of the comb's own, where nothing is beside it but what the law does
not say exactly, and where a bottom sounds. They are chosen, on the draws of
studies/constants/fringe_water.py."""

STRENGTH_VARIANCE = 0.25
"""Variance of the strength of a comb's parts, nepers^2."""

PARTS = ((0.3, 0), (0.3, 1), (0.3, 2), (0.7, 0), (0.7, 1), (0.95, 0), (0.95, 1))
"""Depths of the dark bands of a comb, as ratios of amplitudes, and powers of log frequency
with which their strength changes: what is linear in a comb."""

FIRST = np.array([depth * (power == 0) for depth, power in PARTS])
"""What each has of the first harmonic in the middle of the band."""

ORDERS = range(1, 7)
"""Harmonics of the logarithm of two ways' interference that are summed."""

CYCLES, FEWEST, STEP = 64.0, 0.6, 0.08
"""Most and fewest fringes in the band that are tried, and their step."""

PHASES = (0.0, 0.5, 1.0, 1.5)
"""Of the reflections that are asked, in half turns; the first is the surface's."""

LARGEST_BLUR = 0.35
"""Cycles over a knot at the lowest frequency: beyond, no comb is seen anywhere."""

LEAST_LOG_ODDS, LARGEST_SHARE = 3.0, 0.15
"""Evidence for one comb, nepers, from which its delay is taken, and the deviation up to
which it is, as a share (tests/draws/fringe_rates.py)."""

MODEL_SHARE = 0.03
"""Deviation of the delay, as a share, by what neither law nor comb say exactly."""


class Mirror(NamedTuple):
    """Delay of the surface's image at the closest approach."""

    delay_s: float
    """By how much later it arrives, s."""
    share: float
    """Standard deviation of that, as a share of it."""
    log_odds: float
    """Evidence for one comb over a pattern of any other shape, nepers."""
    alone: float
    """Evidence for nothing beside it over a rest, nepers."""

    @property
    def is_evident(self) -> bool:
        """Whether its delay can be used."""
        return self.log_odds >= LEAST_LOG_ODDS and self.share <= LARGEST_SHARE


def mirror_of(
    panel: Panel, passage: Hypothesis, template: Template, misfit: float, lowest_hz: float
) -> Mirror:
    """Return the likeliest delay of a comb in a passage's pattern.

    ``misfit``: what the evidence is divided by. ``lowest_hz``: middle of the panel's lowest
    cell.
    """
    model = FringeModel(panel, [template])
    information, right, place = model.information(passage)
    eigenvalue, axes = np.linalg.eigh(information / misfit)
    eigenvalue, heard = np.maximum(eigenvalue, 0.0), right / misfit @ axes
    frequency_hz = lowest_hz * np.exp(panel.cell * place)
    blur = panel.cell * max(1.0, template.knots)
    delay_s = np.arange(FEWEST, CYCLES, STEP) / frequency_hz[-1]
    delay_s = delay_s[delay_s * frequency_hz[0] * blur < LARGEST_BLUR]
    bend = np.linspace(-1.0, 1.0, place.size)
    waves = _waves(delay_s[:, None] * frequency_hz, blur)
    turned = axes.astype(np.float32)
    combs = [_combs(phase, waves, bend) @ turned for phase in PHASES]

    def told(variance: float, comb: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        kept = 1.0 + variance * eigenvalue
        gain, strength = _gains(comb, eigenvalue / kept, heard / kept)
        return gain + rest(variance), strength

    def rest(variance: float) -> float:
        kept = 1.0 + variance * eigenvalue
        return 0.5 * float((variance * heard**2 / kept - np.log(kept)).sum())

    every = np.array([[told(each, comb)[0] for comb in combs] for each in RESTS])
    each_phase = _mean(np.swapaxes(every, 0, 1).reshape(len(PHASES), -1))
    likely = np.logaddexp.reduce(every[:, 0], axis=0)
    weight = np.exp(likely - np.logaddexp.reduce(likely))
    mean = float(weight @ np.log(delay_s))
    share = float(np.sqrt(weight @ (np.log(delay_s) - mean) ** 2))
    odds = float(each_phase[0] - max(*map(rest, RESTS), *each_phase[1:]))
    # what is beside the comb, by the comb's own variance
    best, at = np.unravel_index(np.argmax(every[:, 0]), every[:, 0].shape)
    strength = told(RESTS[best], combs[0])[1][at]
    own = float(((strength @ combs[0][at]) ** 2).mean())
    nothing, channel = (
        max(float(_mean(told(own * each, combs[0])[0])) for each in shares)
        for shares in (NOTHING, CHANNEL)
    )
    return Mirror(
        float(np.exp(mean)), float(np.hypot(share, MODEL_SHARE)), odds,
        nothing - max(channel, *map(rest, RESTS)),
    )  # fmt: skip


def _mean(log_values: FloatArray) -> FloatArray:
    """Return the logarithm of the mean of values along the last axis."""
    total = np.logaddexp.reduce(log_values, axis=-1)
    return np.asarray(total - np.log(log_values.shape[-1]))


def _waves(cycles: FloatArray, blur: float) -> list[NDArray[np.complex64]]:
    """Return the harmonics of combs over some cycles, of shape (delay, coefficient)."""
    turn = np.exp(2j * np.pi * cycles).astype(np.complex64)
    found, wave = [], np.ones_like(turn)
    for order in ORDERS:
        wave = wave * turn
        share = np.sinc((order * blur) * cycles.astype(np.float32))
        found.append(wave * share)
    return found


def _combs(
    phase: float, waves: Sequence[NDArray[np.complex64]], bend: FloatArray
) -> NDArray[np.float32]:
    """Return combs of some delays and what changes their strength.

    The logarithm of 1 + r^2 - 2 r cos is - sum of 2 r^n cos(n .) / n. Shape (delay, part,
    coefficient). ``phase``: of the reflection, in half turns from one that turns the sound
    round.
    """
    turned = [
        -(wave * np.exp(1j * np.pi * phase * k).astype(np.complex64)).real
        for k, wave in zip(ORDERS, waves, strict=True)
    ]
    shapes = {
        depth: np.tensordot([2.0 * depth**k / k for k in ORDERS], turned, 1) for depth, _ in PARTS
    }
    found = [shapes[depth] * bend**power for depth, power in PARTS]
    return np.stack(found, 1).astype(np.float32)


def _gains(
    combs: NDArray[np.float32], precision: FloatArray, value: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what a comb of each delay gains beside a rest, nepers, and its strength.

    Shapes (delay,) and (delay, part).
    """
    heavy = combs * precision.astype(np.float32)
    seen = (heavy @ np.swapaxes(combs, 1, 2)).astype(float)
    root = np.linalg.cholesky(np.eye(combs.shape[1]) + STRENGTH_VARIANCE * seen)
    heard = combs @ value
    # all delays at once, part by part: solving each by itself is most of the cost
    half, strength = np.zeros_like(heard), np.zeros_like(heard)
    parts = range(combs.shape[1])
    for k in parts:
        known = (root[:, k, :k] * half[:, :k]).sum(axis=1)
        half[:, k] = (heard[:, k] - known) / root[:, k, k]
    for k in reversed(parts):
        known = (root[:, k + 1 :, k] * strength[:, k + 1 :]).sum(axis=1)
        strength[:, k] = (half[:, k] - known) / root[:, k, k]
    gain = 0.5 * STRENGTH_VARIANCE * (half**2).sum(axis=1)
    gain -= np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    gain = np.where(strength @ FIRST > 0.0, gain, -np.inf)
    return np.asarray(gain), STRENGTH_VARIANCE * strength
