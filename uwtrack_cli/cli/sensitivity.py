"""What a run could have found, said beside what it found.

**Conventions.** One sentence per sensor, on standard error, with ``--verbose``; the
numbers are in the product's lines.
"""

from collections.abc import Iterable

import numpy as np

from uwtrack_cli.cli.console import say
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.lines import Lines


def say_sensitivity(made: Iterable[Container]) -> None:
    """Say for every sensor with lines what could have been found.

    A block without frames, which ends a stream, completes the one before it.
    """
    said: dict[str, dict[str, float]] = {}
    for lines in made:
        if isinstance(lines, Lines):
            row = said.setdefault(lines.frames.sensor, {"threshold": np.nan})
            row["found"] = lines.line_id.size
            row["rate"] = lines.false_lines_per_khz_hour
            row["weakest"] = lines.weakest_line_snr_db
            row["measured"] = lines.measured_false_lines_per_khz_hour
            known = lines.frames.threshold_db[np.isfinite(lines.frames.threshold_db)]
            if known.size:
                row["threshold"] = float(np.median(known))
    for sensor, row in said.items():
        text = (
            f"{sensor}: {row['found']:.0f} lines; noise alone gives {row['rate']:.3g} "
            "per kHz and hour at most; a steady line of "
            f"{row['weakest']:.1f} dB over the noise in its cell is found within a "
            "minute every other time"
        )
        if np.isfinite(row["measured"]):
            text += (
                f"; the recording's own noise gives {row['measured']:.2g} per kHz and "
                "hour, as measured"
            )
        if np.isfinite(row["threshold"]):
            text += f"; the detection threshold is {row['threshold']:.1f} dB"
        say(text, 1)
