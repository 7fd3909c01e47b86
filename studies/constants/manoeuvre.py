"""How often a straight target is said to alter its velocity, and one that does is found.

Draws records of the published scenarios with straight targets and with targets that
turn or change their speed half way, and prints the probability of an alteration: for
straight ones the share of more than a half is that of false alterations, for the others
that of those found. Some seconds for ten records of each:
python -m studies.constants.manoeuvre 60

"straight" leaves the others out, and the last line has the false alterations of all with
their exact interval: python -m studies.constants.manoeuvre 60 4000 straight

"worth" fits an alteration to every record, and prints how small the probability of the
linear model is where the fitted one is above a half (`WORTH_A_FIT` of the package):
python -m studies.constants.manoeuvre 1 11 worth

"hidden" prints by how much the true motion of a target that goes from 8 to 9 knots beside
an own ship that circles is likelier than the best straight one, nuisances fitted, and what
the unknowns of the alteration cost: python -m studies.constants.manoeuvre 10 100 hidden
"""

import sys
from dataclasses import replace

import numpy as np
from scipy.stats import binomtest

from studies.tma_runs import fit_from_truth
from studies.tma_scenarios import (
    COUNT,
    REST_HZ,
    SOUND_SPEED_MPS,
    STEP_S,
    TARGETS,
    make_problem,
    make_scenario,
)
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.target_motion import legs
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.legs import find_legs, seek_alteration
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.row_noise import NO_MEMORY
from uwtrack_cli.motion.target_motion.solvers.marquardt import minimise, search_bounds

KNOWN = NuisanceDeviations(7.4, 1.0, 10.0, 0.1, 100.0)
BOUNDS = search_bounds((20.0, 200_000.0), 18.0)
TURNS = ((10.0, 0.0), (30.0, 0.0), (90.0, 0.0), (0.0, 1.0))
"""Turns in degrees and changes of speed in knots at the middle of the record."""


def turned(problem: Problem, name: str, turn_deg: float, faster_kn: float) -> Problem:
    """Return records whose target changes its velocity half way."""
    scenario = make_scenario(name)
    time = STEP_S * np.arange(-1, COUNT)
    half = time[COUNT // 2 + 1]
    course = np.radians(scenario.course_deg)
    before = scenario.speed_mps * np.array([np.sin(course), np.cos(course)])
    speed = scenario.speed_mps + faster_kn * 1852.0 / 3600.0
    course += np.radians(turn_deg)
    after = speed * np.array([np.sin(course), np.cos(course)])
    extra = np.maximum(time - half, 0.0)[:, np.newaxis] * (after - before)
    start = np.radians(scenario.bearing_deg)
    at = scenario.range_m * np.array([np.sin(start), np.cos(start)])
    place = at + time[:, np.newaxis] * before
    own = np.stack([scenario.own_east_m, scenario.own_north_m], axis=1)
    bearing, frequency = _heard(place + extra - own)
    still = _heard(place - own)
    return replace(
        problem,
        bearing_rad=problem.bearing_rad + bearing - still[0],
        frequency_hz=problem.frequency_hz + frequency - still[1],
    )


def _heard(relative: FloatArray) -> tuple[FloatArray, FloatArray]:
    distance = np.hypot(relative[:, 0], relative[:, 1])
    rate = np.diff(distance) / STEP_S
    bearing = np.arctan2(relative[1:, 0], relative[1:, 1])
    return bearing, REST_HZ * (1.0 - rate / SOUND_SPEED_MPS)


def probabilities(
    name: str, noise: float, runs: int, change: tuple[float, float], seed: int
) -> FloatArray:
    """Return probabilities of an alteration, of so many records of a scenario."""
    problem = make_problem(make_scenario(name), noise=noise, runs=runs, seed=seed)
    problem = turned(problem, name, *change)
    fit = fit_from_truth(problem, make_scenario(name).solution())
    found = [find_legs(problem.record(k), fit.take([k]), BOUNDS, KNOWN) for k in range(runs)]
    return np.array([one.probability for one in found])


def worth(runs: int, seed: int) -> None:
    """Print probabilities of the linear model where the fit finds an alteration."""
    legs.WORTH_A_FIT = 0.0
    linear, fitted = [], []
    for name in TARGETS:
        for noise in (1.0, 5.0):
            for change in ((0.0, 0.0), *TURNS):
                scenario = make_scenario(name)
                problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
                problem = turned(problem, name, *change)
                fit = fit_from_truth(problem, scenario.solution())
                for k in range(runs):
                    one, start = problem.record(k), fit.take([k])
                    found = seek_alteration(one, start.q[0], KNOWN)
                    linear.append(found.probability)
                    fitted.append(find_legs(one, start, BOUNDS, KNOWN).probability)
    first, last = np.array(linear), np.array(fitted)
    asked = first[last > 0.5]
    low = np.quantile(asked, [0.0, 0.01, 0.05])
    print(f"seed {seed}: {asked.size} of {last.size} records ask for an alteration")
    print("linear probability of these, least, 1 and 5 %:", np.round(low, 3))
    for limit in (0.05, 0.15, 0.5):
        share, missed = (first > limit).mean(), int((asked <= limit).sum())
        print(f"from {limit}: {share:.2f} of all are fitted, {missed} are missed")


def hidden(runs: int, seed: int) -> None:
    """Print what tells a change of speed beside a circling own ship, record by record."""
    true = make_scenario("S2").solution()
    faster = true[2:] / np.hypot(*true[2:]) * 1852.0 / 3600.0
    half = STEP_S * (COUNT // 2 - 0.5)
    altered = np.concatenate([true, faster, [half, np.log(2.0 * STEP_S)]])
    told, cost = [], []
    for k in range(runs):
        drawn = make_problem(make_scenario("S2"), noise=1.0, seed=seed + k)
        problem = legs._with_durations(turned(drawn, "S2", 0.0, 1.0).record(0))  # noqa: SLF001
        straight = fit_from_truth(problem, true).q[0]
        limits = legs.with_one_more(BOUNDS, problem)
        best = minimise(problem, altered[np.newaxis], limits, iterations=200).q[0]
        models = [legs._Linear(problem, q, KNOWN) for q in (straight, best, altered)]  # noqa: SLF001
        least = [0.5 * one.least(NO_MEMORY)[0] for one in models]
        odds = models[1].evidence(NO_MEMORY) - models[0].evidence(NO_MEMORY)
        told.append(least[0] - least[2])
        cost.append(least[0] - least[1] - odds)
    for name, values in (("log likelihood of the truth over straight", told), ("cost", cost)):
        print(f"{name}: {min(values):.1f} to {max(values):.1f}, median {np.median(values):.1f}")


def main(runs: int, seed: int = 11, *, only_straight: bool = False) -> None:
    """Print a line for every scenario, noise and change, and the false ones of all."""
    changes = ((0.0, 0.0), *(() if only_straight else TURNS))
    false, straight = 0, 0
    for name in TARGETS:
        for noise in (1.0, 5.0):
            for change in changes:
                found = probabilities(name, noise, runs, change, seed)
                median, high = np.quantile(found, [0.5, 0.98])
                share = (found > 0.5).mean()
                if change == (0.0, 0.0):
                    false, straight = false + int((found > 0.5).sum()), straight + runs
                print(
                    f"{name} noise {noise:g} turn {change[0]:g} deg {change[1]:+g} kn: "
                    f"median {median:.2f}, 98 % {high:.2f}, found {share:.3f}",
                    flush=True,
                )
    low, high = binomtest(false, straight).proportion_ci(method="exact")
    print(f"seed {seed}: false alterations {false} of {straight} ({low:.1%} to {high:.1%})")


if __name__ == "__main__":
    if "worth" in sys.argv:
        worth(*map(int, sys.argv[1:3]))
    elif "hidden" in sys.argv:
        hidden(*map(int, sys.argv[1:3]))
    else:
        main(*map(int, sys.argv[1:3]), only_straight="straight" in sys.argv)
