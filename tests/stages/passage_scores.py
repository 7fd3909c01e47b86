"""Scores of drawn passages: errors in stated deviations, and against the bands."""

from dataclasses import dataclass, field

import numpy as np

from tests.stages.passage_lottery import BAND_OF, BANDS, DEPTH_M, draw
from uwtrack_cli.flow.studies.seatrial import analyse

QUANTITIES = ("speed", "range", "width", "time", "course")


@dataclass
class Score:
    """What came of one recording."""

    kind: str
    seed: int
    claimed: int
    expected: int
    missed: int = 0
    wrong_side: int = 0
    errors: list = field(default_factory=list)
    deviations: list = field(default_factory=list)
    outside: list = field(default_factory=list)


def score(kind, seed):
    """Draw, analyse and score one recording."""
    scenario = draw(kind, seed)
    found = analyse(scenario)[0]
    passed = [v.closest_approach for v in scenario.vessels]
    rows = [n for n in range(found.n_encounters) if np.isfinite(found.time_s[n])]
    result = Score(kind, seed, len(rows), len(passed))
    for vessel in passed:
        if not rows:
            result.missed += 1
            continue
        row = min(
            rows,
            key=lambda n: (
                abs(found.time_s[n] - vessel.time_s)
                + 5 * abs(np.nan_to_num(found.speed_mps[n]) - vessel.speed_mps)
            ),
        )
        rows.remove(row)
        _score_row(result, found, row, vessel)
    return result


def _score_row(result, found, row, vessel):
    slant = float(np.hypot(vessel.horizontal_range_m, DEPTH_M - 3.0))
    course = (found.course_deg[row] - vessel.course_deg + 180) % 360 - 180
    table = {
        "speed": (found.speed_mps[row] - vessel.speed_mps, found.speed_std_mps[row],
                  vessel.speed_mps),
        "range": (found.slant_range_m[row] - slant, found.slant_range_std_m[row], slant),
        "width": (found.range_over_speed_s[row] - slant / vessel.speed_mps,
                  found.range_over_speed_std_s[row], slant / vessel.speed_mps),
        "time": (found.time_s[row] - vessel.time_s, found.time_std_s[row], 1.0),
        "course": (course, found.course_std_deg[row], 1.0),
    }  # fmt: skip
    band = BANDS[BAND_OF[result.kind]]
    for name, (error, std, unit) in table.items():
        result.errors.append((name, float(error), float(std), float(unit)))
        if not np.isfinite(error):
            continue
        result.deviations.append((name, float(error / std)))
        if abs(error) > max(band[name] * unit, 0):
            result.outside.append(name)
    if found.side[row] and found.side[row] != vessel.side:
        result.wrong_side += 1
