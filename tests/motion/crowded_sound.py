"""Broadband levels and bearings of several vessels, whose powers add."""

from dataclasses import replace

import numpy as np

from tests.draws.passage_truth import Scene, received
from tests.motion.passing_vessel import frames_of, levels_of_scene

ISOTROPIC_SHARE = 0.05
"""Noise of either component of the intensity, as a share of the power."""


def drawn_scene(rng, time_s):
    """Return a vessel that passes about the given time."""
    return Scene(
        closest_s=time_s,
        range_m=rng.uniform(80, 300),
        speed_mps=rng.uniform(3.0, 7.7),
        bearing_deg=rng.uniform(0, 360),
        turn=int(rng.choice([-1, 1])),
    )


def arrival_s(scene):
    """Return when the sound of the closest approach arrives."""
    return scene.closest_s + scene.range_m / 1500.0


def crowded_levels(scenes, snrs_db, rng, *, has_bearing=True, spreading_db=20.0, drift_db=0.0):
    """Return levels with 0.5 dB of noise, above a background that may drift."""
    time = np.asarray(frames_of(600.0).time_s)
    total = 10 ** (drift_db / 10 * drift(rng, time))
    vector = np.zeros(time.size, complex)
    for scene, snr_db in zip(scenes, snrs_db, strict=True):
        motion = (scene.closest_s, scene.range_m / scene.speed_mps, scene.speed_mps)
        _, angle, distance = received(scene, time, motion)
        near = (scene.range_m / distance) ** (spreading_db / 10)
        power = 10 ** (snr_db / 10) * near
        bearing = np.deg2rad(scene.bearing_deg) + scene.turn * angle
        total = total + power
        vector = vector + power * np.exp(1j * bearing)
    spread = ISOTROPIC_SHARE * total
    noise = rng.normal(size=(2, time.size))
    vector = vector + spread * (noise[0] + 1j * noise[1])
    excess = 10 * np.log10(total) + 0.5 * rng.normal(size=time.size)
    unknown = np.full(time.size, np.nan)
    std = np.rad2deg(np.minimum(spread / np.abs(vector), 1.8))
    return replace(
        levels_of_scene(Scene(), rng),
        level_db=excess + 100.0,
        excess_db=excess,
        excess_std_db=np.full(time.size, 0.5),
        bearing_deg=np.rad2deg(np.angle(vector)) % 360 if has_bearing else unknown,
        bearing_std_deg=std if has_bearing else unknown,
    )


def drift(rng, time_s, correlation_time_s=60.0):
    """Return coloured noise of unit variance."""
    step = np.exp(-(time_s[1] - time_s[0]) / correlation_time_s)
    path = rng.normal(size=time_s.size)
    for k in range(1, time_s.size):
        path[k] = step * path[k - 1] + np.sqrt(1 - step**2) * path[k]
    return path
