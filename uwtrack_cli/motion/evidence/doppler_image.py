"""How far the sound of a few seconds shifts in log frequency as a passage would have it.

**Method.** What a vehicle radiates is a pattern over the logarithm of frequency: orders of
an engine, a horn, the whine of gears. Its Doppler factor moves all of it by one amount,
whatever the pattern is. Frames of the sound are shifted back by a law, and a free pattern
explains their mean: in some of its cells something sounds, of unit variance, and nothing
in the others. With that integrated out, what a cell gains is

    log(1 - q + q exp(1/2 [m^2 W W / (1 + W) - log(1 + W)]))

with its weighted mean m, its precision W and the share q of cells that sound, so that no
pattern gains nothing. No line is tracked, and none is cut where it falls fastest. The same
frames are explained by what passes nowhere: a pattern that stays or drifts, one that steps,
one that moves as a passage turned upside down, and noise. What the passage gains over the
best of them is its evidence. The engine may drift while it passes.

An engine in place that slows down shifts its sound as a passage does, and its level changes
with its speed; that of a vehicle rises and falls about the closest approach. Mean levels of
quarters of R/v are fitted by least squares: as the power of the vehicle, which falls with the
square of the range and may be louder ahead or astern, over the rest of the sound; as a level
that is linear in the shift; and as one that drifts. The evidence is half the number of means
times the logarithm of the ratio of the squares that are left, fading of each included.

**Conventions.** Times count from the first sample; those of frames are as received, that of
a closest approach is its own, before its sound arrives. A law is that time, R/v there and v
over the speed of sound. Gains in nepers.

**References.** Kapolka (2008), doi 10.1121/1.2934751, for shifts in log frequency;
Rasmussen and Williams (2006), section 2.7, for what is integrated out; Gelman et al. (2013),
Bayesian Data Analysis, ch. 14, for the ratio of squares.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.decimation import decimated_stretch, usual_decimation

CELLS_PER_OCTAVE = 64
"""Cells of an octave: one is a shift by 1 %, 3.7 m/s in air."""

BAND_HZ = (80.0, 3000.0)
"""Band whose pattern is taken: engines, horns and gears."""

PADDING = 4
"""Length of the transforms over that of the frames."""

FRAME_S, SHORTEST_S, LONGEST_S = 0.17, 0.06, 0.24
"""Length of the frames, s, for a passage whose R/v is one second, and limits: it grows as
the root of R/v, so that a tone moves by a resolution in a frame where it falls fastest."""

OVERLAP, MOST_FRAMES, FIRST_LOOK = 3, 240, 2
"""Frames in the length of one, how many are taken at most of a long passage, and every how
many in a first look."""

BACKGROUND_OCTAVES = 0.3
"""Running mean along frequency that is taken off each frame: orders and tones are narrower,
and bands of interference with the ground's image, which fall before the closest approach and
rise behind it, are wider."""

CLIPPED = (-2.5, 4.0)
"""Nepers about that mean to which a cell is held: an empty one says no more."""

LEAST_VARIANCE = 0.3
"""Variance of a cell that is assumed at least, nepers^2."""

REACH, LEAST_REACH_S = 6.0, 1.0
"""R/v and seconds, at least, on either side of the closest approach that are taken."""

LARGEST_SHIFT = 0.45
"""Shift of the logarithm of frequency up to which laws are tried."""

FASTEST, SLOWEST, N_SPEEDS = 0.35, 0.012, 28
"""Speeds over that of sound that are tried, and how many."""

WIDTHS, TIMES, DRIFTS = (0.5, 0.7, 1.0, 1.4, 2.0), 7, (-0.05, 0.0, 0.05)
"""R/v over that of a rise, times within R/v of it, and drifts of the logarithm of the
engine's speed in R/v, that are tried."""

NEAR, LEAST_GAIN = 0.06, 4.0
"""Shift within which the pattern of a frame is sought about its place, and nepers that it
must gain there."""

LEAST_FRAMES = 8
"""Frames that the sound must have."""

SOUNDING = 0.2
"""Prior share of the cells in which something sounds; chosen."""

ROUNDS, FINER = 18, 0.6
"""Rounds in which the best law is refined, and the ratio of their steps."""


class DopplerLaw(NamedTuple):
    """A passage as its Doppler shift shows it."""

    time_s: float
    """Closest approach, s."""
    width_s: float
    """R/v there, s."""
    mach: float
    """Speed over that of sound."""
    drift: float = 0.0
    """Of the logarithm of the engine's speed, 1/s."""


class PatternCourse(NamedTuple):
    """Where a pattern was in each frame; arrays of shape (frame,)."""

    time_s: FloatArray
    """Middle of the frame, s."""
    shift: FloatArray
    """Of the logarithm of its frequencies; nan where it does not stand out."""
    shift_std: FloatArray
    """Standard deviation of that."""
    tone_hz: float
    """Its strongest tone, at rest, Hz."""
    tone_std_hz: float
    """Standard deviation of that, by the width of a cell, Hz."""
    overlap: float
    """Share of a frame that the next one has, too."""


class DopplerEvidence(NamedTuple):
    """What the shift of a pattern says of a passage."""

    law: DopplerLaw
    """The best law."""
    gain: float
    """What the pattern gains if it moves so, nepers."""
    evidence: float
    """What of it no other movement gains, and no noise, nepers."""
    course: PatternCourse
    """The pattern, frame by frame."""


def shifts(time_s: FloatArray, law: FloatArray) -> FloatArray:
    """Return the logarithm of the Doppler factor of what arrives at times.

    Parameters
    ----------
    time_s
        Instants, s, shape (frame,).
    law
        Rows of time, R/v, Mach number and drift, shape (law, 4).
    """
    at, width, mach, drift = (law[:, [n]] for n in range(4))
    lag = (time_s - at) / width
    # the sound that arrives at t left at t - R / c
    emitted = (lag - mach * np.sqrt(lag**2 + 1.0 - mach**2)) / (1.0 - mach**2)
    moved = -np.log1p(mach * emitted / np.hypot(1.0, emitted))
    return np.asarray(moved + drift * (time_s - at))


class DopplerImage:
    """Log-frequency image of some seconds of sound.

    Parameters
    ----------
    samples
        Sound, shape (n,).
    rate_hz
        Samples per second.
    start_s
        Time of the first sample, s.
    frame_s
        Length of its frames, s.
    """

    def __init__(self, samples: FloatArray, rate_hz: float, start_s: float, frame_s: float) -> None:
        from scipy.fft import next_fast_len, rfft
        from scipy.ndimage import uniform_filter1d

        length = round(frame_s * rate_hz)
        hop = max(1, length // OVERLAP, samples.size // MOST_FRAMES)
        frames = np.lib.stride_tricks.sliding_window_view(samples, length)[::hop]
        size = next_fast_len(PADDING * length, real=True)
        power = np.abs(rfft(frames * np.hanning(length), size, axis=1)) ** 2
        cell = np.log(2.0) / CELLS_PER_OCTAVE
        low_hz, high_hz = (max(BAND_HZ[0], 2.0 / frame_s), min(BAND_HZ[1], 0.44 * rate_hz))
        self.log_hz = np.arange(np.log(low_hz), np.log(high_hz), cell)
        place = np.exp(self.log_hz) * size / rate_hz
        half = 0.5 * np.maximum(place * cell, 1.0)
        total = np.pad(power.cumsum(axis=1), ((0, 0), (1, 0)))

        def summed(at: FloatArray) -> FloatArray:
            first = np.floor(at).astype(int)
            share = at - first
            return np.asarray(total[:, first] * (1 - share) + total[:, first + 1] * share)

        level = (summed(place + 0.5 + half) - summed(place + 0.5 - half)) / (2 * half)
        value = np.log(level + 1e-12 * max(float(level.max()), 1e-300))
        smooth = round(BACKGROUND_OCTAVES * CELLS_PER_OCTAVE) | 1
        value -= uniform_filter1d(value, smooth, axis=1, mode="nearest")
        value = np.clip(value, *CLIPPED)
        scatter = value - np.median(value, axis=0)
        variance = max(float(np.median(scatter**2)) / 0.455, LEAST_VARIANCE)
        self.time_s = start_s + (np.arange(len(frames)) * hop + 0.5 * length) / rate_hz
        # Hann frames: bins in a resolution, and frames in one that is independent
        share = np.minimum(1.0, np.exp(self.log_hz) * cell * frame_s / 1.5)
        self.precision = share * min(1.0, 2.0 * hop / length) / variance
        self._margin = int(LARGEST_SHIFT / cell) + 1
        wide = ((0, 0), (self._margin, self._margin))
        self._value = np.pad(value.astype(np.float32), wide)
        self._known = np.pad(np.ones(self.log_hz.size, np.float32), self._margin)
        view = np.lib.stride_tricks.sliding_window_view
        self._shifted = view(self._value, self.log_hz.size, axis=1)
        self._known_of = view(self._known, self.log_hz.size)
        self._cell, self._overlap = cell, max(0.0, 1.0 - hop / length)

    def _stacked(self, moved: FloatArray, step: int = 1) -> tuple[FloatArray, FloatArray]:
        """Return mean and precision of the frames shifted back, shape (law, cell).

        Of every ``step``-th frame; to the nearest cell if that is not every one.
        """
        place = np.clip(moved / self._cell, -self._margin, self._margin - 1)
        whole = np.floor(place if step == 1 else place + 0.5).astype(int)
        share = (place - whole).astype(np.float32)[..., None]
        whole += self._margin
        total = np.zeros((len(moved), self.log_hz.size), np.float32)
        known, is_known = np.zeros_like(total), self._known_of
        for frame in range(0, self.time_s.size, step):
            values, low = self._shifted[frame], whole[:, frame]
            if step > 1:
                total += values[low]
                known += is_known[low]
                continue
            part = share[:, frame]
            total += values[low] * (1 - part) + values[low + 1] * part
            known += is_known[low] * (1 - part) + is_known[low + 1] * part
        return total / np.maximum(known, 1e-9), step * known * self.precision

    def gains(self, moved: FloatArray, step: int = 1) -> FloatArray:
        """Return what a free pattern gains if it is shifted so, nepers, shape (law,).

        Parameters
        ----------
        moved
            Shift of log frequency, shape (law, frame).
        step
            Every how many frames are taken, for a first look.
        """
        mean, weight = self._stacked(moved, step)
        gain = 0.5 * (mean**2 * weight * weight / (1 + weight) - np.log1p(weight))
        sounds = np.logaddexp(gain + np.log(SOUNDING), np.log1p(-SOUNDING))
        return np.asarray(sounds.sum(axis=1), np.float64)

    def course(self, law: DopplerLaw) -> PatternCourse:
        """Measure in every frame where the pattern is that a law has found.

        A frame in which it does not stand out within `NEAR` of its place has nan.
        """
        moved = shifts(self.time_s, np.array([law]))
        mean, weight = (each[0] for each in self._stacked(moved))
        pattern = mean * weight / (1.0 + weight)
        reach = round(NEAR / self._cell)
        place = np.clip(moved[0] / self._cell, -self._margin, self._margin - 1)
        whole = np.floor(place).astype(int) + self._margin
        offsets = np.arange(-reach, reach + 1)
        frames = np.arange(self.time_s.size)[:, None, None]
        cells = whole[:, None, None] + offsets[:, None] + np.arange(pattern.size)
        cells = np.clip(cells, 0, self._value.shape[1] - 1)
        value, known = self._value[frames, cells], self._known[cells]
        gain = ((value * pattern - 0.5 * known * pattern**2) * self.precision).sum(-1)
        best = np.clip(gain.argmax(axis=1), 1, 2 * reach - 1)
        rows = np.arange(best.size)
        left, middle, right = (gain[rows, best + k] for k in (-1, 0, 1))
        bend = np.minimum(left - 2.0 * middle + right, -1e-6)
        top = 0.5 * (left - right) / bend
        stands_out = (middle >= np.maximum(left, right)) & (middle > LEAST_GAIN)
        shift = (whole - self._margin + offsets[best] + top) * self._cell
        tone_hz = float(np.exp(self.log_hz[np.argmax(pattern**2 * weight)]))
        return PatternCourse(
            self.time_s, np.where(stands_out, shift, np.nan),
            np.where(stands_out, self._cell / np.sqrt(-bend), np.nan),
            tone_hz, tone_hz * self._cell / 12.0**0.5, self._overlap,
        )  # fmt: skip

    def gain(self, law: DopplerLaw) -> float:
        """Return what the pattern gains by one law, nepers."""
        return float(self.gains(shifts(self.time_s, np.array([law])))[0])

    def best(self, time_s: float, width_s: float) -> tuple[DopplerLaw, float]:
        """Return the law of most gain about a time and R/v, and its gain."""
        speeds = np.geomspace(SLOWEST, FASTEST, N_SPEEDS)
        best, most = DopplerLaw(time_s, width_s, speeds[0]), -np.inf
        for ratio in WIDTHS:
            wide = ratio * width_s
            axes = (
                time_s + width_s * np.linspace(-1.0, 1.0, TIMES), [wide], speeds,
                np.array(DRIFTS) / max(width_s, 0.3),
            )  # fmt: skip
            laws = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 4)
            gain = self.gains(shifts(self.time_s, laws), FIRST_LOOK)
            first = int(np.argmax(gain))
            if gain[first] > most:
                best, most = DopplerLaw(*laws[first].tolist()), float(gain[first])
        return self.refined(best, self.gain(best))

    def refined(self, law: DopplerLaw, gain: float) -> tuple[DopplerLaw, float]:
        """Return the law of most gain near one, and its gain."""
        x = np.array([law.time_s, np.log(law.width_s), np.log(law.mach), law.drift])
        step = np.array([0.15 * law.width_s, 0.15, 0.08, 0.03 / max(law.width_s, 0.3)])
        near = np.concatenate([np.eye(4), -np.eye(4)])
        for _ in range(ROUNDS):
            tried = x + near * step
            laws = np.column_stack([tried[:, 0], np.exp(tried[:, 1:3]), tried[:, 3]])
            found = self.gains(shifts(self.time_s, laws))
            first = int(np.argmax(found))
            if found[first] > gain:
                x, gain = tried[first], float(found[first])
            else:
                step = FINER * step
        return DopplerLaw(float(x[0]), float(np.exp(x[1])), float(np.exp(x[2])), float(x[3])), gain

    def other_gain(self, law: DopplerLaw) -> float:
        """Return what the best movement without a passage gains, nepers."""
        lag = (self.time_s - law.time_s) / law.width_s
        drift = np.linspace(-0.4, 0.4, 41)[:, None] * lag / max(np.abs(lag).max(), 1e-9)
        at, height = np.meshgrid(np.linspace(-1.5, 1.5, 7), np.linspace(-0.4, 0.4, 41))
        step = height.reshape(-1, 1) * (lag > at.reshape(-1, 1))
        speeds = np.geomspace(SLOWEST, FASTEST, N_SPEEDS)
        upside_down = -np.concatenate([
            shifts(
                self.time_s,
                np.stack([[law.time_s, ratio * law.width_s, v, 0.0] for v in speeds]),
            )
            for ratio in (0.5, 1.0, 2.0)
        ])  # fmt: skip
        return float(self.gains(np.concatenate([drift, step, upside_down])).max())


def doppler_evidence(recording: Recording, time_s: float, width_s: float) -> DopplerEvidence | None:
    """Return the best law of a passage of seconds, and the evidence of the sound for it.

    Parameters
    ----------
    recording
        The recording.
    time_s, width_s
        Where it rises, and for how long, R/v, s.

    Returns
    -------
    DopplerEvidence | None
        None where the sound is not at hand, or there is too little of it.
    """
    reach_s = max(REACH * width_s, LEAST_REACH_S)
    factor = usual_decimation(recording.sample_rate_hz, BAND_HZ[1], least_rate_hz=0.0)
    start_s, stop_s = max(time_s - reach_s, 0.0), time_s + reach_s
    blocks, rate_hz, start_s = decimated_stretch(
        recording, start_s, min(stop_s, recording.duration_s), factor
    )
    try:
        sound = np.concatenate(list(blocks)).astype(np.float64)
    except DataError:
        return None
    frame_s = min(max(FRAME_S * width_s**0.5, SHORTEST_S), LONGEST_S)
    if sound.size < LEAST_FRAMES * frame_s * rate_hz:
        return None
    image = DopplerImage(sound - sound.mean(), rate_hz, start_s, frame_s)
    found, gain = image.best(time_s, width_s)
    other = max(image.other_gain(found), 0.0)
    return DopplerEvidence(found, gain, gain - other, image.course(found))


HUMP_REACH, BLOCK = 3.0, 0.25
"""R/v on either side that are taken, and of a mean."""

FADING_DB = 1.5
"""Scatter of a mean by directions, ground and load, dB."""

FLOORS = 10.0 ** np.arange(-3.0, 0.51, 0.25)
"""Power of the rest of the sound, over the vehicle's at its closest."""

FEWEST_MEANS = 8
"""Means without which nothing is said."""


def level_hump(levels: Levels, time_s: float, width_s: float) -> float:
    """Return the log evidence that the level goes with the range of a passage.

    Parameters
    ----------
    levels
        Levels of the sound.
    time_s, width_s
        Closest approach, as it is heard, and R/v, s.

    Returns
    -------
    float
        Nepers; nan where too little was measured.
    """
    lag = (levels.frames.time_s - time_s) / width_s
    known = (np.abs(lag) < HUMP_REACH) & np.isfinite(levels.excess_db)
    cell = np.floor(lag[known] / BLOCK).astype(int)
    _, place = np.unique(cell, return_inverse=True)
    count = np.bincount(place)
    if count.size < FEWEST_MEANS:
        return float("nan")
    mean_db = np.bincount(place, levels.excess_db[known]) / count
    middle = np.bincount(place, lag[known]) / count
    shift = middle / np.hypot(1.0, middle)
    rise_db = 10.0 * np.log10(1.0 / (1.0 + middle**2) + FLOORS[:, None])
    rises = [_left(mean_db - one, shift) for one in rise_db]
    other = min(_left(mean_db, shift), _left(mean_db, middle))
    floor = count.size * FADING_DB**2
    return float(0.5 * count.size * np.log((other + floor) / (min(rises) + floor)))


def _left(level_db: FloatArray, course: FloatArray) -> float:
    """Return the squares that a course times any factor leaves of levels."""
    own, left = course - course.mean(), level_db - level_db.mean()
    left = left - own * float(own @ left) / max(float(own @ own), 1e-12)
    return float(left @ left)
