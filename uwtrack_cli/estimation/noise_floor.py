"""A robust noise density, and thresholds that keep a stated false-alarm rate.

**Method.** The density is the median over tiles of 16 frames by 16 natural bins, taken
again without the cells far above it, interpolated along frequency but for edges (steps of
some 8 dB and more are put where the cells change, if those are no slope) and long steep
slopes, such as those of a recorder's filter (their tiles are levelled before the median is
taken), times the gain of the single frame (the median ratio of its own block medians to
the tile's). Lines and short sounds move a median little, and
a vessel that passes moves the whole floor. Tiles are fixed in absolute frame index,
so how a recording is cut into blocks has no influence.

A threshold above an *estimated* floor is exceeded more often than above the true one.
For the median of n independent exponential cells the rate is known in closed form
(order-statistic CFAR, Rohling 1983, eq. 33), and is solved for the factor; neighbouring
cells are correlated, so n is the number of independent cells with the same variance.

**References.** Rohling 1983, "Radar CFAR thresholding in clutter"; Lancaster 1958 for
the expansion of correlated exponential variables in Laguerre polynomials.
"""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.window import cell_correlation

TILE_FRAMES = 16
"""Frames in a tile; blocks of a stream hold whole tiles, except the last."""

TILE_BINS = 16
"""Natural bins in a tile."""

CHUNK_VALUES = 1 << 18
"""Values of as many beams as are worked on at once: a megabyte stays in the cache."""

LN2 = float(np.log(2.0))

STIRLING_FROM = 10.0
"""Argument from which five terms of Stirling's series are exact to rounding."""

LEAST_SHARE = np.float32(1e-10)
"""Density over that of the loudest part of the frame below which there is no sound: no
recorder hears 100 dB beside its own band, and single precision rounds there."""

SMALLEST = np.float32(1e-37)
"""Density of silence."""

LINE_FACTOR = 3.0
"""Cells above this multiple of the mean noise are left out of it."""

KEPT_MEDIAN = -float(np.log((1.0 + np.exp(-LINE_FACTOR)) / 2.0))
"""Median of exponential cells below the line factor, over the mean of all."""

LEAST_AGAIN = 0.93
"""Part of the median that is left at least when lines have raised it."""

TRUNCATION_LOSS = 1.25
"""Variance of that median over the plain one's (measured on 1e7 cells of noise)."""

EDGE_STEP = 0.9
"""Step of the level from tile to tile, in nepers of power (4 dB), that is an edge and no
slope: neighbouring medians of even noise differ by less than a tenth."""

SPLIT_SHARE = 0.5
"""Deviations of the cells of a tile between two steps from the levels on either side, over
those from its own, below which an edge is within it: 0.2 to 0.5 for edges of 10 to 30 dB,
from 0.5 on where a horn and its overtones are, or the ground is steep (measured)."""

FEWEST_STEPS = 3
"""Such steps in a row, all up or all down, that are a steep slope: an edge makes two."""

LEVELLINGS = 2
"""How often the tiles of a slope are levelled by the slope that they tell."""

EDGE_BINS = 2
"""Natural bins by which a Hann window widens the loud side of an edge."""

BAND_BLOCKS = 5
"""Blocks of 16 natural bins in a band that may have a gain of its own."""

BAND_VARIANCE = 0.05
"""Variance of a band's gain in one frame of noise, nepers squared (measured)."""

OWN_GAIN = 3.0
"""Mean square of a band's gains over that variance from which they are its own."""

OWN_MARGIN = 0.2
"""Raise of a gain of its own, nepers: noise of variance s^2 in the floor lets noise pass
a threshold T as often as a floor lower by T s^2 / 2 does (T = 9.2 at 1e-4)."""

OWN_BINS = 2.3
"""Natural bins beside a high cell of noise that are high with it and raise its floor
(measured on 1e7 cells of noise; the main lobe of a Hann window is 4 bins wide)."""


def noise_floor(
    power_density: FloatArray, valid_fraction: FloatArray, *, zero_padding: int = 1
) -> FloatArray:
    """Estimate the noise density in every cell.

    Power density has the shape (frame, frequency), or (beam, frame, frequency) for
    beams of their own floors, and so has the result, float32; the first frame starts a
    tile. Frames whose share of valid samples is below one half are left out; nan where
    a tile has none other. Frames without any sound say nothing of the others of their
    tile, and have the density of silence.
    """
    floor = np.full(power_density.shape, np.nan, np.float32)
    n_frames, n_cells = power_density.shape[-2:]
    one = power_density.ndim == 2
    beams = power_density[None] if one else power_density
    floors = floor[None] if one else floor
    at_once = max(1, CHUNK_VALUES // (TILE_FRAMES * n_cells))
    for start in range(0, n_frames, TILE_FRAMES):
        valid = valid_fraction[start : start + TILE_FRAMES] >= 0.5
        tile = beams[:, start : start + TILE_FRAMES]
        sounds = valid & tile.any(axis=(0, 2))
        floors[:, start + np.flatnonzero(valid & ~sounds)] = SMALLEST
        rows = np.flatnonzero(sounds) + start
        if not rows.size:
            continue
        kept = slice(start, start + valid.size) if sounds.all() else rows
        for first in range(0, len(beams), at_once):
            chunk = slice(first, first + at_once)
            floors[chunk, kept] = _tile_floors(beams[chunk, kept], zero_padding)
    return floor


def _tile_floors(power: FloatArray, zero_padding: int) -> FloatArray:
    """Return the floors of one tile of every beam, shape (beam, frame, cell)."""
    n_cells = power.shape[2]
    width = min(TILE_BINS * zero_padding, n_cells)
    n_blocks = n_cells // width
    whole = power[..., : n_blocks * width]
    blocks = whole.reshape(*power.shape[:2], n_blocks, width)
    gain, margin = _frame_gain(blocks)
    steady = blocks / gain[..., None]
    tiles = steady.transpose(0, 2, 1, 3).reshape(len(power), n_blocks, -1)
    level = np.log(np.maximum(_noise_median(tiles), SMALLEST))
    centres = (np.arange(n_blocks) + 0.5) * width - 0.5
    shape = _interpolated(level, centres, n_cells)
    # cells beyond the last whole block have its gain
    last_width = n_cells - (n_blocks - 1) * width
    widths = np.append(np.full(n_blocks - 1, width), last_width)
    step = np.diff(level, axis=1)
    is_edge = np.abs(step) > EDGE_STEP
    for beam, first, last in _slopes(step):
        cells = steady[beam, :, first : last + 1]
        level[beam] = _levelled(cells, level[beam], centres, (first, last))
        shape[beam] = _interpolated(level[beam : beam + 1], centres, n_cells)[0]
        ground = np.arange(int(centres[first]) + 1.0, int(centres[last]) + 1.0)
        shape[beam, ground.astype(int)] = _through(level[beam], centres, ground)
        is_edge[beam, first:last] = False
    step = np.diff(level, axis=1)
    for beam, k in np.argwhere(is_edge):
        # a tile with an edge in it is part quiet: its loud neighbour knows better
        first, last, up = k, k + 1, step[beam]
        cell_gain = np.repeat(gain[beam], widths, axis=1)
        if up[k] < 0.0 and k > 0 and abs(up[k - 1]) < EDGE_STEP:
            first = k - 1
        if up[k] > 0.0 and k + 1 < up.size and abs(up[k + 1]) < EDGE_STEP:
            last = k + 2
        if k > 0 and abs(up[k - 1]) > EDGE_STEP and up[k - 1] * up[k] > 0.0:
            inside = slice(k * width, (k + 1) * width)
            cells = power[beam, :, inside] / cell_gain[:, inside]
            if _is_split(cells, *level[beam, k - 1 : k + 2]):
                first = k - 1
        left, right = level[beam, first : k + 1], level[beam, k + 1 : last + 1]
        # within a tile that is split, the outer one is right
        left = left.max() if up[k] < 0.0 else left[0]
        at = slice(int(centres[first]) + 1, int(centres[last]) + 1)
        shape[beam, at] = _edge(
            power[beam, :, at] / cell_gain[:, at], shape[beam, at],
            left, right.max(), EDGE_BINS * zero_padding,
        )  # fmt: skip
    shape += np.repeat(margin, widths, axis=1)
    floor: FloatArray = np.repeat(gain, widths, axis=2)
    floor *= (np.exp(shape) / LN2).astype(np.float32)[:, None]
    least = np.maximum(LEAST_SHARE * floor.max(axis=2, keepdims=True), SMALLEST)
    np.maximum(floor, least, out=floor)
    return floor


def _slopes(step: FloatArray) -> list[tuple[int, int, int]]:
    """Return beam, first and last tile of every steep slope."""
    sign = np.where(np.abs(step) > EDGE_STEP, np.sign(step), 0.0)
    found: list[tuple[int, int, int]] = []
    for beam in np.flatnonzero(np.count_nonzero(sign, axis=1) >= FEWEST_STEPS):
        bounds = np.flatnonzero(np.diff(sign[beam], prepend=0.0, append=0.0))
        for first, last in pairwise(bounds.tolist()):
            if sign[beam, first] and last - first >= FEWEST_STEPS:
                found.append((int(beam), first, last))
    return found


def _levelled(
    cells: FloatArray, level: FloatArray, centres: FloatArray, ends: tuple[int, int]
) -> FloatArray:
    """Return the levels of the tiles with those of a slope taken from levelled cells.

    The cells are those of the slope's tiles, shape (frame, tile, cell). On a slope the
    lower cells of a tile are all that is not far above its median.
    """
    own = slice(ends[0], ends[1] + 1)
    found = level.astype(np.float64)
    tiles = cells.transpose(1, 0, 2)
    usual = _median(tiles.reshape(len(tiles), -1))
    # below that is no sound, and a slope into silence has no end
    least = max(level.max() + np.log(LEAST_SHARE), np.log(SMALLEST))
    plain = np.maximum(np.log(np.maximum(usual, SMALLEST)), least)
    found[own] = plain
    width = cells.shape[2]
    place = centres[own, None] + np.arange(width) - 0.5 * (width - 1)
    for _ in range(LEVELLINGS):
        ground = _through(found, centres, place)
        flat = tiles * np.exp(-ground).astype(np.float32)[:, None]
        rest = _noise_median(flat.reshape(len(flat), -1))
        found[own] += np.log(np.maximum(rest, SMALLEST))
        found[own] = np.maximum(found[own], least)
    # how steep the ground is beyond the outer tiles is not known: what is levelled too
    # little there draws the median down, and the plain one is that of the tile's middle
    if ends[0] == 0:
        found[0] = max(found[0], plain[0])
    if ends[1] == level.size - 1:
        found[-1] = max(found[-1], plain[-1])
    return found


def _through(level: FloatArray, centres: FloatArray, place: FloatArray) -> FloatArray:
    """Interpolate the levels of a slope to places; beyond it the outer slope goes on.

    Filters fall ever faster: between two tiles the ground bulges over the straight line
    by an eighth of its second difference, of which the greater is taken. It is not
    known beyond the outer tiles, and taken twice there.
    """
    left = np.clip(np.searchsorted(centres, place, "right") - 1, 0, centres.size - 2)
    share = (place - centres[left]) / (centres[left + 1] - centres[left])
    bend = np.minimum(np.diff(level, 2), 0.0)
    bend = np.concatenate([2.0 * bend[:1], bend, 2.0 * bend[-1:]])
    bulge = np.minimum(bend[left], bend[left + 1]) * np.maximum(share * (1 - share), 0.0)
    through: FloatArray = level[left] + (level[left + 1] - level[left]) * share - 0.5 * bulge
    return through


def _interpolated(level: FloatArray, centres: FloatArray, n_cells: int) -> FloatArray:
    """Interpolate the levels of blocks to cells, constant beyond the outer centres."""
    if centres.size == 1:
        return np.repeat(level.astype(np.float64), n_cells, axis=1)
    level = level.astype(np.float64)
    cell = np.clip(np.arange(n_cells), centres[0], centres[-1])
    left = np.clip(np.searchsorted(centres, cell, "right") - 1, 0, centres.size - 2)
    slope = np.diff(level, axis=1) / np.diff(centres)
    return slope[:, left] * (cell - centres[left]) + level[:, left]


def _frame_gain(blocks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how loud each frame is in each block, and what to raise a block by.

    The gains are about one, shape (beam, frame, block); the raise is in nepers, shape
    (beam, block).

    All blocks of a frame share a gain. Where the bands of a tile leave it by more than
    the medians of noise do, each has a gain of its own, less what noise makes of it
    (James and Stein 1961).
    """
    usual = _median(blocks)
    typical = np.maximum(_median(usual.transpose(0, 2, 1)), SMALLEST)
    lag = np.log(np.maximum(usual / typical[:, None], SMALLEST))
    common = _median(lag)[..., None]
    if blocks.shape[2] < BAND_BLOCKS:
        gain = np.exp(np.broadcast_to(common, lag.shape))
        return gain, np.zeros((len(lag), lag.shape[2]))
    own = _running_median(lag - common)
    spread = np.maximum((own**2).mean(axis=1), 1e-9)
    share = np.where(spread > OWN_GAIN * BAND_VARIANCE, 1 - BAND_VARIANCE / spread, 0.0)
    gain = np.exp(common + share.astype(np.float32)[:, None] * own)
    return gain, OWN_MARGIN * share


def _running_median(values: FloatArray) -> FloatArray:
    """Return the median of each block and the two on either side of it.

    Nine comparisons of whole arrays find the median of five, in a quarter of the time
    that sorting every five takes.
    """
    padded = np.pad(values, ((0, 0), (0, 0), (BAND_BLOCKS // 2,) * 2), mode="edge")
    n = values.shape[2]
    a, b, c, d, e = (padded[..., k : k + n] for k in range(BAND_BLOCKS))
    a, b = np.minimum(a, b), np.maximum(a, b)
    d, e = np.minimum(d, e), np.maximum(d, e)
    low, high = np.maximum(a, d), np.minimum(b, e)  # least and greatest are out
    return np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c))


def _edge(
    power: FloatArray, slope: FloatArray, left: float, right: float, margin: int
) -> FloatArray:
    """Place a step between two levels where most cells on either side agree with it.

    Interpolated, a step would leave loud noise above the floor beside it. A line
    spoils few cells and hardly moves the step; the loud side gets a margin, for a
    window leaks. Steep ground stays a slope: a step that is farther from the cells than
    the interpolation is none.
    """
    usual = np.log(np.maximum(_median(power.T), SMALLEST))
    votes = np.sign(0.5 * (left + right) - usual) * np.sign(right - left)
    score = np.cumsum(np.append(0.0, votes))
    split, cell = int(np.argmax(score)), np.arange(votes.size)
    step = np.where(cell < split, left, right)
    if np.abs(usual - step).sum() > np.abs(usual - slope).sum():
        return slope
    return np.where(cell < split + (margin if left > right else -margin), left, right)


def _is_split(power: FloatArray, before: float, own: float, after: float) -> bool:
    """Tell whether the tile between two steps is part one side and part the other.

    Else it is a stair or a slope: then its cells are nearer to its own level.
    """
    usual = np.log(np.maximum(_median(power.T), SMALLEST))
    off = np.abs(usual - before) - np.abs(usual - after)
    as_split = np.abs(usual - after).sum() + np.append(0.0, np.cumsum(off)).min()
    return bool(as_split < SPLIT_SHARE * np.abs(usual - own).sum())


def _noise_median(values: FloatArray) -> FloatArray:
    """Median along the last axis of what is left without the cells far above it.

    Lines, and the few strongest cells of the noise itself, which could otherwise
    raise the floor under themselves, are left out; what that does to the median of
    exponential noise is undone.
    """
    ordered = np.sort(values, axis=-1)
    first = _kept_median(ordered, ordered[..., values.shape[-1] // 2])
    # lines that fill a part of the cells raise the first median, and what it keeps;
    # an edge within the cells moves it further
    again = _kept_median(ordered, first)
    return np.where(again > LEAST_AGAIN * first, again, first)


def _kept_median(ordered: FloatArray, typical: FloatArray) -> FloatArray:
    kept = np.sum(ordered <= LINE_FACTOR / LN2 * typical[..., None], axis=-1)
    median = np.take_along_axis(ordered, kept[..., None] // 2, axis=-1)[..., 0]
    return median * np.float32(LN2 / KEPT_MEDIAN)


def _median(values: FloatArray) -> FloatArray:
    # for such short rows numpy sorts faster than it partitions
    return np.sort(values, axis=-1)[..., values.shape[-1] // 2]


def independent_cells(
    n_frames: int, n_cells: int, *, zero_padding: int, hop_windows: float
) -> float:
    """Return how many independent cells a tile's floor is worth.

    Of so many frames in the tile and cells in the whole spectrum, the zero padding, and
    the distance of two frames in window lengths.

    Notes
    -----
    The floor is a median over the tile times the frame's gain, a median over the
    whole spectrum of one frame (1.57 is pi/2, the variance of a median of medians);
    their variances add. Between two tiles the interpolation averages, which leaves
    2/3 of the variance.
    """
    along_frequency = _correlation_sum(1.0 / zero_padding, 0.0)
    along_time = _correlation_sum(0.0, hop_windows)
    width = min(TILE_BINS * zero_padding, n_cells)
    averaged = 1.5 if n_cells >= 2 * width else 1.0
    tile = averaged * n_frames * width / (along_frequency * along_time)
    tile /= TRUNCATION_LOSS
    frame = n_cells / (along_frequency * 1.57)
    return 1.0 / (1.0 / tile + 1.0 / frame)


@lru_cache(maxsize=32)
def _correlation_sum(step_bins: float, step_windows: float) -> float:
    """Sum the correlations of "the cell is below the median" over all lags."""
    total = 1.0
    for lag in range(1, 8):
        squared = cell_correlation(lag * step_bins, lag * step_windows)
        total += 2.0 * 4.0 * _median_covariance(squared)
    return total


def _median_covariance(squared_correlation: float) -> float:
    """Covariance of two indicators of exponential cells (Lancaster 1958).

    sum_k c^k [m e^-m L_(k-1)^(1)(m) / k]^2 with m = ln 2.
    """
    m, total = LN2, 0.0
    before, now = 0.0, 1.0  # associated Laguerre polynomials of order 1
    for k in range(1, 60):
        total += squared_correlation**k * (m * np.exp(-m) * now / k) ** 2
        before, now = now, ((2 * k - m) * now - k * before) / k
    return float(total)


@lru_cache(maxsize=256)
def threshold_factor(probability: float, n_independent: float, own_share: float = 0.0) -> float:
    """Return the power over the estimated floor that noise exceeds so often.

    Behind the floor are so many independent cells (`independent_cells`), of which a
    share is high when the tested one is.

    Notes
    -----
    Solves prod_(j<k) (n-j)/(n-j+a) = P (Rohling 1983, eq. 33) at the median,
    k = (n+1)/2, with gamma functions so that n need not be whole. A share s of cells that
    are high together with the tested one shifts the rank of the median, and so raises
    the floor by s / ln 2.
    """
    n, rest = n_independent + 1.0, (n_independent + 1.0) / 2.0
    a = -math.log(probability)
    for _ in range(100):  # Newton's method; the rate falls, ever more slowly, with a
        excess = _log_rising(rest, a) - _log_rising(n, a) - math.log(probability)
        step = excess / (_digamma(n + a) - _digamma(rest + a))
        a += step
        if abs(step) < 1e-14 * a:
            break
    return a * LN2 * (1.0 - own_share / LN2)


def _log_rising(x: float, a: float) -> float:
    """Return ln Gamma(x + a) - ln Gamma(x), without the loss of a difference."""
    if x < STIRLING_FROM:
        return math.lgamma(x + a) - math.lgamma(x)
    rest = _stirling_rest(x + a) - _stirling_rest(x)
    return a * math.log(x + a) + (x - 0.5) * math.log1p(a / x) - a + rest


def _stirling_rest(x: float) -> float:
    """Return what Stirling's formula of ln Gamma leaves (Abramowitz 1964, 6.1.41)."""
    terms = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188)
    return sum(term / x ** (2 * k + 1) for k, term in enumerate(terms))


def _digamma(x: float) -> float:
    """Return the slope of ln Gamma to a hundredth, enough for a search (6.3.18)."""
    return math.log(x) - 0.5 / x - 1.0 / (12.0 * x**2)


def own_share(n_frames: int) -> float:
    """Return the share of a tile's cells that are high when one of them is."""
    return OWN_BINS / (n_frames * TILE_BINS)
