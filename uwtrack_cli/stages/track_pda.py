"""Peaks to tracked frequency lines, with probabilistic association.

**Method.** The line tracker starts and confirms lines; once confirmed, a line weighs all
the peaks in its gate instead of taking one, above a detection threshold that is chosen
for every line and frame from its predicted variance.

**Conventions.** As in `uwtrack_cli.stages.track`. The threshold can only be lowered to the
weakest peaks that `peaks` has kept.

**References.** Choi, Kim and Hong (2001) as corrected; Gelfand, Fortmann and Bar-Shalom
(1996); Choi (2014) for the tracker itself.
"""

from collections.abc import Iterator

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.errors import OptionError
from uwtrack_cli.stages.lines.association import Policies
from uwtrack_cli.stages.lines.driver import follow_peaks
from uwtrack_cli.stages.lines.pda_tracker import PdaLineTracker
from uwtrack_cli.stages.lines.policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)

_SCORE, _GATES, _MOTION, _HARMONICS = ScoreLogic(), Gates(), Motion(), Harmonics()


def track_lines_pda(
    blocks: Iterator[Families | Peaks],
    *,
    snr_db: float = 3.0,
    lowest_false_alarm: float = 1e-6,
    score: ScoreLogic = _SCORE,
    gates: Gates = _GATES,
    motion: Motion = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> Iterator[Lines]:
    """Follow frequency lines by weighing all peaks near each of them.

    An alternative to `track` for lines that coast through clutter: a line takes the mean
    of what may be its own, and its deviation tells how doubtful that was.

    Parameters
    ----------
    blocks
        Peaks, or families that carry their peaks, block by block.
    snr_db
        Power over noise, in its cell, of the lines to be held, in dB.
    lowest_false_alarm
        Least false alarm probability per cell that the threshold may be raised to, in
        (0, 1); the greatest is that of the peaks kept.
    score
        Settings of the score that starts and ends lines.
    gates
        Where a line looks for its next peaks, and when two lines are one.
    motion
        How fast frequencies and bearings may change.
    harmonics
        What a harmonic family looks like.

    Yields
    ------
    Lines
        One block per input block with the points that are final, then the rest with
        the table of lines.

    Raises
    ------
    DataError
        The families do not carry their peaks.
    OptionError
        An option is out of range.

    Notes
    -----
    Lines start as in `track`, so that noise starts as many. A point is an association
    where one peak has at least half of the probability.
    """
    policies = Policies(
        "score", score, CountLogic(), Feedback(classifier="none"), gates, motion,
        harmonics,
    )  # fmt: skip

    def make_tracker(frames: Frames, peaks: Peaks) -> PdaLineTracker:
        _check(lowest_false_alarm, peaks)
        return PdaLineTracker(
            policies, frames, peaks, snr_db=snr_db,
            lowest_false_alarm=lowest_false_alarm,
        )  # fmt: skip

    return follow_peaks(blocks, make_tracker)


def _check(lowest_false_alarm: float, peaks: Peaks) -> None:
    if not 0.0 < lowest_false_alarm < peaks.kept_probability:
        msg = (
            "lowest_false_alarm must be above 0 and below the probability of the peaks "
            f"kept ({peaks.kept_probability:g}), got {lowest_false_alarm}."
        )
        raise OptionError(msg)
