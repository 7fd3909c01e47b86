"""Target motion in words: why a value is missing, what the data can tell."""

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.estimation.target_motion.coordinates import to_motion
from uwtrack_cli.stages.motion.contact import ContactAnswer
from uwtrack_cli.stages.motion.modes import ModeAnswer

LARGEST_LOG_RANGE_STD = 1.0
"""Deviation of ln R above which the range is not told."""

LARGEST_SPEED_STD_MPS = 5.0
LARGEST_COURSE_STD_RAD = np.radians(60.0)


def reasons_of(mode: ModeAnswer, answer: ContactAnswer) -> dict[str, str]:
    """Say for every value that cannot be told why not."""
    told = mode.observability.told.copy()
    # what scales or turns freely drags speed and course along, even where their
    # slopes happen to vanish
    told[2:4] &= told[0] & told[1]
    motion = to_motion(mode.q)
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    spans = mode.intervals
    cause = _cause(mode, answer)
    reasons: dict[str, str] = {}
    if not told[0]:
        reasons["range_m"] = cause
    elif spans["range"].open_high or std[0] > LARGEST_LOG_RANGE_STD * motion[0]:
        low = "" if spans["range"].open_low else _at_least(np.exp(spans["range"].low))
        reasons["range_m"] = f"the data do not bound the range yet{low}; {cause}"
    if "range_m" in reasons and mode.at_limit_m is not None and told[0]:
        reasons["range_m"] = (
            f"the best fit lies on the limit of the search, {mode.at_limit_m:.0f} m: "
            f"widen range_limits_m, or the data do not bound the range"
        )
    if not told[1]:
        reasons["bearing_deg"] = "no bearings: only the shape of the pass is told"
    reasons |= {
        key: cause
        for key, hidden in (
            ("speed_mps", not told[2] or std[2] > LARGEST_SPEED_STD_MPS),
            ("course_deg", not told[3] or std[3] > LARGEST_COURSE_STD_RAD),
            ("rest_frequencies_hz", not told[4:].all()),
        )
        if hidden
    }
    now = {"now_range_m": "range_m", "now_bearing_deg": "bearing_deg"}
    return reasons | {key: reasons[of] for key, of in now.items() if of in reasons}


def _at_least(range_m: float) -> str:
    return f" (at least {range_m:.0f} m)"


def _cause(mode: ModeAnswer, answer: ContactAnswer) -> str:
    """Name what is missing for the range to be told."""
    weakest = mode.observability.weakest
    n_parameters = mode.observability.n_parameters
    if answer.n_values < n_parameters:
        return f"{answer.n_values} values cannot fix {n_parameters} parameters"
    no_bearings = bool(np.isnan(answer.data.bearing_deg).all())
    singular = mode.observability.rank < n_parameters
    if no_bearings:
        return f"frequencies alone do not fix the motion: {weakest} fits alike"
    if singular and not answer.manoeuvring:
        if answer.data.line_id.size == 0:
            missing = "there are no frequency lines and own ship does not manoeuvre"
        else:
            missing = "the bearing does not change and own ship does not manoeuvre"
        return f"{missing}: {weakest} fits alike"
    return f"too little change of bearing and frequency so far: {weakest} is one sigma"


def ellipse_agrees(mode: ModeAnswer) -> bool:
    """Tell whether deviations and likelihood-ratio intervals say the same."""
    motion = to_motion(mode.q)
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    centres = {"range": np.log(motion[0]), "speed": motion[2], "course": motion[3]}
    widths = {"range": std[0] / motion[0], "speed": std[2], "course": std[3]}
    for name, span in mode.intervals.items():
        if span.is_open:
            return False
        # the course of the interval is counted from -180 to 180 degrees
        centre = centres[name] if name != "course" else (span.low + span.high) / 2.0
        half = max(span.high - centre, centre - span.low)
        other = min(span.high - centre, centre - span.low)
        if half > 1.25 * 1.96 * widths[name] or other < 0.75 * 1.96 * widths[name]:
            return False
    return True


def report_of(
    mode: ModeAnswer,
    answer: ContactAnswer,
    reasons: dict[str, str],
    *,
    manoeuvre_needed: bool,
) -> str:
    """Say in a few sentences what the data can and cannot tell."""
    seen = mode.observability
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance), 0.0))
    motion = to_motion(mode.q)
    known = [
        f"{name} to {value:.2g} {unit}"
        for name, key, value, unit in (
            ("range", "range_m", 100.0 * std[0] / motion[0], "%"),
            ("speed", "speed_mps", std[2] / KNOT_MPS, "kn"),
            ("course", "course_deg", np.degrees(std[3]), "deg"),
        )
        if key not in reasons
    ]
    parts = [f"{seen.rank} of {seen.n_parameters} parameters are told"]
    if np.isfinite(seen.condition):
        parts[0] += f" (condition {seen.condition:.3g})"
    if "range_m" in reasons:
        parts.append(f"range is not observable: {reasons['range_m']}")
    if known:
        parts.append(f"known (one sigma): {', '.join(known)}")
    parts.append(f"weakest direction: {seen.weakest}")
    if manoeuvre_needed:
        parts.append("a manoeuvre of own ship is needed")
    elif not answer.manoeuvring and answer.data.line_id.size:
        parts.append("own ship does not manoeuvre: the range rests on Doppler")
    parts.append(
        f"chance of range within 10 %, speed within 3 kn and course within 7 deg: "
        f"{seen.probability:.3f}"
    )
    parts += _complaints(mode, answer)
    if "range_m" in reasons:
        return "; ".join(parts) + "."
    parts.append(
        f"a sound speed wrong by 1 % moves the range by "
        f"{mode.range_per_sound_speed:+.2g} %"
    )
    if not ellipse_agrees(mode):
        parts.append("the deviations mislead here: use the intervals")
    return "; ".join(parts) + "."


def _complaints(mode: ModeAnswer, answer: ContactAnswer) -> list[str]:
    """Say when the residuals are larger than the deviations allow."""
    freedom = answer.n_values - mode.observability.n_parameters
    if freedom < 1:
        return []
    ratio = mode.value / freedom
    if ratio < 1.0 + 5.0 * np.sqrt(2.0 / freedom):
        return []
    words = (
        f"the misfit is {ratio:.3g} times what the deviations explain: outliers (try a "
        f"robust loss), a manoeuvre of the target, or deviations that are too small"
    )
    return [words]
