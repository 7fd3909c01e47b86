"""Level received at closest approach, and the source level that follows from it.

**Method.** The calibrated levels are a vessel's share, which falls with the square of
the range as the fitted passage says, and a constant background: both powers are fitted
in decibels. The source level adds the loss over the slant range under a stated law.

**Conventions.** dB re the levels' reference, in their band; source levels at 1 m, and
only where the recording is calibrated.

**References.** Choi et al. (2014), eq. 3 with a background.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.spectra import MICROPASCAL, Levels
from uwtrack_cli.estimation.correlation import long_run_excess
from uwtrack_cli.estimation.passage_fit import PassageFit
from uwtrack_cli.estimation.robust import bisquare_weight, median_scale
from uwtrack_cli.physics.passage import passage_law
from uwtrack_cli.stages.passages.report import Row, Setting

KEYS = ("received_level_db", "source_level_db")
LARGEST_LEVEL_STD_DB = 3.0
"""A level less certain than this is not given."""


def add_levels(
    row: Row, levels: Levels | None, fit: PassageFit, setting: Setting, n_vessels: int
) -> None:
    """Add received and source level to a row, or why there are none.

    Parameters
    ----------
    row
        Row of the encounter.
    levels
        Broadband levels, or None.
    fit
        Fit of the passage.
    setting
        Sensor, medium and spreading law.
    n_vessels
        Number of vessels that passed.
    """
    if levels is None:
        row.explain("no broadband levels", *KEYS)
        return
    if n_vessels > 1:
        row.explain("several vessels share the broadband", *KEYS)
        return
    time = np.asarray(levels.frames.time_s, float)
    law = passage_law(time, fit.theta[:, :3], setting.sound_speed_mps, setting.height_m)
    level, std = _fit_level(
        np.asarray(levels.level_db, float), law.spread[0], time,
        float(fit.range_over_speed_s[0]),
    )  # fmt: skip
    if not std < LARGEST_LEVEL_STD_DB:
        row.explain("the level does not stand out from the background", *KEYS)
        return
    row.values["received_level_db"] = level
    row.values["received_level_std_db"] = std
    _add_source_level(row, setting)


def _add_source_level(row: Row, setting: Setting) -> None:
    level, std = row.values["received_level_db"], row.values["received_level_std_db"]
    slant, slant_std = row.values["slant_range_m"], row.values["slant_range_std_m"]
    if not np.isfinite(slant):
        return
    if setting.reference != MICROPASCAL:
        row.explain("the recording is not calibrated", "source_level_db")
        return
    row.reasons.pop("source_level_db", None)
    loss_std = setting.spreading_db / np.log(10) * slant_std / slant
    row.values["source_level_db"] = level + setting.spreading_db * np.log10(slant)
    row.values["source_level_std_db"] = float(np.hypot(std, loss_std))


def _fit_level(
    level_db: FloatArray, spread: FloatArray, time_s: FloatArray, width_s: float
) -> tuple[float, float]:
    """Fit vessel and background in dB; level at closest approach and deviation."""
    good = np.isfinite(level_db)
    if good.sum() < 8:
        return float("nan"), float("nan")
    level, spread, time = level_db[good], spread[good], time_s[good]
    background = float(np.quantile(level, 0.1))
    near = spread > np.log(0.5)
    loudest = float(np.median(level[near])) if near.any() else float(level.max())
    theta: FloatArray = np.array([max(loudest, background + 1.0), background])
    weight: FloatArray = np.ones(level.size)
    slope: FloatArray = np.empty((level.size, 2))
    for _ in range(30):
        total, slope = _level_model(theta, spread)
        residual = level - total
        scale = max(float(median_scale(residual, np.ones(level.size))), 1e-9)
        weight = bisquare_weight(residual / scale)
        normal = slope.T @ (weight[:, None] * slope) + 1e-9 * np.eye(2)
        step = np.linalg.solve(normal, slope.T @ (weight * residual))
        theta = theta + np.clip(step, -6.0, 6.0)
        if np.abs(step).max() < 1e-6:
            break
    residual = level - _level_model(theta, spread)[0]
    precision = weight / scale**2
    excess = long_run_excess(
        residual[None],
        precision[None],
        time,
        max(1.5 * width_s, float(np.ptp(time)) / 50),
    )
    weight = precision / (1 + excess[0] * precision)
    covariance = np.linalg.inv(slope.T @ (weight[:, None] * slope) + 1e-12 * np.eye(2))
    return float(theta[0]), float(np.sqrt(covariance[0, 0]))


def _level_model(
    theta: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    unit = np.log(10) / 10
    vessel = theta[0] * unit + spread
    total = np.logaddexp(vessel, theta[1] * unit)
    share = np.exp(vessel - total)
    return total / unit, np.stack([share, 1 - share], axis=1)
