"""Ask whether an adaptive threshold, or region, helps a track through clutter.

**Method.** The factor q2 is compared with its reference tables, the recorded tracks are
run again, one scan is taken under every rule (the decrease of the variance that the
filter reports beside the decrease of the squared error that really came of it, both
over the decrease without clutter), and the paper's scenes are run with paired
measurements.

**References.** Choi, Kim and Hong (2001), section III: the claim under test is that a
smaller validation region leaves less variance; Gelfand, Fortmann and Bar-Shalom (1996).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.clutter_runs import EXPERIMENTS, ClutterExperiment, TrackTally, run_scene, setting_of
from studies.clutter_scans import ClutterScene, simulate_scan
from studies.rows import error_row, exact_row, load_reference, share_row
from uwtrack_cli.clutter.clutter_filter import ClutterSetting, Scan, step
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.estimation.constant_velocity import constant_velocity
from uwtrack_cli.estimation.detection_threshold import best_prior
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.estimation.information_reduction import information_reduction
from uwtrack_cli.estimation.operating_curve import constant_curve, model_curve

_LEGEND = (
    "lost: more than 100 m wrong, or a position variance above (100 m)^2, at any scan "
    "from 7 s on; the other figures are means over the tracks that were kept. "
    "flagged: the test for a loss rose above 10 at any scan. "
    "TS-lit: the paper's two steps, threshold and validation region."
)
_COMPARED = (
    ("prior minus best fixed", "The prior-optimised threshold against the best fixed"),
    ("TS-lit minus prior", "The paper's shrinking region against the prior rule"),
    ("post minus prior", "Choosing after the scan against the prior rule"),
)


def study_clutter(*, runs: int = 1000, seed: int = 1) -> Study:
    """Compare the clutter tracker with the published experiment.

    ``runs``: number of tracks in each scene; the one-scan test takes 20 times as many.

    Returned: information factors, recorded tracks, single scans and whole tracks.
    """
    reference = load_reference("clutter")
    rows = [
        *_reduction_rows(reference),
        *_optimum_rows(reference),
        *_recorded_rows(),
        *_one_step_rows(reference, 20 * runs, seed),
    ]
    for scene in EXPERIMENTS:
        tallies = run_scene(scene, runs=runs, seed=seed)
        rows += _scene_rows(scene.name, tallies, reference["tracks"][scene.name])
    remarks = (_LEGEND, *_conclusions(rows))
    return Study("clutter", reference["source"], runs, seed, tuple(rows), remarks)


def _reduction_rows(reference: Any) -> Iterator[StudyRow]:
    for table in reference["information_reduction"]:
        ours = information_reduction(
            np.array(table["detection_probability"])[:, None],
            np.array(table["expected_clutter"]),
            dimension=table["dimension"],
            gate=table["gate"],
        )
        case = f"q2, M={table['dimension']}, g={table['gate']:g}"
        worst = float(np.abs(ours - table["q2"]).max())
        yield exact_row(case, "largest difference from the table", None, worst)
    for gate, _, q2, *_ in reference["gate_size"]:
        found = information_reduction(0.8, 2.0 * (gate / 4.0) ** 2, gate=gate)
        yield exact_row(f"q2, region of radius {gate:g}", "q2", q2, float(found))


def _optimum_rows(reference: Any) -> Iterator[StudyRow]:
    for point in reference["prior_optimum"]:
        fluctuating = point["model"] == "power"
        curve = (
            model_curve("fluctuating", point["snr"])
            if fluctuating
            else model_curve("gaussian", point["snr"] ** 2 / 2.0)
        )
        cells = np.array([point["cells"]])
        false_alarm = best_prior(curve, cells, (1e-5, 0.96))
        q2 = information_reduction(curve.detection(false_alarm), false_alarm * cells)
        case = f"optimum, {point['model']} {point['snr']:.3g}, {point['cells']:g} cells"
        published = point["false_alarm_probability"]
        yield exact_row(case, "false alarm probability", published, float(false_alarm[0]))
        yield exact_row(case, "q2", point["q2"], float(q2[0]))


def _recorded_rows() -> Iterator[StudyRow]:
    """Run the recorded scans again."""
    golden = load_reference("clutter_golden")
    setting = setting_of("fixed", constant_curve(golden["PD"]), golden["PF"])
    transition, noise = constant_velocity(1.0, 10.0, 2)
    for track in golden["tracks"]:
        belief = Belief(
            np.array(track["x0"])[None, None], 100.0 * np.eye(4)[None, None], np.ones((1, 1))
        )
        worst = 0.0
        for recorded in track["steps"]:
            measured = np.array(recorded["Z"], dtype=np.float64).reshape(1, -1, 2)
            present = np.ones(measured.shape[:2], dtype=bool)
            amplitude = np.full(measured.shape[:2], np.nan)
            scan = Scan(measured, present, amplitude, np.array(golden["R"])[None, None])
            outcome = step(
                belief, scan, setting, transition=transition, noise=noise[None],
                switching=np.ones((1, 1)),
            )  # fmt: skip
            belief = outcome.belief
            worst = max(worst, float(np.abs(outcome.mean - recorded["x"]).max()))
        case = f"recorded track, seed {track['seed']}"
        yield exact_row(case, "largest difference (m, m/s)", None, worst)


def _one_step_rows(reference: Any, runs: int, seed: int) -> Iterator[StudyRow]:
    published = iter(reference["one_step"])
    for scene in (EXPERIMENTS[1], EXPERIMENTS[0], EXPERIMENTS[2]):
        for variance in INNOVATION_VARIANCES_M2:
            entry = next(published)
            found = one_step(scene, variance, runs=runs, seed=seed)
            for rule, ours in found.items():
                reported, true = entry["rows"][rule]
                case = f"one scan, {entry['detector']}, S={variance:g} m^2, {rule}"
                yield error_row(case, "reported", reported, ours.reported, ours.reported_error)
                yield error_row(case, "true", true, ours.true, ours.true_error)


def _scene_rows(name: str, tallies: dict[str, TrackTally], published: Any) -> Iterator[StudyRow]:
    for method, tally in tallies.items():
        known = published.get(method, {})
        case = f"{name}, {method}"
        yield share_row(case, "lost (%)", known.get("lost_percent"), tally.lost, percent=True)
        kept = tally.means[:, ~tally.lost]
        if kept.shape[1] > 1:
            yield from _kept_rows(case, kept, known)
        if method in {"prior", "prior, two models"}:
            if tally.lost.any():
                lost = tally.flagged[tally.lost]
                yield share_row(case, "flagged among the lost (%)", None, lost, percent=True)
            if not tally.lost.all():
                kept_flag = tally.flagged[~tally.lost]
                yield share_row(case, "flagged among the kept (%)", None, kept_flag, percent=True)
    yield from _paired_rows(name, tallies, published)


def _kept_rows(case: str, kept: FloatArray, known: Any) -> Iterator[StudyRow]:
    mean = kept.mean(axis=1)
    error = kept.std(axis=1, ddof=1) / math.sqrt(kept.shape[1])
    names = (
        ("position_rmse_m", "position RMSE (m)"),
        ("velocity_rmse_mps", "velocity RMSE (m/s)"),
        ("position_trace_m2", "reported position variance (m^2)"),
        ("velocity_trace_m2ps2", "reported velocity variance (m^2/s^2)"),
        ("nees", "NEES (4 states)"),
    )
    for index, (key, quantity) in enumerate(names):
        value, half = float(mean[index]), float(error[index])
        if index < 2:
            value = math.sqrt(value)
            half /= 2.0 * value
        yield error_row(case, quantity, known.get(key), value, half)


def _paired_rows(name: str, tallies: dict[str, TrackTally], published: Any) -> Iterator[StudyRow]:
    """Compare the rules on the same scans."""
    fixed = min(("fix.1", "fix.03", "fix.01"), key=lambda m: tallies[m].lost.sum())
    pairs = {
        "prior minus best fixed": ("prior", fixed),
        "post minus prior": ("post", "prior"),
        "TS-lit minus prior": ("TS-lit", "prior"),
        "NN.05 minus prior": ("NN.05", "prior"),
    }
    for case, (ours, other) in pairs.items():
        difference = 100.0 * (tallies[ours].lost.astype(float) - tallies[other].lost)
        error = float(difference.std() / math.sqrt(difference.size))
        known = published[ours]["lost_percent"] - published[other]["lost_percent"]
        yield error_row(
            f"{name}, {case}", "lost (percentage points)", round(known, 1),
            float(difference.mean()), error,
        )  # fmt: skip


def _conclusions(rows: list[StudyRow]) -> Iterator[str]:
    """Say over all scenes how the rules compare, from the paired rows."""
    for case, subject in _COMPARED:
        found = [row for row in rows if row.case.endswith(case)]
        mean = sum(row.ours for row in found) / len(found)
        half = math.sqrt(sum((row.high - row.ours) ** 2 for row in found)) / len(found)
        yield (
            f"{subject}: {mean:+.1f} +- {half:.1f} percentage points of lost tracks "
            f"(mean of {len(found)} scenes, 95 %)."
        )


INNOVATION_VARIANCES_M2 = (25.0, 100.0, 400.0)
_NOISE_M2, _HIGHEST = 5.0, 0.3


@dataclass(frozen=True)
class OneStep:
    """Factors of variance reduction with their standard errors."""

    reported: float
    """Mean decrease of the reported variance over that without clutter."""
    reported_error: float
    """Its standard error."""
    true: float
    """Mean decrease of the squared error over that without clutter."""
    true_error: float
    """Its standard error."""


def one_step(
    scene: ClutterExperiment, innovation_variance: float, *, runs: int, seed: int
) -> dict[str, OneStep]:
    """Take one scan under every rule.

    ``innovation_variance``: variance S of each component of the innovation in m^2,
    above 5. ``runs``: number of independent scans, from 1.

    Returned: reported and true factor per rule, named as in the reference table.
    """
    rng = np.random.default_rng(seed)
    spread = innovation_variance - _NOISE_M2
    truth = math.sqrt(spread) * rng.standard_normal((runs, 2))
    detector = ClutterScene(
        target=scene.target, signal_to_noise=scene.signal_to_noise,
        noise_std=math.sqrt(_NOISE_M2), false_alarm=_HIGHEST,
        half_width=8.0 * math.sqrt(innovation_variance),
    )  # fmt: skip
    drawn = simulate_scan(rng, truth, detector)
    scan = Scan(
        drawn.measured, np.isfinite(drawn.amplitude), drawn.amplitude, _NOISE_M2 * np.eye(2)[None]
    )
    best = 2.0 * spread**2 / innovation_variance
    return {
        name: _factors(setting, scan, truth, spread, best)
        for name, setting in _settings(scene).items()
    }


def _settings(scene: ClutterExperiment) -> dict[str, ClutterSetting]:
    curve = scene.curve
    return {
        **{
            f"fixed {level:g}": setting_of("fixed", curve, level)
            for level in (0.3, 0.1, 0.03, 0.01)
        },
        "prior": setting_of("prior", curve),
        "two-step lit": setting_of("region", curve),
        "posterior": setting_of("posterior", curve),
    }


def _factors(
    setting: ClutterSetting, scan: Scan, truth: FloatArray, spread: float, best: float
) -> OneStep:
    runs = truth.shape[0]
    prediction = np.tile(np.diag([spread, 0.0, spread, 0.0]), (1, runs, 1, 1))
    outcome = step(
        Belief(np.zeros((1, runs, 4)), prediction, np.ones((1, runs))), scan, setting,
        transition=np.eye(4), noise=np.zeros((1, 4, 4)), switching=np.ones((1, 1)),
    )  # fmt: skip
    after = np.trace(outcome.covariance, axis1=1, axis2=2)
    reported = (2.0 * spread - after) / best
    left = ((outcome.mean[:, ::2] - truth) ** 2).sum(axis=1)
    true = ((truth**2).sum(axis=1) - left) / best
    root = math.sqrt(runs)
    return OneStep(
        float(reported.mean()), float(reported.std() / root),
        float(true.mean()), float(true.std() / root),
    )  # fmt: skip
