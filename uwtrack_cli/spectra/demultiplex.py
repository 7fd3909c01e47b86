"""Omni, east and north out of the audio of a DIFAR sonobuoy, one second at a time.

A buoy sends one channel of audio: the omnidirectional hydrophone below 2.4 kHz, a pilot at
7.5 kHz and, about a carrier at exactly twice that frequency, both dipoles in quadrature
with a second pilot, which gives the phase of the carrier.

**Method.** A second is made of the three seconds of audio about it. One transform gives
three bands, each at 6 kHz: the omni channel, 6 kHz about the carrier, 240 Hz about the
first pilot. The square of the first pilot's phasor follows clock, wow and jitter of the
carrier up to a constant angle; the phase pilot, averaged over the three seconds with a Hann
window, is that constant. Nothing is remembered: a second is the same wherever reading
begins, and lock is there again as soon as the pilot is.

A fiftieth of a second is locked where the standard deviation of the carrier's phase is below
0.2 rad: twice that of the pilot, 1 / sqrt(2 SNR), its SNR measured against the noise on
either side. A dipole loses exp(-0.2^2 / 2) at that limit, 2 % of its gain.

**Conventions.** With p the phase of the phase pilot cos(p), the audio about the carrier is
-E cos(p) - N sin(p): the east dipole is opposite to the pilot, north a quarter of a period
ahead of it. North is that of the buoy's compass. So have both demultiplexers of PAMGuard,
which read real buoys, and so is the compass in the published simulator; its angle of the
emitter has the other sign of east.

**References.** B. S. Miller, `AmmcDemux.java` of PAMGuard (after Delagrange 1992) and
`AzigramProcess.java` (after Thode et al. 2019, J. Acoust. Soc. Am. 146, 95);
`simulateDifar.m` of bsmUtils, ported from Greeneridge Sciences (MIL-S-81487D, 3.6.4.6.3).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.recording import Samples

RATE_HZ = 6000
"""Sample rate of omni, east and north, Hz."""

LEAST_RATE_HZ = 36_000
"""Least sample rate of the audio, Hz: it holds the carrier and 3 kHz on either side."""

PILOT_HZ = 7500
"""Frequency of the first pilot, Hz."""

SPAN_S = 3
"""Audio of which a second is made, s: the one before, itself, and the one after."""

SOUND_HZ = (2500.0, 3000.0)
"""Where the band of omni and dipoles begins to fall, and where it ends, Hz."""

TRACKED_HZ = (80.0, 120.0)
"""The same of the band in which the first pilot is followed, on either side of it."""

BESIDE_HZ = (300.0, 1500.0)
"""Distances from the pilot between which noise is measured, Hz."""

CELLS = 50
"""Parts of a second, of which each is locked or not."""

LOCKED_RAD = 0.2
"""Standard deviation of the carrier's phase below which there is lock."""

LEAST_PHASE_PILOT = 0.1
"""Least amplitude of the phase pilot over that of the first; buoys send both alike."""

Phasors = NDArray[np.complex128]


@dataclass(frozen=True)
class Second:
    """A second of demultiplexed audio."""

    samples: Samples
    """Omni, east and north, shape (6000, 3); nan where lock is lost."""
    locked_share: float
    """Share of the second that is locked."""
    pilot_snr: float
    """Power of the first pilot over that of the noise in its band."""
    phase_pilot: float
    """Amplitude of the phase pilot over that of the first; nan without lock."""
    clock_error: float
    """Relative error of the first pilot's frequency; nan without lock."""


@dataclass(frozen=True)
class Demultiplexer:
    """Takes three seconds of a buoy's audio and returns the one in the middle."""

    rate_hz: int
    """Sample rate of the audio, Hz, `LEAST_RATE_HZ` or more."""
    dipoles: tuple[str, str]
    """Dipole in phase with the phase pilot, and the one ahead of it; "-" inverts one."""
    response: tuple[tuple[float, float], ...] = ()
    """Frequencies, Hz, and the response of the buoy there, dB, which is taken off."""

    def second(self, audio: FloatArray, first: int, stop: int) -> Second:
        """Return the middle one of three seconds.

        ``audio``: shape (3 ``rate_hz``,), nan where it is lost. ``first``, ``stop``:
        the samples that lie in the recording; those beside them are zero.
        """
        is_missing = np.isnan(audio)
        spectrum = np.fft.rfft(np.where(is_missing, 0.0, audio)) / audio.size
        tracked = _band(spectrum, PILOT_HZ, _TRACKED)
        pilot, noise = _powers(tracked), _powers(_band(spectrum, PILOT_HZ, _BESIDE))
        noise = np.maximum(noise * np.sum(_TRACKED**2) / np.sum(_BESIDE**2), 1e-30)
        is_inside = self._cells_with((np.arange(audio.size) >= first)[:stop])
        is_lost = (pilot / noise < 1.0 + 2.0 / LOCKED_RAD**2) & is_inside
        is_lost |= self._cells_with(is_missing)
        is_locked = is_inside & ~np.convolve(is_lost, np.ones(3), "same").astype(bool)
        # the carrier, but for the constant angle that the phase pilot gives
        turning = (tracked / np.maximum(np.abs(tracked), 1e-30)) ** 2
        about = _band(spectrum, 2 * PILOT_HZ, _SOUND) * np.conj(turning)
        weight = np.hanning(about.size) * np.repeat(is_locked, RATE_HZ // CELLS)
        constant = np.sum(weight * about) / max(np.sum(weight), 1e-30)
        amplitude = np.sqrt(np.sum(pilot * is_locked) / max(np.sum(is_locked), 1))
        if abs(constant) <= LEAST_PHASE_PILOT * amplitude:
            is_locked[:] = False
        sound = (about - constant) * np.conj(constant) / max(abs(constant), 1e-30)
        omni = _band(spectrum, 0, _SOUND).real
        kept = np.repeat(is_locked, RATE_HZ // CELLS)
        parts = np.stack([omni, *self._directed(sound)], axis=1) * kept[:, None]
        parts = self._equalised(parts)
        parts[~kept] = np.nan
        own = slice(CELLS, 2 * CELLS)
        turned = (tracked[1:] * np.conj(tracked[:-1]) * kept[1:])[RATE_HZ : 2 * RATE_HZ]
        has_lock = bool(is_locked[own].any())
        turned_rad = float(np.angle(np.sum(turned)))
        return Second(
            samples=parts[RATE_HZ : 2 * RATE_HZ].astype(np.float32),
            locked_share=float(np.mean(is_locked[own])),
            pilot_snr=float(np.sum(pilot[own]) / np.sum(noise[own])),
            phase_pilot=float(abs(constant) / amplitude) if has_lock else np.nan,
            clock_error=turned_rad * RATE_HZ / (2.0 * np.pi * PILOT_HZ) if has_lock else np.nan,
        )

    def _cells_with(self, flags: BoolArray) -> BoolArray:
        """Tell which parts of the three seconds hold a flag, shape (150,)."""
        edges = np.arange(SPAN_S * CELLS + 1) * self.rate_hz // CELLS
        count = np.concatenate([[0], np.cumsum(flags)])
        return np.asarray(np.diff(count[np.minimum(edges, flags.size)]) > 0)

    def _directed(self, sound: Phasors) -> tuple[FloatArray, FloatArray]:
        """Return east and north of what is in phase with the pilot and ahead of it."""
        named = {
            name.removeprefix("-"): -part if name.startswith("-") else part
            for name, part in zip(self.dipoles, (sound.real, sound.imag), strict=True)
        }
        return named["east"], named["north"]

    def _equalised(self, parts: FloatArray) -> FloatArray:
        """Return three seconds of omni, east and north without the buoy's response."""
        if not self.response:
            return parts
        spectrum = np.fft.rfft(parts, axis=0) * self._undo[:, None]
        return np.asarray(np.fft.irfft(spectrum, parts.shape[0], axis=0))

    @cached_property
    def _undo(self) -> FloatArray:
        frequency_hz, response_db = np.array(self.response).T
        grid_hz = np.maximum(np.arange(SPAN_S * RATE_HZ // 2 + 1) / SPAN_S, 1e-3)
        held_db = np.interp(np.log(grid_hz), np.log(frequency_hz), response_db)
        return np.asarray(10.0 ** (-held_db / 20.0))


def _band(spectrum: Phasors, centre_hz: int, gain: FloatArray) -> Phasors:
    """Return the phasor of a band at 6 kHz: the audio is its real part, turned.

    ``spectrum``: that of three seconds, one-sided, over their samples. ``gain``: by
    frequency from the centre, in the order of a transform.
    """
    half, centre = gain.size // 2, centre_hz * SPAN_S
    band = np.zeros(gain.size, np.complex128)
    band[:half] = 2.0 * spectrum[centre : centre + half]
    if centre:
        band[half:] = 2.0 * spectrum[centre - half : centre]
    else:
        band[0] *= 0.5
    return np.fft.ifft(band * gain) * gain.size


def _powers(phasor: Phasors) -> FloatArray:
    """Return the mean square of each part of a second that is locked or not."""
    cells = phasor.reshape(-1, RATE_HZ // CELLS)
    return np.asarray(np.mean(np.abs(cells) ** 2, axis=1))


def _pass_gain(edge_hz: tuple[float, float]) -> FloatArray:
    """Return a gain of 1 up to a frequency that falls as a cosine to 0 at another."""
    size = SPAN_S * RATE_HZ
    distance_hz = np.abs(np.fft.fftfreq(size, 1.0 / RATE_HZ))
    share = np.clip((distance_hz - edge_hz[0]) / (edge_hz[1] - edge_hz[0]), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * share))


_SOUND, _TRACKED = _pass_gain(SOUND_HZ), _pass_gain(TRACKED_HZ)
_BESIDE = _pass_gain((BESIDE_HZ[1], BESIDE_HZ[1] + 100.0)) - _pass_gain(
    (BESIDE_HZ[0] - 100.0, BESIDE_HZ[0])
)
