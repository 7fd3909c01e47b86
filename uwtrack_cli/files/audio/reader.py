"""Samples of a recording, block by block, with an eye on what may be wrong.

**Method.** Blocks are at most as long as asked for. While they
pass, samples at full scale, samples that are no number and channels without any
sound are counted; what was found is said once, when the recording ends. Runs of one
value in all channels are passed on as nan (`dropouts`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile

from uwtrack_cli.data.recording import Samples, check_block
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.audio.dropouts import Dropouts, segment_without_dropouts, without_dropouts
from uwtrack_cli.files.audio.opening import open_sound

FULL_SCALE = 1.0 - 2.0**-15
"""Magnitude from which a sample counts as full scale (that of 16 bit)."""

CLIPPED_SHARE = 1e-4
"""Share of samples at full scale from which a channel is reported as clipped."""

READ_VALUES = 1 << 22
"""Most values (samples times channels) that are decoded at once."""


def file_stamp(path: Path) -> tuple[int, int]:
    """Return size and time of change of a file: whether it is still the same.

    Raises
    ------
    DataError
        The file is gone.
    """
    try:
        facts = path.stat()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}.") from error
    return facts.st_size, facts.st_mtime_ns


@dataclass
class AudioReader:
    """Open the recording and yield its blocks: `reader(block_samples)`.

    Parameters
    ----------
    path
        The recording.
    columns
        Channels of the file to yield, in this order, counted from 0.
    first
        First sample to yield.
    last
        Sample after the last one.
    stamp
        Size and time of change when the file was opened; None is not checked.
    """

    path: Path
    columns: tuple[int, ...]
    first: int
    last: int
    stamp: tuple[int, int] | None = None
    has_warned: bool = field(default=False, repr=False)
    """Whether what is wrong with its samples was told."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, float32, shape (sample, channel)."""
        check_block(block_samples)
        return self._blocks(block_samples)

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples from one on, counted from the first that is yielded.

        Raises
        ------
        DataError
            The file ends before, or cannot be read.
        """
        try:
            with open_sound(self.path) as file:

                def read(first: int, count: int) -> Samples:
                    file.seek(first)
                    return self._read(file, first, count)

                first = self.first + first_sample
                span, bounds = (
                    (first, first + n_samples),
                    (self.first, max(self.last, first + n_samples)),
                )
                return segment_without_dropouts(read, span, bounds, file.samplerate)
        except (soundfile.SoundFileError, RuntimeError, OSError) as error:
            raise DataError(f"{self.path} cannot be read again: {error}.") from error

    def _blocks(self, block_samples: int) -> Iterator[Samples]:
        tally = Tally(len(self.columns))
        try:
            with open_sound(self.path) as file:
                dropouts = Dropouts(file.samplerate)
                file.seek(self.first)
                yield from without_dropouts(
                    self._read_blocks(file, block_samples, tally), dropouts, block_samples
                )
        except (soundfile.SoundFileError, RuntimeError, OSError) as error:
            raise DataError(f"{self.path} cannot be read further: {error}.") from error
        if self.stamp is not None and file_stamp(self.path) != self.stamp:
            raise DataError(f"{self.path} changed while it was read; run again when it is whole.")
        if not self.has_warned:
            self.has_warned = True
            said = tally.problems(self.path.name, self.columns)
            for msg in (*said, *dropouts.problems(self.path.name)):
                warn(msg)

    def _read_blocks(
        self, file: soundfile.SoundFile, block_samples: int, tally: "Tally"
    ) -> Iterator[Samples]:
        for start in range(self.first, self.last, block_samples):
            block = self._read(file, start, min(block_samples, self.last - start))
            tally.add(block)
            yield block

    def _read(self, file: soundfile.SoundFile, start: int, count: int) -> Samples:
        block = np.empty((count, len(self.columns)), np.float32)
        step = max(1, READ_VALUES // file.channels)
        # whole numbers of 16 bit are decoded four times as fast as floats
        is_short = file.subtype == "PCM_16"
        scale = np.float32(2.0**-15 if is_short else 1.0)
        is_whole = self.columns == tuple(range(file.channels))
        for offset in range(0, count, step):
            wanted = min(step, count - offset)
            dtype = "int16" if is_short else "float32"
            part = file.read(wanted, dtype=dtype, always_2d=True)
            if part.shape[0] < wanted:
                end = start + offset + part.shape[0]
                raise DataError(
                    f"{self.path} ends at {end / file.samplerate:.3f} s, its header "
                    f"promises {self.last / file.samplerate:.3f} s; "
                    f"give --stop-s {end / file.samplerate:.3f} to use what is there."
                )
            chosen = part if is_whole else part[:, list(self.columns)]
            np.multiply(chosen, scale, out=block[offset : offset + wanted])
        if not (is_short or np.isfinite(block).all()):
            block[~np.isfinite(block)] = np.nan
        return block


class Tally:
    """Counts per channel of what a user should know."""

    def __init__(self, n_channels: int) -> None:
        self.n_samples = 0
        self.n_full = np.zeros(n_channels, np.int64)
        self.n_nan = np.zeros(n_channels, np.int64)
        self.has_sound = np.zeros(n_channels, np.bool_)
        self.changes = np.zeros(n_channels, np.bool_)
        self.first: Samples | None = None

    def add(self, block: Samples) -> None:
        """Count what a block holds."""
        self.n_samples += block.shape[0]
        # most blocks are neither clipped nor lack a sample, which their extremes tell
        low, high = block.min(initial=0.0), block.max(initial=0.0)
        if not -FULL_SCALE < low <= high < FULL_SCALE:
            self.n_full += np.count_nonzero(np.abs(block) >= FULL_SCALE, axis=0)
            self.n_nan += np.count_nonzero(np.isnan(block), axis=0)
        if not self.has_sound.all():
            self.has_sound |= np.any(np.abs(block) > 0.0, axis=0)
        if not self.changes.all() and block.shape[0]:
            if self.first is None:
                self.first = block[0].copy()
            self.changes |= np.any((block != self.first) & ~np.isnan(block), axis=0)

    def problems(self, name: str, columns: tuple[int, ...]) -> Iterator[str]:
        """Yield what is wrong with the channels of a recording, in words."""
        for i, column in enumerate(columns):
            channel = f"channel {column + 1} of {name}"
            if self.n_nan[i]:
                yield (
                    f"{channel} has {self.n_nan[i]} samples that are no number; "
                    f"they are treated as gaps."
                )
            if not self.has_sound[i]:
                yield f"{channel} is silent: every sample is zero or no number."
            elif self.first is not None and not self.changes[i]:
                yield (
                    f"{channel} does not change: every sample is {self.first[i]:.4g}, "
                    f"which is no sound."
                )
            share = self.n_full[i] / self.n_samples
            if share >= CLIPPED_SHARE:
                yield (
                    f"{channel} is clipped: {100.0 * share:.3g} % of its samples are "
                    f"at full scale; levels and harmonics of loud passages are wrong."
                )
