"""Closest approaches from lines, levels and tables."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.passing_vessel import frames_of, levels_of_scene, lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage import encounter_rows as passage_levels

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0, compass_std_deg=0.0)
SCENE = Scene(rest_hz=(63.0, 126.0, 189.0))


def deviations(found, row, scene):
    """Errors in stated deviations of time, speed, range and bearing."""
    bearing = (found.bearing_deg[row] - scene.bearing_deg + 180) % 360 - 180
    return np.array(
        [
            (found.time_s[row] - scene.closest_s) / found.time_std_s[row],
            (found.speed_mps[row] - scene.speed_mps) / found.speed_std_mps[row],
            (found.slant_range_m[row] - scene.range_m) / found.slant_range_std_m[row],
            bearing / found.bearing_std_deg[row],
        ]
    )


def reasons(found, row=0):
    return found.reasons(row)


@pytest.mark.slow
def test_lines_and_levels_give_the_whole_passage():
    turn = -1  # the other side is that of the mirrored track
    scene = replace(SCENE, turn=turn)
    rng = np.random.default_rng(1)
    found = find_encounters(lines_of_scenes([scene], rng), levels_of_scene(scene, rng), DIFAR)
    assert found.status.tolist() == ["ok"]
    assert np.all(np.abs(deviations(found, 0, scene)) < 3.5)
    assert found.side[0] == ("starboard" if turn > 0 else "port")
    course = (scene.bearing_deg + 90 * turn) % 360
    assert abs(found.course_deg[0] - course) < 3.5 * found.course_std_deg[0]
    np.testing.assert_allclose(found.rest_frequency_hz, scene.rest_hz, atol=0.01)
    depths = found.nuisances(0)
    height = depths["sensor_depth_m"]["value"] - depths["source_depth_m"]["value"]
    flat = np.sqrt(found.slant_range_m[0] ** 2 - height**2)
    assert found.horizontal_range_m[0] == pytest.approx(flat)
    truth = np.sqrt(scene.range_m**2 - scene.height_m**2)
    assert abs(flat - truth) < 3.5 * found.horizontal_range_std_m[0]
    delay = found.slant_range_m[0] / 1500.0
    assert found.arrival_time_s[0] == pytest.approx(found.time_s[0] + delay)


def test_a_mono_recording_gives_speed_and_range_but_no_course():
    rng = np.random.default_rng(2)
    lines = lines_of_scenes([SCENE], rng, has_bearing=False)
    found = find_encounters(lines, None, Sensor(id="h1"))
    assert abs(found.speed_mps[0] - 6.0) < 3.5 * found.speed_std_mps[0]
    assert found.side[0] == ""
    assert np.isnan(found.course_deg[0])
    assert reasons(found)["course_deg"] == "no bearing channel"
    assert reasons(found)["horizontal_range_m"] == ("the depth of the sensor is not known")
    # a sensor that has bearings is not said to have none
    difar = Sensor(id="h1", kind="difar", channels="omni,east,north")
    told = reasons(find_encounters(lines, None, difar))["course_deg"]
    assert told == "no bearing that stands out"


def test_levels_alone_give_range_over_speed_and_no_speed():
    rng = np.random.default_rng(3)
    levels = levels_of_scene(SCENE, rng, has_bearing=False)
    found = find_encounters(None, levels, DIFAR)
    width = SCENE.range_m / SCENE.speed_mps
    assert found.status.tolist() == ["level-only"]
    error = found.range_over_speed_s[0] - width
    assert abs(error) < 3.5 * found.range_over_speed_std_s[0]
    assert np.isnan(found.speed_mps[0])
    assert reasons(found)["speed_mps"] == "no line"


@pytest.mark.parametrize("kind", ["steady", "hum"])
def test_steady_lines_are_no_vessel(kind):
    rng = np.random.default_rng(4)
    still = replace(SCENE, speed_mps=1e-6, range_m=250.0)
    status = "hum" if kind == "hum" else "steady"
    lines = lines_of_scenes([still], rng, status=status)
    assert find_encounters(lines, None, DIFAR).n_encounters == 0


def test_a_line_that_drifts_slowly_is_no_vessel():
    rng = np.random.default_rng(5)
    lines = lines_of_scenes([replace(SCENE, speed_mps=1e-6)], rng, has_bearing=False)
    drift = 1 + 1e-3 * np.asarray(lines.time_s) / 600
    lines = replace(lines, measured_frequency_hz=lines.measured_frequency_hz * drift)
    assert find_encounters(lines, None, DIFAR).n_encounters == 0


@pytest.mark.parametrize("seed", range(5))
def test_two_steady_lines_joined_by_a_tracker_are_no_vessel(seed):
    """One line ends, another one begins a little lower: nothing passes."""
    rng = np.random.default_rng(seed)
    scene = Scene(rest_hz=(350.0,), speed_mps=1e-6, length_s=60.0)
    lines = lines_of_scenes([scene], rng, has_bearing=False)
    time = np.asarray(lines.time_s)
    heard = (rng.random(time.size) < 0.4) & (np.abs(time - 30.0) > 3.0)
    frequency = np.where(time < 30.0, 353.4, 346.6) + 0.2 * rng.normal(size=time.size)
    joined = replace(
        lines,
        frequency_hz=frequency,
        measured_frequency_hz=np.where(heard, frequency, np.nan),
        measured_frequency_std_hz=np.full(time.size, 0.2),
    )
    assert find_encounters(joined).n_encounters == 0


def test_two_vessels_within_one_passage_time_stay_two():
    first = Scene(rest_hz=(63.0, 126.0), closest_s=280.0, bearing_deg=40.0, turn=1)
    second = Scene(
        speed_mps=4.0, range_m=180.0, rest_hz=(81.0, 162.0), closest_s=310.0,
        bearing_deg=200.0, turn=-1,
    )  # fmt: skip
    rng = np.random.default_rng(6)
    lines = lines_of_scenes([first, second], rng)
    found = find_encounters(lines, levels_of_scene(first, rng), DIFAR)
    assert found.contact.tolist() == [1, 2]
    assert np.all(np.abs(deviations(found, 0, first)) < 3.5)
    assert np.all(np.abs(deviations(found, 1, second)) < 3.5)
    assert found.side.tolist() == ["starboard", "port"]


def test_lines_that_a_tracker_split_into_contacts_are_one_vessel():
    rng = np.random.default_rng(7)
    lines = lines_of_scenes([replace(SCENE, rest_hz=(63.0, 126.0, 189.0))], rng)
    split = replace(lines, line_contact=np.array([1, 2, 2]))
    found = find_encounters(split, None, DIFAR)
    assert found.n_encounters == 1
    assert found.rest_frequency_hz.size == 3
    assert np.all(np.abs(deviations(found, 0, SCENE)) < 3.5)


def test_a_later_start_shifts_times_only():
    one = find_encounters(lines_of_scenes([SCENE], np.random.default_rng(8)), sensor=DIFAR)
    frames = frames_of(600.0)
    moved = replace(frames, time_s=np.asarray(frames.time_s) + 1000.0)
    scene = replace(SCENE, closest_s=1300.0)
    two = find_encounters(
        lines_of_scenes([scene], np.random.default_rng(8), frames=moved), sensor=DIFAR
    )
    assert two.time_s[0] - one.time_s[0] == pytest.approx(1000.0, abs=1e-3)
    assert two.speed_mps[0] == pytest.approx(one.speed_mps[0], rel=1e-5)
    assert two.bearing_deg[0] == pytest.approx(one.bearing_deg[0], abs=1e-3)


def test_a_mirrored_track_gives_a_mirrored_encounter():
    lines = lines_of_scenes([SCENE], np.random.default_rng(9))
    mirrored = replace(lines, measured_bearing_deg=-lines.measured_bearing_deg % 360)
    one, two = (find_encounters(item, None, DIFAR) for item in (lines, mirrored))
    assert two.bearing_deg[0] == pytest.approx(-one.bearing_deg[0] % 360, abs=1e-3)
    assert {one.side[0], two.side[0]} == {"port", "starboard"}
    assert two.speed_mps[0] == pytest.approx(one.speed_mps[0], rel=1e-5)


@pytest.mark.slow
def test_a_gain_moves_levels_only():
    rng = np.random.default_rng(10)
    lines, levels = lines_of_scenes([SCENE], rng), levels_of_scene(SCENE, rng)
    louder = replace(levels, level_db=levels.level_db + 6.0)
    one, two = (find_encounters(lines, item, DIFAR) for item in (levels, louder))
    assert two.received_level_db[0] - one.received_level_db[0] == pytest.approx(6.0)
    assert two.speed_mps[0] == one.speed_mps[0]


def test_received_and_source_level_are_those_of_the_vessel():
    rng = np.random.default_rng(11)
    found = find_encounters(
        lines_of_scenes([SCENE], rng), levels_of_scene(SCENE, rng, level_db=120.0), DIFAR
    )
    error = found.received_level_db[0] - 120.0
    assert abs(error) < 3.5 * found.received_level_std_db[0]
    source = 120.0 + 20 * np.log10(SCENE.range_m)
    assert abs(found.source_level_db[0] - source) < 3.5 * found.source_level_std_db[0]
    assert (found.band_low_hz, found.band_high_hz) == (100.0, 1000.0)


@pytest.mark.long
def test_a_long_quiet_recording_leaves_levels_as_they_are(monkeypatch):
    """Frames far from the vessel tell of the background alone: some are enough."""
    rng = np.random.default_rng(13)
    scene = replace(SCENE, length_s=6000.0, closest_s=3100.0)
    made = lines_of_scenes([scene], rng), levels_of_scene(scene, rng), DIFAR
    whole = find_encounters(*made)
    monkeypatch.setattr(passage_levels, "MOST_FRAMES", 4000)
    monkeypatch.setattr(passage_levels, "MOST_FAR", 1000)
    some = find_encounters(*made)
    std = whole.received_level_std_db[0]
    assert some.received_level_std_db[0] == pytest.approx(std, rel=0.3)
    assert abs(some.received_level_db[0] - whole.received_level_db[0]) < std


def test_an_error_of_the_sound_speed_scales_speed_and_range():
    lines = lines_of_scenes([SCENE], np.random.default_rng(12), has_bearing=False)
    one = find_encounters(lines, sensor=DIFAR)
    two = find_encounters(lines, sensor=DIFAR, sound_speed_mps=1515.0)
    assert two.speed_mps[0] / one.speed_mps[0] == pytest.approx(1.01, rel=1e-4)
    assert two.slant_range_m[0] / one.slant_range_m[0] == pytest.approx(1.01, rel=1e-3)


def test_a_passage_that_ends_before_its_closest_approach_is_extrapolated():
    scene = replace(SCENE, closest_s=610.0)
    lines = lines_of_scenes([scene], np.random.default_rng(13))
    found = find_encounters(lines, sensor=DIFAR)
    assert found.status.tolist() == ["extrapolated"]
    assert bool(found.extrapolated[0])
    assert np.all(np.abs(deviations(found, 0, scene)) < 4)


def test_levels_that_end_before_the_closest_approach_are_extrapolated():
    scene = replace(SCENE, closest_s=612.0)
    levels = levels_of_scene(scene, np.random.default_rng(20), snr_db=20.0)
    found = find_encounters(None, levels, DIFAR)
    assert found.status.tolist() == ["extrapolated"]
    assert abs(found.time_s[0] - scene.closest_s) < 4 * found.time_std_s[0]


@pytest.mark.slow
def test_a_table_of_frequencies_works_like_lines():
    lines = lines_of_scenes([SCENE], np.random.default_rng(14))
    n = 600
    rows = np.asarray(lines.measured_frequency_hz).reshape(3, n).T
    unknown = np.full(n, np.nan)
    series = Series(
        contact=np.ones(n), time_s=lines.time_s[:n], frequency_hz=rows,
        frequency_std_hz=np.full(rows.shape, np.nan), bearing_deg=unknown,
        bearing_std_deg=unknown, level_db=unknown, level_std_db=unknown,
    )  # fmt: skip
    found = find_encounters(None, None, None, series)
    assert abs(found.speed_mps[0] - 6.0) < 3.5 * found.speed_std_mps[0]
    assert found.time_utc_ns[0] == -1


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("sound_speed_mps", -1.0),
        ("source_depth_m", -3.0),
        ("false_alarm_probability", 0.0),
        ("spreading_db", 0.0),
    ],
)
def test_options_out_of_range_are_refused(option, value):
    lines = lines_of_scenes([SCENE], np.random.default_rng(15))
    with pytest.raises(OptionError, match=option):
        find_encounters(lines, **{option: value})


def test_frames_that_blur_a_fast_passage_are_pointed_out():
    scene = Scene(speed_mps=30.0, range_m=40.0, rest_hz=(900.0,), length_s=60.0, closest_s=30.0)
    lines = lines_of_scenes([scene], np.random.default_rng(16))
    with pytest.warns(UwtrackWarning, match="too long: they blur"):
        found = find_encounters(lines, None, Sensor(id="h1"))
    assert found.status.tolist() == ["ok"]


@pytest.mark.slow
def test_frames_advised_for_a_slow_distant_passage_are_at_most_eight_seconds():
    scene = Scene(speed_mps=2.6, range_m=900.0, rest_hz=(63.0,), length_s=1800.0, closest_s=900.0)
    quarter = frames_of(1800.0)
    quarter = replace(
        quarter, window_samples=quarter.window_samples // 4, hop_samples=quarter.hop_samples // 4
    )
    rng = np.random.default_rng(19)
    with pytest.warns(UwtrackWarning, match="too short: .* window_s = 8 would suit"):
        find_encounters(lines_of_scenes([scene], rng, frames=quarter), sensor=DIFAR)
    rng = np.random.default_rng(19)
    whole = lines_of_scenes([scene], rng)
    assert find_encounters(whole, sensor=DIFAR).status.tolist() == ["ok"]


@pytest.mark.slow
def test_what_is_left_of_another_vessels_pull_widens_the_course():
    other = Scene(speed_mps=4.0, range_m=180.0, rest_hz=(81.0,), closest_s=310.0, bearing_deg=200.0)
    rng = np.random.default_rng(17)
    alone = find_encounters(lines_of_scenes([SCENE], rng), sensor=DIFAR)
    rng = np.random.default_rng(17)
    crowd = find_encounters(lines_of_scenes([SCENE, other], rng), sensor=DIFAR)
    added = crowd.course_std_deg[0] ** 2 - alone.course_std_deg[0] ** 2
    # within d/v half of the lines' 20 dB have lost 1 dB or more: 1 + u^2 at u = 1/2
    left = 0.3 * np.rad2deg(0.01 * 1.25 / np.sqrt(2))
    assert np.sqrt(added) == pytest.approx(left, rel=0.05)


def test_measurements_that_say_nothing_give_no_encounter():
    rng = np.random.default_rng(18)
    lines, levels = lines_of_scenes([SCENE], rng), levels_of_scene(SCENE, rng)
    silent = np.full(600, np.nan)
    empty = lines.take("point", slice(0, 0)).take("line", slice(0, 0))
    for found in (
        find_encounters(empty),
        find_encounters(lines.take("point", slice(0, 6))),
        find_encounters(None, replace(levels, excess_db=silent, bearing_deg=silent)),
        find_encounters(None, replace(levels, excess_db=silent * 0, bearing_deg=silent)),
    ):
        assert found.n_encounters == 0


def test_bearings_of_a_table_alone_give_width_and_side():
    time = np.arange(60.0)
    unknown = np.full(60, np.nan)
    bearing = 350.0 + np.rad2deg(np.arctan((time - 30) / 5))
    series = Series(
        contact=np.ones(60), time_s=time, frequency_hz=np.empty((60, 0)),
        frequency_std_hz=np.empty((60, 0)), bearing_deg=bearing % 360,
        bearing_std_deg=unknown, level_db=unknown, level_std_db=unknown,
    )  # fmt: skip
    found = find_encounters(series=series)
    assert found.range_over_speed_s[0] == pytest.approx(5.0, rel=1e-3)
    assert found.course_deg[0] == pytest.approx(80.0, abs=0.01)
    assert found.side.tolist() == ["starboard"]


def test_nothing_to_work_on_is_refused():
    with pytest.raises(DataError, match="need lines, levels or a series"):
        find_encounters()


def test_a_contact_whose_fit_fails_is_refused_with_its_reason_and_the_others_told():
    time_s = 2.0 * np.arange(200)
    along_m = 6.0 * (time_s - 200.0)
    law = 100.0 * (1.0 - 6.0 * along_m / (1500.0 * np.hypot(along_m, 250.0)))
    parts = []
    for contact in (1, 2, 3, 4):
        rng = np.random.default_rng(contact - 2 if contact > 1 else 9)
        n = 200 if contact == 1 else 119
        noise = rng.standard_normal((2, 200))
        # a table that claims to know some frequencies to 1e-12 Hz
        is_sure = (rng.random(n) < 0.3) & (contact > 1)
        frequency = law[:n] + 50.0 * (contact - 1) + 0.03 * noise[0, :n]
        std = np.where(is_sure, 1e-12, 0.03)
        parts.append((np.full(n, contact), time_s[:n], frequency, std))
    contact, time_s, frequency_hz, std_hz = map(np.concatenate, zip(*parts, strict=True))
    nothing = np.full(time_s.size, np.nan)
    series = Series(
        contact=contact, time_s=time_s, frequency_hz=frequency_hz[:, None],
        frequency_std_hz=std_hz[:, None], bearing_deg=nothing, bearing_std_deg=nothing,
        level_db=nothing, level_std_db=nothing,
    )  # fmt: skip
    with pytest.warns(UwtrackWarning, match=r"\(0 to 236 s\) is reported as no passage"):
        found = find_encounters(series=series)
    row = found.contact.tolist().index(1)
    assert abs(found.speed_mps[row] - 6.0) < 3.5 * found.speed_std_mps[row]
    # which matrices are singular may depend on the machine
    failed = [reason for *_, reason in found.refusals() if "fit failed" in reason]
    assert failed
    assert set(failed) == {"its fit failed (LinAlgError: Singular matrix)"}
