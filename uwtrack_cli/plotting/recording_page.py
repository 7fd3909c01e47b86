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
from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.arrays.line_array import LineArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
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
    is_true,
)
from uwtrack_cli.plotting.maps import draw_sensor_map, has_sensor_map
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    Panel,
    badge,
    draw_parts,
    fitting,
    span_title,
    stacked,
    titled_figure,
)
from uwtrack_cli.plotting.panels import (
    bearing_part,
    comb_part,
    fringe_part,
    level_part,
    lofargram_parts,
    outlined_lines,
    presence_part,
    rates_part,
)
from uwtrack_cli.plotting.passage_fit import ReportedPassage
from uwtrack_cli.plotting.passage_words import cautions, passage_title
from uwtrack_cli.plotting.style import contact_color, contact_dash
from uwtrack_cli.plotting.target_motion_page import (
    draw_motion_map,
    measured_from,
    motion_states,
)
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MAP_IN = 4.6
"""Height of the map of several sensors, inches."""

NO_PASSAGE = "no closest approach; "
"""What is said before each stretch where nothing passes, and once on a page."""

MOST_NAMED = 8
"""Passages that are said in words above the panels."""


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
        shared = view.span_s(shared, scenes[0].clock)
        parts = [_parts(scene, view, shared, len(scenes)) for scene in scenes]
    below = _below(scenes, shared, 0.9 * view.width_in / (MAP_IN - 0.5))
    if not any(parts) and below is None:
        held = ", ".join(sorted({c.NAME for s in scenes for c in s.containers}))
        msg = f"there is nothing to draw; the files hold {held or 'nothing'}."
        raise DataError(msg)
    every = fitting([part for own in parts for part in own], view)
    height = sum(part.height for part in every) + (0.5 if every else 0.0)
    map_in = 0.0 if below is None else MAP_IN
    figure, body = titled_figure(_heads(scenes, view, shared), view, height + map_in)
    upper, lower = body, body
    if every and below is not None:
        upper, lower = stacked(body, height, map_in)
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


def _heads(
    scenes: Sequence[Scene], view: View, span_s: tuple[float, float]
) -> list[HeadLine]:
    """Return the title: what was recorded when; what came of it; and every passage."""
    clock = scenes[0].clock
    names = [r.name for s in scenes if (r := s.first(Recording)) is not None]
    found = [HeadLine(span_title(span_s, clock, names))]
    sensors = [s for s in (scene.sensor for scene in scenes) if s]
    facts = [f"sensor {', '.join(sensors)}"] if sensors else []
    passages = [(fit, row) for scene in scenes for fit, row in _passages(scene, span_s)]
    facts += _counts(scenes[0], span_s, len(passages))
    lines = [line.number for s in scenes if s.first(BearingTime) is None
             for line in outlined_lines(s, view, span_s)]  # fmt: skip
    if lines:
        facts.append(
            "edges: lines" + (", white ones of no passage" if 0 in lines else "")
        )
    if facts:
        found.append(HeadLine(" \u00b7 ".join(facts)))
    motions = scenes[0].first(Motions)
    if motions is not None:
        found += [HeadLine(text) for text in motion_states(motions, view.units)]
    for fit, row in passages[:MOST_NAMED]:
        where = f"   {row['sensor']}" if len(scenes) > 1 else ""
        found.append(
            HeadLine(f"{passage_title(row, view.units)}{where}", number=fit.number)
        )
        found += [HeadLine(f"\u26a0 {text}", warns=True) for text in cautions(row)]
    if len(passages) > MOST_NAMED:
        found.append(
            HeadLine(f"and {len(passages) - MOST_NAMED} more, as in the table")
        )
    return found


def _passages(
    scene: Scene, span_s: tuple[float, float]
) -> list[tuple[ReportedPassage, dict[str, object]]]:
    """Return the passages within a span, with their rows as they are printed."""
    encounters = scene.encounters
    if encounters is None:
        return []
    fits = [ReportedPassage(encounters, k) for k in range(encounters.n_encounters)]
    every = zip(fits, json_rows(encounters), strict=True)
    return [(fit, row) for fit, row in every
            if not (fit.marked_s < span_s[0] or fit.marked_s > span_s[1])]  # fmt: skip


def _counts(scene: Scene, span_s: tuple[float, float], n: int) -> list[str]:
    """Say how many passages a span holds, and what else was heard in it."""
    presence = scene.presence
    facts = []
    if scene.encounters is not None and (n or presence is None):
        facts.append(f"{n or 'no'} passage{'' if n == 1 else 's'}")
    if presence is not None:
        near = (presence.to_s >= span_s[0]) & (presence.from_s <= span_s[1])
        heard = json_rows(presence.take("stretch", np.flatnonzero(near)))
        for text in presence_sentences(heard, is_passed=n > 0):
            facts.append(text.removeprefix(NO_PASSAGE) if facts else text)
    return facts


def _parts(
    scene: Scene, view: View, span_s: tuple[float, float], count: int
) -> list[PagePart]:
    """Return the panels of one sensor; of several sensors, only the first ones."""
    first = _record(scene, span_s) or lofargram_parts(scene, view, span_s)
    parts = [*(first if count == 1 else first[:1]), *presence_part(scene, span_s)]
    if count == 1:
        parts += [
            *comb_part(scene, span_s),
            *fringe_part(scene, span_s, [fit for fit, _ in _passages(scene, span_s)]),
            *rates_part(scene, span_s),
            *level_part(scene, span_s),
        ]
        if scene.first(BearingTime) is None:
            parts += bearing_part(scene, span_s)
    fits = [fit for fit, _ in _passages(scene, span_s)]
    return [
        PagePart(part.height, _marked(part.draw, fits, scene.sensor, place, count))
        for place, part in enumerate(parts)
    ]


def _marked(
    draw: Panel,
    fits: Sequence[ReportedPassage],
    sensor: str | None,
    place: int,
    count: int,
) -> Panel:
    """Return a panel with the passages marked, the first one with their numbers."""
    height = 0.06 if place == 0 else 1.0

    def marked(ax: "Axes") -> None:
        draw(ax)
        for fit in fits:
            if np.isfinite(fit.marked_s):
                ax.axvline(fit.marked_s, 1.0 - height, color=contact_color(fit.number),
                           lw=0.9, linestyle=contact_dash(fit.number))  # fmt: skip
                if place == 0:
                    badge(ax, fit.number, (fit.marked_s, 1.03), ha="center", va="bottom",
                          transform=ax.get_xaxis_transform())  # fmt: skip
        if place == 0 and count > 1 and sensor:
            ax.text(
                0.01, 0.95, figure_text(sensor), transform=ax.transAxes, va="top",
                fontsize=9, bbox={"fc": "white", "ec": "none", "alpha": 0.8},
            )  # fmt: skip

    return marked


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
            draw_line_angles(record, lines, scene, ax)

    parts = [PagePart(3.6, draw)]
    known = record.heading_deg[np.isfinite(record.heading_deg)]
    if known.size and not (is_true(record) and np.ptp(known) < 1.0):
        parts.append(PagePart(1.0, lambda ax: draw_heading(record, ax)))
    return parts
