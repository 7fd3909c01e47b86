"""The parts of acceptance: what is run, under which names, and in which sets.

Seeds were drawn once and nothing is tuned on them; a part of `make long` draws anew.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.acceptance import (
    arrays,
    drawn_sounds,
    fringe_sounds,
    line_sounds,
    real_sounds,
    samples,
    tables,
    targets,
)
from tests.acceptance.outcomes import Outcome

Case = Callable[[Path], Outcome]

PARTS: dict[str, Callable[[], dict[str, Case]]] = {
    "ships": partial(drawn_sounds.ships, 6, 381100),
    "two-vessels": partial(drawn_sounds.two_vessels, 8, 381200),
    "disturbed": partial(drawn_sounds.disturbed, 12, 381300),
    "quiet": partial(drawn_sounds.quiet, 12, 381400),
    "harder": partial(drawn_sounds.harder, 8, 381500),
    "vehicles": partial(drawn_sounds.vehicles, 14, 381600),
    "nothing": partial(drawn_sounds.nothing, 28, 381700),
    "foreign": partial(drawn_sounds.foreign, 12, 381800),
    "fringes": partial(fringe_sounds.cases, 2, 382400),
    "samples": samples.cases,
    "lines": partial(line_sounds.cases, 381900),
    "tables": partial(tables.cases, 382000),
    "arrays": partial(arrays.cases, 382100),
    "targets": partial(targets.cases, 382300),
    "real": real_sounds.cases,
}
"""60 drawn recordings with vessels, 40 without, and what is no drawn recording.

Parts that take longest come first, so that two processes end together.
"""

LONG: dict[str, Callable[[], dict[str, Case]]] = {
    "nothing": partial(drawn_sounds.nothing, 140, 391700),
    "foreign": partial(drawn_sounds.foreign, 60, 391800),
    "quiet": partial(drawn_sounds.quiet, 60, 391400),
    "disturbed": partial(drawn_sounds.disturbed, 60, 391300),
}
"""What `make long` runs: 200 recordings without a vessel; rates alone are held."""

SHORT: dict[str, tuple[str, ...]] = {
    "samples": ("noise", "bearings", "contacts", "scans"),
    "lines": ("track: fades of 10 s at 10 dB", "two lengths of frames joined"),
    "tables": ("tma S1-T1, compass 1 degree", "discriminate", "pdaf crossing at 20"),
    "targets": ("own ship under way, bearings",),
    "fringes": ("shallow 382400",),
}
"""Cases of each part that are in `make test`: about half a CPU minute."""
