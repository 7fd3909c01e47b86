"""`plot` and `report`: what was found, for people."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uwtrack_cli.cli.command_factory import Ais, Branch, Overwrite, WithinM
from uwtrack_cli.cli.console import progress_bar, say
from uwtrack_cli.cli.recording_arguments import (
    SOURCE_PARAMETERS,
    open_source,
    with_parameters,
)
from uwtrack_cli.cli.targets import PIPE, Inputs, open_product, product_name
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError

if TYPE_CHECKING:
    from uwtrack_cli.files.hdf5.product import Product
    from uwtrack_cli.flow.deployment import Deployment
    from uwtrack_cli.plotting.page import Page
    from uwtrack_cli.plotting.view import View

DRAWN = frozenset({"overview", "levels", "lines", "encounters", "fixes", "presence",
                   "bearing_time", "motions", "target", "decision"})  # fmt: skip
"""Containers of which a page shows one."""

WITHIN_M = 2000.0
"""Range within which AIS vessels are expected unless told, m."""

Begin = Annotated[
    str | None,
    typer.Option("--from", help="Begin: UTC, time of day, or s from the first sample."),
]
End = Annotated[str | None, typer.Option("--to", help="End, likewise.")]
Band = Annotated[
    tuple[float, float] | None,
    typer.Option("--band-hz", help="Lowest and highest frequency. (Hz)"),
]
IsLog = Annotated[
    bool | None,
    typer.Option(
        "--log/--linear",
        help="Frequency axis; logarithmic by itself where most lines are low, or the "
        "band of a recording spans more than a factor of 20.",
    ),
]
HasLines = Annotated[
    bool, typer.Option("--lines/--no-lines", help="Whether tracked lines are outlined.")
]
HAS_NO_USE = {"sensor", "sensor_sound_speed_mps", "own_ship"}
SOUND_PARAMETERS = [p for p in SOURCE_PARAMETERS if p.name not in HAS_NO_USE]
"""How a recording is opened: what its picture depends on, beside the sensor file."""

OF_SOUND = {
    "window_s",
    "db_range",
    "colormap",
    "size",
    *(p.name for p in SOUND_PARAMETERS),
}
"""Options that have a meaning for recordings alone."""

OF_PRODUCTS = {"contact", "has_lines", "ais", "within_m", "step"}
"""Options that have a meaning for products alone."""

Picture = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        help="Picture: PNG, SVG, or PDF with all pages; else named after the file.",
    ),
]


@with_parameters(SOUND_PARAMETERS)
def plot(  # noqa: PLR0913 (one parameter for each option)
    *,
    context: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Products of one recording, in any order; or one recording: WAV, RF64, "
            "W64, FLAC or AIFF."
        ),
    ],
    output: Picture = None,
    contact: Annotated[
        int | None,
        typer.Option("--contact", help="Draw the page of this contact's passage."),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            "--sensor",
            help="Sensor, where several heard it; of a recording, its sensor file.",
        ),
    ] = None,
    begin: Begin = None,
    end: End = None,
    band_hz: Band = None,
    is_log: IsLog = None,
    has_lines: HasLines = True,
    ais: Ais = None,
    within_m: WithinM = WITHIN_M,
    step: Branch = None,
    window_s: Annotated[
        float | None,
        typer.Option(
            help="Of a recording: length of the analysis window; else by its length. (s)"
        ),
    ] = None,
    db_range: Annotated[
        float | None,
        typer.Option(
            help="Of a recording: levels below the brightest that are told apart. (dB)"
        ),
    ] = None,
    colormap: Annotated[
        str | None,
        typer.Option(
            help="Of a recording: colours by matplotlib's name; else viridis."
        ),
    ] = None,
    size: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Of a recording: width and height of the page. (inches)"),
    ] = None,
    dpi: Annotated[
        float | None, typer.Option(help="Dots per inch; else 110, in a PDF 220.")
    ] = None,
    overwrite: Overwrite = False,
    **source: Any,
) -> None:
    """Draw a recording on a page, or with --contact one passage on a page of its own.

    A passage's page, and a part of a day, show the sound finely resolved if the recording
    still lies beside the product, else what the product carries of it.

    Of a sound file, draw its spectrogram at once: density in dB re 1 uPa^2/Hz where its
    sensor file calibrates it, else re full scale.
    """
    try:
        from uwtrack_cli.plotting.page import check_picture, write_pages
        from uwtrack_cli.plotting.sound_page import sized
        from uwtrack_cli.plotting.view import View
    except ImportError as error:
        msg = f"plots need matplotlib ({error}); pip install 'uwtrack[plot]'."
        raise DataError(msg) from error
    is_sound = _is_sound(files)
    _refuse_foreign(context, files[0], is_sound=is_sound)
    target = _picture_name(output, files, contact)
    check_picture(target, overwrite=overwrite)
    view = sized(
        View(
            begin=begin, end=end, band_hz=_checked_band(band_hz), is_log=is_log,
            has_lines=has_lines,
        ),
        size, dpi,
    )  # fmt: skip
    is_document = target.suffix.lower() == ".pdf"
    if is_sound:
        style = {"window_s": window_s, "db_range": db_range, "colormap": colormap}
        opening = {**source, "sensor": None if sensor is None else Path(sensor)}
        _write_sound(files[0], target, view, opening, style, overwrite=overwrite)
        return
    needs_sound = contact is not None or is_document or view.is_zoomed
    containers, tracks = _read(files, step, ais, within_m, needs_sound=needs_sound)
    pages = _chosen(containers, tracks, contact, sensor, is_document=is_document)
    write_pages(pages, target, view, overwrite=overwrite)
    say(f"wrote {target}")
    if contact is None and not is_document:
        _tell_others(pages)


def _is_sound(files: Sequence[Path]) -> bool:
    """Tell whether a recording is drawn.

    Raises
    ------
    OptionError
        There are other files beside it.
    """
    from uwtrack_cli.files.audio.opening import SUFFIXES

    sounds = [path for path in files if path.suffix.lower() in SUFFIXES]
    if sounds and len(files) > 1:
        msg = (
            f"{sounds[0]} is a recording, which is drawn by itself: plot one at a time."
        )
        raise OptionError(msg)
    return bool(sounds)


def _refuse_foreign(context: typer.Context, file: Path, *, is_sound: bool) -> None:
    """Refuse options that have no meaning for what is drawn."""
    foreign = OF_PRODUCTS if is_sound else OF_SOUND
    for param in context.command.params:
        source = context.get_parameter_source(str(param.name))
        if param.name in foreign and source is not None and source.name != "DEFAULT":
            flag = "/".join([*param.opts, *param.secondary_opts])
            why = (
                f"belongs to a product, and {file} is a recording: draw the file that "
                f"'uwtrack run' makes of it"
                if is_sound
                else f"belongs to a recording, and {file} is a product: give the sound file"
            )
            msg = f"{flag} {why}, or leave it out."
            raise OptionError(msg)


def _write_sound(
    file: Path, target: Path, view: "View", opening: Mapping[str, Any],
    style: Mapping[str, Any], *, overwrite: bool,
) -> None:  # fmt: skip
    """Write the spectrogram of a sound file, opened as the options say."""
    from uwtrack_cli.plotting.page import Page, write_pages
    from uwtrack_cli.plotting.sound_page import checked_style, sound_figure

    checked = checked_style(**style)
    recording = open_source(file, opening)
    with progress_bar("plot", recording.duration_s) as done:
        page = Page(
            "sound", None, None,
            lambda asked: sound_figure(recording, checked, asked, done),
        )  # fmt: skip
        write_pages([page], target, view, overwrite=overwrite)
    say(f"wrote {target}")


def _chosen(
    containers: Sequence[Container], tracks: Sequence[VesselTrack],
    contact: int | None, sensor: str | None, *, is_document: bool,
) -> "list[Page]":  # fmt: skip
    """Return the pages of products that are asked for."""
    from uwtrack_cli.plotting.page import choose_pages, pages_of

    pages = choose_pages(pages_of(containers, tracks), contact, sensor)
    if contact is not None and sensor is None and not is_document:
        _refuse_several(pages)
    return pages


def _refuse_several(pages: "Sequence[Page]") -> None:
    sensors = sorted({page.sensor for page in pages if page.sensor is not None})
    if len(sensors) > 1:
        msg = (
            f"contact {pages[0].contact} was heard by {', '.join(sensors)}: name one with "
            f"--sensor, or write all their pages with -o NAME.pdf."
        )
        raise OptionError(msg)


def _tell_others(pages: "Sequence[Page]") -> None:
    """Say which pages there are beside the one that was written."""
    contacts = dict.fromkeys(
        str(page.contact) for page in pages[1:] if page.contact is not None
    )
    if contacts:
        say(f"a page each with --contact: {', '.join(contacts)}; all with -o NAME.pdf")


def _picture_name(
    output: Path | None, files: Sequence[Path], contact: int | None
) -> Path:
    if output == PIPE or (output is None and files[0] == PIPE):
        msg = "a picture is written to a file of its own: name it with -o FILE."
        raise OptionError(msg)
    if output is not None:
        return output
    return product_name(
        files[0], ".png" if contact is None else f".contact-{contact}.png"
    )


def _checked_band(band_hz: tuple[float, float] | None) -> tuple[float, float] | None:
    if band_hz is not None and not 0 <= band_hz[0] < band_hz[1] < float("inf"):
        msg = (
            f"--band-hz takes a lower and a higher frequency in Hz, got "
            f"{band_hz[0]:g} {band_hz[1]:g}."
        )
        raise OptionError(msg)
    return band_hz


def _read(
    files: Sequence[Path],
    step: str | None,
    ais: Path | None,
    within_m: float,
    *,
    needs_sound: bool,
) -> tuple[list[Container], list[VesselTrack]]:
    """Read what the pages show, with the sound where it is at hand, and AIS."""
    from uwtrack_cli.files.hdf5.layout import CONTAINERS
    from uwtrack_cli.flow.branches import refuse_unknown_step

    with ExitStack() as stack:
        inputs = Inputs(stack, step)
        drawn = tuple(CONTAINERS[name] for name in sorted(DRAWN))
        owners: dict[str, Path] = {}
        for file in files:
            before = [held.container for held in inputs.held]
            inputs.add(file, drawn)
            containers = [held.container for held in inputs.held]
            _refuse_second(file, before, containers[len(before) :], owners)
        refuse_unknown_step(inputs.products, step)
        found = [held.container for held in inputs.held]
        return with_more(found, inputs.products, ais, within_m, needs_sound=needs_sound)


def with_more(
    containers: Sequence[Container],
    products: "Sequence[Product]",
    ais: Path | None,
    within_m: float,
    *,
    needs_sound: bool,
) -> tuple[list[Container], list[VesselTrack]]:
    """Add own ship's way, peaks of an array, envelopes, sound, and what AIS knows."""
    from uwtrack_cli.flow.rerun_sources import with_sound
    from uwtrack_cli.flow.vessel_names import read_vessels, tracks_past

    navigation = [n for product in products for n in product.read_all(Navigation)]
    found: list[Container] = [
        with_sound(c, products) if needs_sound and isinstance(c, Recording) else c
        for c in containers
    ]
    if any(isinstance(c, BearingTime) for c in found):  # beams show where peaks lie
        found += [peaks for product in products for peaks in product.read_all(Peaks)]
    pictures = [one for product in products for one in product.read_all(Overview)]
    found += [  # of the envelope, beside that of the sound
        one
        for one in pictures
        if one.reference == MODULATION and not any(one.equals(c) for c in containers)
    ]
    if ais is None:
        return [*found, *navigation], []
    vessels = read_vessels(ais, within_m)
    sensors = [c for c in found if isinstance(c, Sensor)]
    recordings = [c for c in found if isinstance(c, Recording)]
    named = [
        vessels.name(c, sensors, recordings) if isinstance(c, Encounters) else c
        for c in found
    ]
    if len(sensors) != 1:
        return [*named, *navigation], []
    tracks = tracks_past(vessels, sensors[0], recordings[0] if recordings else None)
    return [*named, *navigation], tracks


def _refuse_second(
    file: Path,
    before: Sequence[Container],
    added: Sequence[Container],
    owners: dict[str, Path],
) -> None:
    """Refuse a file that repeats, with other content, what an earlier one holds."""
    for container in added:
        name = container.NAME
        known = owners.setdefault(name, file)
        same = any(container.equals(other) for other in before)
        if known != file and name in DRAWN and not same:
            msg = (
                f"{known} and {file} both hold {name}, and a page shows one recording: "
                f"plot them one by one."
            )
            raise DataError(msg)


def report(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="{file}",
            help="Product, or folder of products; - is standard input.",
        ),
    ],
    step: Branch = None,
    ais: Ais = None,
    within_m: WithinM = WITHIN_M,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="HTML file; else named after the product."),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a page about a recording, or about a folder: results, pictures, history.

    Everything is in one file: a card for every passage, with its page. Of a folder, the
    deployment at a glance: when there was sound, when vessels were heard and passed.
    """
    from uwtrack_cli.files.atomic import check_target, write_text

    try:
        from uwtrack_cli.plotting import deployment_report
        from uwtrack_cli.plotting import report as product_report
    except ImportError as error:
        msg = f"reports need matplotlib ({error}); pip install 'uwtrack[plot]'."
        raise DataError(msg) from error
    target = _report_name(output, source)
    is_folder = source.is_dir()
    inputs = () if is_folder or source == PIPE else (source,)
    check_target(target, overwrite=overwrite, inputs=inputs)
    if is_folder:
        if step is not None:
            msg = "--step chooses within one product, and a folder holds many."
            raise OptionError(msg)
        text = _of_folder(source, ais, within_m, deployment_report.deployment_html)
    else:
        with open_product(source) as product:
            containers, tracks = _reported(product, step, ais, within_m)
            made = product_report.Report(containers, tracks)
            text = product_report.report_html(product, made)
    write_text(target, text, overwrite=overwrite, inputs=inputs)
    say(f"wrote {target}")


def _report_name(output: Path | None, source: Path) -> Path:
    if output == PIPE or (output is None and source == PIPE):
        msg = "this is written to a file of its own: name it with -o FILE."
        raise OptionError(msg)
    if output is not None:
        return output
    return source / "report.html" if source.is_dir() else product_name(source, ".html")


def _of_folder(
    folder: Path,
    ais: Path | None,
    within_m: float,
    write: "Callable[[Deployment, str], str]",
) -> str:
    """Return the report of a folder."""
    from uwtrack_cli.flow.deployment import read_deployment
    from uwtrack_cli.flow.passages import collect_passages, usual_cache

    table = collect_passages([folder], ais=ais, within_m=within_m, cache=usual_cache())
    return write(read_deployment([folder], table), folder.resolve().name)


def _reported(
    product: "Product", step: str | None, ais: Path | None, within_m: float
) -> tuple[list[Container], list[VesselTrack]]:
    """Read what a report shows of a product."""
    from uwtrack_cli.flow.branches import refuse_unknown_step, sole_keys
    from uwtrack_cli.flow.products import small_containers

    refuse_unknown_step([product], step)
    keys = sole_keys(product, step, DRAWN)
    found = [held.container for held in small_containers(product, step, keys)]
    passed = any(isinstance(c, Encounters) and c.n_encounters for c in found)
    return with_more(found, [product], ais, within_m, needs_sound=passed)
