"""Commands made from the stages' own signatures, and from plain functions.

**Method.** A command is a function whose signature is computed: the inputs, the
stage's options with their help, and the options that every command shares. Typer
builds the rest, so a command can have no default of its own.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer
from typer.core import TyperCommand

from uwtrack_cli.cli.console import guard, set_verbosity
from uwtrack_cli.data.options import is_union, makes_rungs
from uwtrack_cli.files.input_ledger import input_ledger
from uwtrack_cli.flow.stage import Option, Stage

GENERAL, EXPERT = "General options", "Expert options"
"""Titles of the panels that come last."""

RARE = frozenset({
    "above_design", "cells_per_octave", "decimation", "dipole_noise_ratio",
    "kept_probability", "largest_share", "least_highest_hz", "loading",
    "lowest_false_alarm", "max_pixels", "most_peaks", "overlap", "shading",
    "sidelobe_db", "snapshots", "weighting", "zero_padding",
})  # fmt: skip
"""Options of stages that few people need, beside those in groups of their own."""

Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="Say nothing but errors.", rich_help_panel=GENERAL
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", "-v", help="Say more about what is done.", rich_help_panel=GENERAL
    ),
]
Debug = Annotated[
    bool,
    typer.Option(
        "--debug", help="Show the traceback of an error.", rich_help_panel=GENERAL
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace an existing output file.")
]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Output file; - is standard output."),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON on standard output.")
]

ProductFile = Annotated[Path, typer.Argument(help="Result file; - is standard input.")]
Branch = Annotated[
    str | None,
    typer.Option(
        "--step",
        help="Step whose results are used, if several steps made the same table.",
    ),
]

Axis = Annotated[
    str | None,
    typer.Option(
        "--axis",
        help="Rows of another axis of the table: row (motions), lobe (directions).",
    ),
]
NAMES = "Names of vessels"
Ais = Annotated[
    Path | None,
    typer.Option(
        "--ais",
        help="AIS table or log with the names of the vessels.",
        rich_help_panel=NAMES,
    ),
]
WithinM = Annotated[
    float,
    typer.Option(
        help="Range in m within which AIS vessels are compared.",
        rich_help_panel=NAMES,
    ),
]

SHARED: dict[str, Any] = {"quiet": Quiet, "verbose": Verbose, "debug": Debug}
"""Options of every command."""


class PlainCommand(TyperCommand):
    """A command whose help has every name in full, however narrow the screen is.

    In a table of boxes a long name is cut where columns meet: `--false-alarm-prob…`.
    """

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options panel by panel."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            is_argument = param.param_type_name == "argument"
            usual = "Arguments" if is_argument else "Options"
            if record is not None:
                title = getattr(param, "rich_help_panel", None) or usual
                title = GENERAL if param.name == "help" else title
                panels.setdefault(title, []).append(record)
        for title, records in sorted(panels.items(), key=lambda panel: _rank(panel[0])):
            with formatter.section(title):
                formatter.write_dl(records)


def _rank(panel: str) -> int:
    """Return where a panel stands: what is common first, what experts need last."""
    first = ("Arguments", "Options", "Recording", "Many recordings")
    if panel in first:
        return first.index(panel)
    return len(first) + (panel == GENERAL) + 2 * panel.startswith(EXPERT)


def register(app: typer.Typer, name: str, function: Callable[..., None]) -> None:
    """Make a function a command with the shared options and error handling."""
    signature = inspect.signature(function)
    parameters = [*signature.parameters.values(), *map(_flag, SHARED)]

    def run(**values: Any) -> None:
        quiet, verbose, debug = (bool(values.pop(shared)) for shared in SHARED)
        if quiet or verbose:
            set_verbosity(-1 if quiet else 1)
        with guard(debug=debug), input_ledger():
            function(**values)

    run.__doc__ = flowing(function.__doc__ or "")
    run.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=parameters
    )
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    app.command(name, cls=PlainCommand)(run)


def flowing(text: str) -> str:
    """Return paragraphs without line breaks, for a screen of any width."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(part.split()) for part in paragraphs)


def _flag(name: str) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=SHARED[name]
    )


def stage_function(
    stage: Stage,
    body: Callable[[Mapping[str, Any], list[dict[str, Any]]], None],
    own: list[inspect.Parameter],
) -> Callable[..., None]:
    """Return the function that is the command of a stage.

    ``stage``: the stage; its options become the command's. ``body``: called with the
    command's own parameters and the bound options: one set, or one for each value of an
    option that makes rungs. ``own``: parameters of the command beside the stage's
    options.
    """
    flat = [_parameter(option) for option in stage.options]

    def run(**values: Any) -> None:
        given = {n: values.pop(n) for n in [p.name for p in flat]}
        body(values, nest_rungs(stage, given))

    run.__doc__ = _help(stage)
    run.__signature__ = inspect.Signature([*own, *flat])  # type: ignore[attr-defined]
    return run


def nest_rungs(stage: Stage, flat: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the stage's options for each value of the option that makes rungs.

    ``flat``: options of the command, by their flat names.
    """
    several = [o.flat_name for o in stage.options if makes_rungs(o.hint)]
    if not several:
        return [nest(stage, flat)]
    (name,) = several
    return [nest(stage, {**flat, name: value}) for value in flat[name]]


def nest(stage: Stage, flat: Mapping[str, Any]) -> dict[str, Any]:
    """Turn the flat options of a command into the stage's own, policies nested."""
    options: dict[str, Any] = {}
    for option in stage.options:
        value = flat[option.flat_name]
        if option.group is None:
            options[option.name] = value
        else:
            options.setdefault(option.group, {})[option.name] = value
    return stage.bind(options)


def _parameter(option: Option) -> inspect.Parameter:
    panel = EXPERT if option.name in RARE else None
    if option.group is not None:
        panel = f"{EXPERT}: {option.group}"
    several = makes_rungs(option.hint)
    return inspect.Parameter(
        option.flat_name,
        inspect.Parameter.KEYWORD_ONLY,
        default=[option.default] if several else option.default,
        annotation=Annotated[
            list[option.type] if several else option.type,  # type: ignore[name-defined]
            typer.Option(help=option.help, rich_help_panel=panel),
        ],
    )


def spread_values(stage: Stage, words: Sequence[str]) -> list[str]:
    """Let an option that takes a list be followed by all its values.

    ``--start-velocity 50 -50`` becomes ``--start-velocity 50 --start-velocity -50``.
    """
    flags = {
        f"--{option.flat_name.replace('_', '-')}"
        for option in stage.options
        if takes_list(option.type) or makes_rungs(option.hint)
    }
    found: list[str] = []
    flag = ""
    for word in words:
        if word in flags:
            flag = word
        elif flag and _is_number(word):
            if found[-1] != flag:
                found.append(flag)
        else:
            flag = ""
        found.append(word)
    return found


def takes_list(kind: Any) -> bool:
    """Tell whether a type is a list of any length, or may be one."""
    if is_union(kind):
        return any(takes_list(one) for one in get_args(kind))
    return get_origin(kind) is list


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _help(stage: Stage) -> str:
    """Summary and meaning, up to the parameters, as paragraphs."""
    text = inspect.getdoc(stage.function) or ""
    return text.split("\nParameters\n---", 1)[0].strip()
