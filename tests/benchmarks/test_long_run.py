"""A day costs a day's time, and no more memory than an hour.

The figures of a day: ``pytest -m long tests/benchmarks/test_long_run.py -s``.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent.parent


def run(hours, n_passages, rate_hz, recipe="vessel", limit_s=280):
    words = [str(hours), str(n_passages), str(rate_hz), recipe]
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.long_run", *words], cwd=ROOT,
        capture_output=True, text=True, check=True, timeout=limit_s,
    )  # fmt: skip
    return json.loads(done.stdout)


@pytest.mark.benchmark
def test_three_times_the_length_needs_no_more_memory():
    short, long = run(0.15, 2, 400), run(0.45, 2, 400)
    print(f"peak {short['peak_mb']:.0f} and {long['peak_mb']:.0f} MB")
    assert len(short["times_s"]) == len(long["times_s"]) == 2
    assert long["peak_mb"] < 1.1 * short["peak_mb"]


@pytest.mark.long
@pytest.mark.benchmark
def test_a_day_with_ten_passages_yields_ten_encounters_at_an_hours_memory():
    hour, day = run(1, 1, 4000, limit_s=None), run(24, 10, 4000, limit_s=None)
    for name, found in {"hour": hour, "day": day}.items():
        print(
            f"{name}: peak {found['peak_mb']:.0f} MB, "
            f"{found['cpu_s_per_hour']:.1f} s of processor time per hour, "
            f"encounters at {np.round(found['times_s'], 1)}"
        )
    expected = (np.arange(10) + 0.5) * 8640.0
    assert sorted(day["times_s"]) == pytest.approx(expected, abs=3.0)
    assert day["peak_mb"] < 1.1 * hour["peak_mb"]
    assert day["cpu_s_per_hour"] < 1.25 * hour["cpu_s_per_hour"]
