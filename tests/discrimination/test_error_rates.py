"""Wald's law: a sequential test errs no oftener than accepted, averaged over drawn pairs."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import binom

from studies.repeater import RepeaterScene
from tests.draws.contact_pairs import (
    BEARING_STD_DEG,
    MOTIONS,
    SCENE,
    contact_pair,
    error_rates,
    two_vessels,
)
from uwtrack_cli.discrimination.discriminate import discriminate_contacts

ROWS = list(product((True, False), BEARING_STD_DEG))


def _holds(count, total, accepted):
    """Return whether a count is within the exact 95 % limit of an accepted share."""
    return binom.sf(count - 1, total, accepted) > 0.025


def _rows_hold(seed, pairs, data, has_history, motion="as assumed"):
    for row in error_rates(seed, pairs, motion, data, has_history=has_history):
        assert _holds(row.wrong, pairs, row.error)
        # Two filters of the right reading, at a tenth of the accepted error each.
        assert _holds(row.neither, pairs, 0.2 * row.error)
        assert row.right > 10 * row.wrong


@pytest.mark.parametrize(("has_history", "data"), ROWS)
def test_errors_are_those_accepted(data, has_history):
    _rows_hold(5, 100, data, has_history)


@pytest.mark.long
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(("has_history", "data"), ROWS)
def test_errors_of_many_pairs_are_those_accepted(data, has_history, motion):
    _rows_hold(1000, 2000, data, has_history, motion)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [SCENE, RepeaterScene(aspect_deg=80.0)])
@pytest.mark.parametrize("has_history", [True, False])
def test_the_expected_number_of_scans_is_the_number_taken(scene, has_history):
    found = []
    for seed in range(15):
        contacts, navigation = contact_pair(scene, seed=seed)
        if not has_history:
            late = np.flatnonzero(contacts.time_s > 59.9)
            contacts = contacts.take("row", late)
        found.append(discriminate_contacts(contacts, navigation))
    expected = np.mean([one.expected_scans[0] for one in found])
    taken = np.array([one.decision_scan[0] for one in found])
    assert taken.all()
    # Four deviations of a mean of fifteen, and half a scan that is no fraction.
    spread = 4.0 * taken.std() / np.sqrt(taken.size)
    assert abs(expected - taken.mean()) < 0.5 + spread


@pytest.mark.slow
def test_two_vessels_are_named_with_an_earlier_contact_as_often_as_without():
    named = [two_vessels(40, 20, has_history=h)["both move"] for h in (True, False)]
    assert named[0] >= named[1] - 2
    assert named[0] >= 9
