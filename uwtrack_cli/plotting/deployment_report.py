"""The report of a folder: a deployment at a glance, its days, its passages.

**Method.** The calendar has a row per day and sensor: grey where there is sound, darker
where a vessel is detected, a mark where one passes. Below it stand the medians of every
hour in decidecade bands and of the whole band, the tracks of the vessels past their
sensors, how many passed at which hour, speed and range, and a picture of each passage
that leads to its page: the part of the overview where its lines are, with the fit, from
its product alone. Of more days or passages than there is room for, the last days
and the first passages are drawn, which is said.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from uwtrack_cli.acoustics.geometry import compass_unit
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import Container
from uwtrack_cli.errors import DataError, UwtrackError
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
from uwtrack_cli.plotting import html_page, maps, panels, style
from uwtrack_cli.plotting.layout import PagePart, page_figure, timed
from uwtrack_cli.plotting.page import scenes_of
from uwtrack_cli.plotting.passage import ReportedPassage, passages_of
from uwtrack_cli.plotting.picture import FrequencyAxis, cell_edges
from uwtrack_cli.plotting.style import Clock
from uwtrack_cli.plotting.view import Scene, Units, View

THUMB_IN, THUMB_DPI = (7.0, 2.3), 90
"""Size of a small picture, inches, and its dots in each."""

MOST_THUMBNAILS = 60
"""Passages that have a small picture; the others are in the table."""

Glance = Callable[[PassageRow, int], dict[str, Any] | None]
"""Gives what the report has of a passage with its number; None beyond the most."""

MOST_ROWS = 62
"""Days that are drawn."""

MOST_PASSAGES = 1000
"""Passages that are listed."""

MOST_TRACKS = 300
"""Passages on the map."""

LABELS_DEG = 37.0
"""Bearing from one number on a circle to the next, so that they stand apart."""

MARKERS = "ov^sD*"
"""Marks of the sensors, beside their colours."""

CAPTION = "Grey: sound. Dark: a vessel may be detected. Marks: passages."

OF_MAP = (
    "Tracks past the sensor, which is the origin, by their course and bearing; a circle is "
    "the range of a vessel whose direction is not known."
)

HEARD = "#8c8c8c"

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
    return html_page.page_html(
        "deployment.html", title=title, warnings=deployment.problems,
        result=f"{count} in {total_h(deployment.sound):.1f} hours of sound",
        listened=deployment.listened, vessels={p.vessel for p in passages if p.vessel},
        pictures=[
            {"heading": heading, "text": text,
             "picture": html_page.picture_of_page(draw, units, shows)}
            for heading, text, shows, draw in _pictures(deployment)
        ],
        gallery=[one for one in shown if one is not None],
        tables=list(_tables(deployment, units)) if passages else [],
        more=n - MOST_PASSAGES,
    )  # fmt: skip


def _pictures(deployment: Deployment) -> Iterator[tuple[str, str, str, Callable[[View], Figure]]]:
    """Yield headings, captions, alternative texts and pictures of the whole.

    Each is there where it has something to say.
    """
    passages, n = deployment.passages, len(_days(deployment))
    if n:
        more = f" The last {MOST_ROWS} of {n} days." if n > MOST_ROWS else ""
        shows = f"Calendar of {n} days of sound with {len(passages)} passages."
        yield "Calendar", CAPTION + more, shows, partial(calendar_figure, deployment)
    hours = by_hour(hour for one in deployment.listened for hour in one.hours)
    for key, group in groupby(hours, lambda hour: (hour.sensor, hour.reference)):
        own = list(group)
        shows = f"Medians of {len(own)} hours in decidecade bands, and of all of them."
        heading = f"Levels by the hour, sensor {key[0]}"
        yield heading, "", shows, partial(hours_figure, own)
    if passages:
        shows = f"Histograms of {len(passages)} passages by hour, speed and range."
        heading = "Passages by hour, speed and range"
        yield heading, "", shows, partial(histogram_figure, passages)
    tracks = [row for row in passages if row.slant_range_m is not None][:MOST_TRACKS]
    if tracks:
        shows = f"Map of {len(tracks)} passages about their sensors."
        yield "Map", OF_MAP, shows, partial(map_figure, tracks)


def _days(deployment: Deployment) -> list[int]:
    """Return the days on which there was sound, as numbers since 1970, ascending."""
    return sorted({day for day, _ in by_day(deployment.sound)})


def calendar_figure(deployment: Deployment, view: View) -> Figure:
    """Return the calendar: a row per day, hours to the right."""
    days = _days(deployment)[-MOST_ROWS:]
    sensors = sorted({span.sensor for _, span in by_day(deployment.sound)})
    place = {day: len(days) - 1 - number for number, day in enumerate(days)}
    rows_in = max(0.28 * len(days) * max(1, len(sensors)) ** 0.5, 0.6)
    figure = style.new_figure(view.width_in, rows_in + 0.8)
    ax = figure.subplots()
    height = 0.8 / max(1, len(sensors))
    for number, sensor in enumerate(sensors):
        shift = 0.4 - (number + 0.5) * height
        own = [one for one in deployment.listened if one.sensor == sensor]
        heard = [SoundSpan(sensor, "", *span) for one in own for span in one.heard_ns]
        sound = [span for span in deployment.sound if span.sensor == sensor]
        for spans, color, share in ((sound, style.NO_SOUND, 1.0), (heard, HEARD, 0.5)):
            for day, span in by_day(spans):
                if day in place:
                    left = (span.begin_ns - day * DAY_NS) / HOUR_NS
                    ax.barh(place[day] + shift, total_h([span]), left=left, lw=0,
                            color=color, height=share * height)  # fmt: skip
        at = [divmod(parse_utc(p.time_utc), DAY_NS) for p in deployment.passages
              if p.sensor == sensor and p.time_utc]  # fmt: skip
        if marks := [(ns / HOUR_NS, place[day] + shift) for day, ns in at if day in place]:
            color = style.CONTACT_COLORS[number % len(style.CONTACT_COLORS)]
            ax.plot(
                *np.array(marks).T, ls="none", marker=MARKERS[number % len(MARKERS)],
                ms=5, color=color, mec="white", mew=0.5, label=figure_text(sensor),
                zorder=3,
            )  # fmt: skip
    every = max(1, len(days) // 31)
    names = [day_name(day) for day in days]
    ax.set_yticks([place[d] for d in days][::every], names[::every], fontsize=8)
    ax.set(ylim=(-0.6, len(days) - 0.4), xlim=(0, 24))
    style.calm(ax)
    if len(sensors) > 1 and deployment.passages:
        ax.legend(fontsize=8, loc="upper right", ncols=min(4, len(sensors)))
    ax.set_xticks(range(0, 25, 3 if view.is_wide else 6))
    ax.set_xlabel("hour of the day (UTC)", fontsize=9)
    return figure


def hours_figure(hours: Sequence[HourLevel], view: View) -> Figure:
    """Return medians of hours: in decidecade bands, and of the whole band below.

    ``hours``: hours of one sensor, in order.
    """
    first, last = hours[0].hour, hours[-1].hour
    bands_of = [np.round(one.centre_hz, 3) for one in hours]
    centre = np.unique(np.concatenate(bands_of))
    level = np.full((last - first + 1, centre.size), np.nan)
    whole = np.full((last - first + 1, 3), np.nan)
    for one, own in zip(hours, bands_of, strict=True):
        level[one.hour - first, np.searchsorted(centre, own)] = one.median_db
        whole[one.hour - first] = one.whole_db
    edges_s = 3600.0 * np.arange(last - first + 2)
    edges_hz = 10.0 ** cell_edges(np.log10(centre), width=0.1)
    unit = f"dB re {hours[0].reference}".replace("1 uPa", "1 \u00b5Pa")

    def bands(ax: Axes) -> None:
        bar = f"median in a decidecade\n{unit}"
        FrequencyAxis(edges_hz[0], edges_hz[-1], is_log=True).set_axis(ax)
        style.draw_cells(ax, edges_s, edges_hz, level, (None, None), bar)

    def all_bands(ax: Axes) -> None:
        style.calm(ax, f"all bands, median\nand 10-90 % ({unit})")
        low, middle, high = whole.T
        grey = style.MEASURED
        ax.stairs(high, edges_s, baseline=low, fill=True, color=grey, alpha=0.3)
        ax.stairs(middle, edges_s, baseline=None, color=grey, lw=1.0)

    parts, span_s = [PagePart(2.6, bands), PagePart(1.3, all_bands)], (0.0, edges_s[-1])
    clock = Clock(first * HOUR_NS)
    return page_figure([], view, [timed(parts, view, clock, span_s)])


def histogram_figure(passages: Sequence[PassageRow], view: View) -> Figure:
    """Return how many passed at which hour, speed and range; who has none is counted."""
    scale = KNOT_MPS if view.units == "kn" else 1.0
    hours = [parse_utc(p.time_utc) % DAY_NS / HOUR_NS for p in passages if p.time_utc]
    speeds = [p.speed_mps / scale for p in passages if p.speed_mps is not None]
    ranges = [p.slant_range_m for p in passages if p.slant_range_m is not None]
    figure = style.new_figure(view.width_in, 2.3 if view.is_wide else 6.0)
    grid = np.ravel(figure.subplots(*((1, 3) if view.is_wide else (3, 1))))
    named = {"hour of the day (UTC)": hours, f"speed ({view.units})": speeds,
             "range at closest approach (m)": ranges}  # fmt: skip
    for ax, (name, values) in zip(grid, named.items(), strict=True):
        top = max(values, default=1.0)
        nice = MaxNLocator(BINS, steps=(1, 2, 5, 10)).tick_values(0.0, top)
        bins = np.arange(25.0) if values is hours else nice
        style.calm(ax).hist(values, bins=list(bins), color=HEARD, rwidth=0.85)
        missing = len(passages) - len(values)
        ax.set_xlabel(name + (f"; {missing} not known" if missing else ""), fontsize=8)
        ax.yaxis.get_major_locator().set_params(integer=True)
    grid[0].set(xticks=range(0, 25, 6))
    grid[0].set_ylabel("passages", fontsize=8)
    return figure


def map_figure(tracks: Sequence[PassageRow], view: View) -> Figure:
    """Return the tracks of passages past their sensors, which are the origin."""
    figure = style.new_figure(view.width_in, 5.0 if view.is_wide else view.width_in)
    ax = figure.subplots()
    for number, row in enumerate(tracks, 1):
        distance = row.horizontal_range_m or row.slant_range_m or 0.0
        bearing = LABELS_DEG * number if row.bearing_deg is None else row.bearing_deg
        place = distance * compass_unit(bearing)
        if row.bearing_deg is None or row.course_deg is None:
            maps.draw_circle(ax, distance, 0.0, number)
        else:
            maps.draw_track(ax, place, row.course_deg, 2.0 * distance, number)
        style.name_place(ax, place, str(number), style.contact_color(number), (4, 4))
    ax.plot(0.0, 0.0, "k^", ms=7)
    maps.fit_limits(ax, 0.9 * view.width_in / 4.5 if view.is_wide else 1.0)
    maps.furnish(ax)
    return figure


def _tables(deployment: Deployment, units: Units) -> Iterator[dict[str, Any]]:
    """Yield the counts per day and vessel, and all passages; the counts add up."""
    passages, hours = deployment.passages, hours_per_day(deployment.sound)
    if undated := [span for span in deployment.sound if span.recording]:
        hours["unknown"] = total_h(undated)
    counts = Counter((p.time_utc or "unknown")[:10] for p in passages)
    days = sorted(hours.keys() | counts.keys())
    vessels = Counter(p.vessel or "" for p in passages).most_common()
    yield {
        "heading": "Days", "heads": ("day", "sound h", "passages"),
        "rows": [(day, f"{hours[day]:.1f}" if day in hours else NOT_KNOWN, f"{counts[day]}")
                 for day in days],
        "total": ("all", f"{sum(hours.values()):.1f}", f"{len(passages)}"),
    }  # fmt: skip
    if any(name for name, _ in vessels):
        yield {
            "heading": "Vessels", "heads": ("vessel", "passages"),
            "rows": [(name or "not named", f"{count}") for name, count in vessels],
            "total": ("all", f"{len(passages)}"),
        }  # fmt: skip
    listed = [{**asdict(row), "recording": row.file.rpartition("/")[2]}
              for row in passages[:MOST_PASSAGES]]  # fmt: skip
    known = {"passage": tuple(str(k + 1) for k in range(len(listed)))}
    known |= passage_columns(listed, units)
    known.pop("contact", None)
    known["result"] = known.pop("recording")
    if "level dB" in known:  # the two references never mix
        known["level dB"] = tuple(
            cell if cell == NOT_KNOWN else f"{cell} re {row['level_reference']}"
            for cell, row in zip(known["level dB"], listed, strict=True)
        )
    rows = list(zip(*known.values(), strict=True))
    yield {"heading": "Passages", "heads": list(known), "rows": rows}


def glances(
    folder: Path,
    read: Callable[[Path], list[Container]],
    units: Units,
    speed_up: float | None = None,
) -> Glance:
    """Return what gives small pictures of passages, their titles, links and sound.

    ``folder``: where the report lies; the page of a result beside it is linked to.
    ``read``: gives what a product holds. ``speed_up``: as in `sound_of`.
    """

    def glance(passage: PassageRow, number: int) -> dict[str, Any] | None:
        if number > MOST_THUMBNAILS:
            return None
        path, link = Path(passage.file), None
        try:
            scenes = scenes_of(read(path))
            scene = next(s for s in scenes if s.sensor in (None, passage.sensor))
            fit = next(f for f in passages_of(scene) if f.contact == passage.contact)
        except (UwtrackError, StopIteration):
            return None  # it has gone since the table was made
        page = path.with_suffix(".html").resolve()
        if page.is_file() and page.is_relative_to(folder.resolve()):
            is_alone = sum(bool(passages_of(one)) for one in scenes) < 2
            link = f"{quote(page.relative_to(folder.resolve()).as_posix())}#"
            link += html_page.anchor_of(fit.printed, is_alone=is_alone)
        figure = thumbnail(scene, fit)
        return {
            **html_page.passage_head(fit.printed, number, units), "file": path.name,
            "link": link, "picture": figure and html_page.png_data(figure, THUMB_DPI),
            "sound": html_page.sound_of(scene, fit, speed_up),
        }  # fmt: skip

    return glance


def thumbnail(scene: Scene, fit: ReportedPassage) -> Figure | None:
    """Return the small picture of a passage; None where the product carries none.

    It has the part of the overview where its lines are; without a line, all of it.
    """
    scene = scene.shown(View(), fit.span_s(scene, View()))
    overview, span_s = scene.overview, scene.span_s
    if overview is None or overview.frequency_hz.size < 2:
        return None
    rest = fit.encounters.rest_frequency_hz[fit.rest_rows]
    low, high = (float(overview.frequency_hz[end]) for end in (0, -1))
    if rest.size:
        margin = 0.3 * float(np.ptp(rest)) + 0.1 * float(rest.max())
        low = max(low, float(rest.min()) - margin)
        high = min(high, float(rest.max()) + margin)
    try:
        axis = FrequencyAxis(low, high, is_log=False)
        found = panels.picture_of(scene, axis) if low < high else None
    except DataError:
        found = None
    if found is None:
        return None
    figure = Figure(figsize=THUMB_IN)  # fixed margins: a layout costs more than it
    ax = figure.add_axes((0.09, 0.2, 0.9, 0.75))
    found.draw(ax, label="")
    if fit.has_doppler:
        time_s = np.linspace(*span_s, 200)
        ax.plot(time_s, rest * (1.0 + fit.shift(time_s)[0])[:, np.newaxis], lw=0.7,
                color=style.contact_color(fit.number),
                path_effects=style.halo())  # fmt: skip
    ax.axvline(fit.marked_s, color="white", lw=0.8, linestyle=(0, (2, 2)))
    scene.clock.set_axis(ax, span_s, 6)
    ax.set_ylabel("Hz", fontsize=8)
    figure.set_label(f"passage {fit.number}")
    return figure
