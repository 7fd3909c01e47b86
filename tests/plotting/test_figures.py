"""Every picture of README and documents says what it shows, and is what is drawn."""

import functools
import re
import shlex
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from typer.testing import CliRunner

from tests.draws import fringe_picture
from uwtrack_cli.cli.app import app
from uwtrack_cli.plotting.style import draw_cells

ROOT = Path(__file__).parent.parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PICTURE = re.compile(r"!\[([^\]]*)\]\(([^)\s]+\.(?:png|svg))\)")

BROWSER = {"site.png"}
"""Pictures that a browser makes, which `make figures` does where there is one."""


def pictures():
    return [
        (page.name, text, (page.parent / place).resolve())
        for page in PAGES
        for text, place in PICTURE.findall(page.read_text())
        if "://" not in place
    ]


def recipe():
    """The commands of `make figures`, with the recipes' pictures written out."""
    rule = re.search(r"^figures:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    text = rule[1].replace("\\\n", " ")
    loop = re.search(r"for name in ([^;]+); do (.*?)done", text)
    lines = [loop[2].replace("$$name", name) for name in loop[1].split()]
    lines += text.replace(loop[0], "").splitlines()
    return [shlex.split(line.replace("--overwrite;", "--overwrite")) for line in lines]


def test_every_picture_says_what_it_shows_and_is_drawn_by_the_makefile():
    made = {word for line in recipe() for word in line if word.startswith("docs/")}
    assert pictures()
    for page, text, path in pictures():
        assert path.exists(), (page, path)
        assert len(text.split()) >= 4, f"{page}: {path.name} needs an alternative text"
        name = path.relative_to(ROOT).as_posix()
        assert name in made or path.name in BROWSER, f"make figures draws no {name}"


@pytest.mark.long
def test_the_pictures_are_what_is_drawn_today(tmp_path):
    """No more than one dot in a hundred differs visibly."""
    places = (("$(DEMO)", str(tmp_path)), ("$(CURDIR)", str(ROOT)))
    for line in recipe():
        words = [functools.reduce(lambda w, p: w.replace(*p), places, w) for w in line]
        if words[:2] == ["ln", "-sf"]:
            Path(words[3]).symlink_to(words[2])
        if "tests.draws.fringe_picture" in words:
            fringe_picture.main(str(tmp_path / words[-1]))
        if words[:1] != ["$(BIN)/uwtrack"]:
            continue
        moved = [str(tmp_path / w) if w.startswith("docs/") else w for w in words[1:]]
        moved = [str(ROOT / w) if w.startswith("sample_data/") else w for w in moved]
        for place in [Path(w).parent for w in moved if str(tmp_path) in w]:
            place.mkdir(parents=True, exist_ok=True)
        done = CliRunner().invoke(app, moved)
        assert done.exit_code == 0, done.output
    drawn = sorted((tmp_path / "docs").rglob("*.*"))
    assert drawn
    for path in drawn:
        kept = ROOT / path.relative_to(tmp_path)
        if path.suffix == ".svg":
            assert path.read_text() == kept.read_text(), path.name
            continue
        new, old = (matplotlib.image.imread(p)[..., :3] for p in (path, kept))
        assert new.shape == old.shape, path.name
        assert np.mean(np.abs(new - old).max(axis=-1) > 0.1) < 0.01, path.name


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_a_cell_is_painted_where_its_frequency_lies(scale):
    """A bright row of 63 Hz, of even rows on the axis and of uneven ones."""
    figure = Figure(figsize=(4.0, 4.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    for number, bend in enumerate((1.0, 1.3)):
        ax = figure.add_subplot(1, 2, number + 1)
        ax.set(yscale=scale, ylim=(10.0, 1000.0), xlim=(0.0, 1.0))
        space = np.geomspace if scale == "log" else np.linspace
        edges = space(10.0, 1000.0**bend, 201) ** np.linspace(1.0, 1.0 / bend, 201)
        level = np.zeros((3, 200))
        row = int(np.searchsorted(edges, 63.0)) - 1
        level[:, row] = 1.0
        draw_cells(ax, np.linspace(0.0, 1.0, 4), edges, level, (0.0, 1.0), cmap="gray")
        ax.set_axis_off()
        canvas.draw()
        dots = np.asarray(canvas.buffer_rgba())[::-1, :, 0]
        at = ax.transData.transform([(0.5, edges[row]), (0.5, edges[row + 1])])
        bright = np.flatnonzero(dots[:, int(at[0, 0])] == 255)
        inside = bright[(bright > ax.bbox.y0 + 1) & (bright < ax.bbox.y1 - 1)]
        assert inside.size
        assert np.abs(inside - at[:, 1].mean()).max() <= 0.5 * np.ptp(at[:, 1]) + 1.5
