"""Cramer-Rao bounds of a drawn passage, from what its scenario says and nothing else.

**Method.** Fisher information of line frequencies, signal levels and bearings, frame by
frame, with every rest frequency, the level and the bearing at closest approach free;
partials by central differences of the law solved by Newton's method.

**Conventions.** Lines in frames of 0.8 / sqrt(f v^2 / (c d)) within 0.5 and 8 s, used
above E/N0 = 10; levels and bearings each second. Broadband sound of the vessels is
noise to the lines. Jitter is noise common to the lines with a known correlation time; of several
jittering lines the rest frequencies count as one unknown, which can only lower the
bound. Every gear has rest frequencies of its own, and tells nothing while it is changed.
No image, no turn: the path ends where it is straight.

**References.** Choi et al. (2014): the law of a passage; Kay (1993), section 3.9.
"""

import numpy as np

from tests.draws.passage_truth import Scene, received

SOUND_MPS = 1500.0
DIPOLE_NOISE = 1.0 / 3.0
"""Noise of a dipole over that of the omni channel: isotropic in three dimensions."""

LONGEST_FRAME_S = 8.0

STEPS = np.array([1e-3, 1e-4, 1e-4])


def bounds(scenario, number):
    """Return the least deviations of speed, range, width, time and course.

    Relative for speed, range and width; seconds and degrees for time and course.
    """
    vessel = scenario.vessels[number]
    motion = _motion(scenario, vessel)[0]
    last = min((turn.at_s for turn in vessel.turns), default=scenario.duration_s)
    information = np.zeros((4, 4))
    for line in vessel.lines:
        information += _line(scenario, vessel, line, last)
    if vessel.frequency_jitter.fraction:
        information[:3, :3] += _wandering(scenario, vessel, last)
    information += _broadband(scenario, vessel, last)
    if scenario.sensors[0].kind == "omni":
        information = information[:3, :3]
    covariance = np.linalg.inv(information)
    speed, width = motion[2], motion[1]
    along = np.array([0.0, speed, width])
    deviation = np.sqrt(np.diag(covariance))
    known = deviation.size > 3
    return {
        "speed": deviation[2] / speed,
        "range": np.sqrt(along @ covariance[:3, :3] @ along) / (speed * width),
        "width": deviation[1] / width,
        "time": deviation[0],
        "course": np.rad2deg(deviation[3]) if known else np.inf,
    }


def _motion(scenario, vessel):
    plan = vessel.closest_approach
    height = scenario.sensors[0].depth_m - vessel.source_depth_m
    slant = float(np.hypot(plan.horizontal_range_m, height))
    scene = Scene(plan.speed_mps, slant, height_m=height)
    return np.array([plan.time_s, slant / plan.speed_mps, plan.speed_mps]), scene


def _ambient(scenario, frequency_hz):
    noise = scenario.noise
    decades = np.log10(np.maximum(frequency_hz, noise.corner_hz) / noise.reference_hz)
    return 10 ** ((noise.density_db + noise.slope_db_per_decade * decades) / 10)


def _density(scenario, vessel, frequency_hz, time_s):
    """Broadband density of a vessel at the sensor, shape (frequency, time)."""
    plan = vessel.broadband
    if plan is None:
        return np.zeros((frequency_hz.size, time_s.size))
    low, high = plan.band_hz
    grid = np.linspace(low, high, 4000)
    tilt = plan.slope_db_per_decade / 10
    at_nearest = 10 ** (plan.snr_db / 10) * _ambient(scenario, grid).mean()
    at_nearest = at_nearest * frequency_hz**tilt / (grid**tilt).mean()
    inside = (frequency_hz >= low) & (frequency_hz <= high)
    motion, scene = _motion(scenario, vessel)
    distance = received(scene, time_s, motion)[2]
    near = (motion[1] * motion[2] / distance) ** 2
    return (at_nearest * inside)[:, None] * near[None, :]


def _noise(scenario, vessel, frequency_hz, time_s):
    """Ambient density and that of the other vessels."""
    total = np.repeat(_ambient(scenario, frequency_hz)[:, None], time_s.size, axis=1)
    for other in scenario.vessels:
        if other is not vessel:
            total = total + _density(scenario, other, frequency_hz, time_s)
    return total


def _partials(scenario, vessel, time_s):
    """Partials of ratio, bearing (rad) and level (dB) to time, width and speed."""
    motion, scene = _motion(scenario, vessel)

    def law(trial):
        ratio, angle, distance = received(scene, time_s, trial)
        turn = -1.0 if vessel.closest_approach.side == "port" else 1.0
        return np.stack([ratio, turn * angle, 20 * np.log10(trial[1] * trial[2] / distance)])

    columns = []
    for number, step in enumerate(STEPS * motion.clip(1.0)):
        moved = np.zeros(3)
        moved[number] = step
        columns.append((law(motion + moved) - law(motion - moved)) / (2 * step))
    return law(motion), np.stack(columns, axis=1)


def _gears(vessel, last_s):
    """Return begin, end and rate of the shaft, over that of the first gear, of each gear."""
    gears, begin, rate = [], 0.0, 1.0
    for change in vessel.gear_changes:
        gears.append((begin, min(change.at_s, last_s), rate))
        begin, rate = change.at_s + change.duration_s, change.factor
    gears.append((begin, last_s, rate))
    return [gear for gear in gears if gear[0] < gear[1]]


def _without_constant(slope, weight, constant):
    """Information (3, 3) of weighted measurements with one free constant."""
    columns = np.concatenate([slope, constant[None]])
    full = (weight * columns) @ columns.T
    if full[3, 3] == 0:
        return np.zeros((3, 3))
    return full[:3, :3] - np.outer(full[:3, 3], full[:3, 3]) / full[3, 3]


def _line(scenario, vessel, line, last_s):
    """Information of a line's frequencies, and of its bearings (4, 4)."""
    total = np.zeros((4, 4))
    for begin_s, end_s, rate in _gears(vessel, last_s):
        total += _line_in_gear(scenario, vessel, line, (begin_s, end_s), rate)
    return total


def _line_in_gear(scenario, vessel, line, span_s, rate):
    motion = _motion(scenario, vessel)[0]
    tone = line.frequency_hz * rate
    sweep = tone * motion[2] / (SOUND_MPS * motion[1])
    frame = float(np.clip(0.8 / np.sqrt(sweep), 0.5, 8.0))
    time = np.arange(span_s[0] + frame / 2, span_s[1], frame)
    total = np.zeros((4, 4))
    if not time.size:
        return total
    values, slope = _partials(scenario, vessel, time)
    ratio = _ratio(scenario, vessel, line, rate, time, values)
    usable = ratio * frame >= 10
    precision = np.where(usable, 2 * np.pi**2 * ratio * frame**3 / 3, 0.0)
    if not vessel.frequency_jitter.fraction:
        total[:3, :3] = _without_constant(tone * slope[0], precision, values[0])
    angles = np.where(usable, 2 * ratio / DIPOLE_NOISE * frame, 0.0)
    return total + _bearings(slope[1], angles)


def _ratio(scenario, vessel, line, rate, time_s, values):
    """Power of a line over the density of all noise at its place, Hz, shape (time,).

    The source is as loud as in its first gear.
    """
    first, at = np.array([line.frequency_hz]), np.array([line.frequency_hz * rate])
    noise = _noise(scenario, vessel, at, time_s) + _density(scenario, vessel, at, time_s)
    near = 10 ** (values[2] / 10)
    return 10 ** (line.cn0_db_hz / 10) * near * _ambient(scenario, first) / noise[0]


def _wandering(scenario, vessel, last_s):
    """Information of the frequencies of all lines together under jitter (3, 3)."""
    gears = _gears(vessel, last_s)
    times = [np.arange(begin + 0.5, end) for begin, end, _ in gears]
    time = np.concatenate(times)
    gear = np.repeat(np.arange(len(gears)), [one.size for one in times])
    values, slope = _partials(scenario, vessel, time)
    precision = np.zeros(time.size)
    for line in vessel.lines:
        for number, (_, _, rate) in enumerate(gears):
            ratio = _ratio(scenario, vessel, line, rate, time, values)
            usable = (ratio * LONGEST_FRAME_S >= 10) & (gear == number)
            longest = 2 * np.pi**2 * ratio * LONGEST_FRAME_S**2 / 3
            tone = line.frequency_hz * rate
            precision += np.where(usable, longest * tone**2, 0.0)
    heard = precision > 0
    lag = np.abs(time[heard, None] - time[None, heard])
    plan = vessel.frequency_jitter
    covariance = plan.fraction**2 * np.exp(-lag / plan.correlation_s)
    covariance += np.diag(1 / precision[heard])
    in_gear = gear[heard, None] == np.unique(gear[heard])
    columns = np.hstack([slope[0][:, heard].T, values[0][heard, None] * in_gear])
    full = columns.T @ np.linalg.solve(covariance, columns)
    free = full[3:, 3:]
    return full[:3, :3] - full[:3, 3:] @ np.linalg.solve(free, full[3:, :3])


def _bearings(slope, precision):
    columns = np.concatenate([slope, np.ones((1, slope.shape[1]))])
    return (precision * columns) @ columns.T


def _broadband(scenario, vessel, last_s):
    """Information of signal levels and broadband bearings, each second (4, 4)."""
    total = np.zeros((4, 4))
    if vessel.broadband is None:
        return total
    time = np.arange(0.5, last_s)
    slope = _partials(scenario, vessel, time)[1]
    low, high = vessel.broadband.band_hz
    band = np.linspace(low, high, 81)
    noise = _noise(scenario, vessel, band, time)
    rho = _density(scenario, vessel, band, time) / noise
    step = band[1] - band[0]
    level = ((rho / (1 + rho)) ** 2).sum(axis=0) * step / 4.34**2
    total[:3, :3] = _without_constant(slope[2], level, np.ones(time.size))
    dipole = rho / DIPOLE_NOISE
    angles = 2 * (dipole * (rho + dipole) / (1 + rho + dipole)).sum(axis=0) * step
    return total + _bearings(slope[1], angles)
