"""The documented CI example runs as it stands, and fails on a change."""

import os
import re
import subprocess
from pathlib import Path

import pytest

DOCUMENT = Path(__file__).parent.parent.parent / "docs" / "github-actions.md"


def blocks(language):
    text = DOCUMENT.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


@pytest.fixture
def workplace(tmp_path):
    """A folder with the script and limits of the document."""
    (tmp_path / "ci").mkdir()
    (tmp_path / "ci" / "results.sh").write_text(blocks("sh")[0])
    limits, close = blocks("toml")
    (tmp_path / "ci" / "limits.toml").write_text(limits)
    (tmp_path / "ci" / "close.toml").write_text(close)
    return tmp_path


def run(folder, program):
    path = f"{program}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["sh", "ci/results.sh"], cwd=folder, env={**os.environ, "PATH": path},
        capture_output=True, text=True, check=False, timeout=250,
    )  # fmt: skip


@pytest.mark.slow
def test_the_example_passes_and_fails_on_a_change(workplace, program, uwtrack):
    done = run(workplace, program)
    assert done.returncode == 0, done.stderr
    words = ["diff", workplace / "out" / "pass.run.h5", workplace / "again.h5"]
    assert uwtrack(*words, "--tolerance", "ci/close.toml").exit_code == 0
    strict = "[encounters]\nspeed_mps = { error = 1e-9 }\n"
    (workplace / "ci" / "limits.toml").write_text(strict)
    changed = uwtrack(
        "score", workplace / "out" / "pass.run.h5", "--tolerance", "ci/limits.toml",
        "--truth", workplace / "in" / "pass.truth.json",
    )  # fmt: skip
    assert changed.exit_code == 4
