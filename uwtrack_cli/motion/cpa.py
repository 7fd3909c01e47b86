"""Closest approaches: when, how near and how fast each contact passed.

**Method.** One contact at a time: starts from a search over time and width, a joint
maximum-likelihood fit of its raw frequencies, bearings and levels with the exact
retarded-time law, and a decision whether it is a passage at all. A passage of lines is
then held against its own residuals, the lines' levels, its halves and the sound itself.

**Conventions.** Times count from the first sample; time of closest approach is
geometric, and its sound arrives d/c later. A passage of the level alone must be one in
the parts of the band, too. What the data do not tell is nan, with the
reason under its key.

**References.** Choi et al. (2014), corrected: free rest frequencies, level and floor;
the sign of eq. 5; the side from the bearing trend.
"""

import warnings
from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.constants import SOURCE_DEPTH_M, SOURCE_DEPTH_STD_M
from uwtrack_cli.data.base import IntArray
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.directions import Directions
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import AtLeast, AtMost, Unit, checked
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor, SoundSpeed
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import FULL_SCALE, Levels
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.motion.decision import LEAST_PROBABILITY, Rejection
from uwtrack_cli.motion.options import Probability, Spreading
from uwtrack_cli.motion.passage.candidates import (
    CandidatePassage,
    RecordingSpan,
    Still,
    Unclaimed,
    fit_contact,
    read,
    split,
    take_apart,
)
from uwtrack_cli.motion.passage.checks.fit_checks import check_fit
from uwtrack_cli.motion.passage.checks.sub_bands import ask_the_parts
from uwtrack_cli.motion.passage.encounter_rows import (
    EXTRAPOLATED,
    LEVEL_ONLY,
    CpaContext,
    Refusal,
    Row,
    add_checks,
    add_levels,
    add_sensor_motion,
    advise_frames,
    make_encounters,
    passage_row,
    still_contact,
    widen_for_others,
)
from uwtrack_cli.motion.passage.failed_fits import FailedFit, attempted, failed_fits
from uwtrack_cli.motion.passage.fit.directivity import consider_directivity
from uwtrack_cli.motion.passage.fit.nuisances import NuisancePriors, nuisance_priors
from uwtrack_cli.motion.passage.fringe_rows import add_fringes
from uwtrack_cli.motion.passage.model.direction_bearings import bearing_series, with_directions
from uwtrack_cli.motion.passage.model.measurements import PassageData, series_data
from uwtrack_cli.motion.passage.readings.competing_readings import TWO_TARGETS, read_passage
from uwtrack_cli.motion.passage.recording_passages import examine_recording

SIGNIFICANCE = 1e-3
"""Probability that noise alone is examined as a passage."""

MIXED = "the bearings are those of two targets"
"""Why no direction is known."""


@checked
def find_encounters(  # noqa: PLR0913 (five inputs that may be absent)
    lines: Lines | None = None,
    levels: Levels | None = None,
    sensor: Sensor | None = None,
    series: Series | None = None,
    recording: Recording | None = None,
    directions: Directions | None = None,
    bearing_time: BearingTime | None = None,
    fringes: Fringes | None = None,
    *,
    sound_speed_mps: SoundSpeed | None = None,
    sound_speed_std_mps: Annotated[float | None, Unit("m/s"), AtLeast(0), AtMost(1e8)] = None,
    source_depth_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(11_000)] = SOURCE_DEPTH_M,
    source_depth_std_m: Annotated[
        float, Unit("m"), AtLeast(0), AtMost(11_000)
    ] = SOURCE_DEPTH_STD_M,
    probability: Probability = LEAST_PROBABILITY,
    false_alarm_probability: Probability | None = None,
    spreading_db: Spreading = 20.0,
    rest_frame_test: bool = True,
) -> Encounters:
    """Find the closest point of approach (CPA) of every contact.

    Each passing vessel gives one row: the time of its closest approach, its speed,
    range, course and side, each with a standard deviation. A steady hum, a ship that
    only approaches or only leaves, and noise give no row.

    Parameters
    ----------
    lines
        Tracked frequency lines.
    levels
        Broadband levels and bearings.
    sensor
        The sensor; without it one of unknown position and depth is assumed.
    series
        Frequencies, bearings or levels measured elsewhere, instead of the others.
    recording
        The recording. Where its sound is at hand, a passage of lines must make them
        steadier in the vessel's own time than any other reading does.
    directions
        Directions that an array heard, from delays: the bearings of the levels, or
        a series of bearings by themselves.
    bearing_time
        Record of an array, whose directions are taken in the same way.
    fringes
        Image of the sound, in whose fringes passages are seen that have no line.
    sound_speed_mps
        Sound speed; by default that of the sensor. An error of 1 % in it is an error
        of 1 % in speed and range.
    sound_speed_std_mps
        Standard deviation of the sound speed, 0 for exactly known; by default that of
        the sensor, else 0.5 % of a speed that is given and 1 % of the nominal one.
    source_depth_m
        Depth of the vessel's source.
    source_depth_std_m
        Standard deviation of that depth, 0 for exactly known.
    probability
        Least probability of a passage that is reported; contacts below it are listed as
        rejected, with their probability and the alternative.
    false_alarm_probability
        Replaced by ``probability``, and taken out in the next version: the probability
        that noise alone is examined at all.
    spreading_db
        Spreading loss per decade of range, for the source level.
    rest_frame_test
        Whether a passage is checked against the sound itself, if the sound can be read.

    Returns
    -------
    Encounters
        One row per passage, in the order of time.

    Raises
    ------
    DataError
        There is nothing to work on.
    OptionError
        An option is out of its range.

    Notes
    -----
    Choi et al. (2014), eqs. 3-6, as one joint likelihood with the corrected eq. 5;
    rest frequencies, level and noise floor are free.
    """
    _check_array(sensor)
    if false_alarm_probability is not None:
        msg = (
            "false_alarm_probability of 'cpa' is replaced by probability (0.5 unless "
            "given), which moves what is reported, and is taken out in the next version."
        )
        warnings.warn(msg, UwtrackWarning, stacklevel=2)
    significance = false_alarm_probability or SIGNIFICANCE
    if directions is None and bearing_time is not None:
        directions = bearing_time.directions
    levels = with_directions(levels, directions)
    if lines is None and levels is None and series is None and fringes is None:
        series = _bearings_alone(directions)
    name = _name(lines, levels, fringes)
    known = sensor if sensor is not None else Sensor(id=name)
    sound = recording if rest_frame_test else None
    priors = nuisance_priors(
        known, sound_speed_mps, sound_speed_std_mps, source_depth_m, source_depth_std_m
    )
    _check_one_sensor(series)
    context = _context((lines, levels, series, fringes), known, priors, spreading_db)
    medium = priors.medium
    limits = _limits(lines, levels, series)
    has_sound = sound is not None and sound.can_be_read_again
    with failed_fits() as failed:
        found, still = _examined(
            lines, levels, series, (medium, significance), limits, sound, directions
        )
        made = partial(_row, context=context, levels=levels, least=probability, has_sound=has_sound)
        pairs = [
            (item, attempted(partial(made, item), item.contacts, item.blocks.time_s))
            for item in found
        ]
    passed = [(item, row) for item, row in pairs if isinstance(row, Row)]
    refusals = [row for _, row in pairs if isinstance(row, Refusal)]
    fits = [item.fit for item, _ in passed]
    add_levels([row for _, row in passed], levels, fits, context)
    rows = []
    for item, row in passed:
        if lines is None or lines.window_s is None:  # a ladder has all lengths
            advise_frames(row, context, limits.window_s)
        if len(found) > 1:
            widen_for_others(row, lines, item.line_ids)
        turned = add_sensor_motion(row, context)
        if turned is None:
            rows.append(row)
        else:
            refusals.append(_refused(item, turned))
    number = _free_number(lines, found)
    rows, contradicted = add_fringes(rows, fringes, context, number, probability)
    refusals += contradicted
    rows.sort(key=lambda row: np.nan_to_num(row.values["time_s"], nan=np.inf))
    refusals += [still_contact(one) for one in still]
    told = {row.contact for row in rows} | {one.contact for one in refusals}
    refusals += _not_fitted([one for one in failed if one.contact not in told])
    return make_encounters(rows, refusals, context)


def _examined(
    lines: Lines | None,
    levels: Levels | None,
    series: Series | None,
    terms: tuple[Medium, float],
    limits: RecordingSpan,
    sound: Recording | None,
    directions: Directions | None,
) -> tuple[list[CandidatePassage], list[Still]]:
    """Examine lines and levels, or a series; neither is there beside fringes alone."""
    if series is not None:
        return _from_series(series, *terms)
    if lines is None and levels is None:
        return [], []
    return examine_recording(lines, levels, *terms, limits, sound, directions)


def _not_fitted(failed: list[FailedFit]) -> list[Refusal]:
    """Refuse what could not be fitted, and say so: nobody looks for what is not there."""
    for one in failed:
        msg = (
            f"contact {one.contact} ({one.from_s:.0f} to {one.to_s:.0f} s) is reported "
            f"as no passage: {one.reason.sentence}."
        )
        warnings.warn(msg, UwtrackWarning, stacklevel=4)
    return [Refusal(*one) for one in failed]


def _bearings_alone(directions: Directions | None) -> Series:
    if directions is None:
        raise DataError(
            "closest approaches need lines, levels or a series, got none: run "
            "'uwtrack track' or 'uwtrack levels' first, or give a CSV file."
        )
    return bearing_series(directions)


def _check_array(sensor: Sensor | None) -> None:
    """Refuse an array that moves, or whose bearings may lie on either side."""
    if sensor is None or not sensor.is_array:
        return
    if sensor.element_positions_m is None or sensor.navigation is not None:
        kind = "moves" if sensor.element_positions_m else (
            "is a line array, which may move and does not separate port from starboard"
        )  # fmt: skip
        raise DataError(
            f"sensor {sensor.id!r} {kind}; a closest approach needs a fixed sensor "
            f"with bearings: take 'uwtrack tma' for range, course and speed (recipe "
            f"towed-array), or --channel."
        )


def _name(lines: Lines | None, levels: Levels | None, fringes: Fringes | None) -> str:
    """Return what the sensor is called in the measurements."""
    frames = levels.frames if levels else lines.frames if lines else fringes
    return (frames.sensor if frames else "series") or "sensor"


def _free_number(lines: Lines | None, found: list[CandidatePassage]) -> int:
    """Return the first contact number that nothing has."""
    taken = [number for item in found for number in item.contacts]
    if lines is not None:
        taken.append(int(lines.line_contact.max(initial=0)))
    return max(taken, default=0) + 1


def _context(
    sources: tuple[Lines | None, Levels | None, Series | None, Fringes | None],
    sensor: Sensor,
    priors: NuisancePriors,
    spreading_db: float,
) -> CpaContext:
    lines, levels, series, fringes = sources
    frames = levels.frames if levels else lines.frames if lines else fringes
    start = frames.start_utc_ns if frames else series.start_utc_ns if series else None
    band = (levels.band_low_hz, levels.band_high_hz) if levels else None
    source = levels or lines or fringes
    reference = source.reference if source else FULL_SCALE
    return CpaContext(sensor, priors, start, reference, band, spreading_db)


def _check_one_sensor(series: Series | None) -> None:
    """Refuse a table of several sensors: a closest approach is one sensor's."""
    if series is None or series.sensor is None:
        return
    names = np.unique(series.sensor).tolist()
    if len(names) > 1:
        raise DataError(
            f"the table has rows of {len(names)} sensors ({', '.join(names[:10])}): "
            f"'uwtrack locate' and 'uwtrack tma' take them with --sensors, 'cpa' one."
        )


def _from_series(
    series: Series, medium: Medium, probability: float
) -> tuple[list[CandidatePassage], list[Still]]:
    found, still = list[CandidatePassage](), list[Still]()
    number = int(series.contact.max(initial=0))
    for contact in np.unique(series.contact):
        columns = np.arange(1, series.frequency_hz.shape[1] + 1)
        data, owner = series_data(series, int(contact)), ((int(contact),), columns)
        told = attempted(
            partial(_of_table, data, owner, medium, probability), owner[0], data.time_s
        )
        apart, unclaimed = told or ([], [])
        if len(apart) > 1:
            number += 1
            apart[1] = replace(apart[1], contacts=(number,))
        found += apart
        still += unclaimed
    return found, still


def _of_table(
    data: PassageData, owner: tuple[tuple[int, ...], IntArray], medium: Medium, probability: float
) -> tuple[list[CandidatePassage], list[Still]]:
    """Examine a contact of a table, which may be two vessels."""
    one = fit_contact(data, *owner, medium, probability)
    if isinstance(one, CandidatePassage):
        apart = split(one, medium, probability)
    else:
        apart = take_apart(data, owner, medium, probability)
    still = one.read() if isinstance(one, Unclaimed) and not apart else []
    checked = [check_fit(read(item)) for item in apart]
    return [item.measured(as_given=1.0) for item in checked], still


def _limits(lines: Lines | None, levels: Levels | None, series: Series | None) -> RecordingSpan:
    frames = levels.frames if levels else lines.frames if lines else None
    if frames is None:
        time = series.time_s if series is not None else np.zeros(1)
        return RecordingSpan(0.0, float(time.min()), float(time.max()))
    if not frames.n_frames:
        return RecordingSpan(frames.window_s, 0.0, 0.0)
    return RecordingSpan(frames.window_s, float(frames.time_s[0]), float(frames.time_s[-1]))


def _row(
    candidate: CandidatePassage,
    context: CpaContext,
    levels: Levels | None,
    *,
    least: float,
    has_sound: bool,
) -> Row | Refusal:
    """Turn a candidate into a row, or say why it is no passage."""
    if candidate.blocks.shift.is_empty:  # it was not read with any lines
        reading = read_passage(candidate.fit, candidate.blocks)[1]
        candidate = replace(candidate, reading=reading)
    contact, fit = candidate.contacts[0], candidate.fit
    time = candidate.blocks.time_s
    wider = consider_directivity(fit, candidate.blocks)
    row = passage_row(contact, wider, context, candidate.line_ids)
    if candidate.reading.name == TWO_TARGETS and not candidate.data.bearing_deg.size:
        row.reasons.update(dict.fromkeys(("bearing_deg", "course_deg", "side"), MIXED))
    if row.status == LEVEL_ONLY and levels is not None:
        candidate = ask_the_parts(candidate, levels)
    if not time[0] <= fit.theta[0, 0] <= time[-1]:
        row = replace(row, status=EXTRAPOLATED, extrapolated=True)
    if candidate.duplicate_of or candidate.decision.probability <= least:
        refused = _refused(candidate, candidate.rejection)
        return refused._replace(probability=candidate.decision.probability)
    row.decision = candidate.decision
    add_checks(row, candidate, has_sound=has_sound)
    if row.side and candidate.other_turn > 1e-3:
        other = "port" if row.side == "starboard" else "starboard"
        row.other_sides.append((other, candidate.other_turn))
    return row


def _refused(candidate: CandidatePassage, reason: Rejection) -> Refusal:
    time = candidate.blocks.time_s
    return Refusal(candidate.contacts[0], float(time[0]), float(time[-1]), reason)
