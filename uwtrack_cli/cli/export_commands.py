"""`export` and `report`: results for other programs, and for people."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from uwtrack_cli.cli.command_factory import (
    Ais,
    Branch,
    Output,
    Overwrite,
    WithinM,
    command,
)
from uwtrack_cli.cli.console import say
from uwtrack_cli.cli.targets import PIPE, open_product, product_name
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError

if TYPE_CHECKING:
    from uwtrack_cli.files.hdf5.product import Product

ProductFile = Annotated[Path, typer.Argument(help="Product; - is standard input.")]


def register(app: typer.Typer, name: str) -> None:
    """Add the command of a name."""
    named: dict[str, Callable[..., None]] = {"export": export, "report": report}
    command(app, name)(named[name])


def export(
    *,
    file: ProductFile,
    form: Annotated[
        Literal["csv", "geojson", "kml", "raven", "netcdf"],
        typer.Option("--to", help="Format to write."),
    ],
    container: Annotated[
        str | None,
        typer.Option("--container", help="Container that a CSV holds: fixes, lines."),
    ] = None,
    sensor: Annotated[
        str | None, typer.Option("--sensor", help="Sensor, where there are several.")
    ] = None,
    step: Branch = None,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """Write results as CSV, GeoJSON, KML, Raven selection table or NetCDF.

    GeoJSON and KML need sensors with latitude and longitude, and draw positions with
    their 95 % regions.
    """
    from uwtrack_cli.flow.exports.export import ENDINGS, export_product

    if container is not None and form != "csv":
        msg = f"--container goes with --to csv, not {form}, which takes what it needs."
        raise OptionError(msg)
    target = _target(output, file, ENDINGS[form])
    inputs = () if file == PIPE else (file,)
    with open_product(file) as product:
        export_product(
            product, form, target, container=container, sensor=sensor,
            step=step, overwrite=overwrite, inputs=inputs,
        )  # fmt: skip
    say(f"wrote {target}")


def report(
    *,
    file: ProductFile,
    step: Branch = None,
    ais: Ais = None,
    within_m: WithinM = 2000.0,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a page about a recording: results, pictures, history; all in one file."""
    try:
        from uwtrack_cli.plotting.report import SHOWN, write_report
    except ImportError as error:
        msg = f"reports need matplotlib ({error}); pip install 'uwtrack[plot]'."
        raise DataError(msg) from error
    from uwtrack_cli.flow.branches import refuse_unknown_step, sole_keys

    target = _target(output, file, ".html")
    inputs = () if file == PIPE else (file,)
    with open_product(file) as product:
        refuse_unknown_step([product], step)
        keys = sole_keys(product, step, SHOWN)
        write_report(
            product,
            target,
            keys=keys,
            overwrite=overwrite,
            inputs=inputs,
            revise=None if ais is None else _names(product, ais, within_m),
        )
    say(f"wrote {target}")


def _names(
    product: "Product", ais: Path, within_m: float
) -> Callable[[Encounters], Encounters]:
    """Return what gives the encounters of a product the names of vessels."""
    from uwtrack_cli.flow.vessel_names import read_vessels

    vessels = read_vessels(ais, within_m)
    sensors, recordings = product.read_all(Sensor), product.read_all(Recording)
    return lambda encounters: vessels.name(encounters, sensors, recordings)


def _target(output: Path | None, file: Path, ending: str) -> Path:
    if output == PIPE or (output is None and file == PIPE):
        msg = "this is written to a file of its own: name it with -o FILE."
        raise OptionError(msg)
    return output or product_name(file, ending)
