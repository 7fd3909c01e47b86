"""How strong everything is at the source, from what the scenario states.

**Method.** A ratio given at closest approach is multiplied back: a tone of C/N0 in a
noise density N has the mean square 10^(C/N0/10) N there, and R^(spreading/20) times
that amplitude at one metre. Only the direct path counts; a surface image comes on top.

**Conventions.** Amplitudes in uPa at 1 m; densities in uPa^2/Hz at 1 m.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.approach import direct_path, nearest_range_m
from uwtrack_cli.simulate.noise import Density, ambient_density
from uwtrack_cli.simulate.scenario import Noise, Scenario
from uwtrack_cli.simulate.trajectories import Array, reference_sensor
from uwtrack_cli.simulate.vessels import Broadband, Line, SpectralFeature, Vessel


@dataclass(frozen=True)
class Tone:
    """A spectral line at its source: rest frequency and amplitude at 1 m."""

    frequency_hz: float
    """Rest frequency, Hz."""
    amplitude_upa: float
    """Amplitude at 1 m, uPa."""


@dataclass(frozen=True)
class BroadbandSource:
    """Broadband sound at its source: density ``scale * (f/1 kHz)^slope`` in a band."""

    band_hz: tuple[float, float]
    """Lowest and highest frequency, Hz."""
    scale: float
    """Density at 1 kHz and 1 m, uPa^2/Hz."""
    slope_db_per_decade: float
    """Slope of the density, dB per decade."""
    features: tuple[SpectralFeature, ...] = ()
    """Bumps and notches."""

    def density(self, frequency_hz: Array) -> Array:
        """Return the density at 1 m, uPa^2/Hz."""
        low, high = self.band_hz
        inside = (frequency_hz >= low) & (frequency_hz <= high)
        density = np.where(inside, self.scale * _tilt(self, frequency_hz), 0.0)
        for feature in self.features:
            density = density * feature.gain(frequency_hz)
        return density

    def power(self) -> float:
        """Return the mean square in the band at 1 m, uPa^2."""
        return _band_power(self.density, self.band_hz)


def reference_range_m(scenario: Scenario, vessel: Vessel) -> float:
    """Return the slant range at which the ratios of a vessel hold, m."""
    plan = reference_sensor(vessel.closest_approach, scenario)
    path = direct_path(scenario, vessel, plan)
    return nearest_range_m(path, scenario.duration_s)


def tones(scenario: Scenario, vessel: Vessel) -> tuple[Tone, ...]:
    """Return every line of a vessel."""
    loss = _loss(scenario, vessel)
    return tuple(
        Tone(frequency, _amplitude(line, frequency, number, loss, scenario.noise))
        for line in vessel.lines
        for number, frequency in enumerate(line_frequencies(line))
    )


def line_frequencies(line: Line) -> tuple[float, ...]:
    """Return the rest frequencies of a line table, Hz."""
    first = line.frequency_hz or line.fundamental_hz or 0.0
    return tuple(first * (n + 1) for n in range(line.harmonics))


def broadband_source(scenario: Scenario, vessel: Vessel) -> BroadbandSource | None:
    """Return the broadband sound of a vessel, if it makes any."""
    plan = vessel.broadband
    if plan is None:
        return None
    if plan.band_hz[1] > 0.48 * scenario.sample_rate_hz:
        raise OptionError(
            f"broadband.band_hz must end below {0.48 * scenario.sample_rate_hz:g} Hz "
            f"(0.48 of the sample rate), got {plan.band_hz[1]:g}."
        )
    shape = plan.band_hz, plan.slope_db_per_decade, plan.features
    unit = BroadbandSource(shape[0], 1.0, *shape[1:]).power()
    power = _broadband_power(plan, scenario, vessel)
    return BroadbandSource(shape[0], power / unit, *shape[1:])


def band_noise_power(noise: Noise, band_hz: tuple[float, float]) -> float:
    """Return the mean square of the ambient noise in a band, uPa^2."""
    return _band_power(lambda f: ambient_density(noise, f), band_hz)


def _broadband_power(plan: Broadband, scenario: Scenario, vessel: Vessel) -> float:
    if plan.source_level_db is not None:
        return float(10.0 ** (plan.source_level_db / 10.0))
    noise = _needed(scenario.noise, "broadband.snr_db")
    ratio = 10.0 ** ((plan.snr_db or 0.0) / 10.0)
    loss = _loss(scenario, vessel)
    return float(ratio * band_noise_power(noise, plan.band_hz) * loss**2)


def _amplitude(
    line: Line, frequency: float, number: int, loss: float, noise: Noise | None
) -> float:
    step = 10.0 ** (line.step_db * number / 20.0)
    if line.source_level_db is not None:
        return float(np.sqrt(2.0) * 10.0 ** (line.source_level_db / 20.0) * step)
    ambient = _needed(noise, "line.cn0_db_hz")
    density = ambient_density(ambient, np.array(frequency))
    power = 10.0 ** ((line.cn0_db_hz or 0.0) / 10.0) * density
    return float(np.sqrt(2.0 * power) * loss * step)


def _loss(scenario: Scenario, vessel: Vessel) -> float:
    distance = reference_range_m(scenario, vessel)
    return float(distance ** (vessel.spreading_db_per_decade / 20.0))


def _needed(noise: Noise | None, key: str) -> Noise:
    if noise is None:
        raise OptionError(f"{key} is a ratio to the noise; give a noise table or source_level_db.")
    return noise


def _tilt(plan: BroadbandSource, frequency_hz: Array) -> Array:
    held = np.maximum(frequency_hz, 1.0) / 1000.0
    return np.asarray(held ** (plan.slope_db_per_decade / 10.0))


def _band_power(density: Density, band_hz: tuple[float, float]) -> float:
    frequency = np.linspace(*band_hz, 20001)
    return float(np.trapezoid(density(frequency), frequency))
