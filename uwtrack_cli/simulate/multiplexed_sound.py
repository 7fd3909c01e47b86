"""A sonobuoy's audio: omni, dipoles and pilots in one channel, through a radio.

**Method.** What the sensor hears is band-limited, brought to several times its rate by
zero-stuffing and a linear-phase low pass, and read at the times that the recorder's clock
gives, by a cubic through four samples. The pilots and the carriers of the dipoles are sines
of those same times.

**Conventions.** Time zero is the first sample; the recorder's clock agrees with that of the
scenario there. Tiles have a fixed length, so that blocks of any size are the same.

**References.** The composite signal is that of Greeneridge Sciences' simulator after
MIL-S-81487D, 3.6.4.6.3, ported by B. S. Miller (bsmUtils, `simulateDifar.m`): pilots
sin(w t) and sin(2 w t + pi), north -N cos(2 w t), the first dipole in phase with the
second pilot, which real buoys' east is opposite to. Noise of a frequency
discriminator: S. O. Rice, Noise in FM receivers (1963).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.recording import Samples
from uwtrack_cli.simulate.disturbance_sound import RecorderFilter
from uwtrack_cli.simulate.frequency_jitter import draw_jitter
from uwtrack_cli.simulate.multiplex import Multiplex
from uwtrack_cli.simulate.noise import TILE, NoiseGenerator, shaping_filter
from uwtrack_cli.simulate.scenario import Recorder, Scenario

Array = NDArray[np.float64]

PILOT_HZ = 7500.0
"""Frequency of the first pilot; the second has twice that."""

RADIO_HZ = 20_000.0
"""Highest frequency of the radio's noise, Hz."""

SMOOTH_HZ = 48_000.0
"""Least rate at which a cubic through the sound is taken for the sound, Hz."""

LOW_PASS_PERIODS = 24
"""Length of the low pass that interpolates, in samples of the sound, on either side."""


def multiplexed_tiles(
    scenario: Scenario, number: int, plan: Multiplex, sound: Iterator[Samples]
) -> Iterator[Samples]:
    """Yield the audio of a sensor in tiles, float32, shape (sample, 1).

    ``number``: that of the sensor, from 0. ``sound``: its omni and dipoles, in tiles.
    """
    rate_hz = plan.sample_rate_hz
    source = _SmoothSound(plan, scenario.sample_rate_hz, sound)
    radio = _Radio(scenario.seed, number, plan)
    last_s = 1.01 * scenario.duration_s + 10.0
    seed = (scenario.seed, 111, number)
    jitter = draw_jitter(seed, 1.0, plan.jitter_correlation_s, 0.0, last_s)
    total = round(scenario.duration_s * rate_hz)
    for tile in range(-(-total // TILE)):
        time_s = np.arange(tile * TILE, (tile + 1) * TILE) / rate_hz
        turns = 2.0 * np.pi * plan.wow_hz
        heard_s = time_s * (1.0 + 1e-6 * plan.clock_error_ppm)
        heard_s += plan.wow / turns * (1.0 - np.cos(turns * time_s))
        omni, first, second = source.at(heard_s)
        phase = 2.0 * np.pi * PILOT_HZ * heard_s
        if plan.phase_jitter_rad:
            phase += plan.phase_jitter_rad * jitter.at(heard_s)
        pilots = np.sin(phase) + np.sin(2.0 * phase + np.pi)
        audio = plan.pilot_amplitude * pilots + omni
        audio -= first * np.sin(2.0 * phase) + second * np.cos(2.0 * phase)
        audio = radio.received(tile, time_s, audio)[: total - tile * TILE]
        yield audio[:, None].astype(np.float32)


class _SmoothSound:
    """Sound of three channels, at any times that increase."""

    def __init__(self, plan: Multiplex, rate_hz: float, sound: Iterator[Samples]) -> None:
        from scipy.signal import firwin

        low_hz, high_hz = plan.band_hz
        band = Recorder(high_pass_hz=low_hz, low_pass_hz=high_hz, order=4)
        self._band = RecorderFilter(band, rate_hz, 3)
        self._multiple = int(np.ceil(SMOOTH_HZ / rate_hz))
        self._rate_hz = rate_hz * self._multiple
        n_taps = 2 * LOW_PASS_PERIODS * self._multiple + 1
        cut = 1.0 / self._multiple
        self._taps = self._multiple * firwin(n_taps, cut, window=("kaiser", 8.0))
        self._order = [("east", "north").index(name.removeprefix("-")) for name in plan.dipoles]
        self._signs = [-1.0 if name.startswith("-") else 1.0 for name in plan.dipoles]
        self._sound = sound
        # what is held begins half a filter before the first sample
        self._first = -(n_taps // 2)
        self._held = np.zeros((0, 3))
        self._tail = np.zeros((n_taps - 1, 3))

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Return omni and the dipoles of the first and the second carrier."""
        place = time_s * self._rate_hz - self._first
        index = np.floor(place).astype(np.int64)
        while self._held.shape[0] < index[-1] + 3:
            self._held = np.concatenate([self._held, self._more()])
        share = (place - index)[:, None]
        before, here, after, beyond = (self._held[index + k] for k in (-1, 0, 1, 2))
        # Lagrange's cubic through four samples
        found = -share * (share - 1.0) * (share - 2.0) / 6.0 * before
        found += (share + 1.0) * (share - 1.0) * (share - 2.0) / 2.0 * here
        found -= (share + 1.0) * share * (share - 2.0) / 2.0 * after
        found += (share + 1.0) * share * (share - 1.0) / 6.0 * beyond
        passed = max(int(index[0]) - 1, 0)
        self._held, self._first = self._held[passed:], self._first + passed
        dipoles = [
            sign * found[:, 1 + column]
            for sign, column in zip(self._signs, self._order, strict=True)
        ]
        return found[:, 0], dipoles[0], dipoles[1]

    def _more(self) -> Array:
        """Return the next samples at the higher rate; silence after the end."""
        from scipy.signal import upfirdn

        tile = next(self._sound, None)
        sound = np.zeros((TILE, 3)) if tile is None else self._band(np.asarray(tile))
        spread = upfirdn(self._taps, sound, up=self._multiple, axis=0)
        n_samples = sound.shape[0] * self._multiple
        whole = np.zeros((n_samples + self._tail.shape[0], 3))
        whole[: spread.shape[0]] = spread
        whole[: self._tail.shape[0]] += self._tail
        self._tail = whole[n_samples:]
        return whole[:n_samples]


class _Radio:
    """Noise and fades of a receiver."""

    def __init__(self, seed: int, number: int, plan: Multiplex) -> None:
        self._plan = plan
        self._power = plan.pilot_amplitude**2
        # unit power below RADIO_HZ, rising as the square of the frequency
        spectrum = shaping_filter(
            lambda f: np.where(f <= RADIO_HZ, 3.0 * f**2 / RADIO_HZ**3, 0.0), plan.sample_rate_hz
        )
        self._noise = NoiseGenerator(seed, (110, number), spectrum)

    def received(self, tile: int, time_s: Array, audio: Array) -> Array:
        """Return the audio of a tile as it is received."""
        plan = self._plan
        if plan.radio_snr_db is None and not plan.fades:
            return audio
        usual = 0.0 if plan.radio_snr_db is None else 10 ** (-plan.radio_snr_db / 10)
        noise_power, share = np.full(time_s.size, usual), np.ones(time_s.size)
        for fade in plan.fades:
            past_s = time_s - fade.start_s
            inside = (past_s >= 0.0) & (past_s < fade.duration_s)
            ratio = 10.0 ** (-fade.radio_snr_db / 10.0)
            noise_power[inside] = ratio / (1.0 + ratio)
            share[inside] = np.sqrt(1.0 / (1.0 + ratio))
        noise = np.sqrt(self._power * noise_power) * self._noise.tile(tile)
        return np.asarray(share * audio + noise)
