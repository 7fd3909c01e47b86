"""Stretches of a file in which no sample changes: dropouts of a recorder.

**Method.** Noise of a sensor changes with every sample; a run of one value in all channels at
once, of zeros as a rule, is sound that a recorder has lost. Frames are told of it as of any
gap, so that the ambient level is not taken for none there, and the sound that begins again
for a rise. A run may go on from one block to the next.

**Conventions.** Samples count from the first one of the file that is read.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.data.recording import Samples

SHORTEST_S = 0.5
"""Shortest run of one value that is a dropout, s: quiet sound in few bits has shorter ones."""

MOST_TOLD = 5
"""Dropouts whose times are told."""


@dataclass
class Dropouts:
    """Find dropouts in blocks that follow each other."""

    sample_rate_hz: float
    """Samples per second."""
    runs: list[tuple[int, int]] = field(default_factory=list)
    """First sample of each dropout and the one after its last."""
    _position: int = 0
    """Samples that have passed."""
    _last: Samples | None = None
    """The last of them."""
    _same: int = 0
    """Samples with which they end that are like it."""

    def blank(self, block: Samples) -> Samples:
        """Return the next block with nan where sound is lost.

        Parameters
        ----------
        block
            Samples, shape (n, channel).

        Returns
        -------
        Samples
            The same block, changed only where it has a dropout.
        """
        least = round(SHORTEST_S * self.sample_rate_hz)
        begin, self._position = self._position, self._position + block.shape[0]
        if not block.shape[0]:
            return block
        last, before = self._last, self._same
        self._last, self._same = block[-1].copy(), 1
        goes_on = last is not None and bool((block[0] == last).all())
        ends_so = block.shape[0] > 1 and bool((block[-2] == block[-1]).all())
        if not (goes_on or ends_so or _may_hold(block, least)):
            return block
        for first, stop in _runs(block):
            more = before if goes_on and first == 0 else 0
            if stop == block.shape[0]:
                self._same = stop - first + more
            if stop - first + more < least:
                continue
            block[first:stop] = np.nan
            if self.runs and self.runs[-1][1] == begin + first:
                self.runs[-1] = (self.runs[-1][0], begin + stop)
            else:
                self.runs.append((begin + first - more, begin + stop))
        return block

    def problems(self, name: str) -> Iterator[str]:
        """Yield what is said of them, in words; nothing of a file without any sound.

        Parameters
        ----------
        name
            Name of the file.
        """
        lost = sum(stop - first for first, stop in self.runs)
        if not self.runs or lost == self._position:
            return
        rate = self.sample_rate_hz
        times = [
            f"{a / rate:.1f} to {b / rate:.1f} s" for a, b in self.runs[:MOST_TOLD]
        ]
        more = len(self.runs) - len(times)
        times += [f"{more} more"] if more else []
        yield (
            f"{name} does not change from {', '.join(times)}: the recorder has lost "
            f"{lost / rate:.1f} s, which are treated as gaps."
        )


def _may_hold(block: Samples, least: int) -> bool:
    """Tell whether a block may hold so many equal samples, by a few of them."""
    some = np.arange(1, block.shape[0], max(least // 2, 1))
    return bool((block[some] == block[some - 1]).all(axis=1).any())


def _runs(block: Samples) -> list[tuple[int, int]]:
    """Return the first sample of every run of one value and the one after its last."""
    begins = np.ones(block.shape[0], np.bool_)
    begins[1:] = (block[1:] != block[:-1]).any(axis=1)  # nan is like nothing
    first = np.flatnonzero(begins)
    stop = np.append(first[1:], block.shape[0])
    kept = (stop - first > 1) | (first == 0) | (stop == block.shape[0])
    return list(zip(first[kept].tolist(), stop[kept].tolist(), strict=True))
