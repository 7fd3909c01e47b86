"""Two hydrophones as an array, against geometry and drawn noise."""

from dataclasses import replace

import numpy as np
import pytest

from tests.arrays.test_spatial_array import RATE_HZ, C, plane_wave
from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.arrays.delays import measure_delays
from uwtrack_cli.arrays.directions import find_directions
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.locate import locate_vessels
from uwtrack_cli.motion.tma import estimate_motion

LENGTH_M, HEADING_DEG = 1.5, 40.0
DESIGN_HZ = C / (2.0 * LENGTH_M)
PAIR = Sensor(
    id="pair", kind="array", channels="fore,aft", element_along_m="0.75,-0.75",
    heading_deg=HEADING_DEG, heading_source="fixed", sound_speed_mps=C,
    sound_speed_std_mps=0.0, compass_std_deg=0.0, east_m=0.0, north_m=0.0,
    position_std_m=0.0,
)  # fmt: skip
PLACES = np.array([[0.0, 0.75, 0.0], [0.0, -0.75, 0.0]])

START, VELOCITY = np.array([600.0, 500.0]), np.array([-5.0, 2.0])
TIME_S = np.arange(0.0, 240.0, 8.0)
STD_S = 2e-6


def wrapped(deg):
    return (deg + 180.0) % 360.0 - 180.0


def passing(sensor, seed):
    """Delays of a vessel on a straight course, drawn about those of its geometry."""
    off = START + TIME_S[:, None] * VELOCITY - [sensor.east_m, sensor.north_m]
    axis = np.radians(sensor.heading_deg)
    cosine = off @ [np.sin(axis), np.cos(axis)] / np.hypot(*off.T)
    noise_s = STD_S * np.random.default_rng(seed).standard_normal(TIME_S.size)
    return Delays(
        time_s=TIME_S, channel_a=np.full(TIME_S.size, "fore"),
        channel_b=np.full(TIME_S.size, "aft"),
        delay_s=LENGTH_M * cosine / C + noise_s,
        delay_std_s=np.full(TIME_S.size, STD_S), sensor=sensor.id,
    )  # fmt: skip


@pytest.mark.parametrize("cone_deg", [35.0, 90.0, 120.0])
def test_delays_give_a_cone_and_the_bearings_on_both_of_its_sides(cone_deg):
    samples = plane_wave(PLACES, cone_deg, 0.0, snr_db=5.0, duration_s=60.0)
    recording = recording_of(samples, RATE_HZ, PAIR)
    blocks = measure_delays(recording, band_hz=(60.0, 900.0), overlap=0.0)
    found = find_directions(Delays.join(list(blocks)), PAIR)
    assert found.ambiguity == "line"
    assert found.time_s.size == 60
    off = wrapped(found.bearing_deg - HEADING_DEG - cone_deg)
    # 60 independent frames: three deviations of an rms are 27 %
    assert 0.7 < np.sqrt(np.mean((off / found.bearing_std_deg) ** 2)) < 1.35
    assert found.lobe_frame.tolist() == found.frame.tolist()
    middle = wrapped(found.lobe_bearing_deg + found.bearing_deg - 2.0 * HEADING_DEG)
    assert middle == pytest.approx(0.0, abs=1e-9)
    assert found.lobe_weight == pytest.approx(0.5)
    assert np.isnan(found.elevation_deg).all()
    assert found.slowness_ratio == pytest.approx(
        np.abs(np.cos(np.radians(found.bearing_deg - HEADING_DEG)))
    )


def test_beams_of_a_pair_begin_at_half_its_design_frequency_and_tell_the_cone():
    rng, cosine = np.random.default_rng(5), 0.4
    time_s = np.arange(round(40.0 * RATE_HZ)) / RATE_HZ
    early_s = PLACES[:, 1] * cosine / C
    tone = np.cos(2.0 * np.pi * 400.3 * (time_s[:, None] + early_s))
    samples = 0.2 * tone + rng.standard_normal((time_s.size, 2))
    recording = recording_of(samples, RATE_HZ, PAIR)
    with pytest.warns(UserWarning, match="design frequency"):
        record = BearingTime.join(list(form_beams(recording, overlap=0.0)))
    assert record.band_low_hz == pytest.approx(DESIGN_HZ / 2.0, abs=1.0)
    assert record.ambiguity == "mirror"
    peaks = record.peaks
    near = (np.abs(peaks.frequency_hz - 400.3) < 1.0) & peaks.is_detection
    assert near.sum() > 30
    off = peaks.cone_deg[near] - np.degrees(np.arccos(cosine))
    assert 0.7 < np.sqrt(np.mean((off / peaks.cone_std_deg[near]) ** 2)) < 1.35


@pytest.mark.parametrize("cosine", [-0.95, 0.95])
def test_no_beam_of_a_pair_takes_the_grating_lobe_of_the_other_end(cosine):
    rng, frequency_hz = np.random.default_rng(2), 0.94 * DESIGN_HZ
    time_s = np.arange(round(20.0 * RATE_HZ)) / RATE_HZ
    early_s = PLACES[:, 1] * cosine / C
    tone = np.cos(2.0 * np.pi * frequency_hz * (time_s[:, None] + early_s))
    samples = tone + 0.01 * rng.standard_normal((time_s.size, 2))
    with pytest.warns(UserWarning, match="design frequency"):
        blocks = form_beams(recording_of(samples, RATE_HZ, PAIR))
    peaks = BearingTime.join(list(blocks)).peaks
    near = (np.abs(peaks.frequency_hz - frequency_hz) < 0.5) & (peaks.snr_db > 20.0)
    assert near.any()
    found = np.cos(np.radians(peaks.cone_deg[near].astype(float)))
    assert found == pytest.approx(cosine, abs=0.02)


def test_one_hydrophone_that_works_of_two_is_refused():
    samples = np.random.default_rng(1).standard_normal((8000, 2))
    samples[:, 1] = 0.0
    recording = recording_of(samples, RATE_HZ, PAIR)
    with (
        pytest.warns(UserWarning, match="left out"),
        pytest.raises(DataError, match=r"1 of 2 hydrophones .* beams need 2"),
    ):
        list(measure_delays(recording, band_hz=(60.0, 900.0)))


def test_the_cones_of_three_pairs_place_a_vessel_on_its_true_side():
    sensors = [
        PAIR,
        replace(PAIR, id="east", heading_deg=130.0, east_m=500.0, north_m=100.0),
        replace(PAIR, id="west", heading_deg=80.0, east_m=-400.0, north_m=-100.0),
    ]
    found = [find_directions(passing(one, k), one) for k, one in enumerate(sensors)]
    fixes = locate_vessels(directions=found, sensors=sensors, at=["120"], contact_numbers="common")
    best = int(np.argmax(fixes.weight))
    off = np.array([fixes.east_m[best], fixes.north_m[best]]) - START - 120.0 * VELOCITY
    assert off @ np.linalg.solve(fixes.covariance_m2[best], off) < 13.8  # 99.9 %
    assert np.hypot(*off) < 20.0


def test_the_cones_of_one_pair_at_rest_leave_both_sides_and_no_range():
    found = find_directions(passing(PAIR, 0), PAIR)
    motions = estimate_motion(directions=found, sensor=PAIR)
    assert not motions.observable.any()
    off = wrapped(motions.bearing_deg - HEADING_DEG)
    true_deg = np.degrees(np.arctan2(*START))
    cone = wrapped(true_deg - HEADING_DEG)
    assert (off > 0.0).any()
    assert (off < 0.0).any()
    assert np.abs(off) == pytest.approx(abs(cone), abs=1.5)
