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
def test_the_commands_run_in_an_empty_folder(tmp_path):
    script = "set -eu\n" + "\n".join(blocks("sh"))
    folder = str(Path(sys.executable).parent)
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", script], cwd=tmp_path, capture_output=True,
        text=True, check=False, env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "pass.png").exists()


def test_the_python_runs(samples, monkeypatch):
    monkeypatch.chdir(samples)
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), {})


def test_the_figures_of_the_demo_are_those_that_it_prints(tmp_path):
    folder = str(Path(sys.executable).parent)
    done = subprocess.run(
        ["bash", "-c", "uwtrack sample pass -q && uwtrack run pass.wav"], cwd=tmp_path,
        capture_output=True, text=True, check=True,
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
    )  # fmt: skip
    (row,) = [line for line in done.stderr.splitlines() if " ok " in line]
    assert row.split() in [line.split() for line in README.splitlines()]
