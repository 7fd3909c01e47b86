"""Which of several contacts moves: decisions with their odds over time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uwtrack_cli.data.base import (
    BoolArray,
    Container,
    FloatArray,
    IntArray,
    TextArray,
    column,
    scalar,
)

FILTERS = ("first moves", "second drifts", "first drifts", "second moves")
"""The axis ``filter``: two under the hypothesis that the first contact moves (and the
second is a stationary repeater), two under its opposite."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision(Container):
    """One row per pair of contacts, and one row per scan of a pair.

    Log odds are positive for "the second contact moves". An undecided pair is a result
    of its own: its odds are those of the last scan.
    """

    NAME: ClassVar[str] = "decision"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("filter", "hypothesis")

    first_contact: IntArray = column("1", "First contact.", "pair", dtype=np.int64)
    second_contact: IntArray = column("1", "Second contact.", "pair", dtype=np.int64)
    verdict: TextArray = column(
        "", "'first moves', 'second moves' or 'undecided'.", "pair", dtype=np.str_
    )
    probability: FloatArray = column(
        "1", "Probability of the likelier hypothesis, both alike at first.", "pair"
    )
    final_log_odds: FloatArray = column(
        "1", "Log odds at the decision, or at the last scan.", "pair"
    )
    decision_time_s: FloatArray = column(
        "s", "Time of the decision; nan if undecided.", "pair"
    )
    decision_scan: IntArray = column(
        "1", "Scans taken for it, the first included; 0 if undecided.", "pair",
        dtype=np.int64,
    )  # fmt: skip
    expected_scans: FloatArray = column(
        "1", "Mean number of scans that a decision takes at this rate of evidence.",
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
        "1", "Whether bearings told that range at all: second, first contact.",
        "pair", "hypothesis", dtype=np.bool_,
    )  # fmt: skip
    reasons: TextArray = column(
        "", "What limits the decision, as a JSON object by key.", "pair", dtype=np.str_
    )
    scan_pair: IntArray = column("1", "Row of the pair.", "scan", dtype=np.int64)
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
