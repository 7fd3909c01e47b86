"""Closest approaches that are over within seconds: looked at again in shorter frames.

**Method.** Frames as long as a passage of minutes needs blur one of seconds, and short
ones are blind to weak lines and cost ten times as much. So the sound is looked at again
where lines or the level rise for seconds (`spectra/transients.py`), and where the long frames
show a closest approach that lasts only a few of their lengths. Lines that keep their
frequencies, and a level that rises for longer, do not need the shortest frames, and
lines that climb none. These segments of the sound are read again, and recipes of
shorter frames run over them, up to their closest approaches, which are held against the
sound as all are; where the sound cannot be read again, a warning says which segments
were left out. What long or longer frames tell of a piece of a line that a better passage
explains is left out before (`motion/explained_lines.py`), and so is what longer frames
tell by levels alone where the parts of the band do not (`checks/sub_bands.py`). A
segment is too short to tell swell from a passage by the level alone: there the level,
and the parts of its band by themselves, must rise by more than the recording does all
the time (`motion/passage/checks/usual_rises.py`). In the end all
answers, those of several lengths of long frames among them, compete for one row per
passage (`motion/competition.py`).

**Conventions.** Times count from the first sample of the recording. The recipes are the
shipped ones, with their own options; sensor and sound speed are those of the recording.
"""

import warnings
from dataclasses import replace

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import BoolArray
from uwtrack_cli.data.encounters import TOO_FAST, Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import checked
from uwtrack_cli.data.recording import PartReader, Recording, read_segment
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.data.transients import CLIMB, FALL, LEVEL, Transients
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.flow.engine import Engine, MemorySink, context_of
from uwtrack_cli.flow.graph import Graph
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.competition import LEVEL_ONLY, compete
from uwtrack_cli.motion.decision import LEAST_PROBABILITY
from uwtrack_cli.motion.explained_lines import unexplained
from uwtrack_cli.motion.options import Probability
from uwtrack_cli.motion.passage.checks.sub_bands import agreement
from uwtrack_cli.motion.passage.checks.usual_rises import stands_out

RECIPES = ("small-craft", "vehicle")
"""Recipes that look again: frames of a quarter and a tenth of a second."""

BRIEF_S = 0.3
"""Half length of rises of the level up to which the shortest frames are needed, s."""

QUICK_WINDOWS = 8.0
"""d/v, in lengths of the long frames, up to which a passage is looked at again."""

LEAST_S, WIDTHS = 10.0, 5.0
"""A segment reaches so many seconds, and so many d/v, to either side."""

LONGEST_S = 60.0
"""Segments are joined up to this length, s."""


@checked
def zoom_in(
    encounters: list[Encounters],
    rises: Transients | None = None,
    lines: list[Lines] | None = None,
    recording: Recording | None = None,
    levels: Levels | None = None,
    *,
    recipes: list[str] | None = None,
    probability: Probability = LEAST_PROBABILITY,
) -> Encounters:
    """Reanalyse in shorter frames where something passes within seconds.

    Parameters
    ----------
    encounters
        Closest approaches that long frames have shown; of several lengths of frames the
        table of the lines first, which keeps its contact numbers.
    rises
        Transients of lines or level within seconds, which tell where to look.
    lines
        Tracked lines of each table, in the same order: of the first for the length of
        its frames and contact numbers that are free, of all to tell which rows another
        passage explains. None leaves that out.
    recording
        The recording, whose sound is read again.
    levels
        Levels of the recording, above whose usual rises the level of a segment must
        rise. None leaves that out.
    recipes
        Recipes with shorter frames; by default small-craft and vehicle. Only the first
        is run where lines keep their frequencies or the level rises for longer.
    probability
        Least probability of a passage from shorter frames that is reported.

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
            "zoom needs the sound, which cannot be read: run the recording itself, or "
            "keep it beside its result file."
        )
        raise DataError(msg)
    graphs = [_up_to_passages(name, probability) for name in recipes or RECIPES]
    tracked = lines[0] if lines else None
    taken = 0 if tracked is None else int(tracked.line_contact.max(initial=0))
    first, *others = _own_passages(encounters, lines or [])
    longer = [_without_lines(_confirmed(other, levels)) for other in others]
    known = compete(first, longer, taken, keeps_first=True)
    own = known.of_sensor(recording.sensor.id)
    found: list[Encounters] = []
    too_fast = known.refused_as(TOO_FAST)
    missed_s: list[float] = []
    for number, graph in enumerate(graphs):
        looked = rises if rises is None else _seen(rises, is_first=number == 0)
        for start_s, stop_s in _segments(own, looked, tracked):
            part = _part(recording, start_s, stop_s)
            if part is None:
                missed_s.append(max(0.0, start_s))
                continue
            table = _passages(part, graph)
            if table is not None:
                too_fast += table.refused_as(TOO_FAST)
                placed = _placed(table, start_s, stop_s, recording)
                found.append(_risen(placed, own, rises, levels))
    if missed_s:
        _warn_of_missed(missed_s, recording)
    told = compete(own, found, taken)
    if too_fast and not told.n_encounters:  # lines of the look are in no other table
        msg = f"{recording.name} has a passage that is none: {too_fast[0]}."
        warnings.warn(msg, UwtrackWarning, stacklevel=2)
    return told


def _warn_of_missed(from_s: list[float], recording: Recording) -> None:
    """Say that segments are not looked at again, since their sound is not at hand."""
    places = sorted(set(from_s))
    segments = f"{len(places)} segment" + ("s" if len(places) > 1 else "")
    msg = (
        f"{segments} of {recording.name}, from {places[0]:.0f} s on, where something may "
        f"pass within seconds, cannot be analysed again: the sound is gone. Record it "
        f"in a file, and run that."
    )
    warnings.warn(msg, UwtrackWarning, stacklevel=3)


def _own_passages(tables: list[Encounters], lines: list[Lines]) -> list[Encounters]:
    """Return the tables without the rows whose lines a better passage explains."""
    told = [
        table.take("encounter", np.flatnonzero(unexplained(table, own, tables)))
        for table, own in zip(tables, lines, strict=False)
    ]
    return told + tables[len(told) :]


def _confirmed(table: Encounters, levels: Levels | None) -> Encounters:
    """Return the rows without those by the level alone that the recording's refuse.

    A table of lines alone has asked no part of the band; bearings need none.
    """
    if levels is None:
        return table
    kept = (table.status != LEVEL_ONLY) | np.isfinite(table.bearing_deg)
    for row in np.flatnonzero(~kept):
        place = float(table.time_s[row]), float(table.range_over_speed_s[row])
        told = agreement(levels, *place)
        kept[row] = told is None or told.is_passage
    return table.take("encounter", np.flatnonzero(kept))


def _seen(rises: Transients, *, is_first: bool) -> Transients:
    """Return the rises that the first of the recipes, or the others, look at."""
    if is_first:
        return rises.take("transient", np.flatnonzero(rises.kind != CLIMB))
    brief = (rises.kind == LEVEL) & (rises.half_length_s < 1.01 * BRIEF_S)
    return rises.take("transient", np.flatnonzero(brief | (rises.kind == FALL)))


def _segments(
    known: Encounters, rises: Transients | None, lines: Lines | None
) -> list[tuple[float, float]]:
    """Return where to look, in the order of time, s."""
    places: list[tuple[float, float]] = []
    if rises is not None:
        reach = np.maximum(LEAST_S, WIDTHS * rises.half_length_s)
        places += zip(rises.time_s.tolist(), reach.tolist(), strict=True)
    if lines is not None:
        brief = known.range_over_speed_s < QUICK_WINDOWS * lines.frames.window_s
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


def _part(recording: Recording, start_s: float, stop_s: float) -> Recording | None:
    """Return a segment of a recording as a recording; None if it has passed."""
    assert recording.reader is not None  # noqa: S101 - checked before
    rate_hz = recording.sample_rate_hz
    first = round(max(0.0, start_s) * rate_hz)
    last = min(round(stop_s * rate_hz), recording.n_samples)
    try:
        for end in (first, last - 1):
            read_segment(recording.reader, end, 1)
    except DataError:
        return None
    start_ns = recording.start_utc_ns
    if start_ns is not None:
        start_ns += round(first / rate_hz * NANOSECONDS)
    return replace(
        recording,
        n_samples=last - first,
        start_utc_ns=start_ns,
        first_sample=recording.first_sample + first,
        reader=PartReader(recording.reader, first, last - first),
    )


def _up_to_passages(recipe: str, probability: float) -> Graph:
    """Return the part of a recipe that its first closest approaches need."""
    loaded = load_recipe(recipe)
    graph = loaded.graph()
    made = [step.name for step in graph.steps() if step.stage.output is Encounters]
    if not made:
        msg = f"recipe {recipe} has no closest approaches to look for; give another."
        raise OptionError(msg)
    told = loaded.with_settings([f"{made[0]}.probability={probability}"])
    return told.graph().part(made[:1])


def _passages(part: Recording, graph: Graph) -> Encounters | None:
    """Run the steps of a graph over a segment; None if it is too short for them."""
    sink = MemorySink()
    try:
        with warnings.catch_warnings():  # of frames that nobody has chosen
            warnings.simplefilter("ignore", UwtrackWarning)
            graph = graph.resolved(part)
            Engine(graph, context_of(part), sink).run_recording(part)
    except DataError:
        return None
    (last,) = [step for step in graph.steps() if step.stage.output is Encounters]
    made = sink.read(last)
    return made if isinstance(made, Encounters) else None


def _risen(
    found: Encounters, known: Encounters, rises: Transients | None, levels: Levels | None
) -> Encounters:
    """Return the passages of a segment; by the level alone, where the recording rises."""
    time_s, reach_s = known.time_s, known.range_over_speed_s
    if rises is not None:
        is_level = rises.kind == LEVEL
        time_s = np.append(time_s, rises.time_s[is_level])
        reach_s = np.append(reach_s, rises.half_length_s[is_level])
    apart = np.abs(found.time_s[:, None] - time_s)
    near = apart < reach_s + found.range_over_speed_s[:, None]
    kept: BoolArray = np.asarray(near.any(axis=1), np.bool_)
    if levels is not None:
        for row in np.flatnonzero(kept & (found.status == LEVEL_ONLY)):
            place = float(found.time_s[row]), float(found.range_over_speed_s[row])
            kept[row] = stands_out(levels, *place)
    kept |= found.status != LEVEL_ONLY
    return found.take("encounter", np.flatnonzero(kept))


def _placed(table: Encounters, start_s: float, stop_s: float, recording: Recording) -> Encounters:
    """Return the passages that lie well inside a segment, in the recording's time."""
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
    )
    return _without_lines(placed).take("encounter", np.flatnonzero(inside))


def _without_lines(table: Encounters) -> Encounters:
    """Return rows whose lines are not those of the product's first tracker."""
    return replace(table, rest_line_id=np.zeros_like(table.rest_line_id))
