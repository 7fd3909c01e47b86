"""Sound of sources that move along any path past a hydrophone or a vector sensor.

The time of emission is found by inverting arrival over emission on a fine grid, the
sound between samples by a windowed sinc. Nothing is shared with the program's simulator.
"""

from collections.abc import Callable

import numpy as np

from tests.draws.recordings import Passage
from tests.draws.vehicle_sounds import coloured, wander

SOUND_MPS = 1500.0
GRID_S = 0.02
LEAD_S = 3.0
"""Sound is made so long before the recording begins."""

Path = Callable[[np.ndarray], np.ndarray]
"""East, north of a source at times of emission, m, shape (2, time)."""


def delayed(samples: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Interpolate samples at fractional positions, by 16 taps."""
    whole = np.floor(position).astype(int)
    out = np.zeros(position.size)
    for k in range(-7, 9):
        lag = position - whole - k
        kernel = np.sinc(lag) * np.cos(np.pi * lag / 17.0) ** 2
        out += kernel * samples[np.clip(whole + k, 0, samples.size - 1)]
    return out


def arriving(
    sound: np.ndarray, path: Path, *, source_m: float, sensor_m: float, rate: float,
    seconds: float, image: float, kind: str,
) -> np.ndarray:  # fmt: skip
    """Return what the channels of a sensor record of a source and its surface image.

    ``sound``: at 1 m, from `LEAD_S` before the recording. Depths in m. ``image``: share
    that the surface reflects, with opposite sign. Shape (sample, channel).
    """
    emitted = np.arange(-LEAD_S, seconds + GRID_S, GRID_S)
    place = path(emitted)
    flat = np.hypot(*place)
    time = np.arange(int(seconds * rate)) / rate
    total = np.zeros((time.size, 3 if kind == "difar" else 1))
    for height, gain in ((sensor_m - source_m, 1.0), (sensor_m + source_m, -image)):
        slant = np.hypot(flat, height)
        begun = np.interp(time, emitted + slant / SOUND_MPS, emitted)
        share = gain / np.interp(begun, emitted, slant)
        heard = share * delayed(sound, (begun + LEAD_S) * rate)
        total[:, 0] += heard
        if kind == "difar":
            for axis in (0, 1):
                toward = np.interp(begun, emitted, place[axis] / slant)
                total[:, 1 + axis] += heard * toward
    return total


def ambient(rng: np.random.Generator, n: int, rate: float, kind: str) -> np.ndarray:
    """Draw the sea: unit variance, a third of it on each dipole (isotropic noise)."""
    slope = rng.uniform(-5.0, -3.0)
    parts = [coloured(rng, n, rate, slope, 10.0, 0.48 * rate)]
    if kind == "difar":
        parts += [coloured(rng, n, rate, slope, 10.0, 0.48 * rate) / np.sqrt(3.0) for _ in range(2)]
    swing_db = rng.uniform(0.0, 1.0) * wander(rng, n, rate, 20.0)
    return np.stack(parts, axis=1) * 10.0 ** (swing_db[:, None] / 20.0)


def closest(path: Path, seconds: float, depth_m: float, **told: object) -> Passage:
    """Return the closest approach of a path, ``depth_m`` above the sensor."""
    time = np.arange(0.0, seconds, 1e-3)
    place = path(time)
    least = int(np.argmin(np.hypot(*place)))
    step = path(time[least] + np.array([-0.5, 0.5]))
    east, north = step[:, 1] - step[:, 0]
    here = place[:, least]
    # the sensor is to starboard where the vessel's way turns clockwise to it
    side = "starboard" if east * -here[1] - north * -here[0] < 0 else "port"
    return Passage(
        float(time[least]), float(np.hypot(east, north)),
        float(np.hypot(np.hypot(*here), depth_m)),
        float(np.degrees(np.arctan2(east, north)) % 360.0), side, **told,
    )  # fmt: skip


def straight(
    time_s: float, speed_mps: float, range_m: float, course_deg: float, turn: float
) -> Path:
    """Return a straight path; ``turn`` is 1 where the sensor lies to starboard, else -1."""
    course = np.radians(course_deg)
    along = np.array([np.sin(course), np.cos(course)])
    starboard = np.array([along[1], -along[0]])

    def place(emitted: np.ndarray) -> np.ndarray:
        way = speed_mps * (emitted - time_s)
        return along[:, None] * way - turn * range_m * starboard[:, None]

    return place
