"""Contacts that every sensor numbers on its own: which are one target."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.buoy_contacts import pairs_of, scene, score
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.target_motion.contact_pairing import pair_contacts
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.tma import estimate_motion

OPTIONS = TmaOptions(
    nuisances=NuisanceDeviations(sound_speed_mps=15.0),
    sound_speed_mps=1500.0,
    is_table=True,
)


def joined(pairings):
    """Return the contacts of every target, as sensor/number."""
    return [pairings.members(int(n))[0] for n in np.unique(pairings.contact)]


@pytest.mark.parametrize(
    ("seed", "given"),
    [(4100, {}), (4200, {"alter": True}), (4300, {"boats": 3, "frequencies": True})],
    ids=["straight", "altering", "frequencies"],
)
def test_contacts_with_random_numbers_are_joined_as_the_boats_were(seed, given):
    series, boat_of, _ = scene(seed, rows=20, **given)
    _, pairings = pair_contacts(series, OPTIONS, "auto")
    right, pairs = pairs_of(boat_of, joined(pairings))
    assert right == pairs > 3
    assert (pairings.share[pairings.is_member] > 0.5).all()


def test_ellipses_of_joined_contacts_hold_the_boats():
    one = score(4102, rows=20)
    assert one.held == one.ellipses == one.due == 2


def test_the_order_of_sensors_and_their_names_do_not_matter():
    series, _, _ = scene(4101, rows=20, buoys=3)
    turned = {"b0": "z", "b1": "y", "b2": "x"}
    other = replace(
        series,
        sensor=np.array([turned[one] for one in series.sensor]),
        sensor_id=np.array([turned[one] for one in series.sensor_id]),
    )
    first, second = (pair_contacts(one, OPTIONS, "own")[1] for one in (series, other))
    back = {new: old for old, new in turned.items()}
    found = {
        frozenset(f"{back[s]}/{n}" for s, n in (m.split("/") for m in words.split()))
        for words in joined(second)
    }
    assert found == {frozenset(words.split()) for words in joined(first)}


def test_numbers_that_are_common_are_honoured():
    series, _, _ = scene(4100, rows=20, buoys=2)
    same, pairings = pair_contacts(series, OPTIONS, "common")
    assert pairings is None
    assert same is series
    told = replace(series, contact_numbers="common")
    assert pair_contacts(told, OPTIONS, "auto")[1] is None
    assert pair_contacts(told, OPTIONS, "own")[1] is not None


def test_two_contacts_that_say_the_same_share_a_pairing_evenly():
    series, boat_of, _ = scene(4100, boats=1, rows=60, miss=0.0)
    number = next(n for s, n in boat_of if s == "b0")
    twin = series.take("row", np.flatnonzero(series.sensor == "b0"))
    twin = replace(twin, contact=np.full(twin.time_s.size, number % 9 + 1))
    both = type(series).join([series, twin])
    _, pairings = pair_contacts(both, OPTIONS, "own")
    (target,) = (
        n for n in np.unique(pairings.contact) if " " in pairings.members(int(n))[0]
    )
    shares = pairings.share[(pairings.contact == target) & (pairings.sensor == "b0")]
    np.testing.assert_allclose(shares, [0.5, 0.5], atol=0.01)


def test_a_contact_that_broke_is_joined_again():
    series, _, _ = scene(4100, boats=1, rows=40, miss=0.0)
    is_later = (series.sensor == "b1") & (series.time_s > 700.0)
    broken = replace(series, contact=np.where(is_later, 77, series.contact))
    paired, pairings = pair_contacts(broken, OPTIONS, "own")
    assert len(joined(pairings)) == 1
    assert "b1/77" in joined(pairings)[0]
    assert np.unique(paired.contact).size == 1


def test_boats_far_apart_are_not_joined():
    series, boat_of, _ = scene(4110, rows=20, miss=0.0)
    kept = [
        boat_of[str(s), int(n)] == (0 if str(s) in {"b0", "b1"} else 1)
        for s, n in zip(series.sensor, series.contact, strict=True)
    ]
    halves = series.take("row", np.flatnonzero(kept))
    _, pairings = pair_contacts(halves, OPTIONS, "own")
    words = " ".join(f"({one})" for one in joined(pairings))
    assert not any("b0" in one and "b2" in one for one in joined(pairings)), words


def test_results_say_what_was_joined():
    series, boat_of, _ = scene(4100, boats=1, rows=20, miss=0.0)
    members = " ".join(sorted(f"{s}/{n}" for s, n in boat_of))
    for found in (
        locate_vessels(series=series, at=["600"]),
        estimate_motion(series, updates=1),
    ):
        assert found.sensor_contacts.tolist() == [members]
        assert found.pairing_probability[0] > 0.95
        assert members in found.statement
        assert found.pairing_number.size == 4
