"""What the levels of the lines add to a passage, and whether its intervals still hold.

Lines of one vessel are drawn with depths, sound speed, shaft jitter and fading, their
levels by image sources of their own: the coherent sum of the direct sound and of its
images in the surface, and in the bottom of a shallow channel, too. They fade by 3 to
8 dB with a correlation time of 2 to 60 s, each by itself, and the vessel by up to 3 dB
as a whole; a line is lost where it fades into the noise. Each recording is analysed with
the levels and without them, and the levels are asked by themselves, too.
"""

from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np

from tests.draws.measured_passages import CLOSEST_S, received
from tests.motion.passing_vessel import frames_of, lines_of_columns
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.fit.line_levels import line_levels
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import contact_data, make_blocks
from uwtrack_cli.motion.passage.readings import competing_readings as readings

LENGTH_S, SENSOR_DEPTH_M = 600, 22.0
QUANTITIES = ("time", "speed", "slant range", "range over speed", "course")


@dataclass(frozen=True)
class Kind:
    """What is drawn of a class."""

    most_lines: int = 1
    jitter: bool = False
    has_channel: bool = False
    has_image: bool = True
    has_bearing: bool = False
    fading_db: tuple = (3.0, 8.0)


KINDS = {
    "one line": Kind(),
    "one line, jitter": Kind(jitter=True),
    "one line, no image": Kind(has_image=False),
    "one line, channel": Kind(has_channel=True),
    "one line, 1 dB of fading": Kind(fading_db=(1.0, 1.0)),
    "lines, jitter, channel": Kind(4, jitter=True, has_channel=True),
    "lines with bearings, jitter": Kind(4, jitter=True, has_bearing=True),
}


@dataclass(frozen=True)
class Drawn:
    """One drawn passage and its truth, in the order of `QUANTITIES`."""

    truth: np.ndarray
    sensor: Sensor
    lines: Lines


def transmission(flat_m, depths_m, wave_number, surface, bottom, water_m):
    """Return the pressure at 1 m of distance over that received, by image sources."""
    source, sensor = depths_m
    total = np.zeros(flat_m.size, complex)
    for order in range(-4, 5) if bottom else (0,):
        for sign in (1, -1):
            path = np.hypot(flat_m, sensor - sign * source + 2 * order * water_m)
            hits = abs(order)
            of_surface = hits
            if sign < 0:
                of_surface = hits - 1 if order > 0 else hits + 1
            gain = (-surface) ** of_surface * bottom**hits
            total += gain * np.exp(1j * wave_number * path) / path
    return total


def wander(rng, count, memory_s):
    """Return noise of unit strength whose correlation falls exponentially."""
    decay = np.exp(-1.0 / memory_s)
    value = rng.normal(size=count)
    value[1:] *= np.sqrt(1 - decay**2)
    for number in range(1, count):
        value[number] += decay * value[number - 1]
    return value


def draw(name, seed):
    """Draw one passage of a class."""
    kind = KINDS[name]
    rng = np.random.default_rng([seed, list(KINDS).index(name)])
    depth = -1.0
    while depth <= 0.3:
        depth = rng.normal(3.0, 2.0)
    sensor_depth = SENSOR_DEPTH_M + 0.5 * rng.normal()
    height, sound = sensor_depth - depth, 1500.0 + 7.5 * rng.normal()
    speed = rng.uniform(2.5, 8.0)
    flat = np.exp(rng.uniform(np.log(30.0), np.log(400.0)))
    slant = float(np.hypot(flat, height))
    closest = CLOSEST_S + rng.uniform(-60.0, 60.0)
    frames = frames_of(LENGTH_S)
    time = np.asarray(frames.time_s)
    straight = np.array([speed, 0.0])
    x, y, rate = received(
        time - closest + CLOSEST_S, flat, height, sound, CLOSEST_S, (straight, straight)
    )
    course, turn = rng.uniform(0.0, 360.0), rng.choice([-1.0, 1.0])
    bearing = course - turn * 90.0 + turn * np.degrees(np.arctan2(x, y))
    ratio = 1.0 / (1.0 + rate / sound)
    if kind.jitter:
        ratio = ratio * (1.0 + 10 ** rng.uniform(-4.3, -3.0) * wander(rng, time.size, 20.0))
    surface = rng.uniform(0.5, 1.0) if kind.has_image else 0.0
    bottom, water = rng.uniform(0.3, 0.8), rng.uniform(28.0, 80.0)
    fading, memory = (rng.uniform(*kind.fading_db), np.exp(rng.uniform(*np.log([2.0, 60.0]))))
    common = rng.uniform(0.0, 3.0) * wander(rng, time.size, 60.0)
    base, count = rng.uniform(30.0, 150.0), int(rng.integers(1, kind.most_lines + 1))
    columns = []
    for number in range(1, count + 1):
        rest = number * base
        loss = transmission(
            np.hypot(x, y), (depth, sensor_depth), 2 * np.pi * rest / sound, surface,
            bottom if kind.has_channel else 0.0, water,
        )  # fmt: skip
        level = 20 * np.log10(np.abs(loss)) + fading * wander(rng, time.size, memory)
        level += common
        level += rng.uniform(18.0, 30.0) - np.median(level[abs(time - closest) < slant / speed])
        amplitude = 10 ** (level / 20)
        noise = (rng.normal(size=time.size) + 1j * rng.normal(size=time.size)) / np.sqrt(2)
        cell = np.abs(amplitude + noise) ** 2
        std = np.sqrt(1.5) / (np.pi * amplitude)
        bearing_std = np.degrees(1.0 / amplitude)
        columns.append((
            np.full(time.size, number), rest * ratio + std * rng.normal(size=time.size), std,
            (bearing + bearing_std * rng.normal(size=time.size)) % 360.0, bearing_std,
            10 * np.log10(cell), 10 * np.log10(np.maximum(cell - 1.0, 1e-3)),
        ))  # fmt: skip
    *measured, snr_db = (np.concatenate(part) for part in zip(*columns, strict=True))
    lines = lines_of_columns(frames, measured, [1] * count)
    lines = replace(lines, measured_snr_db=snr_db)
    if not kind.has_bearing:
        unknown = np.full(snr_db.size, np.nan)
        lines = replace(lines, measured_bearing_deg=unknown, measured_bearing_std_deg=unknown)
    lines = lines.take("point", np.flatnonzero(snr_db > 3.0))
    sensor = Sensor(
        id="h1", kind="difar" if kind.has_bearing else "omni", depth_m=SENSOR_DEPTH_M,
        depth_std_m=0.5, sound_speed_std_mps=7.5, compass_std_deg=2.0,
    )  # fmt: skip
    return Drawn(np.array([closest, speed, slant, slant / speed, course]), sensor, lines)


def analyse(drawn, *, has_levels=True):
    """Return errors and stated deviations of one recording; nan where none are given."""
    with patch.object(
        readings, "fit_with_line_levels",
        readings.fit_with_line_levels if has_levels else lambda fit, _: fit,
    ):  # fmt: skip
        found = find_encounters(drawn.lines, None, drawn.sensor)
    if not found.n_encounters:
        return np.full((5, 2), np.nan)
    names = ("time", "speed", "slant_range", "range_over_speed", "course")
    units = ("s", "mps", "m", "s", "deg")
    told = np.array([
        [getattr(found, f"{name}{part}_{unit}")[0] for part in ("", "_std")]
        for name, unit in zip(names, units, strict=True)
    ])  # fmt: skip
    told[:, 0] -= drawn.truth
    told[4, 0] = (told[4, 0] + 180.0) % 360.0 - 180.0
    return told


def alone(drawn):
    """Return pull and deviation of ln d/v by the levels alone, about the truth.

    The pull is the square of the deviations of time and ln d/v together, by the
    gradient at the truth; None where there are too few levels.
    """
    priors = nuisance_priors(drawn.sensor, None, None, 3.0, 2.0)
    closest, speed, slant = drawn.truth[:3]
    flat = np.sqrt(max(slant**2 - priors.height_m**2, 1.0))
    theta = np.array([[closest, np.log(flat / speed), speed, 0.0, priors.height_m]])
    blocks = make_blocks(contact_data(drawn.lines, None, (1,)))
    levels = line_levels(theta, blocks, priors.medium, None)
    if levels is None:
        return None
    _, gradient, matrix = levels.normal(theta, priors.medium, None)
    covariance = np.linalg.inv(matrix[:2, :2])
    return gradient[:2] @ covariance @ gradient[:2], np.sqrt(covariance[1, 1])
