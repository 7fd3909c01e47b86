"""Commands about files: info, show, verify, plot."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from uwtrack_cli.cli.doors import AsJson, Overwrite, command
from uwtrack_cli.cli.screen import FAILED, put, say
from uwtrack_cli.cli.targets import open_product
from uwtrack_cli.errors import DataError, OptionError

ProductFile = Annotated[Path, typer.Argument(help="Product; - is standard input.")]


def register(app: typer.Typer, name: str) -> None:
    """Add the command of a name."""
    named: dict[str, Callable[..., None]] = {
        "info": info, "show": show, "verify": verify, "plot": plot,
    }  # fmt: skip
    command(app, name)(named[name])


def info(*, file: ProductFile, json_output: AsJson = False) -> None:
    """Tell what is inside a product: containers, units and history."""
    with open_product(file) as product:
        facts = _facts(product)
    if json_output:
        put([json.dumps(facts, ensure_ascii=False)])
        return
    put(_lines(facts))


def _facts(product: Any) -> dict[str, Any]:
    from uwtrack_cli.files.reading import container_group

    containers = []
    for sensor, names in product.containers().items():
        for name in names:
            columns = _columns(product, container_group, sensor, name)
            containers.append({"container": name, "sensor": sensor, "columns": columns})
    return {
        "file": product.name,
        "schema_version": product.schema_version,
        "program_version": product.program_version,
        "created_utc": product.created_utc,
        "sha256": product.digest,
        "containers": containers,
        "history": [json.loads(step.to_json()) for step in product.history],
    }


def _columns(
    product: Any, container_group: Any, sensor: str | None, name: str
) -> list[dict[str, Any]]:
    from uwtrack_cli.files.reading import column_dataset
    from uwtrack_cli.files.registry import container_class

    kind = container_class(name)
    group = container_group(product.file, product.paths[sensor, name], kind)
    return [
        {
            "name": column,
            "shape": list(column_dataset(group, column, spec).shape),
            "units": spec.unit,
        }
        for column, spec in kind.columns().items()
        if column in group
    ]


def _lines(facts: dict[str, Any]) -> list[str]:
    made = f"made {facts['created_utc']} by uwtrack {facts['program_version']}"
    lines = [f"{facts['file']}: {made}, schema {facts['schema_version']}"]
    for item in facts["containers"]:
        of = f" of {item['sensor']}" if item["sensor"] else ""
        lines.append(f"  {item['container']}{of}")
        for column in item["columns"]:
            shape = " x ".join(map(str, column["shape"]))
            unit = f" [{column['units']}]" if column["units"] not in {"", "1"} else ""
            lines.append(f"    {column['name']}{unit}: {shape}")
    lines.append("  history")
    for step in facts["history"]:
        options = ", ".join(f"{k}={v}" for k, v in step["options"].items())
        read = "".join(f" <- {source['name']}" for source in step["sources"])
        lines.append(f"    {step['stage']}({options}){read}")
    return lines


def show(
    *,
    file: ProductFile,
    container: Annotated[
        str, typer.Argument(help="Name of the container: encounters, lines, peaks ...")
    ],
    form: Annotated[
        Literal["table", "csv", "json", "jsonl"],
        typer.Option("--format", help="How it is written."),
    ] = "table",
    sensor: Annotated[
        str | None, typer.Option("--sensor", help="Sensor, where there are several.")
    ] = None,
) -> None:
    """Print a container of a product on standard output."""
    from uwtrack_cli.files.registry import CONTAINERS
    from uwtrack_cli.files.tables import write_table

    if container not in CONTAINERS:
        msg = f"there is no container {container!r}; there are {', '.join(CONTAINERS)}."
        raise OptionError(msg)
    with open_product(file) as product:
        put(write_table(product.read(CONTAINERS[container], sensor), form))


def verify(
    *,
    files: Annotated[list[Path], typer.Argument(help="Products to check.")],
) -> None:
    """Check products for damage: checksums, completeness, schema, history."""
    from uwtrack_cli.files.product import verify_product

    damaged = False
    for file in files:
        problems = verify_product(file)
        damaged |= bool(problems)
        put([f"{file}: {problem}" for problem in problems] or [f"{file}: ok"])
    if damaged:
        raise typer.Exit(FAILED)


def plot(
    *,
    files: Annotated[
        list[Path], typer.Argument(help="Products of one recording, in any order.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Picture: PNG, PDF or SVG.")
    ],
    overwrite: Overwrite = False,
) -> None:
    """Draw the lofargram with lines and fits, bearings, level and map."""
    from contextlib import ExitStack

    from uwtrack_cli.cli.targets import Inputs

    try:
        from uwtrack_cli.plotting.page import draw_page
    except ImportError as error:
        msg = f"plots need matplotlib ({error}); pip install 'uwtrack[plot]'."
        raise DataError(msg) from error
    with ExitStack() as stack:
        inputs = Inputs(stack)
        for file in files:
            inputs.add(file, ())
    draw_page(inputs.containers, output, overwrite=overwrite)
    say(f"wrote {output}")
