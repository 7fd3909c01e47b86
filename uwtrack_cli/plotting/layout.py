"""Pages of panels below each other: a title, panels with one time axis."""

import re
from collections.abc import Callable, Sequence
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting import style
from uwtrack_cli.plotting.style import Clock, Span
from uwtrack_cli.plotting.view import View

TITLE_PT, LINE_PT, COLUMN_PT = 12.0, 9.0, 7.5
"""Size of the title, of the lines below it, and of both in the column of a paper."""

POINT_CHARACTERS, BOLD_CHARACTERS = 118.0, 102.0
"""Characters in an inch, times their size in points, and of those that are bold."""

WITHIN_VALUE = re.compile(r" (?=\u00b1)|(?<=\u00b1) |(?<=\d) (?=(?:kn|m|m/s|s|deg|Hz|UTC)\b)")
"""Spaces at which no line ends: within a value with its deviation and unit."""

LEAST_SHARE = 0.8
"""Share of its usual height that a panel needs on a page whose height is given."""


class PagePart(NamedTuple):
    """A panel, or a part of a page that holds several."""

    height: float
    """Height, inches."""
    draw: Callable[[Any], Any]
    """Draws it into axes, or into a part of a page."""


def alone(height: float, draw: Callable[[Axes], Any]) -> PagePart:
    """Return a part of a page that one panel fills, ``height`` inches high."""
    return PagePart(height, lambda part: draw(part.subplots()))


class HeadLine(NamedTuple):
    """A line above the panels; the first one is the title."""

    text: str
    """What it says."""
    warns: bool = False
    """Whether a reader must not overlook it."""
    number: int = 0
    """Passage whose badge stands before it; 0 for none."""
    size_pt: float = 0.0
    """Size of its letters, points; 0: as it fits the page."""


def warning(text: str) -> HeadLine:
    """Return a line that a reader must not overlook."""
    return HeadLine(f"\u26a0 {text}", warns=True)


def span_title(span_s: Span, clock: Clock, names: Sequence[str]) -> str:
    """Return the title of a span of recordings: begin and end, s, and their names."""
    length_s, is_utc = np.ptp(span_s), clock.start_utc_ns is not None
    step = 0.5 if length_s < 20 and not is_utc else 1.0 if length_s < 7200 else 60.0
    begin, end = (clock.text(time, step) for time in span_s)
    first, last = map(clock.day, span_s)
    span = f"{first} {begin} to {'' if first == last else f'{last} '}{end}".strip()
    span += " UTC" if is_utc else " s"
    return "   ".join([span, ", ".join(dict.fromkeys(names))]).strip()


def page_figure(
    heads: Sequence[HeadLine], view: View, blocks: Sequence[PagePart], widths: Sequence[float] = ()
) -> Figure:
    """Return a page: a title, and blocks below each other.

    ``widths``: where the blocks stand beside each other, in these ratios. A height of the
    page that the view has is kept, and leaves the blocks at least half.
    """
    heights = [block.height for block in blocks]
    body_in, head_in = max(heights) if widths else sum(heights), 0.0
    lines = _fitted(heads, view) if view.stands_alone else []
    if lines:
        head_in = sum(_step_in(line) for line in lines) + 0.12
        if view.height_in is not None:
            body_in = max(0.5 * view.height_in, view.height_in - head_in)
            head_in = view.height_in - body_in
    figure = style.new_figure(view.width_in, head_in + body_in)
    figure.set_label(". ".join(head.text for head in heads))
    *upper, body = _parts(figure, [head_in, body_in] if lines else [body_in])
    for part in upper:
        _write_heads(part, lines, view.width_in, head_in)
    parts = (
        body.subfigures(1, len(widths), squeeze=False, width_ratios=widths)[0]
        if widths
        else _parts(body, heights)
    )
    for block, part in zip(blocks, parts, strict=True):
        block.draw(part)
    return figure


def _parts(figure: Figure | SubFigure, heights: Sequence[float]) -> list[SubFigure]:
    """Return parts of a page below each other, with heights in given ratios."""
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)
    return list(parts[:, 0])


def _fitted(heads: Sequence[HeadLine], view: View) -> list[HeadLine]:
    """Return the lines of a title as they fit the page."""
    is_column = view.width_in < style.NARROW_IN
    sizes = (COLUMN_PT + 1.5, COLUMN_PT) if is_column else (TITLE_PT, LINE_PT)
    found = []
    for place, head in enumerate(heads):
        size = sizes[place > 0]
        is_bold = head.warns or not place
        room = view.width_in * (BOLD_CHARACTERS if is_bold else POINT_CHARACTERS)
        for text in wrap(WITHIN_VALUE.sub("\u00a0", head.text), int(room / size)):
            found.append(head._replace(text=text.replace("\u00a0", " "), size_pt=size))
            head = head._replace(number=0)  # noqa: PLW2901 - one badge
    return found


def _step_in(line: HeadLine) -> float:
    return line.size_pt * 1.45 / 72


def _write_heads(
    upper: SubFigure, lines: Sequence[HeadLine], width_in: float, height_in: float
) -> None:
    down_in = 0.06
    for head in lines:
        left, top = 0.12 / width_in, 1.0 - down_in / height_in
        is_title = head.size_pt == lines[0].size_pt
        if head.number:
            badge(upper, head.number, (left, top), va="top")
            left += 0.25 / width_in
        upper.text(
            left, top, figure_text(head.text), va="top", fontsize=head.size_pt,
            fontweight="bold" if is_title or head.warns else "normal",
            color=style.WARNING if head.warns else "black" if is_title else style.MEASURED,
        )  # fmt: skip
        down_in += _step_in(head)


def fitting(parts: Sequence[PagePart], view: View) -> list[PagePart]:
    """Return the first panels, as many as a page of a given height has room for."""
    if view.height_in is None:
        return list(parts)
    room = view.height_in - 1.1  # title and time axis
    needed = np.cumsum([LEAST_SHARE * part.height for part in parts])
    return list(parts[: max(1, int(np.searchsorted(needed, room, side="right")))])


def badge(owner: Any, number: int, place: tuple[float, float], **more: Any) -> None:
    """Write the number of a passage on its colour, at a place of a panel or page."""
    color = style.contact_color(number)
    box = {"boxstyle": "round,pad=0.2", "fc": color, "ec": "none"}
    owner.text(
        *place, str(number), fontsize=8, fontweight="bold", color=style.text_on(color),
        bbox=box, **more,
    )  # fmt: skip


def alternative_text(figure: Figure) -> str:
    """Say what a page shows, for who cannot see it: its title and its panels."""
    names = (ax.get_ylabel() or ax.get_xlabel() for ax in figure.axes
             if ax.get_label() != "<colorbar>")  # fmt: skip
    shown = dict.fromkeys(" ".join(name.split()) for name in names if name)
    return f"{figure.get_label()}. Panels: {', '.join(shown)}."


def timed(
    parts: Sequence[PagePart], view: View, clock: Clock, span_s: Span, ticks: int | None = None
) -> PagePart:
    """Return panels below each other with one time axis, named at the last one.

    ``span_s``: begin and end of the axis, s. ``ticks``: ticks that it has room for; None
    is as many as the view has.
    """

    def draw(figure: SubFigure) -> None:
        heights = [part.height for part in parts]
        grid = figure.subplots(len(parts), 1, height_ratios=heights, squeeze=False)
        for part, panel in zip(parts, grid[:, 0], strict=True):
            clock.set_axis(panel, span_s, ticks or view.ticks)
            part.draw(panel)
            panel.set_xlim(*span_s)
            panel.tick_params(labelbottom=part is parts[-1])
        panel.set_xlabel(clock.label(span_s), fontsize=9)

    return PagePart(sum(part.height for part in parts) + 0.5, draw)
