"""Where the target of a table of sensors was at given times: fixes with ellipses.

**Method.** The motion that the bearings of all sensors determine is carried to each time,
with its covariance. Where bearings alone are measured and one mode explains them, mean and
covariance are those of the posterior over two readings, a source at rest and one that moves
(see `place_readings`). Few bearings, or bearings of one moment, tell a place and no
velocity: no reading is told then, and the velocity has the deviation of vessels in general,
so that the ellipse grows from the time of the bearings on.

**Conventions.** East and north on the grid of the sensors; latitude and longitude where
they have them. What is read as still has no course: that of its posterior's mean velocity
would be the direction of nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.series import Series
from uwtrack_cli.estimation.constant_velocity import carried_on
from uwtrack_cli.motion.fix_table import FixRows, fix_rows, fix_table
from uwtrack_cli.motion.target_motion.contact import ContactAnswer
from uwtrack_cli.motion.target_motion.contact_pairing import Pairings
from uwtrack_cli.motion.target_motion.inputs import Platforms
from uwtrack_cli.motion.target_motion.model import state_at, state_jacobian
from uwtrack_cli.motion.target_motion.modes import ModeAnswer
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.place_readings import (
    NO_READING,
    STILL,
    VELOCITY_STDS_MPS,
    VESSEL_VELOCITY_STD_MPS,
    PlaceReading,
    compete,
    mixture,
    moving_region,
    still_region,
)


def first_place(platforms: Platforms) -> FloatArray:
    """Return east and north of the sensor at the first row, from which states count."""
    return np.array([platforms.east_m[0], platforms.north_m[0]])


def grid_state(
    mode: ModeAnswer, platforms: Platforms, since_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the state (east, north, their rates) some time after the first row.

    And its covariance.
    """
    state, partials = state_at(mode.q, since_s)
    known = mode.solver_covariance[: mode.q.size, : mode.q.size]
    state[:2] += first_place(platforms)
    return state, partials @ known @ partials.T


def fixes_of_answers(
    answers: Sequence[tuple[ContactAnswer, FloatArray]],
    series: Series,
    unplaced: Sequence[str] = (),
    pairings: Pairings | None = None,
) -> Fixes:
    """Return the places of all contacts and modes at their times, s.

    ``unplaced`` says why other contacts of the table have no position, in sentences;
    ``pairings`` which contacts of the sensors were joined.
    """
    statements = [] if pairings is None else [pairings.statement]
    statements += unplaced
    parts: list[FixRows] = []
    for answer, times in answers:
        own = [_at_times(answer, n, mode, times) for n, mode in enumerate(answer.modes, 1)]
        kept = [part for part in own if part is not None]
        if pairings is not None:
            for part in kept:
                said = pairings.columns_of(np.repeat(answer.data.contact, len(part["time_s"])))
                part.update(said)
        if not kept:
            statements.append(NO_REGION.format(answer.data.contact))
        parts += kept
    latitude, longitude = series.origin_latitude, series.origin_longitude
    origin = None
    if latitude is not None and longitude is not None:
        origin = Origin(latitude, longitude)
    return fix_table(
        parts, series.start_utc_ns, (series.origin, origin), " ".join(statements),
        **({} if pairings is None else pairings.table()),
    )  # fmt: skip


NO_REGION = (
    "No position for contact {}: the places that explain the bearings gather in no "
    "ellipse; 'uwtrack tma' gives the intervals of its motion."
)


def _sampled(
    answer: ContactAnswer,
    mode: ModeAnswer,
    state: FloatArray,
    covariance: FloatArray,
    platforms: Platforms,
) -> tuple[FloatArray, FloatArray, PlaceReading] | None:
    """Return the posterior's state, covariance and reading; None where it has no ellipse."""
    problem = answer.problem
    if problem.n_lines or len(answer.modes) > 1:
        return state, covariance, NO_READING
    place = np.concatenate([first_place(platforms), np.zeros(2)])
    # what noise alone does not explain stays: coloured noise, places of the sensors
    jacobian = state_jacobian(mode.q[np.newaxis])[0]
    matrix = misfit(problem, mode.q[np.newaxis]).matrix[0]
    white = _with_vessel_prior(jacobian @ np.linalg.pinv(matrix) @ jacobian.T)
    values, axes = np.linalg.eigh(covariance - white)
    rest = (axes * np.maximum(values, 0.0)) @ axes.T
    competes = bool(mode.observability.observable[2:4].all())
    stds = VELOCITY_STDS_MPS if competes else (VESSEL_VELOCITY_STD_MPS,)
    moving = moving_region(problem, state - place, covariance, stds, answer.mixture)
    if not moving.is_sampled:
        return None
    moving = replace(moving, covariance=moving.covariance + rest)
    if not competes:
        return moving.mean + place, moving.covariance, NO_READING
    still = still_region(problem, answer.mixture)
    # what shifts place and velocity by d shifts a place at rest by d_p + A_pp^-1 A_pv d_v
    inward = np.linalg.inv(jacobian)
    normal = inward.T @ matrix @ inward
    shift = np.linalg.pinv(normal[:2, :2]) @ normal[:2, 2:]
    turn = np.concatenate([np.eye(2), shift], axis=1)
    still = replace(still, covariance=still.covariance + turn @ rest @ turn.T)
    reading = compete(still, moving)
    both = mixture(reading, still, moving)
    return both.mean + place, both.covariance, reading


def _at_times(
    answer: ContactAnswer, number: int, mode: ModeAnswer, times: FloatArray
) -> FixRows | None:
    """Carry a mode to the times: the covariance grows with the lag; None without one."""
    platforms = answer.data.platforms
    if platforms is None:
        raise TypeError("fixes are of sensors whose places are known")
    lags = times - answer.data.time_s[0]
    if len(mode.legs) > 1:
        pairs = [grid_state(mode, platforms, float(lag)) for lag in lags]
        states, covariances = (np.array(values) for values in zip(*pairs, strict=True))
        return fix_rows(
            states, covariances, times, contact=answer.data.contact, mode=number,
            weight=mode.weight, sensors=",".join(platforms.name),
            motion_model=NO_READING.name, motion_model_probability=NO_READING.weight,
            alternative_motion_model=NO_READING.rival,
            alternative_motion_model_probability=NO_READING.rival_weight,
        )  # fmt: skip
    state, covariance = grid_state(mode, platforms)
    if not mode.observability.observable[2:4].all():  # a place, and no velocity
        covariance[2:, :] = covariance[:, 2:] = 0.0
        covariance[[2, 3], [2, 3]] = 1e3 * VESSEL_VELOCITY_STD_MPS**2
    covariance = _with_vessel_prior(covariance)
    sampled = _sampled(answer, mode, state, covariance, platforms)
    if sampled is None:
        return None
    state, covariance, reading = sampled
    rows = fix_rows(
        *carried_on(state, covariance, lags),
        times,
        contact=answer.data.contact,
        mode=number,
        weight=mode.weight,
        sensors=",".join(platforms.name),
        motion_model=reading.name,
        motion_model_probability=reading.weight,
        alternative_motion_model=reading.rival,
        alternative_motion_model_probability=reading.rival_weight,
    )
    rows["course_std_deg"] = np.minimum(rows["course_std_deg"], 180.0)
    if reading.name == STILL:
        rows["course_deg"] = rows["course_std_deg"] = np.full(times.size, np.nan)
    return rows


def _with_vessel_prior(covariance: FloatArray) -> FloatArray:
    """Bound the velocity's deviation by that of vessels in general."""
    precision = np.zeros((4, 4))
    precision[[2, 3], [2, 3]] = VESSEL_VELOCITY_STD_MPS**-2
    # C (I + P C)^-1: the covariance itself may be singular, its inverse is not needed
    joint = covariance @ np.linalg.inv(np.eye(4) + precision @ covariance)
    return np.asarray(0.5 * (joint + joint.T))
