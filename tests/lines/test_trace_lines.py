"""Track-before-detect: laws, false lines, many lines, gaps, bearings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import poisson

from studies.line_sound import detect_line
from studies.trace_noise import RATE_HZ as NOISE_RATE_HZ
from studies.trace_noise import noise_recording
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.paths.trace_threshold import PathBearing
from uwtrack_cli.lines.paths.trace_window import to_window
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 1024.0


def sound(
    tones: list[tuple[float, float]], length_s: float = 90.0, seed: int = 1, **options
) -> list[Spectrogram]:
    """Noise of variance one with steady tones: frequency and SNR in 1 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(length_s * RATE_HZ)) / RATE_HZ
    samples = rng.standard_normal(time.size)
    for frequency, snr_db in tones:
        amplitude = np.sqrt(4.0 * 10.0 ** (snr_db / 10.0) / RATE_HZ)
        samples += amplitude * np.cos(2 * np.pi * frequency * time + rng.uniform(0, 6))

    def read(block: int):
        for start in range(0, time.size, block):
            yield 0.05 * samples[start : start + block, None].astype(np.float32)

    recording = Recording(
        sensor=Sensor(id="h1"), name="t", sample_rate_hz=RATE_HZ,
        n_samples=time.size, n_channels=1, reader=read,
    )  # fmt: skip
    return list(compute_spectrogram(recording, **options))


def joined(blocks: list[Spectrogram], **options) -> Lines:
    return Lines.join(list(trace_lines(iter(blocks), **options)))


def cut(whole: Spectrogram, start: int, stop: int) -> Spectrogram:
    block = whole.take("frame", slice(start, stop))
    return replace(block, frames=replace(block.frames, first_frame=start))


@pytest.mark.parametrize("block", [16, 64, 176])
def test_the_cut_into_blocks_changes_no_bit(block: int) -> None:
    whole = Spectrogram.join(sound([(150.0, 6.0), (301.2, 12.0)]))
    n = whole.frames.n_frames
    blocks = [cut(whole, k, min(k + block, n)) for k in range(0, n, block)]
    out = list(trace_lines(iter(blocks)))
    assert [b.frames.n_frames for b in out[: len(blocks)]] == [b.frames.n_frames for b in blocks]
    assert Lines.join(out).equals(joined([whole]))


def test_many_lines_of_unequal_strength_are_found_once_each() -> None:
    tones = [(80.0, 6.0), (130.0, 30.0), (137.0, 8.0), (222.3, 4.0), (380.0, 15.0)]
    lines = joined(sound(tones))
    found = sorted(float(np.median(lines.frequency_hz[lines.line == k])) for k in lines.line_id)
    assert len(found) == len(tones)
    assert np.allclose(found, [f for f, _ in tones], atol=0.2)


def test_a_line_through_many_windows_keeps_its_number_and_every_frame() -> None:
    blocks = sound([(200.0, 8.0)], length_s=300.0)
    lines = joined(blocks)
    frames = np.sort(lines.frame[lines.line == lines.line_id[0]])
    n_frames = sum(b.frames.n_frames for b in blocks)
    assert lines.line_id.size == 1
    assert np.array_equal(frames, np.unique(frames))
    assert frames.size >= n_frames - 4


def test_false_lines_in_noise_come_at_the_stated_rate() -> None:
    rate, hours = 60.0, 0.25
    blocks = list(compute_spectrogram(noise_recording(11, hours)))
    count = joined(blocks, false_lines_per_khz_hour=rate).line_id.size
    expected = rate * 2.046 * hours
    # the stated rate, with a fifth for the fit of the tail
    assert poisson.ppf(0.001, 0.7 * expected) <= count
    assert count <= poisson.ppf(0.999, 1.2 * expected)


@pytest.mark.slow
def test_noise_in_longer_frames_is_the_same_noise_in_another_unit_of_time() -> None:
    """Samples at a rate and in frames so many times slower hold the same kHz hours."""
    noise = noise_recording(12, 0.1)
    found = []
    for window_s in (1.0, 0.5, 4.0, 8.0, 12.0):
        slower = replace(noise, sample_rate_hz=NOISE_RATE_HZ / window_s)
        blocks = list(compute_spectrogram(slower, window_s=window_s))
        lines = joined(blocks, false_lines_per_khz_hour=90.0)
        found.append(np.sort([
            np.median(lines.frequency_hz[lines.line == k]) * window_s
            for k in lines.line_id
        ]))  # fmt: skip
    assert found[0].size > 3
    for other in found[1:]:
        assert other == pytest.approx(found[0], abs=0.5)


def directional_sound(
    seed: int, length_s: float, snr_db: float = -90.0, share: float = 0.0
) -> list[Spectrogram]:
    """Vector sensor: isotropic noise, a share of it from 40 deg, a tone from 130."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(length_s * RATE_HZ)) / RATE_HZ
    noise = rng.standard_normal((time.size, 3)) * np.sqrt([1.0, 1 / 3, 1 / 3])
    amplitude = np.sqrt(4.0 * 10.0 ** (snr_db / 10.0) / RATE_HZ)
    angle = 2 * np.pi * (rng.uniform(150, 350) * time + 0.02 * time**2)
    waves = [
        (40.0, np.sqrt(share) * rng.standard_normal(time.size)),
        (130.0, amplitude * np.cos(angle + rng.uniform(0, 6))),
    ]
    samples = noise * np.sqrt(1.0 - share)
    for bearing, wave in waves:
        way = np.radians(bearing)
        samples += wave[:, None] * np.array([1.0, np.sin(way), np.cos(way)])
    samples = (0.05 * samples).astype(np.float32)

    def read(block: int):
        for start in range(0, time.size, block):
            yield samples[start : start + block]

    sensor = Sensor(id="v", kind="difar", channels="omni,east,north")
    recording = Recording(
        sensor=sensor, name="t", sample_rate_hz=RATE_HZ,
        n_samples=time.size, n_channels=3, reader=read,
    )  # fmt: skip
    return list(compute_spectrogram(recording))


def without_bearing(blocks: list[Spectrogram]) -> list[Spectrogram]:
    return [replace(b, intensity_east=None, intensity_north=None) for b in blocks]


@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.long), 0.5])
def test_noise_from_one_bearing_starts_no_more_lines_than_stated(share: float) -> None:
    rate, length_s = 150.0, 900.0
    blocks = directional_sound(3, length_s, share=share)
    count = joined(blocks, false_lines_per_khz_hour=rate).line_id.size
    stated = rate * 0.512 * length_s / 3600.0
    assert count <= poisson.ppf(0.999, stated)


def test_one_bearing_along_a_path_tells_weaker_lines() -> None:
    with_bearing = without = 0
    for seed in range(14):
        blocks = directional_sound(seed, 60.5, snr_db=-2.0)
        for at, given in enumerate((blocks, without_bearing(blocks))):
            lines = joined(given, false_lines_per_khz_hour=4.8)
            heard = lines.line_id.size > 0
            with_bearing += heard and at == 0
            without += heard and at == 1
    # measured over 60: twice to four times as many at this SNR
    assert with_bearing >= without + 2


def test_the_evidence_of_one_bearing_is_exponential_in_noise() -> None:
    for share in (0.0, 0.9):
        whole = Spectrogram.join(directional_sound(5, 61.0, share=share))
        data = to_window(whole, slice(4, None))
        n_frames, n_cells = data.power.shape
        data = replace(data, floor=np.ones(data.power.shape, np.float32))
        rows = np.zeros(n_frames, dtype=int)
        paths = np.stack([rows + cell for cell in range(60, n_cells - 60, 3)])
        evidence = PathBearing(data, 1.0, 0.0).scores(paths)
        for level in (1.0, 2.0, 3.0):
            expected = np.exp(-level)
            spread = np.sqrt(expected * (1.0 - expected) / len(paths))
            assert abs(np.mean(evidence > level) - expected) < 4.0 * spread


@pytest.mark.long
def test_a_line_of_the_stated_weakest_snr_is_heard_about_every_other_time() -> None:
    blocks = sound([], length_s=70.0)
    weakest_db = joined(blocks, false_lines_per_khz_hour=4.8).weakest_line_snr_db
    # cell to 1 Hz: the Hann window's noise bandwidth of 1.5 bins
    snr_db = weakest_db + 10 * np.log10(1.5)
    heard = np.mean([detect_line("trace", snr_db, seed).is_detected for seed in range(40)])
    assert 0.2 <= heard <= 0.8


def test_a_gap_is_no_evidence_against_a_line() -> None:
    whole = Spectrogram.join(sound([(180.0, 10.0)], length_s=120.0))
    valid_fraction = whole.frames.valid_fraction.copy()
    valid_fraction[80:112] = 0.0
    power = whole.power_density.copy()
    power[80:112] = 0.0
    frames = replace(whole.frames, valid_fraction=valid_fraction)
    lines = joined([replace(whole, frames=frames, power_density=power)])
    assert lines.line_id.size == 1
    assert not np.isin(np.arange(80, 112), lines.frame).any()
    assert lines.frame.max() > 220


def test_smoothed_frequencies_hold_their_stated_deviations() -> None:
    scores = []
    for seed in range(10):
        lines = joined(sound([(203.3, 10.0)], seed=seed))
        error = lines.frequency_hz - 203.3
        scores.append(error**2 / lines.frequency_covariance[:, 0, 0])
    nees = float(np.concatenate(scores).mean())
    # a steady tone is smoother than the model, so errors are small, never large
    assert nees < 1.2


@pytest.mark.parametrize(
    "options",
    [
        {"false_lines_per_khz_hour": 0.0},
        {"window_frames": 30},
        {"window_frames": 122},
        {"shortest_frames": 2},
        {"band_hz": (100.0, 163.0)},  # 127 cells of 128
    ],
)
def test_options_out_of_range_are_refused(options: dict) -> None:
    with pytest.raises(OptionError, match=r"got|holds"):
        joined(sound([], length_s=20.0), **options)


def test_the_narrowest_band_is_traced() -> None:
    assert joined(sound([], length_s=20.0), band_hz=(100.0, 163.5)).line.size == 0


def test_frames_whose_noise_is_not_known_are_refused_with_the_known_ones() -> None:
    with pytest.raises(OptionError, match=r"overlap 0\.5 with zero padding 2"):
        joined(sound([], length_s=20.0, overlap=0.25))
