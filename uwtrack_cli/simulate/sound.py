"""The sound of a vessel as a sensor receives it.

**Method.** A tone's phase is that of its emission time, its wander included; its
amplitude falls with the range at emission. Broadband sound is one Gaussian process
at the source, made at four times the sample rate and read at the emission times by
cubic B-splines, whose prefilter is part of the process's filter: its delay is exact,
its spectrum to 0.01 dB (aliases below -65 dB). Direct way and surface image, and all
sensors, hear the same process, so fringes and time differences are right.

**Conventions.** Pressure in uPa. The surface image has the sign of a soft surface.

**References.** M. Unser, Splines: a perfect fit for signal and image processing, IEEE
Signal Processing Magazine 16(6), 1999, eqs. (8)-(10) (cubic B-spline, prefilter).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.approach import direct_path
from uwtrack_cli.simulate.delay import Path
from uwtrack_cli.simulate.levels import Hiss, Tone, hiss, tones
from uwtrack_cli.simulate.motion import Array
from uwtrack_cli.simulate.noise import TILE, ColouredNoise, shaping_filter
from uwtrack_cli.simulate.scenario import Scenario, SensorPlan
from uwtrack_cli.simulate.sources import RAMP_S, Vessel
from uwtrack_cli.simulate.wander import Drift, drift

MULTIPLE = 4
"""Rate of the broadband process over the sample rate."""

Arrival = tuple[Array, Array, Array]
"""Pressure (uPa) and the two cosines towards the source, for the samples of a tile."""


@dataclass
class SourceSound:
    """Broadband sound at its source, readable at any time near the last one."""

    noise: ColouredNoise
    start_s: float
    rate_hz: float
    tiles: dict[int, Array] = field(default_factory=dict)

    def at(self, time_s: Array) -> Array:
        """Return the pressure at 1 m at emission times, uPa."""
        place = (time_s - self.start_s) * self.rate_hz
        whole = np.floor(place)
        first = int(whole.min()) - 1
        samples = self._stretch(first, int(whole.max()) + 3)
        index = whole.astype(np.int64) - first
        x = place - whole
        y = 1.0 - x
        return np.asarray(
            samples[index - 1] * (y * y * y / 6.0)
            + samples[index] * (2.0 / 3.0 - x * x * (1.0 - 0.5 * x))
            + samples[index + 1] * (2.0 / 3.0 - y * y * (1.0 - 0.5 * y))
            + samples[index + 2] * (x * x * x / 6.0)
        )

    def _stretch(self, first: int, stop: int) -> Array:
        size = TILE * MULTIPLE
        numbers = range(first // size, (stop - 1) // size + 1)
        self.tiles = {
            n: self.tiles[n] if n in self.tiles else self.noise.tile(n)
            for n in range(numbers[0] - (numbers[0] - 1 in self.tiles), numbers[-1] + 1)
        }
        joined = np.concatenate([self.tiles[n] for n in numbers])
        return joined[first - numbers[0] * size : stop - numbers[0] * size]


@dataclass
class VesselSound:
    """Everything one sensor hears of one vessel."""

    paths: tuple[tuple[float, Path], ...]
    sample_rate_hz: float
    exponent: float
    tones: tuple[Tone, ...]
    phases: Array
    wander: Drift | None
    broadband: SourceSound | None
    sounding_s: tuple[float, float] | None

    def arrivals(self, tile: int) -> Iterator[Arrival]:
        """Yield what comes along each way during a tile."""
        first = tile * TILE
        heard_s = np.arange(first, first + TILE) / self.sample_rate_hz
        for factor, path in self.paths:
            if self._is_silent(path, heard_s[[0, -1]]):
                if self.broadband is not None:
                    self.broadband.tiles = {}
                continue
            delay, east, north = path.along(first, TILE, self.sample_rate_hz)
            distance = delay * path.sound_speed_mps
            spread = (
                1.0 / distance if self.exponent == 1.0 else distance**-self.exponent
            )
            yield factor * spread * self._emitted(heard_s - delay), east, north

    def _is_silent(self, path: Path, ends_s: Array) -> bool:
        if self.sounding_s is None:
            return False
        emitted_s = ends_s - path.solve(ends_s)[0]
        return bool(
            emitted_s[1] < self.sounding_s[0] or emitted_s[0] > self.sounding_s[1]
        )

    def _emitted(self, time_s: Array) -> Array:
        total = np.zeros(time_s.size)
        ticks = time_s
        if self.wander is not None:
            ticks = time_s + self.wander.excess_s(time_s)
        for tone, phase in zip(self.tones, self.phases, strict=True):
            cycles = tone.frequency_hz * ticks + phase
            cycles -= np.floor(cycles)
            angle = (2.0 * np.pi * cycles).astype(np.float32)
            total += tone.amplitude_upa * np.cos(angle)
        if self.broadband is not None:
            total += self.broadband.at(time_s)
        if self.sounding_s is not None:
            total *= _ramp(time_s, self.sounding_s)
        return total


def vessel_sound(scenario: Scenario, number: int, plan: SensorPlan) -> VesselSound:
    """Prepare what a sensor hears of the vessel with the given number."""
    vessel = scenario.vessels[number]
    path = direct_path(scenario, vessel, plan)
    paths = [(1.0, path)]
    if vessel.surface_image > 0.0:
        image = replace(path, source_depth_m=-vessel.source_depth_m)
        paths.append((-vessel.surface_image, image))
    lines = tones(scenario, vessel)
    _check_lines(lines, path, scenario)
    start_s = first_emission_s(scenario, vessel)
    phases = np.random.default_rng([scenario.seed, 200, number]).random(len(lines))
    return VesselSound(
        paths=tuple(paths),
        sample_rate_hz=scenario.sample_rate_hz,
        exponent=vessel.spreading_db_per_decade / 20.0,
        tones=lines,
        phases=phases,
        wander=vessel_wander(scenario, number, start_s),
        broadband=_source_sound(scenario, number, start_s, hiss(scenario, vessel)),
        sounding_s=vessel.sounding_s,
    )


def _ramp(time_s: Array, sounding_s: tuple[float, float]) -> Array:
    inside = np.minimum(time_s - sounding_s[0], sounding_s[1] - time_s)
    return np.asarray(np.sin(0.5 * np.pi * np.clip(inside / RAMP_S, 0.0, 1.0)) ** 2)


def vessel_wander(scenario: Scenario, number: int, start_s: float) -> Drift | None:
    """Return the wander of a vessel's lines, or None if they are steady."""
    plan = scenario.vessels[number].wander
    if plan.fraction == 0.0:
        return None
    seed = (scenario.seed, 201, number)
    last_s = scenario.duration_s + TILE / scenario.sample_rate_hz
    return drift(seed, plan.fraction, plan.correlation_s, start_s, last_s)


def first_emission_s(scenario: Scenario, vessel: Vessel) -> float:
    """Return a time before any sound of a vessel that a sensor can hear, s."""
    start = np.zeros(1)
    delays = [
        direct_path(scenario, replace(vessel, source_depth_m=sign * depth), plan).solve(
            start
        )[0][0]
        for plan in scenario.sensors
        for sign, depth in ((1.0, vessel.source_depth_m), (-1.0, vessel.source_depth_m))
    ]
    return -float(np.ceil(max(delays))) - 1.0


def _source_sound(
    scenario: Scenario, number: int, start_s: float, plan: Hiss | None
) -> SourceSound | None:
    if plan is None:
        return None
    rate = scenario.sample_rate_hz

    def prefiltered(frequency_hz: Array) -> Array:
        turn = 2.0 * np.pi * frequency_hz / (MULTIPLE * rate)
        return np.asarray(
            plan.density(frequency_hz) * (3.0 / (2.0 + np.cos(turn))) ** 2
        )

    spectrum = shaping_filter(prefiltered, rate, MULTIPLE)
    noise = ColouredNoise(scenario.seed, (202, number), spectrum, MULTIPLE)
    return SourceSound(noise, start_s, MULTIPLE * rate)


def _check_lines(lines: tuple[Tone, ...], path: Path, scenario: Scenario) -> None:
    mach = (path.source.top_speed_mps + path.receiver.top_speed_mps) / (
        scenario.sound_speed_mps
    )
    if mach > 0.5:
        msg = f"speeds must stay below half the sound speed, got {mach:.2f} of it."
        raise OptionError(msg)
    limit = 0.49 * scenario.sample_rate_hz * (1.0 - mach)
    worst = max((tone.frequency_hz for tone in lines), default=0.0)
    if worst > limit:
        msg = f"line frequencies must stay below {limit:.6g} Hz, got {worst:g}."
        raise OptionError(msg)
