"""The two-step rule that shrinks the validation region along with the threshold.

**Method.** After the prior-optimal false alarm rate is found, the region's radius is set
to one of two numbers derived from the operating point, whichever promises the larger q2
by a fitted formula, and the target is taken to lie in it with certainty.

**Conventions.** The radius is in standard deviations.

**References.** Choi, Kim and Hong (2001), section III and Figs. 1-2, with the formula of
Kershaw and Evans that it rests on.

Notes
-----
Shrinking the region cannot help: q2 never falls when the gate widens at a given clutter
density. The rule is kept because it is the paper's; it reports a smaller variance and
loses more tracks than the prior rule (``uwtrack study clutter``).
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

_PAPER_SHIFT = 3.0
"""Mean of the target's amplitude in the paper's Fig. 1, in noise deviations."""


def shrunk_gate(
    false_alarm: FloatArray,
    detection: FloatArray,
    one_cell: FloatArray,
    gate: float,
) -> FloatArray:
    """Return the radius of the paper's second step.

    Parameters
    ----------
    false_alarm
        False alarm probability of the first step.
    detection
        Detection probability of the first step.
    one_cell
        Radius at which the region is one resolution cell.
    gate
        Greatest radius.

    Returns
    -------
    FloatArray
        Radius in standard deviations, between one cell and ``gate``.

    Notes
    -----
    gamma_1 = 3 - Phi^-1(P_D), gamma_2 = sqrt(-2 ln P_F). The fitted q2, 0.997 P_D / (1 +
    0.37 P_D^-1.57 mu), falls with the clutter mu in the region at a given operating
    point, so that the larger q2 is always that of the smaller radius.

    Examples
    --------
    >>> float(shrunk_gate(np.array(0.03222), np.array(0.7318), np.array(1.7), 4.0).round(3))
    2.382
    """
    from scipy.special import ndtri

    from_detection = _PAPER_SHIFT - ndtri(detection)
    from_false_alarm = np.sqrt(-2.0 * np.log(false_alarm))
    smaller = np.minimum(from_detection, from_false_alarm)
    radius: FloatArray = np.minimum(np.maximum(smaller, one_cell), gate)
    return radius
