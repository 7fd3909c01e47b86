"""Contacts that every sensor numbers on its own: which are one target."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.draws.buoy_contacts import pairs_of, scene, score
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.container_tables import write_table
from uwtrack_cli.files.tables.series import read_series
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.target_motion.contact_pairing import pair_contacts
from uwtrack_cli.motion.target_motion.error_budget import NuisanceDeviations
from uwtrack_cli.motion.target_motion.modes import TmaOptions
from uwtrack_cli.motion.tma import estimate_motion

OPTIONS = TmaOptions(
    nuisances=NuisanceDeviations(sound_speed_mps=15.0), sound_speed_mps=1500.0, is_table=True
)


def joined(pairings):
    """Return the contacts of every target, as sensor/number."""
    return [pairings.members(int(n))[0] for n in np.unique(pairings.contact)]


@pytest.mark.parametrize(
    ("seed", "given"),
    [(4100, {}), (300, {"alter": True}), (4300, {"boats": 3, "frequencies": True})],
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


def test_a_way_through_the_very_place_of_a_buoy_tells_no_alteration():
    # what a change would tell there is lost to rounding, and warned of (an error here)
    one = score(9801)
    assert one.right == one.pairs == 9


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


@pytest.mark.parametrize("numbers", ["own", "common"])
def test_a_table_printed_and_read_again_says_whose_its_numbers_are(numbers, tmp_path):
    series, _, _ = scene(4100, rows=5, buoys=2)
    path = tmp_path / "t.csv"
    path.write_text("\n".join(write_table(replace(series, contact_numbers=numbers), "csv")))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the origin of the grid is no column of a table
        assert read_series(path).contact_numbers == numbers


def test_two_contacts_that_say_the_same_share_a_pairing_evenly():
    series, boat_of, _ = scene(4100, boats=1, rows=60, miss=0.0)
    number = next(n for s, n in boat_of if s == "b0")
    twin = series.take("row", np.flatnonzero(series.sensor == "b0"))
    twin = replace(twin, contact=np.full(twin.time_s.size, number % 9 + 1))
    both = type(series).join([series, twin])
    _, pairings = pair_contacts(both, OPTIONS, "own")
    (target,) = (n for n in np.unique(pairings.contact) if " " in pairings.members(int(n))[0])
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
    for found in (locate_vessels(series=series, at=["600"]), estimate_motion(series, updates=1)):
        assert found.sensor_contacts.tolist() == [members]
        assert found.pairing_probability[0] > 0.95
        assert members in found.statement
        assert found.pairing_number.size == 4


def directions_of(series, name, **given):
    """Return what an array of that name heard of a scene, as its directions."""
    rows = np.flatnonzero(series.sensor == name)
    time, frame = np.unique(series.time_s[rows], return_inverse=True)
    nothing = np.full(rows.size, np.nan)
    empty = np.zeros(0)
    number = np.array([np.sum(frame[:k] == f) + 1 for k, f in enumerate(frame)])
    return Directions(
        frame=frame, time_s=time[frame], bearing_deg=series.bearing_deg[rows],
        bearing_std_deg=series.bearing_std_deg[rows], elevation_deg=nothing,
        elevation_std_deg=nothing, slowness_ratio=nothing, slowness_ratio_std=nothing,
        snr_db=nothing, level_db=nothing, range_m=nothing, range_std_m=nothing,
        source=number, lobe_frame=np.zeros(0, np.int64), lobe_bearing_deg=empty,
        lobe_elevation_deg=empty, lobe_weight=empty, false_alarm_probability=1e-3,
        band_low_hz=10.0, band_high_hz=100.0, ambiguity="elevation",
        reference="full scale", sensor=name, **{"method": "beams", **given},
    )  # fmt: skip


def test_directions_of_several_arrays_are_located_together():
    series, _, places = scene(4100, boats=1, rows=30, miss=0.0, drift_mps=0.0)
    names = sorted(set(series.sensor.tolist()))
    first = {name: int(np.flatnonzero(series.sensor == name)[0]) for name in names}
    sensors = [
        Sensor(
            id=name, kind="array", channels="a,b,c", compass_std_deg=5.0,
            east_m=float(series.sensor_east_m[row]),
            north_m=float(series.sensor_north_m[row]),
        )
        for name, row in first.items()
    ]  # fmt: skip
    heard = [directions_of(series, name) for name in names]
    found = locate_vessels(sensors=sensors, directions=heard, at=["600"])
    assert found.sensor_contacts.tolist() == ["b0/1 b1/1 b2/1 b3/1"]
    off = np.array([found.east_m[0], found.north_m[0]]) - places[0]
    assert off @ np.linalg.solve(found.covariance_m2[0], off) < 5.99
    with pytest.raises(DataError, match="one side of its plane"):
        locate_vessels(
            sensors=sensors, directions=[replace(heard[0], ambiguity="plane"), *heard[1:]]
        )


def test_rows_without_values_and_deviations_are_no_obstacle():
    series, _, _ = scene(4100, rows=20, buoys=3)
    nothing = np.full(series.time_s.size, np.nan)
    untold = replace(
        series,
        bearing_deg=np.where(series.sensor == "b1", np.nan, series.bearing_deg),
        bearing_std_deg=nothing,
        sensor_compass_std_deg=np.full(3, np.nan),
    )
    paired, pairings = pair_contacts(untold, OPTIONS, "own")
    assert "b1" not in set(pairings.sensor)
    assert set(np.unique(paired.contact)) == set(np.unique(pairings.contact))


def test_a_boat_that_passes_over_a_buoy_is_joined():
    # its bearings turn by half within a block: of a way through the place itself
    series, boat_of, _ = scene(1003, rows=40)
    _, pairings = pair_contacts(series, OPTIONS, "own")
    right, pairs = pairs_of(boat_of, joined(pairings))
    assert right == pairs == 6


def test_bearings_that_say_nothing_leave_the_odds_of_the_prior():
    # one contact of each of two sensors: one target heard by both, or two heard by one.
    # With a share of heard ones that may be any, 1/3 to 1/30: Beta(3, 1) and Beta(3, 3)
    series, _, _ = scene(4100, boats=1, buoys=2, rows=3, miss=0.0)
    vague = replace(series, bearing_std_deg=np.full(series.time_s.size, 1e5))
    _, pairings = pair_contacts(vague, OPTIONS, "own")
    share = pairings.share[pairings.contact == pairings.contact[0]]
    np.testing.assert_allclose(share.min(), 10.0 / 11.0, atol=0.01)
