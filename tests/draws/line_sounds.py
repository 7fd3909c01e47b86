"""Scenes of frequency lines in white noise, and the scores of a tracker in them.

Sound at 8 kHz with lines from 100 to 1750 Hz, eight at a time, at 12 dB over the noise in
1 Hz unless said; spectrogram, peaks and tracker at the commands' defaults. *Cover* is the
share of the true frames with a point within 1.5 Hz, *purity* the share of an id's points
that belong to its main line, *ids* the ids per true line.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, GATE_HZ = 8000, 1.5
BAND_HZ = (50.0, 2000.0)
STEP_S = 0.5


@dataclass
class Scene:
    """Lines over time: frequency on a grid of frames, nan where a line is silent."""

    frequency_hz: np.ndarray
    snr_db: np.ndarray

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return self.frequency_hz.shape[1] * STEP_S

    def sound(self, rng: np.random.Generator) -> np.ndarray:
        """Draw the samples: phase-continuous tones in noise of unit density."""
        n = int(self.duration_s * RATE_HZ)
        time, grid = (np.arange(n) / RATE_HZ, np.arange(self.frequency_hz.shape[1]) * STEP_S)
        samples = rng.standard_normal(n) * np.sqrt(RATE_HZ / 2)
        for frequency, snr_db in zip(self.frequency_hz, self.snr_db, strict=True):
            known = np.isfinite(frequency)
            course = np.interp(time, grid[known], frequency[known])
            sounds = known[np.minimum(np.rint(time / STEP_S).astype(int), known.size - 1)]
            phase = 2.0 * np.pi * (np.cumsum(course) / RATE_HZ + rng.random())
            samples += sounds * np.sqrt(2.0 * 10.0 ** (0.1 * snr_db)) * np.sin(phase)
        return samples.astype(np.float32)


def tracked(scene: Scene, seed: int, stage: str = "track", **spectrogram: Any) -> Lines:
    """Follow the lines of a scene at the defaults of the commands."""
    sound = scene.sound(np.random.default_rng(seed))
    blocks = compute_spectrogram(recording_of(sound, RATE_HZ), band_hz=BAND_HZ, **spectrogram)
    if stage == "trace":
        return Lines.join(list(trace_lines(blocks)))
    return Lines.join(list(track_lines(find_peaks(block) for block in blocks)))


@dataclass
class Score:
    """Scores of one scene."""

    cover: np.ndarray
    """Share of its frames in which a line is followed, shape (line,)."""
    purity: float
    """Share of the points of all ids that are of the id's main line."""
    ids: float
    """Ids per line that was found."""


def score(scene: Scene, lines: Lines) -> Score:
    """Compare tracked lines with those of a scene."""
    frame = np.rint(lines.time_s / STEP_S).astype(int)
    frame = np.clip(frame, 0, scene.frequency_hz.shape[1] - 1)
    away = np.abs(lines.frequency_hz[:, None] - scene.frequency_hz[:, frame].T)
    away = np.where(np.isfinite(away), away, np.inf)
    nearest = away.argmin(axis=1)
    is_near = away[np.arange(nearest.size), nearest] < GATE_HZ
    cover, told = np.zeros(scene.snr_db.size), []
    for k in range(scene.snr_db.size):
        own = away[:, k] < GATE_HZ
        n_true = np.isfinite(scene.frequency_hz[k]).sum() - 2
        cover[k] = np.unique(frame[own]).size / max(n_true, 1)
    n_main = n_points = 0
    for line in np.unique(lines.line[is_near]):
        mine = nearest[is_near & (lines.line == line)]
        counts = np.bincount(mine)
        n_main, n_points = n_main + counts.max(), n_points + mine.size
        if mine.size >= 10:
            told.append(counts.argmax())
    found = np.unique(told).size
    return Score(
        np.minimum(cover, 1.0), n_main / max(n_points, 1), len(told) / found if found else np.nan
    )


def _places(rng: np.random.Generator, count: int = 8) -> np.ndarray:
    return np.sort(rng.permutation(np.linspace(130.0, 1700.0, 20))[:count])


def steady(rng: np.random.Generator, snr_db: float, duration_s: float = 300.0) -> Scene:
    """Eight lines that stay where they are."""
    n = int(duration_s / STEP_S)
    return Scene(np.repeat(_places(rng)[:, None], n, axis=1), np.full(8, snr_db))


def silences(
    rng: np.random.Generator, silent_s: float, snr_db: float, sounding_s: float = 60.0
) -> Scene:
    """Steady lines that fall silent again and again."""
    scene = steady(rng, snr_db)
    time = np.arange(scene.frequency_hz.shape[1]) * STEP_S
    scene.frequency_hz[:, time % (sounding_s + silent_s) >= sounding_s] = np.nan
    return scene


def bursts(rng: np.random.Generator, snr_db: float) -> Scene:
    """Lines of a minute that wander by up to 0.1 Hz/s."""
    time = np.arange(int(90 / STEP_S)) * STEP_S
    rate = rng.uniform(-0.1, 0.1, 8)
    frequency = _places(rng)[:, None] + rate[:, None] * (time - 45.0)
    frequency[:, (time < 15.0) | (time >= 75.0)] = np.nan
    return Scene(frequency, np.full(8, snr_db))


def crossings(rng: np.random.Generator, rate_hzps: float, count: int = 6) -> Scene:
    """Pairs of lines that cross once, in the middle."""
    time = np.arange(int(120 / STEP_S)) * STEP_S - 60.0
    centre = np.linspace(220.0, 1650.0, count) + rng.uniform(-20.0, 20.0, count)
    frequency = np.concatenate(
        [c + sign * rate_hzps * time for c in centre for sign in (-1.0, 1.0)]
    )
    return Scene(frequency.reshape(2 * count, -1), np.full(2 * count, 12.0))


def close_pairs(rng: np.random.Generator, bins: float) -> Scene:
    """Pairs of steady lines at 15 dB, some bins apart."""
    place = _places(rng, 4)
    frequency = np.sort(np.concatenate([place, place + bins]))
    return Scene(np.repeat(frequency[:, None], 600, axis=1), np.full(8, 15.0))


def sweeps(rng: np.random.Generator, bins: float) -> Scene:
    """Triangles that move by some bins a frame, at 15 dB."""
    time = np.arange(240)
    half = max(24.0, 20.0 / bins)  # frames from one corner to the next
    triangle = 2.0 * np.abs((time / (2.0 * half)) % 1.0 - 0.5)
    place = np.linspace(200.0, 1500.0, 8) + rng.uniform(-20.0, 20.0, 8)
    return Scene(place[:, None] + bins * half * triangle, np.full(8, 15.0))


def jumps(rng: np.random.Generator, percent: float) -> Scene:
    """A family of eight whose shaft rate changes every 100 s."""
    base = rng.uniform(40.0, 60.0)
    step = np.array([1.0, 1.0 + 0.01 * percent, 1.0])
    rate = base * np.repeat(step, int(100 / STEP_S))
    return Scene(np.arange(3, 11)[:, None] * rate, np.full(8, 12.0))


SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    **{
        f"fades of {s} s at {snr} dB": lambda rng, s=s, snr=snr: silences(rng, s, snr, 60.0 - s)
        for s in (5, 10, 20)
        for snr in (10, 20)
    },
    **{f"steady at {snr} dB": lambda rng, snr=snr: steady(rng, snr) for snr in (6, 8, 10, 15)},
    **{f"stops of {s} s": lambda rng, s=s: silences(rng, s, 12.0) for s in (5, 20, 60)},
    **{f"crossings at {r} Hz/s": lambda rng, r=r: crossings(rng, r) for r in (0.05, 0.2, 0.5)},
    **{f"pairs {b} bins apart": lambda rng, b=b: close_pairs(rng, b) for b in (1, 1.5, 2, 3)},
    **{f"sweeps of {b} bins a frame": lambda rng, b=b: sweeps(rng, b) for b in (0.1, 0.5, 1, 2)},
    **{f"jumps of {p} %": lambda rng, p=p: jumps(rng, p) for p in (1, 2, 5)},
}
"""What is drawn, by the name of its row."""
