"""Where the threshold of `rises` comes from: drawn sound with and without a passage.

Prints how many rises an hour of sound without a vessel has above each height, in noise
alone and with the disturbances of real recordings, and how high brief passages stand,
with their broadband and without it. The threshold lies where noise has fewer than one
an hour. Of the rises of lines above the default height it prints how many keep their
frequencies, fall and climb. The second number is the first seed: the height was chosen
on 100, what falls and climbs on 4200. A recording takes a second:
python -m studies.constants.transients 20 100
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.draws.brief_passages import passages, small_craft, vehicle
from tests.draws.random_passages import draw_scenario
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.data.transients import CLIMB, FALL, LEVEL, LINES, Transients
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import Scenario, simulate_recordings
from uwtrack_cli.spectra import transients as stage
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

HEIGHTS = (4.0, 5.0, 6.0, 7.0, 8.0, 10.0)
"""Heights for which rises are counted, spreads."""

DURATION_S = 600.0
"""Length of a recording without a vessel, s."""

RATE_HZ = 4000.0
"""Its sample rate, Hz."""


def short_frames(scenario: Scenario) -> Iterator[Spectrogram]:
    """Return the short frames of a scenario, with the options of recipe `auto`."""
    recipe: Recipe = load_recipe("auto")
    (options,) = [s.options for s in recipe.steps if s.name == "short-spectrogram"]
    (recording,) = simulate_recordings(scenario)
    return compute_spectrogram(recording, **options)


def movements(found: list[Transients], default: float = 7.0) -> str:
    """Tell how many rises of lines keep their frequencies, fall and climb."""
    kind = np.concatenate([one.kind[one.spreads > default] for one in found])
    return ", ".join(f"{word} {np.count_nonzero(kind == word)}" for word in (LINES, FALL, CLIMB))


def rises_of(scenario: Scenario, least: float) -> Transients:
    """Return the rises of a scenario above a height."""
    blocks = stage.find_transients(short_frames(scenario), least_spreads=least)
    return Transients.join(list(blocks))


def quiet(seed: int, kinds: list[str] | None) -> Scenario:
    """Draw a recording without a vessel."""
    return draw_scenario(
        seed, n_vessels=0, kinds=kinds, sample_rate_hz=RATE_HZ, duration_s=DURATION_S
    )


def lines_alone(draw: Callable[[int], Scenario]) -> Callable[[int], Scenario]:
    """Leave the broadband of a passage out."""

    def drawn(seed: int) -> Scenario:
        scenario = draw(seed)
        vessels = tuple(replace(v, broadband=None) for v in scenario.vessels)
        return replace(scenario, vessels=vessels)

    return drawn


def without_passage(name: str, kinds: list[str] | None, seeds: range) -> None:
    """Print the rises an hour above each height."""
    hours = len(seeds) * DURATION_S / 3600
    found = [rises_of(quiet(seed, kinds), HEIGHTS[0]) for seed in seeds]
    for kind in (LEVEL, LINES):
        height = np.concatenate(
            [one.spreads[(one.kind == LEVEL) == (kind == LEVEL)] for one in found]
        )
        told = "  ".join(f"{np.sum(height > h) / hours:6.1f}" for h in HEIGHTS)
        print(f"{name:22}{kind:8}{told}   ({hours:.1f} h)", flush=True)
    print(f"{name:22}{movements(found)}", flush=True)


def with_passage(name: str, draw: Callable[[int], Scenario], seeds: range) -> None:
    """Print how many passages stand above each height, by either kind of rise."""
    best: dict[str, list[float]] = {LEVEL: [], LINES: []}
    nearby = []
    for seed in seeds:
        scenario = draw(seed)
        ((time_s, width_s, _),) = passages(scenario)
        found = rises_of(scenario, 1.0)
        near = np.abs(found.time_s - time_s) < max(1.0, width_s)
        nearby.append(found.take("transient", np.flatnonzero(near)))
        for kind, values in best.items():
            own = found.spreads[near & ((found.kind == LEVEL) == (kind == LEVEL))]
            values.append(float(own.max(initial=0.0)))
    either = np.maximum(best[LEVEL], best[LINES])
    for kind, height in (*best.items(), ("either", either)):
        told = "  ".join(f"{np.mean(np.array(height) > h):6.2f}" for h in HEIGHTS)
        print(f"{name:22}{kind:8}{told}", flush=True)
    print(f"{name:22}{movements(nearby)}", flush=True)


def main(n_recordings: int, seed: int) -> None:
    """Print the tables for so many recordings of each kind."""
    seeds = range(seed, seed + n_recordings)
    print(f"{'':30}" + "  ".join(f"{h:6g}" for h in HEIGHTS))
    without_passage("noise", [], seeds)
    without_passage("disturbances", None, seeds)
    for name, draw in (("vehicle", vehicle), ("small craft", small_craft)):
        with_passage(name, draw, seeds)
        with_passage(f"{name}, lines", lines_alone(draw), seeds)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
