"""Directed ambient sound or a vessel's own tail: python -m studies.constants.ambient [SEEDS].

`SAME_AMBIENT` and `QUIET_S` of `uwtrack_cli.spectra.levels` decide whether the intensity of the
quiet time is taken off broadband bearings. Too strict, and the ambient draws a weak vessel;
too lax, and the faint sound of the vessel itself before and after turns its own bearings.
Printed are the mean errors of both, degrees, over seeds: of a vessel of 0 dB at 70 degrees
while a tenth, and half, of the ambient comes from 160 degrees, and the rms error of a vessel
that passes, near the beginning or in the middle.

With 60 s and 0.3: 0.2, 0.2, 0.8 and 0.9 degrees (seeds 1 and 2), and the same to the last figure
from 15 to 120 s and from 0.03 to 10; with 0.003, or 180 s of 160 that are quiet, nothing is
taken off: 5.8 and 26.8 degrees. Neither constant was fitted; neither edge is near.
"""

import sys
import warnings

import numpy as np

from tests.benchmarks.difar_figures import ambient_pull
from tests.support import DIFAR, recording_of, white_noise
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.spectra import levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram


def own_tail(seed: int, pass_s: float, scale_s: float = 40.0) -> float:
    """Return the rms error of bearings of a vessel that is heard all the time, degrees."""
    rate, seconds = 1000.0, 512
    time_s = np.arange(int(rate * seconds)) / rate
    noise = [white_noise(time_s.size, 10 * seed + k, rate_hz=rate) for k in range(3)]
    lag = (time_s - pass_s) / scale_s
    bearing = np.radians(90.0) + np.arctan(lag)
    ship = white_noise(time_s.size, 10 * seed + 3, rate_hz=rate)
    ship *= np.sqrt(8.0 / (1.0 + lag**2))
    samples = np.stack(
        [ship + noise[0], *(ship * f(bearing) + part / np.sqrt(3)
         for f, part in zip((np.sin, np.cos), noise[1:], strict=True))],
        axis=1,
    )  # fmt: skip
    blocks = compute_spectrogram(recording_of(samples, rate, DIFAR))
    made = Levels.join(list(levels.measure_levels(blocks, band_hz=(50.0, 450.0))))
    near = np.abs(made.frames.time_s - pass_s) < 60.0
    truth = np.interp(made.frames.time_s, time_s, np.degrees(bearing))
    off = wrap_deg(made.bearing_deg[near] - truth[near])
    return float(np.sqrt(np.mean(off**2)))


def main(n_seeds: int = 3) -> None:
    """Print both errors over a grid of the two constants."""
    warnings.simplefilter("ignore")
    for quiet_s in (60.0, 15.0, 120.0, 180.0):
        for same in (0.003, 0.03, 0.3, 1.0, 10.0):
            levels.QUIET_S, levels.SAME_AMBIENT = quiet_s, same
            found: list[list[float]] = [[], [], [], []]
            for seed in range(1, n_seeds + 1):
                for k, share in enumerate((0.1, 0.5)):
                    error, _ = ambient_pull(0.0, share=share, quiet_s=160.0, loud_s=64.0, seed=seed)
                    found[k].append(abs(float(error.mean())))
                found[2].append(own_tail(seed, 100.0))
                found[3].append(own_tail(seed, 256.0))
            means = " ".join(f"{np.mean(one):.1f}" for one in found)
            print(f"{quiet_s:.0f} s, {same}: {means}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
