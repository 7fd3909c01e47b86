"""Pages of what products hold: which there are, and how they become files.

**Method.** A recording has a page, and every passage and every contact of target
motion has one of its own. A PDF holds all of them, PNG and SVG the one that is asked
for: of a passage or contact if it is named, else the first, that of the recording.

**Conventions.** The same page is the same file, to the byte: no time of making is
written into it. Every picture says in words what it shows (its title and description).
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.atomic import atomic_target, check_target
from uwtrack_cli.files.hdf5.layout import sensor_of
from uwtrack_cli.plotting.analysis_pages import decision_figure, target_figure, target_motion_figure
from uwtrack_cli.plotting.layout import alternative_text
from uwtrack_cli.plotting.passage_page import passage_figure
from uwtrack_cli.plotting.recording_page import recording_figure
from uwtrack_cli.plotting.sound_pages import demon_figure
from uwtrack_cli.plotting.view import DPI, Scene, View

SUFFIXES = (".png", ".pdf", ".svg")

HEARD = {"overview", "bearing_time", "levels", "lines", "presence", "fixes"}
"""Names of containers that the page of a recording shows by themselves."""


class Page(NamedTuple):
    """A page that can be drawn."""

    kind: str
    """'recording', 'passage', 'motion', 'target', 'decision', 'demon' or 'sound'."""
    draw: Callable[[View], Figure]
    """Draws it."""
    sensor: str | None = None
    """Sensor; None where it does not matter."""
    contact: int | None = None
    """Contact; None for all."""
    number: int | None = None
    """Number of the passage, by time from 1; None if it is of none."""


def scenes_of(containers: Sequence[Container], tracks: Sequence[VesselTrack] = ()) -> list[Scene]:
    """Return what belongs to each sensor; everything, where there are no sensors.

    ``containers``: containers of one recording, or of several sensors. ``tracks``: tracks
    of vessels by AIS, where there is one sensor.
    """
    heard = {sensor_of(c) for c in containers if c.NAME in {*HEARD, "recording"}}
    sensors: list[str | None] = [*sorted(name for name in heard if name is not None)]
    return [Scene(containers, name, tracks) for name in sensors or [None]]


def pages_of(
    containers: Sequence[Container], tracks: Sequence[VesselTrack] = (), *, is_demon: bool = False
) -> list[Page]:
    """Return the pages that containers have, that of the whole first.

    ``containers``: containers of one recording or table. ``tracks``: tracks of vessels by
    AIS: s from the first sample, east and north of the sensor. ``is_demon``: whether the
    spectra of the envelope are asked for, one for each sensor, and nothing else.

    Raises
    ------
    DataError
        There is nothing to draw.
    """
    scenes, whole = scenes_of(containers, tracks), Scene(containers)
    if is_demon:
        return [Page("demon", partial(demon_figure, s), s.sensor) for s in scenes]
    held, pages = {c.NAME for c in containers}, []
    for kind, draw in (("target", target_figure), ("decision", decision_figure)):
        if kind in held:
            pages.append(Page(kind, partial(draw, whole)))
    motions, is_array = whole.first(Motions), "bearing_time" in held
    if held & HEARD and (is_array or motions is None):
        pages.append(Page("recording", partial(recording_figure, scenes)))
    if motions is not None:
        contacts: list[int | None] = [*np.unique(motions.contact).tolist()]
        if not is_array and len(contacts) != 1:
            contacts.insert(0, None)  # all of them
        pages += [Page("motion", partial(target_motion_figure, whole, c), None, c)
                  for c in contacts]  # fmt: skip
    pages += [
        Page("passage", partial(passage_figure, scene, row), str(found.sensor[row]),
             int(found.contact[row]), row + 1)
        for scene in scenes if (found := scene.encounters) is not None
        for row in range(found.n_encounters)
    ]  # fmt: skip
    if not pages:
        names = ", ".join(sorted(held)) or "nothing"
        raise DataError(f"there is nothing to draw; the files hold {names}.")
    return pages


def choose_pages(
    pages: Sequence[Page], contact: int | None, sensor: str | None, passage: int | None = None
) -> list[Page]:
    """Return the pages of a contact, passage and sensor; without them, every one.

    Raises
    ------
    DataError
        There is no such page; those that there are are named.
    """
    found = list(pages)
    wanted = (("contact", "contact", contact), ("passage", "number", passage),
              ("sensor", "sensor", sensor))  # fmt: skip
    for name, key, value in wanted:
        known = dict.fromkeys(getattr(p, key) for p in found)
        if value is not None and value not in known:
            names = ", ".join(map(str, sorted(k for k in known if k is not None)))
            msg = f"{name} {value} has no page; {name}s with one: {names or 'none'}."
            if key == "contact":
                msg += " Contacts that pass are numbered by time: --passage."
            raise DataError(msg)
        found = [page for page in found if value in (None, getattr(page, key))]
    return found


def draw_page(
    containers: Sequence[Container],
    output: Path | str | None = None,
    *,
    passage: int | None = None,
    sensor: str | None = None,
    is_demon: bool = False,
    overwrite: bool = False,
    **how: Any,
) -> Figure:
    """Draw one page of containers, and write it where it has a name.

    ``how``: fields of a `View`.

    Raises
    ------
    DataError
        There is no such page.
    OptionError
        There is no such option, or it is not accepted.
    OutputError
        The picture exists, or cannot be written.
    """
    names = [one.name for one in fields(View)]
    if unknown := set(how) - set(names):
        raise OptionError(f"a plot has no option {min(unknown)!r}; it has {', '.join(names)}.")
    view, every = View(**how), pages_of(containers, is_demon=is_demon)
    page = choose_pages(every, None, sensor, passage)[0]
    figure = page.draw(view)
    if output is not None:
        made = page._replace(draw=lambda _: figure)
        write_pages([made], Path(output), view, overwrite=overwrite)
    return figure


def check_picture(output: Path, *, overwrite: bool) -> None:
    """Refuse a picture that cannot be written, before anything is drawn.

    Raises
    ------
    OptionError
        The file name asks for another kind of picture.
    OutputError
        The file exists, is an input, or cannot be written.
    """
    if output.suffix.lower() not in SUFFIXES:
        names = ", ".join(SUFFIXES)
        raise OptionError(f"a picture is written as {names}, got {output.name!r}.")
    check_target(output, overwrite=overwrite)


def write_pages(
    pages: Sequence[Page], output: Path, view: View, *, overwrite: bool = False
) -> None:
    """Write pages into one file.

    ``pages``: what is drawn: of a PNG or SVG, the first of them. ``output``: picture to
    write: PNG, PDF or SVG.

    Raises
    ------
    OptionError
        The file name asks for another kind of picture, or the view for what is not.
    """
    check_picture(output, overwrite=overwrite)
    form = output.suffix[1:].lower()
    figures = [page.draw(view) for page in (pages if form == "pdf" else pages[:1])]
    with atomic_target(output, overwrite=overwrite) as temporary, temporary.open("wb") as file:
        if form != "pdf":
            save_figure(figures[0], file, form, view.dpi or DPI)
            return
        from matplotlib.backends.backend_pdf import PdfPages

        told: Any = {"CreationDate": None, "Title": figures[0].get_label()}
        with PdfPages(file, metadata=told) as document:
            for figure in figures:
                _lay_out(figure, view.dpi or 2 * DPI)
                document.savefig(figure, dpi=view.dpi or 2 * DPI)


def save_figure(figure: Figure, file: IO[bytes], form: str, dpi: float) -> None:
    """Write a page as PNG or SVG, with what it shows in words, and without a date."""
    import matplotlib as mpl

    _lay_out(figure, dpi)
    told = {"Title": figure.get_label(), "Description": alternative_text(figure)}
    more: Any = {"Date": None} if form == "svg" else {}
    with mpl.rc_context({"svg.hashsalt": "uwtrack", "svg.fonttype": "none"}):
        figure.savefig(file, format=form, dpi=dpi, metadata={**told, **more})


def _lay_out(figure: Figure, dpi: float) -> None:
    """Give the panels their places, which the solver leaves open in the last digits."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    figure.set_dpi(dpi)
    engine.execute(figure)
    figure.set_layout_engine(None)  # one that is left would have all drawn twice
    for part in figure.findobj(SubFigure):
        part.bbox_relative.set_points(np.round(part.bbox_relative.get_points(), 6))
    for ax in figure.axes:
        ax.set_position(np.round(ax.get_position(original=True).bounds, 6).tolist())


def png_of(figure: Figure, dpi: float = DPI) -> bytes:
    """Return a page as PNG."""
    picture = io.BytesIO()
    save_figure(figure, picture, "png", dpi)
    return picture.getvalue()
