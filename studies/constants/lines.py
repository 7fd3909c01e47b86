"""Where the constants of `track` come from: lines in drawn noise, and noise alone.

Each constant is set to some values in turn, all others as they are. Printed are the share
of bursts of a minute that are followed at 1, 1.5 and 2 dB over the noise in 1 Hz, the false
lines per kHz and hour of noise alone, how many lines are carried on average, which is what
a frame costs, and for the constants of continuation and of process noise the ids per line
and the cover in fades, stops, sweeps and jumps, and the error of the frequency of a steady line
of 10 dB after a minute over the bound of one frame. The constants were chosen on seeds
4100 and 7100; with twelve runs and two hours a row takes half a minute:
python -m studies.constants.lines 12 2 4100
"""

import sys
from types import ModuleType

import numpy as np

from studies.trace_noise import noise_recording
from tests.draws.line_sounds import BAND_HZ, RATE_HZ, SCENES, Scene, bursts, score
from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.lines import stitching
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracking import line_continuation, llr_score, tracker
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

STARTS: dict[tuple[ModuleType, str], tuple[float, ...]] = {
    (llr_score, "START_RATE"): (0.01, 0.02, 0.04),
    (llr_score, "DISMISSED"): (-0.5, -2.0, -4.0),
    (llr_score, "WALD_SHARE"): (0.25, 0.4, 0.6),
    (tracker, "WEAK_RATE"): (0.25, 0.5, 1.0),
}
"""Constants of how lines begin, and the values that are tried."""

COURSES: dict[tuple[ModuleType, str], tuple[float, ...]] = {
    (tracker, "LOUD_RATE"): (1.0, 4.0, 8.0),
    (llr_score, "FAINT"): (2.0, 3.0, 5.0, 10.0),
    (line_continuation, "LEAST_LOG_RATIO"): (0.0, 1.6, 4.0),
    (stitching, "RETURNING"): (0.1, 0.5, 0.9),
    (stitching, "TURNING"): (0.1, 0.5, 0.9),
    (stitching, "TURN_WINDOWS"): (1.0, 3.0, 9.0),
    (stitching, "LEAST_STD"): (0.1, 0.3, 0.6),
    (stitching, "LEAST_RATE_STD"): (0.07, 0.2, 0.6),
    (stitching, "GREATEST_CHANCE"): (1e-5, 1e-3, 1e-1),
    (stitching, "REACH"): (0.25, 0.5, 1.0),
    (stitching, "BEFORE_WINDOWS"): (3.0, 12.0, 40.0),
    (stitching, "LATE_WINDOWS"): (12.0, 40.0, 120.0),
    (stitching, "AFTER_WINDOWS"): (3.0, 6.0, 12.0),
    (tracker, "STEADY_SHARE"): (1e-5, 1e-4, 1e-3, 1e-2, 1e-1),
    (tracker, "RISE"): (1.0, 3.0, 6.0),
    (tracker, "WIDTH_SHARE"): (0.0, 0.25, 1.0),
}
"""Constants of how lines go on, and the values that are tried."""

WANTED = (
    "fades of 10 s at 20 dB", "stops of 20 s", "sweeps of 0.5 bins a frame",
    "sweeps of 1 bins a frame", "sweeps of 2 bins a frame", "jumps of 5 %",
)  # fmt: skip
"""Scenes for the second table."""

LEVELS_DB = (1.0, 1.5, 2.0)
"""Levels of the bursts over the noise in 1 Hz, dB."""


def peaks_of(scene: Scene, seed: int) -> list[Peaks]:
    """Return the peaks of a scene in noise, at the command's defaults."""
    sound = recording_of(scene.sound(np.random.default_rng(seed)), RATE_HZ)
    return [find_peaks(b) for b in compute_spectrogram(sound, band_hz=BAND_HZ)]


class Draws:
    """Peaks of all scenes and of noise alone, drawn once for all rows."""

    def __init__(self, n_runs: int, hours: float, seed: int) -> None:
        self.hours = hours
        self.bursts: list[list[tuple[Scene, list[Peaks]]]] = []
        for level in LEVELS_DB:
            scenes = [
                bursts(np.random.default_rng([seed, k, int(2 * level)]), level)
                for k in range(n_runs)
            ]
            self.bursts.append([(s, peaks_of(s, seed + 1000 * k)) for k, s in enumerate(scenes)])
        self.noise = [
            find_peaks(block, band_hz=BAND_HZ)
            for block in compute_spectrogram(noise_recording(seed, hours))
        ]
        self.courses = {
            name: [
                (scene, peaks_of(scene, seed + k))
                for k in range(max(n_runs // 4, 1))
                for scene in [SCENES[name](np.random.default_rng([seed, k]))]
            ]
            for name in WANTED
        }


def followed(peaks: list[Peaks]) -> Lines:
    """Track some peaks at the command's defaults."""
    return Lines.join(list(track_lines(iter(peaks))))


def starts(draws: Draws) -> str:
    """Tell what is followed, what noise makes, and what is carried."""
    shares = []
    for drawn in draws.bursts:
        covers = [score(scene, followed(peaks)).cover for scene, peaks in drawn]
        shares.append(np.mean(np.concatenate(covers) > 0.5))
    carried: list[int] = []
    step = tracker.LineTracker.step

    def counted(self: tracker.LineTracker, *args: object) -> None:
        step(self, *args)  # type: ignore[arg-type]
        carried.append(self.store.active().size)

    tracker.LineTracker.step = counted  # type: ignore[method-assign]
    false = followed(draws.noise).line_id.size
    tracker.LineTracker.step = step  # type: ignore[method-assign]
    band_khz = 1e-3 * (BAND_HZ[1] - BAND_HZ[0])
    told = "  ".join(f"{share:5.2f}" for share in shares)
    rate = false / (band_khz * draws.hours)
    return f"{told}   {rate:5.2f} false   {np.mean(carried):5.0f} lines"


def courses(draws: Draws) -> str:
    """Tell ids per line and cover of each scene."""
    told = []
    for drawn in draws.courses.values():
        scores = [score(scene, followed(peaks)) for scene, peaks in drawn]
        ids = np.nanmean([one.ids for one in scores])
        cover = np.mean([one.cover.mean() for one in scores])
        told.append(f"{ids:5.2f} ({cover:.3f})")
    return "  ".join(told)


def main(n_runs: int, hours: float, seed: int) -> None:
    """Print both tables."""
    draws = Draws(n_runs, hours, seed)
    print(f"{'':32}" + "  ".join(f"{level:3g} dB" for level in LEVELS_DB))
    for table, told, head in ((STARTS, starts, ""), (COURSES, courses, "; ".join(WANTED))):
        print(head)
        for (module, name), values in table.items():
            usual = getattr(module, name)
            for value in values:
                setattr(module, name, value)
                mark = "*" if value == usual else " "
                print(f"{name:18}{value:9g} {mark}   {told(draws)}", flush=True)
            setattr(module, name, usual)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]))
