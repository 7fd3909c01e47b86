"""`diff` sees numbers, not bytes: what differs, by how much, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import HistoryStep, read_product, write_product
from uwtrack_cli.flow.comparison import compare_products
from uwtrack_cli.flow.scoring.tolerances import read_closeness, read_requirements

ONE = {"time_s": 100.0, "course_deg": 359.9, "side": "port", "time_utc_ns": 10**18}
SENSOR = Sensor(id="h1", latitude=35.0, longitude=128.5)


@pytest.fixture
def differences(tmp_path):
    """Write two products and return what differs, by quantity."""

    def compare(first, second, **options):
        for name, containers in (("a.h5", first), ("b.h5", second)):
            steps = [HistoryStep.now("cpa", {"name": name})]
            write_product(tmp_path / name, containers, history=steps, overwrite=True)
        with read_product(tmp_path / "a.h5") as a, read_product(tmp_path / "b.h5") as b:
            return {d.quantity: d for d in compare_products(a, b, **options)}

    return compare


def changed(**values):
    return encounters_of({**ONE, **values})


def test_what_made_a_file_does_not_count(differences):
    assert differences([changed(), SENSOR], [changed(), SENSOR]) == {}


def test_a_changed_number_is_told_with_its_size(differences):
    found = differences([changed()], [changed(time_s=100.5)])
    assert set(found) == {"time_s"}
    assert found["time_s"].largest == pytest.approx(0.5)
    assert found["time_s"].largest_relative == pytest.approx(0.5 / 100.5)


@pytest.mark.parametrize(
    ("options", "same"),
    [
        ({"atol": 0.6}, True), ({"atol": 0.4}, False),
        ({"rtol": 0.006}, True), ({"rtol": 0.004}, False),
    ],
    ids=str,
)  # fmt: skip
def test_tolerances_are_absolute_or_relative(differences, options, same):
    found = differences([changed()], [changed(time_s=100.5)], **options)
    assert (found == {}) is same


def test_angles_are_compared_around_the_circle(differences):
    found = differences([changed()], [changed(course_deg=0.1)])
    assert found["course_deg"].largest == pytest.approx(0.2)


def test_epochs_are_compared_in_seconds_and_never_relatively(differences):
    later = changed(time_utc_ns=10**18 + 2_000_000)
    assert differences([changed()], [later], atol=0.003) == {}
    found = differences([changed()], [later], rtol=0.1)
    assert found["time_utc_ns"].largest == pytest.approx(0.002)


def test_nan_agrees_with_nan_and_with_nothing_else(differences):
    found = differences([changed()], [changed(speed_mps=5.0)], atol=1e9)
    assert set(found) == {"speed_mps"}
    assert "known in one only" in found["speed_mps"].reason


def test_ragged_tables_are_compared_by_their_numbers(differences):
    one, other = (
        replace(
            changed(), ambiguity_encounter=[0], ambiguity_side=["port"], ambiguity_weight=[weight]
        )
        for weight in (0.5, 0.5000001)
    )
    assert set(differences([one], [other])) == {"ambiguity_weight"}
    assert differences([one], [other], rtol=1e-3) == {}


def test_a_changed_text_or_fact_is_told(differences):
    found = differences(
        [changed(), SENSOR],
        [changed(side="starboard"), replace(SENSOR, latitude=None, depth_m=4.0)],
    )
    assert set(found) == {"side", "latitude", "depth_m"}


def test_another_number_of_rows_is_told_by_its_shape(differences):
    found = differences([changed()], [encounters_of(ONE, ONE)])
    assert found["time_s"].reason == "has shape (1,) and (2,)"


def test_a_missing_container_is_told(differences):
    found = differences([changed(), SENSOR], [changed()])
    assert found[""].table == "sensor"


def test_tolerances_per_quantity_override_the_others(differences, tmp_path):
    path = tmp_path / "t.toml"
    path.write_text("[encounters]\ntime_s = { atol = 1.0 }\n")
    one, other = changed(), changed(time_s=100.5, course_deg=3.0)
    found = differences([one], [other], tolerances=read_closeness(path))
    assert set(found) == {"course_deg"}


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("encounters = 3\n", DataError, "one section per table"),
        ("[encounters]\ntime_s = 3\n", DataError, "time_s must be a table"),
        ("[encounters]\ntime_s = { tol = 3 }\n", DataError, "Did you mean 'rtol'"),
        ("[encounters]\ntime_s = { atol = -3 }\n", DataError, "atol must be a number"),
        ("[encounters\n", DataError, "no valid TOML"),
    ],
    ids=["container", "quantity", "key", "negative", "syntax"],
)
def test_a_wrong_tolerance_file_is_refused(tmp_path, text, error, words):
    path = tmp_path / "t.toml"
    path.write_text(text)
    with pytest.raises(error, match=words):
        read_closeness(path)


def test_requirements_have_limits_and_counts(tmp_path):
    path = tmp_path / "t.toml"
    path.write_text("[encounters]\nmissed = 0\nspeed_mps = { percent = 2 }\n")
    wanted = read_requirements(path)
    assert wanted.missed == 0
    assert wanted.false is None
    limits = wanted.limits["encounters"]["speed_mps"]
    assert limits.excess(0.5, 2.5, 99.0) == "percent 2.5 > 2"
    assert limits.excess(0.5, -1.5, 99.0) == ""
    assert limits.excess(0.5, np.nan, 99.0) != ""
