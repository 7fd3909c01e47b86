"""Types the commands of pages that show what is printed, and writes what they print.

Run as ``python -m tests.first_half_hour`` in a clone: the wheel is built, everything is
typed into one shell in an empty folder with a home of its own, and the page is written
again with what came. ``python -m tests.first_half_hour commands`` does the same with
`docs/commands.md`, whose program is that of the clone. The suite types the same again,
without the installations, and compares (`tests/test_documents.py`).
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "first-half-hour.md"
COMMANDS_PAGE = ROOT / "docs" / "commands.md"
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALLS = ("$ ls\n", "$ git clone")
"""How the blocks begin that install the program."""

END = "--- what came before is what the command printed ---"


def repeated(text: str, run: Callable[[str], str], *, installs: bool) -> str:
    """Return the page with the output that each command has now.

    Parameters
    ----------
    text
        The page.
    run
        Types a command, and returns what it prints.
    installs
        Whether the blocks that install the program are typed, too.
    """

    def again(found: re.Match[str]) -> str:
        typed = found.group(1)
        if typed.startswith(INSTALLS) and not installs:
            return found.group(0)
        commands = [line[2:] for line in typed.splitlines() if line.startswith("$ ")]
        told = "".join(f"$ {command}\n{run(command)}" for command in commands)
        return f"```console\n{told}```"

    return BLOCK.sub(again, text)


class Shell:
    """One shell that goes on from command to command, as a person's does."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            ["bash"], cwd=folder, env=environment, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def type(self, command: str) -> str:
        """Type a command, and return what it prints, without ends of blanks."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{{ {command}\n}} </dev/null\necho '{END}'\n")
        self._process.stdin.flush()
        lines = []
        for line in self._process.stdout:
            if line.rstrip("\n").endswith(END):
                break
            lines.append(f"{line.rstrip()}\n")
        return "".join(lines)

    def close(self) -> None:
        """End the shell."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


def main() -> None:
    """Type all of it, and write the page."""
    page = COMMANDS_PAGE if sys.argv[1:] == ["commands"] else PAGE
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder, home = Path(name) / "new", Path(name) / "home"
        folder.mkdir()
        home.mkdir()
        build = [sys.executable, "-m", "build", "--no-isolation", "--wheel"]
        if page == PAGE:
            words = [*build, "-o", folder, ROOT]
            subprocess.run(words, check=True, capture_output=True)
        shell = Shell(
            folder,
            {
                "HOME": str(home), "PATH": os.environ["PATH"], "COLUMNS": "80",
                "LANG": "C.UTF-8", "MPLBACKEND": "agg", "PIP_QUIET": "3",
                "REPOSITORY": str(ROOT),
            },
        )  # fmt: skip

        def type_and_tell(command: str) -> str:
            print(f"{time.monotonic() - begin:5.0f} s  {command}", flush=True)
            return shell.type(command)

        text = repeated(page.read_text(encoding="utf-8"), type_and_tell, installs=True)
        shell.close()
    for hidden in (name, str(ROOT), str(Path.home())):
        if hidden in text:
            msg = f"a path of this machine stands in what was printed: {hidden}"
            raise SystemExit(msg)
    page.write_text(text, encoding="utf-8")
    print(f"{time.monotonic() - begin:5.0f} s  written")


if __name__ == "__main__":
    main()
