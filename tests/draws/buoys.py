"""Sonobuoys: scenes, and the audio that their radio gives.

Buoys emphasise high frequencies by 6 dB an octave up to about 1 kHz, which a recorder's
high pass of first order does here, as in the response of an SSQ-53 (-20 dB at 10 Hz, 0 dB at
100 Hz, +20 dB at 1 kHz; M. Alksne et al., CalCOFI Sonobuoy Calibration).
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.simulate import make_scenario, simulate_recordings
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

BEARING_DEG = float(np.degrees(np.arctan2(1.0, 3.0)))
"""Bearing of the vessel of `scene`, which makes way straight off the buoy."""

LINES_HZ = (150.0, 310.0, 620.0)
"""Frequencies of the lines of `line_scene`, Hz."""

ROUGH = {
    "radio_snr_db": 20.0, "clock_error_ppm": 100.0, "wow": 1e-3, "wow_hz": 2.0,
    "phase_jitter_rad": 0.1,
}  # fmt: skip
"""A radio and a recorder with all that the demultiplexer must bear."""


def scene(seed, duration_s, radio=None, *, full_scale_db=117.0):
    """Return the table of a vessel at a steady bearing in ambient noise as loud as it.

    ``radio``: that of a buoy; None records omni and dipoles themselves.
    """
    sensor = {
        "id": "b1", "kind": "difar", "depth_m": 30.0, "full_scale_db": full_scale_db,
        "recorder": {"high_pass_hz": 1000.0, "order": 1},
    }  # fmt: skip
    if radio is not None:
        sensor["multiplex"] = radio
    return {
        "seed": seed,
        "duration_s": duration_s,
        "sample_rate_hz": 6000.0,
        "sensor": [sensor],
        "vessel": [
            {
                "name": "launch",
                "track": {
                    "east_m": 100.0, "north_m": 300.0, "speed_mps": 0.05,
                    "course_deg": BEARING_DEG,
                },
                "broadband": {
                    "band_hz": [50.0, 2300.0], "source_level_db": 163.0,
                    "slope_db_per_decade": -17.0,
                },
            }
        ],
        "noise": {
            "density_db": 70.0, "reference_hz": 1000.0, "slope_db_per_decade": -17.0
        },
    }  # fmt: skip


def line_scene(seed, duration_s, bearing_deg, radio=None):
    """Return the table of `scene` with a vessel of lines alone at any bearing."""
    table = scene(seed, duration_s, radio)
    (vessel,) = table["vessel"]
    del vessel["broadband"]
    bearing = np.radians(bearing_deg)
    vessel["track"] |= {
        "east_m": 316.0 * np.sin(bearing), "north_m": 316.0 * np.cos(bearing),
        "course_deg": bearing_deg,
    }  # fmt: skip
    vessel["line"] = [
        {"fundamental_hz": f, "harmonics": 1, "source_level_db": 155.0} for f in LINES_HZ
    ]
    return table


def line_errors_deg(recording, bearing_deg):
    """Return the errors of the bearings of its lines, frame by frame and line by line."""
    blocks = list(compute_spectrogram(recording, window_s=1.0))
    east, north = (
        np.concatenate([getattr(block, name) for block in blocks])
        for name in ("intensity_east", "intensity_north")
    )
    bins = np.rint(np.array(LINES_HZ) / blocks[0].frames.bin_hz).astype(int)
    found = np.degrees(np.arctan2(east[:, bins], north[:, bins])).ravel()
    found = found[np.isfinite(found)]
    return (found - bearing_deg + 180.0) % 360.0 - 180.0


def passage_scene(seed):
    """Return the table of a passage, drawn by a seed, past two buoys and their radios."""
    rng = np.random.default_rng((seed, 43))
    usual = {"position_std_m": 5.0, "compass_std_deg": 1.0, "clock_std_s": 0.1}
    (first,) = scene(seed, 120.0, {**ROUGH, "fade": [{"start_s": 10.0, "duration_s": 2.5}]},
                     full_scale_db=145.0)["sensor"]  # fmt: skip
    first |= usual
    radio = {"radio_snr_db": 15.0, "clock_error_ppm": -40.0}
    second = first | {"id": "b2", "east_m": 250.0, "north_m": 300.0, "multiplex": radio}
    way = {
        "sensor": "b1", "time_s": 45.0, "horizontal_range_m": rng.uniform(80.0, 160.0),
        "speed_mps": rng.uniform(5.0, 9.0), "course_deg": rng.uniform(0.0, 360.0),
        "side": ("port", "starboard")[rng.integers(2)],
    }  # fmt: skip
    vessel = {
        "name": "coaster", "source_depth_m": 4.0, "closest_approach": way,
        "frequency_jitter": {"fraction": 2e-5, "correlation_s": 20.0},
        "line": [{"fundamental_hz": 42.5, "harmonics": 6, "step_db": -2.0,
                  "source_level_db": 162.0}],
        "broadband": {"band_hz": [60.0, 2000.0], "source_level_db": 165.0,
                      "slope_db_per_decade": -15.0},
    }  # fmt: skip
    return scene(seed, 120.0) | {
        "start_utc": "2024-05-02T06:30:00Z", "sensor": [first, second], "vessel": [vessel],
        "noise": {"density_db": 68.0, "reference_hz": 1000.0, "slope_db_per_decade": -17.0},
    }  # fmt: skip


def held(table):
    """Return the first recording of a scenario with all its samples in memory."""
    recording = simulate_recordings(make_scenario(table))[0]
    samples = np.concatenate(list(recording.reader(1 << 18)))
    return replace(recording, reader=HeldSamples(samples))


def heard(recording, **sensor):
    """Return what a buoy's audio holds, as a recording in memory, and its reader.

    ``sensor``: facts of the sensor that are told otherwise.
    """
    told = replace(recording, sensor=replace(recording.sensor, **sensor))
    opened = demultiplex(told)
    samples = np.concatenate(list(opened.reader(1 << 18)))
    return replace(opened, reader=HeldSamples(samples)), opened.reader
