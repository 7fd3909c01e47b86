"""Where the thresholds of the checks of a passage come from: drawn sound.

Draws recordings with one vessel and without any, with the disturbances of real ones,
runs the chain with its checks switched off, and prints what each check says of the true
and of the false passages. A threshold lies where it refuses no true one:
`SMALLEST_EVIDENCE`, `LARGEST_MISFIT` and `SMALLEST_SLOPE` were set from 88 recordings
drawn by lot, 30 drawn ones with a vessel and 20 without (three
recipes each). With the lines that `track` follows now, 12 vessels of 28 dB Hz or more and
some recordings without any (seeds from 45000 and 55000, stopped there) confirm them: of
the true passages whose speed is told the six have evidence from 0.12, misfits to 0.08
and slopes from 0.69, and none is refused; the eight false ones have evidence to -0.02,
and all are. A recording takes some ten seconds; the third number is the first seed, the
fourth the least C/N0 (dB Hz) of a vessel's strongest line, below which a seed is passed
over (most faint vessels give no candidate at all), and the last line says what the
thresholds refuse among these draws:
python -m studies.constants.fit_checks 30 20
python -m studies.constants.fit_checks 12 3 45000 28
"""

import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.draws.random_passages import draw_scenario
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.passage.candidates import CandidatePassage, examine_contacts
from uwtrack_cli.motion.passage.checks.fit_checks import (
    LARGEST_MISFIT,
    SLOPE_DEVIATIONS,
    SMALLEST_SLOPE,
    doppler_misfit,
    level_slope,
)
from uwtrack_cli.motion.passage.checks.rest_frame import (
    SMALLEST_EVIDENCE,
    ask_the_sound,
)
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.simulate import Scenario, simulate_recordings

RECIPES = ("vessel", "small-craft", "vehicle")
"""Recipes that are run over recordings without a vessel."""

HEAD = f"{'truth':6}{'speed m/s':>10}{'d/v s':>8}{'evidence':>10}{'misfit':>8}  slope dB/dB"


def candidates(
    scenario: Scenario, recipe: str
) -> Iterator[tuple[CandidatePassage, Lines]]:
    """Yield the significant fits of the lines of a scenario, with what the sound says."""
    (simulated,) = simulate_recordings(scenario)
    if simulated.reader is None:
        return
    blocks = list(simulated.reader(1 << 20))
    recording = replace(simulated, reader=HeldSamples(np.concatenate(blocks)))
    made = run_recipe(recording, load_recipe(recipe))
    lines = next(item for item in made if isinstance(item, Lines))
    medium = nuisance_priors(recording.sensor, None, None, 3.0, 2.0).medium
    for item in examine_contacts(lines, medium, 1e-3)[0]:
        yield ask_the_sound(item, recording), lines


def describe(item: CandidatePassage, lines: Lines, scenario: Scenario) -> str:
    """Return the line of a candidate: true or false, and what each check says."""
    fit = item.fit
    width, time = float(fit.range_over_speed_s[0]), float(fit.theta[0, 0])
    passed = [v.closest_approach for v in scenario.vessels if v.closest_approach]
    is_true = any(abs(v.time_s - time) < max(5.0, width) for v in passed)
    slope, std = level_slope(item, lines)
    misfit = doppler_misfit(fit, item.blocks)
    return (
        f"{'true' if is_true else 'FALSE':6}{fit.theta[0, 2]:10.2f}{width:8.1f}"
        f"{item.rest_frame_evidence:10.2f}{misfit:8.2f}  {slope:.2f} +- {std:.2f}"
    )


def is_refused(item: CandidatePassage, lines: Lines) -> bool:
    """Return whether a check refuses a candidate, with its threshold."""
    slope, std = level_slope(item, lines)
    return bool(
        item.rest_frame_evidence < SMALLEST_EVIDENCE
        or doppler_misfit(item.fit, item.blocks) > LARGEST_MISFIT
        or slope + SLOPE_DEVIATIONS * std < SMALLEST_SLOPE
    )


def scenarios(count: int, n_vessels: int, seed: int, least: float) -> list[Scenario]:
    """Draw so many recordings; those of vessels that are too faint are passed over."""
    found: list[Scenario] = []
    while len(found) < count:
        one = draw_scenario(seed, n_vessels=n_vessels, sample_rate_hz=4e3)
        seed += 1
        heard = [line.cn0_db_hz or 0.0 for each in one.vessels for line in each.lines]
        if not n_vessels or max(heard, default=-np.inf) >= least:
            found.append(one)
    return found


def main(
    n_vessels: int, n_quiet: int, seed: int = 900, least_cn0_db_hz: float = -np.inf
) -> None:
    """Print a table of so many recordings with and without a vessel."""
    warnings.simplefilter("ignore")
    print(HEAD)
    refused: dict[bool, list[bool]] = {True: [], False: []}
    passing = scenarios(n_vessels, 1, seed, least_cn0_db_hz)
    quiet = scenarios(n_quiet, 0, seed + 10_000, -np.inf)
    for number, scenario in enumerate((*passing, *quiet)):
        is_quiet = number >= n_vessels
        for recipe in RECIPES if is_quiet else RECIPES[:1]:
            for item, lines in candidates(scenario, recipe):
                if np.isfinite(item.fit.covariance[0, 2, 2]):
                    words = describe(item, lines, scenario)
                    refused[words.startswith("true")].append(is_refused(item, lines))
                    print(words, flush=True)
    print(
        f"seeds from {seed}: refused {sum(refused[True])} of {len(refused[True])} true "
        f"and {sum(refused[False])} of {len(refused[False])} false passages"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
