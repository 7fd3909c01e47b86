"""Laws of the recordings: blocks, length, memory, facts of the sensor."""

import pickle
import tracemalloc

import numpy as np
import pytest

from tests.simulate.scenes import DIFAR, OMNI, listen, scene, vessel
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate import simulate_recordings

EVERYTHING = {
    "sensor": [DIFAR | {"axes": "housing", "track": {"course_deg": 40.0}}],
    "vessel": [
        vessel(
            surface_image=0.7,
            frequency_jitter={"fraction": 1e-4},
            broadband={"band_hz": [50.0, 400.0], "snr_db": 5.0},
        )
    ],
    "noise": {
        "density_db": 60.0,
        "slope_db_per_decade": -15.0,
        "hum": {"levels_db": [90.0, 80.0], "fraction": 1e-4},
        "clicks": {"rate_per_min": 60.0, "peak_db": 130.0},
    },
}
EVERYTHING["sensor"][0]["track"]["speed_mps"] = 3.0


def test_block_size_changes_no_bit():
    scenario = scene(**EVERYTHING)
    whole = listen(scenario, block_samples=60_000)
    assert whole.shape == (60_000, 3)
    for size in (777, 15_360, 15_361, 40_000, 10**9):
        assert np.array_equal(listen(scenario, block_samples=size), whole)


def test_blocks_have_the_asked_size_and_end_with_the_rest():
    reader = simulate_recordings(scene(**EVERYTHING))[0].reader
    sizes = [len(block) for block in reader(16_000)]
    assert sizes == [16_000, 16_000, 16_000, 12_000]
    with pytest.raises(OptionError, match="block_samples"):
        next(reader(0))


def test_longer_recording_begins_like_the_shorter_one():
    # ratios would change with the range heard: state the source levels
    hiss = {"band_hz": [50.0, 400.0], "source_level_db": 160.0}
    source = vessel(frequency_jitter={"fraction": 1e-4}, broadband=hiss)
    noise = EVERYTHING["noise"]
    short = listen(scene(vessel=[source], noise=noise, duration_s=31.7))
    long = listen(scene(vessel=[source], noise=noise, duration_s=60.0))
    assert np.array_equal(short, long[: len(short)])


def test_reader_survives_pickling():
    recording = simulate_recordings(scene(**EVERYTHING, duration_s=2.0))[0]
    again = pickle.loads(pickle.dumps(recording.reader))
    one = np.concatenate(list(recording.reader(500)))
    assert np.array_equal(one, np.concatenate(list(again(500))))


@pytest.mark.slow
def test_memory_does_not_grow_with_the_length_of_the_recording():
    peaks = []
    for duration_s in (100.0, 1000.0):
        reader = simulate_recordings(scene(**EVERYTHING, duration_s=duration_s))[0]
        tracemalloc.start()
        for _ in reader.reader(8192):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]


def test_gain_of_the_chain_scales_samples_alone():
    chain = {"sensitivity_db_re_v_per_upa": -170.0, "gain_db": 20.0, "adc_peak_v": 2.0}
    plain = {key: value for key, value in OMNI.items() if key != "full_scale_db"}
    calibrated = scene(sensor=[plain | chain], vessel=[vessel()])
    recording = simulate_recordings(calibrated)[0]
    assert recording.sensor.full_scale_upa == pytest.approx(2.0 * 10**7.5)
    block = next(recording.reader(60_000)).astype(np.float64)
    reference = listen(scene(vessel=[vessel()]))
    upa = block * recording.sensor.full_scale_upa
    np.testing.assert_allclose(upa, reference, rtol=1e-6, atol=1.0)


def test_uncalibrated_sensor_keeps_its_scale_from_the_user():
    told = simulate_recordings(scene(vessel=[vessel()]))[0].sensor
    assert told.full_scale_db == OMNI["full_scale_db"]
    unknown = {**OMNI, "is_calibrated": False}
    recording = simulate_recordings(scene(vessel=[vessel()], sensor=[unknown]))[0]
    assert recording.sensor.full_scale_upa is None
    assert recording.sensor.gain_db is None


def test_clock_and_position_errors_stay_hidden_from_the_owner():
    facts = {"clock_offset_s": 2.0, "clock_error_s": 0.5, "position_error_m": [3.0, -4.0]}
    start = {"start_utc": "2024-05-01T12:00:00Z"}
    recording = simulate_recordings(scene(sensor=[OMNI | facts], **start))[0]
    # stamp + known offset = true time + hidden error
    assert recording.start_utc_ns == 1_714_564_800_000_000_000 - 1_500_000_000
    assert (recording.sensor.east_m, recording.sensor.north_m) == (3.0, -4.0)
    assert recording.sensor.clock_offset_s == 2.0


def test_moving_sensor_carries_its_navigation_through_the_turn():
    turn = {"at_s": 20.0, "course_deg": 130.0, "rate_deg_per_s": 3.0}
    track = {"course_deg": 40.0, "speed_mps": 4.0, "turn": [turn]}
    recording = simulate_recordings(scene(sensor=[DIFAR | {"track": track}]))[0]
    rows = recording.sensor.navigation
    assert rows is not None
    assert rows.time_s[-1] >= 60.0
    assert rows.heading_deg[[0, 35, 55]] == pytest.approx([40.0, 85.0, 130.0])
    steps = np.hypot(np.diff(rows.east_m), np.diff(rows.north_m))
    np.testing.assert_allclose(steps, 4.0, atol=1e-3)
    assert recording.sensor.east_m is None
