"""Closest approaches that are over within seconds: looked at again in shorter frames.

**Method.** Frames as long as a passage of minutes needs blur one of seconds, and short
ones are blind to weak lines and cost ten times as much. The long ones tell where to
look: where the level rises and falls again within seconds, and where a closest approach
was found that lasts only a few of their lengths. These stretches of the sound are read
again, and recipes of shorter frames run over them, up to their closest approaches,
which are held against the sound as all are. In the end all answers compete for one row
per passage (`motion/competition.py`).

A rise is the mean level over a few seconds less that of the louder side: a step, the
flank of a slow passage and the onset of rain are none. It must exceed what the
recording does all the time by several of its spreads, as swell does not.

**Conventions.** Times count from the first sample of the recording. The recipes are the
shipped ones, with their own options; sensor and sound speed are those of the recording.
"""

import warnings
from dataclasses import replace
from typing import Annotated

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.recording import HeldSamples, Recording
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.flow.engine import Engine, MemorySink, context_of
from uwtrack_cli.flow.graph import Graph
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.competition import compete

RECIPES = ("small-craft", "vehicle")
"""Recipes that look again: frames of a quarter and a tenth of a second."""

RISE_S = (0.5, 1.0, 2.0)
"""Half lengths of a rise, s."""

FLANK = (2.0, 6.0)
"""Where its sides begin and end, in half lengths, from the middle."""

SPREADS = 4.0
"""Spreads of a recording's own rises that one must exceed."""

FEWEST_FRAMES = 64
"""Frames below which a recording does not tell how much it rises by itself."""

QUICK_WINDOWS = 8.0
"""d/v, in lengths of the long frames, up to which a passage is looked at again."""

LEAST_S, WIDTHS = 10.0, 5.0
"""A stretch reaches so many seconds, and so many d/v, to either side."""

LONGEST_S = 60.0
"""Stretches are joined up to this length, s."""


@checked
def zoom_in(
    encounters: Encounters,
    levels: Levels | None = None,
    lines: Lines | None = None,
    recording: Recording | None = None,
    *,
    recipes: list[str] | None = None,
    least_rise_db: Annotated[float, Unit("dB"), AtLeast(0.1), AtMost(100)] = 4.0,
) -> Encounters:
    """Look again, in shorter frames, where something passes within seconds.

    Parameters
    ----------
    encounters
        Closest approaches that long frames have shown.
    levels
        Broadband levels, which tell where to look.
    lines
        Tracked lines, for contact numbers that are free.
    recording
        The recording, whose sound is read again.
    recipes
        Recipes with shorter frames that are run over what is looked at; small-craft
        and vehicle unless given.
    least_rise_db
        Least rise of the level within seconds that is looked at.

    Returns
    -------
    Encounters
        One row per passage, whichever frames have shown it best.

    Raises
    ------
    OptionError
        There is no such recipe, or an option is out of range.
    DataError
        There is no recording whose sound could be read again.
    """
    if recording is None or recording.reader is None:
        msg = (
            "the sound is looked at again, and is not at hand: run the recording "
            "itself, or keep it beside its product."
        )
        raise DataError(msg)
    graphs = [_up_to_passages(name) for name in recipes or RECIPES]
    own = encounters.of_sensor(recording.sensor.id)
    taken = 0 if lines is None else int(lines.line_contact.max(initial=0))
    found: list[Encounters] = []
    for start_s, stop_s in _stretches(own, levels, least_rise_db):
        part = _part(recording, start_s, stop_s)
        if part is None:
            continue
        for graph in graphs:
            table = _passages(part, graph)
            if table is not None:
                found.append(_placed(table, start_s, stop_s, recording))
    return compete(own, found, taken)


def _stretches(
    known: Encounters, levels: Levels | None, least_rise_db: float
) -> list[tuple[float, float]]:
    """Return where to look, in the order of time, s."""
    places: list[tuple[float, float]] = []
    if levels is not None and levels.frames.n_frames:
        window_s = levels.frames.window_s
        places += quick_rises(levels, least_rise_db)
        brief = known.range_over_speed_s < QUICK_WINDOWS * window_s
        brief &= np.isfinite(known.time_s)
        for row in np.flatnonzero(brief):
            width_s = float(known.range_over_speed_s[row])
            places.append((float(known.time_s[row]), max(LEAST_S, WIDTHS * width_s)))
    joined: list[tuple[float, float]] = []
    for time_s, reach_s in sorted(places):
        start_s, stop_s = time_s - reach_s, time_s + reach_s
        if joined and start_s <= joined[-1][1] and stop_s - joined[-1][0] < LONGEST_S:
            start_s, stop_s = joined[-1][0], max(stop_s, joined[-1][1])
            joined.pop()
        joined.append((start_s, stop_s))
    return joined


def quick_rises(levels: Levels, least_rise_db: float) -> list[tuple[float, float]]:
    """Return where the level rises and falls again within seconds.

    Parameters
    ----------
    levels
        Broadband levels.
    least_rise_db
        Least rise that counts, dB.

    Returns
    -------
    list[tuple[float, float]]
        Middle of each rise and how far to either side it should be looked at, s.
    """
    frames = levels.frames
    found: list[tuple[float, float]] = []
    for half_s in RISE_S:
        half = max(1, round(half_s / frames.hop_s))
        rise = _rise(levels.excess_db, half)
        heard = np.isfinite(rise)
        if not heard.any():
            continue
        least = least_rise_db
        if np.count_nonzero(heard) >= FEWEST_FRAMES:
            usual = np.median(rise[heard])
            spread = 1.4826 * float(np.median(np.abs(rise[heard] - usual)))
            least = max(least, float(usual) + SPREADS * spread)
        rise = np.where(rise > least, rise, -np.inf)
        reach = round(FLANK[1] * half)
        while (top := int(np.argmax(rise))) >= 0 and rise[top] > -np.inf:
            found.append((float(frames.time_s[top]), max(LEAST_S, WIDTHS * half_s)))
            rise[max(0, top - reach) : top + reach + 1] = -np.inf
    return found


def _rise(excess_db: FloatArray, half: int) -> FloatArray:
    """Return the mean over a rise less that of its louder side, of every frame, dB."""
    near, far = round(FLANK[0] * half), round(FLANK[1] * half)
    middle = _mean(excess_db, -half, half)
    before, after = _mean(excess_db, -far, -near), _mean(excess_db, near, far)
    # where the recording ends, the other side tells
    rise: FloatArray = middle - np.fmax(before, after)
    return rise


def _mean(value: FloatArray, first: int, last: int) -> FloatArray:
    """Return the mean over frames from one offset to another; nan where none is."""
    known = np.isfinite(value)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, value, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    place = np.arange(value.size)
    low = np.clip(place + first, 0, value.size)
    high = np.clip(place + last + 1, 0, value.size)
    number = count[high] - count[low]
    mean: FloatArray = np.where(
        number > 0, (total[high] - total[low]) / np.maximum(number, 1), np.nan
    )
    return mean


def _part(recording: Recording, start_s: float, stop_s: float) -> Recording | None:
    """Return a stretch of a recording as a recording; None if it has passed."""
    start_s = max(0.0, start_s)
    try:
        sound = recording.stretch(start_s, min(stop_s, recording.duration_s))
    except DataError:
        return None
    first = round(start_s * recording.sample_rate_hz)
    start_ns = recording.start_utc_ns
    if start_ns is not None:
        start_ns += round(first / recording.sample_rate_hz * NANOSECONDS)
    return replace(
        recording,
        n_samples=sound.shape[0],
        start_utc_ns=start_ns,
        first_sample=recording.first_sample + first,
        reader=HeldSamples(sound),
    )


def _up_to_passages(recipe: str) -> Graph:
    """Return the part of a recipe that its first closest approaches need."""
    graph = load_recipe(recipe).graph()
    made = [step.name for step in graph.steps() if step.stage.output is Encounters]
    if not made:
        msg = f"recipe {recipe} has no closest approaches to look for; give another."
        raise OptionError(msg)
    return graph.part(made[:1])


def _passages(part: Recording, graph: Graph) -> Encounters | None:
    """Run the steps of a graph over a stretch; None if it is too short for them."""
    graph = graph.resolved(part)
    (last,) = [step for step in graph.steps() if step.stage.output is Encounters]
    sink = MemorySink()
    try:
        with warnings.catch_warnings():  # of frames that nobody has chosen
            warnings.simplefilter("ignore", UwtrackWarning)
            Engine(graph, context_of(part), sink).run_recording(part)
    except DataError:
        return None
    made = sink.read(last)
    return made if isinstance(made, Encounters) else None


def _placed(
    table: Encounters, start_s: float, stop_s: float, recording: Recording
) -> Encounters:
    """Return the passages that lie well inside a stretch, in the recording's time."""
    shift_s = max(0.0, start_s)
    time_s = table.time_s + shift_s
    width_s = np.nan_to_num(table.range_over_speed_s)
    inside = np.isfinite(time_s) & ~table.extrapolated
    inside &= (time_s - width_s > start_s) & (time_s + width_s < stop_s)
    inside &= (time_s > 0) & (time_s < recording.duration_s)
    changed_s = table.change_time_s
    placed = replace(
        table,
        time_s=time_s,
        change_time_s=None if changed_s is None else changed_s + shift_s,
        arrival_time_s=table.arrival_time_s + shift_s,
        rest_line_id=np.zeros_like(table.rest_line_id),
    )
    return placed.take("encounter", np.flatnonzero(inside))
