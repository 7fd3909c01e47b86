"""The panels over time that pages of recordings, passages and reports share.

**Conventions.** A panel is drawn if it has something to say: each function returns the
parts of a page that there are, none where nothing is known. A contact with a passage
has the passage's number and colour; what belongs to none is white on a picture, else
grey. Bands are two standard deviations on either side.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import ScaledTranslation

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import KINDS, OF_VESSELS, Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import MODULATION, Levels, Overview
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting import style
from uwtrack_cli.plotting.fringe_image import FringeImage, law_of
from uwtrack_cli.plotting.layout import PagePart
from uwtrack_cli.plotting.passage import ReportedPassage, passages_of
from uwtrack_cli.plotting.picture import (
    MOST_SAMPLES,
    FrequencyAxis,
    Picture,
    check_axes,
    choose_axis,
    lofargram,
    overview_picture,
)
from uwtrack_cli.plotting.view import Scene

WHOLE_IN, PART_IN, COMB_IN, RATES_IN, CURVE_IN = 2.5, 2.3, 1.9, 1.6, 1.1
"""Heights of the pictures of the whole band, of the lines' part of it, of a comb, of the
envelope, and of curves, inches."""

MOST_POINTS = 1500
"""Points of a line or level that are drawn; of more, every so many-th."""

LONE_IN = 3.4
"""Height of the picture of the whole band where it has the lines, too, inches."""

LASTING = 0.05
"""Share of what is drawn that a line must last to be no fragment."""

MOST_LINES, MOST_OUTLINES = 40, 10
"""Lines that are marked unless all are asked for, the longest ones; and those of no
passage that have an outline, not their ends alone."""

LINES_SHARE, FEW_LINES, PART_SHARE = 0.75, 8, 0.6
"""The lines' part holds such a share of them, all of a few, and is enlarged if it takes
less than such a share of the height."""

HARMONICS, CELLS_PER_TOOTH = 20, 8.0
"""Most teeth of a comb that are drawn, and cells of a window between two of them."""

LABEL_SHARE, LABEL_PLACES = 0.12, 4
"""Least distance of two labels that are not beside each other, as a share of the height
of the rates' panel, and how many of them are."""

EDGE_PT = 2.2
"""Distance of the edges of an outline from the line, points."""

LEAST_SHARE = 0.004
"""Least length of a bar, as a share of the whole span."""

LEVEL_QUANTILES, LEVEL_BLOCKS = (0.1, 0.5, 0.9), 500
"""What is shown of the levels within a pixel, and the pixels."""

USABLE_BEARING_DEG = 30.0
"""Deviation of a bearing up to which it is drawn."""


class Outlined(NamedTuple):
    """A line that is outlined."""

    time_s: FloatArray
    """Times of its points, s."""
    frequency_hz: FloatArray
    """Their frequencies, Hz."""
    number: int
    """Passage that it belongs to; 0 for none."""


def lofargram_parts(scene: Scene) -> list[PagePart]:
    """Return the picture of the whole band, and that of the lines' part enlarged.

    Where there is no picture, the lines are drawn by themselves.
    """
    lines, held, view = outlined_lines(scene), scene.first(Lines), scene.view
    known_hz = _known_band(scene)
    if known_hz is None and not lines:
        return []
    if known_hz is None:
        every = np.hstack([line.frequency_hz for line in lines])
        low, high = view.band_hz or (float(every.min()), float(every.max()))
        margin = 0.05 * (high - low) or 0.5
        axis = FrequencyAxis(low - margin, high + margin, bool(view.is_log and low > 0))
        return [PagePart(PART_IN, partial(_draw_lofargram, scene, None, axis, lines))]
    axis = choose_axis(known_hz, view)
    part = None if view.band_hz is not None else lines_part(lines, axis)
    window_s = None if held is None else held.frames.window_s
    whole = (LONE_IN if lines else WHOLE_IN, axis, lines, None)
    shown = (
        [whole] if part is None else [(WHOLE_IN, axis, [], None), (PART_IN, part, lines, window_s)]
    )
    return [
        PagePart(height, partial(_draw_lofargram, scene, found, axis, own))
        for height, axis, own, window_s in shown
        for found in [picture_of(scene, axis, window_s)]
    ]


def _known_band(scene: Scene) -> tuple[float, float] | None:
    """Return the band that there is a picture of, Hz: of the sound, or the overview."""
    overview = scene.overview
    if (sound := drawn_sound(scene)) is not None:
        return 0.0, 0.5 * sound.sample_rate_hz
    if overview is None or not overview.shade.size:
        return None
    check_axes(overview, "time_s", "frequency_hz")
    known = overview.frequency_hz
    is_log = not is_of_envelope(overview) and known.size > 1 and known[0] <= 0
    return float(known[int(is_log)]), float(known[-1])


def is_of_envelope(overview: Overview | None) -> bool:
    """Tell whether a picture is of the envelope, and its frequencies are rates."""
    return overview is not None and overview.reference == MODULATION


def drawn_sound(scene: Scene) -> Recording | None:
    """Return the sound that pictures are drawn from: at hand, and short enough."""
    sound = scene.sound
    if sound is None or is_of_envelope(scene.overview):
        return None
    is_short = float(np.ptp(scene.span_s)) * sound.sample_rate_hz <= MOST_SAMPLES
    return sound if is_short else None


def why_coarse(scene: Scene) -> str:
    """Say why pictures are drawn from the overview; nothing where they are from the sound.

    That of the envelope is all that there is of it.
    """
    overview, own = scene.overview, scene.recording
    if overview is None or is_of_envelope(overview) or drawn_sound(scene) is not None:
        return ""
    if scene.sound is not None:
        return "drawn from the overview: so long a span of sound takes too long"
    if own is None or own.is_live:
        return "drawn from the overview: the sound is not kept"
    return f"drawn from the overview: {own.name} is not beside the product"


def picture_of(scene: Scene, axis: FrequencyAxis, window_s: float | None = None) -> Picture | None:
    """Return a span of the sound over its floor, else of the overview; None without.

    ``window_s``: length of a window; None: as the length of the sound asks for.
    """

    def make() -> Picture | None:
        sound, overview, found = drawn_sound(scene), scene.overview, None
        if sound is not None:
            found = lofargram(sound, axis, scene.span_s, window_s)
        if found is None and overview is not None and overview.shade.size:
            found = overview_picture(overview, axis, scene.span_s)
        return found

    return scene.once((axis, scene.span_s, window_s), make)


def _draw_lofargram(
    scene: Scene, picture: Picture | None, axis: FrequencyAxis, lines: Sequence[Outlined], ax: Axes
) -> None:
    """Draw a picture with lines as outlines; of many without a passage, their ends."""
    if picture is None:
        axis.set_axis(style.calm(ax))
    else:
        axis = picture.axis
        picture.draw(ax)
    if is_of_envelope(scene.overview):
        ax.set_ylabel("modulation rate (Hz)", fontsize=9)
    is_crowd = sum(not line.number for line in lines) > MOST_OUTLINES
    for line in lines:
        if line.number or picture is None or not is_crowd:
            _outline(line, axis, ax, is_over=picture is not None)
            continue
        for end, mark in ((0, ">"), (-1, "<")):
            if axis.low_hz <= line.frequency_hz[end] <= axis.high_hz:
                ax.plot(line.time_s[end], line.frequency_hz[end], mark, ms=3.0,
                        color="white", alpha=0.8, mec="none")  # fmt: skip


def outlined_lines(scene: Scene) -> list[Outlined]:
    """Return the lines that are outlined: no fragments, unless all are asked for."""
    key = ("lines", scene.view.has_lines, scene.span_s)
    return scene.once(key, lambda: list(_outlined(scene)))


def _outlined(scene: Scene) -> Iterator[Outlined]:
    lines, has_lines = scene.first(Lines), scene.view.has_lines
    if lines is None or has_lines is False:
        return
    order = np.argsort(lines.line, kind="stable")
    order = order[style.within(lines.time_s[order], scene.span_s)]
    first, last = (np.searchsorted(lines.line[order], lines.line_id, side=side)
                   for side in ("left", "right"))  # fmt: skip
    rows = [order[begin:end] for begin, end in zip(first, last, strict=True)]
    times = [lines.time_s[own] for own in rows]
    lasting_s = np.array([np.ptp(one) if one.size else -1.0 for one in times])
    least_s = 0.0 if has_lines else LASTING * float(np.ptp(scene.span_s))
    longest = np.argsort(-lasting_s, kind="stable")[: None if has_lines else MOST_LINES]
    kept = longest[lasting_s[longest] >= least_s]
    for line in np.sort(kept):
        own = rows[line][:: -(-rows[line].size // MOST_POINTS)]
        number = scene.number(lines.line_contact[line])
        yield Outlined(lines.time_s[own], lines.frequency_hz[own], number)


def lines_part(lines: Sequence[Outlined], axis: FrequencyAxis) -> FrequencyAxis | None:
    """Return the part of an axis that holds most lines; None where it needs no other.

    The axis of the part is linear: multiples of a rate lie evenly.
    """
    if not lines or not axis.is_log:
        return None
    middle = np.sort([float(np.median(line.frequency_hz)) for line in lines])
    middle = middle[style.within(middle, (axis.low_hz, axis.high_hz))]
    if not middle.size:
        return None
    share = 1.0 if middle.size <= FEW_LINES else LINES_SHARE
    low, high = middle[[0, int(np.ceil(share * middle.size)) - 1]].tolist()
    margin = max(0.15 * (high - low), 0.08 * high)
    low, high = max(0.0, low - margin), min(high + margin, axis.high_hz)
    part = FrequencyAxis(low, high, is_log=False)
    ends = np.clip([part.low_hz, part.high_hz], axis.low_hz, axis.high_hz)
    is_small = float(np.ptp(axis.share(ends))) < PART_SHARE
    return part if is_small and part.low_hz < part.high_hz else None


def _outline(line: Outlined, axis: FrequencyAxis, ax: Axes, *, is_over: bool = True) -> None:
    """Draw a line in the colour of its passage; over a picture an edge on either side."""
    inside = style.within(line.frequency_hz, (axis.low_hz, axis.high_hz))
    frequency = np.where(inside, line.frequency_hz, np.nan)
    if not is_over:
        ax.plot(line.time_s, frequency, color=style.contact_color(line.number), lw=0.9)
        return
    color, alpha = style.contact_color(line.number) if line.number else "white", 0.4
    dots = ax.figure.dpi_scale_trans
    for side in (-1.0, 1.0):
        moved = ax.transData + ScaledTranslation(0, side * EDGE_PT / 72, dots)
        ax.plot(line.time_s, frequency, transform=moved, color=color, lw=0.7,
                alpha=0.9 if line.number else alpha)  # fmt: skip


def comb_part(scene: Scene) -> list[PagePart]:
    """Return the harmonics of the longest family over time, by their number."""
    presence, rows = scene.presence, scene.segments
    if presence is None:
        return []
    is_vessel = np.isin(presence.kind[rows], list(OF_VESSELS))
    known = is_vessel & np.isfinite(presence.spacing_hz[rows])
    rows = rows[known & (presence.n_lines[rows] > 1)]
    if not rows.size:
        return []
    seen = np.clip([presence.from_s[rows], presence.to_s[rows]], *scene.span_s)
    row = int(rows[np.argmax(np.ptp(seen, axis=0))])
    spacing = float(presence.spacing_hz[row])
    own = presence.frequency_hz[presence.frequency_segment == row] / spacing
    highest = min(HARMONICS, round(float(own.max(initial=4.0))) + 2)
    window_s = min(CELLS_PER_TOOTH / spacing, 0.125 * float(np.ptp(scene.span_s)))
    axis = FrequencyAxis(0.5 * spacing, (highest + 0.5) * spacing, is_log=False)
    band_hz = _known_band(scene)
    if band_hz is None or axis.high_hz > band_hz[1] or window_s * spacing < 2.0:
        return []
    if (picture := picture_of(scene, axis, window_s)) is None:
        return []

    def draw(ax: Axes) -> None:
        picture.draw(ax)
        numbers = range(1, highest + 1, 1 + highest // 9)
        ax.set_yticks([n * spacing for n in numbers], [f"{n}" for n in numbers])
        ax.set_ylabel(f"multiple of\n{spacing:.2f} Hz", fontsize=8)

    return [PagePart(COMB_IN, draw)]


def fringe_part(scene: Scene, fits: Sequence[ReportedPassage]) -> list[PagePart]:
    """Return the image of fringes, with the curves of passages over it."""
    fringes = scene.first(Fringes)
    image = None if fringes is None else FringeImage.of(fringes, scene.span_s)
    if image is None:
        return []
    laws = [law_of(fit.time_s, fit.width_s, fit.mach) for fit in fits if fit.is_drawn]
    laws = [law for law in laws if image.moves_as(law)]
    return [PagePart(COMB_IN, lambda ax: image.draw(ax, laws))] if laws else []


def presence_part(scene: Scene) -> list[PagePart]:
    """Return bars of what was heard: a row for each vessel, and for each other kind."""
    if (presence := scene.presence) is None:
        return []
    rows = defaultdict[tuple[int, int, int], list[int]](list)
    for segment in scene.segments.tolist():
        number = scene.owner(segment)
        is_vessel = presence.kind[segment] in OF_VESSELS
        contact = int(presence.contact[segment]) if is_vessel else 0
        kind = KINDS.index(presence.kind[segment])
        rows[(-1, number, 0) if number else (kind, 0, contact)].append(segment)
    order = sorted(rows, reverse=True)

    def draw(ax: Axes) -> None:
        style.calm(ax).grid(visible=False, axis="y")
        for place, key in enumerate(order):
            _draw_bars(presence, rows[key], key[1], place, ax)
        names = [f"passage {key[1]}" if key[1] else KINDS[key[0]] for key in order]
        ax.set_yticks(range(len(order)), names, fontsize=7)
        ax.set_ylim(-0.6, len(order) - 0.4)

    return [PagePart(0.28 + 0.17 * len(order), draw)] if order else []


def _draw_bars(presence: Presence, rows: list[int], number: int, place: int, ax: Axes) -> None:
    """Draw segments in a row, those that overlap as one, with the longest's spacing."""
    color, span_s = style.contact_color(number), ax.get_xlim()
    length_s, bars = float(np.ptp(span_s)), list[tuple[float, float, list[int]]]()
    for row in sorted(rows, key=lambda row: float(presence.from_s[row])):
        begin, end, own = float(presence.from_s[row]), float(presence.to_s[row]), [row]
        if bars and begin <= bars[-1][1]:
            begin, last, before = bars.pop()
            end, own = max(last, end), [*before, row]
        bars.append((begin, end, own))
    for begin, end, own in bars:
        ax.barh(
            place, max(end - begin, LEAST_SHARE * length_s), left=begin, height=0.66,
            color=color, edgecolor="white", linewidth=0.5, alpha=1.0 if number else 0.6,
        )  # fmt: skip
        known = [row for row in own if np.isfinite(presence.spacing_hz[row])]
        seen = np.clip([begin, end], *span_s)
        if known and np.ptp(seen) > 0.1 * length_s:
            row = max(known, key=lambda row: presence.to_s[row] - presence.from_s[row])
            ax.text(
                float(seen.mean()), place, f"every {presence.spacing_hz[row]:.2f} Hz",
                ha="center", va="center", fontsize=7, clip_on=True,
                color=style.text_on(color) if number else "black",
            )  # fmt: skip


def rates_part(scene: Scene) -> list[PagePart]:
    """Return the modulation rates that were heard, over the envelope's spectrum."""
    presence, envelope = scene.presence, scene.envelope
    if presence is None:
        return []
    near = np.isin(presence.rate_segment, scene.segments)
    if not near.any():
        return []
    axis = FrequencyAxis(0.0, 1.25 * float(presence.rate_hz[near].max()), is_log=False)
    picture = None
    if envelope is not None and envelope is not scene.overview:
        picture = overview_picture(envelope, axis, scene.span_s)

    def draw(ax: Axes) -> None:
        if picture is not None:
            picture.draw(ax)
        axis.set_axis(ax if picture else style.calm(ax))
        ax.set_ylabel("modulation\nrate (Hz)", fontsize=8)
        rows = np.flatnonzero(near)
        rows = rows[np.argsort(presence.rate_hz[rows], kind="stable")]
        below, place, is_over = -np.inf, 0, picture is not None
        for row in rows:
            segment, rate = int(presence.rate_segment[row]), presence.rate_hz[row]
            ends = presence.from_s[segment], presence.to_s[segment]
            ends = np.clip(ends, *scene.span_s)
            line = Outlined(ends, np.full(2, rate), scene.owner(segment))
            _outline(line, axis, ax, is_over=is_over)
            share = float(axis.share(rate))  # a value that covers one is put beside it
            place = (place + 1) % LABEL_PLACES if share - below < LABEL_SHARE else 0
            below = share
            ax.annotate(
                f"{rate:.2f}", (ends[0], rate), xytext=(3 + 30 * place, EDGE_PT + 1),
                textcoords="offset points", fontsize=7,
                color="white" if is_over else None,
            )  # fmt: skip

    return [PagePart(CURVE_IN if picture is None else RATES_IN, draw)]


def level_part(scene: Scene, fit: ReportedPassage | None = None) -> list[PagePart]:
    """Return the level: its middle, what most frames lie within, and a passage's fit."""
    measured_s, level, name = _measured_level(scene, fit)
    inside = style.within(measured_s, scene.span_s) & np.isfinite(level)
    if inside.sum() < 2:
        return []
    time_s, level_db = measured_s[inside], level[inside]

    def draw(ax: Axes) -> None:
        style.calm(ax, name)
        middle, low, half, high = _quantiles(time_s, level_db)
        ax.fill_between(middle, low, high, color=style.MEASURED, alpha=0.3, lw=0)
        ax.plot(middle, half, color=style.MEASURED, lw=0.8)
        if fit is not None and fit.has_level:
            _draw_level_fit(scene, fit, time_s, level_db, ax)

    return [PagePart(CURVE_IN, draw)]


def _measured_level(
    scene: Scene, fit: ReportedPassage | None
) -> tuple[FloatArray, FloatArray, str]:
    """Return times, levels and what they are: of the sound, or of a table."""
    levels, series = scene.first(Levels), scene.first(Series)
    if levels is not None:
        name = (
            f"level {levels.band_low_hz:.0f}-{levels.band_high_hz:.0f} Hz\n"
            f"(dB re {figure_text(levels.reference)})"
        )
        return levels.frames.time_s, levels.level_db, name
    if series is None or fit is None:
        return np.zeros(0), np.zeros(0), ""
    rows = series.contact == fit.contact
    return series.time_s[rows], series.level_db[rows], "level (dB)"


def _quantiles(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return middles of blocks of as many frames, and quantiles of values in each."""
    size = -(-time_s.size // LEVEL_BLOCKS)
    blocks = np.split(np.arange(time_s.size), range(size, time_s.size, size))
    found = np.array([[time_s[b].mean(), *np.quantile(values[b], LEVEL_QUANTILES)] for b in blocks])
    steps = np.diff(found[:, 0], prepend=found[0, 0])
    found[steps > 3 * np.median(steps), 1:] = np.nan  # a gap in the sound
    return found.T


def _draw_level_fit(
    scene: Scene, fit: ReportedPassage, time_s: FloatArray, level_db: FloatArray, ax: Axes
) -> None:
    """Draw the vessels over the background, with the deviation of the one's level."""
    every = [one for one in passages_of(scene) if one.has_level]
    grid, color = np.linspace(*ax.get_xlim(), 400), style.contact_color(fit.number)
    others = sum(one.power(grid) for one in every if one.row != fit.row)
    left = 10 ** (level_db / 10) - sum(one.power(time_s) for one in every)
    background = others + max(float(np.nanmedian(left)), 0.0)
    half = style.BAND_DEVIATIONS * np.nan_to_num(fit.value("received_level_std_db"))
    middle, low, high = (
        10 * np.log10(fit.power(grid) * 10 ** (add / 10) + background) for add in (0.0, -half, half)
    )
    ax.plot(grid, middle, color=color, lw=1.1)
    ax.fill_between(grid, low, high, color=color, alpha=0.25, lw=0)
    bottom, top = float(np.quantile(level_db, 0.005)), float(level_db.max())
    ax.set_ylim(bottom - 1.5, float(np.nanmax(middle, initial=top)) + 1.5)


def bearing_part(scene: Scene, fit: ReportedPassage | None = None) -> list[PagePart]:
    """Return bearings of the sound and of lines, and those of a passage as fitted."""
    levels, own = scene.first(Levels), fit and fit.contact
    measured: list[Sequence[Any]] = []
    if levels is not None and levels.bearing_deg.size:
        std = np.nan_to_num(levels.bearing_std_deg, nan=np.inf)
        measured.append((0, levels.frames.time_s, levels.bearing_deg, std))
    for contact, *columns in contact_bearings(scene, has_tables=fit is not None):
        if contact == own or (fit is None and columns[0]):
            measured.append(columns)
    shown = [
        (time_s[inside], np.mod(bearing[inside], 360.0), number)
        for number, time_s, bearing, std in measured
        for is_usable in [~(std >= USABLE_BEARING_DEG)]
        for inside in [style.within(time_s, scene.span_s) & is_usable]
        if np.isfinite(bearing[inside]).any()
    ]
    grid = np.linspace(*scene.span_s, 400)
    fitted = None if fit is None else fit.bearing(grid)
    if not shown and fitted is None:
        return []

    def draw(ax: Axes) -> None:
        style.calm(ax, "bearing (deg)")
        for time_s, bearing, number in shown:
            thin = slice(None, None, -(-time_s.size // (4 * MOST_POINTS)))
            color = style.contact_color(number) if number else style.MEASURED
            ax.plot(time_s[thin], bearing[thin], ".", ms=2.4, color=color, alpha=0.4,
                    mec="none", rasterized=True)  # fmt: skip
        if fit is not None and fitted is not None:
            half, color = (style.BAND_DEVIATIONS * fitted[1], style.contact_color(fit.number))
            style.draw_band(ax, grid, style.broken_bearing(fitted[0]), half, color)
        ax.set(ylim=(0.0, 360.0), yticks=range(0, 361, 90))

    return [PagePart(CURVE_IN, draw)]


def contact_bearings(
    scene: Scene, *, has_tables: bool = True
) -> Iterator[tuple[int, int, FloatArray, FloatArray, FloatArray]]:
    """Yield contact, number of its passage, times, bearings and their deviations.

    Those of a table, or followed without lines, come before those of each line.
    """
    lines, series = scene.first(Lines), scene.first(Series)
    if series is not None and has_tables:
        columns = series.time_s, series.bearing_deg, series.bearing_std_deg
        for contact in np.unique(series.contact).tolist():
            own = series.contact == contact
            number = scene.number(contact) or contact
            yield contact, number, *(one[own] for one in columns)
    if lines is not None:
        columns = (lines.time_s, lines.measured_bearing_deg, lines.measured_bearing_std_deg)
        for name, contact in zip(lines.line_id, lines.line_contact, strict=True):
            if contact > 0:
                own = lines.line == name
                yield contact, scene.number(contact), *(one[own] for one in columns)
