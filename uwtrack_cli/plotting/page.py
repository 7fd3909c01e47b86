"""Pages of what products hold: which there are, and how they become files.

**Method.** A recording has a page, and every passage and every contact of target
motion has one of its own. A PDF holds all of them, PNG and SVG the one that is asked
for: of a contact if it is named, else the first, which is that of the recording.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.spectra import Levels, Overview
from uwtrack_cli.data.targets import Target
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.atomic import atomic_target, check_target
from uwtrack_cli.files.hdf5.layout import sensor_of
from uwtrack_cli.plotting.passage_page import passage_figure
from uwtrack_cli.plotting.recording_page import recording_figure
from uwtrack_cli.plotting.table_pages import decision_figure, target_figure
from uwtrack_cli.plotting.target_motion_page import target_motion_figure
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".pdf", ".svg")

DPI = 110
"""Dots per inch of a page that is stored as dots."""

HEARD = (Overview, BearingTime, Levels, Lines, Presence, Fixes)
"""Containers that the page of a recording shows by themselves."""


class Page(NamedTuple):
    """A page that can be drawn."""

    kind: str
    """'recording', 'passage', 'motion', 'target', 'decision' or 'sound'."""
    sensor: str | None
    """Sensor; None where it does not matter."""
    contact: int | None
    """Contact; None for all."""
    draw: Callable[[View], "Figure"]
    """Draws it."""


def scenes_of(
    containers: Sequence[Container],
    tracks: Sequence[VesselTrack] = (),
) -> list[Scene]:
    """Return what belongs to each sensor; everything, where there are no sensors.

    ``containers``: containers of one recording, or of several sensors. ``tracks``: ways
    of vessels by AIS, where there is one sensor.
    """
    heard = {
        sensor_of(c)
        for c in containers
        if isinstance(c, HEARD) or c.NAME == "recording"
    }
    sensors = sorted(name for name in heard if name is not None)
    if not sensors:
        return [Scene(containers, None, tracks)]
    return [Scene(containers, name, tracks) for name in sensors]


def pages_of(
    containers: Sequence[Container], tracks: Sequence[VesselTrack] = ()
) -> list[Page]:
    """Return the pages that containers have, that of the whole first.

    ``containers``: containers of one recording or table. ``tracks``: ways of vessels by
    AIS: s from the first sample, east and north of the sensor.

    Raises
    ------
    DataError
        There is nothing to draw.
    """
    scenes = scenes_of(containers, tracks)
    whole = Scene(containers)
    pages = []
    if any(isinstance(c, Target) for c in containers):
        pages.append(Page("target", None, None, lambda _: target_figure(containers)))
    if any(isinstance(c, Decision) for c in containers):
        pages.append(
            Page("decision", None, None, lambda _: decision_figure(containers))
        )
    recording = Page("recording", None, None, partial(recording_figure, scenes))
    motions = whole.first(Motions)
    is_array = any(isinstance(c, BearingTime) for c in containers)
    is_heard = any(isinstance(c, HEARD) for c in containers)
    if is_heard and (is_array or motions is None):
        pages.append(recording)
    if motions is not None:
        pages += _motion_pages(whole, motions, is_array=is_array)
    pages += [page for scene in scenes for page in _passage_pages(scene)]
    if not pages:
        held = ", ".join(sorted({c.NAME for c in containers})) or "nothing"
        msg = f"there is nothing to draw; the files hold {held}."
        raise DataError(msg)
    return pages


def _motion_pages(whole: Scene, motions: Motions, *, is_array: bool) -> list[Page]:
    contacts = [int(c) for c in np.unique(motions.contact)]
    every = Page("motion", None, None, partial(target_motion_figure, whole, None))
    if not contacts:
        return [every]
    own = [
        Page("motion", None, c, partial(target_motion_figure, whole, c))
        for c in contacts
    ]
    return own if is_array or len(own) == 1 else [every, *own]


def _passage_pages(scene: Scene) -> list[Page]:
    encounters = scene.encounters
    if encounters is None:
        return []
    return [
        Page(
            "passage", str(encounters.sensor[row]), int(encounters.contact[row]),
            partial(passage_figure, scene, row),
        )
        for row in range(encounters.n_encounters)
    ]  # fmt: skip


def choose_pages(
    pages: Sequence[Page], contact: int | None, sensor: str | None
) -> list[Page]:
    """Return the pages of a contact and sensor; without them, every one.

    Raises
    ------
    DataError
        There is no such page; those that there are are named.
    """
    found = list(pages)
    if contact is not None:
        found = [page for page in found if page.contact == contact]
        if not found:
            known = sorted({p.contact for p in pages if p.contact is not None})
            names = ", ".join(map(str, known)) or "none"
            msg = f"contact {contact} has no page; contacts with one: {names}."
            raise DataError(msg)
    if sensor is not None:
        of_sensor = [page for page in found if page.sensor == sensor]
        if not of_sensor:
            known_sensors = sorted({p.sensor for p in found if p.sensor is not None})
            msg = (
                f"sensor {sensor!r} has no such page; sensors with one: "
                f"{', '.join(known_sensors) or 'none'}."
            )
            raise DataError(msg)
        found = of_sensor
    return found


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
        msg = f"a picture is written as {names}, got {output.name!r}."
        raise OptionError(msg)
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
    shown = pages if form == "pdf" else pages[:1]
    figures = [page.draw(view) for page in shown]
    with (
        atomic_target(output, overwrite=overwrite) as temporary,
        temporary.open("wb") as file,
    ):
        if form != "pdf":
            figures[0].savefig(file, format=form, dpi=view.dpi or DPI)
            return
        from matplotlib.backends.backend_pdf import PdfPages

        with PdfPages(file) as document:
            for figure in figures:
                document.savefig(figure, dpi=view.dpi or 2 * DPI)
