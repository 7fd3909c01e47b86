"""False rows of recipe `auto` on drawn recordings, and what it finds of drawn passages.

Recordings without a passage, ten minutes each and half of them of omni sensors, with the
disturbances of `random_passages` and ships far off; and recordings of one passage with the
same disturbances, with `auto` and with `vessel`, the recipe that a person would choose who
knew what passes. A passage is due where the Cramer-Rao bounds of its speed and of its d/v
are below 5 % (in the ambient noise: disturbances can only raise them). What the rest-frame
evidence of every candidate was is told for true and false ones, whatever became of them.
Prints Markdown, with exact 95 % intervals (Clopper and Pearson 1934); its numbers are
recordings of either kind and the first seed; one takes half a minute of CPU:
python -m tests.flow.drawn_recordings 20 10 21000
"""

import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta, chi2

from tests.flow.auto_scores import in_memory, passages
from tests.motion.passage_limits import bounds
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.passage import recording_passages
from uwtrack_cli.simulate import Scenario
from uwtrack_cli.simulate.random_passages import draw_scenario

RATE_HZ = 4000.0
QUIET_S, PASSING_S = 600.0, 480.0
LARGEST_BOUND = 0.05
SENSORS = ("omni", "difar")
SHARES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)


class Asked(NamedTuple):
    """A candidate that was held against the sound and its own lines."""

    time_s: float
    """Closest approach, in the recording that was looked at, s."""
    width_s: float
    """Its d/v, s."""
    evidence: float
    """Rest-frame evidence; nan if the sound was not asked."""
    is_kept: bool
    """Whether nothing speaks against it."""
    speed_over_std: float
    """Its speed in deviations."""


@contextmanager
def candidates() -> Iterator[list[Asked]]:
    """Collect every candidate of lines that is checked, kept or not."""
    found: list[Asked] = []
    check = recording_passages.check_fit

    def noted(candidate: Any, lines: Any) -> Any:
        made = check(candidate, lines)
        if not made.blocks.shift.is_empty and np.isfinite(made.rest_frame_evidence):
            theta, covariance = made.fit.theta[0], made.fit.covariance[0]
            found.append(
                Asked(
                    float(theta[0]), float(made.fit.range_over_speed_s[0]),
                    float(made.rest_frame_evidence), not made.doubt,
                    float(theta[2] / np.sqrt(covariance[2, 2])),
                )
            )  # fmt: skip
        return made

    recording_passages.check_fit = noted
    try:
        yield found
    finally:
        recording_passages.check_fit = check


def of_each_sensor(
    count: int, seed: int, **options: Any
) -> Iterator[tuple[int, Scenario]]:
    """Draw recordings from a seed on until there are half of each kind of sensor."""
    left = dict.fromkeys(SENSORS, count // 2)
    while any(left.values()):
        scenario = draw_scenario(seed, sample_rate_hz=RATE_HZ, **options)
        kind = scenario.sensors[0].kind
        if left[kind]:
            left[kind] -= 1
            yield seed, scenario
        seed += 1


def share(count: int, whole: int) -> str:
    """Tell a share with its exact 95 % interval."""
    low = beta.ppf(0.025, count, whole - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, whole - count) if count < whole else 1.0
    return f"{count} of {whole} ({100 * low:.0f} to {100 * high:.0f} %)"


def rate(count: int, hours: float) -> str:
    """Tell a rate an hour with its exact 95 % interval."""
    low = chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = chi2.ppf(0.975, 2 * count + 2) / 2
    return f"{count / hours:.2f} ({low / hours:.2f} to {high / hours:.2f})"


def table_of(scenario: Scenario, recipe: str) -> tuple[Encounters, float]:
    """Return what a recipe finds, and the seconds of CPU it took."""
    recording = in_memory(scenario)
    begin = time.process_time()
    made = run_recipe(recording, load_recipe(recipe))
    cost = time.process_time() - begin
    return next(item for item in made if isinstance(item, Encounters)), cost


def row_words(table: Encounters, k: int) -> str:
    """Tell a row in a few words."""
    return (
        f"{table.status[k]} at {table.time_s[k]:.1f} s, d/v "
        f"{table.range_over_speed_s[k]:.1f} ± {table.range_over_speed_std_s[k]:.1f} s, "
        f"{table.speed_mps[k]:.2f} ± {table.speed_std_mps[k]:.2f} m/s"
    )


def told_evidence(name: str, asked: list[Asked]) -> str:
    """Tell how the evidence of candidates is distributed."""
    if not asked:
        return f"| {name} | 0 | | |"
    values = np.quantile([one.evidence for one in asked], SHARES)
    kept = sum(one.is_kept for one in asked)
    words = ", ".join(f"{value:.2f}" for value in values)
    return f"| {name} | {len(asked)} | {kept} | {words} |"


def without_passage(count: int, seed: int, notes: list[str]) -> list[Asked]:
    """Print the false rows of recordings without a passage; return the candidates."""
    rows = {kind: Counter() for kind in SENSORS}
    asked: list[Asked] = []
    for number, scenario in of_each_sensor(
        count, seed, n_vessels=0, duration_s=QUIET_S
    ):
        kind = scenario.sensors[0].kind
        with candidates() as found:
            table, cost = table_of(scenario, "auto")
        asked += found
        rows[kind].update({"recordings": 1, "cost": cost})
        for k in range(table.n_encounters):
            is_level = table.status[k] == "level-only"
            rows[kind]["level-only" if is_level else "with lines"] += 1
            notes.append(f"without a passage, {kind} {number}: {row_words(table, k)}")
    sys.stdout.write(
        "| without a passage | recordings | false, with lines | false, level-only "
        "| an hour |\n|---|---|---|---|---|\n"
    )
    for kind in SENSORS:
        one = rows[kind]
        wrong = one["with lines"] + one["level-only"]
        hours = one["recordings"] * QUIET_S / 3600.0
        sys.stdout.write(
            f"| {kind} | {one['recordings']} | {one['with lines']} "
            f"| {one['level-only']} | {rate(wrong, hours)} |\n"
        )
    sys.stdout.flush()
    return asked


class Scored(NamedTuple):
    """What a recipe makes of a recording of one passage."""

    counts: Counter
    """Found, false and due."""
    error: float
    """Relative error of d/v; nan of a passage that is not found."""
    notes: list[str]
    """Rows that are wrong, in words."""


def score(scenario: Scenario, table: Encounters) -> Scored:
    """Hold a table against the only passage of its recording."""
    time_s, width_s, _ = passages(scenario)[0]
    number = next(
        k for k, v in enumerate(scenario.vessels) if v.closest_approach is not None
    )
    limits = bounds(scenario, number)
    is_due = bool(max(limits["speed"], limits["width"]) < LARGEST_BOUND)
    off_s = np.abs(table.time_s - time_s)
    near = np.flatnonzero(off_s < max(1.0, width_s))
    order = np.lexsort((off_s[near], table.status[near] == "level-only"))
    best = int(near[order[0]]) if near.size else -1
    wrong = [k for k in range(table.n_encounters) if k != best]
    notes = [f"{row_words(table, k)}; true {time_s:.1f} s" for k in wrong]
    if is_due and best < 0:
        notes.append(f"due at {time_s:.1f} s, d/v {width_s:.1f} s, none")
    error = table.range_over_speed_s[best] / width_s - 1.0 if best >= 0 else np.nan
    counts = Counter({
        "passages": 1, "due": int(is_due), "found": best >= 0, "false": len(wrong),
        "found of due": int(is_due and best >= 0),
    })  # fmt: skip
    return Scored(counts, abs(float(error)), notes)


def with_passage(
    count: int, seed: int, notes: list[str]
) -> tuple[list[Asked], list[Asked]]:
    """Print what is found of drawn passages; return the true and false candidates."""
    true: list[Asked] = []
    false: list[Asked] = []
    totals = {recipe: Counter() for recipe in ("vessel", "auto")}
    errors: dict[str, list[float]] = {recipe: [] for recipe in totals}
    for number, scenario in of_each_sensor(
        count, seed, n_vessels=1, duration_s=PASSING_S
    ):
        for recipe, total in totals.items():
            with candidates() as found:
                table, cost = table_of(scenario, recipe)
            scored = score(scenario, table)
            total.update({**scored.counts, "cost": cost})
            errors[recipe].append(scored.error)
            notes += [f"passage {number}, {recipe}: {words}" for words in scored.notes]
        time_s, width_s, _ = passages(scenario)[0]
        for one in found:  # those of auto
            is_true = abs(one.time_s - time_s) < max(1.0, width_s)
            (true if is_true else false).append(one)
    both = np.isfinite(np.array(list(errors.values()))).all(axis=0)
    sys.stdout.write(
        "\n| one passage | found | found where due | false rows "
        "| median error of d/v, where both find it | cost |\n|---|---|---|---|---|---|\n"
    )
    for recipe, total in totals.items():
        median = 100 * np.median(np.array(errors[recipe])[both])
        sys.stdout.write(
            f"| {recipe} | {share(total['found'], total['passages'])} "
            f"| {share(total['found of due'], total['due'])} | {total['false']} "
            f"| {median:.2f} % of {both.sum()} "
            f"| {total['cost'] / totals['vessel']['cost']:.2f} |\n"
        )
    sys.stdout.flush()
    return true, false


def main(n_quiet: int, n_passing: int, seed: int) -> None:
    """Print both tables, the evidence of the candidates and every row that is wrong."""
    warnings.simplefilter("ignore")
    notes: list[str] = []
    sys.stdout.write(
        f"Made by `python -m tests.flow.drawn_recordings {n_quiet} {n_passing} {seed}`.\n\n"
    )
    quiet = without_passage(n_quiet, seed, notes) if n_quiet else []
    true, false = with_passage(n_passing, seed + 500, notes) if n_passing else ([], [])
    sys.stdout.write(
        "\n| candidates of lines that the sound was asked about | number | kept "
        f"| evidence at {', '.join(map(str, SHARES))} |\n|---|---|---|---|\n"
        f"{told_evidence('true', true)}\n"
        f"{told_evidence('false, beside a passage', false)}\n"
        f"{told_evidence('false, without a passage', quiet)}\n"
        "\n```text\n" + "\n".join(notes) + "\n```\n"
    )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:4]))
