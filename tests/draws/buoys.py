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

BEARING_DEG = float(np.degrees(np.arctan2(1.0, 3.0)))
"""Bearing of the vessel of `scene`, which makes way straight off the buoy."""

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
