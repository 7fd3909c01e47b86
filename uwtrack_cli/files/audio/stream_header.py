"""The header of a WAV file that comes through a pipe, where nothing can be sought.

**Method.** Chunks are taken as they come, up to the one that holds the samples. A
program that writes into a pipe cannot know the length beforehand and writes 0, all
ones, or the length that it uses for this: such a length means everything that follows.

**Conventions.** Whole numbers are divided by their full scale, a power of two, and
float32 is the result, rounded once: to the bit what libsndfile gives for the same file.

**References.** Microsoft Multimedia Programming Interface 1.0 (RIFF WAVE, formats 1 and 3); Microsoft
2001 (WAVE_FORMAT_EXTENSIBLE); EBU Tech 3306 (RF64).
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.recording import Samples
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.header import MAX_CHUNKS


@dataclass(frozen=True)
class SampleFormat:
    """How a sample is written."""

    kind: str
    """'s' for signed and 'u' for unsigned whole numbers, 'f' for floating point."""
    n_bytes: int
    """Bytes of a sample."""
    order: str = "<"
    """'<' for the least significant byte first, '>' for the most significant."""

    @property
    def dtype(self) -> str:
        """How numpy names the samples; those of 24 bit are widened to 32."""
        return f"{self.order}{'f' if self.kind == 'f' else 'i'}{self.n_bytes}"

    def decode(self, content: bytes, n_channels: int) -> Samples:
        """Turn whole frames into samples.

        ``content``: interleaved samples; its length is a multiple of a frame.

        Returned: array, shape (sample, channel); float32 in full-scale units; what is
        no number is nan.
        """
        values = self._values(content)
        if not np.isfinite(values).all():
            values = np.where(np.isfinite(values), values, np.float32(np.nan))
        return values.reshape(-1, n_channels)

    def _values(self, content: bytes) -> Samples:
        if self.kind == "u":
            raw = np.frombuffer(content, np.uint8).astype(np.float32)
            return (raw - np.float32(128.0)) / np.float32(128.0)
        if self.kind == "f":
            with np.errstate(over="ignore"):  # beyond float32: no number
                return np.frombuffer(content, self.dtype).astype(np.float32)
        if self.n_bytes == 3:
            wide = np.zeros((len(content) // 3, 4), np.uint8)
            octets = np.frombuffer(content, np.uint8).reshape(-1, 3)
            wide[:, 1:] = octets if self.order == "<" else octets[:, ::-1]
            whole = wide.reshape(-1).view("<i4")
            return whole.astype(np.float32) / np.float32(2.0**31)
        whole = np.frombuffer(content, self.dtype)
        return whole.astype(np.float32) / np.float32(2.0 ** (8 * self.n_bytes - 1))


RAW_FORMATS: dict[str, SampleFormat] = {
    "u8": SampleFormat("u", 1),
    "s8": SampleFormat("s", 1),
    **{
        f"{kind}{8 * n_bytes}{name}": SampleFormat(kind, n_bytes, order)
        for kind, sizes in (("s", (2, 3, 4)), ("f", (4, 8)))
        for n_bytes in sizes
        for name, order in (("le", "<"), ("be", ">"))
    },
}
"""Formats of raw sound by the names that ffmpeg gives them."""


UNKNOWN = {0, 0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF}
"""Lengths that mean everything that follows."""

SOX_UNKNOWN = range(0x7FFFF000, 0x80000000)
"""Lengths from the one that sox writes into a pipe, less than a frame below it, to the
longest of arecord."""

PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
MOST_FORMAT_BYTES = 1 << 16
MOST_SKIPPED_BYTES = 1 << 28
"""More than this before the samples is no header."""

MAGIC = {b"RIFF": "<", b"RF64": "<", b"BW64": "<", b"RIFX": ">"}

Take = Callable[[int], bytes]
"""Takes so many bytes of the stream, fewer only at its end."""


@dataclass(frozen=True)
class StreamHeader:
    """What a stream says of its samples."""

    sample_rate_hz: float
    """Sample rate, Hz."""
    n_channels: int
    """Number of channels."""
    sample_format: SampleFormat
    """How a sample is written."""
    n_bytes: int | None = None
    """Bytes of samples that it promises; None for everything that follows."""
    start: int = 0
    """Bytes before the first sample."""

    @property
    def frame_bytes(self) -> int:
        """Bytes of one sample of every channel."""
        return self.sample_format.n_bytes * self.n_channels


def read_stream_header(take: Take, name: str) -> StreamHeader:
    """Read the header of a WAV or RF64 stream, up to its first sample.

    Raises
    ------
    DataError
        Nothing came, or it is no WAV sound of a format that can be read.
    """
    begin = take(12)
    if not begin:
        raise DataError(f"{name} is empty: no sound came.")
    order = MAGIC.get(begin[:4])
    if order is None or begin[8:12] != b"WAVE":
        raise DataError(
            f"{name} is no WAV sound (it begins with {begin!r}); a pipe takes WAV and RF64 "
            f"(ffmpeg -i FILE -f wav - makes it of other sound), or samples without a "
            f"header with --raw FORMAT --rate-hz HZ."
        )
    found = _read_chunks(take, order, name)
    if found is None:
        raise DataError(f"{name} ends, or is damaged, before its first sample: there is no sound.")
    return found


def _read_chunks(take: Take, order: str, name: str) -> StreamHeader | None:
    """Read the chunks up to the samples; None if there are none."""
    position, large = 12, 0
    layout: StreamHeader | None = None
    for _ in range(MAX_CHUNKS):
        head = take(8)
        if len(head) < 8:
            return None
        kind, size = struct.unpack(order + "4sI", head)
        position += 8
        if kind == b"data":
            promised = large if size == 0xFFFFFFFF and large else size
            return layout and _complete(layout, promised, position)
        content = _chunk(take, kind, size + size % 2)
        if content is None:
            return None
        position += size + size % 2
        if kind == b"ds64" and len(content) >= 16:
            large = struct.unpack("<Q", content[8:16])[0]
        if kind == b"fmt ":
            layout = _format(content, order, name)
    return None


def _complete(layout: StreamHeader, promised: int, start: int) -> StreamHeader:
    frame = layout.frame_bytes
    is_unknown = promised in UNKNOWN or promised + frame - 1 in SOX_UNKNOWN
    known = None if is_unknown or promised in SOX_UNKNOWN else promised
    return replace(layout, n_bytes=known, start=start)


def _chunk(take: Take, kind: bytes, size: int) -> bytes | None:
    """Take a chunk: its content if it matters, else pass over it; None if it ends."""
    if kind in {b"fmt ", b"ds64"}:
        content = take(size) if size <= MOST_FORMAT_BYTES else b""
        return content if len(content) == size else None
    if size > MOST_SKIPPED_BYTES:
        return None
    for begin in range(0, size, MOST_FORMAT_BYTES):
        wanted = min(MOST_FORMAT_BYTES, size - begin)
        if len(take(wanted)) < wanted:
            return None
    return b""


def _format(content: bytes, order: str, name: str) -> StreamHeader:
    """Return rate, channels and sample format of a format chunk."""
    if len(content) < 16:
        raise DataError(f"{name} has a damaged header: its format chunk is too short.")
    tag, n_channels, rate_hz, _, frame, bits = struct.unpack(order + "HHIIHH", content[:16])
    if tag == EXTENSIBLE and len(content) >= 26:
        tag = struct.unpack(order + "H", content[24:26])[0]
    if not n_channels:
        raise DataError(f"{name} claims to have no channel: it is damaged.")
    n_bytes = frame // n_channels
    allowed = {PCM: (1, 2, 3, 4), FLOAT: (4, 8)}.get(tag, ())
    if n_bytes not in allowed or 8 * n_bytes != (bits + 7) // 8 * 8:
        raise DataError(
            f"{name} holds WAV format {tag} with {bits} bits, which a pipe does not "
            f"take; make it PCM or float, as with ffmpeg -i FILE -c:a pcm_s24le -f wav -."
        )
    if not 1 <= rate_hz <= 10_000_000:
        raise DataError(f"{name} claims {rate_hz} Hz, which no recording has: it is damaged.")
    kind = "f" if tag == FLOAT else "u" if n_bytes == 1 else "s"
    return StreamHeader(float(rate_hz), n_channels, SampleFormat(kind, n_bytes, order))
