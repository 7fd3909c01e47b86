"""Rates over all cases, held by exact limits; and the bands that they are to reach.

A share is held where its exact 95 % interval (Clopper and Pearson 1934) meets the limit,
a count over hours or kHz hours where its Poisson interval (Garwood 1936) does. The limit
of a rate is its band, or today's figure where that misses the band: green is "not
worse". To move a limit to its band, edit `RATES`.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from tests.acceptance.running import Results
from tests.support import binomial_interval, poisson_interval

DRAWN = ("quiet", "disturbed", "two-vessels", "harder", "ships", "vehicles")
WITHOUT = ("nothing", "foreign")
WITH = ("quiet", "disturbed", "two-vessels", "harder", "ships")
WITHIN, MEDIAN_WITHIN, BEYOND = 1.96, 0.6745, 5.0
"""Standard deviations that hold 95 and 50 % of normal errors, and almost all."""

Counted = tuple[float, float]
"""Hits, and of how many; or a count, and over how much."""

Count = Callable[[Results], Counted]
Limit = tuple[float, float]


def _vessels(results: Results, parts: Sequence[str], start: str = "") -> Iterator[dict[str, Any]]:
    for part in parts:
        for name, one in results.get(part, {}).items():
            if name.startswith(start):
                yield from one.get("vessels", [])


def _quantities(
    results: Results, parts: Sequence[str], start: str, name: str = ""
) -> Iterator[dict[str, float]]:
    for vessel in _vessels(results, parts, start):
        for key, one in vessel["quantities"].items():
            if name in ("", key):
                yield one


def found(parts: Sequence[str], start: str = "") -> Count:
    """Count vessels found of those due."""

    def count(results: Results) -> Counted:
        due = [one for one in _vessels(results, parts, start) if one["due"]]
        return sum(one["found"] for one in due), len(due)

    return count


def with_speed(parts: Sequence[str]) -> Count:
    """Count vessels due whose speed is given."""

    def count(results: Results) -> Counted:
        due = [one for one in _vessels(results, parts) if one["due"]]
        return sum("speed_mps" in one["quantities"] for one in due), len(due)

    return count


def wrong_sides(parts: Sequence[str], start: str = "") -> Count:
    """Count wrong sides of those that are given."""

    def count(results: Results) -> Counted:
        told = [one for one in _vessels(results, parts, start) if one["side"] != "none"]
        return sum(one["side"] == "wrong" for one in told), len(told)

    return count


def within(deviations: float, parts: Sequence[str], start: str = "", name: str = "") -> Count:
    """Count quantities within so many of their standard deviations."""

    def count(results: Results) -> Counted:
        every = list(_quantities(results, parts, start, name))
        return sum(abs(q["error"]) <= deviations * q["std"] for q in every), len(every)

    return count


def beyond(parts: Sequence[str], start: str = "") -> Count:
    """Count quantities beyond five standard deviations."""

    def count(results: Results) -> Counted:
        every = list(_quantities(results, parts, start))
        return sum(abs(q["error"]) > BEYOND * q["std"] for q in every), len(every)

    return count


def over_bound(ratio: float, parts: Sequence[str], start: str = "", name: str = "") -> Count:
    """Count standard deviations above so many Cramer-Rao bounds; half are at a median."""

    def count(results: Results) -> Counted:
        every = [q for q in _quantities(results, parts, start, name) if "bound" in q]
        return sum(q["std"] > ratio * q["bound"] for q in every), len(every)

    return count


SURE = 0.9
"""Probability from which a row is as good as said to be of a vessel."""


def false_rows(parts: Sequence[str], least: float = 0.0) -> Count:
    """Count false rows of a probability, those that do not state any included, over hours."""

    def count(results: Results) -> Counted:
        cases = [one for part in parts for one in results.get(part, {}).values()]
        rows = [row for one in cases for row in one.get("false", [])]
        return (sum(row.get("probability", 1.0) >= least for row in rows),
                sum(one.get("hours", 0.0) for one in cases))  # fmt: skip

    return count


def false_of(parts: Sequence[str], start: str) -> Count:
    """Count false rows of tables over the draws."""

    def count(results: Results) -> Counted:
        cases = [
            one for part in parts for name, one in results.get(part, {}).items()
            if name.startswith(start)
        ]  # fmt: skip
        return (sum(len(one.get("false", [])) for one in cases),
                sum(of for one in cases for _, of in one.get("counts", {}).values()))  # fmt: skip

    return count


def counted(part: str, *names: str) -> Count:
    """Sum counts of these names over the cases of a part."""

    def count(results: Results) -> Counted:
        every = [
            value for one in results.get(part, {}).values()
            for name, value in one.get("counts", {}).items() if name.startswith(names)
        ]  # fmt: skip
        return sum(hits for hits, _ in every), sum(of for _, of in every)

    return count


class Rate(NamedTuple):
    """A rate with its limit of today and its band; a limit is (least, most)."""

    name: str
    """What is counted."""
    count: Count
    """How it is counted."""
    parts: tuple[str, ...]
    """Parts that it needs."""
    limit: tuple[float, float]
    """What must not be missed; today's figure where that misses the band."""
    band: tuple[float, float]
    """What is wanted."""
    source: str
    """Where the band is from."""
    is_share: bool = True
    """Else the count is a Poisson one, over hours or kHz hours."""

    def held(self, counted: Counted, limit: tuple[float, float]) -> bool:
        """Whether a count agrees with a limit."""
        hits, of = counted
        if not of:
            return True
        low, high = (
            binomial_interval(round(hits), round(of)) if self.is_share
            else tuple(one / of for one in poisson_interval(round(hits)))
        )  # fmt: skip
        return low <= limit[1] and high >= limit[0]


HONEST, MEDIAN = (0.93, 0.97), (0.4, 0.6)
"""Shares within 1.96 and within .6745 standard deviations where these are honest."""

ONE = ("quiet", "disturbed")
"""Recordings of one vessel that have bounds."""

WITH_BOUND = (*ONE, "two-vessels")
FRINGES = "specification, fringes 4"
DECISION, MOTION = "specification, decision 6", "specification, motion 7"
TARGETS = "specification, pdaf and discriminate"
NAMES_OF_TABLES = ("time", "speed", "range", "range over speed", "course")


def _at_least(name: str, count: Count, parts: Sequence[str], limit: float, band: float, source: str) -> Rate:  # fmt: skip
    return Rate(name, count, tuple(parts), (limit, 1.0), (band, 1.0), source)


def _at_most(name: str, count: Count, parts: Sequence[str], limit: float, band: float, source: str) -> Rate:  # fmt: skip
    return Rate(name, count, tuple(parts), (0.0, limit), (0.0, band), source)


def _each_hour(name: str, count: Count, parts: Sequence[str], limit: float, band: float, source: str) -> Rate:  # fmt: skip
    return _at_most(name, count, parts, limit, band, source)._replace(is_share=False)


def _honest(name: str, parts: Sequence[str], start: str, quantity: str, limit: Limit, median: Limit, source: str) -> tuple[Rate, Rate]:  # fmt: skip
    """Return both sides of honesty: neither too narrow nor too wide."""
    return (
        Rate(f"{name} within 1.96", within(WITHIN, parts, start, quantity), tuple(parts),
             limit, HONEST, source),
        Rate(f"{name} within .6745", within(MEDIAN_WITHIN, parts, start, quantity),
             tuple(parts), median, MEDIAN, "specification, design 8"),
    )  # fmt: skip


RATES: tuple[Rate, ...] = (
    _at_least("quiet: found of due", found(("quiet",)), ("quiet",), 0.83, 0.98, DECISION),
    _at_least("disturbed: found of due", found(("disturbed",)), ("disturbed",), 0.9, 0.9, DECISION),
    _at_least("two vessels: found of due", found(("two-vessels",)), ("two-vessels",), 0.98, 0.98, DECISION),
    _at_least("harder: found", found(("harder",)), ("harder",), 0.98, 0.98, "specification, decision 3a"),
    _at_least("ships: found", found(("ships",)), ("ships",), 0.98, 0.98, DECISION),
    _at_least("ships: speed given", with_speed(("ships",)), ("ships",), 0.95, 0.98, DECISION),
    _at_least("vehicles: found", found(("vehicles",)), ("vehicles",), 0.9, 0.9, DECISION),
    _at_least("vehicles: speed given", with_speed(("vehicles",)), ("vehicles",), 0.12, 0.9, DECISION),
    _at_most("drawn: wrong sides", wrong_sides(DRAWN), DRAWN, 0.0, 0.0, MOTION),
    _at_least("fringes: found", found(("fringes",)), ("fringes",), 0.95, 0.95, FRINGES),
    _each_hour("fringes: false rows an hour", false_rows(("fringes",)), ("fringes",), 0.0, 0.0, FRINGES),
    _at_least("fringes: within 1.96", within(WITHIN, ("fringes",)), ("fringes",), 0.92, 0.92, FRINGES),
    _each_hour("without a vessel: rows an hour", false_rows(WITHOUT), WITHOUT, 1.02, 0.1, DECISION),
    _each_hour("beside vessels: false rows an hour", false_rows(WITH), WITH, 0.1, 0.1, DECISION),
    _each_hour("without a vessel: rows an hour of .9 and more", false_rows(WITHOUT, SURE), WITHOUT, 0.1, 0.1, DECISION),
    _each_hour("beside vessels: false rows an hour of .9 and more", false_rows(WITH, SURE), WITH, 0.1, 0.1, DECISION),
    *_honest("drawn, one or two vessels", WITH_BOUND, "", "", HONEST, MEDIAN, DECISION),
    *_honest("harder and ships", ("harder", "ships"), "", "", HONEST, MEDIAN, DECISION),
    *_honest("vehicles", ("vehicles",), "", "", HONEST, MEDIAN, DECISION),
    _at_most("drawn, beyond 5", beyond(WITH_BOUND), WITH_BOUND, 0.005, 0.005, DECISION),
    _at_most("drawn: stated over 1.5 bounds", over_bound(1.5, WITH_BOUND), WITH_BOUND, 0.9, 0.5, DECISION),
    *(
        rate
        for quantity in NAMES_OF_TABLES
        for rate in _honest(f"cpa of tables, {quantity},", ("tables",), "cpa", quantity, HONEST, MEDIAN, DECISION)
    ),
    _at_most("cpa of tables, beyond 5", beyond(("tables",), "cpa"), ("tables",), 0.005, 0.005, DECISION),
    _at_most("cpa of tables: stated over 1.5 bounds", over_bound(1.5, ("tables",), "cpa"), ("tables",), 0.5, 0.5, DECISION),
    _at_least("cpa of tables: found of due", found(("tables",), "cpa"), ("tables",), 0.98, 0.98, DECISION),
    _at_most("cpa of tables: wrong sides", wrong_sides(("tables",), "cpa"), ("tables",), 0.0, 0.0, MOTION),
    *(
        _at_most(f"cpa of tables, {kind}: told as a passage", false_of(("tables",), f"cpa {kind}"), ("tables",), 0.0, 0.0, DECISION)
        for kind in ("machinery", "constant", "joined")
    ),
    *(
        rate
        for quantity in ("range", "bearing", "speed", "course")
        for rate in _honest(f"tma, {quantity},", ("tables",), "tma", quantity, HONEST, MEDIAN, MOTION)
    ),
    *(
        Rate(f"tma: interval of {name}", counted("tables", f"interval of {name}"), ("tables",), HONEST, HONEST, MOTION)
        for name in ("range", "speed", "course")
    ),
    Rate("locate: ellipses", counted("tables", "ellipses"), ("tables",), (0.9, 0.98), (0.9, 0.98), MOTION),
    _at_least("discriminate: right", counted("tables", "pairs right"), ("tables",), 0.9, 0.9, "specification, discriminate"),
    _at_most("discriminate: wrong", counted("tables", "pairs wrong"), ("tables",), 0.01, 0.01, "specification, discriminate"),
    _at_least("pdaf: own target after a crossing at 20 degrees", counted("tables", "own at 20"), ("tables",), 0.9, 0.9, "specification, pdaf"),
    _at_most("pdaf: lost", counted("tables", "lost"), ("tables",), 0.01, 0.01, "specification, pdaf"),
    *(
        _at_most(f"discriminate: {what} at an accepted {share:g} %", counted("targets", f"{name} of pairs at {share:g} %"), ("targets",), limit * share / 100.0, limit * share / 100.0, TARGETS)
        for share in (5, 1) for what, name, limit in (("wrong", "wrong", 1.0), ("neither fits", "neither", 0.2))
    ),
    _at_most("pdaf: takeovers at 10 degrees", counted("targets", "takeovers"), ("targets",), 0.02, 0.02, TARGETS),
    _at_most("pdaf: one of two lost", counted("targets", "lost of two"), ("targets",), 0.02, 0.02, TARGETS),
    _at_least("pdaf: states of Stone Soup's JPDA", counted("targets", "states of"), ("targets",), 1.0, 1.0, TARGETS),
    _at_least("pdaf: GOSPA within 15 % of Stone Soup's, without a start", counted("targets", "GOSPA"), ("targets",), 0.9, 0.9, TARGETS),
    _each_hour("pdaf: false tracks over those stated", counted("targets", "false tracks"), ("targets",), 1.0, 1.0, TARGETS),
    *(
        rate
        for kind in ("places", "rates", "bearings")
        for rate in (
            _at_most(f"pdaf: lost under way, {kind}", counted("targets", f"lost under way, {kind}"), ("targets",), 0.05, 0.05, TARGETS),
            _at_least(f"pdaf: ellipses under way, {kind}", counted("targets", f"ellipses under way, {kind}"), ("targets",), 0.93, 0.93, TARGETS),
        )
    ),
    _at_most("pdaf: lost in turns", counted("targets", "lost in turns"), ("targets",), 0.02, 0.02, TARGETS),
    _at_least("pdaf: smoothed ellipses of turns", counted("targets", "smoothed ellipses"), ("targets",), 0.93, 0.93, TARGETS),
    _at_least("track: half of the bursts at 1.5 dB", counted("lines", "track at 1.5 dB"), ("lines",), 0.5, 0.5, "specification, lines, second part, 2"),
    _at_least("trace: half of the bursts at 0.5 dB", counted("lines", "trace at 0.5 dB"), ("lines",), 0.5, 0.5, "specification, combs 1"),
    *(
        _each_hour(f"false lines of {stage}, each kHz hour", counted("lines", f"false by {stage}"), ("lines",), 1.5, 1.5, "specification, lines, second part, 1")
        for stage in ("track", "trace")
    ),
    _each_hour("ids beyond one a line", counted("lines", "ids beyond"), ("lines",), 0.25, 0.25, "specification, lines, second part, 3"),
    *(
        _at_least(f"{what} by {stage}", counted("lines", f"{what} by {stage}"), ("lines",), band, band, "specification, lines, second part, 6")
        for stage in ("track", "trace") for what, band in (("teeth", 0.9), ("families", 0.95))
    ),
    _at_least("track: lines of ten minutes at -7 dB", counted("lines", "track at -7 dB"), ("lines",), 0.5, 0.5, "specification, combs 1"),
    _at_least("trace: lines of ten minutes at -10 dB", counted("lines", "trace at -10 dB"), ("lines",), 0.5, 0.5, "specification, combs 1"),
    _at_least("shafts named", counted("lines", "shafts"), ("lines",), 0.95, 0.95, "specification, lines, second part, 5"),
    Rate("directions within 1.96", counted("arrays", "directions within 1.96"), ("arrays",), HONEST, HONEST, "specification, arrays"),
    Rate("directions within .6745", counted("arrays", "directions within 0.6745"), ("arrays",), MEDIAN, MEDIAN, "specification, arrays"),
    _at_least("arrays: motions found", found(("arrays",)), ("arrays",), 0.98, 0.98, "specification, arrays"),
)  # fmt: skip
"""Every rate that is held. A limit beside its band: moved there when the band is met."""


def held(results: Results, parts: Sequence[str]) -> Iterator[str]:
    """Yield in words which rates miss their limit, of those whose parts were all run."""
    for rate in RATES:
        if not set(rate.parts) <= set(parts):
            continue
        counted = rate.count(results)
        if not rate.held(counted, rate.limit):
            yield f"{rate.name}: {words_of(rate, counted)}, limit {span(rate.limit)}"


def words_of(rate: Rate, counted: Counted) -> str:
    """Tell a count with its exact 95 % interval."""
    hits, of = counted
    if not of:
        return "none"
    if rate.is_share:
        low, high = binomial_interval(round(hits), round(of))
        return f"{hits:.0f} of {of:.0f} ({100 * low:.0f} to {100 * high:.0f} %)"
    low, high = (one / of for one in poisson_interval(round(hits)))
    return f"{hits / of:.2f} ({low:.2f} to {high:.2f}; {hits:.0f} in {of:.3g})"


def span(limit: tuple[float, float]) -> str:
    """Tell a limit."""
    low, high = limit
    if low <= 0.0:
        return f"<= {high:g}"
    if high >= 1.0:
        return f">= {low:g}"
    return f"{low:g} to {high:g}"
