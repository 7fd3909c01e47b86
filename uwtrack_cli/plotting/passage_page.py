"""The page of one passage: its lines as they were heard, the fit, what is left of it.

**Method.** Strips of the sound about each line with the fit (`passage_strips`), what the
fit leaves of the measurements, level, bearing, map and numbers. A panel is drawn if it
has something to say.

**Conventions.** Bands are two standard deviations on either side. Residuals are shares
of the Doppler shift v/c, so that a fit which leaves its lines is seen at once.
"""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.files.tables.json_rows import Row
from uwtrack_cli.files.tables.summaries import Head, utc_text
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.fringe_image import draw_fringes
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    draw_parts,
    side_by_side,
    stacked,
    titled_figure,
)
from uwtrack_cli.plotting.passage_fit import PassagePage, ReportedPassage
from uwtrack_cli.plotting.passage_map import draw_map, has_map
from uwtrack_cli.plotting.passage_strips import line_strips, measured_line
from uwtrack_cli.plotting.style import (
    BAND_DEVIATIONS,
    MEASURED,
    WARNING,
    broken_bearing,
    calm,
    contact_color,
)
from uwtrack_cli.plotting.view import Scene, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MARKED_MISFIT = 0.2
"""Misfit from which a page warns: half of what refuses a passage."""

BLOCKS = 0.25
"""Length over which residuals are averaged, in d/v."""

USABLE_BEARING_DEG = 30.0
"""Deviation of a bearing up to which it is drawn."""

MAP_IN = 3.8
"""Height of the map on a narrow page, inches."""


def passage_figure(scene: Scene, row: int, view: View) -> "Figure":
    """Return the page of a passage.

    ``scene``: the recording, with its closest approaches.

    Raises
    ------
    DataError
        The sound is asked for outside of the recording.
    """
    encounters = scene.encounters
    if encounters is None:
        msg = "a passage page needs encounters."
        raise ValueError(msg)
    page = PassagePage(scene, ReportedPassage(encounters, row), view)
    span_s = page.span_s()
    parts = [*line_strips(page, span_s), *_residuals(page, span_s)]
    parts += _fringes(page, span_s)
    parts += [*_level(page, span_s), *_bearing(page, span_s)]
    is_mapped, right = has_map(encounters, row), None
    heads = title_lines(page)
    heights = [part.height for part in parts]
    if view.is_wide and (is_mapped or view.stands_alone):
        figure, body = titled_figure(heads, view, max(sum(heights) + 0.5, 3.6))
        left, right = side_by_side(body, 2.25, 1.0)
    elif is_mapped:
        figure, body = titled_figure(heads, view, sum(heights) + 0.5 + MAP_IN)
        left, right = stacked(body, sum(heights) + 0.5, MAP_IN)
    else:
        figure, left = titled_figure(heads, view, sum(heights) + 0.5)
    for panel in draw_parts(parts, left, scene.clock, span_s, view.ticks):
        _mark(page.fit, panel)
    if right is not None:
        _fill_side(page, right, is_mapped=is_mapped)
    return figure


def title_lines(page: PassagePage) -> list[HeadLine]:
    """Return the lines above the panels."""
    row, fit = page.row, page.fit
    first = passage_title(row)
    second = [f"passage {fit.contact}", f"sensor {row['sensor']}"]
    if row["course_deg"] is not None:
        course = Head("", "course_deg", 0, "course_std_deg").text(row)
        second.append(f"course {course}\u00b0")
    if row["side"]:
        second.append(f"sensor to {row['side']}")
    n_lines = len(row["rest_frequencies_hz"])
    second.append(f"{n_lines or 'no'} line{'' if n_lines == 1 else 's'}")
    second.append(row["status"])
    found = [HeadLine(first), HeadLine(" \u00b7 ".join(second))]
    if fit.misfit >= MARKED_MISFIT:
        text = (
            f"\u26a0 misfit: the lines leave the fit by {100 * fit.misfit:.0f} % of "
            f"the Doppler shift beyond their noise"
        )
        found.append(HeadLine(text, warns=True))
    if row["extrapolated"]:
        text = "\u26a0 extrapolated: the closest approach was not recorded"
        found.append(HeadLine(text, warns=True))
    return found


def passage_title(row: Row) -> str:
    """Return when, how fast, how near and who, with deviations.

    ``row``: the passage, as `json_rows` gives it.
    """
    return f"{_when(row)}{_speed(row)}{_range(row)}{_vessel(row)}"


def _when(row: Row) -> str:
    if row["time_utc"]:
        std = row["time_std_s"]
        digits = 0 if std is None or std >= 1.0 else 1
        return f"{utc_text(row['time_utc'], digits)} UTC"
    return f"closest at {Head('', 'time_s', 1, 'time_std_s').text(row)} s"


def _speed(row: Row) -> str:
    if row["speed_mps"] is None:
        return ""
    knots = {"v": row["speed_mps"] / KNOT_MPS}
    if row["speed_std_mps"] is not None:
        knots["s"] = row["speed_std_mps"] / KNOT_MPS
    return f"   {Head('', 'v', 1, 's').text(knots)} kn"


def _range(row: Row) -> str:
    if row["slant_range_m"] is not None:
        return f"   {Head('', 'slant_range_m', 0, 'slant_range_std_m').text(row)} m"
    if row["range_over_speed_s"] is None:
        return ""
    text = Head("", "range_over_speed_s", 1, "range_over_speed_std_s").text(row)
    return f"   range/speed {text} s"


def _vessel(row: Row) -> str:
    return f"   {row['vessel']['name']}" if row["vessel"] else ""


def _mark(fit: ReportedPassage, ax: "Axes") -> None:
    """Mark when the sound of the closest approach arrived."""
    low, high = ax.get_xlim()
    if low < fit.arrival_s < high:
        ax.axvline(
            fit.arrival_s, linewidth=0.7, linestyle=(0, (1, 3)), color="black", zorder=1
        )


def _fringes(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the image of fringes with the curves of the passage."""
    fringes, fit = page.scene.first(Fringes), page.fit
    if fringes is None or not fringes.frequency_hz.size or not np.isfinite(fit.width_s):
        return []
    told = [(fit.time_s, fit.width_s, fit.mach)]

    def draw(ax: "Axes") -> None:
        calm(ax)
        draw_fringes(ax, fringes, span_s, told)

    return [PagePart(1.9, draw)]


def _residuals(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return what the lines leave of their curve."""
    fit = page.fit
    own = fit.rest_rows
    if not own.size or not fit.is_drawn or fit.mach <= 0:
        return []
    time_s, left, weight = _left(page.scene, fit, own, span_s)
    if time_s.size < 3:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        color = contact_color(fit.contact)
        is_marked = fit.misfit >= MARKED_MISFIT
        thin = slice(None, None, -(-time_s.size // 6000))
        ax.plot(time_s[thin], left[thin], ".", ms=2.6, alpha=0.35, color=color,
                mec="none", rasterized=True)  # fmt: skip
        middle, mean, std = _block_means(time_s, left, weight, BLOCKS * fit.width_s)
        ax.errorbar(middle, mean, BAND_DEVIATIONS * std, fmt="o", ms=2.8, lw=0.9,
                    color="black")  # fmt: skip
        grid = np.linspace(*span_s, 300)
        band = 100 * BAND_DEVIATIONS * fit.shift(grid)[1] / fit.mach
        ax.fill_between(grid, -band, band, color=color, alpha=0.25, lw=0)
        ax.axhline(0.0, color=color, lw=0.8)
        reach = 3.0 * float(np.median(np.abs(left))) / 0.6745
        reach = max(reach, 1.3 * float(np.abs(mean).max(initial=0.0)), 2.0)
        ax.set_ylim(-reach, reach)
        ax.set_ylabel("residual\n(% of v/c)", fontsize=8)
        if is_marked:
            ax.set_facecolor("#fdecea")
            ax.text(
                0.99, 0.92, f"misfit {100 * fit.misfit:.0f} %", transform=ax.transAxes,
                ha="right", va="top", fontsize=8, fontweight="bold", color=WARNING,
            )  # fmt: skip

    return [PagePart(1.15, draw)]


def _left(
    scene: Scene, fit: ReportedPassage, own: IntArray, span_s: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, residuals in % of v/c, and weights of all lines of a passage."""
    empty: FloatArray = np.zeros(0)
    times, values, weights = [empty], [empty], [empty]
    for k in own:
        found = measured_line(scene, fit.contact, int(fit.encounters.rest_line_id[k]))
        inside = (found.time_s >= span_s[0]) & (found.time_s <= span_s[1])
        rest = float(fit.encounters.rest_frequency_hz[k])
        time_s, std = found.time_s[inside], found.std_hz[inside] / rest
        shift = found.frequency_hz[inside] / rest - 1.0
        times.append(time_s)
        values.append(100 * (shift - fit.shift(time_s)[0]) / fit.mach)
        with np.errstate(divide="ignore", invalid="ignore"):
            weights.append(np.nan_to_num(1 / std**2, nan=1.0, posinf=1.0))
    found_values = np.concatenate(values)
    known = np.isfinite(found_values)  # what the fit says nothing of is left out
    return (
        np.concatenate(times)[known],
        found_values[known],
        np.concatenate(weights)[known],
    )


def _block_means(
    time_s: FloatArray, values: FloatArray, weight: FloatArray, length_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middles, weighted means and their deviations over blocks of time."""
    number = np.floor((time_s - time_s.min()) / max(length_s, 1e-9)).astype(int)
    _, block = np.unique(number, return_inverse=True)
    total = np.bincount(block, weight)
    mean = np.bincount(block, weight * values) / total
    middle = np.bincount(block, weight * time_s) / total
    scatter = np.bincount(block, (weight * (values - mean[block])) ** 2)
    return middle, mean, np.sqrt(scatter) / total


def _level(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return the level with the vessels' shares as the fits say."""
    measured_s, level, name = _measured_level(page)
    inside = (measured_s >= span_s[0]) & (measured_s <= span_s[1]) & np.isfinite(level)
    if inside.sum() < 2:
        return []
    time_s, level_db = measured_s[inside], level[inside]

    def draw(ax: "Axes") -> None:
        calm(ax)
        thin = slice(None, None, -(-time_s.size // 4000))
        ax.plot(time_s[thin], level_db[thin], ".", ms=2.6, color=MEASURED,
                alpha=0.6, mec="none", rasterized=True)  # fmt: skip
        ax.set_ylabel(name, fontsize=8)
        low, high = float(np.quantile(level_db, 0.005)), float(level_db.max())
        ax.set_ylim(low - 1.5, high + 1.5)
        _draw_level_fit(page.fit, time_s, level_db, span_s, ax)

    return [PagePart(1.15, draw)]


def _measured_level(page: PassagePage) -> tuple[FloatArray, FloatArray, str]:
    """Return times, levels and what they are: of the sound, or of a table."""
    levels, series = page.scene.first(Levels), page.scene.first(Series)
    if levels is not None:
        name = (
            f"level {levels.band_low_hz:.0f}-{levels.band_high_hz:.0f} Hz\n"
            f"(dB re {figure_text(levels.reference)})"
        )
        return levels.frames.time_s, levels.level_db, name
    if series is None:
        return np.zeros(0), np.zeros(0), ""
    rows = series.contact == page.fit.contact
    return series.time_s[rows], series.level_db[rows], "level (dB)"


def _draw_level_fit(
    fit: ReportedPassage,
    time_s: FloatArray,
    level_db: FloatArray,
    span_s: tuple[float, float],
    ax: "Axes",
) -> None:
    """Draw the vessel over the background, with the deviation of its level."""
    found = fit.encounters
    peak = float(found.received_level_db[fit.row])
    if not np.isfinite(peak) or not fit.is_drawn:
        return
    every = [ReportedPassage(found, row) for row in range(found.n_encounters)]
    heard = [
        f for f in every
        if f.is_drawn and np.isfinite(found.received_level_db[f.row])
    ]  # fmt: skip
    grid = np.linspace(*span_s, 400)

    def power(at_s: FloatArray, added_db: float) -> FloatArray:
        total: FloatArray = np.zeros(at_s.size)
        for f in heard:
            own = float(found.received_level_db[f.row])
            own += added_db if f.row == fit.row else 0.0
            total = total + 10 ** ((own + f.spread_db(at_s)) / 10)
        return total

    background = max(
        float(np.nanmedian(10 ** (level_db / 10) - power(time_s, 0.0))), 0.0
    )
    std = np.nan_to_num(float(found.received_level_std_db[fit.row]))
    curves = [
        10 * np.log10(power(grid, add) + background)
        for add in (0.0, -BAND_DEVIATIONS * std, BAND_DEVIATIONS * std)
    ]
    color = contact_color(fit.contact)
    ax.plot(grid, curves[0], color=color, lw=1.1)
    ax.fill_between(grid, curves[1], curves[2], color=color, alpha=0.25, lw=0)
    low, high = ax.get_ylim()
    ax.set_ylim(low, float(np.nanmax(curves[0] + 1.0, initial=high)))


def _bearing(page: PassagePage, span_s: tuple[float, float]) -> list[PagePart]:
    """Return bearings of the passage as measured and as fitted."""
    levels, lines, fit = page.scene.first(Levels), page.scene.first(Lines), page.fit
    measured: list[tuple[FloatArray, FloatArray, str]] = []
    if levels is not None:
        known = levels.bearing_std_deg < USABLE_BEARING_DEG
        measured.append(
            (levels.frames.time_s[known], levels.bearing_deg[known], MEASURED)
        )
    if lines is not None:
        own = fit.encounters.rest_line_id[fit.encounters.rest_encounter == fit.row]
        known = np.isin(lines.line, own)
        known &= lines.measured_bearing_std_deg < USABLE_BEARING_DEG
        measured.append(
            (lines.time_s[known], lines.measured_bearing_deg[known],
             contact_color(fit.contact))
        )  # fmt: skip
    series = page.scene.first(Series)
    if series is not None:
        known = (series.contact == fit.contact) & np.isfinite(series.bearing_deg)
        color = contact_color(fit.contact)
        measured.append((series.time_s[known], series.bearing_deg[known], color))
    shown = [
        (time_s[inside], bearing[inside], color)
        for time_s, bearing, color in measured
        for inside in [(time_s >= span_s[0]) & (time_s <= span_s[1])]
        if inside.any()
    ]
    grid = np.linspace(*span_s, 400)
    fitted = fit.bearing(grid)
    if not shown and fitted is None:
        return []

    def draw(ax: "Axes") -> None:
        calm(ax)
        for time_s, bearing, color in shown:
            thin = slice(None, None, -(-time_s.size // 4000))
            ax.plot(time_s[thin], np.mod(bearing[thin], 360.0), ".", ms=3.0, color=color,
                    alpha=0.4, mec="none", rasterized=True)  # fmt: skip
        if fitted is not None:
            _draw_bearing_fit(fit, grid, fitted, ax)
        ax.set(ylim=(0.0, 360.0), yticks=range(0, 361, 90))
        ax.set_ylabel("bearing (deg)", fontsize=8)

    return [PagePart(1.15, draw)]


def _draw_bearing_fit(
    fit: ReportedPassage,
    grid: FloatArray,
    fitted: tuple[FloatArray, FloatArray],
    ax: "Axes",
) -> None:
    bearing, std = fitted
    color = contact_color(fit.contact)
    middle = broken_bearing(bearing)
    ax.plot(grid, middle, color=color, lw=0.9)
    half = BAND_DEVIATIONS * std
    ax.fill_between(grid, middle - half, middle + half, color=color, alpha=0.25, lw=0)


def _fill_side(page: PassagePage, side: "SubFigure", *, is_mapped: bool) -> None:
    """Fill the side of the page: the map, and the numbers where there is room."""
    if not (page.view.is_wide and page.view.stands_alone):
        draw_map(page.scene, page.fit, side.subplots())
        return
    if is_mapped:
        upper, lower = side.subplots(2, 1, height_ratios=[1.25, 1.0])
        draw_map(page.scene, page.fit, upper)
    else:
        lower = side.subplots()
    lower.axis("off")
    facts = fact_lines(page.row)
    lower.text(
        0.0, 1.0, "\n".join(figure_text(f"{name}") for name, _ in facts), va="top",
        fontsize=8, color=MEASURED, linespacing=1.5, transform=lower.transAxes,
    )  # fmt: skip
    lower.text(
        0.42, 1.0, "\n".join(figure_text(value) for _, value in facts), va="top",
        fontsize=8, linespacing=1.5, transform=lower.transAxes,
    )  # fmt: skip


FACTS = (
    ("speed", Head("", "speed_mps", 2, "speed_std_mps"), "m/s"),
    ("slant range", Head("", "slant_range_m", 1, "slant_range_std_m"), "m"),
    ("horizontal range", Head("", "horizontal_range_m", 1, "horizontal_range_std_m"), "m"),
    ("range/speed", Head("", "range_over_speed_s", 2, "range_over_speed_std_s"), "s"),
    ("course", Head("", "course_deg", 1, "course_std_deg"), "deg"),
    ("bearing", Head("", "bearing_deg", 1, "bearing_std_deg"), "deg"),
    ("received level", Head("", "received_level_db", 1, "received_level_std_db"), "dB re {}"),
    ("source level", Head("", "source_level_db", 1, "source_level_std_db"), "dB re {}"),
    ("evidence", Head("", "rest_frame_evidence", 1), "nepers"),
    ("misfit", Head("", "misfit", 2), "of v/c"),
)  # fmt: skip
"""What stands beside the panels: name, how it is written, unit."""


def fact_lines(row: Row) -> list[tuple[str, str]]:
    """Return what is known of a passage, by name, as text with units.

    ``row``: the passage, as `json_rows` gives it.
    """
    found = [
        (name, f"{head.text(row)} {unit.format(row['level_reference'])}")
        for name, head, unit in FACTS
        if row.get(head.key) is not None
    ]
    rest = sorted(f for f in row["rest_frequencies_hz"] if f is not None)
    for number in range(0, len(rest), 3):
        part = ", ".join(f"{f:.2f}" for f in rest[number : number + 3])
        end = " Hz" if number + 3 >= len(rest) else ","
        found.append(("at rest" if number == 0 else "", part + end))
    if row.get("reading") not in {None, "straight"}:  # as in the table
        weight = Head("", "reading_weight", 2).text(row)
        found.append(("reading", f"{row['reading']}, weight {weight}"))
    found.append(("sound speed", f"{row['sound_speed_mps']:g} m/s"))
    return found
