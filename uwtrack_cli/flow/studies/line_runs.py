"""Run the tracker over scenes and count: association, errors, breaks, falsities.

**Method.** The tracker is stepped frame by frame and read after each one, so that the
figures are those of the filter at the time, as in Choi (2014), figures 6-9. Confirmed
lines and true ones are matched one to one within 3 Hz and 8 degrees.

**Conventions.** Shares are in percent of line-frames. Errors are filtered ones.

**References.** Choi (2014), section 4.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.estimation.line_bank import ASSOCIATION, CONFIRMED, LineBank
from uwtrack_cli.flow.studies.line_scene import (
    N_FRAMES,
    Scene,
    SceneRule,
    simulate_scene,
)
from uwtrack_cli.stages.classify import classify_peaks
from uwtrack_cli.stages.lines.association import Policies
from uwtrack_cli.stages.lines.frame_peaks import split_frames
from uwtrack_cli.stages.lines.policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)
from uwtrack_cli.stages.lines.tracker import LineTracker

MATCH_HZ, MATCH_DEG, MISSED_HZ = 3.0, 8.0, 3.0

Setting = Literal["conventional", "feedback", "lax"]
"""The paper's two trackers, and lax parameters for all without a classifier."""

CLASSIFIERS: dict[Setting, Literal["families", "all", "none"]] = {
    "conventional": "none",
    "feedback": "families",
    "lax": "all",
}


@dataclass(frozen=True)
class RunFigures:
    """The figures of one run."""

    association: float
    measured_association: float
    frequency_mse: float
    penalised_mse: float
    bearing_mse: float
    lines_told: float
    breaks: float
    false_lines: float


def paper_policies(setting: Setting) -> Policies:
    """Return the settings of the paper's trackers (specification A.3 and A.4)."""
    feedback = Feedback(
        classifier=CLASSIFIERS[setting],
        births="families" if setting == "feedback" else "all",
        chance=1e-2, hold_frames=10, every_frames=1,
    )  # fmt: skip
    return Policies(
        initiation="count",
        score=ScoreLogic(),
        count=CountLogic(),
        feedback=feedback,
        gates=Gates(
            frequency_hz=2.0, bearing_deg=4.0, merge_hz=1.0, merge_deg=3.0,
            merge_rate_sigmas=np.inf, merge_frames=1,
        ),
        motion=Motion(
            frequency_hz2ps3=1e-4, doppler_ps3=0.0, bearing_deg2ps3=1e-2,
            frequency_rate_hzps=0.2, bearing_rate_degps=1.0,
        ),
        harmonics=Harmonics(
            spacing_hz=(15.0, 60.0), teeth=14, bearing_window_deg=3.54
        ),
    )  # fmt: skip


def run_figures(setting: Setting, rule: SceneRule, seed: int) -> RunFigures:
    """Simulate one scene, track it and take its figures."""
    scene = simulate_scene(rule, np.random.default_rng(seed))
    block: Families | Peaks = scene.peaks
    if setting == "feedback":
        block = classify_peaks(
            scene.peaks, spacing_hz=(15.0, 60.0), teeth=14, bearing_window_deg=3.54,
            most_peaks=500,
        )  # fmt: skip
    tracker = LineTracker(paper_policies(setting), scene.peaks.frames, scene.peaks)
    tally = _Tally(scene, rule)
    for frame, peaks in enumerate(split_frames(block, scene.peaks)):
        tracker.step(frame, frame + 0.5, 1.0, peaks)
        tally.read(frame, tracker.bank)
        if tracker.bank.is_chunk_full:
            tracker.emit()
    return tally.figures(tracker.bank.next_line - 1)


class _Tally:
    def __init__(self, scene: Scene, rule: SceneRule) -> None:
        self.scene, self.n_lines = scene, rule.n_lines
        self.owner = {
            (int(frame), float(f)): int(line)
            for frame, f, line in zip(
                scene.peaks.frame, scene.peaks.frequency_hz, scene.source, strict=True
            )
            if 0 <= line < rule.n_lines
        }
        self.loud = {
            (int(frame), float(f))
            for frame, f in zip(
                scene.peaks.frame[scene.peaks.is_detection],
                scene.peaks.frequency_hz[scene.peaks.is_detection], strict=True,
            )
        }  # fmt: skip
        self.associated = self.associated_loud = self.false = 0
        self.squares: list[FloatArray] = []
        self.matched = 0
        self.told: list[set[int]] = [set() for _ in range(rule.n_lines)]

    def read(self, frame: int, bank: LineBank) -> None:
        slots = np.flatnonzero(bank.stage == CONFIRMED)
        for slot in slots[bank.table[ASSOCIATION, slots] > 0]:
            key = (frame, float(bank.table[10, slot]))
            self.associated += key in self.owner
            self.associated_loud += key in self.owner and key in self.loud
        track, line = _match(bank, slots, self.scene, frame)
        is_target = line < self.n_lines
        self.false += slots.size - int(is_target.sum())
        self.matched += int(is_target.sum())
        for t, k in zip(track[is_target], line[is_target], strict=True):
            self.told[k].add(int(bank.serial[t]))
        truth = self.scene
        self.squares.append(np.stack([
            (bank.table[0, track] - truth.frequency_hz[frame, line])[is_target] ** 2,
            (bank.table[1, track] - truth.bearing_deg[frame, line])[is_target] ** 2,
        ]))  # fmt: skip

    def figures(self, lines_told: int) -> RunFigures:
        total = self.n_lines * N_FRAMES
        is_own = (self.scene.source >= 0) & (self.scene.source < self.n_lines)
        n_loud = int((is_own & self.scene.peaks.is_detection).sum())
        squares = np.concatenate(self.squares, axis=1)
        missed = total - self.matched
        return RunFigures(
            association=100.0 * self.associated / total,
            measured_association=100.0 * self.associated_loud / n_loud,
            frequency_mse=float(squares[0].mean()),
            penalised_mse=float((squares[0].sum() + MISSED_HZ**2 * missed) / total),
            bearing_mse=float(squares[1].mean()),
            lines_told=float(lines_told),
            breaks=float(np.mean([max(len(ids) - 1, 0) for ids in self.told])),
            false_lines=self.false / N_FRAMES,
        )


def _match(
    bank: LineBank, slots: IntArray, scene: Scene, frame: int
) -> tuple[IntArray, IntArray]:
    """Match confirmed lines to true ones, nearest first, one to one."""
    off = np.abs(bank.table[0, slots][:, None] - scene.frequency_hz[frame])
    turn = bank.table[1, slots][:, None] - scene.bearing_deg[frame]
    turn = np.abs((turn + 180.0) % 360.0 - 180.0)
    near = np.where((off < MATCH_HZ) & (turn < MATCH_DEG), off, np.inf)
    track, line = [], []
    while np.isfinite(near).any():
        best = np.unravel_index(np.argmin(near), near.shape)
        track.append(slots[best[0]])
        line.append(best[1])
        near[best[0], :] = near[:, best[1]] = np.inf
    return np.array(track, dtype=np.int64), np.array(line, dtype=np.int64)
