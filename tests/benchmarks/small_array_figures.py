"""Figures of small arrays.

python -m tests.benchmarks.small_array_figures [directions | several | noise ...]
"""

import os
import sys
import warnings
from pathlib import Path

import numpy as np

from tests.arrays.test_spatial_array import C
from tests.draws.array_scenes import TETRAHEDRON, frames_from_anywhere, sensor_of
from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.arrays.delays import measure_delays
from uwtrack_cli.arrays.directions import find_directions
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.directions import Delays, Directions
from uwtrack_cli.files.audio.recording_file import open_recording

RATE_HZ, FRAMES = 4000, 100
WEIGHTINGS = ("plain", "phat", "ml")


def bound_deg(band_hz, rho_db):
    rho = 10.0 ** (rho_db / 10.0)
    turn = 2.0 * np.pi * np.arange(*band_hz) / C
    weight = 4.0 * rho**2 / (1.0 + 4.0 * rho) / 1.5
    return np.degrees(1.0 / np.sqrt(2.0 * np.sum(weight * turn**2) * 0.5))


def told(found: Directions, azimuth_deg, elevation_deg):
    found = found.strongest()
    frame = np.rint(found.time_s - 0.5).astype(int)
    off = (found.bearing_deg - azimuth_deg[frame] + 180.0) % 360.0 - 180.0
    rise = found.elevation_deg - elevation_deg[frame]
    level = np.cos(np.radians(elevation_deg[frame]))
    ratio = np.concatenate([off / found.bearing_std_deg, rise / found.elevation_std_deg])
    rms = [np.sqrt(np.mean(x**2)) for x in (off * level, rise, ratio)]
    return f"{rms[0]:.3f} {rms[1]:.3f} {rms[2]:.2f} {1.0 - frame.size / FRAMES:.2f}"


def directions():
    print("band, dB: bound; rms azimuth x cos(el), elevation, over stated, share without")
    sensor = sensor_of(TETRAHEDRON)
    for band_hz in ((60.0, 1800.0), (60.0, 700.0), (800.0, 1800.0)):
        for rho_db in (-5, 0, 10, 20):
            samples, *truth = frames_from_anywhere(rho_db)
            recording = recording_of(samples, RATE_HZ, sensor)
            row = [f"bound {bound_deg(band_hz, rho_db):.3f}"]
            for weighting in WEIGHTINGS:
                blocks = measure_delays(
                    recording, overlap=0.0, band_hz=band_hz, weighting=weighting
                )
                found = find_directions(Delays.join(list(blocks)), sensor)
                row.append(f"{weighting} {told(found, *truth)}")
            beams = form_beams(
                recording, overlap=0.0, zero_padding=1, band_hz=band_hz,
                false_alarm_probability=1e-3,
            )  # fmt: skip
            found = BearingTime.join(list(beams)).directions
            row.append(f"beams {told(found, *truth)}")
            print(band_hz, rho_db, " | ".join(row), flush=True)


def real_noise():
    """Hydrophones minutes apart in time share no sound, but keep their noise."""
    folder = Path(os.environ["UWTRACK_REAL_DATA"]) / "array"
    table = np.loadtxt(folder / "infrasound_brp.positions.csv", delimiter=",", skiprows=1)
    places = np.column_stack([table[:, 1:], np.zeros(4)])
    sensor = sensor_of(places, sound_speed_mps=345.0)
    recording = open_recording(folder / "infrasound_brp.wav", sensor=sensor)
    (samples,) = recording.reader(recording.n_samples)
    for probability in (0.1, 0.01):
        hits = frames = 0
        for shift in (4130, 5730, 7930, 9170):
            apart = np.stack([np.roll(samples[:, k], shift * k) for k in range(4)], axis=1)
            blocks = form_beams(
                recording_of(apart, 100.0, sensor), band_hz=(1.0, 5.0), window_s=20.0,
                false_alarm_probability=probability, kept_probability=0.2,
            )  # fmt: skip
            record = BearingTime.join(list(blocks))
            hits += record.directions.frame.size
            frames += record.frames.n_frames
        print(f"real noise, {probability}: {hits} of {frames} frames")


def several():
    """Two and three sources in each of 60 frames: how often each is told, and how well."""
    pairs = [((40.0, 0.0, 10.0), (40.0 + apart, 0.0, 10.0)) for apart in (30, 45, 90)]
    pairs += [((40.0, 0.0, 20.0), (130.0, 0.0, low)) for low in (10.0, 0.0, -5.0)]
    pairs += [((40.0, 0.0, 20.0),), ((40.0, 0.0, 0.0),)]
    pairs += [((40.0, 10.0, 10.0), (160.0, 0.0, 10.0), (280.0, 0.0, 8.0))]
    for sources in pairs:
        rng, n = np.random.default_rng(21), 60 * RATE_HZ // 2
        heard = rng.standard_normal((n, 4))
        frequency_hz = np.fft.rfftfreq(n, 2.0 / RATE_HZ)
        for azimuth, elevation, level_db in sources:
            a, e = np.radians([azimuth, elevation])
            toward = [np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)]
            own = np.fft.rfft(rng.standard_normal(n)) * 10.0 ** (level_db / 20.0)
            turn = np.exp(2j * np.pi * np.outer(TETRAHEDRON @ toward / C, frequency_hz))
            heard += np.fft.irfft(own * turn, n).T
        recording = recording_of(heard, RATE_HZ // 2, sensor_of(TETRAHEDRON))
        blocks = form_beams(
            recording, overlap=0.0, zero_padding=1, band_hz=(60.0, 900.0),
            false_alarm_probability=1e-3,
        )  # fmt: skip
        found = BearingTime.join(list(blocks)).directions
        row, right = [], np.zeros(found.frame.size, np.bool_)
        for azimuth, *_ in sources:
            off = (found.bearing_deg - azimuth + 180.0) % 360.0 - 180.0
            near = np.abs(off) < 15.0
            right |= near
            ratio = np.sqrt(np.mean((off / found.bearing_std_deg)[near] ** 2))
            row.append(f"{near.sum() / 60:.2f} of frames, {off[near].mean():+.2f}, "
                       f"{np.median(found.bearing_std_deg[near]):.2f}, {ratio:.2f}")  # fmt: skip
        print(sources, *row, "others", np.count_nonzero(~right), sep=" | ", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    asked = sys.argv[1:] or ["directions", "several", "noise"]
    for name, made in (("directions", directions), ("several", several)):
        if name in asked:
            made()
    if "noise" in asked and "UWTRACK_REAL_DATA" in os.environ:
        real_noise()
