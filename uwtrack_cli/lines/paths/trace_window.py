"""What is measured along the paths of one window, and how it is smoothed.

**Method.** Along each path the frequency is that of the peak beside the path's cell, if
the line is strong enough for a peak to be its own, and otherwise the cell itself:
below some 2 dB in the cell noise peaks win. Measurements are smoothed forth and back over the
window by the filters of `estimation.kalman`, all lines at once.

**Conventions.** Arrays have the shape (frame of the window, line).

**References.** Rauch, Tung & Striebel (1965).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.estimation import kalman
from uwtrack_cli.estimation.angles import compass_deg, wrap_deg
from uwtrack_cli.estimation.noise_floor import (
    LEAST_SHARE,
    SMALLEST,
    TILE_BINS,
    TILE_FRAMES,
    noise_floor,
)
from uwtrack_cli.estimation.window import NOISE_BANDWIDTH_BINS, frequency_std_hz, peak_offset_bins
from uwtrack_cli.lines.tracker_options import ProcessNoise
from uwtrack_cli.lines.tracking.track_store import UNKNOWN_BEARING_VARIANCE

_PEAK_SNR = 1.6
"""Mean power ratio of a line above which its peaks are interpolated (2 dB)."""

_EXPONENTS = (0.0, 1.0, 2.0, 3.0, 4.0)
"""Powers of frequency tried for the ground near zero, up to 12 dB per octave."""

_MUCH_EVENER = 0.6
"""Share of their spread that a ground's power law leaves at most: 6 dB per octave from 5 Hz
leaves less than half, and lines beside each other on even ground most of it."""

_PATH_CORRELATION = 9.0
"""Frames for which the error of a path's cells lasts: so many are as good as one
(simulated at 0 to 3 dB, where 92 to 96 % of the smoothed frequencies then hold)."""


@dataclass(frozen=True)
class WindowData(Rows):
    """The frames of one window."""

    SHARED = frozenset({"frequency_hz"})

    frame: IntArray
    """Index of each frame, shape (frame,)."""
    time_s: FloatArray
    """Centre of each frame, s, shape (frame,)."""
    is_valid: BoolArray
    """Whether the frame has valid samples, shape (frame,)."""
    frequency_hz: FloatArray
    """Frequency of each cell, Hz, shape (cell,)."""
    power: FloatArray
    """Power density, shape (frame, cell)."""
    floor: FloatArray
    """Noise density in the same unit, nan in a gap, shape (frame, cell)."""
    exponent: FloatArray
    """Power of frequency by which the ground under it falls, shape (frame,)."""
    east: FloatArray | None
    """Active intensity to the east, in the unit of the power density; None if omni."""
    north: FloatArray | None
    """The same to the north."""
    window_s: float
    """Length of the analysis window, s."""
    cells_per_bin: int
    """Cells per natural bin."""

    @property
    def even_floor(self) -> FloatArray:
        """Noise density without the power law of the ground, shape (frame, cell)."""
        return self.floor / power_law(self.frequency_hz, self.exponent)

    @property
    def power_ratio(self) -> FloatArray:
        """Power over noise; nan in a gap, and over the floor of silence beside sound."""
        ratio = self.power / self.floor
        ratio[ratio > 1.0 / LEAST_SHARE] = np.nan
        return ratio


class Windows:
    """Cuts blocks of spectrogram into windows that overlap by one half.

    Parameters
    ----------
    first
        The first block.
    band_hz
        Lowest and highest frequency of the windows, Hz.
    window_frames
        Frames of a window.
    """

    def __init__(
        self, first: Spectrogram, band_hz: tuple[float, float], window_frames: int
    ) -> None:
        # the cells at zero are not exponential
        low = max(band_hz[0], 2.0 / first.frames.window_s)
        is_inside = (first.frequency_hz >= low) & (first.frequency_hz <= band_hz[1])
        inside = np.flatnonzero(is_inside)
        self.chosen = slice(int(inside[0]), int(inside[-1]) + 1)
        self.window_frames = window_frames
        self.is_first = True
        self._held: list[WindowData] = []
        self._n_held = 0

    def push(self, block: Spectrogram) -> Iterator[WindowData]:
        """Take a block; yield the windows that are full."""
        self._held.append(to_window(block, self.chosen))
        self._n_held += block.frames.n_frames
        while self._n_held >= self.window_frames:
            data = WindowData.join(self._held)
            rest = data.take(slice(self.window_frames // 2, None))
            self._held, self._n_held = [rest], rest.frame.size
            yield data.take(slice(self.window_frames))
            self.is_first = False

    def rest(self) -> WindowData | None:
        """Return what no window has had whole, at the end; None if there is nothing."""
        n_searched = 0 if self.is_first else self.window_frames // 2
        return WindowData.join(self._held) if self._n_held > n_searched else None


@dataclass(frozen=True)
class Measured:
    """Raw measurements along the paths; variances are inf outside the lines."""

    position: FloatArray
    """Frequency and bearing, shape (2, frame, line)."""
    variance: FloatArray
    """Variance of both, inf outside the line, shape (2, frame, line)."""
    raw: FloatArray
    """What `LinePoints.measured` holds, shape (N_MEASURED, frame, line)."""


def to_window(spectrogram: Spectrogram, chosen: slice) -> WindowData:
    """Take what is needed from a block of spectrogram, and estimate its noise."""
    frames = spectrogram.frames
    power, frequency = (spectrogram.power_density[:, chosen], spectrogram.frequency_hz[chosen])
    exponent = ground_exponent(power, frequency, frames.cells_per_bin)
    ground = power_law(frequency, exponent)
    floor = noise_floor(power / ground, frames.valid_fraction, zero_padding=frames.cells_per_bin)
    floor = np.maximum(floor * ground, SMALLEST)
    east, north = spectrogram.intensity_east, spectrogram.intensity_north
    return WindowData(
        frame=frames.first_frame + np.arange(frames.n_frames),
        time_s=frames.time_s,
        is_valid=frames.valid_fraction > 0.0,
        frequency_hz=frequency,
        power=power,
        floor=floor,
        exponent=exponent,
        east=None if east is None else east[:, chosen],
        north=None if north is None else north[:, chosen],
        window_s=frames.window_s,
        cells_per_bin=frames.cells_per_bin,
    )


def ground_exponent(power: FloatArray, frequency_hz: FloatArray, cells_per_bin: int) -> FloatArray:
    """Return the power of frequency by which each frame's ground falls, shape (frame,).

    A tile of the noise floor is wider than the knee of steep ground near zero. Where the
    lowest tile ends at three times the frequency of its beginning, the whole exponent is
    taken that leaves the two lowest tiles most even (median deviation of mean powers over 16 frames);
    elsewhere, and where that is not much evener, zero. The first frame starts a tile.
    """
    exponent = np.zeros(len(power), np.float32)
    width = TILE_BINS * cells_per_bin
    if frequency_hz.size < 2 * width or frequency_hz[width] < 3.0 * frequency_hz[0]:
        return exponent
    log_hz = np.log(frequency_hz[: 2 * width] / frequency_hz[0])
    trials = np.array(_EXPONENTS)
    for start in range(0, len(power), TILE_FRAMES):
        tile = slice(start, start + TILE_FRAMES)
        mean = power[tile, : 2 * width].mean(axis=0, dtype=float)
        if not (np.isfinite(mean).all() and (mean > SMALLEST).all()):
            continue
        even = np.log(mean) + trials[:, None] * log_hz
        off = np.abs(even - np.median(even, axis=1, keepdims=True))
        spread = np.median(off, axis=1)
        best = spread.argmin()
        if spread[best] < _MUCH_EVENER * spread[0]:
            exponent[tile] = trials[best]
    return exponent


def power_law(frequency_hz: FloatArray, exponent: FloatArray) -> FloatArray:
    """Return the ground of such exponents, one at the lowest cell, (frame, cell)."""
    law: FloatArray = (frequency_hz / frequency_hz[0]).astype(np.float32) ** -exponent[:, None]
    return law


def measure(data: WindowData, cells: IntArray, is_line: BoolArray) -> Measured:
    """Measure frequency, bearing, level and SNR along paths, shape (frame, line)."""
    power, ratio = _along(data.power, cells), _along(data.power_ratio, cells)
    known = is_line & np.isfinite(ratio)
    mean = np.where(known, ratio, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    strength = np.maximum(mean - 1.0, 0.1)
    frequency, std = _frequency(data, cells, strength)
    bearing, bearing_std = _bearing(data, cells, strength)
    snr = np.maximum(ratio - 1.0, 0.1 * ratio)
    bin_hz = 1.0 / data.window_s
    with np.errstate(divide="ignore", invalid="ignore"):
        level = 10.0 * np.log10(power * NOISE_BANDWIDTH_BINS * bin_hz)
        raw = np.stack([frequency, std, bearing, bearing_std, level, 10.0 * np.log10(snr)])
    variance = np.stack([std**2, bearing_std**2])
    variance = np.where(known & np.isfinite(raw[[0, 2]]), variance, np.inf)
    return Measured(raw[[0, 2]], variance, raw)


def _along(values: FloatArray, cells: IntArray) -> FloatArray:
    return np.take_along_axis(values, cells, axis=1).astype(float)


def _frequency(
    data: WindowData, cells: IntArray, strength: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Frequency and deviation: of the peak nearby, or of the cell itself."""
    step = 1.0 / data.cells_per_bin
    last = data.frequency_hz.size - 2
    # half a resolution to either side: farther off, the peak is the noise's
    reach = max(1, data.cells_per_bin // 2)
    near = np.clip(cells[..., None] + np.arange(-reach, reach + 1), 1, last)
    shape = cells.shape
    flat = near.reshape(shape[0], -1)
    best = np.take_along_axis(data.power, flat, axis=1).reshape(near.shape).argmax(-1)
    peak = np.take_along_axis(near, best[..., None], axis=-1)[..., 0]
    three = [_along(data.power, peak + k) for k in (-1, 0, 1)]
    offset = peak_offset_bins(three[0], three[1], three[2], step)
    bin_hz = 1.0 / data.window_s
    interpolated = data.frequency_hz[peak] + offset * bin_hz
    # by the line's own strength: single peaks owe theirs to the noise
    std = np.broadcast_to(frequency_std_hz(strength, data.window_s), shape)
    # a cell's error: its width, and the noise that pulls the path (simulated)
    cell_std = bin_hz * np.sqrt(_PATH_CORRELATION) * np.hypot(0.29 * step, 0.31 / strength)
    is_strong = strength > _PEAK_SNR
    return (
        np.where(is_strong, interpolated, data.frequency_hz[cells]),
        np.where(is_strong, std, np.broadcast_to(cell_std, shape)),
    )


def _bearing(
    data: WindowData, cells: IntArray, strength: FloatArray
) -> tuple[FloatArray, FloatArray]:
    if data.east is None or data.north is None:
        return np.full(cells.shape, np.nan), np.full(cells.shape, np.nan)
    sums = [
        sum(
            _along(part, np.clip(cells + k, 0, part.shape[1] - 1))
            for k in range(-(data.cells_per_bin // 2), data.cells_per_bin // 2 + 1)
        )
        for part in (data.east, data.north)
    ]
    # isotropic noise: a dipole channel has a third of the omni channel's power
    variance = (1.0 + 1.0 / strength) / (6.0 * strength)
    std = np.degrees(np.minimum(np.sqrt(variance), 1.8))
    return (
        compass_deg(np.asarray(sums[0]), np.asarray(sums[1])),
        np.broadcast_to(std, cells.shape).copy(),
    )


def smooth_window(
    measured: Measured, time_s: FloatArray, noise_density: FloatArray, rate_std: FloatArray
) -> FloatArray:
    """Filter and smooth all lines of a window; return states, (frame, 5, 2, line).

    Deviations of first rates are those of frequency, Hz/s, and bearing, degree/s.
    """
    n_frames, n_lines = measured.position.shape[1:]
    steps = np.diff(time_s, prepend=time_s[:1])
    state = _first_state(measured, rate_std)
    states = np.empty((n_frames, 5, 2, n_lines))
    for k in range(n_frames):
        state = kalman.predict(state, float(steps[k]), noise_density)
        off = measured.position[:, k] - state.position
        off[1] = wrap_deg(off[1])
        off = np.where(np.isfinite(measured.variance[:, k]), off, 0.0)
        state = kalman.update(state, off, measured.variance[:, k])
        states[k] = state
    everywhere = np.ones((n_frames, 1, 1), dtype=bool)
    kalman.smooth_all(states, steps, noise_density, everywhere)
    return states


def smooth_paths(
    data: WindowData, measured: Measured, middle_hz: FloatArray, motion: ProcessNoise, hop_s: float
) -> FloatArray:
    """Smooth all lines of a window by how fast they may change at their frequencies.

    Middle frequencies in Hz have the shape (line,), frames come every ``hop_s``; returns
    states, shape (frame, 5, 2, line).
    """
    density = np.stack([
        motion.frequency_density(middle_hz, data.window_s),
        np.full(middle_hz.size, motion.bearing_deg2ps3),
    ])  # fmt: skip
    rate_hzps = motion.rate_std_hzps(data.window_s, hop_s)
    rate_std = np.array([rate_hzps, motion.bearing_rate_degps])
    return smooth_window(measured, data.time_s, density, rate_std)


def _first_state(measured: Measured, rate_std: FloatArray) -> kalman.KalmanState:
    """Start every line at its first measurement, with little confidence."""
    is_known = np.isfinite(measured.variance)
    first = is_known.argmax(axis=1)
    start = np.take_along_axis(measured.position, first[:, None], axis=1)[:, 0]
    has_any = is_known.any(axis=1)
    start = np.where(has_any, start, 0.0)
    zero = np.zeros_like(start)
    spread = np.full_like(start, UNKNOWN_BEARING_VARIANCE)
    rate_variance = np.broadcast_to(rate_std[:, None] ** 2, start.shape).copy()
    return kalman.KalmanState(start, zero, spread, zero, rate_variance)
