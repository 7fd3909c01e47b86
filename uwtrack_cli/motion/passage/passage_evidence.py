"""What was measured of a candidate, for and against a passage, by name.

**Method.** The checks of a candidate leave what they measured with it. Here stands what
its fit tells besides: what it gains over nothing, how well time and width are known, and
what its speed costs. `motion/decision.py` makes a probability of all that.

**Conventions.** Gains and costs in nepers. One data set, the fit's one row.
"""

import numpy as np

from uwtrack_cli.motion.decision import Evidence
from uwtrack_cli.motion.passage.candidates import (
    CandidatePassage,
    RecordingSpan,
    measured_extent,
)
from uwtrack_cli.motion.passage.readings.change_priors import cost_of_speed


def passage_evidence(candidate: CandidatePassage, limits: RecordingSpan) -> Evidence:
    """Return all that was measured of a candidate.

    Parameters
    ----------
    candidate
        A significant fit, checked.
    limits
        Length of the frames and ends of the recording.
    """
    fit, blocks, ratio = candidate.fit, candidate.blocks, candidate.likelihood_ratio
    width_s, time_s = float(fit.range_over_speed_s[0]), float(fit.theta[0, 0])
    variance = np.diag(fit.covariance[0])
    std = np.sqrt(np.where(variance > 0, variance, np.inf))
    extent = np.array(measured_extent(blocks))
    ends = (extent - time_s) / width_s
    has_lines = not blocks.shift.is_empty
    return {
        "gain": ratio.total - ratio.threshold,
        "gain_over_line": ratio.over_line - ratio.threshold,
        "gain_over_break": ratio.over_break - ratio.threshold,
        "doppler": ratio.doppler,
        "bearing": ratio.bearing,
        "level": ratio.level,
        "line_level": ratio.line_level,
        "log_odds": candidate.reading.log_odds,
        "time_s": time_s,
        "time_std_s": std[0],
        "range_over_speed_s": width_s,
        "relative_width_std": std[1] / width_s,
        "turn_deg": float(np.degrees(np.ptp(np.arctan(ends)))),
        "before": -ends[0],
        "after": ends[1],
        "widths_in_frames": width_s / max(limits.window_s, 1e-9),
        "speed_mps": float(fit.theta[0, 2]),
        "speed_std_mps": std[2] if has_lines else np.nan,
        "speed_cost": cost_of_speed(fit) if has_lines else 0.0,
        "is_air": float(fit.medium.is_air),
        "has_lines": float(has_lines),
        "has_change": float(fit.change is not None),
        **candidate.evidence,
    }
