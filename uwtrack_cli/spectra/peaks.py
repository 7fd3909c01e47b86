"""Spectrogram to spectral peaks above a threshold of stated false-alarm rate.

**Method.** A cell is a peak when it is the largest of its neighbourhood of one natural
bin and exceeds the noise by a factor that noise alone exceeds with a stated
probability per cell. Frequency: bias-free parabola through the three largest cells.
Peaks are kept down to a weaker threshold, marked, because a tracker can use them.

**Conventions.** SNR is the power of the line over the noise in one cell, dB.

**References.** Rohling 1983 for the threshold; Rife & Boorstyn 1974 for the
deviation of the frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.noise_floor import (
    TILE_FRAMES,
    independent_cells,
    noise_floor,
    own_share,
    threshold_factor,
)
from uwtrack_cli.estimation.window import (
    NOISE_BANDWIDTH_BINS,
    frequency_std_hz,
    peak_offset_bins,
    response,
)
from uwtrack_cli.spectra.peak_bearings import background_pull, peak_bearings

N_NOISE_BANDS = 16
"""Bands in which the noise density is reported."""


@checked
def find_peaks(
    spectrogram: Spectrogram,
    *,
    false_alarm_probability: Annotated[float, AtLeast(1e-9), AtMost(0.5)] = 1e-4,
    kept_probability: Annotated[float, AtLeast(1e-9), AtMost(0.5)] = 0.1,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    dipole_noise_ratio: Annotated[float, AtLeast(1e-6), AtMost(10)] = 1.0 / 3.0,
) -> Peaks:
    """Find the spectral peaks of each frame.

    Parameters
    ----------
    spectrogram
        A spectrogram, or a block of one that starts with a whole tile.
    false_alarm_probability
        Probability that noise alone exceeds the threshold in a cell.
    kept_probability
        The same for the weakest peaks kept, not below the first: `track` follows lines
        2 dB weaker with 0.1 than with 0.01.
    band_hz
        Lowest and highest frequency searched, Hz; everything unless given.
    dipole_noise_ratio
        Noise power of a dipole channel over the omni channel's, 1/3 if isotropic.

    Returns
    -------
    Peaks
        In the order of frame and frequency.

    Raises
    ------
    OptionError
        An option is out of range.

    Notes
    -----
    The rate of *peaks* is below the rate of *cells*, since a peak is the largest of
    its neighbourhood: half of it at 1e-2 and two thirds at 1e-4, with zero padding 2.
    Bearings are freed of directional noise beneath the line; see `peak_bearings`.
    """
    if kept_probability < false_alarm_probability:
        raise OptionError(
            "kept_probability must be at least false_alarm_probability = "
            f"{false_alarm_probability:g}, got {kept_probability:g}."
        )
    chosen = _chosen_cells(spectrogram.frequency_hz, band_hz)
    frames, power = spectrogram.frames, spectrogram.power_density[:, chosen]
    padding = frames.cells_per_bin
    floor = noise_floor(power, frames.valid_fraction, zero_padding=padding)
    detect, keep = (
        threshold_factors(frames, power.shape[1], probability)
        for probability in (false_alarm_probability, kept_probability)
    )
    ratio = power / floor
    row, cell = _maxima(ratio, keep, padding)
    frequency_hz = spectrogram.frequency_hz[chosen]
    three = [power[row, cell + k] for k in (-1, 0, 1)]
    tones = tones_in(frames, frequency_hz[0] + cell * frames.bin_hz, three)
    bearing_deg, bearing_std_deg = _bearings(
        spectrogram, chosen, (power, floor), (row, cell), dipole_noise_ratio
    )
    return Peaks(
        frames=with_noise(frames, frequency_hz, floor, detect),
        frame=row + frames.first_frame,
        **tones.columns(three[1].astype(np.float64), floor[row, cell]),
        bearing_deg=bearing_deg,
        bearing_std_deg=bearing_std_deg,
        is_detection=ratio[row, cell] > detect[row],
        false_alarm_probability=false_alarm_probability,
        kept_probability=kept_probability,
        reference=spectrogram.reference,
        lowest_hz=float(frequency_hz[0]),
        highest_hz=float(frequency_hz[-1]),
    )


def _chosen_cells(frequency_hz: FloatArray, band_hz: tuple[float, float] | None) -> slice:
    if band_hz is None:
        return slice(0, frequency_hz.size)
    inside = np.flatnonzero((frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1]))
    if inside.size < 8:
        raise OptionError(
            f"band_hz = {band_hz[0]:g} {band_hz[1]:g} holds {inside.size} cells of the "
            f"spectrogram, which reaches {frequency_hz[0]:g} to {frequency_hz[-1]:g} Hz."
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


def threshold_factors(frames: Frames, n_cells: int, probability: float) -> FloatArray:
    """Return the factor above the floor that noise exceeds so often, per frame.

    The first frame starts a tile; the spectrum has so many cells.
    """
    factor = np.empty(frames.n_frames)
    for start in range(0, frames.n_frames, TILE_FRAMES):
        tile = slice(start, start + TILE_FRAMES)
        n_valid = max(1, int(np.sum(frames.valid_fraction[tile] >= 0.5)))
        independent = independent_cells(
            n_valid,
            n_cells,
            zero_padding=frames.cells_per_bin,
            hop_windows=frames.hop_samples / frames.window_samples,
        )
        factor[tile] = threshold_factor(probability, round(independent, 1), own_share(n_valid))
    return factor


def _maxima(ratio: FloatArray, keep: FloatArray, padding: int) -> tuple[IntArray, IntArray]:
    """Rows and cells that exceed and are the largest within one natural bin."""
    inner = ratio[:, padding:-padding]
    is_peak = inner > keep[:, None]
    for shift in range(1, padding + 1):
        is_peak &= inner >= ratio[:, padding - shift : -padding - shift]
        is_peak &= inner > ratio[:, padding + shift : ratio.shape[1] - padding + shift]
    row, cell = np.divmod(np.flatnonzero(is_peak), inner.shape[1])
    return row, cell + padding


def _bearings(
    spectrogram: Spectrogram,
    chosen: slice,
    density: tuple[FloatArray, FloatArray],
    place: tuple[IntArray, IntArray],
    dipole_noise_ratio: float,
) -> tuple[FloatArray, FloatArray]:
    """Bearings of the peaks without their background; nan without direction."""
    east, north = spectrogram.intensity_east, spectrogram.intensity_north
    if east is None or north is None:
        return np.full(place[0].size, np.nan), np.full(place[0].size, np.nan)
    frames = spectrogram.frames
    parts, padding = (east[:, chosen], north[:, chosen]), frames.cells_per_bin
    background = background_pull(parts, *density, *place, zero_padding=padding)
    return peak_bearings(
        parts, *density, background, *place,
        zero_padding=padding, dipole_noise_ratio=dipole_noise_ratio,
        hop_windows=frames.hop_samples / frames.window_samples,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tones:
    """Tones at the largest of neighbouring cells, shape (tone,) each."""

    frames: Frames
    """Time base of the spectra."""
    frequency_hz: FloatArray
    """Interpolated frequencies, Hz."""
    offset_bins: FloatArray
    """How far they lie from their cells, natural bins."""

    def snr(self, centre: FloatArray, floor: FloatArray) -> FloatArray:
        """Return the power over the noise, of the power in a cell and the density there."""
        ratio = self._peak(centre) / floor
        return np.maximum(ratio - 1.0, 0.1 * ratio)

    def columns(self, centre: FloatArray, floor: FloatArray) -> dict[str, Any]:
        """Return frequency, level and SNR with their deviations, as `Peaks` has them."""
        snr = self.snr(centre, floor)
        natural_bin_hz = self.frames.bin_hz / self._step_bins
        line_power = self._peak(centre) * NOISE_BANDWIDTH_BINS * natural_bin_hz
        return {
            "frequency_hz": self.frequency_hz,
            "frequency_std_hz": frequency_std_hz(snr, self.frames.window_s),
            "level_db": 10 * np.log10(line_power),
            "snr_db": 10 * np.log10(snr),
        }

    def _peak(self, centre: FloatArray) -> FloatArray:
        """Return the power at the interpolated maximum, from the window's own shape."""
        step = self._step_bins
        return np.asarray(centre / response(np.clip(self.offset_bins, -step, step)) ** 2)

    @property
    def _step_bins(self) -> float:
        """Distance of two cells in natural bins."""
        return self.frames.window_samples / self.frames.fft_length


def tones_in(frames: Frames, cell_hz: FloatArray, three: Sequence[FloatArray]) -> Tones:
    """Interpolate tones by the power in the largest cells, before and after them."""
    step_bins = frames.window_samples / frames.fft_length
    left, centre, right = (power.astype(np.float64) for power in three)
    offset_bins = peak_offset_bins(left, centre, right, step_bins)
    natural_bin_hz = frames.bin_hz / step_bins
    return Tones(frames, cell_hz + offset_bins * natural_bin_hz, offset_bins)


def with_noise(
    frames: Frames, frequency_hz: FloatArray, floor: FloatArray, detect: FloatArray
) -> Frames:
    """Return frames in which the noise per band and the threshold are noted.

    The noise density has the shape (frame, frequency), the factor of the threshold
    above it that of the frames.
    """
    edges = np.linspace(0, frequency_hz.size, N_NOISE_BANDS + 1).astype(int)
    edges = np.unique(edges)
    middles = (edges[:-1] + edges[1:]) // 2
    with np.errstate(divide="ignore"):
        noise_db = 10 * np.log10(floor[:, middles])
    return replace(
        frames,
        band_low_hz=frequency_hz[edges[:-1]],
        band_high_hz=frequency_hz[edges[1:] - 1],
        noise_db=noise_db,
        threshold_db=10 * np.log10(detect),
    )
