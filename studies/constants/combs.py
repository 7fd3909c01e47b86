"""The evidence of combs in white noise, and how weak a comb is heard.

`noise` simulates windows of white noise through the search of `lines.comb_search`, and
prints the mean of the greatest evidence, of that of combs out of tune, and the scale of
its tail: the constants of ``lines/comb_search/comb_tracker.py``. `bound` simulates the
weakest comb of eight equal teeth, a random subset of sixteen, that can be heard at all: by
the likelihood ratio that knows level, drift and the share of teeth that sound, but
neither the fundamental nor which teeth. `heard` puts such combs through the stage. All
print Markdown: python -m studies.constants.combs noise 4100 40
"""

import sys

import numpy as np

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import HeldSamples, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.estimation.window import cell_correlation
from uwtrack_cli.lines.comb_search.comb_grid import comb_grid
from uwtrack_cli.lines.comb_search.comb_window import CombWindow
from uwtrack_cli.lines.combs import find_combs, window_frames
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

FRAMES = (
    (1.0, (10.0, 1000.0), 64.0), (1.0, (10.0, 1000.0), 128.0), (4.0, (5.0, 400.0), 128.0),
    (4.0, (5.0, 800.0), 128.0), (4.0, (5.0, 800.0), 256.0), (12.0, (5.0, 200.0), 96.0),
)  # fmt: skip
"""Length of frames, band and time searched together of the windows that are simulated."""

TEETH, SOUNDING = 16, 8
"""Teeth of which some sound, and how many do."""


def sound(
    seconds: float, highest_hz: float, seed: int, tones: np.ndarray, level_db: float
) -> Recording:
    """Return white noise of unit density with tones of a level over it in 1 Hz."""
    rng = np.random.default_rng(seed)
    rate_hz = float(np.ceil(2.5 * highest_hz))
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    samples = np.sqrt(rate_hz / 2.0) * rng.standard_normal(time_s.size)
    for tone in tones:
        phase = 2.0 * np.pi * (tone * time_s + rng.random())
        samples += np.sqrt(2.0 * 10.0 ** (0.1 * level_db)) * np.sin(phase)
    return Recording(
        name="sound", sensor=Sensor(id="h1"), sample_rate_hz=rate_hz,
        n_samples=time_s.size, n_channels=1,
        reader=HeldSamples(samples.astype(np.float32)[:, None]),
    )  # fmt: skip


def spectrum(
    window_s: float,
    band_hz: tuple[float, float],
    seconds: float,
    seed: int,
    tones: np.ndarray | None = None,
    level_db: float = 0.0,
) -> Spectrogram:
    """Return the spectrogram of a window, with tones if there are any."""
    none = np.zeros(0) if tones is None else tones
    made = sound(seconds + 0.5 * window_s, band_hz[1], seed, none, level_db)
    blocks = compute_spectrogram(made, window_s=window_s, band_hz=band_hz)
    return Spectrogram.join(list(blocks))


def draw(rng: np.random.Generator, window_s: float) -> tuple[float, np.ndarray]:
    """Return a fundamental that the frames resolve, and the teeth that sound."""
    low = 6.0 / window_s
    fundamental = float(low * np.exp(rng.uniform(0.0, np.log(6.0))))
    teeth = np.sort(rng.choice(np.arange(1, TEETH + 1), SOUNDING, replace=False))
    return fundamental, teeth


def noise(seed: int, draws: int) -> None:
    """Print what white noise reaches, for each length of frames."""
    write = sys.stdout.write
    write("| frames, s | band, Hz | window, s | combs | best | tail | out of tune |\n")
    write("|---|---|---|---|---|---|---|\n")
    rows = []
    for window_s, band_hz, seconds in FRAMES:
        best, tuned = [], []
        for k in range(draws):
            made = spectrum(window_s, band_hz, seconds, seed + k)
            n_frames = window_frames(seconds, made.frames.hop_s)
            frequency = made.frequency_hz
            grid = comb_grid(frequency, 1.0 / window_s, (0.5, 60.0), 32, 5e-5 * seconds)
            ratio = made.power_density[:n_frames]
            ratio = np.asarray(ratio / 1.0, np.float32)
            window = CombWindow(ratio, grid, 0.5, made.frames.cells_per_bin)
            tuned.append(window.surrogate(seed + k))
            found = window.take_best(-np.inf)
            best.append(np.nan if found is None else found.evidence)
        mean, tail = float(np.mean(best)), float(np.std(best) * np.sqrt(6.0) / np.pi)
        rows.append((np.log(grid.n_hypotheses), mean, tail, mean - np.mean(tuned)))
        write(
            f"| {window_s:g} | {band_hz[0]:g}-{band_hz[1]:g} | {seconds:g} "
            f"| {grid.n_hypotheses} | {mean:.2f} | {tail:.2f} | {np.mean(tuned):.2f} |\n"
        )
    size, mean, tail, less = np.array(rows).T
    slope, offset = np.polyfit(size, mean, 1)
    write(
        f"\noffset {offset:.2f}, slope {slope:.3f}, tail {tail.mean():.2f}, out of tune "
        f"less {less.mean():.2f}\n"
    )


def known_level_evidence(made: Spectrogram, window_s: float, level_db: float) -> float:
    """Return the log-likelihood ratio of a comb of known level and share, at best.

    Of steady combs: every fundamental is asked for on the finest grid that teeth tell.
    """
    share = 1.0 / (1.0 + 2.0 * cell_correlation(0.0, 0.5))
    snr = 10.0 ** (0.1 * level_db) * window_s / 1.5
    ratio = np.asarray(made.power_density, float)
    total = share * amplitude_log_ratio(ratio, snr).sum(axis=0)
    part = SOUNDING / TEETH
    tooth = np.log1p(part * np.expm1(np.minimum(total, 500.0)))
    frequency = made.frequency_hz
    cell_hz = frequency[1] - frequency[0]
    low = 4.0 / window_s
    fundamental = np.arange(low, 40.0 / window_s, 0.5 * cell_hz / TEETH)
    evidence = np.zeros(fundamental.size)
    for k in range(1, TEETH + 1):
        place = np.rint((k * fundamental - frequency[0]) / cell_hz).astype(int)
        inside = (place >= 0) & (place < frequency.size)
        evidence += np.where(inside, tooth[np.clip(place, 0, frequency.size - 1)], 0.0)
    most = evidence.max()
    return float(most + np.log(np.exp(evidence - most).sum()))


def bound(seed: int, draws: int) -> None:
    """Print how often the likelihood ratio of known level hears a comb."""
    write = sys.stdout.write
    write("| frames, s | window, s | level, dB | heard |\n|---|---|---|---|\n")
    for window_s, seconds in ((1.0, 60.0), (1.0, 128.0), (4.0, 128.0)):
        band_hz = (2.0 / window_s, 700.0 / window_s)
        per_hour = 3600.0 / (0.5 * seconds)
        for level_db in np.arange(-9.0, -4.0, 0.5) - 3.0 * (window_s == 4.0):
            quiet, heard = [], []
            for k in range(draws):
                rng = np.random.default_rng([seed, k])
                empty = spectrum(window_s, band_hz, seconds, seed + k)
                quiet.append(known_level_evidence(empty, window_s, level_db))
                fundamental, teeth = draw(rng, window_s)
                full = spectrum(
                    window_s, band_hz, seconds, seed + draws + k, fundamental * teeth, level_db
                )
                heard.append(known_level_evidence(full, window_s, level_db))
            tail = max(np.std(quiet) * np.sqrt(6.0) / np.pi, 1e-3)
            least = np.mean(quiet) + tail * (np.log(per_hour) - 0.5772)
            share = np.mean(np.array(heard) > least)
            write(f"| {window_s:g} | {seconds:g} | {level_db:g} | {share:.2f} |\n")


def found(made: Recording, window_s: float, search_s: float = 120.0, rate: float = 1.0) -> Lines:
    """Return what the stage finds."""
    band_hz = (5.0, 800.0) if window_s > 1.0 else (10.0, 1000.0)
    blocks = compute_spectrogram(made, window_s=window_s, band_hz=band_hz)
    return Lines.join(list(find_combs(blocks, search_s=search_s, false_combs_per_hour=rate)))


def heard(seed: int, draws: int) -> None:
    """Print how often the stage hears a comb, and how often its fundamental is right."""
    write = sys.stdout.write
    write("| frames, s | search, s | level, dB | heard | of these right |\n")
    write("|---|---|---|---|---|\n")
    for window_s, seconds in ((1.0, 60.0), (1.0, 128.0), (4.0, 128.0)):
        for level_db in np.arange(-6.5, -2.0, 0.5) - 4.0 * (window_s == 4.0):
            n_heard = n_right = 0
            for k in range(draws):
                rng = np.random.default_rng([seed, k])
                fundamental, teeth = draw(rng, window_s)
                tones = fundamental * teeth
                made = sound(seconds + 0.5 * window_s, 1000.0, seed + k, tones, level_db)
                lines = found(made, window_s, seconds)
                n_heard += bool(lines.families.family.size)
                off = np.abs(lines.families.spacing_hz / fundamental - 1.0)
                n_right += bool(off.size and off[0] < 0.5 / (window_s * tones[-1]))
            write(
                f"| {window_s:g} | {seconds:g} | {level_db:g} | {n_heard / draws:.2f} "
                f"| {n_right / max(n_heard, 1):.2f} |\n"
            )


def rates(seed: int, draws: int) -> None:
    """Print the combs that the stage finds in hours of white noise."""
    write = sys.stdout.write
    write("| frames, s | hours | stated an hour | found |\n|---|---|---|---|\n")
    for window_s in (1.0, 4.0, 12.0):
        for rate in (1.0, 20.0):
            count = 0
            for k in range(draws):
                made = sound(3600.0, 1000.0, seed + k, np.zeros(0), 0.0)
                lines = found(made, window_s, rate=rate)
                count += lines.families.family.size
            write(f"| {window_s:g} | {draws} | {rate:g} | {count} |\n")


PARTS = {"noise": noise, "bound": bound, "heard": heard, "rates": rates}

if __name__ == "__main__":
    PARTS[sys.argv[1]](*(int(word) for word in sys.argv[2:]))
