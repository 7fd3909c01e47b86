"""Sums along all straight drifts through a window, each sum from two shorter ones.

**Method.** The sum along a line that climbs d cells in a window is that of the first
half, climbing d/2, and that of the second one, which begins where the first has ended:
all drifts of all cells take N log N additions instead of N squared.

**Conventions.** A sum belongs to the cell in the middle of the window. Beyond the ends
of the band there is nothing.

**References.** Taylor, Astron. Astrophys. Suppl. 15, 367 (1974), for the tree; Enriquez
et al., ApJ 849, 104 (2017), for turboSETI, which uses it for narrow lines.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray


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
