"""The sound of a vessel at a sensor, against closed forms computed here."""

import numpy as np
import pytest

from tests.simulate.scenes import DIFAR, OMNI, PASSAGE, listen, scene, vessel
from uwtrack_cli.errors import OptionError

C = 1500.0


def passage(time_s, course_deg, side, horizontal=100.0, speed=8.0, t0=30.0, down=19.0):
    """Range at emission and bearing of the sound that arrives at each time."""
    mach, past = speed / C, time_s - t0
    slant = np.hypot(horizontal, down)
    root = np.sqrt(speed**2 * past**2 + (1.0 - mach**2) * slant**2)
    emitted = (past - root / C) / (1.0 - mach**2)
    sense = {"starboard": 1.0, "port": -1.0}[side]
    abeam = course_deg - 90.0 * sense
    turned = np.degrees(np.arctan(speed * emitted / horizontal))
    return C * (past - emitted), abeam + sense * turned, emitted


def wrap(degrees):
    return (degrees + 180.0) % 360.0 - 180.0


def frequency(pressure, time_s, near_hz, rate):
    """Frequency at the middle of a stretch, from the slope of its phase."""
    beat = pressure * np.exp(-2j * np.pi * near_hz * time_s)
    size = int(rate / 10)
    mean = beat[: beat.size // size * size].reshape(-1, size).mean(axis=1)
    phase = np.unwrap(np.angle(mean)) / (2 * np.pi)
    return near_hz + np.polyfit(np.arange(phase.size) * size / rate, phase, 1)[0]


def test_line_has_phase_and_amplitude_of_the_exact_passage():
    received = listen(scene(vessel=[vessel()]))[:, 0]
    distance, _, emitted = passage(np.arange(received.size) / 1000.0, 81.0, "port")
    turn = 2 * np.pi * 126.0 * emitted
    unit = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    level, *_ = np.linalg.lstsq(unit, received * distance, rcond=None)
    rest = received * distance - unit @ level
    assert 20 * np.log10(np.hypot(*level)) == pytest.approx(173.01, abs=1e-3)
    assert np.std(rest) < 2e-6 * np.hypot(*level)


def test_each_harmonic_is_weaker_by_the_stated_step():
    still = {"course_deg": 0.0, "speed_mps": 0.0, "north_m": 100.0}
    line = {"fundamental_hz": 50.0, "harmonics": 3, "step_db": -6.0, "source_level_db": 160.0}
    source = vessel(closest_approach=None, track=still, line=[line])
    received = listen(scene(vessel=[source], duration_s=20.0))[:, 0]
    amplitude = 2.0 * np.abs(np.fft.rfft(received)) / received.size
    levels = 20.0 * np.log10(amplitude[[1000, 2000, 3000]] / np.sqrt(2.0))
    loss = 20.0 * np.log10(np.hypot(100.0, 19.0))
    np.testing.assert_allclose(levels + loss, [160.0, 154.0, 148.0], atol=0.01)


def test_line_has_its_rest_frequency_when_the_abeam_sound_arrives():
    received = listen(scene(vessel=[vessel()]))[:, 0]
    arrival = 30.0 + np.hypot(100.0, 19.0) / C
    middle = round(1000 * arrival)
    stretch = slice(middle - 2000, middle + 2000)
    time_s = np.arange(received.size) / 1000.0
    got = frequency(received[stretch], time_s[stretch], 126.0, 1000.0)
    assert got == pytest.approx(126.0, abs=5e-4)


def test_surface_image_makes_the_fringes_of_two_rays():
    still = {"east_m": 250.0, "course_deg": 0.0, "speed_mps": 0.0}
    for depth in (3.0, 11.0, 24.0):
        source = vessel(closest_approach=None, track=still, surface_image=0.9, source_depth_m=depth)
        received = listen(scene(vessel=[source], duration_s=10.0))[:, 0]
        direct, image = np.hypot(250.0, 22.0 - depth), np.hypot(250.0, 22.0 + depth)
        wave = 2j * np.pi * 126.0 / C
        field = np.exp(-wave * direct) / direct - 0.9 * np.exp(-wave * image) / image
        expected = 10 ** (170.0 / 20) * abs(field)
        assert np.sqrt(np.mean(received**2)) == pytest.approx(expected, rel=1e-5)


def test_a_channel_has_the_modes_of_its_water():
    # perfect mirrors of opposite sign: the mode of Brekhovskikh and Lysanov, section 5.2,
    # is the first one, and the only one that travels at this frequency
    depth_m, hertz, far_m = 30.0, 20.0, 60.0
    still = {"east_m": far_m, "course_deg": 0.0, "speed_mps": 0.0}
    line = [{"frequency_hz": hertz, "source_level_db": 170.0}]

    def level(source_m):
        source = vessel(
            closest_approach=None, track=still, surface_image=1.0, line=line,
            source_depth_m=source_m,
        )  # fmt: skip
        bed = {"depth_m": depth_m, "loss_db": 0.0, "orders": 10}
        heard = listen(scene(vessel=[source], sea_bed=bed, duration_s=10.0))
        return np.sqrt(np.mean(heard[4000:, 0] ** 2))

    wave = np.pi / (2.0 * depth_m)
    for source_m in (5.0, 11.0, 20.0):
        share = np.sin(wave * source_m) / np.sin(wave * 30.0)
        assert level(source_m) / level(30.0) == pytest.approx(share, rel=0.03)


def test_a_sea_bed_lies_below_everything():
    with pytest.raises(OptionError, match="below the bottom"):
        scene(vessel=[vessel()], sea_bed={"depth_m": 10.0})


def test_broadband_sound_and_its_image_have_the_transfer_of_two_rays():
    noise = {"band_hz": [50.0, 450.0], "source_level_db": 165.0}
    still = {"east_m": 150.0, "course_deg": 0.0, "speed_mps": 0.0}
    common = {"closest_approach": None, "track": still, "source_depth_m": 12.0}
    plain = vessel(broadband=noise, line=[], **common)
    both = plain | {"surface_image": 0.8}
    one = listen(scene(vessel=[plain], duration_s=30.0))[:, 0]
    two = listen(scene(vessel=[both], duration_s=30.0))[:, 0]
    frames = [x[:28_672].reshape(-1, 2048) * np.hanning(2048) for x in (one, two)]
    spectra = [np.fft.rfft(frame) for frame in frames]
    cross = (spectra[1] * spectra[0].conj()).sum(axis=0)
    transfer = cross / (abs(spectra[0]) ** 2).sum(axis=0)
    hertz = np.fft.rfftfreq(2048, 1e-3)
    direct, image = np.hypot(150.0, 10.0), np.hypot(150.0, 34.0)
    lag = np.exp(-2j * np.pi * hertz * (image - direct) / C)
    band = (hertz > 60) & (hertz < 440)
    error = abs(transfer - (1.0 - 0.8 * direct / image * lag))[band]
    assert error.max() < 0.03


def test_broadband_level_and_density_are_those_stated():
    from scipy.signal import welch

    noise = {"band_hz": [100.0, 400.0], "source_level_db": 160.0}
    still = {"east_m": 100.0, "course_deg": 0.0, "speed_mps": 0.0}
    source = vessel(closest_approach=None, track=still, line=[], broadband=noise)
    received = listen(scene(vessel=[source], duration_s=400.0))[:, 0]
    hertz, density = welch(received, 1000.0, nperseg=512, detrend=False)
    distance = np.hypot(100.0, 19.0)
    expected = 10**16.0 / 300.0 / distance**2
    inside = density[(hertz > 110) & (hertz < 390)]
    np.testing.assert_allclose(inside, expected, rtol=0.15)
    assert inside.mean() == pytest.approx(expected, rel=0.01)
    assert density[(hertz < 90) | (hertz > 410)].max() < 1e-5 * expected


def test_broadband_sound_reaches_two_sensors_with_the_right_difference():
    noise = {"band_hz": [20.0, 480.0], "source_level_db": 160.0}
    still = {"east_m": -400.0, "course_deg": 0.0, "speed_mps": 0.0}
    source = vessel(closest_approach=None, track=still, line=[], broadband=noise)
    pair = [OMNI, OMNI | {"id": "h2", "east_m": 333.0}]
    scenario = scene(vessel=[source], sensor=pair, duration_s=30.0)
    near, far = listen(scenario, 0)[:, 0], listen(scenario, 1)[:, 0]
    spectra = np.fft.rfft(near[:28_000]), np.fft.rfft(far[:28_000])
    hertz = np.fft.rfftfreq(28_000, 1e-3)
    band = (hertz > 30) & (hertz < 470)
    lag = (np.hypot(733.0, 19.0) - np.hypot(400.0, 19.0)) / C
    aligned = spectra[1] * np.exp(2j * np.pi * hertz * lag) * spectra[0].conj()
    assert abs(np.angle(aligned[band].sum())) < 0.02
    coherent = abs(aligned[band].sum()) ** 2
    total = np.sum(abs(spectra[0][band]) ** 2) * np.sum(abs(spectra[1][band]) ** 2)
    assert coherent / total > 0.98


@pytest.mark.parametrize("side", ["port", "starboard"])
@pytest.mark.parametrize("course_deg", [0.0, 81.0, 230.0])
def test_intensity_points_along_the_bearing_of_the_exact_passage(side, course_deg):
    way = PASSAGE | {"side": side, "course_deg": course_deg}
    received = listen(scene(sensor=[DIFAR], vessel=[vessel(closest_approach=way)]))
    loud = abs(received[:, 0]) > 0.3 * abs(received[:, 0]).max()
    east, north = (received[loud, :1] * received[loud, 1:]).T
    _, bearing, _ = passage(np.flatnonzero(loud) / 1000.0, course_deg, side)
    error = wrap(np.degrees(np.arctan2(east, north)) - bearing)
    assert abs(error).max() < 1e-3


def test_dipoles_lose_the_cosine_of_the_elevation():
    way = PASSAGE | {"horizontal_range_m": 30.0, "time_s": 5.0}
    quiet = scene(
        sensor=[DIFAR | {"depth_m": 43.0}], vessel=[vessel(closest_approach=way)], duration_s=10.0
    )
    received = listen(quiet)
    omni, east, north = (received**2).reshape(-1, 100, 3).sum(axis=1).T
    time_s = (np.arange(100) + 0.5) / 10
    distance, _, _ = passage(time_s, 81.0, "port", 30.0, 8.0, 5.0, 40.0)
    expected = 1.0 - (40.0 / distance) ** 2
    np.testing.assert_allclose((east + north) / omni, expected, atol=1e-3)


def test_housing_axes_and_compass_facts_turn_the_channels():
    facts = {"axes": "housing", "heading_deg": 250.0}
    errors = {"compass_offset_deg": 4.0, "compass_error_deg": 1.5}
    plain = listen(scene(sensor=[DIFAR], vessel=[vessel()]))
    turned = listen(scene(sensor=[DIFAR | facts | errors], vessel=[vessel()]))
    apparent = np.degrees(np.arctan2(*(turned[:, :1] * turned[:, 1:]).mean(axis=0)))
    true = np.degrees(np.arctan2(*(plain[:, :1] * plain[:, 1:]).mean(axis=0)))
    # heading and known offset bring it back to the true bearing plus the hidden error
    assert wrap(apparent + 250.0 + 4.0 - true) == pytest.approx(1.5, abs=1e-6)


def test_moving_receiver_and_moving_source_shift_a_line_as_mechanics_says():
    tone = {"line": [{"frequency_hz": 200.0, "source_level_db": 170.0}]}
    far = {"east_m": 5000.0, "course_deg": 0.0, "speed_mps": 0.0}
    towards = {"course_deg": 90.0, "speed_mps": 10.0}
    closing = {"east_m": 5000.0, "course_deg": 270.0, "speed_mps": 10.0}
    level = {"source_depth_m": 22.0, "closest_approach": None}
    time_s = np.arange(20_000) / 1000.0
    received = scene(
        sensor=[OMNI | {"track": towards}],
        vessel=[vessel(track=far, **level, **tone)],
        duration_s=20.0,
    )
    emitted = scene(vessel=[vessel(track=closing, **level, **tone)], duration_s=20.0)
    moving_receiver = frequency(listen(received)[:, 0], time_s, 200.0, 1000.0)
    moving_source = frequency(listen(emitted)[:, 0], time_s, 200.0, 1000.0)
    assert moving_receiver == pytest.approx(200.0 * (1 + 10.0 / C), abs=1e-6)
    assert moving_source == pytest.approx(200.0 / (1 - 10.0 / C), abs=1e-6)


def test_line_steps_by_the_change_of_closing_speed_in_a_turn():
    track = {
        "east_m": -4000.0,
        "course_deg": 90.0,
        "speed_mps": 9.0,
        "turn": [{"at_s": 28.0, "course_deg": 0.0, "rate_deg_per_s": 45.0}],
    }
    source = vessel(closest_approach=None, track=track, source_depth_m=22.0)
    received = listen(scene(vessel=[source]))[:, 0]
    time_s = np.arange(received.size) / 1000.0
    before = frequency(received[:20_000], time_s[:20_000], 126.0, 1000.0)
    after = frequency(received[40_000:], time_s[40_000:], 126.0, 1000.0)
    assert before == pytest.approx(126.0 / (1 - 9.0 / C), abs=1e-5)
    assert after == pytest.approx(126.0, abs=0.06)  # now abeam, 3.7 km off
    assert before - after > 0.7


def test_range_law_follows_the_stated_spreading():
    for spreading in (10.0, 15.0, 20.0):
        received = listen(scene(vessel=[vessel(spreading_db_per_decade=spreading)]))[:, 0]
        power = (received**2).reshape(-1, 500).mean(axis=1)
        distance, _, _ = passage((np.arange(120) + 0.5) / 2, 81.0, "port")
        constant = 10 * np.log10(power) + spreading * np.log10(distance)
        assert constant.mean() == pytest.approx(170.0, abs=0.02)
        assert np.std(constant) < 0.05


def test_vessel_is_silent_outside_its_sounding_time():
    always = listen(scene(vessel=[vessel()]))[:, 0]
    hiss = {"band_hz": [50.0, 400.0], "source_level_db": 150.0}
    received = listen(scene(vessel=[vessel(sounding_s=[20.0, 40.0])]))[:, 0]
    assert np.array_equal(received[25_200:34_900], always[25_200:34_900])
    assert not received[:20_050].any()
    assert not received[40_200:].any()
    late = vessel(sounding_s=[40.0, 60.0], broadband=hiss)
    lasting = listen(scene(vessel=[vessel(broadband=hiss)]))[:, 0]
    again = listen(scene(vessel=[late]))[:, 0]
    assert np.array_equal(again[46_000:54_000], lasting[46_000:54_000])
