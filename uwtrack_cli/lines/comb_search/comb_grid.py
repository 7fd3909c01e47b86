"""Every fundamental and drift that is asked for, and the evidence of its teeth.

**Method.** A fundamental that drifts by a share of itself moves each tooth by the same
share. So the evidence of a comb is a sum over its teeth of one table: what each cell and
drift in it say for a line. A comb sounds from one tooth to another, with silent ones
between; the best such range is found in one pass over the teeth (Kadane).

**Conventions.** Evidence in nepers. The table has the shape (drift, cell), drifts in
cells over the window, from the steepest fall on.

**References.** Bentley, Commun. ACM 27, 865 (1984), for the greatest sum of a range.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

FEWEST_TEETH = 3
"""Teeth of a comb."""

LEAST_SPACING_BINS = 4.0
"""Natural bins between teeth, at least: closer ones fill the tile of the noise floor."""

STEP_CELLS = 0.75
"""Cells by which the highest tooth moves from one fundamental to the next."""

DRIFT_STEP_CELLS = 1.5
"""The same from one drift to the next, over a whole window."""


@dataclass(frozen=True)
class CombBand:
    """Fundamentals of about an octave, with the drifts that they can have."""

    fundamental_hz: FloatArray
    """Fundamentals in the middle of the window, Hz, shape (fundamental,)."""
    drift: FloatArray
    """Relative change over the window, shape (drift,)."""
    n_teeth: int
    """Highest tooth of any of them."""


@dataclass(frozen=True)
class CombGrid:
    """All fundamentals and drifts, and where their teeth lie in a table."""

    bands: tuple[CombBand, ...]
    """Bands of fundamentals, ascending."""
    first_hz: float
    """Frequency of the first cell, Hz."""
    cell_hz: float
    """Distance of cells, Hz."""
    n_cells: int
    """Cells."""
    most_cells: int
    """Greatest drift in cells over a window."""

    @property
    def n_hypotheses(self) -> int:
        """Fundamentals times drifts."""
        return sum(band.fundamental_hz.size * band.drift.size for band in self.bands)

    def places(self, fundamental_hz: FloatArray, drift: FloatArray, tooth: float) -> IntArray:
        """Return where a tooth lies in the flat table, (drift, fundamental).

        The table has an empty cell beyond either end of the band. ``tooth`` need not be
        whole.
        """
        frequency = tooth * fundamental_hz
        cell = np.rint((frequency - self.first_hz) / self.cell_hz) + 1.0
        cell = np.clip(cell, 0, self.n_cells + 1).astype(np.int32)
        highest = self.first_hz + self.cell_hz * self.n_cells
        cells = (np.minimum(frequency, highest) / self.cell_hz).astype(np.float32)
        climb = drift.astype(np.float32)[:, None] * cells
        climb += np.float32(self.most_cells + 0.5)  # cut off, this is rounded
        row: IntArray = climb.astype(np.int32)
        row *= np.int32(self.n_cells + 2)
        row += cell
        return row


def comb_grid(
    frequency_hz: FloatArray,
    bin_hz: float,
    fundamental_hz: tuple[float, float],
    n_teeth: int,
    most_drift: float,
) -> CombGrid:
    """Lay out the fundamentals and drifts to be asked for.

    Of cells of these frequencies, Hz, and natural bins of such a width: fundamentals
    between two limits, Hz, with so many teeth at most, that change by a share of
    themselves at most over a window. No bands where there is none.
    """
    cell_hz = float(frequency_hz[1] - frequency_hz[0])
    highest = float(frequency_hz[-1])
    low = max(fundamental_hz[0], LEAST_SPACING_BINS * bin_hz)
    high = min(fundamental_hz[1], highest / FEWEST_TEETH)
    bands = []
    while low < high:
        stop = min(2.0 * low, high)
        top_hz = min(n_teeth * stop, highest)
        step = STEP_CELLS * cell_hz / min(n_teeth, highest / low)
        fundamental = np.arange(low, stop, step)
        n_drifts = int(np.ceil(most_drift * top_hz / (DRIFT_STEP_CELLS * cell_hz)))
        drift = most_drift * np.arange(-n_drifts, n_drifts + 1) / max(n_drifts, 1)
        bands.append(CombBand(fundamental, drift, min(n_teeth, int(highest / low))))
        low = stop
    most_cells = int(np.ceil(most_drift * (highest + cell_hz) / cell_hz))
    return CombGrid(tuple(bands), float(frequency_hz[0]), cell_hz, frequency_hz.size, most_cells)


def comb_scores(
    grid: CombGrid, band: CombBand, table: FloatArray, off_tune: FloatArray | None
) -> FloatArray:
    """Return the evidence of every comb of a band, shape (drift, fundamental).

    The table has an empty cell at either end. ``off_tune`` moves each tooth by a share of
    the spacing, shape (tooth,): such combs no machine has.
    """
    flat = table.reshape(-1)
    shape = band.drift.size, band.fundamental_hz.size
    best = np.full(shape, -np.inf, np.float32)
    run = np.full(shape, -np.inf, np.float32)
    for tooth in range(1, band.n_teeth + 1):
        shift = 0.0 if off_tune is None else float(off_tune[tooth - 1])
        place = grid.places(band.fundamental_hz, band.drift, tooth + shift)
        np.maximum(run, np.float32(first_tooth_prior(tooth)), out=run)
        run += flat.take(place)
        np.maximum(best, run, out=best)
    return best


def first_tooth_prior(tooth: int) -> float:
    """Return the prior evidence that a comb begins with a tooth, nepers."""
    return -float(np.log(tooth))


def sounding_range(evidence: FloatArray) -> tuple[int, int, float]:
    """Return the first and last tooth of the best range, and its evidence.

    Of the evidence of each tooth from the first on, shape (tooth,).
    """
    best, run, start, ends = -np.inf, -np.inf, 1, (1, 1)
    for tooth, own in enumerate(evidence.tolist(), start=1):
        fresh = first_tooth_prior(tooth)
        if fresh > run:
            run, start = fresh, tooth
        run += own
        if run > best:
            best, ends = run, (start, tooth)
    return *ends, float(best)
