"""Sentences for command lines that cannot be understood.

**Method.** What the parser of the command line refuses is said again in one sentence:
what is wrong, with the value as it was typed, what is accepted, and where to look. An
option that belongs to a stage of a recipe is told in the form in which `--set` takes it.
"""

import difflib
from collections.abc import Collection, Sequence
from typing import Any

from uwtrack_cli.cli.command_factory import flag_of
from uwtrack_cli.flow.catalogue import STAGES

OF_RECIPES = ("run", "batch", "watch")
"""Commands that run recipes: options of stages reach them by `--set`."""

KINDS = {"a valid integer": "a whole number", "a valid number": "a number"}
"""What a value must be, as the parser says it and in words."""

COUNTS = {2: "two", 3: "three", 4: "four"}
"""Numbers of values of an option, in words."""


def usage_sentence(error: Any, words: Sequence[str], commands: Collection[str]) -> str:
    """Return what is wrong with a command line, in one sentence.

    ``error``: what the parser raised: an error with a message, and often the parameter.
    ``commands``: names of all commands.
    """
    name = words[0] if words and words[0] in commands else ""
    param = getattr(error, "param", None)
    if getattr(error, "option_name", None) and hasattr(error, "possibilities"):
        text = _unknown_option(error, name, words)
    elif param is not None and type(error).__name__ == "MissingParameter":
        text = f"{_named(param)} is missing: {_help_of(error)}"
    elif param is not None:
        text = _wrong_value(error, param, words)
    elif getattr(error, "option_name", None) and "arguments" in str(error.message):
        text = _too_few(str(error.option_name), str(error.message), words)
    else:
        text = f"{str(error.format_message()).rstrip('.')}."
    if name and "uwtrack help" not in text:
        text += f" See uwtrack help {name}."
    return text


def _named(param: Any) -> str:
    flags = [flag for flag in param.opts if flag.startswith("--")]
    return flags[0] if flags else str(param.name).upper()


def _help_of(error: Any) -> str:
    """Return what a parameter is that was left out, from its own help."""
    text = str(error.param.help or "it is needed").rstrip(".")
    _, found, choices = str(error.format_message()).partition("Choose from:")
    if found:
        text += f" ({' '.join(choices.split())})"
    return text + "."


def _wrong_value(error: Any, param: Any, words: Sequence[str]) -> str:
    """Say what a value must be, and what was given."""
    told = str(error.message).removeprefix("Value error, ").rstrip(".")
    given = _given(param.opts, words)
    got = "" if given is None else f", got {given!r}"
    if param.nargs > 1:
        return _many_numbers(_named(param), param.nargs, got)
    for kind, word in KINDS.items():
        if kind in told:
            return f"{_named(param)} must be {word}{got}."
    _, found, choices = told.partition(" is not one of ")
    if found:
        return f"{_named(param)} must be one of {choices.replace(chr(39), '')}{got}."
    return f"{_named(param)} cannot be used: {told}{got}."


def _too_few(option: str, told: str, words: Sequence[str]) -> str:
    """Say how many numbers an option takes whose words end before."""
    count = next(int(word) for word in told.split() if word.isdigit())
    given = _given([option], words)
    return _many_numbers(option, count, f", got {given!r}" if given else "")


def _many_numbers(option: str, count: int, got: str) -> str:
    words = COUNTS.get(count, str(count))
    return f"{option} takes {words} numbers with spaces between them{got}."


def _given(options: Sequence[str], words: Sequence[str]) -> str | None:
    """Return the value that a command line gives an option, as it was typed."""
    for word, after in zip(words, [*words[1:], ""], strict=True):
        flag, sign, value = word.partition("=")
        if word in options:
            return after
        if sign and flag in options:
            return value
    return None


def _unknown_option(error: Any, name: str, words: Sequence[str]) -> str:
    """Name an option that a command does not have, and what may be meant."""
    option = str(error.option_name)
    text = f"{name or 'uwtrack'} has no option {option}."
    step = _stage_with(option) if name in OF_RECIPES else None
    if step is not None:
        value = _values_after(option, words)
        return f"{text} It is an option of a step: --set {step}={value}."
    near = list(error.possibilities or ())
    near = difflib.get_close_matches(option, near, 2) or sorted(near)
    return text + (f" Did you mean {' or '.join(near)}?" if near else "")


def _stage_with(option: str) -> str | None:
    """Return the first stage's option of a name, as `--set` names it."""
    from uwtrack_cli.flow.catalogue import find_stage

    for name in STAGES:
        for one in find_stage(name).options:
            if option == flag_of(one.flat_name):
                group = "" if one.group is None else f"{one.group}."
                return f"{name}.{group}{one.name}"
    return None


def _values_after(option: str, words: Sequence[str]) -> str:
    """Return the values that follow an option, as `--set` takes them."""
    if option not in words:
        return "VALUE"
    values: list[str] = []
    for word in words[words.index(option) + 1 :]:
        try:
            float(word)
        except ValueError:
            break
        values.append(word)
    if len(values) > 1:
        return f"[{','.join(values)}]"
    return values[0] if values else "VALUE"
