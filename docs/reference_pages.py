"""Pages of the reference, made from what defines the program itself.

Commands and their options come from the catalogue and the signatures, containers from
their columns, JSON from the schemas, sensor files from the class that reads them,
recipes from their files. Nothing is copied by hand; a page is written again only when
it has changed, so that the next build takes what is new alone.
"""

import ast
import inspect
import itertools
import json
import math
import re
import sys
import types
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import uwtrack_cli
from uwtrack_cli.cli.app import COMMANDS, GROUPS, load_command
from uwtrack_cli.cli.json_schemas import json_schema, schema_names
from uwtrack_cli.data.base import Column, Container
from uwtrack_cli.data.options import plain_type, range_of, unit_of
from uwtrack_cli.files.hdf5.layout import CONTAINERS, part_classes, scalar_types
from uwtrack_cli.files.tables.sensors import DeployedSensorTable
from uwtrack_cli.flow.catalogue import STAGES, find_stage
from uwtrack_cli.flow.shipped_recipes import load_recipe, shipped_recipes

ROOMS = {
    "acoustics": "closed forms: geometry, Doppler, propagation",
    "spectra": "sound to spectrogram, levels, peaks, envelope spectra",
    "arrays": "sound of a line array to beams",
    "lines": "peaks to families and frequency lines",
    "motion": "lines, levels and bearings to motion",
    "presence": "what was heard, and why it is no closest approach",
    "clutter": "one target through clutter",
    "discrimination": "which of two contacts moves",
    "estimation": "numerics without sonar in them",
}
"""Folders of the package whose modules say what they are from, and what they do."""

PAGES_OF = Path(__file__).parent
"""Folder of the pages that people write."""

EXAMPLES = re.findall(
    r"^```console\n(.*?)^```$",
    (PAGES_OF / "commands.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL,
)  # fmt: skip
"""What is typed on the page of examples, block by block."""

PICTURES = {
    "plot": {"pass.png": "The page of a passage", "recording.png": "A recording"},
    "demon": {"demon.png": "The mean spectrum of the envelope"},
    "presence": {"presence.png": "What was detected over time"},
    "fringes": {"fringes.png": "The image of the fringes"},
    "recipes": {"recipes/vessel.svg": "The steps of the recipe vessel"},
}
"""Pictures of commands, with what they show."""

FOR_ALL = {"commands.md", "first-half-hour.md", "measured.md", "migration.md", "notebook.md"}
"""Pages that name a command only by the way, and those that begin with no heading."""

MOST_PAGES = 6
"""Pages that a command's page leads to, at most."""

SHARED = ("quiet", "verbose", "debug", "overwrite", "output", "help")
"""Options that come last: they are nearly everywhere."""


def write_reference(folder: Path) -> None:
    """Write all generated pages into a folder.

    Parameters
    ----------
    folder
        Folder of the pages; pages of what no longer exists are removed.
    """
    pages = {
        **{f"commands/{name}.md": _command(name) for name in COMMANDS},
        "commands.md": _list(
            "Commands", "commands", COMMANDS, "Every command, in the order of the chain. "
            "`uwtrack help COMMAND` prints the same; `uwtrack --install-completion` "
            "completes commands, options and names.",
        ),
        **{f"containers/{kind.NAME}.md": _container(kind) for kind in CONTAINERS.values()},
        "containers.md": _list(
            "Containers", "containers", CONTAINERS, "What flows, and what product files "
            "hold: frozen dataclasses of arrays with named axes.",
        ),
        **{f"json/{name}.md": _schema(name) for name in schema_names()},
        "json.md": _list(
            "JSON", "json", schema_names(), "What `--json` and `show --format json` "
            "print. `uwtrack show --schema NAME` prints the JSON Schema. Within a version "
            "keys are added, never changed.",
        ),
        "sensor-files.md": _sensor_files(),
        "recipes.md": _recipes(),
        "python.md": _python(),
        **{f"methods/{room}.md": _methods(room, text) for room, text in ROOMS.items()},
        "methods.md": _list(
            "Methods, module by module", "methods", ROOMS, "Method, conventions and "
            "sources of each module, as they stand in the code.",
        ),
    }  # fmt: skip
    for name, lines in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        text = "\n".join(lines) + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in folder.rglob("*.md"):
        if path.relative_to(folder).as_posix() not in pages:
            path.unlink()


def _list(title: str, folder: str, names: Iterable[str], text: str) -> Iterator[str]:
    yield from (f"# {title}", "", text, "", "```{toctree}", ":maxdepth: 1", "")
    yield from (f"{folder}/{name}" for name in names)
    yield "```"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield ""
    for row in (heads, ["---"] * len(heads), *rows):
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


def _command(name: str) -> Iterator[str]:
    command = load_command(name)
    params = sorted(command.params, key=lambda p: p.name in SHARED)
    arguments = [p for p in params if p.param_type_name == "argument"]
    words = "".join(f" {_placeholder(p)}" for p in arguments)
    yield from (f"# uwtrack {name}", "", "```text", f"uwtrack {name}{words} [OPTIONS]")
    yield from ("```", "", _escaped(command.help or ""))
    if name in STAGES:
        stage = find_stage(name)
        function = stage.function.__name__
        takes = " or ".join(
            f"[{kind.NAME}](../containers/{kind.NAME}.md)"
            for item in stage.inputs
            for kind in item.kinds
        )
        made = stage.output.NAME
        yield from ("", (f"Takes {takes}; makes [{made}](../containers/{made}.md). From "
                    f"Python: {{py:func}}`uwtrack_cli.{function}`."))  # fmt: skip
    yield from _example(name)
    if arguments:
        yield from ("", "## Arguments")
        yield from _table(
            ["argument", "meaning"], [[f"`{p.name}`", _escaped(p.help or "")] for p in arguments]
        )
    panels: dict[str, list[Any]] = {}
    for param in params:
        if param.param_type_name == "option":
            title = getattr(param, "rich_help_panel", None) or "Options"
            panels.setdefault(title, []).append(param)
    for title, options in panels.items():
        yield from ("", f"## {title}")
        yield from _table(["option", "value", "default", "meaning"], map(_option, options))
    yield from _see_also(name)


def _example(name: str) -> Iterator[str]:
    """Yield what the page of examples types for a command, and its pictures."""
    yield from ("", "## Example")
    for block in EXAMPLES:
        lines = block.splitlines()
        begins = [k for k, line in enumerate(lines) if line.startswith("$ ")]
        for begin, end in itertools.pairwise([*begins, len(lines)]):
            if lines[begin].startswith(f"$ uwtrack {name} ") or lines[begin] == (
                f"$ uwtrack {name}"
            ):
                yield from ("", "```console", *lines[begin:end], "```")
    for picture, text in PICTURES.get(name, {}).items():
        yield from ("", f"![{text}](../../../{picture})")


def _see_also(name: str) -> Iterator[str]:
    """Yield links to the commands before and after, those of its group, and pages."""
    near = [other for group in GROUPS.values() if name in group for other in group]
    if name in STAGES:
        own = find_stage(name)
        stages = {other: find_stage(other) for other in STAGES}
        kinds = {kind for item in own.inputs for kind in item.kinds}
        before = [o for o, stage in stages.items() if stage.output in kinds]
        after = [
            o for o, stage in stages.items()
            if any(own.output in item.kinds for item in stage.inputs)
        ]  # fmt: skip
        near = [*before, *after]
    links = [f"[{other}]({other}.md)" for other in dict.fromkeys(near) if other != name]
    said = re.compile(rf"uwtrack {re.escape(name)}[ `\n]")
    links += [
        f"[{path.read_text(encoding='utf-8').splitlines()[0].removeprefix('# ')}]"
        f"(../../../{path.name})"
        for path in sorted(PAGES_OF.glob("*.md"))
        if path.name not in FOR_ALL and said.search(path.read_text(encoding="utf-8"))
    ][:MOST_PAGES]
    if links:
        yield from ("", "## See also", "", ", ".join(links))


def _placeholder(param: Any) -> str:
    name = str(param.name).upper() + ("..." if param.nargs == -1 else "")
    return name if param.required else f"[{name}]"


def _option(param: Any) -> list[str]:
    default = "" if param.default is None or param.is_flag else _shown(param.default)
    flags = ", ".join(f"`{flag}`" for flag in param.opts)
    kind = "" if param.is_flag else _kind(param.type_descriptor.annotation)
    return [flags, kind, default, _escaped(param.help or "")]


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return " ".join(map(_shown, value))
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _kind(hint: Any) -> str:
    """Return what a person types for a type."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in {Union, types.UnionType}:
        return " or ".join(_kind(one) for one in inner if one is not type(None))
    if origin is Literal:
        return ", ".join(f"`{one}`" for one in inner)
    if origin is list:
        return f"{_kind(inner[0])}, ..."
    if origin is tuple:
        return " ".join(map(_kind, inner))
    known = {float: "number", int: "integer", str: "text", Path: "path", bool: "true, false"}
    return known.get(hint, getattr(hint, "__name__", str(hint)))


def _container(kind: type[Container]) -> Iterator[str]:
    yield from (f"# {kind.NAME}", "", f"`uwtrack_cli.{kind.__name__}`", "")
    yield inspect.getdoc(kind) or ""
    columns = kind.columns()
    for axis in dict.fromkeys(spec.axes[0] for spec in columns.values()):
        owned = [c for c, spec in columns.items() if spec.owner and spec.axes[0] == axis]
        ragged = f"; a ragged table, {columns[owned[0]].owner} by `{owned[0]}`" if owned else ""
        yield from ("", f"## One row per {axis}{ragged}")
        yield from _table(["column", "unit", "type", "axes", "meaning"], [
            [
                f"`{name}`", spec.unit, "text" if spec.dtype.kind == "U" else str(spec.dtype),
                " x ".join(spec.axes), _escaped(spec.description)
                + (" May be absent." if spec.optional else "") + _cells(spec),
            ]
            for name, spec in columns.items() if spec.axes[0] == axis
        ])  # fmt: skip
    plain = scalar_types(kind)
    if plain:
        yield from ("", "## Single values")
        yield from _table(["value", "unit", "type", "meaning"], [
            [
                f"`{name}`", kind.scalars()[name].metadata["unit"], one.__name__,
                _escaped(kind.scalars()[name].metadata["description"]),
            ]
            for name, one in plain.items()
        ])  # fmt: skip
    if part_classes(kind):
        yield from ("", "## Parts")
        for name, part in part_classes(kind).items():
            yield f"* `{name}`: [{part.NAME}]({part.NAME}.md)"


def _cells(spec: Column) -> str:
    """Say how tables that people give hold a column; nothing of one that they do not."""
    if spec.cells is None:
        return ""
    cells = spec.cells
    facts = ["needed" if cells.needed else "may be left out"]
    if len(spec.axes) > 1:
        facts = ["may be left out", "numbered from 2 without a gap where there are several"]
    facts.append("every cell" if cells.every else "cells may be empty")
    if math.isfinite(cells.low):
        is_tiny = 0.0 < cells.low <= sys.float_info.min
        facts.append("above 0" if is_tiny else f"from {cells.low:g}")
    if math.isfinite(cells.high):
        facts.append(f"up to {cells.high:g}")
    return f" In a table: {', '.join(facts)}."


def _schema(name: str) -> Iterator[str]:
    schema = json_schema(name)
    yield from (f"# {name}", "", _escaped(schema.get("title", "")), "")
    yield f"`uwtrack show --schema {name}` prints the schema `{schema['$id']}`."
    body = schema.get("items", schema)
    is_list = "items" in schema
    yield from ("", "One array of objects with these keys:" if is_list else
                "One object with these keys:")  # fmt: skip
    rows = [
        [f"`{key}`", _json_type(value), _escaped(value.get("description", ""))]
        for key, value in body.get("properties", {}).items()
    ]
    yield from _table(["key", "type", "meaning"], rows)
    for key, value in body.get("properties", {}).items():
        inner = value.get("items", {}).get("properties", {})
        if inner:
            yield from ("", f"## Objects of `{key}`")
            yield from _table(["key", "type", "meaning"], [
                [f"`{k}`", _json_type(v), _escaped(v.get("description", ""))]
                for k, v in inner.items()
            ])  # fmt: skip


def _json_type(schema: dict[str, Any]) -> str:
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return ", ".join(f"`{json.dumps(value)}`" for value in values)
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(map(_json_type, schema["anyOf"])))
    kinds = schema.get("type", "object")
    text = " or ".join([kinds] if isinstance(kinds, str) else kinds)
    if kinds == "array" and "type" in schema.get("items", {}):
        return f"array of {_json_type(schema['items'])}"
    return text


def _sensor_files() -> Iterator[str]:
    yield from (
        "# Sensor files", "",
        ("`pass.sensor.toml` beside `pass.wav` is found by itself; `--sensor` names another. "
        "A deployment file has a `[[sensor]]` table for each sensor, each with `files`. What "
        "is not given is unknown, and is estimated with a prior."),
    )  # fmt: skip
    hints = get_type_hints(DeployedSensorTable, include_extras=True)
    texts = field_texts(DeployedSensorTable)
    rows = []
    for one in fields(DeployedSensorTable):
        hint = hints[one.name]
        limits = ", ".join(fact for fact in (unit_of(hint), range_of(hint)) if fact)
        rows.append([f"`{one.name}`", _kind(plain_type(hint)), limits, texts[one.name]])
    yield from _table(["key", "value", "unit and range", "meaning"], rows)


def field_texts(kind: type) -> dict[str, str]:
    """Return the text beneath each field of a dataclass, those of its bases included.

    Parameters
    ----------
    kind
        The dataclass.
    """
    texts: dict[str, str] = {}
    for base in reversed([c for c in kind.__mro__ if is_dataclass(c)]):
        (node,) = ast.parse(inspect.getsource(base)).body
        body = node.body if isinstance(node, ast.ClassDef) else []
        for field, text in itertools.pairwise(body):
            is_text = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
            if isinstance(field, ast.AnnAssign) and is_text:
                texts[ast.unparse(field.target)] = str(text.value.value)
    return texts


def _recipes() -> Iterator[str]:
    yield from ("# Shipped recipes", "")
    yield "With every default, as `uwtrack recipes --show NAME` prints them; how they join is"
    yield "told in [Recipes](../../recipes.md)."
    for name in shipped_recipes():
        recipe = load_recipe(name)
        yield from ("", f"## {name}", "", _escaped(recipe.description), "", "```text")
        yield from recipe.graph().lines()
        yield from ("```", "", "```toml", recipe.to_toml().strip(), "```")


def _methods(room: str, text: str) -> Iterator[str]:
    """Yield the docstrings of a room's modules that name a source."""
    yield from (f"# {room}", "", f"{text[0].upper()}{text[1:]}.")
    root = Path(uwtrack_cli.__file__).parent / room
    for path in sorted(root.rglob("*.py"), key=lambda path: (len(path.parts), path)):
        doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        if "**References.**" in doc:
            name = path.relative_to(root).with_suffix("").as_posix()
            title, _, rest = doc.partition("\n")
            yield from ("", f"## {name}", "", title, rest.replace("::\n", ":\n"))


def _python() -> Iterator[str]:
    yield from (
        "# Python", "",
        "All public names are imported from `uwtrack_cli`; paths are text or `Path`.",
        "The package is typed. [Containers](containers.md) have a page each.", "",
        "```{eval-rst}", ".. py:module:: uwtrack_cli", "",
    )  # fmt: skip
    for name in uwtrack_cli.__all__:
        value = getattr(uwtrack_cli, name)
        if inspect.isfunction(value):
            yield f".. autofunction:: uwtrack_cli.{name}"
        elif inspect.isclass(value) and name not in _containers():
            yield f".. autoclass:: uwtrack_cli.{name}"
            yield "   :members:" if not issubclass(value, Exception) else ""
        yield ""
    yield "```"


def _containers() -> set[str]:
    return {kind.__name__ for kind in CONTAINERS.values()}


def _escaped(text: str) -> str:
    """Return plain text as Markdown: nothing in it is markup."""
    for sign in "\\<*_$[{":
        text = text.replace(sign, f"\\{sign}")
    return text
