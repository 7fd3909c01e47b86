"""Feed a tracker frame by frame, and pass on the points that have become final.

**Conventions.** One block of lines for each block of peaks, and at the end one more
with the points still held and the table of lines.
"""

from collections.abc import Callable, Iterator

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.errors import DataError
from uwtrack_cli.stages.lines.frame_peaks import split_frames
from uwtrack_cli.stages.lines.output import join_points, no_table, to_lines
from uwtrack_cli.stages.lines.tracker import LineTracker


def follow_peaks(
    blocks: Iterator[Families | Peaks],
    make_tracker: Callable[[Frames, Peaks], LineTracker],
) -> Iterator[Lines]:
    """Follow the peaks of a stream with a tracker made for its first block.

    Parameters
    ----------
    blocks
        Blocks of peaks, or of families that carry their peaks.
    make_tracker
        Makes the tracker from the first block's frames and peaks.

    Raises
    ------
    DataError
        The families do not carry their peaks.
    """
    tracker: LineTracker | None = None
    frames: Frames | None = None
    for block in blocks:
        peaks = _peaks_of(block)
        frames = peaks.frames
        if tracker is None:
            tracker = make_tracker(frames, peaks)
        parts = []
        for index, step in enumerate(split_frames(block, peaks)):
            tracker.step(
                frames.first_frame + index,
                float(frames.time_s[index]),
                float(frames.effort[index]),
                step,
            )
            if tracker.bank.is_chunk_full:
                parts.append(tracker.emit())
        yield to_lines(frames, join_points(parts), no_table(), tracker.scalars())
    if tracker is not None and frames is not None:
        points = tracker.finish()
        nothing = frames.take("frame", slice(0, 0))
        yield to_lines(nothing, points, tracker.line_table(), tracker.scalars())


def _peaks_of(block: Families | Peaks) -> Peaks:
    if isinstance(block, Peaks):
        return block
    if block.peaks is None:
        msg = (
            "these families do not carry their peaks; give the file that "
            "'uwtrack classify' or 'uwtrack peaks' wrote."
        )
        raise DataError(msg)
    return block.peaks
