"""Families are sought again where lines have moved since they were sought last.

**Method.** The test of combs costs more than all else when there are many lines, and most
machines run steadily: as long as the same lines are where they were, to a small part of
the width of a tooth, what was found last still holds.

**Conventions.** Lines are given in the order of frequency.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.lines.families.comb_test import CombRule
from uwtrack_cli.lines.families.harmonics import Comb, find_combs

MOVED = 0.2
"""Change of a frequency, in deviations, from which families are sought again: a tooth is
several deviations wide."""

SIGMA_CHANGE = 0.05
"""Relative change of the deviation from which they are sought again, too."""


class LastLook:
    """Remembers what was found when families were sought last."""

    def __init__(self) -> None:
        self.lines: IntArray | None = None
        self.frequency_hz: FloatArray = np.empty(0)
        self.sigma_hz = 0.0
        self.found: tuple[list[Comb], FloatArray] = ([], np.empty(0))

    def find_combs(
        self,
        lines: IntArray,
        frequency_hz: FloatArray,
        bearing_deg: FloatArray,
        rule: CombRule,
        greatest_chance: float,
    ) -> tuple[list[Comb], FloatArray]:
        """Find families as `harmonics.find_combs` does, or remember them.

        ``lines`` are the numbers of the lines that the frequencies and bearings are of;
        where any bearing is known, families are always sought.
        """
        if not (
            self._is_same(lines, frequency_hz, rule) and np.isnan(bearing_deg).all()
        ):
            self.found = find_combs(frequency_hz, bearing_deg, rule, greatest_chance)
            self.lines, self.frequency_hz = lines, frequency_hz
            self.sigma_hz = rule.sigma_hz
        return self.found

    def _is_same(
        self, lines: IntArray, frequency_hz: FloatArray, rule: CombRule
    ) -> bool:
        if self.lines is None or not np.array_equal(lines, self.lines):
            return False
        if abs(rule.sigma_hz - self.sigma_hz) > SIGMA_CHANGE * self.sigma_hz:
            return False
        moved = np.abs(frequency_hz - self.frequency_hz).max()
        return bool(moved < MOVED * self.sigma_hz)
