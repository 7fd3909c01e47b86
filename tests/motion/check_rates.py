"""How often the checks of a fit widen or refuse what is true, and what is not.

The passages of `drawn_readings` are given to `cpa` as tracked lines, whose levels follow
the range and fade, and go through reading and checks; without sound, so that the test
in the rest frame is not among them. Then straight ones are spoilt in ways that no
reading knows. For each, deviations before and after the checks are held against the
truth. The table in tests/baselines/fit_checks.md is made by:
python -m tests.motion.check_rates 20 30 130000
"""

import sys
import warnings
from typing import NamedTuple

import numpy as np

from tests.motion.drawn_readings import (
    BEND,
    CLOSEST_S,
    KINDS,
    LENGTH_S,
    SENSOR,
    draw,
    is_clear,
)
from tests.motion.nuisance_coverage import interval
from tests.motion.passing_vessel import frames_of, lines_of_columns
from uwtrack_cli.motion.passage.candidates import (
    RecordingSpan,
    examine_contacts,
    not_a_passage,
    read,
)
from uwtrack_cli.motion.passage.checks.fit_checks import check_fit
from uwtrack_cli.motion.passage.fit.nuisances import marginalise, nuisance_priors

TRUE = (*(kind for kind in KINDS if kind != "machinery"), BEND)
SPOILT = ("a line leaves", "lines wander", "lines of others", "steady levels")
"""Ways in which measurements leave what the readings know."""

PRIORS = nuisance_priors(SENSOR, None, None, 3.0, 2.0)
SPAN = RecordingSpan(1.0, 0.0, LENGTH_S)
WIDER = 1.05
"""Factor on a deviation from which it counts as widened."""


def wander(rng, count, memory_s):
    """Draw a process of unit variance that forgets exponentially."""
    decay, value = np.exp(-1.0 / memory_s), rng.normal(size=count)
    for k in range(1, count):
        value[k] = decay * value[k - 1] + np.sqrt(1 - decay**2) * value[k]
    return value


def others_of(count):
    """Return which of so many lines are a machine's: more than half of them."""
    return slice((count - 1) // 2, count)


def spoiled(drawn, spoilt, rng):
    """Return the frequencies of a drawn passage, Hz, spoilt in one way."""
    time, frequency = drawn.series.time_s, drawn.series.frequency_hz.copy()
    count = frequency.shape[1]
    shift = drawn.truth[1] / drawn.facts.sound_mps
    if spoilt == "a line leaves":  # by two thirds of the whole shift
        slope = rng.choice([-1, 1]) * 4 / 3 * shift / LENGTH_S
        frequency[:, 0] *= 1 + slope * (time - CLOSEST_S)
    elif spoilt == "lines wander":
        for k in range(count):
            frequency[:, k] *= 1 + 0.3 * shift * wander(rng, time.size, 30.0)
    elif spoilt == "lines of others":
        others = others_of(count)
        steady = np.nanmedian(frequency[:, others], axis=0)
        frequency[:, others] = steady * (1 + 1e-5 * rng.normal(size=(time.size, 1)))
    return frequency


def columns_of(drawn, spoilt, rng):
    """Return the points of the lines of a drawn passage, spoilt in one way.

    Levels fall with the range, as the density that gives the deviations does, and fade.
    """
    series = drawn.series
    time, std = series.time_s, series.frequency_std_hz
    frequency = spoiled(drawn, spoilt, rng)
    level_db = -20 * np.log10(std[:, 0] / np.nanmin(std[:, 0]))
    bearing = series.bearing_deg, series.bearing_std_deg
    if spoilt == "steady levels":  # bearings alone would show the passage
        level_db, bearing = 0.0 * level_db, np.full((2, time.size), np.nan)
    fade_db, columns = rng.uniform(0.0, 6.0), []
    count = frequency.shape[1]
    foreign = range(count)[others_of(count)] if spoilt == "lines of others" else ()
    for k in range(count):
        fades = fade_db * wander(rng, time.size, rng.uniform(10.0, 60.0))
        told, heard = level_db, bearing
        if k in foreign:  # it lies somewhere, and stays there
            told = 0.0 * level_db
            still = 70.0 + bearing[1] * rng.normal(size=time.size)
            heard = still % 360.0, bearing[1]
        columns.append((
            np.full(time.size, k + 1), frequency[:, k], std[:, k], *heard,
            100.0 + told + fades,
        ))  # fmt: skip
    return [np.concatenate(column) for column in zip(*columns, strict=True)]


class Checked(NamedTuple):
    """What the checks did to one drawn passage."""

    outcome: str
    """'nothing', 'refused' or 'told'."""
    scale: float
    """Largest factor on its deviations."""
    before: np.ndarray
    """Errors of time, d/v and speed in deviations without the checks; nan if nothing is
    told without them."""
    after: np.ndarray
    """The same with them; nan where it is refused."""


def deviations(fit, truth):
    """Return the errors of time, d/v and speed of a fit in its deviations.

    A speed within three deviations of zero is not told.
    """
    fit = marginalise(fit, PRIORS)[0]
    answer = np.array([fit.theta[0, 0], fit.range_over_speed_s[0], fit.theta[0, 2]])
    std = np.sqrt(np.diag(fit.covariance[0])[:3])
    off = (answer - truth) / std
    if not answer[2] > 3.0 * std[2]:
        off[2] = np.nan
    return off


def check(kind, spoilt, seed):
    """Draw, spoil, read and check one passage."""
    rng = np.random.default_rng([seed, 17])
    number = seed
    drawn = draw(kind, number)
    fewest = {"": 1, "steady levels": 1, "lines of others": 3}.get(spoilt, 2)
    while not is_clear(drawn) or drawn.series.frequency_hz.shape[1] < fewest:
        number += 1_000_000
        drawn = draw(kind, number)
    frames = frames_of(LENGTH_S)
    columns = columns_of(drawn, spoilt, rng)
    kept = np.isfinite(columns[1]) & np.isfinite(columns[2])
    contacts = [1] * drawn.series.frequency_hz.shape[1]
    lines = lines_of_columns(frames, columns, contacts).take(
        "point", np.flatnonzero(kept)
    )
    nothing = np.full(3, np.nan)
    found = [
        one for one in map(read, examine_contacts(lines, PRIORS.medium, 1e-3)[0])
        if not_a_passage(one.fit, one.blocks, SPAN) is None
    ]  # fmt: skip
    if not found:
        return Checked("nothing", np.nan, nothing, nothing)
    one = found[0]
    checked = check_fit(one, lines)
    truth = drawn.truth[[0, 3, 1]]
    before = deviations(one.fit, truth)
    scale = np.sqrt(np.diag(checked.fit.covariance[0]) / np.diag(one.fit.covariance[0]))
    if checked.doubt:
        return Checked("refused", float(np.nanmax(scale)), before, nothing)
    after = deviations(checked.fit, truth)
    return Checked("told", float(np.nanmax(scale)), before, after)


def row(name, found):
    """Return the row of a table: outcomes, and how the intervals hold."""
    names = [one.outcome for one in found]
    told = [one for one in found if one.outcome == "told"]
    wider = sum(one.scale > WIDER for one in told)
    cells = [name, str(len(found)), str(names.count("nothing"))]
    for count, total in ((names.count("refused"), len(found)), (wider, len(told))):
        low, high = interval(count, total) if total else (np.nan, np.nan)
        cells.append(f"{count} of {total} ({low:.1%} to {high:.1%})")
    scales = [one.scale for one in told if one.scale > WIDER]
    cells.append(f"{np.median(scales):.2f}" if scales else "")
    for values in ([one.before for one in found], [one.after for one in found]):
        ratio = np.abs(np.ravel(values))
        ratio = ratio[np.isfinite(ratio)]
        if ratio.size:
            cells += [
                f"{(ratio < 1.96).mean():.1%} of {ratio.size}",
                f"{(ratio > 5).sum()}",
            ]
        else:
            cells += ["", ""]
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "drawn", "passages", "nothing", "refused (95 %)", "widened (95 %)", "median factor",
    "within 1.96 before", "beyond 5", "within 1.96 after", "beyond 5",
)  # fmt: skip


def main(n_true, n_spoilt, first):
    """Write what the checks do to so many passages of each kind, in Markdown."""
    warnings.simplefilter("ignore")
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    every = []
    for kind in TRUE:
        found = [check(kind, "", first + k) for k in range(n_true)]
        every += found
        lines.append(row(kind, found))
    lines.append(row("every true one", every))
    for spoilt in SPOILT:
        found = [check("straight", spoilt, first + 1000 + k) for k in range(n_spoilt)]
        lines.append(row(spoilt, found))
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]))
