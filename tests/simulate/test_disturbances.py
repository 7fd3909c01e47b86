"""Disturbances have the statistics that the scenario states, measured by scipy."""

from dataclasses import replace

import numpy as np
import pytest

from tests.simulate.scenes import DIFAR, OMNI, listen, scene, vessel
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.disturbance_sound import draw_steps
from uwtrack_cli.simulate.disturbances import Machine
from uwtrack_cli.simulate.frequency_jitter import SpeedCourse

FLAT = {"density_db": 60.0}
QUIET = {"density_db": -100.0}
STILL = {"course_deg": 0.0, "speed_mps": 0.0, "north_m": 100.0}


def density_db(sound, rate_hz, size=1024):
    """Return frequencies and density of a sound by Welch's method."""
    from scipy.signal import welch

    hertz, density = welch(sound, rate_hz, nperseg=size)
    return hertz, 10.0 * np.log10(np.maximum(density, 1e-30))


def course_hz(sound, rate_hz):
    """Return the instantaneous frequency of a tone, away from the ends."""
    from scipy.signal import hilbert

    phase = np.unwrap(np.angle(hilbert(sound)))
    return np.diff(phase)[50:-50] * rate_hz / (2.0 * np.pi)


def levels_db(sound, size):
    """Return the levels of consecutive stretches."""
    whole = sound[: sound.size // size * size].reshape(-1, size)
    return 10.0 * np.log10((whole**2).mean(axis=1))


def test_rain_is_white_above_its_corner_and_falls_by_12_db_an_octave_below():
    rain = {"peak_s": 100.0, "hold_s": 120.0, "rise_s": 30.0, "fall_s": 40.0, "density_db": 80.0}
    sound = listen(scene(duration_s=220.0, sample_rate_hz=4000.0, noise=QUIET | {"rain": [rain]}))[
        :, 0
    ]
    hertz, full = density_db(sound[45 * 4000 : 155 * 4000], 4000.0, 8192)

    def near(frequency):
        return full[np.abs(hertz - frequency) < 40.0].mean()

    assert [near(f) for f in (700.0, 1200.0, 1800.0)] == pytest.approx([80.0] * 3, abs=0.3)
    assert near(250.0) == pytest.approx(68.0, abs=0.6)
    assert near(125.0) == pytest.approx(56.0, abs=1.2)
    level = levels_db(sound, 4000)
    assert level[:9].max() < -60.0
    assert level[201:].max() < -60.0
    top = level[45:155].mean()
    assert level[24:26].mean() == pytest.approx(top - 3.0, abs=0.5)
    assert level[179:181].mean() == pytest.approx(top - 3.0, abs=0.5)


def test_ambient_drift_has_its_range_and_correlation_time():
    drift = {"range_db": 8.0, "correlation_s": 100.0}
    table = {"duration_s": 60_000.0, "sample_rate_hz": 50.0}
    noise = {"density_db": 60.0, "corner_hz": 0.1, "drift": drift}
    level = levels_db(listen(scene(**table, noise=noise))[:, 0], 500)
    level -= 60.0 + 10.0 * np.log10(25.0)
    assert np.abs(level).max() < 8.0 + 1.5  # 500 samples measure to 0.27 dB
    grid = np.linspace(-6.0, 6.0, 20001)
    weight = np.exp(-0.5 * grid**2)
    expected = np.sqrt((weight * (8.0 * np.tanh(grid)) ** 2).sum() / weight.sum())
    assert level.std() == pytest.approx(expected, rel=0.08)
    hidden = np.arctanh(np.clip(level / 8.0, -0.99, 0.99))
    hidden -= hidden.mean()
    later = [np.mean(hidden[k:] * hidden[:-k]) / hidden.var() for k in (5, 10)]
    np.testing.assert_allclose(later, np.exp([-0.5, -1.0]), atol=0.09)


def test_swell_moves_the_level_by_its_amplitude_at_its_period():
    noise = FLAT | {"swell": {"amplitude_db": 6.0, "period_s": 10.0}}
    level = levels_db(listen(scene(duration_s=400.0, noise=noise))[:, 0], 500)
    time_s = 0.25 + 0.5 * np.arange(level.size)
    turns = 2.0 * np.pi * time_s / 10.0
    design = np.stack([np.sin(turns), np.cos(turns), np.ones(level.size)], axis=1)
    (sine, cosine, mean), *_ = np.linalg.lstsq(design, level, rcond=None)
    assert np.hypot(sine, cosine) == pytest.approx(6.0, abs=0.2)
    assert mean == pytest.approx(60.0 + 10.0 * np.log10(500.0), abs=0.3)
    power = np.abs(np.fft.rfft(level - level.mean())) ** 2
    assert np.fft.rfftfreq(level.size, 0.5)[power.argmax()] == pytest.approx(0.1)


def test_gusts_come_at_their_rate_below_their_corner():
    from scipy.signal import find_peaks

    gusts = {"density_db": 90.0, "rate_per_min": 1.0, "duration_s": 6.0}
    noise = QUIET | {"gusts": gusts}
    sound = listen(scene(duration_s=3000.0, noise=noise))[:, 0]
    level = levels_db(sound, 500)
    found, _ = find_peaks(level, height=level.max() - 6.0, distance=6)
    # 50 gusts on average; those that overlap are seen as one
    assert 30 <= found.size <= 62
    middles = np.concatenate([sound[k * 500 : (k + 1) * 500] for k in found])
    hertz, full = density_db(middles, 1000.0, 500)
    assert full[(hertz > 20) & (hertz < 150)].mean() == pytest.approx(90.0, abs=1.0)
    assert full[np.abs(hertz - 400.0) < 20.0].mean() == pytest.approx(78.0, abs=1.5)
    assert np.mean(level < level.max() - 60.0) > 0.8


def test_shrimp_snap_at_their_rate_above_their_lowest_frequency():
    from scipy.signal import find_peaks

    shrimp = {"rate_per_min": 600.0, "peak_db": 140.0, "spread_db": 4.0}
    noise = QUIET | {"shrimp": shrimp}
    sound = listen(scene(duration_s=60.0, sample_rate_hz=16_000.0, noise=noise))[:, 0]
    found, facts = find_peaks(np.abs(sound), height=1e5, distance=100)
    # 600 on average, of which a few percent fall into one another
    assert 520 <= found.size <= 660
    peaks_db = 20.0 * np.log10(facts["peak_heights"])
    assert np.median(peaks_db) == pytest.approx(140.0, abs=0.6)
    # ripples behind a few snaps count as peaks of their own: the quantiles hold
    low, high = np.quantile(peaks_db, [0.159, 0.841])
    assert 0.5 * (high - low) == pytest.approx(4.0, abs=0.5)
    hertz, full = density_db(sound, 16_000.0)
    assert full[hertz < 1700.0].max() < full[(hertz > 2500) & (hertz < 7500)].mean() - 15


def test_shrimp_above_the_band_of_the_recording_leave_nothing():
    noise = FLAT | {"shrimp": {"peak_db": 160.0}}
    table = {"sample_rate_hz": 3000.0, "duration_s": 10.0}
    np.testing.assert_array_equal(
        listen(scene(**table, noise=noise)), listen(scene(**table, noise=FLAT))
    )


def test_knocks_ring_at_frequencies_of_their_band_and_decay():
    from scipy.signal import find_peaks, hilbert

    knocks = {
        "rate_per_min": 6.0, "peak_db": 130.0, "spread_db": 0.0,
        "band_hz": [100.0, 300.0], "decay_s": 0.2,
    }  # fmt: skip
    noise = QUIET | {"knocks": knocks}
    sound = listen(scene(duration_s=1200.0, noise=noise))[:, 0]
    envelope = np.abs(hilbert(sound))
    found, _ = find_peaks(envelope, height=10.0**6.5 * 0.7, distance=3000)
    assert 85 <= found.size <= 150  # 120 on average
    alone = found[1:-1][(np.diff(found)[1:] > 4000) & (np.diff(found)[:-1] > 4000)]
    decays, hertz = [], []
    for begin in alone:
        tail = envelope[begin + 50 : begin + 450]
        decays.append(-1.0 / np.polyfit(np.arange(400) / 1000.0, np.log(tail), 1)[0])
        power = np.abs(np.fft.rfft(sound[begin : begin + 1000])) ** 2
        hertz.append(power.argmax())
    assert np.median(decays) == pytest.approx(0.2, abs=0.01)
    assert min(hertz) >= 98
    assert max(hertz) <= 302
    assert np.std(hertz) > 30.0
    assert np.median(envelope[found]) == pytest.approx(10.0**6.5, rel=0.15)


def machine(**facts):
    """Return the sound of one machine alone."""
    table = {"duration_s": 2000.0, "sample_rate_hz": 400.0}
    plan = {"fundamental_hz": 60.0, "levels_db": [120.0]} | facts
    return listen(scene(**table, noise=QUIET | {"machine": [plan]}))[:, 0]


def test_a_drifting_machine_has_its_deviation():
    sound = machine(fraction=1e-3, correlation_s=10.0)
    hertz = course_hz(sound, 400.0)
    assert np.sqrt(2.0 * (sound**2).mean()) == pytest.approx(2.0**0.5 * 1e6, rel=1e-3)
    assert hertz.mean() == pytest.approx(60.0, abs=0.02)
    assert hertz.std() == pytest.approx(0.06, rel=0.2)


def test_a_stepping_machine_keeps_to_its_steps():
    hertz = course_hz(machine(step_fraction=0.05, step_every_s=50.0), 400.0)
    share = np.median(hertz[: hertz.size // 400 * 400].reshape(-1, 400), axis=1) / 60 - 1
    assert np.abs(share).max() <= 0.0502
    assert np.quantile(np.abs(share), 0.05) >= 0.0095
    jumps = np.abs(np.diff(share)) > 1e-4
    steps = np.count_nonzero(np.diff(jumps.astype(int)) == 1)
    assert 20 <= steps <= 60  # 40 on average, the equal and the near ones less
    assert np.mean(jumps) < 0.2


def test_a_pump_switches_for_as_long_as_stated():
    sound = machine(on_s=20.0, off_s=40.0)
    is_on = (levels_db(sound, 400) > 110.0).astype(int)
    assert is_on.mean() == pytest.approx(1.0 / 3.0, abs=0.15)
    switches = np.count_nonzero(np.diff(is_on))
    assert 40 <= switches <= 95  # 2000 s of a cycle of 60 s, both ways
    on = levels_db(sound, 400)[is_on == 1]
    assert np.median(on) == pytest.approx(120.0, abs=0.1)


@pytest.mark.parametrize("heading_deg", [0.0, 70.0])
def test_a_machine_lies_in_its_bearing_however_the_housing_is_turned(heading_deg):
    plan = {"fundamental_hz": 60.0, "levels_db": [120.0, 110.0], "bearing_deg": 130.0}
    sensor = DIFAR | {"axes": "housing", "heading_deg": heading_deg}
    noise = QUIET | {"machine": [plan]}
    sound = listen(scene(sensor=[sensor], noise=noise))
    x, y = (sound[:, :1] * sound[:, 1:]).mean(axis=0)
    bearing = np.degrees(np.arctan2(x, y)) + heading_deg
    assert bearing % 360.0 == pytest.approx(130.0, abs=0.1)


def test_the_integral_of_a_speed_course_is_that_of_fine_steps():
    course = SpeedCourse(np.array([2.0, 3.0, 5.0, 5.5]), np.array([0.1, 0.3, -0.2, 0.0]))
    changed = SpeedCourse(course.time_s, course.deviation + 0.05)
    time_s = np.linspace(-1.0, 9.0, 200_001)
    for each in (course, changed):
        value = np.interp(time_s, each.time_s, each.deviation)
        area = np.concatenate([[0.0], np.cumsum(0.5 * (value[1:] + value[:-1]))]) * 5e-5
        area -= area[np.argmin(np.abs(time_s - 2.0))]
        np.testing.assert_allclose(each.excess_s(time_s), area, atol=1e-8)


def test_a_hum_of_the_housing_does_not_turn_with_it():
    plan = {"fundamental_hz": 60.0, "levels_db": [120.0]}
    noise = QUIET | {"machine": [plan]}
    sensor = DIFAR | {"axes": "housing"}
    table = {"duration_s": 5.0, "noise": noise}
    np.testing.assert_array_equal(
        listen(scene(**table, sensor=[sensor | {"heading_deg": 90.0}])),
        listen(scene(**table, sensor=[sensor])),
    )


def test_a_machine_in_a_bearing_reaches_a_single_hydrophone_at_its_level():
    plan = {"fundamental_hz": 60.0, "levels_db": [120.0], "bearing_deg": 45.0}
    sound = listen(scene(noise=QUIET | {"machine": [plan]}))
    assert sound.shape[1] == 1
    level = 10.0 * np.log10((sound**2).mean())
    assert level == pytest.approx(120.0, abs=0.01)


def test_a_gear_change_moves_every_line_by_its_factor_and_revs_on_the_way():
    gears = [{"at_s": 20.0, "factor": 1.25, "duration_s": 6.0, "revving": 0.1}]
    line = {"fundamental_hz": 40.0, "harmonics": 1, "source_level_db": 160.0}
    source = vessel(closest_approach=None, track=STILL, line=[line], gear_change=gears)
    hertz = course_hz(listen(scene(vessel=[source]))[:, 0], 1000.0)
    time_s = (np.arange(hertz.size) + 50.5) / 1000.0 - 0.1
    assert hertz[time_s < 18.0].mean() == pytest.approx(40.0, abs=0.01)
    assert hertz[time_s > 28.0].mean() == pytest.approx(50.0, abs=0.01)
    smooth = np.convolve(hertz, np.ones(201) / 201.0, "same")
    during = (time_s > 20.0) & (time_s < 26.0)
    assert smooth[during].max() == pytest.approx(55.0, abs=0.5)
    # half-way up the first ramp, at an eighth of it
    up = hertz[np.abs(time_s - 20.75) < 0.02].mean()
    assert up == pytest.approx(40.0 + 0.25 * 15.0, abs=0.3)


def test_notches_and_bumps_stand_in_ambient_noise_and_in_broadband_sound():
    features = [
        {"centre_hz": 500.0, "width_hz": 100.0, "gain_db": -20.0},
        {"centre_hz": 1200.0, "width_hz": 200.0, "gain_db": 10.0},
    ]
    table = {"duration_s": 300.0, "sample_rate_hz": 4000.0}
    hertz, full = density_db(
        listen(scene(**table, noise=FLAT | {"feature": features}))[:, 0], 4000.0
    )
    at = {f: full[np.abs(hertz - f) < 8.0].mean() for f in (500, 450, 1200, 1100, 1700)}
    assert at[500] == pytest.approx(40.0, abs=0.8)
    assert at[450] == pytest.approx(50.0, abs=0.8)
    assert at[1200] == pytest.approx(70.0, abs=0.4)
    assert at[1100] == pytest.approx(65.0, abs=0.5)
    assert at[1700] == pytest.approx(60.0, abs=0.3)
    hiss = {"band_hz": [100.0, 1900.0], "source_level_db": 150.0}
    source = vessel(
        closest_approach=None, track=STILL, line=None,
        broadband=hiss | {"feature": features[:1], "slope_db_per_decade": -20.0},
    )  # fmt: skip
    sound = listen(scene(**table, vessel=[source]))[:, 0]
    hertz, full = density_db(sound, 4000.0)
    low, high = (full[np.abs(hertz - f) < 16.0].mean() for f in (200.0, 1600.0))
    assert low - high == pytest.approx(18.06, abs=0.5)  # 6 dB an octave
    notch = full[np.abs(hertz - 500.0) < 8.0].mean()
    assert notch == pytest.approx(low - 20.0 * np.log10(2.5) - 20.0, abs=1.0)
    distance = np.hypot(100.0, OMNI["depth_m"] - 3.0)
    level = 10.0 * np.log10((sound**2).mean()) + 20.0 * np.log10(distance)
    assert level == pytest.approx(150.0, abs=0.2)


def test_a_recorder_cuts_at_its_edges():
    from scipy.signal import butter, freqz_sos

    edges = {"high_pass_hz": 50.0, "low_pass_hz": 800.0, "order": 4}
    sensor = OMNI | {"recorder": edges}
    table = {"duration_s": 300.0, "sample_rate_hz": 2500.0, "noise": FLAT}
    open_sound = listen(scene(**table))[:, 0]
    cut = listen(scene(**table, sensor=[sensor]))[:, 0]
    hertz, full = density_db(cut, 2500.0, 4096)
    _, whole = density_db(open_sound, 2500.0, 4096)
    for frequency in (25.0, 50.0, 200.0, 800.0, 1000.0):
        gain = 0.0
        for edge, kind in ((50.0, "highpass"), (800.0, "lowpass")):
            sections = butter(4, edge, kind, fs=2500.0, output="sos")
            _, response = freqz_sos(sections, [frequency], fs=2500.0)
            gain += 20.0 * np.log10(abs(response[0]))
        near = np.abs(hertz - frequency) < 2.0
        assert (full - whole)[near].mean() == pytest.approx(gain, abs=0.6)
    assert 10 * np.log10(0.5) == pytest.approx(
        (full - whole)[np.abs(hertz - 800.0) < 2.0].mean(), abs=0.5
    )


def test_cavitation_is_modulated_at_the_blade_rate_without_changing_its_level():
    plan = {"blade_rate_hz": 8.0, "depth": 0.4, "harmonics": 2}
    hiss = {"band_hz": [100.0, 450.0], "source_level_db": 150.0, "cavitation": plan}
    source = vessel(closest_approach=None, track=STILL, line=None, broadband=hiss)
    sound = listen(scene(duration_s=1000.0, vessel=[source]))[:, 0]
    square = sound**2 / (sound**2).mean()
    spectrum = 2.0 * np.abs(np.fft.rfft(square)) / square.size
    hertz = np.fft.rfftfreq(square.size, 1e-3)
    # (1 + d cos x + d/2 cos 2x)^2 over its mean, by hand
    power = 1.0 + 0.5 * 0.4**2 + 0.5 * 0.2**2
    first, second = (0.8 + 0.4 * 0.2) / power, (0.4 + 0.5 * 0.4**2) / power
    assert spectrum[np.isclose(hertz, 8.0)][0] == pytest.approx(first, abs=0.03)
    assert spectrum[np.isclose(hertz, 16.0)][0] == pytest.approx(second, abs=0.03)
    assert spectrum[(hertz > 9) & (hertz < 15)].max() < 0.05
    distance = np.hypot(100.0, OMNI["depth_m"] - 3.0)
    level = 10.0 * np.log10((sound**2).mean()) + 20.0 * np.log10(distance)
    assert level == pytest.approx(150.0, abs=0.2)


ALL = FLAT | {
    "drift": {}, "swell": {}, "hum": {"levels_db": [90.0]},
    "clicks": {"rate_per_min": 30.0, "peak_db": 120.0},
    "feature": [{"centre_hz": 100.0, "width_hz": 20.0, "gain_db": -10.0}],
    "rain": [{"peak_s": 10.0, "density_db": 70.0, "rise_s": 5.0}],
    "gusts": {"density_db": 80.0, "rate_per_min": 30.0},
    "shrimp": {"peak_db": 120.0, "lowest_hz": 300.0},
    "knocks": {"rate_per_min": 30.0, "peak_db": 120.0, "decay_s": 1.0},
    "machine": [
        {"fundamental_hz": 25.0, "levels_db": [100.0, 95.0], "fraction": 1e-3,
         "step_fraction": 0.03, "step_every_s": 5.0, "on_s": 10.0, "off_s": 5.0},
    ],
}  # fmt: skip
EVERYTHING = {
    "noise": ALL,
    "sensor": [DIFAR | {"recorder": {"high_pass_hz": 10.0, "low_pass_hz": 450.0}}],
}


def test_block_size_changes_no_bit_of_all_disturbances_together():
    whole = scene(**EVERYTHING)
    np.testing.assert_array_equal(
        listen(whole, block_samples=60_000), listen(whole, block_samples=1237)
    )


def test_every_disturbance_is_seeded_and_independent_of_the_others():
    table = {"sensor": [DIFAR], "duration_s": 40.0}
    base = listen(scene(**table, noise=ALL))
    np.testing.assert_array_equal(base, listen(scene(**table, noise=ALL)))
    assert not np.array_equal(base, listen(scene(**table, noise=ALL, seed=8)))
    silent = {"density_db": -200.0}
    for key in ("rain", "gusts", "shrimp", "knocks", "machine"):
        rest = {name: value for name, value in ALL.items() if name != key}
        alone = listen(scene(**table, noise=silent | {key: ALL[key]}))
        assert np.abs(alone).max() > 1e3, key
        np.testing.assert_allclose(
            base - listen(scene(**table, noise=rest)), alone, atol=base.max() * 1e-6
        )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise": FLAT | {"knocks": {"peak_db": 1.0, "band_hz": [50.0, 700.0]}}},
         "must end below 500 Hz"),
        ({"noise": FLAT | {"machine": [{"fundamental_hz": 300.0, "levels_db": [1, 1]}]}},
         "must stay below 490 Hz"),
        ({"noise": FLAT | {"machine": [{"fundamental_hz": 450.0, "levels_db": [1],
                                        "fraction": 0.05}]}}, "must stay below 490 Hz"),
        ({"noise": FLAT | {"machine": [{"fundamental_hz": 450.0, "levels_db": [1],
                                        "step_fraction": 0.1}]}}, "below 490 Hz"),
        ({"noise": FLAT | {"machine": [{"fundamental_hz": 30.0, "levels_db": [1],
                                        "on_s": 3.0}]}}, "on_s and off_s go together"),
        ({"noise": FLAT | {"machine": [{"fundamental_hz": 30.0, "levels_db": []}]}},
         "one harmonic or more"),
        ({"noise": FLAT | {"rain": [{"peak_s": 3.0}]}}, "needs the key 'density_db'"),
        ({"noise": FLAT | {"swell": {"period_s": 0.0}}}, "swell.period_s"),
        ({"sensor": [OMNI | {"recorder": {"low_pass_hz": 600.0}}]}, "half the sample"),
        ({"vessel": [vessel(gear_change=[{"at_s": 5.0, "factor": 1.2},
                                         {"at_s": 6.0, "factor": 1.4}])]}, "each after"),
        ({"vessel": [vessel(gear_change=[{"at_s": 5.0, "factor": 4.0}])]},
         "line frequencies must stay below"),
        ({"vessel": [vessel(broadband={
            "band_hz": [10.0, 400.0], "source_level_db": 1.0,
            "cavitation": {"blade_rate_hz": 5.0, "depth": 0.9}})]}, "negative"),
    ],
)  # fmt: skip
def test_a_disturbance_that_cannot_be_made_is_refused(changes, message):
    with pytest.raises(OptionError, match=message):
        listen(scene(**changes))


def test_steps_of_a_machine_never_overlap():
    plan = Machine(fundamental_hz=50.0, levels_db=(1.0,), step_fraction=0.05, step_every_s=1.0)
    course = draw_steps((3,), plan, 600.0)
    assert np.all(np.diff(course.time_s) > 0.0)
    assert course.time_s.size > 200
    none = draw_steps((3,), replace(plan, step_every_s=1e6), 1.0)
    assert np.ptp(none.deviation) == 0.0
