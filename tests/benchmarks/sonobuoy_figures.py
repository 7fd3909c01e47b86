"""Figures of the demultiplexer of sonobuoys: bearings, gains, lock, CPU time.

`python -m tests.benchmarks.sonobuoy_figures [SEED]`; docs/sonobuoys.md has them.
"""

import sys
import time
import warnings

import numpy as np

from tests.draws.buoys import BEARING_DEG, ROUGH, heard, held, scene
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

DURATION_S = 300.0
"""Length of a recording of a vessel, s."""


def errors_deg(recording):
    """Return the errors of its bearings, s by s."""
    blocks = measure_levels(compute_spectrogram(recording, window_s=1.0))
    return Levels.join(list(blocks)).bearing_deg - BEARING_DEG


def gains(found, true):
    """Return the level of each dipole over that of the omni channel, against the truth.

    From 50 to 2000 Hz, second by second, where the sound has not been stretched.
    """
    spectra = [np.fft.rfft(s.reshape(-1, 6000, 3), axis=1)[:, 50:2000]
               for s in (found, true)]  # fmt: skip
    cross = np.sum(spectra[0] * np.conj(spectra[1]), axis=(0, 1)).real
    level = cross / np.sum(np.abs(spectra[1]) ** 2, axis=(0, 1))
    return level[1:] / level[0]


def through_radio(seed):
    """Print bearings and gains before and after the way through the radio."""
    direct = held(scene(seed, DURATION_S))
    before = errors_deg(direct)
    print(f"before: mean {before.mean():.3f}, std {before.std():.3f} degrees")
    radios = [("20 dB", {"radio_snr_db": 20.0}), ("20 dB, clock, wow, jitter", ROUGH),
              ("12 dB", {"radio_snr_db": 12.0}), ("no noise", {})]  # fmt: skip
    for name, radio in radios:
        audio = held(scene(seed, DURATION_S, radio))
        begin = time.process_time()
        found, _ = heard(audio)
        cost_s = time.process_time() - begin
        after = errors_deg(found)
        is_straight = "clock_error_ppm" not in radio
        pair = (
            gains(found.reader.samples, direct.reader.samples) if is_straight else "-"
        )
        print(
            f"{name}: mean {after.mean():.3f}, std {after.std():.3f} "
            f"({100 * (after.std() / before.std() - 1):+.1f} %), gains {pair}, "
            f"{60.0 * cost_s / DURATION_S:.2f} CPU s a minute"
        )


def lock(seed):
    """Print where lock holds, and how soon it is there again."""
    for snr_db in (20, 12, 6, 3, 0, -3, -6):
        radio = {**ROUGH, "radio_snr_db": snr_db}
        reader = demultiplex(held(scene(seed, 60.0, radio))).reader
        try:
            for _ in reader(6000):
                pass
        except ValueError:  # there is none anywhere
            pass
        table = reader.lock("b1")
        print(f"{snr_db} dB: locked {np.mean(table.locked_share):.3f}, "
              f"pilot {np.median(table.pilot_snr_db):.1f} dB")  # fmt: skip
    rng = np.random.default_rng(seed)
    late = []
    for number in range(20):
        fade = {"start_s": rng.uniform(2, 6), "duration_s": rng.uniform(0.1, 8)}
        radio = {**ROUGH, "radio_snr_db": 12.0, "fade": [fade]}
        samples = heard(held(scene(seed + number, 16.0, radio)))[0].reader.samples
        last = np.flatnonzero(np.isnan(samples[:, 0]))[-1] / 6000.0
        late.append(last - fade["start_s"] - fade["duration_s"])
    print(f"regained after 20 fades at 12 dB: {max(late):.3f} s at most")


if __name__ == "__main__":
    warnings.simplefilter("ignore", UwtrackWarning)
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    through_radio(wanted)
    lock(wanted)
