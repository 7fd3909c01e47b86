"""Which of several contacts moves: decisions with their odds over time."""

from dataclasses import dataclass
from typing import ClassVar

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
    of its own: its odds are those of the last scan. "both move" and "neither fits"
    say that the measurements reject both hypotheses.
    """

    NAME: ClassVar[str] = "decision"
    ROW: ClassVar[str] = "pair"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("filter", "hypothesis")

    first_contact: IntArray = column("First contact.")
    second_contact: IntArray = column("Second contact.")
    verdict: TextArray = column(
        "'first moves', 'second moves', 'undecided', 'both move' or 'neither fits'."
    )
    probability: FloatArray = column(
        "Probability of the likelier hypothesis, both alike at first; nan where both are rejected."
    )
    final_log_odds: FloatArray = column("Log odds at the decision, or at the last scan.")
    decision_time_s: FloatArray = column("Time of the decision; nan without one.")
    decision_scan: IntArray = column(
        "Scans taken for it, the first included; 0 without a decision."
    )
    expected_scans: FloatArray = column(
        "Mean number of scans to a decision at this growth of the odds."
    )
    fixed_scans: FloatArray = column("Scans that a test of fixed length needs for the same errors.")
    fixed_verdict: TextArray = column("What that test says; empty where the scans do not suffice.")
    consistency: FloatArray = column(
        "Probability of an innovation as large as that of each filter.", "pair", "filter"
    )
    inverse_range_std: FloatArray = column(
        "Relative standard deviation of the drifting filter's range: second, first contact.",
        "pair",
        "hypothesis",
    )
    observable: BoolArray = column(
        "Whether that range was observable: second, first contact.", "pair", "hypothesis"
    )
    reason_pair: IntArray = column(
        "Row of the pair that a reason belongs to.", "reason", owner="pair"
    )
    scan_pair: IntArray = column("Row of the pair.", "scan", owner="pair")
    scan_time_s: FloatArray = column("Time of the scan.", "scan")
    log_odds: FloatArray = column("Log odds after the scan.", "scan")
    log_likelihood: FloatArray = column(
        "Sum of the log likelihoods of each filter so far.", "scan", "filter"
    )
    lower_threshold: float = scalar("Log odds that decide for 'first moves'.")
    upper_threshold: float = scalar("Log odds that decide for 'second moves'.")
    miss_probability: float = scalar("Miss probability allowed to each pair.")
    false_alarm_probability: float = scalar("False alarm probability allowed to each pair.")
    moving_contact: int = scalar(
        "The contact that was found moving against all others; 0 for none."
    )
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)

    @property
    def statements(self) -> tuple[str, ...]:
        """The verdict of every pair in words."""
        return tuple(map(self._statement, range(self.verdict.size)))

    def _statement(self, pair: int) -> str:
        first, second = int(self.first_contact[pair]), int(self.second_contact[pair])
        verdict = str(self.verdict[pair])
        if verdict == "both move":
            return f"both contacts move: {first} and {second}."
        if verdict == "neither fits":
            return (
                f"neither hypothesis fits: neither contact {first} nor contact {second} can "
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
