"""Tables: what people's CSV holds is read or refused by its line; rows come out."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.base import reason_columns
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError, UwtrackError, UwtrackNote, UwtrackWarning
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.tables.container_tables import FORMATS, json_rows, write_table
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.series import read_series


@pytest.fixture
def table(tmp_path):
    """Write a CSV file and return its path."""

    def write(text):
        (tmp_path / "t.csv").write_bytes(text.encode())
        return tmp_path / "t.csv"

    return write


def test_documented_columns_are_read(table):
    series = read_series(
        table(
            "contact,time_s,bearing_deg,bearing_std_deg,frequency_hz,frequency_std_hz,"
            "frequency_hz_2,level_db,level_std_db\n"
            "1,0,10,1,63,.1,126,100,2\n2,0,-20,1,,.1,nan,,2\n1,5,11,1,62,.1,125,99,2\n"
        )
    )
    assert series.contact.tolist() == [1, 2, 1]
    assert series.bearing_deg.tolist() == [10.0, 340.0, 11.0]
    expected = [[63.0, 126.0], [np.nan, np.nan], [62.0, 125.0]]
    np.testing.assert_array_equal(series.frequency_hz, expected)
    assert np.isnan(series.frequency_std_hz[:, 1]).all()
    assert series.frequency_std_hz[:, 0].tolist() == [0.1] * 3
    np.testing.assert_array_equal(series.level_db, [100.0, np.nan, 99.0])
    assert series.start_utc_ns is None


@pytest.mark.parametrize(
    "text",
    [
        "time_s,bearing_deg\n0,1\n1,2\n",
        "\ufeffTime_s , Bearing deg\n0,1\n1,2\n",
        "# a comment\n\nTIME_S;BEARING_DEG\n# more\n0;1\n1;2\n\n",
        "time_s\tbearing_deg\r\n0\t1\r\n1\t2\r\n",
        '"time_s","bearing_deg"\n"0","1"\n"1"," 2"\n',
    ],
    ids=["plain", "bom", "comments", "tabs", "quotes"],
)
def test_header_is_read_however_it_is_written(text, table):
    assert read_series(table(text)).bearing_deg.tolist() == [1.0, 2.0]


def test_utc_times_are_exact_and_count_from_the_first_row(table):
    text = (
        "index,doppler_offset,timestamp,frequency_hz\n"
        "0,2239.9,2018-01-13T16:12:01.862011Z,145882239.9675292969\n"
        "1,2232.4,2018-01-13T16:12:01.962011Z,145882232.4924316406\n"
    )
    with pytest.warns(UwtrackWarning, match="not used: index, doppler_offset"):
        series = read_series(table(text))
    assert series.start_utc_ns == 1_515_859_921_862_011_000
    np.testing.assert_allclose(series.time_s, [0.0, 0.1], atol=1e-15)
    assert series.frequency_hz[0, 0] == 145882239.9675292969
    assert np.isnan(series.frequency_std_hz).all()


def test_time_zero_of_two_time_columns_is_that_of_seconds(table):
    head = "time_s,time_utc,level_db\n"
    rows = "10,2020-01-01T00:00:10Z,1\n11,2020-01-01T00:00:11Z,1\n"
    series = read_series(table(head + rows))
    assert series.start_utc_ns == 1_577_836_800_000_000_000
    with pytest.raises(DataError, match="line 3: time_s and time_utc disagree"):
        read_series(table(head + rows.replace("11Z", "12Z")))


def test_a_deviation_that_the_table_does_not_state_is_none(table):
    text = "time_s,bearing_deg,bearing_std_deg\n0,1,2\n1,2,\n"
    np.testing.assert_array_equal(read_series(table(text)).bearing_std_deg, [2, np.nan])


BAD = {
    "": "is empty",
    "\n#x\n": "no line with column names",
    "time_s,bearing_deg\n": "no rows",
    "bearing_deg\n1\n": "lacks the column time_s or time_utc",
    "time_s\n1\n": "lacks the column bearing_deg, frequency_hz or level_db",
    "time_s,bearng_deg,level_db\n1,2,3\n": "did you mean 'bearing_deg'",
    "time_s,level_db,level_db\n1,2,3\n": "named twice",
    "time_s,level_db\n0,1\nlost it\n": "line 3: 1 cells, 2 columns: 'lost it' is no row",
    "# c\ntime_s,level_db\n0,1\n1,x\n": "line 4: level_db must be a number, got 'x'",
    "time_s,level_db\n0,1\n1,inf\n": "line 3: level_db must be a finite number",
    "time_s,level_db\nnan,1\n": "line 2: time_s must be a finite number",
    "time_s,level_db\n,1\n": "line 2: time_s must be a number",
    "time_s,level_db\n1,1\n1,2\n": "line 3: time 1 s is not later than 1 s",
    "contact,time_s,level_db\n1,1,1\n2,1,1\n1,1,2\n": "line 4: time 1 s is not later",
    "contact,time_s,level_db\n1.5,1,1\n": "line 2: contact must be a whole number",
    "contact,time_s,level_db\n0,1,1\n": "line 2: contact must be",
    "time_s,bearing_deg\n0,400\n": "from -360 to 360",
    "time_s,frequency_hz\n0,-5\n": "line 2: frequency_hz must be",
    "time_s,frequency_hz_2\n0,5\n": "lacks the column frequency_hz",
    "time_s,bearing_deg,bearing_std_deg\n0,5,0\n": "line 2: bearing_std_deg must be",
    "time_s,time_utc,level_db\n9e9,1700-01-01T00:00:00Z,5\n": "centuries from time_utc",
    "time_utc,level_db\nyesterday,5\n": "line 2: time_utc: 'yesterday' is no time",
    "time_utc,level_db\n2020-02-30T00:00:00Z,5\n": "line 2: time_utc",
    'time_s,level_db\n0,"1\n': "no CSV table",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_table_is_refused_with_its_line(text, table):
    with pytest.raises(DataError) as caught:
        read_series(table(text))
    assert BAD[text] in str(caught.value)
    assert "t.csv" in str(caught.value)


def test_binary_file_is_no_table(tmp_path):
    (tmp_path / "t.csv").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(DataError, match="no CSV table"):
        read_series(tmp_path / "t.csv")


def test_bearings_that_look_like_radians_are_remarked_on(table):
    rows = "".join(f"{i},{i * 0.3}\n" for i in range(20))
    with pytest.warns(UwtrackWarning, match="radians"):
        read_series(table("time_s,bearing_deg\n" + rows))


@settings(max_examples=60, deadline=None)
@given(text=st.text(max_size=30), place=st.integers(0, 60))
def test_any_damage_of_a_table_is_an_error_of_ours_or_none(text, place, tmp_path_factory):
    path = tmp_path_factory.mktemp("t") / "t.csv"
    good = "time_s,time_utc,frequency_hz,level_db\n0,2020-01-01T00:00:00Z,5,6\n"
    damaged = good[:place] + text + good[place:]
    path.write_bytes(damaged.encode("utf-8", "surrogatepass"))
    for read in (read_series, read_navigation):
        try:
            read(path)
        except (UwtrackError, UwtrackWarning) as error:
            assert str(error)  # noqa: PT017


def test_positions_on_a_local_grid_are_taken_as_they_are(table):
    text = "time_s,east_m,north_m,heading_deg\n0,1,2,-10\n5,3,4,\n"
    navigation = read_navigation(table(text))
    assert navigation.east_m.tolist() == [1.0, 3.0]
    np.testing.assert_array_equal(navigation.heading_deg, [350.0, np.nan])
    assert navigation.origin_latitude is None


def test_latitude_and_longitude_become_metres_along_geodesics(table):
    """One minute of latitude at 45 degrees is 1852.2 m, of longitude 1314.2 m."""
    text = "time_s,lat,lon\n0,45,10\n1,45.0166666667,10\n2,45,10.0166666667\n"
    navigation = read_navigation(table(text))
    np.testing.assert_allclose(navigation.north_m, [0.0, 1852.25, 0.0], atol=0.3)
    np.testing.assert_allclose(navigation.east_m, [0.0, 0.0, 1314.2], atol=0.3)
    assert (navigation.origin_latitude, navigation.origin_longitude) == (45.0, 10.0)


@pytest.mark.parametrize("unit", ["speed_mps", "speed_kn"])
def test_speed_and_course_integrate_to_a_square(unit, table):
    speed = 10.0 if unit == "speed_mps" else 10.0 * 3600 / 1852
    rows = [(0, 0), (99.999, 0), (100, 90), (199.999, 90), (200, 180)]
    text = f"time_s,{unit},course_deg\n"
    text += "".join(f"{t},{speed},{c}\n" for t, c in rows)
    navigation = read_navigation(table(text))
    np.testing.assert_allclose(navigation.east_m, [0, 0, 0, 1000, 1000], atol=0.03)
    np.testing.assert_allclose(navigation.north_m, [0, 1000, 1000, 1000, 1000], atol=0.03)


BAD_NAVIGATION = {
    "time_s,heading_deg\n0,1\n": "no positions",
    "time_s,east_m\n0,1\n": "lacks the column north_m",
    "time_s,latitude\n0,1\n": "lacks the column longitude",
    "time_s,latitude,longitude\n0,91,1\n": "from -90 to 90",
    "time_s,speed_kn\n0,1\n": "lacks the column course_deg",
    "time_s,speed_kn,speed_mps,course_deg\n0,1,1,1\n": "twice",
    "time_s,speed_mps,course_deg\n0,500,1\n": "from 0 to 100",
    "time_s,speed_mps,course_deg\n0,-1,1\n": "from 0 to 100",
    "time_s,east_m,north_m\n0,1,1\n0,1,1\n": "line 3: time 0 s is not later",
    "time_s,east_m,north_m\n0,,1\n": "line 2: east_m must be a number",
}


@pytest.mark.parametrize("text", BAD_NAVIGATION)
def test_bad_navigation_is_refused(text, table):
    with pytest.raises(DataError) as caught:
        read_navigation(table(text))
    assert BAD_NAVIGATION[text] in str(caught.value)


@pytest.mark.parametrize("kind", CONTAINERS.values(), ids=list(CONTAINERS))
@pytest.mark.parametrize("n_rows", [0, 3])
def test_every_container_prints_in_every_format(kind, n_rows):
    container = synthetic(kind, n_rows)
    lines = {form: list(write_table(container, form)) for form in FORMATS}
    assert all("\n" not in line for form in FORMATS for line in lines[form])
    json.loads("\n".join(lines["json"]), parse_constant=pytest.fail)
    rows = [json.loads(line, parse_constant=pytest.fail) for line in lines["jsonl"]]
    cells = list(csv.reader(lines["csv"]))
    assert len({len(row) for row in cells}) == 1
    assert len(cells) == len(rows) + 1
    assert len(rows) == (len(json_rows(container)))
    if n_rows and kind.columns():
        assert len(lines["table"]) == len(rows) + 1
    assert "nan" not in "".join(lines["csv"])


def test_a_table_for_people_tells_the_range_of_what_is_too_much_to_look_at():
    overview = synthetic(CONTAINERS["overview"], 2)
    shade = np.array([[7] + 60 * [3], [0] + 60 * [9]], np.uint8)
    wide = replace(overview, frequency_hz=np.arange(61.0), shade=shade)
    _, first, second = write_table(wide)
    assert first.endswith("  3 to 7 (61 values)")
    assert second.endswith("  0 to 9 (61 values)")
    head, *_ = write_table(wide, "csv")
    assert head.endswith(",shade_60")


ENCOUNTER = """
    {"contact": 1, "sensor": "h1", "status": "ok", "time_utc": "...Z", "time_s": 612.4,
     "time_std_s": 0.1, "arrival_time_s": 612.6, "speed_mps": 5.9,
     "speed_std_mps": 0.02, "slant_range_m": 251.0, "slant_range_std_m": 1.2,
     "horizontal_range_m": 250.3, "range_over_speed_s": 42.5,
     "range_over_speed_std_s": 0.3, "course_deg": 81.0, "course_std_deg": 0.4,
     "bearing_deg": 171.0, "bearing_std_deg": 0.4, "side": "port",
     "rest_frequencies_hz": [63.0, 126.0], "rest_frequencies_std_hz": [0.002, 0.003],
     "sound_speed_mps": 1500.0, "received_level_db": 112.3, "extrapolated": false,
     "ambiguities": [], "reasons": {}, "received_level_std_db": 0.4,
     "source_level_db": 160.3, "source_level_std_db": 0.5, "spreading_db": 20.0,
     "level_reference": "1 uPa", "level_band_hz": [100.0, 1500.0],
     "horizontal_range_std_m": 1.3, "horizontal_range_over_speed_s": 42.4,
     "horizontal_range_over_speed_std_s": 0.3, "source_depth_m": 3.2, "source_depth_std_m": 0.4,
     "nuisances": {"source_depth_m": {"value": 3.1, "std": 1.9, "share": 0.02}},
     "rest_frame_evidence": 8.5, "misfit": 0.02, "probability": 0.97,
     "alternative": "line-levels", "alternative_probability": 0.02,
     "evidence": [{"alternative": "line-levels", "nepers": -0.4}],
     "vessel": {"name": "FERRY", "mmsi": "235000001", "probability": 0.98},
     "motion_model": "manoeuvre", "motion_model_probability": 0.9,
     "alternative_motion_model": {"motion_model": "frequency-step", "probability": 0.1},
     "change": {"time_s": 700.1, "time_std_s": 0.8, "follows": true, "frequency_change": null,
                "frequency_change_std": null, "frequency_slope_per_s": null,
                "frequency_slope_std_per_s": null, "other_leg_speed_mps": 4.1,
                "other_leg_speed_std_mps": 0.1, "other_leg_course_deg": 61.0,
                "other_leg_course_std_deg": 2.1, "turn_away_deg": null,
                "turn_away_std_deg": null, "turn_duration_s": null,
                "turn_duration_std_s": null, "turn_correlation": null},
     "covariance": [[0.01, 0.0, 0.0, 0.0], [0.0, 0.09, 0.0, 0.0],
                    [0.0, 0.0, 0.0004, 0.0], [0.0, 0.0, 0.0, 0.16]]}"""
FIX = """
    {"contact": 1, "mode": 1, "weight": 1.0, "time_utc": "...Z", "time_s": 1500.0,
     "east_m": 812.0, "north_m": -95.0, "latitude": 35.1, "longitude": 128.6,
     "east_std_m": 21.0, "north_std_m": 14.0,
     "covariance_m2": [[441.0, 3.1], [3.1, 196.0]],
     "speed_mps": 5.9, "course_deg": 81.0, "sensors": ["h1", "h2"]}"""


NO_AMBIGUITY = {"ambiguity_encounter": [], "ambiguity_side": [], "ambiguity_weight": []}


def test_encounter_has_the_documented_keys_types_and_order():
    documented = json.loads(ENCOUNTER)
    direct = {key: [value] for key, value in documented.items() if key in Encounters.columns()}
    change = documented["change"]
    times = {"change_time_s": change.pop("time_s"),
             "change_time_std_s": change.pop("time_std_s"),
             "change_follows": change.pop("follows")}  # fmt: skip
    known = {k: [np.nan if v is None else v] for k, v in (times | change).items()}
    direct |= known | {
        "alternative_motion_model": ["frequency-step"],
        "alternative_motion_model_probability": [0.1],
    }
    direct |= {"motion_model": ["manoeuvre"], "motion_model_probability": [0.9]}
    documented = json.loads(ENCOUNTER)
    container = synthetic(
        Encounters, 1, **direct, time_utc_ns=[1_577_836_800_123_456_789],
        **NO_AMBIGUITY, **reason_columns("reason_encounter", [{}]), rest_encounter=[0, 0], rest_line_id=[1, 2],
        rest_frequency_hz=[63.0, 126.0], rest_frequency_std_hz=[0.002, 0.003],
        evidence_encounter=[0], evidence_alternative=["line-levels"], evidence_nepers=[-0.4],
        nuisance_encounter=[0], nuisance_name=["source_depth_m"], nuisance_value=[3.1],
        nuisance_std=[1.9], nuisance_share=[0.02],
        vessel_name=["FERRY"], vessel_mmsi=["235000001"], vessel_probability=[0.98],
        spreading_db=20.0, reference="1 uPa", band_low_hz=100.0, band_high_hz=1500.0,
    )  # fmt: skip
    (row,) = json_rows(replace(container, sensor=["h1"]))
    assert list(row) == list(documented)
    assert row == documented | {"time_utc": "2020-01-01T00:00:00.123Z"}


def test_what_an_encounter_cannot_tell_is_null_with_its_reason():
    nan = float("nan")
    container = synthetic(
        Encounters, 1, speed_mps=[nan], side=[""], time_utc_ns=[-1],
        **NO_AMBIGUITY, **reason_columns("reason_encounter", [{"speed_mps": "no line"}]),
        rest_encounter=[], rest_line_id=[], rest_frequency_hz=[],
        rest_frequency_std_hz=[],
    )  # fmt: skip
    (row,) = json_rows(container)
    assert row["speed_mps"] is None
    assert row["side"] is None
    assert row["time_utc"] is None
    assert row["rest_frequencies_hz"] == []
    assert row["reasons"]["speed_mps"] == "no line"
    assert "start time" in row["reasons"]["time_utc"]
    assert list(write_table(synthetic(Encounters, 0), "json")) == ["[]"]


def test_fix_has_the_documented_keys_and_order():
    documented = json.loads(FIX)
    direct = {k: [v] for k, v in documented.items() if k in Fixes.columns()}
    direct |= {"sensors": ["h1,h2"], "time_utc_ns": [-1]}
    (row,) = json_rows(synthetic(Fixes, 1, **direct))
    further = [
        "motion_model",
        "motion_model_probability",
        "alternative_motion_model",
        "reasons",
        "sensor_contacts",
        "pairing_probability",
    ]
    assert list(row) == [*documented, *further]
    expected = documented | {"time_utc": None}
    assert {key: row[key] for key in expected} == expected


MOTION = """
    {"contact": 1, "mode": 1, "weight": 0.98, "time_utc": "...Z", "range_m": 20010.0,
     "range_std_m": 99.0, "bearing_deg": 45.0, "bearing_std_deg": 0.08,
     "speed_mps": 4.11, "speed_std_mps": 0.03, "course_deg": 270.1,
     "course_std_deg": 0.17, "rest_frequencies_hz": [650.0], "observable": true,
     "reasons": {}, "rest_frequencies_std_hz": [0.1], "time_s": 3.0,
     "range_low_m": 19800.0, "range_high_m": 20210.0, "speed_low_mps": 4.05,
     "speed_high_mps": 4.17, "course_low_deg": 269.8, "course_high_deg": 270.4,
     "covariance": [[9801.0, 0.0, 0.0, 0.0], [0.0, 0.0064, 0.0, 0.0],
                    [0.0, 0.0, 0.0009, 0.0], [0.0, 0.0, 0.0, 0.0289]],
     "ellipse_trusted": true, "now_time_s": 5994.0, "now_range_m": 32290.0,
     "now_range_std_m": 156.0, "now_bearing_deg": 296.0, "now_bearing_std_deg": 0.07,
     "now_speed_mps": 11.0, "now_speed_std_mps": 0.2, "now_course_deg": 131.0,
     "now_course_std_deg": 0.9,
     "misfit": 1995.0, "n_values": 2000,
     "nuisances": {"compass_deg": {"value": 0.0, "std": 1.0, "share": 0.05}},
     "motion_model": "straight", "manoeuvre_time_s": null, "manoeuvre_gain": 2.5,
     "manoeuvre_probability": 0.25,
     "legs": [{"number": 1, "start_s": 3.0, "end_s": 5994.0, "range_m": 20010.0,
               "range_std_m": 99.0, "bearing_deg": 45.0, "bearing_std_deg": 0.08,
               "speed_mps": 4.11, "speed_std_mps": 0.03, "course_deg": 270.1,
               "course_std_deg": 0.17, "alteration_time_s": null,
               "alteration_time_std_s": null}],
     "east_m": 100.0, "north_m": -20.0, "latitude": 35.0, "longitude": 129.0,
     "reference": "b1", "offsets_deg": {"b1": -1.5},
     "probability_of_rows": [1.0, 0.25], "sensor_contacts": "b1/2 b2/7",
     "pairing_probability": 0.75}"""


def test_motion_has_the_documented_keys_and_order():
    documented = json.loads(MOTION)
    direct = {k: [v] for k, v in documented.items() if k in Motions.columns()}
    direct |= {
        "motion_model": ["straight"],
        "time_utc_ns": [1_577_836_800_000_000_000],
        **reason_columns("reason_motion", [{}]),
    }
    container = synthetic(
        Motions, 1, **direct, rest_motion=[0], rest_line_id=[4],
        rest_frequency_hz=[650.0], rest_frequency_std_hz=[0.1],
        nuisance_motion=[0], nuisance_name=["compass_deg"], nuisance_value=[0.0],
        nuisance_std=[1.0], nuisance_share=[0.05],
        offset_motion=[0], offset_sensor=["b1"], offset_deg=[-1.5],
        row_contact=[1, 1], row_number=[1, 2], row_time_s=[3.0, 4.0],
        row_probability=[1.0, 0.25], row_residual_deg=[0.0, 9.0], leg_motion=[0],
        **{f"leg_{k}": [np.nan if v is None else v] for k, v in documented["legs"][0].items()},
    )  # fmt: skip
    (row,) = json_rows(container)
    assert list(row) == list(documented)
    assert row == documented | {"time_utc": "2020-01-01T00:00:00.000Z"}


def test_reasons_and_ambiguities_are_rows_of_their_own_and_print_as_objects():
    solutions = {
        "ambiguity_encounter": [1, 0, 1], "ambiguity_side": ["port", "starboard", ""],
        "ambiguity_weight": [0.25, 0.5, 0.125],
    }  # fmt: skip
    reasons = [{"speed_mps": "no line"}, {}, {"side": "no bearing", "course_deg": "Ø"}]
    container = synthetic(
        Encounters, 3, time_utc_ns=[1, 1, 1], vessel_name=["a", "b", "c"], **solutions,
        **reason_columns("reason_encounter", reasons),
    )  # fmt: skip
    rows = json_rows(container)
    assert [row["reasons"] for row in rows] == reasons
    assert [row["ambiguities"] for row in rows] == [
        [{"side": "starboard", "weight": 0.5}],
        [{"side": "port", "weight": 0.25}, {"side": "", "weight": 0.125}],
        [],
    ]
    turned = json_rows(container.take("encounter", np.array([2, 0])))
    assert [row["reasons"] for row in turned] == [reasons[2], reasons[0]]
    twice = json_rows(Encounters.join([container, container]))
    assert [row["reasons"] for row in twice] == [*reasons, *reasons]
    assert list(twice[4]["reasons"]) == list(reasons[1])


def test_a_decision_prints_its_reasons_as_the_text_that_scripts_know():
    found = synthetic(Decision, 2, **reason_columns("reason_pair", [{"history": "Ø"}, {}]))
    rows = json_rows(found)
    assert list(rows[0])[-2:] == ["observable", "reasons"]
    assert [row["reasons"] for row in rows] == ['{"history": "\\u00d8"}', "{}"]
    whole = json.loads("\n".join(write_table(found, "json")))
    assert whole["pair"] == rows
    assert "reason" not in whole


def test_rows_of_another_axis_can_be_asked_for():
    lines = synthetic(Lines, 3)
    rows = [json.loads(r) for r in write_table(lines, "jsonl", axis="line")]
    assert [row["line_id"] for row in rows] == lines.line_id.tolist()
    whole = json.loads("\n".join(write_table(lines, "json")))
    assert whole["line"] == rows
    assert whole["reference"] == "x"
    with pytest.raises(OptionError, match="no axis 'frog'; it has point, line"):
        write_table(lines, "csv", axis="frog")
    with pytest.raises(OptionError, match="unknown format"):
        write_table(lines, "xml")


def test_series_printed_as_csv_reads_back(tmp_path):
    text = "time_s,level_db\n0,1.0123456789012345\n1,\n"
    (tmp_path / "a.csv").write_text(text)
    series = read_series(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("\n".join(write_table(series, "csv")))
    assert read_series(tmp_path / "b.csv").equals(series)


def test_a_table_without_contacts_stays_one_when_it_is_printed_as_csv(tmp_path):
    text = "time_s,sensor,sensor_east_m,sensor_north_m,bearing_deg\n0,a,0,0,10\n0,b,9,0,20\n"
    (tmp_path / "a.csv").write_text(text)
    series = read_series(tmp_path / "a.csv")
    assert series.contact_numbers == "common"
    printed = "\n".join(write_table(series, "csv"))
    (tmp_path / "b.csv").write_text(printed)
    again = read_series(tmp_path / "b.csv")
    assert again.contact_numbers == "common"
    assert again.contact.tolist() == [1, 1]
    (tmp_path / "b.csv").write_text(printed.replace("common", "commune", 1))
    with pytest.raises(DataError, match="own or common"):
        read_series(tmp_path / "b.csv")


def test_sensor_prints_as_names_and_values():
    printed = list(write_table(Sensor(id="h1", depth_m=22.0)))
    assert "id                           h1" in printed
    assert "depth_m                      22" in printed
    assert "latitude" in printed


def test_a_series_is_written_as_it_is_read(tmp_path):
    written = tmp_path / "again.csv"
    source = tmp_path / "series.csv"
    source.write_text(
        "time_s,contact,bearing_deg,bearing_std_deg,frequency_hz,frequency_std_hz,"
        "frequency_hz_2,frequency_std_hz_2,level_db,level_std_db\n"
        "0,1,10.0,1.0,63.1,0.01,126.2,0.02,100.0,1.0\n"
        "1,1,,,63.0,0.01,,,101.0,1.0\n"
    )
    series = read_series(source)
    written.write_text("\n".join(write_table(series, "csv")) + "\n")
    assert written.read_text().startswith("contact,time_s")
    assert "frequency_hz,frequency_hz_2,frequency_std_hz,frequency_std_hz_2" in (
        written.read_text()
    )
    assert read_series(written).equals(series)


@pytest.mark.parametrize("radians", ["first", "last"])
def test_a_column_that_changes_from_degrees_to_radians_is_told_with_its_line(tmp_path, radians):
    path = tmp_path / "bearings.csv"
    bearing = np.array([201.2, 202.9, 201.8, 203.5, 204.1, 203.0, 205.2, 206.1])
    is_turned = (np.arange(8) < 4) == (radians == "first")
    mixed = np.where(is_turned, np.radians(bearing), bearing)
    path.write_text(
        "time_s,bearing_deg\n" + "".join(f"{10 * k},{b:.4f}\n" for k, b in enumerate(mixed))
    )
    line = 2 if radians == "first" else 6
    with pytest.raises(DataError, match=rf"line {line}: .* 4 of 8 .* radians"):
        read_series(path)


@pytest.mark.parametrize("course", [0.0, 3.0, 90.0])
def test_a_source_that_crosses_north_or_is_passed_is_no_column_of_radians(tmp_path, course):
    path = tmp_path / "bearings.csv"
    noise = np.random.default_rng(5).normal(0.0, 0.8, 60)
    way = np.linspace(-1.0, 1.0, 60)
    bearing = (course + np.degrees(np.arctan2(way, 0.01)) + 90.0 + noise) % 360.0
    path.write_text(
        "time_s,bearing_deg\n" + "".join(f"{10 * k},{b:.2f}\n" for k, b in enumerate(bearing))
    )
    assert read_series(path).bearing_deg.size == 60


def test_rows_of_one_platform_are_put_in_order_of_time(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("contact,time_s,bearing_deg\n2,5,50\n1,3,30\n1,1,10\n2,4,40\n1,2,20\n")
    with pytest.warns(UwtrackNote, match=r"t\.csv: the rows are not in order of time: sorted"):
        series = read_series(path)
    assert series.contact.tolist() == [1, 1, 1, 2, 2]
    assert series.bearing_deg.tolist() == [10.0, 20.0, 30.0, 40.0, 50.0]
    assert series.begin_of(0).endswith("line 4: ")  # where the row stood
