"""Export a product: CSV, GeoJSON, KML, Raven table, NetCDF, REP, DSF."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.atomic import atomic_target, check_target, write_text
from uwtrack_cli.files.hdf5.layout import container_class
from uwtrack_cli.files.hdf5.netcdf import write_netcdf
from uwtrack_cli.files.hdf5.product import Product
from uwtrack_cli.files.tables.container_tables import write_table
from uwtrack_cli.files.tables.replay import replay_lines
from uwtrack_cli.flow.branches import read_of_branch, refuse_unknown_step, sole_keys
from uwtrack_cli.flow.exports.features import geographic_features
from uwtrack_cli.flow.exports.geojson import geojson_text
from uwtrack_cli.flow.exports.kml import kml_text
from uwtrack_cli.flow.exports.passage_tables import COLUMNS, csv_lines
from uwtrack_cli.flow.exports.raven import raven_text
from uwtrack_cli.flow.passages import passage_rows
from uwtrack_cli.flow.products import small_containers

Form = Literal["csv", "geojson", "kml", "raven", "netcdf", "rep", "dsf"]
SUMMARIES = ("fixes", "encounters", "motions", "target", "decision", "lines", "levels")
"""Containers that a CSV holds, the first one there is with a row in it."""


def export_product(
    product: Product,
    form: Form,
    target: Path,
    *,
    container: str | None = None,
    sensor: str | None = None,
    step: str | None = None,
    axis: str | None = None,
    overwrite: bool = False,
    inputs: tuple[Path, ...] = (),
) -> None:
    """Write what a product found in the format of another program.

    ``container``: container that a CSV holds. ``sensor``: sensor, where there are
    several. ``axis``: axis of the container whose rows a CSV holds; the main one unless
    given.

    Raises
    ------
    DataError
        The product does not hold what the format needs.
    OutputError
        The target exists, is an input, or cannot be written.
    """
    check_target(target, overwrite=overwrite, inputs=inputs)
    refuse_unknown_step([product], step)
    if form == "netcdf":
        with atomic_target(target, overwrite=overwrite, inputs=inputs) as temporary:
            history = [step.to_json() for step in product.history]
            write_netcdf(temporary, list(small_containers(product, step)), history)
        return
    made = FORMATS[form]
    if made.text is None and container is None and axis is None and _lists(product):
        encounters = read_of_branch(product, Encounters, None, step)
        found = [asdict(row) for row in passage_rows(product, encounters)]
        rows = [row for row in found if sensor in {None, row["sensor"]}]
        _remark(product.name, "passages", n_rows=len(rows))
        text = "".join(f"{line}\n" for line in csv_lines(rows, COLUMNS))
    elif made.text is None:
        chosen = _chosen(product, container, sensor, step)
        text = "\n".join(write_table(chosen, "csv", axis=axis)) + "\n"
    else:
        keys = sole_keys(product, step, frozenset(made.takes))
        containers = [held.container for held in small_containers(product, step, keys)]
        text = made.text(containers, product.name)
    write_text(target, text, overwrite=overwrite, inputs=inputs)


def _lists(product: Product) -> bool:
    """Tell whether the result of a product is the closest approaches of passages."""
    last = product.history[-1].stage if product.history else ""
    held = {key.name for key in product.paths}
    return "encounters" in held and last != "locate" and "motions" not in held


def _geojson(containers: list[Container], name: str) -> str:
    return geojson_text(geographic_features(containers, name))


def _kml(containers: list[Container], name: str) -> str:
    return kml_text(geographic_features(containers, name), Path(name).name)


def _replay(containers: list[Container], name: str, *, with_tracks: bool) -> str:
    series = [c for c in containers if isinstance(c, Series)]
    told = [c for c in containers if isinstance(c, Fixes | Motions)]
    lines = replay_lines(series, told, with_tracks=with_tracks)
    text = "".join(f"{line}\n" for line in lines)
    if not text:
        raise DataError(
            f"{name} has no table of bearings, and no positions with latitude, longitude "
            f"and UTC: that is what a REP file holds (a DSF file: the bearings)."
        )
    return text


class Format(NamedTuple):
    """A format of another program."""

    ending: str
    """How its files end."""
    takes: tuple[str, ...] = ()
    """Containers of which it takes one for each sensor."""
    text: Callable[[list[Container], str], str] | None = None
    """Makes its text of them and the name of the product; None: written in its own way."""


PLACED = ("encounters", "fixes", "motions")
"""Containers whose rows have places on a map."""

FORMATS: dict[Form, Format] = {
    "csv": Format(".csv"),
    "geojson": Format(".geojson", PLACED, _geojson),
    "kml": Format(".kml", PLACED, _kml),
    "raven": Format(".selections.txt", ("lines",), raven_text),
    "netcdf": Format(".nc"),
    "rep": Format(".rep", ("series", "fixes", "motions"), partial(_replay, with_tracks=True)),
    "dsf": Format(".dsf", ("series",), partial(_replay, with_tracks=False)),
}


def _chosen(
    product: Product, container: str | None, sensor: str | None, step: str | None
) -> Container:
    if container is not None:
        found = read_of_branch(product, container_class(container), sensor, step)
        return _remarked(found, product.name)
    held = {key.name for key in product.paths}
    there: Container | None = None
    for name in (name for name in SUMMARIES if name in held):
        found = read_of_branch(product, container_class(name), sensor, step)
        if _n_rows(found):
            return found
        there = there or found
    if there is None:
        raise DataError(f"{product.name} holds no table; name one with --table.")
    return _remarked(there, product.name)


def _n_rows(container: Container) -> int:
    """Return the rows of a table; a container without any is one row of facts."""
    return container.sizes().get(container.ROW, 0) if container.columns() else 1


def _remarked(container: Container, name: str) -> Container:
    """Say of a table without rows that it is one."""
    _remark(name, container.NAME, n_rows=_n_rows(container))
    return container


def _remark(name: str, rows: str, *, n_rows: int) -> None:
    if not n_rows:
        warn(f"{name} has no {rows}: the table has a head and no rows.")
