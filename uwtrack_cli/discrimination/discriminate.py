"""Tell which of two contacts moves, and which is a stationary repeater.

**Method.** A sequential probability ratio test between two pairs of matched filters. A
repeater answers an active sonar with a delay and a Doppler shift: its range and range
rate are false, and only its bearing can be trusted.

**Conventions.** Bearings are compass degrees. More than two contacts are tested in pairs;
the contact that moves takes part in one pair with each of the others, and the error
budget is divided among these.

The tables have compass bearings, the filters mathematical radians. Own ship's position is
linear between the rows of its navigation; where she turns, what the rows leave open of
her position and velocity is added to the variances of the scan. Times are brought to one
clock when both tables know their UTC.

**References.** Jeong and Hong (1996), as corrected; Wald (1947).
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, reason_columns
from uwtrack_cli.data.decisions import FILTERS, Decision
from uwtrack_cli.data.options import AtLeast, Below, Unit, checked
from uwtrack_cli.data.scans import Contacts
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.discrimination.contact_filters import Observation
from uwtrack_cli.discrimination.options import ContactErrors, ContactFilters
from uwtrack_cli.discrimination.pair_test import (
    PairTest,
    Thresholds,
    consistency,
    expected_scans,
    first_crossing,
    fixed_scans,
    follow,
    overshoot_error,
    run_pair,
    scans_to,
    wald_thresholds,
)
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.own_ship import own_motion


@dataclass(frozen=True)
class ContactPair:
    """Two contacts over the scans from the first that both share."""

    first: int
    """Number of the first contact."""
    second: int
    """Number of the second contact."""
    times_s: FloatArray
    """Times of the scans, s."""
    observations: tuple[list[Observation], list[Observation]]
    """Measurements of the first and of the second contact, scan by scan."""
    history_times_s: FloatArray
    """Times of the scans with one contact before there were two, s."""
    history: list[Observation]
    """Measurements of that contact; empty when there was none, or two."""


def arrange_contacts(
    contacts: Contacts, navigation: Navigation, errors: ContactErrors
) -> list[ContactPair]:
    """Return every pair of contacts, ready for the filters."""
    numbers = np.unique(contacts.contact)
    if numbers.size < 2:
        raise DataError(f"two contacts or more are needed, the table has {numbers.size}.")
    measured, variance = _measurements(contacts, errors)
    times = np.unique(contacts.time_s)
    own = own_motion(navigation, times, contacts.start_utc_ns, "contacts")
    tables = {}
    for number in numbers:
        rows = np.flatnonzero(contacts.contact == number)
        at = np.searchsorted(times, contacts.time_s[rows])
        again = np.flatnonzero(np.diff(np.sort(at)) == 0)
        if again.size:
            when = times[np.sort(at)[again[0]]]
            raise DataError(f"contact {number} has two measurements at {when:g} s.")
        table = np.full((times.size, 3), np.nan)
        spread = np.ones((times.size, 3))
        table[at] = measured[rows]
        spread[at] = variance[rows] + _navigation_variance(
            measured[rows], own.change[at], own.gap_s[at]
        )
        tables[int(number)] = [
            Observation(table[i], spread[i], own.position[i], own.velocity[i])
            for i in range(times.size)
        ]
    return [_pair(a, b, tables[a], tables[b], times) for a, b in combinations(tables, 2)]


def _pair(
    a: int, b: int, first: list[Observation], second: list[Observation], times: FloatArray
) -> ContactPair:
    has = np.array([[np.isfinite(s.measured).all() for s in t] for t in (first, second)])
    both = np.flatnonzero(has.all(axis=0))
    if both.size < 2:
        raise DataError(
            f"contacts {a} and {b} share {both.size} complete scans (range, bearing and "
            "range rate at the same time); two or more are needed."
        )
    begin, end = both[0], both[-1] + 1
    alone = has.any(axis=1)
    earlier = has[:, :begin]
    # One contact before the other appeared; it may carry either number.
    split = bool(alone.all() and not earlier.any(axis=1).all())
    before = np.flatnonzero(earlier.any(axis=0)) if split else np.array([], np.int64)
    own = first if earlier[0].any() else second
    return ContactPair(
        a, b, times[begin:end], (first[begin:end], second[begin:end]), times[before],
        [own[i] for i in before],
    )  # fmt: skip


def _measurements(contacts: Contacts, errors: ContactErrors) -> tuple[FloatArray, FloatArray]:
    """Return range, bearing, range rate in radians and m, and their variances."""
    for name in ("range_m", "time_s"):
        values = getattr(contacts, name)
        bad = (
            np.flatnonzero(values <= 0.0)
            if name == "range_m"
            else np.flatnonzero(~np.isfinite(values))
        )
        if bad.size:
            raise DataError(f"row {bad[0] + 1} of the contacts: {name} is {values[bad[0]]}.")
    bearing = np.deg2rad(90.0 - contacts.bearing_deg)
    measured = np.stack([contacts.range_m, bearing, contacts.range_rate_mps], axis=1)
    deviations = [
        _deviation(contacts, errors, name)
        for name in ("range_std_m", "bearing_std_deg", "range_rate_std_mps")
    ]
    deviations[1] = np.deg2rad(deviations[1])
    return measured, np.stack(deviations, axis=1) ** 2


def _navigation_variance(
    measured: FloatArray, change_mps: FloatArray, gap_s: FloatArray
) -> FloatArray:
    """Return the variances of range, bearing, range rate that own ship's turn adds.

    Between two rows her velocity may be any on the way from that before to that after
    them: uniform, a twelfth of the change squared; the place follows over half the gap.
    """
    line = np.stack([np.cos(measured[:, 1]), np.sin(measured[:, 1])], axis=-1)
    side = np.stack([-line[:, 1], line[:, 0]], axis=-1)
    # The two changes, at the row before and after, are halves of that over both.
    along, across = (
        ((change_mps * axis[:, None]).sum(axis=-1) ** 2).sum(axis=1) / 6.0 for axis in (line, side)
    )
    reach = (0.5 * gap_s) ** 2
    bearing = across * reach / measured[:, 0] ** 2
    return np.stack([along * reach, bearing, along], axis=1)


def _deviation(contacts: Contacts, errors: ContactErrors, name: str) -> FloatArray:
    """Return a column of deviations, completed by the option."""
    option = getattr(errors, name)
    values = getattr(contacts, name)
    if option is not None:
        values = np.where(np.isnan(values), option, values)
    measured = np.isfinite(getattr(contacts, name.replace("_std", "")))
    bad = np.flatnonzero(measured & ~(values > 0.0))
    if bad.size:
        raise DataError(
            f"row {bad[0] + 1} of the contacts: {name} is {values[bad[0]]}; give a "
            f"deviation above 0, or errors.{name} (--errors-{name.replace('_', '-')})."
        )
    return np.where(np.isfinite(values), values, 1.0)


ErrorProbability = Annotated[float, Unit("1"), AtLeast(1e-12), Below(0.5)]


_IMPROBABLE = 0.05
"""Innovations less probable than this say that a filter's model is wrong."""
_UNOBSERVED = 0.9
"""Share of the first deviation of 1/range above which bearings do not determine it."""
_VERDICTS = {-1: "first moves", 0: "undecided", 1: "second moves"}
_BOTH_MOVE, _NEITHER = "both move", "neither fits"
_REJECTION_SHARE = 0.1
"""Share of the accepted error at which a filter is rejected. The right reading has two
filters, so that it is overruled in less than a fifth of the accepted error."""


_STATED = (
    "verdict", "probability", "final_log_odds", "decision_time_s", "decision_scan",
    "expected_scans", "fixed_scans", "fixed_verdict", "consistency",
    "inverse_range_std", "observable",
)  # fmt: skip
"""Columns of `Decision` that each pair's verdict has."""


@dataclass(frozen=True)
class PairVerdict:
    """What `Decision` says of one pair."""

    verdict: str
    """Decision in words."""
    probability: float
    """Probability of the likelier hypothesis."""
    final_log_odds: float
    """Log odds at the decision, or at the last scan."""
    decision_time_s: float
    """Time of the decision, s; nan if undecided."""
    decision_scan: int
    """Scans taken for it; 0 if undecided."""
    expected_scans: float
    """Mean number of scans that a decision takes; nan where it cannot be given."""
    fixed_scans: float
    """Scans that a test of fixed length needs for the same errors."""
    fixed_verdict: str
    """Verdict of that test; empty where the scans do not suffice."""
    consistency: FloatArray
    """Probability of innovations as large as those of each filter, ``(4,)``."""
    inverse_range_std: FloatArray
    """Relative deviation of the drifting filter's range, ``(2,)``: second, first."""
    observable: BoolArray
    """Whether bearings determined that range, ``(2,)``."""
    reasons: dict[str, str]
    """What limits the decision, by the name of the value."""
    time_s: FloatArray
    """Times of the scans, s, ``(scan,)``."""
    log_odds: FloatArray
    """Log odds after every scan, ``(scan,)``."""
    log_likelihood: FloatArray
    """Sum of each filter's log likelihoods, ``(scan, 4)``."""


@checked
def discriminate_contacts(
    contacts: Contacts,
    navigation: Navigation,
    *,
    miss: ErrorProbability = 0.05,
    false_alarm: ErrorProbability = 0.05,
    errors: ContactErrors = ContactErrors(),  # noqa: B008 - frozen
    filters: ContactFilters = ContactFilters(),  # noqa: B008 - frozen
) -> Decision:
    """Decide which of two contacts moves and which is a stationary repeater.

    Two echoes look alike: one is a vessel under way, the other a moored or drifting
    repeater whose range and range rate are false. Scan by scan the likelihoods of both
    hypotheses are compared until one is likely enough, or the scans end undecided. When
    the innovations of all scans reject both hypotheses, the verdict says so: "neither
    fits". It is "both move" where both contacts fit a vessel and either is a far worse
    repeater. Far contacts fit both, since bearings alone tell a repeater from a vessel:
    the test then stays undecided, or takes one of two vessels for the repeater.

    Parameters
    ----------
    contacts
        Ranges, bearings and range rates of two or more contacts.
    navigation
        Own ship's positions, covering the times of the contacts.
    miss
        Accepted probability of taking the first contact for the moving one when it is
        the second.
    false_alarm
        Accepted probability of the opposite error.
    errors
        Deviations of the measurements, where the table has none.
    filters
        What the filters assume of moving and drifting contacts.

    Returns
    -------
    Decision
        Verdict, odds over time, consistency and observability of each pair.

    Raises
    ------
    DataError
        Fewer than two contacts share scans, deviations are missing, or own ship's
        navigation does not cover the scans.
    OptionError
        An option is out of range.

    Notes
    -----
    L(k) = L(k-1) + ln p(z(k) | Z, H1) - ln p(z(k) | Z, H0); decide at ln((1 - P_M)/P_F)
    and ln(P_M/(1 - P_F)) (Wald 1947; Jeong and Hong 1996, eqs. 3-4 and 20).
    """
    pairs = arrange_contacts(contacts, navigation, errors)
    n_contacts = np.unique(contacts.contact).size
    share = 1.0 / (n_contacts - 1)
    thresholds = wald_thresholds(miss * share, false_alarm * share)
    level = _REJECTION_SHARE * share * min(miss, false_alarm)
    verdicts = [judge_pair(pair, filters, thresholds, level) for pair in pairs]
    per_scan = [v.log_odds.size for v in verdicts]
    return Decision(
        first_contact=np.array([pair.first for pair in pairs]),
        second_contact=np.array([pair.second for pair in pairs]),
        **{name: np.array([getattr(v, name) for v in verdicts]) for name in _STATED},
        **reason_columns("reason_pair", [v.reasons for v in verdicts]),
        scan_pair=np.repeat(np.arange(len(pairs)), per_scan),
        scan_time_s=np.concatenate([v.time_s for v in verdicts]),
        log_odds=np.concatenate([v.log_odds for v in verdicts]),
        log_likelihood=np.concatenate([v.log_likelihood for v in verdicts]),
        lower_threshold=thresholds.lower,
        upper_threshold=thresholds.upper,
        miss_probability=miss * share,
        false_alarm_probability=false_alarm * share,
        moving_contact=_moving([p.first for p in pairs], [p.second for p in pairs], verdicts),
        start_utc_ns=contacts.start_utc_ns,
    )


def _moving(first: list[int], second: list[int], verdicts: list[PairVerdict]) -> int:
    """Return the contact that moves against every other, 0 for none."""
    wins: dict[int, int] = {}
    for a, b, found in zip(first, second, verdicts, strict=True):
        winner = {"first moves": a, "second moves": b}.get(found.verdict)
        if winner is not None:
            wins[winner] = wins.get(winner, 0) + 1
    rivals = len({*first, *second}) - 1
    return next((contact for contact, count in wins.items() if count == rivals), 0)


def judge_pair(
    pair: ContactPair, filters: ContactFilters, thresholds: Thresholds, level: float
) -> PairVerdict:
    """Run the test on a pair and describe its outcome.

    A filter is rejected where its innovations are less probable than ``level``.
    """
    history = follow(pair.history, pair.history_times_s, filters)
    found = run_pair(*pair.observations, pair.times_s, filters, history=history)
    odds = np.concatenate([[0.0], found.log_odds])
    sums = np.cumsum(found.log_density, axis=0)
    terms = np.concatenate([np.zeros((1, 4)), sums[:, :4]])
    crossing = first_crossing(odds, thresholds)
    fits = consistency(found.distance2, found.degrees)
    # The one that moved before goes on, or a vessel begins anew. A repeater's density is
    # as much smaller as this in less than the share of all cases.
    vessel = np.maximum(sums[-1, [0, 3]], sums[-1, 4:])
    is_vessel = vessel - sums[-1, [2, 1]] > -math.log(0.5 * level)
    rejected = _rejected_verdict(fits < level, is_vessel)
    decision = 0 if rejected else int(crossing.decision)
    at = int(crossing.scan) if decision else odds.size - 1
    observable = found.inverse_range_left < _UNOBSERVED
    mean_scans, fixed, fixed_verdict = _comparison(odds, thresholds)
    return PairVerdict(
        verdict=rejected or _VERDICTS[decision],
        probability=math.nan if rejected else 1.0 / (1.0 + math.exp(-abs(odds[at]))),
        final_log_odds=float(odds[at]),
        decision_time_s=float(pair.times_s[at]) if decision else math.nan,
        decision_scan=at + 1 if decision else 0,
        expected_scans=mean_scans,
        fixed_scans=fixed,
        fixed_verdict=fixed_verdict,
        consistency=fits[:4],
        inverse_range_std=found.inverse_range_std,
        observable=observable,
        reasons=_reasons(pair, decision, found, observable, rejected),
        time_s=pair.times_s,
        log_odds=odds,
        log_likelihood=terms,
    )


def _rejected_verdict(is_rejected: BoolArray, is_vessel: BoolArray) -> str:
    """Return the verdict where both readings are rejected; empty where one is not."""
    if is_vessel.all() and not (is_rejected[[0, 3]] & is_rejected[4:]).any():
        return _BOTH_MOVE
    first_moves, second_drifts, first_drifts, second_moves = is_rejected[:4].tolist()
    if (first_moves or second_drifts) and (first_drifts or second_moves):
        return _NEITHER
    return ""


def _comparison(odds: FloatArray, thresholds: Thresholds) -> tuple[float, float, str]:
    """Return expected scans, and length and verdict of a test of fixed length."""
    side = float(np.sign(odds[-1]))
    walk = side * odds[1:]
    mean = float(walk[-1]) / walk.size
    if walk.size < 2 or mean == 0.0:
        return math.nan, math.nan, ""
    # The variance of a Gaussian log likelihood ratio is twice its mean.
    deviation = math.sqrt(2.0 * mean)
    error = overshoot_error(thresholds, 0.0)
    limit = thresholds.upper if side > 0.0 else -thresholds.lower
    taken = scans_to(
        walk, (1.0 - 2.0 * error) * limit, expected_scans(mean, deviation, thresholds, error)
    )
    steady = fixed_scans(mean, deviation, error)
    length = scans_to(walk, steady * mean, steady)
    # odds that hardly grow ask for more scans than any number holds
    last = math.ceil(min(length, odds.size))
    verdict = _VERDICTS[int(np.sign(odds[last]))] if last < odds.size else ""
    return 1.0 + taken, length, verdict


def _reasons(
    pair: ContactPair, decision: int, found: PairTest, observable: BoolArray, rejected: str
) -> dict[str, str]:
    """Say in words what limits the decision."""
    reasons = {}
    if rejected == _BOTH_MOVE:
        reasons["verdict"] = (
            "both contacts fit a moving vessel, and neither fits a stationary repeater"
        )
    elif caution := _caution(pair, decision, found):
        reasons["verdict"] = caution
    if rejected:
        reasons["probability"] = "the measurements reject both readings"
    elif not decision:
        reasons["decision_time_s"] = "the scans ended before the odds were high enough"
    for known, number in zip(observable, (pair.second, pair.first), strict=True):
        if not known:
            reasons[f"inverse_range_{number}"] = (
                f"bearings do not determine the range of contact {number} if it is the "
                "repeater: own ship headed for it or away"
            )
    if not pair.history:
        reasons["history"] = "there was no single contact before the two: both filters start anew"
    return reasons


def _caution(pair: ContactPair, decision: int, found: PairTest) -> str:
    """Say whether the innovations speak against the verdict."""
    wrong = consistency(found.distance2, found.degrees)[:4] < _IMPROBABLE
    readings = (bool(wrong[:2].any()), bool(wrong[2:].any()))
    if all(readings):
        names = [name for name, bad in zip(FILTERS, wrong, strict=True) if bad]
        return (
            f"neither hypothesis fits the measurements ({', '.join(names)}): a contact may "
            "have manoeuvred; compare with filters.manoeuvre_std_mps2"
        )
    if decision and readings[0 if decision < 0 else 1]:
        return "the reading decided for does not fit its measurements"
    rejected = {-1: 3, 1: 0}.get(decision)
    if rejected is None or not wrong[rejected]:
        return ""
    worst = int(found.distance2[:, rejected].argmax())
    rest = [np.delete(table[:, rejected], worst) for table in (found.distance2, found.degrees)]
    if not rest[0].size or consistency(*rest) < _IMPROBABLE:
        return ""
    contact = pair.second if decision < 0 else pair.first
    return (
        f"contact {contact} was improbable as a moving one at {pair.times_s[worst + 1]:g} "
        "s alone: a manoeuvre then would explain it, too; compare with "
        "filters.manoeuvre_std_mps2"
    )
