"""Sound into a file, block by block: it appears whole or not at all."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import soundfile

from uwtrack_cli.data.recording import Samples
from uwtrack_cli.errors import DataError, OptionError, OutputError
from uwtrack_cli.files.atomic import atomic_target

FORMATS = {
    ".wav": "WAV", ".rf64": "RF64", ".w64": "W64", ".flac": "FLAC",
    ".aif": "AIFF", ".aiff": "AIFF",
}  # fmt: skip
WAV_BYTES = 0xFFFFFFFF - 4096


def write_wav(
    path: Path | str,
    blocks: Iterator[Samples],
    sample_rate_hz: float,
    subtype: str = "PCM_16",
    *,
    overwrite: bool = False,
) -> int:
    """Write blocks of samples as a recording; the suffix decides its format.

    ``path``: target: .wav, .rf64, .w64, .flac, .aif or .aiff. ``blocks``: float32
    blocks in full-scale units, shape (sample, channel). ``sample_rate_hz``: sample
    rate, whole Hz. ``subtype``: sample format, as libsndfile names it (PCM_16, PCM_24,
    FLOAT, ...).

    Returns
    -------
    int
        Samples written per channel.

    Raises
    ------
    OutputError
        The target exists, cannot be written, or grows beyond what WAV can hold.
    OptionError
        A suffix, sample rate or sample format that cannot be written.
    DataError
        No block, or samples that are no number.
    """
    path = Path(path)
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        msg = f"cannot write {path}: the suffix must be one of {', '.join(FORMATS)}."
        raise OptionError(msg)
    if sample_rate_hz != int(sample_rate_hz) or sample_rate_hz < 1:
        msg = f"the sample rate must be whole Hz, at least 1, got {sample_rate_hz}."
        raise OptionError(msg)
    if not soundfile.check_format(kind, subtype):
        msg = f"{kind} has no sample format {subtype!r}."
        raise OptionError(msg)
    with atomic_target(path, overwrite=overwrite) as temporary:
        return _write(temporary, path, iter(blocks), int(sample_rate_hz), kind, subtype)


def _write(
    temporary: Path,
    path: Path,
    blocks: Iterator[Samples],
    rate: int,
    kind: str,
    subtype: str,
) -> int:
    first = next(blocks, None)
    if first is None:
        msg = f"there are no samples to write to {path}."
        raise DataError(msg)
    total = 0
    try:
        with soundfile.SoundFile(
            str(temporary), "w", rate, first.shape[1], subtype, format=kind
        ) as file:
            for block in _chain(first, blocks):
                if not np.isfinite(block).all() and "PCM" in subtype:
                    msg = f"samples of {path} are no numbers near sample {total}."
                    raise DataError(msg)
                file.write(block)
                total += block.shape[0]
                if kind == "WAV" and temporary.stat().st_size > WAV_BYTES:
                    msg = f"{path} grows beyond 4 GB: name it .w64 or .rf64."
                    raise OutputError(msg)
    except soundfile.SoundFileError as error:
        msg = f"cannot write {path}: {error}."
        raise OutputError(msg) from error
    return total


def _chain(first: Samples, rest: Iterator[Samples]) -> Iterator[Samples]:
    yield first
    yield from rest
