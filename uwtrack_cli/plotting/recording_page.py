"""The page of a recording or a day: what was heard, over one time axis.

**Method.** The lofargram lies over the noise floor of its band; tracked lines are
drawn as outlines, an edge on either side, so that what was heard stays visible between
them. Passages are marked at their arrival with the number that they have in the table,
in the colour that they have everywhere. Of a line array the bearing-time record takes
the place of the lofargram.

**Conventions.** A panel is drawn if it has something to say.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.arrays.line_array import LineArray
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.presence import KINDS, Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.tables.presence_words import presence_sentences
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.bearing_time import (
    draw_beam_pattern,
    draw_bearing_time,
    draw_contact_angles,
    draw_frequency_azimuth,
    draw_heading,
    draw_line_angles,
)
from uwtrack_cli.plotting.lofargram import (
    FrequencyAxis,
    choose_axis,
    draw_lofargram,
    finer_overview,
)
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    Panel,
    draw_parts,
    span_title,
    stacked,
    titled_figure,
)
from uwtrack_cli.plotting.passage_fit import ReportedPassage
from uwtrack_cli.plotting.passage_page import MARKED_MISFIT, USABLE_BEARING_DEG
from uwtrack_cli.plotting.sensor_map import draw_sensor_map, has_sensor_map
from uwtrack_cli.plotting.style import (
    MEASURED,
    calm,
    contact_color,
    contact_dash,
    text_on,
)
from uwtrack_cli.plotting.target_motion_page import (
    draw_motion_map,
    measured_from,
    motion_states,
)
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MOST_POINTS = 1500
"""Points of a line or level that are drawn; of more, every so many-th."""

LOFARGRAM_IN = 3.4
"""Height of the lofargram, inches."""

RATES_IN = 1.6
"""Height of the spectrum of the envelope, inches."""

LABEL_SHARE, LABEL_PLACES = 0.12, 4
"""Least distance of two labels that are not beside each other, as a share of the height
of the rates' panel, and how many of them are."""

EDGE_PT = 2.2
"""Distance of the edges of an outline from the line, points."""

MOST_LANES = 4
"""Rows of bars of one kind that overlap."""

LEAST_SHARE = 0.004
"""Least length of a bar, as a share of the whole span."""

MAP_IN = 4.6
"""Height of the map of several sensors, inches."""

LEVEL_QUANTILES = (0.1, 0.5, 0.9)
"""What is shown of the levels within a pixel."""

LEVEL_BLOCKS = 500
"""Pixels of a level."""


def recording_figure(scenes: Sequence[Scene], view: View) -> "Figure":
    """Return the page of a recording, or of several sensors that heard the same.

    Raises
    ------
    DataError
        There is nothing to draw.
    """
    spans = [scene.times_s for scene in scenes]
    known = [span for span in spans if span is not None]
    parts: list[list[PagePart]] = []
    shared: tuple[float, float] = (0.0, 1.0)
    if known:
        shared = min(s[0] for s in known), max(s[1] for s in known)
        clock = scenes[0].clock
        shared = view.span_s(shared, clock)
        parts = [_parts(scene, view, shared, len(scenes)) for scene in scenes]
    below = _below(scenes, shared, 0.9 * view.width_in / (MAP_IN - 0.5))
    if not any(parts) and below is None:
        held = ", ".join(sorted({c.NAME for s in scenes for c in s.containers}))
        msg = f"there is nothing to draw; the files hold {held or 'nothing'}."
        raise DataError(msg)
    every = [part for own in parts for part in own]
    height = sum(part.height for part in every) + (0.5 if every else 0.0)
    map_in = 0.0 if below is None else MAP_IN
    figure, body = titled_figure(_heads(scenes, shared), view, height + map_in)
    if every and below is not None:
        upper, lower = stacked(body, height, map_in)
    else:
        upper, lower = body, body
    draw_parts(every, upper, scenes[0].clock, shared, view.ticks)
    if below is not None:
        below(lower)
    return figure


def _below(
    scenes: Sequence[Scene], span_s: tuple[float, float], ratio: float
) -> Callable[["SubFigure"], object] | None:
    """Return what is drawn below the panels over time: a map, or peaks of an array."""
    first = scenes[0]
    motions = first.first(Motions)
    if motions is not None and motions.contact.size:
        origin = measured_from(first)
        return lambda part: draw_motion_map(motions, origin, part.subplots(), ratio)
    if has_sensor_map(scenes):
        return lambda part: draw_sensor_map(scenes, part.subplots(), ratio)
    record, peaks = first.first(BearingTime), first.first(Peaks)
    if record is None or peaks is None or not peaks.frame.size:
        return None
    sensor = first.first(Sensor)
    if sensor is None or record.cos_angle is None:
        return lambda part: draw_frequency_azimuth(
            record, peaks, part.subplots(), span_s
        )
    array = LineArray(sensor.element_places_m, sensor.sound_speed_mps)

    def draw(part: "SubFigure") -> None:
        left, right = part.subplots(1, 2, width_ratios=[4.0, 1.0])
        draw_frequency_azimuth(record, peaks, left, span_s)
        draw_beam_pattern(record, array, right)

    return draw


def _heads(scenes: Sequence[Scene], span_s: tuple[float, float]) -> list[HeadLine]:
    """Return the title: what was recorded when; and what came of it."""
    clock = scenes[0].clock
    names = [r.name for s in scenes if (r := s.first(Recording)) is not None]
    found = [HeadLine(span_title(span_s, clock, names))]
    sensors = [s for s in (scene.sensor for scene in scenes) if s]
    facts = [f"sensor {', '.join(sensors)}"] if sensors else []
    facts += _counts(scenes[0], span_s)
    if facts:
        found.append(HeadLine(" \u00b7 ".join(facts)))
    motions = scenes[0].first(Motions)
    if motions is not None:
        found += [HeadLine(text) for text in motion_states(motions)]
    return found + _warnings(scenes)


def _counts(scene: Scene, span_s: tuple[float, float]) -> list[str]:
    """Say how many passages a span holds, and what else was heard in it."""
    encounters, presence = scene.encounters, scene.presence
    facts = []
    n = 0
    if encounters is not None:
        at = np.where(
            np.isfinite(encounters.arrival_time_s), encounters.arrival_time_s,
            encounters.time_s,
        )  # fmt: skip
        n = int(np.sum(~((at < span_s[0]) | (at > span_s[1]))))
        if n or presence is None:
            facts.append(f"{n or 'no'} passage{'' if n == 1 else 's'}")
    if presence is not None:
        near = (presence.to_s >= span_s[0]) & (presence.from_s <= span_s[1])
        heard = json_rows(presence.take("stretch", np.flatnonzero(near)))
        facts += presence_sentences(heard, is_passed=n > 0)
    return facts


def _warnings(scenes: Sequence[Scene]) -> list[HeadLine]:
    """Return the passages whose fit leaves their lines."""
    found = []
    for scene in scenes:
        encounters = scene.encounters
        count = 0 if encounters is None else encounters.n_encounters
        for row in range(count):
            fit = ReportedPassage(encounters, row)  # type: ignore[arg-type]
            if fit.misfit >= MARKED_MISFIT:
                text = (
                    f"\u26a0 passage {fit.contact}: misfit, the lines leave the fit by "
                    f"{100 * fit.misfit:.0f} % of the Doppler shift"
                )
                found.append(HeadLine(text, warns=True))
    return found


def _parts(
    scene: Scene, view: View, span_s: tuple[float, float], count: int
) -> list[PagePart]:
    """Return the panels of one sensor; of several sensors, only the first ones."""
    encounters = scene.encounters
    parts = _record(scene, span_s) or _lofargram(scene, view, span_s)
    parts += _presence(scene, span_s)
    if count == 1:
        parts += [
            *_rates(scene, span_s),
            *_level(scene, span_s),
            *_bearing(scene, span_s),
        ]
    if encounters is None or not parts:
        return parts
    first, *rest = parts
    return [
        PagePart(first.height, _numbered(first.draw, encounters, scene.sensor, count)),
        *(PagePart(p.height, _marked(p.draw, encounters)) for p in rest),
    ]


def _numbered(
    draw: Panel, encounters: Encounters, sensor: str | None, count: int
) -> Panel:
    """Return a panel with the number of every passage at its top."""

    def numbered(ax: "Axes") -> None:
        draw(ax)
        _mark(encounters, ax, height=0.06)
        low, high = ax.get_xlim()
        for row in range(encounters.n_encounters):
            fit = ReportedPassage(encounters, row)
            at = fit.arrival_s if np.isfinite(fit.arrival_s) else fit.time_s
            if not low <= at <= high:
                continue
            ax.annotate(
                f"{fit.contact}{'!' if fit.misfit >= MARKED_MISFIT else ''}",
                (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                textcoords="offset points", ha="center", va="bottom", fontsize=8,
                fontweight="bold", color=text_on(contact_color(fit.contact)),
                annotation_clip=False,
                bbox={"boxstyle": "round,pad=0.25", "fc": contact_color(fit.contact),
                      "ec": "none"},
            )  # fmt: skip
        if count > 1 and sensor:
            ax.text(
                0.01, 0.95, figure_text(sensor), transform=ax.transAxes, va="top",
                fontsize=9, bbox={"fc": "white", "ec": "none", "alpha": 0.8},
            )  # fmt: skip

    return numbered


def _marked(draw: Panel, encounters: Encounters) -> Panel:
    def marked(ax: "Axes") -> None:
        draw(ax)
        _mark(encounters, ax, height=1.0)

    return marked


def _mark(encounters: Encounters, ax: "Axes", *, height: float) -> None:
    """Mark when the sound of every closest approach arrived, down from the top."""
    low, high = ax.get_xlim()
    for row in range(encounters.n_encounters):
        fit = ReportedPassage(encounters, row)
        at = fit.arrival_s if np.isfinite(fit.arrival_s) else fit.time_s
        if low <= at <= high:
            ax.axvline(
                at, 1.0 - height, color=contact_color(fit.contact), lw=0.9,
                linestyle=contact_dash(fit.contact),
            )  # fmt: skip


def _lofargram(scene: Scene, view: View, span_s: tuple[float, float]) -> list[PagePart]:
    overview, lines = scene.overview, scene.first(Lines)
    if overview is None or not overview.shade.size:
        return _lines_alone(lines, view)
    if view.is_zoomed:
        frames = next((c.frames for c in (lines, scene.first(Levels)) if c), None)
        window_s = 1.0 if frames is None else frames.window_s
        overview = finer_overview(overview, scene.first(Recording), window_s, span_s)
    picture = overview
    axis = choose_axis(picture, lines, view.band_hz, is_log=view.is_log)

    def draw(ax: "Axes") -> None:
        draw_lofargram(picture, axis, span_s, ax)
        if lines is not None and view.has_lines:
            _outline(lines, axis, ax)

    return [PagePart(LOFARGRAM_IN, draw)]


def _lines_alone(lines: Lines | None, view: View) -> list[PagePart]:
    """Return the lines where no lofargram was kept."""
    if lines is None or not lines.line_id.size:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        for name, contact in zip(lines.line_id, lines.line_contact, strict=True):
            rows = np.flatnonzero(lines.line == name)
            rows = rows[:: -(-rows.size // MOST_POINTS) or 1]
            ax.plot(lines.time_s[rows], lines.frequency_hz[rows], lw=0.9,
                    color=contact_color(int(contact)))  # fmt: skip
        if view.band_hz is not None:
            ax.set_ylim(*view.band_hz)
        if view.is_log:
            ax.set_yscale("log")
        ax.set_ylabel("frequency (Hz)", fontsize=9)

    return [PagePart(LOFARGRAM_IN, draw)]


def _outline(lines: Lines, axis: FrequencyAxis, ax: "Axes") -> None:
    """Draw an edge on either side of every line, in the colour of its contact.

    Of lines that lie closer together than their edges, the ends alone are marked.
    """
    from matplotlib.transforms import ScaledTranslation

    figure = ax.get_figure(root=True)
    if figure is None:
        return
    low, high = ax.get_xlim()
    shown = [
        (rows, int(contact))
        for name, contact in zip(lines.line_id, lines.line_contact, strict=True)
        if (rows := _shown_rows(lines, int(name), axis, (low, high))).size
    ]
    middle = np.array([float(np.median(lines.frequency_hz[r])) for r, _ in shown])
    ends_s = np.array([lines.time_s[r[[0, -1]]] for r, _ in shown]).reshape(-1, 2)
    crowded = _crowded(axis.share(middle), ends_s)
    for (rows, contact), is_crowded in zip(shown, crowded, strict=True):
        kept = rows[:: -(-rows.size // MOST_POINTS)]
        color = contact_color(contact) if contact > 0 else "white"
        time_s, frequency = lines.time_s[kept], lines.frequency_hz[kept]
        if is_crowded:
            ends = [0, -1]
            ax.plot(time_s[ends], frequency[ends], ls="none", marker="|", ms=4,
                    mew=1.0, color=color, alpha=0.9)  # fmt: skip
            continue
        for side in (-1.0, 1.0):
            moved = ScaledTranslation(0, side * EDGE_PT / 72, figure.dpi_scale_trans)
            ax.plot(time_s, frequency, transform=ax.transData + moved, color=color,
                    lw=0.7, alpha=0.9 if contact > 0 else 0.45)  # fmt: skip


def _shown_rows(
    lines: Lines, name: int, axis: FrequencyAxis, span_s: tuple[float, float]
) -> IntArray:
    rows = np.flatnonzero(lines.line == name)
    inside = (lines.time_s[rows] >= span_s[0]) & (lines.time_s[rows] <= span_s[1])
    inside &= lines.frequency_hz[rows] >= axis.low_hz
    inside &= lines.frequency_hz[rows] <= axis.high_hz
    return rows[inside]


def _crowded(share: FloatArray, ends_s: FloatArray) -> BoolArray:
    """Tell which lines lie closer to one of the same time than their edges.

    ``share``: their heights, as shares of the axis, shape (line,). ``ends_s``: their
    begins and ends, s, shape (line, 2).
    """
    least = 3.0 * EDGE_PT / (72 * LOFARGRAM_IN)
    near = np.abs(share[:, None] - share) < least
    near &= (ends_s[:, None, 0] <= ends_s[:, 1]) & (ends_s[:, None, 1] >= ends_s[:, 0])
    np.fill_diagonal(near, val=False)
    return np.asarray(near.any(axis=1))


def _presence(scene: Scene, span_s: tuple[float, float]) -> list[PagePart]:
    """Return bars of what was heard, one row for each kind."""
    presence = scene.presence
    if presence is None:
        return []
    near = (presence.to_s >= span_s[0]) & (presence.from_s <= span_s[1])
    rows = {
        kind: _lanes(presence, np.flatnonzero(near & (presence.kind == kind)))
        for kind in KINDS
    }
    lanes = [(kind, lane) for kind, found in rows.items() for lane in found]
    if not lanes:
        return []

    def draw(ax: "Axes") -> None:
        _draw_bars(presence, lanes, float(np.ptp(span_s)), ax)

    return [PagePart(0.28 + 0.17 * len(lanes), draw)]


def _lanes(presence: Presence, stretches: IntArray) -> list[list[int]]:
    """Put stretches of one kind below each other where they overlap."""
    lanes: list[list[int]] = []
    for number in stretches[np.argsort(presence.from_s[stretches], kind="stable")]:
        free = [
            lane for lane in lanes if presence.to_s[lane[-1]] <= presence.from_s[number]
        ]
        if free:
            free[0].append(int(number))
        elif len(lanes) < MOST_LANES:
            lanes.append([int(number)])
        else:
            lanes[-1].append(int(number))
    return lanes


def _draw_bars(
    presence: Presence,
    lanes: Sequence[tuple[str, list[int]]],
    length_s: float,
    ax: "Axes",
) -> None:
    calm(ax)
    ax.grid(visible=False, axis="y")
    for number, (_, lane) in enumerate(lanes):
        for stretch in lane:
            _draw_bar(presence, stretch, len(lanes) - 1 - number, length_s, ax)
    first: dict[str, int] = {}
    for number, (kind, _) in enumerate(lanes):
        first.setdefault(kind, len(lanes) - 1 - number)
    ax.set_yticks(list(first.values()), list(first), fontsize=7)
    ax.set_ylim(-0.6, len(lanes) - 0.4)


def _draw_bar(
    presence: Presence, stretch: int, place: int, length_s: float, ax: "Axes"
) -> None:
    begin, end = float(presence.from_s[stretch]), float(presence.to_s[stretch])
    owner = int(presence.encounter[stretch]) or int(presence.contact[stretch])
    color, is_passage = contact_color(owner), bool(presence.encounter[stretch])
    ax.barh(
        place, max(end - begin, LEAST_SHARE * length_s), left=begin, height=0.66,
        color=color, edgecolor="white", linewidth=0.5,
        alpha=1.0 if is_passage else 0.6,
    )  # fmt: skip
    spacing = float(presence.spacing_hz[stretch])
    if np.isfinite(spacing) and end - begin > 0.1 * length_s:
        ax.annotate(
            f"{spacing:.2f} Hz", (0.5 * (begin + end), place), ha="center",
            va="center", fontsize=7, clip_on=True,
            color=text_on(color) if is_passage else "black",  # it is paler then
        )  # fmt: skip


def _rates(scene: Scene, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the modulation rates that were heard, over the envelope's spectrum."""
    presence, envelope = scene.presence, scene.envelope
    if presence is None or not presence.rate_hz.size:
        return []
    owner = presence.rate_stretch
    near = (presence.to_s[owner] >= span_s[0]) & (presence.from_s[owner] <= span_s[1])
    if not near.any():
        return []
    has_picture = envelope is not None and envelope is not scene.overview

    def draw(ax: "Axes") -> None:
        calm(ax)
        axis = FrequencyAxis(0.0, 1.25 * float(presence.rate_hz[near].max()), False)
        if has_picture and envelope is not None:
            draw_lofargram(envelope, axis, span_s, ax)
        else:
            axis.set_axis(ax)
        ax.set_ylabel("modulation\nrate (Hz)", fontsize=8)
        _draw_rates(presence, np.flatnonzero(near), axis, ax, is_over=has_picture)

    return [PagePart(RATES_IN if has_picture else 1.1, draw)]


def _draw_rates(
    presence: Presence,
    rows: IntArray,
    axis: FrequencyAxis,
    ax: "Axes",
    *,
    is_over: bool,
) -> None:
    """Draw rates as lines, or over a picture as the edges of lines, with their values.

    A value that would cover the one below is put beside it.
    """
    from matplotlib.transforms import ScaledTranslation

    figure = ax.get_figure(root=True)
    if figure is None:
        return
    low_s, high_s = ax.get_xlim() if is_over else (-np.inf, np.inf)
    rows = rows[np.argsort(presence.rate_hz[rows], kind="stable")]
    below, place = -np.inf, 0
    for row in rows:
        stretch, rate = int(presence.rate_stretch[row]), float(presence.rate_hz[row])
        contact = int(presence.encounter[stretch]) or int(presence.contact[stretch])
        ends = np.clip(
            [presence.from_s[stretch], presence.to_s[stretch]], low_s, high_s
        )
        color = "white" if is_over and not contact else contact_color(contact)
        for side in (-1.0, 1.0) if is_over else (0.0,):
            moved = ScaledTranslation(0, side * EDGE_PT / 72, figure.dpi_scale_trans)
            ax.plot(ends, (rate, rate), transform=ax.transData + moved, color=color,
                    lw=0.7 if is_over else 1.6, alpha=0.8 if is_over else 1.0)  # fmt: skip
        share = float(axis.share(np.array(rate)))
        place = (place + 1) % LABEL_PLACES if share - below < LABEL_SHARE else 0
        below = share
        ax.annotate(
            f"{rate:.2f}", (ends[0], rate), xytext=(3 + 30 * place, EDGE_PT + 1),
            textcoords="offset points", fontsize=7, color="white" if is_over else None,
        )  # fmt: skip


def _level(scene: Scene, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the broadband level: its middle, and what most frames lie within."""
    levels = scene.first(Levels)
    if levels is None:
        return []
    time_s = levels.frames.time_s
    inside = (
        (time_s >= span_s[0]) & (time_s <= span_s[1]) & np.isfinite(levels.level_db)
    )
    if inside.sum() < 2:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        middle, low, half, high = _quantiles(time_s[inside], levels.level_db[inside])
        ax.fill_between(middle, low, high, color=MEASURED, alpha=0.3, lw=0)
        ax.plot(middle, half, color=MEASURED, lw=0.8)
        ax.set_ylabel(
            f"level {levels.band_low_hz:.0f}-{levels.band_high_hz:.0f} Hz\n"
            f"(dB re {figure_text(levels.reference)})", fontsize=8,
        )  # fmt: skip

    return [PagePart(1.1, draw)]


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


def _bearing(scene: Scene, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the broadband bearings of a vector sensor, and those of its lines."""
    levels, lines = scene.first(Levels), scene.first(Lines)
    if levels is None or scene.first(BearingTime) is not None:
        return []
    time_s = levels.frames.time_s
    known = levels.bearing_std_deg < USABLE_BEARING_DEG
    known &= (time_s >= span_s[0]) & (time_s <= span_s[1])
    if not known.any():
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        rows = np.flatnonzero(known)
        rows = rows[:: -(-rows.size // (4 * MOST_POINTS))]
        ax.plot(time_s[rows], np.mod(levels.bearing_deg[rows], 360.0), ".", ms=2.0,
                color=MEASURED, alpha=0.5, mec="none", rasterized=True)  # fmt: skip
        if lines is not None:
            _draw_line_bearings(lines, ax)
        ax.set(ylim=(0, 360), yticks=range(0, 361, 90))
        ax.set_ylabel("bearing (deg)", fontsize=8)

    return [PagePart(1.1, draw)]


def _draw_line_bearings(lines: Lines, ax: "Axes") -> None:
    for name, contact in zip(lines.line_id, lines.line_contact, strict=True):
        if contact <= 0:
            continue
        rows = np.flatnonzero((lines.line == name) & np.isfinite(lines.bearing_deg))
        rows = rows[:: -(-rows.size // MOST_POINTS) or 1]
        ax.plot(lines.time_s[rows], np.mod(lines.bearing_deg[rows], 360.0), ".", ms=1.6,
                mec="none", color=contact_color(int(contact)), rasterized=True)  # fmt: skip


def _record(scene: Scene, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the bearing-time record of a line array, and where it pointed."""
    record = scene.first(BearingTime)
    if record is None or not record.frames.n_frames:
        return []
    lines, followed = scene.first(Lines), scene.first(Series)

    def draw(ax: "Axes") -> None:
        draw_bearing_time(record, ax, span_s)
        if followed is not None and record.cos_angle is not None:
            draw_contact_angles(record, followed, ax)
        if lines is not None:
            draw_line_angles(record, lines, ax)

    parts = [PagePart(3.6, draw)]
    if np.isfinite(record.heading_deg).any():
        parts.append(PagePart(1.0, lambda ax: draw_heading(record, ax)))
    return parts
