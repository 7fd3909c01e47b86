"""Run cases, each in a process of its own, and store what came of them."""

import json
import multiprocessing
import subprocess
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tests.acceptance.costs import peak_mb, reference_s
from tests.acceptance.outcomes import Outcome

Case = Callable[[Path], Outcome]
Results = dict[str, dict[str, Outcome]]
"""Outcomes by part and case."""

FROZEN = Path(__file__).parent / "frozen"
"""The outcomes that hold."""


def outcome(case: Case) -> Outcome:
    """Run a case in a folder of its own; one that fails is an outcome, too."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        unit = reference_s()
        begin = time.process_time()
        try:
            made = case(Path(folder))
        except Exception as error:  # noqa: BLE001 - a case that fails is red, not an end
            traceback.print_exc()
            made = {"failed": f"{type(error).__name__}: {error}"}
        spent = (time.process_time() - begin) / unit
    made["cost"] = {"cpu": round(spent, 1), "memory_mb": round(peak_mb())}
    return made


_CASES: dict[tuple[str, str], Case] = {}
"""Cases of a run, for the processes that are forked from this one."""


def _numbered(key: tuple[str, str]) -> tuple[tuple[str, str], Outcome]:
    return key, outcome(_CASES[key])


def run_all(
    cases: Mapping[tuple[str, str], Case], processes: int
) -> Iterator[tuple[tuple[str, str], Outcome]]:
    """Yield the outcome of each case, by part and name, as soon as it is there.

    A process for each case tells its peak memory; without any (``processes`` = 0) all
    run here, as a test does that has threads.
    """
    if processes == 0:
        for key, case in cases.items():
            yield key, outcome(case)
        return
    commit()
    _CASES.clear()
    _CASES.update(cases)
    context = multiprocessing.get_context("fork")
    with context.Pool(processes, maxtasksperchild=1) as pool:
        yield from pool.imap_unordered(_numbered, list(cases), chunksize=1)


@cache
def commit() -> str:
    """Return the commit of the tree, with a plus where it was changed since.

    It is asked for before processes are forked: one that is forked while git is read
    holds the pipe's other end, and the pipe would not end.
    """
    words = ["git", "-C", str(FROZEN), "describe", "--always", "--dirty=+", "--exclude=*"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def store(folder: Path, part: str, cases: Mapping[str, Outcome]) -> None:
    """Write the outcomes of a part, one case a line."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(
        f"{json.dumps(name)}: {json.dumps(cases[name], default=float)}" for name in sorted(cases)
    )
    text = f'{{\n"part": {json.dumps(part)},\n"commit": {json.dumps(commit())},\n"cases": {{\n{lines}\n}}\n}}\n'
    (folder / f"{part}.json").write_text(text, encoding="utf-8")


def load(folder: Path, part: str) -> dict[str, Any]:
    """Return what is stored of a part: its commit and its cases."""
    path = folder / f"{part}.json"
    if not path.exists():
        return {"part": part, "commit": "", "cases": {}}
    return dict(json.loads(path.read_text(encoding="utf-8")))


def load_all(folder: Path, parts: Sequence[str]) -> Results:
    """Return the outcomes of parts that are stored."""
    return {part: load(folder, part)["cases"] for part in parts}
