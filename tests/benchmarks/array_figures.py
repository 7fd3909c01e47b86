"""Figures of line arrays.

All of them, or those named: python -m tests.benchmarks.array_figures [NAME ...]
"""

import sys
import time
from dataclasses import replace

import numpy as np

from tests.arrays.test_array_chain import TURN, run, scene, truth_at
from tests.arrays.test_beamform import (
    FIXED,
    PLACES,
    RATE_HZ,
    C,
    N,
    beams_of,
    both_stand_out,
    cosine_of,
    exceedances,
    tones,
)
from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario
from uwtrack_cli.simulate.trajectories import array_place, vessel_trajectory
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

DENSITY = 2.0 / RATE_HZ
"""One-sided density of noise of unit variance."""


def level_db(rho_db):
    """Level of a tone whose power in a Hann cell is so far above the noise."""
    return rho_db + 10.0 * np.log10(1.5 * DENSITY)


def directions():
    print("cone, rho, shading: rms over bound, error over stated, frames")
    turn = 2.0 * np.pi * 450.0 / C
    for shading in ("uniform", "chebyshev"):
        for cone_deg, rho_db in ((90, 0), (90, 10), (90, 20), (60, 10), (30, 10), (15, 10)):
            truth = np.cos(np.radians(cone_deg))
            errors, stated = [], []
            for seed in range(4):
                at = truth + (seed - 1.5) / 4.0 * 2.0 / (4 * N)
                samples = tones([at], [level_db(rho_db)], 450.0, 60.0, seed)
                peaks = beams_of(
                    samples, shading=shading, overlap=0.0, band_hz=(400.0, 500.0)
                ).peaks
                cosine = cosine_of(peaks)
                near = np.abs(peaks.frequency_hz - 450.0) < 1.0
                near &= np.abs(cosine - truth) < 0.12
                errors.append(cosine[near] - at)
                sine = np.sqrt(1.0 - cosine[near] ** 2)
                stated.append(np.radians(peaks.cone_std_deg[near]) * sine)
            error, std = np.concatenate(errors), np.concatenate(stated)
            rho = 10.0 ** (rho_db / 10.0)
            bound = np.sqrt(6.0 / (rho * turn**2 * N * (N**2 - 1)))
            rms = np.sqrt(np.mean(error**2))
            ratio = np.sqrt(np.mean((error / std) ** 2))
            print(
                f"{cone_deg:3} {rho_db:3} {shading:10} {rms / bound:.3f} {ratio:.3f} {error.size}"
            )


def sensor_of(n_elements):
    """A line of hydrophones 1 m apart, and their places."""
    places = np.arange(n_elements) - 0.5 * (n_elements - 1)
    names = ",".join(f"e{k}" for k in range(n_elements))
    along = ",".join(map(str, places))
    return replace(FIXED, channels=names, element_along_m=along), places


def half_detected(levels, shares):
    """Level at which half are detected, from a straight line through the shares."""
    slope, middle = np.polyfit(levels, np.array(shares) - 0.5, 1)
    return -middle / slope


def detection():
    print("hydrophones: level of half detected at 1e-4 by default bands, uniform")
    for n_elements, centre_db in ((1, 9.8), (16, -2.3), (32, -5.3)):
        sensor, places = sensor_of(max(n_elements, 2))
        levels, shares = centre_db + np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), []
        for rho_db in levels:
            hits = frames = 0
            for seed in range(12):
                at = 0.2 + seed / 12.0 * 2.0 / (4 * n_elements)
                samples = tones([at], [level_db(rho_db)], 450.0, 60.0, 50 + seed, places)
                if n_elements == 1:
                    sound = recording_of(samples[:, :1], RATE_HZ, Sensor(id="one"))
                    spectra = compute_spectrogram(sound, overlap=0.0)
                    peaks = Peaks.join([find_peaks(block) for block in spectra])
                    near = peaks.is_detection.copy()
                else:
                    peaks = beams_of(samples, sensor, shading="uniform", overlap=0.0).peaks
                    near = peaks.is_detection & (np.abs(cosine_of(peaks) - at) < 0.2)
                near &= np.abs(peaks.frequency_hz - 450.0) < 1.0
                hits += np.unique(peaks.frame[near]).size
                frames += peaks.frames.n_frames
            shares.append(hits / frames)
        print(f"{n_elements:3} {half_detected(levels, shares):.2f} dB", np.round(shares, 3), frames)


def endfire():
    print("hydrophones, cosine: rms over 0.893 sqrt(sigma), frames, greatest deviation")
    for n_elements in (16, 32):
        sensor, places = sensor_of(n_elements)
        for cosine in (1.0, -1.0):
            errors, stated = [], []
            for seed in range(8):
                samples = tones([cosine], [level_db(12.0)], 450.0, 60.0, 80 + seed, places)
                peaks = beams_of(
                    samples, sensor, shading="uniform", overlap=0.0, band_hz=(350.0, 550.0)
                ).peaks
                strong = peaks.snr_db > 18.0
                errors.append(peaks.cone_deg[strong] - (0.0 if cosine > 0 else 180.0))
                stated.append(np.radians(peaks.cone_std_deg[strong]) ** 2)
            error, sigma = np.concatenate(errors), np.concatenate(stated)
            wanted = 0.893 * np.degrees(np.sqrt(sigma.mean()))
            most = np.degrees(np.sqrt(sigma.max()))
            print(f"{n_elements:3} {cosine:+.0f} {np.sqrt((error**2).mean()) / wanted:.3f} "
                  f"{error.size} {most:.1f}")  # fmt: skip


def resolution():
    print("beamformer, widths apart: share of records in which both sources stand out")
    for widths, options in (
        (1.2, {"beamformer": "conventional", "shading": "uniform"}),
        (0.6, {"beamformer": "mvdr"}),
    ):
        found = [both_stand_out(widths, options, seed) for seed in range(40)]
        print(f"{options['beamformer']:12} {widths} {np.mean(found):.3f}")


def false_alarms():
    print("noise, vessel, probability: rate over nominal, least and greatest beam")
    for density_db, loud in ((60.0, False), (-60.0, False), (60.0, True)):
        array = {
            "id": "tow", "kind": "array", "depth_m": 30.0, "full_scale_db": 140.0,
            "element_along_m": PLACES.tolist(), "heading_deg": 0.0,
            "element_noise_db": 50.0,
        }  # fmt: skip
        vessel = {
            "source_depth_m": 30.0,
            "track": {"east_m": 800.0, "north_m": 900.0, "course_deg": 0.0, "speed_mps": 0.0},
            "broadband": {"band_hz": [50.0, 750.0], "source_level_db": 150.0},
        }
        table = {
            "seed": 11, "duration_s": 150.0, "sample_rate_hz": RATE_HZ,
            "sensor": [array], "noise": {"density_db": density_db},
            "vessel": [vessel] if loud else [],
        }  # fmt: skip
        (recording,) = simulate_recordings(make_scenario(table))
        for probability in (1e-2, 1e-3, 1e-4):
            counted, cells = 0.0, 0
            for beams, floor, detect in exceedances(recording, probability):
                over = beams.power > detect[:, None].astype(np.float32) * floor
                counted = counted + over.mean(axis=2).sum(axis=1)
                cells += beams.frames.n_frames
            rate = counted / cells / probability
            print(f"{density_db:5} {loud!s:5} {probability:.0e} {rate.mean():.3f} "
                  f"{rate.min():.2f} {rate.max():.2f}")  # fmt: skip


def motions():
    print("seed: range, speed, course error; stated; modes")
    for seed in range(1, 5):
        scenario = scene(seed, turn=[TURN])
        found = run(scenario)[Motions]
        truth = truth_at(scenario, found.time_s[0])
        row = [
            f"{getattr(found, name)[0] - truth[name]:+.2f} +- {std[0]:.2f}"
            for name, std in (
                ("range_m", found.range_std_m), ("speed_mps", found.speed_std_mps),
                ("course_deg", found.course_std_deg),
            )
        ]  # fmt: skip
        print(seed, *row, found.contact.tolist(), found.weight.round(3).tolist())


def towed_scene(n_elements, vessels, seed, turn=True, duration_s=1000.0):
    """A towed line 1 m apart, 150 m behind a ship of 3 m/s that turns by 60 degrees.

    Vessels are given by east and north at the start (m), course (degrees), speed (m/s)
    and their lines (Hz, dB).
    """
    turns = [{"at_s": 450.0, "course_deg": 60.0, "rate_deg_per_s": 1.0}] if turn else []
    places = np.arange(n_elements) - 0.5 * (n_elements - 1)
    array = {
        "id": "tow1", "kind": "array", "depth_m": 40.0, "full_scale_db": 140.0,
        "element_along_m": places[::-1].tolist(),
        "tow_offset_m": 150.0, "element_noise_db": 54.0,
        "track": {"course_deg": 0.0, "speed_mps": 3.0, "turn": turns},
    }  # fmt: skip
    return make_scenario(
        {"seed": seed, "duration_s": duration_s, "sample_rate_hz": RATE_HZ,
         "sensor": [array], "noise": {"density_db": 62.0},
         "vessel": [
             {"source_depth_m": 5.0,
              "track": {"east_m": east, "north_m": north, "course_deg": course,
                        "speed_mps": speed},
              "line": [{"frequency_hz": f, "source_level_db": level}
                       for f, level in lines]}
             for east, north, course, speed, lines in vessels]}
    )  # fmt: skip


ONE = [(2600.0, 1900.0, 170.0, 5.0, [(310.0, 138.0), (455.0, 137.0), (610.0, 136.0)])]
TWO = [
    (2300.0, 1500.0, 140.0, 6.0, [(330.0, 135.0), (560.0, 134.5)]),
    (-1700.0, 1900.0, 60.0, 4.0, [(410.0, 135.0), (655.0, 134.5)]),
]


def scenes():
    """The scenes of a towed line: range, speed and course of every vessel."""
    print("scene seed: lines followed | contact, weight, reading: value +- stated (truth)")
    for name, n_elements, vessels, turn, seeds in (
        ("turn", 16, ONE, True, range(1, 6)),
        ("two", 32, TWO, True, range(11, 14)),
        ("straight", 16, ONE, False, range(21, 24)),
    ):
        for seed in seeds:
            scenario = towed_scene(n_elements, vessels, seed, turn)
            made = run(scenario)
            found = made[Motions]
            print(name, seed, np.unique(made[Lines].line_id).size, end=" |")
            for row in range(found.contact.size):
                middle = array_place(scenario.sensors[0], (0.0,) * 3)
                here = middle.at(np.array(found.time_s[row]))
                print(f" {found.contact[row]} w {found.weight[row]:.2f}", end="")
                best = None
                for vessel in scenario.vessels:
                    there = vessel_trajectory(vessel, scenario)
                    there = there.at(np.array(found.time_s[row]))
                    east, north = there[0] - here[0], there[1] - here[1]
                    away = np.hypot(east, north)
                    off = abs(found.bearing_deg[row] - np.degrees(np.arctan2(east, north)))
                    off = min(off % 360.0, -off % 360.0)
                    if best is None or off < best[0]:
                        best = off, away, vessel
                off, away, vessel = best
                print(
                    f" {off:.1f} deg off: {found.range_m[row]:.0f}+-"
                    f"{found.range_std_m[row]:.0f} ({away:.0f}) m,"
                    f" {found.speed_mps[row]:.2f}+-{found.speed_std_mps[row]:.2f} m/s,"
                    f" {found.course_deg[row]:.1f}+-{found.course_std_deg[row]:.1f} deg;",
                    end="",
                )
            print(flush=True)


def cost():
    samples = tones([0.3], [-10.0], duration_s=600.0).astype(np.float32)
    begin = time.process_time()
    beams_of(samples, zero_padding=1)
    whole = time.process_time() - begin
    from scipy.fft import rfft

    window = np.hanning(1600).astype(np.float32)
    begin = time.process_time()
    for channel in samples.T:
        view = np.lib.stride_tricks.sliding_window_view(channel, 1600)[::800]
        for first in range(0, len(view), 32):
            rfft(view[first : first + 32] * window)
    print(f"beamform over the bare transforms: {whole / (time.process_time() - begin):.1f}")


def oracle():
    """Beams of two sources against those of acoular, which must be installed for it."""
    from acoular import BeamformerBase, ImportGrid, MicGeom, PowerSpectraImport, SteeringVector

    print("Hz: greatest difference to acoular within 20 dB of the maximum, dB")
    window = np.hanning(1601)[:-1]
    for frequency_hz in (300.0, 500.0, 700.0):
        samples = tones([0.31, -0.45], [0.0, -3.0], frequency_hz, 32.0, 5)
        record = beams_of(
            samples, shading="uniform", overlap=0.0, zero_padding=1,
            band_hz=(frequency_hz - 8.0, frequency_hz + 8.0),
        )  # fmt: skip
        inside = np.abs(record.cos_angle) <= 1.0
        cosines = record.cos_angle[inside]
        ours = 10.0 * np.log10((10.0 ** (record.level_db[:, inside] / 10.0)).mean(axis=0))
        frames = samples.reshape(-1, 1600, N) * window[:, None]
        spectra = np.fft.rfft(frames, axis=1)
        toward = np.stack([cosines, np.sqrt(1.0 - cosines**2), 0.0 * cosines])
        steer = SteeringVector(
            grid=ImportGrid(pos=1e4 * toward),
            mics=MicGeom(pos_total=np.stack([PLACES, 0.0 * PLACES, 0.0 * PLACES])),
            steer_type="classic",
        )
        steer.env.c = C
        power = 0.0
        for cell_hz in frequency_hz + np.arange(-8.0, 9.0):
            cell = spectra[:, round(cell_hz)]
            matrix = np.einsum("kn,km->nm", cell, cell.conj()) / len(cell)
            data = PowerSpectraImport(csm=matrix[None], frequencies=cell_hz)
            beams = BeamformerBase(freq_data=data, steer=steer, r_diag=False, cached=False)
            power = power + beams.synthetic(cell_hz, 0).ravel()
        theirs = 10.0 * np.log10(power)
        near = theirs > theirs.max() - 20.0
        off = (ours - theirs)[near]
        print(f"{frequency_hz:.0f} {np.abs(off - np.median(off)).max():.3f} {near.sum()}")


FIGURES = (cost, directions, detection, endfire, resolution, motions, scenes, false_alarms)

if __name__ == "__main__":
    for figure in FIGURES:
        if figure.__name__ in sys.argv[1:] or not sys.argv[1:]:
            figure()
    if "oracle" in sys.argv[1:]:
        oracle()
