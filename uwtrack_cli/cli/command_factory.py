"""Commands made from the stages' own signatures, and from plain functions.

**Method.** A command is a function whose signature is computed: the inputs, the
stage's options with their help, and the options that every command shares. Typer
builds the rest, so a command can have no default of its own.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer
from typer.core import TyperCommand
from typer.models import ParameterInfo

from uwtrack_cli.cli.console import guard, set_verbosity
from uwtrack_cli.data.options import convert, is_union, makes_rungs, plain_type, range_of
from uwtrack_cli.files.input_ledger import input_ledger
from uwtrack_cli.flow.stage import Option, Stage, parameter_texts

GENERAL, EXPERT = "General options", "Expert options"
"""Titles of the panels that come last."""

RARE = frozenset({
    "above_design", "cells_per_octave", "decimation", "dipole_noise_ratio",
    "kept_probability", "largest_share", "least_highest_hz", "loading",
    "lowest_false_alarm", "max_pixels", "most_peaks", "overlap", "shading",
    "sidelobe_db", "snapshots", "weighting", "zero_padding",
})  # fmt: skip
"""Options of stages that few people need, beside those in groups of their own."""

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing output file.")]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="Output file; - is standard output.")
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON on standard output.")
]

ProductFile = Annotated[Path, typer.Argument(help="Result file; - is standard input.")]
Branch = Annotated[
    str | None,
    typer.Option(
        "--step", help="Step whose results are used, if several steps made the same table."
    ),
]

Axis = Annotated[
    str | None,
    typer.Option(
        "--axis", help="Rows of another axis of the table: row (motions), lobe (directions)."
    ),
]
NAMES = "Names of vessels"
Ais = Annotated[
    Path | None,
    typer.Option(
        "--ais", help="AIS table or log with the names of the vessels.", rich_help_panel=NAMES
    ),
]
WithinM = Annotated[
    float,
    typer.Option(help="Range in m within which AIS vessels are compared.", rich_help_panel=NAMES),
]


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


def documented(
    function: Callable[..., Any], panel: str | None = None, flags: Mapping[str, str] | None = None
) -> list[inspect.Parameter]:
    """Return the parameters of a command with what its docstring says of each.

    Positional parameters are arguments, and keyword-only ones are options.

    ``function``: a command; or a dataclass of options that several commands share.
    ``panel``: title under which the help lists them. ``flags``: flags that are not called
    like their options.
    """
    texts, named = parameter_texts(function), flags or {}
    is_set = isinstance(function, type)
    return [
        parameter(
            one.name, one.annotation, one.default, texts[one.name], panel=panel,
            flag=named.get(one.name),
            is_argument=not is_set and one.kind is one.POSITIONAL_OR_KEYWORD,
        )
        if one.name in texts else one
        for one in inspect.signature(function).parameters.values()
    ]  # fmt: skip


def parameter(
    name: str,
    hint: Any,
    default: Any,
    text: str,
    *,
    panel: str | None = None,
    flag: str | None = None,
    is_argument: bool = False,
) -> inspect.Parameter:
    """Return a parameter of a command: an option, or an argument.

    ``hint``: its type, with unit, range and Typer's own facts, if any. ``text``: what the
    help says. ``panel``: title under which it stands. ``flag``: its flag, if that is not
    its name.
    """
    given = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    kind = plain_type(hint)
    named = [flag or flag_of(name)] if flag or kind is bool else []
    (info,) = [copy(one) for one in given if isinstance(one, ParameterInfo)] or [
        typer.Argument() if is_argument else typer.Option(*named)
    ]
    info.help = Option(name, hint, default, text).help
    if panel is not None:
        info.rich_help_panel = panel
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info]
    )


def flag_of(name: str) -> str:
    """Return the flag of an option: ``--every-s`` of ``every_s``."""
    return f"--{name.replace('_', '-')}"


def checked_values(function: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a command, those with a range held to it.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    hints = inspect.signature(function).parameters
    return {
        name: convert(flag_of(name), hints[name].annotation, value)
        if name in hints and range_of(hints[name].annotation)
        else value
        for name, value in values.items()
    }


SHARED = [
    parameter(
        "quiet", Annotated[bool, typer.Option("--quiet", "-q")], False,
        "Say nothing but errors.", panel=GENERAL,
    ),
    parameter(
        "verbose", Annotated[bool, typer.Option("--verbose", "-v")], False,
        "Say more about what is done.", panel=GENERAL,
    ),
    parameter("debug", bool, False, "Show the traceback of an error.", panel=GENERAL),
]  # fmt: skip
"""Options of every command."""


def register(app: typer.Typer, name: str, function: Callable[..., None]) -> None:
    """Make a function a command with the shared options and error handling."""
    parameters = [*documented(function), *SHARED]

    def run(**values: Any) -> None:
        quiet, verbose, debug = (bool(values.pop(p.name)) for p in SHARED)
        if quiet or verbose:
            set_verbosity(-1 if quiet else 1)
        with guard(debug=debug), input_ledger():
            function(**checked_values(function, values))

    run.__doc__ = flowing(_help(function))
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    app.command(name, cls=PlainCommand)(run)


def with_parameters(
    extra: Sequence[inspect.Parameter],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a function that takes ``**options`` named parameters instead."""

    def named(function: Callable[..., None]) -> Callable[..., None]:
        own = [
            p
            for p in inspect.signature(function).parameters.values()
            if p.kind is not inspect.Parameter.VAR_KEYWORD
        ]
        function.__signature__ = inspect.Signature([*own, *extra])  # type: ignore[attr-defined]
        return function

    return named


def flowing(text: str) -> str:
    """Return paragraphs without line breaks, for a screen of any width."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(part.split()) for part in paragraphs)


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

    run.__doc__ = _help(stage.function)
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
    kind, default = option.type, option.default
    if makes_rungs(option.hint):
        kind, default = list[kind], [default]  # type: ignore[valid-type]
    info = typer.Option(help=option.help, rich_help_panel=panel)
    return inspect.Parameter(
        option.flat_name, inspect.Parameter.KEYWORD_ONLY, default=default,
        annotation=Annotated[kind, info],
    )  # fmt: skip


def spread_values(stage: Stage, words: Sequence[str]) -> list[str]:
    """Let an option that takes a list be followed by all its values.

    ``--start-velocity 50 -50`` becomes ``--start-velocity 50 --start-velocity -50``.
    """
    flags = {
        flag_of(option.flat_name)
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


def _help(function: Callable[..., Any]) -> str:
    """Summary and meaning, up to the parameters, as paragraphs."""
    text = inspect.getdoc(function) or ""
    return text.split("\nParameters\n---", 1)[0].strip()
