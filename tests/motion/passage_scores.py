"""Scores of drawn passages: errors in stated deviations, and against the bands.

A band is the larger of the floor of its class and five times the Cramer-Rao bound of
the passage. A quantity should be given where this bound is below 5 % (of the value; of
d/v for the time, of a radian for the course).

The table in tests/baselines/passages.md is made by (6 recordings of each class):
python -m tests.motion.passage_scores 6 8700 > tests/baselines/passages.md
"""

import sys
import warnings
from dataclasses import dataclass, field

import numpy as np

from tests.motion.passage_limits import bounds
from tests.motion.random_passages import BAND_OF, BANDS, CLASSES, DEPTH_M, draw
from uwtrack_cli.studies.seatrial import analyse

QUANTITIES = ("speed", "range", "width", "time", "course")
LARGEST_BOUND = 0.05


@dataclass(frozen=True)
class Error:
    """One quantity of one passage; the error is nan where it is not given."""

    name: str
    error: float
    std: float
    bound: float
    is_outside: bool
    is_due: bool


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

    @property
    def deviations(self):
        """Errors that are given, in stated deviations."""
        return [(e.name, e.error / e.std) for e in self.errors if np.isfinite(e.error)]

    @property
    def outside(self):
        """Names of what is outside its band."""
        return [e.name for e in self.errors if e.is_outside]

    @property
    def due(self):
        """Whether each quantity is given that should be."""
        return [bool(np.isfinite(e.error)) for e in self.errors if e.is_due]


def score(kind, seed):
    """Draw, analyse and score one recording."""
    scenario = draw(kind, seed)
    found = analyse(scenario)[0]
    passed = [v.closest_approach for v in scenario.vessels]
    rows = [n for n in range(found.n_encounters) if np.isfinite(found.time_s[n])]
    result = Score(kind, seed, len(rows), len(passed))
    pairs = sorted(
        (
            abs(found.time_s[row] - vessel.time_s)
            + 5 * abs(np.nan_to_num(found.speed_mps[row]) - vessel.speed_mps),
            row,
            number,
        )
        for row in rows
        for number, vessel in enumerate(passed)
    )
    done = set()
    for _, row, number in pairs:
        if row in rows and number not in done:
            rows.remove(row)
            done.add(number)
            _score_row(result, found, row, passed[number], bounds(scenario, number))
    result.missed = len(passed) - len(done)
    for number in set(range(len(passed))) - done:
        limits = bounds(scenario, number)
        _add(
            result, dict.fromkeys(QUANTITIES, (np.nan, np.nan)), passed[number], limits
        )
    return result


def _score_row(result, found, row, vessel, limits):
    slant = float(np.hypot(vessel.horizontal_range_m, DEPTH_M - 3.0))
    width = slant / vessel.speed_mps
    course = (found.course_deg[row] - vessel.course_deg + 180) % 360 - 180
    table = {
        "speed": (found.speed_mps[row] - vessel.speed_mps, found.speed_std_mps[row]),
        "range": (found.slant_range_m[row] - slant, found.slant_range_std_m[row]),
        "width": (
            found.range_over_speed_s[row] - width, found.range_over_speed_std_s[row]
        ),
        "time": (found.time_s[row] - vessel.time_s, found.time_std_s[row]),
        "course": (course, found.course_std_deg[row]),
    }  # fmt: skip
    _add(result, table, vessel, limits)
    if found.side[row] and found.side[row] != vessel.side:
        result.wrong_side += 1


def _add(result, table, vessel, limits):
    """Set errors and their stated deviations beside bands and bounds."""
    slant = float(np.hypot(vessel.horizontal_range_m, DEPTH_M - 3.0))
    width = slant / vessel.speed_mps
    units = {"speed": vessel.speed_mps, "range": slant, "width": width}
    wholes = {"time": width, "course": np.rad2deg(1.0)}
    floors = BANDS[BAND_OF[result.kind]]
    for name, (error, std) in table.items():
        bound, unit = limits[name], units.get(name, 1.0)
        is_outside = bool(abs(error) > max(floors[name], 5 * bound) * unit)
        is_due = bound / wholes.get(name, 1.0) < LARGEST_BOUND
        result.errors.append(
            Error(name, float(error), float(std), bound * unit, is_outside, is_due)
        )


def table(results):
    """Return the scores as a table in Markdown, one row per class."""
    head = (
        "| class | recordings | vessels | claimed | missed | wrong side "
        "| given where due | within 3 deviations | median deviation "
        "| median error over bound | outside the band |"
    )
    lines = [head, "|---" * 11 + "|"]
    kinds = dict.fromkeys(r.kind for r in results)
    for kind in [*kinds, "all"]:
        part = [r for r in results if kind in (r.kind, "all")]
        values = np.abs([d for r in part for _, d in r.deviations])
        due = [given for r in part for given in r.due]
        over = [
            abs(e.error) / e.bound
            for r in part
            for e in r.errors
            if np.isfinite(e.error)
        ]
        shares = (
            (np.mean(due), (values <= 3).mean(), np.median(values), np.median(over))
            if over
            else (np.nan,) * 4
        )
        lines.append(
            f"| {kind} | {len(part)} | {sum(r.expected for r in part)} "
            f"| {sum(r.claimed for r in part)} | {sum(r.missed for r in part)} "
            f"| {sum(r.wrong_side for r in part)} | {shares[0]:.1%} of {len(due)} "
            f"| {shares[1]:.1%} of {values.size} | {shares[2]:.2f} | {shares[3]:.1f} "
            f"| {sum(len(r.outside) for r in part)} |"
        )
    return "\n".join(lines)


def main(count, first):
    """Print the table of so many recordings of each class."""
    warnings.simplefilter("ignore")
    results = [score(kind, first + k) for kind in CLASSES for k in range(count)]
    command = f"python -m tests.motion.passage_scores {count} {first}"
    sys.stdout.write(
        "# Passages drawn by lot, through the whole chain\n\n"
        f"Made by `{command}`; ranges in tests/motion/random_passages.py. A quantity is "
        "outside its band beyond the larger of the floor of its class and five times the "
        "Cramer-Rao bound of the passage (jitter counts as noise of known correlation time); "
        "it is due where this bound is below 5 %. "
        f"Nothing is given of a missed vessel.\n\n{table(results)}\n"
    )
    for r in results:
        wild = [f"{n} {d:+.1f}" for n, d in r.deviations if abs(d) > 3]
        if wild or r.outside or r.missed or r.claimed != r.expected:
            sys.stderr.write(
                f"{r.kind} {r.seed}: {r.claimed}/{r.expected} {wild} {r.outside}\n"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
