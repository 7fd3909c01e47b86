"""Figures of vector sensors: how calibrations hold, and how ambient sound pulls bearings.

`python -m tests.benchmarks.difar_figures [RUNS [SEED]]`, with RUNS = 0 the lines alone.
"""

import sys

import numpy as np

from tests.support import DIFAR, recording_of, white_noise
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.flow.calibration import calibrate_sensor
from uwtrack_cli.simulate import make_scenario, simulate_recordings
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

SNR_DB = (-5.0, 0.0, 3.0, 6.0, 10.0, 20.0)
"""SNR at which bearings are measured."""


def drawn_passage(seed):
    """Return a recording, the truth of its track, and the drawn errors of the sensor."""
    draw = np.random.default_rng(seed)
    gains, leaks = draw.uniform(-0.25, 0.25, 2), draw.uniform(-0.08, 0.08, 2)
    cross, offset = draw.uniform(-0.08, 0.08), draw.uniform(-20.0, 20.0)
    speed, range_m = draw.uniform(3.0, 9.0), draw.uniform(60.0, 300.0)
    course, time_s = draw.uniform(0.0, 360.0), draw.uniform(120.0, 180.0)
    table = {
        "seed": seed,
        "duration_s": 300.0,
        "sample_rate_hz": 2000.0,
        "sensor": [
            {
                "id": "h1", "kind": "difar", "depth_m": 20.0, "full_scale_db": 140.0,
                "compass_error_deg": offset, "dipole_gain_errors": gains.tolist(),
                "dipole_crosstalk": cross, "omni_crosstalk": leaks.tolist(),
            }
        ],
        "vessel": [
            {
                "name": "launch",
                "closest_approach": {
                    "time_s": time_s, "horizontal_range_m": range_m,
                    "speed_mps": speed, "course_deg": course, "side": "port",
                },
                "line": [{"frequency_hz": 310.0, "cn0_db_hz": 35.0}],
                "broadband": {
                    "band_hz": [100.0, 900.0], "snr_db": draw.uniform(5.0, 20.0),
                    "slope_db_per_decade": -20.0,
                },
            }
        ],
        "noise": {
            "density_db": 70.0, "reference_hz": 1000.0, "slope_db_per_decade": -17.0
        },
    }  # fmt: skip
    scenario = make_scenario(table)
    (recording,) = simulate_recordings(scenario)
    angle = np.radians(course)
    along = np.array([np.sin(angle), np.cos(angle)])
    # the sensor lies to port: the vessel passes to the right of it, seen along the course
    place = range_m * np.array([along[1], -along[0]])
    times = np.arange(-10.0, 310.0)
    east, north = place[:, None] + speed * along[:, None] * (times - time_s)
    track = VesselTrack(
        vessel="launch", time_s=times, first=east, second=north,
        speed_mps=np.full(times.size, speed), course_deg=np.full(times.size, course),
    )  # fmt: skip
    truth = Truth(
        name="truth", start_utc_ns=None, is_geographic=False, tracks=(track,),
        sensor_places={"h1": (0.0, 0.0)},
    )  # fmt: skip
    return recording, truth, np.array([*(1.0 + gains), cross, *leaks, -offset])


def calibrations(runs, seed):
    """Print errors over deviations of every quantity, and what is left of bearings."""
    rows, left, stated, before = [], [], [], []
    for number in range(runs):
        recording, truth, due = drawn_passage(seed * 1000 + number)
        found, sensor = calibrate_sensor(recording, truth)
        got = np.array([one.value for one in found.quantities])
        std = np.array([one.std for one in found.quantities])
        off = got - due
        off[5] = wrap_deg(off[5])
        rows.append(off / std)
        left.append(direction_error(sensor, due))
        stated.append(found.compass_std_deg)
        before.append(direction_error(DIFAR, due))
    table = np.array(rows)
    names = [one.quantity for one in found.quantities]
    for name, column in zip(names, table.T, strict=True):
        inside = np.mean(np.abs(column) < 1.96)
        print(f"{name:22} rms/std {np.sqrt(np.mean(column**2)):.2f}, {inside:.0%} inside")
    print(f"bearing error before {np.median(before):.1f}, after {np.median(left):.2f}, "
          f"stated {np.median(stated):.2f} degrees (medians, rms over directions); "
          f"rms left/stated {np.sqrt(np.mean((np.array(left) / stated) ** 2)):.2f}")  # fmt: skip


def direction_error(sensor, due):
    """Return the rms error over all directions of a sensor with a true response."""
    angle = np.radians(np.arange(0, 360, 5))
    sine, cosine = (np.sin(angle - np.radians(due[5])), np.cos(angle - np.radians(due[5])))
    heard = np.stack(
        [due[0] * (sine + due[2] * cosine + due[3]), due[1] * (due[2] * sine + cosine + due[4])]
    )
    response = sensor.dipole_response
    ideal = np.linalg.solve(response[:, :2], heard - response[:, 2:])
    bearing = np.arctan2(*ideal) + np.radians(sensor.compass_offset_deg)
    return float(np.sqrt(np.mean(wrap_deg(np.degrees(bearing - angle)) ** 2)))


def channels_of(source, wind, noise, share, apart_deg):
    """Return what a vector sensor hears of a source at 70 degrees beside its ambient."""
    angles = np.radians([70.0, 70.0 + apart_deg])
    isotropic = np.sqrt(1 - share)
    return np.stack(
        [
            source + wind + isotropic * noise[0],
            *(source * f(angles[0]) + wind * f(angles[1]) + isotropic * part / np.sqrt(3)
              for f, part in zip((np.sin, np.cos), noise[1:], strict=True)),
        ],
        axis=1,
    )  # fmt: skip


def ambient_pull(snr_db, *, share, apart_deg=90.0, seed=1, quiet_s=200.0, loud_s=200.0):
    """Return the mean error of broadband bearings beside directed ambient sound.

    A vessel is heard at 70 degrees between two quiet times; a share of the ambient comes
    from apart_deg beside it.
    """
    rate = 2000.0
    begin, end = int(rate * quiet_s), int(rate * (quiet_s + loud_s))
    n = begin + end
    noise = [white_noise(n, seed * 10 + k, rate_hz=rate) for k in range(3)]
    wind = white_noise(n, seed * 10 + 3, rate_hz=rate) * np.sqrt(share)
    ship = white_noise(n, seed * 10 + 4, rate_hz=rate) * 10 ** (snr_db / 20)
    ship[:begin], ship[end:] = 0.0, 0.0
    samples = channels_of(ship, wind, noise, share, apart_deg)
    blocks = compute_spectrogram(recording_of(samples, rate, DIFAR))
    made = Levels.join(list(measure_levels(blocks, band_hz=(100.0, 900.0))))
    loud = np.abs(made.frames.time_s - n / rate / 2.0) < loud_s / 2.0 - 1.0
    error = wrap_deg(made.bearing_deg[loud] - 70.0)
    return error, made.bearing_std_deg[loud]


def line_pull(snr_db, *, share, apart_deg=90.0, seed=1, length_s=800.0):
    """Return errors and deviations of bearings of a line over such an ambient."""
    rate = 1000.0
    n = int(rate * length_s)
    noise = [white_noise(n, seed * 10 + k, rate_hz=rate) for k in range(3)]
    wind = white_noise(n, seed * 10 + 3, rate_hz=rate) * np.sqrt(share)
    power = 1.5 * 10 ** (snr_db / 10)
    tone = np.sqrt(2 * power) * np.sin(2 * np.pi * 200.25 * np.arange(n) / rate)
    samples = channels_of(tone, wind, noise, share, apart_deg)
    blocks = compute_spectrogram(recording_of(samples, rate, DIFAR), zero_padding=2)
    peaks = Peaks.join([find_peaks(block) for block in blocks])
    line = np.abs(peaks.frequency_hz - 200.25) < 0.6
    return wrap_deg(peaks.bearing_deg[line] - 70.0), peaks.bearing_std_deg[line]


def weighed(error, std):
    """Return the weighed mean error, its deviation, and rms of error over deviation."""
    weight = std**-2.0
    if error.size < 10:
        return float("nan"), float("nan"), float("nan")
    mean = float((weight * error).sum() / weight.sum())
    spread = float(np.sqrt(2.0 / weight.sum()))  # frames overlap by half
    return mean, spread, float(np.sqrt(np.mean((error / std) ** 2)))


def main(runs=40, seed=1):
    if runs:
        calibrations(runs, seed)
        for share in (0.0, 0.5, 0.9):
            for snr_db in SNR_DB:
                got = weighed(*ambient_pull(snr_db, share=share, seed=seed))
                print("broadband", share, snr_db, *(f"{v:.2f}" for v in got))
    for share, apart_deg in ((0.0, 90.0), (0.5, 90.0), (0.9, 90.0), (0.5, 45.0)):
        for snr_db in SNR_DB:
            error, std = line_pull(
                snr_db, share=share, apart_deg=apart_deg, seed=seed, length_s=3000.0
            )
            got = (*weighed(error, std), np.median(std))
            words = f"{share} at {apart_deg:.0f} degrees, {snr_db:.0f} dB:"
            print("line", words, error.size, *(f"{v:.2f}" for v in got), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
