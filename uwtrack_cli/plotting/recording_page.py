"""The page of a recording or a day: what was heard, over one time axis.

**Method.** The whole band lies over its noise floor on a logarithmic axis, and below it
the part where the lines are, enlarged; tracked lines are drawn as outlines, an edge on
either side, so that what was heard stays visible between them. Passages are marked at
their arrival with the number that they have in the table, in the colour that they have
everywhere, and said in words above. Of a line array the bearing-time record takes the
place of the lofargram.

**Conventions.** A panel is drawn if it has something to say.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.arrays.line_array import LineArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.tables.presence_words import presence_sentences
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting import bearing_time, layout, panels, passage, style
from uwtrack_cli.plotting.analysis_pages import draw_motion_map, measured_from, motion_states
from uwtrack_cli.plotting.layout import HeadLine, PagePart
from uwtrack_cli.plotting.maps import draw_sensor_map, has_sensor_map
from uwtrack_cli.plotting.passage import ReportedPassage
from uwtrack_cli.plotting.view import Scene, View

MAP_IN = 4.6
"""Height of the map of several sensors, inches."""

NO_PASSAGE = "no closest approach; "
"""What is said before each segment where nothing passes, and once on a page."""

MOST_NAMED = 8
"""Passages that are said in words above the panels."""


def recording_figure(scenes: Sequence[Scene], view: View) -> Figure:
    """Return the page of a recording, or of several sensors that heard the same.

    Raises
    ------
    DataError
        There is nothing to draw.
    """
    ends, parts, shared = [s.times_s for s in scenes if s.times_s], [], (0.0, 1.0)
    if ends:
        begins, stops = zip(*ends, strict=True)
        shared = view.span_s((min(begins), max(stops)), scenes[0].clock)
    scenes = [scene.shown(view, shared) for scene in scenes]
    if ends:
        parts = [part for s in scenes for part in _parts(s, len(scenes))]
    below = None
    if view.is_wide or view.height_in is None or not parts:
        below = _below(scenes, 0.9 * view.width_in / (MAP_IN - 0.5))
    if not parts and below is None:
        held = ", ".join(sorted({c.NAME for s in scenes for c in s.containers}))
        raise DataError(f"there is nothing to draw; the files hold {held or 'nothing'}.")
    over = layout.timed(layout.fitting(parts, view), view, scenes[0].clock, shared)
    blocks = ([over] if parts else []) + ([PagePart(MAP_IN, below)] if below else [])
    return layout.page_figure(_heads(scenes), view, blocks)


def _below(scenes: Sequence[Scene], ratio: float) -> Callable[[SubFigure], object] | None:
    """Return what is drawn below the panels over time: a map, or peaks of an array."""
    first = scenes[0]
    motions, record = first.first(Motions), first.first(BearingTime)
    if motions is not None and motions.contact.size:
        origin = measured_from(first)
        return lambda part: draw_motion_map(motions, origin, part.subplots(), ratio)
    if has_sensor_map(scenes):
        return lambda part: draw_sensor_map(scenes, part.subplots(), ratio)
    peaks, sensor = first.first(Peaks), first.first(Sensor)
    if record is None or peaks is None or not peaks.frame.size:
        return None

    def draw(part: SubFigure) -> None:
        is_line = sensor is not None and record.cos_angle is not None
        widths = [4.0, 1.0] if is_line else [1.0]
        grid = part.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
        bearing_time.draw_frequency_azimuth(record, peaks, grid[0], first.span_s)
        if sensor is not None and is_line:
            array = LineArray(sensor.element_places_m, sensor.sound_speed_mps)
            bearing_time.draw_beam_pattern(record, array, grid[1])

    return draw


def _heads(scenes: Sequence[Scene]) -> list[HeadLine]:
    """Return the title: what was recorded when; what came of it; and every passage."""
    first, view = scenes[0], scenes[0].view
    names = [s.recording.name for s in scenes if s.recording is not None]
    found = [HeadLine(layout.span_title(first.span_s, first.clock, names))]
    sensors = ", ".join(scene.sensor for scene in scenes if scene.sensor)
    facts = [f"sensor {sensors}"] if sensors else []
    passages = [fit for scene in scenes for fit in _passages(scene)]
    facts += _counts(first, len(passages))
    lines = [line.number for s in scenes if s.first(BearingTime) is None
             for line in panels.outlined_lines(s)]  # fmt: skip
    if lines:
        more = ", white ones of no passage" if 0 in lines else ""
        facts.append(f"edges: lines{more}")
    if first.first(BearingTime) is None and (reason := panels.why_coarse(first)):
        facts.append(figure_text(reason))
    if facts:
        found.append(HeadLine(" \u00b7 ".join(facts)))
    motions = first.first(Motions)
    if motions is not None:
        found += [HeadLine(text) for text in motion_states(motions, view.units)]
    for fit in passages[:MOST_NAMED]:
        where = f"   {fit.printed['sensor']}" if len(scenes) > 1 else ""
        title = f"{passage.passage_title(fit.printed, view.units)}{where}"
        found.append(HeadLine(title, number=fit.number))
        found += map(layout.warning, passage.cautions(fit.printed))
    more = f"and {len(passages) - MOST_NAMED} more, as in the table"
    return found + [HeadLine(more)] * (len(passages) > MOST_NAMED)


def _passages(scene: Scene) -> list[ReportedPassage]:
    """Return the passages within a span, and those whose time is not known."""
    return [fit for fit in passage.passages_of(scene)
            if not (fit.marked_s < scene.span_s[0] or fit.marked_s > scene.span_s[1])]  # fmt: skip


def _counts(scene: Scene, n: int) -> list[str]:
    """Say how many passages a span holds, and what else was heard in it."""
    presence, facts = scene.presence, []
    if scene.encounters is not None and (n or presence is None):
        facts.append(f"{n or 'no'} passage{'' if n == 1 else 's'}")
    if presence is not None:
        heard = json_rows(presence.take("segment", scene.segments))
        for text in presence_sentences(heard, is_passed=n > 0):
            facts.append(text.removeprefix(NO_PASSAGE) if facts else text)
    return facts


def _parts(scene: Scene, count: int) -> list[PagePart]:
    """Return the panels of one sensor; of several sensors, only the first ones."""
    first = _record(scene) or panels.lofargram_parts(scene)
    fits = _passages(scene)
    parts = (first if count == 1 else first[:1]) + panels.presence_part(scene)
    if count == 1:
        parts += panels.comb_part(scene) + panels.fringe_part(scene, fits)
        parts += panels.rates_part(scene) + panels.level_part(scene)
        if scene.first(BearingTime) is None:
            parts += panels.bearing_part(scene)
    name = scene.sensor if count > 1 else None
    return [
        part._replace(draw=partial(_draw_marked, part, fits, name, place == 0))
        for place, part in enumerate(parts)
    ]


def _draw_marked(
    part: PagePart, fits: Sequence[ReportedPassage], name: str | None, is_first: bool, ax: Axes
) -> None:
    """Draw a panel with the passages marked, the first one with numbers and name."""
    part.draw(ax)
    for fit in (fit for fit in fits if np.isfinite(fit.marked_s)):
        ax.axvline(fit.marked_s, 0.94 if is_first else 0.0, lw=0.9,
                   color=style.contact_color(fit.number),
                   ls=style.contact_dash(fit.number))  # fmt: skip
        if is_first:
            layout.badge(ax, fit.number, (fit.marked_s, 1.03), ha="center", va="bottom",
                  transform=ax.get_xaxis_transform())  # fmt: skip
    if is_first and name:
        ax.text(
            0.01, 0.95, figure_text(name), transform=ax.transAxes, va="top",
            fontsize=9, bbox={"fc": "white", "ec": "none", "alpha": 0.8},
        )  # fmt: skip


def _record(scene: Scene) -> list[PagePart]:
    """Return the bearing-time record of a line array, and where it pointed."""
    record = scene.first(BearingTime)
    if record is None or not record.frames.n_frames:
        return []

    def draw(ax: Axes) -> None:
        bearing_time.draw_bearing_time(record, ax, scene.span_s)
        bearing_time.draw_contact_angles(record, scene, ax)

    parts = [PagePart(3.6, draw)]
    known = record.heading_deg[np.isfinite(record.heading_deg)]
    if known.size and not (bearing_time.is_true(record) and np.ptp(known) < 1.0):
        parts.append(PagePart(1.0, partial(bearing_time.draw_heading, record)))
    return parts
