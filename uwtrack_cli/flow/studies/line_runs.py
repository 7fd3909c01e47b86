"""Run the tracker over the scenes of the line study: its settings, and one run.

**Method.** The tracker is stepped frame by frame and read after each one, so that the
figures are those of the filter at the time, as in Choi (2014), figures 6-9. The
settings add the parts of the paper's feedback one by one: births in families only,
weaker peaks (alpha), wider gates (beta), longer windows (gamma); and a control that
gives all of it to every confirmed line, without a classifier.

**Conventions.** A frame has at most 500 peaks in its search for families, the loudest:
in the densest clutter that is five of six.

**References.** Choi (2014), section 4.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.estimation.lines.line_bank import ENDED, FREE
from uwtrack_cli.flow.studies.line_scene import (
    ALPHA,
    N_FRAMES,
    SceneRule,
    simulate_scene,
)
from uwtrack_cli.flow.studies.line_tally import RunFigures, Tally
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

BETA, GAMMA = 1.5, 2.7
SPACING_HZ, TEETH, BEARING_WINDOW_DEG, MOST_PEAKS = (15.0, 60.0), 14, 3.54, 500
MERGE_HZ = 1.0


@dataclass(frozen=True)
class Setting:
    """What of the paper's feedback a tracker has."""

    classifier: Literal["families", "all", "none"] = "families"
    births: Literal["all", "families"] = "families"
    alpha: float = ALPHA
    beta: float = BETA
    gamma: float = GAMMA
    bearing_window_deg: float = BEARING_WINDOW_DEG


SETTINGS = {
    "conventional": Setting("none", "all"),
    "feedback": Setting(),
    "lax for all": Setting("all", "all"),
    "births": Setting("none"),
    "births, alpha": Setting(beta=1.0, gamma=1.0),
    "births, beta": Setting(alpha=1.0, gamma=1.0),
    "births, gamma": Setting(alpha=1.0, beta=1.0),
    "no bearings": Setting(bearing_window_deg=180.0),
    "beta 1": Setting(beta=1.0),
}
"""The paper's two trackers, the control without a classifier, and parts of them."""


def paper_policies(setting: Setting) -> Policies:
    """Return the settings of the paper's trackers (specification A.3 and A.4)."""
    # a tracker that does not listen to its classifier need not run it
    listens = setting.classifier == "families"
    feedback = Feedback(
        classifier=setting.classifier, births=setting.births, alpha=setting.alpha,
        beta=setting.beta, gamma=setting.gamma, chance=1e-2,
        hold_frames=10 if listens else N_FRAMES + 1,
        every_frames=1 if listens else N_FRAMES + 1,
    )  # fmt: skip
    return Policies(
        initiation="count",
        score=ScoreLogic(),
        count=CountLogic(),
        feedback=feedback,
        gates=Gates(
            frequency_hz=2.0, bearing_deg=4.0, merge_hz=MERGE_HZ, merge_deg=3.0,
            merge_rate_sigmas=np.inf, merge_frames=1,
        ),
        motion=Motion(
            frequency_hz2ps3=1e-4, doppler_ps3=0.0, bearing_deg2ps3=1e-2,
            frequency_rate_hzps=0.2, bearing_rate_degps=1.0,
        ),
        harmonics=Harmonics(
            spacing_hz=SPACING_HZ, teeth=TEETH,
            bearing_window_deg=setting.bearing_window_deg,
        ),
    )  # fmt: skip


def run_figures(setting: str, rule: SceneRule, seed: int) -> RunFigures:
    """Simulate one scene, track it and take its figures.

    Parameters
    ----------
    setting
        Name of one of `SETTINGS`.
    rule
        Variant of the scene.
    seed
        Seed of the scene; the same for all settings, so that they are compared.
    """
    scene = simulate_scene(rule, np.random.default_rng(seed))
    chosen = SETTINGS[setting]
    block: Families | Peaks = scene.peaks
    if chosen.births == "families":
        block = classify_peaks(
            scene.peaks, spacing_hz=SPACING_HZ, teeth=TEETH, most_peaks=MOST_PEAKS,
            bearing_window_deg=chosen.bearing_window_deg,
        )  # fmt: skip
    tracker = LineTracker(paper_policies(chosen), scene.peaks.frames, scene.peaks)
    tally = Tally(scene, rule)
    for frame, peaks in enumerate(split_frames(block, scene.peaks)):
        tracker.step(frame, frame + 0.5, 1.0, peaks)
        tally.read(frame, tracker.bank)
        # nobody asks for the points of ended lines, so their slots serve again
        stage = tracker.bank.stage
        stage[stage == ENDED] = FREE
    return tally.figures(tracker.bank.next_line - 1)
