"""Tracking of lines on simulated peaks: laws, identities, gaps, contacts, hum."""

import numpy as np
import pytest
from scipy.signal import firwin, lfilter
from scipy.stats import poisson

from studies.line_sound import detect_line, minute, score
from studies.trace_noise import noise_recording
from tests.draws.long_lines import lines_heard
from tests.lines.line_scenes import cut, doppler, line_peaks, passage_bearing, some_frames
from tests.support import DIFAR, recording_of
from uwtrack_cli.data.lines import COASTED, Lines
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.kalman import KalmanState
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.followed_lines import FollowedLines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracker_options import (
    CountLogic,
    Feedback,
    Gates,
    Harmonics,
    ProcessNoise,
    ScoreLogic,
)
from uwtrack_cli.lines.tracking.track_management import merge_lines
from uwtrack_cli.lines.tracking.track_store import TrackStore
from uwtrack_cli.lines.tracking.tracker import LastLook
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram


def track(peaks: Peaks, **options) -> Lines:
    return Lines.join(list(track_lines(iter([peaks]), **options)))


def vessel(n_frames: int = 600, **motion) -> tuple[np.ndarray, np.ndarray]:
    time = some_frames(n_frames).time_s
    options = {"closest_s": 150.0, "speed": 6.0, "range_m": 250.0} | motion
    rest = np.array([63.0, 126.0, 189.0, 310.0])
    frequency = rest * (1.0 + doppler(time, **options)[:, None])
    bearing = np.repeat(passage_bearing(time, **options)[:, None], 4, axis=1)
    return frequency, bearing


def owner(lines: Lines, frequency: np.ndarray) -> dict[int, int]:
    """True line of each tracked one, by the median distance."""
    return {
        int(k): int(
            np.argmin(
                np.median(
                    np.abs(lines.frequency_hz[at][:, None] - frequency[lines.frame[at]]), axis=0
                )
            )
        )
        for k in lines.line_id
        for at in [lines.line == k]
    }


@pytest.mark.parametrize("initiation", ["score", "count"])
def test_the_cut_into_blocks_changes_no_bit(initiation: str) -> None:
    frequency, bearing = vessel()
    peaks = line_peaks(frequency, bearing)
    whole = track(peaks, initiation=initiation)
    for block in (1, 37) if initiation == "score" else (37,):  # chunks are of 256
        blocks = [cut(peaks, k, min(k + block, 600)) for k in range(0, 600, block)]
        out = list(track_lines(iter(blocks), initiation=initiation))
        assert [b.frames.n_frames for b in out[: len(blocks)]] == [
            b.frames.n_frames for b in blocks
        ]
        assert Lines.join(out).equals(whole), block


@pytest.mark.slow
def test_what_is_known_so_far_is_what_the_end_would_give() -> None:
    """Asked within a chunk, behind one and behind two; asking changes nothing."""
    frequency, bearing = vessel()
    peaks = line_peaks(frequency, bearing)
    scan = track_lines(cut(peaks, k, k + 40) for k in range(0, 600, 40))
    assert isinstance(scan, FollowedLines)
    scan.remember(1e9)
    out = []
    for n_frames, block in zip(range(40, 640, 40), scan, strict=False):
        out.append(block)
        if n_frames in {40, 200, 320, 560}:
            known = scan.so_far(-np.inf)
            assert known is not None
            assert known.equals(track(cut(peaks, 0, n_frames)))
    part = scan.so_far(150.0)
    assert part is not None
    assert part.frames.time_s[0] <= 150.0 <= part.frames.time_s[40]
    assert part.time_s.min() >= part.frames.time_s[0]
    assert part.line_id.tolist() == known.line_id.tolist()
    assert Lines.join([*out, *scan]).equals(track(peaks))


def test_a_passage_gives_one_line_per_tone_and_one_contact() -> None:
    frequency, bearing = vessel()
    lines = track(line_peaks(frequency, bearing))
    assert sorted(owner(lines, frequency).values()) == [0, 1, 2, 3]
    assert lines.line_contact.tolist() == [1, 1, 1, 1]
    assert set(lines.line_status) == {"moving"}
    assert all(np.count_nonzero(lines.line == k) >= 595 for k in lines.line_id)


def test_points_are_ordered_by_line_and_frame() -> None:
    frequency, bearing = vessel()
    lines = track(line_peaks(frequency, bearing))
    order = np.lexsort((lines.frame, lines.line))
    assert np.array_equal(order, np.arange(lines.line.size))


def test_stated_deviations_of_smoothed_frequencies_hold() -> None:
    inside, squares = [], []
    for seed in range(5):
        time = some_frames(400).time_s
        frequency = (200.0 + 0.5 * np.sin(2 * np.pi * time / 120.0))[:, None]
        lines = track(line_peaks(frequency, seed=seed, clutter=0.0))
        at = (lines.frame > 20) & (lines.frame < 380)
        error = lines.frequency_hz[at] - frequency[lines.frame[at], 0]
        score = error / np.sqrt(lines.frequency_covariance[at, 0, 0])
        inside.append(np.mean(np.abs(score) < 1.96))
        squares.append(np.mean(score**2))
    # the wave is smoother than the model, so the errors may be somewhat small
    assert 0.93 <= np.mean(inside) <= 1.0
    assert 0.3 <= np.mean(squares) <= 1.2


def test_lines_that_cross_keep_their_identity() -> None:
    time = some_frames(400).time_s
    one = 300.0 + 0.06 * (time - 100.0)
    two = 300.0 - 0.06 * (time - 100.0)
    bearing = np.stack([40.0 + 0.5 * time, 140.0 - 0.5 * time], axis=1)
    swaps = 0
    for seed in range(4):
        frequency = np.stack([one, two], axis=1)
        lines = track(line_peaks(frequency, bearing, seed=seed))
        names = owner(lines, frequency)
        for k, line in names.items():
            at = lines.line == k
            late = at & (lines.frame > 300)
            if late.any():
                away = np.abs(lines.frequency_hz[late] - frequency[lines.frame[late], line])
                swaps += np.median(away) > 1.0
        long = [k for k in names if np.count_nonzero(lines.line == k) > 350]
        assert len(long) == 2
    assert swaps == 0


def test_a_line_swept_by_a_bin_per_frame_is_followed() -> None:
    frequency = (200.0 + 1.0 * np.arange(120))[:, None]
    motion = ProcessNoise(frequency_hz2ps3=1e-2)
    lines = track(line_peaks(frequency, clutter=2.0), motion=motion)
    longest = max(np.count_nonzero(lines.line == k) for k in lines.line_id)
    assert longest >= 110
    assert np.median(np.abs(lines.frequency_hz - frequency[lines.frame, 0])) < 0.2


def test_missing_time_is_no_missed_detection() -> None:
    valid_fraction = np.ones(300)
    valid_fraction[100:130] = 0.0
    frequency = np.full((300, 1), 150.0)
    lines = track(line_peaks(frequency, clutter=1.0, valid_fraction=valid_fraction))
    assert lines.line_id.size == 1
    assert not np.isin(np.arange(100, 130), lines.frame).any()
    assert lines.frame.max() >= 295


def test_a_gap_too_long_for_a_lines_identity_ends_it() -> None:
    valid_fraction = np.ones(700)
    valid_fraction[100:600] = 0.0
    frequency = np.full((700, 1), 150.0)
    lines = track(line_peaks(frequency, clutter=1.0, valid_fraction=valid_fraction))
    assert lines.line_id.size == 2


@pytest.mark.parametrize("initiation", ["count", "score"])
def test_a_line_that_falls_silent_goes_on_under_its_number(initiation) -> None:
    frequency = np.full((300, 1), 150.0)
    frequency[100:130] = np.nan
    lines = track(line_peaks(frequency, clutter=1.0), initiation=initiation)
    assert lines.line_id.size == 1
    assert not np.isin(np.arange(110, 125), lines.frame).any()
    assert np.isin(np.arange(140, 290), lines.frame).all()


def test_a_sweep_that_falls_silent_is_found_again_on_its_course() -> None:
    """In 15 s without sound it moves by three resolutions."""
    frequency = (200.0 + 0.1 * np.arange(300.0))[:, None]
    frequency[140:170] = np.nan
    assert track(line_peaks(frequency, clutter=1.0)).line_id.size == 1


@pytest.mark.parametrize("rate_hz", [0.3, 0.8])
def test_a_line_that_turns_at_once_keeps_its_number(rate_hz) -> None:
    """By so much in each frame, after a minute and a quarter at one frequency."""
    frequency = (200.0 + rate_hz * np.maximum(np.arange(300.0) - 150.0, 0.0))[:, None]
    frequency[148:152] = np.nan
    lines = track(line_peaks(frequency, clutter=1.0))
    assert lines.line_id.size == 1
    assert lines.line.size >= 290


@pytest.mark.parametrize("initiation", ["count", "score"])
def test_another_line_after_a_silence_has_another_number(initiation) -> None:
    frequency = np.full((300, 1), 150.0)
    frequency[100:130], frequency[130:] = np.nan, 156.0
    lines = track(line_peaks(frequency, clutter=1.0), initiation=initiation)
    assert lines.line_id.size == 2


def test_eight_lines_that_fade_keep_their_numbers() -> None:
    rest = np.array([63.0, 97.5, 131.0, 188.0, 240.0, 291.5, 350.0, 412.0])
    frequency = np.tile(rest, (500, 1))
    for start in range(60, 500, 100):  # 20 s without sound in every 50 s
        frequency[start : start + 40] = np.nan
    lines = track(line_peaks(frequency, clutter=1.0))
    assert lines.line_id.size <= 10
    for k in lines.line_id:  # and each number is of one line
        own = np.abs(lines.frequency_hz[lines.line == k, None] - rest).argmin(axis=1)
        assert np.mean(own == np.median(own)) >= 0.97


@pytest.mark.slow
def test_a_steady_line_is_known_far_better_than_a_frame() -> None:
    frequency = np.full((400, 1), 150.0)
    std_hz = 0.1
    errors = []
    for seed in range(6):
        lines = track(line_peaks(frequency, clutter=1.0, seed=seed, std_hz=std_hz))
        errors += list(lines.frequency_hz[lines.frame >= 120] - 150.0)
    assert np.sqrt(np.mean(np.square(errors))) <= 0.3 * std_hz
    fixed = ProcessNoise(adaptation=0.0)
    lines = track(line_peaks(frequency, clutter=1.0, std_hz=std_hz), motion=fixed)
    off = lines.frequency_hz[lines.frame >= 120] - 150.0
    assert np.sqrt(np.mean(off**2)) > 0.3 * std_hz


@pytest.mark.parametrize("scatter_hz", [pytest.param(0.0, marks=pytest.mark.long), 0.2])
def test_a_line_wider_than_its_peaks_promise_has_honest_deviations(scatter_hz) -> None:
    inside = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        frequency = 150.0 + scatter_hz * rng.normal(size=(600, 1))  # 0.1 Hz is stated
        lines = track(line_peaks(frequency, clutter=1.0, seed=seed))
        own = np.abs(lines.frequency_hz - 150.0) < 2.0
        assert np.unique(lines.line[own]).size == 1
        late = own & (lines.frame >= 300)
        std = np.sqrt(lines.frequency_covariance[late, 0, 0])
        inside += list(np.abs(lines.frequency_hz[late] - 150.0) < 1.96 * std)
    # a smoothed line has some dozen independent values in 300 frames
    assert np.mean(inside) >= 0.87


@pytest.mark.parametrize("between_deg", [90.0, 270.0])
def test_two_lines_that_are_one_become_one_though_another_vessels_lies_between(
    between_deg: float,
) -> None:
    store = TrackStore()
    store.track_bearings()
    position = np.array([[100.0, 100.1, 100.2], [90.0, between_deg, 91.0]])
    still = np.zeros_like(position)
    state = KalmanState(position, still, still + 0.01, still, still + 1e-4)
    noise, measured = np.zeros((2, 3)), np.zeros((6, 3))
    store.start(state, noise, measured, np.ones(3, bool), np.ones(3), np.ones(3))
    merge_lines(store, Gates(), resolution_hz=1.0)
    others = {90.0: [0], 270.0: [0, 1]}  # the first of those that are one stays
    assert store.active().tolist() == others[between_deg]


def test_two_vessels_with_crossing_bearings_stay_two_contacts() -> None:
    time = some_frames(600).time_s
    courses = [
        {"closest_s": 140.0, "speed": 6.0, "range_m": 200.0},
        {"closest_s": 165.0, "speed": -8.0, "range_m": 300.0},
    ]
    rests = [np.array([80.0, 131.0, 240.0]), np.array([97.0, 171.0, 288.0])]
    frequency = np.concatenate(
        [
            rest * (1.0 + doppler(time, **course)[:, None])
            for course, rest in zip(courses, rests, strict=True)
        ],
        axis=1,
    )
    bearing = np.concatenate(
        [np.repeat(passage_bearing(time, **course)[:, None], 3, axis=1) for course in courses],
        axis=1,
    )
    lines = track(line_peaks(frequency, bearing))
    names = owner(lines, frequency)
    contact = dict(zip(lines.line_id.tolist(), lines.line_contact.tolist(), strict=True))
    groups = [{contact[k] for k, v in names.items() if v // 3 == side} for side in (0, 1)]
    assert [len(group) for group in groups] == [1, 1]
    assert groups[0] != groups[1]


def test_without_bearings_shared_doppler_groups_the_lines() -> None:
    time = some_frames(600).time_s
    one = {"closest_s": 100.0, "speed": 8.0, "range_m": 150.0}
    two = {"closest_s": 220.0, "speed": 8.0, "range_m": 150.0}
    frequency = np.concatenate(
        [
            np.array([180.0, 310.0]) * (1 + doppler(time, **one)[:, None]),
            np.array([233.0, 402.0]) * (1 + doppler(time, **two)[:, None]),
        ],
        axis=1,
    )
    lines = track(line_peaks(frequency))
    names = owner(lines, frequency)
    contact = {names[int(k)]: c for k, c in zip(lines.line_id, lines.line_contact, strict=True)}
    assert contact[0] == contact[1] != contact[2] == contact[3]


def test_mains_multiples_are_marked_as_hum_and_kept() -> None:
    frequency, _ = vessel()
    hum = np.tile([50.0, 100.0, 250.0], (600, 1))
    everything = np.concatenate([frequency, hum], axis=1)
    lines = track(line_peaks(everything))
    names = owner(lines, everything)
    status = {names[int(k)]: s for k, s in zip(lines.line_id, lines.line_status, strict=True)}
    assert [status[k] for k in (4, 5, 6)] == ["hum"] * 3
    assert all(status[k] == "moving" for k in (1, 2, 3))


def test_a_family_has_one_number_over_its_life() -> None:
    time = some_frames(500).time_s
    shift = 1.0 + doppler(time, closest_s=125.0, speed=7.0, range_m=200.0)[:, None]
    frequency = (12.5 * np.arange(3, 12)) * shift
    lines = track(line_peaks(frequency))
    members = lines.line_family[lines.line_family >= 0]
    assert lines.families.family.size == 1
    assert members.size >= 8
    # as heard when it was surest, with its Doppler of at most v/c
    assert np.isclose(lines.families.spacing_hz[0], 12.5, rtol=7.0 / 1500.0)
    assert lines.families.is_harmonic[0]
    assert lines.families.n_members[0] == members.size


def test_a_strong_line_does_not_swallow_a_weak_neighbour() -> None:
    frequency = np.tile([200.0, 203.0], (300, 1))
    lines = track(line_peaks(frequency, seen=0.9))
    assert sorted(np.round(np.median(lines.frequency_hz[lines.line == k]))
                  for k in lines.line_id) == [200.0, 203.0]  # fmt: skip


def test_false_lines_in_noise_are_not_more_than_stated() -> None:
    n_frames, found = 1800, 0
    for seed in range(2):
        none = np.full((n_frames, 1), np.nan)
        peaks = line_peaks(none, clutter=9.0, seed=seed)
        rule = ScoreLogic(false_lines_per_khz_hour=20.0)
        found += track(peaks, score=rule).line_id.size
    # half an hour and one kHz in all: Poisson with mean 10 exceeds 20 once in 700
    assert found <= 20


def noise_peaks(hours: float, kept: float, seed: int) -> list[Peaks]:
    blocks = compute_spectrogram(noise_recording(seed, hours))
    return [find_peaks(block, kept_probability=kept) for block in blocks]


@pytest.mark.parametrize("kept", [0.01, 0.1])
def test_false_lines_in_sound_come_near_the_stated_rate(kept: float) -> None:
    rate, hours = 200.0, 0.1
    rule = ScoreLogic(false_lines_per_khz_hour=rate)
    blocks = noise_peaks(hours, kept, seed=21)
    count = Lines.join(list(track_lines(iter(blocks), score=rule))).line_id.size
    stated = rate * 2.048 * hours
    # at or below the stated rate, and not below a third of it
    assert poisson.ppf(0.001, stated / 3.0) <= count <= poisson.ppf(0.999, stated)


@pytest.mark.slow
def test_sharp_edges_of_the_noise_are_no_lines() -> None:
    found = 0
    for step_db in (10.0, 30.0):
        rng = np.random.default_rng(12)
        rate, n_samples = 2048.0, 2048 * 300
        noise = rng.standard_normal((2, n_samples))
        low = lfilter(firwin(2001, 300.0, fs=rate), 1.0, noise[0])
        sound = 0.1 * (low + 10.0 ** (-step_db / 20.0) * noise[1])
        recording = recording_of(sound.astype(np.float32), rate)
        blocks = [find_peaks(block) for block in compute_spectrogram(recording)]
        found += Lines.join(list(track_lines(iter(blocks)))).line_id.size
    # a floor interpolated across the steps lets 23 through
    assert found <= 2


@pytest.mark.long
def test_half_a_decibel_above_the_published_snr_most_lines_are_heard() -> None:
    # a Kalman filter with a cumulative score: 1.8 dB in 1 Hz
    heard = [detect_line("score", 1.8 + 0.5, seed).is_detected for seed in range(24)]
    # nine of 24 come once in 130 times if it is one half
    assert sum(heard) > 9


@pytest.mark.slow
def test_a_line_of_the_stated_weakest_snr_is_heard_about_every_other_time() -> None:
    blocks, _ = minute(-80.0, 0)
    weakest_db = score(blocks).weakest_line_snr_db
    # cell to 1 Hz: the Hann window's noise bandwidth of 1.5 bins
    snr_db = weakest_db + 10 * np.log10(1.5)
    heard = np.mean([detect_line("score", snr_db, seed).is_detected for seed in range(14)])
    assert 0.15 <= heard <= 0.85


def test_raw_measurements_stand_beside_smoothed_states() -> None:
    frequency, bearing = vessel(200)
    peaks = line_peaks(frequency, bearing, seen=0.8)
    lines = track(peaks)
    coasted = lines.association == COASTED
    assert coasted.any()
    assert np.isnan(lines.measured_frequency_hz[coasted]).all()
    keys = set(zip(peaks.frame.tolist(), peaks.frequency_hz.tolist(), strict=True))
    own = zip(lines.frame[~coasted].tolist(),
              lines.measured_frequency_hz[~coasted].tolist(), strict=True)  # fmt: skip
    assert all(pair in keys for pair in own)


def test_a_shift_in_time_shifts_times_only() -> None:
    from dataclasses import replace

    frequency, bearing = vessel(200)
    peaks = line_peaks(frequency, bearing)
    moved = replace(peaks, frames=replace(peaks.frames, time_s=peaks.frames.time_s + 64.0))
    here, there = track(peaks), track(moved)
    assert np.array_equal(there.time_s, here.time_s + 64.0)
    assert np.allclose(there.frequency_hz, here.frequency_hz, atol=1e-9)
    assert np.array_equal(there.line_contact, here.line_contact)


def test_births_by_families_need_families() -> None:
    frequency, bearing = vessel()
    lone = line_peaks(frequency[:, :2], bearing[:, :2])
    rule = Feedback(births="families")
    assert track(classify_peaks(lone), feedback=rule).line_id.size == 0
    teeth = 100.0 + 12.5 * np.tile(np.arange(9), (200, 1))
    family = classify_peaks(line_peaks(teeth))
    assert track(family, feedback=rule).line_id.size == 9


def test_families_without_their_peaks_are_refused_with_the_next_command() -> None:
    frequency, _ = vessel(100)
    families = track(line_peaks(frequency)).families
    with pytest.raises(DataError, match="uwtrack classify"):
        list(track_lines(iter([families])))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: CountLogic(start_hits=6, start_frames=5),
        lambda: Feedback(alpha=0.0),
        lambda: Feedback(beta=0.5),
        lambda: Gates(sigmas=-1.0),
        lambda: ScoreLogic(false_lines_per_khz_hour=0.0),
        lambda: ProcessNoise(doppler_ps3=-1.0),
        lambda: Feedback(every_frames=6, hold_frames=5),
        lambda: Harmonics(spacing_hz=(5.0, 2.0)),
        lambda: Gates(merge_hz=1e308),
    ],
    ids=["window", "alpha", "beta", "gate", "rate", "motion", "hold", "spacing", "merge"],
)
def test_options_outside_their_meaning_are_refused(wrong) -> None:
    with pytest.raises(OptionError, match="got"):
        wrong()


@pytest.mark.parametrize(("n_lines", "n_looks"), [(20, 12), (220, 3)])
def test_families_are_sought_less_often_among_very_many_lines(monkeypatch, n_lines, n_looks):
    """In 60 frames every fifth; of 220 lines, of which pairs are many, every 20th."""
    looks = []
    found = LastLook.find_combs
    monkeypatch.setattr(LastLook, "find_combs", lambda *given: looks.append(1) or found(*given))
    frequency = np.tile(20.0 + 4.0 * np.arange(n_lines), (60, 1))
    lines = track(line_peaks(frequency))
    assert abs(len(looks) - n_looks) <= 1
    assert (lines.line_family >= 0).any()


@pytest.mark.parametrize(("command", "level_db"), [("track", -4.0), ("trace", -9.0)])
def test_frames_of_eight_seconds_hear_steady_lines_far_below_those_of_one(command, level_db):
    assert lines_heard(command, 8.0, level_db, 33) >= 6  # of 8; the band is one in two


def test_a_line_is_followed_through_a_passage_near_a_vector_sensor():
    """Twenty metres off at 6 m/s the bearing turns by 17 degrees a second."""
    rate_hz, n = 500.0, 100_000
    time_s = np.arange(n) / rate_hz
    along_m = 6.0 * (time_s - 100.0)
    range_m = np.hypot(along_m, 20.0)
    bearing = np.arctan2(along_m, 20.0)
    phase = 2.0 * np.pi * 60.0 * (time_s - range_m / 1500.0)
    rng = np.random.default_rng(5)
    tone = np.sin(phase) * np.minimum(1.0, 60.0 / range_m)
    channels = [tone, tone * np.sin(bearing), tone * np.cos(bearing)]
    noise = rng.standard_normal((n, 3)) * [1.0, 3**-0.5, 3**-0.5]
    recording = recording_of(
        (np.stack(channels, axis=1) + noise).astype(np.float32), rate_hz, DIFAR
    )
    blocks = compute_spectrogram(recording, band_hz=(20.0, 100.0))
    lines = Lines.join(list(track_lines(find_peaks(block) for block in blocks)))
    near = (np.abs(lines.frequency_hz - 60.0) < 1.0) & (np.abs(lines.time_s - 100.0) < 40.0)
    assert np.unique(lines.line[near]).size == 1
    is_taken = near & (lines.association != COASTED)
    assert np.count_nonzero(is_taken) >= 150  # of 160 frames
    truth = np.degrees(np.arctan2(6.0 * (lines.time_s[is_taken] - 100.0), 20.0))
    off = (lines.bearing_deg[is_taken] - truth + 180.0) % 360.0 - 180.0
    assert np.median(np.abs(off)) < 5.0
    assert np.abs(off).max() < 30.0  # the filter follows a second late
