"""Scores of drawn passages: errors in stated deviations, and against the bands.

The table in tests/baselines/passages.md is made by (23 recordings of each class):
python -m tests.stages.passage_scores 23 2000 > tests/baselines/passages.md
"""

import sys
import warnings
from dataclasses import dataclass, field

import numpy as np

from tests.stages.passage_lottery import BAND_OF, BANDS, CLASSES, DEPTH_M, draw
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
            _score_row(result, found, row, passed[number])
    result.missed = len(passed) - len(done)
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
        if abs(error) > max(band[name] * unit, 5 * std):
            result.outside.append(name)
    if found.side[row] and found.side[row] != vessel.side:
        result.wrong_side += 1


def table(results):
    """Return the scores as a table in Markdown, one row per class."""
    head = (
        "| class | recordings | vessels | claimed | missed | wrong side "
        "| given | within 3 deviations | median deviation | outside the band |"
    )
    lines = [head, "|---|---|---|---|---|---|---|---|---|---|"]
    kinds = dict.fromkeys(r.kind for r in results)
    for kind in [*kinds, "all"]:
        part = [r for r in results if kind in (r.kind, "all")]
        values = np.abs([d for r in part for _, d in r.deviations])
        errors = [
            e
            for r in part
            for n, e, _, _ in r.errors
            if not (r.kind == "mono" and n == "course")
        ]
        shares = (
            (np.isfinite(errors).mean(), (values <= 3).mean(), np.median(values))
            if errors
            else (np.nan,) * 3
        )
        lines.append(
            f"| {kind} | {len(part)} | {sum(r.expected for r in part)} "
            f"| {sum(r.claimed for r in part)} | {sum(r.missed for r in part)} "
            f"| {sum(r.wrong_side for r in part)} | {shares[0]:.1%} "
            f"| {shares[1]:.1%} of {values.size} | {shares[2]:.2f} "
            f"| {sum(len(r.outside) for r in part)} |"
        )
    return "\n".join(lines)


def main(count, first):
    """Print the table of so many recordings of each class."""
    warnings.simplefilter("ignore")
    results = [score(kind, first + k) for kind in CLASSES for k in range(count)]
    command = f"python -m tests.stages.passage_scores {count} {first}"
    sys.stdout.write(
        "# Passages drawn by lot, through the whole chain\n\n"
        f"Made by `{command}`; ranges in tests/stages/passage_lottery.py. A quantity is "
        "outside its band beyond the larger of the band of its class and five stated "
        f"deviations.\n\n{table(results)}\n"
    )
    for r in results:
        wild = [f"{n} {d:+.1f}" for n, d in r.deviations if abs(d) > 3]
        if wild or r.outside or r.missed or r.claimed != r.expected:
            sys.stderr.write(
                f"{r.kind} {r.seed}: {r.claimed}/{r.expected} {wild} {r.outside}\n"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
