"""Facts that a passage is fitted with and that are not known exactly.

**Method.** Depths, sound speed and compass have Gaussian priors. The depth difference
is an unknown of the fit, for near passages determine it. The law depends on speed and
depth difference only through their ratios to the sound speed, so that the prior of the
depth difference holds the sound speed as well, and what the fit leaves of it follows by
the Kalman update; speeds scale with the sound speed, and bearings turn with the
compass. A deviation of zero means known exactly.

**Conventions.** Covariances are over t0 (s), horizontal range over speed (s), v (m/s),
bearing (degrees) and depth difference (m), in this order.

**References.** Van Trees, Bell and Tian (2013), section 4.3: bounds with nuisance
parameters.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.passage.fit.covariance import slant_partials
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.model.unknowns import CHANGED, MANOEUVRE
from uwtrack_cli.motion.sound_speed import sound_speed_std

SENSOR_DEPTH_STD_M = 0.5
"""Deviation of a sensor's depth that is given without one."""

COMPASS_STD_DEG = 2.0
"""Deviation of a sensor's compass that is not given."""

NAMES = ("source_depth_m", "sensor_depth_m", "sound_speed_mps", "compass_deg")


class NuisanceEstimate(NamedTuple):
    """A nuisance after the fit."""

    name: str
    """What it is, with its unit."""
    value: float
    """Its estimate; that of the compass is the error of the bearings."""
    std: float
    """Its standard deviation."""
    share: float
    """Share of the variance of the speed that it causes; nan without a speed."""


@dataclass(frozen=True)
class NuisancePriors:
    """Means and deviations before the fit; a sensor depth of nan is unknown."""

    mean: FloatArray
    """Source depth (m), sensor depth (m), sound speed (m/s) and compass error
    (degrees), shape (4,)."""
    std: FloatArray
    """Their standard deviations, shape (4,)."""

    @property
    def height_m(self) -> float:
        """Depth of the sensor below the source, m; 0 where it is unknown."""
        height = float(self.mean[1] - self.mean[0])
        return height if np.isfinite(height) else 0.0

    @property
    def slope(self) -> FloatArray:
        """Partials of the scaled depth difference by the nuisances, shape (4,)."""
        if not np.isfinite(self.mean[1]):
            return np.zeros(4)
        return np.array([-1.0, 1.0, -self.height_m / self.mean[2], 0.0])

    @property
    def medium(self) -> Medium:
        """Sound speed, and the depth difference with its prior."""
        most = float(self.mean[1]) if np.isfinite(self.mean[1]) else np.inf
        return Medium(
            float(self.mean[2]),
            self.height_m,
            height_std_m=float(np.linalg.norm(self.slope * self.std)),
            most_m=most,
        )


def nuisance_priors(
    sensor: Sensor,
    sound_speed_mps: float | None,
    sound_speed_std_mps: float | None,
    source_depth_m: float,
    source_depth_std_m: float,
) -> NuisancePriors:
    """Return the priors that follow from a sensor and the options.

    Parameters
    ----------
    sensor
        The sensor.
    sound_speed_mps
        Sound speed of the options, m/s; None takes that of the sensor.
    sound_speed_std_mps
        Its deviation, m/s; None takes that of the sensor, or a share of the speed.
    source_depth_m
        Depth of the source, m.
    source_depth_std_m
        Its deviation, m.
    """
    speed = sound_speed_mps or sensor.sound_speed_mps
    speed_std = sound_speed_std_mps
    if speed_std is None:
        speed_std = sound_speed_std(sensor, sound_speed_mps)
    depth, depth_std = sensor.depth_m, sensor.depth_std_m
    return NuisancePriors(
        np.array([source_depth_m, np.nan if depth is None else depth, speed, 0.0]),
        np.array([
            source_depth_std_m,
            SENSOR_DEPTH_STD_M if depth_std is None else depth_std,
            speed_std,
            COMPASS_STD_DEG if sensor.compass_std_deg is None else sensor.compass_std_deg,
        ]),
    )  # fmt: skip


def marginalise(
    fit: PassageFit, priors: NuisancePriors
) -> tuple[PassageFit, list[NuisanceEstimate]]:
    """Put the nuisances into a fit's covariances, and say what is left of each.

    Parameters
    ----------
    fit
        Fit of one row.
    priors
        Means and deviations before the fit.

    Returns
    -------
    tuple[PassageFit, list[NuisanceEstimate]]
        The fit with the covariances that hold all nuisances, and their estimates.
    """
    inner = np.nan_to_num(fit.full_covariance[0])
    known = np.isfinite(np.diag(fit.full_covariance[0]))
    count = known.size + len(NAMES)
    motion, facts = [*range(5), *range(9, count)], list(range(5, 9))
    medium, speed = fit.medium, float(fit.theta[0, 2])
    gain, moved, left = np.zeros(4), 0.0, 0.0
    if medium.height_std_m and known[2]:
        gain = priors.std**2 * priors.slope / medium.height_std_m**2
        moved = float(fit.height_m[0]) - medium.height_m
        left = medium.height_std_m**2 - float(inner[4, 4])
    mean = priors.mean + gain * moved
    joint = np.zeros((count, count))
    joint[np.ix_(motion, motion)] = inner
    joint[5:9, 5:9] = np.diag(priors.std**2) - np.outer(gain, gain) * left
    joint[np.ix_(facts, motion)] = gain[:, None] * inner[4]
    joint[np.ix_(motion, facts)] = joint[np.ix_(facts, motion)].T
    # slant range over speed keeps its value when speeds scale with the sound speed
    turn = np.zeros((count + 1, count))
    turn[:count] = np.eye(count)
    slope, own = slant_partials(fit.theta, medium)[0, 1], float(fit.covariance[0, 1, 1])
    linear = float(slope @ inner[:5, :5] @ slope)
    # a rival that passes overhead has no horizontal range to speak of, but a slant one
    turn[count, :5] = slope * (np.sqrt(own / linear) if 0.0 < own < linear else 1.0)
    turn[2, 7] = speed / priors.mean[2] * float(known[2])
    turn[3, 8] = float(known[3])
    if fit.change is not None and fit.change.kind == MANOEUVRE:
        turn[9:count, 7] = fit.theta[0, CHANGED:] / priors.mean[2]
    joint = turn @ joint @ turn.T
    slant = [0, count, 2, 3]
    found = replace(
        fit,
        full_covariance=_or_nan(joint[np.ix_(motion, motion)], known)[None],
        covariance=_or_nan(joint[np.ix_(slant, slant)], known[:4])[None],
    )
    variance = joint[2, 2] if known[2] else np.nan
    estimates = []
    for place, name in enumerate(NAMES):
        left = float(joint[5 + place, 5 + place])
        if np.isfinite(mean[place]):
            share = joint[2, 5 + place] ** 2 / (left * variance) if left > 0 else 0.0
            std = float(np.sqrt(max(left, 0.0)))
            estimates.append(NuisanceEstimate(name, float(mean[place]), std, float(share)))
    return found, estimates


def _or_nan(covariance: FloatArray, known: BoolArray) -> FloatArray:
    return np.where(known[:, None] & known, covariance, np.nan)
