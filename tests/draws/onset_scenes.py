"""Drawn sound whose lines begin and end at once, and what the line stages tell of it.

Each scene has one kind of lines (chords with overtones, machines that change their speed
together, beeps, steady lines), a ground of noise, and may have digital silence for up to a
minute, pauses, and samples of few bits; all of it from the scene's seed alone, by no code of
the simulator. Nothing is known of such sound but that a stage must not fail on it.
"""

import numpy as np

from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 2048
FRAMES = ((1.0, 0.5, 2), (1.0, 0.75, 1), (0.5, 0.5, 1), (4.0, 0.75, 2))
"""Window in s, overlap and zero padding of the spectrograms, one after the other."""

KINDS = ("chords", "machines", "beeps", "steady lines")
"""What sounds, one after the other."""


def scene(seed: int) -> np.ndarray:
    """Return the samples of one scene, 60 to 180 s, full scale 1."""
    rng = np.random.default_rng(seed)
    size = int(rng.uniform(60.0, 180.0) * RATE_HZ)
    time_s = np.arange(size) / RATE_HZ
    kind = KINDS[seed % len(KINDS)]
    samples = 10.0 ** rng.uniform(-5.0, -2.0) * rng.standard_normal(size)
    for start_s, stop_s in _stretches(rng, time_s[-1], kind):
        inside = slice(int(start_s * RATE_HZ), int(stop_s * RATE_HZ))
        for frequency_hz in _frequencies(rng, kind):
            amplitude = 10.0 ** rng.uniform(-4.0, -1.5)
            phase = 2.0 * np.pi * (frequency_hz * time_s[inside] + rng.random())
            samples[inside] += amplitude * np.sin(phase)
    if rng.random() < 0.5:  # sound and pauses in turn
        period_s, share = rng.uniform(1.0, 30.0), rng.uniform(0.2, 0.8)
        samples *= (time_s / period_s) % 1.0 < share
    if rng.random() < 0.5:  # digital silence for up to a minute
        start = int(rng.uniform(0.0, 0.8) * size)
        samples[start : start + int(rng.uniform(5.0, 60.0) * RATE_HZ)] = 0.0
    if rng.random() < 0.5:  # a recorder of few bits
        step = 2.0 ** -rng.integers(7, 16)
        samples = np.round(samples / step) * step
    return np.clip(samples, -1.0, 1.0)


def _stretches(rng: np.random.Generator, length_s: float, kind: str) -> list[tuple[float, float]]:
    """Draw from when to when the same lines sound: one stretch after the other."""
    lasts_s = {"chords": 4.0, "machines": 25.0, "beeps": 12.0, "steady lines": 60.0}
    stretches, now = [], float(rng.uniform(0.0, 10.0))
    while now < length_s:
        stop = now + rng.uniform(0.3, 2.0) * lasts_s[kind]
        stretches.append((now, min(stop, length_s)))
        # music and machines go on at once, others after a while
        now = stop if kind in ("chords", "machines") else stop + rng.uniform(0.0, 20.0)
    return stretches


def _frequencies(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Draw the lines of one stretch, Hz, below the half of the rate."""
    highest = 0.48 * RATE_HZ
    if kind == "chords":  # notes of equal temperament, eight overtones each
        notes = 55.0 * 2.0 ** (rng.choice(36, rng.integers(1, 6), replace=False) / 12.0)
        lines = np.outer(notes, np.arange(1, 9)).ravel()
    elif kind == "machines":  # one shaft whose speed changes by some per cent
        shaft = 17.3 * (1.0 + rng.uniform(-0.06, 0.06))
        lines = shaft * np.arange(2, rng.integers(8, 40))
    else:
        lines = rng.uniform(30.0, highest, rng.integers(3, 30))
    return lines[lines < highest]


def traced(seed: int) -> Lines:
    """Trace the lines of a scene at the frames that its seed chooses."""
    window_s, overlap, padding = FRAMES[seed // len(KINDS) % len(FRAMES)]
    blocks = compute_spectrogram(
        recording_of(scene(seed), RATE_HZ), window_s=window_s, overlap=overlap, zero_padding=padding
    )
    return Lines.join(list(trace_lines(blocks)))
