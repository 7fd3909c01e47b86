"""Broadband level and bearing of each frame, between the lines.

**Method.** The band is cut into sub-bands. In each frame and sub-band, cells far above
the sub-band's own median are lines and left out. What remains is divided by a
quiet-time density (the lowest of the tile medians within half an hour either way), so
that every sub-band weighs as its noise is known, and averaged: the excess. A sub-band
weighs as many cells as fill it, of which a filter's edge leaves few, and nothing where
there is no more than the recorder's own noise, as beyond its anti-alias filter: what
passes is not heard there. For a vector sensor the whitened intensity gives the bearing,
and its scatter across the line of sight gives the deviation. Ambient sound that comes
from somewhere (surf, a harbour) would draw the bearing of a weak vessel towards itself:
its intensity is taken off, where it was the same in the quiet time before and after.
(The quiet time of a single passage holds the vessel itself, faintly; taken off, it would
turn every bearing.)

**Conventions.** Excess in dB above the quiet time; level in dB re the reference over
the whole band. Tiles count absolute frames, so blocks have no influence.

**References.** Choi et al. 2014 (level envelope of a proximity sensor); D'Spain et al.
1991 (active intensity).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from uwtrack_cli.data.base import Container, FloatArray, column, scalar
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.spectra import Levels, Spectrogram
from uwtrack_cli.data.streams import RememberedStream
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.angles import compass_deg
from uwtrack_cli.estimation.noise_floor import LEAST_SHARE, LN2
from uwtrack_cli.estimation.window import BIN_CORRELATION

TILE_FRAMES = 64
"""Frames whose median makes one quiet-time value."""

REACH_TILES = 56
"""Tiles on either side among which the quietest one is sought."""

QUIET_S = 60.0
"""Time that must be as quiet as the quietest tile, before and again after, for the
ambient's direction to be known."""

SAME_AMBIENT = 0.3
"""Difference of the intensity before from that after, as a share of their mean, up to
which both are the ambient's: a vessel that is still heard in the quiet time lies in
another direction after it has passed. Errors are the same from 0.03 to 10, and for 15 to
120 s of quiet (studies/constants/ambient.py)."""

QUIET_SPREAD = 1.12
"""Level above the quietest tile within which a tile is as quiet (0.5 dB)."""

OWN_SHARE = 1e-4
"""Density of the recorder's own noise over that of the loudest sub-band, at most: ambient
noise falls by less in the usual band, 40 dB, which are 10 dB an octave."""

N_PARTS = 8
"""Parts of the band whose levels are kept, of some sub-bands each."""

LINE_FACTOR = 5.0
"""Cells above this multiple of the sub-band's mean are lines."""

KEPT_MEAN = 1.0 - LINE_FACTOR / (np.exp(LINE_FACTOR) - 1.0)
"""Mean of exponential cells below the line factor, over the mean of all."""

EVEN_SQUARE = (2.0 - 37.0 * np.exp(-LINE_FACTOR)) / (1.0 - np.exp(-LINE_FACTOR)) / KEPT_MEAN**2
"""Mean square of these cells, over the square of their mean."""


@checked
def measure_levels(
    blocks: Iterator[Spectrogram],
    *,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()] = (
        100.0,
        1500.0,
    ),
    n_bands: Annotated[int, AtLeast(1), AtMost(256)] = 16,
) -> Iterator[Levels]:
    """Measure the broadband level and bearing of each frame between the lines.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram.
    band_hz
        Lowest and highest frequency used, Hz; cut to what the spectrogram holds.
    n_bands
        Number of sub-bands that are whitened one by one.

    Returns
    -------
    Iterator[Levels]
        One block per block read, and the frames that waited for a quiet time at last.

    Raises
    ------
    OptionError
        The band holds too few cells, or an option is out of range.

    Notes
    -----
    Cells below c times their mean have 1 - c / (e^c - 1) of it: levels are corrected.
    The excess deviates by 4.34 dB over the root of the number of independent cells.
    """
    return MeasuredLevels(blocks, band_hz, n_bands)


class MeasuredLevels(RememberedStream[Levels, Levels]):
    """The levels of a stream of spectrograms, measured while they come.

    Parameters
    ----------
    blocks
        Blocks of a spectrogram, or of what `condense` made of them.
    band_hz, n_bands
        Options of `measure_levels`.

    Raises
    ------
    OptionError
        The band holds too few cells.
    """

    def __init__(
        self, blocks: Iterator[Spectrogram], band_hz: tuple[float, float], n_bands: int
    ) -> None:
        self._waiting: list[_Bands] = []
        self._quiet: list[_TileSound] = []
        self._rest: _Bands | None = None
        # place of the first waiting tile among the quiet times that are held
        self._at = 0
        super().__init__(self._follow(blocks, band_hz, n_bands))

    def so_far(self, start_s: float) -> Levels | None:
        """Return the levels as they would be if the spectrogram ended here.

        They begin with the first tile that reaches beyond a time, s; None before the
        first block.
        """
        if self._rest is None:
            return None
        past = self._since(start_s)
        held = [*self._waiting, self._rest]
        late = [
            k for k, tile in enumerate(held)
            if tile.frames.n_frames and tile.frames.time_s[-1] >= start_s
        ]  # fmt: skip
        first = late[0] if late else len(held) - 1
        rest = self._held_levels(self._rest, first)
        return Levels.join([*past, rest]) if past else rest

    def _follow(
        self, blocks: Iterator[Spectrogram], band_hz: tuple[float, float], n_bands: int
    ) -> Iterator[Levels]:
        for block in blocks:
            cut = _condensed(block, band_hz, n_bands)
            rest = cut if self._rest is None else _Bands.join([self._rest, cut])
            n_whole = rest.frames.n_frames // TILE_FRAMES
            for k in range(n_whole):
                self._waiting.append(rest.take("frame", _rows(k)))
                self._quiet.append(_tile_sound(self._waiting[-1]))
            rest = rest.take("frame", slice(n_whole * TILE_FRAMES, None))
            self._rest = rest
            n_ready = max(0, len(self._quiet) - REACH_TILES - self._at)
            made = _levels(self._waiting[:n_ready], self._quiet, self._at, rest)
            self._waiting = self._waiting[n_ready:]
            n_past = max(0, self._at + n_ready - REACH_TILES)
            self._at += n_ready - n_past
            self._quiet = self._quiet[n_past:]
            if made.frames.n_frames:
                now_s = float(made.frames.time_s[-1])
                self._keep(now_s, made, now_s)
            yield made
        if self._rest is not None:
            yield self._held_levels(self._rest, 0)

    def _held_levels(self, rest: "_Bands", first: int) -> Levels:
        """Return the levels of the tiles that wait from one on, and of the rest."""
        quiet = list(self._quiet)
        if rest.frames.n_frames >= TILE_FRAMES // 4 or not quiet:
            quiet.append(_tile_sound(rest))
        else:
            quiet.append(_TileSound.unknown(rest.density.shape[1]))
        tiles = [*self._waiting[first:], rest]
        return _levels(tiles, quiet, self._at + first, rest.take("frame", slice(0)))


def condense(block: Spectrogram, *, band_hz: tuple[float, float], n_bands: int) -> Container:
    """Return what `measure_levels` needs of a block, and takes in its place.

    Means of sub-bands, some hundred times smaller. Options as those of
    `measure_levels`.
    """
    return _measure(block, band_hz, n_bands)


@dataclass(frozen=True)
class WhitenedFrames:
    """Power and intensity of each frame, every sub-band over its quiet density."""

    time_s: FloatArray
    """Centre of each frame, s from the first sample, shape (frame,)."""
    power: FloatArray
    """Mean over the band, 1 in the quiet time, shape (frame,); nan without sound."""
    intensity: FloatArray
    """Along the first and the second dipole, in the same unit, shape (frame, 2)."""
    n_cells: FloatArray
    """Independent cells of each frame, shape (frame,)."""


def whiten_frames(
    blocks: Iterator[Spectrogram], *, band_hz: tuple[float, float], n_bands: int
) -> WhitenedFrames:
    """Return power and intensity between the lines of a recording of a vector sensor.

    Options as those of `measure_levels`.

    Raises
    ------
    OptionError
        The band holds too few cells.
    """
    bands = _Bands.join([_measure(block, band_hz, n_bands) for block in blocks])
    tiles = range(-(-bands.frames.n_frames // TILE_FRAMES))
    quiet = [_tile_sound(bands.take("frame", _rows(k))) for k in tiles]
    noise, share = _quiet_time(quiet)
    weight = share / noise
    heard = bands.frames.valid_fraction == 1.0
    return WhitenedFrames(
        time_s=bands.frames.time_s,
        power=np.where(heard, (weight * bands.density).sum(axis=1), np.nan),
        # cells above the line factor are left out of the density as of the intensity,
        # but only the former is raised by what they would have added
        intensity=(weight[:, None] * bands.intensity).sum(axis=1) / KEPT_MEAN,
        n_cells=bands.n_cells.sum(axis=1),
    )


def _condensed(block: Container, band_hz: tuple[float, float], n_bands: int) -> "_Bands":
    if isinstance(block, Spectrogram):
        return _measure(block, band_hz, n_bands)
    assert isinstance(block, _Bands)  # noqa: S101 - made by `condense`
    return block


def _rows(tile: int) -> slice:
    return slice(tile * TILE_FRAMES, (tile + 1) * TILE_FRAMES)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Bands(Container):
    """Means over the cells of each sub-band that are not lines."""

    ROW = "band"
    FIXED_AXES = ("band",)

    frames: Frames
    """Time base."""
    low_hz: FloatArray = column("Lower edge.")
    high_hz: FloatArray = column("Upper edge.")
    density: FloatArray = column("Mean power density.", "frame", "band", unit="")
    n_cells: FloatArray = column("Independent cells.", "frame", "band", unit="")
    n_filled: FloatArray = column(
        "As many cells of one density as vary like those that there are.", "frame", "band", unit=""
    )
    intensity: FloatArray = column("Mean east, north.", "frame", "band", "axis", unit="")
    square: FloatArray = column(
        "Mean east^2, north^2, east north.", "frame", "band", "moment", unit=""
    )
    reference: str = scalar("Level reference.")


def _measure(block: Spectrogram, band_hz: tuple[float, float], n_bands: int) -> _Bands:
    frequency_hz = block.frequency_hz
    edges = _edges(frequency_hz, band_hz, n_bands)
    padding = block.frames.fft_length / block.frames.window_samples
    shape = (block.frames.n_frames, edges.size - 1)
    density, n_cells, n_filled = np.empty((3, *shape))
    intensity, moments = np.full((*shape, 2), np.nan), np.full((*shape, 3), np.nan)
    for k, cells in enumerate(map(slice, edges[:-1], edges[1:])):
        power = block.power_density[:, cells]
        kept = power <= _median(power) * np.float32(LINE_FACTOR / LN2)
        count = np.maximum(kept.sum(axis=1), 1)
        quiet = power * kept
        mean = quiet.sum(axis=1) / count
        density[:, k] = mean / KEPT_MEAN
        n_cells[:, k] = np.maximum(count / (padding * BIN_CORRELATION), 1.0)
        # cells of one density have a known mean square
        quiet /= np.where(mean > 0.0, mean, np.float32(1.0))[:, None]
        square = np.maximum((quiet**2).sum(axis=1) / count, EVEN_SQUARE)
        n_filled[:, k] = n_cells[:, k] * EVEN_SQUARE / square
        if block.intensity_east is not None and block.intensity_north is not None:
            east = block.intensity_east[:, cells] * kept
            north = block.intensity_north[:, cells] * kept
            for j, part in enumerate((east, north)):
                intensity[:, k, j] = part.sum(axis=1) / count
            for j, part in enumerate((east * east, north * north, east * north)):
                moments[:, k, j] = part.sum(axis=1) / count
    return _Bands(
        frames=block.frames,
        low_hz=frequency_hz[edges[:-1]],
        high_hz=frequency_hz[edges[1:] - 1],
        density=density,
        n_cells=n_cells,
        n_filled=n_filled,
        intensity=intensity,
        square=moments,
        reference=block.reference,
    )


def _edges(frequency_hz: FloatArray, band_hz: tuple[float, float], n_bands: int) -> FloatArray:
    low, high = np.searchsorted(frequency_hz, band_hz)
    if high - low < 16:
        raise OptionError(
            f"band_hz = {band_hz[0]:g} {band_hz[1]:g} holds {max(high - low, 0)} cells "
            f"of the spectrogram, which reaches {frequency_hz[0]:g} to "
            f"{frequency_hz[-1]:g} Hz; at least 16 are needed."
        )
    n_bands = min(n_bands, int(high - low) // 16)
    return np.linspace(low, high, n_bands + 1).astype(np.int64)


def _median(power: FloatArray) -> FloatArray:
    middle = power.shape[1] // 2
    return np.partition(power, middle, axis=1)[:, middle, None]


@dataclass(frozen=True, eq=False)
class _TileSound:
    """What a tile of frames holds on the whole."""

    density: FloatArray
    """Median density per sub-band, shape (band,); nan without sound."""
    n_filled: FloatArray
    """Mean number of cells that fill each sub-band, shape (band,)."""
    intensity: FloatArray
    """Mean intensity, shape (band, 2)."""

    @classmethod
    def unknown(cls, n_bands: int) -> "_TileSound":
        """Return that of a tile without sound."""
        nothing = np.full(n_bands, np.nan)
        return cls(nothing, nothing, np.zeros((n_bands, 2)))


def _tile_sound(tile: _Bands) -> _TileSound:
    """Return median density and mean intensity over the frames with sound."""
    has_sound = (tile.frames.valid_fraction > 0.5) & (tile.density > 0).all(axis=1)
    if not has_sound.any():
        return _TileSound.unknown(tile.density.shape[1])
    return _TileSound(
        np.median(tile.density[has_sound], axis=0),
        tile.n_filled[has_sound].mean(axis=0),
        tile.intensity[has_sound].mean(axis=0),
    )


def _levels(tiles: list[_Bands], quiet: list[_TileSound], at: int, pattern: _Bands) -> Levels:
    """Turn whole tiles into levels; without any, a block of no rows.

    The first tile's own sound is at a place in the list; before it are those within
    reach, as far as there were any.
    """
    parts = []
    for k, tile in enumerate(tiles, start=at):
        near = quiet[max(0, k - REACH_TILES) : k + REACH_TILES + 1]
        noise, share = _quiet_time(near)
        tile_s = TILE_FRAMES * tile.frames.hop_s
        here = min(k, REACH_TILES)
        ambient = _ambient(near, here, share / noise, tile_s)
        parts.append(_tile_levels(tile, noise, share, ambient))
    if not parts:
        empty = pattern.take("frame", slice(0))
        n_bands = empty.density.shape[1]
        unknown = np.full(n_bands, np.nan)
        return _tile_levels(empty, unknown, unknown, np.zeros((n_bands, 2)))
    return Levels.join(parts)


def _quiet_time(near: list[_TileSound]) -> tuple[FloatArray, FloatArray]:
    """Return the quiet density of each sub-band and its share, both shape (band,).

    The shares are those of the cells that fill them, less what the recorder's own noise
    is of the quiet density: what passes adds to the rest alone. The recorder's noise is
    white, so it is at most that of the quietest sub-band, and far below the loudest.
    Both are nan where no tile has sound.
    """
    known = [one for one in near if np.isfinite(one.density).all()] or near[:1]
    noise = np.min([one.density for one in known], axis=0)
    loudest = noise.max()
    own = 1.0 / (1.0 / noise.min() + 1.0 / (OWN_SHARE * loudest))
    heard = np.maximum(1.0 - np.maximum(own, LEAST_SHARE * loudest) / noise, 0.0)
    share = np.mean([one.n_filled for one in known], axis=0) * heard
    return noise, np.asarray(share / share.sum())


def _ambient(near: list[_TileSound], here: int, weight: FloatArray, tile_s: float) -> FloatArray:
    """Return the intensity to take off a tile, shape (band, 2); zero if not known.

    Nothing is taken off a quiet tile: its bearing is that of what is heard then. It is
    one of those near, and lasts some seconds; weights are the shares of the sub-bands
    over their quiet density, shape (band,).
    """
    if not np.isfinite(near[0].intensity).all():  # no directions
        return np.zeros((weight.size, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.array([(one.density * weight).sum() for one in near])
    lowest = np.nanmin(level) if np.isfinite(level).any() else np.nan
    is_quiet = level <= QUIET_SPREAD * lowest
    sides = is_quiet[:here], is_quiet[here + 1 :]
    if is_quiet[here] or min(map(np.count_nonzero, sides)) * tile_s < QUIET_S:
        return np.zeros((weight.size, 2))
    intensity = np.array([one.intensity for one in near])
    before = intensity[:here][sides[0]].mean(axis=0)
    after = intensity[here + 1 :][sides[1]].mean(axis=0)
    mean = 0.5 * (before + after)
    apart, whole = (
        float(np.hypot(*(each * weight[:, None]).sum(axis=0))) for each in (before - after, mean)
    )
    return mean if apart < SAME_AMBIENT * whole else np.zeros((weight.size, 2))


def _tile_levels(tile: _Bands, noise: FloatArray, share: FloatArray, ambient: FloatArray) -> Levels:
    width_hz = tile.high_hz - tile.low_hz + tile.frames.bin_hz
    ratio = tile.density / noise
    mean = (share * ratio).sum(axis=1)
    variance = (share**2 * ratio**2 / tile.n_filled).sum(axis=1)
    bearing_deg, bearing_std_deg = _bearing(tile, share / noise, ambient)
    silent = (tile.frames.valid_fraction < 0.5) | ~(mean > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        level_db = 10 * np.log10((width_hz * tile.density).sum(axis=1))
        excess_db = 10 * np.log10(mean)
        excess_std_db = 10 / np.log(10) * np.sqrt(variance) / mean
        n_bands = ratio.shape[1]
        upper, lowest = ratio[:, n_bands // 2 :], ratio[:, : max(1, n_bands // 4)]
        tilt_db = 10 * np.log10(upper.mean(axis=1) / lowest.mean(axis=1))
        edges = np.linspace(0, n_bands, min(N_PARTS, n_bands) + 1).astype(np.int64)
        parts = [ratio[:, a:b].mean(axis=1) for a, b in pairwise(edges)]
        part_excess_db = 10 * np.log10(np.stack(parts, axis=1))
    columns = {
        "level_db": level_db,
        "excess_db": excess_db,
        "excess_std_db": excess_std_db,
        "tilt_db": tilt_db,
        "bearing_deg": bearing_deg,
        "bearing_std_deg": bearing_std_deg,
    }
    return Levels(
        frames=tile.frames,
        **{name: np.where(silent, np.nan, values) for name, values in columns.items()},
        part_excess_db=np.where(silent[:, None], np.nan, part_excess_db),
        band_low_hz=float(tile.low_hz[0]),
        band_high_hz=float(tile.high_hz[-1]),
        reference=tile.reference,
    )


def _bearing(
    tile: _Bands, weight: FloatArray, ambient: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bearing of what the intensity has above the ambient's; transverse deviation."""
    east, north = ((tile.intensity - ambient) * weight[:, None]).sum(axis=1).T
    bearing = np.arctan2(east, north)
    cos, sin = np.cos(bearing)[:, None], np.sin(bearing)[:, None]
    east2, north2, product = np.moveaxis(tile.square, 2, 0)
    scatter = cos**2 * east2 + sin**2 * north2 - 2 * cos * sin * product
    variance = (weight**2 * np.maximum(scatter, 0.0) / tile.n_cells).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.sqrt(variance) / np.hypot(east, north)
    return compass_deg(east, north), np.degrees(np.minimum(std, 1.8))
