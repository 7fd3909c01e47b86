"""Where the limits of "one passage told twice" come from: drawn lines of one vessel.

The lines of a drawn passage are parted into two contacts, each with half of the
instants and all the noise of its own; both are fitted. Prints the quantiles of how far
the two answers are apart, in deviations (`SAME_DEVIATIONS`) and in d/v (`SAME_SHARE`),
and which share of pairs of different vessels within a minute would be taken for one:
python -m studies.constants.same_passage 60 6000
"""

import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.draws.measured_passages import SENSOR, draw, draw_pair
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.passage.candidates import CandidatePassage, examine, is_one
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors
from uwtrack_cli.motion.passage.model.measurements import series_data

MEDIUM = nuisance_priors(SENSOR, None, None, 3.0, 2.0).medium
QUANTILES = (0.0, 0.5, 0.9, 0.95, 0.99, 1.0)


def fitted(series: Series) -> CandidatePassage | None:
    """Return the significant fit of the lines of a table, without its levels."""
    unknown = np.full(series.time_s.size, np.nan)
    alone = replace(series, level_db=unknown, level_std_db=unknown)
    columns = np.arange(1, series.frequency_hz.shape[1] + 1)
    return examine(series_data(alone, 1), (1,), columns, MEDIUM, 1e-3)


def only(series: Series, kept: FloatArray, lines: FloatArray) -> Series:
    """Return some instants of some lines."""
    frequency = np.where(kept[:, None], series.frequency_hz, np.nan)[:, lines]
    return replace(
        series,
        frequency_hz=frequency,
        frequency_std_hz=series.frequency_std_hz[:, lines],
        bearing_deg=np.where(kept, series.bearing_deg, np.nan),
    )


def halves(series: Series) -> list[Series]:
    """Return the odd and the even instants."""
    every = np.arange(series.frequency_hz.shape[1])
    is_even = np.arange(series.time_s.size) % 2 == 0
    return [only(series, kept, every) for kept in (is_even, ~is_even)]


def vessels(seed: int) -> list[Series]:
    """Return the lines of each vessel of a drawn pair, without bearings of both."""
    pair = draw_pair(seed)
    every = np.ones(pair.series.time_s.size, np.bool_)
    silent = replace(pair.series, bearing_deg=np.full(every.size, np.nan))
    return [only(silent, every, np.flatnonzero(pair.lines == k)) for k in (0, 1)]


def pairs(count: int, seed: int, *, of_one: bool) -> Iterator[list[CandidatePassage]]:
    """Yield both fits of drawn pairs."""
    for k in range(seed, seed + count):
        parts = halves(draw("straight", k).series) if of_one else vessels(k)
        found = [one for one in map(fitted, parts) if one is not None]
        if len(found) == len(parts):
            yield found


def apart(found: list[CandidatePassage]) -> tuple[float, float]:
    """Return the largest lag of two answers in deviations, and of their times in d/v."""
    value = np.array(
        [(one.fit.theta[0, 0], one.fit.range_over_speed_s[0], one.fit.theta[0, 2]) for one in found]
    )
    variance = sum(np.diag(one.fit.covariance[0])[:3] for one in found)
    lag = abs(value[0] - value[1])
    return float((lag / np.sqrt(variance)).max()), float(lag[0] / value[:, 1].min())


def main(count: int, seed: int) -> None:
    """Print how far apart parts of one passage are, and how many pairs are taken for one."""
    warnings.simplefilter("ignore")
    for of_one in (True, False):
        every = list(pairs(count, seed, of_one=of_one))
        lags = np.array([apart(found) for found in every])
        whose = "one vessel" if of_one else "two vessels"
        for name, column in (("deviations", lags[:, 0]), ("d/v", lags[:, 1])):
            words = ", ".join(
                f"{q:.0%} {value:.2g}"
                for q, value in zip(QUANTILES, np.quantile(column, QUANTILES), strict=True)
            )
            print(f"{whose}, quantiles of the lag in {name}: {words}")
        same = sum(is_one(*found) for found in every)
        print(f"{whose}: {same} of {len(every)} pairs are taken for one")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
