"""When two tracked lines have become one.

**Method.** Lines that are nearer than half a resolution, run alike and agree in bearing
are doubles. Of two, the tentative one ends; of two tentative ones the less likely, at
once; of two confirmed ones the later, if they stay together: two vessels' lines that
cross are close for a while, and go on as two.

**Conventions.** Lines are given by their slots in the bank.

**References.** None: a plain rule.
"""

import numpy as np

from uwtrack_cli.data.base import IntArray
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.lines.line_bank import CONFIRMED, ENDED, FREE, LineBank
from uwtrack_cli.stages.lines.policies import Gates

UNKNOWN_BEARING_VARIANCE = 1e8
"""Variance in degree^2 of a bearing that was never measured."""


def merge_lines(bank: LineBank, gates: Gates, resolution_hz: float) -> None:
    """End the lesser of two lines that have become one.

    Parameters
    ----------
    bank
        The lines.
    gates
        When two lines are one.
    resolution_hz
        Resolution of a frame in Hz.
    """
    near_hz = gates.merge_hz or 0.5 * resolution_hz
    slots, state = bank.active(), bank.state
    # two up in a frame together, one down in every frame
    np.maximum(bank.doubled - 1, 0, out=bank.doubled)
    position = state.position[0, slots]
    order = position.argsort(kind="stable")
    position, slots = position[order], slots[order]
    for gap in (1, 2):
        is_near = position[gap:] - position[:-gap] < near_hz
        if not is_near.any():
            break
        low, high = slots[:-gap][is_near], slots[gap:][is_near]
        slip = np.abs(state.rate[0, high] - state.rate[0, low])
        doubt = np.sqrt(state.rate_variance[0, high] + state.rate_variance[0, low])
        is_one = slip < gates.merge_rate_sigmas * doubt
        if bank.n_quantities == 2:
            turn = kalman.wrap_deg(state.position[1, high] - state.position[1, low])
            is_one &= (np.abs(turn) < gates.merge_deg) | (
                np.maximum(state.variance[1, high], state.variance[1, low])
                > 0.5 * UNKNOWN_BEARING_VARIANCE
            )
        _end_doubles(bank, gates, low[is_one], high[is_one])


def _end_doubles(bank: LineBank, gates: Gates, low: IntArray, high: IntArray) -> None:
    # one of the two may just have ended beside a third
    both = (bank.stage[low] != ENDED) & (bank.stage[high] != ENDED)
    both &= (bank.stage[low] != FREE) & (bank.stage[high] != FREE)
    low, high = low[both], high[both]
    if not low.size:
        return
    weaker = np.unique(_weaker(bank, low, high))
    bank.doubled[weaker] += 2
    is_confirmed = bank.stage[weaker] == CONFIRMED
    lasting = bank.doubled[weaker] >= gates.merge_frames
    bank.release(weaker[~is_confirmed | lasting])


def _weaker(bank: LineBank, low: IntArray, high: IntArray) -> IntArray:
    """Of two lines the tentative, the less likely or the later one, in this order."""
    sure = (bank.stage[low] == CONFIRMED) * 1 - (bank.stage[high] == CONFIRMED)
    score = np.where(sure == 0, bank.score[low] - bank.score[high], 0.0)
    # between confirmed lines, whose scores have no bound, age decides
    score[bank.stage[low] + bank.stage[high] == 2 * CONFIRMED] = 0.0
    age = bank.serial[high] - bank.serial[low]
    lead = np.where(sure != 0, sure, np.where(score != 0.0, score, age))
    return np.where(lead < 0, low, high)
