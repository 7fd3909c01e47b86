"""Where odds and exponents of the decision come from, and how far probabilities are right.

Draws recordings with vessels near the threshold (bounds of speed or R/v from 3 to 50 %),
disturbed ones, motions that are not straight, vehicles in air, and recordings in which
nothing passes; runs `auto` over them and keeps what was measured of every candidate, told
or refused. A candidate is right where a vessel passes within three standard deviations of
its time, or half of R/v, no quantity is beyond five, and R/v is known to 40 %. The log
odds are linear in the log evidences; exponents are not negative, and drawn to 0.15 by a
ridge, so that a kind of measurement which says nothing new counts little. Prints odds and
exponents, and for recordings that were left out of the fit (eighths of them in turn) how
many candidates of each probability are right, and what the gates of 0.2.0 gave:
python -m studies.constants.passage_probability draw candidates.pkl 511000 16
python -m studies.constants.passage_probability fit candidates.pkl
"""

import pickle
import sys
import warnings
from collections.abc import Iterator
from itertools import pairwise
from math import isfinite, log, log1p, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize

from tests.acceptance.outcomes import run
from tests.draws import harder_motions, nothing_passes, other_sounds
from tests.draws.passage_bounds import bounds
from tests.draws.random_passages import draw_scenario
from tests.draws.recordings import Drawn, Passage, of_scenario
from tests.draws.vehicle_sounds import SOUND_MPS, SPEEDS_MPS, recording_file
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.flow import zoom
from uwtrack_cli.motion import alternatives, cpa
from uwtrack_cli.motion.alternatives import (
    ENOUGH_SUB_BANDS,
    Measured,
    compressed,
    two_scales,
    value_of,
)
from uwtrack_cli.motion.decision import MOST_NEPERS

MISFIT, OTHER_MISFIT = 0.1, 0.5
"""Scale of the misfit of lines of a passage, and of what is none, as shares of v/c."""

ENOUGH_FLANK = 0.7
"""R/v before or after the closest approach from which a drift no longer looks like it."""


def noise(measured: Measured) -> float:
    """Return what the passage gains over noise of any colour, a drift and a break."""
    names = ("gain", "gain_over_line", "gain_over_break")
    return compressed(min(value_of(measured, name) for name in names))


def stationary_source(measured: Measured) -> float:
    """Return what is gained over a source that stays: steady, changing or joined lines."""
    return compressed(value_of(measured, "log_odds"))


def misfit(measured: Measured) -> float:
    """Return what lines that keep to their curve, or leave it, say."""
    return two_scales(value_of(measured, "misfit"), MISFIT, OTHER_MISFIT)


def no_tones(measured: Measured) -> float:
    """Return what tones, or noise that was tracked, say in the sound itself."""
    return log1p(max(value_of(measured, "tones"), 0.0) / 10.0) - log(2.0)


def few_sub_bands(measured: Measured) -> float:
    """Return what the number of sub-bands that rise says."""
    return value_of(measured, "sub_bands") - ENOUGH_SUB_BANDS


def sub_bands_disagree(measured: Measured) -> float:
    """Return what times and widths of the sub-bands say of one rise."""
    chance = value_of(measured, "sub_bands_agree")
    return log(max(chance, 1e-5) / 0.05) if isfinite(chance) else nan


def short_flank(measured: Measured) -> float:
    """Return what was recorded on the shorter side says of a drift."""
    flank = min(value_of(measured, "before"), value_of(measured, "after"))
    return log(min(max(flank, 0.05) / ENOUGH_FLANK, 1.0))


TRIED = (
    alternatives.stationary_bearing, alternatives.stationary_levels,
    alternatives.stationary_lines, alternatives.halves, alternatives.unusual_speed,
    alternatives.other_rise, alternatives.undetermined, alternatives.short_frames, noise,
    stationary_source, misfit, no_tones, few_sub_bands, sub_bands_disagree,
    short_flank, alternatives.other_time, alternatives.small_turn,
)  # fmt: skip
"""Every log evidence that is tried."""

FIXED = alternatives.unusual_speed
"""A prior, which no exponent tempers."""

N_ODDS, RIDGE, USUAL_EXPONENT = 3, 1.5, 0.15
"""Log odds before; strength of the ridge, and the exponent that it draws to."""

KINDS = ("near", "nothing", "other", "vehicle", "disturbed", "near again", "harder")
"""Kinds of recordings, one of each for a seed."""

RATE_HZ, SECONDS = 2000.0, 240.0
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
Record = dict[str, Any]


def drawn(kind: str, seed: int) -> Drawn:
    """Draw a recording of one kind in water."""
    if kind == "nothing":
        return nothing_passes.draw(
            nothing_passes.KINDS[seed % len(nothing_passes.KINDS)], seed
        )
    if kind == "other":
        rate, sound, _ = other_sounds.draw(seed)
        return Drawn(rate, sound)
    if kind == "harder":
        kinds = harder_motions.KINDS
        return harder_motions.draw(kinds[seed % len(kinds)], seed)
    seed += 50_000 * (kind == "near again")
    while True:
        disturbances = None if seed % 2 or kind == "disturbed" else ()
        scenario = draw_scenario(
            seed, n_vessels=1, kinds=disturbances, sample_rate_hz=RATE_HZ,
            duration_s=SECONDS,
        )  # fmt: skip
        least = bounds(scenario, 0)
        worst = max(least["speed"], least["width"])
        if kind == "disturbed" or 0.03 < worst < 0.5:
            return of_scenario(scenario, seed)
        seed += 100_000


def write(kind: str, seed: int, path: Path) -> tuple[list[Passage], tuple[str, ...]]:
    """Write a recording; return what passes, and the options of its run."""
    if kind != "vehicle":
        made = drawn(kind, seed)
        made.write(path)
        return list(made.passages), made.words
    path.with_suffix(".sensor.toml").unlink(missing_ok=True)
    kinds = [one for one in SPEEDS_MPS if one != "ship"]
    rng = np.random.default_rng([seed, 77])
    passing = recording_file(rng, kinds[seed % len(kinds)], path)
    found = [Passage(one.time_s, one.speed_mps, one.range_m) for one in passing]
    return found, ("--sound-speed-mps", str(SOUND_MPS))


def candidates(path: Path, words: tuple[str, ...]) -> list[Record]:
    """Run `auto` and return what was measured of each candidate, in the recording's time."""
    found: list[Record] = []
    begin_s = [0.0]
    decide, make_row, look = cpa.decide, cpa._row, zoom._passages  # noqa: SLF001

    def decided(measured: Record) -> Any:
        found.append({**measured, "time_s": measured["time_s"] + begin_s[0]})
        return decide(measured)

    def made(*given: Any, **more: Any) -> Any:
        row = make_row(*given, **more)
        found[-1]["gate"] = "" if isinstance(row, cpa.Row) else row.reason.code
        return row

    def looked(part: Any, graph: Any) -> Any:
        begin_s[0] = part.first_sample / part.sample_rate_hz
        try:
            return look(part, graph)
        finally:
            begin_s[0] = 0.0

    with (
        patch.multiple(cpa, decide=decided, _row=made),
        patch.object(zoom, "_passages", looked),
    ):
        run(path, words)
    return found


def is_right(measured: Record, passing: list[Passage]) -> bool:
    """Tell whether a vessel passes as a candidate has it."""
    if measured["relative_width_std"] > 0.4:
        return False
    for one in passing:
        apart_s = abs(measured["time_s"] - one.time_s)
        width_s = one.slant_range_m / one.speed_mps
        if apart_s > max(3.0 * measured["time_std_s"], 0.5 * width_s):
            continue
        off = [apart_s / measured["time_std_s"]]
        own = measured["range_over_speed_s"]
        off.append(abs(own - width_s) / (own * measured["relative_width_std"]))
        speed, std = measured["speed_mps"], measured["speed_std_mps"]
        if measured["has_lines"] and speed > 3.0 * std:
            off.append(abs(speed - one.speed_mps) / std)
        if max(off) < 5.0:
            return True
    return False


def draw(path: Path, seed: int, count: int) -> None:
    """Draw recordings and append their candidates to a file."""
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder, path.open("ab") as file:
        for number in range(seed, seed + count):
            for kind in KINDS:
                sound = Path(folder) / "drawn.wav"
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
    held = np.clip(
        np.where(np.isfinite(values), values, 0.0), -MOST_NEPERS, MOST_NEPERS
    )
    has_lines = measured["has_lines"]
    return [has_lines, 1.0 - has_lines, measured["is_air"], *held.tolist()]


def fitted(columns: FloatArray, right: BoolArray) -> FloatArray:
    """Return odds and exponents by logistic regression with a ridge."""
    place = N_ODDS + TRIED.index(FIXED)

    def cost(weight: FloatArray) -> tuple[float, FloatArray]:
        odds = columns @ weight
        off = weight[N_ODDS:] - USUAL_EXPONENT
        value = (np.logaddexp(0.0, odds) - odds * right).sum() + RIDGE * (off**2).sum()
        slope = columns.T @ (1.0 / (1.0 + np.exp(-odds)) - right)
        slope[N_ODDS:] += 2.0 * RIDGE * off
        return float(value), slope

    count = columns.shape[1]
    limits: list[tuple[float | None, float | None]] = [(None, None)] * N_ODDS
    limits += [(0.0, None)] * (count - N_ODDS)
    limits[place] = (1.0, 1.0)
    start = np.zeros(count)
    start[place] = 1.0
    found = minimize(cost, start, jac=True, bounds=limits, method="L-BFGS-B")
    return np.asarray(found.x)


def fit(path: Path) -> None:
    """Print odds, exponents, and how far probabilities are right."""
    columns, right, gates, owner = [], [], list[str](), list[int]()
    for number, (_, _, passing, rows) in enumerate(read(path)):
        for one in rows:
            columns.append(terms(one))
            right.append(is_right(one, passing))
            gates.append(one["gate"] or "given")
            owner.append(number)
    table, is_true, gate = np.array(columns), np.array(right), np.array(gates)
    is_given = gate == "given"
    names = ["lines", "levels", "air", *(one.__name__ for one in TRIED)]
    for name, value in zip(names, fitted(table, is_true), strict=True):
        print(f"{name:22} {value:6.2f}")
    part: IntArray = np.array(owner) % 8
    chance = np.empty(is_true.size)
    for k in range(8):
        weight = fitted(table[part != k], is_true[part != k])
        chance[part == k] = 1.0 / (1.0 + np.exp(-table[part == k] @ weight))
    for low, high in pairwise(EDGES):
        within = (chance >= low) & (chance < high)
        print(
            f"{low:.1f} to {high:.1f}: {within.sum()} candidates, "
            f"{chance[within].sum():.1f} expected right, {is_true[within].sum()} are"
        )
    for name in sorted(set(gates), key=gates.count, reverse=True):
        own = gate == name
        agreed = (chance[own] > 0.5) == is_true[own]
        print(
            f"{name:24} {own.sum()} candidates, {is_true[own].sum()} right, "
            f"{chance[own].sum():.1f} expected; the probability decides {agreed.sum()} "
            f"of them rightly"
        )
    for name, told in (("gates of 0.2.0", is_given), ("probability", chance > 0.5)):
        print(
            f"{name}: {(told & is_true).sum()} right, {(told & ~is_true).sum()} wrong"
        )
    score = np.log(np.where(is_true, chance, 1.0 - chance)).mean()
    share = is_true.mean()
    constant = share * np.log(share) + (1.0 - share) * np.log(1.0 - share)
    print(f"mean log score {score:.3f}, of the best constant {constant:.3f}")


if __name__ == "__main__":
    if sys.argv[1] == "draw":
        draw(Path(sys.argv[2]), *map(int, sys.argv[3:]))
    else:
        fit(Path(sys.argv[2]))
