"""The README is short, and its commands run as they stand in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
MOST_LINES = 130


def test_the_commands_run_in_an_empty_folder_and_print_what_it_says(shared_program, tmp_path):
    blocks = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    folder = f"{shared_program}:{Path(sys.executable).parent}"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", "set -eu\n" + "\n".join(blocks)], cwd=tmp_path,
        capture_output=True, text=True, check=False,
        env={
            **os.environ, "COLUMNS": "80", "MPLBACKEND": "agg",
            "PATH": f"{folder}:{os.environ['PATH']}",
        },
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "pass.png").exists()
    (printed,) = [line.split() for line in done.stderr.splitlines() if "  ok  " in line]
    (told,) = [line.split() for line in README.splitlines() if "  ok  " in line]
    assert is_alike(told, printed), printed


def is_alike(row: list[str], other: list[str]) -> bool:
    """Tell whether rows differ by a unit of a last digit at most: machines do."""
    if len(row) != len(other):
        return False
    for told, printed in zip(row, other, strict=True):
        unit = 10.0 ** -len(told.partition(".")[2])
        both = (told, printed)
        number = all(re.fullmatch(r"-?\d+(\.\d+)?", one) for one in both)
        if told != printed and not (number and abs(float(told) - float(printed)) < 1.5 * unit):
            return False
    return True


def test_it_is_short_and_a_sentence_has_few_words():
    assert len(README.splitlines()) <= MOST_LINES
    prose = [line for line in README.splitlines() if re.match(r"[A-Z]", line)]
    for sentence in re.split(r"(?<=[.?])\s", " ".join(prose).split("The methods")[0]):
        assert len(sentence.split()) <= 30, sentence
