"""Which changes of the code no test notices: a sample of mutations, one at a time.

Each mutation changes one place: an arithmetic or comparing operator, a number, a
condition, or an argument given by name. The changed module replaces its original in a
copy of the project, and the test files nearest to it in the graph of imports are run,
the nearest first, until one fails (the mutation is *killed*) or the time is spent (it
*survives*). Survivors are read by a person: some change nothing that can be observed.

``python -m tests.mutations lines motion --count 40 --seed 1`` prints one line for each
mutation and the number that survived.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "uwtrack_cli"
SECONDS = 240.0
"""Time for the tests of one mutation, unless told."""

ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
}  # fmt: skip
COMPARISONS = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


def places_of(tree: ast.Module) -> list[int]:
    """Return the nodes of a module that can be changed, by their number in a walk."""
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for statement in function.body
        for node in ast.walk(statement)
    }
    return [
        index
        for index, node in enumerate(ast.walk(tree))
        if id(node) in inside and not _is_of_a_message(node) and _change(node)
    ]


def mutated(text: str, index: int) -> tuple[int, str, str]:
    """Return the line of a node, what becomes of it, and the changed module's text."""
    tree = ast.parse(text)
    node = next(n for k, n in enumerate(ast.walk(tree)) if k == index)
    before = ast.unparse(node)
    change = _change(node)
    assert change is not None
    change(node)
    return node.lineno, f"{before} -> {ast.unparse(node)}", ast.unparse(tree)


def _is_of_a_message(node: ast.AST) -> bool:
    return isinstance(node, ast.BinOp) and any(
        isinstance(part, ast.JoinedStr)
        or (isinstance(part, ast.Constant) and isinstance(part.value, str))
        for part in ast.walk(node)
    )


def _change(node: ast.AST) -> Callable[[ast.AST], object] | None:
    change: Callable[[ast.AST], object] | None = None
    match node:
        case ast.BinOp() if type(node.op) in ARITHMETIC:
            change = partial(_set, name="op", value=ARITHMETIC[type(node.op)]())
        case ast.Compare() if type(node.ops[0]) in COMPARISONS:
            other = COMPARISONS[type(node.ops[0])]()
            change = partial(_set, name="ops", value=[other, *node.ops[1:]])
        case ast.BoolOp():
            other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            change = partial(_set, name="op", value=other)
        case ast.Constant(value=bool()):
            change = partial(_set, name="value", value=not node.value)
        case ast.Constant(value=float()):
            change = partial(_set, name="value", value=2.0 * node.value + 1.0)
        case ast.Call() if node.keywords and node.keywords[0].arg:
            change = partial(_set, name="keywords", value=node.keywords[1:])
    return change


def _set(node: ast.AST, *, name: str, value: object) -> None:
    setattr(node, name, value)


def nearest_tests(module: str) -> list[Path]:
    """Return the test files that lead to a module, the fewest imports away first."""
    users: dict[str, set[str]] = defaultdict(set)
    places = {}
    for path in [*ROOT.glob(f"{PACKAGE}/**/*.py"), *ROOT.glob("tests/**/*.py")]:
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        places[name.removesuffix(".__init__")] = path
    for name, path in places.items():
        for used in _modules_used(path):
            users[used].add(name)
    near, seen = [module], {module}
    for name in near:
        for user in sorted(users[name] - seen):
            seen.add(user)
            near.append(user)
    return [places[n] for n in near if n.rpartition(".")[2].startswith("test_")]


def _modules_used(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.ImportFrom(module=str(module), names=names):
                yield module
                yield from (f"{module}.{alias.name}" for alias in names)
            case ast.Constant(value=str(text)) if text.startswith(f"{PACKAGE}."):
                yield text.partition(":")[0]  # a stage, loaded when it is wanted
            case ast.Constant(value=str(text)) if "_commands:" in text:
                yield f"{PACKAGE}.cli.{text.partition(':')[0]}"


def survives(copy_of: Path, module: str, seconds: float) -> tuple[bool, str]:
    """Run the tests nearest to a module in a copy; tell whether none failed."""
    room = f"tests/{module.split('.')[1]}/"
    tests = [str(path.relative_to(ROOT)) for path in nearest_tests(module)]
    tests = [t for t in tests if "benchmarks" not in t and "stress" not in t]
    word = module.rpartition(".")[2]
    tests.sort(key=lambda t: word not in (ROOT / t).read_text())
    tests.sort(key=lambda t: not t.startswith(room))  # stable: nearest first
    tests.sort(key=lambda t: module not in _modules_used(ROOT / t))
    stop = time.monotonic() + seconds
    environment = dict(os.environ, PYTHONPATH=str(copy_of), OPENBLAS_NUM_THREADS="1")
    for count, test in enumerate(tests):
        left = stop - time.monotonic()
        if left <= 0.0:
            return True, f"after {count} of {len(tests)} files"
        command = [sys.executable, "-m", "pytest", "-x", "-q", test]
        options = ["-p", "no:cacheprovider", "--timeout", "120"]
        try:
            run = subprocess.run(
                [*command, *options], cwd=copy_of, env=environment,
                capture_output=True, timeout=left, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            continue
        if run.returncode not in (0, 5):
            return False, test
    return True, f"all {len(tests)} files"


def main(folders: list[str], count: int, seed: int, seconds: float) -> None:
    """Draw mutations over folders, try each, and print what became of it."""
    modules = [p for f in folders for p in sorted(ROOT.glob(f"{PACKAGE}/{f}/**/*.py"))]
    possible = [(p, k) for p in modules for k in places_of(ast.parse(p.read_text()))]
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        copy_of = Path(folder) / "project"
        shutil.copytree(ROOT, copy_of, ignore=shutil.ignore_patterns(".venv", ".git"))
        for path, index in random.Random(seed).sample(possible, count):
            line, words, text = mutated(path.read_text(), index)
            own = copy_of / path.relative_to(ROOT)
            own.write_text(text)
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            alive, where = survives(copy_of, name, seconds)
            shutil.copy(path, own)
            survivors += alive
            fate = "SURVIVES" if alive else "killed"
            print(f"{fate} {name}:{line} {words} ({where})", flush=True)
    print(f"{survivors} of {count} survive, of {len(possible)} possible.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", help="rooms, such as lines motion")
    parser.add_argument("--count", type=int, default=40, help="mutations to draw")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="time for each")
    told = parser.parse_args()
    main(told.folders, told.count, told.seed, told.seconds)
