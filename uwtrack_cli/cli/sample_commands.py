"""Commands that make recordings to try things on: sample and simulate."""

from pathlib import Path
from typing import Annotated

import typer

from uwtrack_cli.cli.command_factory import Overwrite
from uwtrack_cli.cli.console import put, say


def _samples(incomplete: str) -> list[str]:
    from uwtrack_cli.flow.shipped_recipes import sample_names

    return [name for name in sample_names() if name.startswith(incomplete)]


def simulate(
    scenario: Path,
    *,
    output: Annotated[Path, typer.Option("--output", "-o")],
    overwrite: Overwrite = False,
) -> None:
    """Simulate recordings with known truth: moving vessels, moving receivers, noise.

    Writes pass.wav, pass.sensor.toml and pass.truth.json.

    Parameters
    ----------
    scenario
        Scenario: a TOML file.
    output
        Recording to write: a WAV file.
    """
    from uwtrack_cli.flow.sample_recordings import read_scenario, write_simulation

    for path in write_simulation(read_scenario(scenario), output, overwrite=overwrite):
        say(f"wrote {path}")


def sample(
    name: Annotated[str | None, typer.Argument(autocompletion=_samples)] = None,
    *,
    folder: Annotated[Path, typer.Option("--output", "-o")] = Path(),
    overwrite: Overwrite = False,
) -> None:
    """Copy a sample recording with its sensor file and truth, or list the samples.

    Parameters
    ----------
    name
        Name of a sample; by default all are listed.
    folder
        Folder to copy it to.
    """
    from uwtrack_cli.flow.shipped_recipes import copy_sample, sample_texts

    if name is None:
        texts = sample_texts()
        width = max(map(len, texts))
        put(f"{name:{width}}  {text}".rstrip() for name, text in texts.items())
        return
    for path in copy_sample(name, folder, overwrite=overwrite):
        say(f"wrote {path}")
