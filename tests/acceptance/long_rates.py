"""Rates over far more draws than acceptance has, for `make long`: 200 recordings without
a vessel, 120 with one. Nothing of them is frozen but the limits of the rates.
"""

import sys

from tests.acceptance.parts import LONG
from tests.acceptance.rates import RATES, span, words_of
from tests.acceptance.running import Results, run_all


def check_long(processes: int) -> int:
    """Run the long parts, print their rates, and return 1 if one misses its limit."""
    cases = {(part, name): case for part, make in LONG.items() for name, case in make().items()}
    results: Results = {part: {} for part in LONG}
    for (part, name), one in run_all(cases, processes):
        results[part][name] = one
    red = 0
    for rate in RATES:
        if set(rate.parts) <= set(LONG):
            counted = rate.count(results)
            is_held = rate.held(counted, rate.limit)
            red += not is_held
            sys.stdout.write(
                f"{'held' if is_held else 'RED'} {rate.name}: {words_of(rate, counted)}, "
                f"limit {span(rate.limit)}, band {span(rate.band)}\n"
            )
    return int(red > 0)
