"""False lines of `track` and `trace` in noise that is not white, with exact intervals.

Each kind of noise is drawn here, by no code of the simulator: filters by the transform
of whole blocks, gains as functions of time. Spectrogram, peaks, `track` and `trace` are at
the commands' defaults, 50 to 2000 Hz, where one false line per kHz and hour is stated.
"""

from collections.abc import Callable, Iterator

import numpy as np

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, BLOCK_S = 4096, 64
BAND_HZ = (50.0, 2000.0)

Noise = Callable[[np.random.Generator, np.ndarray], np.ndarray]
"""Draws a block of noise at the times given, in s."""


def coloured(shape_db: Callable[[np.ndarray], np.ndarray]) -> Noise:
    """Noise with a spectrum in dB over frequency."""

    def draw(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
        spectrum = np.fft.rfft(rng.standard_normal(time_s.size))
        frequency = np.fft.rfftfreq(time_s.size, 1.0 / RATE_HZ)
        return np.fft.irfft(spectrum * 10.0 ** (shape_db(frequency) / 20.0), time_s.size)

    return draw


def gained(gain_db: Callable[[np.ndarray], np.ndarray]) -> Noise:
    """White noise whose level in dB changes with time."""
    return lambda rng, time_s: rng.standard_normal(time_s.size) * 10.0 ** (gain_db(time_s) / 20.0)


def impulses(per_s: float, level: float, decay_s: float) -> Noise:
    """White noise with short bursts of noise at random times, of log-normal levels."""

    def draw(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
        samples = rng.standard_normal(time_s.size)
        tail = np.exp(-np.arange(int(6 * decay_s * RATE_HZ) + 1) / (decay_s * RATE_HZ))
        for start in rng.integers(0, time_s.size, rng.poisson(per_s * BLOCK_S)):
            part = samples[start : start + tail.size]
            height = level * 10.0 ** (0.3 * rng.standard_normal())
            part += height * tail[: part.size] * rng.standard_normal(part.size)
        return samples

    return draw


def gusts(rng: np.random.Generator, time_s: np.ndarray) -> np.ndarray:
    """White noise, and below 200 Hz a log-normal level of 10 dB that lasts 3 s."""
    n_steps = BLOCK_S * 4
    smooth = np.exp(-0.5 * (np.arange(-24, 25) / 6.0) ** 2)
    course = np.convolve(rng.standard_normal(n_steps + 48), smooth, "valid")
    course *= 10.0 / np.sqrt(np.sum(smooth**2))
    edge = 10.0 * np.linspace(0.0, 1.0, 9)  # blocks begin and end calm
    course[:9] *= edge / 10.0
    course[-9:] *= edge[::-1] / 10.0
    gain = np.interp(time_s - time_s[0], np.arange(n_steps) / 4.0, course)
    low = coloured(lambda f: -10.0 * np.log10(1.0 + (f / 200.0) ** 8))(rng, time_s)
    return rng.standard_normal(time_s.size) + low * 10.0 ** (gain / 20.0)


KINDS: dict[str, Noise] = {
    "white": coloured(np.zeros_like),
    "shrimp": impulses(20.0, 15.0, 2e-4),
    "knocks": impulses(0.5, 10.0, 0.02),
    "6 dB an octave": coloured(lambda f: -20.0 * np.log10(np.maximum(f, 20.0) / 20.0)),
    "rain drift of 8 dB": gained(lambda t: 8.0 * np.sin(2.0 * np.pi * t / 600.0)),
    "swell of 6 dB at 0.11 Hz": gained(lambda t: 6.0 * np.sin(2.0 * np.pi * 0.11 * t)),
    "gusts below 200 Hz": gusts,
    "bump of 15 dB, sd 30 Hz": coloured(lambda f: 15.0 * np.exp(-0.5 * ((f - 700.0) / 30.0) ** 2)),
    "notch of 20 dB, sd 40 Hz": coloured(
        lambda f: -20.0 * np.exp(-0.5 * ((f - 700.0) / 40.0) ** 2)
    ),
}
"""Noises of the specification, by the name of their row."""


def recording(noise: Noise, hours: float, seed: int) -> Recording:
    """Return noise that is drawn when it is read."""
    n_blocks = round(hours * 3600 / BLOCK_S)
    size = BLOCK_S * RATE_HZ

    def read(block: int) -> Iterator[Samples]:
        rng = np.random.default_rng(seed)
        for k in range(n_blocks):
            time_s = (k * size + np.arange(size)) / RATE_HZ
            drawn = (0.05 * noise(rng, time_s)).astype(np.float32)
            for start in range(0, size, block):
                yield drawn[start : start + block, None]

    return Recording(
        sensor=Sensor(id="noise"), name="noise", sample_rate_hz=float(RATE_HZ),
        n_samples=n_blocks * size, n_channels=1, reader=read,
    )  # fmt: skip


def false_lines(noise: Noise, hours: float, seed: int) -> dict[str, int]:
    """Count what each stage tells of some hours of noise."""
    blocks = compute_spectrogram(recording(noise, hours, seed), band_hz=BAND_HZ)
    stages = {
        "track": lambda source: track_lines(find_peaks(b) for b in source),
        "trace": trace_lines,
    }
    counts = {}
    for name, stage in stages.items():
        if name != "track":
            blocks = compute_spectrogram(recording(noise, hours, seed), band_hz=BAND_HZ)
        last: Lines | None = None
        for last in stage(blocks):  # noqa: B007 - the table of lines comes last
            pass
        counts[name] = 0 if last is None else int(last.line_id.size)
    return counts
