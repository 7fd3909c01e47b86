"""Sample formats of sound without a library: what comes through a pipe.

**Conventions.** Whole numbers are divided by their full scale, a power of two, and
float32 is the result, rounded once: to the bit what libsndfile gives for the same file.

**References.** Microsoft Multimedia Programming Interface 1.0 (WAVE formats 1 and 3).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.recording import Samples


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
