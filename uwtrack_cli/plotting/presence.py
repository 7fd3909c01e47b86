"""Pictures of what was heard: one bar for each stretch, and modulation rates."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.presence import KINDS, Presence
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.files.text_escaping import figure_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {
    "vessel": "#0072b2", "rates": "#56b4e9", "lines": "#009e73", "hum": "#999999",
    "broadband": "#d55e00", "rain": "#cc79a7", "unknown": "#dddddd",
}  # fmt: skip
"""Colour of each kind (Okabe & Ito 2008, for colour-blind readers)."""

LEAST_SHARE = 0.004
"""Least length of a bar, as a share of the whole span."""


def draw_presence(presence: Presence, ax: "Axes") -> "Axes":
    """Draw a bar for every stretch, one row per kind, with its spacing or shaft."""
    kinds = [kind for kind in KINDS if (presence.kind == kind).any()]
    if not kinds:
        return ax
    span = float(np.ptp([presence.from_s.min(), presence.to_s.max()])) or 1.0
    for number, row in enumerate(json_rows(presence)):
        begin, end = float(presence.from_s[number]), float(presence.to_s[number])
        place = len(kinds) - 1 - kinds.index(row["kind"])
        length = max(end - begin, LEAST_SHARE * span)
        ax.barh(
            place, length, left=begin, height=0.7, color=COLORS[row["kind"]],
            edgecolor="white", linewidth=0.5, alpha=0.85,
        )  # fmt: skip
        if row["spacing_hz"] is not None and length > 0.1 * span:
            ax.annotate(
                figure_text(f"{row['spacing_hz']:.2f} Hz"), (begin + 0.5 * length, place),
                ha="center", va="center", fontsize=7, color="white",
            )  # fmt: skip
    ax.set_yticks(range(len(kinds)), kinds[::-1], fontsize=7)
    ax.set(xlabel="time (s)", ylim=(-0.6, len(kinds) - 0.4))
    return ax


def draw_rates(presence: Presence, ax: "Axes") -> "Axes":
    """Draw the modulation rates of every stretch over its time."""
    for number in range(presence.n_stretches):
        color = COLORS[str(presence.kind[number])]
        for rate in presence.rate_hz[presence.owned_rows("rate_stretch", number)]:
            ends = (presence.from_s[number], presence.to_s[number])
            ax.plot(ends, (rate, rate), color=color, linewidth=1.6)
            ax.annotate(
                f"{rate:.2f}", (ends[0], rate), fontsize=7, color=color,
                textcoords="offset points", xytext=(2, 2),
            )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="rate (Hz)")
    ax.set_ylim(bottom=0.0)
    return ax
