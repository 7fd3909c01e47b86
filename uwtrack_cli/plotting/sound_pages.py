"""Pages of sound in which nothing needs to be sought: spectrogram and DEMON.

**Method.** How the sound is taken apart: see `picture`. The DEMON spectrum is the mean
power of the envelope over all frames, over the floor of its neighbourhood. Rates that
belong to one shaft are marked at the shaft's rate and at that of the blades; a multiple
that was not heard has no mark.

**Conventions.** Density is absolute, in uPa^2/Hz, where the sensor file calibrates it,
else relative to full scale.

**References.** Nielsen, "Sonar Signal Processing" (1991), chapter 3, for DEMON.
"""

from collections.abc import Callable, Iterator
from typing import Annotated, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, convert
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.plotting import layout, picture, style
from uwtrack_cli.plotting.layout import HeadLine, PagePart
from uwtrack_cli.plotting.panels import rates_part
from uwtrack_cli.plotting.style import Clock
from uwtrack_cli.plotting.view import Scene, View
from uwtrack_cli.spectra.demon import demodulate
from uwtrack_cli.spectra.overview import pool_overview

QUIET_SHARE, BRIGHT_SHARE = 0.05, 0.998
"""Shares of the spectrogram below the darkest and below the brightest colour."""

LEAST_RANGE_DB, MOST_RANGE_DB = 20.0, 80.0
"""Levels that its colours cover, unless asked for."""

PAGE_IN, SPECTRUM_IN, GRAM_IN = 3.9, 2.8, 2.4
"""Heights of the spectrogram, and of spectrum and picture of the envelope, inches."""

USUAL_HZ = 30.0
"""Highest rate that is drawn where no rates were found."""

LongestS = AtMost(picture.LONGEST_WINDOW_S)
WindowS = Annotated[float, Unit("s"), AtLeast(1e-6), LongestS] | None
RangeDb = Annotated[float, Unit("dB"), AtLeast(1), AtMost(200)] | None


def sound_figure(
    recording: Recording,
    view: View,
    progress: Callable[[float], None] = lambda _: None,
    *,
    window_s: WindowS = None,
    db_range: RangeDb = None,
    colormap: str | None = None,
) -> Figure:
    """Return the page of a recording's sound.

    ``progress``: called with the seconds that were read. ``window_s``: length of the
    analysis window, s; None: as the length of the sound asks for. ``db_range``: levels
    below the brightest colour, dB; None: as the picture asks for. ``colormap``: name of
    the colours, one of matplotlib's; None are the usual ones.

    Raises
    ------
    OptionError
        An option is out of range, or does not fit the recording.
    DataError
        Nothing was recorded in the span, or the sound is too short.
    """
    window_s = convert("--window-s", WindowS, window_s)
    db_range = convert("--db-range", RangeDb, db_range)
    colormap = style.LEVELS_MAP if colormap is None else colormap
    if colormap not in mpl.colormaps:
        raise OptionError(
            f"--colormap takes a name of matplotlib such as viridis, magma, cividis or "
            f"gray, got {colormap!r}."
        )
    clock = Clock()
    if recording.start_utc_ns is not None:  # right by its sensor's offset
        offset_ns = round(recording.sensor.clock_offset_s * NANOSECONDS)
        clock = Clock(recording.start_utc_ns + offset_ns)
    span_s = view.span_s((0.0, recording.duration_s), clock)
    span_s = max(0.0, span_s[0]), min(recording.duration_s, span_s[1])
    part = picture.part_of(recording, span_s) if view.is_zoomed else recording
    band_hz = (0.0, 0.5 * recording.sample_rate_hz)
    axis = picture.choose_axis(band_hz, view, "the recording")
    axis, frames = picture.plan_frames(part, axis, window_s)
    found = picture.sound_picture(part, axis, frames, progress=progress)
    found = found._replace(edges_s=found.edges_s + span_s[0])
    limits = _limits(found.level_db[np.isfinite(found.level_db)], db_range)
    unit = "dB re 1 \u00b5Pa\u00b2/Hz"
    if recording.sensor.full_scale_upa is None:
        unit = "dB re full scale\u00b2/Hz, not calibrated"
    heads = [
        HeadLine(layout.span_title(span_s, clock, [recording.name])),
        HeadLine(_facts(part, frames)),
    ]
    panel = PagePart(PAGE_IN, lambda ax: found.draw(ax, limits, unit, colormap))
    return layout.page_figure(heads, view, [layout.timed([panel], view, clock, span_s)])


def _facts(recording: Recording, frames: list[picture.Framing]) -> str:
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
    dark, bright = np.quantile(known_db, [QUIET_SHARE, BRIGHT_SHARE]) if known_db.size else (0, 0)
    if range_db is None:
        range_db = float(np.clip(bright - dark, LEAST_RANGE_DB, MOST_RANGE_DB))
    return float(bright) - range_db, float(bright)


class Shaft(NamedTuple):
    """A segment in which a shaft was heard."""

    number: int
    """Passage that it belongs to; 0 for none."""
    shaft_hz: float
    """Rate of the shaft."""
    blade_hz: float
    """Rate of the blades; nan if unknown."""
    rates_hz: tuple[float, ...]
    """Rates that were heard."""

    @property
    def words(self) -> str:
        """What is known of it."""
        text = f"shaft {self.shaft_hz:.2f} Hz ({60 * self.shaft_hz:.0f} rpm)"
        blades = self.blade_hz / self.shaft_hz
        if not np.isfinite(blades) or round(blades) < 2:
            return text
        return f"{text}, blades {self.blade_hz:.2f} Hz ({round(blades)} to a shaft)"


def demon_figure(scene: Scene, view: View) -> Figure:
    """Return the DEMON page of a recording.

    Raises
    ------
    DataError
        The product has no spectrum of the envelope, and its sound is not at hand.
    """
    envelope = scene.envelope or _of_sound(scene)
    span_s = view.span_s(scene.times_s or (0.0, 1.0), scene.clock)
    scene = scene.shown(view, span_s)
    shafts = list(_shafts(scene))
    highest = 1.25 * max((max(s.rates_hz) for s in shafts), default=USUAL_HZ / 1.25)
    rate_hz = envelope.frequency_hz
    low, high = view.band_hz or (0.0, min(highest, float(rate_hz[-1])))
    names = [r.name for r in scene.all(Recording)]
    heads = [HeadLine(layout.span_title(span_s, scene.clock, [*names, "DEMON"]))]
    heads += [HeadLine(shaft.words, number=shaft.number) for shaft in shafts]
    if not shafts:
        heads.append(HeadLine("no shaft was found; 'uwtrack run --recipe presence' seeks one"))
    inside = style.within(envelope.time_s, span_s)
    power = 10.0 ** (picture.overview_levels(envelope)[inside] / 10.0)
    mean_db = 10.0 * np.log10(np.nanmean(power, axis=0, keepdims=True))
    level = picture.over_floor(mean_db)[0]

    def spectrum(part: SubFigure) -> None:
        ax = style.calm(part.subplots(), "mean over the\nneighbourhood (dB)")
        ax.plot(rate_hz, level, color=style.MEASURED, lw=0.8)
        shown = level[style.within(rate_hz, (low, high))]
        top = float(np.nanmax(shown, initial=1.0))
        for shaft in shafts:
            _mark(shaft, top, ax)
        bottom = float(np.nanmin(shown, initial=0.0))
        ax.set(xlim=(low, high), ylim=(bottom, 1.25 * top))
        ax.set_xlabel("modulation rate (Hz)", fontsize=9)

    gram = [PagePart(GRAM_IN, part.draw) for part in rates_part(scene)]
    if not gram or scene.envelope is None or view.band_hz is not None:
        axis = picture.FrequencyAxis(low, high, is_log=False)
        found = picture.overview_picture(envelope, axis, span_s)

        def draw(ax: Axes) -> None:
            found.draw(ax)
            ax.set_ylabel("modulation\nrate (Hz)", fontsize=8)

        gram = [PagePart(GRAM_IN, draw)]
    lower = layout.timed(gram, view, scene.clock, span_s)
    return layout.page_figure(heads, view, [PagePart(SPECTRUM_IN + 0.4, spectrum), lower])


def _of_sound(scene: Scene) -> Overview:
    """Return the spectrum of the envelope of a recording whose sound is at hand."""
    if scene.sound is None:
        raise DataError(
            "the file holds no spectrum of the envelope, and the recording does not lie "
            "beside it: run with --recipe presence, which keeps one."
        )
    *_, found = pool_overview(demodulate(scene.sound))
    return found


def _shafts(scene: Scene) -> Iterator[Shaft]:
    """Yield what was heard of shafts in a span."""
    found = scene.presence
    if found is None:
        return
    for row in scene.segments.tolist():
        rates = np.sort(found.rate_hz[found.rate_segment == row])
        if rates.size:
            spacing = float(found.spacing_hz[row])
            is_of_rates = spacing <= rates[0] * 1.02  # not of its lines
            shaft = spacing if is_of_rates else float(rates[0])
            blade = float(found.blade_rate_hz[row])
            yield Shaft(scene.owner(row), shaft, blade, tuple(rates.tolist()))


def _mark(shaft: Shaft, top_db: float, ax: Axes) -> None:
    color = style.contact_color(shaft.number or 2)
    for rate in shaft.rates_hz:
        is_blade = abs(rate - shaft.blade_hz) < 0.02 * rate
        name = "blades" if is_blade else f"{rate / shaft.shaft_hz:.0f}"
        name = "shaft" if abs(rate - shaft.shaft_hz) < 0.02 * rate else name
        ax.axvline(rate, ymax=0.88, color=color, lw=1.6 if is_blade else 0.8, alpha=0.7,
                   linestyle="-" if is_blade else "--")  # fmt: skip
        ax.text(rate, 1.13 * top_db, name, ha="center", fontsize=7, color=color)
