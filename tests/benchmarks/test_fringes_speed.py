"""CPU time of fringes against the plain way, on ten minutes with a passage.

The search correlates image and law, so that all times of an R/v are one transform; the
plain way shifts and stacks the rows for each time, as D'Spain and Kuperman (1999) do for
each range. What is fitted after it costs no more than some searches.
"""

import time

import numpy as np
import pytest

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import draw_power, fringes_of
from uwtrack_cli.motion.evidence.fringe_panel import panel_of
from uwtrack_cli.motion.evidence.fringes import (
    LEAST_WIDTH_S,
    WIDTH_STEP,
    FringeEvidence,
    fringe_passages,
)

PLACES = 40
"""Times that the plain way is measured at, of each R/v."""


@pytest.fixture(scope="module")
def fringes():
    frequency, power, _ = draw_power(71, is_deep=True)
    return fringes_of(frequency, power)


def stacked(panel, time_s, width_s):
    """Return the energy of the stack of rows, each shifted as the law says."""
    lag = (panel.time_s - time_s) / width_s
    near = np.abs(lag) < 5.0
    shift = np.rint(0.5 * np.log1p(lag[near] ** 2) / panel.cell).astype(int)
    total = np.zeros(panel.value.shape[1] + shift.max(initial=0))
    first = total.size - panel.value.shape[1]
    for row, by in zip(panel.value[near], shift, strict=True):
        total[first - by : total.size - by] += row
    return float((total**2).sum())


def plain_search_s(fringes):
    """Return the CPU time of the same grid by shifting and stacking, s."""
    spent_s, span_s = 0.0, float(fringes.time_s[-1] - fringes.time_s[0])
    width_s = LEAST_WIDTH_S
    while width_s < span_s:
        panel = panel_of(fringes, min(width_s / 16.0, span_s / 48.0), 2)
        places = np.linspace(*panel.time_s[[0, -1]], PLACES)
        begin = time.process_time()
        for place in places:
            stacked(panel, place, width_s)
        each_s = (time.process_time() - begin) / PLACES
        spent_s += each_s * panel.time_s.size
        width_s *= WIDTH_STEP
    return spent_s


@pytest.mark.benchmark
def test_the_search_costs_less_than_shifting_and_stacking(fringes, capsys):
    FringeEvidence(fringes, MACH).proposals()  # slow imports
    begin = time.process_time()
    FringeEvidence(fringes, MACH).proposals()
    search_s = time.process_time() - begin
    begin = time.process_time()
    assert fringe_passages(fringes, MACH)
    whole_s = time.process_time() - begin
    plain_s = plain_search_s(fringes)
    with capsys.disabled():
        print(
            f"\nfringes: search {search_s / plain_s:.2f} of shifting and stacking, "
            f"all {whole_s / search_s:.1f} searches ({whole_s:.1f} s of CPU time)"
        )
    assert search_s < 0.2 * plain_s
    assert whole_s < 8.0 * search_s
