"""Which contacts of several sensors are one target: by the evidence of its motion.

**Method.** Every sensor numbers its contacts by itself. A hypothesis divides all contacts
into targets; a target has at most one contact of each sensor at a time. Its weight is the
product of the evidences of its targets (the joint likelihood of bearings and frequencies,
integrated over motion, compass errors and rest frequencies, by Laplace's approximation) and
of the prior of their number and of missed contacts. An alteration of velocity takes part as
in `legs`: the mean over its instants and widths has a closed form.

Hypotheses grow contact by contact (Reid 1979); only the likeliest are kept, and targets that
none of them asks about are never fitted. The weights of those that are left, normalised,
give the probability of every pairing.

Rows of a contact are gathered into blocks: medians of bearings, means of frequencies. Their
deviations are those of the rows that were stated, or of their scatter if that is larger.

**Conventions.** The number of targets has the prior of a rate of which nothing is known
(1 / N), and so have the shares of contacts that are heard and that break (uniform from 0 to
1). A range is likely within a factor of e of the sensors' spread.

**References.** Reid 1979, IEEE Trans. Autom. Control 24, 843; Kaplan, Bar-Shalom & Blair
2008, IEEE Trans. Aerosp. Electron. Syst. 44, 449 (the likelihood of contacts of several
sensors); MacKay 2003, ch. 28 (evidence).
"""

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import e, lgamma, log, pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray, TextArray
from uwtrack_cli.data.series import Series
from uwtrack_cli.estimation.robust import white_scatter
from uwtrack_cli.motion.target_motion.contact import build_problem
from uwtrack_cli.motion.target_motion.inputs import measurements_from_series, rounding_std
from uwtrack_cli.motion.target_motion.legs import seek_alteration, with_one_more
from uwtrack_cli.motion.target_motion.model import PER_ALTERATION, STRAIGHT, from_state, to_state
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.target_motion.near_rows import near_rows
from uwtrack_cli.motion.target_motion.place_readings import VESSEL_VELOCITY_STD_MPS
from uwtrack_cli.motion.target_motion.problem import Expectation, MotionPrior, Problem, without_rows
from uwtrack_cli.motion.target_motion.solvers.marquardt import (
    DescentResult,
    SearchBounds,
    minimise,
    search_bounds,
)
from uwtrack_cli.motion.target_motion.starts import multistart

ContactNumbers = Literal["auto", "own", "common"]
"""Whose the numbers of contacts are: as the table says, each sensor's own, or those of all
sensors in common."""

BLOCKS = 20
"""Blocks into which the rows of a contact are gathered."""

MOST_HYPOTHESES, LEAST_LOG_WEIGHT = 300, -14.0
"""Hypotheses that are kept, and their least weight beside the likeliest one."""

LEAST_EVIDENCE = -1e6
"""Log evidence of a target whose motion has no volume that numbers hold."""

LOG_RANGE_STD = 1.0
"""Prior deviation of the logarithm of a range."""

LOG_FREQUENCY_SPAN = log(1e4)
"""A rest frequency is equally likely anywhere in four decades."""

UNTOLD_COMPASS_STD_DEG = 3.0 * e
"""Deviation of a compass of which none is told: the root mean square of the prior of its
logarithm in `contact`."""

MOST_ALTERATIONS, STRETCHES = 3, 4
"""Alterations of a target that are fitted, each from starts in so many stretches."""

LEAST_SHARE = 0.01
"""Probability from which another pairing is listed."""

Group = frozenset[int]
"""Contacts, by number from 0, that are one target."""
Hypothesis = frozenset[Group]
"""Targets into which contacts are divided."""


@dataclass(frozen=True, eq=False)
class Pairings:
    """Which contacts of the sensors every target is made of, and how sure that is."""

    contact: IntArray
    """Target: contact number in the result, shape (pairings,)."""
    sensor: TextArray
    """Sensor, same shape."""
    number: IntArray
    """Number of the contact at that sensor, same shape."""
    share: FloatArray
    """Probability that this contact is this target's, same shape."""
    is_member: BoolArray
    """Whether it is, in the likeliest hypothesis, same shape."""

    def members(self, contact: int) -> tuple[str, float]:
        """Return the contacts of a target, sensor/number, and the least of their shares.

        A target that has not been paired (a further source of its rows) has none.
        """
        own = np.flatnonzero((self.contact == contact) & self.is_member)
        words = [f"{self.sensor[k]}/{self.number[k]}" for k in own]
        return " ".join(words), float(self.share[own].min()) if own.size else np.nan

    @property
    def statement(self) -> str:
        """Which contacts are one target, in a sentence."""
        words = []
        for contact in np.unique(self.contact):
            members, share = self.members(int(contact))
            if " " in members:
                words.append(f"contact {contact} is {members} (P {share:.2f})")
        said = "; ".join(words) or "no two of them are one target"
        return f"Joined by evidence, as sensor/contact: {said}."

    def columns_of(self, contacts: IntArray) -> dict[str, NDArray[Any]]:
        """Return the columns that say of contacts what they were joined of."""
        told = [self.members(int(contact)) for contact in contacts]
        return {
            "sensor_contacts": np.array([words for words, _ in told], np.str_),
            "pairing_probability": np.array([share for _, share in told], float),
        }

    def table(self) -> dict[str, NDArray[Any]]:
        """Return the columns of all pairings."""
        return {
            "pairing_contact": self.contact,
            "pairing_sensor": self.sensor,
            "pairing_number": self.number,
            "pairing_share": self.share,
        }


@dataclass(frozen=True, eq=False)
class _Heard:
    """One contact of one sensor."""

    sensor: str
    """Its sensor."""
    number: int
    """Its number there."""
    rows: IntArray
    """Its rows in the table."""
    span_s: tuple[float, float]
    """Times of its first and last row, s."""
    blocks: Series
    """Its rows, gathered."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """What one target says of its contacts."""

    log_evidence: float
    """Logarithm of their marginal likelihood."""
    state: FloatArray
    """East and north of the sensors' origin at time 0, m, and their rates, m/s."""


def pair_contacts(
    series: Series, options: TmaOptions, numbers: ContactNumbers
) -> tuple[Series, Pairings | None]:
    """Give the contacts of several sensors that are one target the same number.

    Parameters
    ----------
    series
        Bearings and frequencies of contacts.
    options
        Options of the analysis.
    numbers
        Whose the numbers are.

    Returns
    -------
    tuple[Series, Pairings | None]
        The table with the numbers of targets, and the pairings; None where the table is
        of one sensor, or its numbers are common.
    """
    given = series.contact_numbers if numbers == "auto" else numbers
    if given != "own" or series.sensor is None or series.sensor_east_m is None:
        return series, None
    if np.unique(series.sensor).size < 2:
        return series, None
    heard = _contacts(series, options)
    if not heard:
        return series, None
    evidence = _Evidence(heard, options)
    likely = _hypotheses(evidence)
    best = max(likely, key=lambda one: likely[one])
    named = _named(best, evidence.heard)
    contact = np.empty_like(series.contact)
    contact[:] = min(named)  # rows that measured nothing are anybody's
    for number, group in named.items():
        for member in group:
            contact[evidence.heard[member].rows] = number
    pairings = _pairings(named, likely, evidence.heard)
    return replace(series, contact=contact), pairings


def _contacts(series: Series, options: TmaOptions) -> list[_Heard]:
    """Return the contacts of all sensors, one sensor after the other."""
    if series.sensor is None:
        return []
    sensor = series.sensor
    series = _with_deviations(series, options)
    is_measured = np.isfinite(series.bearing_deg)
    is_measured |= np.isfinite(series.frequency_hz).any(axis=1)
    found = []
    for name in np.unique(sensor):
        of_sensor = is_measured & (sensor == name)
        for number in np.unique(series.contact[of_sensor]):
            rows = np.flatnonzero(of_sensor & (series.contact == number))
            rows = rows[np.argsort(series.time_s[rows], kind="stable")]
            time = series.time_s[rows]
            span = float(time[0]), float(time[-1])
            blocks = _gathered(series.take("row", rows))
            found.append(_Heard(str(name), int(number), rows, span, blocks))
    # a contact that broke comes after what it was before
    return sorted(found, key=lambda one: (one.sensor, one.span_s))


def _with_deviations(series: Series, options: TmaOptions) -> Series:
    """Give every row the deviations that were stated, or the scatter of its contact.

    A contact with too few rows for a scatter has the median of the others.
    """
    given = options.misfit
    bearing = _row_deviations(
        series, series.bearing_deg[:, np.newaxis],
        series.bearing_std_deg[:, np.newaxis], given.bearing_std_deg, is_angle=True,
    )  # fmt: skip
    frequency = _row_deviations(
        series, series.frequency_hz, series.frequency_std_hz, given.frequency_std_hz
    )
    return replace(series, bearing_std_deg=bearing[:, 0], frequency_std_hz=frequency)


def _row_deviations(
    series: Series,
    values: FloatArray,
    std: FloatArray,
    asked: float | None,
    *,
    is_angle: bool = False,
) -> FloatArray:
    """Return the deviations of rows: as stated, or their scatter if that is larger.

    ``asked``: that of rows that state none. Angles are in degrees.
    """
    found = std.copy() if asked is None else np.nan_to_num(std, nan=asked)
    names = np.zeros(0) if series.sensor is None else series.sensor
    owner = np.stack([np.unique(names, return_inverse=True)[1], series.contact])
    for sensor, contact in np.unique(owner, axis=1).T:
        rows = np.flatnonzero((owner[0] == sensor) & (owner[1] == contact))
        rows = rows[np.argsort(series.time_s[rows], kind="stable")]
        for column, line in enumerate(values[rows].T):
            scatter = white_scatter(np.radians(line) if is_angle else line, circular=is_angle)
            scatter = float(np.degrees(scatter)) if is_angle else scatter
            least = np.fmax(scatter, rounding_std(line))
            if np.isfinite(scatter) and least > 0.0:
                found[rows, column] = np.fmax(found[rows, column], least)
    if np.isfinite(found).any():
        usual = np.broadcast_to(np.nanmedian(found), found.shape)
        found = np.where(np.isnan(found), usual, found)
    return found


def _gathered(series: Series) -> Series:
    """Gather the rows of one contact into blocks, with the deviations of their middles."""
    n = series.time_s.size
    edges = np.linspace(0, n, min(n, BLOCKS) + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges)]
    bearing, bearing_std = _middles(
        series.bearing_deg[:, np.newaxis], series.bearing_std_deg[:, np.newaxis], parts, turn=360.0
    )
    frequency, frequency_std = _middles(series.frequency_hz, series.frequency_std_hz, parts)
    mirrored = series.mirrored_bearing_deg
    if mirrored is not None:
        folded, _ = _middles(mirrored[:, np.newaxis], np.ones((n, 1)), parts, turn=360.0)
        mirrored = folded[:, 0]
    return replace(
        series.take("row", (edges[:-1] + edges[1:]) // 2),
        time_s=np.array([series.time_s[part].mean() for part in parts]),
        bearing_deg=bearing[:, 0],
        bearing_std_deg=bearing_std[:, 0],
        frequency_hz=frequency,
        frequency_std_hz=frequency_std,
        mirrored_bearing_deg=mirrored,
    )


MEDIAN_VARIANCE = pi / 2.0
"""Variance of a median of many normal values over that of their mean."""


def _middles(
    values: FloatArray, std: FloatArray, parts: list[slice], turn: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return the medians of blocks and their deviations, shapes (blocks, columns).

    ``turn``: after how much a value comes again.
    """
    middle, spread = np.full((2, len(parts), values.shape[1]), np.nan)
    for row, part in enumerate(parts):
        for column in range(values.shape[1]):
            is_known = ~np.isnan(values[part, column])
            known, told = values[part, column][is_known], std[part, column][is_known]
            if not known.size:
                continue
            off = known - known[0]
            if np.isfinite(turn):
                off = (off + 0.5 * turn) % turn - 0.5 * turn
            middle[row, column] = known[0] + np.median(off)
            loss = MEDIAN_VARIANCE if known.size > 2 else 1.0
            spread[row, column] = np.sqrt(loss * np.mean(told**2) / known.size)
    return (middle % turn if np.isfinite(turn) else middle), spread


class _Evidence:
    """Fits the motions of targets, each once."""

    def __init__(self, heard: list[_Heard], options: TmaOptions) -> None:
        self.heard = heard
        self._options = options
        self._limits = search_bounds(options.search.range_limits_m, options.search.speed_limit_mps)
        east, north, weight = self._places()
        centre = weight @ np.stack([east, north], -1) / weight.sum()
        away2 = (east - centre[0]) ** 2 + (north - centre[1]) ** 2
        self.spread_m = max(float(np.sqrt(weight @ away2 / weight.sum())), 1.0)
        self._known: dict[Group, _Fit] = {}

    def _places(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the places of all contacts' sensors, m, each sensor of weight 1."""
        count = Counter(one.sensor for one in self.heard)
        places = [
            (np.mean(east), np.mean(north), 1.0 / count[one.sensor])
            for one in self.heard
            for east, north in [(one.blocks.sensor_east_m, one.blocks.sensor_north_m)]
            if east is not None and north is not None
        ]
        east, north, weight = np.array(places).T
        return east, north, weight

    def are_apart(self, members: Iterable[int], other: int) -> bool:
        """Return whether a contact may be one with others: none overlaps at its sensor."""
        own = self.heard[other]
        return all(
            self.heard[m].sensor != own.sensor
            or self.heard[m].span_s[1] < own.span_s[0]
            or self.heard[m].span_s[0] > own.span_s[1]
            for m in members
        )

    def of(self, group: Group, parts: Iterable[Group] = ()) -> _Fit:
        """Return the fit of a target, begun from those of parts of it."""
        if group not in self._known:
            starts = [self._known[part].state for part in parts if part in self._known]
            self._known[group] = self._fit(group, starts)
        return self._known[group]

    def _fit(self, group: Group, starts: list[FloatArray]) -> _Fit:
        problem, origin, begin_s = self._problem(group)
        extra = None
        if starts:
            state = np.array(starts)
            state[:, :2] += begin_s * state[:, 2:] - origin
            extra = np.clip(from_state(state), self._limits.lower, self._limits.upper)
        found = multistart(problem, self._limits, extra=extra)
        evidence, q = self._evidence(problem, found)
        near = near_rows(problem, found.q[0])
        if near.any():  # bearings of what passes the sensor itself may be any
            weight = problem.bearing_weight[:, near]
            anywhere = -float(np.log(np.sqrt(2.0 * pi) * weight[weight > 0]).sum())
            rest = without_rows(problem, near)
            other = multistart(rest, self._limits, extra=found.q[:1])
            value, way = self._evidence(rest, other)
            if value + anywhere > evidence:
                evidence, q = value + anywhere, way
        state = to_state(q)
        state[:2] += origin - begin_s * state[2:]
        return _Fit(max(evidence, LEAST_EVIDENCE), state)

    def _evidence(self, problem: Problem, found: DescentResult) -> tuple[float, FloatArray]:
        """Return the log evidence of a target, and its likeliest straight motion."""
        value = _laplace(problem, found)
        best = int(value.argmax())
        q = found.q[best]
        evidence = _with_alterations(problem, q, float(value[best]), self._limits, self._options)
        return evidence, q

    def _problem(self, group: Group) -> tuple[Problem, FloatArray, float]:
        """Return the problem of a target, where its states count from, and when."""
        joined = Series.join([self.heard[one].blocks for one in sorted(group)])
        joined = replace(joined, contact=np.ones(joined.time_s.size, np.int64))
        (data,) = measurements_from_series(joined)
        problem = build_problem(data, self._options)
        options, platforms = self._options, data.platforms
        if platforms is None:
            raise TypeError("contacts are paired where the places of their sensors are known")
        std = platforms.compass_std_deg
        if options.compass_std_deg is not None:
            std = np.full(std.shape, options.compass_std_deg)
        std = np.nan_to_num(std, nan=UNTOLD_COMPASS_STD_DEG)
        given = options.prior
        prior = MotionPrior(
            log_range=given.log_range or Expectation(log(self.spread_m), LOG_RANGE_STD),
            speed_mps=given.speed_mps or Expectation(0.0, VESSEL_VELOCITY_STD_MPS),
            course_rad=given.course_rad,
        )
        problem = replace(problem, offset_std_rad=np.radians(std), prior=prior)
        origin = np.array([platforms.east_m[0], platforms.north_m[0]])
        return problem, origin, float(data.time_s[0])


def _laplace(problem: Problem, found: DescentResult) -> FloatArray:
    """Return the log evidence of motions of one number of legs about each minimum."""
    std, count = VESSEL_VELOCITY_STD_MPS, found.q.shape[1]
    matrix = found.matrix.copy()
    # the prior of the speed as it bends across the velocity
    velocity = found.q[:, 2:STRAIGHT]
    along = velocity / np.maximum(np.hypot(*velocity.T), 1e-9)[:, np.newaxis]
    bend = np.eye(2) - along[:, :, np.newaxis] * along[:, np.newaxis]
    matrix[:, 2:STRAIGHT, 2:STRAIGHT] += bend / std**2
    # a bearing has a circle: its volume is no larger where nothing tells it
    matrix[:, 1, 1] += 1.0 / (2.0 * pi)
    sign, volume = np.linalg.slogdet(matrix)
    value = -0.5 * (found.value + volume - count * log(2.0 * pi))
    value -= 2.5 * log(2.0 * pi) + log(LOG_RANGE_STD * std**2)
    if problem.offset_std_rad is not None:
        power = (problem.bearing_weight**2).sum(1)
        value -= 0.5 * float(np.log1p(problem.offset_std_rad**2 * power).sum())
    power = (problem.frequency_weight**2).sum(1)
    lines = 0.5 * np.log(2.0 * pi / power) - LOG_FREQUENCY_SPAN
    value += (lines - np.log(found.rest_hz)).sum(1)
    prior = problem.prior
    each = 1.5 * log(2.0 * pi) + log(prior.change_std_mps**2 * prior.log_duration.std)
    each += log(max(float(np.ptp(problem.row_time_s)), 1.0))
    value -= (count - STRAIGHT) // PER_ALTERATION * each
    # a way through the very place of a sensor has no volume that numbers hold
    return np.where((sign > 0) & np.isfinite(value), value, -np.inf)


def _with_alterations(
    problem: Problem,
    straight: FloatArray,
    evidence: float,
    limits: SearchBounds,
    options: TmaOptions,
) -> float:
    """Return the log evidence of a motion with as many alterations as raise it.

    The last one is that of all instants and widths, in closed form.
    """
    q, best, limit = straight, evidence, limits
    for _ in range(MOST_ALTERATIONS):
        try:
            found = seek_alteration(problem, q, options.nuisances)
        except np.linalg.LinAlgError:  # a way through the very place of a sensor
            break
        best = max(best, evidence + float(np.logaddexp(0.0, found.log_odds_of_any)))
        if found.log_odds_of_any < 0.0:
            break
        limit = with_one_more(limit, problem)
        chances = found.log_odds.max(axis=1)
        parts = np.array_split(np.arange(chances.size), STRETCHES)
        best_of = [int(one[chances[one].argmax()]) for one in parts]
        usual = problem.prior.log_duration.mean
        starts = np.array([found.with_alteration(q, at, usual) for at in best_of])
        more = minimise(problem, starts, limit, iterations=12, tolerance=1e-4)
        value = _laplace(problem, more) + log(found.prior_odds)
        if not value.max() > evidence:
            break
        q, evidence = more.q[value.argmax()], float(value.max())
        best = max(best, evidence)
    return best


def _hypotheses(evidence: _Evidence) -> dict[Hypothesis, float]:
    """Return the likeliest divisions of all contacts, with their log weights."""
    heard = evidence.heard
    kept: dict[Hypothesis, float] = {frozenset(): 0.0}
    sensors: set[str] = set()
    for number, one in enumerate(heard):
        sensors.add(one.sensor)
        alone = frozenset({number})
        more: dict[Hypothesis, float] = {}
        for hypothesis, value in kept.items():
            own = value + evidence.of(alone).log_evidence
            more[hypothesis | {alone}] = own
            for group in hypothesis:
                if not evidence.are_apart(group, number):
                    continue
                joined = group | alone
                gain = evidence.of(joined, (group, alone)).log_evidence
                gain -= evidence.of(group).log_evidence
                more[(hypothesis - {group}) | {joined}] = value + gain
        weight = {one: value + _log_prior(one, heard, len(sensors)) for one, value in more.items()}
        order = sorted(more, key=lambda one: -weight[one])[:MOST_HYPOTHESES]
        least = -np.inf
        # only when all contacts of a sensor have their place do hypotheses compare
        if number + 1 == len(heard) or heard[number + 1].sensor != one.sensor:
            least = weight[order[0]] + LEAST_LOG_WEIGHT
        kept = {one: more[one] for one in order if weight[one] > least}
    count = len(sensors)
    return {one: value + _log_prior(one, heard, count) for one, value in kept.items()}


def _log_prior(hypothesis: Hypothesis, heard: list[_Heard], n_sensors: int) -> float:
    """Return the log prior of a division, up to a constant.

    N targets, each heard by a sensor with a probability that may be any, are N! / N
    divisions with the prior 1 / N of their number; each contact breaks with a
    probability that may be any, too.
    """
    n = len(hypothesis)
    pairs = sum(len({heard[m].sensor for m in group}) for group in hypothesis)
    breaks = sum(map(len, hypothesis)) - pairs
    return (
        lgamma(n)
        + _log_beta(pairs + 1, n * n_sensors - pairs + 1)
        + _log_beta(breaks + 1, pairs + 1)
    )


def _log_beta(a: int, b: int) -> float:
    return lgamma(a) + lgamma(b) - lgamma(a + b)


def _named(best: Hypothesis, heard: list[_Heard]) -> dict[int, Group]:
    """Give every target a number: the one that most of its contacts have, if it is free."""
    order = sorted(best, key=lambda group: (-len(group), min(group)))
    found: dict[int, Group] = {}
    for group in order:
        votes = Counter(heard[m].number for m in group)
        wanted = sorted(votes, key=lambda number: (-votes[number], number))
        free = (n for n in range(1, len(heard) + 1) if n not in found)
        number = next((n for n in wanted if n not in found), None)
        found[next(free) if number is None else number] = group
    return dict(sorted(found.items()))


def _pairings(
    named: dict[int, Group], likely: dict[Hypothesis, float], heard: list[_Heard]
) -> Pairings:
    """List the contacts of every target, and those that may be its, with probabilities.

    The targets of every hypothesis are those of the likeliest with which they have most
    contacts in common.
    """
    from scipy.optimize import linear_sum_assignment

    top = max(likely.values())
    weight = {one: float(np.exp(value - top)) for one, value in likely.items()}
    total = sum(weight.values())
    share: defaultdict[tuple[int, int], float] = defaultdict(float)
    for hypothesis, own in weight.items():
        groups, numbers = list(hypothesis), list(named)
        common = [[len(one & named[number]) for number in numbers] for one in groups]
        for row, column in zip(
            *linear_sum_assignment(np.array(common), maximize=True), strict=True
        ):
            if not common[row][column]:
                continue
            for member in groups[row]:
                share[numbers[column], member] += own / total
    kept = sorted(
        (number, member)
        for (number, member), value in share.items()
        if value >= LEAST_SHARE or member in named[number]
    )
    return Pairings(
        np.array([number for number, _ in kept], np.int64),
        np.array([heard[member].sensor for _, member in kept], np.str_),
        np.array([heard[member].number for _, member in kept], np.int64),
        np.array([min(share[key], 1.0) for key in kept]),
        np.array([member in named[number] for number, member in kept]),
    )
