"""`plot` and `report`: what was found, for people."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from uwtrack_cli.cli.command_factory import Ais, Branch, Output, Overwrite, WithinM, with_parameters
from uwtrack_cli.cli.console import progress_bar, say
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS, open_source
from uwtrack_cli.cli.targets import PIPE, Inputs, named_target, open_product
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError, needing

if TYPE_CHECKING:
    from uwtrack_cli.files.hdf5.product import Product
    from uwtrack_cli.plotting.page import Page
    from uwtrack_cli.plotting.view import View

DRAWN = frozenset({"overview", "levels", "lines", "encounters", "fixes", "presence",
                   "bearing_time", "motions", "target", "decision"})  # fmt: skip
"""Containers of which a page shows one."""

WITHIN_M = 2000.0
"""Range within which AIS vessels are expected unless told, m."""

UnitsOption = Annotated[Literal["kn", "mps"], typer.Option("--units", help="Unit of every speed.")]
HAS_NO_USE = {"sensor", "sensor_sound_speed_mps", "own_ship"}
SOUND_PARAMETERS = [p for p in SOURCE_PARAMETERS if p.name not in HAS_NO_USE]
"""How a recording is opened: what its picture depends on, beside the sensor file."""

OF_SOUND = {"window_s", "db_range", "colormap", *(p.name for p in SOUND_PARAMETERS)}
"""Options that have a meaning for recordings alone."""

OF_PRODUCTS = {"contact", "passage", "is_demon", "has_lines", "units", "ais", "within_m", "step"}
"""Options that have a meaning for products alone."""


@with_parameters(SOUND_PARAMETERS)
def plot(  # noqa: PLR0913 (one parameter for each option)
    files: list[Path],
    *,
    context: typer.Context,
    output: Output = None,
    contact: int | None = None,
    passage: int | None = None,
    is_demon: Annotated[bool, typer.Option("--demon")] = False,
    sensor: str | None = None,
    begin: Annotated[str | None, typer.Option("--from")] = None,
    end: Annotated[str | None, typer.Option("--to")] = None,
    band_hz: Annotated[tuple[float, float] | None, Unit("Hz"), AtLeast(0), Increasing()] = None,
    is_log: Annotated[bool | None, typer.Option("--log/--linear")] = None,
    has_lines: Annotated[bool | None, typer.Option("--lines/--no-lines")] = None,
    units: UnitsOption = "kn",
    ais: Ais = None,
    within_m: WithinM = WITHIN_M,
    step: Branch = None,
    window_s: float | None = None,
    db_range: float | None = None,
    colormap: str | None = None,
    size: tuple[float, float] | None = None,
    has_title: Annotated[bool, typer.Option("--title/--no-title")] = True,
    dpi: float | None = None,
    overwrite: Overwrite = False,
    **source: Any,
) -> None:
    """Draw a recording, or with --passage one passage.

    Passages and parts of a recording are drawn from the sound itself if the recording
    is still beside the result file, and otherwise from what the result file holds of
    it.

    For a recording, the spectrogram is drawn at once, as density in dB re 1 uPa^2/Hz if
    its sensor file has a calibration, else re full scale.

    Parameters
    ----------
    files
        Result files of one recording, or the recording itself: WAV, RF64, W64, FLAC
        or AIFF.
    output
        PNG, SVG, or PDF with all pages; by default a PNG named after the file.
    contact
        Draw this contact.
    passage
        Draw this passage, by its number in the table.
    is_demon
        Draw the averaged spectrum of the envelope.
    sensor
        Sensor, if there are several; for a recording, its sensor file.
    begin
        Begin: UTC, time of day, or seconds from the first sample.
    end
        End, in the same form.
    band_hz
        Lowest and highest frequency.
    is_log
        Frequency axis; by default logarithmic if most lines are low, or if the band
        spans more than a factor of 20.
    has_lines
        Outline all tracked lines, or none; by default those that last.
    window_s
        For a recording: length of the analysis window; by default by its length.
        (s)
    db_range
        For a recording: range of levels that the colours show. (dB)
    colormap
        For a recording: name of a colour map of matplotlib; by default viridis.
    size
        Width and height of the page. (inches)
    has_title
        Draw the title, or leave it to a caption.
    dpi
        Dots per inch; by default 110, in a PDF 220.
    """
    with needing("plots need matplotlib", "plot"):
        from uwtrack_cli.plotting.page import check_picture, choose_pages, pages_of, write_pages
        from uwtrack_cli.plotting.style import WIDE_IN
        from uwtrack_cli.plotting.view import View
    is_sound = _is_sound(files)
    _refuse_foreign(context, files[0], is_sound=is_sound)
    refuse_without_ais(context, ais)
    target = _picture_name(output, files, contact, passage, is_demon=is_demon)
    check_picture(target, overwrite=overwrite)
    width_in, height_in = size or (WIDE_IN, None)
    view = View(
        begin=begin, end=end, band_hz=band_hz, is_log=is_log,
        has_lines=has_lines, units="kn" if units == "kn" else "m/s",
        stands_alone=has_title, width_in=width_in, height_in=height_in, dpi=dpi,
    )  # fmt: skip
    if is_sound:
        style = {"window_s": window_s, "db_range": db_range, "colormap": colormap}
        opening = {**source, "sensor": None if sensor is None else Path(sensor)}
        _write_sound(files[0], target, view, opening, style, overwrite=overwrite)
        return
    is_document = target.suffix.lower() == ".pdf"
    is_one = is_demon or not contact is passage is None
    needs_sound = is_one or is_document or view.is_zoomed
    containers, tracks = _read(files, step, ais, within_m, needs_sound=needs_sound)
    pages = choose_pages(pages_of(containers, tracks, is_demon=is_demon), contact, sensor, passage)
    if sensor is None and not is_document:
        _refuse_several(pages if is_one else pages[:1])
    write_pages(pages, target, view, overwrite=overwrite)
    say(f"wrote {target}")
    if not is_one and not is_document:
        _tell_others(pages)


def refuse_without_ais(context: typer.Context, ais: Path | None) -> None:
    """Refuse --within-m where there is no table that it would apply to."""
    given = context.get_parameter_source("within_m")
    if ais is None and given is not None and given.name != "DEFAULT":
        raise OptionError("--within-m is the range of vessels of an AIS table: give it with --ais.")


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
        raise OptionError(
            f"{sounds[0]} is a recording, which is drawn by itself: plot one at a time."
        )
    return bool(sounds)


def _refuse_foreign(context: typer.Context, file: Path, *, is_sound: bool) -> None:
    """Refuse options that have no meaning for what is drawn."""
    foreign = OF_PRODUCTS if is_sound else OF_SOUND
    for param in context.command.params:
        source = context.get_parameter_source(str(param.name))
        if param.name in foreign and source is not None and source.name != "DEFAULT":
            flag = "/".join([*param.opts, *param.secondary_opts])
            why = (
                f"belongs to a result file, and {file} is a recording: draw the file "
                f"that 'uwtrack run' makes of it"
                if is_sound
                else f"belongs to a recording, and {file} is a result file: give the sound file"
            )
            raise OptionError(f"{flag} {why}, or leave it out.")


def _write_sound(
    file: Path, target: Path, view: "View", opening: Mapping[str, Any],
    style: Mapping[str, Any], *, overwrite: bool,
) -> None:  # fmt: skip
    """Write the spectrogram of a sound file, opened as the options say."""
    from uwtrack_cli.plotting.page import Page, write_pages
    from uwtrack_cli.plotting.sound_pages import sound_figure

    recording = open_source(file, opening)
    with progress_bar("plot", recording.duration_s) as done:
        page = Page("sound", lambda view: sound_figure(recording, view, done, **style))
        write_pages([page], target, view, overwrite=overwrite)
    say(f"wrote {target}")


def _refuse_several(pages: "Sequence[Page]") -> None:
    sensors = sorted({page.sensor for page in pages if page.sensor is not None})
    if len(sensors) > 1:
        raise OptionError(
            f"the page that is asked for is one of {', '.join(sensors)} each: name one "
            f"with --sensor, or write all their pages with -o NAME.pdf."
        )


def _tell_others(pages: "Sequence[Page]") -> None:
    """Say which pages there are beside the one that was written."""
    for flag, key in (("--passage", "number"), ("--contact", "contact")):
        own = [page for page in pages[1:] if flag == "--passage" or page.number is None]
        found = dict.fromkeys(getattr(page, key) for page in own)
        names = ", ".join(str(name) for name in found if name is not None)
        if names:
            say(f"a page each with {flag}: {names}; all with -o NAME.pdf")


def _picture_name(
    output: Path | None, files: Sequence[Path], contact: int | None,
    passage: int | None, *, is_demon: bool,
) -> Path:  # fmt: skip
    if is_demon and not contact is passage is None:
        raise OptionError("--demon is a page of the recording: leave --passage and --contact out.")
    words = [".demon"] if is_demon else []
    words += [f".{name}-{number}" for name, number in
              (("contact", contact), ("passage", passage)) if number is not None]  # fmt: skip
    return named_target(output, files[0], f"{''.join(words)}.png")


def _read(
    files: Sequence[Path], step: str | None, ais: Path | None, within_m: float, *, needs_sound: bool
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
    """Add own ship's way, peaks of an array, envelopes, sound, and what AIS knows.

    ``needs_sound``: whether long sound is wanted, too, which is checked for changes.
    """
    from uwtrack_cli.flow.rerun_sources import with_sound
    from uwtrack_cli.flow.vessel_names import read_vessels, tracks_past
    from uwtrack_cli.plotting.picture import MOST_SAMPLES

    navigation = [n for product in products for n in product.read_all(Navigation)]
    found: list[Container] = [
        with_sound(c, products)
        if isinstance(c, Recording) and (needs_sound or c.n_samples <= MOST_SAMPLES)
        else c
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
        vessels.name(c, sensors, recordings) if isinstance(c, Encounters) else c for c in found
    ]
    if len(sensors) != 1:
        return [*named, *navigation], []
    tracks = tracks_past(vessels, sensors[0], recordings[0] if recordings else None)
    return [*named, *navigation], tracks


def _refuse_second(
    file: Path, before: Sequence[Container], added: Sequence[Container], owners: dict[str, Path]
) -> None:
    """Refuse a file that repeats, with other content, what an earlier one holds."""
    for container in added:
        name = container.NAME
        known = owners.setdefault(name, file)
        same = any(container.equals(other) for other in before)
        if known != file and name in DRAWN and not same:
            raise DataError(
                f"{known} and {file} both hold {name}, and a page shows one recording: "
                f"plot them one by one."
            )


def report(  # noqa: PLR0913 (one parameter for each option)
    file: Path,
    *,
    context: typer.Context,
    step: Branch = None,
    units: UnitsOption = "kn",
    ais: Ais = None,
    within_m: WithinM = WITHIN_M,
    sound: bool = False,
    speed_up: Annotated[float | None, AtLeast(0.1), AtMost(32)] = None,
    pages: bool = False,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a page about a recording, or about a folder: results, pictures, history.

    The page is one HTML file with a card and a picture for every passage. The page of a
    folder shows when there was sound, when vessels were detected and when they passed,
    the levels by the hour, and a small picture of every passage. That picture links to
    the page of its recording, if it exists.

    Parameters
    ----------
    file
        Result file, or folder of result files; - is standard input.
    sound
        Include the sound of every passage, in its band.
    speed_up
        Factor by which the sound is played faster, such as 4 for low frequencies.
    pages
        For a folder: write the page of every file in it, too.
    output
        HTML file; by default named after the result file.
    """
    from uwtrack_cli.files.atomic import check_target, write_text

    with needing("reports need matplotlib and jinja2", "plot"):
        from uwtrack_cli.plotting.report import Report, report_html
    refuse_without_ais(context, ais)
    if speed_up is not None and not sound:
        raise OptionError("--speed-up is how fast the sound is played: give it with --sound.")
    is_folder = file.is_dir()
    target = named_target(output, file / "report" if is_folder else file, ".html")
    if pages and not is_folder:
        raise OptionError(
            "--pages writes the pages of the result files in a folder; this is one result file."
        )
    inputs = () if is_folder or file == PIPE else (file,)
    check_target(target, overwrite=overwrite, inputs=inputs)
    made: dict[str, Any] = {
        "units": "kn" if units == "kn" else "m/s",
        "speed_up": (speed_up or 1.0) if sound else None,
    }

    def text_of(path: Path) -> str:
        with open_product(path) as product:
            found, tracks = _reported(product, step, ais, within_m)
            return report_html(product, Report(found, None, tracks, **made))

    if not is_folder:
        text = text_of(file)
    elif step is not None:
        raise OptionError("--step chooses within one result file, and a folder holds many.")
    else:
        if pages:
            _write_pages_of(file, text_of, overwrite=overwrite)
        text = _of_folder(file, target.parent, ais, within_m, made)
    write_text(target, text, overwrite=overwrite, inputs=inputs)
    say(f"wrote {target}")


def _write_pages_of(folder: Path, text_of: Callable[[Path], str], *, overwrite: bool) -> None:
    """Write the page of every product of a folder that has none, or all anew."""
    from uwtrack_cli.files.atomic import write_text
    from uwtrack_cli.flow.passages import find_results

    paths = find_results([folder])
    with progress_bar("report", len(paths), "pages") as done:
        for number, path in enumerate(paths, 1):
            page = path.with_suffix(".html")
            if overwrite or not page.exists():
                write_text(page, text_of(path), overwrite=overwrite, inputs=(path,))
            done(number)


def _of_folder(
    folder: Path, beside: Path, ais: Path | None, within_m: float, made: Mapping[str, Any]
) -> str:
    """Return the report of a folder."""
    from uwtrack_cli.files.hdf5.product import read_product
    from uwtrack_cli.flow.deployment import read_deployment
    from uwtrack_cli.flow.passages import collect_passages, usual_cache
    from uwtrack_cli.flow.rerun_sources import with_sound
    from uwtrack_cli.plotting.deployment_report import MOST_THUMBNAILS, deployment_html, glances

    table = collect_passages([folder], ais=ais, within_m=within_m, cache=usual_cache())
    deployment = read_deployment([folder], table, glanced=MOST_THUMBNAILS)

    def read(path: Path) -> list[Container]:
        found = deployment.held.get(str(path.resolve()), [])
        if made["speed_up"] is None:
            return found
        with read_product(path) as product:
            return [with_sound(c, [product]) if isinstance(c, Recording) else c for c in found]

    gallery = glances(beside, read, **made)
    return deployment_html(deployment, folder.resolve().name, gallery, made["units"])


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
