"""Lines of the real ships against a long-average spectrum: what is missed and invented.

The reference uses nothing of the program: `scipy.signal.welch` in frames of 1 s over the
whole recording, its level over a running median, and the gamma law of an average of
exponential cells. A line of the reference stands above what noise gives once in ten
recordings; one of `track` or `trace` is invented when the average over its own time
does not stand out within 1 Hz of it at a chance of 1 %.

Reads the folder in UWTRACK_REAL_DATA; the table in tests/baselines/ship_lines.md is made by:
UWTRACK_REAL_DATA=FOLDER python -m tests.lines.ship_lines > tests/baselines/ship_lines.md
"""

import os
import sys
from pathlib import Path

import numpy as np
import soundfile
from scipy.ndimage import median_filter
from scipy.signal import welch
from scipy.stats import gamma

from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

BAND_HZ = (10.0, 2000.0)
NEAR_HZ = 1.0
FALSE_PER_RECORDING, INVENTED_CHANCE = 0.1, 0.01
SHIPS = ("kennicott_31", "nave_orbit_10", "ruby_princess_5")


def average(samples: np.ndarray, rate: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, power over the running median, and independent averages."""
    frequency, power = welch(samples, rate, nperseg=rate, noverlap=rate // 2)
    ratio = power / median_filter(power, 33)
    # half-overlapped Hann frames hardly repeat each other (Welch 1967: correlation 1/36)
    frames = max(2 * samples.size // rate - 1, 1)
    independent = max(frames / (1.0 + 2.0 / 36.0), 1.0)
    inside = (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])
    return frequency[inside], ratio[inside], independent


def least_ratio(chance: float, independent: float) -> float:
    """Ratio to the median that an average of noise exceeds by this chance."""
    law = gamma(independent)
    return float(law.isf(chance) / law.median())


def reference(samples: np.ndarray, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and decibels over the median of the lines of the long average."""
    frequency, ratio, independent = average(samples, rate)
    limit = least_ratio(FALSE_PER_RECORDING / frequency.size, independent)
    top = (
        (ratio[1:-1] >= ratio[:-2]) & (ratio[1:-1] > ratio[2:]) & (ratio[1:-1] > limit)
    )
    at = np.flatnonzero(top) + 1
    return frequency[at], 10.0 * np.log10(ratio[at])


def invented(lines: Lines, samples: np.ndarray, rate: int) -> list[str]:
    """Lines that the average over their own time does not show."""
    told = []
    for number in lines.line_id:
        own = lines.line == number
        time, middle = lines.time_s[own], float(np.median(lines.frequency_hz[own]))
        if np.ptp(lines.frequency_hz[own]) > 4.0 * NEAR_HZ:
            continue  # an average blurs what moves
        start = max(int((time[0] - 0.5) * rate), 0)
        stop = max(int((time[-1] + 0.5) * rate), start + rate)
        frequency, ratio, independent = average(samples[start:stop], rate)
        near = np.abs(frequency - middle) <= NEAR_HZ
        if ratio[near].max() < least_ratio(INVENTED_CHANCE / near.sum(), independent):
            told.append(f"{middle:.1f} ({time[0]:.0f}-{time[-1]:.0f} s)")
    return told


def rows(folder: Path, name: str) -> list[str]:
    """Return a row for each stage and ship."""
    samples, rate = soundfile.read(folder / "ships" / f"{name}.wav", dtype="float32")
    blocks = list(compute_spectrogram(recording_of(samples, rate), band_hz=BAND_HZ))
    stages = {
        "track": track_lines(find_peaks(block) for block in blocks),
        "trace": trace_lines(iter(blocks)),
    }
    true_hz, level_db = reference(samples, rate)
    told = []
    for stage, found in stages.items():
        lines = Lines.join(list(found))
        away = np.abs(true_hz[:, None] - lines.frequency_hz[None, :])
        missed = away.min(axis=1) > NEAR_HZ
        listed = [
            f"{f:.0f} ({level:.1f} dB)"
            for f, level in zip(true_hz[missed], level_db[missed], strict=True)
        ]
        false = invented(lines, samples.astype(float), rate)
        told.append(
            f"| {name} | {stage} | {true_hz.size} | {lines.line_id.size} | "
            f"{len(listed)}: {', '.join(listed) or 'none'} | "
            f"{len(false)}: {', '.join(false) or 'none'} |"
        )
    return told


def main() -> None:
    """Print the table."""
    folder = Path(os.environ["UWTRACK_REAL_DATA"])
    sys.stdout.write(
        "# Lines of three ships against a long-average spectrum\n\n"
        "`UWTRACK_REAL_DATA=FOLDER python -m tests.lines.ship_lines`; frequencies in "
        "Hz.\n\n| ship | stage | lines of the average | lines told | missed (dB over the "
        "median) | invented (when) |\n|---|---|---|---|---|---|\n"
    )
    for name in SHIPS:
        sys.stdout.write("\n".join(rows(folder, name)) + "\n")


if __name__ == "__main__":
    main()
