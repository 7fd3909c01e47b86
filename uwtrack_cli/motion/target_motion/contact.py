"""Target motion of one contact: deviations, solution, modes, observability.

**Method.** Measurements made of overlapping windows are not independent; their
deviations are first raised by the correlation of the residuals. A constant error of
the compass turns the whole solution, and enters the covariance as one more source.
In a table of several sensors the constant error of each is an unknown with a prior; where
no deviation is told, that of the prior is the one that the bearings make likeliest
(marginal likelihood by Laplace's approximation, with a broad prior about three degrees).
Bearings of others are told apart where the misfit asks for it (see `association`).
"""

from dataclasses import dataclass, replace
from warnings import warn

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.estimation.robust import white_scatter
from uwtrack_cli.motion.target_motion.association import BearingSource, associate
from uwtrack_cli.motion.target_motion.conventions import other_convention
from uwtrack_cli.motion.target_motion.inputs import (
    Measurements,
    Platforms,
    check_measurements,
    correlation_inflation,
    own_path,
    rounding_std,
    sensor_paths,
)
from uwtrack_cli.motion.target_motion.last_leg import find_last_leg
from uwtrack_cli.motion.target_motion.manoeuvre import Manoeuvre, find_manoeuvre
from uwtrack_cli.motion.target_motion.model import to_motion
from uwtrack_cli.motion.target_motion.modes import (
    ModeAnswer,
    Modes,
    TmaOptions,
    describe_mode,
    find_modes,
)
from uwtrack_cli.motion.target_motion.near_rows import near_rows
from uwtrack_cli.motion.target_motion.objective import residuals
from uwtrack_cli.motion.target_motion.observability import (
    assess,
    information,
    is_manoeuvring,
    misfit_scale,
)
from uwtrack_cli.motion.target_motion.own_ship import (
    USUAL_TOW_M,
    OwnPath,
    bend_rad,
    make_observer_track,
    make_sensors_track,
)
from uwtrack_cli.motion.target_motion.problem import Problem, without_rows
from uwtrack_cli.motion.target_motion.row_mixture import RowMixture
from uwtrack_cli.motion.target_motion.solvers.marquardt import (
    DescentResult,
    SearchBounds,
    minimise,
    search_bounds,
)
from uwtrack_cli.motion.target_motion.solvers.solvers import SOLVERS
from uwtrack_cli.motion.target_motion.starts import minima_of, multistart


@dataclass(frozen=True, eq=False)
class ContactAnswer:
    """Modes of one contact, and its estimates over time."""

    data: Measurements
    """The measurements."""
    modes: list[ModeAnswer]
    """What each mode says, best first."""
    n_values: int
    """Number of measured values."""
    manoeuvring: bool
    """Whether own ship leaves a straight and steady track."""
    target_manoeuvre: Manoeuvre
    """The change of the target's velocity that gains most."""
    last_leg: ModeAnswer | None
    """The motion behind a certain change; None without one, or where it is not told."""
    update_rows: IntArray
    """Last row of every estimate over time, shape (updates,)."""
    update_motion: FloatArray
    """Range, bearing, speed and course (SI) of each, shape (updates, 4)."""
    update_std: FloatArray
    """Their deviations, same shape; nan where not observable."""
    problem: Problem
    """What was solved, with the weights of its rows."""
    probability: FloatArray | None = None
    """Probability that each row's bearing is this contact's, shape (rows,); None where
    all of them are."""
    mixture: RowMixture | None = None
    """What every row says of the source, whoever it belongs to; None where all rows are
    this contact's."""
    n_sources: int = 1
    """Sources that the contact's rows were taken apart into."""


def analyse_contacts(
    contacts: list[Measurements], options: TmaOptions
) -> list[ContactAnswer]:
    """Estimate the motions of all contacts; further sources get new numbers."""
    found: list[ContactAnswer] = []
    number = max((data.contact for data in contacts), default=0)
    for data in contacts:
        first, *others = analyse_contact(data, options)
        found.append(first)
        for other in others:
            number += 1
            found.append(replace(other, data=replace(data, contact=number)))
    return found


def analyse_contact(data: Measurements, options: TmaOptions) -> list[ContactAnswer]:
    """Estimate the motion of one contact, or of every source that its rows hold."""
    check_measurements(data)
    limits = search_bounds(
        options.search.range_limits_m, options.search.speed_limit_mps
    )
    problem = build_problem(data, options)
    if data.platforms is not None:
        problem = _with_offsets(problem, limits, data.platforms, options)
        options = _of_sensors(options, data.platforms)
    if data.overlap_rows:
        problem = _allow_for_overlap(problem, limits, data.overlap_rows)
    found = _answers(data, problem, limits, options)
    if data.platforms is not None:
        other = other_convention(problem, limits, found[0].modes[0].q)
        if other is not None:
            msg = data.begin_of(data.platforms.sensor == other.sensor)
            msg += OTHER_CONVENTION.format(
                data.contact, data.platforms.name[other.sensor], other.name
            )
            warn(msg, UwtrackWarning, stacklevel=4)
    return found


OTHER_CONVENTION = (
    "contact {}: the bearings of sensor {} miss what those of the others tell, and would "
    "meet it if they are counted {}: write them as compass bearings to the target, in "
    "degrees."
)


def _answers(
    data: Measurements, problem: Problem, limits: SearchBounds, options: TmaOptions
) -> list[ContactAnswer]:
    """Solve one contact, or every source that its rows hold."""
    sources = None
    if options.misfit.loss == "auto" and options.is_table:
        sources = _sources(problem, limits, data, options)
    if sources is None:
        return [_answer(data, problem, limits, options)]
    found = [
        replace(
            _answer(data, source.problem, limits, options),
            probability=source.probability,
            mixture=source.mixture,
            n_sources=len(sources),
        )
        for source in sources
    ]
    # the source whose place is told best comes first: most rows may be of a loud one
    return sorted(found, key=_area_m2)


def _area_m2(answer: ContactAnswer) -> float:
    """Return the area of the first place's one-sigma ellipse; inf if unobservable."""
    mode = answer.modes[0]
    if not mode.observability.observable[:2].all():
        return np.inf
    spread = np.linalg.det(mode.solver_covariance[:2, :2])
    return float(np.pi * np.exp(2.0 * mode.q[0]) * np.sqrt(max(spread, 0.0)))


def _answer(
    data: Measurements, problem: Problem, limits: SearchBounds, options: TmaOptions
) -> ContactAnswer:
    """Solve one problem and say what each of its modes tells."""
    ends = _growing(problem.n_rows, options.updates)
    estimates = SOLVERS[options.solver](problem, limits, ends, options.seed)
    modes = _modes(problem, limits, estimates[-1], options)
    if data.platforms is not None and not problem.n_lines:
        near = near_rows(problem, modes.q[0])
        if near.any():
            return _answer(data, without_rows(problem, near), limits, options)
    scale = misfit_scale(problem, modes.q[0])
    answers = [
        describe_mode(problem, limits, modes, index, options, scale=scale)
        for index in range(len(modes.q))
    ]
    deviations = [
        _deviations(problem.rows(slice(0, int(end))), q)
        for end, q in zip(ends, estimates, strict=True)
    ]
    change = find_manoeuvre(problem, modes.q[0], options.nuisances, data.overlap_rows)
    last = None
    if change.is_certain:
        last = find_last_leg(problem, modes.q[0], limits, change, options)
    return ContactAnswer(
        data=data,
        modes=answers,
        n_values=problem.n_values,
        manoeuvring=data.platforms is not None or is_manoeuvring(problem.track),
        target_manoeuvre=change,
        last_leg=last,
        update_rows=ends - 1,
        update_motion=to_motion(estimates),
        update_std=np.stack(deviations),
        problem=problem,
    )


LARGE_MISFIT = 5.0
"""Deviations by which the misfit must exceed what is expected before bearings of
others are sought among measurements of stated deviations."""


def _sources(
    problem: Problem, limits: SearchBounds, data: Measurements, options: TmaOptions
) -> list[BearingSource] | None:
    """Take the rows apart into sources where the misfit asks for it."""
    is_told = _is_told(data, options)
    if is_told:
        fit = minima_of(problem, limits)
        freedom = max(problem.n_values - 4 - problem.n_lines, 1)
        excess = float(fit.value[0]) / freedom - 1.0
        if excess < LARGE_MISFIT * np.sqrt(2.0 / freedom):
            return None
    found = associate(replace(problem, loss="squares"), limits, is_told=is_told)
    if found is None:
        return None
    loss = problem.loss if problem.n_lines else "squares"
    return [
        replace(source, problem=replace(source.problem, loss=loss)) for source in found
    ]


def _is_told(data: Measurements, options: TmaOptions) -> bool:
    """Return whether every bearing has a deviation that somebody stated."""
    missing = np.isnan(data.bearing_std_deg) & ~np.isnan(data.bearing_deg)
    return options.misfit.bearing_std_deg is not None or not missing.any()


UNTOLD_COMPASS_STD_DEG = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Deviations of compasses that are compared where none is told."""

MIDDLE_COMPASS_STD_DEG, COMPASS_LOG_STD = 3.0, 1.0
"""Their prior: log-normal."""


def _with_offsets(
    problem: Problem, limits: SearchBounds, platforms: Platforms, options: TmaOptions
) -> Problem:
    """Make the constant error of every sensor an unknown with its prior."""
    std = platforms.compass_std_deg.copy()
    if options.compass_std_deg is not None:
        std = np.full(std.shape, options.compass_std_deg)
    if std.size == 1:  # one ship: the option's default, that of own ship
        std = np.nan_to_num(std, nan=options.nuisances.compass_deg)
    untold = np.isnan(std)
    if not untold.any():
        return replace(problem, offset_std_rad=np.radians(std))
    robust = replace(problem, loss="student" if problem.loss == "squares" else "huber")
    best: tuple[float, FloatArray] | None = None
    for candidate in UNTOLD_COMPASS_STD_DEG:
        trial = np.radians(np.where(untold, candidate, std))
        asked = replace(robust, offset_std_rad=trial)
        fit = multistart(asked, limits)
        weight = (problem.bearing_weight**2).sum(1)
        volume = np.log1p(trial**2 * weight)[untold].sum()
        _, shrunk = np.linalg.slogdet(fit.matrix[0] + 1e-12 * np.eye(4))
        away = np.log(candidate / MIDDLE_COMPASS_STD_DEG) / COMPASS_LOG_STD
        value = float(fit.value[0] + volume + shrunk + away**2)
        if best is None or value < best[0]:
            best = (value, trial)
    return problem if best is None else replace(problem, offset_std_rad=best[1])


def _of_sensors(options: TmaOptions, platforms: Platforms) -> TmaOptions:
    """Return options whose nuisances are those of the sensors of a table."""
    given = options.nuisances
    position = np.nan_to_num(platforms.position_std_m, nan=given.own_position_m)
    nuisances = replace(
        given,
        compass_deg=0.0,
        own_position_m=0.0,
        own_velocity_mps=0.0,
        sensor_position_m=position if position.any() else None,
    )
    return replace(options, nuisances=nuisances)


def build_problem(data: Measurements, options: TmaOptions) -> Problem:
    """Put the measurements of a contact into the form that solvers take."""
    platforms = data.platforms
    model, weights = options.model, options.misfit
    steps = np.diff(np.unique(data.time_s))
    interval = model.interval_s or data.window_s
    if interval is None:
        interval = float(np.median(steps)) if steps.size else 1.0
    bearing_std = _filled(
        data.bearing_deg, data.bearing_std_deg, weights.bearing_std_deg, circular=True
    )
    frequency_std = _filled(
        data.frequency_hz, data.frequency_std_hz, weights.frequency_std_hz
    )
    frequency_weight, frequency = _weigh(data.frequency_hz, frequency_std)
    share = 1.0
    if weights.line_weighting == "mean":
        share = 1.0 / max(1, frequency_weight.shape[0])
    loss = weights.loss
    if loss == "auto":
        stated = ~np.isnan(data.frequency_std_hz) | np.isnan(data.frequency_hz)
        is_told = _is_told(data, options) and (
            weights.frequency_std_hz is not None or bool(stated.all())
        )
        loss = "squares" if is_told or not options.is_table else "student"
    if platforms is None:
        path = own_path(options.navigation, data)
        track = make_observer_track(path, data.time_s, model.doppler, interval)
        heading = _array_heading(path, data.time_s, interval, options)
        bent = np.degrees(bend_rad(path, data.time_s, _tow_length_m(options)))
        bearing_std = np.hypot(bearing_std, bent)
    else:
        paths = sensor_paths(data, platforms)
        track = make_sensors_track(
            paths, platforms.sensor, data.time_s, model.doppler, interval
        )
        heading = None
    if data.mirrored_bearing_deg is not None:
        heading = _between_mirrors(data.bearing_deg, data.mirrored_bearing_deg)
        if platforms is not None:
            bent = _bent_arrays_rad(data, platforms, paths, heading, interval, options)
            bearing_std = np.hypot(bearing_std, np.degrees(bent))
    bearing_weight, bearing = _weigh(
        np.radians(data.bearing_deg), np.radians(bearing_std)
    )
    return Problem(
        track=track,
        bearing_rad=bearing[np.newaxis],
        bearing_weight=bearing_weight,
        frequency_hz=frequency[np.newaxis],
        frequency_weight=frequency_weight * np.sqrt(share),
        sound_speed_mps=options.sound_speed_mps,
        delayed=options.delayed,
        array_heading_rad=heading,
        loss=loss,
        frequency_share=share,
        height_m=options.height_m,
        sensor=None if platforms is None else platforms.sensor,
    )


OWN_COURSE_RAD = np.radians(3.0)
"""Difference of an array's heading from its ship's course in a turn up to which it was taken
from that."""


def _bent_arrays_rad(
    data: Measurements,
    platforms: Platforms,
    paths: list[OwnPath],
    heading_rad: FloatArray,
    interval_s: float,
    options: TmaOptions,
) -> FloatArray:
    """Return by how much arrays of a table were bent, rad, shape (rows,).

    Only those count whose heading goes with the course of what tows them; one that was
    measured, or turns later, is taken at its word.
    """
    given = options.model.tow_length_m
    length_m = USUAL_TOW_M if given is None else given
    bent = np.zeros(data.time_s.size)
    for number, path in enumerate(paths):
        rows = np.flatnonzero(platforms.sensor == number)
        own = bend_rad(path, data.time_s[rows], length_m)
        turns = (own > OWN_COURSE_RAD) & ~np.isnan(heading_rad[rows])
        if not turns.any():
            continue
        course = path.course_at(data.time_s[rows[turns]], interval_s)
        # opposite headings fold alike
        off = np.abs(np.sin(heading_rad[rows[turns]] - course))
        if np.median(off) < np.sin(OWN_COURSE_RAD):
            bent[rows] = own
    return bent


def _between_mirrors(bearing_deg: FloatArray, mirrored_deg: FloatArray) -> FloatArray:
    """Return the heading of the array that has two bearings for one; nan for others."""
    is_open = ~np.isnan(mirrored_deg) & ~np.isnan(bearing_deg)
    # half the sum of the angles; opposite headings fold alike
    total = np.where(is_open, bearing_deg + mirrored_deg, 0.0).sum(0)
    return np.where(is_open.any(0), np.radians(0.5 * total), np.nan)


def _filled(
    values: FloatArray, std: FloatArray, option: float | None, *, circular: bool = False
) -> FloatArray:
    """Give every value a deviation: its own, the option's, or from the scatter.

    A sensor with too few values for a scatter gets the median of the others.
    """
    missing = np.isnan(std) & ~np.isnan(values)
    if not missing.any():
        return std
    streams = np.flatnonzero(missing.any(1))
    scatter = np.full(len(values), np.nan if option is None else option)
    if option is None:
        scatter[streams] = [_scatter(values[s], circular=circular) for s in streams]
        told = scatter[np.isfinite(scatter)]
        scatter = np.where(
            np.isnan(scatter), np.median(told) if told.size else np.nan, scatter
        )
    if not np.all(scatter[streams] > 0):
        kind = "bearing_std_deg" if circular else "frequency_std_hz"
        msg = (
            f"a deviation cannot be estimated from {np.count_nonzero(missing)} "
            f"values that state none: give {kind} as a column or an option."
        )
        raise DataError(msg)
    return np.where(missing, scatter[:, np.newaxis], std)


def _scatter(values: FloatArray, *, circular: bool) -> float:
    """Return the scatter about a smooth course, at least that of the rounding."""
    found = white_scatter(np.radians(values) if circular else values, circular=circular)
    found = float(np.degrees(found)) if circular else found
    return max(found, rounding_std(values)) if np.isfinite(found) else np.nan


def _weigh(values: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    heard = ~np.isnan(values)
    weight = np.where(heard, 1.0 / np.where(heard, std, 1.0), 0.0)
    return weight, np.where(heard, values, 0.0)


def _array_heading(
    path: OwnPath, time_s: FloatArray, interval_s: float, options: TmaOptions
) -> FloatArray | None:
    if options.array_heading == "none":
        return None
    if options.array_heading == "course":
        if path.time_s.size < 2:
            msg = "array_heading 'course' needs navigation: own ship has no course."
            raise DataError(msg)
        return path.course_at(time_s, interval_s)
    heading = path.heading_at(time_s)
    if np.isnan(heading).any() and options.fixed_heading_deg is not None:
        heading = np.full(time_s.size, np.radians(options.fixed_heading_deg))
    if np.isnan(heading).any():
        msg = (
            "array_heading 'heading' needs a column heading_deg in the navigation, or "
            "a sensor with a heading."
        )
        raise DataError(msg)
    return heading


def _tow_length_m(options: TmaOptions) -> float:
    """Return the way from own ship to the end of an array that takes its heading."""
    given = options.model.tow_length_m
    usual = USUAL_TOW_M if options.array_heading == "course" else 0.0
    return usual if given is None else given


def _growing(rows: int, updates: int) -> IntArray:
    return np.unique(np.ceil(rows * np.arange(1, updates + 1) / updates).astype(int))


def _allow_for_overlap(problem: Problem, limits: SearchBounds, lags: int) -> Problem:
    first = minima_of(problem, limits)
    r = residuals(problem, first.q[:1])
    bearing = correlation_inflation(r.bearing[0], problem.bearing_weight, lags)
    frequency = correlation_inflation(r.frequency[0], problem.frequency_weight, lags)
    return replace(
        problem,
        bearing_weight=problem.bearing_weight / np.sqrt(bearing),
        frequency_weight=problem.frequency_weight / np.sqrt(frequency),
    )


def _modes(
    problem: Problem, limits: SearchBounds, solution: FloatArray, options: TmaOptions
) -> Modes:
    """List the solver's answer and every other motion within the region."""
    from scipy.special import chdtri

    fit = minima_of(problem, limits)
    own = minimise(problem, solution[np.newaxis], limits, iterations=0)
    merged = DescentResult.join([own, fit])
    order = np.argsort(merged.value, kind="stable")
    # the solver's own answer is the best mode unless it missed the minimum
    if own.value[0] - merged.value[order[0]] < 1e-3:
        order = np.concatenate([[0], order[order != 0]])
    merged = merged.take(order)
    freedom = 4 + problem.n_lines
    threshold = float(chdtri(freedom, 1.0 - options.search.confidence))
    found = information(problem, merged.q[0])
    modes = find_modes(
        problem,
        merged,
        threshold * misfit_scale(problem, merged.q[0]),
        singular=found.rank < len(found.bread),
    )
    if problem.sensor is None:
        return modes
    # a way through the very place of a sensor fits well and is improbable
    order = np.argsort(-modes.weight, kind="stable")
    return Modes(
        modes.q[order], modes.rest_hz[order], modes.value[order], modes.weight[order]
    )


def _deviations(problem: Problem, q: FloatArray) -> FloatArray:
    """Deviations of range, bearing, speed and course; nan where not observable."""
    found = information(problem, q)
    observable = assess(found, to_motion(q)).observable[:4]
    variance = np.diagonal(found.covariance())[:4]
    return np.where(observable, np.sqrt(np.maximum(variance, 0.0)), np.nan)
