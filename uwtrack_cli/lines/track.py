"""Peaks to tracked frequency lines.

**Method.** Each line is a pair of Kalman filters, for frequency and for bearing. The
precision of a frequency is averaged along the line, because the height of a weak line's
single peak is its noise's. Peaks inside the gates of confirmed lines are assigned one to
one; by score, a tentative line takes its likeliest peak. A line is confirmed and ended
by its cumulative log-likelihood ratio, or by M hits of N as in Choi (2014), whose
feedback from the harmonic classifier (weaker peaks, wider gates, longer windows) is a
group of options of its own. Points leave smoothed, beside the raw measurements that
later fits use.

**Conventions.** Frames without valid samples are missing time, not missed detections.

**References.** Choi (2014), equations 1-11; Blackman & Popoli (1999), section 6.2;
Rauch, Tung & Striebel (1965).
"""

from collections.abc import Iterator
from functools import partial
from typing import Literal

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.lines.followed_lines import FollowedLines
from uwtrack_cli.lines.tracker_options import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    ProcessNoise,
    ScoreLogic,
    TrackerOptions,
)
from uwtrack_cli.lines.tracking.tracker import LineTracker

_SCORE, _COUNT, _FEEDBACK = ScoreLogic(), CountLogic(), Feedback()
_GATES, _MOTION, _HARMONICS = Gates(), ProcessNoise(), Harmonics()


@checked
def track_lines(
    blocks: Iterator[Families | Peaks],
    *,
    initiation: Literal["score", "count"] = "score",
    score: ScoreLogic = _SCORE,
    count: CountLogic = _COUNT,
    feedback: Feedback = _FEEDBACK,
    gates: Gates = _GATES,
    motion: ProcessNoise = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> Iterator[Lines]:
    """Track spectral peaks from frame to frame as frequency lines.

    A line is what one machine on one vessel emits; its frequency bends when the
    vessel passes. Lines of one vessel share a contact.

    Parameters
    ----------
    blocks
        Peaks, or families that carry their peaks, block by block.
    initiation
        What starts and ends a line: its cumulative score, or counted hits (M of N).
    score
        Options of the score.
    count
        Options of the counted hits.
    feedback
        Wider limits for lines that the harmonic classifier has recognised.
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
    ln(0.4 x rate of noise peaks / wanted rate of false lines); noise exceeds it at 0.9
    of the wanted rate with peaks kept at 0.1 (Wald 1947 bounds it by 2.5 times that
    rate; measured). Lines of 1.5 dB over the noise in 1 Hz are followed every other time
    within a minute. Smoothing has a fixed lag of at least 256 frames, many times the
    correlation time of the filters.
    """
    options = TrackerOptions(initiation, score, count, feedback, gates, motion, harmonics)
    return FollowedLines(blocks, partial(LineTracker, options))
