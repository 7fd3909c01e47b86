"""Where `trace` begins and ends its lines: python -m studies.constants.line_ends [SEEDS] [FIRST].

`PATH_NOISE` and `END_GAIN` of `uwtrack_cli.lines.paths.path_search` decide which frames of
a path hold its line. In noise a path finds louder cells than free noise has, so that a line
compared with free noise ends late; the louder the noise is taken to be and the less it
takes to leave frames out, the more of a weak line is lost.

Eight lines a seed in five minutes of white noise, six of them for a part of the time. For
each pair of constants and each level over the noise in 1 Hz: median of the ends' distance
from the truth and 90th percentile of how late they are, median distance of the beginnings,
s; share of the lines' frames that are told, ids per line, and points told where there is
no line.

The chosen pair keeps nine in ten of steady
lines as weak as 0.8 of the noise whole (`tests/lines/test_path_search.py`).
"""

import sys
from collections.abc import Sequence

import numpy as np

from tests.support import recording_of, white_noise
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.lines.paths import path_search
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, SECONDS = 2000.0, 300
LEVELS_DB = (0.5, 2.5, 6.0)
SHORT_LINES, ALL_LINES = 6, 8

Scene = tuple[FloatArray, FloatArray, FloatArray, list[Spectrogram]]


def scene(level_db: float, seed: int) -> Scene:
    """Return frequencies, begins and ends of the lines, and the spectrogram."""
    rng = np.random.default_rng([seed, int(100 * level_db)])
    frequency_hz = 60.0 + 105.0 * np.arange(ALL_LINES) + rng.uniform(0, 80, ALL_LINES)
    begin_s, end_s = rng.uniform(30, 100, ALL_LINES), rng.uniform(180, 260, ALL_LINES)
    begin_s[SHORT_LINES:], end_s[SHORT_LINES:] = 0.0, SECONDS
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    noise = white_noise(time_s.size, seed, rate_hz=RATE_HZ)
    amplitude = np.sqrt(4.0 * np.var(noise) / RATE_HZ * 10.0 ** (0.1 * level_db))
    for one, begin, end in zip(frequency_hz, begin_s, end_s, strict=True):
        tone = np.sin(2.0 * np.pi * (one * time_s + rng.random()))
        noise = noise + amplitude * tone * ((time_s >= begin) & (time_s <= end))
    recording = recording_of(noise.astype(np.float32), RATE_HZ)
    blocks = list(compute_spectrogram(recording, band_hz=(40.0, 950.0)))
    return frequency_hz, begin_s, end_s, blocks


def scores(scenes: Sequence[Scene]) -> list[float]:
    """Return the six numbers of a row."""
    late: list[float] = []
    early: list[float] = []
    cover: list[float] = []
    ids: list[float] = []
    n_false = 0
    for frequency_hz, begin_s, end_s, blocks in scenes:
        lines = Lines.join(list(trace_lines(iter(blocks))))
        is_own = np.zeros(lines.line.size, dtype=bool)
        for k in range(ALL_LINES):
            mine = np.abs(lines.frequency_hz - frequency_hz[k]) < 1.0
            is_own |= mine
            inside = (lines.time_s >= begin_s[k]) & (lines.time_s <= end_s[k])
            n_told = np.unique(lines.frame[mine & inside]).size
            cover.append(n_told * lines.frames.hop_s / (end_s[k] - begin_s[k]))
            ids.append(np.unique(lines.line[mine]).size)
            if mine.any() and k < SHORT_LINES:
                late.append(float(lines.time_s[mine].max()) - end_s[k])
                early.append(begin_s[k] - float(lines.time_s[mine].min()))
        n_false += int(np.count_nonzero(~is_own))
    return [
        float(np.median(np.abs(late))), float(np.percentile(late, 90)),
        float(np.median(np.abs(early))), float(np.mean(cover)), float(np.mean(ids)),
        float(n_false),
    ]  # fmt: skip


def main(n_seeds: int = 4, first: int = 40) -> None:
    """Print a table."""
    pairs = [(1.1, 6.0), (1.0, 6.0), (1.2, 6.0), (1.32, 6.0), (1.1, 3.0), (1.1, 10.0)]
    print("| noise | gain | dB | ends, s | 90 % late, s | begins, s | cover | ids | false |")
    print("|---|---|---|---|---|---|---|---|---|")
    for level_db in LEVELS_DB:
        scenes = [scene(level_db, seed) for seed in range(first, first + n_seeds)]
        for noise, gain in pairs:
            path_search.PATH_NOISE, path_search.END_GAIN = noise, gain
            row = scores(scenes)
            values = " | ".join(f"{value:.3g}" for value in row)
            print(f"| {noise:g} | {gain:g} | {level_db:g} | {values} |", flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
