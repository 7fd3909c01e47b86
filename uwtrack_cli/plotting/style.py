"""Colours, clock and habits that all pictures share.

**Conventions.** A contact has one colour and one kind of dash in every panel, page and
report. The colours are those of Okabe & Ito (2008) that stand out on white and on the
dark of the lofargram alike; they differ in lightness, so that readers who see fewer
colours, and grey prints, still tell them apart, and every mark bears its number.
"""

import io
import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patheffects import Normal, Stroke

from uwtrack_cli.acoustics.geometry import region_95
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.files.utc import EPOCH

CONTACT_COLORS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (1.5, 1)))
NO_CONTACT = "#767676"
"""Colour of what belongs to no contact."""

MEASURED = "#4d4d4d"
"""Colour of measurements that no contact owns, such as levels."""

WARNING = "#b00020"
"""Colour of what a reader must not overlook; it is always written out, too."""

LEVELS_MAP = "viridis"
"""Colour map of levels: lightness rises evenly, so that it reads in grey."""

NO_SOUND = "#d9d9d9"
"""Colour of gaps in a lofargram."""

MOST_PLACES = 2000
"""Places along an axis that uneven cells are drawn at."""

BAND_DEVIATIONS = 2.0
"""Half the width of every band about a fit, in deviations."""

WIDE_IN, NARROW_IN = 11.0, 4.6
"""Width of a page for a screen or paper, and for a telephone, inches."""

MARGIN_IN = 0.08
"""Room on the left and right of every panel, inches."""

STEPS_S = (
    0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10_800,
    21_600, 43_200, 86_400, 172_800, 604_800, 2_419_200,
)  # fmt: skip
"""Distances of the ticks of a time axis, s."""


Span = tuple[float, float]
"""Begin and end, s."""


def within(time_s: FloatArray, span_s: Span) -> BoolArray:
    """Tell which times lie within a span, s."""
    return np.asarray((time_s >= span_s[0]) & (time_s <= span_s[1]))


def contact_color(contact: int) -> str:
    """Return the colour of a contact, the same everywhere; grey for none."""
    if contact <= 0:
        return NO_CONTACT
    return CONTACT_COLORS[(contact - 1) % len(CONTACT_COLORS)]


def text_on(color: str) -> str:
    """Return the colour of text that is read on a colour: black or white.

    Notes
    -----
    Relative luminance as in WCAG 2.1; at 0.18 both have the same contrast.
    """
    parts = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return "black" if linear @ [0.2126, 0.7152, 0.0722] > 0.18 else "white"


def contact_dash(contact: int) -> Any:
    """Return the dash of a contact: contacts of one colour differ in it."""
    return DASHES[(max(contact, 1) - 1) // len(CONTACT_COLORS) % len(DASHES)]


class NotebookFigure(Figure):
    """A figure that shows itself in a notebook."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty page; needs no screen."""
    layout = ConstrainedLayoutEngine(w_pad=MARGIN_IN)
    return NotebookFigure(figsize=(width_in, height_in), layout=layout, dpi=100)


def halo() -> list[Any]:
    """Return the white edge that marks have on a picture."""
    return [Stroke(linewidth=1.4, foreground="white", alpha=0.9), Normal()]


def calm(ax: Axes, label: str | None = None) -> Axes:
    """Take away the frame that says nothing, draw a faint grid, name what goes up."""
    ax.set_ylabel(label or ax.get_ylabel(), fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.tick_params(labelsize=8)
    return ax


def draw_band(
    ax: Axes, x: FloatArray, middle: FloatArray, half: FloatArray, color: str, **line: Any
) -> None:
    """Draw a curve with a band of half a width on either side of it."""
    ax.plot(x, middle, color=color, **{"lw": 0.9, **line})
    ax.fill_between(x, middle - half, middle + half, color=color, alpha=0.25, lw=0)


def draw_cells(
    ax: Axes, x: FloatArray, y: FloatArray, level_db: FloatArray,
    limits_db: tuple[float | None, float | None], bar: str = "",
    cmap: str = LEVELS_MAP,
) -> None:  # fmt: skip
    """Draw cells in the colours of their levels, grey where there is none.

    Scale and limits of a logarithmic axis are set before. Cells lie evenly on their axis,
    or else each place has the cell that covers it.

    ``x``, ``y``: edges of the cells. ``level_db``: levels of shape (x, y).
    ``limits_db``: levels of the darkest and the brightest colour. ``bar``: name of the
    bar of colours; empty without one.
    """
    scale, ends, place = ax.yaxis.get_transform(), y[[0, -1]], ax.transData
    columns, rows = _places(x), _places(scale.transform(y))
    cells = level_db if columns is None else level_db[columns]
    cells = cells if rows is None else cells[:, rows]
    if ax.get_yscale() != "linear":  # else an image is even in what the scale bends
        low, high = scale.transform(np.array(ax.get_ylim()))
        ends = (scale.transform(ends) - low) / (high - low)
        place = ax.get_xaxis_transform()
    image = ax.imshow(
        np.ma.masked_invalid(cells.T), cmap=cmap, vmin=limits_db[0], vmax=limits_db[1],
        extent=(x[0], x[-1], ends[0], ends[1]), origin="lower", aspect="auto",
        interpolation="nearest", transform=place,
    )  # fmt: skip
    ax.set_facecolor(NO_SOUND)
    if bar:
        color_bar(image, ax, bar)


def _places(edges: FloatArray) -> IntArray | None:
    """Return the cell at each of many even places; None where the cells lie so."""
    width = np.abs(np.diff(edges))
    if np.allclose(width, width.mean(), rtol=0.01):
        return None
    count = min(MOST_PLACES, int(np.ceil(width.sum() / max(width.min(), 1e-9))))
    at = edges[0] + (np.arange(count) + 0.5) / count * (edges[-1] - edges[0])
    sign = np.sign(edges[-1] - edges[0])
    return np.asarray(np.searchsorted(sign * edges[1:-1], sign * at))


def color_bar(image: Any, ax: Axes, name: str) -> None:
    """Draw the bar of the colours of a picture beside its panel."""
    colors = ScalarMappable(image.norm, image.cmap)  # a bar would hold its picture
    bar = ax.figure.colorbar(colors, ax=ax, pad=0.01, aspect=30)
    bar.set_label(name, fontsize=8)
    bar.ax.tick_params(labelsize=7)


@dataclass(frozen=True)
class Clock:
    """The clock of a page: UTC where the start of the recording is known."""

    start_utc_ns: int | None = None
    """Time of the first sample since 1970-01-01 UTC, ns; None if unknown."""

    def text(self, time_s: float, step_s: float = 1.0) -> str:
        """Return a time as on an axis with ticks so far apart, s.

        Examples
        --------
        >>> Clock().text(12.5, 0.5), Clock(0).text(86_399.9, 60.0)
        ('12.5', '00:00')
        """
        digits = 1 if step_s < 1.0 else 0
        if self.start_utc_ns is None:
            return f"{time_s:.{digits}f}"
        unit_ns = NANOSECONDS // 10**digits
        at = self._date(round(time_s * NANOSECONDS) + unit_ns // 2, unit_ns)
        if step_s >= STEPS_S[-4]:
            return f"{at:%m-%d}"
        return f"{at:%H:%M:%S.%f}"[: 5 if step_s >= 60.0 else 8 + 2 * digits]

    def day(self, time_s: float) -> str:
        """Return the day of a time, empty if it is not known."""
        if self.start_utc_ns is None:
            return ""
        return f"{self._date(round(time_s * NANOSECONDS), NANOSECONDS):%Y-%m-%d}"

    def _date(self, since_ns: int, unit_ns: int) -> datetime:
        """Return a time, cut to whole units."""
        ns = ((self.start_utc_ns or 0) + since_ns) // unit_ns * unit_ns
        return EPOCH + timedelta(microseconds=ns // 1000)

    def set_axis(self, ax: Axes, span_s: Span, ticks: int = 8) -> None:
        """Give a panel a time axis from one time to another, s.

        Ticks lie at whole seconds, minutes, hours or days of UTC.
        """
        low, high = span_s
        enough = (high - low) / ticks
        step = next((s for s in STEPS_S if s >= enough), math.ceil(enough))
        offset = (self.start_utc_ns or 0) % (604_800 * NANOSECONDS) / NANOSECONDS
        first = math.ceil((low + offset) / step - 1e-9)
        last = math.floor((high + offset) / step + 1e-9)
        at = [k * step - offset for k in range(first, last + 1)]
        ax.set_xlim(low, high)
        ax.set_xticks(at, [self.text(t, step) for t in at])

    def label(self, span_s: Span) -> str:
        """Return the name of the time axis."""
        if self.start_utc_ns is None:
            return "time from the first sample (s)"
        days = dict.fromkeys(map(self.day, span_s))
        return f"UTC {' to '.join(days)}"


def draw_ellipse(
    ax: Axes, place: FloatArray, covariance: FloatArray, color: str, alpha: float = 0.2
) -> None:
    """Draw the 95 % ellipse of a position.

    ``place``: its middle, m, shape (2,). ``covariance``: covariance of both
    coordinates, m^2, shape (2, 2); without one nothing is drawn. ``alpha``: share of
    the filling that is seen.
    """
    if np.isfinite(covariance).all():
        ring = np.asarray(place)[:, None] + region_95(covariance)
        ax.fill(*ring, color=color, alpha=alpha, lw=0)
        ax.plot(*ring, color=color, lw=1.0)


def draw_arrow(
    ax: Axes, begin: FloatArray, end: FloatArray, color: str, alpha: float = 1.0
) -> None:
    """Draw an arrow from one place of a map to another, each of shape (2,)."""
    ax.annotate(
        "", (float(end[0]), float(end[1])), (float(begin[0]), float(begin[1])),
        arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.4, "alpha": alpha},
    )  # fmt: skip


def name_place(ax: Axes, place: FloatArray, name: str, color: str, offset: tuple[int, int]) -> None:
    """Write a name beside a place of a map, so many points to the right and up."""
    ax.annotate(
        figure_text(name), (float(place[0]), float(place[1])), xytext=offset,
        textcoords="offset points", fontsize=8, color=color,
    )  # fmt: skip


def broken_bearing(bearing_deg: FloatArray) -> FloatArray:
    """Return bearings from 0 to 360 degrees, broken where they pass north."""
    bearing = np.mod(bearing_deg, 360.0)
    jumps = np.abs(np.diff(bearing, prepend=bearing[:1])) > 180.0
    return np.where(jumps, np.nan, bearing)
