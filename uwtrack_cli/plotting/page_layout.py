"""Pages of panels below each other: a title, panels with one time axis."""

from collections.abc import Callable, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.style import (
    MEASURED,
    NARROW_IN,
    WARNING,
    Clock,
    contact_color,
    new_figure,
    text_on,
)
from uwtrack_cli.plotting.view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

TITLE_PT, LINE_PT, COLUMN_PT = 12.0, 9.0, 7.5
"""Size of the title, of the lines below it, and of both in the column of a paper."""

POINT_CHARACTERS = 118.0
"""Characters in an inch, times their size in points."""

LEAST_SHARE = 0.8
"""Share of its usual height that a panel needs on a page whose height is given."""

Panel = Callable[["Axes"], Any]


class PagePart(NamedTuple):
    """A panel of a page."""

    height: float
    """Height, inches."""
    draw: Panel
    """Draws it."""


class HeadLine(NamedTuple):
    """A line above the panels; the first one is the title."""

    text: str
    """What it says."""
    warns: bool = False
    """Whether a reader must not overlook it."""
    number: int = 0
    """Passage whose badge stands before it; 0 for none."""


def span_title(span_s: tuple[float, float], clock: Clock, names: Sequence[str]) -> str:
    """Return the title of a span of recordings: begin and end, s, and their names."""
    length_s = np.ptp(span_s)
    step = 1.0 if length_s < 7200 else 60.0
    if clock.start_utc_ns is None and length_s < 20:
        step = 0.5
    begin, end = clock.text(span_s[0], step), clock.text(span_s[1], step)
    last = clock.day(span_s[1])
    end = end if last == clock.day(span_s[0]) else f"{last} {end}"
    span = f"{clock.day(span_s[0])} {begin} to {end}".strip()
    unit = "UTC" if clock.start_utc_ns is not None else "s"
    return "   ".join([f"{span} {unit}", ", ".join(dict.fromkeys(names))]).strip()


def titled_figure(
    heads: Sequence[HeadLine], view: View, body_in: float
) -> tuple["Figure", "SubFigure"]:
    """Return a page with its title, and the part of it below the title.

    ``body_in``: height of the part below the title, inches, unless the view has a height
    of the page, which leaves it at least half.
    """
    if not view.stands_alone:
        figure = new_figure(view.width_in, body_in)
        figure.set_label(". ".join(head.text for head in heads))
        return figure, stacked(figure, body_in)[0]
    is_column = view.width_in < NARROW_IN
    title_pt, line_pt = (
        (COLUMN_PT + 1.5, COLUMN_PT) if is_column else (TITLE_PT, LINE_PT)
    )
    lines = [
        (head._replace(text=text, number=0 if part else head.number), place == 0, size)
        for place, head in enumerate(heads)
        for size in [line_pt if place else title_pt]
        for part, text in enumerate(
            wrap(head.text, int(view.width_in * POINT_CHARACTERS / size))
        )
    ]
    sizes = [size for _, _, size in lines]
    steps = [size * 1.45 / 72 for size in sizes]
    head_in = sum(steps) + 0.12
    if view.height_in is not None:
        body_in = max(0.5 * view.height_in, view.height_in - head_in)
        head_in = view.height_in - body_in
    figure = new_figure(view.width_in, head_in + body_in)
    upper, body = stacked(figure, head_in, body_in)
    down = 0.06
    for (head, is_title, size), step in zip(lines, steps, strict=True):
        left, top = 0.12 / view.width_in, 1.0 - down / head_in
        if head.number:
            badge(upper, head.number, (left, top), va="top")
        upper.text(
            left + (0.25 / view.width_in if head.number else 0.0), top,
            figure_text(head.text), va="top", fontsize=size,
            fontweight="bold" if is_title or head.warns else "normal",
            color=WARNING if head.warns else "black" if is_title else MEASURED,
        )  # fmt: skip
        down += step
    figure.set_label(". ".join(head.text for head in heads))
    return figure, body


def fitting(parts: Sequence[PagePart], view: View) -> list[PagePart]:
    """Return the first panels, as many as a page of a given height has room for."""
    if view.height_in is None:
        return list(parts)
    room = view.height_in - 1.1  # title and time axis
    needed = np.cumsum([LEAST_SHARE * part.height for part in parts])
    return list(parts[: max(1, int(np.searchsorted(needed, room, side="right")))])


def badge(owner: Any, number: int, place: tuple[float, float], **more: Any) -> None:
    """Write the number of a passage on its colour, at a place of a panel or page."""
    color = contact_color(number)
    box = {"boxstyle": "round,pad=0.2", "fc": color, "ec": "none"}
    owner.text(
        *place, str(number), fontsize=8, fontweight="bold", color=text_on(color), bbox=box,
        **more,
    )  # fmt: skip


def alternative_text(figure: "Figure") -> str:
    """Say what a page shows, for who cannot see it: its title and its panels."""
    names = (ax.get_ylabel() or ax.get_xlabel() for ax in figure.axes
             if ax.get_label() != "<colorbar>")  # fmt: skip
    shown = dict.fromkeys(" ".join(name.split()) for name in names if name)
    return f"{figure.get_label()}. Panels: {', '.join(shown)}."


def stacked(figure: "Figure | SubFigure", *heights: float) -> "list[SubFigure]":
    """Return parts of a page below each other, with heights in these ratios."""
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    return list(np.ravel(parts))


def side_by_side(figure: "Figure | SubFigure", *widths: float) -> "list[SubFigure]":
    """Return parts of a page beside each other, with widths in these ratios."""
    parts = figure.subfigures(1, len(widths), width_ratios=widths, squeeze=False)
    return list(np.ravel(parts))


def draw_parts(
    parts: Sequence[PagePart], figure: "SubFigure", clock: Clock,
    span_s: tuple[float, float], ticks: int,
) -> "list[Axes]":  # fmt: skip
    """Draw panels below each other with one time axis, named at the last one.

    ``span_s``: begin and end of the axis, s. ``ticks``: ticks that it has room for.
    """
    if not parts:
        return []
    heights = [part.height for part in parts]
    grid = figure.subplots(len(parts), 1, height_ratios=heights, squeeze=False)
    panels = list(grid[:, 0])
    for panel, part in zip(panels, parts, strict=True):
        clock.set_axis(panel, span_s, ticks)
        part.draw(panel)
        panel.set_xlim(*span_s)
        panel.tick_params(labelbottom=panel is panels[-1])
    panels[-1].set_xlabel(clock.label(span_s), fontsize=9)
    return panels
