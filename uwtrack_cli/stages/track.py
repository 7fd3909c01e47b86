"""Peaks to tracked frequency lines.

**Method.** Each line is a pair of Kalman filters, for frequency and for bearing, with a
measurement variance from every peak's own SNR. Peaks inside a line's gate are
assigned one to one. A line is confirmed and ended by its cumulative log-likelihood
ratio, or by M hits of N as in Choi (2014), whose feedback from the harmonic
classifier (weaker peaks, wider gates, longer windows) is a policy of its own. Points
leave smoothed, beside the raw measurements that later fits use.

**Conventions.** Frames without effort are missing time, not missed detections.

**References.** Choi (2014), equations 1-11; Blackman & Popoli (1999), section 6.2;
Rauch, Tung & Striebel (1965).
"""

from collections.abc import Iterator
from typing import Literal

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.stages.lines.association import Policies
from uwtrack_cli.stages.lines.driver import follow_peaks
from uwtrack_cli.stages.lines.policies import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    Motion,
    ScoreLogic,
)
from uwtrack_cli.stages.lines.tracker import LineTracker

_SCORE, _COUNT, _FEEDBACK = ScoreLogic(), CountLogic(), Feedback()
_GATES, _MOTION, _HARMONICS = Gates(), Motion(), Harmonics()


def track_lines(
    blocks: Iterator[Families | Peaks],
    *,
    initiation: Literal["score", "count"] = "score",
    score: ScoreLogic = _SCORE,
    count: CountLogic = _COUNT,
    feedback: Feedback = _FEEDBACK,
    gates: Gates = _GATES,
    motion: Motion = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> Iterator[Lines]:
    """Follow spectral peaks from frame to frame as frequency lines.

    A line is what one machine on one vessel emits; its frequency bends when the
    vessel passes. Lines of one vessel share a contact.

    Parameters
    ----------
    blocks
        Peaks, or families that carry their peaks, block by block.
    initiation
        What starts and ends a line: its cumulative score, or counted hits (M of N).
    score
        Settings of the score.
    count
        Settings of the counted hits.
    feedback
        Lax parameters for lines that the harmonic classifier has recognised.
    gates
        Where a line looks for its next peak, and when two lines are one.
    motion
        How fast frequencies and bearings may change.
    harmonics
        What a harmonic family looks like.

    Yields
    ------
    Lines
        One block per input block with the points that are final, then the rest
        with the table of lines.

    Raises
    ------
    DataError
        The families do not carry their peaks.

    Notes
    -----
    State and covariances are Choi (2014), equations 1-8. A score starts a line at
    ln(rate of noise peaks / wanted rate of false lines), which noise exceeds at most
    at the wanted rate (Wald 1947). Smoothing has a fixed lag of at least 256 frames,
    many times the memory of the filters.
    """
    policies = Policies(initiation, score, count, feedback, gates, motion, harmonics)
    return follow_peaks(
        blocks, lambda frames, peaks: LineTracker(policies, frames, peaks)
    )
