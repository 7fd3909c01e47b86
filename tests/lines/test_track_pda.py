"""Line tracking by probabilistic association: truth, laws, and what it refuses."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from studies.line_association import noise_lines, passage
from studies.tones import simulate_tones
from tests.lines.line_scenes import line_peaks
from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.track_pda import track_lines_pda
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 1000.0
TONES_HZ = np.array([120.3, 211.7, 333.2])


@pytest.fixture(scope="session")
def blocks():
    n = round(120 * RATE_HZ)
    course = np.repeat(TONES_HZ[:, None], n, axis=1)
    samples = simulate_tones(np.random.default_rng(1), course, 8.0, sample_rate_hz=RATE_HZ)
    recording = recording_of(samples, RATE_HZ)
    return [find_peaks(block, kept_probability=0.1) for block in compute_spectrogram(recording)]


def _join(found):
    return Lines.join(list(found))


def test_clear_tones_are_followed_within_their_stated_deviation(blocks):
    lines = _join(track_lines_pda(iter(blocks)))
    assert lines.line_id.size == 3
    error = (
        lines.frequency_hz - TONES_HZ[np.abs(lines.frequency_hz[:, None] - TONES_HZ).argmin(axis=1)]
    )
    variance = lines.frequency_covariance[:, 0, 0]
    assert np.all(variance > 0.0)
    assert 0.05 < (error**2 / variance).mean() < 2.0
    assert np.isfinite(lines.measured_frequency_hz).mean() > 0.8


def test_the_blocks_in_which_frames_arrive_do_not_change_a_bit(blocks):
    whole = _join(track_lines_pda(iter(blocks)))
    joined = type(blocks[0]).join(blocks)
    edges = [0, 1, 50, 51, 120, joined.frames.n_frames]
    parts = []
    for low, high in itertools.pairwise(edges):
        inside = (joined.frame >= low) & (joined.frame < high)
        frames = joined.frames.take("frame", slice(low, high))
        parts.append(
            replace(
                joined.take("peak", np.flatnonzero(inside)), frames=replace(frames, first_frame=low)
            )
        )
    outputs = list(track_lines_pda(iter(parts)))
    assert [o.frames.n_frames for o in outputs[: len(parts)]] == [p.frames.n_frames for p in parts]
    cut = _join(outputs)
    for name in ("line", "frame", "frequency_hz", "frequency_covariance"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name))


@pytest.mark.slow
def test_noise_alone_starts_as_many_lines_as_with_the_plain_tracker():
    counts = [noise_lines(0.1, seed) for seed in range(2)]
    plain = sum(c["track"] for c in counts)
    ours = sum(c["track-pda"] for c in counts)
    # 200 lines wanted per kHz and hour: 8.3 in each recording at most
    assert abs(ours - plain) <= 2
    assert ours <= 2 * 8.3


@pytest.mark.slow
def test_weak_tones_are_covered_in_no_more_pieces_than_with_the_plain_tracker():
    found = [passage(3.0, 0.1, seed) for seed in (1, 2)]
    cover = [np.mean([f[t].cover for f in found]) for t in ("track", "track-pda")]
    pieces = [np.mean([f[t].pieces for f in found]) for t in ("track", "track-pda")]
    assert cover[1] > max(cover[0] - 0.02, 0.75)
    assert pieces[1] <= pieces[0]


def test_strong_tones_are_followed_as_by_the_plain_tracker(blocks):
    ours, plain = _join(track_lines_pda(iter(blocks))), _join(track_lines(iter(blocks)))
    assert ours.line_id.size == plain.line_id.size
    for tone in TONES_HZ:
        means = [x.frequency_hz[np.abs(x.frequency_hz - tone) < 1].mean() for x in (ours, plain)]
        assert means[0] == pytest.approx(means[1], abs=0.01)


@pytest.mark.parametrize("has_bearings", [True, False])
def test_bearings_tell_two_lines_apart_that_cross_slowly(has_bearings):
    """They are as far apart as the gate of a bearing is wide: 35 degrees of 8."""
    time = 0.5 * np.arange(240)
    frequency = np.stack([100.0 + 0.0 * time, 98.5 + time / 40.0], axis=1)
    bearing = np.tile([90.0, 125.0], (time.size, 1)) if has_bearings else None
    peaks = line_peaks(frequency, bearing, std_hz=0.25, bearing_std_deg=8.0, seed=1)
    lines = _join(track_lines_pda(iter([peaks])))
    off = lines.frequency_hz[:, None] - frequency[lines.frame]
    least = [
        np.sqrt(np.mean(off[lines.line == line] ** 2, axis=0)).min()
        for line in np.unique(lines.line)
    ]
    assert (len(least) == 2 and max(least) < 0.1) == has_bearings


def test_families_are_read_through_to_their_peaks_and_refused_without(blocks):
    families = [classify_peaks(block) for block in blocks]
    by_family = _join(track_lines_pda(iter(families)))
    by_peak = _join(track_lines_pda(iter(blocks)))
    np.testing.assert_array_equal(by_family.frequency_hz, by_peak.frequency_hz)
    with pytest.raises(DataError, match="do not carry their peaks"):
        list(track_lines_pda(iter([replace(families[0], peaks=None)])))


@pytest.mark.parametrize("value", [0.0, 0.1, 0.5])
def test_a_floor_of_the_threshold_above_the_peaks_kept_is_refused(blocks, value):
    with pytest.raises(OptionError, match=r"lowest_false_alarm must be .*below .*got"):
        list(track_lines_pda(iter(blocks), lowest_false_alarm=value))
