"""Tracks of targets through clutter."""

import math
from dataclasses import dataclass
from typing import ClassVar, Self

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

CLUTTER_SIGMAS = 4.0
"""Deviations by which a density of clutter must differ from the one told to say so."""

CLUTTER_LEAST = 0.2
"""Difference of its logarithm from which it is said."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Target(Container):
    """One row per target and scan: the estimate after it, and how it was come by.

    The state interleaves each component with its rate: z_1, v_1, z_2, v_2 ... The
    associations list every measurement that took part, with its probability.
    """

    NAME: ClassVar[str] = "target"
    ROW: ClassVar[str] = "scan"
    FIXED_AXES: ClassVar[tuple[str, ...]] = ("dimension", "state", "state_too", "model")

    target_id: IntArray | None = column(
        "Number of the target, from 1 in the order of their beginning."
    )
    scan: IntArray = column("Number of the scan.")
    time_s: FloatArray = column("Time of the scan.")
    state: FloatArray = column("Components and their rates per second.", "scan", "state", unit="")
    state_covariance: FloatArray = column(
        "Covariance of the state.", "scan", "state", "state_too", unit=""
    )
    model_probability: FloatArray = column(
        "Probability of each motion model, quiet first.", "scan", "model"
    )
    false_alarm_probability: FloatArray = column("Operating point of the detector, per cell.")
    detection_probability: FloatArray = column("Probability that the target crosses the threshold.")
    threshold: FloatArray = column("Threshold used on the amplitude.")
    gate: FloatArray = column("Radius of the validation region in standard deviations.")
    gate_volume: FloatArray = column(
        "Volume of the validation region, in the units of the components.", unit=""
    )
    expected_clutter: FloatArray = column("Mean number of false measurements in the region.")
    validated: IntArray = column("Measurements in the region and above the threshold.")
    miss_probability: FloatArray = column("Probability that none of them was the target's.")
    information_reduction: FloatArray = column("Factor q2 that was expected of the scan.")
    score: FloatArray = column("Log likelihood ratio of the track against clutter alone, so far.")
    loss_cusum: FloatArray = column(
        "Cumulative sum (Page 1954) that detects the loss of the target."
    )
    lost: BoolArray = column("Whether this sum is above its limit.")
    association_target_id: IntArray | None = column(
        "Number of the target of the association.", "association"
    )
    association_scan: IntArray = column("Number of the scan of the association.", "association")
    association_row: IntArray = column(
        "Row of its measurement in the table of scans, from 0.", "association"
    )
    association_probability: FloatArray = column(
        "Probability that the measurement was the target's.", "association"
    )
    component: TextArray = column("Name of each component.", "dimension")
    component_unit: TextArray = column("Unit of each component; empty if not given.", "dimension")
    threshold_rule: str = scalar("How the threshold was chosen.")
    false_tracks_per_hour: float | None = scalar(
        "Bound on the rate of tracks that clutter begins; none where targets were given.",
        None,
        unit="1/h",
    )
    confirming_score: float | None = scalar("Score at which a track was confirmed for it.", None)
    crowded_scans: int | None = scalar(
        "Scans in which the least likely pairs of target and measurement were left out "
        "of the joint hypotheses; none for one target.",
        None,
    )
    smoothing_scans: int | None = scalar(
        "Number of later scans that each state learns from; none for the filter alone.", None
    )
    clutter_ratio: float | None = scalar(
        "Density of false measurements about the targets over the one given.", None
    )
    clutter_ratio_std: float | None = scalar("Its standard deviation.", None)
    start_utc_ns: int | None = scalar("UTC epoch of time zero.", None)

    @property
    def state_std(self) -> FloatArray:
        """Standard deviations of the state, ``(scan, state)``."""
        variance = np.diagonal(self.state_covariance, axis1=-2, axis2=-1)
        deviation: FloatArray = np.sqrt(variance)
        return deviation

    @property
    def targets(self) -> tuple[Self, ...]:
        """One table for each target, in the order of their numbers."""
        if self.target_id is None:
            return (self,)
        return tuple(self.of_target(int(number)) for number in np.unique(self.target_id))

    def of_target(self, number: int) -> Self:
        """Return the rows and the associations of one target."""
        if self.target_id is None or self.association_target_id is None:
            return self
        own = self.take("scan", self.target_id == number)
        return own.take("association", self.association_target_id == number)

    @property
    def statements(self) -> tuple[str, ...]:
        """The outcome of the tracks in words."""
        targets = self.targets
        told = [
            text if len(targets) == 1 else f"target {number}: {text}"
            for number, target in enumerate(targets, 1)
            for text in target.outcome
        ]
        if not targets:
            told = ["no target was found: no track's score reached the one asked for."]
        if self.false_tracks_per_hour is not None:
            told.append(
                f"tracks begin at a score of {self.confirming_score:.1f}, which clutter "
                f"reaches {self.false_tracks_per_hour:g} times an hour at most."
            )
        if self.crowded_scans:
            told.append(
                f"in {self.crowded_scans} scans too many targets shared too many "
                "measurements: the least likely pairs were left out."
            )
        return (*told, *self._clutter())

    @property
    def outcome(self) -> tuple[str, str]:
        """What became of the only target, and where it was last."""
        n_scans = self.scan.size
        lost = np.flatnonzero(self.lost)
        if lost.size and self.lost[-1]:
            first = int(lost[np.flatnonzero(np.diff(lost, prepend=-2) > 1)[-1]])
            outcome = (
                f"the target is lost from scan {self.scan[first]} at "
                f"{self.time_s[first]:g} s on: its score no longer rises."
            )
        else:
            outcome = f"the target was followed through {n_scans} scans to {self.time_s[-1]:g} s."
        values, deviations = self.state[-1], self.state_std[-1]
        parts = [
            f"{name} = {values[2 * i]:.6g} ± {deviations[2 * i]:.2g}{unit}, "
            f"rate {values[2 * i + 1]:.4g} ± {deviations[2 * i + 1]:.2g}{unit and unit + '/s'}"
            for i, (name, unit) in enumerate(zip(self.component, self._units(), strict=True))
        ]
        return outcome, f"at the last scan: {'; '.join(parts)}."

    def _clutter(self) -> tuple[str, ...]:
        """Say where the density of clutter is not the one told."""
        ratio, std = self.clutter_ratio, self.clutter_ratio_std
        if ratio is None or std is None:
            return ()
        if abs(math.log(ratio)) < max(CLUTTER_SIGMAS * std / ratio, CLUTTER_LEAST):
            return ()
        end = "probability" if self.threshold_rule == "fixed" else "range"
        text = (
            f"about the targets there are {ratio:.2f} ± {std:.2f} times as many false "
            f"measurements as given: correct the cell volume (--detector-cell-volume) "
            f"or "
            f"the false alarms (--detector-false-alarm-{end})."
        )
        return (text,)

    def _units(self) -> list[str]:
        """Units of the components with a space before, empty where not given."""
        return [f" {unit}" if unit else "" for unit in self.component_unit.tolist()]
