"""Whether two closest approaches are those of one vessel: asked in one place.

**Method.** Contacts of one recording, frames of several lengths, recordings that overlap and
looks at live sound report passages more than once. Two reports are held against each other
by the odds that one vessel has made both: the density of their difference, with the
variances of both and the errors that no variance knows, over that of two vessels that
passed by themselves at a stated rate. What either does not know says nothing. So reports
with wide standard deviations need not be near, sharp ones must be, and a busy place needs
more to take two for one.

Errors that no variance knows are those of frames that are long beside R/v and of lines that
were tracked apart: `studies/constants/same_passage.py` draws them.

**Conventions.** Nepers, positive for one vessel; symmetric in both reports. Times are those
of closest approach, in one clock.

**References.** Bar-Shalom and Tian (2011), Tracking and Data Fusion, section 9.5
(likelihood ratio of track-to-track association); Kass and Raftery (1995).
"""

from collections.abc import Iterator, Sequence
from math import exp, hypot, isfinite, log, nan, pi, sqrt
from typing import NamedTuple

PASSAGES_PER_HOUR = 12.0
"""Passages of other vessels, as in a harbour: one in five minutes."""

MODEL_SHARE, MODEL_DEG = 0.05, 3.0
"""Standard deviation of the errors that no variance knows: share of R/v and of the speed, and
degrees of bearing. Of 60 drawn passages whose lines were parted all lie within 0.22."""

USUAL_WIDTH_S = 30.0
"""R/v that is assumed for those errors where neither report knows it, s."""

OUTLIERS, OUTLIER_SCALE = 0.05, 3.0
"""Share of the reports whose errors are larger, and how many times."""

LOG_WIDTH_STD, LOG_SPEED_STD = 1.0, 0.6
"""Standard deviations of the logarithms of R/v and speed among vessels."""

LINE_SHARE, NO_LINE_IN_COMMON = 5e-3, -10.0
"""Share by which rest frequencies of one line differ, and nepers of two reports that have
lines and none in common."""


class PassageReport(NamedTuple):
    """What is reported of a passage; nan is unknown."""

    time_s: float
    """Time of closest approach, s."""
    time_std_s: float = nan
    """Its standard deviation, s."""
    range_over_speed_s: float = nan
    """Slant range over speed, s."""
    range_over_speed_std_s: float = nan
    """Its standard deviation, s."""
    speed_mps: float = nan
    """Speed, m/s."""
    speed_std_mps: float = nan
    """Its standard deviation, m/s."""
    bearing_deg: float = nan
    """Bearing at closest approach, degrees."""
    bearing_std_deg: float = nan
    """Its standard deviation, degrees."""
    rest_frequencies_hz: Sequence[float] = ()
    """Rest frequencies of its lines, Hz, where both reports tell of the same lines."""


def same_vessel(one: PassageReport, other: PassageReport) -> float:
    """Return the log odds that two reports are of one vessel.

    Parameters
    ----------
    one, other
        Closest approaches, in one clock.

    Returns
    -------
    float
        Nepers; above zero they rather are one.
    """
    return sum(_terms(one, other))


def _terms(one: PassageReport, other: PassageReport) -> Iterator[float]:
    """Yield what each quantity says, nepers."""
    widths = [w for r in (one, other) if isfinite(w := r.range_over_speed_s)]
    width_s = min(widths, default=USUAL_WIDTH_S)
    std_s = _spread(one.time_std_s, other.time_std_s, MODEL_SHARE * width_s)
    yield _log_density(one.time_s - other.time_s, std_s) - log(PASSAGES_PER_HOUR / 3600.0)
    for name, std_name, usual in (
        ("range_over_speed_s", "range_over_speed_std_s", LOG_WIDTH_STD),
        ("speed_mps", "speed_std_mps", LOG_SPEED_STD),
    ):
        values = getattr(one, name), getattr(other, name)
        if not all(isfinite(value) and value > 0.0 for value in values):
            continue
        shares = (getattr(one, std_name) / values[0], getattr(other, std_name) / values[1])
        apart, std = log(values[0] / values[1]), _spread(*shares, MODEL_SHARE)
        # two vessels differ by what speeds and ranges do, and by the errors of both
        yield _log_density(apart, std) - _log_normal(apart, hypot(std, sqrt(2.0) * usual))
    apart_deg = (one.bearing_deg - other.bearing_deg + 180.0) % 360.0 - 180.0
    if isfinite(apart_deg):
        std_deg = _spread(one.bearing_std_deg, other.bearing_std_deg, MODEL_DEG)
        yield _log_density(apart_deg, std_deg) + log(360.0)
    yield _lines_in_common(one.rest_frequencies_hz, other.rest_frequencies_hz)


def _lines_in_common(one: Sequence[float], other: Sequence[float]) -> float:
    """Return what rest frequencies say: lines of one machine are found again."""
    if not (len(one) and len(other)):
        return 0.0
    is_common = any(abs(a / b - 1.0) <= LINE_SHARE for a in one for b in other)
    return 0.0 if is_common else NO_LINE_IN_COMMON


def _spread(one: float, other: float, model: float) -> float:
    """Return the standard deviation of a difference; what is not stated is zero."""
    return hypot(*(value for value in (one, other, model) if isfinite(value)))


def _log_density(apart: float, std: float) -> float:
    """Return the log density of a difference, of which some have larger errors."""
    usual = log(1.0 - OUTLIERS) + _log_normal(apart, std)
    larger = log(OUTLIERS) + _log_normal(apart, OUTLIER_SCALE * std)
    most = max(usual, larger)
    return most + log(exp(usual - most) + exp(larger - most))


def _log_normal(apart: float, std: float) -> float:
    return -0.5 * (apart / std) ** 2 - log(std) - 0.5 * log(2.0 * pi)
