"""The graph of a recipe as a picture: steps from left to right, arrows between them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.page import check_picture, save_figure
from uwtrack_cli.plotting.view import DPI

_BOX_WIDTH, _BOX_HEIGHT = 1.5, 0.5
_COLUMN, _ROW = 2.5, 0.85


def draw_recipe_graph(
    edges: Sequence[tuple[str, str, str]],
    title: str,
    output: Path,
    *,
    overwrite: bool = False,
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
    check_picture(output, overwrite=overwrite)
    place = _places(edges)
    kept = {source for source, reader, _ in edges if reader == "product"}
    width = max(x for x, _ in place.values()) + _BOX_WIDTH + 0.4
    height = max(y for _, y in place.values()) + _BOX_HEIGHT + 1.2
    figure = Figure(figsize=(width, height))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(-0.2, width - 0.2), ylim=(height - 0.6, -0.6))
    ax.set_axis_off()
    ax.text(0.0, -0.3, figure_text(title), fontweight="bold", fontsize=11)
    ax.text(0.0, height - 0.75, "filled: kept in the product", fontsize=8)
    for source, reader, container in edges:
        if reader != "product":
            _draw_arrow(ax, place[source], place[reader], container)
    for name, corner in place.items():
        _draw_box(ax, name, corner, is_kept=name in kept)
    figure.set_label(title)
    with (
        atomic_target(output, overwrite=overwrite) as temporary,
        temporary.open("wb") as file,
    ):
        save_figure(figure, file, output.suffix[1:].lower(), DPI)


def _draw_arrow(
    ax: Any, source: tuple[float, float], reader: tuple[float, float], container: str
) -> None:
    start = (source[0] + _BOX_WIDTH, source[1] + _BOX_HEIGHT / 2)
    end = (reader[0], reader[1] + _BOX_HEIGHT / 2)
    ax.annotate(
        "", end, start,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 0.8,
                    "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    ax.text(
        *middle, figure_text(container), fontsize=7, ha="center", va="center",
        color="#333333", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
    )  # fmt: skip


def _draw_box(
    ax: Any, name: str, corner: tuple[float, float], *, is_kept: bool
) -> None:
    is_sound = name == "recording"
    ax.add_patch(
        FancyBboxPatch(
            corner, _BOX_WIDTH, _BOX_HEIGHT, boxstyle="round,pad=0,rounding_size=0.1",
            facecolor="#cfe3f2" if is_kept else "white",
            edgecolor="#777777" if is_sound else "black",
            linestyle="dashed" if is_sound else "solid", linewidth=1.0,
        )
    )  # fmt: skip
    ax.text(
        corner[0] + _BOX_WIDTH / 2, corner[1] + _BOX_HEIGHT / 2, figure_text(name), ha="center",
        va="center", fontsize=9,
    )  # fmt: skip


def _places(edges: Sequence[tuple[str, str, str]]) -> dict[str, tuple[float, float]]:
    """Return the upper left corner of each box: a column further than what it reads."""
    column: dict[str, int] = {"recording": 0}
    for source, reader, _ in edges:
        if reader != "product":
            column[reader] = max(column.get(reader, 0), column.get(source, 0) + 1)
    rows: dict[int, int] = {}
    place: dict[str, tuple[float, float]] = {}
    for name, at in column.items():
        row = rows.get(at, 0)
        rows[at] = row + 1
        place[name] = (at * _COLUMN, row * _ROW)
    return place
