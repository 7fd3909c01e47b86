"""Figures of the demultiplexer of sonobuoys, each beside its band.

`python -m tests.benchmarks.sonobuoy_figures [SEED]`; docs/sonobuoys.md has them.
"""

import json
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from tests.draws.buoys import (
    BEARING_DEG,
    ROUGH,
    heard,
    held,
    line_errors_deg,
    line_scene,
    passage_scene,
    scene,
)
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.flow.sample_recordings import write_simulation
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.simulate import make_scenario
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

UWTRACK = Path(sys.executable).with_name("uwtrack")
"""The installed command."""

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
    spectra = [np.fft.rfft(s.reshape(-1, 6000, 3), axis=1)[:, 50:2000] for s in (found, true)]
    cross = np.sum(spectra[0] * np.conj(spectra[1]), axis=(0, 1)).real
    level = cross / np.sum(np.abs(spectra[1]) ** 2, axis=(0, 1))
    return level[1:] / level[0]


def told(what, figure, band, *, is_met):
    """Print a figure beside its band."""
    print(f"{what}: {figure} ({band}){'' if is_met else '  NOT MET'}")


def spread(what, before, after):
    """Print mean and deviation of bearing errors after the radio beside their bands."""
    moved = after.mean() - before.mean()
    told(f"{what}, mean of bearings", f"{before.mean():.3f}, after {after.mean():.3f}",
         "within .1 degree", is_met=abs(moved) < 0.1)  # fmt: skip
    more = 100.0 * (after.std() / before.std() - 1.0)
    is_bound = "12 dB" not in what
    told(
        f"{what}, their noise",
        f"{before.std():.3f} degrees {more:+.1f} %",
        "+5 % at most" if is_bound else "at 20 dB +5 % at most, here no band",
        is_met=more < 5.0 or not is_bound,
    )


def through_radio(seed):
    """Print bearings, gains and cost before and after the way through the radio."""
    direct = held(scene(seed, DURATION_S))
    before = errors_deg(direct)
    radios = [("20 dB", {"radio_snr_db": 20.0}), ("20 dB, clock, wow, jitter", ROUGH),
              ("12 dB", {"radio_snr_db": 12.0}), ("no noise", {})]  # fmt: skip
    for name, radio in radios:
        audio = held(scene(seed, DURATION_S, radio))
        begin = time.process_time()
        found, _ = heard(audio)
        cost_s = 60.0 * (time.process_time() - begin) / DURATION_S
        spread(name, before, errors_deg(found))
        if "clock_error_ppm" not in radio:
            pair = gains(found.reader.samples, direct.reader.samples)
            told(f"{name}, gains", np.round(pair, 4), "1 within .02",
                 is_met=np.all(np.abs(pair - 1.0) < 0.02))  # fmt: skip
        told(f"{name}, cost", f"{cost_s:.2f} CPU s a minute", "1.5 at most", is_met=cost_s <= 1.5)


def tones(seed):
    """Print bearings of single lines before and after a radio of 20 dB."""
    for bearing_deg in (20.0, 110.0, 200.0, 290.0):
        direct = held(line_scene(seed, DURATION_S, bearing_deg))
        radio = {"radio_snr_db": 20.0}
        found, _ = heard(held(line_scene(seed, DURATION_S, bearing_deg, radio)))
        errors = (line_errors_deg(one, bearing_deg) for one in (direct, found))
        spread(f"lines at {bearing_deg:.0f} degrees, 20 dB", *errors)


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
        share, level_db = np.mean(table.locked_share), np.median(table.pilot_snr_db)
        told(f"lock at {snr_db} dB", f"{share:.3f} of the time, pilot {level_db:.1f} dB",
             "all to 12 dB", is_met=share == 1.0 or snr_db < 12)  # fmt: skip
    rng = np.random.default_rng(seed)
    late = []
    for number in range(20):
        fade = {"start_s": rng.uniform(2, 6), "duration_s": rng.uniform(0.1, 8)}
        radio = {**ROUGH, "radio_snr_db": 12.0, "fade": [fade]}
        samples = heard(held(scene(seed + number, 16.0, radio)))[0].reader.samples
        last = np.flatnonzero(np.isnan(samples[:, 0]))[-1] / 6000.0
        late.append(last - fade["start_s"] - fade["duration_s"])
    told("regained after 20 fades at 12 dB", f"{max(late):.3f} s at most",
         "within a second", is_met=max(late) < 1.0)  # fmt: skip


def passage(seed):
    """Print the places of a drawn passage past two buoys, as audio, by one `run`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_simulation(make_scenario(passage_scene(seed)), folder / "p.wav")
        sounds = [folder / f"p-{buoy}.wav" for buoy in ("b1", "b2")]
        words = ["run", *map(str, sounds), "--start-utc", "2024-05-02T06:30:00Z", "-q"]
        subprocess.run([UWTRACK, *words], check=True, capture_output=True)
        score = subprocess.run(
            [UWTRACK, "score", folder / "p-b1.fixes.h5", "--truth", folder / "p.truth.json",
             "--json"], check=False, capture_output=True, text=True,
        )  # fmt: skip
    rows = [row for row in json.loads(score.stdout)["scores"] if row["quantity"] == "position_m"]
    for row in rows:
        told("a passage past two buoys, position", f"{row['error']:.1f} m, "
             f"{row['sigmas']:.2f} deviations", "3 deviations at most",
             is_met=row["sigmas"] < 3.0)  # fmt: skip


if __name__ == "__main__":
    warnings.simplefilter("ignore", UwtrackWarning)
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    through_radio(wanted)
    tones(wanted)
    lock(wanted)
    passage(wanted)
