"""Transients of level or lines that last seconds: where something may pass quickly.

**Method.** Each frame is cut into sub-bands. A sub-band's noise is its median cell; the
cells that exceed it by a factor which noise exceeds with a stated probability make the
strength of its lines, 1 + ln(power over that factor) summed over all cells. It needs no
line that lasts and does not mind how fast lines sweep. Every frame has a noise of its
own, so rain, gusts and knocks do not raise it; a line that is heard a quarter of the
time, such as hum, makes its cell as loud as it usually is, and must exceed that. The
noise of the sub-bands against their own quiet frames makes the level.

A rise is the mean over some frames, without the strongest few, less that of the louder
of both sides: a knock, a step, the flank of a slow passage and the onset of rain are
none. Its height counts in spreads of
the rises of like length that the recording has all the time, so that swell and hum
that flutters are none, either. A stretch is too short to know its own spread where
it holds few such lengths; there the usual spread of drawn sound stands in, weighted like
some lengths more.

Where lines rise, their frequencies are turned back by the movement of passages of some
widths and speeds, and by the same upside down. A movement fits where the strengths of
all cells come together in fewer of them, by the sum of their squares. Lines of a quick
passage fall so; lines that keep their frequency best may be those of a slow one, and
calls climb as well as they fall.

**Conventions.** Stretches count absolute frames, so blocks have no influence. Memory is
bounded by one stretch.

**References.** Rohling (1983), IEEE Trans. Aerosp. Electron. Syst. 19, 608, eq. 33, for
the factor. `studies/constants/transients.py` draws what the constants were set from.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.options import AtLeast, AtMost, checked
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.data.streams import RememberedStream
from uwtrack_cli.data.transients import CLIMB, FALL, LEVEL, LINES, Transients
from uwtrack_cli.estimation.noise_floor import LN2, threshold_factor
from uwtrack_cli.estimation.window import BIN_CORRELATION

HALF_LENGTHS_S = (0.15, 0.3, 0.5, 1.0, 2.0)
"""Half lengths of the rises that are sought, s."""

FLANK = (2.0, 6.0)
"""Where the sides of a rise begin and end, in half lengths, from the middle."""

LEFT_OUT = 3
"""Strongest frames of a rise that are left out: as many as overlap one instant."""

BAND_BINS = 32
"""Natural bins of a sub-band."""

CELL_PROBABILITY = 1e-4
"""Probability that noise makes a cell count among the lines."""

HIT_SQUARE = 1.2
"""Mean square of what a cell of noise counts, 1 + ln(1 + y / 9) with y exponential."""

QUIET_SHARE = 0.2
"""Share of a sub-band's frames that its quiet level lies above."""

LOUD_SHARE = 0.75
"""Share of a cell's frames that what it usually has lies above."""

LOUD_FACTOR = 10.0
"""What a line must exceed that: noise, or a line that fades, does so rarely."""

LARGEST_RATIO = 6e4
"""Largest ratio that is told, as half precision holds it."""

USUAL_LEVEL_DB = 0.25
"""Spread of rises of the level in sound without a passage, dB: the median over drawn
recordings without a vessel."""

USUAL_WEIGHT = 2.0
"""Lengths of a rise with its sides that the usual spread is worth."""

WIDTHS_S = (0.15, 0.3, 0.6, 1.2, 2.4)
"""d/v of the movements by which lines are turned back, s."""

MACHS = (0.03, 0.05, 0.07, 0.1, 0.15, 0.25)
"""Their speeds over that of sound: below them frames of a tenth of a second resolve no
movement."""

N_PLACES = 7
"""Instants of closest approach that are tried within a rise."""

MOVED_WIDTHS = 3.0
"""d/v to either side that are turned back."""

LEAST_FALL, LEAST_CLIMB = 1.4, 1.2
"""Sums of squares, over those of lines that keep their frequency, from which lines fall
or climb: see studies/constants/transients.py."""

LOWEST_MEDIAN = 2.0
"""Usual spreads, at most, by which the median rise of a stretch lies below zero: leaving
out the strongest three frames of seven, it is 1.1 in noise."""

STRETCH_FRAMES, CONTEXT_FRAMES = 6_000, 1_200
"""Frames that are searched at once, and those beside them that are known, too."""


@dataclass(frozen=True, eq=False)
class _Cells(Rows):
    """What is kept of some frames."""

    SHARED = frozenset({"edges"})

    time_s: FloatArray
    """Middles, s, shape (frame,)."""
    density: FloatArray
    """Noise of each sub-band, nan without sound, shape (frame, band)."""
    ratio: NDArray[np.float16]
    """Power over noise and over the factor that noise exceeds, shape (frame, cell)."""
    edges: IntArray
    """First cell of each sub-band, and the number of cells, shape (band + 1,)."""
    lowest: float
    """Frequency of the first cell, in cells."""


class _Hits(NamedTuple):
    """Cells of lines, above what their band and they themselves usually have."""

    row: IntArray
    """Their frames, shape (hit,)."""
    frequency: FloatArray
    """Their frequencies, in cells."""
    strength: FloatArray
    """1 + ln(power over what must be exceeded)."""


_Transient = tuple[float, float, str, float]
"""Middle and half length in s, kind, and height in spreads."""


@checked
def find_transients(
    blocks: Iterator[Spectrogram],
    *,
    least_spreads: Annotated[float, AtLeast(1), AtMost(1000)] = 7.0,
) -> Iterator[Transients]:
    """Find transients: lines or a level that rise and fall within seconds.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram with frames of a tenth of a second or so.
    least_spreads
        Height from which a transient is reported, in spreads of the fluctuations of the
        recording. With the default, an hour of noise alone has fewer than one.

    Returns
    -------
    Iterator[Transients]
        One block per block read, and the rest at last.

    Raises
    ------
    OptionError
        The option is out of range.
    """
    return FoundTransients(blocks, least_spreads)


class FoundTransients(RememberedStream[Transients, _Transient]):
    """The rises of a stream of spectrograms, found while they come.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram with short frames.
    least_spreads
        Option of `find_transients`.
    """

    def __init__(self, blocks: Iterator[Spectrogram], least_spreads: float) -> None:
        self._least_spreads = least_spreads
        self._held: list[_Cells] = []
        self._hop_s, self._known, self._sensor = 1.0, 0, ""
        super().__init__(self._follow(blocks))

    def so_far(self, start_s: float) -> Transients | None:
        """Return the rises as they would be if the spectrogram ended here.

        They begin at a time, s. Those that are not certain yet count in spreads of the
        stretch, and of what is known before it. None before the first block.
        """
        if not self._held:
            return None
        whole = _Cells.join(self._held)
        self._held = [whole]
        first = max(self._known, int(np.searchsorted(whole.time_s, start_s)))
        before = min(first, CONTEXT_FRAMES)
        near = whole.take(slice(first - before, None))
        searched = (before, near.time_s.size)
        found = _search(near, self._hop_s, searched, self._least_spreads, passes=True)
        return self._table([*self._since(start_s), *found])

    def _follow(self, blocks: Iterator[Spectrogram]) -> Iterator[Transients]:
        for block in blocks:
            self._hop_s, self._sensor = block.frames.hop_s, block.frames.sensor
            self._held.append(_cells(block))
            found = []
            while sum(part.time_s.size for part in self._held) - self._known >= (
                STRETCH_FRAMES + CONTEXT_FRAMES
            ):
                whole = _Cells.join(self._held)
                stop = self._known + STRETCH_FRAMES
                around = whole.take(slice(None, stop + CONTEXT_FRAMES))
                searched = (self._known, stop)
                found += _search(around, self._hop_s, searched, self._least_spreads)
                self._held = [whole.take(slice(stop - CONTEXT_FRAMES, None))]
                self._known = CONTEXT_FRAMES
            for rise in found:
                self._keep(rise[0], rise, float(self._held[-1].time_s[-1]))
            yield self._table(found)
        if self._held:
            whole = _Cells.join(self._held)
            searched = (self._known, whole.time_s.size)
            yield self._table(_search(whole, self._hop_s, searched, self._least_spreads))

    def _table(self, found: list[_Transient]) -> Transients:
        time_s, half_s, kind, spreads = zip(*found, strict=True) if found else ((),) * 4
        return Transients(
            time_s=np.array(time_s, float),
            half_length_s=np.array(half_s, float),
            kind=np.array(kind, np.str_),
            spreads=np.array(spreads, float),
            least_spreads=self._least_spreads,
            sensor=self._sensor,
        )


def _cells(block: Spectrogram) -> _Cells:
    """Measure the noise of the frames of a block, and what is above it."""
    power, frames = block.power_density, block.frames
    padding = frames.cells_per_bin
    n_bands = max(1, power.shape[1] // (BAND_BINS * padding))
    edges = np.linspace(0, power.shape[1], n_bands + 1).astype(np.int64)
    density = np.empty((power.shape[0], n_bands), np.float32)
    ratio = np.empty(power.shape, np.float16)
    for k, cells in enumerate(map(slice, edges[:-1], edges[1:])):
        part = power[:, cells]
        middle = part.shape[1] // 2
        density[:, k] = np.partition(part, middle, axis=1)[:, middle] / LN2
        # the tested cell is one of those behind the median: measured, noise exceeds
        # the factor 1.1 times as often as is stated
        bins = max(3.0, part.shape[1] / padding)
        factor = threshold_factor(CELL_PROBABILITY, round(bins, 1), 1 / bins)
        least = np.maximum(factor * density[:, k, None], 1e-37)
        ratio[:, cells] = np.minimum(part / least, LARGEST_RATIO)
    silent = (frames.valid_fraction < 0.5) | ~(density > 0).all(axis=1)
    density[silent] = np.nan
    ratio[silent] = 0.0
    lowest = float(block.frequency_hz[0]) / frames.bin_hz
    return _Cells(frames.time_s, density, ratio, edges, lowest)


def _search(
    held: _Cells, hop_s: float, searched: tuple[int, int], least_spreads: float,
    *, passes: bool = False,
) -> list[_Transient]:  # fmt: skip
    """Return middle, half length, kind and height of the rises of a stretch.

    A length of which plain means leave no doubt that none is there may be passed over:
    most of the work is to leave out the strongest frames of every one.
    """
    n_cells = held.ratio.shape[1]
    usual = CELL_PROBABILITY * n_cells
    noise_db = 10 / np.log(10) * np.sqrt(BIN_CORRELATION / n_cells)
    level_db, hits = _level_db(held.density), _hits(held)
    lines = np.bincount(hits.row, hits.strength, held.time_s.size).astype(np.float64)
    lines[~np.isfinite(held.density[:, 0])] = np.nan
    found = []
    for half in sorted({max(1, round(half_s / hop_s)) for half_s in HALF_LENGTHS_S}):
        half_s = half * hop_s
        middle, side = 2 * half + 1, (FLANK[1] - FLANK[0]) * half
        # of two sides the louder: its mean scatters by 0.68 of one's variance
        share = 1 / middle + 0.68 / side
        one_hit = np.sqrt(HIT_SQUARE * (usual * share + 1 / middle**2))
        noise = max(noise_db * np.sqrt(share), USUAL_LEVEL_DB)
        for kind, values, least in ((LEVEL, level_db, noise), (LINES, lines, one_hit)):
            limit = (least_spreads - LOWEST_MEDIAN) * least
            if passes and not highest(values, half, searched) > limit:
                continue
            height = heights(values, half, least)
            height[: searched[0]] = height[searched[1] :] = -np.inf
            reach = round(FLANK[1] * half)
            while height.size and height[top := int(np.argmax(height))] > least_spreads:
                middle_s = float(held.time_s[top])
                told = kind
                if kind == LINES:
                    told = _movement(hits, held.time_s, middle_s, half_s)
                found.append((middle_s, half_s, told, float(height[top])))
                height[max(0, top - reach) : top + reach + 1] = -np.inf
    return sorted(found)


def _level_db(density: FloatArray) -> FloatArray:
    """Return the level against the quiet frames of each sub-band, dB."""
    level_db = np.full(density.shape[0], np.nan)
    known = np.isfinite(density).all(axis=1)
    if known.any():
        quiet = np.quantile(density[known], QUIET_SHARE, axis=0)
        level_db[known] = 10 * np.log10((density[known] / quiet).mean(axis=1))
    return level_db


def _hits(held: _Cells) -> _Hits:
    """Return the cells of lines, in the order of the bands."""
    place = int(LOUD_SHARE * (held.ratio.shape[0] - 1))
    found = []
    for k, cells in enumerate(map(slice, held.edges[:-1], held.edges[1:])):
        ratio = held.ratio[:, cells]
        if not (ratio > 1.0).any():
            continue
        least = np.ones(ratio.shape, np.float32)
        # a cell must exceed what it usually has, over its band's noise and by itself
        gain = np.nan_to_num(held.density[:, k, None])
        for scale in (np.float32(1.0), np.maximum(gain, np.float32(1e-37))):
            own = ratio * scale
            usual = np.partition(own, place, axis=0)[place]
            with np.errstate(over="ignore"):  # frames without sound have no lines
                np.maximum(least, LOUD_FACTOR * usual / scale, out=least)
        row, cell = np.nonzero(ratio > least)
        over = ratio[row, cell] / least[row, cell]
        frequency = held.lowest + held.edges[k] + cell
        found.append((row, frequency, 1.0 + np.log(over.astype(np.float64))))
    if not found:
        return _Hits(np.empty(0, np.int64), np.empty(0), np.empty(0))
    return _Hits(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _movement(hits: _Hits, time_s: FloatArray, middle_s: float, half_s: float) -> str:
    """Tell whether the lines of a rise keep their frequencies, fall or climb."""
    fall = climb = 0.0
    for width_s in WIDTHS_S:
        reach_s = max(MOVED_WIDTHS * width_s, half_s)
        near = np.abs(time_s[hits.row] - middle_s) <= reach_s
        frequency, strength = hits.frequency[near], hits.strength[near]
        if not frequency.size:
            continue
        usual = _sharpness(frequency, strength)
        for place_s in middle_s + half_s * np.linspace(-1.0, 1.0, N_PLACES):
            lag = (time_s[hits.row[near]] - place_s) / width_s
            shift = -lag / np.hypot(1.0, lag)
            for mach in MACHS:
                down, up = (
                    _sharpness(frequency / (1.0 + sign * mach * shift), strength)
                    for sign in (1.0, -1.0)
                )
                fall, climb = max(fall, down / usual), max(climb, up / usual)
    if climb > max(fall, LEAST_CLIMB):
        return CLIMB
    return FALL if fall > LEAST_FALL else LINES


def _sharpness(frequency: FloatArray, strength: FloatArray) -> float:
    """Return the sum of squares of the strength in bands of two cells."""
    whole = np.floor(frequency).astype(np.int64)
    share = frequency - whole
    whole -= whole.min()
    total = np.bincount(whole, strength * (1.0 - share), int(whole.max()) + 2)
    total += np.bincount(whole + 1, strength * share, total.size)
    return float(((total[1:] + total[:-1]) ** 2).sum())


def heights(values: FloatArray, half: int, usual_spread: float) -> FloatArray:
    """Return how high each frame stands as the middle of a rise, in spreads.

    Values are nan where there is none; the half length is in frames. Such rises spread
    by ``usual_spread`` where nothing passes. Minus infinity where it is not known.
    """
    near, far = round(FLANK[0] * half), round(FLANK[1] * half)
    middle = _lasting(values, half)
    least = (far - near + 1) // 2
    before = _mean(values, -far, -near, least)
    after = _mean(values, near, far, least)
    rise = middle - np.fmax(before, after)  # at an end the other side tells
    known = np.isfinite(rise)
    if not known.any():
        return np.full(values.size, -np.inf)
    median = float(np.median(rise[known]))
    own = 1.4826 * float(np.median(np.abs(rise[known] - median)))
    lengths = np.count_nonzero(known) / (2 * far)
    weight = USUAL_WEIGHT / (USUAL_WEIGHT + lengths)
    spread = usual_spread**weight * max(own, usual_spread) ** (1 - weight)
    height: FloatArray = np.where(known, (rise - min(median, 0.0)) / spread, -np.inf)
    return height


def highest(values: FloatArray, half: int, searched: tuple[int, int]) -> float:
    """Return what no rise of a length exceeds: that of the mean of all its frames.

    As for `heights`, from the first frame in question to the one behind the last. In
    the unit of the values; minus infinity where none is known.
    """
    near, far = round(FLANK[0] * half), round(FLANK[1] * half)
    least = (far - near + 1) // 2
    sides = _mean(values, -far, -near, least), _mean(values, near, far, least)
    rise = (_mean(values, -half, half, 1) - np.fmax(*sides))[slice(*searched)]
    known = rise[np.isfinite(rise)]
    return float(known.max()) if known.size else -np.inf


def _lasting(values: FloatArray, half: int) -> FloatArray:
    """Return the mean of the frames about each one without the strongest; else nan."""
    length = 2 * half + 1
    middle = np.full(values.size, np.nan)
    if values.size >= length:
        around = np.lib.stride_tricks.sliding_window_view(values, length)
        kept = length - min(LEFT_OUT, half)
        middle[half : values.size - half] = np.partition(around, kept - 1, axis=1)[:, :kept].mean(
            axis=1
        )
    return middle


def _mean(values: FloatArray, first: int, last: int, least: int) -> FloatArray:
    """Return the mean over frames from one offset to another; nan where few are."""
    known = np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    place = np.arange(values.size)
    low = np.clip(place + first, 0, values.size)
    high = np.clip(place + last + 1, 0, values.size)
    number = count[high] - count[low]
    enough = number >= max(least, 1)
    mean: FloatArray = np.where(enough, (total[high] - total[low]) / np.maximum(number, 1), np.nan)
    return mean
