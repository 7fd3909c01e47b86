"""The spectrogram of a recording itself, with nothing sought in it.

**Conventions.** Density is absolute, in uPa^2/Hz, where the sensor file calibrates it,
else relative to full scale. How it is taken apart: see `picture`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, convert
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import OptionError
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    page_figure,
    span_title,
    timed,
)
from uwtrack_cli.plotting.picture import (
    LONGEST_WINDOW_S,
    Framing,
    choose_axis,
    draw_picture,
    part_of,
    plan_frames,
    sound_picture,
)
from uwtrack_cli.plotting.style import LEVELS_MAP, Clock
from uwtrack_cli.plotting.view import View

QUIET_SHARE, BRIGHT_SHARE = 0.05, 0.998
"""Shares of the picture below the darkest and below the brightest colour."""

LEAST_RANGE_DB, MOST_RANGE_DB = 20.0, 80.0
"""Levels that the colours cover, unless asked for."""

PAGE_IN = 3.9
"""Height of the spectrogram, inches."""

WindowS = Annotated[float, Unit("s"), AtLeast(1e-6), AtMost(LONGEST_WINDOW_S)] | None
RangeDb = Annotated[float, Unit("dB"), AtLeast(1), AtMost(200)] | None


@dataclass(frozen=True, kw_only=True)
class SoundStyle:
    """How the sound is taken apart and coloured."""

    window_s: WindowS = None
    """Length of the analysis window, s; None: as the length of the sound asks for."""
    db_range: RangeDb = None
    """Levels below the brightest colour, dB; None: as the picture asks for."""
    colormap: str = LEVELS_MAP
    """Name of the colours, one of matplotlib's."""


def checked_style(window_s: float | None, db_range: float | None,
                  colormap: str | None) -> SoundStyle:  # fmt: skip
    """Return a style of options that are within their ranges.

    Raises
    ------
    OptionError
        One is out of range, or there are no colours of that name.
    """
    if colormap is not None and colormap not in mpl.colormaps:
        msg = (
            f"--colormap takes a name of matplotlib such as viridis, magma, cividis or "
            f"gray, got {colormap!r}."
        )
        raise OptionError(msg)
    return SoundStyle(
        window_s=convert("--window-s", WindowS, window_s),
        db_range=convert("--db-range", RangeDb, db_range),
        colormap=colormap or LEVELS_MAP,
    )


def sound_figure(
    recording: Recording,
    style: SoundStyle,
    view: View,
    progress: Callable[[float], None] = lambda _: None,
) -> Figure:
    """Return the page of a recording's sound.

    ``progress``: called with the seconds that were read.

    Raises
    ------
    OptionError
        The window or the band does not fit the recording.
    DataError
        Nothing was recorded in the span, or the sound is too short.
    """
    clock = _clock(recording)
    span_s = view.span_s((0.0, recording.duration_s), clock)
    span_s = max(0.0, span_s[0]), min(recording.duration_s, span_s[1])
    part = part_of(recording, span_s) if view.is_zoomed else recording
    band_hz = (0.0, 0.5 * recording.sample_rate_hz)
    axis = choose_axis(band_hz, view, "the recording")
    axis, frames = plan_frames(part, axis, style.window_s)
    found = sound_picture(part, axis, frames, progress=progress)
    found = found._replace(edges_s=found.edges_s + span_s[0])
    limits = _limits(found.level_db[np.isfinite(found.level_db)], style.db_range)
    unit = "dB re 1 \u00b5Pa\u00b2/Hz"
    if recording.sensor.full_scale_upa is None:
        unit = "dB re full scale\u00b2/Hz, not calibrated"
    heads = [
        HeadLine(span_title(span_s, clock, [recording.name])),
        HeadLine(_facts(part, frames)),
    ]
    panel = PagePart(
        PAGE_IN, lambda ax: draw_picture(found, ax, limits, unit, style.colormap)
    )
    return page_figure(heads, view, [timed([panel], view, clock, span_s)])


def _clock(recording: Recording) -> Clock:
    """Return the clock of the recording, right by its sensor's offset."""
    if recording.start_utc_ns is None:
        return Clock()
    offset_ns = round(recording.sensor.clock_offset_s * NANOSECONDS)
    return Clock(recording.start_utc_ns + offset_ns)


def _facts(recording: Recording, frames: list[Framing]) -> str:
    """Say in a line of what the picture is."""
    main = frames[-1]
    width_hz = 1.5 / main.window_s  # equivalent noise bandwidth of a Hann window
    facts = [
        f"sensor {recording.sensor.id}",
        f"{recording.sample_rate_hz:g} samples/s",
        f"window {main.window_s:.3g} s (bandwidth {width_hz:.3g} Hz)",
    ]
    if len(frames) > 1:
        facts.append(f"to {frames[0].window_s:.3g} s in the lowest octaves")
    if main.per_column > 1:
        facts.append(f"mean of {main.per_column} frames in a column")
    return " \u00b7 ".join(facts)


def _limits(known_db: FloatArray, range_db: float | None) -> tuple[float, float]:
    """Return the levels of the darkest and the brightest colour."""
    known_db = known_db[known_db > -2999.0]  # digital silence has no level
    dark, bright = (
        np.quantile(known_db, [QUIET_SHARE, BRIGHT_SHARE]) if known_db.size else (0, 0)
    )
    if range_db is None:
        range_db = float(np.clip(bright - dark, LEAST_RANGE_DB, MOST_RANGE_DB))
    return float(bright) - range_db, float(bright)
