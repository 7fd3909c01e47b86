"""Test how often, and how soon, the sequential test tells a repeater from its source.

**Method.** The three published experiments are run over the aspects, since the figures
with their geometry are lost; the machinery is checked on the textbook's Gaussian walk.
The test as published takes a repeater's bearing alone, and lets its range be any: the
program's own has a density for the false range and range rate, too, and bounds the range
by that measured. Both are run.

**References.** Jeong and Hong (1996); Wald (1947); Siegmund (1985).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from studies.repeater import RepeaterScene, simulate_repeater
from studies.rows import load_reference, mean_row, share_row
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.discrimination.contact_filters import (
    GaussianSum,
    InnovationFit,
    Observation,
    predict_drift,
    predict_moving,
    update_drift,
    update_moving,
)
from uwtrack_cli.discrimination.options import ContactFilters
from uwtrack_cli.discrimination.pair_test import (
    EarlierTrack,
    PairTest,
    consistency,
    follow,
    run_pair,
)
from uwtrack_cli.discrimination.sequential_test import (
    Thresholds,
    first_crossing,
    wald_thresholds,
)
from uwtrack_cli.estimation.imm import Belief

_ERRORS = {1: 0.05, 2: 0.005, 3: 0.005}
TWO_MODELS = ContactFilters(acceleration_std_mps2=1.0, manoeuvre_std_mps2=10.0)
_FILTERS = {
    "": (ContactFilters(), True),
    ", two models": (TWO_MODELS, True),
    ", the program's test": (ContactFilters(), False),
}
"""Options of each test, and whether it is that published."""
_FURTHER_ASPECTS = ((1, 30), (1, 120), (2, 30), (2, 90), (2, 120), (3, 60), (3, 90))
_REMARKS = (
    (
        "right: the source is taken for the moving contact; undecided after 30 s counts "
        "as neither. Scans are means over the right decisions, the first included."
    ),
    (
        "Where the source turns at the separation the constant-velocity filter is wrong "
        "for it; whether that spoils the test depends on the aspect. The filter's "
        "innovations show it (improbable: the source's moving filter below 0.05)."
    ),
    "two models: a quiet and a manoeuvring filter interact under both hypotheses.",
    (
        "the program's test: a repeater answers late and steadily, so that its range is "
        "that measured or less, and its false range and rate have a density, too."
    ),
    (
        "fixed length: the sign of the log odds after as many scans as the sequential "
        "test took on average."
    ),
)


def study_discriminate(*, runs: int = 2000, seed: int = 1) -> Study:
    """Compare the sequential test of two contacts with the published experiments.

    ``runs``: number of runs in each case; the textbook test takes 25 times as many.

    Returned: shares of right, wrong and undecided runs, and mean numbers of scans.
    """
    reference = load_reference("discriminate")
    known = {(row[0], row[1]): row[2:] for row in reference["scenarios"]}
    rows = list(_textbook_rows(reference, 25 * runs, seed))
    for scenario, aspect in (*known, *_FURTHER_ASPECTS):
        for name, (filters, is_published) in _FILTERS.items():
            result = run_scenario(
                scenario, aspect, filters, is_published, runs=runs, seed=seed
            )
            published = known.get((scenario, aspect), ()) if not name else ()
            case = f"scenario {scenario}, aspect {aspect} deg{name}"
            rows += _scenario_rows(case, result, published)
            if (scenario, aspect) in ((1, 80), (2, 140), (3, 140)) and not name:
                share, scans = reference["paper"][str(scenario)]
                case += ", against the paper"
                rows += list(_scenario_rows(case, result, (share, None, None, scans)))
    return Study("discriminate", reference["source"], runs, seed, tuple(rows), _REMARKS)


@dataclass(frozen=True)
class ScenarioResult:
    """Decisions of all runs of one experiment."""

    decision: IntArray
    """-1 right, 0 undecided, 1 wrong, ``(run,)``."""
    scans: IntArray
    """Scans to the decision, the first included; 0 if undecided."""
    fixed_wrong: BoolArray
    """Runs in which the test of fixed length errs."""
    improbable: BoolArray
    """Runs in which the moving filter of the source has improbable innovations."""


def run_scenario(
    scenario: int,
    aspect_deg: float,
    filters: ContactFilters,
    is_published: bool,
    *,
    runs: int,
    seed: int,
) -> ScenarioResult:
    """Run one published experiment at one aspect.

    ``scenario``: 1: no turn; 2: both turn, 1000 m; 3: both turn, 400 m. ``aspect_deg``:
    angle between the source's course and the line of sight, degrees. ``filters``: what
    the filters assume. ``is_published``: the test as published, else the program's.
    ``runs``: number of runs, from 1.
    """
    scene = RepeaterScene(
        aspect_deg=aspect_deg, range_m=400.0 if scenario == 3 else 1000.0,
        interval_s=1.0 if scenario == 3 else 2.0, turns=scenario > 1,
    )  # fmt: skip
    found = _run_filters(scene, filters, is_published, runs, seed)
    error = _ERRORS[scenario]
    odds = found.log_odds[: round(30.0 / scene.interval_s)]
    scan, decision = first_crossing(odds, wald_thresholds(error, error))
    right = decision < 0
    mean = round(float(scan[right].mean())) if right.any() else odds.shape[0] - 1
    fit = consistency(found.distance2[:, 0], found.degrees[:, 0])
    return ScenarioResult(
        decision, np.where(decision != 0, scan + 2, 0), odds[mean] > 0.0,
        fit < 0.05,
    )  # fmt: skip


def _run_filters(
    scene: RepeaterScene,
    filters: ContactFilters,
    is_published: bool,
    runs: int,
    seed: int,
) -> PairTest:
    drawn = simulate_repeater(np.random.default_rng(seed), scene, runs)
    variance = np.array([
        scene.range_std_m, np.deg2rad(scene.bearing_std_deg), scene.range_rate_std_mps
    ]) ** 2  # fmt: skip
    clock, own = drawn.navigation_time_s, drawn.own_ship_m
    rate = np.gradient(own, clock, axis=0)
    at = np.searchsorted(clock, drawn.time_s - 1e-6)

    def observations(table: FloatArray) -> list[Observation]:
        measured = table.copy()
        measured[..., 1] = np.deg2rad(90.0 - table[..., 1])
        return [
            Observation(measured[k], variance, own[i], rate[i])
            for k, i in enumerate(at)
        ]

    source, repeater = observations(drawn.source), observations(drawn.repeater)
    split = int(np.flatnonzero(np.isfinite(drawn.repeater[:, 0, 0]))[0])
    history = follow(source[:split], drawn.time_s[:split], filters)
    source, repeater, times_s = source[split:], repeater[split:], drawn.time_s[split:]
    if not is_published:
        return run_pair(source, repeater, times_s, filters, history=history)
    a, b = (
        _published_fits(scans, times_s, filters, history)
        for scans in (source, repeater)
    )
    fits = [(a[0][k], b[1][k], a[1][k], b[0][k]) for k in range(len(a[0]))]
    density, distance2, degrees = (
        np.stack([[getattr(fit, name) for fit in row] for row in fits])
        for name in ("log_density", "distance2", "degrees")
    )
    return PairTest(density, distance2, degrees, np.empty(0), np.empty(0))


def _published_fits(
    scans: list[Observation],
    times_s: FloatArray,
    filters: ContactFilters,
    history: EarlierTrack | None,
) -> tuple[list[InnovationFit], list[InnovationFit]]:
    """Follow a contact as a moving and, by bearings alone, as a drifting one."""
    if history is None:
        msg = "the published test goes on from an earlier track."
        raise ValueError(msg)
    moving, before_s = history.state, history.time_s
    distance, bearing, _ = np.moveaxis(scans[0].measured, -1, 0)
    mean = np.stack([bearing, 1.0 / distance, distance, 0.0 * bearing], axis=-1)
    spread = np.zeros((*bearing.shape, 4, 4))
    spread[..., 0, 0] = scans[0].variance[..., 1]
    spread[..., 1, 1] = (filters.inverse_range_std / distance) ** 2
    # One model and one term; range and rate, which nothing measures, do not matter.
    one = np.ones((1, 1, *bearing.shape))
    drifting = GaussianSum(
        Belief(mean[None, None], spread[None, None], one), np.log(one[0])
    )
    moves, drifts = [], []
    for scan, seen in enumerate(scans):
        interval = float(times_s[scan] - before_s)
        before_s = float(times_s[scan])
        moving = predict_moving(
            moving, interval, filters.intensities, filters.switching
        )
        moving, moved = update_moving(moving, seen)
        if not scan:
            continue
        alone = np.where([False, True, False], seen.measured, np.nan)
        way = seen.position - scans[scan - 1].position
        drifting, drifted = update_drift(
            predict_drift(
                drifting, interval, way, filters.drift_std_mps, np.zeros(1),
                np.ones((1, 1)),
            ),
            replace(seen, measured=alone),
        )  # fmt: skip
        moves.append(moved)
        drifts.append(drifted)
    return moves, drifts


def _scenario_rows(
    case: str, result: ScenarioResult, published: Any
) -> Iterator[StudyRow]:
    shares = {
        "right": result.decision < 0,
        "wrong": result.decision > 0,
        "undecided": result.decision == 0,
    }
    references = dict(zip((*shares, "scans"), published, strict=False))
    for name, events in shares.items():
        yield share_row(case, name, references.get(name), events)
    right = result.scans[shares["right"]].astype(np.float64)
    if right.size > 1:
        yield from mean_row(
            case, "mean scans when right", references.get("scans"), right
        )
    yield share_row(case, "wrong, fixed length", None, result.fixed_wrong)
    yield share_row(case, "moving filter improbable", None, result.improbable)


def _textbook_rows(reference: Any, runs: int, seed: int) -> Iterator[StudyRow]:
    for row in reference["textbook"]:
        error, mean, *published = row
        wrong, scans = textbook_test(error, mean, runs=runs, seed=seed)
        case = f"Gaussian walk, Pe {error:g}, mean {mean:g}"
        yield share_row(case, "error rate", published[0], wrong)
        yield from mean_row(case, "mean scans", published[1], scans)


def textbook_test(
    error: float, mean: float, *, runs: int, seed: int
) -> tuple[BoolArray, FloatArray]:
    """Run the symmetric test on Gaussian samples N(+mean/2, 1) or N(-mean/2, 1).

    ``error``: error probability that sets both thresholds. ``mean``: distance of the
    two means in standard deviations, above 0. ``runs``: number of tests, from 1.

    Returned: whether each test erred, and the scans it took.
    """
    rng = np.random.default_rng(seed)
    thresholds: Thresholds = wald_thresholds(error, error)
    odds, scans = np.zeros(runs), np.zeros(runs)
    running = np.arange(runs)
    while running.size:
        sample = 0.5 * mean + rng.standard_normal(running.size)
        odds[running] += mean * sample
        scans[running] += 1.0
        now = odds[running]
        running = running[(now > thresholds.lower) & (now < thresholds.upper)]
    return np.asarray(odds <= thresholds.lower), scans
