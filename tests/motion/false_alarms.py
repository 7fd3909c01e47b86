"""How often noise is taken for a passage, and how weak a passage is found."""

import warnings
from dataclasses import replace

import numpy as np
from scipy.stats import beta

from tests.draws.passage_truth import Scene
from tests.motion.passing_vessel import levels_of_scene, lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import UwtrackWarning
from uwtrack_cli.motion.cpa import find_encounters

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0)
STATED = (0.1, 0.03, 0.01, 0.001)
LENGTH = 300.0


def gauss_markov(rng, time_s, correlation_time_s):
    """Unit noise with an exponential correlation time, at one-second steps."""
    decay = np.exp(-1.0 / correlation_time_s)
    steps = np.sqrt(1 - decay**2) * rng.normal(size=time_s.size)
    steps[0] = rng.normal()
    for k in range(1, steps.size):
        steps[k] += decay * steps[k - 1]
    return steps


def _path(rng, time_s):
    """Fractional jitter of a machine: none, a random walk, or one that returns."""
    kind = rng.integers(3)
    if kind == 0:
        return np.zeros(time_s.size)
    fraction = 10 ** rng.uniform(-5, -3)
    if kind == 1:
        walk = np.cumsum(rng.normal(size=time_s.size))
        return fraction * walk / np.sqrt(time_s.size)
    return fraction * gauss_markov(rng, time_s, 10 ** rng.uniform(0.7, 2.5))


def still_recording(seed):
    """Draw the lines and levels of machines that stay where they are, in noise."""
    rng = np.random.default_rng(seed)
    scenes = [
        Scene(
            speed_mps=1e-6,
            rest_hz=tuple(rng.uniform(30, 300) * np.arange(1, rng.integers(2, 6))),
            length_s=LENGTH,
            closest_s=LENGTH / 2,
            bearing_deg=rng.uniform(0, 360),
        )
        for _ in range(rng.integers(1, 3))
    ]
    lines = lines_of_scenes(scenes, rng)
    time = np.unique(lines.time_s)
    contact = lines.line_contact[lines.line - 1]
    frequency, bearing = lines.measured_frequency_hz, lines.measured_bearing_deg
    for number in np.unique(contact):
        own = contact == number
        path = np.interp(lines.time_s, time, _path(rng, time))
        frequency = np.where(own, frequency * (1 + path), frequency)
        if rng.random() < 0.5:
            around = 360 * rng.random(bearing.size)
            bearing = np.where(own, around, bearing)
    lines = replace(lines, measured_frequency_hz=frequency, measured_bearing_deg=bearing)
    levels = levels_of_scene(scenes[0], rng, snr_db=-60.0)
    drift = 0.0
    if rng.random() < 0.7:
        drift = 10 ** rng.uniform(-0.5, 0.6) * gauss_markov(rng, time, 10 ** rng.uniform(0.7, 2.5))
    around = 360 * rng.random(levels.bearing_deg.size)
    return lines, replace(
        levels,
        excess_db=levels.excess_db + drift,
        level_db=levels.level_db + drift,
        bearing_deg=around,
        bearing_std_deg=around * 0 + 60,
    )


def claims(lines, levels, sensor, stated):
    """Tell at which stated probabilities a closest approach is claimed.

    What is not claimed at one probability is claimed at no smaller one.
    """
    found = dict.fromkeys(stated, False)
    for probability in sorted(stated, reverse=True):
        with warnings.catch_warnings():  # that the option is taken out
            warnings.simplefilter("ignore", UwtrackWarning)
            rows = find_encounters(lines, levels, sensor, false_alarm_probability=probability)
        found[probability] = bool(np.isfinite(rows.time_s).any())
        if not found[probability]:
            break
    return [found[probability] for probability in stated]


def hump_claims(seed, snr_db, stated):
    """Decide on the levels of a passage alone, measured with 1 dB of noise."""
    rng = np.random.default_rng([seed, 3])
    scene = Scene(length_s=LENGTH, closest_s=LENGTH / 2)
    levels = levels_of_scene(scene, rng, snr_db=snr_db, has_bearing=False)
    return claims(None, levels, DIFAR, stated)


def interval(count, runs):
    """Return the interval of 95 % of a probability (Clopper and Pearson 1934)."""
    low = beta.ppf(0.025, count, runs - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, runs - count) if count < runs else 1.0
    return float(low), float(high)
