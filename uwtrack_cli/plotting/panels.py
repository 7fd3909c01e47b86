"""The panels over time that pages of recordings, passages and reports share.

**Conventions.** A panel is drawn if it has something to say: each function returns the
parts of a page that there are, none where nothing is known. A contact with a passage
has the passage's number and colour; what belongs to none is white on a picture, else
grey. Bands are two standard deviations on either side.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.presence import KINDS, OF_VESSELS, Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import MODULATION, Levels
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.fringe_image import draw_fringes, has_pattern
from uwtrack_cli.plotting.page_layout import PagePart
from uwtrack_cli.plotting.passage_fit import ReportedPassage
from uwtrack_cli.plotting.picture import (
    MOST_SAMPLES,
    FrequencyAxis,
    Picture,
    check_axes,
    choose_axis,
    draw_picture,
    lofargram,
    overview_picture,
)
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    MEASURED,
    broken_bearing,
    calm,
    contact_color,
    text_on,
)
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WHOLE_IN, PART_IN, COMB_IN, RATES_IN, CURVE_IN = 2.5, 2.3, 1.9, 1.6, 1.1
"""Heights of the pictures of the whole band, of the lines' part of it, of a comb, of the
envelope, and of curves, inches."""

MOST_POINTS = 1500
"""Points of a line or level that are drawn; of more, every so many-th."""

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

Span = tuple[float, float]


class Outlined(NamedTuple):
    """A line that is outlined."""

    time_s: FloatArray
    """Times of its points, s."""
    frequency_hz: FloatArray
    """Their frequencies, Hz."""
    number: int
    """Passage that it belongs to; 0 for none."""


def lofargram_parts(scene: Scene, view: View, span_s: Span) -> list[PagePart]:
    """Return the picture of the whole band, and that of the lines' part enlarged."""
    lines = outlined_lines(scene, view, span_s)
    known_hz = _known_band(scene, span_s)
    if known_hz is None:
        return _lines_alone(lines, view)
    axis = choose_axis(known_hz, view)
    part = None if view.band_hz is not None else lines_part(lines, axis)
    parts = [_picture_part(scene, span_s, axis, lines if part is None else [])]
    if part is not None and part.high_hz > part.low_hz:
        held = scene.first(Lines)
        window_s = None if held is None else held.frames.window_s
        parts.append(_picture_part(scene, span_s, part, lines, window_s))
    return parts


def _known_band(scene: Scene, span_s: Span) -> tuple[float, float] | None:
    """Return the band that there is a picture of, Hz: of the sound, or the overview."""
    overview = scene.overview
    if _has_sound(scene, span_s):
        return 0.0, 0.5 * scene.all(Recording)[0].sample_rate_hz
    if overview is None or not overview.shade.size:
        return None
    check_axes(overview, "time_s", "frequency_hz")
    frequency = overview.frequency_hz
    is_log = overview.reference != MODULATION and frequency.size > 1
    return float(frequency[1 if is_log and frequency[0] <= 0 else 0]), float(
        frequency[-1]
    )


def _has_sound(scene: Scene, span_s: Span) -> bool:
    """Tell whether the sound is at hand, and short enough to be drawn from."""
    recording, overview = scene.first(Recording), scene.overview
    if recording is None or recording.reader is None:
        return False
    if overview is not None and overview.reference == MODULATION:
        return False
    return float(np.ptp(span_s)) * recording.sample_rate_hz <= MOST_SAMPLES


def picture_of(
    scene: Scene, axis: FrequencyAxis, span_s: Span, window_s: float | None = None
) -> Picture | None:
    """Return a span of the sound over its floor, else of the overview; None without.

    ``window_s``: length of a window; None: as the length of the sound asks for.
    """

    def make() -> Picture | None:
        recording, overview, found = scene.first(Recording), scene.overview, None
        if recording is not None and _has_sound(scene, span_s):
            found = lofargram(recording, axis, span_s, window_s)
        if found is None and overview is not None and overview.shade.size:
            found = overview_picture(overview, axis, span_s)
        return found

    return scene.once((axis, span_s, window_s), make)


def _picture_part(
    scene: Scene, span_s: Span, axis: FrequencyAxis,
    lines: Sequence[Outlined], window_s: float | None = None,
) -> PagePart:  # fmt: skip
    picture = picture_of(scene, axis, span_s, window_s)
    overview = scene.overview

    def draw(ax: "Axes") -> None:
        shown = axis
        if picture is not None:
            draw_picture(picture, ax)
            shown = picture.axis
        if overview is not None and overview.reference == MODULATION:
            ax.set_ylabel("modulation rate (Hz)", fontsize=9)
        _draw_outlines(lines, shown, ax)

    is_alone = bool(lines) or window_s is None
    height = PART_IN if window_s is not None else WHOLE_IN + (0.9 if lines else 0.0)
    return PagePart(height if is_alone else PART_IN, draw)


def outlined_lines(scene: Scene, view: View, span_s: Span) -> list[Outlined]:
    """Return the lines that are outlined: no fragments, unless all are asked for."""
    lines = scene.first(Lines)
    if lines is None or view.has_lines is False:
        return []
    least_s = 0.0 if view.has_lines else LASTING * float(np.ptp(span_s))
    order = np.argsort(lines.line, kind="stable")
    first = np.searchsorted(lines.line[order], lines.line_id, side="left")
    last = np.searchsorted(lines.line[order], lines.line_id, side="right")
    found: list[tuple[float, Outlined]] = []
    for begin, end, contact in zip(first, last, lines.line_contact, strict=True):
        rows = order[begin:end]
        time_s = lines.time_s[rows]
        rows = rows[(time_s >= span_s[0]) & (time_s <= span_s[1])]
        if rows.size and np.ptp(lines.time_s[rows]) >= least_s:
            kept = rows[:: -(-rows.size // MOST_POINTS)]
            own = (
                lines.time_s[kept],
                lines.frequency_hz[kept],
                scene.number(int(contact)),
            )
            found.append((float(np.ptp(own[0])), Outlined(*own)))
    if view.has_lines is None and len(found) > MOST_LINES:
        found = sorted(found, key=lambda one: -one[0])[:MOST_LINES]
    return [line for _, line in found]


def lines_part(lines: Sequence[Outlined], axis: FrequencyAxis) -> FrequencyAxis | None:
    """Return the part of an axis that holds most lines; None where it needs no other.

    The axis of the part is linear: multiples of a rate lie evenly.
    """
    if not lines or not axis.is_log:
        return None
    middle = np.sort([float(np.median(line.frequency_hz)) for line in lines])
    middle = middle[(middle >= axis.low_hz) & (middle <= axis.high_hz)]
    if not middle.size:
        return None
    low = float(middle[0])
    share = 1.0 if middle.size <= FEW_LINES else LINES_SHARE
    high = float(middle[int(np.ceil(share * middle.size)) - 1])
    margin = max(0.15 * (high - low), 0.08 * high)
    part = FrequencyAxis(
        max(0.0, low - margin), min(high + margin, axis.high_hz), False
    )
    ends = np.clip([part.low_hz, part.high_hz], axis.low_hz, axis.high_hz)
    return part if float(np.ptp(axis.share(ends))) < PART_SHARE else None


def _draw_outlines(lines: Sequence[Outlined], axis: FrequencyAxis, ax: "Axes") -> None:
    """Draw lines as outlines; of many without a passage, begin and end alone."""
    is_crowd = sum(not line.number for line in lines) > MOST_OUTLINES
    for line in lines:
        if line.number or not is_crowd:
            _outline(line, axis, ax)
            continue
        for end, mark in ((0, ">"), (-1, "<")):
            if axis.low_hz <= line.frequency_hz[end] <= axis.high_hz:
                ax.plot(line.time_s[end], line.frequency_hz[end], mark, ms=3.0,
                        color="white", alpha=0.8, mec="none")  # fmt: skip


def _outline(line: Outlined, axis: FrequencyAxis, ax: "Axes") -> None:
    """Draw an edge on either side of a line, in the colour of its passage."""
    from matplotlib.transforms import ScaledTranslation

    inside = (line.frequency_hz >= axis.low_hz) & (line.frequency_hz <= axis.high_hz)
    figure = ax.get_figure(root=True)
    if figure is None or not inside.any():
        return
    color = contact_color(line.number) if line.number else "white"
    frequency = np.where(inside, line.frequency_hz, np.nan)
    for side in (-1.0, 1.0):
        moved = ScaledTranslation(0, side * EDGE_PT / 72, figure.dpi_scale_trans)
        ax.plot(line.time_s, frequency, transform=ax.transData + moved, color=color,
                lw=0.7, alpha=0.9 if line.number else 0.4)  # fmt: skip


def _lines_alone(lines: Sequence[Outlined], view: View) -> list[PagePart]:
    """Return the lines where there is no picture."""
    if not lines:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        for line in lines:
            color = contact_color(line.number)
            ax.plot(line.time_s, line.frequency_hz, lw=0.9, color=color)
        if view.band_hz is not None:
            ax.set_ylim(*view.band_hz)
        if view.is_log:
            ax.set_yscale("log")
        ax.set_ylabel("frequency (Hz)", fontsize=9)

    return [PagePart(PART_IN, draw)]


def comb_part(scene: Scene, span_s: Span) -> list[PagePart]:
    """Return the harmonics of the longest family over time, by their number."""
    presence = scene.presence
    if presence is None:
        return []
    inside = np.minimum(presence.to_s, span_s[1]) - np.maximum(
        presence.from_s, span_s[0]
    )
    known = np.isfinite(presence.spacing_hz) & (presence.n_lines > 1) & (inside > 0.0)
    known &= np.isin(presence.kind, list(OF_VESSELS))
    if not known.any():
        return []
    row = int(np.argmax(np.where(known, inside, -np.inf)))
    spacing = float(presence.spacing_hz[row])
    own = presence.frequency_hz[presence.frequency_stretch == row] / spacing
    highest = min(HARMONICS, round(float(own.max(initial=4.0))) + 2)
    window_s = min(CELLS_PER_TOOTH / spacing, 0.125 * float(np.ptp(span_s)))
    axis = FrequencyAxis(0.5 * spacing, (highest + 0.5) * spacing, is_log=False)
    band_hz = _known_band(scene, span_s)
    if band_hz is None or axis.high_hz > band_hz[1] or window_s * spacing < 2.0:
        return []
    picture = picture_of(scene, axis, span_s, window_s)
    if picture is None:
        return []

    def draw(ax: "Axes") -> None:
        draw_picture(picture, ax)
        numbers = range(1, highest + 1, 1 + highest // 9)
        ax.set_yticks([n * spacing for n in numbers], [f"{n}" for n in numbers])
        ax.set_ylabel(f"multiple of\n{spacing:.2f} Hz", fontsize=8)

    return [PagePart(COMB_IN, draw)]


def fringe_part(
    scene: Scene, span_s: Span, fits: Sequence[ReportedPassage]
) -> list[PagePart]:
    """Return the image of fringes, with the curves of passages over it."""
    fringes = scene.first(Fringes)
    if fringes is None:
        return []
    laws = [(fit.time_s, fit.width_s, fit.mach) for fit in fits if fit.is_drawn]
    laws = [law for law in laws if has_pattern(fringes, span_s, law)]
    if not laws:
        return []
    return [PagePart(COMB_IN, lambda ax: draw_fringes(calm(ax), fringes, span_s, laws))]


def presence_part(scene: Scene, span_s: Span) -> list[PagePart]:
    """Return bars of what was heard: a row for each vessel, and for each other kind."""
    presence = scene.presence
    if presence is None:
        return []
    near = (presence.to_s >= span_s[0]) & (presence.from_s <= span_s[1])
    rows: dict[tuple[int, int, int], list[int]] = {}
    for stretch in np.flatnonzero(near):
        number = _owner(scene, presence, int(stretch))
        kind = KINDS.index(presence.kind[stretch])
        is_vessel = presence.kind[stretch] in OF_VESSELS
        contact = int(presence.contact[stretch]) if is_vessel else 0
        key = (-1, number, 0) if number else (kind, 0, contact)
        rows.setdefault(key, []).append(int(stretch))
    if not rows:
        return []
    order = sorted(rows, reverse=True)

    def draw(ax: "Axes") -> None:
        calm(ax)
        ax.grid(visible=False, axis="y")
        for place, key in enumerate(order):
            _draw_bars(presence, rows[key], key[1], place, span_s, ax)
        names = [f"passage {key[1]}" if key[1] else KINDS[key[0]] for key in order]
        ax.set_yticks(range(len(order)), names, fontsize=7)
        ax.set_ylim(-0.6, len(order) - 0.4)

    return [PagePart(0.28 + 0.17 * len(order), draw)]


def _owner(scene: Scene, presence: Presence, stretch: int) -> int:
    """Return the number of the passage that a stretch belongs to; 0 for none."""
    own = int(presence.encounter[stretch]) or int(presence.contact[stretch])
    return scene.number(own) if scene.encounters is not None else 0


def _draw_bars(
    presence: Presence,
    rows: list[int],
    number: int,
    place: int,
    span_s: Span,
    ax: "Axes",
) -> None:
    """Draw stretches in a row, those that overlap as one, with the longest's spacing."""
    color, length_s = contact_color(number), float(np.ptp(span_s))
    bars: list[tuple[float, float, list[int]]] = []
    for row in sorted(rows, key=lambda row: float(presence.from_s[row])):
        begin, end = float(presence.from_s[row]), float(presence.to_s[row])
        if bars and begin <= bars[-1][1]:
            first, last, own = bars.pop()
            bars.append((first, max(last, end), [*own, row]))
        else:
            bars.append((begin, end, [row]))
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
                color=text_on(color) if number else "black",
            )  # fmt: skip


def rates_part(scene: Scene, span_s: Span) -> list[PagePart]:
    """Return the modulation rates that were heard, over the envelope's spectrum."""
    presence, envelope = scene.presence, scene.envelope
    if presence is None or not presence.rate_hz.size:
        return []
    owner = presence.rate_stretch
    near = (presence.to_s[owner] >= span_s[0]) & (presence.from_s[owner] <= span_s[1])
    if not near.any():
        return []
    axis = FrequencyAxis(0.0, 1.25 * float(presence.rate_hz[near].max()), is_log=False)
    picture = None
    if envelope is not None and envelope is not scene.overview:
        picture = overview_picture(envelope, axis, span_s)

    def draw(ax: "Axes") -> None:
        calm(ax)
        if picture is not None:
            draw_picture(picture, ax)
        axis.set_axis(ax)
        ax.set_ylabel("modulation\nrate (Hz)", fontsize=8)
        is_over = picture is not None
        _draw_rates(scene, presence, np.flatnonzero(near), axis, ax, is_over=is_over)

    return [PagePart(CURVE_IN if picture is None else RATES_IN, draw)]


def _draw_rates(
    scene: Scene, presence: Presence, rows: IntArray, axis: FrequencyAxis, ax: "Axes",
    *, is_over: bool,
) -> None:  # fmt: skip
    """Draw rates as lines, or over a picture as the edges of lines, with their values.

    A value that would cover the one below is put beside it.
    """
    span_s = ax.get_xlim()
    below, place = -np.inf, 0
    for row in rows[np.argsort(presence.rate_hz[rows], kind="stable")]:
        stretch, rate = int(presence.rate_stretch[row]), float(presence.rate_hz[row])
        number = _owner(scene, presence, stretch)
        ends = np.clip([presence.from_s[stretch], presence.to_s[stretch]], *span_s)
        if is_over:
            _outline(Outlined(ends, np.full(2, rate), number), axis, ax)
        else:
            ax.plot(ends, (rate, rate), color=contact_color(number), lw=1.6)
        share = float(axis.share(np.array(rate)))
        place = (place + 1) % LABEL_PLACES if share - below < LABEL_SHARE else 0
        below = share
        ax.annotate(
            f"{rate:.2f}", (ends[0], rate), xytext=(3 + 30 * place, EDGE_PT + 1),
            textcoords="offset points", fontsize=7, color="white" if is_over else None,
        )  # fmt: skip


def level_part(
    scene: Scene, span_s: Span, fit: ReportedPassage | None = None
) -> list[PagePart]:
    """Return the level: its middle, what most frames lie within, and a passage's fit."""
    measured_s, level, name = _measured_level(scene, fit)
    inside = (measured_s >= span_s[0]) & (measured_s <= span_s[1]) & np.isfinite(level)
    if inside.sum() < 2:
        return []
    time_s, level_db = measured_s[inside], level[inside]

    def draw(ax: "Axes") -> None:
        calm(ax)
        middle, low, half, high = _quantiles(time_s, level_db)
        ax.fill_between(middle, low, high, color=MEASURED, alpha=0.3, lw=0)
        ax.plot(middle, half, color=MEASURED, lw=0.8)
        ax.set_ylabel(name, fontsize=8)
        if fit is not None:
            _draw_level_fit(fit, time_s, level_db, span_s, ax)

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


def _quantiles(
    time_s: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return middles of blocks of as many frames, and quantiles of values in each."""
    size = -(-time_s.size // LEVEL_BLOCKS)
    blocks = np.split(np.arange(time_s.size), range(size, time_s.size, size))
    found = np.array([np.quantile(values[b], LEVEL_QUANTILES) for b in blocks])
    middle = np.array([time_s[b].mean() for b in blocks])
    steps = np.diff(middle, prepend=middle[0])
    found[steps > 3 * np.median(steps)] = np.nan  # a gap in the sound
    return middle, found[:, 0], found[:, 1], found[:, 2]


def _draw_level_fit(
    fit: ReportedPassage, time_s: FloatArray, level_db: FloatArray, span_s: Span,
    ax: "Axes",
) -> None:  # fmt: skip
    """Draw the vessels over the background, with the deviation of the one's level."""
    found = fit.encounters
    peak = found.received_level_db
    if not np.isfinite(peak[fit.row]) or not fit.is_drawn:
        return
    every = (ReportedPassage(found, row) for row in range(found.n_encounters))
    heard = [f for f in every if f.is_drawn and np.isfinite(peak[f.row])]
    grid = np.linspace(*span_s, 400)

    def power(at_s: FloatArray, added_db: float) -> FloatArray:
        own = [10 ** ((float(peak[f.row]) + (added_db if f.row == fit.row else 0.0)
                       + f.spread_db(at_s)) / 10) for f in heard]  # fmt: skip
        return np.asarray(np.sum(own, axis=0))

    left = 10 ** (level_db / 10) - power(time_s, 0.0)
    background = max(float(np.nanmedian(left)), 0.0)
    half = BAND_DEVIATIONS * np.nan_to_num(float(found.received_level_std_db[fit.row]))
    middle, low, high = (
        10 * np.log10(power(grid, add) + background) for add in (0.0, -half, half)
    )
    color = contact_color(fit.number)
    ax.plot(grid, middle, color=color, lw=1.1)
    ax.fill_between(grid, low, high, color=color, alpha=0.25, lw=0)
    bottom, top = float(np.quantile(level_db, 0.005)), float(level_db.max())
    ax.set_ylim(bottom - 1.5, float(np.nanmax(middle, initial=top)) + 1.5)


def bearing_part(
    scene: Scene, span_s: Span, fit: ReportedPassage | None = None
) -> list[PagePart]:
    """Return bearings of the sound and of lines, and those of a passage as fitted."""
    measured = _bearings_of_sound(scene) if fit is None else _bearings_of(scene, fit)
    shown = [
        (time_s[inside], np.mod(bearing[inside], 360.0), color)
        for time_s, bearing, color in measured
        for inside in [(time_s >= span_s[0]) & (time_s <= span_s[1])]
        if inside.any()
    ]
    grid = np.linspace(*span_s, 400)
    fitted = None if fit is None else fit.bearing(grid)
    if not shown and fitted is None:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        for time_s, bearing, color in shown:
            thin = slice(None, None, -(-time_s.size // (4 * MOST_POINTS)))
            ax.plot(time_s[thin], bearing[thin], ".", ms=2.4, color=color, alpha=0.4,
                    mec="none", rasterized=True)  # fmt: skip
        if fit is not None and fitted is not None:
            color, middle = contact_color(fit.number), broken_bearing(fitted[0])
            half = BAND_DEVIATIONS * fitted[1]
            ax.plot(grid, middle, color=color, lw=0.9)
            ax.fill_between(grid, middle - half, middle + half, color=color, alpha=0.25,
                            lw=0)  # fmt: skip
        ax.set(ylim=(0.0, 360.0), yticks=range(0, 361, 90))
        ax.set_ylabel("bearing (deg)", fontsize=8)

    return [PagePart(CURVE_IN, draw)]


Bearings = list[tuple[FloatArray, FloatArray, str]]


def _bearings_of_sound(scene: Scene) -> Bearings:
    """Return broadband bearings, and behind them those of the passages' lines."""
    levels, lines = scene.first(Levels), scene.first(Lines)
    if levels is None or levels.bearing_deg.size == 0:
        return []
    known = levels.bearing_std_deg < USABLE_BEARING_DEG
    if not known.any():
        return []
    found = [(levels.frames.time_s[known], levels.bearing_deg[known], MEASURED)]
    if lines is None:
        return found
    for name, contact in zip(lines.line_id, lines.line_contact, strict=True):
        number = scene.number(int(contact))
        if number:
            rows = (lines.line == name) & np.isfinite(lines.bearing_deg)
            own = lines.time_s[rows], lines.bearing_deg[rows], contact_color(number)
            found.append(own)
    return found


def _bearings_of(scene: Scene, fit: ReportedPassage) -> Bearings:
    """Return measured bearings of a passage: of the sound, its lines, or a table."""
    levels, lines = scene.first(Levels), scene.first(Lines)
    series, color = scene.first(Series), contact_color(fit.number)
    found: Bearings = []
    if levels is not None:
        known = levels.bearing_std_deg < USABLE_BEARING_DEG
        found.append((levels.frames.time_s[known], levels.bearing_deg[known], MEASURED))
    if lines is not None:
        own = fit.encounters.rest_line_id[fit.encounters.rest_encounter == fit.row]
        known = np.isin(lines.line, own)
        known &= lines.measured_bearing_std_deg < USABLE_BEARING_DEG
        found.append((lines.time_s[known], lines.measured_bearing_deg[known], color))
    if series is not None:
        known = (series.contact == fit.contact) & np.isfinite(series.bearing_deg)
        found.append((series.time_s[known], series.bearing_deg[known], color))
    return found
