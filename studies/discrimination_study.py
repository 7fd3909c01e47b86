"""Test how often, and how soon, the sequential test tells a repeater from its source.

**Method.** The three published experiments are run over the aspects, since the figures
with their geometry are lost; the machinery is checked on the textbook's Gaussian walk.
The test as published follows the source in east and north, takes a repeater's bearing
alone, and lets its range be any: the program's own follows both in polar coordinates, has
a density for the false range and range rate, too, and bounds the range by that measured.
Both are run.

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
    update_drift,
    velocity_noise,
)
from uwtrack_cli.discrimination.options import ContactFilters
from uwtrack_cli.discrimination.pair_test import (
    PairTest,
    Thresholds,
    consistency,
    first_crossing,
    follow,
    run_pair,
    wald_thresholds,
)
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.constant_velocity import transition
from uwtrack_cli.estimation.imm import Belief, advance, mix, reweigh

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
            result = run_scenario(scenario, aspect, filters, is_published, runs=runs, seed=seed)
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
        decision, np.where(decision != 0, scan + 2, 0), odds[mean] > 0.0, fit < 0.05
    )


def _run_filters(
    scene: RepeaterScene, filters: ContactFilters, is_published: bool, runs: int, seed: int
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
        return [Observation(measured[k], variance, own[i], rate[i]) for k, i in enumerate(at)]

    source, repeater = observations(drawn.source), observations(drawn.repeater)
    split = int(np.flatnonzero(np.isfinite(drawn.repeater[:, 0, 0]))[0])
    if not is_published:
        return run_pair(
            source[split:], repeater[split:], drawn.time_s[split:], filters,
            history=follow(source[:split], drawn.time_s[:split], filters),
        )  # fmt: skip
    a, b = (
        _published_fits(scans[split:], drawn.time_s, split, filters, source[:split])
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
    split: int,
    filters: ContactFilters,
    history: list[Observation],
) -> tuple[list[InnovationFit], list[InnovationFit]]:
    """Follow a contact as a moving and, by bearings alone, as a drifting one.

    ``split``: place of the first of its scans among the times; ``history``: the scans of
    the one contact before it.
    """
    distance, bearing, _ = np.moveaxis(scans[0].measured, -1, 0)
    mean = np.stack([bearing, 1.0 / distance, distance, 0.0 * bearing], axis=-1)
    spread = np.zeros((*bearing.shape, 4, 4))
    spread[..., 0, 0] = scans[0].variance[..., 1]
    spread[..., 1, 1] = (filters.inverse_range_std / distance) ** 2
    # One model and one term; range and rate, which nothing measures, do not matter.
    one = np.ones((1, 1, *bearing.shape))
    drifting = GaussianSum(Belief(mean[None, None], spread[None, None], one), np.log(one[0]))
    drifts = []
    for scan, seen in enumerate(scans[1:], 1):
        alone = np.where([False, True, False], seen.measured, np.nan)
        drifting, drifted = update_drift(
            predict_drift(
                drifting, float(times_s[split + scan] - times_s[split + scan - 1]),
                seen.position - scans[scan - 1].position, filters.drift_std_mps,
                np.zeros(1), np.ones((1, 1)),
            ),
            replace(seen, measured=alone),
        )  # fmt: skip
        drifts.append(drifted)
    return _published_moving([*history, *scans], times_s, filters)[split:], drifts


def _published_moving(
    scans: list[Observation], times_s: FloatArray, filters: ContactFilters
) -> list[InnovationFit]:
    """Follow a contact in east and north; how the scans after the first agree."""
    first, intensity = scans[0], filters.intensities
    distance, bearing, _ = np.moveaxis(first.measured, -1, 0)
    var_r, var_b, _ = np.moveaxis(first.variance, -1, 0)
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    nothing = np.zeros_like(along)
    mean = np.concatenate([first.position + distance[..., None] * along, nothing], axis=-1)
    spread = np.zeros((*mean.shape, 4))
    for line, variance in ((along, var_r), (across, distance**2 * var_b)):
        square = line[..., :, None] * line[..., None, :]
        spread[..., :2, :2] += np.asarray(variance)[..., None, None] * square
    spread[..., 2:, 2:] = filters.speed_std_mps**2 * np.eye(2)
    models = (intensity.size, *mean.shape[:-1])
    belief = Belief(
        np.broadcast_to(mean, (*models, 4)), np.broadcast_to(spread, (*models, 4, 4)),
        np.full(models, 1.0 / intensity.size),
    )  # fmt: skip
    fits = []
    for seen, step_s in zip(scans[1:], np.diff(times_s), strict=True):
        belief = advance(
            mix(belief, filters.switching),
            np.kron(transition(float(step_s)), np.eye(2)),
            velocity_noise(float(step_s), intensity),
        )
        expected, slope = _seen_from(belief.mean, seen)
        residual = seen.measured - expected
        residual[..., 1] = wrap_rad(residual[..., 1])
        cross = belief.covariance @ np.swapaxes(slope, -1, -2)
        innovation = slope @ cross + seen.variance[..., None] * np.eye(3)
        gain = cross @ np.linalg.inv(innovation)
        solved = np.linalg.solve(innovation, residual[..., None])[..., 0]
        distance2 = (residual * solved).sum(axis=-1)
        density = -0.5 * (np.log(np.linalg.det(innovation)) + distance2)
        total = np.log((belief.probability * np.exp(density)).sum(axis=0))
        weight = reweigh(belief, density)
        belief = Belief(
            belief.mean + (gain @ residual[..., None])[..., 0],
            belief.covariance - gain @ innovation @ np.swapaxes(gain, -1, -2), weight,
        )  # fmt: skip
        fits.append(InnovationFit(total, (weight * distance2).sum(axis=0), np.full(total.shape, 3)))
    return fits


def _seen_from(mean: FloatArray, seen: Observation) -> tuple[FloatArray, FloatArray]:
    """Return expected range, bearing and range rate, and their slopes."""
    place, rate = mean[..., :2] - seen.position, mean[..., 2:] - seen.velocity
    distance = np.hypot(place[..., 0], place[..., 1])[..., None]
    along, nothing = place / distance, np.zeros_like(place)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / distance
    closing = (along * rate).sum(axis=-1)
    turning = (rate - closing[..., None] * along) / distance
    bearing = np.arctan2(place[..., 1], place[..., 0])
    slope = np.stack([
        np.concatenate(pair, axis=-1)
        for pair in ((along, nothing), (across, nothing), (turning, along))
    ], axis=-2)  # fmt: skip
    return np.stack([distance[..., 0], bearing, closing], axis=-1), slope


def _scenario_rows(case: str, result: ScenarioResult, published: Any) -> Iterator[StudyRow]:
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
        yield from mean_row(case, "mean scans when right", references.get("scans"), right)
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
