"""Which of several contacts moves: decisions with their odds over time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    BoolArray,
    FloatArray,
    HasReasons,
    IntArray,
    TextArray,
    column,
    scalar,
)

FILTERS = ("first moves", "second drifts", "first drifts", "second moves")
"""The axis ``filter``: two under the hypothesis that the first contact moves (and the
second is a stationary repeater), two under its opposite."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision(HasReasons):
    """One row per pair of contacts, and one row per scan of a pair.

    Log odds are positive for "the second contact moves". An undecided pair is a result
    of its own: its odds are those of the last scan. "both move" and "neither reading"
    say that the measurements reject both hypotheses.
    """

    NAME: ClassVar[str] = "decision"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("filter", "hypothesis")

    first_contact: IntArray = column("1", "First contact.", "pair", dtype=np.int64)
    second_contact: IntArray = column("1", "Second contact.", "pair", dtype=np.int64)
    verdict: TextArray = column(
        "",
        "'first moves', 'second moves', 'undecided', 'both move' or 'neither reading'.",
        "pair",
        dtype=np.str_,
    )
    probability: FloatArray = column(
        "1",
        "Probability of the likelier hypothesis, both alike at first; nan where both "
        "are rejected.",
        "pair",
    )
    final_log_odds: FloatArray = column(
        "1", "Log odds at the decision, or at the last scan.", "pair"
    )
    decision_time_s: FloatArray = column(
        "s", "Time of the decision; nan without one.", "pair"
    )
    decision_scan: IntArray = column(
        "1", "Scans taken for it, the first included; 0 without a decision.", "pair",
        dtype=np.int64,
    )  # fmt: skip
    expected_scans: FloatArray = column(
        "1", "Mean number of scans to a decision at this growth of the odds.",
        "pair",
    )  # fmt: skip
    fixed_scans: FloatArray = column(
        "1", "Scans that a test of fixed length needs for the same errors.", "pair"
    )
    fixed_verdict: TextArray = column(
        "", "What that test says; empty where the scans do not suffice.", "pair",
        dtype=np.str_,
    )  # fmt: skip
    consistency: FloatArray = column(
        "1", "Probability of an innovation as large as that of each filter.",
        "pair", "filter",
    )  # fmt: skip
    inverse_range_std: FloatArray = column(
        "1", "Relative deviation of the drifting filter's range: second, first contact.",
        "pair", "hypothesis",
    )  # fmt: skip
    observable: BoolArray = column(
        "1", "Whether that range was observable: second, first contact.",
        "pair", "hypothesis", dtype=np.bool_,
    )  # fmt: skip
    reason_pair: IntArray = column(
        "1", "Row of the pair that a reason belongs to.", "reason",
        dtype=np.int64, owner="pair",
    )  # fmt: skip
    scan_pair: IntArray = column(
        "1", "Row of the pair.", "scan", dtype=np.int64, owner="pair"
    )
    scan_time_s: FloatArray = column("s", "Time of the scan.", "scan")
    log_odds: FloatArray = column("1", "Log odds after the scan.", "scan")
    log_likelihood: FloatArray = column(
        "1", "Sum of the log likelihoods of each filter so far.", "scan", "filter"
    )
    lower_threshold: float = scalar("1", "Log odds that decide for 'first moves'.")
    upper_threshold: float = scalar("1", "Log odds that decide for 'second moves'.")
    miss_probability: float = scalar("1", "Miss probability allowed to each pair.")
    false_alarm_probability: float = scalar(
        "1", "False alarm probability allowed to each pair."
    )
    moving_contact: int = scalar(
        "1", "The contact that was found moving against all others; 0 for none."
    )
    start_utc_ns: int | None = scalar("ns", "UTC epoch of time zero.", None)

    @property
    def statements(self) -> tuple[str, ...]:
        """The verdict of every pair in words."""
        return tuple(map(self._statement, range(self.verdict.size)))

    def _statement(self, pair: int) -> str:
        first, second = int(self.first_contact[pair]), int(self.second_contact[pair])
        verdict = str(self.verdict[pair])
        if verdict == "both move":
            return f"both contacts move: {first} and {second}."
        if verdict == "neither reading":
            return (
                f"neither reading fits: neither contact {first} nor contact {second} can "
                "be the moving one with the other a stationary repeater."
            )
        odds = f"probability {self.probability[pair]:.4g}"
        if verdict == "undecided":
            likelier = second if self.final_log_odds[pair] > 0.0 else first
            return (
                f"undecided between contacts {first} and {second}: it is likelier that "
                f"contact {likelier} moves ({odds})."
            )
        moving, still = (first, second) if verdict == "first moves" else (second, first)
        return (
            f"contact {moving} moves, contact {still} is a stationary repeater ({odds}, "
            f"after {self.decision_scan[pair]} scans at "
            f"{self.decision_time_s[pair]:g} s)."
        )
