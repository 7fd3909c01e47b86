"""The report of a folder: a deployment at a glance, its days, its passages.

**Method.** The calendar has a row per day and sensor: grey where there is sound, darker
where a vessel is heard, a mark where one passes. Beside it stand the passages of each
hour of the day. Of more days than there is room for, the last ones are drawn.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from datetime import timedelta
from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli import __version__
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.files.tables.summaries import NOT_KNOWN, Head, utc_text
from uwtrack_cli.files.text_escaping import figure_text, html_text
from uwtrack_cli.files.utc import EPOCH, parse_utc
from uwtrack_cli.flow.deployment import Deployment
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
from uwtrack_cli.plotting.html_page import (
    facts_html,
    list_html,
    page_html,
    picture_html,
    table_html,
)
from uwtrack_cli.plotting.style import (
    CONTACT_COLORS,
    NARROW_IN,
    NO_SOUND,
    WIDE_IN,
    calm,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ROWS = 62
"""Days that are drawn."""

MOST_PASSAGES = 1000
"""Passages that are listed."""

MARKERS = "ov^sD*"
"""Marks of the sensors, beside their colours."""

CAPTION = "Grey: sound. Dark: a vessel may be heard. Marks: passages."

HEARD_COLOR = "#8c8c8c"

HEADS = (
    Head("speed m/s", "speed_mps", 2, "speed_std_mps"),
    Head("range m", "slant_range_m", 0, "slant_range_std_m"),
    Head("course deg", "course_deg", 0, "course_std_deg"),
    Head("level dB", "received_level_db", 1, "received_level_std_db"),
)


def deployment_html(deployment: Deployment, title: str) -> str:
    """Return the report of a folder as HTML."""
    n = len(deployment.passages)
    count = f"{n or 'no'} passage{'' if n == 1 else 's'}"
    hours = total_h(deployment.sound)
    body = [
        f'<p class="result">{count} in {hours:.1f} hours of sound</p>',
        list_html(deployment.problems, "warnings"),
        facts_html(_facts(deployment)),
    ]
    if _days(deployment):
        wide, narrow = (calendar_figure(deployment, w) for w in (WIDE_IN, NARROW_IN))
        body.append("<h2>Calendar</h2>")
        body.append(f"<p>{CAPTION}</p>")
        body.append(picture_html(wide, narrow, "calendar of sound and passages"))
    body += _tables(deployment)
    return page_html(title, body, f"uwtrack {__version__}")


def _facts(deployment: Deployment) -> list[tuple[str, str]]:
    listened = deployment.listened
    spans = [one.span_ns for one in listened if one.span_ns is not None]
    facts = [
        ("Recordings", str(len(listened))),
        ("Sensors", ", ".join(sorted({one.sensor for one in listened})) or "none"),
    ]
    if spans:
        first, last = min(s[0] for s in spans), max(s[1] for s in spans)
        facts += [("First", _utc(first)), ("Last", _utc(last))]
    unknown = len(listened) - len(spans)
    if unknown:
        facts.append(("Without a start time", str(unknown)))
    vessels = Counter(p.vessel for p in deployment.passages if p.vessel)
    if vessels:
        facts.append(("Vessels by AIS", str(len(vessels))))
    return facts


def _utc(time_ns: int) -> str:
    return f"{EPOCH + timedelta(seconds=time_ns // NANOSECONDS):%Y-%m-%d %H:%M}"


def _days(deployment: Deployment) -> list[int]:
    """Return the days on which there was sound, as numbers since 1970, ascending."""
    return sorted({day for day, _ in by_day(deployment.sound)})


def calendar_figure(deployment: Deployment, width_in: float) -> "Figure":
    """Return the calendar: a row per day, hours to the right.

    ``width_in``: width of the picture, inches.
    """
    days = _days(deployment)[-MOST_ROWS:]
    sensors = sorted({span.sensor for _, span in by_day(deployment.sound)})
    place = {day: len(days) - 1 - number for number, day in enumerate(days)}
    rows_in = max(0.28 * len(days) * max(1, len(sensors)) ** 0.5, 0.6)
    figure = new_figure(width_in, rows_in + 2.2)
    upper, lower = figure.subplots(2, 1, height_ratios=[rows_in, 1.0], sharex=True)
    height = 0.8 / max(1, len(sensors))
    for number, sensor in enumerate(sensors):
        shift = 0.4 - (number + 0.5) * height
        _draw_sensor(deployment, sensor, number, place, shift, height, upper)
    every = max(1, len(days) // 31)
    names = [day_name(day) for day in days]
    upper.set_yticks([place[d] for d in days][::every], names[::every], fontsize=8)
    upper.set(ylim=(-0.6, len(days) - 0.4), xlim=(0, 24))
    calm(upper)
    if len(sensors) > 1 and deployment.passages:
        upper.legend(fontsize=8, loc="upper right", ncols=min(4, len(sensors)))
    hours = [
        parse_utc(p.time_utc) % DAY_NS / DAY_NS * 24
        for p in deployment.passages if p.time_utc
    ]  # fmt: skip
    lower.hist(hours, bins=np.arange(25), color=HEARD_COLOR, rwidth=0.85)
    calm(lower)
    lower.set_ylabel("passages\nper hour", fontsize=8)
    lower.yaxis.get_major_locator().set_params(integer=True)
    lower.set_xticks(range(0, 25, 3 if width_in > 0.7 * WIDE_IN else 6))
    lower.set_xlabel("hour of the day (UTC)", fontsize=9)
    return figure


def _draw_sensor(
    deployment: Deployment, sensor: str, number: int, place: dict[int, int],
    shift: float, height: float, ax: "Axes",
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


def _tables(deployment: Deployment) -> Iterator[str]:
    """Yield the counts per day and vessel, and all passages."""
    passages = deployment.passages
    if not passages:
        return
    yield "<h2>Days</h2>"
    yield table_html(("day", "sound h", "passages"), _day_rows(deployment))
    vessels = Counter(p.vessel for p in passages if p.vessel).most_common()
    if vessels:
        yield "<h2>Vessels</h2>"
        yield table_html(("vessel", "passages"), [(n, str(k)) for n, k in vessels])
    yield "<h2>Passages</h2>"
    rows = [_cells(row) for row in passages[:MOST_PASSAGES]]
    heads = (
        "time UTC",
        "sensor",
        "vessel",
        "status",
        *(h.title for h in HEADS),
        "result",
    )
    columns = list(zip(heads, zip(*rows, strict=True), strict=True))
    known = [(head, cells) for head, cells in columns if set(cells) != {"-"}]
    yield table_html(
        [h for h, _ in known], list(zip(*(c for _, c in known), strict=True))
    )
    if len(passages) > MOST_PASSAGES:
        more = len(passages) - MOST_PASSAGES
        yield f"<p>{html_text(f'{more} more: uwtrack passages lists them.')}</p>"


def _day_rows(deployment: Deployment) -> list[tuple[str, str, str]]:
    hours = hours_per_day(deployment.sound)
    counts = Counter((p.time_utc or "unknown")[:10] for p in deployment.passages)
    return [
        (day, f"{hours[day]:.1f}" if day in hours else "-", str(counts[day]))
        for day in sorted(hours.keys() | counts.keys())
    ]


def _cells(row: PassageRow) -> tuple[str, ...]:
    when = f"{row.time_s:.1f} s" if row.time_s is not None else "-"
    when = utc_text(row.time_utc) if row.time_utc else when
    name = row.vessel or "-"
    if row.vessel_probability is not None:
        name += f" {100 * row.vessel_probability:.0f} %"
    facts = asdict(row)
    numbers = [head.text(facts) for head in HEADS]
    if numbers[-1] != NOT_KNOWN and row.level_reference:
        numbers[-1] += f" re {row.level_reference}"  # the two never mix
    return (when, row.sensor, name, row.status, *numbers, row.file.rpartition("/")[2])
