"""`study`: a paper's experiment again, its figures beside ours."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Annotated

import uwtrack_cli
from uwtrack_cli.cli.command_factory import AsJson
from uwtrack_cli.cli.console import put, say
from uwtrack_cli.data.options import AtLeast, AtMost, nearest
from uwtrack_cli.data.study import Study
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.flow.catalogue import summary_of

MAX_RUNS = 1_000_000
"""Most runs of a study; it would take weeks."""


def study(
    name: str | None = None,
    *,
    runs: Annotated[int | None, AtLeast(1), AtMost(MAX_RUNS)] = None,
    seed: int = 1,
    json_output: AsJson = False,
) -> None:
    """Repeat a published experiment, and compare the published figures with ours.

    The experiments come with a clone of the project, not with the installed program.
    Intervals shrink with the root of the number of runs. Every random number comes from
    the seed.

    Parameters
    ----------
    name
        The study to repeat; without it, all are listed.
    runs
        Simulated runs per case; unless given, as many as take minutes.
    seed
        Seed of the simulation.
    """
    studies = _catalogue()
    if name is None:
        if runs is not None or json_output:
            raise OptionError(f"name the study to repeat: {', '.join(studies)}.")
        width = max(map(len, studies))
        put(f"{key:{width}}  {summary_of(place)}" for key, place in studies.items())
        return
    if name not in studies:
        near = nearest(name, studies)
        raise OptionError(f"there is no study {name!r}.{near} There are {', '.join(studies)}.")
    module, _, function = studies[name].partition(":")
    chosen = {} if runs is None else {"runs": runs}
    done: Study = getattr(import_module(module), function)(seed=seed, **chosen)
    if json_output:
        put([json.dumps(asdict(done), ensure_ascii=False)])
        return
    put(_lines(done))
    for remark in done.remarks:
        say(remark)


def _catalogue() -> dict[str, str]:
    """Return where the function of each study is, from the folder beside the package.

    Raises
    ------
    DataError
        The program runs without a checkout of the project.
    """
    checkout = Path(uwtrack_cli.__file__).resolve().parent.parent
    if not (checkout / "studies" / "catalogue.py").is_file():
        raise DataError(
            "the published experiments are not part of the installed program: clone the "
            "project, 'make install' there, then '.venv/bin/uwtrack study'."
        )
    if str(checkout) not in sys.path:
        sys.path.append(str(checkout))
    studies: dict[str, str] = import_module("studies.catalogue").STUDIES
    return studies


def _lines(done: Study) -> Iterator[str]:
    yield f"{done.name}: {done.source}; {done.runs} runs, seed {done.seed}"
    cases = max((len(row.case) for row in done.rows), default=4)
    names = max((len(row.quantity) for row in done.rows), default=8)
    yield (
        f"{'case':{cases}}  {'quantity':{names}}  {'reference':>9}  {'ours':>9}"
        f"  {'95 % interval':>18}"
    )
    for row in done.rows:
        reference = "-" if row.reference is None else f"{row.reference:.4g}"
        interval = f"{_short(row.low)} to {_short(row.high)}"
        yield (
            f"{row.case:{cases}}  {row.quantity:{names}}  {reference:>9}"
            f"  {row.ours:>9.4g}  {interval:>18}"
        )


def _short(value: float) -> str:
    """Write an end of an interval in eight characters at most."""
    if 1e3 <= abs(value) < 1e7:
        return f"{value:.0f}"
    return f"{value:.2g}" if abs(value) < 1e-2 else f"{value:.3g}"
