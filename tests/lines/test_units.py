"""The line stages know no second and no hertz: a recording slowed down by eight.

Every time is eight times as long, every frequency an eighth, and options with units are
changed alike. By powers of two no rounding changes either, so that the lines are the
same to the last bit but for the factor. (Contacts know the frequencies of mains.)
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.lines.line_scenes import line_peaks
from tests.lines.test_multi_resolution import at, drawn, power
from tests.support import DIFAR, recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.multi_resolution import join_rungs
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.track_pda import track_lines_pda
from uwtrack_cli.lines.tracker_options import Gates, Harmonics, ProcessNoise
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

SLOWER = 8.0
N_FRAMES = 400


def scene(seed: int, *, has_bearings: bool) -> Peaks:
    """A line that turns, one that fades, a sweep with a gap, two that cross, a family."""
    frame = np.arange(float(N_FRAMES))
    turning = 200.0 + 0.5 * np.maximum(frame - 150.0, 0.0)
    fading, sweep = np.full(N_FRAMES, 90.0), 420.0 + 0.1 * frame
    turning[148:152] = fading[100:130] = fading[300:330] = sweep[140:170] = np.nan
    cross = 0.03 * (frame - 200.0)
    swing = 1.0 + 2e-3 * np.sin(frame / 60.0)
    family = [13.0 * tooth * swing for tooth in range(51, 57)]
    frequency = np.stack([turning, fading, sweep, 600 + cross, 600 - cross, *family], 1)
    first = 10.0 * np.arange(frequency.shape[1])
    bearing = first + 0.15 * frame[:, None] if has_bearings else None
    return line_peaks(frequency, bearing, clutter=6.0, seen=0.9, snr_db=9.0, seed=seed)


def slowed(peaks: Peaks) -> Peaks:
    frames = replace(
        peaks.frames,
        time_s=peaks.frames.time_s * SLOWER,
        sample_rate_hz=peaks.frames.sample_rate_hz / SLOWER,
        band_low_hz=peaks.frames.band_low_hz / SLOWER,
        band_high_hz=peaks.frames.band_high_hz / SLOWER,
    )
    names = ("frequency_hz", "frequency_std_hz", "lowest_hz", "highest_hz")
    return replace(peaks, frames=frames, **{n: getattr(peaks, n) / SLOWER for n in names})


def options(factor: float) -> dict[str, Any]:
    return {
        "motion": ProcessNoise(
            doppler_ps3=2e-8 / factor**3, bearing_deg2ps3=1e-2 / factor**3,
            bearing_rate_degps=1.0 / factor,
        ),
        "harmonics": Harmonics(spacing_hz=(2.0 / factor, 60.0 / factor)),
    }  # fmt: skip


def followed(peaks: Peaks, factor: float, how: str) -> Lines:
    told = options(factor) | {"gates": Gates(silence_s=120.0 * factor)}
    if how == "pda":
        return Lines.join(list(track_lines_pda(iter([peaks]), **told)))
    found = track_lines(iter([peaks]), initiation=how, **told)
    return Lines.join(list(found))


def assert_same(slow: Lines, usual: Lines, *, exact: bool = True) -> None:
    assert usual.line_id.size >= 3
    assert (usual.line_unresolved_share > 0.0).any()
    for name in ("line", "frame", "line_id", "line_family", "association"):
        assert np.array_equal(getattr(slow, name), getattr(usual, name)), name
    per = np.array([[1.0, SLOWER], [SLOWER, SLOWER**2]])
    rtol = 0.0 if exact else 1e-6
    for name, factor in (
        ("time_s", 1.0 / SLOWER), ("frequency_hz", SLOWER),
        ("frequency_covariance", SLOWER**2 * per),
        ("frequency_rate_hzps", SLOWER**2), ("bearing_deg", 1.0),
        ("bearing_rate_degps", SLOWER), ("bearing_covariance", per),
        ("line_unresolved_share", 1.0),
    ):  # fmt: skip
        ours, theirs = getattr(slow, name) * factor, getattr(usual, name)
        atol = 0.0 if exact else 1e-6 * float(np.nanmax(np.abs(theirs), initial=0.0))
        assert np.allclose(ours, theirs, rtol=rtol, atol=atol, equal_nan=True), name
    ours, theirs = slow.families, usual.families
    assert np.allclose(ours.spacing_hz * SLOWER, theirs.spacing_hz, rtol=1e-9)
    assert np.array_equal(ours.n_members, theirs.n_members)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["score", "count", "pda"])
def test_lines_of_slower_peaks_are_the_same(how: str) -> None:
    peaks = scene(1, has_bearings=True)
    slow, usual = followed(slowed(peaks), SLOWER, how), followed(peaks, 1.0, how)
    # probabilities of doubtful peaks are rounded
    assert_same(slow, usual, exact=how != "pda")


def test_families_of_slower_peaks_are_the_same() -> None:
    peaks = line_peaks(
        np.outer(np.ones(40), [51.3, *(13.0 * np.arange(20, 29))]),
        np.full((40, 10), 70.0), clutter=2.0, seed=2,
    )  # fmt: skip
    slow, usual = (
        classify_peaks(p, spacing_hz=(2.0 / s, 60.0 / s))
        for p, s in ((slowed(peaks), SLOWER), (peaks, 1.0))
    )
    assert isinstance(usual, Families)
    assert usual.family.size > 30
    assert np.array_equal(slow.peak_family, usual.peak_family)
    assert np.array_equal(slow.is_harmonic, usual.is_harmonic)
    for name in ("spacing_hz", "spacing_std_hz", "offset_hz"):
        ours, theirs = getattr(slow, name) * SLOWER, getattr(usual, name)
        assert np.allclose(ours, theirs, rtol=1e-9), name
    assert np.allclose(slow.log10_chance, usual.log10_chance)


def test_traced_lines_of_slower_sound_are_the_same() -> None:
    rate_hz, n = 512.0, 512 * 100
    rng = np.random.default_rng(3)
    time = np.arange(n) / rate_hz
    noise = rng.standard_normal((n, 3)) * np.sqrt([1.0, 1 / 3, 1 / 3])
    tones = np.zeros((n, 3))
    for hz, slope, begin, end, bearing in (  # silences are less than 120 s
        (60.0, 0.0, 0, 100, 30.0), (90.0, 0.3, 0, 70, 90.0), (120.0, -0.3, 20, 100, 200.0),
        (150.0, 0.0, 0, 46, 300.0), (150.0, 0.0, 58, 100, 300.0),
        (200.0, 0.0, 0, 100, 50.0),
    ):  # fmt: skip
        wave = 0.25 * np.cos(2 * np.pi * (hz * time + 0.5 * slope * time**2))
        wave *= (time >= begin) & (time < end)
        angle = np.radians(bearing)
        tones += wave[:, None] * [1.0, np.sin(angle), np.cos(angle)]
    sound = (0.05 * (noise + tones)).astype(np.float32)
    lines = []
    for factor in (SLOWER, 1.0):
        recording = recording_of(sound, rate_hz / factor, DIFAR)
        blocks = compute_spectrogram(recording, window_s=factor)
        # the tails of noise are those of a kHz of frames of one second
        told = options(factor) | {"false_lines_per_khz_hour": 10.0 / factor}
        lines.append(Lines.join(list(trace_lines(blocks, **told))))
    assert_same(*lines, exact=False)


def test_joined_rungs_of_slower_frames_are_the_same() -> None:
    lines = []
    for factor in (SLOWER, 1.0):
        told = [
            drawn(
                w * factor,
                (at(100.0 / factor), power(20.0 / factor, 0.0, 45.0 * factor)),
                (at(131.0 / factor), power(60.0 / factor, 30.0 * factor)),
                (at(170.0 / factor), power(4.0 / factor)),
                duration_s=80.0 * factor,
            )
            for w in (4.0, 1.0, 0.25)
        ]
        lines.append(join_rungs(told))
    slow, usual = lines
    assert usual.line_id.size == 3
    assert np.array_equal(slow.line, usual.line)
    assert np.allclose(slow.time_s, usual.time_s * SLOWER)
    assert np.allclose(slow.window_s, usual.window_s * SLOWER)
