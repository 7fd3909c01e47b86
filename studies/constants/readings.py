"""Where the odds against a change beside a passage come from: drawn passages.

Draws passages that are straight, that jitter, that step or ramp their frequencies and
that manoeuvre, at once or bending for long, and weighs their readings with several
odds: how many of those that did not change are read as changed, how many that did are
read as straight, and which share of all quantities (time, range over speed, speed) lies
within 1.96 deviations and beyond 5. `ODDS` is the smallest number of nepers with at most 5 % of false changes among the
straight ones and those that jitter. Of 40 (20 each) none is one at 3, two are at 2,
four at 1 and six at 0; of 56 others with jitter that were read with 2 eleven were.
Of 14 that bend for long two are read as straight at 2 and at 6, one at 0.
Twenty of each kind take some minutes; kinds may be named:
python -m studies.constants.readings 40
python -m studies.constants.readings 20 straight jitter
"""

import sys
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tests.draws.measured_passages import BEND, KINDS, SENSOR, draw, is_clear
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.candidates import CandidatePassage, examine
from uwtrack_cli.motion.passage.fit.nuisances import marginalise, nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import Blocks, series_data
from uwtrack_cli.motion.passage.readings import competing_readings as readings
from uwtrack_cli.motion.passage.readings.change_priors import ODDS, STRAIGHT

FIRST_SEED = 500_000
"""Seeds that no table and no test uses."""

TRIED = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0)
"""Odds that are tried, nepers."""

CHANGED = (*KINDS[:-1], BEND)
"""Kinds that are drawn; a machine is no passage."""

PRIORS = nuisance_priors(SENSOR, None, None, 3.0, 2.0)


class Outcome(NamedTuple):
    """A drawn passage read with some odds."""

    name: str
    """The reading."""
    deviations: FloatArray
    """Errors of time, range over speed and speed in stated deviations."""


def found(kind: str, count: int) -> Iterator[tuple[CandidatePassage, FloatArray]]:
    """Yield the candidates of so many drawn passages, with their truth."""
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        drawn = draw(kind, seed)
        lines = np.arange(1, 1 + drawn.series.frequency_hz.shape[1])
        data = series_data(drawn.series, 1)
        if not is_clear(drawn):
            continue
        one = examine(data, (1,), lines, PRIORS.medium, 1e-3)
        # one that was found beside a change of its own has been weighed already
        if one is not None and one.fit.change is None:
            yield one, drawn.truth[[0, 3, 1]]


def outcome(tried: readings.Tried, blocks: Blocks, truth: FloatArray, odds: float) -> Outcome:
    """Weigh the readings of a candidate with some odds."""
    ODDS.update(dict.fromkeys(ODDS, odds))
    fit, reading = readings.weigh_readings(tried, blocks)
    fit = marginalise(fit, PRIORS)[0]
    answer = np.array([fit.theta[0, 0], fit.range_over_speed_s[0], fit.theta[0, 2]])
    deviation = np.sqrt(np.diag(fit.covariance[0])[:3])
    return Outcome(reading.name, (answer - truth) / deviation)


def main(count: int, kinds: tuple[str, ...]) -> None:
    """Print a line for every kind and odds."""
    warnings.simplefilter("ignore")
    for kind in kinds:
        items = [
            (readings.try_readings(item.fit, item.blocks), item.blocks, truth)
            for item, truth in found(kind, count)
        ]
        for odds in TRIED:
            made = [outcome(*item, odds) for item in items]
            straight = np.mean([one.name == STRAIGHT for one in made])
            values = np.abs([one.deviations for one in made])
            values = values[np.isfinite(values)]
            print(
                f"{kind} odds {odds:g}: {len(made)} found, straight {straight:.1%}, "
                f"within 1.96 {(values < 1.96).mean():.1%}, "
                f"beyond 5 {(values > 5).mean():.2%}",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]), tuple(sys.argv[2:]) or CHANGED)
