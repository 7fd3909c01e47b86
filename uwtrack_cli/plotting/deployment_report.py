"""The report of a folder: a deployment at a glance, its days, its passages.

**Method.** The calendar has a row per day and sensor: grey where there is sound, darker
where a vessel is detected, a mark where one passes. Below it stand the medians of every
hour in decidecade bands and of the whole band, the ways of the vessels past their
sensors, how many passed at which hour, speed and range, and a picture of each passage
that leads to its page. Of more days or passages than there is room for, the last days
and the first passages are drawn, which is said.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uwtrack_cli.acoustics.geometry import compass_unit
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.files.tables.summaries import NOT_KNOWN, passage_columns
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.files.utc import parse_utc
from uwtrack_cli.flow.deployment import Deployment
from uwtrack_cli.flow.long_term import HourLevel, by_hour
from uwtrack_cli.flow.passages import PassageRow
from uwtrack_cli.flow.recorder_folder import DAY_NS
from uwtrack_cli.flow.sound_hours import (
    HOUR_NS,
    SoundSpan,
    by_day,
    day_name,
    hours_per_day,
    total_h,
)
from uwtrack_cli.plotting.html_page import page_html, picture_of_page
from uwtrack_cli.plotting.maps import (
    draw_circle,
    draw_way,
    fit_limits,
    furnish,
)
from uwtrack_cli.plotting.page_layout import PagePart, page_figure, timed
from uwtrack_cli.plotting.picture import FrequencyAxis, cell_edges
from uwtrack_cli.plotting.style import (
    CONTACT_COLORS,
    MEASURED,
    NO_SOUND,
    Clock,
    calm,
    contact_color,
    draw_cells,
    name_place,
    new_figure,
)
from uwtrack_cli.plotting.thumbnail import Glance
from uwtrack_cli.plotting.view import Units, View

MOST_ROWS = 62
"""Days that are drawn."""

MOST_PASSAGES = 1000
"""Passages that are listed."""

MOST_WAYS = 300
"""Passages on the map."""

LABELS_DEG = 37.0
"""Bearing from one number on a circle to the next, so that they stand apart."""

MARKERS = "ov^sD*"
"""Marks of the sensors, beside their colours."""

CAPTION = "Grey: sound. Dark: a vessel may be detected. Marks: passages."

OF_MAP = (
    "Ways past the sensor, which is the origin, by their course and bearing; a circle is "
    "the range of a vessel whose direction is not known."
)

HEARD_COLOR = "#8c8c8c"

BINS = 12
"""Bars of speed and range."""


def deployment_html(
    deployment: Deployment,
    title: str,
    glance: Glance = lambda _row, _number: None,
    units: Units = "kn",
) -> str:
    """Return the report of a folder as HTML.

    ``glance``: gives picture and link of a passage with its number, None for none.
    ``units``: unit of every speed.
    """
    passages, n = deployment.passages, len(deployment.passages)
    count = f"{n or 'no'} passage{'' if n == 1 else 's'}"
    shown = [glance(row, k) for k, row in enumerate(passages, 1)]
    return page_html(
        "deployment.html", title=title, warnings=deployment.problems,
        result=f"{count} in {total_h(deployment.sound):.1f} hours of sound",
        listened=deployment.listened, vessels={p.vessel for p in passages if p.vessel},
        pictures=list(_pictures(deployment, units)),
        gallery=[one for one in shown if one is not None],
        tables=list(_tables(deployment, units)) if passages else [],
        more=n - MOST_PASSAGES,
    )  # fmt: skip


def _pictures(deployment: Deployment, units: Units) -> Iterator[dict[str, Any]]:
    """Yield the pictures of the whole, each where it has something to say."""
    passages, n_days = deployment.passages, len(_days(deployment))
    parts: list[tuple[str, Callable[[View], Figure], str, str]] = []
    if n_days:
        more = f" The last {MOST_ROWS} of {n_days} days." if n_days > MOST_ROWS else ""
        shows = f"Calendar of {n_days} days of sound with {len(passages)} passages."
        parts.append(
            ("Calendar", partial(calendar_figure, deployment), shows, CAPTION + more)
        )
    hours = by_hour(hour for one in deployment.listened for hour in one.hours)
    for key in dict.fromkeys((h.sensor, h.reference) for h in hours):
        own = [h for h in hours if (h.sensor, h.reference) == key]
        shows = f"Medians of {len(own)} hours in decidecade bands, and of all of them."
        name = f"Levels by the hour, sensor {key[0]}"
        parts.append((name, partial(hours_figure, own), shows, ""))
    if passages:
        shows = f"Histograms of {len(passages)} passages by hour, speed and range."
        name = "Passages by hour, speed and range"
        parts.append((name, partial(histogram_figure, passages), shows, ""))
    ways = [row for row in passages if row.slant_range_m is not None][:MOST_WAYS]
    if ways:
        shows = f"Map of {len(ways)} passages about their sensors."
        parts.append(("Map", partial(map_figure, ways), shows, OF_MAP))
    for name, draw, shows, text in parts:
        picture = picture_of_page(draw, units, shows)
        yield {"heading": name, "text": text, "picture": picture}


def _days(deployment: Deployment) -> list[int]:
    """Return the days on which there was sound, as numbers since 1970, ascending."""
    return sorted({day for day, _ in by_day(deployment.sound)})


def calendar_figure(deployment: Deployment, view: View) -> Figure:
    """Return the calendar: a row per day, hours to the right."""
    days = _days(deployment)[-MOST_ROWS:]
    sensors = sorted({span.sensor for _, span in by_day(deployment.sound)})
    place = {day: len(days) - 1 - number for number, day in enumerate(days)}
    rows_in = max(0.28 * len(days) * max(1, len(sensors)) ** 0.5, 0.6)
    figure = new_figure(view.width_in, rows_in + 0.8)
    ax = figure.subplots()
    height = 0.8 / max(1, len(sensors))
    for number, sensor in enumerate(sensors):
        shift = 0.4 - (number + 0.5) * height
        _draw_sensor(deployment, sensor, number, place, shift, height, ax)
    every = max(1, len(days) // 31)
    names = [day_name(day) for day in days]
    ax.set_yticks([place[d] for d in days][::every], names[::every], fontsize=8)
    ax.set(ylim=(-0.6, len(days) - 0.4), xlim=(0, 24))
    calm(ax)
    if len(sensors) > 1 and deployment.passages:
        ax.legend(fontsize=8, loc="upper right", ncols=min(4, len(sensors)))
    ax.set_xticks(range(0, 25, 3 if view.is_wide else 6))
    ax.set_xlabel("hour of the day (UTC)", fontsize=9)
    return figure


def _draw_sensor(
    deployment: Deployment, sensor: str, number: int, place: dict[int, int],
    shift: float, height: float, ax: Axes,
) -> None:  # fmt: skip
    """Draw sound, vessels heard and passages of one sensor."""
    sound = [span for span in deployment.sound if span.sensor == sensor]
    own = [one for one in deployment.listened if one.sensor == sensor]
    heard = [SoundSpan(sensor, "", *span) for one in own for span in one.heard_ns]
    for spans, color, share in ((sound, NO_SOUND, 1.0), (heard, HEARD_COLOR, 0.5)):
        for day, span in by_day(spans):
            if day in place:
                left = (span.begin_ns - day * DAY_NS) / HOUR_NS
                ax.barh(place[day] + shift, total_h([span]), left=left, color=color,
                        height=share * height, lw=0)  # fmt: skip
    at = [parse_utc(p.time_utc) for p in deployment.passages
          if p.sensor == sensor and p.time_utc]  # fmt: skip
    shown = [(t % DAY_NS / DAY_NS * 24, place[t // DAY_NS] + shift)
             for t in at if t // DAY_NS in place]  # fmt: skip
    if shown:
        ax.plot(
            *np.array(shown).T, ls="none", marker=MARKERS[number % len(MARKERS)], ms=5,
            color=CONTACT_COLORS[number % len(CONTACT_COLORS)], mec="white", mew=0.5,
            label=figure_text(sensor), zorder=3,
        )  # fmt: skip


def hours_figure(hours: Sequence[HourLevel], view: View) -> Figure:
    """Return medians of hours: in decidecade bands, and of the whole band below.

    ``hours``: hours of one sensor, in order.
    """
    first, last = hours[0].hour, hours[-1].hour
    centre = max((one.centre_hz for one in hours), key=len)
    level = np.full((last - first + 1, centre.size), np.nan)
    whole = np.full((last - first + 1, 3), np.nan)
    names = np.round(centre, 3)
    for one in hours:
        own = np.round(one.centre_hz, 3)
        row = level[one.hour - first]
        row[np.isin(names, own)] = one.median_db[np.isin(own, names)]
        whole[one.hour - first] = one.whole_db
    edges_s = 3600.0 * np.arange(last - first + 2)
    edges_hz = 10.0 ** cell_edges(np.log10(centre)) if centre.size > 1 else centre[0] * (
        np.array([0.9, 1.1]))  # fmt: skip
    unit = f"dB re {hours[0].reference}".replace("1 uPa", "1 \u00b5Pa")

    def bands(ax: Axes) -> None:
        bar = f"median in a decidecade\n{unit}"
        FrequencyAxis(edges_hz[0], edges_hz[-1], is_log=True).set_axis(ax)
        draw_cells(ax, edges_s, edges_hz, level, (None, None), bar)

    def all_bands(ax: Axes) -> None:
        calm(ax, f"all bands, median\nand 10-90 % ({unit})")
        low, middle, high = whole.T
        ax.stairs(high, edges_s, baseline=low, fill=True, color=MEASURED, alpha=0.3)
        ax.stairs(middle, edges_s, baseline=None, color=MEASURED, lw=1.0)

    parts, span_s = [PagePart(2.6, bands), PagePart(1.3, all_bands)], (0.0, edges_s[-1])
    clock = Clock(first * HOUR_NS)
    return page_figure([], view, [timed(parts, view, clock, span_s)])


def histogram_figure(passages: Sequence[PassageRow], view: View) -> Figure:
    """Return how many passed at which hour, speed and range; who has none is counted."""
    scale = KNOT_MPS if view.units == "kn" else 1.0
    hours = [parse_utc(p.time_utc) % DAY_NS / HOUR_NS for p in passages if p.time_utc]
    speeds = [p.speed_mps / scale for p in passages if p.speed_mps is not None]
    ranges = [p.slant_range_m for p in passages if p.slant_range_m is not None]
    figure = new_figure(view.width_in, 2.3 if view.is_wide else 6.0)
    panels = np.ravel(figure.subplots(*((1, 3) if view.is_wide else (3, 1))))
    named = (
        (hours, "hour of the day (UTC)", np.arange(25.0)),
        (speeds, f"speed ({view.units})", _bins(speeds)),
        (ranges, "range at closest approach (m)", _bins(ranges)),
    )
    for ax, (values, name, bins) in zip(panels, named, strict=True):
        calm(ax).hist(values, bins=list(bins), color=HEARD_COLOR, rwidth=0.85)
        missing = len(passages) - len(values)
        ax.set_xlabel(name + (f"; {missing} not known" if missing else ""), fontsize=8)
        ax.yaxis.get_major_locator().set_params(integer=True)
    panels[0].set_ylabel("passages", fontsize=8)
    panels[0].set_xticks(range(0, 25, 6))
    return figure


def _bins(values: Sequence[float]) -> FloatArray:
    """Return edges of bars from zero on that hold every value."""
    top = max(values, default=1.0)
    step = 10.0 ** np.floor(np.log10(max(top / BINS, 1e-6)))
    step *= next(n for n in (1.0, 2.0, 5.0, 10.0) if n * step * BINS >= top)
    return np.asarray(step * np.arange(int(top / step) + 2))


def map_figure(ways: Sequence[PassageRow], view: View) -> Figure:
    """Return the ways of passages past their sensors, which are the origin."""
    figure = new_figure(view.width_in, 5.0 if view.is_wide else view.width_in)
    ax = figure.subplots()
    for number, row in enumerate(ways, 1):
        distance = row.horizontal_range_m or row.slant_range_m or 0.0
        bearing = LABELS_DEG * number if row.bearing_deg is None else row.bearing_deg
        place = distance * compass_unit(bearing)
        if row.bearing_deg is None or row.course_deg is None:
            draw_circle(ax, distance, 0.0, number)
        else:
            draw_way(ax, place, row.course_deg, 2.0 * distance, number)
        name_place(ax, place, str(number), contact_color(number), (4, 4))
    ax.plot(0.0, 0.0, "k^", ms=7)
    fit_limits(ax, 0.9 * view.width_in / 4.5 if view.is_wide else 1.0)
    furnish(ax)
    return figure


def _tables(deployment: Deployment, units: Units) -> Iterator[dict[str, Any]]:
    """Yield the counts per day and vessel, and all passages; the counts add up."""
    passages, hours = deployment.passages, hours_per_day(deployment.sound)
    counts = Counter((p.time_utc or "unknown")[:10] for p in passages)
    days = [
        (day, f"{hours[day]:.1f}" if day in hours else NOT_KNOWN, str(counts[day]))
        for day in sorted(hours.keys() | counts.keys())
    ]
    yield {
        "heading": "Days", "heads": ("day", "sound h", "passages"), "rows": days,
        "total": ("all", f"{sum(hours.values()):.1f}", str(len(passages))),
    }  # fmt: skip
    vessels = Counter(p.vessel or "" for p in passages).most_common()
    if any(name for name, _ in vessels):
        yield {
            "heading": "Vessels", "heads": ("vessel", "passages"),
            "rows": [(name or "not named", str(count)) for name, count in vessels],
            "total": ("all", str(len(passages))),
        }  # fmt: skip
    listed = [asdict(row) for row in passages[:MOST_PASSAGES]]
    for row in listed:
        row["recording"] = row["file"].rpartition("/")[2]
    known = {"passage": tuple(str(k + 1) for k in range(len(listed)))}
    known |= passage_columns(listed, units)
    known.pop("contact", None)
    if "level dB" in known:  # the two references never mix
        known["level dB"] = tuple(
            cell if cell == NOT_KNOWN else f"{cell} re {row['level_reference']}"
            for cell, row in zip(known["level dB"], listed, strict=True)
        )
    rows = list(zip(*known.values(), strict=True))
    heads = [{"recording": "result"}.get(head, head) for head in known]
    yield {"heading": "Passages", "heads": heads, "rows": rows}
