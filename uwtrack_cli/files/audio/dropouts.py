"""Segments of sound in which no sample changes: dropouts of a recorder.

**Method.** Noise of a sensor changes with every sample; a run of one value in all channels at
once, of zeros as a rule, is sound that a recorder has lost. Frames are told of it as of any
gap, so that the ambient level is not taken for none there, and the sound that begins again
for a rise. A run that goes on at the end of a block is held until it is known how long it lasts:
how the sound is read, and whether it is still coming, changes no sample.

**Conventions.** Samples count from the first one that is read. Lost is what is like the
sample before it: the first of a run was heard.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from uwtrack_cli.data.base import BoolArray
from uwtrack_cli.data.recording import Samples

SHORTEST_S, FEWEST_SAMPLES = 0.5, 16
"""Shortest run of one value that is a dropout, s, and in samples: quiet sound in few bits
has shorter ones."""

MOST_TOLD = 5
"""Dropouts, or other gaps, whose times are told."""


def shortest_samples(sample_rate_hz: float) -> int:
    """Return of how many samples the shortest dropout is."""
    return max(FEWEST_SAMPLES, round(SHORTEST_S * sample_rate_hz))


@dataclass
class Dropouts:
    """Find dropouts in blocks that follow each other."""

    sample_rate_hz: float
    """Samples per second."""
    runs: list[tuple[int, int]] = field(default_factory=list)
    """First sample of each dropout and the one after its last."""
    _position: int = 0
    """Samples that were returned."""
    _last: Samples | None = None
    """The last of them, as it was."""
    _held: Samples | None = None
    """Samples after it that are like it, too few yet to be a dropout."""
    _is_lost: bool = False
    """Whether they were returned as a dropout, which goes on."""

    def blank(self, block: Samples) -> Samples:
        """Take the next block; return what is settled, with nan where sound is lost.

        Parameters
        ----------
        block
            Samples, shape (n, channel).

        Returns
        -------
        Samples
            What was held before, and the block without what is held now.
        """
        if not block.shape[0]:
            return block
        least = shortest_samples(self.sample_rate_hz)
        before = block[:1] if self._last is None else self._last
        sound = block if self._held is None else np.concatenate([self._held, block])
        ends_so = sound.shape[0] > 1 and bool((sound[-2] == sound[-1]).all())
        begins_so = self._last is not None and bool((sound[0] == before[0]).all())
        if not (begins_so or ends_so or _may_hold(sound, least)):
            self._held, self._is_lost = None, False
            return self._returned(sound, sound[-1:].copy())
        is_same = _unchanged(np.concatenate([before, sound]))
        is_same[0] &= begins_so
        edges = np.flatnonzero(np.diff(is_same, prepend=False, append=False))
        settled, goes_on, lost = sound.shape[0], False, []
        for first, stop in edges.reshape(-1, 2).tolist():
            at_end = stop == sound.shape[0]
            if stop - first + 1 >= least or (first == 0 and self._is_lost):
                lost.append((first, stop))
                goes_on = at_end
            elif at_end:
                settled = first
        self._held = sound[settled:].copy() if settled < sound.shape[0] else None
        self._is_lost = goes_on
        last = sound[settled - 1 : settled].copy() if settled else before
        if lost and not sound.flags.writeable:
            sound = sound.copy()
        for first, stop in lost:
            self._note(first, stop)
            sound[first:stop] = np.nan
        return self._returned(sound[:settled], last)

    def finish(self) -> Samples | None:
        """Return what is held at the end of the sound: no dropout; None if nothing is."""
        held, self._held = self._held, None
        return None if held is None else self._returned(held, held[-1:])

    def problems(self, name: str) -> Iterator[str]:
        """Yield what is said of them, in words; nothing of a file without any sound.

        Parameters
        ----------
        name
            Name of the file.
        """
        lost = sum(stop - first for first, stop in self.runs)
        if not self.runs or lost >= self._position - 1:
            return
        rate = self.sample_rate_hz
        yield (
            f"{name} does not change from {spans_in_words(self.runs, rate)}: the "
            f"recorder has lost {lost / rate:.1f} s, which are treated as gaps."
        )

    def _note(self, first: int, stop: int) -> None:
        begin, end = self._position + first, self._position + stop
        if self.runs and self.runs[-1][1] == begin:
            begin, _ = self.runs.pop()
        self.runs.append((begin, end))

    def _returned(self, sound: Samples, last: Samples) -> Samples:
        self._position += sound.shape[0]
        self._last = last
        return sound


def without_dropouts(
    blocks: Iterator[Samples], dropouts: Dropouts, block_samples: int
) -> Iterator[Samples]:
    """Yield blocks of at most so many samples, with nan where sound is lost.

    The samples of a block may be overwritten.
    """

    def settled() -> Iterator[Samples | None]:
        for block in blocks:
            yield dropouts.blank(block)
        yield dropouts.finish()

    for sound in settled():
        count = 0 if sound is None else sound.shape[0]
        for first in range(0, count, block_samples):
            assert sound is not None  # noqa: S101 - it has samples
            yield sound[first : first + block_samples]


def segment_without_dropouts(
    read: Callable[[int, int], Samples],
    span: tuple[int, int],
    bounds: tuple[int, int],
    sample_rate_hz: float,
) -> Samples:
    """Return a segment of sound as `without_dropouts` yields it.

    Parameters
    ----------
    read
        Returns so many samples from one on.
    span
        First sample of the segment, and the one after its last.
    bounds
        The same of all that can be read.
    sample_rate_hz
        Samples per second.
    """
    beside = shortest_samples(sample_rate_hz) + 1  # a run may begin and end there
    begin, stop = max(bounds[0], span[0] - beside), min(bounds[1], span[1] + beside)
    dropouts = Dropouts(sample_rate_hz)
    parts = [dropouts.blank(read(begin, stop - begin)), dropouts.finish()]
    whole = np.concatenate([part for part in parts if part is not None])
    return whole[span[0] - begin : span[1] - begin]


def spans_in_words(spans: Sequence[tuple[int, int]], rate_hz: float) -> str:
    """Return the times of spans of samples, and how many more there are."""
    times = [f"{a / rate_hz:.1f} to {b / rate_hz:.1f} s" for a, b in spans[:MOST_TOLD]]
    more = len(spans) - len(times)
    return ", ".join([*times, *([f"{more} more"] if more else [])])


def _may_hold(block: Samples, least: int) -> bool:
    """Tell whether a block may hold so many equal samples, by a few of them."""
    some = np.arange(1, block.shape[0], max(least // 2, 1))
    return bool((block[some] == block[some - 1]).all(axis=1).any())


def _unchanged(sound: Samples) -> BoolArray:
    """Tell which samples but the first are like the one before; nan is like nothing."""
    return np.asarray((sound[1:] == sound[:-1]).all(axis=1))
