"""Lines of a stream of blocks, followed while they come, by any tracker of blocks.

**Conventions.** One block of lines leaves for each block that comes, and at the end one
more with the points still held and the table of lines. What that end would be can be
asked at any time (`FollowedLines.so_far`).
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.streams import RememberedStream
from uwtrack_cli.lines.line_points import LinePoints, LineTable, no_table, to_lines

if TYPE_CHECKING:
    from uwtrack_cli.lines.comb_search.comb_tracker import CombTracker
    from uwtrack_cli.lines.tracking.tracker import LineTracker

Block = TypeVar("Block")


class FollowedLines(RememberedStream[Lines, tuple[Frames, LinePoints]]):
    """The lines of a stream of blocks, followed while they come.

    Parameters
    ----------
    blocks
        Blocks of what the tracker takes.
    make_tracker
        Makes the tracker from the first block.
    """

    def __init__(
        self, blocks: Iterator[Block], make_tracker: "Callable[[Block], LineTracker | CombTracker]"
    ) -> None:
        self._tracker: LineTracker | CombTracker | None = None
        super().__init__(self._follow(blocks, make_tracker))

    def so_far(self, start_s: float) -> Lines | None:
        """Return the lines and their table as they would be if the blocks ended here.

        They begin with the first block that reaches beyond a time, s; None before the
        first one.
        """
        past = self._since(start_s)
        if self._tracker is None or not past:
            return None
        frames = Frames.join([frames for frames, _ in past])
        begin_s = float(frames.time_s[0])
        held = self._tracker.pending(begin_s)
        points = LinePoints.join([*(points for _, points in past), held])
        points = points.since(begin_s).sorted()
        return _told(self._tracker, frames, points, self._tracker.table_of(points))

    def _follow(
        self, blocks: Iterator[Any], make_tracker: "Callable[[Any], LineTracker | CombTracker]"
    ) -> Iterator[Lines]:
        tracker = None
        for block in blocks:
            if tracker is None:
                self._tracker = tracker = make_tracker(block)
            frames, points = tracker.push(block)
            if frames.n_frames:
                end_s = float(frames.time_s[-1])
                self._keep(end_s, (frames, points), end_s)
            yield _told(tracker, frames, points, no_table())
        if tracker is not None:
            points, nothing = tracker.finish(), frames.take("frame", slice(0, 0))
            yield _told(tracker, nothing, points, tracker.line_table())


def _told(
    tracker: "LineTracker | CombTracker", frames: Frames, points: LinePoints, table: LineTable
) -> Lines:
    return to_lines(frames, points, table, tracker.scalars())
