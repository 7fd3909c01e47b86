"""Beams of simulated and drawn sound against truth, bounds and a second beamformer."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario

pytestmark = pytest.mark.filterwarnings("ignore:hydrophones 1 m apart")

C, RATE_HZ, N = 1500.0, 1600.0, 16
PLACES = np.arange(N) - 0.5 * (N - 1)
FIXED = Sensor(
    id="tow", kind="array", channels=",".join(f"e{k}" for k in range(N)),
    element_along_m=",".join(map(str, PLACES)), heading_deg=30.0,
    heading_source="fixed", east_m=0.0, north_m=0.0,
)  # fmt: skip


def tones(cosines, levels_db, frequency_hz=449.7, duration_s=8.0, seed=1, places=PLACES):
    """Plane waves with equal frequency and random phases in independent noise."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    total = rng.standard_normal((time_s.size, len(places)))
    for cosine, level_db in zip(cosines, levels_db, strict=True):
        phase = rng.random()
        delay_s = -places * cosine / C
        amplitude = np.sqrt(2.0 * 10.0 ** (level_db / 10.0))
        cycles = frequency_hz * (time_s[:, None] - delay_s) + phase
        total += amplitude * np.cos(2.0 * np.pi * cycles)
    return total


def beams_of(samples, sensor=FIXED, **options):
    recording = recording_of(samples, RATE_HZ, sensor)
    return BearingTime.join(list(form_beams(recording, **options)))


def cosine_of(peaks):
    return np.cos(np.radians(peaks.cone_deg.astype(float)))


@pytest.mark.parametrize("cosine", [-0.83, 0.0, 0.41])
def test_levels_are_those_of_a_delay_and_sum_in_time(cosine):
    samples = tones([0.4], [-12.0], duration_s=10.0)
    record = beams_of(samples, band_hz=(200.0, 700.0), shading="uniform")
    at = int(np.argmin(np.abs(record.cos_angle - cosine)))
    steered = np.zeros(len(samples))
    for channel, along_m in zip(samples.T, PLACES, strict=True):
        spectrum = np.fft.rfft(channel)
        frequency_hz = np.fft.rfftfreq(len(channel), 1.0 / RATE_HZ)
        later_s = along_m * record.cos_angle[at] / C  # ahead came first to the head
        shift = np.exp(-2j * np.pi * frequency_hz * later_s)
        steered += np.fft.irfft(spectrum * shift, len(channel)) / N
    spectrum = np.abs(np.fft.rfft(steered)) ** 2
    inside = (frequency_hz >= 200.0) & (frequency_hz <= 700.0)
    wanted_db = 10.0 * np.log10(2.0 * spectrum[inside].sum() / len(samples) ** 2)
    power = 10.0 ** (record.level_db[:, at] / 10.0)
    assert 10.0 * np.log10(power.mean()) == pytest.approx(wanted_db, abs=0.25)


@pytest.mark.parametrize(("shading", "cone_deg"), [("uniform", 30.0), ("chebyshev", 60.0)])
def test_directions_err_as_stated_and_near_the_bound(shading, cone_deg):
    truth = np.cos(np.radians(cone_deg))
    errors, stated = [], []
    for seed in range(4):
        shift = (seed - 1.5) / 4.0 * 2.0 / (4 * N)  # places between the beams
        samples = tones([truth + shift], [-18.0], duration_s=60.0, seed=seed)
        peaks = beams_of(samples, shading=shading, overlap=0.0, band_hz=(350.0, 550.0)).peaks
        near = np.abs(peaks.frequency_hz - 449.7) < 1.0
        near &= np.abs(cosine_of(peaks) - truth) < 0.1
        errors.append(cosine_of(peaks)[near] - truth - shift)
        sine = np.sin(np.arccos(cosine_of(peaks)[near]))
        stated.append(np.radians(peaks.cone_std_deg[near]) * sine)
    error, std = np.concatenate(errors), np.concatenate(stated)
    assert error.size > 225  # of 240 frames: hardly one is missed
    density = 2.0 / RATE_HZ  # of noise of unit variance
    rho = 10.0**-1.8 / density / 1.5
    turn = 2.0 * np.pi * 449.7 / C
    bound = np.sqrt(6.0 / (rho * turn**2 * N * (N**2 - 1)))
    rms = np.sqrt(np.mean(error**2))
    # the bands, and five deviations of an rms of 240 on either side
    low, high = (0.93, 1.10) if shading == "uniform" else (0.98, 1.20)
    assert low / 1.25 < rms / bound < high * 1.25
    assert 0.8 / 1.2 < np.sqrt(np.mean((error / std) ** 2)) < 1.25 * 1.2
    assert abs(error.mean()) < 5.0 * rms / np.sqrt(error.size)


@pytest.mark.parametrize("cone_deg", [20.0, 75.0, 130.0])
def test_lines_between_the_bins_have_no_bias_at_a_moving_array(cone_deg):
    heading, far_m = 40.0, 3e6
    bearing = np.radians(heading + cone_deg)
    vessel = {
        "source_depth_m": 30.0,
        "spreading_db_per_decade": 0.0,
        "track": {
            "east_m": far_m * float(np.sin(bearing)),
            "north_m": far_m * float(np.cos(bearing)),
            "course_deg": 0.0,
            "speed_mps": 0.0,
        },
        "line": [{"frequency_hz": 300.0 + 37.13 * k, "source_level_db": 100.0} for k in range(8)],
    }
    array = {
        "id": "tow", "kind": "array", "depth_m": 30.0, "full_scale_db": 140.0,
        "element_along_m": PLACES.tolist(),
        "track": {"course_deg": heading, "speed_mps": 10.0},
    }  # fmt: skip
    (recording,) = simulate_recordings(
        make_scenario(
            {"seed": 1, "duration_s": 8.0, "sample_rate_hz": RATE_HZ,
             "sensor": [array], "vessel": [vessel]}
        )
    )  # fmt: skip
    record = BearingTime.join(list(form_beams(recording, kept_probability=1e-4)))
    peaks = record.peaks
    strong = peaks.level_db > peaks.level_db.max() - 3.0
    assert np.count_nonzero(strong) == 8 * record.frames.n_frames
    error = cosine_of(peaks)[strong] - np.cos(np.radians(cone_deg))
    assert np.abs(error).max() < 4e-4
    assert abs(error.mean()) < 2e-4
    assert peaks.bearing_deg[strong] == pytest.approx(heading + cone_deg, abs=0.1)


def test_ahead_and_astern_have_finite_deviations_that_hold():
    for cosine in (1.0, -1.0):
        samples = tones([cosine], [-12.0], duration_s=60.0)
        peaks = beams_of(samples, shading="uniform", overlap=0.0, band_hz=(350.0, 550.0)).peaks
        strong = peaks.snr_db > 20.0
        assert np.count_nonzero(strong) >= 55
        truth = 0.0 if cosine > 0 else 180.0
        error = peaks.cone_deg[strong] - truth
        sigma = np.radians(peaks.cone_std_deg[strong]) ** 2
        wanted = 0.893 * np.degrees(np.sqrt(sigma.mean()))
        assert np.sqrt(np.mean(error**2)) == pytest.approx(wanted, rel=0.3)
        assert np.isfinite(peaks.cone_deg).all()
        assert peaks.cone_std_deg.max() <= 30.0


@pytest.mark.slow
@pytest.mark.parametrize("is_isotropic", [True, False])
def test_noise_exceeds_the_thresholds_of_every_beam_as_often_as_stated(is_isotropic):
    array = {
        "id": "tow", "kind": "array", "depth_m": 30.0, "full_scale_db": 140.0,
        "element_along_m": PLACES[:8].tolist(), "heading_deg": 0.0,
        "element_noise_db": 50.0,
    }  # fmt: skip
    noise = {"density_db": 60.0 if is_isotropic else -60.0}
    table = {"seed": 3, "duration_s": 240.0, "sample_rate_hz": RATE_HZ,
             "sensor": [array], "noise": noise}  # fmt: skip
    (recording,) = simulate_recordings(make_scenario(table))
    counted, cells = np.zeros(37), 0
    for beams, floor, detect in exceedances(recording, 1e-2):
        over = beams.power > detect[:, None].astype(np.float32) * floor
        counted += over.mean(axis=2).sum(axis=1)
        cells += beams.frames.n_frames
    rate = counted / cells
    assert rate.mean() == pytest.approx(1e-2, rel=0.1)
    assert rate.min() > 0.8e-2
    assert rate.max() < 1.25e-2


def exceedances(recording, probability):
    """Yield beams, floors and thresholds as the stage makes them."""
    from unittest.mock import patch

    from uwtrack_cli.arrays import beamform
    from uwtrack_cli.spectra.peaks import threshold_factors

    seen = []

    def find(beams, floor, noise, rules):
        seen.append((beams, floor))
        return found(beams, floor, noise, rules)

    found = beamform.find_beam_peaks
    with patch.object(beamform, "find_beam_peaks", find):
        for _ in form_beams(recording):
            beams, floor = seen.pop()
            yield beams, floor, threshold_factors(
                beams.frames, beams.frequency_hz.size, probability
            )  # fmt: skip


@pytest.mark.parametrize(
    ("widths", "options"),
    [(1.2, {"beamformer": "conventional", "shading": "uniform"}), (0.6, {"beamformer": "mvdr"})],
)
def test_two_sources_are_resolved(widths, options):
    assert both_stand_out(widths, options, seed=2)


def both_stand_out(widths, options, seed):
    """Whether two sources of 10 dB a hydrophone give two maxima near their places."""
    width = C / (449.7 * N)
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((2, round(20 * RATE_HZ)))
    band = np.fft.rfftfreq(white.shape[1], 1.0 / RATE_HZ)
    inside = (band > 440.0) & (band < 460.0)
    samples = rng.standard_normal((white.shape[1], N))
    pair = [-0.5 * widths * width, 0.5 * widths * width]
    for one, cosine in zip(white, pair, strict=True):
        spectrum = np.fft.rfft(one) * inside * np.sqrt(10.0)
        for k, along_m in enumerate(PLACES):
            turn = np.exp(2j * np.pi * band * along_m * cosine / C)
            samples[:, k] += np.fft.irfft(spectrum * turn, white.shape[1])
    record = beams_of(samples, band_hz=(442.0, 458.0), **options)
    power = 10.0 ** (record.level_db[:32] / 10.0).mean(axis=0)
    tops = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] > power[2:])) + 1
    best = sorted(tops, key=lambda k: -power[k])[:2]
    found = np.sort(record.cos_angle[best])
    return len(best) == 2 and np.abs(found - pair).max() < 0.5 * widths * width


def test_blocks_of_reading_change_no_bit():
    samples = tones([0.3], [-10.0], duration_s=40.0)
    made = [
        BearingTime.join(list(form_beams(recording_of(samples, RATE_HZ, FIXED, block=block))))
        for block in (997, 64_000)
    ]
    assert made[0].equals(made[1])
    assert [b.frames.n_frames for b in form_beams(recording_of(samples, RATE_HZ, FIXED))] == [32, 32, 15]  # fmt: skip


def test_a_gap_has_neither_levels_nor_peaks():
    samples = tones([0.3], [-10.0], duration_s=30.0)
    samples[round(8 * RATE_HZ) : round(20 * RATE_HZ), 3] = np.nan
    record = beams_of(samples)
    empty = record.frames.valid_fraction < 0.5
    assert empty.sum() > 20
    assert np.isnan(record.level_db[empty]).all()
    assert np.isfinite(record.level_db[~empty]).all()
    assert not np.isin(record.peaks.frame, np.flatnonzero(empty)).any()


def test_a_dead_hydrophone_is_told_and_left_out():
    samples = tones([0.3], [-10.0], duration_s=20.0)
    dead = samples.copy()
    dead[:, 15] = 0.0
    with pytest.warns(UwtrackWarning, match=r"e15 is silent.* left out"):
        record = beams_of(dead, shading="uniform")
    strong = record.peaks.snr_db > 20.0
    assert strong.any()
    assert cosine_of(record.peaks)[strong] == pytest.approx(0.3, abs=0.01)
    whole = beams_of(samples, shading="uniform").peaks
    ratio = np.median(record.peaks.cone_std_deg[strong]) / np.median(
        whole.cone_std_deg[whole.snr_db > 20.0]
    )
    assert ratio == pytest.approx(1.12, abs=0.06)  # (16/15)^1.5 and less gain


def test_a_loud_hydrophone_is_told():
    samples = tones([0.3], [-10.0])
    samples[:, 2] *= 10.0**0.5
    with pytest.warns(UwtrackWarning, match="e2 is 10 dB above"):
        beams_of(samples)


def test_an_inverted_hydrophone_is_told_and_turned():
    samples = tones([0.3], [10.0], frequency_hz=251.3)
    right = beams_of(samples)
    samples[:, 7] *= -1.0
    with pytest.warns(UwtrackWarning, match="e7 has the opposite sign"):
        turned = beams_of(samples)
    assert turned.level_db == pytest.approx(right.level_db)


def test_too_few_hydrophones_that_work_are_refused():
    samples = tones([0.3], [-10.0])
    samples[:, 1:] = 0.0
    with (
        pytest.warns(UwtrackWarning, match="left out"),
        pytest.raises(DataError, match="beams need 2"),
    ):
        beams_of(samples)


def test_above_the_design_frequency_nothing_is_kept_unless_it_is_marked():
    wide = replace(FIXED, element_along_m=",".join(map(str, 2.0 * PLACES)))
    samples = tones([0.8], [-3.0], frequency_hz=600.0)
    with pytest.warns(UwtrackWarning, match="design frequency of 375 Hz"):
        record = beams_of(samples, wide)
    assert record.peaks.highest_hz < 375.0
    marked = beams_of(samples, wide, above_design="mark").peaks
    near = (np.abs(marked.frequency_hz - 600.0) < 2.0) & (marked.snr_db > 25.0)
    assert near.any()
    assert marked.is_aliased[near].all()
    assert not marked.is_aliased[marked.frequency_hz < 370.0].any()


def test_one_of_a_lines_lobes_stands_for_all_and_is_followed_by_its_frequency():
    wide = replace(FIXED, element_along_m=",".join(map(str, 2.0 * PLACES)))
    samples = tones([0.8], [-3.0], 600.0, 30.0, places=2.0 * PLACES)
    samples += tones([0.8], [-3.0], 300.0, 30.0, 2, 2.0 * PLACES)
    peaks = beams_of(samples, wide, above_design="mark").peaks
    strong = peaks.snr_db > 20.0
    high = strong & (np.abs(peaks.frequency_hz - 600.0) < 2.0)
    # c / (f d) = 1500 / (600 x 4): the lobe of 0.8 within half of it
    assert np.unique(peaks.frame[high]).size == np.count_nonzero(high)
    lobe = cosine_of(peaks)[high] - 0.8
    distance = 1500.0 / (peaks.frequency_hz[high] * 2.0 * (PLACES[1] - PLACES[0]))
    assert lobe == pytest.approx(-np.abs(distance), abs=0.01)
    lines = Lines.join(list(track_lines(iter([peaks]))))
    above, below = (
        (np.abs(lines.measured_frequency_hz - f) < 2.0) & (lines.measured_snr_db > 20.0)
        for f in (600.0, 300.0)
    )
    assert np.isfinite(lines.measured_bearing_deg[above]).all()
    assert np.isnan(lines.bearing_deg[above]).all()
    assert np.isfinite(lines.bearing_deg[below]).all()


def test_bearings_are_written_for_the_side_asked_for_and_not_where_the_array_is_bent():
    samples = tones([np.cos(np.radians(50.0))], [-5.0], duration_s=40.0)
    for side, wanted in (("starboard", 80.0), ("port", 340.0)):
        peaks = beams_of(samples[:8000], side=side).peaks
        strong = peaks.snr_db > 25.0
        assert peaks.bearing_deg[strong] == pytest.approx(wanted, abs=1.0)
    time_s = np.arange(-60.0, 42.0)
    turned = np.radians(30.0 + 3.0 * np.clip(time_s - 10.0, 0.0, 10.0))
    step = 3.0 * np.stack([np.sin(turned), np.cos(turned)])
    east, north = np.cumsum(step, axis=1)
    navigation = Navigation(
        time_s=time_s, east_m=east, north_m=north, heading_deg=np.full(time_s.size, np.nan)
    )
    towed = replace(FIXED, heading_source="way", tow_offset_m=0.0, navigation=navigation)
    record = beams_of(samples, towed, band_hz=(400.0, 500.0))
    bent = record.bend_deg > 0.5
    assert 15 < bent.sum() < 60
    assert np.isnan(record.peaks.bearing_deg[bent[record.peaks.frame]]).all()
    assert np.isfinite(record.peaks.cone_deg).all()
    straight = record.peaks.bearing_deg[~bent[record.peaks.frame]]
    assert np.isfinite(straight).all()
    assert record.heading_deg[[0, -1]] == pytest.approx([30.0, 60.0], abs=0.1)


ROWS = np.arange(0.0, 30.0)
AHEAD = Navigation(time_s=ROWS, east_m=0.0 * ROWS, north_m=3.0 * ROWS, heading_deg=0.0 * ROWS)


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"element_along_m": None, "kind": "omni"}, {}, 'need kind = "array"'),
        ({"heading_source": None}, {}, "neither heading_deg nor navigation"),
        ({"navigation": AHEAD, "heading_source": "way"}, {}, "not tow_offset_m"),
        (
            {"navigation": replace(AHEAD, time_s=ROWS + 1e5), "tow_offset_m": 0.0,
             "heading_source": "way"},
            {}, "do both count from the same start",
        ),
        (
            {"navigation": replace(AHEAD, start_utc_ns=1), "tow_offset_m": 0.0,
             "heading_source": "way"},
            {}, "--start-utc",
        ),
        (
            {"navigation": replace(AHEAD, heading_deg=np.nan * ROWS),
             "tow_offset_m": 0.0, "heading_source": "compass"},
            {}, "have no heading_deg",
        ),
        ({}, {"beamformer": "mvdr", "snapshots": 8, "loading": 0.0}, "no inverse"),
        ({}, {"beams": 17}, "at least 33"),
        ({}, {"band_hz": (800.0, 801.0)}, "hold 8 cells"),
        ({}, {"kept_probability": 1e-6}, "kept_probability must be at least"),
    ],
)  # fmt: skip
def test_what_cannot_be_beamed_is_refused(changes, options, words):
    samples = np.random.default_rng(0).standard_normal((4000, N))
    with pytest.raises((DataError, OptionError), match=words):
        beams_of(samples, replace(FIXED, **changes), **options)


@pytest.mark.parametrize(
    ("rows", "tow_m", "words"),
    [(ROWS, 150.0, "150 m|157.5 m"), (ROWS - 28.5, 0.0, "before the end")],
)
def test_navigation_that_does_not_reach_is_told(rows, tow_m, words):
    short = replace(AHEAD, time_s=rows)
    towed = replace(FIXED, navigation=short, tow_offset_m=tow_m, heading_source="way")
    with pytest.warns(UwtrackWarning, match=words):
        record = beams_of(tones([0.0], [-10.0], duration_s=4.0), towed)
    assert record.heading_deg == pytest.approx(0.0, abs=1e-6)


def test_angles_alone_need_no_heading():
    unplaced = replace(FIXED, heading_source=None)
    record = beams_of(tones([0.5], [-5.0]), unplaced, frame="array")
    assert np.isnan(record.peaks.bearing_deg).all()
    strong = record.peaks.snr_db > 25.0
    assert record.peaks.cone_deg[strong] == pytest.approx(60.0, abs=1.0)
    assert record.ambiguity == "none"
