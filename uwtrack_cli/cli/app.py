"""The program: every command, in the order of the chain."""

from typing import Annotated

import typer

from uwtrack_cli import __version__
from uwtrack_cli.cli import (
    chain_commands,
    file_commands,
    run_commands,
    sample_commands,
)
from uwtrack_cli.cli.screen import say, set_verbosity

app = typer.Typer(
    name="uwtrack",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"uwtrack {__version__}")
        raise typer.Exit


@app.callback()
def program(
    *,
    version: Annotated[  # noqa: ARG001 - the callback acts on it
        bool,
        typer.Option("--version", callback=_print_version, help="Print the version."),
    ] = False,
    verbose: Annotated[
        int, typer.Option("--verbose", "-v", count=True, help="Say more.")
    ] = 0,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")
    ] = False,
) -> None:
    """Turn hydrophone recordings into vessel tracks.

    The whole chain in one pass: uwtrack run pass.wav. Try it: uwtrack sample pass,
    then uwtrack run pass.wav, uwtrack plot pass.run.h5 -o pass.png.
    """
    set_verbosity(-1 if quiet else verbose)
    say("details are shown", 2)


run_commands.register(app)
chain_commands.register(app)
file_commands.register(app)
sample_commands.register(app)
