"""What each cell, and each drift through it, says for a line: the table of teeth.

**Method.** Along each drift the power over noise is compared with a steady line of several
levels, equally likely before; a tooth sounds or is silent. What is not a tooth may still
be a line, of something else: so a line so strong that it is beyond doubt says for a comb
only as much as lines are rare, and no single one makes a comb. How rare they are is asked
of the window itself. Beside a loud line its leakage looks like lines, too, and so do drifts
that cross it: a tooth is where the amplitude is nearly the greatest around.

The sum along a line that climbs d cells in a window is that of the first
half, climbing d/2, and that of the second one, which begins where the first has ended:
all drifts of all cells take N log N additions instead of N squared.

**Conventions.** Evidence in nepers, zero where nothing is known. Cells have the shape
(frame, cell), the table (drift, cell + 2): nothing is beyond either end of the band.

A sum belongs to the cell in the middle of the window. Beyond the ends
of the band there is nothing.

**References.** Rice (1945) for a line in noise; Robbins (1956) for the share of lines,
found from the data itself; Taylor, Astron. Astrophys. Suppl. 15, 367 (1974), for the tree; Enriquez
et al., ApJ 849, 104 (2017), for turboSETI, which uses it for narrow lines.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio

LEVELS = (1.2, 3.0, 8.0)
"""Levels of a tooth that are tried, in those that a window of so many frames hears alone at
one standard deviation, sqrt(2 / frames)."""

MOST_SCORE = 3.0
"""Cap on what a cell says, nepers: a click is no tooth."""

STEPS, MOST_AMPLITUDE = 256, 16.0
"""Steps of the table of what an amplitude says, and its end, beyond which the cap is."""

SOUNDING = 0.6
"""Share of the teeth, from the first that sounds to the last, that sound."""

LEAST_STRAY = 5e-4
"""Least share of cells in which lines of no comb are expected."""

SKIRT = 0.75
"""Share of the greatest mean amplitude nearby below which a cell is a line's leakage: half
a natural bin off Hann's response is at .85, one bin off at .5 (Harris 1978)."""

SKIRT_BINS = 2.0
"""Natural bins to either side from which a line leaks (Hann's main lobe)."""

LOUD_SIGMAS = 6.0
"""Deviations of the noise's mean amplitude beyond which a line has skirts to speak of."""

AMPLITUDE_MEAN, AMPLITUDE_STD = 0.886, 0.463
"""Mean and deviation of the square root of an exponential power (Rayleigh)."""

SURE = 30.0
"""Evidence, nepers, beyond which more changes nothing."""


def tooth_levels(n_frames: float) -> FloatArray:
    """Return the levels of teeth that are tried: power over noise in their cell."""
    return np.asarray(np.array(LEVELS) * np.sqrt(2.0 / n_frames), np.float32)


def cell_evidence(power_ratio: FloatArray, levels: FloatArray, independent: float) -> FloatArray:
    """Return what each cell says for a line of each level, and its amplitude.

    ``independent`` is the share of frames that are as good as independent. Shape
    (level + 1, frame, cell); the last is the amplitude over that of noise.
    """
    known = np.isfinite(power_ratio)
    amplitude = np.sqrt(np.where(known, power_ratio, 0.0), dtype=np.float32)
    step = np.minimum(amplitude * np.float32(STEPS), STEPS * MOST_AMPLITUDE)
    step = step.astype(np.int32)
    middle = (np.arange(int(STEPS * MOST_AMPLITUDE) + 1) + 0.5) / STEPS
    score = np.empty((len(levels) + 1, *amplitude.shape), np.float32)
    for plane, level in zip(score, levels, strict=False):
        column = np.minimum(amplitude_log_ratio(middle**2, level), MOST_SCORE)
        (independent * column).astype(np.float32).take(step, out=plane)
    np.subtract(amplitude, np.float32(AMPLITUDE_MEAN), out=score[-1])
    score[:, ~known] = 0.0
    return score


def tooth_table(evidence: FloatArray, most_cells: int, bin_cells: int) -> tuple[FloatArray, float]:
    """Return the table of teeth, and the share of cells with a line.

    Of the evidence of cells, (level + 1, frame, cell), along drifts of up to so many
    cells; a natural bin has ``bin_cells``.
    """
    total = drift_sums(evidence, most_cells)
    likelihood: FloatArray = np.zeros_like(total[0])
    for own in total[:-1]:
        likelihood += np.exp(np.minimum(own, np.float32(SURE)))
    likelihood /= np.float32(len(total) - 1)
    likelihood -= np.float32(1.0)  # over that of noise, less one
    likelihood[_is_skirt(total[-1], evidence.shape[1], bin_cells)] = 0.0
    share = stray_share(likelihood[most_cells])
    n_drifts, n_cells = likelihood.shape
    table = np.zeros((n_drifts, n_cells + 2), np.float32)
    table[:, 1:-1] = np.log1p(np.float32(SOUNDING) * likelihood)
    table[:, 1:-1] -= np.log1p(np.float32(share) * likelihood)
    return table, share


def _is_skirt(amplitude: FloatArray, n_frames: int, bin_cells: int) -> BoolArray:
    """Tell which drifts and cells are the leakage of a line beside them."""
    greatest = amplitude.max(axis=0)
    half = round(SKIRT_BINS * bin_cells)
    padded = np.pad(greatest, half, mode="edge")
    nearby = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=1)
    is_loud = nearby > LOUD_SIGMAS * AMPLITUDE_STD * np.sqrt(n_frames)
    return np.asarray((amplitude < SKIRT * nearby) & is_loud)


def stray_share(likelihood: FloatArray) -> float:
    """Return the share of cells that hold a line, at least `LEAST_STRAY`.

    By two steps of expectation and maximisation, from the likelihood ratio less one.
    """
    share = LEAST_STRAY
    for _ in range(2):
        held = share * (likelihood + 1.0) / (1.0 + share * likelihood)
        share = max(float(held.mean()), LEAST_STRAY)
    return share


def drift_sums(values: FloatArray, most_cells: int) -> FloatArray:
    """Sum along every straight drift of at most so many cells in a window.

    Values have the shape (..., frame, cell), with a power of two of frames. Returns
    (..., 2 ``most_cells`` + 1, cell), drifts from the steepest fall to the steepest
    rise.
    """
    n_frames = values.shape[-2]
    most = min(most_cells, n_frames - 1)
    rising = _centred(_rising(values, most), 1)
    falling = _centred(_rising(values[..., ::-1], most)[..., ::-1], -1)
    every = np.concatenate([falling[..., :0:-1, :], rising], axis=-2)
    if most == most_cells:
        return every
    beside = np.zeros((*every.shape[:-2], most_cells - most, every.shape[-1]))
    return np.concatenate([beside, every, beside], axis=-2, dtype=every.dtype)


def _rising(values: FloatArray, most_cells: int) -> FloatArray:
    """Sum along rises of 0 to ``most_cells`` cells, at their first cell."""
    sums = values[..., None, :]  # (..., block, rise, cell)
    n_frames = values.shape[-2]
    n_blocks = n_frames
    while n_blocks > 1:
        n_blocks //= 2
        # no block climbs more than its share, rounded up
        n_rises = min(2 * sums.shape[-2], -(-most_cells // n_blocks) + 1)
        first, second = sums[..., 0::2, :, :], sums[..., 1::2, :, :]
        shape = (*first.shape[:-2], n_rises, first.shape[-1])
        longer = np.empty(shape, values.dtype)
        for rise in range(n_rises):
            own, start = rise // 2, (rise + 1) // 2
            total = longer[..., rise, :]
            total[...] = first[..., own, :]
            if start:
                total[..., :-start] += second[..., own, start:]
            else:
                total += second[..., own, :]
        sums = longer
    return sums[..., 0, : most_cells + 1, :]


def _centred(sums: FloatArray, sign: int) -> FloatArray:
    """Move sums from the first cell of their drift to the one in the middle."""
    for rise in range(1, sums.shape[-2]):
        shift = sign * (rise // 2)
        sums[..., rise, :] = np.roll(sums[..., rise, :], shift, axis=-1)
        if shift > 0:
            sums[..., rise, :shift] = 0.0
        elif shift < 0:
            sums[..., rise, shift:] = 0.0
    return sums
