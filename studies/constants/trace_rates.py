"""Count the lines that `trace` tells in white noise, in frames of several lengths.

Stated is one line per kHz and hour; what is told above that moves the offset of the
usual tail in ``lines/paths/trace_threshold.py``. Prints Markdown; a draw is four hours
of half a kHz and takes some seconds of CPU. The first seed and the number of draws of
each length may be told: python -m studies.constants.trace_rates 9000 6
"""

import sys

import numpy as np
from scipy.stats import chi2

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import HeldSamples, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, HOURS, FRAMES_S = 1024.0, 4.0, (0.5, 1.0, 4.0, 8.0, 12.0)


def count(seed: int, window_s: float) -> tuple[int, float]:
    """Return the lines that are told in white noise, and in how many kHz hours."""
    size = round(HOURS * 3600.0 * RATE_HZ)
    noise = np.random.default_rng(seed).standard_normal(size, np.float32)
    recording = Recording(
        name="noise", sensor=Sensor(id="h1"), sample_rate_hz=RATE_HZ, n_samples=size,
        n_channels=1, reader=HeldSamples(noise[:, None]),
    )  # fmt: skip
    blocks = compute_spectrogram(recording, window_s=window_s)
    found = Lines.join(list(trace_lines(blocks, false_lines_per_khz_hour=1.0)))
    return found.line_id.size, HOURS * RATE_HZ / 2000.0


def main(seed: int, draws: int) -> None:
    """Print a row for each length of frames."""
    write = sys.stdout.write
    total = np.zeros(2)
    write("| frames, s | lines | kHz h | per kHz h | 95 % |\n|---|---|---|---|---|\n")
    for window_s in FRAMES_S:
        every = [count(seed + draw, window_s) for draw in range(draws)]
        lines, khz_h = (sum(column) for column in zip(*every, strict=True))
        total += lines, khz_h
        low = chi2.ppf(0.025, 2 * lines) / 2 / khz_h if lines else 0.0
        high = chi2.ppf(0.975, 2 * lines + 2) / 2 / khz_h
        write(
            f"| {window_s:g} | {lines} | {khz_h:.3g} | {lines / khz_h:.2f} "
            f"| {low:.2f} to {high:.2f} |\n"
        )
    write(f"| all | {total[0]:.0f} | {total[1]:.3g} | {total[0] / total[1]:.2f} | |\n")


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given or (9000, 6)))
