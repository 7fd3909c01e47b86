"""The evidence that combs reach by chance, in white noise and in the recording's own.

**Method.** The greatest evidence of a window of noise grows with the logarithm of the
combs that are asked for, and its tail is exponential. What combs out of tune reach in the
recording beyond that, by its stray lines and the shape of its noise, is a mean over the
windows so far. Thresholds are raised by it.

**Conventions.** Evidence in nepers; rates are of combs an hour, at any fundamental.

**References.** Gumbel, "Statistics of Extremes" (1958), for the tail.
"""

from dataclasses import dataclass

import numpy as np

WHITE_OFFSET, WHITE_SLOPE = -6.8, 1.09
"""Mean of the greatest evidence in a window of white noise, and what it gains as the combs
that are asked for grow by e (`studies.constants.combs noise 4100 24`)."""

SURROGATE_LESS = 0.26
"""By how much less combs out of tune reach in white noise, of every third fundamental (same
script)."""

TAIL = 1.12
"""Nepers by which such maxima become rarer by e (same script)."""

EULER = 0.5772
"""Mean of Gumbel's distribution over its mode, in its scale."""

CONTINUATION = 30.0
"""Factor on the rate where a comb is expected: few places, not all fundamentals."""

REMAINDER = 1e3
"""Factor on the rate at which combs may come by chance without their loudest tooth."""


@dataclass
class CombThreshold:
    """Thresholds of the windows of a recording, as it has been heard so far."""

    false_combs_per_hour: float
    """Combs that noise alone may cause in an hour."""
    n_hypotheses: int
    """Combs that are asked for in a window."""
    step_s: float
    """Time from window to window, s."""
    total: float = 0.0
    """Sum over the windows of what combs out of tune reached beyond white noise."""
    windows: int = 0
    """Windows so far."""
    passed: float = 0.0
    """Sum over the windows of the factor by which raised thresholds cut the rate."""

    @property
    def white(self) -> float:
        """Mean of the greatest evidence in a window of white noise, nepers."""
        return WHITE_OFFSET + WHITE_SLOPE * float(np.log(max(self.n_hypotheses, 1)))

    @property
    def white_surrogate(self) -> float:
        """The same of the combs out of tune, nepers."""
        return self.white - SURROGATE_LESS

    def excess(self, surrogate: float) -> float:
        """Return by how much the recording's noise exceeds white noise, nepers.

        By the windows so far, and what combs out of tune reach in this one.
        """
        total = self.total + surrogate - self.white_surrogate
        return max(total / (self.windows + 1), 0.0)

    def new(self, excess: float) -> float:
        """Return the evidence that a comb needs to begin, nepers."""
        per_hour = 3600.0 / self.step_s
        mode = self.white - EULER * TAIL
        return (
            mode + TAIL * float(np.log(per_hour / self.false_combs_per_hour)) + excess
        )

    def continued(self, excess: float) -> float:
        """Return the evidence that a comb needs where one is expected, nepers."""
        return self.new(excess) - TAIL * float(np.log(CONTINUATION))

    def remainder(self, excess: float) -> float:
        """Return the evidence that a comb needs without its loudest tooth, nepers."""
        return self.new(excess) - TAIL * float(np.log(REMAINDER))

    def note(self, surrogate: float) -> None:
        """Enter a window by what combs out of tune reached in it."""
        self.passed += float(np.exp(-self.excess(surrogate) / TAIL))
        self.total += surrogate - self.white_surrogate
        self.windows += 1

    def measured_per_hour(self) -> float:
        """Return the rate of false combs as the recording tells it; nan without any."""
        if not self.windows:
            return float("nan")
        left = self.total / self.windows
        return float(
            self.false_combs_per_hour * np.exp(left / TAIL) * self.passed / self.windows
        )
