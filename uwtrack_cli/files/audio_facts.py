"""What the header of a sound file says, without reading its samples."""

from dataclasses import dataclass
from pathlib import Path

import soundfile

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import check_readable

SUFFIXES = (".wav", ".rf64", ".w64", ".flac", ".aif", ".aiff")
"""Endings of recordings, in lower case."""


@dataclass(frozen=True)
class SoundFacts:
    """Rate, length and channels as the header tells them."""

    sample_rate_hz: int
    n_samples: int
    n_channels: int


def sound_facts(path: Path) -> SoundFacts:
    """Return what the header of a recording says.

    Raises
    ------
    DataError
        The file is missing or no recording.
    """
    check_readable(path)
    try:
        info = soundfile.info(str(path))
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        msg = f"{path} is no recording that can be read ({error})."
        raise DataError(msg) from error
    return SoundFacts(info.samplerate, info.frames, info.channels)
