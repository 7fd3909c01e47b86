"""Scores against constructed truth; which ship it was; AIS against geodesics."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, UwtrackNote
from uwtrack_cli.files.tables.ais import read_ais
from uwtrack_cli.files.tables.truth import read_truth
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.flow.scoring.ais_passages import ais_passages
from uwtrack_cli.flow.scoring.encounter_scores import score_encounters
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors

START = 1_714_564_800 * 10**9
SENSOR = Sensor(id="h1", latitude=50.75, longitude=-1.1, depth_m=20.0)
TRUTH = {
    "format": "uwtrack-truth", "version": 1, "start_utc": "2024-05-01T12:00:00Z",
    "sensors": [{"id": "h1", "east_m": 0.0, "north_m": 0.0, "latitude": 35.0,
                 "longitude": 128.5}],
    "vessels": [], "encounters": [],
}  # fmt: skip


def heard(start_utc_ns=START, seconds=600.0, **facts):
    recording = Recording(
        sensor=SENSOR, name="a.wav", sample_rate_hz=1000.0,
        n_samples=int(seconds * 1000), n_channels=1, start_utc_ns=start_utc_ns, **facts,
    )  # fmt: skip
    return RecordedSensors([SENSOR], [recording])


def vessel(number, name):
    track = {key: [0.0, 0.0] for key in (
        "east_m", "north_m", "velocity_east_mps", "velocity_north_mps")}  # fmt: skip
    return {"vessel": number, "name": name, "track": {"time_s": [0.0, 600.0], **track}}


def passage(number, **values):
    known = {
        "time_s": 100.0, "arrival_time_s": 100.2, "speed_mps": 6.0,
        "slant_range_m": 250.0, "horizontal_range_m": 249.0, "range_over_speed_s": 41.7,
        "course_deg": 81.0, "bearing_deg": 171.0, "side": "port", "inside": True,
        "rest_frequencies_hz": [63.0], "sensor": "h1", "vessel": number,
    }  # fmt: skip
    return {**known, **values}


@pytest.fixture
def truth_of(tmp_path):
    def make(*passages):
        numbers = sorted({row["vessel"] for row in passages})
        vessels = [vessel(number, f"ship{number}") for number in numbers]
        path = tmp_path / "t.truth.json"
        content = {**TRUTH, "vessels": vessels, "encounters": list(passages)}
        path.write_text(json.dumps(content))
        return read_truth(path)

    return make


def estimate(**values):
    return {
        "time_s": 100.1, "time_std_s": 0.1, "speed_mps": 6.06, "speed_std_mps": 0.03,
        "course_deg": 80.0, "course_std_deg": 1.0, "side": "port", **values,
    }  # fmt: skip


def test_errors_are_told_in_units_percent_and_deviations(truth_of):
    found = score_encounters(encounters_of(estimate()), truth_of(passage(1)), heard())
    by = {score.quantity: score for score in found.scores}
    assert by["speed_mps"].error == pytest.approx(0.06)
    assert by["speed_mps"].percent == pytest.approx(1.0)
    assert by["speed_mps"].sigmas == pytest.approx(2.0)
    assert by["time_s"].sigmas == pytest.approx(1.0)
    assert np.isnan(by["course_deg"].percent)
    assert by["course_deg"].error == pytest.approx(-1.0)
    assert "bearing_deg" not in by
    assert by["side"].estimate == by["side"].truth == "port"
    assert found.missed == found.false == ()


def test_the_sigmas_of_right_error_bars_have_unit_scatter(truth_of):
    rng = np.random.default_rng(1)
    sigmas = []
    for _ in range(60):
        values = {"time_s": 100.0 + rng.normal(0, 0.1), "speed_mps": 6.0 + rng.normal(0, 0.03)}
        found = score_encounters(encounters_of(estimate(**values)), truth_of(passage(1)), heard())
        sigmas += [s.sigmas for s in found.scores if s.quantity in {"time_s", "speed_mps"}]
    assert np.std(sigmas) == pytest.approx(1.0, abs=3.0 / np.sqrt(2 * len(sigmas)))


def test_each_encounter_finds_its_own_vessel(truth_of):
    truth = truth_of(passage(1), passage(2, time_s=130.0, course_deg=261.0))
    both = encounters_of(estimate(time_s=130.2, course_deg=262.0), estimate())
    found = score_encounters(both, truth, heard())
    assert [who.vessel for who in found.identities] == ["ship2 (2)", "ship1 (1)"]
    assert all(who.candidates[0][1] > 0.99 for who in found.identities)


def test_two_vessels_alike_share_the_probability(truth_of):
    truth = truth_of(passage(1), passage(2))
    (who,) = score_encounters(encounters_of(estimate()), truth, heard()).identities
    assert [p for _, p in who.candidates] == pytest.approx([0.5, 0.5], abs=0.01)


def odds_by_hand(time_error_s, speed_error_mps=None):
    """Return the odds of a passage over an unlisted vessel that passes unheard.

    Time within 5 s against the recording of 600 s; speed within 0.5 m/s against 20 m/s;
    detection as probable as not, one unlisted vessel expected.
    """
    from scipy.stats import norm

    odds = norm.pdf(time_error_s, scale=5.0) * 600.0
    if speed_error_mps is not None:
        odds *= norm.pdf(speed_error_mps, scale=0.5) * 20.0
    return odds


@pytest.mark.parametrize("error_s", [0.0, 8.0, 13.5, 14.2])
def test_probability_of_a_passage_is_that_by_hand(truth_of, error_s):
    row = {"time_s": 100.0 + error_s, "time_std_s": 0.1}
    found = score_encounters(encounters_of(row), truth_of(passage(1)), heard())
    (who,) = found.identities
    odds = odds_by_hand(error_s)
    assert who.candidates[0][1] == pytest.approx(odds / (1.0 + odds), rel=1e-6)
    assert who.unlisted == pytest.approx(1.0 / (1.0 + odds), rel=1e-6)
    # matched where it is likelier than not, which changes between 13.5 and 14.2 s
    assert (who.vessel is not None) == (odds > 1.0) == (error_s < 14.0)
    assert len(found.missed) == len(found.false) == (odds < 1.0)


def test_probability_takes_every_quantity_that_is_known(truth_of):
    row = {"time_s": 110.0, "time_std_s": 0.1, "speed_mps": 7.0, "speed_std_mps": 0.01}
    (who,) = score_encounters(encounters_of(row), truth_of(passage(1)), heard()).identities
    odds = odds_by_hand(10.0, 1.0)
    assert who.candidates[0][1] == pytest.approx(odds / (1.0 + odds), rel=1e-6)


@pytest.mark.parametrize(("sigmas", "is_matched"), [(4.99, True), (5.01, False)])
def test_beyond_the_gate_nothing_belongs_together(truth_of, sigmas, is_matched):
    """Two quantities at equal deviations: 2 x 5^2 is the gate of 50."""
    row = {
        "time_s": 100.0 + 100.0 * sigmas, "time_std_s": 100.0, "speed_mps": 6.0,
        "course_deg": 81.0 + 5.0 * sigmas, "course_std_deg": 5.0,
    }  # fmt: skip
    # many quantities that agree well make up for the deviations
    row |= {"bearing_deg": 171.0, "slant_range_m": 250.0, "speed_std_mps": 0.1}
    found = score_encounters(encounters_of(row), truth_of(passage(1)), heard())
    (who,) = found.identities
    assert (who.unlisted < 1.0) == is_matched


def test_candidates_are_listed_by_falling_probability(truth_of):
    truth = truth_of(passage(1, time_s=92.0), passage(2), passage(3, time_s=105.0))
    row = {"time_s": 100.0, "time_std_s": 0.1}
    (who,) = score_encounters(encounters_of(row), truth, heard()).identities
    assert [name for name, _ in who.candidates] == ["ship2 (2)", "ship3 (3)", "ship1 (1)"]
    assert sum(p for _, p in who.candidates) + who.unlisted == pytest.approx(1.0)


def test_a_result_without_its_recording_has_passages_at_any_time(truth_of):
    truth = truth_of(passage(1, time_s=5000.0))
    row = estimate(time_s=5000.2)
    bare = RecordedSensors([SENSOR], [])
    found = score_encounters(encounters_of(row), truth, bare)
    assert found.missed == found.false == ()
    assert score_encounters(encounters_of(), truth, bare).missed
    assert not score_encounters(encounters_of(), truth, heard()).missed


def test_improbable_candidates_are_not_listed(truth_of):
    """Probabilities of about 0.0012 and 0.0008, beside the vessel that it is."""
    base = odds_by_hand(0.0)
    listed = []
    for share in (0.0012, 0.0008):
        off = 5.0 * np.sqrt(-2.0 * np.log(share * (1.0 + base) / base))
        row = {"time_s": 100.0, "time_std_s": 0.1}
        truth = truth_of(passage(1), passage(2, time_s=100.0 + off))
        (who,) = score_encounters(encounters_of(row), truth, heard()).identities
        listed.append(len(who.candidates))
    assert listed == [2, 1]


def test_what_is_missed_and_what_is_invented_is_told(truth_of):
    truth = truth_of(passage(1), passage(2, time_s=9000.0, inside=False))
    found = score_encounters(encounters_of(estimate(time_s=400.0)), truth, heard())
    assert len(found.missed) == 1
    assert found.missed[0].startswith("ship1 (1)")
    assert found.false == ("contact 1 of sensor h1 at 400.0 s",)


def test_what_is_no_passage_claims_no_vessel(truth_of):
    row = estimate(status="not-a-passage")
    found = score_encounters(encounters_of(row), truth_of(passage(1)), heard())
    assert found.identities == ()
    assert len(found.missed) == 1


@pytest.mark.parametrize(
    "facts", [{"start_utc_ns": START + 40 * 10**9}, {"start_utc_ns": None}], ids=str
)
def test_a_span_of_the_recording_keeps_the_clock(truth_of, facts):
    recorded = heard(**facts, first_sample=40_000)
    row = estimate(time_s=60.1)
    found = score_encounters(encounters_of(row), truth_of(passage(1)), recorded)
    by = {score.quantity: score for score in found.scores}
    assert by["time_s"].error == pytest.approx(0.1)


def test_joined_encounters_keep_their_rest_frequencies():
    one = encounters_of(
        estimate(),
        rest_encounter=np.array([0]), rest_line_id=np.array([1]),
        rest_frequency_hz=np.array([63.0]), rest_frequency_std_hz=np.array([0.1]),
    )  # fmt: skip
    joined = Encounters.join([one, encounters_of(estimate()), one])
    np.testing.assert_array_equal(joined.rest_encounter, [0, 2])


def geodesic_table(path, **sog):
    """AIS messages of a vessel that keeps a geodesic, abeam of the sensor at 300 s."""
    abeam = Geodesic.WGS84.Direct(SENSOR.latitude, SENSOR.longitude, 170.0, 400.0)
    lines = ["Time,MMSI,Latitude_degrees,Longitude_degrees,COG_degrees,SOG_knots"]
    course = abeam["azi2"] - 90.0
    for second in range(0, 601, 10):
        ahead = Geodesic.WGS84.Direct(abeam["lat2"], abeam["lon2"], course, 5.0 * (second - 303.3))
        clock = f"2024-05-01 12:{second // 60:02d}:{second % 60:02d}"
        lines.append(
            f"{clock},123456789,{ahead['lat2']:.9f},{ahead['lon2']:.9f},"
            f"{ahead['azi2'] % 360:.3f},{sog.get('kn', 5.0 / 1852 * 3600):.3f}"
        )
    path.write_text("\n".join(lines) + "\n")
    return read_ais(path)


@pytest.mark.parametrize("speed", [{}, {"kn": 102.3}], ids=["with speed", "without"])
def test_a_passage_in_ais_is_that_of_the_geodesic(tmp_path, speed):
    truth = geodesic_table(tmp_path / "ais.csv", **speed)
    shift_s = (truth.start_utc_ns - START) / 1e9
    (found,) = ais_passages(truth, SENSOR, (-shift_s, 600.0 - shift_s), 2000.0)
    assert found.values["time_s"] + shift_s == pytest.approx(303.3, abs=0.05)
    assert found.values["horizontal_range_m"] == pytest.approx(400.0, abs=0.05)
    assert found.values["slant_range_m"] == pytest.approx(np.hypot(400, 17), abs=0.05)
    assert found.values["speed_mps"] == pytest.approx(5.0, abs=0.01)
    assert found.values["course_deg"] == pytest.approx(80.0, abs=0.1)
    assert found.values["bearing_deg"] == pytest.approx(170.0, abs=0.1)
    assert found.side == "port"


def test_an_encounter_is_scored_against_ais(tmp_path):
    truth = geodesic_table(tmp_path / "ais.csv")
    row = estimate(time_s=304.0, speed_mps=5.05, side="port", bearing_deg=171.0)
    found = score_encounters(encounters_of(row), truth, heard())
    by = {score.quantity: score for score in found.scores}
    assert by["time_s"].error == pytest.approx(0.7, abs=0.05)
    assert by["time_s"].std == pytest.approx(np.hypot(0.1, 10.0 / 5.0), abs=0.01)
    assert found.identities[0].vessel == "123456789"


def test_a_recording_that_starts_late_is_scored_on_its_own_clock(tmp_path):
    truth = geodesic_table(tmp_path / "ais.csv")
    late = heard(START + 200 * 10**9, seconds=300.0)
    row = estimate(time_s=104.0, speed_mps=5.05, side="port", bearing_deg=171.0)
    found = score_encounters(encounters_of(row), truth, late)
    by = {score.quantity: score for score in found.scores}
    assert by["time_s"].error == pytest.approx(0.7, abs=0.05)
    assert found.missed == found.false == ()


@pytest.mark.parametrize(("within_m", "n_missed"), [(390.0, 0), (410.0, 1)])
def test_vessels_farther_than_asked_for_are_not_missed(tmp_path, within_m, n_missed):
    truth = geodesic_table(tmp_path / "ais.csv")
    found = score_encounters(encounters_of(), truth, heard(), within_m=within_m)
    assert len(found.missed) == n_missed


def test_ais_needs_the_time_of_the_recording(tmp_path):
    truth = geodesic_table(tmp_path / "ais.csv")
    with pytest.raises(DataError, match="--start-utc"):
        score_encounters(encounters_of(estimate()), truth, heard(None))


def test_ais_names_the_column_that_it_lacks(tmp_path):
    path = tmp_path / "ais.csv"
    path.write_text("Time,MMSI,Latitude\n2024-05-01 12:00:00,1,50\n")
    with pytest.raises(DataError, match="lacks the columns longitude"):
        read_ais(path)


DAMAGES = {
    "cells": "12:00:20,219000001,55",
    "time": "2024-05-01 25:00:20,219000001,55.1,12.2,10,90",
    "latitude": "2024-05-01 12:00:20,219000001,fifty,12.2,10,90",
    "longitude": "2024-05-01 12:00:20,219000001,55.1,1200,10,90",
    "quote": '2024-05-01 12:00:20,"21"9"000001,55.1,12.2,10,90',
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_message_is_left_out_with_its_line_and_the_others_stay(tmp_path, damage):
    path = tmp_path / "ais.csv"
    whole = [f"2024-05-01 12:00:{k}0,219000001,55.1,12.{k},10,90" for k in range(1, 6)]
    head = "Time,MMSI,Latitude,Longitude,SOG,COG"
    path.write_text("\n".join([head, *whole]))
    want = read_ais(path).tracks[0]
    path.write_text("\n".join([head, *whole[:2], DAMAGES[damage], *whole[2:]]))
    with pytest.warns(UwtrackNote, match=r"1 damaged row is left out of 6.* line 4: "):
        (track,) = read_ais(path).tracks
    np.testing.assert_array_equal(track.time_s, want.time_s)
    np.testing.assert_array_equal(track.second, want.second)
    path.write_text("\n".join([head, whole[0], *[DAMAGES[damage]] * 2]))
    with pytest.raises(DataError, match=r"line 3: .* 2 of 3 rows"):
        read_ais(path)


AGENCIES = {
    "Danish": (
        (
            "# Timestamp,Type of mobile,MMSI,Latitude,Longitude,Navigational status,ROT,"
            "SOG,COG,Heading,IMO,Name,Draught"
        ),
        (
            "02/05/2024 12:00:{:02d},Class A,219000001,55.1,12.{},Under way,0.0,{},90.0,"
            "91,Unknown,FÆRGE,"
        ),
    ),
    "Norwegian": (
        "mmsi;imo;name;date_time_utc;lon;lat;sog;cog;true_heading",
        "219000001;;FÆRGE;2024-05-02 12:00:{:02d};12.{};55.1;{};90.0;91",
    ),
    "United States": (
        "mmsi,base_date_time,longitude,latitude,sog,cog,heading,vessel_name,imo",
        "219000001,2024-05-02 12:00:{:02d},12.{},55.1,{},90.0,91,FÆRGE,",
    ),
    "seconds since 1970": (
        "timestamp,mmsi,lon,lat,speed,course,shipname,rssi",
        "17146512{:02d},219000001,12.{},55.1,{},90.0,FÆRGE,-70",
    ),
}
"""Lines of names and of messages as agencies and receivers give them: second, place,
speed."""


@pytest.mark.parametrize("agency", AGENCIES)
def test_tables_of_the_agencies_say_the_same(tmp_path, agency):
    path = tmp_path / "ais.csv"
    head, row = AGENCIES[agency]
    messages = [(20, 2, 10.0), (0, 1, 10.0), (20, 9, 10.0), (40, 3, 102.3)]
    path.write_text("\n".join([head, *(row.format(*one) for one in messages)]) + "\n")
    truth = read_ais(path)
    assert truth.start_utc_ns == parse_utc("2024-05-02T12:00:00Z")
    (track,) = truth.tracks
    assert track.vessel == "FÆRGE (219000001)"
    np.testing.assert_allclose(track.time_s, [0.0, 20.0, 40.0])
    np.testing.assert_allclose(track.second, [12.1, 12.2, 12.3])  # the first counts
    np.testing.assert_allclose(track.speed_mps, np.array([10, 10, np.nan]) / 1.94384, 1e-5)


REAL = Path(os.environ.get("UWTRACK_REAL_DATA", "/nonexistent"))
SOLENT = REAL / "ais" / "SolentAIS_20160112_130211.csv"


@pytest.mark.slow
@pytest.mark.skipif(not SOLENT.exists(), reason="UWTRACK_REAL_DATA is not set")
def test_real_ais_passages_are_the_least_geodesic_distances():
    truth = read_ais(SOLENT)
    assert len(truth.tracks) == 91
    passages = list(ais_passages(truth, SENSOR, (0.0, 5000.0), 2000.0))
    assert passages
    for passage in passages:
        track = next(t for t in truth.tracks if t.vessel == passage.vessel)
        at = np.argmin(np.abs(track.time_s - passage.values["time_s"]))
        near = slice(max(0, at - 8), at + 9)
        ranges = [
            Geodesic.WGS84.Inverse(SENSOR.latitude, SENSOR.longitude, lat, lon)["s12"]
            for lat, lon in zip(track.first[near], track.second[near], strict=True)
        ]
        assert passage.values["horizontal_range_m"] <= min(ranges) + 1.0
        assert passage.values["horizontal_range_m"] > min(ranges) - 100.0
