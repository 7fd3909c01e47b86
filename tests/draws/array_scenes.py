"""A towed array past which one vessel goes, and frames of sound from anywhere at a small one."""

import numpy as np

from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.simulate.scenario import make_scenario
from uwtrack_cli.simulate.trajectories import array_place, vessel_trajectory

LINES = [{"frequency_hz": f, "source_level_db": 141.0} for f in (141.0, 213.0)]
COURSE_DEG, SPEED_MPS = 310.0, 6.0
TURN = {"at_s": 110.0, "course_deg": 320.0, "rate_deg_per_s": 2.0}

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 8.0**0.5
C, RATE_HZ, FRAMES = 1500.0, 4000, 100


def scene(seed=7, turn=(), course_deg=20.0, duration_s=280.0, place=(1200.0, 600.0), **sound):
    """Eight hydrophones 80 m behind a ship; one vessel, of two lines unless given."""
    array = {
        "id": "tow1", "kind": "array", "depth_m": 20.0, "full_scale_db": 140.0,
        "element_along_m": [10.5 - 3.0 * k for k in range(8)], "tow_offset_m": 80.0,
        "track": {"course_deg": course_deg, "speed_mps": 4.0, "turn": list(turn)},
    }  # fmt: skip
    vessel = {
        "source_depth_m": 4.0,
        "track": {"east_m": place[0], "north_m": place[1], "course_deg": COURSE_DEG,
                  "speed_mps": SPEED_MPS},
        **(sound or {"line": LINES}),
    }  # fmt: skip
    return make_scenario(
        {"seed": seed, "duration_s": duration_s, "sample_rate_hz": 500.0,
         "sensor": [array], "vessel": [vessel],
         "noise": {"density_db": 62.0, "reference_hz": 100.0}}
    )  # fmt: skip


def truth_at(scenario, time_s):
    """Range and bearing from the array's middle, and the vessel's course and speed."""
    here = array_place(scenario.sensors[0], (0.0,) * 3).at(np.array(time_s))
    there = vessel_trajectory(scenario.vessels[0], scenario).at(np.array(time_s))
    east, north = there[0] - here[0], there[1] - here[1]
    return {
        "range_m": np.hypot(east, north),
        "bearing_deg": np.degrees(np.arctan2(east, north)) % 360.0,
        "speed_mps": SPEED_MPS,
        "course_deg": COURSE_DEG,
    }


def sensor_of(places, heading_deg=0.0, **facts):
    text = ";".join(",".join(map(str, place)) for place in places)
    return Sensor(
        id="a", kind="array", channels=",".join(f"e{k}" for k in range(len(places))),
        element_positions_m=text, heading_deg=heading_deg, heading_source="fixed",
        **facts,
    )  # fmt: skip


def frames_from_anywhere(rho_db, seed=7):
    """Seconds of sound, each from a direction of its own, in independent noise."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, FRAMES)
    elevation = np.radians(rng.uniform(-30.0, 30.0, FRAMES))
    frequency_hz = np.fft.rfftfreq(RATE_HZ, 1.0 / RATE_HZ)
    parts = []
    for a, e in zip(azimuth, elevation, strict=True):
        toward = [np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)]
        source = np.fft.rfft(rng.standard_normal(RATE_HZ)) * 10.0 ** (rho_db / 20.0)
        turn = np.exp(2j * np.pi * np.outer(TETRAHEDRON @ toward / C, frequency_hz))
        heard = np.fft.irfft(source * turn, RATE_HZ).T
        parts.append(heard + rng.standard_normal((RATE_HZ, 4)))
    return np.concatenate(parts), np.degrees(azimuth), np.degrees(elevation)
