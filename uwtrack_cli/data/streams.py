"""Results that come block by block, and are remembered for a while."""

from collections import deque
from collections.abc import Iterator
from typing import Generic, Self, TypeVar

Block = TypeVar("Block")
Past = TypeVar("Past")


class RememberedStream(Generic[Block, Past]):
    """The blocks of a stage, made while they are asked for.

    Once told to, it keeps what has left, so that the stage can say what its result would
    be if the input ended here.
    """

    def __init__(self, blocks: Iterator[Block]) -> None:
        self._blocks = blocks
        self._memory_s = 0.0
        self._past: deque[tuple[float, Past]] = deque()

    def __iter__(self) -> Self:
        """Return the blocks."""
        return self

    def __next__(self) -> Block:
        """Return the next block."""
        return next(self._blocks)

    def remember(self, last_s: float) -> None:
        """Keep what leaves from now on for so long, s."""
        self._memory_s = last_s

    def _keep(self, end_s: float, what: Past, now_s: float) -> None:
        """Keep what has left and reaches to a time, s, and forget what is too old."""
        if self._memory_s:
            self._past.append((end_s, what))
            while self._past and self._past[0][0] < now_s - self._memory_s:
                self._past.popleft()

    def _since(self, start_s: float) -> list[Past]:
        """Return what has left and reaches beyond a time, s."""
        return [what for end_s, what in self._past if end_s >= start_s]
