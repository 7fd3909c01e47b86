"""Commands made from the stages' own signatures, and from plain functions.

**Method.** A command is a function whose signature is computed: the inputs, the
stage's options with their help, and the options that every command shares. Typer
builds the rest, so a command can have no default of its own.
"""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_origin

import typer

from uwtrack_cli.cli.screen import guard, set_verbosity
from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.stage import Option, Stage

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

        run.__doc__ = function.__doc__
        run.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=parameters
        )
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        app.command(name)(run)

    return register


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
    parameters = {_flat_name(option): option for option in stage.options}
    flat = [_parameter(name, option) for name, option in parameters.items()]
    flat += [_policy_choice(n, c) for n, c in _choices(stage).items()]

    def run(**values: Any) -> None:
        given = {n: values.pop(n) for n in [p.name for p in flat]}
        body(values, nest(stage, given))

    run.__doc__ = _help(stage)
    run.__signature__ = inspect.Signature([*own, *flat])  # type: ignore[attr-defined]
    command(app, stage.name)(run)


def nest(stage: Stage, flat: Mapping[str, Any]) -> dict[str, Any]:
    """Turn the flat options of a command into the stage's own, policies nested.

    Raises
    ------
    OptionError
        An option belongs to a policy that was not chosen.
    """
    options: dict[str, Any] = {}
    for option in stage.options:
        value = flat[_flat_name(option)]
        if option.owner is None:
            options[option.name] = value
            continue
        table = options.setdefault(option.owner, {})
        if option.choice is None:
            table[option.name] = value
            continue
        chosen = flat[option.owner]
        table["kind"] = chosen
        if option.choice == chosen and value is not None:
            table[option.name] = value
        elif value is not None and not _is_shared(stage, option, chosen):
            flag = "--" + _flat_name(option).replace("_", "-")
            msg = (
                f"{flag} goes with --{option.owner.replace('_', '-')} {option.choice}."
            )
            raise OptionError(msg)
    return stage.bind(options)


def _is_shared(stage: Stage, option: Option, chosen: str) -> bool:
    return any(
        other.owner == option.owner
        and other.choice == chosen
        and other.name == option.name
        for other in stage.options
    )


def _flat_name(option: Option) -> str:
    return option.name if option.owner is None else f"{option.owner}_{option.name}"


def _choices(stage: Stage) -> dict[str, tuple[list[str], str]]:
    """Policies of several classes: the class names and the default one."""
    found: dict[str, tuple[list[str], str]] = {}
    for option in stage.options:
        if option.owner is not None and option.choice is not None:
            default = type(stage.defaults[option.owner]).__name__
            names, _ = found.setdefault(option.owner, ([], default))
            if option.choice not in names:
                names.append(option.choice)
    return found


def _policy_choice(owner: str, choices: tuple[list[str], str]) -> inspect.Parameter:
    names, default = choices
    hint: Any = Literal[tuple(names)]
    text = f"Which policy: {' or '.join(names)}."
    return _keyword(owner, Annotated[hint, typer.Option(help=text)], default)


def _parameter(name: str, option: Option) -> inspect.Parameter:
    hint, default, text = option.type, option.default, option.help
    if option.choice is not None:  # None is "not given": it may not be meant
        text = f"{text} [{option.choice}: {default}]"
        hint, default = hint | None, None
    if get_origin(hint) is list and default is None:
        default = []
    return _keyword(name, Annotated[hint, typer.Option(help=text)], default)


def _keyword(name: str, hint: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint
    )


def _help(stage: Stage) -> str:
    """Summary and meaning, up to the parameters, as paragraphs."""
    text = inspect.getdoc(stage.function) or ""
    return text.split("\nParameters\n---", 1)[0].strip()
