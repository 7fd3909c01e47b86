"""Most likely frequency paths through a window of frames, by dynamic programming.

**Method.** A path visits one cell per frame and moves at most one cell per frame. Its
score is the sum of the cells' log-likelihood ratios "steady line against noise"
minus a penalty per move. For every last cell the best path is found by the Viterbi
recursion, all cells at once; the way back is kept as one byte per cell.

**Conventions.** Scores are in nepers, shape (frame, cell).

**References.** Streit & Barrett, "Frequency line tracking using hidden Markov
models", IEEE Trans. ASSP 38(4), 586-598 (1990).
"""

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray, IntArray

Steps = NDArray[np.int8]
"""Move into each cell on its best path: -1, 0 or 1, shape (frame, cell)."""


def best_scores(score: FloatArray, move_penalty: float) -> tuple[FloatArray, Steps]:
    """Return the score of the best path into each last cell, and the moves.

    Parameters
    ----------
    score
        Score of each cell, shape (frame, cell).
    move_penalty
        Cost of moving by one cell from frame to frame, in nepers.
    """
    n_frames, n_cells = score.shape
    moves = np.zeros((n_frames, n_cells), dtype=np.int8)
    padded = np.full(n_cells + 2, -np.inf, dtype=score.dtype)
    total = padded[1:-1]
    total[:] = score[0]
    side = np.empty(n_cells, dtype=score.dtype)
    is_right = np.empty(n_cells, dtype=bool)
    is_move = np.empty(n_cells, dtype=bool)
    penalty = score.dtype.type(move_penalty)
    for k in range(1, n_frames):
        np.greater(padded[2:], padded[:-2], out=is_right)
        np.maximum(padded[2:], padded[:-2], out=side)
        side -= penalty
        np.greater(side, total, out=is_move)
        # the move that led here: from the cell above (+1) or below (-1)
        moves[k] = is_move * (2 * is_right.view(np.int8) - 1)
        np.maximum(total, side, out=total)
        total += score[k]
    return total.copy(), moves


def trace_back(moves: Steps, last_cells: IntArray) -> IntArray:
    """Return the cells of the best paths that end in ``last_cells``.

    Returns
    -------
    IntArray
        Shape (path, frame).
    """
    cells = np.asarray(last_cells, dtype=np.int64)
    path = np.empty((cells.size, moves.shape[0]), dtype=np.int64)
    for k in range(moves.shape[0] - 1, -1, -1):
        path[:, k] = cells
        cells = cells + moves[k, cells]
    return path
