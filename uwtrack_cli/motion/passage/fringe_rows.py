"""Rows of encounters that interference fringes tell, confirm or sharpen.

**Method.** A passage told by fringes is the same vessel as a row whose closest approach
lies within the narrower R/v of the two, or where `association` takes them for one. If that row has lines or bearings and agrees, both
are weighed by their deviations: fringes know range over speed, and lines the speed, so
that the range gains. If levels alone tell it, time and range over speed are those of the
fringes, since a level may swing and a pattern cannot. A passage without a row is one of
its own, whose speed is not known. A row of levels that no passage confirms is weighed
again, with the log evidence of the image at its law, and refused where that decides.

Where the pattern is evidently that of one image in the surface, its spacing ties range to
the depths of source and sensor. A range that lines know gives the depth of the source;
without lines the prior of that depth and that of vessels' speeds give range and speed
together, with the wide deviations that they leave.

**Conventions.** As in `encounter_rows`; what disagrees with lines by more than
`LARGEST_CHI2` is left to them.

**References.** Kapolka (2008), doi 10.1121/1.2934751: Doppler and fringes give range.
"""

from collections.abc import Sequence

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.motion.association import PassageReport, same_vessel
from uwtrack_cli.motion.decision import FRINGES, PassageDecision, reject, weigh_more
from uwtrack_cli.motion.evidence.fringes import FringePassage, evidence_of_levels, fringe_passages
from uwtrack_cli.motion.passage.encounter_rows import (
    KEYS,
    LARGEST_RELATIVE_DEVIATION,
    LEVEL_ONLY,
    NO_SPEED,
    CpaContext,
    Refusal,
    Row,
)
from uwtrack_cli.motion.passage.fit.nuisances import NuisancePriors
from uwtrack_cli.motion.passage.readings.change_priors import VESSEL_MPS, VESSEL_STD_MPS

LARGEST_CHI2 = 25.0
"""Square of the difference of time and R/v over its deviations up to which two answers
are of one vessel: five deviations."""

NO_MIRROR = "no image in the surface alone is evident in fringes"
UNKNOWN_SPEED = (
    "speed_mps", "slant_range_m", "horizontal_range_m", "source_level_db",
    "horizontal_range_over_speed_s", "rest_frequencies_hz", "rest_frame_evidence",
    "misfit",
)  # fmt: skip
NO_LINE = "no line: fringes give time and range over speed"


def add_fringes(
    rows: Sequence[Row], fringes: Fringes | None, context: CpaContext, number: int, least: float
) -> tuple[list[Row], list[Refusal]]:
    """Return the rows with what fringes tell of them, those of fringes alone, and refusals.

    Parameters
    ----------
    rows
        Rows of the passages that lines, bearings and levels tell.
    fringes
        The image; None leaves the rows as they are.
    context
        Sensor and medium.
    number
        First contact number that is free.
    least
        Probability above which a row is reported.
    """
    told = list(rows)
    if fringes is None:
        for row in told:
            row.explain("no fringes were asked", "source_depth_m")
        return told, []
    sound_mps = context.sound_speed_mps
    mach = VESSEL_MPS / sound_mps, VESSEL_STD_MPS / sound_mps
    free = list(rows)
    passages = fringe_passages(fringes, mach)
    for one in passages:
        own = _nearest(free, one)
        free = [row for row in free if row is not own]
        if own is None:
            told.append(_row(one, number, fringes, mach[0], context))
            number += 1
        elif own.status == LEVEL_ONLY:
            _take(own, one, mach[0])
        else:
            _sharpen(own, one, sound_mps)
        _add_mirror(told[-1] if own is None else own, one, context.priors)
    kept, refused = [], []
    for row in told:
        _weigh_levels(row, fringes, mach, passages)
        if row.status == LEVEL_ONLY and row.decision.probability <= least:
            refused.append(_refusal(row))
        else:
            row.explain(NO_MIRROR, "source_depth_m")
            kept.append(row)
    return kept, refused


def _weigh_levels(
    row: Row, fringes: Fringes, mach: tuple[float, float], passages: Sequence[FringePassage]
) -> None:
    """Weigh a row of levels by what the image says of it."""
    if row.status == LEVEL_ONLY:
        nepers = evidence_of_levels(fringes, mach, passages, _report(row))
        if np.isfinite(nepers):
            row.decision = weigh_more(row.decision, FRINGES, nepers)


def _report(row: Row) -> PassageReport:
    """Return what of a row is compared."""
    values = row.values
    return PassageReport(
        values["time_s"], values["time_std_s"], values["range_over_speed_s"],
        values["range_over_speed_std_s"],
    )  # fmt: skip


def _refusal(row: Row) -> Refusal:
    """Return what is said of a row that fringes refuse."""
    time_s, width_s = row.values["time_s"], row.values["range_over_speed_s"]
    span_s = max(time_s - width_s, 0.0), time_s + width_s
    why = reject(FRINGES)
    return Refusal(row.contact, *span_s, why, probability=row.decision.probability)


def _nearest(rows: Sequence[Row], one: FringePassage) -> Row | None:
    """Return the row of the same vessel; None if there is none."""
    passage = one.passage
    near: list[tuple[float, int]] = []
    for k, row in enumerate(rows):
        other = _report(row)
        apart_s = abs(other.time_s - passage.time_s)
        width_s = min(passage.width_s, other.range_over_speed_s)
        if apart_s < width_s or same_vessel(one.report, other) > 0.0:
            near.append((apart_s, k))
    return rows[min(near)[1]] if near else None


def _row(
    one: FringePassage, number: int, fringes: Fringes, mach: float, context: CpaContext
) -> Row:
    """Return the row of a passage that fringes alone tell."""
    row = Row(number, NO_SPEED)
    _take(row, one, mach)
    is_omni = len(context.sensor.channel_names) == 1
    why = "no bearing channel" if is_omni else "fringes give no bearing"
    row.explain(why, "bearing_deg", "course_deg", "side")
    row.explain(NO_LINE, *KEYS)
    row.values["motion_model_probability"] = one.probability
    row.values["alternative_motion_model_probability"] = 0.0
    time_s = row.values["time_s"]
    row.extrapolated = not fringes.time_s[0] <= time_s <= fringes.time_s[-1]
    return row


def _take(row: Row, one: FringePassage, mach: float) -> None:
    """Give a row time and range over speed of the fringes, and nothing of levels."""
    values, (time_var, width_var) = row.values, np.diag(one.covariance)
    row.status = NO_SPEED
    row.decision = PassageDecision(
        one.probability, one.rival, 1.0 - one.probability, ((one.rival, one.log_odds),)
    )
    values["time_s"], values["range_over_speed_s"] = (one.passage.time_s, one.passage.width_s)
    values["time_std_s"] = float(np.sqrt(time_var))
    values["range_over_speed_std_s"] = float(np.sqrt(width_var))
    values["arrival_time_s"] = values["time_s"] + mach * values["range_over_speed_s"]
    for covariance in (row.covariance, row.horizontal_covariance):
        covariance[:2, :], covariance[:, :2] = np.nan, np.nan
    row.covariance[:2, :2] = one.covariance
    row.reasons = {name: text for name, text in row.reasons.items() if name not in UNKNOWN_SPEED}
    row.explain(NO_LINE, *UNKNOWN_SPEED)


def _sharpen(row: Row, one: FringePassage, sound_mps: float) -> None:
    """Weigh a row by its deviations with what fringes tell, if they agree."""
    values = row.values
    own = np.array([values["time_s"], values["range_over_speed_s"]])
    off = np.array([one.passage.time_s, one.passage.width_s]) - own
    total = row.covariance[:2, :2] + one.covariance
    if not np.isfinite(total).all() or off @ np.linalg.solve(total, off) > LARGEST_CHI2:
        return
    known = np.flatnonzero(np.isfinite(np.diag(row.covariance)))
    before = row.covariance[np.ix_(known, known)]
    gain = np.linalg.solve(total, before[:2]).T
    moved = dict(zip(known.tolist(), (gain @ off).tolist(), strict=True))
    after = before - gain @ before[:2]
    row.covariance[np.ix_(known, known)] = after
    width_s = own[1]
    values["time_s"] += moved[0]
    values["range_over_speed_s"] += moved[1]
    deviation: FloatArray = np.sqrt(np.diag(row.covariance))
    values["time_std_s"], values["range_over_speed_std_s"] = deviation[:2]
    if 3 in moved and np.isfinite(values["bearing_deg"]):
        for name in ("bearing_deg", "course_deg"):
            values[name] = (values[name] + moved[3]) % 360.0
            values[name.replace("_deg", "_std_deg")] = float(deviation[3])
    if 2 in moved and np.isfinite(values["speed_mps"]):
        values["speed_mps"] += moved[2]
        values["speed_std_mps"] = float(deviation[2])
        _add_ranges(row, width_s)
    speed = values["speed_mps"] if np.isfinite(values["speed_mps"]) else VESSEL_MPS
    delay_s = values["range_over_speed_s"] * speed / sound_mps
    values["arrival_time_s"] = values["time_s"] + delay_s


def _add_mirror(row: Row, one: FringePassage, priors: NuisancePriors) -> None:
    """Give a row what the surface's image tells of depth, or of range and speed."""
    source, sensor, sound_mps = map(float, priors.mean[:3])
    if not np.isfinite(sensor):
        row.explain("no sensor depth", "source_depth_m")
        return
    mirror = one.mirror
    if mirror is None or not mirror.is_evident:
        return
    longer_m = sound_mps * mirror.delay_s
    spread = float(np.hypot(mirror.share, priors.std[1] / sensor))
    values, range_m = row.values, row.values["slant_range_m"]
    if np.isfinite(range_m):
        straight = 1.0 - 0.25 * (longer_m / range_m) ** 2
        depth_m = 0.5 * range_m * longer_m * np.sqrt(max(straight, 0.0)) / sensor
        std_m = depth_m * np.hypot(spread, values["slant_range_std_m"] / range_m)
        if 0.0 < depth_m < sensor and std_m < LARGEST_RELATIVE_DEVIATION * depth_m:
            values["source_depth_m"], values["source_depth_std_m"] = depth_m, std_m
    elif row.status == NO_SPEED and source > 0.0:
        row.explain("its prior gives range and speed", "source_depth_m")
        product = 2.0 * sensor * _median(source, float(priors.std[0]))
        near_m = np.hypot(product / longer_m, 0.5 * longer_m)
        own = np.hypot(spread, _log_std(source, float(priors.std[0])))
        _take_speed(row, float(near_m), float(own), sensor - source)


def _take_speed(row: Row, range_m: float, log_std: float, least_m: float) -> None:
    """Give a row range and speed, by a range that is known to a factor.

    ``log_std``: standard deviation of the range's logarithm. ``least_m``: range below
    which no vessel is.
    """
    values = row.values
    width_s = values["range_over_speed_s"]
    wide = values["range_over_speed_std_s"] / width_s
    usual = _median(VESSEL_MPS, VESSEL_STD_MPS)
    # logarithm of the speed: by range and by what vessels have
    means = np.log([range_m / width_s, usual])
    precision = np.array([np.hypot(log_std, wide), _log_std(VESSEL_MPS, VESSEL_STD_MPS)]) ** -2.0
    mean, std = float(means @ precision / precision.sum()), precision.sum() ** -0.5
    speed = float(np.exp(mean + 0.5 * std**2))
    speed_std = speed * float(np.sqrt(np.expm1(std**2)))
    if speed * width_s < least_m:
        return
    # a wider R/v makes the range's part of the speed less
    slope = -speed / width_s * float(precision[0] / precision.sum())
    row.covariance[2, :2] = row.covariance[:2, 2] = slope * row.covariance[1, :2]
    row.covariance[2, 2] = speed_std**2
    values["speed_mps"], values["speed_std_mps"] = speed, speed_std
    values["slant_range_m"] = speed * width_s
    partial = np.array([speed, width_s])
    values["slant_range_std_m"] = float(np.sqrt(partial @ row.covariance[1:3, 1:3] @ partial))
    for name in ("speed_mps", "slant_range_m"):
        row.reasons.pop(name, None)


def _median(mean: float, std: float) -> float:
    """Return the median of what is log-normal."""
    return mean / float(np.hypot(1.0, std / mean))


def _log_std(mean: float, std: float) -> float:
    """Return the standard deviation of the logarithm of what is log-normal."""
    return float(np.sqrt(np.log1p((std / mean) ** 2)))


def _add_ranges(row: Row, old_width_s: float) -> None:
    """Give the ranges again by the sharper range over speed."""
    values = row.values
    width_s, speed = values["range_over_speed_s"], values["speed_mps"]
    slope = np.array([speed, width_s])
    std_m = float(np.sqrt(slope @ row.covariance[1:3, 1:3] @ slope))
    if np.isfinite(values["slant_range_m"]):
        values["slant_range_m"], values["slant_range_std_m"] = width_s * speed, std_m
    flat_s = values["horizontal_range_over_speed_s"]
    if not np.isfinite(flat_s):
        return
    # heights stay: the squares of both ranges change alike
    square = flat_s**2 + width_s**2 - old_width_s**2
    if square <= 0.0:
        return
    flat_s = float(np.sqrt(square))
    share = width_s / flat_s
    row.horizontal_covariance = row.covariance.copy()
    row.horizontal_covariance[1, :] *= share
    row.horizontal_covariance[:, 1] *= share
    values["horizontal_range_over_speed_s"] = flat_s
    values["horizontal_range_over_speed_std_s"] = share * values["range_over_speed_std_s"]
    if np.isfinite(values["horizontal_range_m"]):
        values["horizontal_range_m"] = flat_s * speed
        values["horizontal_range_std_m"] = float(np.hypot(
            share * values["range_over_speed_std_s"] * speed,
            flat_s * values["speed_std_mps"],
        ))  # fmt: skip
