"""The image of fringes of a passage, with the curves that its law draws over it.

**Method.** Level and slope of each row and the median of each cell are taken off, rows
are averaged to some hundred, and each cell is drawn in units of its own noise. A pattern
of the closest approach moves along log frequency as the range grows: curves through some
frequencies there show how.

**Conventions.** A passage whose speed is not known is drawn at the usual speed of a
vessel: only the time that sound takes depends on it. Curves are those of a mirror; a
waveguide's lie a few percent beside them.
"""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.fringes import MIDDLE, STEP_DB, Fringes
from uwtrack_cli.motion.evidence.fringe_template import Hypothesis, relative_range
from uwtrack_cli.plotting.picture import cell_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_ROWS = 300
"""Rows that are drawn."""

NOISES = 3.0
"""Height above and below the median that has the strongest colours, in the noise of a
cell: the median step from one row to the next."""

TICKS_HZ = (100, 200, 500, 1000, 2000, 5000)
"""Frequencies that are named."""

N_CURVES = 5
"""Curves over the image."""

USUAL_MACH = 0.0037
"""Speed of a vessel over that of sound, where it is not known."""


def draw_fringes(
    ax: "Axes",
    fringes: Fringes,
    span_s: tuple[float, float],
    passages: list[tuple[float, float, float]],
) -> "Axes":
    """Draw the image of a stretch, and the curves of passages over it.

    ``span_s``: begin and end, s. ``passages``: time and range over speed of each, s, and
    its speed over that of sound, nan if unknown.
    """
    inside = (fringes.time_s >= span_s[0]) & (fringes.time_s <= span_s[1])
    rows = np.flatnonzero(inside & (fringes.shade[:, :1] > 0).any(axis=1))
    frequency = fringes.frequency_hz
    ax.set_yscale("log")
    ax.set_ylabel("Hz", fontsize=8)
    if rows.size < 2 or not frequency.size:
        return ax
    height_db = STEP_DB * (fringes.shade[rows].astype(np.float32) - MIDDLE)
    height_db = height_db - np.median(height_db, axis=0)
    each = -(-rows.size // MOST_ROWS)
    count = rows.size // each
    image = height_db[: count * each].reshape(count, each, -1).mean(axis=1)
    time_s = fringes.time_s[rows[: count * each]].reshape(count, each).mean(axis=1)
    # low cells hold few degrees of freedom: each is drawn in its own noise
    noise_db = np.median(np.abs(np.diff(image, axis=0)), axis=0)
    image = image / np.maximum(noise_db, STEP_DB)
    ax.pcolormesh(
        cell_edges(time_s), np.exp(cell_edges(np.log(frequency))), image.T,
        cmap="RdBu_r", vmin=-NOISES, vmax=NOISES, rasterized=True,
    )  # fmt: skip
    ax.set_yticks(TICKS_HZ, [str(tick) for tick in TICKS_HZ], fontsize=8)
    ax.minorticks_off()
    ax.set_ylim(frequency[0], frequency[-1])
    grid = np.linspace(*span_s, 300)
    for at_s, width_s, mach in passages:
        known = mach if np.isfinite(mach) and mach > 0 else USUAL_MACH
        far = relative_range(grid, Hypothesis(at_s, width_s, mach=known))
        for start_hz in np.geomspace(frequency[0], 0.8 * frequency[-1], N_CURVES):
            ax.plot(grid, start_hz * far, color="black", lw=0.8)
    return ax
