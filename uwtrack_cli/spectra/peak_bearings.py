"""Bearings of spectral peaks, freed of the directional background beneath them.

**Method.** The noise in the cells of a peak comes from somewhere: surf, a harbour,
another vessel's broadband. Two things draw the bearing of a line there. The mean
intensity of that noise adds to the line's; and a weak line is seen in the frames in
which the noise happens to add to it, so that the noise that is seen with it is more
than its mean, and tells its own direction. Both are gone where the dipoles are freed
of what the omni channel foretells of their noise: with b its covariance with the omni
channel over the omni channel's noise power, D - b O holds noise that O knows nothing
of, whatever O was selected for. O* (D - b O) is then p (u - b) in the mean, u the unit
vector to the source and p the line's own share of the power, that follows from |u| = 1.
b is the mean intensity over the cells of the noise floor's tile that are not lines.

**Conventions.** Compass degrees. The noise of a dipole channel that the omni channel
does not foretell is N (1 - |b|) (k 1 + b b' / |b|) with k the dipole noise ratio of
isotropic noise: the directed part comes from one direction, the rest from all.

**References.** D'Spain et al. (1991), J. Acoust. Soc. Am. 89, 1134 (active intensity);
T. W. Anderson, An Introduction to Multivariate Statistical Analysis (2003), section 2.5
(what of one Gaussian variable another one foretells).
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import compass_deg
from uwtrack_cli.estimation.noise_floor import TILE_BINS, TILE_FRAMES
from uwtrack_cli.estimation.window import cell_correlation, response

LINE_FACTOR = 5.0
"""Cells above this multiple of the noise are lines and no background."""

KEPT_MEAN = 1.0 - LINE_FACTOR / (np.exp(LINE_FACTOR) - 1.0)
"""Mean of exponential cells below the line factor, over the mean of all."""

LOBE_BINS = 2
"""Natural bins to which a line spreads on either side."""

MOST_DIRECTED = 0.95
"""Largest length of b: it is known from a tile to some hundredths only."""

LEAST_SQUARE = 1e-3
"""Least z^2, for deviations that are finite."""

TINY = 1e-300
"""Divisor in place of zero."""

LARGEST_STD_RAD = 1.8
"""Deviation of a bearing that tells nothing."""


def background_intensity(
    parts: tuple[FloatArray, FloatArray],
    power: FloatArray,
    floor: FloatArray,
    row: IntArray,
    cell: IntArray,
    *,
    zero_padding: int = 1,
) -> FloatArray:
    """Return the intensity of the background at some cells.

    Parameters
    ----------
    parts
        Intensity to the east and to the north, shape (frame, frequency).
    power, floor
        Power density and noise density, same shape; the first frame starts a tile.
    row, cell
        Where it is wanted, shape (n,).
    zero_padding
        Cells per natural bin.

    Returns
    -------
    FloatArray
        East and north, shape (2, n), in units of the power density.
    """
    step = max(1, zero_padding)
    n_bins = power.shape[1] // step
    width = min(TILE_BINS, n_bins)
    n_blocks = n_bins // width
    used = slice(0, n_blocks * width * step, step)
    n_tiles = -(-power.shape[0] // TILE_FRAMES)
    mean = np.zeros((2, n_tiles, n_blocks))
    for tile in range(n_tiles):
        frames = slice(tile * TILE_FRAMES, (tile + 1) * TILE_FRAMES)
        kept = _between_lines(power[frames, used], floor[frames, used])
        shape = (kept.shape[0], n_blocks, width)
        count = np.maximum(kept.reshape(shape).sum(axis=(0, 2)), 1) * KEPT_MEAN
        for axis, part in enumerate(parts):
            quiet = np.where(kept, part[frames, used], np.float32(0.0))
            mean[axis, tile] = quiet.reshape(shape).sum(axis=(0, 2)) / count
    place = np.clip(cell / (width * step) - 0.5, 0.0, n_blocks - 1.0)
    left = np.floor(place).astype(np.int64)
    right = np.minimum(left + 1, n_blocks - 1)
    tiles, share = row // TILE_FRAMES, place - left
    between: FloatArray = (1 - share) * mean[:, tiles, left] + share * mean[
        :, tiles, right
    ]
    return between


def _between_lines(power: FloatArray, floor: FloatArray) -> BoolArray:
    """Mark cells that are no line, nor within its main lobe of a Hann window."""
    is_quiet = power <= np.float32(LINE_FACTOR) * floor  # nan in a gap: not quiet
    kept = is_quiet.copy()
    for shift in range(1, LOBE_BINS + 1):
        kept[:, shift:] &= is_quiet[:, :-shift]
        kept[:, :-shift] &= is_quiet[:, shift:]
    return kept


def peak_bearings(
    parts: tuple[FloatArray, FloatArray],
    power: FloatArray,
    background: FloatArray,
    noise: FloatArray,
    row: IntArray,
    cell: IntArray,
    *,
    zero_padding: int,
    dipole_noise_ratio: float,
) -> tuple[FloatArray, FloatArray]:
    """Return bearings of peaks and their deviations, degrees.

    Parameters
    ----------
    parts
        Intensity to the east and to the north, shape (frame, frequency).
    power
        Power density of the omni channel, same shape.
    background
        Intensity of the background at the peaks, shape (2, n).
    noise
        Noise density at the peaks.
    row, cell
        Where the peaks are.
    zero_padding
        Cells per natural bin.
    dipole_noise_ratio
        Noise power of a dipole channel over the omni channel's, if isotropic.

    Notes
    -----
    With J the sum over the cells of the intensity less b times the power, p is the
    positive root of |J + p b| = p, and the bearing that of J + p b. In coordinates in
    which the noise of J is white, z is its length in deviations and a its angle, the
    bearing d(a) deviates by d'/z; z^2 is freed of the 1 that noise adds in the mean.
    The weight 1/(d'/z)^2 follows the error where d' does: the mean of such bearings is
    off by -1.5 d''/z^2, which is put back, and counts among the deviations.
    """
    half = zero_padding // 2
    reach = range(-half, half + 1)
    pull = background / np.maximum(noise, TINY)
    size = np.hypot(*pull)
    axis = np.where(size > TINY, pull / np.maximum(size, TINY), [[0.0], [1.0]])
    size = np.minimum(size, MOST_DIRECTED)
    omni = np.sum([power[row, cell + k] for k in reach], axis=0, dtype=np.float64)
    heard = np.array(
        [np.sum([part[row, cell + k] for k in reach], axis=0) for part in parts]
    )
    # J along the background's direction, and clockwise of it
    along = (axis * heard).sum(axis=0) - size * omni
    across = axis[1] * heard[0] - axis[0] * heard[1]
    own = np.hypot(along, np.sqrt(1.0 - size**2) * across)
    own = (size * along + own) / (1.0 - size**2)
    angle = np.arctan2(across, along + size * own)
    scale = 0.5 * _cells_together(half, zero_padding) * noise * omni * (1.0 - size)
    square = along**2 / (dipole_noise_ratio + size) + across**2 / dipole_noise_ratio
    square = np.maximum(square / np.maximum(scale, TINY), LEAST_SQUARE)
    slope, bend = angle_by_whitened(angle, size, dipole_noise_ratio)
    shift = 1.5 * bend / np.maximum(square, 4.0)
    known = np.sqrt(square * np.maximum(square - 1.0, LEAST_SQUARE))
    std = np.minimum(np.hypot(slope / np.sqrt(known), shift), LARGEST_STD_RAD)
    return (
        (compass_deg(*axis) + np.degrees(angle + np.clip(shift, -std, std))) % 360.0,
        np.degrees(std),
    )


def angle_by_whitened(
    angle: FloatArray, size: FloatArray, ratio: float
) -> tuple[FloatArray, FloatArray]:
    """Return first and second derivative of a line's angle by that in white noise.

    Parameters
    ----------
    angle
        Direction of the line from that of the background, rad.
    size
        Length of b.
    ratio
        Dipole noise ratio of isotropic noise.

    Notes
    -----
    tan a = r sin d / (cos d - |b|) with r^2 = (ratio + |b|) / ratio.
    """
    stretch = np.sqrt((ratio + size) / ratio)
    cos, sin = np.cos(angle), np.sin(angle)
    lower = stretch * (1.0 - size * cos)
    slope = ((cos - size) ** 2 + (stretch * sin) ** 2) / lower
    change = 2.0 * ((stretch**2 - 1.0) * cos + size) - slope * stretch * size
    return slope, slope * sin * change / lower


def _cells_together(half: int, zero_padding: int) -> float:
    """Return how much noise of neighbouring cells adds, for a line in their middle."""
    offset = np.arange(-half, half + 1) / zero_padding
    shape = response(offset)
    alike = [[np.sqrt(cell_correlation(a - b, 0.0)) for a in offset] for b in offset]
    return float(shape @ np.array(alike) @ shape / (shape @ shape))
