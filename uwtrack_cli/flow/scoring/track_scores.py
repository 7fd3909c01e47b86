"""Score positions against true tracks: errors, and GOSPA and OSPA over time.

**Method.** At every time of the fixes the vessels that the truth knows then are the set
to be found. Both are brought to one grid: that of the fixes, by geodesics where the truth
or the fixes are in latitude and longitude. Of the modes of a contact that share 95 % of
the weight the one nearest to the truth is compared, and it is said that there were
others: sensors without bearings hear a vessel and its mirror image alike.

For the distance of two sets positions are paired so that the sum of the cut-off distances is least;
what finds no partner costs the cut-off (OSPA) or half of it to the power (GOSPA).

**Conventions.** ``position_m`` is the distance to the nearest vessel; its ``sigmas``
is the Mahalanobis distance under the covariance of the fix.

**References.** Schuhmacher, Vo and Vo (2008), IEEE Trans. Signal Processing 56, 3447
(OSPA, eq. 3); Rahmathullah, Garcia-Fernandez and Svensson (2017), FUSION (GOSPA with
alpha = 2, eq. 5 and proposition 1).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid, to_latitude_longitude
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.flow.scoring.ais_passages import interpolate_track
from uwtrack_cli.flow.scoring.encounter_scores import Score
from uwtrack_cli.flow.scoring.recorded_sensors import clock_shift_s

LISTED_WEIGHT = 0.95
"""Weight of the modes among which the nearest to the truth is compared."""


@dataclass(frozen=True)
class TrackScores:
    """Errors of positions, and the mean distances of the sets over time."""

    scores: tuple[Score, ...]
    """Scores of all quantities."""
    gospa_m: float
    """Mean GOSPA over the times, m."""
    ospa_m: float
    """Mean OSPA over the times, m."""
    n_times: int
    """Number of times at which positions were compared."""
    ambiguous: tuple[str, ...]
    """Contacts whose positions were ambiguous, and which mode was compared, in words."""


def score_fixes(
    fixes: Fixes, truth: Truth, start_utc_ns: int | None, *, cutoff_m: float = 500.0
) -> TrackScores:
    """Compare positions with the tracks of the truth.

    ``fixes``: positions found. ``start_utc_ns``: UTC of time zero of the fixes, None if
    unknown. ``cutoff_m``: distance from which a position and a vessel do not belong
    together, m.

    Raises
    ------
    DataError
        The two cannot be brought to one grid or one clock.
    """
    shift_s = clock_shift_s(truth, start_utc_ns)
    tracks = [(track, *_on_grid(track, truth, fixes)) for track in truth.tracks]
    vessels = {
        time_s: _true_positions(tracks, time_s - shift_s)
        for time_s in np.unique(fixes.time_s).tolist()
    }
    scores: list[Score] = []
    compared: list[IntArray] = []
    ambiguous: list[str] = []
    for contact in np.unique(fixes.contact).tolist():
        rows, words = _compared_mode(fixes, contact, vessels)
        compared.append(rows)
        ambiguous += words
    distances: list[tuple[float, float]] = []
    chosen = np.concatenate([np.zeros(0, np.int64), *compared])
    for time_s in np.unique(fixes.time_s[chosen]).tolist():
        rows = chosen[fixes.time_s[chosen] == time_s]
        found = np.stack([fixes.east_m[rows], fixes.north_m[rows]], axis=-1)
        names, true = vessels[time_s]
        one = gospa(found, true, cutoff_m=cutoff_m)
        distances.append((one.distance_m, ospa(found, true, cutoff_m=cutoff_m)))
        if len(true):
            scores += [_score(fixes, int(row), names, true) for row in rows]
    mean = np.mean(distances, axis=0) if distances else (np.nan, np.nan)
    return TrackScores(
        tuple(scores), float(mean[0]), float(mean[1]), len(distances), tuple(ambiguous)
    )


def _compared_mode(
    fixes: Fixes, contact: int, vessels: Mapping[float, tuple[list[str], FloatArray]]
) -> tuple[IntArray, list[str]]:
    """Return the rows of the listed mode nearest to the truth, and what is to be said."""
    of_contact = np.flatnonzero(fixes.contact == contact)
    by_mode: dict[int, IntArray] = {}
    listed = 0.0
    for mode in np.unique(fixes.mode[of_contact]).tolist():  # best first
        if listed >= LISTED_WEIGHT:
            break
        by_mode[mode] = of_contact[fixes.mode[of_contact] == mode]
        listed += float(fixes.weight[by_mode[mode][0]])
    off = {
        mode: [
            _score(fixes, int(row), *vessels[float(fixes.time_s[row])]).error
            for row in rows
            if len(vessels[float(fixes.time_s[row])][1])
        ]
        for mode, rows in by_mode.items()
    }
    nearest = min(by_mode, key=lambda mode: sum(off[mode]))
    rows = by_mode[nearest]
    if len(by_mode) == 1:
        return rows, []
    said = (
        f"contact {contact}: mode {nearest} is compared, the nearest of {len(by_mode)} "
        f"that share the weight (its own {float(fixes.weight[rows[0]]):.2f})"
    )
    return rows, [said]


def _on_grid(track: VesselTrack, truth: Truth, fixes: Fixes) -> tuple[FloatArray, FloatArray]:
    """Return the positions of a vessel on the grid of the fixes."""
    latitude, longitude = fixes.origin_latitude, fixes.origin_longitude
    if latitude is None or longitude is None:
        if truth.is_geographic:
            msg = "the positions are on a local grid, and AIS needs latitudes: give "
            msg += "the sensors their latitude and longitude and run again."
            raise DataError(msg)
        place = (0.0, 0.0)
        if fixes.origin != "grid":  # relative to a sensor
            place = truth.sensor_places.get(fixes.origin.removeprefix("sensor "), (0.0, 0.0))
        return track.first - place[0], track.second - place[1]
    there = Origin(latitude, longitude)
    first, second = track.first, track.second
    if not truth.is_geographic:
        if truth.origin is None:
            raise DataError(f"{truth.name} does not say where its grid lies, and the fixes do.")
        if truth.origin == (latitude, longitude):
            return first, second
        first, second = to_latitude_longitude(first, second, Origin(*truth.origin))
    return places_on_grid(first, second, there)


def _true_positions(
    tracks: list[tuple[VesselTrack, FloatArray, FloatArray]], time_s: float
) -> tuple[list[str], FloatArray]:
    names, places = [], []
    for track, east, north in tracks:
        if track.time_s.size < 2:
            continue
        x, y = interpolate_track(track, east, north, np.array([time_s]))
        if np.isfinite(x[0]):
            names.append(track.vessel)
            places.append((float(x[0]), float(y[0])))
    return names, np.array(places).reshape(-1, 2)


def _score(fixes: Fixes, row: int, names: list[str], true: FloatArray) -> Score:
    apart = np.array([fixes.east_m[row], fixes.north_m[row]]) - true
    nearest = int(np.argmin(np.hypot(*apart.T)))
    off, covariance = apart[nearest], fixes.covariance_m2[row]
    distance = float(np.hypot(*off))
    std = sigmas = float("nan")
    if np.isfinite(covariance).all() and np.linalg.det(covariance) > 0.0:
        std = float(np.sqrt(np.trace(covariance)))
        sigmas = float(np.sqrt(off @ np.linalg.solve(covariance, off)))
    return Score(
        "fixes", int(fixes.contact[row]), str(fixes.sensors[row]), names[nearest],
        "position_m", distance, 0.0, distance, float("nan"), std, sigmas,
    )  # fmt: skip


@dataclass(frozen=True)
class Gospa:
    """The distance and its parts, each as a sum of powers before the root."""

    distance_m: float
    """The distance, m."""
    localisation: float
    """Sum of the powers of the distances of the pairs, m^order."""
    n_missed: int
    """Number of true positions without a partner."""
    n_false: int
    """Number of found positions without a partner."""


def gospa(estimated: FloatArray, true: FloatArray, *, cutoff_m: float, order: float = 2.0) -> Gospa:
    """Return the generalised optimal sub-pattern assignment distance.

    ``estimated``: positions found, shape (n, 2), m. ``true``: positions that were
    there, shape (m, 2), m. ``cutoff_m``: distance from which two positions do not
    belong together, m, positive. ``order``: power in which distances count, 1 or more.

    Examples
    --------
    >>> found = gospa(np.zeros((1, 2)), np.array([[3.0, 4.0]]), cutoff_m=10.0)
    >>> found.distance_m, found.n_missed
    (5.0, 0)
    """
    costs = _paired_costs(estimated, true, cutoff_m, order)
    near = costs[costs < cutoff_m**order]
    n_false, n_missed = len(estimated) - near.size, len(true) - near.size
    penalty = 0.5 * cutoff_m**order * (n_false + n_missed)
    total = float(near.sum()) + penalty
    return Gospa(total ** (1.0 / order), float(near.sum()), n_missed, n_false)


def ospa(estimated: FloatArray, true: FloatArray, *, cutoff_m: float, order: float = 2.0) -> float:
    """Return the optimal sub-pattern assignment distance, m.

    ``estimated``: positions found, shape (n, 2), m. ``true``: positions that were
    there, shape (m, 2), m. ``cutoff_m``: distance from which two positions do not
    belong together, m, positive. ``order``: power in which distances count, 1 or more.

    Examples
    --------
    >>> ospa(np.zeros((0, 2)), np.array([[3.0, 4.0]]), cutoff_m=10.0)
    10.0
    """
    costs = _paired_costs(estimated, true, cutoff_m, order)
    larger = max(len(estimated), len(true))
    if larger == 0:
        return 0.0
    alone = cutoff_m**order * (larger - costs.size)
    return float(((costs.sum() + alone) / larger) ** (1.0 / order))


def _paired_costs(
    estimated: FloatArray, true: FloatArray, cutoff_m: float, order: float
) -> FloatArray:
    """Return the cut-off costs of the best pairs."""
    from scipy.optimize import linear_sum_assignment

    if not (cutoff_m > 0.0 and order >= 1.0):
        raise OptionError(
            f"cutoff_m must be positive and order 1 or more, got {cutoff_m}, {order}."
        )
    apart = np.linalg.norm(estimated[:, None, :] - true[None, :, :], axis=-1)
    costs = np.minimum(apart, cutoff_m) ** order
    chosen: FloatArray = costs[linear_sum_assignment(costs)]
    return chosen
