"""Where odds and exponents of the decision come from, and how far probabilities are right.

Draws recordings with vessels near the threshold (bounds of speed or R/v from 3 to 50 %),
disturbed ones, ships of many teeth, motions that are not straight, vehicles in air, and those in which
nothing passes; runs `auto` over them and keeps what was measured of every candidate, told
or refused. A candidate is right where a vessel passes within three standard deviations of
its time, or half of R/v, no quantity of the row is beyond five, and R/v is known to 50 %. The log
odds are linear in the log evidences; exponents are not negative, and drawn to 0.15 by a
ridge, so that a kind of measurement which says nothing new counts little. Prints odds and
exponents, and for recordings that were left out of the fit (eighths of them in turn) how
many candidates of each probability are right; `check` says it of the probabilities that the
program states, on draws of their own:
python -m studies.constants.passage_probability draw candidates.pkl 511000 16
python -m studies.constants.passage_probability fit candidates.pkl
python -m studies.constants.passage_probability check others.pkl
"""

import pickle
import sys
import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import isfinite, log, log1p, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize

from tests.acceptance.outcomes import run
from tests.draws import harder_motions, nothing_passes, other_sounds, ship_sounds
from tests.draws.passage_bounds import bounds
from tests.draws.random_passages import draw_scenario
from tests.draws.recordings import Drawn, Passage, of_scenario
from tests.draws.vehicle_sounds import SOUND_MPS, SPEEDS_MPS, recording_file
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.flow import zoom
from uwtrack_cli.motion import alternatives, cpa
from uwtrack_cli.motion.alternatives import Measured, compressed, value_of
from uwtrack_cli.motion.decision import (
    ALTERNATIVES,
    LEAST_PROBABILITY,
    LOG_ODDS,
    MOST_NEPERS,
    kind_of,
)
from uwtrack_cli.motion.passage import candidates as decided_by
from uwtrack_cli.motion.passage.candidates import passage_evidence

MISFIT, OTHER_MISFIT = 0.1, 0.5
"""Scale of the misfit of lines of a passage, and of what is none, as shares of v/c."""

ENOUGH_FLANK = 0.7
"""R/v before or after the closest approach from which a drift no longer looks like it."""


def two_scales(value: float, narrow: float, wide: float) -> float:
    """Return the log ratio of two half-normal densities."""
    return 0.5 * (value / wide) ** 2 - 0.5 * (value / narrow) ** 2 + log(wide / narrow)


def noise(measured: Measured) -> float:
    """Return what the passage gains over noise of any colour, a drift and a break."""
    names = ("gain", "gain_over_line", "gain_over_break")
    return compressed(min(value_of(measured, name) for name in names))


def misfit(measured: Measured) -> float:
    """Return what lines that keep to their curve, or leave it, say."""
    return two_scales(value_of(measured, "misfit"), MISFIT, OTHER_MISFIT)


def no_tones(measured: Measured) -> float:
    """Return what tones, or noise that was tracked, say in the sound itself."""
    return log1p(max(value_of(measured, "tones"), 0.0) / 10.0) - log(2.0)


def sub_bands_disagree(measured: Measured) -> float:
    """Return what times and widths of the sub-bands say of one rise."""
    chance = value_of(measured, "sub_bands_agree")
    return log(max(chance, 1e-5) / 0.05) if isfinite(chance) else nan


def short_flank(measured: Measured) -> float:
    """Return what was recorded on the shorter side says of a drift."""
    flank = min(value_of(measured, "before"), value_of(measured, "after"))
    return log(min(max(flank, 0.05) / ENOUGH_FLANK, 1.0))


TRIED = (
    *(one.log_evidence for one in ALTERNATIVES), noise, misfit, no_tones,
    sub_bands_disagree, short_flank,
)  # fmt: skip
"""Every log evidence that is tried."""

FIXED = (alternatives.too_fast, alternatives.unusual_speed, alternatives.part_of_another)
"""Priors, which no exponent tempers."""

N_ODDS, RIDGE, USUAL_EXPONENT = len(LOG_ODDS), 1.5, 0.15
"""Log odds before; strength of the ridge, and the exponent that it draws to."""

KINDS = (
    "near", "nothing", "other", "vehicle", "disturbed", "near again", "harder",
    "standing", "other in air", "ships",
)  # fmt: skip
"""Kinds of recordings, one of each for a seed."""

STATED = (
    "time_s", "time_std_s", "range_over_speed_s", "range_over_speed_std_s", "speed_mps",
    "speed_std_mps",
)  # fmt: skip
"""What a row states, which is held against the truth."""

LARGEST_RELATIVE_STD = 0.5
"""Relative standard deviation of R/v, by the fit, from which a row is of no use."""

WEIGHTS = {"standing": 0.5, "other in air": 0.5}
"""Weight of kinds other than one: as many recordings in air have a vehicle as none."""

RATE_HZ, SECONDS = 2000.0, 240.0
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
Record = dict[str, Any]


def drawn(kind: str, seed: int) -> Drawn:
    """Draw a recording of one kind in water."""
    if kind == "nothing":
        return nothing_passes.draw(nothing_passes.KINDS[seed % len(nothing_passes.KINDS)], seed)
    if kind in {"other", "other in air"}:
        rate, sound, _ = other_sounds.draw(seed)
        # a clip of what may be heard in air is as long as those of vehicles
        size = sound.size if kind == "other" else int(45 * rate)
        return Drawn(rate, sound[:size])
    if kind == "ships":
        return ship_sounds.draw(seed, 1 + seed % 2)
    if kind == "harder":
        kinds = harder_motions.KINDS
        return harder_motions.draw(kinds[seed % len(kinds)], seed)
    seed += 50_000 * (kind == "near again")
    while True:
        disturbances = None if seed % 2 or kind == "disturbed" else ()
        scenario = draw_scenario(
            seed, n_vessels=1, kinds=disturbances, sample_rate_hz=RATE_HZ, duration_s=SECONDS
        )
        least = bounds(scenario, 0)
        worst = max(least["speed"], least["width"])
        if kind == "disturbed" or 0.03 < worst < 0.5:
            return of_scenario(scenario, seed)
        seed += 100_000


def write(kind: str, seed: int, path: Path) -> tuple[list[Passage], tuple[str, ...]]:
    """Write a recording; return what passes, and the options of its run."""
    if kind not in {"vehicle", "standing"}:
        made = drawn(kind, seed)
        made.write(path)
        in_air = ("--sound-speed-mps", str(SOUND_MPS)) if kind == "other in air" else ()
        return list(made.passages), made.words + in_air
    kinds = [one for one in SPEEDS_MPS if one != "ship"]
    rng = np.random.default_rng([seed, 77])
    own = kinds[seed % len(kinds)] if kind == "vehicle" else kind
    passing = recording_file(rng, own, path)
    found = [Passage(one.time_s, one.speed_mps, one.range_m) for one in passing]
    return found, ("--sound-speed-mps", str(SOUND_MPS))


def candidates(path: Path, words: tuple[str, ...]) -> list[Record]:
    """Run `auto` and return what was measured of each candidate, in the recording's time."""
    found: list[Record] = []
    last: list[Record] = []
    begin_s = [0.0]
    decide, make_row, look = decided_by.decide, cpa._row, zoom._passages  # noqa: SLF001
    fill = cpa.passage_row
    stated: list[cpa.Row] = []

    def filled(*given: Any) -> Any:
        stated[:] = [fill(*given)]
        return stated[0]

    def decided(measured: Record) -> Any:
        last[:] = [measured]
        return decide(measured)

    def made(*given: Any, **more: Any) -> Any:
        last[:] = [passage_evidence(given[0])]  # unless it is asked more, and decided anew
        row = make_row(*given, **more)
        values = {name: stated[0].values[name] for name in STATED}
        values["time_s"] += begin_s[0]
        found.append({**last[0], "stated": values, "is_given": isinstance(row, cpa.Row)})
        return row

    def looked(part: Any, graph: Any) -> Any:
        begin_s[0] = part.first_sample / part.sample_rate_hz
        try:
            return look(part, graph)
        finally:
            begin_s[0] = 0.0

    with (
        patch.multiple(cpa, _row=made, passage_row=filled),
        patch.object(decided_by, "decide", decided),
        patch.object(zoom, "_passages", looked),
    ):
        run(path, words)
    return found


def is_right(measured: Record, passing: list[Passage]) -> bool:
    """Tell whether a vessel passes as a candidate has it."""
    time_s, time_std_s, own_s, std_s, speed, std_mps = (measured["stated"][name] for name in STATED)
    if not measured["relative_width_std"] < LARGEST_RELATIVE_STD:
        return False
    for one in passing:
        apart_s = abs(time_s - one.time_s)
        width_s = one.slant_range_m / one.speed_mps
        if apart_s > max(3.0 * time_std_s, 0.5 * width_s):
            continue
        off = [apart_s / time_std_s, abs(own_s - width_s) / std_s]
        if speed > 3.0 * std_mps:
            off.append(abs(speed - one.speed_mps) / std_mps)
        if max(off) < 5.0:
            return True
    return False


def draw(path: Path, seed: int, count: int, kinds: Sequence[str] = KINDS) -> None:
    """Draw recordings of some kinds and append their candidates to a file."""
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder, path.open("ab") as file:
        for number in range(seed, seed + count):
            for kind in kinds:
                sound = Path(folder) / f"{kind}_{number}.wav"
                passing, words = write(kind, number, sound)
                rows = candidates(sound, words)
                pickle.dump((kind, number, passing, rows), file)
                print(kind, number, len(rows), flush=True)


def read(path: Path) -> Iterator[Any]:
    """Yield what was drawn."""
    with path.open("rb") as file:
        while True:
            try:
                yield pickle.load(file)  # noqa: S301 - made by `draw`
            except EOFError:
                return


def terms(measured: Record) -> list[float]:
    """Return kinds of candidate and log evidences, zero where nothing was measured."""
    values = np.array([one(measured) for one in TRIED])
    held = np.clip(np.where(np.isfinite(values), values, 0.0), -MOST_NEPERS, MOST_NEPERS)
    return [*(float(kind == kind_of(measured)) for kind in LOG_ODDS), *held.tolist()]


def fitted(columns: FloatArray, right: BoolArray, size: FloatArray) -> FloatArray:
    """Return odds and exponents by logistic regression with a ridge."""
    places = [N_ODDS + TRIED.index(one) for one in FIXED]

    def cost(weight: FloatArray) -> tuple[float, FloatArray]:
        odds = columns @ weight
        off = weight[N_ODDS:] - USUAL_EXPONENT
        value = size @ (np.logaddexp(0.0, odds) - odds * right) + RIDGE * off @ off
        slope = columns.T @ (size * (1.0 / (1.0 + np.exp(-odds)) - right))
        slope[N_ODDS:] += 2.0 * RIDGE * off
        return float(value), slope

    count = columns.shape[1]
    limits: list[tuple[float | None, float | None]] = [(None, None)] * N_ODDS
    limits += [(0.0, None)] * (count - N_ODDS)
    start = np.zeros(count)
    for place in places:
        limits[place], start[place] = (1.0, 1.0), 1.0
    found = minimize(cost, start, jac=True, bounds=limits, method="L-BFGS-B")
    return np.asarray(found.x)


def fit(path: Path) -> None:
    """Print odds, exponents, and how far probabilities are right."""
    columns, right, size, owner = [], [], list[float](), list[int]()
    for number, (kind, _, passing, rows) in enumerate(read(path)):
        for one in rows:
            columns.append(terms(one))
            right.append(is_right(one, passing))
            size.append(WEIGHTS.get(kind, 1.0))
            owner.append(number)
    table, is_true, weight = np.array(columns), np.array(right), np.array(size)
    names = [*LOG_ODDS, *(one.__name__ for one in TRIED)]
    for name, value in zip(names, fitted(table, is_true, weight), strict=True):
        print(f"{name:22} {value:6.2f}")
    part: IntArray = np.array(owner) % 8
    chance = np.empty(is_true.size)
    for k in range(8):
        own = part == k
        found = fitted(table[~own], is_true[~own], weight[~own])
        chance[own] = 1.0 / (1.0 + np.exp(-table[own] @ found))
    reliability(chance, is_true)


def check(path: Path) -> None:
    """Print how far the probabilities that the program states are right."""
    pairs = [
        (decided_by.decide(one).probability, is_right(one, passing))
        for _, _, passing, rows in read(path) for one in rows
    ]  # fmt: skip
    chance, right = np.array(pairs).T
    reliability(chance, right > 0)


def reliability(chance: FloatArray, right: BoolArray) -> None:
    """Print how many candidates of each probability are right."""
    for low, high in pairwise(EDGES):
        within = (chance >= low) & (chance < high)
        print(
            f"{low:.1f} to {high:.1f}: {within.sum()} candidates, "
            f"{chance[within].sum():.1f} expected right, {right[within].sum()} are"
        )
    told = chance > LEAST_PROBABILITY
    print(f"given: {(told & right).sum()} right, {(told & ~right).sum()} wrong")
    print(f"refused: {(~told & right).sum()} right, {(~told & ~right).sum()} wrong")
    sure = (chance >= 0.1) & (chance < 0.9)
    spread = np.sqrt((chance[sure] * (1.0 - chance[sure])).sum())
    off = (right[sure].sum() - chance[sure].sum()) / spread
    print(f"between 0.1 and 0.9: {sure.sum()}, off by {off:.1f} standard deviations")
    score = np.log(np.where(right, chance, 1.0 - chance)).mean()
    share = right.mean()
    constant = share * np.log(share) + (1.0 - share) * np.log(1.0 - share)
    print(f"mean log score {score:.3f}, of the best constant {constant:.3f}")


if __name__ == "__main__":
    if sys.argv[1] == "draw":
        seed, count = map(int, sys.argv[3:5])
        draw(Path(sys.argv[2]), seed, count, sys.argv[5:] or KINDS)
    else:
        {"fit": fit, "check": check}[sys.argv[1]](Path(sys.argv[2]))
