"""Level received at closest approach, and the source level that follows from it.

**Method.** The calibrated levels are the vessels' shares, which fall with the square of
the range as the fitted passages say, and a constant background: all powers are fitted
in decibels. The source level adds the loss over the slant range under a stated law.

**Conventions.** dB re the levels' reference, in their band; source levels at 1 m, and
only where the recording is calibrated.

**References.** Choi et al. (2014), eq. 3 as a sum, with a background.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.spectra import MICROPASCAL, Levels
from uwtrack_cli.estimation.correlation import long_run_excess
from uwtrack_cli.estimation.passages.fit import PassageFit
from uwtrack_cli.estimation.robust import bisquare_weight, median_scale
from uwtrack_cli.physics.passage import passage_law
from uwtrack_cli.physics.propagation import spreading_loss_db
from uwtrack_cli.stages.passages.report import Row, Setting

KEYS = ("received_level_db", "source_level_db")
LARGEST_LEVEL_STD_DB = 3.0
"""A level less certain than this is not given."""

MOST_FRAMES, MOST_FAR = 20_000, 5_000
"""Frames beyond which those far from all vessels are thinned, and to how many."""

FAR = np.log(0.01)
"""Spreading beyond ten times the range at closest approach: background alone."""


def add_levels(
    rows: list[Row], levels: Levels | None, fits: list[PassageFit], setting: Setting
) -> None:
    """Add received and source level to the rows, or why there are none.

    Parameters
    ----------
    rows
        Rows of the passages of one recording.
    levels
        Broadband levels, or None.
    fits
        Their fits.
    setting
        Sensor, medium and spreading law.
    """
    if levels is None or not rows:
        for row in rows:
            row.explain("no broadband levels", *KEYS)
        return
    time = np.asarray(levels.frames.time_s, float)
    spread = np.empty((len(fits), time.size))
    for number, fit in enumerate(fits):  # a copy each: the law's other rows may go
        law = passage_law(
            time, fit.theta[:, :3], setting.sound_speed_mps, setting.height_m
        )
        spread[number] = law.spread[0]
    width_s = max(float(fit.range_over_speed_s[0]) for fit in fits)
    level = np.asarray(levels.level_db, float)
    if time.size > MOST_FRAMES:
        kept = _telling(spread)
        level, spread, time = level[kept], spread[:, kept], time[kept]
    found = _fit_levels(level, spread, time, width_s)
    for row, level, std in zip(rows, *found, strict=True):
        if not std < LARGEST_LEVEL_STD_DB:
            row.explain("the level does not stand out from the background", *KEYS)
            continue
        row.values["received_level_db"] = float(level)
        row.values["received_level_std_db"] = float(std)
        _add_source_level(row, setting)


def _telling(spread: FloatArray) -> IntArray:
    """Choose the frames that some vessel is near, and some of all the others."""
    is_near = (spread > FAR).any(axis=0)
    is_near[:: -(-is_near.size // MOST_FAR)] = True
    return np.flatnonzero(is_near)


def _add_source_level(row: Row, setting: Setting) -> None:
    level, std = row.values["received_level_db"], row.values["received_level_std_db"]
    slant, slant_std = row.values["slant_range_m"], row.values["slant_range_std_m"]
    if not np.isfinite(slant):
        return
    if setting.reference != MICROPASCAL:
        row.explain("the recording is not calibrated", "source_level_db")
        return
    row.reasons.pop("source_level_db", None)
    loss, loss_std = spreading_loss_db(slant, slant_std, setting.spreading_db)
    row.values["source_level_db"] = level + loss
    row.values["source_level_std_db"] = float(np.hypot(std, loss_std))


def _fit_levels(
    level_db: FloatArray, spread: FloatArray, time_s: FloatArray, width_s: float
) -> tuple[FloatArray, FloatArray]:
    """Fit vessels and background in dB; levels at closest approach and deviations."""
    good = np.isfinite(level_db)
    if good.sum() < 8:
        unknown = np.full(spread.shape[0], np.nan)
        return unknown, unknown
    level, spread, time = level_db[good], spread[:, good], time_s[good]
    background = float(np.quantile(level, 0.1))
    theta: FloatArray = np.array(
        [_loudest(level, row, background) for row in spread] + [background]
    )
    weight: FloatArray = np.ones(level.size)
    slope: FloatArray = np.empty((level.size, theta.size))
    for _ in range(30):
        total, slope = _level_model(theta, spread)
        residual = level - total
        scale = max(float(median_scale(residual, np.ones(level.size))), 1e-9)
        weight = bisquare_weight(residual / scale)
        normal = slope.T @ (weight[:, None] * slope) + 1e-9 * np.eye(theta.size)
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
    normal = slope.T @ (weight[:, None] * slope) + 1e-12 * np.eye(theta.size)
    return theta[:-1], np.sqrt(np.diag(np.linalg.inv(normal)))[:-1]


def _loudest(level: FloatArray, spread: FloatArray, background: float) -> float:
    """Level about the closest approach, to start from."""
    near = spread > np.log(0.5)
    loudest = float(np.median(level[near])) if near.any() else float(level.max())
    return max(loudest, background + 1.0)


def _level_model(
    theta: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Total level, and the shares of the vessels and of the background."""
    unit = np.log(10) / 10
    parts = theta[:, None] * unit
    parts = np.concatenate([parts[:-1] + spread, parts[-1:] + 0 * spread[:1]])
    total: FloatArray = np.logaddexp.reduce(parts, axis=0)
    return total / unit, np.exp(parts - total).T
