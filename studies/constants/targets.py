"""Constants of `pdaf` and `discriminate`: python -m studies.constants.targets [DRAWS] [SEED].

`LIKELY` of `uwtrack_cli.clutter.several_targets` decides which measurements begin no track
because a confirmed target has them, and which tentative tracks follow another's target. Ten
of the draws cross at 40 degrees: mean number of tracks beyond the two in a scan, share of
scans without one of them.

`RANGE_SHARE` of `uwtrack_cli.clutter.track_start` is the width of the filters with which a
track begins at a bearing alone: draws that end within their covariance, its mean squared
error over the four that are expected, and filters.

The terms of the Gaussian sums of `uwtrack_cli.discrimination.contact_filters`, of weak
bearings: wrong and right of the draws at an accepted 5 and 1 %, after an earlier contact
and without, and the CPU time over that of the chosen ones.

Of 200 draws from seed 8000 on: `LIKELY` from 0.3 to 0.7 gives the same tracks, and
`RANGE_SHARE` from 0.08 to 0.3 finds 20 of 20 with 19 to 6 filters. Errors are within their
limits at all values. `_SPEED_SHARE` up to 1, `_REACH` from 2 on and `_DISTINCT` change
hardly a verdict and cost time alone; inverse ranges twice as wide leave 13 to 40 more of
the 200 undecided, and half as wide decide 6 to 17 more.
"""

import sys
import time
from collections.abc import Iterator
from types import ModuleType

import numpy as np

from tests.clutter.test_several_targets import AUTO
from tests.draws.contact_pairs import error_rates
from tests.draws.crossing_targets import crossing
from tests.draws.targets_under_way import detector_of, passing
from uwtrack_cli.clutter import several_targets, track_start
from uwtrack_cli.clutter.options import TargetMotion, TargetStart
from uwtrack_cli.clutter.pdaf import track_in_clutter
from uwtrack_cli.discrimination import contact_filters

TERMS = {
    "_SPEED_SHARE": (0.12, 0.25, 0.5, 1.0),
    "_RANGE_SHARE": (0.08, 0.15, 0.3),
    "_REACH": (2.0, 3.0, 4.0),
    "_DISTINCT": (0.03, 0.1, 0.3),
}
"""Values of the terms, the chosen one among them."""


def crossings(seed: int, draws: int) -> str:
    """Return how many tracks there are beyond the targets, and too few."""
    beyond, missing = [], []
    for number in range(seed, seed + draws):
        scans, _ = crossing(number, 40.0)
        scan = track_in_clutter(scans, **AUTO).scan
        counts = np.bincount(scan, minlength=51)[6:51]
        beyond.append(np.maximum(counts - 2, 0).mean())
        missing.append((counts < 2).mean())
    return f"{np.mean(beyond):.4f} tracks beyond, {np.mean(missing):.4f} of scans without"


def bearings(seed: int, draws: int) -> str:
    """Return how well tracks that begin at bearings alone end."""
    squares = []
    for number in range(seed, seed + draws):
        scans, ship, ways, rate = passing(number, kind="bearings")
        found = track_in_clutter(
            scans, navigation=ship, targets="auto", threshold="fixed",
            detector=detector_of("bearings"), motion=TargetMotion(acceleration_std=0.02),
            start=TargetStart(velocity_std=6.0, range_m=(500.0, 8000.0)),
        )  # fmt: skip
        last = found.scan == 50
        off = found.state[last] - np.stack([ways[0, -1], rate[0]], axis=1).ravel()
        solved = np.linalg.solve(found.state_covariance[last], off[..., None])[..., 0]
        squares.append(float((off * solved).sum(axis=1).min(initial=np.inf)))
    near = np.array([square for square in squares if square < 20.0])
    filters = np.ceil(np.log(16.0) / (2.0 * np.log1p(track_start.RANGE_SHARE)))
    return (
        f"{near.size} of {draws} found, {near.mean() / 4.0:.2f} of the expected square, "
        f"{filters:.0f} filters"
    )


def pairs(seed: int, draws: int) -> str:
    """Return wrong and right verdicts, and the CPU time in s."""
    begin = time.process_time()
    words = []
    for has_history in (True, False):
        rows = error_rates(seed, draws, "as assumed", "weak", has_history=has_history)
        words += [f"{row.wrong} and {row.right} at {row.error:g}" for row in rows]
    return f"{'; '.join(words)}; {time.process_time() - begin:.1f} s"


def each(module: ModuleType, name: str, values: tuple[float, ...]) -> Iterator[float]:
    """Yield the values of a constant, each in its place, and put it back."""
    chosen = getattr(module, name)
    try:
        for value in values:
            setattr(module, name, value)
            yield value
    finally:
        setattr(module, name, chosen)


def main(draws: int = 300, seed: int = 8000) -> None:
    """Print what each value does."""
    for value in each(several_targets, "LIKELY", (0.3, 0.5, 0.7)):
        print(f"LIKELY {value:g}: {crossings(seed, draws // 10)}", flush=True)
    for value in each(track_start, "RANGE_SHARE", (0.08, 0.15, 0.3)):
        print(f"RANGE_SHARE {value:g}: {bearings(seed, draws // 10)}", flush=True)
    for name, values in TERMS.items():
        for value in each(contact_filters, name, values):
            print(f"{name} {value:g}: {pairs(seed, draws)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
