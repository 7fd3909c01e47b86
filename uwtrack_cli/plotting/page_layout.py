"""Pages of panels below each other: a title, panels with one time axis."""

from collections.abc import Callable, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.style import MEASURED, WARNING, Clock, new_figure
from uwtrack_cli.plotting.view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

TITLE_PT, LINE_PT = 12.0, 9.0
"""Size of the title and of the lines below it."""

TITLE_CHARACTERS, LINE_CHARACTERS = 9.5, 14.0
"""Characters of either in an inch."""

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


def span_title(span_s: tuple[float, float], clock: Clock, names: Sequence[str]) -> str:
    """Return the title of a span of recordings: begin and end, s, and their names."""
    step = 1.0 if np.ptp(span_s) < 7200 else 60.0
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
        return figure, stacked(figure, body_in)[0]
    lines = [
        (text, number == 0, head.warns)
        for number, head in enumerate(heads)
        for text in wrap(
            head.text,
            int(view.width_in * (TITLE_CHARACTERS if number == 0 else LINE_CHARACTERS)),
            drop_whitespace=True,
        )
    ]
    steps = [
        (TITLE_PT if is_title else LINE_PT) * 1.45 / 72 for _, is_title, _ in lines
    ]
    head_in = sum(steps) + 0.12
    if view.height_in is not None:
        body_in = max(0.5 * view.height_in, view.height_in - head_in)
        head_in = view.height_in - body_in
    figure = new_figure(view.width_in, head_in + body_in)
    upper, body = stacked(figure, head_in, body_in)
    down = 0.06
    for (text, is_title, warns), step in zip(lines, steps, strict=True):
        upper.text(
            0.12 / view.width_in, 1.0 - down / head_in, figure_text(text), va="top",
            fontsize=TITLE_PT if is_title else LINE_PT,
            fontweight="bold" if is_title or warns else "normal",
            color=WARNING if warns else "black" if is_title else MEASURED,
        )  # fmt: skip
        down += step
    return figure, body


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
