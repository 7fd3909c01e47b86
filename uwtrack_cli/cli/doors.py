"""Commands made from the stages' own signatures, and from plain functions.

**Method.** A command is a function whose signature is computed: the inputs, the
stage's options with their help, and the options that every command shares. Typer
builds the rest, so a command can have no default of its own.
"""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from uwtrack_cli.cli.screen import guard, set_verbosity
from uwtrack_cli.flow.options import Option
from uwtrack_cli.flow.stage import Stage

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say more about what is done.")
]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
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

SHARED: dict[str, Any] = {"quiet": Quiet, "verbose": Verbose, "debug": Debug}
"""Options of every command."""


def command(app: typer.Typer, name: str) -> Callable[[Callable[..., None]], None]:
    """Register a function as a command with the shared options and error handling."""

    def register(function: Callable[..., None]) -> None:
        signature = inspect.signature(function)
        parameters = [*signature.parameters.values(), *map(_flag, SHARED)]

        def run(**values: Any) -> None:
            quiet, verbose, debug = (bool(values.pop(shared)) for shared in SHARED)
            if quiet or verbose:
                set_verbosity(-1 if quiet else 1)
            with guard(debug=debug):
                function(**values)

        run.__doc__ = flowing(function.__doc__ or "")
        run.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=parameters
        )
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        app.command(name)(run)

    return register


def flowing(text: str) -> str:
    """Return paragraphs without line breaks, for a screen of any width."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(part.split()) for part in paragraphs)


def _flag(name: str) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=SHARED[name]
    )


def stage_command(
    app: typer.Typer,
    stage: Stage,
    body: Callable[[Mapping[str, Any], dict[str, Any]], None],
    own: list[inspect.Parameter],
) -> None:
    """Register the command of a stage.

    Parameters
    ----------
    app
        The program.
    stage
        The stage; its options become the command's.
    body
        Called with the command's own parameters and the bound options.
    own
        Parameters of the command beside the stage's options.
    """
    flat = [_parameter(option) for option in stage.options]

    def run(**values: Any) -> None:
        given = {n: values.pop(n) for n in [p.name for p in flat]}
        body(values, nest(stage, given))

    run.__doc__ = _help(stage)
    run.__signature__ = inspect.Signature([*own, *flat])  # type: ignore[attr-defined]
    command(app, stage.name)(run)


def nest(stage: Stage, flat: Mapping[str, Any]) -> dict[str, Any]:
    """Turn the flat options of a command into the stage's own, policies nested."""
    options: dict[str, Any] = {}
    for option in stage.options:
        value = flat[option.flat_name]
        if option.owner is None:
            options[option.name] = value
        else:
            options.setdefault(option.owner, {})[option.name] = value
    return stage.bind(options)


def _parameter(option: Option) -> inspect.Parameter:
    return inspect.Parameter(
        option.flat_name,
        inspect.Parameter.KEYWORD_ONLY,
        default=option.default,
        annotation=Annotated[option.type, typer.Option(help=option.help)],
    )


def _help(stage: Stage) -> str:
    """Summary and meaning, up to the parameters, as paragraphs."""
    text = inspect.getdoc(stage.function) or ""
    return text.split("\nParameters\n---", 1)[0].strip()
