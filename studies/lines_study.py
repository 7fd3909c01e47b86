"""Frequency lines: the paper's trackers, the comb test and weak lines in sound.

**Method.** Three experiments. *tracker*: the scene of `line_scene` and its variants
with the paper's conventional tracker, its feedback tracker, parts of the feedback, and
the control that gives lax parameters to every confirmed line without a classifier.
*comb*: families in noise and real ones. *sound*: the error of a tone's frequency
in one frame, the SNR at which lines are detected in a minute, before detection and by
peaks, and the error of the smoothed frequency with what is stated of it.

**Conventions.** Cases begin with the experiment: anchored or moving threshold, parts
of the feedback, dense clutter, variants of the scene; families in noise and real ones;
one frame; minutes. Intervals are 95 %: of the mean over runs, of a share or rate (exact), or
by resampling trials (bootstrap).

**References.** Choi (2014), section 4; reference figures of an independent
implementation in ``reference/lines.json``.
"""

from studies.line_comb import comb_rows
from studies.line_sound import frequency_rows, sound_rows
from studies.line_tracking import tracking_rows
from studies.rows import load_reference
from uwtrack_cli.data.study import Study

LAX_REMARK = (
    "Lax parameters for every confirmed line, without a classifier, associate as much "
    "as the feedback tracker in sparse clutter: the gain is that of alpha and gamma, "
    "not of classification, which pays in dense clutter and against lines of "
    "other sources."
)
SCORE_REMARK = (
    "The score starts lines at the share of Wald's bound that noise was measured to use; "
    "the reference's score was set to equal false lines by simulation, too."
)


def study_lines(*, runs: int = 6, seed: int = 1) -> Study:
    """Repeat the experiments on frequency lines and set them beside the reference.

    ``runs``: runs of each setting of the tracker; the other experiments scale with it.
    100 are the long form.
    """
    reference = load_reference("lines")
    rows = [
        *tracking_rows(reference["tracking"], runs, seed),
        *comb_rows(reference, runs, seed),
        *frequency_rows(reference, runs, seed),
        *sound_rows(reference, runs, seed),
    ]
    return Study("lines", reference["source"], runs, seed, tuple(rows), (LAX_REMARK, SCORE_REMARK))
