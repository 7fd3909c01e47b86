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

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.constants import SOUND_SPEED_WATER_MPS, SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import FULL_SCALE, Levels
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.estimation.passage_data import (
    Blocks,
    PassageData,
    condense,
    make_blocks,
)
from uwtrack_cli.estimation.passage_fit import (
    PassageFit,
    fit_passage,
    fit_with_memory,
    take_row,
)
from uwtrack_cli.estimation.passage_normal import Medium
from uwtrack_cli.estimation.passage_seeds import find_starts
from uwtrack_cli.stages.cpa_decision import (
    Evidence,
    not_a_passage,
    passage_evidence,
)
from uwtrack_cli.stages.cpa_measurements import (
    contact_data,
    contact_ids,
    lines_of,
    series_data,
)
from uwtrack_cli.stages.cpa_report import (
    EXTRAPOLATED,
    Row,
    Setting,
    empty_row,
    make_encounters,
    passage_row,
)

FEWEST_MEASUREMENTS = 8
"""Instants with a measurement below which nothing is fitted."""


@dataclass(frozen=True)
class _Candidate:
    contact: int
    line_ids: IntArray
    blocks: Blocks
    fit: PassageFit
    evidence: Evidence
    other_turn: float


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
    if series is not None:
        found = [
            _examine(
                series_data(series, int(contact)), int(contact),
                np.arange(series.frequency_hz.shape[1]), setting,
                false_alarm_probability,
            )
            for contact in np.unique(series.contact)
        ]  # fmt: skip
    else:
        found = _from_recording(lines, levels, setting, false_alarm_probability)
    rows = [_row(item, setting) for item in found if item is not None]
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
    c = sound_speed_mps or known.sound_speed_mps or SOUND_SPEED_WATER_MPS
    band = (levels.band_low_hz, levels.band_high_hz) if levels else None
    source = levels or lines
    reference = source.reference if source else FULL_SCALE
    return Setting(known, c, source_depth_m, start, reference, band, spreading_db)


def _from_recording(
    lines: Lines | None,
    levels: Levels | None,
    setting: Setting,
    probability: float,
) -> list[_Candidate | None]:
    """Examine every contact; the broadband goes to the only one that passes."""
    found: list[_Candidate] = []
    for contact in contact_ids(lines) if lines is not None else []:
        data = contact_data(lines, None, (contact,))
        ids = (
            lines_of(lines, (contact,)) if lines is not None else np.empty(0, np.int64)
        )
        candidate = _examine(data, contact, ids, setting, probability)
        if candidate is not None:
            found.append(candidate)
    if levels is None or len(found) > 1:
        return list(found)
    if not found:
        data = contact_data(None, levels, ())
        alone = _examine(data, 1, np.empty(0, np.int64), setting, probability)
        return [alone]
    only = found[0]
    data = contact_data(lines, levels, (only.contact,))
    joint = _examine(data, only.contact, only.line_ids, setting, probability)
    return [joint or only]


def _examine(
    data: PassageData,
    contact: int,
    line_ids: IntArray,
    setting: Setting,
    probability: float,
) -> _Candidate | None:
    """Fit one contact and keep it if it is significant."""
    blocks = make_blocks(data)
    used = np.zeros(data.time_s.size, np.bool_)
    for block in (blocks.shift, blocks.bearing, blocks.level):
        used |= (block.weight[0] > 0).any(axis=0)
    if used.sum() < FEWEST_MEASUREMENTS:
        return None
    medium = Medium(setting.sound_speed_mps, setting.height_m)
    rough, other = best_start(blocks, medium)
    if rough is None:
        return None
    short = condense(data, float(rough.theta[0, 0]), float(rough.range_over_speed_s[0]))
    if short is not data:
        blocks = make_blocks(short)
    fit = fit_passage(blocks, rough.theta, rough.turn, medium)
    fit = fit_with_memory(fit, blocks, medium)
    evidence = passage_evidence(fit, blocks, medium, probability)
    if not evidence.is_passage:
        return None
    return _Candidate(contact, line_ids, blocks, fit, evidence, other)


def best_start(blocks: Blocks, medium: Medium) -> tuple[PassageFit | None, float]:
    """Fit one data set from many starts, and weigh the opposite turn.

    Parameters
    ----------
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    """
    starts = find_starts(blocks, medium.sound_speed_mps)
    if not starts.turn.size:
        return None, 0.0
    fits = fit_passage(blocks, starts.theta, starts.turn, medium, is_slow_noise=False)
    cost = np.where(_is_sane(fits, blocks), fits.cost, np.inf)
    if not np.isfinite(cost).any():
        return None, 0.0
    best = int(np.argmin(cost))
    opposite = cost[starts.turn != starts.turn[best]]
    behind = float(opposite.min() - cost[best]) if opposite.size else np.inf
    weight = 0.0 if blocks.bearing.is_empty else 1 / (1 + np.exp(min(behind, 50.0)))
    return take_row(fits, best), float(weight)


def _is_sane(fit: PassageFit, blocks: Blocks) -> FloatArray:
    sane = np.isfinite(fit.cost)
    if not blocks.shift.is_empty:
        sane &= fit.theta[:, 2] > 0
    return sane


def _row(candidate: _Candidate, setting: Setting) -> Row:
    time = candidate.blocks.time_s
    reason = not_a_passage(candidate.fit, time)
    if reason is not None:
        return empty_row(candidate.contact, reason)
    row = passage_row(candidate.contact, candidate.fit, setting, candidate.line_ids)
    if not time[0] <= candidate.fit.theta[0, 0] <= time[-1]:
        row = replace(row, status=EXTRAPOLATED, extrapolated=True)
    if row.side and candidate.other_turn > 1e-3:
        other = "port" if row.side == "starboard" else "starboard"
        row.ambiguities.append({"side": other, "weight": candidate.other_turn})
    return row
