"""Sensors in turn and a target, with bearings and frequencies by a model of its own."""

import numpy as np

from uwtrack_cli.motion.target_motion.own_ship import OwnPath, make_sensors_track
from uwtrack_cli.motion.target_motion.problem import Problem

SOUND_MPS, INTERVAL_S, ROWS = 1480.0, 8.0, 24
STATE = np.array([np.log(2300.0), 0.7, 2.5, -3.5])
REST_HZ = np.array([120.0, 310.0])
OFFSET_RAD = np.radians([2.0, 0.0, -3.0])
OFFSET_STD_RAD = np.radians([4.0, 0.0, 6.0])
BEARING_STD_RAD, FREQUENCY_STD_HZ = np.radians(1.5), np.array([0.02, 0.05])


def place(sensor, time_s):
    """Return where a sensor is, east and north in metres: on a way that bends."""
    start = np.array([[0.0, 0.0], [900.0, -300.0], [-400.0, 1200.0]])[sensor]
    drift = np.array([[2.0, 1.0], [-0.5, 1.5], [0.3, -2.0]])[sensor]
    swing = 60.0 * np.sin(time_s / (70.0 + 20.0 * sensor))
    return start[:, None] + drift[:, None] * time_s + np.stack([swing, -0.5 * swing])


class Scene:
    """Sensors in turn, each at its rows, and what they hear without the room's code."""

    def __init__(self, sensors, doppler, *, delayed=False, height_m=0.0):
        self.sensor = np.arange(ROWS) % sensors
        self.time_s = 12.0 * np.arange(ROWS) + 3.0 * (np.arange(ROWS) % 5)
        self.doppler, self.delayed, self.height_m = doppler, delayed, height_m
        self.moved = np.zeros((3, 2))  # of every sensor, m
        self.row_moved = np.zeros((3, ROWS, 2))  # own place then, before; own velocity
        self.sound_mps = SOUND_MPS
        self.change = np.zeros(3)  # of the target's velocity, m/s, and when, s

    def own(self, later_s=0.0):
        parts = [
            place(k, np.array([t + later_s]))[:, 0] + self.moved[k]
            for k, t in zip(self.sensor, self.time_s, strict=True)
        ]
        return np.array(parts) - place(self.sensor[0], self.time_s[:1])[:, 0]

    def slant_range(self, state, time_s, own):
        """Return ranges, m, and the way to where the sound left, by iteration."""
        delay = np.zeros(ROWS)
        for _ in range(40 if self.delayed else 1):
            left = time_s - delay
            there = state[:2] + left[:, None] * state[2:] - own
            later = np.maximum(left - self.change[2], 0.0)
            there = there + later[:, None] * self.change[:2]
            distance = np.sqrt((there**2).sum(1) + self.height_m**2)
            delay = distance / self.sound_mps
        return distance, there

    def hear(self, x):
        """Return bearings, rad, and frequencies, Hz, of motion, rest and offsets."""
        way = np.exp(x[0]) * np.array([np.sin(x[1]), np.cos(x[1])])
        state, h = np.concatenate([way, x[2:4]]), INTERVAL_S
        then, before, velocity = self.row_moved
        time = self.time_s - self.time_s[0]
        distance, there = self.slant_range(state, time, self.own() + then)
        if self.doppler == "interval":
            gone = self.slant_range(state, time - h, self.own(-h) + before)[0]
            rate = (distance - gone) / h
        else:
            own_mps = (self.own(h / 2) - self.own(-h / 2)) / h + velocity
            ends = [
                self.slant_range(state, time + s, self.own() + then + s * own_mps)[0]
                for s in (0.01, -0.01)
            ]
            rate = (ends[0] - ends[1]) / 0.02
        bearing = np.arctan2(there[:, 0], there[:, 1])
        if x.size > 6:
            bearing = bearing + x[6:][self.sensor]
        return bearing, x[4:6, None] * (1 - rate / self.sound_mps)

    def problem(self, *, offsets, seed=1, loss="squares", noise=1.0):
        """Return the scene with noise as the room takes it."""
        rng = np.random.default_rng(seed)
        x = self.truth(offsets=offsets)
        bearing, frequency = self.hear(x)
        z = noise * rng.standard_normal((3, ROWS))
        if loss != "squares":
            z[:, ::7] *= 5.0
        n = self.sensor.max() + 1
        data, weight = np.zeros((1, n, ROWS)), np.zeros((n, ROWS))
        rows = np.arange(ROWS)
        data[0, self.sensor, rows] = bearing + BEARING_STD_RAD * z[0]
        weight[self.sensor, rows] = 1 / BEARING_STD_RAD
        heard = frequency + FREQUENCY_STD_HZ[:, None] * z[1:]
        frequency_weight = np.repeat(1 / FREQUENCY_STD_HZ[:, None], ROWS, axis=1)
        frequency_weight[1, 4::5] = 0.0  # not heard
        wanted = (self.time_s, self.time_s - INTERVAL_S,
                  self.time_s + INTERVAL_S / 2, self.time_s - INTERVAL_S / 2)  # fmt: skip
        at = np.unique(np.concatenate(wanted))
        paths = [OwnPath(at, *place(k, at), np.full(at.size, np.nan)) for k in range(n)]
        track = make_sensors_track(paths, self.sensor, self.time_s, self.doppler, INTERVAL_S)
        return Problem(
            track, data, weight, heard[None], frequency_weight, SOUND_MPS,
            delayed=self.delayed, loss=loss, height_m=self.height_m,
            sensor=self.sensor if n > 1 else None,
            offset_std_rad=OFFSET_STD_RAD[:n] if offsets else None,
        )  # fmt: skip

    def truth(self, *, offsets):
        offset = OFFSET_RAD[: self.sensor.max() + 1] if offsets else []
        return np.concatenate([STATE, REST_HZ, offset])

    def whitened(self, problem, x):
        """Return the residuals that the misfit sums, the offsets' priors last."""
        bearing, frequency = self.hear(x)
        rows = np.arange(ROWS)
        off = bearing - problem.bearing_rad[0, self.sensor, rows]
        off = np.angle(np.exp(1j * off)) * problem.bearing_weight[self.sensor, rows]
        shift = (frequency - problem.frequency_hz[0]) * problem.frequency_weight
        known = OFFSET_STD_RAD[: x.size - 6] > 0
        prior = x[6:][known] / OFFSET_STD_RAD[: x.size - 6][known]
        return np.concatenate([off, shift.ravel(), prior])

    def slopes(self, problem, x):
        """Return the partials of the residuals by motion, rest and unknown offsets."""
        free = np.concatenate([np.ones(6, bool), OFFSET_STD_RAD[: x.size - 6] > 0])
        steps = 1e-5 * np.diag(np.maximum(np.abs(x), 0.1))[free]
        return np.stack([
            (self.whitened(problem, x + s) - self.whitened(problem, x - s)) / 2 / s.max()
            for s in steps
        ], 1)  # fmt: skip
