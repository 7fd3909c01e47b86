"""The graph of a recipe as a picture: steps from left to right, arrows between them."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.page import Page, write_pages
from uwtrack_cli.plotting.view import View

_BOX_WIDTH, _BOX_HEIGHT = 1.5, 0.5
_COLUMN, _ROW = 2.5, 0.85


def draw_recipe_graph(
    edges: Sequence[tuple[str, str, str]], title: str, output: Path, *, overwrite: bool = False
) -> None:
    """Draw which step of a recipe reads which.

    ``edges``: source, reader and the container that passes, in the order of the graph.

    Raises
    ------
    OptionError
        The file name asks for another kind of picture.
    OutputError
        The picture exists, is an input, or cannot be written.
    """
    place = _places(edges)
    kept = {source for source, reader, _ in edges if reader == "product"}
    width = max(x for x, _ in place.values()) + _BOX_WIDTH + 0.4
    height = max(y for _, y in place.values()) + _BOX_HEIGHT + 1.2
    figure = Figure(figsize=(width, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(-0.2, width - 0.2), ylim=(height - 0.6, -0.6))
    ax.set_axis_off()
    ax.text(0.0, -0.3, figure_text(title), fontweight="bold", fontsize=11)
    ax.text(0.0, height - 0.75, "filled: kept in the result file", fontsize=8)
    arrow = {"arrowstyle": "-|>", "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
    for source, reader, container in edges:
        if reader == "product":
            continue
        middle = _BOX_HEIGHT / 2
        start = place[source][0] + _BOX_WIDTH, place[source][1] + middle
        end = place[reader][0], place[reader][1] + middle
        ax.annotate("", end, start, arrowprops={"color": "black", **arrow})
        ax.text(
            (start[0] + end[0]) / 2, (start[1] + end[1]) / 2, figure_text(container),
            fontsize=7, ha="center", va="center", color="#333333",
            bbox={"fc": "white", "ec": "none", "pad": 0.8},
        )  # fmt: skip
    for name, (x, y) in place.items():
        is_sound = name == "recording"
        ax.add_patch(FancyBboxPatch(
            (x, y), _BOX_WIDTH, _BOX_HEIGHT, boxstyle="round,pad=0,rounding_size=0.1",
            facecolor="#cfe3f2" if name in kept else "white", linewidth=1.0,
            edgecolor="#777777" if is_sound else "black",
            linestyle="dashed" if is_sound else "solid",
        ))  # fmt: skip
        ax.text(x + _BOX_WIDTH / 2, y + _BOX_HEIGHT / 2, figure_text(name), fontsize=9,
                ha="center", va="center")  # fmt: skip
    figure.set_label(title)
    page = Page("recipe", lambda _: figure)
    write_pages([page], output, View(), overwrite=overwrite)


def _places(edges: Sequence[tuple[str, str, str]]) -> dict[str, tuple[float, float]]:
    """Return the upper left corner of each box: a column further than what it reads."""
    column: dict[str, int] = {"recording": 0}
    for source, reader, _ in edges:
        if reader != "product":
            column[reader] = max(column.get(reader, 0), column.get(source, 0) + 1)
    columns = list(column.values())
    return {
        name: (at * _COLUMN, columns[:number].count(at) * _ROW)
        for number, (name, at) in enumerate(column.items())
    }
