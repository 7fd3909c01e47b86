"""Tables of bearings of several sensors, and of a platform that circles, over many draws.

Prints them:
python -m tests.benchmarks.table_figures still 100 5000 (boats 200 6000, drifting 200 8000,
circling 40 7000, structured 60 9000, structured-untold 60 9000)
"""

import sys
import warnings

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import binomtest

from tests.draws.sensor_tables import buoys, untold
from tests.motion.test_sensor_tables import circling
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


SPEEDS_MPS = {"still": (0.0, 0.0), "boats": (1.0, 5.0), "drifting": (0.05, 0.5)}


def fixes(runs, seed, kind):
    """Print errors of fixes beside least squares and the bound, and what ellipses hold."""
    far, moves = 0, kind != "still"
    ours, theirs, bound, held, readings = [], [], [], [], []
    for number in range(seed, seed + runs):
        series, place, velocity, wrong = buoys(number, moving=moves, speeds_mps=SPEEDS_MPS[kind])
        truth = place + MIDDLE_S * velocity
        by_squares = least_squares_fix(series, truth, moves=moves)
        theirs.append(np.hypot(*(by_squares - truth)))
        covariance = information_bound(series, place, velocity, wrong, moves=moves)
        bound.append(typical_error(covariance))
        found = locate_vessels(series=series, at=["0", "600", "1200"])
        if not found.time_s.size:
            far += 1
            continue
        off = np.stack([found.east_m, found.north_m], 1)[:3] - place
        off -= found.time_s[:3, None] * velocity
        ours.append(np.hypot(*off[1]))
        chance = np.linalg.solve(found.covariance_m2[:3], off[:, :, None])[:, :, 0]
        held.append((off * chance).sum(1) < 5.99)
        share = 1.0 - found.motion_model_probability[0]
        readings.append((found.motion_model[0], float(share)))
    print(
        f"{kind}, {runs} tables, seed {seed}: median error {np.median(ours):.0f} m, by "
        f"least squares {np.median(theirs):.0f} m, bound {np.median(bound):.0f} m; "
        f"without a fix {far}"
    )
    for time_s, inside in zip((0, 600, 1200), np.array(held).T, strict=True):
        low, high = binomtest(int(inside.sum()), inside.size).proportion_ci()
        print(f"ellipses at {time_s} s hold {inside.mean():.1%} ({low:.1%} to {high:.1%})")
    for name in ("stationary", "moving", ""):
        shares = np.array([share for read, share in readings if read == name])
        if shares.size:
            print(
                f"read as {name or 'neither'}: {shares.size}, of them with a rival "
                f"{np.count_nonzero(shares >= 0.05)}"
            )


def structured(runs, seed, *, told):
    """Print errors of a boat among rows that are another boat's, a fifth to two fifths.

    Which contact is this boat's is told by its rows, not by its place.
    """
    far, error, held, own, flagged, others = 0, [], [], [], [], 0
    for number in range(seed, seed + runs):
        share = np.random.default_rng(number).uniform(0.2, 0.4)
        series, place, velocity, wrong = buoys(number, strange=0.05, of_another=share)
        series = series if told else untold(series)
        found = locate_vessels(series=series, at=["0", "600", "1200"])
        motions = estimate_motion(series)
        chances = {
            contact: motions.row_probability[motions.row_contact == contact][
                np.argsort(motions.row_number[motions.row_contact == contact])
            ]
            for contact in np.unique(motions.row_contact)
        }
        contact = max(chances, key=lambda one: chances[one][~wrong].mean())
        chance = chances[contact]
        others += len(chances) > 1
        own.append((chance[~wrong].mean(), chance[wrong].mean()))
        flagged.append(((chance[wrong] < 0.5).mean(), (chance[~wrong] < 0.5).mean()))
        if contact not in found.contact:
            far += 1
            continue
        off = np.stack([found.east_m, found.north_m], 1) - place
        off -= found.time_s[:, None] * velocity
        best = np.flatnonzero(found.contact == contact)[:3]
        error.append(np.hypot(*off[best[1]]))
        chance = np.linalg.solve(found.covariance_m2[best], off[best, :, None])
        held.append((off[best] * chance[:, :, 0]).sum(1) < 5.99)
    inside = np.sum(held, axis=0)
    mine, strange = np.mean(own, axis=0)
    caught, lost = np.mean(flagged, axis=0)
    print(
        f"structured, {'told' if told else 'untold'}, {runs} tables, seed {seed}: median "
        f"error {np.median(error):.0f} m, nine in ten within {np.quantile(error, 0.9):.0f} "
        f"m; without a fix {far}; ellipses hold {inside.tolist()} of {len(held)} at 0, 600 "
        f"and 1200 s; the other boat is a contact in {others}; probability of own rows "
        f"{mine:.2f}, of strange ones {strange:.2f}; below one half {lost:.1%} and "
        f"{caught:.1%}"
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
    elif kind in {"structured", "structured-untold"}:
        structured(runs, seed, told=kind == "structured")
    else:
        fixes(runs, seed, kind)
