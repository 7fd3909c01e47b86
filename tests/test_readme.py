"""The README's commands run as they stand, in an empty folder, in their order."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.mark.timeout(900)
def test_the_commands_run_in_an_empty_folder_and_print_what_it_says(program, tmp_path):
    script = "set -eu\n" + "\n".join(blocks("sh"))
    folder = f"{program}:{Path(sys.executable).parent}"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", script], cwd=tmp_path, capture_output=True,
        text=True, check=False, env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "pass.png").exists()
    printed = [line.split() for line in done.stderr.splitlines() if "  ok  " in line]
    demo, array = [line.split() for line in README.splitlines() if "  ok  " in line]
    assert any(is_alike(array, row) for row in printed), printed
    own = [row[3:] for row in printed]  # but its time, which is UTC here
    assert any(is_alike(demo[3:], row) for row in own), printed


def is_alike(row: list[str], other: list[str]) -> bool:
    """Tell whether rows differ by a unit of a last digit at most: machines do."""
    if len(row) != len(other):
        return False
    for told, printed in zip(row, other, strict=True):
        unit = 10.0 ** -len(told.partition(".")[2])
        both = (told, printed)
        number = all(re.fullmatch(r"-?\d+(\.\d+)?", one) for one in both)
        if told != printed and not (
            number and abs(float(told) - float(printed)) < 1.5 * unit
        ):
            return False
    return True


def test_the_python_runs(samples, monkeypatch):
    monkeypatch.chdir(samples)
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), {})
