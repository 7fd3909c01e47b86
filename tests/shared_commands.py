"""A program `uwtrack` that runs a costly command once, however many pages type it.

Pages of the documents begin alike: a sample is copied and run. A command of `COSTLY` with
the same words, over files with the same bytes and with the same files beside them, gives
the same files and words again, so what it gave the first time is copied. A command that
fails, reads standard input or would replace a file is always run.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

COSTLY = ("run", "batch", "simulate", "beamform", "demon", "tma", "plot", "report")

PROGRAM = """#!{python} -IS
import sys
sys.path.insert(0, {root!r})
from tests.shared_commands import main
main({program!r}, {kept!r})
"""


def write_program(folder: Path, program: Path, root: Path) -> Path:
    """Write the program into a folder, and return that folder.

    ``program``: the program that runs the commands. ``root``: folder of the tests.
    """
    kept = folder / "kept"
    kept.mkdir()
    path = folder / "bin" / "uwtrack"
    path.parent.mkdir()
    path.write_text(
        PROGRAM.format(python=sys.executable, root=str(root), program=str(program), kept=str(kept))
    )
    path.chmod(0o755)
    return path.parent


def main(program: str, kept: str) -> None:
    """Run a command, or give what the same command gave before."""
    words = sys.argv[1:]
    if not words or words[0] not in COSTLY or "-" in words or "--follow" in words:
        os.execv(program, [program, *words])  # noqa: S606 - the program under test
    place = Path(kept) / _digest(words)
    made = place / "files"
    names = [path.relative_to(made) for path in made.rglob("*") if path.is_file()]
    if not place.exists() or any(name.exists() for name in names):
        sys.exit(_run_and_keep([program, *words], place))
    for name in names:
        name.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(made / name, name)
    sys.stdout.write((place / "out").read_text())
    sys.stderr.write((place / "err").read_text())


def _digest(words: list[str]) -> str:
    """Return what a command depends on: its words, its files and those beside them."""
    found = hashlib.sha256(json.dumps([words, os.environ.get("COLUMNS")]).encode())
    for word in words:
        path = Path(word)
        if path.is_file() or path.is_dir():
            near = path.iterdir() if path.is_dir() else path.parent.glob(f"{path.stem}*")
            for each in sorted({path, *near}):
                if each.is_file() and (each == path or each.suffix != ".h5"):
                    found.update(f"{each} {each.stat().st_size}".encode())
                    found.update(each.read_bytes())
    return found.hexdigest()


def _run_and_keep(command: list[str], place: Path) -> int:
    """Run a command, keep what it wrote and printed if all went well; return its code."""
    before = {path: path.stat().st_mtime_ns for path in Path().rglob("*")}
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    sys.stdout.write(done.stdout)
    sys.stderr.write(done.stderr)
    if done.returncode or place.exists():
        return done.returncode
    (place / "files").mkdir(parents=True)
    for path in Path().rglob("*"):
        if path.is_file() and before.get(path) != path.stat().st_mtime_ns:
            (place / "files" / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, place / "files" / path)
    (place / "out").write_text(done.stdout)
    (place / "err").write_text(done.stderr)
    return 0
