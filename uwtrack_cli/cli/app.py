"""The program: every command, in the order of the chain.

**Method.** A command is imported when it is called; for the list of all commands only
the first line of its docstring is read. So `uwtrack --help` answers at once.
"""

import difflib
import itertools
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from uwtrack_cli import __version__
from uwtrack_cli.cli.console import USAGE, say, set_verbosity
from uwtrack_cli.data import renamed
from uwtrack_cli.flow.catalogue import STAGES, summary_of

CHAIN = (
    "spectrogram", "overview", "levels", "peaks", "classify", "track", "cpa", "locate",
    "presence",
)  # fmt: skip
"""Stages that every recipe has, in their order."""

ANALYSES = ("tma", "pdaf", "discriminate")
"""Stages that take tables instead of sound."""

GROUPS: dict[str, dict[str, str]] = {
    "The chain": {
        "run": "run_commands:run",
        "recipes": "run_commands:recipes",
        **dict.fromkeys(CHAIN, "chain_commands"),
    },
    "More steps for the chain": {
        name: "chain_commands" for name in STAGES if name not in {*CHAIN, *ANALYSES}
    },
    "Analyses": {
        **dict.fromkeys(ANALYSES, "chain_commands"),
        "forecast": "forecast_commands:forecast",
        "score": "score_commands:score",
        "calibrate": "calibrate_commands:calibrate",
        "study": "study_commands:study",
    },
    "Files": {
        "info": "file_commands:info",
        "show": "file_commands:show",
        "verify": "file_commands:verify",
        "diff": "score_commands:diff",
        "export": "file_commands:export",
        "rerun": "batch_commands:rerun",
        "init-sensor": "init_sensor_command:init_sensor",
        "difar": "difar_commands:difar",
        "sample": "sample_commands:sample",
        "simulate": "sample_commands:simulate",
    },
    "Folders": {"batch": "batch_commands:batch", "passages": "passages_commands:passages"},
    "Live": {"watch": "watch_commands:watch"},
    "Pictures": {"plot": "picture_commands:plot", "report": "picture_commands:report"},
    "Help": {"help": "app:explain"},
}
"""Commands by what they are for: module and function of each. That of a stage documents
itself."""

COMMANDS = {name: place for group in GROUPS.values() for name, place in group.items()}
"""Module and function of every command, in the order of the help."""


class CommandList(TyperGroup):
    """Lists the commands without importing them."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - Typer's signature
        """Return the names in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """Return what the list shows of a command: its name and summary."""
        if cmd_name not in COMMANDS:
            return None
        return TyperCommand(cmd_name, help=_summary(cmd_name))

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the commands group by group, each with its whole summary."""
        widest = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            with formatter.section(title):
                rows = [(name.ljust(widest), _summary(name)) for name in names]
                formatter.write_dl(rows)

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the program; what is wrong with a command line is one sentence.

        ``args``: words of the command line; those of the process if not given.
        ``options``: options of Typer's own function of this name.
        """
        given = args[0] if args else options.pop("args", None)
        words = sys.argv[1:] if given is None else list(given)
        if not words:
            given = words = ["--help"]
        try:
            code = super().main(given, **{**options, "standalone_mode": False})
        except Exception as error:
            if not hasattr(error, "format_message"):
                raise
            from uwtrack_cli.cli.usage_errors import usage_sentence

            say(f"error: {usage_sentence(error, words, COMMANDS)}", -1)
            code = USAGE
        sys.exit(code if isinstance(code, int) else 0)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is called, and import it."""
        args = _with_new_names(args)
        if args and args[0] in COMMANDS:
            found, words = load_command(args[0]), _words(*args)
            if not ctx.resilient_parsing:  # completion asks before all is typed
                _refuse_flags_as_values(found, words)
                _refuse_repeated(found, words)
            return args[0], found, words
        if args and not args[0].startswith("-") and not ctx.resilient_parsing:
            ctx.fail(_no_such_command(args[0]))
        return super().resolve_command(ctx, args)


def _with_new_names(words: Sequence[str]) -> list[str]:
    """Return words with the names that commands and options have now, and say so."""
    command = renamed.STAGES.get(words[0], words[0]) if words else ""
    found = [command, *words[1:]]
    for place, word in enumerate(found[1:], 1):
        flag, sign, value = word.partition("=")
        new = renamed.FLAGS.get((command, flag), flag)
        words_now = renamed.WORDS.get((command, new), {})
        found[place] = f"{new}{sign}{words_now.get(value, value)}"
        if not sign:
            words_now = renamed.WORDS.get((command, found[place - 1]), {})
            found[place] = words_now.get(word, found[place])
    for old, new in zip(words, found, strict=False):
        if old != new:
            say(f"warning: {old} is now called {new}; the old name goes in 0.4.")
    return found[: len(words)]


def _no_such_command(name: str) -> str:
    near = " or ".join(map(repr, difflib.get_close_matches(name, COMMANDS, 2)))
    nearest = f" Did you mean {near}?" if near else ""
    return f"There is no command {name!r}.{nearest} uwtrack help lists all."


def _summary(name: str) -> str:
    if name in STAGES:
        return summary_of(STAGES[name])
    return summary_of(f"uwtrack_cli.cli.{COMMANDS[name]}")


def _words(name: str, *words: str) -> list[str]:
    """Return the words after a command, the values of list options spread out."""
    if name not in STAGES:
        return list(words)
    from uwtrack_cli.cli.command_factory import spread_values
    from uwtrack_cli.flow.catalogue import find_stage

    return spread_values(find_stage(name), words)


def _refuse_repeated(found: Any, words: Sequence[str]) -> None:
    """Refuse a second value of an option that takes one: the first would be lost.

    Raises
    ------
    typer.Exit
        With the code of a usage error, after one sentence.
    """
    single = {
        flag: parameter.name
        for parameter in found.params
        for flag in parameter.opts
        if flag.startswith("-") and not (parameter.multiple or parameter.count)
        and not parameter.is_flag
    }  # fmt: skip
    given: dict[str, str] = {}
    for word in itertools.takewhile(lambda word: word != "--", words):
        flag = word.partition("=")[0] if word.startswith("--") else word
        name = single.get(flag)
        if name is None:
            continue
        if name in given:
            say(f"error: {flag} takes one value and is given twice.", -1)
            raise typer.Exit(USAGE)
        given[name] = flag


def _refuse_flags_as_values(found: Any, words: Sequence[str]) -> None:
    """Refuse an option where a value is missing: it would be taken for the value.

    Raises
    ------
    typer.Exit
        With the code of a usage error, after one sentence.
    """
    options = [p for p in found.params if p.param_type_name == "option"]
    flags = {flag for option in options for flag in option.opts}
    taking = {
        flag for option in options if not (option.is_flag or option.count) for flag in option.opts
    }
    before = itertools.takewhile(lambda word: word != "--", words)
    for flag, value in itertools.pairwise(before):
        if flag in taking and value in flags:
            say(f"error: {flag} takes a value, got the option {value}.", -1)
            raise typer.Exit(USAGE)


def load_command(name: str) -> Any:
    """Import the module of a command and build it."""
    from uwtrack_cli.cli.command_factory import register

    place, _, function = COMMANDS[name].partition(":")
    module = import_module(f"uwtrack_cli.cli.{place}")
    own = typer.Typer(rich_markup_mode=None)
    own.callback()(lambda: None)
    made = getattr(module, function) if function else module.stage_command(name)
    register(own, name, made)
    return typer.main.get_group(own).commands[name]


app = typer.Typer(
    name="uwtrack",
    cls=CommandList,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # what rich needs to draw boxes takes as long as all else
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
        bool, typer.Option("--version", callback=_print_version, help="Print the version.")
    ] = False,
    verbose: Annotated[int, typer.Option("--verbose", "-v", count=True, help="Say more.")] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
) -> None:
    """Turn hydrophone recordings into vessel tracks.

    Copy a recording to try it on: uwtrack sample pass

    Run the whole chain in one pass: uwtrack run pass.wav

    Draw what was found (with matplotlib): uwtrack plot pass.run.h5 -o pass.png
    """
    set_verbosity(-1 if quiet else verbose)


def explain(
    command: Annotated[
        str | None,
        typer.Argument(
            autocompletion=lambda incomplete: [
                name for name in COMMANDS if name.startswith(incomplete)
            ]
        ),
    ] = None,
) -> None:
    """Explain a command, or list all commands.

    Parameters
    ----------
    command
        Command to explain; by default all are listed.
    """
    app([*([] if command is None else [command]), "--help"], prog_name="uwtrack")
