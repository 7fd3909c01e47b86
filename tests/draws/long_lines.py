"""Steady lines of ten minutes in frames of one, eight and thirty-two seconds.

White noise at 1 kHz with eight lines at once, at the commands' defaults. A line is heard
when points within three quarters of a resolution of it are told in a tenth of the frames.
"""

import numpy as np

from tests.support import recording_of, white_noise
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, SECONDS, N_LINES = 1000.0, 600, 8


def steady_lines(level_db: float, seed: int) -> tuple[Recording, np.ndarray]:
    """Return sound of steady lines at a level, and their frequencies in Hz."""
    rng = np.random.default_rng([seed, int(100 * level_db + 1e4)])
    frequency_hz = 60.0 + 45.0 * np.arange(N_LINES) + rng.uniform(0.0, 40.0, N_LINES)
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    sound = white_noise(time_s.size, seed, rate_hz=RATE_HZ)
    for one in frequency_hz:
        tone = np.sin(2.0 * np.pi * (one * time_s + rng.random()))
        sound += np.sqrt(2.0 * 10.0 ** (0.1 * level_db)) * tone
    return recording_of(sound.astype(np.float32), RATE_HZ), frequency_hz


def told(command: str, window_s: float, recording: Recording) -> Lines:
    """Return the lines that a command tells in frames of one length."""
    blocks = compute_spectrogram(recording, window_s=window_s, band_hz=(50.0, 450.0))
    made = (
        trace_lines(blocks)
        if command == "trace"
        else track_lines(find_peaks(block) for block in blocks)
    )
    return Lines.join(list(made))


def lines_heard(command: str, window_s: float, level_db: float, seed: int) -> int:
    """Return how many of the lines are heard."""
    recording, frequency_hz = steady_lines(level_db, seed)
    found = told(command, window_s, recording)
    least = 0.1 * SECONDS / found.frames.hop_s
    near = np.abs(found.frequency_hz - frequency_hz[:, None]) < 0.75 / window_s
    return int(np.count_nonzero(near.sum(axis=1) > least))
