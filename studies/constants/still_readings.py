"""Where the weight of "nothing passes" comes from: faint contacts, drawn and read.

Draws of tests/draws/measured_passages.py, passages and what stays in equal numbers, are made
faint by noise of up to 300 times that of the frequencies, 30 of the bearings and 15 of the
levels, so that many lie near the threshold at which a passage is told. Each is read by the
program; of those that it reads as nothing with a probability of about w, a share w should
be nothing, on both sides. It also prints what each kind is read as.

Ten of each kind take two minutes; the first seed may be given:
python -m studies.constants.still_readings 10 640000
"""

import sys
import warnings
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tests.draws.measured_passages import BEND, KINDS, SENSOR, STILL, draw, is_clear
from tests.support import binomial_interval as interval
from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.passage.candidates import CandidatePassage, fit_contact, read
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import series_data
from uwtrack_cli.motion.passage.readings.competing_readings import Reading

FIRST_SEED = 640_000
"""Seeds that no table and no test uses."""

PASSING = (*(kind for kind in KINDS if kind not in STILL), BEND)
"""Kinds of the draws in which something passes."""

LOUDEST = (2.5, 1.5, 1.2)
"""Decades by which the noise of frequencies, bearings and levels is raised at most."""

EDGES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)
"""Bounds of the probabilities that are counted together."""

PRIORS = nuisance_priors(SENSOR, None, None, 3.0, 2.0)


class Outcome(NamedTuple):
    """What one drawn contact is read as."""

    kind: str
    """What was drawn."""
    is_told: bool
    """Whether it is told as a passage."""
    reading: Reading
    """What it is read as."""

    @property
    def passes(self) -> bool:
        """Whether something passes in the draw."""
        return self.kind not in STILL


def faint(
    series: Series,
    rng: np.random.Generator,
    most: tuple[float, float, float] = LOUDEST,
    least: float = 0.0,
) -> Series:
    """Return a table with more noise, as stated as it is drawn.

    Parameters
    ----------
    series
        Table of one contact.
    rng
        Source of chance.
    most
        Decades by which the noise of each kind is raised at most.
    least
        Share of them by which it is raised at least.
    """
    columns = {}
    names = ("frequency{}_hz", "bearing{}_deg", "level{}_db")
    for name, decades in zip(names, most, strict=True):
        factor = 10 ** rng.uniform(least * decades, decades)
        value, std = (getattr(series, name.format(part)) for part in ("", "_std"))
        more = std * np.sqrt(factor**2 - 1) * rng.normal(size=std.shape)
        columns[name.format("")] = value + more
        columns[name.format("_std")] = std * factor
    columns["bearing_deg"] = columns["bearing_deg"] % 360.0
    return replace(series, **columns)


def outcome(kind: str, seed: int) -> Outcome | None:
    """Draw one contact and read it; None if it is too unclear to be one."""
    drawn = draw(kind, seed)
    if kind not in STILL and not is_clear(drawn):
        return None
    series = faint(drawn.series, np.random.default_rng([seed, 77]))
    lines = np.arange(1, 1 + series.frequency_hz.shape[1])
    one = fit_contact(series_data(series, 1), (1,), lines, PRIORS.medium, 1e-3)
    if one is None:
        return None
    if isinstance(one, CandidatePassage):
        return Outcome(kind, is_told=True, reading=read(one).reading)
    return Outcome(kind, is_told=False, reading=one.read().reading)


def share(found: list[Outcome]) -> str:
    """Return how many of them are nothing, with the exact interval of that share."""
    nothing = sum(not one.passes for one in found)
    low, high = interval(nothing, len(found))
    return f"{nothing} of {len(found)} ({low:.0%} to {high:.0%})"


def calibration(found: list[Outcome]) -> list[str]:
    """Return how probable nothing was, and how often it was, in Markdown."""
    lines = ["| probability of nothing | contacts | mean | nothing drawn | told |"]
    lines.append("|---|---|---|---|---|")
    for low, high in pairwise(EDGES):
        own = [o for o in found if low <= o.reading.nothing < high + (high == 1.0)]
        if own:
            mean = np.mean([one.reading.nothing for one in own])
            told = sum(one.is_told for one in own)
            lines.append(
                f"| {low:g} to {high:g} | {len(own)} | {mean:.3f} | {share(own)} | {told} |"
            )
    return lines


def confusion(found: list[Outcome]) -> list[str]:
    """Return what each kind is read as, in Markdown."""
    names = sorted({one.reading.name for one in found})
    lines = ["| drawn | " + " | ".join(names) + " | told |"]
    lines.append("|---" * (len(names) + 2) + "|")
    for kind in dict.fromkeys(one.kind for one in found):
        own = [one for one in found if one.kind == kind]
        cells = [str(sum(o.reading.name == name for o in own)) for name in names]
        told = sum(one.is_told for one in own)
        lines.append(f"| {kind} | " + " | ".join(cells) + f" | {told} |")
    return lines


def main(count: int, first: int) -> None:
    """Print the tables; what stays is drawn as often as what passes."""
    warnings.simplefilter("ignore")
    numbers = dict.fromkeys(PASSING, count)
    numbers |= dict.fromkeys(STILL, round(count * len(PASSING) / len(STILL)))
    every = [outcome(kind, first + k) for kind, n in numbers.items() for k in range(n)]
    found = [one for one in every if one is not None]
    tables = calibration(found), confusion(found)
    sys.stdout.write("\n\n".join("\n".join(table) for table in tables) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED)
