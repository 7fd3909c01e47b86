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
b is the intensity over the power of those cells of the noise floor's tile that are not
lines: it is as free of what O was selected for, and has no error of the noise floor in
it. The cells of the peak itself are left out: a line that is too weak to be told from
noise frame by frame would be a fifth of its own background.

**Conventions.** Compass degrees. The noise of a dipole channel that the omni channel
does not foretell is N (1 - |b|) (k 1 + b b' / |b|) with k the dipole noise ratio of
isotropic noise: the directed part comes from one direction, the rest from all.

**References.** D'Spain et al. (1991), J. Acoust. Soc. Am. 89, 1134 (active intensity);
T. W. Anderson, An Introduction to Multivariate Statistical Analysis (2003), section 2.5
(what of one Gaussian variable another one foretells).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import compass_deg, wrap_rad
from uwtrack_cli.estimation.noise_floor import TILE_BINS, TILE_FRAMES
from uwtrack_cli.estimation.window import cell_correlation, response

LINE_FACTOR = 5.0
"""Cells above this multiple of the noise are lines and no background."""

LOBE_BINS = 2
"""Natural bins to which a line spreads on either side."""

MOST_DIRECTED = 0.95
"""Largest length of b: it is known from a tile to some hundredths only."""

LEAST_SQUARE = 1e-3
"""Least z^2, for deviations that are finite."""

ROUNDING = 1e-9
"""Share of a sum of powers below which what is left of a difference is rounding."""

TINY = 1e-300
"""Divisor in place of zero."""

LARGEST_STD_RAD = 1.8
"""Deviation of a bearing that tells nothing."""

ALONE, TOGETHER = 6.0, 3.0
"""Deviations of a peak's own J from which its own direction is where the error is taken as
small, and below which that of its tile is."""


def background_pull(
    parts: tuple[FloatArray, FloatArray],
    power: FloatArray,
    floor: FloatArray,
    row: IntArray,
    cell: IntArray,
    *,
    zero_padding: int = 1,
) -> FloatArray:
    """Return how the background leads the dipoles at some cells: b.

    Intensities to the east and to the north, power and noise density have the shape
    (frame, frequency); the first frame starts a tile. The result is intensity over
    power, east and north, shape (2, n).
    """
    step = max(1, zero_padding)
    n_bins = power.shape[1] // step
    width = min(TILE_BINS, n_bins)
    n_blocks = n_bins // width
    used = slice(0, n_blocks * width * step, step)
    n_tiles = -(-power.shape[0] // TILE_FRAMES)
    total = np.zeros((3, n_tiles, n_blocks * width))
    for tile in range(n_tiles):
        frames = slice(tile * TILE_FRAMES, (tile + 1) * TILE_FRAMES)
        kept = _between_lines(power[frames, used], floor[frames, used])
        for axis, part in enumerate((*parts, power)):
            quiet = np.where(kept, part[frames, used], np.float32(0.0))
            total[axis, tile] = quiet.sum(axis=0)
    blocks = total.reshape(3, n_tiles, n_blocks, width).sum(axis=3)
    place = np.clip(cell / (width * step) - 0.5, 0.0, n_blocks - 1.0)
    left = np.floor(place).astype(np.int64)
    right = np.minimum(left + 1, n_blocks - 1)
    tiles, share = row // TILE_FRAMES, place - left
    between = (1 - share) * blocks[:, tiles, left] + share * blocks[:, tiles, right]
    # short frames may have nothing but the line in a block: rounding is no background
    least = ROUNDING * between[2]
    for shift in range(-LOBE_BINS, LOBE_BINS + 1):
        own = np.clip(np.rint(cell / step).astype(np.int64) + shift, 0, None)
        held = np.where(own // width == left, 1 - share, 0.0)
        held += np.where(own // width == right, share, 0.0)
        own = np.minimum(own, n_blocks * width - 1)
        between -= held * total[:, tiles, own]
    pull = np.zeros(between[:2].shape)
    np.divide(between[:2], between[2], out=pull, where=between[2] > least)
    return pull


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
    floor: FloatArray,
    background: FloatArray,
    row: IntArray,
    cell: IntArray,
    *,
    zero_padding: int,
    hop_windows: float,
    dipole_noise_ratio: float,
) -> tuple[FloatArray, FloatArray]:
    """Return bearings of peaks and their deviations, degrees.

    Parameters
    ----------
    parts
        Intensity to the east and to the north, shape (frame, frequency).
    power, floor
        Power density of the omni channel and noise density, same shape; the first frame
        starts a tile.
    background
        How the background leads the dipoles at the peaks, shape (2, n).
    row, cell
        Where the peaks are.
    zero_padding
        Cells per natural bin.
    hop_windows
        Hop of the frames as a share of their window.
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

    That is the second order of an error that is small; of a weak line it is not. Its
    J is linear in the noise all the same: d0, p0 and d' are taken of the sum over the
    tile, and the bearing is d0 + d' w / (p0 |m|), w the part of J across the direction m
    of that sum, which deviates by d' / (p0 |m|) times the noise of J and is as long as
    one Newton step of the likelihood from d0: an error of d0 has no first order in it.
    """
    noise = floor[row, cell].astype(np.float64)
    size = np.hypot(*background)
    axis = np.where(size > TINY, background / np.maximum(size, TINY), [[0.0], [1.0]])
    size = np.minimum(size, MOST_DIRECTED)
    reach = range(-(zero_padding // 2), zero_padding // 2 + 1)
    together = _cells_together(zero_padding // 2, zero_padding)
    own = _White.of(
        [_over_cells(part, row, cell, reach) / np.maximum(noise, TINY) for part in (*parts, power)],
        axis,
        size,
        dipole_noise_ratio,
        together,
    )
    tile, count = _tile_sums(parts, power, floor)
    whole = _White.of(
        [_over_cells(part, row // TILE_FRAMES, cell, reach) for part in tile],
        axis, size, dipole_noise_ratio, together * _frames_together(hop_windows),
    )  # fmt: skip
    aid = np.clip((ALONE - own.deviations) / (ALONE - TOGETHER), 0.0, 1.0)
    n_frames = 1.0 + aid * (count[row // TILE_FRAMES] - 1.0)
    joint = own.joined(whole, aid)
    angle, line_power = joint.angle(size, dipole_noise_ratio)
    slope, bend = angle_by_whitened(angle, size, dipole_noise_ratio)
    square = np.maximum(joint.deviations**2, LEAST_SQUARE)
    shift = 1.5 * bend / np.maximum(square, 4.0)
    sure = np.maximum(1.0 - 1.0 / square, LEAST_SQUARE / square)
    line_power = line_power / n_frames * np.sqrt(sure)
    share = _likely_share(line_power, own.omni, together) ** aid
    length = np.hypot(*joint.sound) / n_frames * sure**0.25 * share
    length = np.maximum(length, TINY)
    turned = joint.sound[0] * own.sound[1] - joint.sound[1] * own.sound[0]
    step = slope * turned / np.maximum(np.hypot(*joint.sound), TINY) / length
    wide = joint.spread_slope(angle, slope, size, dipole_noise_ratio)
    std = np.hypot(wide * np.sqrt(own.variance) / length, shift)
    std = np.hypot(std, aid * wide / np.sqrt(square))
    std = np.minimum(std, LARGEST_STD_RAD)
    step = np.clip(step, -np.pi, np.pi) + np.clip(shift, -std, std)
    return ((compass_deg(*axis) + np.degrees(angle + step)) % 360.0, np.degrees(std))


@dataclass(frozen=True, eq=False)
class _White:
    """J of some peaks in coordinates in which its noise is white."""

    sound: FloatArray
    """J along the background's direction and clockwise of it, shape (2, n)."""
    variance: FloatArray
    """Its variance in either coordinate."""
    omni: FloatArray
    """Power of the omni channel over the noise density."""

    @classmethod
    def of(
        cls,
        heard: list[FloatArray],
        axis: FloatArray,
        size: FloatArray,
        ratio: float,
        together: float,
    ) -> "_White":
        """Take the background off intensities east and north, over a power."""
        east, north, omni = heard
        along = axis[0] * east + axis[1] * north - size * omni
        across = axis[1] * east - axis[0] * north
        return cls(
            np.stack([along / np.sqrt(ratio + size), across / np.sqrt(ratio)]),
            np.maximum(0.5 * together * omni * (1.0 - size), TINY),
            omni,
        )

    @property
    def deviations(self) -> FloatArray:
        """Length of J in deviations."""
        return np.asarray(np.hypot(*self.sound) / np.sqrt(self.variance))

    def joined(self, whole: "_White", aid: FloatArray) -> "_White":
        """Return this with a share of the rest of its tile."""
        return _White(
            self.sound + aid * (whole.sound - self.sound),
            np.maximum(self.variance + aid**2 * (whole.variance - self.variance), TINY),
            self.omni + aid * (whole.omni - self.omni),
        )

    def angle(self, size: FloatArray, ratio: float) -> tuple[FloatArray, FloatArray]:
        """Return the line's angle from the background's direction, and its power."""
        along = self.sound[0] * np.sqrt(ratio + size)
        across = self.sound[1] * np.sqrt(ratio)
        power = np.hypot(along, np.sqrt(1.0 - size**2) * across)
        power = (size * along + power) / (1.0 - size**2)
        return np.arctan2(across, along + size * power), power

    def spread_slope(
        self, angle: FloatArray, slope: FloatArray, size: FloatArray, ratio: float
    ) -> FloatArray:
        """Return the rms of d' over two deviations of a to either side, and at a itself.

        Near the direction of strong background d' is small there, and only there.
        """
        reach = np.minimum(2.0 / np.maximum(self.deviations, TINY), 0.5 * np.pi)
        total = slope**2
        for sign in (-1.0, 1.0):
            cos, sin = np.cos(reach), sign * np.sin(reach)
            first, second = self.sound
            turned = np.stack([first * cos - second * sin, first * sin + second * cos])
            moved, _ = replace(self, sound=turned).angle(size, ratio)
            total = total + (wrap_rad(moved - angle) / reach) ** 2
        return np.asarray(np.sqrt(total / 3.0))


def _over_cells(values: FloatArray, row: IntArray, cell: IntArray, reach: range) -> FloatArray:
    """Return sums over some cells around places."""
    return np.asarray(np.sum([values[row, cell + k] for k in reach], axis=0, dtype=float))


def _tile_sums(
    parts: tuple[FloatArray, FloatArray], power: FloatArray, floor: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Return sums over the frames of each tile, of values over the noise.

    Of both intensities and of the power, shape (tile, frequency) each; and how many
    frames they are of.
    """
    sums: list[list[FloatArray]] = [[], [], []]
    count = []
    for first in range(0, len(power), TILE_FRAMES):
        rows = slice(first, first + TILE_FRAMES)
        heard = np.isfinite(power[rows]).all(axis=1) & (floor[rows] > 0.0).all(axis=1)
        noise = floor[rows][heard]
        for found, values in zip(sums, (*parts, power), strict=True):
            found.append((values[rows][heard] / noise).sum(axis=0, dtype=np.float64))
        count.append(max(1, int(heard.sum())))
    return [np.array(one) for one in sums], np.array(count, np.float64)


def _likely_share(line_power: FloatArray, omni: FloatArray, together: float) -> FloatArray:
    """Return the line's share in the power of a frame, over its mean power.

    The mean of A |O| cos of a line of amplitude A that makes |O| with Gaussian noise:
    the angle between the two follows von Mises' law.
    """
    from scipy.special import ive

    product = np.sqrt(np.maximum(line_power, TINY) * np.maximum(omni, TINY))
    kappa = 2.0 * product / together
    likely = product * ive(1, kappa) / ive(0, kappa)
    return np.asarray(likely / np.maximum(line_power, TINY))


def angle_by_whitened(
    angle: FloatArray, size: FloatArray, ratio: float
) -> tuple[FloatArray, FloatArray]:
    """Return first and second derivative of a line's angle by that in white noise.

    The angle, rad, counts from the direction of the background; ``size`` is the length
    of b, ``ratio`` the dipole noise ratio of isotropic noise.

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


def _frames_together(hop_windows: float) -> float:
    """Return how much noise of the frames of a tile adds, those that overlap."""
    lags = hop_windows * np.arange(1, TILE_FRAMES)
    alike = [np.sqrt(cell_correlation(0.0, lag)) for lag in lags[lags < 1.0]]
    return float(1.0 + 2.0 * np.sum(alike))
