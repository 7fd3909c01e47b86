"""Count what a tracker does in a scene: association, errors, breaks, falsities.

**Method.** Confirmed lines and true ones are matched one to one within 3 Hz and 8
degrees after every frame. The fused bearing is the mean of the matched lines',
weighted with their inverse variances.

**Conventions.** Shares are in percent of line-frames. Errors are filtered ones, nan
where no line was matched in a whole run.

**References.** Choi (2014), figures 6-9; definitions of the specification, section B.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.kalman import wrap_deg
from uwtrack_cli.estimation.lines.line_bank import (
    ASSOCIATION,
    CONFIRMED,
    STATE_ROWS,
    TENTATIVE,
    LineBank,
)
from uwtrack_cli.flow.studies.line_scene import N_FRAMES, Scene, SceneRule

MATCH_HZ, MATCH_DEG, MISSED_HZ = 3.0, 8.0, 3.0


@dataclass(frozen=True)
class RunFigures:
    """The figures of one run.

    Attributes
    ----------
    association
        Line-frames whose line took its own measurement, percent.
    loud_association
        The same among measurements above the detection threshold, percent.
    coverage
        Line-frames with a matched confirmed line, percent.
    frequency_mse
        Squared error of matched lines, Hz^2.
    penalised_mse
        The same per line-frame, a missed line counting 3 Hz, Hz^2.
    bearing_mse
        Squared error of matched lines, degree^2.
    fused_mse
        Squared error of the bearing fused over the lines, degree^2.
    lines_told
        Confirmed lines of the run.
    breaks
        Changes of number per true line.
    false_lines
        Confirmed lines per frame that are none of the vessel's.
    tentative
        Tentative lines per frame.
    """

    association: float
    loud_association: float
    coverage: float
    frequency_mse: float
    penalised_mse: float
    bearing_mse: float
    fused_mse: float
    lines_told: float
    breaks: float
    false_lines: float
    tentative: float


class Tally:
    """Reads a tracker frame by frame."""

    def __init__(self, scene: Scene, rule: SceneRule) -> None:
        self.scene, self.n_lines = scene, rule.n_lines
        peaks = scene.peaks
        is_own = (scene.source >= 0) & (scene.source < rule.n_lines)
        self.owner = {
            (int(frame), float(f)): bool(loud)
            for frame, f, loud in zip(
                peaks.frame[is_own], peaks.frequency_hz[is_own],
                peaks.is_detection[is_own], strict=True,
            )
        }  # fmt: skip
        self.associated = self.associated_loud = 0
        self.false = self.matched = self.tentative = 0
        self.squares: list[FloatArray] = []
        self.fused: list[float] = []
        self.told: list[set[int]] = [set() for _ in range(rule.n_lines)]

    def read(self, frame: int, bank: LineBank) -> None:
        """Add one frame, after the tracker's step."""
        slots = np.flatnonzero(bank.stage == CONFIRMED)
        self.tentative += int(np.count_nonzero(bank.stage == TENTATIVE))
        for slot in slots[bank.table[ASSOCIATION, slots] > 0]:
            loud = self.owner.get((frame, float(bank.table[STATE_ROWS, slot])))
            self.associated += loud is not None
            self.associated_loud += bool(loud)
        track, line = _match(bank, slots, self.scene, frame)
        is_target = line < self.n_lines
        track, line = track[is_target], line[is_target]
        self.false += slots.size - line.size
        self.matched += line.size
        for t, k in zip(track, line, strict=True):
            self.told[k].add(int(bank.serial[t]))
        truth = self.scene
        off = bank.table[0, track] - truth.frequency_hz[frame, line]
        turn = wrap_deg(bank.table[1, track] - truth.bearing_deg[frame, line])
        self.squares.append(np.stack([off**2, turn**2]))
        if line.size:
            weight = 1.0 / bank.state.variance[1, track]
            self.fused.append(float((weight * turn).sum() / weight.sum()) ** 2)

    def figures(self, lines_told: int) -> RunFigures:
        """Return the figures of the run."""
        total = self.n_lines * N_FRAMES
        n_loud = sum(self.owner.values())
        squares = np.concatenate(self.squares, axis=1)
        missed = total - self.matched
        return RunFigures(
            association=100.0 * self.associated / total,
            loud_association=100.0 * self.associated_loud / n_loud,
            coverage=100.0 * self.matched / total,
            frequency_mse=_mean(squares[0]),
            penalised_mse=float((squares[0].sum() + MISSED_HZ**2 * missed) / total),
            bearing_mse=_mean(squares[1]),
            fused_mse=_mean(np.array(self.fused)),
            lines_told=float(lines_told),
            breaks=float(np.mean([max(len(ids) - 1, 0) for ids in self.told])),
            false_lines=self.false / N_FRAMES,
            tentative=self.tentative / N_FRAMES,
        )


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _match(
    bank: LineBank, slots: IntArray, scene: Scene, frame: int
) -> tuple[IntArray, IntArray]:
    """Match confirmed lines to true ones, nearest first, one to one."""
    off = np.abs(bank.table[0, slots][:, None] - scene.frequency_hz[frame])
    turn = np.abs(wrap_deg(bank.table[1, slots][:, None] - scene.bearing_deg[frame]))
    near = np.where((off < MATCH_HZ) & (turn < MATCH_DEG), off, np.inf)
    track, line = [], []
    while np.isfinite(near).any():
        best = np.unravel_index(np.argmin(near), near.shape)
        track.append(slots[best[0]])
        line.append(best[1])
        near[best[0], :] = near[:, best[1]] = np.inf
    return np.array(track, dtype=np.int64), np.array(line, dtype=np.int64)
