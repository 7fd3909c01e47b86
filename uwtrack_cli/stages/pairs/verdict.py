"""Judge one pair of contacts: decision, comparison, consistency, observability.

**Conventions.** As in `uwtrack_cli.data.decisions`.
"""

import json
import math
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.decisions import FILTERS
from uwtrack_cli.estimation.pairs.contact_pair import (
    FilterNoise,
    PairTest,
    consistency,
    follow,
    run_pair,
)
from uwtrack_cli.estimation.pairs.sequential_test import (
    Thresholds,
    expected_scans,
    first_crossing,
    fixed_scans,
    overshoot_error,
)
from uwtrack_cli.stages.pairs.scans import ContactPair

_IMPROBABLE = 0.05
"""Innovations less probable than this say that a filter's model is wrong."""
_UNOBSERVED = 0.9
"""Share of the first deviation of 1/range above which bearings told nothing of it."""
_VERDICTS = {-1: "first moves", 0: "undecided", 1: "second moves"}


@dataclass(frozen=True)
class PairVerdict:
    """What `Decision` says of one pair."""

    verdict: str
    probability: float
    final_log_odds: float
    decision_time_s: float
    decision_scan: int
    expected_scans: float
    fixed_scans: float
    fixed_verdict: str
    consistency: FloatArray
    inverse_range_std: FloatArray
    observable: BoolArray
    reasons: str
    time_s: FloatArray
    log_odds: FloatArray
    log_likelihood: FloatArray


def judge_pair(
    pair: ContactPair, noise: FilterNoise, thresholds: Thresholds
) -> PairVerdict:
    """Run the test on a pair and describe its outcome."""
    belief = follow(pair.history, pair.history_times_s, noise)
    history = None if belief is None else (belief, float(pair.history_times_s[-1]))
    found = run_pair(*pair.seen, pair.times_s, noise, history=history)
    odds = np.concatenate([[0.0], found.log_odds])
    terms = np.concatenate([np.zeros((1, 4)), np.cumsum(found.log_density, axis=0)])
    scan, decision = first_crossing(odds, thresholds)
    at = int(scan) if decision else odds.size - 1
    fits = consistency(found.distance2, found.degrees)
    observable = found.inverse_range_std < _UNOBSERVED * noise.inverse_range_std
    mean_scans, fixed, fixed_verdict = _comparison(odds, thresholds)
    return PairVerdict(
        verdict=_VERDICTS[int(decision)],
        probability=1.0 / (1.0 + math.exp(-abs(float(odds[at])))),
        final_log_odds=float(odds[at]),
        decision_time_s=float(pair.times_s[at]) if decision else math.nan,
        decision_scan=at + 1 if decision else 0,
        expected_scans=mean_scans,
        fixed_scans=fixed,
        fixed_verdict=fixed_verdict,
        consistency=fits,
        inverse_range_std=found.inverse_range_std,
        observable=observable,
        reasons=_reasons(pair, int(decision), found, observable),
        time_s=pair.times_s,
        log_odds=odds,
        log_likelihood=terms,
    )


def _comparison(odds: FloatArray, thresholds: Thresholds) -> tuple[float, float, str]:
    """Return expected scans, and length and verdict of a test of fixed length."""
    # All scans: those up to the decision alone would flatter the rate of evidence.
    steps = np.diff(odds)
    mean = abs(float(steps.mean()))
    if steps.size < 2 or mean == 0.0:
        return math.nan, math.nan, ""
    # For Gaussian evidence the variance is twice the mean, whatever its strength.
    deviation = math.sqrt(2.0 * mean)
    error = overshoot_error(thresholds, deviation)
    length = fixed_scans(mean, deviation, error)
    last = math.ceil(length)
    verdict = _VERDICTS[int(np.sign(odds[last]))] if last < odds.size else ""
    return 1.0 + expected_scans(mean, deviation, thresholds, error), length, verdict


def _reasons(
    pair: ContactPair, decision: int, found: PairTest, observable: BoolArray
) -> str:
    """Say in words what limits the decision."""
    reasons = {}
    caution = _caution(pair, decision, found)
    if caution:
        reasons["verdict"] = caution
    if not decision:
        reasons["decision_time_s"] = "the scans ended before the odds were high enough"
    for seen, number in zip(observable, (pair.second, pair.first), strict=True):
        if not seen:
            reasons[f"inverse_range_{number}"] = (
                f"bearings did not tell the range of contact {number} if it is the "
                "repeater: own ship headed for it or away"
            )
    if not pair.history:
        reasons["history"] = (
            "there was no single contact before the two: both filters start anew"
        )
    return json.dumps(reasons)


def _caution(pair: ContactPair, decision: int, found: PairTest) -> str:
    """Say whether the innovations speak against the verdict."""
    wrong = consistency(found.distance2, found.degrees) < _IMPROBABLE
    readings = (bool(wrong[:2].any()), bool(wrong[2:].any()))
    if all(readings):
        names = [name for name, bad in zip(FILTERS, wrong, strict=True) if bad]
        return (
            f"neither reading fits the measurements ({', '.join(names)}): a contact may "
            "have manoeuvred; compare with filters.manoeuvre_std_mps2"
        )
    if decision and readings[0 if decision < 0 else 1]:
        return "the reading decided for does not fit its measurements"
    rejected = {-1: 3, 1: 0}.get(decision)
    if rejected is None or not wrong[rejected]:
        return ""
    worst = int(found.distance2[:, rejected].argmax())
    rest = [np.delete(table[:, rejected], worst) for table in
            (found.distance2, found.degrees)]  # fmt: skip
    if not rest[0].size or consistency(*rest) < _IMPROBABLE:
        return ""
    contact = pair.second if decision < 0 else pair.first
    return (
        f"contact {contact} was improbable as a moving one at {pair.times_s[worst + 1]:g} "
        "s alone: a manoeuvre then would explain it, too; compare with "
        "filters.manoeuvre_std_mps2"
    )
