"""The image of fringes of a passage, with the curves that its law draws over it.

**Method.** Level and slope of each row and the median of each cell are taken off, rows
are averaged to some hundred, and each cell is drawn in units of its own noise. A pattern
of the closest approach moves along log frequency as the range grows: curves through some
frequencies there show how.

**Conventions.** A passage whose speed is not known is drawn at the usual speed of a
vessel: only the time that sound takes depends on it. Curves are those of a mirror; a
waveguide's lie a few percent beside them.
"""

import numpy as np
from matplotlib.axes import Axes

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes
from uwtrack_cli.motion.evidence.fringe_template import Hypothesis, relative_range
from uwtrack_cli.plotting.picture import cell_edges
from uwtrack_cli.plotting.style import Span, draw_cells, within

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


def has_pattern(
    fringes: Fringes, span_s: Span, passage: tuple[float, float, float]
) -> bool:
    """Tell whether a stretch has a pattern that moves as a passage says.

    Its rows are stacked along the passage's law. What stays, or moves the other way, does
    not stack so; of noise alone, nothing does.

    ``span_s``, ``passage``: as for `draw_fringes`.
    """
    found = _image(fringes, span_s)
    if found is None:
        return False
    time_s, image = found
    image = np.clip(image, -NOISES, NOISES)
    cells = np.log(fringes.frequency_hz)
    shift = np.log(relative_range(time_s, _law(passage)))

    def stacked(sign: float) -> float:
        rows = [np.interp(cells + sign * moved, cells, row, right=0.0)
                for moved, row in zip(shift, image, strict=True)]  # fmt: skip
        return float(np.var(np.mean(rows, axis=0)))

    noise = float(np.var(image)) / len(image)
    return stacked(1.0) > LEAST_STACK * max(stacked(0.0), stacked(-1.0), noise)


def _law(passage: tuple[float, float, float]) -> Hypothesis:
    at_s, width_s, mach = passage
    known = mach if np.isfinite(mach) and mach > 0 else USUAL_MACH
    return Hypothesis(at_s, width_s, mach=known)


def _image(fringes: Fringes, span_s: Span) -> tuple[FloatArray, FloatArray] | None:
    """Return times and rows of the image of a stretch, each cell in its own noise."""
    inside = within(fringes.time_s, span_s)
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
    return time_s, image / np.maximum(noise_db, STEP_DB)


def draw_fringes(
    ax: Axes,
    fringes: Fringes,
    span_s: Span,
    passages: list[tuple[float, float, float]],
) -> Axes:
    """Draw the image of a stretch, and the curves of passages over it.

    ``span_s``: begin and end, s. ``passages``: time and range over speed of each, s, and
    its speed over that of sound, nan if unknown.
    """
    frequency = fringes.frequency_hz
    ax.set_yscale("log")
    ax.set_ylabel("fringes\n(Hz)", fontsize=8)
    found = _image(fringes, span_s)
    if found is None:
        return ax
    time_s, image = found
    edges = cell_edges(time_s), np.exp(cell_edges(np.log(frequency)))
    ax.set_yticks(TICKS_HZ, [str(tick) for tick in TICKS_HZ], fontsize=8)
    ax.minorticks_off()
    ax.set_ylim(frequency[0], frequency[-1])
    draw_cells(ax, *edges, image, (-NOISES, NOISES), cmap="RdBu_r")
    grid = np.linspace(*span_s, 300)
    for passage in passages:
        far = relative_range(grid, _law(passage))
        for start_hz in np.geomspace(frequency[0], 0.8 * frequency[-1], N_CURVES):
            ax.plot(grid, start_hz * far, color="black", lw=0.8)
    return ax
