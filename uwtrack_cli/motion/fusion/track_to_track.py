"""Which encounters are one vessel, and the motions that explain them.

**Method.** Encounters of different sensors are joined, the likeliest pair first, while
the joint motion passes a chi-square gate on time, course and speed and the rest
frequencies agree. A partition's rivals that pass the gate too are kept as modes.

**Conventions.** Weights of the modes of a vessel sum to one. Groups are rows of all
encounters.

**References.** Bar-Shalom, Willett and Tian (2011), section 8.4 (track association).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.constant_velocity import carried_on
from uwtrack_cli.motion.fusion.motion_fit import fit_motion, motion_starts
from uwtrack_cli.motion.fusion.sensor_table import Passages

SMALLEST_WEIGHT = 1e-3
"""Modes less likely than this are left out."""

FREQUENCY_TOLERANCE = 2e-3
"""Relative change of a shaft's rate that is allowed between two sensors."""


@dataclass(frozen=True)
class Mode:
    """One motion that explains a group of encounters."""

    members: tuple[int, ...]
    """Rows of the encounters that it explains."""
    reference_s: float
    """Time of the state, s."""
    state: FloatArray
    """East, north (m), east and north velocity (m/s), shape (4,)."""
    covariance: FloatArray
    """Covariance of the state, shape (4, 4)."""
    chi_square: float
    """Weighted sum of squares of the fit."""
    degrees_of_freedom: int
    """Measured values less four."""
    weight: float
    """Probability of the mode; those of a vessel sum to one."""

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states, shape (n, 4), and covariances at times on its straight leg."""
        return carried_on(self.state, self.covariance, times_s - self.reference_s)


def find_modes(passages: Passages, members: tuple[int, ...]) -> list[Mode]:
    """Fit the motions of a group of encounters, given by their rows, best first."""
    group = passages.approaches.take(list(members))
    if int(np.isfinite(group.measured).sum()) < 4:
        return []
    reference = float(np.mean(group.measured[:, 0]))
    starts = motion_starts(group, reference)
    if not starts.shape[0]:
        return []
    fit = fit_motion(group, starts, reference)
    good = np.isfinite(fit.covariance).all(axis=(1, 2)) & np.isfinite(fit.chi_square)
    order = [int(n) for n in np.argsort(fit.chi_square) if good[n]]
    kept: list[int] = []
    for row in order:
        if fit.chi_square[row] - fit.chi_square[order[0]] > -2 * np.log(SMALLEST_WEIGHT):
            break
        if all(_is_apart(fit.state[row], fit.state[k], fit.covariance[k]) for k in kept):
            kept.append(row)
    likelihood = (
        np.exp(-0.5 * (fit.chi_square[kept] - fit.chi_square[order[0]])) if (kept) else np.empty(0)
    )
    return [
        Mode(
            members, reference, fit.state[row], fit.covariance[row],
            float(fit.chi_square[row]), fit.degrees_of_freedom, float(share),
        )
        for row, share in zip(kept, likelihood / likelihood.sum(), strict=True)
    ]  # fmt: skip


def _is_apart(state: FloatArray, other: FloatArray, covariance: FloatArray) -> bool:
    step = state - other
    distance = float(step @ np.linalg.solve(covariance, step))
    return distance > 1.0


def group_encounters(passages: Passages, gate_probability: float) -> list[tuple[int, ...]]:
    """Join the encounters of one vessel, which pass the gate with a probability."""
    groups: list[tuple[int, ...]] = [(row,) for row in range(len(passages.contact))]
    while True:
        best: tuple[float, tuple[int, ...], tuple[int, ...]] | None = None
        for number, first in enumerate(groups):
            for second in groups[number + 1 :]:
                value = joint_probability(passages, first, second)
                if value > 1 - gate_probability and (best is None or value > best[0]):
                    best = (value, first, second)
        if best is None:
            return sorted(groups)
        _, first, second = best
        groups = [g for g in groups if g not in {first, second}]
        groups.append(tuple(sorted(first + second)))


def list_modes(
    passages: Passages, groups: list[tuple[int, ...]], gate_probability: float
) -> list[list[Mode]]:
    """List the modes of every vessel: its motions, and rival pairings."""
    own = {group: find_modes(passages, group) for group in groups}
    listed: list[list[Mode]] = []
    for group in groups:
        modes = own[group]
        for rival, chosen in _rivals(passages, group, groups):
            if _passes(passages, rival, gate_probability):
                modes = _mix(modes, find_modes(passages, rival), own[chosen], group)
        listed.append(sorted(modes, key=lambda mode: -mode.weight))
    return listed


def _rivals(
    passages: Passages, group: tuple[int, ...], groups: list[tuple[int, ...]]
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Pair groups with one member exchanged with the group that was joined instead."""
    found = []
    for other in groups:
        if other == group:
            continue
        for mine in group:
            for theirs in other:
                if passages.sensor[mine] != passages.sensor[theirs]:
                    continue
                if len(group) > 1:
                    swapped = tuple(sorted({*group, theirs} - {mine}))
                    found.append((swapped, group))
                elif len(other) > 1:
                    swapped = tuple(sorted({*other, mine} - {theirs}))
                    found.append((swapped, other))
    return found


def _passes(passages: Passages, members: tuple[int, ...], probability: float) -> bool:
    first, rest = members[:1], members[1:]
    return joint_probability(passages, first, rest) > 1 - probability


def _mix(
    modes: list[Mode], rivals: list[Mode], chosen: list[Mode], group: tuple[int, ...]
) -> list[Mode]:
    """Weigh the rival pairing against the chosen one by their likelihoods."""
    if not rivals or not chosen:
        return modes
    odds = float(np.exp(0.5 * (chosen[0].chi_square - rivals[0].chi_square)))
    share = odds / (1 + odds)
    if share < SMALLEST_WEIGHT or (len(group) == 1 and not modes):
        return modes
    kept = [replace(mode, weight=mode.weight * (1 - share)) for mode in modes]
    return kept + [replace(mode, weight=mode.weight * share) for mode in rivals]


def joint_probability(passages: Passages, first: tuple[int, ...], second: tuple[int, ...]) -> float:
    """Return the tail probability that two groups are one vessel; 0 if impossible."""
    from scipy.special import chdtrc

    members = tuple(sorted(first + second))
    names = [passages.sensor[row] for row in members]
    if len(set(names)) < len(names):
        return 0.0
    if not _frequencies_agree(passages, first, second):
        return 0.0
    modes = find_modes(passages, members)
    if not modes:
        return 0.0
    freedom = modes[0].degrees_of_freedom
    if freedom <= 0:
        return 1.0
    return float(chdtrc(freedom, modes[0].chi_square))


def _frequencies_agree(passages: Passages, first: tuple[int, ...], second: tuple[int, ...]) -> bool:
    """Return whether at least half of the shorter list of lines has a partner."""
    ours = np.concatenate([passages.rest[row] for row in first])
    theirs = np.concatenate([passages.rest[row] for row in second])
    if not ours.size or not theirs.size:
        return True
    apart = np.abs(ours[:, None, 0] - theirs[None, :, 0])
    allowed = 3 * np.hypot(ours[:, None, 1], theirs[None, :, 1])
    allowed = np.hypot(allowed, FREQUENCY_TOLERANCE * ours[:, None, 0])
    close = apart < allowed
    partners = min(int(close.any(axis=1).sum()), int(close.any(axis=0).sum()))
    return bool(2 * partners >= min(ours.shape[0], theirs.shape[0]))
