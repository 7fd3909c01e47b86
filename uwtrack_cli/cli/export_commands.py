"""`export`: results for other programs."""

from typing import Annotated, Literal

import typer

from uwtrack_cli.cli.command_factory import Axis, Branch, Output, Overwrite, ProductFile
from uwtrack_cli.cli.console import say
from uwtrack_cli.cli.targets import PIPE, named_target, open_product
from uwtrack_cli.errors import OptionError


def export(
    file: ProductFile,
    *,
    form: Annotated[
        Literal["csv", "geojson", "kml", "raven", "netcdf", "rep", "dsf"], typer.Option("--to")
    ],
    container: Annotated[str | None, typer.Option("--table")] = None,
    sensor: str | None = None,
    step: Branch = None,
    axis: Axis = None,
    output: Output = None,
    overwrite: Overwrite = False,
) -> None:
    """Write results as CSV, GeoJSON, KML, Raven selection table, NetCDF, REP or DSF.

    GeoJSON and KML need sensors with latitude and longitude. They hold positions and
    motions with their 95 % regions.

    Parameters
    ----------
    form
        Format to write.
    container
        Table that a CSV holds: fixes, lines.
    sensor
        Sensor, where there are several.
    """
    from uwtrack_cli.flow.exports.export import FORMATS, export_product

    if container is not None and form != "csv":
        raise OptionError(f"--table goes with --to csv, not {form}, which takes what it needs.")
    if axis is not None and container is None:
        raise OptionError(f"--axis {axis} needs --table, and --to csv.")
    target = named_target(output, file, FORMATS[form].ending)
    inputs = () if file == PIPE else (file,)
    with open_product(file) as product:
        export_product(
            product, form, target, container=container, sensor=sensor,
            step=step, axis=axis, overwrite=overwrite, inputs=inputs,
        )  # fmt: skip
    say(f"wrote {target}")
