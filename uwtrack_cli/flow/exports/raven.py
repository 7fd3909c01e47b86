"""Tracked lines as a Raven selection table.

**Conventions.** One selection per line: its times and the band that it moves through.
`Begin Time (s)` is cumulative over the files in the order in which Raven opens them,
without the gaps between them; `File Offset (s)` counts from the begin of `Begin File`.

**References.** Raven Pro 1.6 User's Manual (Cornell Lab of Ornithology, 2023),
chapter 6: selection tables are tab-separated text.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.text_escaping import csv_cell

HEADS = (
    "Selection", "View", "Channel", "Begin Time (s)", "End Time (s)", "Low Freq (Hz)",
    "High Freq (Hz)", "Begin File", "File Offset (s)", "Sensor", "Contact", "Line",
    "Status",
)  # fmt: skip


class FilePlace(NamedTuple):
    """Where a moment lies in the files of a recording."""

    file: str
    """Name of the file."""
    offset_s: float
    """Time in that file, s."""
    cumulative_s: float
    """Time as Raven counts it over all files, s."""


@dataclass(frozen=True)
class FileClock:
    """From seconds of a recording to files, offsets and cumulative time."""

    recording: Recording
    """The recording whose first sample is time zero."""
    files: RecordedFiles | None
    """Files of a joined recording; None if it is one file."""

    def place(self, time_s: float) -> FilePlace:
        """Return where a time of the recording lies in its files."""
        at_s = time_s + self.recording.first_s
        if self.files is None:
            return FilePlace(self.recording.name, at_s, at_s)
        rate = self.recording.sample_rate_hz
        sample = at_s * rate
        starts, counts = self.files.start_sample, self.files.n_samples
        k = max(0, int(np.searchsorted(starts, sample, side="right")) - 1)
        inside_s = min(sample - float(starts[k]), float(counts[k])) / rate
        left_out = self.files.first_sample  # Raven opens the files whole
        skipped_s = (0.0, 0.0)
        if left_out is not None:
            skipped_s = float(left_out[0]) / rate, float(left_out[k]) / rate
        before_s = float(counts[:k].sum()) / rate + skipped_s[0]
        return FilePlace(str(self.files.name[k]), inside_s + skipped_s[1], before_s + inside_s)


def raven_text(containers: Sequence[Container], name: str) -> str:
    """Return the lines of a product as a selection table.

    Raises
    ------
    DataError
        The product has no lines, or does not carry the facts of its recording.
    """
    lines = [c for c in containers if isinstance(c, Lines)]
    if not lines:
        raise DataError(f"{name} holds no lines, which a selection table is made of.")
    rows = [row for item in lines for row in _rows(item, containers, name)]
    rows.sort(key=lambda row: float(row[3]))
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerow(HEADS)
    writer.writerows((number, *row[1:]) for number, row in enumerate(rows, 1))
    return text.getvalue()


def _rows(lines: Lines, containers: Sequence[Container], name: str) -> Iterator[tuple[str, ...]]:
    sensor = lines.frames.sensor
    clock = _clock(containers, sensor, name)
    rates = (lines.frames.sample_rate_hz, clock.recording.sample_rate_hz)
    if not all(rate > 0.0 for rate in rates) or lines.frames.fft_length < 1:
        raise DataError(f"{name} has frames without a sample rate; make it again.")
    padding = lines.frames.fft_length / lines.frames.window_samples
    for k, line in enumerate(lines.line_id):
        points = lines.line == line
        if not points.any():
            continue
        time_s, frequency = lines.time_s[points], lines.frequency_hz[points]
        half_s = 0.5 * lines.point_window_s[points]
        half_hz = 0.25 / padding / half_s  # half a cell of each point's own spectrum
        begin = clock.place(max(0.0, float((time_s - half_s).min())))
        end = clock.place(float((time_s + half_s).max()))
        yield (
            "", "Spectrogram 1", "1", f"{begin.cumulative_s:.6f}", f"{end.cumulative_s:.6f}",
            f"{max(0.0, float((frequency - half_hz).min())):.4f}",
            f"{float((frequency + half_hz).max()):.4f}",
            csv_cell(begin.file), f"{begin.offset_s:.6f}", csv_cell(sensor), str(lines.line_contact[k]), str(line),
            str(lines.line_status[k]),
        )  # fmt: skip


def _clock(containers: Sequence[Container], sensor: str, name: str) -> FileClock:
    files = [c for c in containers if isinstance(c, RecordedFiles)]
    own = next((item for item in files if item.sensor == sensor), None)
    for container in containers:
        if isinstance(container, Recording) and container.sensor.id == sensor:
            return FileClock(container, own)
    raise DataError(f"{name} does not say which recording the lines of {sensor} are from.")
