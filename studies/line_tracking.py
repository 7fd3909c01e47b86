"""The trackers of the line study over its scenes: variants, figures of a run, rows.

**Method.** The tracker is stepped frame by frame and read after each one, so that the
figures are those of the filter at the time, as in Choi (2014), figures 6-9. The
variants add the parts of the paper's feedback one by one: births in families only,
weaker peaks (alpha), wider gates (beta), longer windows (gamma); and a control that
gives all of it to every confirmed line, without a classifier. Confirmed lines and true
ones are matched one to one within 3 Hz and 8 degrees after every frame. The fused
bearing is the mean of the matched lines', weighted with their inverse variances.

**Conventions.** A frame has at most 500 peaks in its search for families, the loudest:
in the densest clutter that is five of six. Shares are in percent of line-frames. Errors
are filtered ones, nan where no line was matched in a whole run. All variants see the
same scenes.

**References.** Choi (2014), section 4, figures 6-9.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from functools import cache
from typing import Any, Literal

import numpy as np

from studies.line_scene import ALPHA, N_FRAMES, LineScene, SceneRule, simulate_scene
from studies.rows import mean_row
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.study import StudyRow
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.tracker_options import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    ProcessNoise,
    ScoreLogic,
    TrackerOptions,
)
from uwtrack_cli.lines.tracking.frame_peaks import split_frames
from uwtrack_cli.lines.tracking.track_store import CONFIRMED, ENDED, FREE, TENTATIVE, TrackStore
from uwtrack_cli.lines.tracking.tracker import LineTracker

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
    confirmed_lines
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
    confirmed_lines: float
    breaks: float
    false_lines: float
    tentative: float


class TrackerTally:
    """Reads a tracker frame by frame."""

    def __init__(self, scene: LineScene, rule: SceneRule) -> None:
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
        self.numbers: list[set[int]] = [set() for _ in range(rule.n_lines)]

    def read(self, frame: int, store: TrackStore) -> None:
        """Add one frame, after the tracker's step."""
        slots = np.flatnonzero(store.stage == CONFIRMED)
        self.tentative += int(np.count_nonzero(store.stage == TENTATIVE))
        for slot in slots[store.association[slots] > 0]:
            loud = self.owner.get((frame, float(store.measured_frequency_hz[slot])))
            self.associated += loud is not None
            self.associated_loud += bool(loud)
        track, line = _match(store, slots, self.scene, frame)
        is_target = line < self.n_lines
        track, line = track[is_target], line[is_target]
        self.false += slots.size - line.size
        self.matched += line.size
        for t, k in zip(track, line, strict=True):
            self.numbers[k].add(int(store.serial[t]))
        truth = self.scene
        off = store.frequency_hz[track] - truth.frequency_hz[frame, line]
        turn = wrap_deg(store.bearing_deg[track] - truth.bearing_deg[frame, line])
        self.squares.append(np.stack([off**2, turn**2]))
        if line.size:
            weight = 1.0 / store.bearing_variance_deg2[track]
            self.fused.append(float((weight * turn).sum() / weight.sum()) ** 2)

    def figures(self, confirmed_lines: int) -> RunFigures:
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
            confirmed_lines=float(confirmed_lines),
            breaks=float(np.mean([max(len(ids) - 1, 0) for ids in self.numbers])),
            false_lines=self.false / N_FRAMES,
            tentative=self.tentative / N_FRAMES,
        )


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _match(
    store: TrackStore, slots: IntArray, scene: LineScene, frame: int
) -> tuple[IntArray, IntArray]:
    """Match confirmed lines to true ones, nearest first, one to one."""
    off = np.abs(store.frequency_hz[slots][:, None] - scene.frequency_hz[frame])
    turn = np.abs(wrap_deg(store.bearing_deg[slots][:, None] - scene.bearing_deg[frame]))
    near = np.where((off < MATCH_HZ) & (turn < MATCH_DEG), off, np.inf)
    track, line = [], []
    while np.isfinite(near).any():
        best = np.unravel_index(np.argmin(near), near.shape)
        track.append(slots[best[0]])
        line.append(best[1])
        near[best[0], :] = near[:, best[1]] = np.inf
    return np.array(track, dtype=np.int64), np.array(line, dtype=np.int64)


BETA, GAMMA = 1.5, 2.7
SPACING_HZ, TEETH, BEARING_WINDOW_DEG, MOST_PEAKS = (15.0, 60.0), 14, 3.54, 500
MERGE_HZ = 1.0


@dataclass(frozen=True)
class TrackerVariant:
    """What of the paper's feedback a tracker has."""

    classifier: Literal["families", "all", "none"] = "families"
    """Which confirmed lines get lax parameters."""
    births: Literal["all", "families"] = "families"
    """Which peaks may start a line."""
    alpha: float = ALPHA
    """Factor on the detection threshold of such lines."""
    beta: float = BETA
    """Factor on their gates."""
    gamma: float = GAMMA
    """Factor on the window of missed detections after which they end."""
    bearing_window_deg: float = BEARING_WINDOW_DEG
    """Spread of the bearings in a family, degrees."""


VARIANTS = {
    "conventional": TrackerVariant("none", "all"),
    "feedback": TrackerVariant(),
    "lax for all": TrackerVariant("all", "all"),
    "births": TrackerVariant("none"),
    "births+alpha": TrackerVariant(beta=1.0, gamma=1.0),
    "births+beta": TrackerVariant(alpha=1.0, gamma=1.0),
    "births+gamma": TrackerVariant(alpha=1.0, beta=1.0),
    "no bearings": TrackerVariant(bearing_window_deg=180.0),
    "beta 1": TrackerVariant(beta=1.0),
}
"""The paper's two trackers, the control without a classifier, and parts of them."""


def paper_options(variant: TrackerVariant) -> TrackerOptions:
    """Return the settings of the paper's trackers."""
    # a tracker that does not use its classifier need not run it
    uses = variant.classifier == "families"
    feedback = Feedback(
        classifier=variant.classifier, births=variant.births, alpha=variant.alpha,
        beta=variant.beta, gamma=variant.gamma, chance=1e-2,
        hold_frames=10 if uses else N_FRAMES + 1,
        every_frames=1 if uses else N_FRAMES + 1,
    )  # fmt: skip
    return TrackerOptions(
        initiation="count",
        score=ScoreLogic(),
        count=CountLogic(),
        feedback=feedback,
        gates=Gates(
            silence_s=0.0,
            frequency_hz=2.0, bearing_deg=4.0, merge_hz=MERGE_HZ, merge_deg=3.0,
            merge_rate_sigmas=1e6, merge_frames=1,
        ),
        motion=ProcessNoise(
            adaptation=0.0,
            frequency_hz2ps3=1e-4, doppler_ps3=0.0, bearing_deg2ps3=1e-2,
            frequency_rate_hzps=0.2, bearing_rate_degps=1.0,
        ),
        harmonics=Harmonics(
            spacing_hz=SPACING_HZ, teeth=TEETH,
            bearing_window_deg=variant.bearing_window_deg,
        ),
    )  # fmt: skip


def run_figures(setting: str, rule: SceneRule, seed: int) -> RunFigures:
    """Simulate one scene, track it and take its figures.

    ``seed``: seed of the scene; the same for all settings, so that they are compared.
    """
    scene = simulate_scene(rule, np.random.default_rng(seed))
    chosen = VARIANTS[setting]
    block: Families | Peaks = scene.peaks
    if chosen.births == "families":
        block = classify_peaks(
            scene.peaks, spacing_hz=SPACING_HZ, teeth=TEETH, most_peaks=MOST_PEAKS,
            bearing_window_deg=chosen.bearing_window_deg,
        )  # fmt: skip
    tracker = LineTracker(paper_options(chosen), scene.peaks)
    tally = TrackerTally(scene, rule)
    for frame, peaks in enumerate(split_frames(block, scene.peaks)):
        tracker.step(frame, frame + 0.5, 1.0, peaks)
        tally.read(frame, tracker.store)
        tracker.store.stage[tracker.store.stage == ENDED] = FREE  # points are not wanted
    return tally.figures(tracker.store.next_line - 1)


QUANTITIES = {
    "association": "association %",
    "loud_association": "loud association %",
    "coverage": "coverage %",
    "frequency_mse": "frequency MSE Hz^2",
    "penalised_mse": "same, missed 9 Hz^2",
    "bearing_mse": "bearing MSE deg^2",
    "fused_mse": "fused MSE deg^2",
    "confirmed_lines": "confirmed lines",
    "breaks": "breaks per line",
    "false_lines": "false per frame",
    "tentative": "tentative per frame",
}
"""What a figure of `RunFigures` is called in the table."""

_FEWEST_RUNS = 2
_SEED_STEP = 1_000_003


def tracking_rows(cases: list[dict[str, Any]], runs: int, seed: int) -> Iterator[StudyRow]:
    """Run the trackers over all scenes of the reference.

    ``cases``: scenes with their settings and known figures. ``runs``: runs of a scene;
    some scenes take a stated share of them.
    """
    names = [field.name for field in fields(RunFigures)]
    for case in cases:
        rule = SceneRule(**case["scene"])
        count = max(round(case["share_of_runs"] * runs), _FEWEST_RUNS)
        for setting, known in case["settings"].items():
            table = np.array(
                [astuple(_run(setting, rule, _SEED_STEP * seed + k)) for k in range(count)]
            )
            for name, value in known.items():
                yield from mean_row(
                    f"{case['section']} {case['case']}, {setting}",
                    QUANTITIES[name], value, table[:, names.index(name)],
                )  # fmt: skip


@cache
def _run(setting: str, rule: SceneRule, seed: int) -> RunFigures:
    """Run once what more than one experiment needs."""
    return run_figures(setting, rule, seed)
