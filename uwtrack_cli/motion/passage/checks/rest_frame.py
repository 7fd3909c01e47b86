"""The rest-frame test: tones that are steady in the vessel's own time.

**Method.** A passage says how the frequency of every line of the vessel moved. Each
line is cut out of the sound as a narrow band and turned back by that movement: if the
passage is true, what is left is a constant tone, and the longer the frames the sharper
it stands out. The same is done for the rivals: nothing moved, a steady drift and one
step, with slope, height and instant from the line's own measured frequencies. A passage
that is read beside a ramp or a step must beat that change alone, too: the drift may
then begin or end, and the step lie, near the instant of that change. At every
frame length the sharpness of a reading is what its three strongest cells gain over
noise in log-likelihood, M (p - 1 - ln p) with the mean power ratio p of M independent
frames, less what the strongest of as many cells of noise would gain. The evidence
against a rival is the mean over the frame lengths of the logarithm of the ratio of
both; that of the passage is the evidence against its best rival.

The shortest frames resolve half of the Doppler shift of a line, each next length is
twice the one before: a law that is only roughly right is as sharp as the true one in
short frames, and blurred in long ones. A slow vessel's lines may follow the law and a
rival alike within what the longest frames resolve; where its bearings show the passage
by themselves, the sound is not asked about such a rival. Lines that are followed and are no tones in any
reading, such as noise that a tracker has joined, leave no evidence at all: a passage
must gain something itself.

**Conventions.** Times count from the first sample. Frequencies shift by fractions: the
Doppler law in time of reception is that of the fit.

**References.** Weiss (1994), IEEE Signal Processing Magazine 11, 13 (time-scale
processing); Ferguson (1992), J. Acoust. Soc. Am. 92, 947 (lines of a passage).
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.decimation import decimated_stretch, usual_decimation
from uwtrack_cli.estimation.narrow_bands import TAPER, NarrowBand, narrow_bands
from uwtrack_cli.motion.passage.candidates import CandidatePassage
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import RAMP, STEP, Change

REACH = 3.0
"""d/v on either side of the closest approach that are read."""

N_LENGTHS = 4
"""Frame lengths, each twice the one before."""

FEWEST_FRAMES = 2
"""Lengths of a frame in the stretch below which a length is left out."""

FEWEST_CELLS = 12
"""Cells of a frame below which its noise is not known."""

CONTEXT, WIDEST = 12.0, 0.45
"""Half of the band that is cut out: so many Doppler shifts, at most such a share of the
line's frequency."""

USED_BAND = 1.0 - TAPER
"""Share of that band whose noise is taken: its edges are tapered."""

INNER = 2.5
"""Doppler shifts on either side of the rest frequency that are searched for the tone."""

STRONGEST = 3
"""Cells of a tone: the main lobe of a Hann window."""

NOISE_MARGIN = 2.0
"""Nepers above the logarithm of the number of cells that a tone must gain."""

SMALLEST_GAIN = 5.0
"""Nepers added to both gains of a ratio, so that two that are nothing are alike."""

AVERAGED = 1 / 1.056
"""Independent frames in one of those that overlap by half (Hann; Welch 1967)."""

N_STEPS = 9
"""Instants within d/v of the closest approach at which the rival may step."""

RIVALS = ("constant", "frequency-ramp", "frequency-step")
"""Readings that the passage must beat."""

FASTEST_KNOWN = 3.0
"""Deviations of the speed from zero below which nothing is claimed of the lines."""

RESOLVED = 1.0
"""Distance of two readings, in cells of the longest frames, from which they are told
apart: nearer ones leave a tone within its main lobe. It is measured where power is."""


class RestFrame(NamedTuple):
    """What the sound says of a passage."""

    evidence: float
    """Mean logarithm of its sharpness over that of its best rival, nepers."""
    rival: str
    """That rival, one of `RIVALS`."""
    gain: float
    """What its lines gain over noise at the best frame length, nepers."""


def ask_the_sound(candidate: CandidatePassage, recording: Recording | None) -> CandidatePassage:
    """Return a candidate with what the sound says of it.

    Parameters
    ----------
    candidate
        A significant fit.
    recording
        The recording it was heard in; None without it.

    Returns
    -------
    CandidatePassage
        The same with its evidence.
    """
    fit = candidate.fit
    # engines are no steady machines: in air the pattern of all sound is asked instead
    if recording is None or fit.medium.is_air or not fit.rest_hz.shape[1]:
        return candidate
    deviation = float(np.sqrt(np.maximum(fit.covariance[0, 2, 2], 0.0)))
    if not fit.theta[0, 2] > FASTEST_KNOWN * deviation:
        return candidate
    gain = candidate.likelihood_ratio
    turns = gain.bearing > gain.threshold
    heard = rest_frame(recording, fit, candidate.blocks, turns=turns)
    if heard is None:
        return candidate
    return replace(candidate, rest_frame_evidence=heard.evidence).measured(
        rest_frame=heard.evidence, tones=heard.gain
    )


def rest_frame(
    recording: Recording, fit: PassageFit, blocks: Blocks, *, turns: bool = False
) -> RestFrame | None:
    """Ask the sound of a recording whether a passage is true.

    Parameters
    ----------
    recording
        The recording; one whose sound is not at hand says nothing.
    fit
        Fit of one data set with lines.
    blocks
        The measurements that it was made from.
    turns
        Whether its bearings show the passage by themselves, so that a rival whose tones
        are the same within the resolution of the sound says nothing against it.

    Returns
    -------
    RestFrame | None
        None without a line, without the sound, or where too little of it is there.
    """
    is_known = np.isfinite(fit.rest_std_hz[0])
    is_known &= (fit.rest_hz[0] > 0) & (fit.rest_hz[0] < recording.sample_rate_hz / 2)
    speed, width = float(fit.theta[0, 2]), float(fit.range_over_speed_s[0])
    if not is_known.any() or speed <= 0:
        return None
    mach = speed / fit.medium.sound_speed_mps
    heard_s = float(fit.theta[0, 0]) + mach * width
    start_s = max(heard_s - REACH * width, 0.0)
    stop_s = min(heard_s + REACH * width, recording.duration_s)
    if stop_s <= start_s:
        return None
    rest_hz = fit.rest_hz[0, is_known]
    half_hz = min(CONTEXT * mach, WIDEST) * rest_hz
    is_wide = half_hz * (stop_s - start_s) > FEWEST_CELLS
    if not is_wide.any():
        return None
    rest_hz, half_hz = rest_hz[is_wide], half_hz[is_wide]
    highest_hz = float((rest_hz + half_hz).max())
    factor = usual_decimation(recording.sample_rate_hz, highest_hz, least_rate_hz=0.0)
    sound, rate_hz, start_s = decimated_stretch(recording, start_s, stop_s, factor)
    try:
        bands = narrow_bands(sound, rate_hz, rest_hz, half_hz)
    except DataError:
        return None
    shapes = _rivals(blocks, is_known, (heard_s, width), fit.change)
    return _compared(bands, start_s, fit, shapes, mach, turns=turns)


class _Rivals(NamedTuple):
    """A drift and a step of all lines, without a passage."""

    slope: float
    """Slope of the drift, 1/s."""
    from_s: float
    """Where it is zero, s: its middle, or where it begins or ends."""
    sign: float
    """+1 where it begins there, -1 where it ends, 0 where it goes on."""
    step: float
    """Height of the step."""
    step_s: float
    """Its instant, s."""

    def shifts(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shift by the drift and by the step."""
        lag = time_s - self.from_s
        if self.sign:
            lag = np.where(self.sign * lag > 0, lag, 0.0)
        return self.slope * lag, self.step * (time_s > self.step_s)


def _rivals(
    blocks: Blocks, is_known: BoolArray, place: tuple[float, float], change: Change | None
) -> _Rivals:
    """Fit a common drift, and a common step, to the lines.

    ``place`` is when the closest approach was heard and d/v, s. Where a change is read
    beside the passage, it may be all there is.
    """
    heard_s, width_s = place
    value = blocks.shift.value[0, is_known]
    weight = blocks.shift.weight[0, is_known]
    lag = blocks.time_s - heard_s
    weight = np.where(abs(lag) < REACH * width_s, weight, 0.0)
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    left = value - (weight * value).sum(axis=1, keepdims=True) / total
    about = width_s * np.linspace(-1.0, 1.0, N_STEPS)

    def best(columns: FloatArray) -> tuple[int, float]:
        free = columns[:, None] - ((weight * columns[:, None]).sum(axis=-1, keepdims=True) / total)
        size = np.maximum((weight * free**2).sum(axis=(1, 2)), 1e-300)
        along = (weight * free * left).sum(axis=(1, 2))
        first = int(np.argmax(along**2 / size))
        return first, float(along[first] / size[first])

    steps, bends = heard_s + about, [(heard_s, 0.0)]
    if change is not None and change.kind == STEP:
        steps = np.append(steps, float(change.time_s[0]))
    if change is not None and change.kind == RAMP:
        near = float(change.time_s[0]) + about
        bends += [(float(at), float(change.sign[0])) for at in near]
    ramps = [_Rivals(1.0, *bend, 0.0, 0.0).shifts(blocks.time_s)[0] for bend in bends]
    number, slope = best(np.array(ramps))
    place_of, step = best(np.where(blocks.time_s > steps[:, None], 1.0, 0.0))
    return _Rivals(slope, *bends[number], step, float(steps[place_of]))


def _compared(
    bands: list[NarrowBand],
    start_s: float,
    fit: PassageFit,
    rivals: _Rivals,
    mach: float,
    *,
    turns: bool,
) -> RestFrame | None:
    gains = np.zeros((N_LENGTHS, 1 + len(RIVALS)))
    is_told = np.full(len(RIVALS), not turns)
    is_used = np.zeros(N_LENGTHS, np.bool_)
    for band in bands:
        shortest = 2 / (mach * band.centre_hz) * band.rate_hz
        lengths = [round(shortest * 2**k) for k in range(N_LENGTHS)]
        time = start_s + np.arange(band.sound.size) / band.rate_hz
        shifts = (fit.law(time).shift[0], np.zeros(time.size), *rivals.shifts(time))
        turn = 2j * np.pi * band.centre_hz / band.rate_hz
        readings = [band.sound * np.exp(-turn * np.cumsum(s)) for s in shifts]
        power = np.abs(band.sound) ** 2
        for k, length in enumerate(lengths):
            if length < FEWEST_CELLS or time.size < FEWEST_FRAMES * length:
                continue
            is_used[k] = True
            for number, shift in enumerate(shifts[1:]):
                apart = _reach(shifts[0] - shift, power) * band.centre_hz
                is_told[number] |= apart > RESOLVED * band.rate_hz / length
            inner = (INNER * mach * band.centre_hz) / band.rate_hz + 2 / length
            gains[k] += [_gain(reading, length, inner) for reading in readings]
    if not (is_used.any() and is_told.any()):
        return None
    sharp = np.log(gains[is_used] + SMALLEST_GAIN)
    evidence = (sharp[:, :1] - sharp[:, 1:]).mean(axis=0)
    best = int(np.argmin(np.where(is_told, evidence, np.inf)))
    return RestFrame(float(evidence[best]), RIVALS[best], float(gains[:, 0].max()))


def _reach(apart: FloatArray, power: FloatArray) -> float:
    """Return how far two readings reach from each other where the power is.

    Half of the distance of its ends for one that is linear under even power: what differs
    where next to nothing is heard is not told apart.
    """
    share = power / max(float(power.sum()), 1e-300)
    off = apart - float(share @ apart)
    return float(np.sqrt(3.0 * (share @ off**2)))


def _gain(sound: NDArray[np.complexfloating], length: int, inner: float) -> float:
    """Log-likelihood that the strongest tone of a narrow band gains over noise.

    ``inner`` is half of the band in which it is sought, in cycles per sample.
    """
    frames = np.lib.stride_tricks.sliding_window_view(sound, length)[:: length // 2]
    power = np.abs(np.fft.fft(frames * np.hanning(length), axis=1)) ** 2
    frequency = np.fft.fftfreq(length)
    known = power[:, abs(frequency) < USED_BAND / 2]
    floor = np.median(known, axis=1) / np.log(2)
    heard = floor > 0
    if not heard.any():
        return 0.0
    within = power[np.ix_(heard, abs(frequency) <= inner)] / floor[heard, None]
    ratio = np.maximum(within.mean(axis=0), 1.0)
    gain = AVERAGED * heard.sum() * (ratio - 1 - np.log(ratio))
    gain -= np.log(ratio.size) + NOISE_MARGIN
    return float(np.maximum(np.sort(gain)[-STRONGEST:], 0.0).sum())
