"""Ask whether an adaptive threshold, or region, helps a track through clutter.

**Method.** The factor q2 is compared with its reference tables, the recorded tracks are
run again, one scan is taken under every rule, and the paper's scenes are run with paired
measurements.

**References.** Choi, Kim and Hong (2001); Gelfand, Fortmann and Bar-Shalom (1996).
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.clutter.clutter_filter import Scan, step
from uwtrack_cli.estimation.clutter.detection_threshold import best_prior
from uwtrack_cli.estimation.clutter.information_reduction import information_reduction
from uwtrack_cli.estimation.clutter.operating_curve import constant_curve, model_curve
from uwtrack_cli.estimation.clutter.pda import constant_velocity
from uwtrack_cli.estimation.imm import Belief
from uwtrack_cli.flow.studies.clutter_one_step import INNOVATION_VARIANCES_M2, one_step
from uwtrack_cli.flow.studies.clutter_runs import SCENES, Tally, run_scene, setting_of
from uwtrack_cli.flow.studies.table import Study, StudyRow, load_reference

_LEGEND = (
    "lost: more than 100 m wrong, or a position variance above (100 m)^2, at any scan "
    "from 7 s on; the other figures are means over the tracks that were kept. "
    "flagged: the evidence of a loss rose above 10 at any scan. "
    "TS-lit: the paper's two steps, threshold and validation region."
)
_COMPARED = (
    ("prior minus best fixed", "The prior-optimised threshold against the best fixed"),
    ("TS-lit minus prior", "The paper's shrinking region against the prior rule"),
    ("post minus prior", "Choosing after the scan against the prior rule"),
)


def study_clutter(*, runs: int = 1000, seed: int = 1) -> Study:
    """Compare the clutter tracker with the published experiment.

    Parameters
    ----------
    runs
        Number of tracks in each scene; the one-scan test takes 20 times as many.
    seed
        Seed of all random numbers.

    Returns
    -------
    Study
        Information factors, recorded tracks, single scans and whole tracks.
    """
    reference = load_reference("clutter")
    rows = [
        *_reduction_rows(reference),
        *_optimum_rows(reference),
        *_recorded_rows(),
        *_one_step_rows(reference, 20 * runs, seed),
    ]
    for scene in SCENES:
        tallies = run_scene(scene, runs=runs, seed=seed)
        rows += _scene_rows(scene.name, tallies, reference["tracks"][scene.name])
    remarks = (_LEGEND, *_conclusions(rows))
    return Study("clutter", reference["source"], runs, seed, tuple(rows), remarks)


def _exact(case: str, quantity: str, reference: float | None, ours: float) -> StudyRow:
    return StudyRow(case, quantity, reference, ours, ours, ours)


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
        yield _exact(case, "largest difference from the table", None, worst)
    for gate, _, q2, *_ in reference["gate_size"]:
        found = information_reduction(0.8, 2.0 * (gate / 4.0) ** 2, gate=gate)
        yield _exact(f"q2, region of radius {gate:g}", "q2", q2, float(found))


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
        yield _exact(case, "false alarm probability", published, float(false_alarm[0]))
        yield _exact(case, "q2", point["q2"], float(q2[0]))


def _recorded_rows() -> Iterator[StudyRow]:
    """Run the recorded scans again."""
    golden = load_reference("clutter_golden")
    setting = setting_of("fixed", constant_curve(golden["PD"]), golden["PF"])
    transition, noise = constant_velocity(1.0, 10.0, 2)
    for track in golden["tracks"]:
        belief = Belief(
            np.array(track["x0"])[None, None], 100.0 * np.eye(4)[None, None],
            np.ones((1, 1)),
        )  # fmt: skip
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
        yield _exact(case, "largest difference (m, m/s)", None, worst)


def _one_step_rows(reference: Any, runs: int, seed: int) -> Iterator[StudyRow]:
    published = iter(reference["one_step"])
    for scene in (SCENES[1], SCENES[0], SCENES[2]):
        for variance in INNOVATION_VARIANCES_M2:
            entry = next(published)
            found = one_step(scene, variance, runs=runs, seed=seed)
            for rule, ours in found.items():
                reported, true = entry["rows"][rule]
                case = f"one scan, {entry['detector']}, S={variance:g} m^2, {rule}"
                yield _around(
                    case, "reported", reported, ours.reported, ours.reported_error
                )
                yield _around(case, "true", true, ours.true, ours.true_error)


def _around(
    case: str, quantity: str, reference: float | None, ours: float, error: float
) -> StudyRow:
    half = 1.96 * error
    return StudyRow(case, quantity, reference, ours, ours - half, ours + half)


def _scene_rows(
    name: str, tallies: dict[str, Tally], published: Any
) -> Iterator[StudyRow]:
    for method, tally in tallies.items():
        known = published.get(method, {})
        case = f"{name}, {method}"
        yield _percent(case, "lost (%)", known.get("lost_percent"), tally.lost)
        kept = tally.means[:, ~tally.lost]
        if kept.shape[1] > 1:
            yield from _kept_rows(case, kept, known)
        if method in {"prior", "prior, two models"}:
            if tally.lost.any():
                lost = tally.flagged[tally.lost]
                yield _percent(case, "flagged among the lost (%)", None, lost)
            if not tally.lost.all():
                kept_flag = tally.flagged[~tally.lost]
                yield _percent(case, "flagged among the kept (%)", None, kept_flag)
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
        yield _around(case, quantity, known.get(key), value, half)


def _paired_rows(
    name: str, tallies: dict[str, Tally], published: Any
) -> Iterator[StudyRow]:
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
        yield _around(
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


def _percent(
    case: str, quantity: str, reference: float | None, events: BoolArray
) -> StudyRow:
    """Return a share with its Wilson interval."""
    count, share, z = events.size, float(events.mean()), 1.96
    centre = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    half *= z / (1 + z**2 / count)
    low, high = 100.0 * max(centre - half, 0.0), 100.0 * (centre + half)
    return StudyRow(case, quantity, reference, 100.0 * share, low, min(high, 100.0))
