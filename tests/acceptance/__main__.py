"""What the program can do, run and held against what is frozen.

``python -m tests.acceptance check [PART ...]`` runs what is frozen of parts (all unless
named) and compares; 1 is red. ``run -o FOLDER`` stores what comes out, ``compare FOLDER`` holds a
folder against what is frozen, or with ``--exact`` against another folder to 1e-9 (pure
moves of code: a run of the commit before, and one after). ``freeze`` runs and
makes that the frozen state, with the tables of tests/baselines; with ``--from FOLDER``
it takes a run that is there. ``list`` names parts and cases, ``faults`` plants
deliberate faults and shows that each is seen. The part ``slow`` of ``check`` is no part with
cases: it is the tests of the suite that `make test` leaves out, since they take longer.
"""

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tests.acceptance.comparison import differences, exact
from tests.acceptance.parts import PARTS
from tests.acceptance.rates import held
from tests.acceptance.running import FROZEN, Results, load, load_all, run_all, store
from tests.acceptance.tables_of_figures import write_tables

SLOW = "slow"
"""Marker of the tests that `make test` leaves out, and name of their part."""


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def run_parts(
    given: argparse.Namespace, folder: Path | None, *, only_frozen: bool = False
) -> Results:
    """Run the cases of parts, say what each costs, and store them."""
    parts = parts_of(given)
    cases = {
        (part, name): case
        for part in parts
        for name, case in PARTS[part]().items()
        if given.cases in name and (not only_frozen or name in load(FROZEN, part)["cases"])
    }
    results: Results = {part: {} for part in parts}
    begin = time.monotonic()
    ran = enumerate(run_all(cases, given.processes), start=1)
    for number, ((part, name), one) in ran:
        results[part][name] = one
        say(
            f"[{number}/{len(cases)} {time.monotonic() - begin:.0f} s] {part}: {name}: "
            f"{one['cost']['cpu']:.0f} references, {one['cost']['memory_mb']} MB"
            + (f"; {one['failed']}" if "failed" in one else "")
        )
        if folder is not None:
            store(folder, part, results[part])
    for part, ones in results.items():
        total = sum(one["cost"]["cpu"] for one in ones.values())
        say(f"cost of {part}: {total:.0f} references")
    return results


def compare(results: Results, pattern: str = "") -> int:
    """Say what is worse than frozen, and return 1 if anything is.

    Rates are held over parts of which every case is frozen.
    """
    red, whole = [], []
    for part, cases in results.items():
        frozen = load(FROZEN, part)["cases"]
        if not PARTS[part]():
            say(f"{part}: no case can be run here (UWTRACK_REAL_DATA is not set)")
            continue
        named = {name: one for name, one in frozen.items() if pattern in name}
        red += [f"{part}: {words}" for words in differences(named, cases)]
        new = set(PARTS[part]()) - set(frozen)
        if new:
            say(f"{part}: {len(new)} cases are not frozen yet")
        elif not pattern:
            whole.append(part)
    red += [f"rate: {words}" for words in held(results, whole)]
    for words in red:
        say(f"RED {words}")
    total = sum(map(len, results.values()))
    say(f"{len(red)} red in {total} cases of {', '.join(results)}")
    return int(bool(red))


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    made = argparse.ArgumentParser(
        "python -m tests.acceptance", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    made.add_argument("command", choices=COMMANDS)
    made.add_argument("names", nargs="*", help="parts, or for compare folders")
    made.add_argument("--processes", type=int, default=2)
    made.add_argument("--cases", default="", help="only cases whose name holds this")
    made.add_argument("--exact", action="store_true", help="compare to 1e-9")
    made.add_argument("--from", dest="source", type=Path, help="folder to freeze")
    made.add_argument("-o", "--output", type=Path, help="folder for what came out")
    return made


def parts_of(given: argparse.Namespace) -> list[str]:
    """Return the parts that are asked for."""
    for part in given.names:
        if part not in PARTS:
            parser().error(f"no part {part!r}; there are {', '.join(PARTS)}")
    return given.names or list(PARTS)


def list_cases(given: argparse.Namespace) -> int:
    """Name parts and cases."""
    for part in parts_of(given):
        say(f"{part}: {', '.join(PARTS[part]())}")
    return 0


def run(given: argparse.Namespace) -> int:
    """Run parts and store what comes out."""
    run_parts(given, given.output)
    return 0


def check(given: argparse.Namespace) -> int:
    """Run what is frozen, and hold it against that; and the slow tests of the suite."""
    is_slow = SLOW in given.names or not given.names
    status = _slow_tests(given.processes) if is_slow else 0
    is_alone = given.names == [SLOW]
    given.names = [name for name in given.names if name != SLOW]
    if is_alone:
        return status
    results = run_parts(given, given.output, only_frozen=True)
    return compare(results, given.cases) or status


def _slow_tests(processes: int) -> int:
    """Run the tests that `make test` leaves out, and return 1 if one fails."""
    words = ["-m", "pytest", "-m", SLOW, "--numprocesses", str(processes)]
    done = subprocess.run([sys.executable, *words, "--dist", "worksteal"], check=False)
    say(f"{'red' if done.returncode else 'green'}: slow tests of the suite")
    return int(done.returncode != 0)


def compare_folders(given: argparse.Namespace) -> int:
    """Hold a stored run against what is frozen, or against another one to 1e-9."""
    one, *other = map(Path, given.names)
    stored = [part for part in PARTS if (one / f"{part}.json").exists()]
    results = load_all(one, stored)
    if not given.exact:
        return compare(results, given.cases)
    second = load_all(other[0], stored)
    found = [w for part in stored for w in exact(results[part], second[part], part)]
    for words in found:
        say(f"DIFFERS {words}")
    say(f"{len(found)} differences in {', '.join(stored)}")
    return int(bool(found))


def freeze(given: argparse.Namespace) -> int:
    """Make a run, or one that is stored, the frozen state, and write the tables."""
    if given.source:
        for part in parts_of(given):
            if (given.source / f"{part}.json").exists():
                shutil.copy(given.source / f"{part}.json", FROZEN)
    else:
        given.cases = ""
        run_parts(given, FROZEN)
    write_tables()
    return 0


def faults(given: argparse.Namespace) -> int:
    """Plant deliberate faults, and show which are seen."""
    from tests.acceptance.faults import plant

    return plant(given.names)


def long(given: argparse.Namespace) -> int:
    """Draw anew and hold the rates alone."""
    from tests.acceptance.long_rates import check_long

    return check_long(given.processes)


COMMANDS = {
    "list": list_cases, "run": run, "check": check, "compare": compare_folders,
    "freeze": freeze, "long": long, "faults": faults,
}  # fmt: skip


if __name__ == "__main__":
    told = parser().parse_args()
    sys.exit(COMMANDS[told.command](told))
