"""Closest approaches: when, how near and how fast each contact passed.

**Method.** One contact at a time: starts from a search over time and width, a joint
maximum-likelihood fit of its raw frequencies, bearings and levels with the exact
retarded-time law, and a decision whether it is a passage at all.

**Conventions.** Times count from the first sample; time of closest approach is
geometric, and its sound arrives d/c later. What the data do not tell is nan, with the
reason under its key.

**References.** Choi et al. (2014), corrected: free rest frequencies, level and floor;
the sign of eq. 5; the side from the bearing trend.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import FULL_SCALE, Levels
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.passages.normal import Medium
from uwtrack_cli.stages.passages.advice import advise_frames, widen_for_others
from uwtrack_cli.stages.passages.contacts import Candidate, examine
from uwtrack_cli.stages.passages.decision import Limits, not_a_passage
from uwtrack_cli.stages.passages.levels import add_levels
from uwtrack_cli.stages.passages.measurements import series_data
from uwtrack_cli.stages.passages.recording import examine_recording
from uwtrack_cli.stages.passages.report import (
    EXTRAPOLATED,
    LEVEL_ONLY,
    NOT_A_PASSAGE,
    Row,
    Setting,
    empty_row,
    make_encounters,
    passage_row,
)

LASTING_SHARE = 0.5
"""A contact heard for less of the recording is not reported without a passage."""

UNSEEN = "the closest approach lies outside, and no Doppler shift shows it"
"""Why bearings and levels alone do not tell of an approach beyond the recording."""


def find_encounters(
    lines: Lines | None = None,
    levels: Levels | None = None,
    sensor: Sensor | None = None,
    series: Series | None = None,
    *,
    sound_speed_mps: float | None = None,
    source_depth_m: float = SOURCE_DEPTH_M,
    false_alarm_probability: float = 1e-3,
    spreading_db: float = 20.0,
) -> Encounters:
    """Find the closest approach of every contact that passed the sensor.

    Each passing vessel gives one row: when it was nearest, how fast, how far, on
    which course and side, with deviations that hold. A steady hum, a ship that
    only comes or goes, and noise give none.

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
    sound_speed_mps
        Sound speed in m/s, above zero; by default that of the sensor. An error of
        1 % in it is an error of 1 % in speed and range.
    source_depth_m
        Depth of the vessel's source in metres, for the horizontal range.
    false_alarm_probability
        Probability that noise alone is reported as a passage, between 0 and 1.
    spreading_db
        Spreading loss in dB per decade of range, for the source level.

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
    _check(sound_speed_mps, source_depth_m, false_alarm_probability, spreading_db)
    if lines is None and levels is None and series is None:
        msg = (
            "closest approaches need lines, levels or a series, got none: run "
            "'uwtrack track' or 'uwtrack levels' first, or give a CSV file."
        )
        raise DataError(msg)
    setting = _setting(
        (lines, levels, series), sensor, sound_speed_mps, source_depth_m, spreading_db
    )
    medium = Medium(setting.sound_speed_mps, setting.height_m)
    limits = _limits(lines, levels, series)
    if series is not None:
        found = _from_series(series, medium, false_alarm_probability)
    else:
        found = examine_recording(
            lines, levels, medium, false_alarm_probability, limits
        )
    pairs = [(item, _row(item, setting, limits)) for item in found]
    rows = [row for _, row in pairs if row is not None]
    passed = [(item, row) for item, row in pairs if row and row.status != NOT_A_PASSAGE]
    fits = [item.fit for item, _ in passed]
    add_levels([row for _, row in passed], levels, fits, setting)
    for item, row in passed:
        advise_frames(row, setting, limits.window_s)
        if len(found) > 1:
            widen_for_others(row, lines, item.line_ids)
    rows.sort(key=lambda row: np.nan_to_num(row.values["time_s"], nan=np.inf))
    return make_encounters(rows, setting)


def _check(
    sound_speed_mps: float | None, depth_m: float, probability: float, loss_db: float
) -> None:
    if sound_speed_mps is not None and not sound_speed_mps > 0:
        msg = f"sound_speed_mps must be above 0, got {sound_speed_mps}."
        raise OptionError(msg)
    if not depth_m >= 0:
        msg = f"source_depth_m must be 0 or more, got {depth_m}."
        raise OptionError(msg)
    if not 0 < probability < 1:
        msg = f"false_alarm_probability must be in (0, 1), got {probability}."
        raise OptionError(msg)
    if not 0 < loss_db <= 60:
        msg = f"spreading_db must be in (0, 60], got {loss_db}."
        raise OptionError(msg)


def _setting(
    sources: tuple[Lines | None, Levels | None, Series | None],
    sensor: Sensor | None,
    sound_speed_mps: float | None,
    source_depth_m: float,
    spreading_db: float,
) -> Setting:
    lines, levels, series = sources
    frames = levels.frames if levels else lines.frames if lines else None
    name = frames.sensor if frames else "series"
    known = sensor if sensor is not None else Sensor(id=name or "sensor")
    start = frames.start_utc_ns if frames else series.start_utc_ns if series else None
    c = sound_speed_mps or known.sound_speed_mps
    band = (levels.band_low_hz, levels.band_high_hz) if levels else None
    source = levels or lines
    reference = source.reference if source else FULL_SCALE
    return Setting(known, c, source_depth_m, start, reference, band, spreading_db)


def _from_series(series: Series, medium: Medium, probability: float) -> list[Candidate]:
    found = []
    for contact in np.unique(series.contact):
        columns = np.arange(1, series.frequency_hz.shape[1] + 1)
        one = examine(
            series_data(series, int(contact)), (int(contact),), columns, medium,
            probability,
        )  # fmt: skip
        found += [one] if one else []
    return found


def _limits(
    lines: Lines | None, levels: Levels | None, series: Series | None
) -> Limits:
    frames = levels.frames if levels else lines.frames if lines else None
    if frames is None:
        time = series.time_s if series is not None else np.zeros(1)
        return Limits(0.0, float(time.min()), float(time.max()))
    if not frames.n_frames:
        return Limits(frames.window_s, 0.0, 0.0)
    return Limits(frames.window_s, float(frames.time_s[0]), float(frames.time_s[-1]))


def _row(candidate: Candidate, setting: Setting, limits: Limits) -> Row | None:
    """Turn a candidate into a row; None if it is a mere fragment."""
    contact, fit = candidate.contacts[0], candidate.fit
    time = candidate.blocks.time_s
    reason = not_a_passage(fit, candidate.blocks, limits)
    row = passage_row(contact, fit, setting, candidate.line_ids)
    if not time[0] <= fit.theta[0, 0] <= time[-1]:
        if row.status == LEVEL_ONLY:
            reason = reason or UNSEEN
        row = replace(row, status=EXTRAPOLATED, extrapolated=True)
    if reason is not None:
        whole = limits.last_s - limits.first_s
        is_lasting = float(np.ptp(time)) > LASTING_SHARE * whole
        return empty_row(contact, reason) if is_lasting else None
    if row.side and candidate.other_turn > 1e-3:
        other = "port" if row.side == "starboard" else "starboard"
        row.ambiguities.append({"side": other, "weight": candidate.other_turn})
    return row
