"""The sound of a vessel as a sensor receives it.

**Method.** A tone's phase is that of its emission time, its jitter included; its
amplitude falls with the range at emission. Broadband sound is one Gaussian process
at the source, made at four times the sample rate and read at the emission times by
cubic B-splines, whose prefilter is part of the process's filter: its delay is exact,
its spectrum to 0.01 dB (aliases below -65 dB). Direct path and surface image, and all
sensors, receive the same process, so fringes and time differences are right.

**Conventions.** Pressure in uPa. The surface image has the sign of a soft surface.

**References.** M. Unser, Splines: a perfect fit for signal and image processing, IEEE
Signal Processing Magazine 16(6), 1999, eqs. (8)-(10) (cubic B-spline, prefilter).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.approach import direct_path
from uwtrack_cli.simulate.delay import Path
from uwtrack_cli.simulate.frequency_jitter import (
    JitterSeries,
    SpeedCourse,
    draw_jitter,
    gear_course,
)
from uwtrack_cli.simulate.noise import TILE, NoiseGenerator, shaping_filter
from uwtrack_cli.simulate.scenario import Scenario, SeaBed, SensorPlan
from uwtrack_cli.simulate.source_levels import BroadbandSource, Tone, broadband_source, tones
from uwtrack_cli.simulate.trajectories import Array, array_place
from uwtrack_cli.simulate.vessels import RAMP_S, Cavitation, Vessel

MULTIPLE = 4
"""Rate of the broadband process over the sample rate."""


class Arrival(NamedTuple):
    """Sound that arrives along one path during a tile."""

    pressure_upa: Array
    """Pressure, uPa."""
    east_cosine: Array
    """Cosine of the direction to the source with east."""
    north_cosine: Array
    """Cosine of the direction to the source with north."""


@dataclass
class SourceSound:
    """Broadband sound at its source, readable at any time near the last one."""

    noise: NoiseGenerator
    """The Gaussian process at the source."""
    start_s: float
    """Time of its first sample, s."""
    rate_hz: float
    """Its sample rate, Hz."""
    tiles: dict[int, Array] = field(default_factory=dict)
    """Tiles kept for the next stretch, by number."""

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
    """All sound of one vessel at one sensor."""

    paths: tuple[tuple[float, Path], ...]
    """Amplitude and path of the direct sound and of the images in surface and bottom."""
    sample_rate_hz: float
    """Sample rate of the recording, Hz."""
    exponent: float
    """Power of the range with which the amplitude falls."""
    tones: tuple[Tone, ...]
    """Spectral lines at the source."""
    phases: Array
    """Phase of each line at time zero, cycles."""
    jitter: JitterSeries | None
    """Variation of all line frequencies; None is none."""
    gears: SpeedCourse | None
    """Course of the shaft speed through its gears; None is one gear."""
    broadband: SourceSound | None
    """Broadband sound at the source; None is none."""
    cavitation: Cavitation | None
    """Modulation of the broadband sound; None is none."""
    sounding_s: tuple[float, float] | None
    """Times between which the vessel sounds, s; None is always."""

    def arrivals(self, tile: int) -> Iterator[Arrival]:
        """Yield what arrives along each path during a tile."""
        first = tile * TILE
        received_s = np.arange(first, first + TILE) / self.sample_rate_hz
        for factor, path in self.paths:
            if self._is_silent(path, received_s[[0, -1]]):
                if self.broadband is not None:
                    self.broadband.tiles = {}
                continue
            delay, east, north = path.along(first, TILE, self.sample_rate_hz)
            distance = delay * path.sound_speed_mps
            spread = 1.0 / distance if self.exponent == 1.0 else distance**-self.exponent
            yield Arrival(factor * spread * self._emitted(received_s - delay), east, north)

    def _is_silent(self, path: Path, ends_s: Array) -> bool:
        if self.sounding_s is None:
            return False
        emitted_s = ends_s - path.solve(ends_s).delay_s
        return bool(emitted_s[1] < self.sounding_s[0] or emitted_s[0] > self.sounding_s[1])

    def _emitted(self, time_s: Array) -> Array:
        total = np.zeros(time_s.size)
        ticks = time_s
        for variation in (self.jitter, self.gears):
            if variation is not None:
                ticks = ticks + variation.excess_s(time_s)
        for tone, phase in zip(self.tones, self.phases, strict=True):
            cycles = tone.frequency_hz * ticks + phase
            cycles -= np.floor(cycles)
            angle = (2.0 * np.pi * cycles).astype(np.float32)
            total += tone.amplitude_upa * np.cos(angle)
        if self.broadband is not None:
            hiss = self.broadband.at(time_s)
            if self.cavitation is not None:
                hiss *= blade_envelope(self.cavitation, ticks)
            total += hiss
        if self.sounding_s is not None:
            total *= _ramp(time_s, self.sounding_s)
        return total


def images(scenario: Scenario, vessel: Vessel) -> list[tuple[float, float]]:
    """Return share of amplitude and depth, m, of a vessel and of its images.

    Those of a channel between surface and bottom: Brekhovskikh and Lysanov, Fundamentals
    of Ocean Acoustics, section 5.1.
    """
    depth_m, surface = vessel.source_depth_m, -vessel.surface_image
    found = [(1.0, depth_m), (surface, -depth_m)]
    if scenario.sea_bed is not None:
        found += _bottom_images(scenario.sea_bed, depth_m, surface)
    return [one for one in found if one[0] != 0.0]


def _bottom_images(bed: SeaBed, depth_m: float, surface: float) -> list[tuple[float, float]]:
    """Return share and depth, m, of the images that the bottom takes part in."""
    found = []
    for order in range(1, bed.orders + 1):
        share = 10.0 ** (-order * bed.loss_db / 20.0) * surface ** (order - 1)
        down_m = 2.0 * order * bed.depth_m
        found += [
            (share, down_m - depth_m), (share * surface, down_m + depth_m),
            (share * surface, depth_m - down_m), (share * surface**2, -depth_m - down_m),
        ]  # fmt: skip
    return found


def vessel_sound(scenario: Scenario, number: int, plan: SensorPlan) -> VesselSound:
    """Prepare the sound of the vessel with the given number at a sensor."""
    vessel = scenario.vessels[number]
    path = direct_path(scenario, vessel, plan)
    paths = [
        (share, replace(path, source_depth_m=depth_m))
        for share, depth_m in images(scenario, vessel)
    ]
    lines = tones(scenario, vessel)
    speed_up = max((c.factor * (1.0 + c.revving) for c in vessel.gear_changes), default=1)
    _check_lines(lines, path, scenario, max(float(speed_up), 1.0))
    start_s = first_emission_s(scenario, vessel)
    phases = np.random.default_rng([scenario.seed, 200, number]).random(len(lines))
    return VesselSound(
        paths=tuple(paths),
        sample_rate_hz=scenario.sample_rate_hz,
        exponent=vessel.spreading_db_per_decade / 20.0,
        tones=lines,
        phases=phases,
        jitter=vessel_jitter(scenario, number, start_s),
        gears=gear_course(vessel.gear_changes),
        cavitation=None if vessel.broadband is None else vessel.broadband.cavitation,
        broadband=_source_sound(scenario, number, start_s, broadband_source(scenario, vessel)),
        sounding_s=vessel.sounding_s,
    )


def sound_at_elements(sound: VesselSound, plan: SensorPlan) -> list[VesselSound]:
    """Return the sound of a vessel at every hydrophone of an array.

    All hear one source: its lines, their jitter and one broadband process.
    """
    return [
        replace(
            sound,
            paths=tuple(
                (
                    factor,
                    replace(
                        path,
                        receiver=array_place(plan, place),
                        receiver_depth_m=path.receiver_depth_m - place[2],
                    ),
                )
                for factor, path in sound.paths
            ),
        )
        for place in plan.element_places
    ]


def blade_envelope(plan: Cavitation, time_s: Array) -> Array:
    """Return the amplitude of blade-modulated cavitation, of unit mean square.

    ``plan``: blade rate, depth and harmonics. ``time_s``: times in s, stretched by the
    variation of the shaft speed.
    """
    turns = plan.blade_rate_hz * time_s
    envelope = np.ones(time_s.size)
    power = 1.0
    for k in range(1, plan.harmonics + 1):
        envelope += plan.depth / k * np.cos(2.0 * np.pi * (k * turns % 1.0))
        power += 0.5 * (plan.depth / k) ** 2
    if plan.shaft_depth > 0.0:
        shaft = plan.blade_rate_hz / plan.blades * time_s
        part = plan.shaft_depth * np.cos(2.0 * np.pi * (shaft % 1.0))
        if plan.blades > 1:
            envelope += part
            power += 0.5 * plan.shaft_depth**2
        else:  # the shaft rate is the blade rate: amplitudes add
            envelope += part
            power += plan.shaft_depth * (plan.depth + 0.5 * plan.shaft_depth)
    return np.asarray(envelope / np.sqrt(power))


def _ramp(time_s: Array, sounding_s: tuple[float, float]) -> Array:
    inside = np.minimum(time_s - sounding_s[0], sounding_s[1] - time_s)
    return np.asarray(np.sin(0.5 * np.pi * np.clip(inside / RAMP_S, 0.0, 1.0)) ** 2)


def vessel_jitter(scenario: Scenario, number: int, start_s: float) -> JitterSeries | None:
    """Return the jitter of a vessel's lines, or None if they are steady."""
    plan = scenario.vessels[number].frequency_jitter
    if plan.fraction == 0.0:
        return None
    seed = (scenario.seed, 201, number)
    last_s = scenario.duration_s + TILE / scenario.sample_rate_hz
    return draw_jitter(seed, plan.fraction, plan.correlation_s, start_s, last_s)


def first_emission_s(scenario: Scenario, vessel: Vessel) -> float:
    """Return a time before any sound of a vessel that a sensor can receive, s."""
    start = np.zeros(1)
    paths = [direct_path(scenario, vessel, plan) for plan in scenario.sensors]
    delays = [
        replace(path, source_depth_m=depth_m).solve(start).delay_s[0]
        for path in paths
        for _, depth_m in images(scenario, vessel)
    ]
    farther_m = max(
        (
            float(np.linalg.norm(place))
            for plan in scenario.sensors
            for place in plan.element_places
        ),
        default=0.0,
    )
    return -float(np.ceil(max(delays) + farther_m / scenario.sound_speed_mps)) - 1.0


def _source_sound(
    scenario: Scenario, number: int, start_s: float, plan: BroadbandSource | None
) -> SourceSound | None:
    if plan is None:
        return None
    rate = scenario.sample_rate_hz

    def prefiltered(frequency_hz: Array) -> Array:
        turn = 2.0 * np.pi * frequency_hz / (MULTIPLE * rate)
        return np.asarray(plan.density(frequency_hz) * (3.0 / (2.0 + np.cos(turn))) ** 2)

    spectrum = shaping_filter(prefiltered, rate, MULTIPLE)
    noise = NoiseGenerator(scenario.seed, (202, number), spectrum, MULTIPLE)
    return SourceSound(noise, start_s, MULTIPLE * rate)


def _check_lines(lines: tuple[Tone, ...], path: Path, scenario: Scenario, speed_up: float) -> None:
    mach = (path.source.top_speed_mps + path.receiver.top_speed_mps) / (scenario.sound_speed_mps)
    if mach > 0.5:
        raise OptionError(f"speeds must stay below half the sound speed, got {mach:.2f} of it.")
    limit = 0.49 * scenario.sample_rate_hz * (1.0 - mach)
    worst = speed_up * max((tone.frequency_hz for tone in lines), default=0.0)
    if worst > limit:
        raise OptionError(f"line frequencies must stay below {limit:.6g} Hz, got {worst:g}.")
