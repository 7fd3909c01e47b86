"""Damaged and hostile files: a sentence and an exit code, never a crash or a hang."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.stress.fuzz import PATIENCE_S, base_inputs

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="session")
def base(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    base_inputs(folder)
    return folder


def meet(base, first, count, limit_s, *kind):
    done = subprocess.run(
        [sys.executable, "-m", "tests.stress.fuzz", base, str(first), str(count), *kind],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=limit_s,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def check(found):
    assert found["trouble"] == []
    assert found["past_header"] >= 0.5 * found["met"]
    assert found["slowest_s"] < PATIENCE_S
    assert found["peak_mb"] < 1024.0


@pytest.mark.slow
def test_sixty_mutants_are_met_with_a_sentence(base):
    check(meet(base, 0, 60, 280))


@pytest.mark.slow
def test_products_with_a_checksum_written_anew_are_met_with_a_sentence(base):
    check(meet(base, 0, 8, 280, "forged"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("count", "kind"), [(5000, []), (2500, ["forged"])], ids=["damaged", "forged"]
)
def test_thousands_of_mutants_are_met_with_a_sentence(base, count, kind):
    parts = [meet(base, first, 250, 3000, *kind) for first in range(1000, 1000 + count, 250)]
    total = {
        "met": sum(part["met"] for part in parts),
        "past_header": sum(part["past_header"] for part in parts),
        "trouble": [row for part in parts for row in part["trouble"]],
        "slowest_s": max(part["slowest_s"] for part in parts),
        "peak_mb": max(part["peak_mb"] for part in parts),
    }
    print({**total, "trouble": len(total["trouble"])})  # noqa: T201 - the figures
    check(total)
