"""Frequency lines: the paper's trackers, the comb test and weak lines in sound.

**Method.** Three experiments. *Tracker*: the scene of `line_scene` with the paper's
conventional tracker, its feedback tracker, and the control that gives lax parameters
to every confirmed line without a classifier. *Comb*: families in noise and real ones.
*Sound*: the SNR at which half of all lines are heard in a minute, before detection
and by peaks, and the error of the smoothed frequency.

**Conventions.** Intervals are 95 %: of the mean over runs, of a share (Wilson), or by
resampling trials (bootstrap).

**References.** Choi (2014), section 4; reference figures of an independent
implementation in ``reference/lines.json``.
"""

from dataclasses import astuple, fields
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.flow.studies.line_comb import family_chances, noise_chances
from uwtrack_cli.flow.studies.line_runs import RunFigures, Setting, run_figures
from uwtrack_cli.flow.studies.line_scene import SceneRule
from uwtrack_cli.flow.studies.line_sound import Heard, listen
from uwtrack_cli.flow.studies.table import Study, StudyRow, load_reference

SETTINGS: tuple[Setting, ...] = ("conventional", "feedback", "lax")
N_INTERFERERS = 6
SNR_GRIDS = {
    "trace": (-3.0, -2.0, -1.0, 0.0, 1.0),
    "score": (1.0, 2.5, 4.0, 5.5, 7.0),
    "count": (3.0, 4.5, 6.0, 7.5, 9.0),
}
LAX_REMARK = (
    "Lax parameters for every confirmed line, without a classifier, associate as much "
    "as the feedback tracker in sparse clutter: the gain is that of alpha and gamma, "
    "not of classification, which pays in dense clutter and against interferers."
)
SCORE_REMARK = (
    "The score keeps Wald's bound on false lines, of which white noise uses a fifth; "
    "the reference's score was set to equal false lines by simulation."
)


def study_lines(*, runs: int = 30, seed: int = 1) -> Study:
    """Repeat the experiments on frequency lines and set them beside the reference.

    Parameters
    ----------
    runs
        Runs of each setting of the tracker; the other experiments scale with it.
    seed
        Seed of all random numbers.
    """
    reference = load_reference("lines")
    rows = [
        *_tracker_rows(reference, runs, seed),
        *_interferer_rows(reference, runs, seed),
        *_comb_rows(reference, 20 * runs, seed),
        *_sound_rows(reference, runs, seed),
    ]
    return Study(
        "lines",
        reference["source"],
        runs,
        seed,
        tuple(rows),
        (LAX_REMARK, SCORE_REMARK),
    )


def _tracker_rows(reference: dict[str, Any], runs: int, seed: int) -> list[StudyRow]:
    rows = []
    for snr, by_setting in reference["tracker"].items():
        for setting in SETTINGS:
            table = _runs(setting, SceneRule(float(snr)), runs, seed)
            for column, field in enumerate(fields(RunFigures)):
                known = by_setting[setting].get(field.name)
                rows.append(_mean_row(
                    f"tracker {setting} {snr} dB", field.name, known, table[:, column]
                ))  # fmt: skip
    return rows


def _runs(setting: Setting, rule: SceneRule, runs: int, seed: int) -> FloatArray:
    return np.array(
        [astuple(run_figures(setting, rule, 1_000_003 * seed + k)) for k in range(runs)]
    )


def _interferer_rows(reference: dict[str, Any], runs: int, seed: int) -> list[StudyRow]:
    rule = SceneRule(-20.0, n_interferers=N_INTERFERERS)
    rows = []
    for setting in SETTINGS:
        table = _runs(setting, rule, max(runs // 3, 2), seed)
        rows.append(_mean_row(
            f"six interferers {setting} -20 dB", "other lines per frame",
            reference["interferers"].get(setting), table[:, -1],
        ))  # fmt: skip
    return rows


def _comb_rows(reference: dict[str, Any], sets: int, seed: int) -> list[StudyRow]:
    rng = np.random.default_rng(seed)
    rows = []
    for density, share in reference["comb_false"].items():
        chances = noise_chances(float(density), sets, rng)
        rows.append(_share_row(
            f"comb, {density} peaks of noise", "share with NFA < 0.1",
            share, chances < -1.0,
        ))  # fmt: skip
    for density, by_teeth in reference["comb_detection"].items():
        noise = noise_chances(float(density), max(sets, 300), rng)
        threshold = np.quantile(noise, 0.01)
        for teeth, share in by_teeth.items():
            chances = family_chances(int(teeth), float(density), sets // 2, rng)
            rows.append(_share_row(
                f"comb of {teeth} teeth, {density} peaks of noise",
                "detected at 1 % false", share, chances < threshold,
            ))  # fmt: skip
    return rows


def _sound_rows(reference: dict[str, Any], runs: int, seed: int) -> list[StudyRow]:
    rows = []
    for method, grid in SNR_GRIDS.items():
        heard = np.array(
            [
                [trial.is_heard for trial in _trials(method, snr, runs, seed)]
                for snr in grid
            ]
        )
        rows.append(_half_row(
            f"sound, {method}", reference["snr50_db"][method], np.array(grid), heard,
            np.random.default_rng(seed),
        ))  # fmt: skip
    for snr, known in reference["trace_rmse_hz"].items():
        squares = np.array(
            [
                trial.square_error_hz2
                for trial in _trials("trace", float(snr), runs, seed)
            ]
        )
        row = _mean_row("", "", None, squares[np.isfinite(squares)])
        rows.append(StudyRow(
            f"sound, trace, {snr} dB", "smoothed frequency error Hz", known,
            *(float(np.sqrt(max(v, 0.0))) for v in (row.ours, row.low, row.high)),
        ))  # fmt: skip
    return rows


def _trials(method: str, snr: float, runs: int, seed: int) -> list[Heard]:
    return [listen(method, snr, 7_919 * seed + k) for k in range(runs)]


def _mean_row(
    case: str, quantity: str, known: float | None, values: FloatArray
) -> StudyRow:
    mean = float(values.mean())
    half = 1.96 * float(values.std(ddof=1)) / np.sqrt(values.size)
    return StudyRow(case, quantity, known, mean, mean - half, mean + half)


def _share_row(
    case: str, quantity: str, known: float | None, is_hit: BoolArray
) -> StudyRow:
    n, p, z = is_hit.size, float(is_hit.mean()), 1.96
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    return StudyRow(case, quantity, known, p, middle - half, middle + half)


def _half_row(
    case: str,
    known: float,
    grid_db: FloatArray,
    heard: BoolArray,
    rng: np.random.Generator,
) -> StudyRow:
    """SNR at which half of the lines are heard, with a bootstrap over trials."""
    ours = half_heard_db(grid_db, heard.mean(axis=1))
    draws = rng.integers(0, heard.shape[1], (200, heard.shape[1]))
    again = [half_heard_db(grid_db, heard[:, draw].mean(axis=1)) for draw in draws]
    low, high = np.quantile(again, [0.025, 0.975])
    quantity = "SNR of half the lines dB"
    return StudyRow(case, quantity, known, ours, float(low), float(high))


def half_heard_db(grid_db: FloatArray, share: FloatArray) -> float:
    """Interpolate the SNR at which one half is heard; the ends if it is outside.

    Examples
    --------
    >>> round(half_heard_db(np.array([0.0, 2.0]), np.array([0.25, 0.75])), 6)
    1.0
    """
    rising = np.maximum.accumulate(share)
    # ties are spread, since interpolation wants strictly rising shares
    rising = rising + 1e-9 * np.arange(rising.size)
    return float(np.interp(0.5, rising, grid_db))
