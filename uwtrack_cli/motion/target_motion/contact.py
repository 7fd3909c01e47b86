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
from uwtrack_cli.motion.target_motion.bounce import Bounce
from uwtrack_cli.motion.target_motion.conventions import other_convention
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.inputs import (
    Measurements,
    Platforms,
    check_measurements,
    correlation_inflation,
    own_path,
    rounding_std,
    sensor_paths,
)
from uwtrack_cli.motion.target_motion.legs import Legs, find_legs
from uwtrack_cli.motion.target_motion.model import STRAIGHT, to_motion
from uwtrack_cli.motion.target_motion.modes import (
    ModeAnswer,
    Modes,
    TmaOptions,
    describe_mode,
    find_modes,
)
from uwtrack_cli.motion.target_motion.near_rows import near_rows
from uwtrack_cli.motion.target_motion.objective import STUDENT, loss_value, misfit, residuals
from uwtrack_cli.motion.target_motion.observability import (
    assess,
    information,
    is_manoeuvring,
    misfit_scale,
)
from uwtrack_cli.motion.target_motion.own_noise import is_own_noise
from uwtrack_cli.motion.target_motion.own_ship import (
    USUAL_TOW_M,
    OwnPath,
    bend_rad,
    make_observer_track,
    make_sensors_track,
)
from uwtrack_cli.motion.target_motion.problem import Problem, without_rows
from uwtrack_cli.motion.target_motion.row_mixture import RowMixture
from uwtrack_cli.motion.target_motion.row_noise import alike_rows, kinds_of, row_noise
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
    legs: Legs
    """The legs of the target."""
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
    is_own_noise: bool = False
    """Whether it is likelier the ship that tows the array than a target."""


def analyse_contacts(contacts: list[Measurements], options: TmaOptions) -> list[ContactAnswer]:
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
    limits = search_bounds(options.search.range_limits_m, options.search.speed_limit_mps)
    problem = build_problem(data, options)
    if data.platforms is not None:
        problem = _with_offsets(problem, limits, data.platforms, options)
        options = _of_sensors(options, data.platforms)
    is_own = _is_own_noise(data, problem, limits, options)
    if data.overlap_rows:
        problem = _allow_for_overlap(problem, limits, data.overlap_rows)
    found = _answers(data, problem, limits, options)
    if is_own:
        found = [replace(answer, is_own_noise=True) for answer in found]
    if data.platforms is not None:
        other = other_convention(problem, limits, found[0].modes[0].q)
        if other is not None:
            msg = data.begin_of(data.platforms.sensor == other.sensor)
            msg += OTHER_CONVENTION.format(
                data.contact, data.platforms.name[other.sensor], other.name
            )
            warn(msg, UwtrackWarning, stacklevel=4)
    return found


def _is_own_noise(
    data: Measurements, problem: Problem, limits: SearchBounds, options: TmaOptions
) -> bool:
    """Return whether the contact is the ship that tows the array."""
    if options.towing is None or problem.array_heading_rad is None:
        return False
    ways = [own_path(navigation, data) for navigation in (options.navigation, options.towing)]
    best = float(minima_of(problem, limits).value[0])
    return is_own_noise(problem, ways[0], ways[1], data.time_s, best)


OTHER_CONVENTION = (
    "contact {}: the bearings of sensor {} miss what those of the others tell, and would "
    "meet it if they are counted {}: write them as compass bearings to the target, in "
    "degrees."
)


def _answers(
    data: Measurements, problem: Problem, limits: SearchBounds, options: TmaOptions
) -> list[ContactAnswer]:
    """Solve one contact, or every source that its rows hold."""
    solved = _solve(data, problem, limits, options)
    sources = None
    if options.misfit.loss == "auto" and options.is_table:
        sources = _sources(problem, solved.legs, limits, data, options)
    if sources is None:
        solved = _with_outliers(data, solved, limits, options)
        return [_answer(data, solved, options)]
    found = [
        replace(
            _answer(
                data,
                _with_outliers(
                    data, _solve(data, source.problem, limits, options), limits, options
                ),
                options,
            ),
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


@dataclass(frozen=True, eq=False)
class _Solved:
    """The motion of one contact, as it was found."""

    ends: IntArray
    """Rows of every estimate over time, shape (updates,)."""
    estimates: FloatArray
    """These, in solver coordinates, shape (updates, 4)."""
    legs: Legs
    """The motions with the legs that the record asks for."""


def _solve(
    data: Measurements, problem: Problem, limits: SearchBounds, options: TmaOptions
) -> _Solved:
    """Find the motions of one problem, and their legs."""
    ends = _growing(problem.n_rows, options.updates)
    estimates = SOLVERS[options.solver](problem, limits, ends, options.seed)
    straight = _minima(problem, limits, estimates[-1])
    if data.platforms is not None and not problem.n_lines:
        near = near_rows(problem, _by_weight(problem, straight, options).q[0])
        if near.any():
            return _solve(data, without_rows(problem, near), limits, options)
    legs = find_legs(problem, straight, limits, options.nuisances)
    return _Solved(ends, estimates, legs)


def _answer(data: Measurements, solved: _Solved, options: TmaOptions) -> ContactAnswer:
    """Say what each of the modes of a solved problem tells."""
    legs, problem = solved.legs, solved.legs.problem
    modes = _by_weight(*legs.weighed(), options)
    # the misfit itself is that of the measurements as they were stated
    modes = replace(modes, value=misfit(problem, modes.q).value)
    scale = misfit_scale(problem, modes.q[0])
    answers = [
        describe_mode(
            problem, legs.limits, modes, index, options, scale=scale,
            colours=legs.colours, beside=legs.beside(modes.q[index]),
        )
        for index in range(len(modes.q))
    ]  # fmt: skip
    # estimates over time are of a straight motion: those of the first leg
    straight = problem.row_time_s[solved.ends - 1] <= answers[0].legs[0].end_s
    ends, estimates = solved.ends[straight], solved.estimates[straight]
    deviations = [
        _deviations(problem.rows(slice(0, int(end))), q)
        for end, q in zip(ends, estimates, strict=True)
    ]
    return ContactAnswer(
        data=data,
        modes=answers,
        n_values=problem.n_values,
        manoeuvring=data.platforms is not None or is_manoeuvring(problem.track),
        legs=legs,
        update_rows=ends - 1,
        update_motion=to_motion(estimates),
        update_std=np.reshape(deviations, (-1, STRAIGHT)),
        problem=problem,
    )


LARGE_MISFIT = 5.0
"""Deviations by which the misfit must exceed what is expected before bearings of
others, or outliers, are sought among measurements of stated deviations."""


def _miss(legs: Legs, nuisances: NuisanceDeviations) -> tuple[bool, ...]:
    """Return whether bearings, frequencies, delays miss by more than their deviations.

    These are of the noise that was stated and of own navigation; noise with a memory
    makes fewer values independent.
    """
    problem = legs.problem
    r = residuals(problem, legs.fit.q[:1])
    variance = row_noise(problem, r, nuisances).variance
    found = []
    z = np.concatenate([r.bearing[0].ravel(), r.frequency[0].ravel()])
    weight = [problem.bearing_weight.ravel(), problem.frequency_weight.ravel()]
    measured = np.concatenate(weight) > 0
    for kind, colour in zip(kinds_of(problem), legs.colours, strict=True):
        each = loss_value(z[kind], problem.loss) / variance[kind]
        count = int(np.count_nonzero(measured[kind]))
        freedom = max(count - legs.fit.q.shape[1], 1)
        excess = float(each.sum()) / freedom - 1.0
        scatter = np.sqrt(2.0 * alike_rows(colour, problem.row_time_s) / freedom)
        found.append(bool(excess > LARGE_MISFIT * scatter))
    return tuple(found)


def _with_outliers(
    data: Measurements, solved: _Solved, limits: SearchBounds, options: TmaOptions
) -> _Solved:
    """Solve again with a loss that outliers do not pull, where they are likelier.

    Beside outliers, deviations that are all too small explain a large misfit.
    """
    problem = solved.legs.problem
    if (
        options.misfit.loss != "auto"
        or problem.loss != "squares"
        or not options.is_table
        or not any(_miss(solved.legs, options.nuisances))
    ):
        return solved
    robust = _solve(data, replace(problem, loss="student"), limits, options)
    return min(solved, robust, key=lambda one: _surprise(one.legs))


def _surprise(legs: Legs) -> float:
    """Return twice the negative log likelihood, with the price of the unknowns.

    The variance of bearings, and that of frequencies, may be larger than was stated
    where errors are normal; outliers are those of Student's t with four degrees of
    freedom. The price is that of Schwarz (1978), Ann. Stat. 6, 461.
    """
    problem = legs.problem
    r = residuals(problem, legs.fit.q[:1])
    total = legs.fit.q.shape[1] * np.log(problem.n_values)
    tones = problem.n_tones
    for z, weight in (
        (r.bearing[0], problem.bearing_weight),
        (r.frequency[0, :tones], problem.frequency_weight[:tones]),
        (r.frequency[0, tones:], problem.frequency_weight[tones:]),
    ):
        measured = z[weight > 0]
        if not measured.size:
            continue
        if problem.loss == "squares":
            variance = max(float(np.mean(measured**2)), 1.0)
            total += measured.size * (np.log(variance) + NORMAL_CONSTANT)
            total += float((measured**2).sum()) / variance
        else:
            tails = (STUDENT + 1.0) * np.log1p(measured**2 / STUDENT)
            total += float(tails.sum()) + measured.size * STUDENT_CONSTANT
    return float(total)


NORMAL_CONSTANT = float(np.log(2.0 * np.pi))
STUDENT_CONSTANT = float(2.0 * np.log(8.0 / 3.0))
"""Twice the negative logarithm of the densities at zero: 3/8 for Student's t with four
degrees of freedom."""


def _sources(
    problem: Problem, legs: Legs, limits: SearchBounds, data: Measurements, options: TmaOptions
) -> list[BearingSource] | None:
    """Take all rows apart into sources where the misfit of the legs asks for it."""
    is_told = _is_told(data, options)
    if is_told and not _miss(legs, options.nuisances)[0]:
        return None
    found = associate(replace(problem, loss="squares"), limits, is_told=is_told)
    if found is None:
        return None
    loss = problem.loss if problem.n_lines else "squares"
    return [replace(source, problem=replace(source.problem, loss=loss)) for source in found]


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
        data.bearing_deg, data.bearing_std_deg, weights.bearing_std_deg, circular=True,
        name="bearing_std_deg",
    )  # fmt: skip
    frequency, frequency_weight, share, bounce = _lines(data, options)
    loss = weights.loss
    if loss == "auto":
        is_told = _is_told(data, options) and _are_lines_told(data, options)
        loss = "squares" if is_told or not options.is_table else "student"
    if platforms is None:
        path = own_path(options.navigation, data)
        track = make_observer_track(path, data.time_s, model.doppler, interval)
        heading = _array_heading(path, data.time_s, interval, options)
        bent = np.degrees(bend_rad(path, data.time_s, _tow_length_m(options)))
        bearing_std = np.hypot(bearing_std, bent)
    else:
        paths = sensor_paths(data, platforms)
        track = make_sensors_track(paths, platforms.sensor, data.time_s, model.doppler, interval)
        heading = None
    if data.mirrored_bearing_deg is not None:
        heading = _between_mirrors(data.bearing_deg, data.mirrored_bearing_deg)
        if platforms is not None:
            bent = _bent_arrays_rad(data, platforms, paths, heading, interval, options)
            bearing_std = np.hypot(bearing_std, np.degrees(bent))
    bearing_weight, bearing = _weigh(np.radians(data.bearing_deg), np.radians(bearing_std))
    return Problem(
        track=track,
        bearing_rad=bearing[np.newaxis],
        bearing_weight=bearing_weight,
        frequency_hz=frequency[np.newaxis],
        frequency_weight=frequency_weight,
        sound_speed_mps=options.sound_speed_mps,
        delayed=options.delayed,
        array_heading_rad=heading,
        lobe_cosine=_lobe_cosine(data, options.design_frequency_hz),
        loss=loss,
        frequency_share=share,
        height_m=options.height_m,
        sensor=None if platforms is None else platforms.sensor,
        prior=options.prior,
        bounce=bounce,
    )


def _lobe_cosine(data: Measurements, design_frequency_hz: float | None) -> FloatArray | None:
    """Return the distance of the cosines that the array's lobes have, (streams, rows)."""
    if design_frequency_hz is None or data.frequency_hz.shape != data.bearing_deg.shape:
        return None
    usual_hz = np.nanmedian(data.frequency_hz, axis=1, keepdims=True)
    return (
        2.0
        * design_frequency_hz
        / np.where(np.isnan(data.frequency_hz), usual_hz, data.frequency_hz)
    )


def _lines(
    data: Measurements, options: TmaOptions
) -> tuple[FloatArray, FloatArray, float, Bounce | None]:
    """Return frequencies and delays, their weights, the share, and the reflected path."""
    weights, bounce, late = options.misfit, options.bounce, data.bounce_delay_s
    std = _filled(data.frequency_hz, data.frequency_std_hz, weights.frequency_std_hz)
    weight, values = _weigh(data.frequency_hz, std)
    share = 1.0
    if weights.line_weighting == "mean":
        share = 1.0 / max(1, weight.shape[0])
    weight = weight * np.sqrt(share)
    if bounce is None or late is None or data.bounce_delay_std_s is None:
        return values, weight, share, None
    _check_delays(data, late, bounce, options.sound_speed_mps)
    delay, delay_std = late[np.newaxis], data.bounce_delay_std_s[np.newaxis]
    delay_std = _filled(delay, delay_std, None, name="bounce_delay_std_s")
    delay_weight, delay = _weigh(delay, delay_std)
    values = np.concatenate([values, delay])
    return values, np.concatenate([weight, delay_weight]), share, bounce


def _are_lines_told(data: Measurements, options: TmaOptions) -> bool:
    """Return whether somebody stated the deviations of frequencies and of delays."""
    stated = ~np.isnan(data.frequency_std_hz) | np.isnan(data.frequency_hz)
    is_told = options.misfit.frequency_std_hz is not None or bool(stated.all())
    late, std = data.bounce_delay_s, data.bounce_delay_std_s
    if late is None or std is None:
        return is_told
    return is_told and not np.isnan(std[~np.isnan(late)]).any()


def _check_delays(
    data: Measurements, delay_s: FloatArray, bounce: Bounce, sound_speed_mps: float
) -> None:
    """Refuse delays that no place of a target could give.

    Raises
    ------
    DataError
        Half of them are longer than right below or above the source.
    """
    longest_s = bounce.most_m / sound_speed_mps
    middle_s = float(np.nanmedian(delay_s))
    if middle_s > longest_s * (1.0 + 5.0 * bounce.relative_std):
        raise DataError(
            f"{data.begin_of(~np.isnan(delay_s))}bounce_delay_s is about {middle_s:.3g} s, "
            f"and no {bounce.words} is later than {longest_s:.3g} s: are the delays in "
            f"seconds, and of this path?"
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
    values: FloatArray,
    std: FloatArray,
    option: float | None,
    *,
    circular: bool = False,
    name: str = "frequency_std_hz",
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
        scatter = np.where(np.isnan(scatter), np.median(told) if told.size else np.nan, scatter)
    if not np.all(scatter[streams] > 0):
        option_too = "" if name == "bounce_delay_std_s" else " or an option"
        raise DataError(
            f"a deviation cannot be estimated from {np.count_nonzero(missing)} "
            f"values that state none: give {name} as a column{option_too}."
        )
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
            raise DataError("array_heading 'course' needs navigation: own ship has no course.")
        return path.course_at(time_s, interval_s)
    heading = path.heading_at(time_s)
    if np.isnan(heading).any() and options.fixed_heading_deg is not None:
        heading = np.full(time_s.size, np.radians(options.fixed_heading_deg))
    if np.isnan(heading).any():
        raise DataError(
            "array_heading 'heading' needs a column heading_deg in the navigation, or "
            "a sensor with a heading."
        )
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


def _minima(problem: Problem, limits: SearchBounds, solution: FloatArray) -> DescentResult:
    """Return the solver's answer and the other straight motions, best first."""
    fit = minima_of(problem, limits)
    own = minimise(problem, solution[np.newaxis], limits, iterations=0)
    merged = DescentResult.join([own, fit])
    order = np.argsort(merged.value, kind="stable")
    # the solver's own answer is the best mode unless it missed the minimum
    if own.value[0] - merged.value[order[0]] < 1e-3:
        order = np.concatenate([[0], order[order != 0]])
    return merged.take(order)


def _by_weight(problem: Problem, fit: DescentResult, options: TmaOptions) -> Modes:
    """List the best motion and every other one within the region."""
    from scipy.special import chdtri

    best = fit.q[0]
    freedom = best.size + problem.n_lines
    threshold = float(chdtri(freedom, 1.0 - options.search.confidence))
    found = information(problem, best)
    modes = find_modes(
        problem,
        fit,
        threshold * misfit_scale(problem, best),
        singular=found.rank < len(found.bread),
    )
    if problem.sensor is None:
        return modes
    # a way through the very place of a sensor fits well and is improbable
    order = np.argsort(-modes.weight, kind="stable")
    return modes.take(order)


def _deviations(problem: Problem, q: FloatArray) -> FloatArray:
    """Deviations of range, bearing, speed and course; nan where not observable."""
    found = information(problem, q)
    observable = assess(found, to_motion(q)).observable[:4]
    variance = np.diagonal(found.covariance())[:4]
    return np.where(observable, np.sqrt(np.maximum(variance, 0.0)), np.nan)
