"""From a scenario to recordings: what each sensor would have stored.

**Method.** Everything is made in tiles of fixed length, counted from the first
sample; blocks are cut from tiles. So the block size changes no bit, and memory does
not grow with the length of the recording.

**Conventions.** Samples are float32 in full-scale units (a stronger sound exceeds 1
and is clipped by whoever writes it). Channels are omni, east, north, or omni, x, y
for axes fixed to the housing (y forward, x to starboard of it), or the hydrophones of
an array, e1 first.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.recording import Recording, Samples, check_block, in_blocks
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.simulate.disturbance_sound import (
    AmbientGain,
    Disturbance,
    MachineSound,
    RecorderFilter,
    ambient_gain,
    dipole_share,
    disturbances,
    tile_times_s,
    turn_dipoles,
)
from uwtrack_cli.simulate.multiplexed_sound import multiplexed_tiles
from uwtrack_cli.simulate.noise import (
    TILE,
    ArrayNoise,
    NoiseGenerator,
    ambient_density,
    shaping_filter,
)
from uwtrack_cli.simulate.scenario import Noise, Scenario, SensorPlan
from uwtrack_cli.simulate.sound import VesselSound, sound_at_elements, vessel_sound
from uwtrack_cli.simulate.trajectories import Array, sensor_trajectory, track_trajectory

KNOWN_AS_IT_IS = (
    "id", "latitude", "longitude", "position_std_m", "depth_m", "heading_deg",
    "compass_offset_deg", "compass_std_deg", "clock_offset_s", "clock_std_s",
    "sensitivity_db_re_v_per_upa", "adc_peak_v",
)  # fmt: skip
"""What the owner of a sensor knows of it without an error."""


def simulate_recordings(scenario: Scenario) -> tuple[Recording, ...]:
    """Return one recording per sensor; its samples are made when they are read.

    Parameters
    ----------
    scenario
        What is in the water.

    Returns
    -------
    tuple of Recording
        The recordings in the order of the sensors. ``reader(block_samples)`` yields
        consecutive blocks of float32 samples, shape (sample, channel).

    Raises
    ------
    OptionError
        The scenario contradicts itself (a line above the band, a missing noise).
    DataError
        A vessel runs into a sensor (found when that moment is read).

    Examples
    --------
    >>> from uwtrack_cli.simulate import make_scenario
    >>> sensor = {"id": "h1", "depth_m": 20.0, "full_scale_db": 140.0}
    >>> table = {"seed": 1, "duration_s": 2.0, "sample_rate_hz": 500.0}
    >>> table |= {"sensor": [sensor], "noise": {"density_db": 70.0}}
    >>> (recording,) = simulate_recordings(make_scenario(table))
    >>> [block.shape for block in recording.reader(600)]
    [(600, 1), (400, 1)]
    """
    return tuple(_recording(scenario, number) for number in range(len(scenario.sensors)))


def _recording(scenario: Scenario, number: int) -> Recording:
    plan = scenario.sensors[number]
    _SensorSound(scenario, number)  # refuses what cannot be made, before anybody reads
    start = scenario.start_utc_ns
    if start is not None:
        shift_s = plan.clock_error_s - plan.clock_offset_s
        start += round(shift_s * NANOSECONDS)
    rate_hz = scenario.sample_rate_hz
    if plan.multiplex is not None:
        rate_hz = plan.multiplex.sample_rate_hz
    return Recording(
        sensor=known_sensor(scenario, plan),
        name=f"{plan.id}.wav",
        sample_rate_hz=rate_hz,
        n_samples=round(scenario.duration_s * rate_hz),
        n_channels=1 if plan.multiplex else _n_channels(plan),
        start_utc_ns=start,
        reader=ScenarioReader(scenario, number),
    )


def known_sensor(scenario: Scenario, plan: SensorPlan) -> Sensor:
    """Return a sensor as its owner describes it: without the errors."""
    true_axes, moving = plan.axes == "true", plan.track is not None
    directional = "omni,east,north" if true_axes else "omni,x,y"
    on_grid = plan.latitude is None and not moving
    channels = directional if plan.kind == "difar" else "omni"
    radio: dict[str, Any] = {}
    if plan.multiplex is not None:
        radio = {"kind": "difar-multiplexed", "channels": "multiplex"}
        radio["multiplex"] = ",".join(plan.multiplex.dipoles)
    array: dict[str, Any] = {}
    if plan.kind == "array":
        numbers = range(1, len(plan.element_places) + 1)
        channels = ",".join(f"e{number}" for number in numbers)
        array = {
            "element_along_m": ",".join(map(repr, plan.element_along_m)) or None,
            "element_positions_m": ";".join(
                ",".join(map(repr, place)) for place in plan.element_positions_m
            )
            or None,
            "tow_offset_m": plan.tow_offset_m if moving else None,
            "heading_source": plan.heading_source if moving else "fixed",
        }
    return Sensor(
        **{name: getattr(plan, name) for name in KNOWN_AS_IT_IS},
        **{"kind": plan.kind, "channels": channels, **radio},
        east_m=plan.east_m + plan.position_error_m[0] if on_grid else None,
        north_m=plan.north_m + plan.position_error_m[1] if on_grid else None,
        depth_std_m=0.0,
        sound_speed_mps=scenario.sound_speed_mps,
        sound_speed_std_mps=0.0,
        gain_db=None if plan.sensitivity_db_re_v_per_upa is None else plan.gain_db,
        full_scale_db=plan.full_scale_db if plan.is_calibrated else None,
        navigation=_navigation(scenario, plan) if moving else None,
        **array,
    )


def _navigation(scenario: Scenario, plan: SensorPlan) -> Navigation:
    """Return the positions that the owner knows: of the platform, not of its array."""
    assert plan.track is not None  # noqa: S101 - it moves
    trajectory, first_s = track_trajectory(plan.track), 0.0
    heading = trajectory
    error_deg = 0.0
    if plan.kind == "array":
        longest_m = plan.tow_offset_m - min(plan.element_along_m)
        first_s = -np.ceil(longest_m / trajectory.top_speed_mps) - 1.0
        if plan.heading_source == "compass":
            heading = sensor_trajectory(plan)
            error_deg = plan.compass_error_deg - plan.compass_offset_deg
    time_s = np.arange(first_s, np.floor(scenario.duration_s) + 2.0)
    east, north, _, _ = trajectory.at(time_s)
    course_deg = np.degrees(heading.course_rad(time_s)) + error_deg
    return Navigation(
        time_s=time_s,
        east_m=east + plan.position_error_m[0],
        north_m=north + plan.position_error_m[1],
        heading_deg=course_deg % 360.0,
        start_utc_ns=scenario.start_utc_ns,
    )


def _n_channels(plan: SensorPlan) -> int:
    counts = {"omni": 1, "difar": 3, "array": len(plan.element_places)}
    return counts[plan.kind]


@dataclass(frozen=True)
class ScenarioReader:
    """Makes the samples of one sensor, block by block; it can be pickled."""

    scenario: Scenario
    """What is in the water."""
    sensor_number: int
    """Number of the sensor, from 0."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield consecutive blocks of at most so many samples."""
        check_block(block_samples)
        return in_blocks(self._tiles(), block_samples)

    def _tiles(self) -> Iterator[Samples]:
        plan = self.scenario.sensors[self.sensor_number].multiplex
        if plan is None:
            return self._sound()
        return multiplexed_tiles(self.scenario, self.sensor_number, plan, self._sound())

    def _sound(self) -> Iterator[Samples]:
        sound = _SensorSound(self.scenario, self.sensor_number)
        total = self.scenario.n_samples
        for number in range(-(-total // TILE)):
            yield sound.tile(number)[: total - number * TILE].astype(np.float32)


class _SensorSound:
    """All sound at one sensor, tile by tile in sequence."""

    def __init__(self, scenario: Scenario, number: int) -> None:
        plan = scenario.sensors[number]
        self.plan, self.rate = plan, scenario.sample_rate_hz
        self.n_channels = _n_channels(plan)
        self.trajectory = sensor_trajectory(plan)
        sounds = [vessel_sound(scenario, i, plan) for i in range(len(scenario.vessels))]
        is_array = plan.kind == "array"
        self.vessels: list[list[VesselSound]] = [
            sound_at_elements(sound, plan) if is_array else [sound] for sound in sounds
        ]
        self.ambient: list[NoiseGenerator] = []
        self.field: ArrayNoise | None = None
        self.others: list[Disturbance] = []
        self.gain: AmbientGain | None = None
        self.recorder: RecorderFilter | None = None
        if plan.recorder is not None:
            self.recorder = RecorderFilter(plan.recorder, self.rate, self.n_channels)
        if scenario.noise is not None:
            self._add_noise(scenario, scenario.noise, number)

    def _add_noise(self, scenario: Scenario, noise: Noise, number: int) -> None:
        if self.plan.kind == "array":
            self.field = ArrayNoise(scenario, noise, number)
            self.gain = ambient_gain(scenario, noise)
            return
        spectrum = shaping_filter(lambda f: ambient_density(noise, f), self.rate)
        self.ambient = [
            NoiseGenerator(scenario.seed, (100, number, channel), dipole_share(channel) * spectrum)
            for channel in range(self.n_channels)
        ]
        self.gain = ambient_gain(scenario, noise)
        self.others = disturbances(scenario, noise, number, self.n_channels)

    def tile(self, number: int) -> Array:
        """Return a tile of samples in full-scale units."""
        turned = self._axes_rad(number)
        total = self._background(number, turned)
        heard = [(k, one) for vessel in self.vessels for k, one in enumerate(vessel)]
        for channel, sound in heard:
            for pressure, east, north in sound.arrivals(number):
                total[:, channel] += pressure
                if self.plan.kind == "difar":
                    cosine, sine = np.cos(turned), np.sin(turned)
                    total[:, 1] += pressure * (east * cosine - north * sine)
                    total[:, 2] += pressure * (east * sine + north * cosine)
        if self.plan.kind == "difar":
            _mix_dipoles(self.plan, total)
        if self.recorder is not None:
            total = self.recorder(total)
        return np.asarray(total / self.plan.full_scale_upa)

    def _background(self, number: int, turned: Array) -> Array:
        """Return all that no vessel makes during a tile, uPa."""
        total = np.zeros((TILE, self.n_channels))
        for channel, ambient in enumerate(self.ambient):
            total[:, channel] = ambient.tile(number)
        if self.field is not None:
            total += self.field.tile(number)
        if self.gain is not None:
            total *= self.gain(tile_times_s(number, self.rate))[:, None]
        for other in self.others:
            sound = other.tile(number)
            if isinstance(other, MachineSound) and other.has_bearing:
                sound = turn_dipoles(sound, turned)
            total += sound
        return total

    def _axes_rad(self, number: int) -> NDArray[np.float64]:
        """Return the compass direction in which the second dipole points, rad."""
        plan = self.plan
        fixed = np.radians(plan.compass_offset_deg - plan.compass_error_deg)
        if plan.axes == "true":
            return np.full(1, fixed)
        if plan.track is None:
            return np.full(1, fixed + np.radians(plan.heading_deg))
        time_s = np.arange(number * TILE, (number + 1) * TILE) / self.rate
        return np.asarray(fixed + self.trajectory.course_rad(time_s))


def _mix_dipoles(plan: SensorPlan, total: Array) -> None:
    """Let each dipole pick up the other one and the omni channel, in place."""
    omni, first, second = total.T.copy()
    one, other = plan.dipole_gain_errors
    heard = first + plan.dipole_crosstalk * second + plan.omni_crosstalk[0] * omni
    total[:, 1] = (1.0 + one) * heard
    heard = second + plan.dipole_crosstalk * first + plan.omni_crosstalk[1] * omni
    total[:, 2] = (1.0 + other) * heard
