"""`run` on sound that is still coming: from a pipe, or from a file that grows.

**Conventions.** An interrupt, SIGTERM and SIGHUP end the sound, not the run: what is
open is finished, and the file is written. A second signal ends the run without a file.
"""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwtrack_cli.cli.command_factory import documented, flag_of
from uwtrack_cli.cli.console import put, say, say_wrote, signals_end
from uwtrack_cli.cli.result_output import say_sensitivity
from uwtrack_cli.cli.targets import PIPE, WANTED_TWICE, product_name, refuse_no_pipe, writer_for
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.recording import LiveSource, Recording
from uwtrack_cli.data.renamed import with_old_keys
from uwtrack_cli.errors import OptionError, warn
from uwtrack_cli.files.checks import is_pipe
from uwtrack_cli.files.text_escaping import shell_word

if TYPE_CHECKING:
    from uwtrack_cli.files.audio.live_recording import RawSound
    from uwtrack_cli.flow.products import Held
    from uwtrack_cli.flow.recipe import Recipe

IDLE_S = 60.0
"""A file that did not grow for so long is complete, unless --idle-s says otherwise."""


@dataclass(frozen=True)
class LiveOptions:
    """Options of `run` that only live sound has.

    Parameters
    ----------
    raw
        Sample format of sound without a header: s16le, s24le, f32le, ... (as ffmpeg).
    rate_hz
        Sample rate of --raw, Hz.
    channels
        Number of channels of --raw; by default 1.
    follow
        Read a file that is still being written.
    idle_s
        End after so many s without sound; by default 60 with --follow, else never.
    """

    raw: str | None = None
    rate_hz: float | None = None
    channels: int | None = None
    follow: bool = False
    idle_s: float | None = None

    def is_live(self, sources: Sequence[Path]) -> bool:
        """Tell whether sound is still coming.

        Raises
        ------
        OptionError
            There are several sources then, or an option that would be ignored.
        """
        pipes = [source for source in sources if is_pipe(source)]
        if not (pipes or self.follow):
            for name in ("raw", "rate_hz", "channels", "idle_s"):
                if getattr(self, name) is not None:
                    flag = flag_of(name)
                    raise OptionError(
                        f"{flag} is for sound that comes through a pipe, as in "
                        f"cat FILE | uwtrack run -, or for a file with --follow."
                    )
            return False
        if len(sources) > 1:
            raise OptionError(f"live sound is run alone, got {len(sources)} sources.")
        if self.follow and sources[0].is_dir():
            raise OptionError(
                f"--follow takes a file that is being written, and {sources[0]} is a "
                f"folder: uwtrack watch {shell_word(sources[0])} -o DIR runs what arrives in it."
            )
        if pipes and self.follow:
            raise OptionError(f"--follow is for a file, and {pipes[0]} is a pipe: leave it out.")
        return True

    def raw_sound(self) -> "RawSound | None":
        """Return what samples without a header are; None for sound with one.

        Raises
        ------
        OptionError
            The options do not go together.
        """
        from uwtrack_cli.files.audio.live_recording import RawSound

        if self.raw is None:
            if self.rate_hz is not None or self.channels is not None:
                raise OptionError(
                    "--rate-hz and --channels go with --raw FORMAT; a header has them."
                )
            return None
        if self.rate_hz is None:
            raise OptionError(
                f"--raw {self.raw} needs --rate-hz: there is no header with the rate."
            )
        return RawSound(self.raw, self.rate_hz, self.channels or 1)


LIVE_PARAMETERS = documented(LiveOptions, "Live sound")
"""Options of `run` for sound that is still coming."""


def live_target(source: Path, output: Path | None, *, as_json: bool) -> Path:
    """Return where the product of live sound goes: a pipe for a pipe, unless named.

    Raises
    ------
    OptionError
        Standard output is a terminal or closed, or is wanted twice.
    """
    target = output or (PIPE if is_pipe(source) else product_name(source, ".run.h5"))
    if target == PIPE and as_json:
        raise OptionError(WANTED_TWICE)
    if target == PIPE:
        refuse_no_pipe()
    return target


def run_live(
    source: Path,
    live: LiveOptions,
    source_options: Mapping[str, Any],
    recipe: "Recipe",
    keep: Sequence[type[Container]],
    target: Path,
    *,
    overwrite: bool,
    as_json: bool,
) -> "list[Held]":
    """Run a recipe over sound until it ends or a signal ends it.

    ``source``: standard input, a pipe, or a file that is being written. ``live``: what
    it is, and when it ends. ``keep``: passing containers that are written, too.

    Returned: the small containers of the product.
    """
    from uwtrack_cli.flow.products import run_into_product
    from uwtrack_cli.flow.sources import open_live_with_options

    idle_s = live.idle_s
    if live.follow and idle_s is None:
        idle_s = IDLE_S
    raw = live.raw_sound()
    with writer_for(target, overwrite=overwrite, inputs=[source]) as writer:
        recording = open_live_with_options(source, source_options, raw=raw, idle_s=idle_s)
        say(f"{recording.name}: live, {recording.sample_rate_hz:g} Hz", 1)
        reader = recording.reader
        assert isinstance(reader, LiveSource)  # noqa: S101 - it was opened so
        with signals_end(reader.end):
            made = run_into_product(
                recording, recipe, writer, keep=keep, tell=put_event if as_json else None
            )
    if not as_json:  # as events they were told
        say_disturbances(reader, recording)
    say_sensitivity([held.container for held in made])
    say_wrote(target)
    return made


def say_disturbances(reader: LiveSource, recording: Recording) -> None:
    """Warn of what disturbed the sound, the first of each kind; whole sound is told."""
    from uwtrack_cli.files.audio.live_reader import DisturbanceKind, DisturbedSource

    if not isinstance(reader, DisturbedSource):
        return
    found: dict[DisturbanceKind, list[str]] = {}
    for gap in reader.take_disturbances():
        told = gap.kind is DisturbanceKind.UNCHANGED  # by the reader, as of a file
        if gap.is_over and gap.n_samples < reader.n_samples and not told:
            rate_hz = recording.sample_rate_hz
            lasted = f" for {gap.n_samples / rate_hz:g} s" if gap.n_samples else ""
            text = f"{gap.reason}{lasted} at {gap.start_sample / rate_hz:g} s"
            found.setdefault(gap.kind, []).append(text)
    for first, *others in found.values():
        more = f", and {len(others)} times more" if others else ""
        warn(f"{recording.name}: {first}{more}.")


def put_event(event: Mapping[str, Any]) -> None:
    """Print an event as one line of JSON; what cannot take it does not end the run.

    A reader that is gone has no more to ask; a full disk or another failure is told,
    once, and the file is written all the same.
    """
    try:
        put([json.dumps(with_old_keys(event), ensure_ascii=False)])
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or error
            warn(f"events are no longer printed ({reason}); the file is written.")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
