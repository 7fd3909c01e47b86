"""Rows of the line study: a mean, a share, an SNR, each with its 95 % interval.

**Conventions.** The interval of a mean is normal, that of a share is Wilson's, that of
an SNR comes from resampling trials (bootstrap).

**References.** Wilson, J. Am. Stat. Assoc. 22, 209-212 (1927); Efron & Tibshirani, "An
Introduction to the Bootstrap" (1993).
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.flow.studies.table import StudyRow

Z95 = 1.96
_N_RESAMPLES = 200


def mean_row(
    case: str, quantity: str, known: float | None, values: FloatArray
) -> list[StudyRow]:
    """Return the row of a mean over runs; none when no run has a value."""
    values = values[np.isfinite(values)]
    if not values.size:
        return []
    mean = float(values.mean())
    # one value tells nothing of its own spread
    spread = float(values.std(ddof=1)) if values.size > 1 else np.inf
    half = Z95 * spread / np.sqrt(values.size)
    return [StudyRow(case, quantity, known, mean, mean - half, mean + half)]


def share_row(
    case: str, quantity: str, known: float | None, is_hit: BoolArray
) -> StudyRow:
    """Return the row of a share."""
    n, p = is_hit.size, float(is_hit.mean())
    middle = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2)) / (1 + Z95**2 / n)
    return StudyRow(case, quantity, known, p, middle - half, middle + half)


def root_row(
    case: str, quantity: str, known: float | None, squares: FloatArray
) -> list[StudyRow]:
    """Return the row of a root mean square over trials; none without a value."""
    return [
        StudyRow(
            case, quantity, known,
            *(float(np.sqrt(max(v, 0.0))) for v in (row.ours, row.low, row.high)),
        )
        for row in mean_row(case, quantity, known, squares)
    ]  # fmt: skip


def heard_row(
    case: str,
    known: float,
    grid_db: FloatArray,
    heard: BoolArray,
    level: float,
    rng: np.random.Generator,
) -> StudyRow:
    """Return the row of the SNR at which a share of the lines is heard.

    Parameters
    ----------
    case
        Case of the row.
    known
        Reference figure, dB.
    grid_db
        SNRs of the trials, ascending.
    heard
        Whether the line was heard, ``(SNR, trial)``.
    level
        The share, 0 to 1.
    rng
        Generator of the resampling.
    """
    ours = heard_db(grid_db, heard.mean(axis=1), level)
    draws = rng.integers(0, heard.shape[1], (_N_RESAMPLES, heard.shape[1]))
    again = [heard_db(grid_db, heard[:, draw].mean(axis=1), level) for draw in draws]
    low, high = np.quantile(again, [0.025, 0.975])
    quantity = f"SNR at {level:.0%} heard, dB".replace("%", " %")
    return StudyRow(case, quantity, known, ours, float(low), float(high))


def heard_db(grid_db: FloatArray, share: FloatArray, level: float = 0.5) -> float:
    """Interpolate the SNR at which a share is heard; the ends if it is outside.

    Examples
    --------
    >>> round(heard_db(np.array([0.0, 2.0]), np.array([0.25, 0.75])), 6)
    1.0
    """
    rising = np.maximum.accumulate(share)
    # ties are spread, since interpolation wants strictly rising shares
    rising = rising + 1e-9 * np.arange(rising.size)
    return float(np.interp(level, rising, grid_db))
