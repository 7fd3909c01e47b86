"""The track of one target through clutter."""

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Target(Container):
    """One row per scan: the estimate after it, and how it was come by.

    The state interleaves each component with its rate: z_1, v_1, z_2, v_2 ... The
    associations list every measurement that took part, with its probability.
    """

    NAME: ClassVar[str] = "target"
    ROW: ClassVar[str] = "scan"
    FIXED_AXES: ClassVar[tuple[str, ...]] = (
        "dimension", "state", "state_too", "model",
    )  # fmt: skip

    scan: IntArray = column("Number of the scan.")
    time_s: FloatArray = column("Time of the scan.")
    state: FloatArray = column(
        "Components and their rates per second.", "scan", "state", unit=""
    )
    state_covariance: FloatArray = column(
        "Covariance of the state.", "scan", "state", "state_too", unit=""
    )
    model_probability: FloatArray = column(
        "Probability of each motion model, quiet first.", "scan", "model"
    )
    false_alarm_probability: FloatArray = column(
        "Operating point of the detector, per cell."
    )
    detection_probability: FloatArray = column(
        "Probability that the target crosses the threshold."
    )
    threshold: FloatArray = column("Threshold used on the amplitude.")
    gate: FloatArray = column("Radius of the validation region in standard deviations.")
    gate_volume: FloatArray = column(
        "Volume of the validation region, in the units of the components.", unit=""
    )
    expected_clutter: FloatArray = column(
        "Mean number of false measurements in the region."
    )
    validated: IntArray = column("Measurements in the region and above the threshold.")
    miss_probability: FloatArray = column(
        "Probability that none of them was the target's."
    )
    information_reduction: FloatArray = column(
        "Factor q2 that was expected of the scan."
    )
    score: FloatArray = column(
        "Log likelihood ratio of the track against clutter alone, so far."
    )
    loss_cusum: FloatArray = column(
        "Cumulative sum (Page 1954) that detects the loss of the target."
    )
    lost: BoolArray = column("Whether this sum is above its limit.")
    association_scan: IntArray = column(
        "Number of the scan of the association.", "association"
    )
    association_row: IntArray = column(
        "Row of its measurement in the table of scans, from 0.", "association"
    )
    association_probability: FloatArray = column(
        "Probability that the measurement was the target's.", "association"
    )
    component: TextArray = column("Name of each component.", "dimension")
    component_unit: TextArray = column(
        "Unit of each component; empty if not given.", "dimension"
    )
    threshold_rule: str = scalar("How the threshold was chosen.")
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)

    @property
    def state_std(self) -> FloatArray:
        """Standard deviations of the state, ``(scan, state)``."""
        variance = np.diagonal(self.state_covariance, axis1=-2, axis2=-1)
        deviation: FloatArray = np.sqrt(variance)
        return deviation

    @property
    def statements(self) -> tuple[str, ...]:
        """The outcome of the track in words."""
        n_scans = self.scan.size
        lost = np.flatnonzero(self.lost)
        if lost.size and self.lost[-1]:
            first = int(lost[np.flatnonzero(np.diff(lost, prepend=-2) > 1)[-1]])
            outcome = (
                f"the target is lost from scan {self.scan[first]} at "
                f"{self.time_s[first]:g} s on: its score no longer rises."
            )
        else:
            outcome = (
                f"the target was followed through {n_scans} scans to "
                f"{self.time_s[-1]:g} s."
            )
        values, deviations = self.state[-1], self.state_std[-1]
        parts = [
            f"{name} = {values[2 * i]:.6g} ± {deviations[2 * i]:.2g}{unit}, "
            f"rate {values[2 * i + 1]:.4g} ± {deviations[2 * i + 1]:.2g}{unit and unit + '/s'}"
            for i, (name, unit) in enumerate(
                zip(self.component, self._units(), strict=True)
            )
        ]
        return outcome, f"at the last scan: {'; '.join(parts)}."

    def _units(self) -> list[str]:
        """Units of the components with a space before, empty where not given."""
        return [f" {unit}" if unit else "" for unit in self.component_unit.tolist()]
