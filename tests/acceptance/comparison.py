"""The rule by which an outcome is as good as the frozen one.

*Drawn, against the truth.* No vessel that was found is lost. Its status is as good or
better ('', 'level-only', 'no-speed', 'extrapolated', 'ok'). A side that was right stays right,
none becomes wrong. A quantity that was given is given. Its error may grow by half of the
frozen standard deviation, or lie within two of its own. Its standard deviation may grow by a
tenth; it may shrink to nine tenths of the Cramer-Rao bound (or of the frozen one where that
was below), or by a tenth where no bound is known, as long as the error stays within two of
it. No further row is false. What is found beyond that is welcome.

*Real.* As many rows, in their order, each of the same status and verdict or better; values
within half of the frozen standard deviation, standard deviations within a fifth. The same
codes. A row that is right by what is known may appear, one that is false may go.

*Values* without a truth are held as those of real recordings. *Scores* are worse by no more than their slack. *Counts* are worse where their exact 95 % intervals part.
A case that is missing or fails is red, one that is not frozen yet is not. Cost is never compared.

For pure moves of code `exact` compares all but the cost of two runs of one machine to 1e-9.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import isclose, isfinite
from typing import Any

from tests.acceptance.outcomes import STATUSES, Outcome
from tests.support import binomial_interval, poisson_interval

Rows = Sequence[Mapping[str, Any]]

RARE = ("false", "ids", "lost", "pairs wrong", "contacts")
"""Counts of which less is better; of others more is."""

ERROR_MAY_GROW, ERROR_WITHIN = 0.5, 2.0
"""In standard deviations: the frozen ones, the row's own."""

STD_MAY_GROW, STD_OVER_BOUND, STD_MAY_SHRINK = 1.1, 0.9, 0.9
VALUE_MAY_MOVE, REAL_STD_MAY_CHANGE = 0.5, 1.2
EXACT = 1e-9


def differences(frozen: Mapping[str, Outcome], now: Mapping[str, Outcome]) -> Iterator[str]:
    """Yield in words what is worse than frozen in the cases of a part."""
    for name, before in frozen.items():
        if name not in now:
            yield f"{name}: missing"
            continue
        for words in case_differences(before, now[name]):
            yield f"{name}: {words}"


def case_differences(before: Outcome, now: Outcome) -> Iterator[str]:
    """Yield what is worse in one case."""
    if "failed" in now:
        yield f"failed: {now['failed']}"
        return
    if "failed" in before:
        return
    pairs = zip(before.get("vessels", []), now.get("vessels", []), strict=True)
    for number, (one, other) in enumerate(pairs, start=1):
        for words in _vessel(one, other):
            yield f"vessel {number}: {words}"
    yield from _false_rows(before.get("false", []), now.get("false", []))
    yield from _codes(before, now)
    yield from _real(before.get("rows", []), now.get("rows", []))
    yield from _counts(before.get("counts", {}), now.get("counts", {}))
    yield from _values(before.get("values", {}), now.get("values", {}))
    yield from _scores(before.get("scores", {}), now.get("scores", {}))


def _counts(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield counts whose exact interval lies beyond the frozen one, on the worse side."""
    for name, (hits, of) in before.items():
        again, size = now[name]
        if not (of and size):
            continue
        if name.startswith(RARE):
            high = poisson_interval(round(hits))[1] / of
            is_worse = poisson_interval(round(again))[0] / size > high
        else:
            low = binomial_interval(round(hits), round(of))[0]
            is_worse = binomial_interval(round(again), round(size))[1] < low
        if is_worse:
            yield f"{name} {again:g} of {size:g}, frozen {hits:g} of {of:g}"


def _values(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for name, one in before.items():
        if name not in now:
            yield f"{name} not given"
        elif _moved(one, now[name]):
            yield f"{name} {_told(now[name])}, frozen {_told(one)}"


def _told(one: Mapping[str, float]) -> str:
    return f"{one['value']:.4g} +- {one['std']:.4g}"


def _false_rows(before: Rows, now: Rows) -> Iterator[str]:
    if len(now) > len(before):
        rows = "; ".join(f"{r['status']} at {r['time_s']:.1f} s, {r['why']}" for r in now)
        yield f"{len(now)} false rows, frozen {len(before)}: {rows}"


def _codes(before: Outcome, now: Outcome) -> Iterator[str]:
    if now.get("codes") != before.get("codes"):
        yield f"codes {now.get('codes')}, frozen {before.get('codes')}"


def _scores(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for name, one in before.items():
        value, limit = now[name]["value"], one["slack"]
        worse = value - one["value"]
        worse = {"less": worse, "more": -worse, "same": abs(worse)}[one["better"]]
        if isfinite(one["value"]) and not worse <= limit:
            yield f"{name} {value:.4g}, frozen {one['value']:.4g}, slack {limit:g}"


def _rank(status: str) -> int:
    return STATUSES.index(status) if status in STATUSES else 1


def _vessel(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    if before["found"] and not now["found"]:
        yield "lost"
        return
    if _rank(now["status"]) < _rank(before["status"]):
        yield f"status {now['status']!r}, frozen {before['status']!r}"
    if now["side"] == "wrong" != before["side"] or (before["side"] == "right" != now["side"]):
        yield f"side {now['side']}, frozen {before['side']}"
    for name, one in before["quantities"].items():
        if name not in now["quantities"]:
            yield f"{name} not given"
            continue
        for words in _quantity(one, now["quantities"][name]):
            yield f"{name} {words}"


def _quantity(before: Mapping[str, float], now: Mapping[str, float]) -> Iterator[str]:
    error, std = abs(now["error"]), now["std"]
    allowed = max(abs(before["error"]) + ERROR_MAY_GROW * before["std"], ERROR_WITHIN * std)
    told = (
        f"off by {error:.4g} +- {std:.4g}, frozen {abs(before['error']):.4g} +- {before['std']:.4g}"
    )
    if not error <= allowed:
        yield told
    elif not std <= STD_MAY_GROW * before["std"]:
        yield f"wider: {told}"
    else:
        least = STD_MAY_SHRINK * before["std"]
        if "bound" in before:
            least = min(least, STD_OVER_BOUND * before["bound"])
        is_narrower = std < STD_MAY_SHRINK * before["std"]
        if std < least or (is_narrower and error > ERROR_WITHIN * std):
            yield f"narrower: {told}"


def _real(before: Rows, now: Rows) -> Iterator[str]:
    """Yield what is worse in rows of a real recording, in their order.

    Where their number differs those are held that are right by what is known.
    """
    if len(before) != len(now):
        if sum(r["verdict"] == "false" for r in now) > sum(r["verdict"] == "false" for r in before):
            yield f"{len(now)} rows, frozen {len(before)}, more of them false"
        before, now = ([r for r in rows if r["verdict"] == "right"] for rows in (before, now))
        if len(now) < len(before):
            yield "a row that was right is lost"
    for number, (one, other) in enumerate(zip(before, now, strict=False), start=1):
        for words in _real_row(one, other):
            yield f"row {number}: {words}"


def _real_row(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    if before["verdict"] == "right" != now["verdict"]:
        yield "was right"
    if _rank(now["status"]) < _rank(before["status"]):
        yield f"status {now['status']!r}, frozen {before['status']!r}"
    for name, value in before.items():
        if not isinstance(value, dict):
            continue
        if name not in now:
            yield f"{name} not given"
        elif _moved(value, now[name]):
            yield f"{name} {_told(now[name])}, frozen {_told(value)}"


def _moved(before: Mapping[str, float], now: Mapping[str, float]) -> bool:
    moved = abs(now["value"] - before["value"]) > VALUE_MAY_MOVE * before["std"]
    ratio = now["std"] / before["std"]
    return moved or not 1.0 / REAL_STD_MAY_CHANGE <= ratio <= REAL_STD_MAY_CHANGE


def exact(one: Any, other: Any, path: str = "") -> Iterator[str]:
    """Yield where two outcomes differ by more than 1e-9, the cost left out."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted({*one, *other} - {"cost"}):
            yield from exact(one.get(key), other.get(key), f"{path}/{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for number, pair in enumerate(zip(one, other, strict=True)):
            yield from exact(*pair, f"{path}/{number}")
    elif isinstance(one, float) and isinstance(other, float):
        if not isclose(one, other, rel_tol=EXACT, abs_tol=EXACT) and (
            isfinite(one) or isfinite(other)
        ):
            yield f"{path}: {one!r}, {other!r}"
    elif one != other:
        yield f"{path}: {one!r}, {other!r}"
