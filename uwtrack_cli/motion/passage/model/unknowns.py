"""Unknowns of a passage, what may change once beside it, and the law they give.

**Conventions.** Unknowns, in this order: t0 (s), ln of the horizontal range over speed
(s), v (m/s), the natural logarithm of the floor relative to the level at closest
approach, and, where it has a prior, the depth difference of sensor and source (m).
What changed beside the passage (`Change`) has its unknowns behind these. The first axis
is the batch.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.motion.passage.model.law import Passage, passage_law, with_other_leg
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.steady_turn import SteadyTurn, with_steady_turn

FLOOR, HEIGHT, CHANGED = 3, 4, 5
"""Places of the floor, the depth difference and the changes among the unknowns."""

STEP, RAMP, MANOEUVRE = "frequency-step", "frequency-ramp", "manoeuvre"
TURN = "steady-turn"
"""A manoeuvre that is no change at once: the course changes evenly for a while."""

FREE_INSTANTS = (RAMP, TURN)
"""Changes whose instant is fitted with the other unknowns, the last of them."""

CHANGE_STD = {STEP: (0.02,), RAMP: (2e-4, 1e4), MANOEUVRE: (4.0, 4.0), TURN: (1.5, 600.0, 1e4)}
"""Deviations of the changes before the fit: share of all rest frequencies; the same per
second, and the instant, s; velocity along and across the course, m/s; change of course
in a steady turn, rad, how long it lasts, s, and its middle, s."""

N_SIZES = {STEP: 1, RAMP: 1, MANOEUVRE: 2, TURN: 1}
"""How many of these are sizes. A step and a manoeuvre make the frequencies jump, so
that their instants are sought one by one; those of `FREE_INSTANTS` are fitted."""

SHORTEST_TURN_S = 1.0
"""A steady turn lasts at least so long."""


@dataclass(frozen=True)
class Change:
    """What changed once beside the passage: all rest frequencies, or the velocity.

    Its unknowns stand behind the depth difference: the step of the rest frequencies as
    a share, their slope (1/s) and what its instant is later by (s), the differences
    of the velocity along the course and away from the sensor (m/s), or the angle of a
    steady turn (rad, away from the sensor), its duration (s) and what its middle is
    later by (s).
    """

    kind: str
    """'frequency-step', 'frequency-ramp', 'manoeuvre' or 'steady-turn'."""
    time_s: FloatArray
    """When it was, s: received for the frequencies, geometric for a manoeuvre and for
    the middle of a turn; shape (batch,)."""
    sign: FloatArray
    """+1 where what changed follows that instant, -1 where it goes before, same shape."""

    @property
    def std(self) -> FloatArray:
        """Deviations of its unknowns before the fit."""
        return np.array(CHANGE_STD[self.kind])

    def law(self, straight: Passage, theta: FloatArray, time_s: FloatArray,
            medium: Medium) -> Passage:  # fmt: skip
        """Put the change into a straight passage.

        Parameters
        ----------
        straight
            The passage with the partials by the depth difference.
        theta
            Unknowns, with those of the change.
        time_s
            Times in seconds.
        medium
            Sound speed.
        """
        if self.kind == MANOEUVRE:
            change = (self.time_s, self.sign, theta[:, CHANGED:])
            return with_other_leg(
                straight, time_s, theta[:, :3], change, medium.sound_speed_mps, theta[:, HEIGHT]
            )
        if self.kind == TURN:
            return self.turned(theta, time_s, medium)
        count = CHANGED + self.std.size
        rows = np.zeros((*straight.rows.shape[:2], count, time_s.size))
        rows[:, :, :5] = straight.rows
        moved = self
        if self.kind == RAMP:
            moved = replace(self, time_s=self.time_s + theta[:, CHANGED + 1])
            is_changed = moved.shape(time_s) != 0.0
            slope = theta[:, CHANGED, None]
            rows[:, 0, 6] = np.where(is_changed, -slope * (1 + straight.shift), 0.0)
        shape = moved.shape(time_s)
        factor = 1 + theta[:, CHANGED, None] * shape
        rows[:, 0, 5] = (1 + straight.shift) * shape
        rows[:, 0, :5] *= factor[:, None]
        rows[:, 0, 0] += factor - 1
        return Passage(rows)

    def turned(self, theta: FloatArray, time_s: FloatArray, medium: Medium) -> Passage:
        """Return the passage with a steady turn.

        Parameters
        ----------
        theta
            Unknowns, with those of the turn.
        time_s
            Times in seconds.
        medium
            Sound speed.
        """
        angle, duration, later = theta[:, CHANGED:].T
        turn = SteadyTurn(angle, duration, self.time_s + later)
        return with_steady_turn(
            time_s, theta[:, :3], turn, medium.sound_speed_mps, theta[:, HEIGHT]
        )

    def shape(self, time_s: FloatArray) -> FloatArray:
        """Return what a frequency does for each unit of its change, shape (batch, n).

        Parameters
        ----------
        time_s
            Times in seconds.
        """
        lag = time_s - self.time_s[:, None]
        is_changed = self.sign[:, None] * lag > 0
        return np.where(is_changed, lag if self.kind == RAMP else 1.0, 0.0)


def free_unknowns(theta: FloatArray, blocks: Blocks, medium: Medium) -> BoolArray:
    """Return which unknowns the data can determine.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    blocks
        Measurements in fit units.
    medium
        The depth difference: known exactly, or with a prior.
    """
    free = np.ones(theta.shape, dtype=np.bool_)
    free[:, 2] &= not blocks.shift.is_empty
    free[:, FLOOR] &= not blocks.level.is_empty
    if theta.shape[1] > HEIGHT and not medium.height_std_m:
        free[:, HEIGHT] = False
    return free


def motion_places(theta: FloatArray) -> list[int]:
    """Return the places of the motion among the unknowns: all but the floor.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    """
    return [n for n in range(theta.shape[-1]) if n != FLOOR]


def heights_m(theta: FloatArray, medium: Medium) -> FloatArray | float:
    """Return the depth difference of every row, or the one that is known.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    medium
        Sound speed and depth difference.
    """
    return theta[:, HEIGHT] if theta.shape[1] > HEIGHT else medium.height_m


def law_of(
    theta: FloatArray, time_s: FloatArray, medium: Medium, change: Change | None = None
) -> Passage:
    """Evaluate the passage of every row.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    time_s
        Times in seconds.
    medium
        Sound speed and depth difference.
    change
        What changed beside the passage, or None.
    """
    if change is not None and change.kind == TURN:
        return change.turned(theta, time_s, medium)
    c, height = medium.sound_speed_mps, heights_m(theta, medium)
    free = theta.shape[1] > HEIGHT
    if theta.shape[0] == 1:
        known = float(np.ravel(height)[0])
        one = passage_law(time_s, theta[0, :3], c, known, with_height=free)
        law = Passage(one.rows[None])
    else:
        law = passage_law(time_s, theta[:, :3], c, height, with_height=free)
    return law if change is None else change.law(law, theta, time_s, medium)
