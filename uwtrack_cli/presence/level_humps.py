"""Transients of the broadband level: the shape of a passage, rain, or unknown.

**Method.** The excess is averaged over bins. A segment is a rise when it stands above
the usual level by several of the spreads that the rest of the recording has by itself,
so that swell and drift, which are the spread, are none. Its shape is compared: the law
of a passage, b + a / (1 + ((t - t0) / w)^2), against a raised cosine and a flat top. Rain
raises the upper half of the band and leaves the lowest quarter behind; of a band whose
upper half is not that of rain nothing is called rain.

**References.** Choi et al. (2014), eq. 3, for the law; Nystuen, JASA 79, 972 (1986), for
the spectrum of rain.
"""

from math import erfc

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.presence import BROADBAND, RAIN, UNKNOWN
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.presence.segment import SoundSegment

FEWEST_BINS, MOST_BINS = 16, 600
"""Bins below which nothing is said, and to how many a recording is cut."""

LEAST_BIN_S = 0.5
"""Least length of a bin, s: what is shorter is a knock."""

FEWEST_SHAPED = 4
"""Bins that a rise must have to show a shape."""

LEAST_RAIN_S = 10.0
"""Least length of rain, s."""

LEAST_RISE_DB = 3.0
"""Least rise that is told, dB."""

RISE_SPREADS = 4.0
"""The same in spreads of the recording's own bins."""

RAIN_TILT_DB, RAIN_TILT_SHARE = 3.0, 0.4
"""Tilt of rain: at least so many dB, and such a share of the rise."""

RAIN_FROM_HZ = 500.0
"""Frequency from which on rain is heard, Hz: the middle of the band lies above."""

GOOD_BEARING_DEG = 30.0
"""Deviation of a bearing below which it counts."""

NO_SHAPE = "a rise of the level without the shape of a passage"
CUT_OFF = "a rise of the level that the recording begins or ends in"
LEVEL_ALONE = "a rise of the level alone, which lines or bearings do not confirm"
IS_RAIN = "a rise above the middle of the band alone, as of rain"


def level_humps(levels: Levels) -> list[SoundSegment]:
    """Return the rises of the broadband level of one sensor."""
    bins = _bins(levels)
    if bins is None:
        return []
    time_s, excess, tilt, edges = bins
    known = np.isfinite(excess)
    if np.count_nonzero(known) < FEWEST_BINS:
        return []
    usual = float(np.median(excess[known]))
    slow = 1.4826 * float(np.median(np.abs(excess[known] - usual)))
    quick = 1.4826 * float(np.median(np.abs(np.diff(excess[known])))) / np.sqrt(2)
    spread = max(slow, quick, 0.05)
    rise = max(LEAST_RISE_DB, RISE_SPREADS * spread)
    usual_tilt = float(np.median(tilt[known]))
    middle_hz = 0.5 * (levels.band_low_hz + levels.band_high_hz)
    found = []
    for first, last in _runs(np.nan_to_num(excess, nan=usual) > usual + 0.5 * rise):
        height = float(np.nanmax(excess[first:last])) - usual
        if height < rise or last - first < 2:
            continue
        extra = float(np.nanmedian(tilt[first:last])) - usual_tilt
        extra = extra if middle_hz >= RAIN_FROM_HZ else 0.0
        kind, reason = _kind(time_s, excess, (first, last), height, extra)
        inside = slice(int(edges[first]), int(edges[last]))
        bearing, scatter = _bearing(levels, inside)
        chance = 0.5 * time_s.size * erfc(height / spread / np.sqrt(2))
        times = levels.frames.time_s[inside]
        found.append(
            SoundSegment(
                kind=kind,
                from_s=float(times[0]),
                to_s=float(times[-1]),
                level_db=float(np.nanmax(levels.level_db[inside])),
                bearing_deg=bearing,
                bearing_std_deg=scatter,
                probability_of_chance=min(1.0, max(chance, 1e-300)),
                reason=reason,
            )
        )
    return found


def _bins(levels: Levels) -> tuple[FloatArray, FloatArray, FloatArray, IntArray] | None:
    """Return time, excess and tilt of the bins, and their first frames."""
    n_frames = levels.frames.n_frames
    span_s = n_frames * levels.frames.hop_s
    n_bins = min(MOST_BINS, n_frames // 2, int(span_s / LEAST_BIN_S))
    if n_bins < FEWEST_BINS:
        return None
    edges = np.linspace(0, n_frames, n_bins + 1).astype(np.int64)
    tilt = levels.tilt_db
    if tilt is None:  # a product of an older program
        tilt = np.zeros(n_frames)
    time_s, excess, tilts = np.empty(n_bins), np.empty(n_bins), np.empty(n_bins)
    for k in range(n_bins):
        rows = slice(int(edges[k]), int(edges[k + 1]))
        known = np.isfinite(levels.excess_db[rows])
        time_s[k] = levels.frames.time_s[rows].mean()
        excess[k] = levels.excess_db[rows][known].mean() if known.any() else np.nan
        tilts[k] = tilt[rows][known].mean() if known.any() else np.nan
    return time_s, excess, tilts, edges


def _runs(above: BoolArray) -> list[tuple[int, int]]:
    change = np.flatnonzero(np.diff(np.concatenate([[0], above.astype(int), [0]])))
    pairs = zip(change[::2], change[1::2], strict=True)
    return [(int(a), int(b)) for a, b in pairs]


def _kind(
    time_s: FloatArray, excess: FloatArray, run: tuple[int, int], height: float, tilt: float
) -> tuple[str, str]:
    first, last = run
    is_tilted = tilt > max(RAIN_TILT_DB, RAIN_TILT_SHARE * height)
    if is_tilted and time_s[last - 1] - time_s[first] > LEAST_RAIN_S:
        return RAIN, IS_RAIN
    if first == 0 or last == time_s.size:
        return UNKNOWN, CUT_OFF
    length = last - first
    if length < FEWEST_SHAPED:
        return UNKNOWN, NO_SHAPE
    near = slice(max(0, first - length), last + length)
    misfits = [
        _misfit(time_s[near], excess[near], time_s[first:last], shape)
        for shape in (_passage, _raised_cosine, _flat_top)
    ]
    if misfits[0] <= min(misfits[1:]):
        return BROADBAND, LEVEL_ALONE
    return UNKNOWN, NO_SHAPE


def _passage(u: FloatArray) -> FloatArray:
    return 1.0 / (1.0 + u**2)


def _raised_cosine(u: FloatArray) -> FloatArray:
    return np.where(np.abs(u) < 2.0, np.cos(0.25 * np.pi * np.clip(u, -2, 2)) ** 2, 0.0)


def _flat_top(u: FloatArray) -> FloatArray:
    return np.clip(1.5 - np.abs(u), 0.0, 1.0)


def _misfit(
    time_s: FloatArray, excess_db: FloatArray, middles_s: FloatArray, shape: object
) -> float:
    """Return the least rms of a shape over a constant, dB, over middles and widths."""
    assert callable(shape)  # noqa: S101 - one of the three above
    known = np.isfinite(excess_db)
    time, level = time_s[known], excess_db[known]
    power = 10 ** (level / 10)
    span = float(np.ptp(middles_s)) + float(time[1] - time[0])
    best = np.inf
    for middle in middles_s[:: max(1, middles_s.size // 40)]:
        for width in span * np.geomspace(0.05, 1.5, 20):
            column = shape((time - middle) / width)
            basis = np.stack([np.ones(time.size), column], axis=1)
            scaled = basis / power[:, None]
            values, *_ = np.linalg.lstsq(scaled, np.ones(time.size), rcond=None)
            model = np.maximum(basis @ values, 1e-3 * power.min())
            rms = float(np.sqrt(np.mean((10 * np.log10(model) - level) ** 2)))
            best = min(best, rms)
    return best


def _bearing(levels: Levels, rows: slice) -> tuple[float, float]:
    std = levels.bearing_std_deg[rows]
    known = std < GOOD_BEARING_DEG
    if not known.any():
        return np.nan, np.nan
    angle = np.radians(levels.bearing_deg[rows][known])
    mean = float(np.degrees(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())))
    off = wrap_deg(np.degrees(angle) - mean)
    return mean % 360.0, float(np.sqrt(np.mean(off**2)))
