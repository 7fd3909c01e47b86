"""The sound of disturbances at a sensor, tile by tile.

**Method.** Weather is coloured noise under an envelope of power; snaps and knocks are
short waveforms at Poisson times from random directions; a machine is a sum of
harmonics whose phase is the integral of its frequency. The ambient level follows a
gain that is common to all sensors. Band edges are Butterworth filters with a state
that is carried from tile to tile.

Hum is a sum of harmonics of the mains whose frequency may vary; every
channel has its own gains and phases, since it is not sound. A click is a short burst
that decays; it comes from a direction of its own, so that a vector sensor measures a bearing.

**Conventions.** Tiles are asked for in sequence. Pressure in uPa; a dipole has a third
of the power of isotropic noise and the cosine of the direction of anything else.

Levels in dB re 1 uPa: root mean square for hum, peak for clicks.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.disturbances import (
    Gusts,
    Knocks,
    LevelDrift,
    Machine,
    Rain,
    Shrimp,
    Swell,
)
from uwtrack_cli.simulate.frequency_jitter import JitterSeries, SpeedCourse, draw_jitter
from uwtrack_cli.simulate.noise import TILE, Density, NoiseGenerator, shaping_filter
from uwtrack_cli.simulate.scenario import Clicks, Hum, Noise, Recorder, Scenario
from uwtrack_cli.simulate.trajectories import Array

SWITCH_S = 0.3
"""Time in which a machine runs up or down when it is switched, s."""
STEP_S = 2.0
"""Time in which a machine steps to another speed, s."""
SNAP_S = 2e-3
"""Length of a snap of shrimp, s."""


def tile_times_s(number: int, sample_rate_hz: float) -> Array:
    """Return the times of the samples of a tile, s."""
    return np.arange(number * TILE, (number + 1) * TILE) / sample_rate_hz


def turn_dipoles(sound: Array, axes_rad: Array) -> Array:
    """Return omni, east and north as received by dipoles that are turned clockwise."""
    cosine, sine = np.cos(axes_rad), np.sin(axes_rad)
    omni, east, north = sound.T
    return np.stack([omni, east * cosine - north * sine, east * sine + north * cosine], axis=1)


def dipole_share(channel: int) -> float:
    """Return a dipole's part of isotropic noise: a third of the power (3-D)."""
    return 1.0 if channel == 0 else float(np.sqrt(1.0 / 3.0))


@dataclass(frozen=True, eq=False)
class AmbientGain:
    """Course of the ambient level."""

    drift: LevelDrift | None
    """Slow random change; None is none."""
    series: JitterSeries | None
    """Process of unit deviation behind it."""
    swell: Swell | None
    """Regular change; None is none."""
    phase: float
    """Phase of the swell at time zero, cycles."""

    def __call__(self, time_s: Array) -> Array:
        """Return the factor on the pressure."""
        level_db = np.zeros(time_s.size)
        if self.drift is not None and self.series is not None:
            level_db += self.drift.range_db * np.tanh(self.series.at(time_s))
        if self.swell is not None:
            turns = time_s / self.swell.period_s + self.phase
            level_db += self.swell.amplitude_db * np.sin(2.0 * np.pi * turns)
        return np.asarray(10.0 ** (level_db / 20.0))


def ambient_gain(scenario: Scenario, noise: Noise) -> AmbientGain | None:
    """Return the course of the ambient level; None if it is constant."""
    if noise.drift is None and noise.swell is None:
        return None
    series = None
    if noise.drift is not None:
        last_s = scenario.duration_s + TILE / scenario.sample_rate_hz
        seed = (scenario.seed, 110)
        series = draw_jitter(seed, 1.0, noise.drift.correlation_s, 0.0, last_s)
    phase = float(np.random.default_rng((scenario.seed, 111)).random())
    return AmbientGain(noise.drift, series, noise.swell, phase)


Envelope = Callable[[Array], Array]
"""Share of the full power at given times, 0 to 1."""


@dataclass(frozen=True, eq=False)
class WeatherNoise:
    """Coloured noise in every channel under an envelope of power."""

    channels: tuple[NoiseGenerator, ...]
    """Noise of every channel at full strength."""
    envelope: Envelope
    """Share of the full power over time."""
    sample_rate_hz: float
    """Sample rate, Hz."""

    def tile(self, number: int) -> Array:
        """Return the noise during a tile, uPa, shape (sample, channel)."""
        power = self.envelope(tile_times_s(number, self.sample_rate_hz))
        if not power.any():
            return np.zeros((TILE, len(self.channels)))
        sound = np.stack([noise.tile(number) for noise in self.channels], axis=1)
        return np.asarray(sound * np.sqrt(power)[:, None])


def rain_density(plan: Rain, frequency_hz: Array) -> Array:
    """Return the density of rain at full strength, uPa^2/Hz."""
    below = np.minimum(frequency_hz / plan.corner_hz, 1.0)
    return np.asarray(10.0 ** (plan.density_db / 10.0) * below**4)


def gust_density(plan: Gusts, frequency_hz: Array) -> Array:
    """Return the density of a gust at its middle, uPa^2/Hz."""
    above = np.maximum(frequency_hz / plan.corner_hz, 1.0)
    return np.asarray(10.0 ** (plan.density_db / 10.0) / above**4)


def rain_envelope(plan: Rain) -> Envelope:
    """Return the share of full power: raised cosines about a stretch of full strength."""
    begin, end = plan.peak_s - 0.5 * plan.hold_s, plan.peak_s + 0.5 * plan.hold_s

    def share(time_s: Array) -> Array:
        risen = np.clip(1.0 - (begin - time_s) / plan.rise_s, 0.0, 1.0)
        left = np.clip(1.0 - (time_s - end) / plan.fall_s, 0.0, 1.0)
        return np.asarray(np.sin(0.5 * np.pi * np.minimum(risen, left)) ** 2)

    return share


def gust_envelope(plan: Gusts, seed: tuple[int, ...], duration_s: float) -> Envelope:
    """Draw the gusts of a recording; the strongest one counts at each time."""
    generator = np.random.default_rng(seed)
    span_s = duration_s + 2.0 * plan.duration_s
    count = generator.poisson(plan.rate_per_min / 60.0 * span_s)
    middles_s = np.sort(generator.random(count) * span_s - plan.duration_s)

    def share(time_s: Array) -> Array:
        if not middles_s.size:
            return np.zeros(time_s.size)
        later = np.searchsorted(middles_s, time_s)
        near = [middles_s[np.clip(later - k, 0, count - 1)] for k in (0, 1)]
        distance_s = np.minimum(*(np.abs(time_s - middle) for middle in near))
        inside = np.clip(1.0 - 2.0 * distance_s / plan.duration_s, 0.0, 1.0)
        return np.asarray(np.sin(0.5 * np.pi * inside) ** 2)

    return share


@dataclass
class ImpulseSound:
    """Waveforms at Poisson times, each from a direction of its own."""

    rate_per_s: float
    """Mean number per second."""
    peak_db: float
    """Median peak pressure, dB re 1 uPa."""
    spread_db: float
    """Standard deviation of the peak pressures, dB."""
    waveforms: Array
    """Waveforms to draw from, of unit peak, ``(waveform, sample)``."""
    seed: tuple[int, ...]
    """Seed of times, peaks and directions."""
    n_channels: int
    """Number of channels."""
    sample_rate_hz: float
    """Sample rate, Hz."""

    def __post_init__(self) -> None:
        """Start with nothing left over from an earlier tile."""
        self._rest: Array = np.zeros((self.waveforms.shape[1], self.n_channels))

    def tile(self, number: int) -> Array:
        """Return the sound during a tile, uPa, shape (sample, channel)."""
        generator = np.random.default_rng([*self.seed, number])
        length = self.waveforms.shape[1]
        count = generator.poisson(self.rate_per_s * TILE / self.sample_rate_hz)
        begins = generator.integers(0, TILE, count)
        kinds = generator.integers(0, len(self.waveforms), count)
        level_db = self.peak_db + self.spread_db * generator.standard_normal(count)
        peaks = 10.0 ** (level_db / 20.0)
        bearing = generator.uniform(0.0, 2.0 * np.pi, count)
        gains = np.stack([np.ones(count), np.sin(bearing), np.cos(bearing)], axis=1)
        total = np.zeros((TILE + length, self.n_channels))
        total[: len(self._rest)] = self._rest
        for begin, kind, gain in zip(begins, kinds, peaks[:, None] * gains, strict=True):
            part = total[begin : begin + length]
            part += np.multiply.outer(self.waveforms[kind], gain[: self.n_channels])
        self._rest = total[TILE:].copy()
        return total[:TILE]


def snap_waveforms(plan: Shrimp, seed: tuple[int, ...], rate_hz: float) -> Array:
    """Return bursts of noise above the lowest frequency, of unit peak.

    Nothing is left where that is above half the sample rate.
    """
    length = max(round(SNAP_S * rate_hz), 8)
    if plan.lowest_hz >= 0.5 * rate_hz:
        return np.zeros((1, length))
    generator = np.random.default_rng(seed)
    noise = generator.standard_normal((16, length))
    noise *= np.exp(-np.arange(length) / (0.2 * length))
    size = 8 * length  # zeros behind, so that the band's edge is sharp
    spectrum = np.fft.rfft(noise, size)
    spectrum[:, np.fft.rfftfreq(size, 1.0 / rate_hz) < plan.lowest_hz] = 0.0
    burst = np.roll(np.fft.irfft(spectrum, size), length, axis=1)[:, : 3 * length]
    return np.asarray(burst / np.abs(burst).max(axis=1, keepdims=True))


def knock_waveforms(plan: Knocks, seed: tuple[int, ...], rate_hz: float) -> Array:
    """Return damped oscillations at drawn frequencies, of unit peak."""
    low, high = plan.band_hz
    if high >= 0.5 * rate_hz:
        raise OptionError(f"knocks.band_hz must end below {0.5 * rate_hz:g} Hz, got {high:g}.")
    generator = np.random.default_rng(seed)
    time_s = np.arange(round(8.0 * plan.decay_s * rate_hz)) / rate_hz
    frequency = generator.uniform(low, high, (16, 1))
    wave = np.sin(2.0 * np.pi * frequency * time_s) * np.exp(-time_s / plan.decay_s)
    return np.asarray(wave / np.abs(wave).max(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class MachineSound:
    """A machine at rest, in every channel."""

    plan: Machine
    """Frequency and levels."""
    phases: Array
    """Phase of each harmonic in each channel at time zero, cycles."""
    gains: Array
    """Gain of each channel."""
    courses: tuple[JitterSeries | SpeedCourse, ...]
    """Variations of the frequency."""
    switches_s: Array
    """Times at which it is switched on and off in turn, s; empty is always on."""
    sample_rate_hz: float
    """Sample rate, Hz."""

    @property
    def has_bearing(self) -> bool:
        """Whether the gains of the dipoles are those of a direction, east and north."""
        return self.plan.bearing_deg is not None and self.gains.size == 3

    def tile(self, number: int) -> Array:
        """Return the sound during a tile, uPa, shape (sample, channel)."""
        time_s = tile_times_s(number, self.sample_rate_hz)
        running = running_share(self.switches_s, time_s)
        total = np.zeros((TILE, self.gains.size))
        if not running.any():
            return total
        ticks = time_s + sum(course.excess_s(time_s) for course in self.courses)
        for i, level_db in enumerate(self.plan.levels_db):
            cycles = (i + 1) * self.plan.fundamental_hz * ticks[:, None] + self.phases[i]
            peak = np.sqrt(2.0) * 10.0 ** (level_db / 20.0)
            total += peak * np.cos(2.0 * np.pi * (cycles - np.floor(cycles)))
        return np.asarray(total * running[:, None] * self.gains)


def running_share(switches_s: Array, time_s: Array) -> Array:
    """Return the share of full amplitude of a machine that is switched.

    ``switches_s``: times of switching on, off, on ... in s; empty is always on.
    ``time_s``: times in s.
    """
    if not switches_s.size:
        return np.ones(time_s.size)
    share = np.zeros(time_s.size)
    for begin, end in zip(switches_s[::2], switches_s[1::2], strict=True):
        inside = np.minimum(time_s - begin, end - time_s) / SWITCH_S
        share = np.maximum(share, np.clip(inside, 0.0, 1.0))
    return share


def machine_sound(
    scenario: Scenario, plan: Machine, number: int, sensor: int, n_channels: int
) -> MachineSound:
    """Draw what a machine does during a recording.

    Its variations are common to all sensors; phases and gains are of the sensor.
    """
    highest = len(plan.levels_db) * plan.fundamental_hz
    highest *= 1.0 + plan.step_fraction + 4.0 * plan.fraction
    if highest > 0.49 * scenario.sample_rate_hz:
        raise OptionError(
            f"harmonics of a machine must stay below {0.49 * scenario.sample_rate_hz:g} "
            f"Hz, got {highest:g}."
        )
    last_s = scenario.duration_s + TILE / scenario.sample_rate_hz
    seed = (scenario.seed, 115, number)
    courses: list[JitterSeries | SpeedCourse] = []
    if plan.fraction > 0.0:
        courses.append(draw_jitter((*seed, 0), plan.fraction, plan.correlation_s, 0.0, last_s))
    if plan.step_fraction > 0.0:
        courses.append(draw_steps((*seed, 1), plan, last_s))
    generator = np.random.default_rng((*seed, 2, sensor))
    phases = generator.random((len(plan.levels_db), n_channels))
    gains = generator.uniform(0.3, 1.0, n_channels)
    gains[0] = 1.0
    if plan.bearing_deg is not None:
        phases[:] = phases[:, :1]
        bearing = np.radians(plan.bearing_deg)
        gains = np.array([1.0, np.sin(bearing), np.cos(bearing)])[:n_channels]
    switches = draw_switches((*seed, 3), plan, last_s)
    return MachineSound(plan, phases, gains, tuple(courses), switches, scenario.sample_rate_hz)


def draw_steps(seed: tuple[int, ...], plan: Machine, last_s: float) -> SpeedCourse:
    """Draw the speeds of a machine that steps from one to another."""
    generator = np.random.default_rng(seed)
    moments = _poisson_times(generator, plan.step_every_s, last_s)
    sizes = generator.uniform(0.2, 1.0, moments.size + 1)
    signs = generator.choice([-1.0, 1.0], moments.size + 1)
    speeds = plan.step_fraction * sizes * signs
    begins = moments.copy()
    for k in range(1, begins.size):  # a step begins after the one before has ended
        begins[k] = max(begins[k], begins[k - 1] + 2.0 * STEP_S)
    times = np.concatenate([[-1.0], np.stack([begins, begins + STEP_S], 1).ravel()])
    values = np.concatenate([[speeds[0]], np.stack([speeds[:-1], speeds[1:]], 1).ravel()])
    if times.size == 1:
        times, values = np.append(times, 0.0), np.repeat(values, 2)
    return SpeedCourse(times, values)


def draw_switches(seed: tuple[int, ...], plan: Machine, last_s: float) -> Array:
    """Draw when a machine is switched: times on, off, on ...; empty is always on."""
    if plan.on_s is None or plan.off_s is None:
        return np.zeros(0)
    generator = np.random.default_rng(seed)
    share = plan.on_s / (plan.on_s + plan.off_s)
    is_on = bool(generator.random() < share)
    switches = [-10.0] if is_on else []
    time_s = 0.0
    while time_s < last_s:
        time_s += float(generator.exponential(plan.on_s if is_on else plan.off_s))
        switches.append(time_s)
        is_on = not is_on
    if is_on:
        switches.append(last_s + 10.0)
    return np.array(switches)


def _poisson_times(generator: np.random.Generator, mean_s: float, last_s: float) -> Array:
    count = generator.poisson(last_s / mean_s)
    return np.sort(generator.random(count) * last_s)


class RecorderFilter:
    """Band edges of a recorder, applied tile by tile in sequence."""

    def __init__(self, plan: Recorder, sample_rate_hz: float, n_channels: int) -> None:
        from scipy.signal import butter

        edges: tuple[tuple[Literal["highpass", "lowpass"], float | None], ...] = (
            ("highpass", plan.high_pass_hz),
            ("lowpass", plan.low_pass_hz),
        )
        for kind, edge in edges:
            if edge is not None and edge >= 0.5 * sample_rate_hz:
                raise OptionError(
                    f"the recorder's {kind} must be below {0.5 * sample_rate_hz:g} Hz, "
                    f"half the sample rate, got {edge:g}."
                )
        self.sections: Sequence[Array] = [
            butter(plan.order, edge, kind, fs=sample_rate_hz, output="sos")
            for kind, edge in edges
            if edge is not None
        ]
        self.states = [np.zeros((len(s), 2, n_channels)) for s in self.sections]

    def __call__(self, sound: Array) -> Array:
        """Return the next tile as the recorder stores it."""
        from scipy.signal import sosfilt

        for k, sections in enumerate(self.sections):
            sound, self.states[k] = sosfilt(sections, sound, axis=0, zi=self.states[k])
        return sound


CLICK_SAMPLES = 256


@dataclass(frozen=True)
class HumSound:
    """Mains hum in every channel."""

    plan: Hum
    """Levels of the harmonics."""
    seed: tuple[int, ...]
    """Seed of phases and gains."""
    n_channels: int
    """Number of channels."""
    sample_rate_hz: float
    """Sample rate, Hz."""
    jitter: JitterSeries | None
    """Variation of the mains frequency; None is none."""

    def tile(self, number: int) -> Array:
        """Return the hum during a tile, uPa, shape (sample, channel)."""
        generator = np.random.default_rng(self.seed)
        shape = (len(self.plan.levels_db), self.n_channels)
        phases, gains = generator.random(shape), generator.uniform(0.3, 1.0, shape)
        gains[:, 0] = 1.0
        time_s = np.arange(number * TILE, (number + 1) * TILE) / self.sample_rate_hz
        if self.jitter is not None:
            time_s = time_s + self.jitter.excess_s(time_s)
        total = np.zeros((TILE, self.n_channels))
        for i, level_db in enumerate(self.plan.levels_db):
            cycles = (i + 1) * self.plan.mains_hz * time_s[:, None] + phases[i]
            peak = np.sqrt(2.0) * 10.0 ** (level_db / 20.0) * gains[i]
            total += peak * np.cos(2.0 * np.pi * (cycles - np.floor(cycles)))
        return total


@dataclass
class ClickSound:
    """Clicks in every channel; tiles must be asked for in sequence."""

    plan: Clicks
    """Rate and peak pressure."""
    seed: tuple[int, ...]
    """Seed of times and directions."""
    n_channels: int
    """Number of channels."""
    sample_rate_hz: float
    """Sample rate, Hz."""

    def __post_init__(self) -> None:
        """Start with nothing left over from an earlier tile."""
        self._rest: Array = np.zeros((CLICK_SAMPLES, self.n_channels))
        generator = np.random.default_rng([104, *self.seed])
        burst = generator.standard_normal(CLICK_SAMPLES)
        burst *= np.exp(-np.arange(CLICK_SAMPLES) / 32.0)
        self._burst = burst * 10.0 ** (self.plan.peak_db / 20.0) / abs(burst).max()

    def tile(self, number: int) -> Array:
        """Return the clicks during a tile, uPa, shape (sample, channel)."""
        generator = np.random.default_rng([*self.seed, number])
        mean = self.plan.rate_per_min / 60.0 * TILE / self.sample_rate_hz
        count = generator.poisson(mean)
        begin = generator.integers(0, TILE, count)
        bearing = generator.uniform(0.0, 2.0 * np.pi, count)
        gains = np.stack([np.ones(count), np.sin(bearing), np.cos(bearing)], axis=1)
        total = np.zeros((TILE + CLICK_SAMPLES, self.n_channels))
        total[:CLICK_SAMPLES] = self._rest
        rows = begin[:, None] + np.arange(CLICK_SAMPLES)
        bursts = self._burst[:, None] * gains[:, None, : self.n_channels]
        np.add.at(total, rows, bursts)
        self._rest = total[TILE:].copy()
        return total[:TILE]


Disturbance = HumSound | ClickSound | WeatherNoise | ImpulseSound | MachineSound


def _hum_and_clicks(
    scenario: Scenario, noise: Noise, sensor: int, n_channels: int
) -> Iterator[HumSound | ClickSound]:
    rate = scenario.sample_rate_hz
    if noise.hum is not None:
        jitter, last_s = None, scenario.duration_s + TILE / rate
        if noise.hum.fraction:
            seed, spread = (scenario.seed, 103), noise.hum.fraction
            jitter = draw_jitter(seed, spread, noise.hum.correlation_s, 0.0, last_s)
        seeds = (scenario.seed, 101, sensor)
        yield HumSound(noise.hum, seeds, n_channels, rate, jitter)
    if noise.clicks is not None:
        yield ClickSound(noise.clicks, (scenario.seed, 102, sensor), n_channels, rate)


def disturbances(
    scenario: Scenario, noise: Noise, sensor: int, n_channels: int
) -> list[Disturbance]:
    """Return everything beside the ambient noise at one sensor."""
    rate = scenario.sample_rate_hz
    found: list[Disturbance] = [*_hum_and_clicks(scenario, noise, sensor, n_channels)]

    def weather(density: Density, stream: int, envelope: Envelope) -> WeatherNoise:
        spectrum = shaping_filter(density, rate)
        channels = [
            NoiseGenerator(scenario.seed, (stream, sensor, c), dipole_share(c) * spectrum)
            for c in range(n_channels)
        ]
        return WeatherNoise(tuple(channels), envelope, rate)

    for k, rain in enumerate(noise.rain):
        shape = rain_envelope(rain)
        found.append(weather(partial(rain_density, rain), 1000 + k, shape))
    if noise.gusts is not None:
        shape = gust_envelope(noise.gusts, (scenario.seed, 112), scenario.duration_s)
        found.append(weather(partial(gust_density, noise.gusts), 113, shape))

    def impulses(plan: Shrimp | Knocks, stream: int, waves: Array) -> ImpulseSound:
        return ImpulseSound(
            plan.rate_per_min / 60.0, plan.peak_db, plan.spread_db, waves,
            (scenario.seed, stream, sensor), n_channels, rate,
        )  # fmt: skip

    if noise.shrimp is not None:
        waves = snap_waveforms(noise.shrimp, (scenario.seed, 120), rate)
        found.append(impulses(noise.shrimp, 121, waves))
    if noise.knocks is not None:
        waves = knock_waveforms(noise.knocks, (scenario.seed, 130), rate)
        found.append(impulses(noise.knocks, 131, waves))
    found += [
        machine_sound(scenario, plan, k, sensor, n_channels)
        for k, plan in enumerate(noise.machines)
    ]
    return found
