"""Vessels without a line, told by their fringes, and sounds in which nothing passes.

Drawn in power, by `tests.draws.fringe_sounds` and `fringe_rates`, which share no formula
with what they test.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.acceptance.outcomes import Outcome, score
from tests.draws.fringe_rates import draw_nothing
from tests.draws.fringe_sounds import draw_power, fringes_of, scene
from tests.draws.nothing_passes import KINDS
from tests.draws.recordings import Passage
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.motion.cpa import find_encounters

Cases = dict[str, Callable[[Path], Outcome]]

NAMES = (
    "contact", "status", "time_s", "time_std_s", "range_over_speed_s",
    "range_over_speed_std_s",
)  # fmt: skip


def _outcome(fringes: Fringes, passages: list[Passage]) -> Outcome:
    table = find_encounters(fringes=fringes)
    columns = {name: getattr(table, name).tolist() for name in NAMES}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    hours = float(fringes.time_s[-1]) / 3600.0
    return {"hours": hours, **score(rows, passages)}


def _passing(seed: int, is_deep: bool, _folder: Path) -> Outcome:
    frequency, power, ship = draw_power(seed, is_deep=is_deep)
    place = scene(seed, is_deep=is_deep)[2]
    one = Passage(ship.time_s, ship.speed_mps, ship.slant_m(place.sensor_m))
    return _outcome(fringes_of(frequency, power), [one])


def _nothing(seed: int, kind: str, _folder: Path) -> Outcome:
    return _outcome(draw_nothing(kind, seed), [])


def cases(count: int, seed: int) -> Cases:
    """Draw so many vessels in deep and shallow water, and of each kind that is none."""
    passing: Cases = {
        f"{'deep' if is_deep else 'shallow'} {number}": partial(_passing, number, is_deep)
        for number in range(seed, seed + count)
        for is_deep in (True, False)
    }
    nothing: Cases = {
        f"{kind} {number}": partial(_nothing, number, kind)
        for number in range(seed, seed + max(1, count // 2)) for kind in KINDS
    }  # fmt: skip
    return passing | nothing
