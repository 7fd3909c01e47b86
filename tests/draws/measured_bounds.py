"""Cramer-Rao bounds of drawn passages, with all that is unknown: see `drawn_readings`.

The information of frequencies, bearings and levels by differences of the independent
law, with depth, sound speed and compass as unknowns with priors (Van Trees, Bell and
Tian 2013, section 4.3), the size and instant of what changed, and the covariance of the
jitter that was drawn. The instant of a step is taken as known.
"""

import numpy as np

from tests.draws.measured_passages import (
    BEND,
    CLOSEST_S,
    COMPASS_STD_DEG,
    MANOEUVRES,
    SENSOR_STD_M,
    SOUND_STD_MPS,
    bent,
    received,
)

SOURCE_STD_M = 2.0


def bounds(drawn):
    """Return the bounds of the quantities, in their order; nan without bearings."""
    facts, speed = drawn.facts, float(drawn.truth[1])
    unknown = np.array(
        [0.0, speed, drawn.flat_m, facts.height_m, facts.sound_mps, drawn.change_s, *facts.change]
    )
    is_step = drawn.kind == "frequency-step"
    free = [0, 1, 2, 3, 4, *range(6, unknown.size)]
    if facts.change.size and not is_step:
        free.insert(5, 5)
    steps = np.array([1e-3, 1e-4, 1e-3, 1e-3, 1e-2, 1e-2, *[1e-7] * 2])
    if drawn.kind in MANOEUVRES:
        steps[6:] = 1e-4
    if drawn.kind == BEND:
        steps[6:] = 1e-2, 1e-4
    columns = []
    for place in free:
        step = np.zeros(unknown.size)
        step[place] = steps[place]
        ahead, behind = (_law(drawn, unknown + sign * step) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step[place]))
    partials = np.stack(columns, axis=-1)
    information = _of_lines(facts, drawn.series.time_s, partials[0])
    follow, has_bearing = np.zeros(len(free)), np.isfinite(facts.bearing_std_deg).any()
    if has_bearing:
        weight = facts.bearing_std_deg**-2.0
        own = np.rad2deg(partials[1])
        size = weight.sum()
        follow = -(weight @ own) / size
        own = own + follow
        information += (own * weight[:, None]).T @ own
    level = _law(drawn, unknown)[2]
    share = 1 / (1 + 1 / (facts.level_gain * np.exp(level)))
    own = np.column_stack([share[:, None] * partials[2], share, 1 - share])
    full = (10 / np.log(10)) ** 2 * own.T @ own
    information += full[:-2, :-2] - full[:-2, -2:] @ np.linalg.solve(full[-2:, -2:], full[-2:, :-2])
    information[3, 3] += 1 / (SOURCE_STD_M**2 + SENSOR_STD_M**2)
    information[4, 4] += SOUND_STD_MPS**-2.0
    inner = np.linalg.inv(information)
    slant = float(drawn.truth[2])
    turn = np.zeros((5, len(free)))
    turn[0, 0] = turn[1, 1] = 1.0
    turn[2, 2], turn[2, 3] = drawn.flat_m / slant, facts.height_m / slant
    turn[3] = turn[2] / speed - turn[1] * slant / speed**2
    turn[4] = follow
    variance = np.einsum("ip,pq,iq->i", turn, inner, turn)
    if has_bearing:
        variance[4] += 1 / size + COMPASS_STD_DEG**2
    else:
        variance[4] = np.nan
    return np.sqrt(variance)


def _law(drawn, unknown):
    """Return the logarithm of the ratio, the angle (rad), the spreading (ln)."""
    t0, speed, flat, height, sound, at, *change = unknown
    legs = np.array([speed, 0.0]), np.array([speed, 0.0])
    if drawn.kind in MANOEUVRES:
        legs = legs[0], np.array(change)
    time = drawn.series.time_s - t0
    when = at - t0 if drawn.kind in MANOEUVRES else CLOSEST_S + 1.0
    if drawn.kind == BEND:
        bend = (at - t0, *change)
        x, y, rate = bent(time, flat, height, sound, speed, bend)
    else:
        x, y, rate = received(time, flat, height, sound, when, legs)
    ratio = 1.0 / (1.0 + rate / sound)
    late = np.maximum(drawn.series.time_s - at, 0.0)
    if drawn.kind == "frequency-step":
        ratio = ratio * (1 + change[0] * (late > 0))
    if drawn.kind == "frequency-ramp":
        ratio = ratio * (1 + change[0] * late)
    slant = flat**2 + height**2
    # twice the angle's half: no jump behind the sensor
    return np.stack([
        np.log(ratio), 2 * np.arctan2(x, np.hypot(x, y) + y),
        np.log(slant / (x**2 + y**2 + height**2)),
    ])  # fmt: skip


def _of_lines(facts, time, partials):
    """Return the information of all lines, their rest frequencies eliminated."""
    std = facts.frequency_std
    heard = np.isfinite(std) & (std > 0)
    row, line = np.nonzero(heard)
    variance = std[row, line] ** 2
    own = np.column_stack([partials[row], np.eye(std.shape[1])[line]])
    own = own[:, own.any(axis=0)]
    covariance = np.diag(variance)
    if facts.wander:
        strength, memory_s = facts.wander
        lag = np.abs(time[row, None] - time[row])
        covariance += strength**2 * np.exp(-lag / memory_s)
    full = own.T @ np.linalg.solve(covariance, own)
    count = partials.shape[1]
    rest = full[count:, count:]
    lost = full[:count, count:] @ np.linalg.solve(rest, full[count:, :count])
    return np.asarray(full[:count, :count] - lost)
