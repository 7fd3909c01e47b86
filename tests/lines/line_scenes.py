"""Peaks of simulated lines for the tests of the line stages."""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks

HOP_S, WINDOW_S, RATE_HZ = 0.5, 1.0, 2000.0


def some_frames(n_frames: int, valid_fraction: np.ndarray | None = None) -> Frames:
    number = np.arange(n_frames)
    return Frames(
        start_sample=(number * HOP_S * RATE_HZ).astype(np.int64),
        time_s=number * HOP_S + 0.5 * WINDOW_S,
        valid_fraction=np.ones(n_frames) if valid_fraction is None else valid_fraction,
        band_low_hz=np.array([0.0]),
        band_high_hz=np.array([1000.0]),
        noise_db=np.zeros((n_frames, 1)),
        threshold_db=np.full(n_frames, 9.6),
        sensor="h1",
        sample_rate_hz=RATE_HZ,
        window_samples=2000,
        hop_samples=1000,
        fft_length=4000,
    )


def line_peaks(
    frequency_hz: np.ndarray,
    bearing_deg: np.ndarray | None = None,
    *,
    seen: float = 0.95,
    std_hz: float = 0.1,
    bearing_std_deg: float = 3.0,
    clutter: float = 4.0,
    snr_db: float = 13.0,
    seed: int = 1,
    valid_fraction: np.ndarray | None = None,
) -> Peaks:
    """Measure true lines, shape (frame, line), amid noise peaks; nan is silence."""
    rng = np.random.default_rng(seed)
    n_frames, n_lines = frequency_hz.shape
    heard = (rng.random((n_frames, n_lines)) < seen) & np.isfinite(frequency_hz)
    if valid_fraction is not None:
        heard &= (valid_fraction > 0)[:, None]
    frame, line = np.nonzero(heard)
    counts = rng.poisson(clutter, n_frames) * (1 if valid_fraction is None else valid_fraction > 0)
    noise_frame = np.repeat(np.arange(n_frames), counts)
    n_noise = noise_frame.size
    frequency = np.concatenate(
        [
            frequency_hz[frame, line] + std_hz * rng.standard_normal(line.size),
            rng.uniform(5.0, 995.0, n_noise),
        ]
    )
    bearing = np.full(frequency.size, np.nan)
    if bearing_deg is not None:
        bearing = np.concatenate(
            [
                bearing_deg[frame, line] + bearing_std_deg * rng.standard_normal(line.size),
                rng.uniform(0.0, 360.0, n_noise),
            ]
        )
    snr = np.concatenate(
        [
            snr_db + 0.5 * rng.standard_normal(line.size),
            10 * np.log10(3.6 + rng.exponential(1.0, n_noise)),
        ]
    )
    frames = np.concatenate([frame, noise_frame])
    std = np.concatenate([np.full(line.size, std_hz), np.full(n_noise, 0.25)])
    order = np.lexsort((frequency, frames))
    return Peaks(
        frames=some_frames(n_frames, valid_fraction),
        frame=frames[order],
        frequency_hz=frequency[order],
        frequency_std_hz=std[order],
        level_db=snr[order],
        snr_db=snr[order],
        bearing_deg=bearing[order] % 360.0,
        bearing_std_deg=np.where(np.isnan(bearing[order]), np.nan, bearing_std_deg),
        is_detection=10 * np.log10(1 + 10 ** (snr[order] / 10)) > 9.6,
        false_alarm_probability=1e-4,
        kept_probability=1e-2,
        reference="full scale",
        lowest_hz=0.0,
        highest_hz=1000.0,
    )


def cut(peaks: Peaks, start: int, stop: int) -> Peaks:
    """Take a block of frames out of a recording's peaks."""
    inside = (peaks.frame >= start) & (peaks.frame < stop)
    columns = {
        name: getattr(peaks, name)[inside]
        for name, spec in Peaks.columns().items()
        if spec.axes == ("peak",) and getattr(peaks, name) is not None
    }
    frames = replace(peaks.frames.take("frame", slice(start, stop)), first_frame=start)
    return replace(peaks, frames=frames, **columns)


def doppler(time_s: np.ndarray, closest_s: float, speed: float, range_m: float):
    """Relative Doppler shift of a straight passage, retardation left out."""
    along = speed * (time_s - closest_s)
    return -speed * along / (1500.0 * np.hypot(along, range_m))


def passage_bearing(time_s: np.ndarray, closest_s: float, speed: float, range_m: float):
    """Compass bearing of a vessel that passes to the north, heading east."""
    return np.degrees(np.arctan2(speed * (time_s - closest_s), range_m)) % 360.0
