"""Delays between the hydrophones of an array: generalised cross-correlation.

**Method.** The cross-spectrum of every pair, weighted, is turned back into a function
of delay on a grid eight times finer than the samples, as far as the pair's distance
allows and a little more; a parabola refines its maximum. The deviation is the
Cramer-Rao bound with the coherence that the aligned spectra show in stretches of
sixteen bins.

Between recorders of one clock that lie far apart the spectra are first aligned, frame by
frame, by the largest delay of the cross-spectrum whose stretches have one level.

**Conventions.** A delay is positive where the second hydrophone hears later.

**References.** C. H. Knapp & G. C. Carter, IEEE Trans. ASSP 24 (1976): the weights and
the bound; G. C. Carter et al., Proc. IEEE 61 (1973): SCOT; G. C. Carter, Proc. IEEE 75
(1987): the variance with any weights.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.arrays.broadband_directions import BAND_BINS, bands_of
from uwtrack_cli.arrays.element_check import ElementCheck, with_silent_elements
from uwtrack_cli.arrays.recorders import RecordersReader
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked, resolved_by
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.window import BIN_CORRELATION, parabola_offset
from uwtrack_cli.spectra.frame_transform import FrameTransform
from uwtrack_cli.spectra.spectrogram import (
    describe_frames,
    frame_blocks,
    plan_frames,
    resolve_decimation,
)

Weighting = Literal["ml", "scot", "phat", "plain"]

FINENESS = 8
"""Delays of the grid within one sample."""

REACH = 1.05
"""Largest delay sought, as a share of the one along the pair."""

BLOCK_FRAMES = 32
"""Frames of a block."""

ML_CHOICE = 4.0
"""Factor of the rate in noise by weights that were chosen in the same noise: 1.7 to 3.3
without it (4,800 pairs and frames)."""

PHAT_LOSS = 1.5
"""Variance of the phase transform over that of scot: bins without signal count fully."""

ALIGNED_LAGS = 5 * FINENESS
"""Delays of the grid on either side of that to which spectra were aligned."""

CLOCK_DEVIATIONS = 3.0
"""Deviations by which clocks are sought apart."""

MOST_LAGS = 20_000
"""Delays of the grid of one pair at most."""


@resolved_by(resolve_decimation)
@checked
def measure_delays(
    recording: Recording,
    *,
    window_s: Annotated[float, Unit("s"), AtLeast(1e-6), AtMost(3600)] = 1.0,
    overlap: Annotated[float, AtLeast(0), AtMost(0.999)] = 0.5,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    decimation: Annotated[int, AtLeast(1), AtMost(1024)] | None = None,
    weighting: Weighting = "ml",
    false_alarm_probability: Annotated[float, AtLeast(1e-9), AtMost(0.5)] = 1e-3,
) -> Iterator[Delays]:
    """Measure the delays between the hydrophones of an array.

    For small arrays, four hydrophones about a metre apart: every pair of them gives a
    delay in every frame, from which directions follow. Several files are those of
    recorders at several places, whose clocks are synchronised as clock_std_s of their
    sensor files says.

    Parameters
    ----------
    recording
        The recording of an array, opened for reading.
    window_s
        Length of a frame, s.
    overlap
        Share of a frame that the next one covers again.
    band_hz
        Lowest and highest frequency used, Hz; everything but zero unless given.
    decimation
        Reduce the sample rate by this factor first, as far as the band allows and to
        10 kHz or more unless given.
    weighting
        Weight of the frequencies: ml, by the coherence that 32 frames show there
        (maximum likelihood); scot, all alike; phat, all alike and every bin of the same
        amplitude, against echoes; plain, by power.
    false_alarm_probability
        Probability that a pair has a delay in a frame of noise.

    Returns
    -------
    Iterator[Delays]
        One row per pair and frame that share sound, in blocks.

    Raises
    ------
    OptionError
        An option is out of range, or the band holds too few bins.
    DataError
        The recording is not of an array, or too few hydrophones work.

    Notes
    -----
    R(tau) = sum W X_b X_a* exp(j 2 pi f tau). With W = C / (1 - C) / abs(X_b X_a*) the
    variance of its maximum is 1 / sum 2 (2 pi f)^2 C / (1 - C), C the squared coherence,
    over independent bins (Knapp & Carter 1976).
    """
    sensor = recording.sensor
    if not len(sensor.element_xyz_m):
        raise DataError(
            f"{recording.name} was recorded by {sensor.kind} sensor {sensor.id!r}; "
            f'delays need kind = "array" with element_positions_m in its sensor file '
            f"(--sensor), and no --channel."
        )
    given = {"band_hz": band_hz, "decimation": decimation}
    used = {**given, **resolve_decimation(recording, given)}["decimation"]
    layout = plan_frames(recording, window_s, overlap, 1, band_hz, used)
    frequency_hz = layout.frequency_hz
    if np.count_nonzero(frequency_hz > 0.0) < BAND_BINS:
        raise OptionError(
            f"the band holds {frequency_hz.size} bins of 1 / window_s; delays need "
            f"{BAND_BINS}: give a wider --band-hz or a longer --window-s."
        )
    return _Correlator(recording, layout, weighting, false_alarm_probability).blocks()


@dataclass
class _Correlator:
    """Measures the delays of one recording."""

    recording: Recording
    """The recording."""
    layout: FrameTransform
    """How its sound is cut into frames."""
    weighting: Weighting
    """How the cross spectra are weighted."""
    probability: float
    """Share of frames of noise in which a delay may be found."""

    def __post_init__(self) -> None:
        """Prepare the pairs and their delays."""
        sensor = self.recording.sensor
        self._places = sensor.element_xyz_m
        self._names = np.array(sensor.channel_names)
        self._frequency_hz = self.layout.frequency_hz
        self._stretches = bands_of(self._frequency_hz.size)
        self._pairs = list(combinations(range(len(self._places)), 2))
        distance = np.array(
            [np.linalg.norm(self._places[a] - self._places[b]) for a, b in self._pairs]
        )
        recorders = self.recording.reader
        stds, late_s = np.zeros((2, len(self._places)))
        if isinstance(recorders, RecordersReader):
            stds, late_s = np.array([recorders.clock_std_s, recorders.late_s])
        self._clock_std_s = np.array([np.hypot(stds[a], stds[b]) for a, b in self._pairs])
        self._late_s = np.array([late_s[b] - late_s[a] for a, b in self._pairs])
        clock_s = CLOCK_DEVIATIONS * np.nan_to_num(self._clock_std_s)
        sought_s = REACH * distance / sensor.sound_speed_mps + clock_s
        longest_s = float(sought_s.max()) / REACH
        window_s = self.layout.window / self.layout.rate_hz
        if 2.0 * longest_s > window_s:
            raise OptionError(
                f"sound takes {longest_s:.4g} s across the {distance.max():.4g} m of the "
                f"array, and a frame of --window-s {window_s:g} must be twice as long: "
                f"are the positions in metres? Else give --window-s "
                f"{2.0 * longest_s:.2g} or more."
            )
        self._step_s = 1.0 / (FINENESS * self.layout.rate_hz)
        self._reach_s = sought_s
        self._n_lags = np.ceil(sought_s / self._step_s).astype(int) + 1
        if self._is_far:
            self._n_lags = np.full(distance.size, ALIGNED_LAGS)
        if self._n_lags.max() > MOST_LAGS:
            raise OptionError(
                f"sound takes {self._n_lags.max() / FINENESS:.0f} samples across the "
                f"array; delays are sought up to {MOST_LAGS // FINENESS}: give a larger "
                f"--decimation."
            )
        quarter_hz = sensor.sound_speed_mps / (4.0 * float(distance.max()))
        order = np.arange(len(self._places), dtype=float)
        self._check = ElementCheck(sensor.channel_names, order, quarter_hz)

    def blocks(self) -> Iterator[Delays]:
        """Yield the delays, some frames at a time."""
        for heard, first, count in frame_blocks(self.recording, self.layout, BLOCK_FRAMES):
            samples = with_silent_elements(heard)
            frames = describe_frames(self.recording, self.layout, samples, first, count)
            whole = frames.valid_fraction == 1.0
            clean = samples if whole.all() else np.nan_to_num(samples)
            spectra = self.layout.spectra_of_all(clean, count)
            alive = (spectra != 0).any(axis=(0, 2))
            if not self._is_far:
                alive = self._check.alive(spectra, self._frequency_hz, float(frames.time_s[0]))
                spectra = self._check.upright(spectra)
            yield self._delays(spectra, alive, whole, frames)

    def _delays(
        self, spectra: NDArray[np.complex64], alive: BoolArray, whole: BoolArray, frames: Frames
    ) -> Delays:
        used = [
            (number, a, b) for number, (a, b) in enumerate(self._pairs) if alive[a] and alive[b]
        ]
        found = [self._pair(spectra[:, a], spectra[:, b], number) for number, a, b in used]
        delay_s, std_s, coherence = np.stack(found, axis=-1)  # frame, pair
        known = np.isfinite(delay_s) & whole[:, None]
        frame, pair = np.nonzero(known)
        first = np.array([a for _, a, _ in used])[pair]
        second = np.array([b for _, _, b in used])[pair]
        number = np.array([number for number, _, _ in used])[pair]
        return Delays(
            time_s=frames.time_s[frame],
            channel_a=self._names[first],
            channel_b=self._names[second],
            delay_s=delay_s[known] + self._late_s[number],
            clock_std_s=self._clock_std_s[number] if self._is_far else None,
            delay_std_s=std_s[known],
            coherence=coherence[known],
            sensor=self.recording.sensor.id,
            start_utc_ns=frames.start_utc_ns,
        )

    def _pair(
        self, one: NDArray[np.complex64], other: NDArray[np.complex64], number: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return delay, deviation and coherence of a pair in every frame."""
        reach = int(self._n_lags[number])
        coarse_s: FloatArray = np.zeros(one.shape[1])
        if self._is_far:
            coarse_s = self._coarse(one, other, float(self._reach_s[number]))
            aligned = np.multiply.outer(self._frequency_hz, coarse_s)
            other = other * np.exp(2j * np.pi * aligned).astype(np.complex64)
        cross, level, weight = self._weighted(one, other)
        lag_s = self._step_s * np.arange(-reach, reach + 1)
        turn = np.exp(2j * np.pi * np.multiply.outer(lag_s, self._frequency_hz))
        spread = np.concatenate(
            [w * cross[bins] for w, bins in zip(weight, self._stretches, strict=True)]
        )
        height = (turn.astype(np.complex64) @ spread.astype(np.complex64)).real
        best = height.argmax(axis=0)
        is_found = (best > 0) & (best < lag_s.size - 1)
        is_found &= height.max(axis=0) > self._threshold(
            spread, max(float(self._reach_s[number]), float(lag_s[-1]))
        )
        at, row = np.clip(best, 1, lag_s.size - 2), np.arange(best.size)
        three = (height[at + k, row].astype(float) for k in (-1, 0, 1))
        delay_s = lag_s[at] + self._step_s * parabola_offset(*three)
        variance, coherence = self._variance(other * one.conj(), level, weight, delay_s)
        is_known = is_found & np.isfinite(variance)
        std_s = np.sqrt(np.where(is_known, variance, 1.0))
        return np.where(is_known, coarse_s + delay_s, np.nan), std_s, coherence

    @property
    def _is_far(self) -> bool:
        """Whether the hydrophones are recorders that lie far apart."""
        return isinstance(self.recording.reader, RecordersReader)

    def _coarse(
        self, one: NDArray[np.complex64], other: NDArray[np.complex64], reach_s: float
    ) -> FloatArray:
        """Return the delay of every frame to a sample, s."""
        from scipy.fft import irfft

        cross, _, _ = self._weighted(one, other, is_flat=True)
        step_hz = float(self._frequency_hz[1] - self._frequency_hz[0])
        size = round(self.layout.rate_hz / step_hz)
        padded = np.zeros((size // 2 + 1, cross.shape[1]), np.complex64)
        first = round(float(self._frequency_hz[0]) / step_hz)
        padded[first : first + len(cross)] = cross
        height = irfft(padded, size, axis=0)
        most = min(int(np.ceil(reach_s * self.layout.rate_hz)), size // 2 - 1)
        lag = np.arange(-most, most + 1)
        return np.asarray(lag[height[lag].argmax(axis=0)] / self.layout.rate_hz)

    def _threshold(self, spread: NDArray[np.complex64], reach_s: float) -> FloatArray:
        """Return what the correlation of noise reaches at the stated rate.

        At one delay it is a sum of many terms of random sign; a band of width B has 2 B
        independent delays in a second.
        """
        from scipy.special import ndtri

        band_hz = float(self._frequency_hz[-1] - self._frequency_hz[0])
        n_own = 1.0 + 2.0 * band_hz * 2.0 * reach_s
        if self.weighting == "ml":
            n_own *= ML_CHOICE
        power = (spread.real**2 + spread.imag**2).sum(axis=0)
        scale = np.sqrt(0.5 * BIN_CORRELATION * power)
        return np.asarray(-ndtri(self.probability / n_own) * scale)

    def _weighted(
        self, one: NDArray[np.complex64], other: NDArray[np.complex64], *, is_flat: bool = False
    ) -> tuple[NDArray[np.complex64], FloatArray, FloatArray]:
        """Return the cross-spectrum, its level and the weights of the stretches.

        The level of a stretch is the geometric mean of the two hydrophones' powers; the
        cross-spectrum is given over it. ``is_flat``: all stretches weigh alike.
        """
        cross = other * one.conj()
        stretches = self._stretches
        level, weight = np.ones((2, len(stretches), one.shape[1]))
        tiny = np.finfo(np.float32).tiny
        if self.weighting == "phat":
            cross = cross / np.maximum(np.abs(cross), tiny)
        for row, bins in enumerate(stretches):
            powers = [(np.abs(x[bins]) ** 2).mean(axis=0) for x in (one, other)]
            level[row] = np.sqrt(np.maximum(powers[0] * powers[1], tiny))
            if self.weighting == "phat":
                continue
            cross[bins] /= level[row]
            if is_flat:
                continue
            seen = np.abs(cross[bins].mean(axis=0))
            if self.weighting == "ml":  # of all frames of the block: less noisy
                mean = np.sqrt(np.mean(seen**2))
                squared = _unbiased(mean, cross[bins].shape[0], 1.0)
                weight[row] = np.sqrt(squared) / (1.0 - squared)
        if self.weighting == "plain":
            weight = level / np.maximum(level.max(axis=0), tiny)
        return cross, level, weight

    def _variance(
        self,
        cross: NDArray[np.complex64],
        level: FloatArray,
        weight: FloatArray,
        delay_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return variances of delays, and the coherence in the band.

        sum w^2 k^2 (1 - C) / (2 (sum w k^2 sqrt C)^2), k = 2 pi f, over independent
        bins (Carter 1987, of any weight).
        """
        turn = np.multiply.outer(self._frequency_hz, delay_s)
        aligned = (cross * np.exp(2j * np.pi * turn)).real
        upper, lower, total = np.zeros((3, delay_s.size))
        for row, bins in enumerate(self._stretches):
            n_bins = self._frequency_hz[bins].size
            seen = np.maximum(aligned[bins].mean(axis=0) / level[row], 0.0)
            squared = _unbiased(seen, n_bins, 0.5)
            wave2 = float(np.mean((2.0 * np.pi * self._frequency_hz[bins]) ** 2))
            independent = n_bins / BIN_CORRELATION
            upper += independent * weight[row] ** 2 * wave2 * (1.0 - squared)
            lower += independent * weight[row] * wave2 * np.sqrt(squared)
            total += np.sqrt(squared) * n_bins
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = upper / (2.0 * lower**2)
        if self.weighting == "phat":
            variance = variance * PHAT_LOSS
        return variance, total / self._frequency_hz.size


def _unbiased(seen: Any, n_bins: int, share: float) -> FloatArray:
    """Return squared coherences without what noise alone shows in so many bins."""
    chance = share * BIN_CORRELATION / n_bins
    squared = (np.minimum(seen, 1.0) ** 2 - chance) / (1.0 - chance)
    return np.asarray(np.clip(squared, 0.0, 1.0 - 1e-6))
