"""Rows of a study: published figures beside measured ones, with intervals.

**Conventions.** A row is one figure: where it was measured (``case``), what it is
(``quantity`` with its unit), the reference (None where the source gives none), ours
and the 95 % interval of ours: Student's for a mean, the exact binomial one for a share
and for a median, Poisson's for a rate of events, chi-square for the root mean square of
normal errors. Reference figures live in JSON files under ``studies/reference``, so that
no code can return them as results.

**References.** Student, Biometrika 6, 1 (1908). Clopper and Pearson, Biometrika 26, 404
(1934). Garwood, Biometrika 28, 437 (1936), for rates. Thompson, Ann. Math. Stat. 7, 122
(1936), for medians.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.study import StudyRow


def load_reference(name: str) -> Any:
    """Return the reference figures of a study from its JSON file.

    ``name``: name of the study, for instance ``lines``.
    """
    path = Path(__file__).parent / "reference" / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))


TAIL = 0.025
"""Probability on either side of an interval."""


def mean_row(case: str, quantity: str, known: float | None, values: FloatArray) -> list[StudyRow]:
    """Return the row of a mean over runs; none when no run has a value."""
    from scipy.special import stdtrit

    values = values[np.isfinite(values)]
    if not values.size:
        return []
    mean = float(values.mean())
    # one value tells nothing of its own spread
    half = np.inf
    if values.size > 1:
        error = float(values.std(ddof=1)) / np.sqrt(values.size)
        half = float(stdtrit(values.size - 1, 1.0 - TAIL)) * error
    return [StudyRow(case, quantity, known, mean, mean - half, mean + half)]


def share_row(
    case: str, quantity: str, known: float | None, is_hit: BoolArray, *, percent: bool = False
) -> StudyRow:
    """Return the row of a share of independent runs, in percent if wanted."""
    from scipy.special import betaincinv

    n, hits = is_hit.size, int(np.count_nonzero(is_hit))
    low = float(betaincinv(hits, n - hits + 1, TAIL)) if hits else 0.0
    high = float(betaincinv(hits + 1, n - hits, 1.0 - TAIL)) if hits < n else 1.0
    unit = 100.0 if percent else 1.0
    return StudyRow(case, quantity, known, unit * hits / n, unit * low, unit * high)


def median_row(case: str, quantity: str, known: float | None, values: FloatArray) -> StudyRow:
    """Return the row of a median over runs, with the ranks' interval."""
    from scipy.stats import binom

    ordered = np.sort(values)
    rank = int(binom.ppf(TAIL, ordered.size, 0.5))
    low, high = -np.inf, np.inf  # too few runs for an interval
    if rank:
        low, high = float(ordered[rank - 1]), float(ordered[-rank])
    return StudyRow(case, quantity, known, float(np.median(ordered)), low, high)


def rate_row(
    case: str, quantity: str, known: float | None, count: int, exposure: float
) -> StudyRow:
    """Return the row of a rate of events: their number over what they were counted in."""
    from scipy.special import gammaincinv

    low = float(gammaincinv(count, TAIL)) if count else 0.0
    high = float(gammaincinv(count + 1, 1.0 - TAIL))
    return StudyRow(case, quantity, known, count / exposure, low / exposure, high / exposure)


def exact_row(case: str, quantity: str, known: float | None, value: float) -> StudyRow:
    """Return the row of a figure without random error."""
    return StudyRow(case, quantity, known, value, value, value)


def error_row(
    case: str, quantity: str, known: float | None, value: float, error: float
) -> StudyRow:
    """Return the row of a figure with a standard error that is known well."""
    half = 1.96 * error
    return StudyRow(case, quantity, known, value, value - half, value + half)


def root_row(case: str, quantity: str, known: float | None, squares: FloatArray) -> list[StudyRow]:
    """Return the row of a root mean square over trials; none without a value."""
    return [
        StudyRow(
            case, quantity, known,
            *(float(np.sqrt(max(v, 0.0))) for v in (row.ours, row.low, row.high)),
        )
        for row in mean_row(case, quantity, known, squares)
    ]  # fmt: skip


def normal_root_row(
    case: str, quantity: str, known: float | None, root: float, runs: int
) -> StudyRow:
    """Return the row of a root mean square of so many normal errors, or of a multiple."""
    from scipy.special import chdtri

    low, high = (float(np.sqrt(runs / chdtri(runs, p))) for p in (TAIL, 1.0 - TAIL))
    return StudyRow(case, quantity, known, root, root * low, root * high)
