"""The image of fringes of a passage, with the curves that its law draws over it.

**Method.** Level and slope of each row and the median of each cell are taken off, rows
are averaged to some hundred, and each cell is drawn in units of its own noise. A pattern
of the closest approach moves along log frequency as the range grows: curves through some
frequencies there show how.

**Conventions.** A passage whose speed is not known is drawn at the usual speed of a
vessel: only the time that sound takes depends on it. Curves are those of a mirror; a
waveguide's lie a few percent beside them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes
from uwtrack_cli.motion.evidence.fringe_template import Hypothesis, relative_range
from uwtrack_cli.plotting import style
from uwtrack_cli.plotting.picture import cell_edges
from uwtrack_cli.plotting.style import Span

MOST_ROWS = 300
"""Rows that are drawn."""

NOISES = 3.0
"""Height above and below the median that has the strongest colours, in the noise of a
cell: the median step from one row to the next."""

TICKS_HZ = (100, 200, 500, 1000, 2000, 5000)
"""Frequencies that are named."""

N_CURVES = 5
"""Curves over the image."""

LEAST_STACK = 2.0
"""How much more than anything else a pattern must stack along the law of its passage."""

USUAL_MACH = 0.0037
"""Speed of a vessel over that of sound, where it is not known."""


class FringeImage(NamedTuple):
    """The image of a segment, each cell in its own noise."""

    time_s: FloatArray
    """Times of its rows, s."""
    frequency_hz: FloatArray
    """Frequencies of its columns, Hz."""
    height: FloatArray
    """Heights over the median in the noise of the cell, shape (row, column)."""

    @classmethod
    def of(cls, fringes: Fringes, span_s: Span) -> "FringeImage | None":
        """Return the image of a segment, s; None where there is none."""
        inside = style.within(fringes.time_s, span_s)
        rows = np.flatnonzero(inside & (fringes.shade[:, :1] > 0).any(axis=1))
        if rows.size < 2 or not fringes.frequency_hz.size:
            return None
        height_db = STEP_DB * (fringes.shade[rows].astype(np.float32) - MIDDLE)
        height_db = height_db - np.median(height_db, axis=0)
        each = -(-rows.size // MOST_ROWS)
        count = rows.size // each
        image = height_db[: count * each].reshape(count, each, -1).mean(axis=1)
        time_s = fringes.time_s[rows[: count * each]].reshape(count, each).mean(axis=1)
        # low cells hold few degrees of freedom: each is drawn in its own noise
        noise_db = np.median(np.abs(np.diff(image, axis=0)), axis=0)
        return cls(time_s, fringes.frequency_hz, image / np.maximum(noise_db, STEP_DB))

    def moves_as(self, law: Hypothesis) -> bool:
        """Tell whether the pattern moves as a passage says.

        Its rows are stacked along the passage's law. What stays, or moves the other way,
        does not stack so; of noise alone, nothing does.
        """
        image = np.clip(self.height, -NOISES, NOISES)
        cells = np.log(self.frequency_hz)
        shift = np.log(relative_range(self.time_s, law))

        def stacked(sign: float) -> float:
            rows = [np.interp(cells + sign * moved, cells, row, right=0.0)
                    for moved, row in zip(shift, image, strict=True)]  # fmt: skip
            return float(np.var(np.mean(rows, axis=0)))

        noise = float(np.var(image)) / len(image)
        return stacked(1.0) > LEAST_STACK * max(stacked(0.0), stacked(-1.0), noise)

    def draw(self, ax: Axes, laws: Sequence[Hypothesis]) -> Axes:
        """Draw the image, and the curves of passages over it."""
        frequency = self.frequency_hz
        style.calm(ax, "fringes\n(Hz)").set_yscale("log")
        ax.set_yticks(TICKS_HZ, [str(tick) for tick in TICKS_HZ], fontsize=8)
        ax.minorticks_off()
        ax.set_ylim(frequency[0], frequency[-1])
        edges = cell_edges(self.time_s), np.exp(cell_edges(np.log(frequency)))
        style.draw_cells(ax, *edges, self.height, (-NOISES, NOISES), cmap="RdBu_r")
        grid = np.linspace(*ax.get_xlim(), 300)
        starts_hz = np.geomspace(frequency[0], 0.8 * frequency[-1], N_CURVES)
        for far in (relative_range(grid, law) for law in laws):
            ax.plot(grid, starts_hz * far[:, np.newaxis], color="black", lw=0.9,
                    path_effects=style.halo())  # fmt: skip
        return ax


def law_of(time_s: float, width_s: float, mach: float) -> Hypothesis:
    """Return the law of a passage: time and range over speed, s, speed over sound speed."""
    known = mach if np.isfinite(mach) and mach > 0 else USUAL_MACH
    return Hypothesis(time_s, width_s, mach=known)
