"""A table of contacts with own ship's navigation, as pairs in the order of scans.

**Conventions.** Compass bearings in, mathematical radians out. Own ship's position is
linear between the rows of its navigation; where she turns, what the rows leave open of
her position and velocity is added to the variances of the scan. Times are brought to one
clock when both tables know their UTC.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.contacts import Contacts
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.discrimination.contact_filters import Observation
from uwtrack_cli.discrimination.options import ContactErrors
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
        msg = f"two contacts or more are needed, the table has {numbers.size}."
        raise DataError(msg)
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
            msg = f"contact {number} has two measurements at {when:g} s."
            raise DataError(msg)
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
    return [
        _pair(a, b, tables[a], tables[b], times) for a, b in combinations(tables, 2)
    ]


def _pair(
    a: int,
    b: int,
    first: list[Observation],
    second: list[Observation],
    times: FloatArray,
) -> ContactPair:
    has = np.array(
        [[np.isfinite(s.measured).all() for s in t] for t in (first, second)]
    )
    both = np.flatnonzero(has.all(axis=0))
    if both.size < 2:
        msg = (
            f"contacts {a} and {b} share {both.size} complete scans (range, bearing and "
            "range rate at the same time); two or more are needed."
        )
        raise DataError(msg)
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


def _measurements(
    contacts: Contacts, errors: ContactErrors
) -> tuple[FloatArray, FloatArray]:
    """Return range, bearing, range rate in radians and m, and their variances."""
    for name in ("range_m", "time_s"):
        values = getattr(contacts, name)
        bad = (
            np.flatnonzero(values <= 0.0)
            if name == "range_m"
            else np.flatnonzero(~np.isfinite(values))
        )
        if bad.size:
            msg = f"row {bad[0] + 1} of the contacts: {name} is {values[bad[0]]}."
            raise DataError(msg)
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
        ((change_mps * axis[:, None]).sum(axis=-1) ** 2).sum(axis=1) / 6.0
        for axis in (line, side)
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
        msg = (
            f"row {bad[0] + 1} of the contacts: {name} is {values[bad[0]]}; give a "
            f"deviation above 0, or errors.{name} (--errors-{name.replace('_', '-')})."
        )
        raise DataError(msg)
    return np.where(np.isfinite(values), values, 1.0)
