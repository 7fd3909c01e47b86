"""One recording for several sources: read once, its sample rate reduced once.

**Method.** What is read goes at once to every rate that is asked for, and is held there
until the last of its takers has it: a source that waits for long frames holds sound of
its own rate alone.
"""

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from uwtrack_cli.data.recording import Reader, Samples
from uwtrack_cli.estimation.decimation import Decimator


class SharedSound:
    """Sound of one reader for several, which must be advanced in turn.

    ``factors``: by how much each reduces the sample rate.
    """

    def __init__(self, reader: Reader, factors: Sequence[int]) -> None:
        self._reader = reader
        self._blocks: Iterator[Samples] | None = None
        self._is_over = False
        self._rates = {factor: _Rate(factor) for factor in factors}
        self.readers = [
            SharedReader(self, self._rates[factor], number)
            for number, factor in enumerate(factors)
        ]
        """A reader for each of them."""
        for own in self.readers:
            own.rate.positions[own.number] = 0

    def more(self, block_samples: int) -> bool:
        """Read on; tell whether there was more."""
        if self._blocks is None:
            self._blocks = self._reader(block_samples)
        block = next(self._blocks, None)
        if not self._is_over:
            for rate in self._rates.values():
                rate.add(block)
        self._is_over = block is None
        return not self._is_over


class _Rate:
    """Sound of one rate, held until the last one has taken it."""

    def __init__(self, factor: int) -> None:
        self.factor = factor
        self.positions: dict[int, int] = {}
        """First sample that each taker has not taken."""
        self._decimator = Decimator(factor)
        self._held: deque[Samples] = deque()
        self._first = self._end = self._n_channels = 0

    def add(self, block: Samples | None) -> None:
        """Take sound of the full rate; None at its end."""
        if block is None:
            block = self._decimator.finish(self._n_channels)
        else:
            self._n_channels = block.shape[1]
            block = self._decimator.feed(block)
        if self.positions and len(block):
            self._held.append(block)
            self._end += len(block)

    def lacks(self, number: int, count: int) -> bool:
        """Tell whether fewer samples are held than a taker wants."""
        return self._end < self.positions[number] + count

    def take(self, number: int, count: int) -> Samples:
        """Return so many samples, fewer if there are no more."""
        begin, start = self.positions[number], self._first
        parts: list[Samples] = []
        for held in self._held:
            low, high = max(begin - start, 0), min(begin + count - start, len(held))
            if low < high:
                parts.append(held[low:high])
            start += len(held)
        self.positions[number] = begin + sum(map(len, parts))
        self._drop()
        if not parts:
            return np.empty((0, self._n_channels), np.float32)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def leave(self, number: int) -> None:
        """Hold nothing more for a taker."""
        self.positions.pop(number, None)
        self._drop()

    def _drop(self) -> None:
        least = min(self.positions.values(), default=self._end)
        while self._held and self._first + len(self._held[0]) <= least:
            self._first += len(self._held.popleft())


class SharedReader:
    """A reader of one of the rates."""

    def __init__(self, sound: SharedSound, rate: _Rate, number: int) -> None:
        self._sound, self.rate, self.number = sound, rate, number

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, of the rate that was asked for."""
        rate, number = self.rate, self.number
        block = None
        while block is None or len(block) == block_samples:
            while rate.lacks(number, block_samples):
                if not self._sound.more(block_samples * rate.factor):
                    break
            block = rate.take(number, block_samples)
            if len(block):
                yield block
        self.leave()

    def decimated(self, factor: int) -> Reader:
        """Return the reader of the lower rate: this one."""
        assert factor == self.rate.factor  # noqa: S101 - it was asked for
        return self

    def leave(self) -> None:
        """Take no more: nothing is held for this reader."""
        self.rate.leave(self.number)
