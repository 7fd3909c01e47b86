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
    printed = [line.split() for line in done.stderr.splitlines()]
    demo, array = [line.split() for line in README.splitlines() if "  ok  " in line]
    assert array in printed
    own = [row for row in printed if row[:2] == demo[:2]]
    assert demo[3:] in [row[3:] for row in own]  # but its time, which is UTC here


def test_the_python_runs(samples, monkeypatch):
    monkeypatch.chdir(samples)
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), {})
