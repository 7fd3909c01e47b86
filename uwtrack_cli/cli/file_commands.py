"""Commands about files: info, show, verify, export."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from uwtrack_cli.cli.command_factory import AsJson, Axis, Branch, Output, Overwrite, ProductFile
from uwtrack_cli.cli.console import FAILED, is_verbose, put, say, unread_too
from uwtrack_cli.cli.targets import PIPE, named_target, open_product
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.options import nearest
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.renamed import TABLES, with_old_keys
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.text_escaping import shell_word

if TYPE_CHECKING:
    from uwtrack_cli.files.hdf5.product import Product


def info(file: Path, *, json_output: AsJson = False) -> None:
    """Describe a file in ten lines; with -v in full.

    For a folder, list which recordings follow each other.

    Parameters
    ----------
    file
        Result file, recording, or folder of recordings; - is standard input.
    """
    from uwtrack_cli.files.audio.opening import SUFFIXES
    from uwtrack_cli.flow.information import folder_lines, product_lines, recording_lines

    if file.is_dir() or file.suffix.lower() in SUFFIXES:
        if json_output:
            raise OptionError(f"--json describes result files; {file} is none.")
        put(folder_lines(file) if file.is_dir() else recording_lines(file))
        return
    with open_product(file) as product:
        if json_output:
            put([json.dumps(with_old_keys(_facts(product)), ensure_ascii=False)])
        elif is_verbose():
            put(_lines(_facts(product)))
        else:
            put(product_lines(product))


def _facts(product: Any) -> dict[str, Any]:
    tables = [
        {
            "table": key.name,
            "sensor": key.sensor,
            "step": key.step,
            "columns": _columns(product, key),
        }
        for key in product.paths
    ]
    return {
        "file": product.name,
        "schema_version": product.schema_version,
        "program_version": product.program_version,
        "created_utc": product.created_utc,
        "sha256": product.digest,
        "tables": [with_old_keys(each) for each in tables],
        "history": [json.loads(step.to_json()) for step in product.history],
    }


def _columns(product: Any, key: Any) -> list[dict[str, Any]]:
    from uwtrack_cli.files.hdf5.layout import container_class

    columns = container_class(key.name).columns()
    return [
        {"name": column, "shape": list(shape), "units": columns[column].unit}
        for column, shape in product.shapes(key).items()
    ]


def _lines(facts: dict[str, Any]) -> list[str]:
    made = f"made {facts['created_utc']} by uwtrack {facts['program_version']}"
    lines = [f"{facts['file']}: {made}, schema {facts['schema_version']}"]
    for item in facts["tables"]:
        of = f" of {item['sensor']}" if item["sensor"] else ""
        of += f" by {item['step']}" if item["step"] else ""
        lines.append(f"  {item['table']}{of}")
        for column in item["columns"]:
            shape = " x ".join(map(str, column["shape"]))
            unit = f" [{column['units']}]" if column["units"] not in {"", "1"} else ""
            lines.append(f"    {column['name']}{unit}: {shape}")
    lines.append("  history")
    for step in facts["history"]:
        options = ", ".join(f"{k}={v}" for k, v in step["options"].items())
        read = "".join(f" <- {source['name']}" for source in step["sources"])
        named = "" if step["name"] in {"", step["stage"]} else f"{step['name']} = "
        lines.append(f"    {named}{step['stage']}({options}){read}")
    return lines


def show(
    file: Path | None = None,
    table: str | None = None,
    *,
    form: Annotated[Literal["table", "csv", "json", "jsonl"], typer.Option("--format")] = "table",
    sensor: str | None = None,
    step: Branch = None,
    axis: Axis = None,
    schema: str | None = None,
) -> None:
    """Print a table of a result file on standard output.

    Without the name of a table, prints the table that the command printed when it made
    the file. Columns that do not fit the screen are left out; --format csv or json
    prints all.

    Parameters
    ----------
    file
        Result file; - is standard input.
    table
        Name of the table: encounters, lines, peaks ...
    form
        Format to print.
    sensor
        Sensor, where there are several.
    schema
        Print the JSON Schema of a table instead, or that of info, batch, passages,
        diff, score, study.
    """
    from uwtrack_cli.cli.result_output import print_container
    from uwtrack_cli.files.hdf5.layout import CONTAINERS
    from uwtrack_cli.flow.branches import read_of_branch, refuse_unknown_step

    if schema is not None:
        from uwtrack_cli.cli.json_schemas import json_schema

        if file is not None:
            raise OptionError(f"--schema prints a schema and reads no file; leave out {file}.")
        put(json.dumps(json_schema(schema), indent=2, ensure_ascii=False).splitlines())
        return
    if file is None:
        raise OptionError("name the file to show, or an output with --schema.")
    if table is None:
        if axis is not None:
            raise OptionError(f"--axis {axis} needs the name of the table that has it.")
        _show_result(file, form, sensor, step)
        return
    table = TABLES.get(table, table)
    if table not in CONTAINERS:
        if str(file) in CONTAINERS:
            raise OptionError(f"the file comes first: uwtrack show {shell_word(table)} {file}")
        hint = nearest(table, CONTAINERS)
        kinds = ", ".join(CONTAINERS)
        raise OptionError(f"there is no table {table!r}.{hint} There are: {kinds}.")
    with open_product(file) as product:
        refuse_unknown_step([product], step)
        found = read_of_branch(product, CONTAINERS[table], sensor, step)
        print_container(found, form, axis, _suggestions(product))


def _suggestions(product: "Product") -> tuple[str, ...]:
    """Return what to try next where the steps of a product found no vessel."""
    from uwtrack_cli.flow.suggestions import suggestions

    recordings = [(one.name, one) for one in product.read_all(Recording)]
    stages = {step.stage for step in product.history}
    return suggestions(stages, recordings, list(product.read_all(Encounters)))


def _show_result(file: Path, form: str, sensor: str | None, step: str | None) -> None:
    """Print the last result of a product that has a summary."""
    from uwtrack_cli.cli.result_output import is_shown, print_result
    from uwtrack_cli.files.hdf5.layout import CONTAINERS
    from uwtrack_cli.files.tables.container_tables import write_table
    from uwtrack_cli.flow.branches import read_of_branch, refuse_unknown_step

    with open_product(file) as product:
        refuse_unknown_step([product], step)
        held = {key.name for key in product.paths}
        name = next((n for n in _results(product) if n in held), None)
        if name is None:
            raise DataError(
                f"{file} holds no result, but {', '.join(sorted(held))}; "
                f"name what to show: uwtrack show {shell_word(file)} "
                f"{min(held, default='lines')}."
            )
        found = read_of_branch(product, CONTAINERS[name], sensor, step)
        presence = None
        if name == "encounters" and "presence" in held:
            presence = read_of_branch(product, Presence, sensor, step)
        is_sought = name in {"presence", "encounters"}
        suggestions = _suggestions(product) if is_sought else ()
    if form == "table" and is_shown(found):
        print_result(found, as_json=False, is_data=True, presence=presence, suggestions=suggestions)
    else:
        put(write_table(found, form))


def _results(product: "Product") -> tuple[str, ...]:
    """Return results in the order in which the command that made them prints one."""
    from uwtrack_cli.files.hdf5.layout import container_of
    from uwtrack_cli.flow.catalogue import STAGES, output_class

    usual = ("encounters", "presence", "motions", "fixes", "target", "decision")
    last = product.history[-1] if product.history else None
    if last is not None and last.sources and last.stage in STAGES:
        return (container_of(output_class(STAGES[last.stage])).NAME, *usual)  # one stage by itself
    is_fused = len({key.sensor for key in product.paths if key.sensor}) > 1
    return ("fixes", *usual) if is_fused else usual


def verify(files: list[Path]) -> None:
    """Check result files for damage: checksum, completeness, schema, history.

    A checksum shows damage, not forgery: it has no key, and whoever changes a result
    file can write a new one. A file that was changed on purpose cannot do harm, because
    it is read in a process of its own with limits on time and memory. Its numbers may
    still be false.

    Parameters
    ----------
    files
        Result files to check.
    """
    from uwtrack_cli.files.hdf5.product import verify_product

    damaged = False
    for file in files:
        problems = verify_product(file)
        damaged |= bool(problems)
        told = [problem.removeprefix(f"{file} ") for problem in problems]
        with unread_too():
            put([f"{file}: {problem}" for problem in told] or [f"{file}: ok"])
    if damaged:
        raise typer.Exit(FAILED)


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
