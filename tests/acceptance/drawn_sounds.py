"""Parts of recordings that are drawn: 60 with vessels, 40 without."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tests.acceptance.outcomes import Outcome, run, run_drawn, score
from tests.draws import harder_motions, nothing_passes, other_sounds, ship_sounds
from tests.draws.passage_bounds import bounds
from tests.draws.random_passages import draw_scenario
from tests.draws.recordings import LARGEST_BOUND, Drawn, Passage, of_scenario
from tests.draws.vehicle_sounds import SOUND_MPS, SPEEDS_MPS, recording_file
from uwtrack_cli.simulate import Scenario

Case = Callable[[Path], Outcome]
Cases = dict[str, Case]

RATE_HZ, RATE_WITHOUT_HZ = 2000.0, 4000.0
SECONDS, SECONDS_OF_TWO, SECONDS_WITHOUT = 240.0, 300.0, 300.0


def _of_scenario(scenario: Scenario, seed: int, folder: Path) -> Outcome:
    return run_drawn(of_scenario(scenario, seed), folder)


def _due(seed: int, count: int, kinds: tuple[str, ...] | None) -> Iterator[tuple[int, Scenario]]:
    """Draw recordings of one vessel that is due from a seed on."""
    while count:
        scenario = draw_scenario(
            seed, n_vessels=1, kinds=kinds, sample_rate_hz=RATE_HZ, duration_s=SECONDS
        )
        place = next(number for number, one in enumerate(scenario.vessels) if one.closest_approach)
        least = bounds(scenario, place)
        if max(least["speed"], least["width"]) < LARGEST_BOUND:
            yield seed, scenario
            count -= 1
        seed += 1


def quiet(count: int, seed: int) -> Cases:
    """Draw one vessel in the noise of the sea alone."""
    return {
        f"quiet {number}": partial(_of_scenario, scenario, number)
        for number, scenario in _due(seed, count, ())
    }


def disturbed(count: int, seed: int) -> Cases:
    """Draw one vessel beside weather, machines and band edges, each by lot."""
    return {
        f"disturbed {number}": partial(_of_scenario, scenario, number)
        for number, scenario in _due(seed, count, None)
    }


def two_vessels(count: int, seed: int) -> Cases:
    """Draw two vessels in one recording."""

    def draw(number: int, folder: Path) -> Outcome:
        scenario = draw_scenario(
            number, n_vessels=2, kinds=(), sample_rate_hz=RATE_HZ, duration_s=SECONDS_OF_TWO
        )
        return _of_scenario(scenario, number, folder)

    return {f"two vessels {n}": partial(draw, n) for n in range(seed, seed + count)}


def vehicles(count: int, seed: int) -> Cases:
    """Draw cars, lorries, motorbikes and aircraft in air, of another generator."""
    kinds = [kind for kind in SPEEDS_MPS if kind != "ship"]

    def draw(number: int, kind: str, folder: Path) -> Outcome:
        path = folder / "drawn.wav"
        rng = np.random.default_rng([number, kinds.index(kind)])
        passing = [
            Passage(one.time_s, one.speed_mps, one.range_m)
            for one in recording_file(rng, kind, path)
        ]
        rows, _ = run(path, ("--sound-speed-mps", SOUND_MPS))
        return score(rows, passing)

    return {
        f"{kinds[k % len(kinds)]} {seed + k}": partial(draw, seed + k, kinds[k % len(kinds)])
        for k in range(count)
    }


def harder(count: int, seed: int) -> Cases:
    """Draw the motions of `harder_motions`, in turn."""

    def draw(number: int, kind: str, folder: Path) -> Outcome:
        return run_drawn(harder_motions.draw(kind, number), folder)

    kinds = harder_motions.KINDS
    return {
        f"{kinds[k % len(kinds)]} {seed + k}": partial(draw, seed + k, kinds[k % len(kinds)])
        for k in range(count)
    }


def ships(count: int, seed: int) -> Cases:
    """Draw ships as they sound, every third recording of two at once."""

    def draw(number: int, n_ships: int, folder: Path) -> Outcome:
        return run_drawn(ship_sounds.draw(number, n_ships), folder)

    return {
        f"{'two ships' if k % 3 == 2 else 'ship'} {seed + k}": partial(
            draw, seed + k, 2 if k % 3 == 2 else 1
        )
        for k in range(count)
    }


def nothing(count: int, seed: int) -> Cases:
    """Draw recordings without a passage, half of them of `nothing_passes`."""

    def disturbances(number: int, folder: Path) -> Outcome:
        scenario = draw_scenario(
            number, n_vessels=0, sample_rate_hz=RATE_WITHOUT_HZ, duration_s=SECONDS_WITHOUT
        )
        return _of_scenario(scenario, number, folder)

    def other(number: int, kind: str, folder: Path) -> Outcome:
        return run_drawn(nothing_passes.draw(kind, number), folder)

    kinds = nothing_passes.KINDS
    cases: Cases = {}
    for k in range(count):
        number = seed + k
        if k % 2:
            cases[f"disturbances {number}"] = partial(disturbances, number)
        else:
            kind = kinds[k // 2 % len(kinds)]
            cases[f"{kind} {number}"] = partial(other, number, kind)
    return cases


def foreign(count: int, seed: int) -> Cases:
    """Draw the sounds of `other_sounds`: whales, sonar, chains, hum, far ships."""

    def draw(number: int, folder: Path) -> Outcome:
        rate, sound, _ = other_sounds.draw(number)
        return run_drawn(Drawn(rate, sound), folder)

    return {f"foreign {n}": partial(draw, n) for n in range(seed, seed + count)}
