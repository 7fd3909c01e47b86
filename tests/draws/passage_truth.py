"""Simulated measurements of a passage and their Cramer-Rao bound, made independently.

The law is solved by Newton's method on the time of emission, not by the closed form
of the package; the bound comes from central differences of that law.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.motion.passage.model.measurements import PassageData


@dataclass(frozen=True)
class Scene:
    speed_mps: float = 6.0
    range_m: float = 250.0
    carrier_to_noise_db: float = 25.0
    rest_hz: tuple[float, ...] = (120.0,)
    level_std_db: float = 1.0
    bearing_std_deg: float = 3.0
    closest_s: float = 300.0
    bearing_deg: float = 40.0
    turn: int = -1
    length_s: float = 600.0
    height_m: float = 19.0
    sound_speed_mps: float = 1500.0
    level_snr_db: float = 10.0
    jitter: float = 0.0
    jitter_time_s: float = 20.0


ROWS = (
    Scene(2.57, 200.0, 25.0),
    Scene(6.0, 250.0, 25.0),
    Scene(6.0, 250.0, 30.0, (63.0, 126.0, 189.0, 310.0)),
    Scene(7.72, 100.0, 30.0),
    Scene(7.72, 500.0, 25.0),
    Scene(5.14, 300.0, 20.0),
    Scene(6.0, 250.0, 25.0, level_std_db=2.0, bearing_std_deg=6.0),
)
"""The seven rows of section 3.3."""


def received(scene, time_s, motion):
    """Return frequency ratio, relative bearing (rad) and range by Newton's method."""
    closest, range_over_speed, speed = motion[:3]
    slant = range_over_speed * speed
    c = scene.sound_speed_mps
    emitted = time_s - closest - slant / c
    for _ in range(30):
        distance = np.sqrt(slant**2 + (speed * emitted) ** 2)
        error = emitted + distance / c - (time_s - closest)
        emitted = emitted - error / (1 + speed**2 * emitted / (c * distance))
    distance = np.sqrt(slant**2 + (speed * emitted) ** 2)
    ratio = 1 / (1 + speed**2 * emitted / (c * distance))
    flat = np.sqrt(slant**2 - scene.height_m**2)
    return ratio, np.arctan2(speed * emitted, flat), distance


def grids(scene):
    """Return times of line frames and of one-second frames, and frame length."""
    tone = max(scene.rest_hz)
    sweep = tone * scene.speed_mps**2 / (scene.sound_speed_mps * scene.range_m)
    frame = float(np.clip(0.8 / np.sqrt(sweep), 0.5, 8.0))
    lines = np.arange(frame / 2, scene.length_s, frame)
    return lines, np.arange(0.5, scene.length_s), frame


def deviations(scene):
    """Return the standard deviations of frequencies and bearings."""
    motion = true_motion(scene)
    lines, seconds, frame = grids(scene)
    far = received(scene, lines, motion)[2] / scene.range_m
    density = 10 ** (scene.carrier_to_noise_db / 10) / far**2
    sigma = np.sqrt(3 / (2 * np.pi**2 * density * frame**3))
    sigma = np.where(density * frame >= 10, sigma, np.nan)
    wide = received(scene, seconds, motion)[2] / scene.range_m
    return np.tile(sigma, (len(scene.rest_hz), 1)), scene.bearing_std_deg * wide


def true_motion(scene):
    return np.array(
        [
            scene.closest_s,
            scene.range_m / scene.speed_mps,
            scene.speed_mps,
            np.deg2rad(scene.bearing_deg),
        ]
    )


def predict(scene, parameters):
    """Return frequencies, bearings (rad) and levels for motion, rests, level, floor."""
    lines, seconds, _ = grids(scene)
    n = len(scene.rest_hz)
    motion, rest, (level, floor) = (parameters[:4], parameters[4 : 4 + n], parameters[4 + n :])
    ratio = received(scene, lines, motion)[0]
    _, angle, distance = received(scene, seconds, motion)
    slant = motion[1] * motion[2]
    power = 10 ** (level / 10) * (slant / distance) ** 2 + 10 ** (floor / 10)
    return (rest[:, None] * ratio, motion[3] + scene.turn * angle, 10 * np.log10(power))


def true_parameters(scene):
    return np.concatenate([true_motion(scene), np.array(scene.rest_hz), [scene.level_snr_db, 0.0]])


def bound(scene):
    """Return the Cramer-Rao covariance of (t0, d/v, v, bearing in degrees)."""
    truth = true_parameters(scene)
    sigma_f, sigma_b = deviations(scene)
    weights = (1 / sigma_f, 1 / np.deg2rad(sigma_b), 1 / scene.level_std_db)
    columns = []
    for number, value in enumerate(truth):
        step = np.zeros(truth.size)
        step[number] = 1e-5 * max(abs(value), 1.0)
        plus, minus = predict(scene, truth + step), predict(scene, truth - step)
        slope = [
            np.nan_to_num(w * (p - m) / (2 * step[number])).ravel()
            for w, p, m in zip(weights, plus, minus, strict=True)
        ]
        columns.append(np.concatenate(slope))
    jacobian = np.stack(columns, axis=1)
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:4, :4]
    unit = np.array([1.0, 1.0, 1.0, np.rad2deg(1.0)])
    return covariance * unit[:, None] * unit[None, :]


def measure(scene, rng, runs):
    """Return noisy measurements of a batch on the union of both time grids."""
    lines, seconds, _ = grids(scene)
    frequency, bearing, level = predict(scene, true_parameters(scene))
    sigma_f, sigma_b = deviations(scene)
    time = np.unique(np.concatenate([lines, seconds]))
    at, on = np.searchsorted(time, lines), np.searchsorted(time, seconds)

    def spread(values, place, rows):
        full = np.full((runs, rows, time.size), np.nan)
        full[:, :, place] = values
        return full

    n = len(scene.rest_hz)
    shift = _wander(scene, rng, runs, lines)[:, None, :]
    tones = frequency * (1 + shift) + sigma_f * rng.normal(size=(runs, n, lines.size))
    angles = np.rad2deg(bearing) + sigma_b * rng.normal(size=(runs, 1, seconds.size))
    levels = level + scene.level_std_db * rng.normal(size=(runs, 1, seconds.size))
    return PassageData(
        time,
        spread(tones, at, n),
        spread(np.broadcast_to(sigma_f, tones.shape), at, n),
        spread(angles % 360, on, 1),
        spread(np.broadcast_to(sigma_b, angles.shape), on, 1),
        spread(levels, on, 1),
        spread(scene.level_std_db, on, 1),
    )


def _wander(scene, rng, runs, time_s):
    if scene.jitter == 0:
        return np.zeros((runs, time_s.size))
    decay = np.exp(-np.diff(time_s) / scene.jitter_time_s)
    value = np.zeros((runs, time_s.size))
    value[:, 0] = rng.normal(size=runs)
    for number, factor in enumerate(decay, 1):
        value[:, number] = factor * value[:, number - 1] + np.sqrt(1 - factor**2) * rng.normal(
            size=runs
        )
    return scene.jitter * value
