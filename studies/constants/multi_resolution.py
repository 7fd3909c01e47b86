"""Where the constant of the ladder comes from: what followed lines gain by being chosen.

Steady tones in white noise, in frames of a quarter of a second, at powers over the noise
in a cell from -2 to 10 dB. Printed are the power ratio that the points of the followed lines tell
on average, coasted ones as zero, the share of their frames that is told, and by how much
s - ln(1 + s) of the told ratio exceeds that of the true one: the greatest is
`PEAK_CHOICE`. Positive values are what the choice of the strongest cell gives, negative ones
what is lost between cells and overlapping floors. Chosen on seeds 0 to 2:
python -m studies.constants.multi_resolution 3 0
"""

import sys

import numpy as np

from tests.support import recording_of, white_noise
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.estimation.window import NOISE_BANDWIDTH_BINS
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, SECONDS, WINDOW_S, N_LINES = 4000.0, 120, 0.25, 8
LEVELS_DB = (-2, 0, 2, 4, 6, 10)


def told_ratios(stage: str, level_db: int, seed: int) -> np.ndarray:
    """Return the power ratio of every point of the lines, 0 where it coasted."""
    rng = np.random.default_rng([seed, level_db + 50])
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    frequency_hz = 200.0 * np.arange(1, N_LINES + 1) + rng.uniform(0.0, 50.0, N_LINES)
    power = 10.0 ** (0.1 * level_db) * NOISE_BANDWIDTH_BINS / WINDOW_S
    sound = white_noise(time_s.size, seed, rate_hz=RATE_HZ)
    for one in frequency_hz:
        phase = 2.0 * np.pi * (one * time_s + rng.random())
        sound += np.sqrt(2.0 * power) * np.sin(phase)
    recording = recording_of(sound.astype(np.float32), RATE_HZ)
    blocks = compute_spectrogram(recording, window_s=WINDOW_S)
    made = (
        trace_lines(blocks)
        if stage == "trace"
        else track_lines(find_peaks(block) for block in blocks)
    )
    lines = Lines.join(list(made))
    off_hz = np.abs(lines.frequency_hz[:, None] - frequency_hz)
    near = (off_hz < 0.6 / WINDOW_S).any(axis=1)
    snr_db = np.asarray(lines.measured_snr_db[near], float)
    return 10.0 ** (0.1 * np.nan_to_num(snr_db, nan=-np.inf))


def main(n_seeds: int, first: int) -> None:
    """Print a row for each stage and level."""
    print("| stage | dB in a cell | ratio | told | share told | gain, nepers |")
    print("|---|---|---|---|---|---|")
    n_frames = n_seeds * N_LINES * 2.0 * SECONDS / WINDOW_S
    for stage in ("track", "trace"):
        for level_db in LEVELS_DB:
            told = np.concatenate(
                [told_ratios(stage, level_db, seed) for seed in range(first, first + n_seeds)]
            )
            true, mean = 10.0 ** (0.1 * level_db), float(told.mean())
            gain = (mean - np.log1p(mean)) - (true - np.log1p(true))
            print(
                f"| `{stage}` | {level_db} | {true:.2f} | {mean:.2f} | "
                f"{told.size / n_frames:.2f} | {gain:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
