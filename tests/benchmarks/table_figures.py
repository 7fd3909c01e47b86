"""Tables of bearings of several sensors, and of a platform that circles, over many draws.

The figures in tests/baselines/buoys.md are made by:
python -m tests.benchmarks.table_figures still 100 5000 (boats 200 6000, circling 40 7000)
"""

import sys
import warnings

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import binomtest

from tests.motion.sensor_tables import buoys
from tests.motion.test_sensor_tables import circling, errors
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.options import Nuisances
from uwtrack_cli.motion.tma import estimate_motion

STD_RAD, OFFSET_STD_RAD = np.radians(8.0), np.radians(15.0 / np.sqrt(3.0))
MIDDLE_S = 600.0


def least_squares_fix(series, start, *, moves):
    """Return the place at 600 s by robust least squares with the offsets as unknowns.

    It begins at the truth, and knows whether the source moves.
    """
    _, sensor = np.unique(series.sensor, return_inverse=True)
    own = np.stack([series.sensor_east_m, series.sensor_north_m], 1)
    lag, count = series.time_s - MIDDLE_S, sensor.max() + 1

    def misfit(x):
        way = x[:2] + x[2:4] * lag[:, None] * moves - own
        off = np.arctan2(*way.T) + x[4:][sensor] - np.radians(series.bearing_deg)
        z = ((off + np.pi) % (2.0 * np.pi) - np.pi) / STD_RAD
        robust = np.sign(z) * 3.0 * np.sqrt(np.log1p(z**2 / 9.0))
        return np.concatenate([robust, x[2:4] / 7.0, x[4:] / OFFSET_STD_RAD])

    first = np.concatenate([start, np.zeros(2 + count)])
    return least_squares(misfit, first, x_scale=np.maximum(np.abs(first), 0.1)).x[:2]


def information_bound(series, place, velocity, wrong, *, moves):
    """Return the covariance of the place at 600 s by the Fisher information."""
    _, sensor = np.unique(series.sensor, return_inverse=True)
    own = np.stack([series.sensor_east_m, series.sensor_north_m], 1)
    way = place + velocity * series.time_s[:, None] - own
    slope = np.stack([way[:, 1], -way[:, 0]], 1) / (way**2).sum(1)[:, None]
    lag = (series.time_s - MIDDLE_S)[:, None]
    rows = np.concatenate([slope, slope * lag, np.eye(sensor.max() + 1)[sensor]], 1)
    prior = np.concatenate([np.zeros(2), np.full(2, 7.0**-2.0),
                            np.full(sensor.max() + 1, OFFSET_STD_RAD**-2.0)])  # fmt: skip
    if not moves:
        prior[2:4] = 1e12
    fisher = rows[~wrong].T @ rows[~wrong] / STD_RAD**2 + np.diag(prior)
    return np.linalg.inv(fisher)[:2, :2]


def typical_error(covariance):
    """Return the median length of errors of a covariance."""
    draw = np.random.default_rng(1).standard_normal((4000, 2))
    return np.median(np.hypot(*(np.linalg.cholesky(covariance) @ draw.T)))


def fixes(runs, seed, *, moves):
    """Print errors of fixes beside least squares and the bound, and what ellipses hold."""
    far, held, ours, theirs, bound = 0, 0, [], [], []
    for number in range(seed, seed + runs):
        series, place, velocity, wrong = buoys(number, moving=moves)
        truth = place + MIDDLE_S * velocity
        by_squares = least_squares_fix(series, truth, moves=moves)
        theirs.append(np.hypot(*(by_squares - truth)))
        covariance = information_bound(series, place, velocity, wrong, moves=moves)
        bound.append(typical_error(covariance))
        found = locate_vessels(series=series, at=["600"])
        if not found.time_s.size:
            far += 1
            continue
        error, chance = errors(found, place, velocity)
        ours.append(error)
        held += chance < 5.99
    low, high = binomtest(held, len(ours)).proportion_ci()
    print(
        f"{runs} tables, seed {seed}: median error {np.median(ours):.0f} m, by least "
        f"squares {np.median(theirs):.0f} m, bound {np.median(bound):.0f} m; without a "
        f"fix {far}; ellipses hold {held / len(ours):.1%} ({low:.1%} to {high:.1%})"
    )


def from_the_circle(runs, seed):
    """Print errors of a nearly still source among others, circled at 160 m."""
    error, untrusted, missed, refused = [], 0, 0, 0
    for number in range(seed, seed + runs):
        draw = np.random.default_rng(number)
        strange, others = float(draw.uniform(0.24, 0.6)), int(draw.integers(0, 3))
        series, ship, place, _ = circling(number, strange=strange, n_other=others)
        try:
            motions = estimate_motion(series, None, ship, nuisances=Nuisances())
        except DataError:
            refused += 1
            continue
        angle = np.radians(motions.bearing_deg[0])
        found = motions.range_m[0] * np.array([np.sin(angle), np.cos(angle)])
        error.append(np.hypot(*(found - place)))
        range_m = np.hypot(*place)
        low, high = motions.range_low_m[0], motions.range_high_m[0]
        is_trusted = bool(motions.observable[0]) and np.isfinite(motions.range_m[0])
        untrusted += not is_trusted
        missed += is_trusted and not low <= range_m <= high
        if is_trusted and not low <= range_m <= high:
            print(f"missed: seed {number}, {range_m:.0f} m, {low:.0f} to {high:.0f}")
    print(
        f"{runs} circles, seed {seed}: median error {np.nanmedian(error):.1f} m; untrusted "
        f"{untrusted}, refused {refused}; ok with an interval that misses {missed}"
    )


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    kind, runs, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    if kind == "circling":
        from_the_circle(runs, seed)
    else:
        fixes(runs, seed, moves=kind == "boats")
