"""Sound to the spectrum of its envelope: what turns, heard in broadband noise.

**Method.** DEMON, detection of envelope modulation on noise. The sound is cut into
sub-bands; the squared magnitude of each is its envelope, which is decimated and divided
by its running mean (`band_envelopes`). The envelopes of a few bands are transformed in
long frames and added with their phases, as the blades modulate all of them at once. In
each cell a band counts at most a few times as much as the usual band: two tones that
beat in one band are no shaft.

**Conventions.** The result is a spectrogram over the modulation rate. Its density is
that of the relative modulation, 1/Hz, its reference is ``modulation``, and it goes on into
``peaks``, ``classify``, ``track`` and ``trace`` as any other. For a vector sensor the
intensities are those of the modulated part, so rates have bearings.

**References.** Nielsen, "Sonar Signal Processing" (1991), chapter 3; Clark, Kirsteins &
Atlas, "Multiband analysis for colored amplitude-modulated ship noise" (2010); Chung,
Sutin, Sedunov & Bruno, "DEMON acoustic ship signature measurements in an urban harbor",
Advances in Acoustics and Vibration (2011).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked, resolved_by
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import MODULATION, Spectrogram
from uwtrack_cli.errors import DataError, OptionError, warn
from uwtrack_cli.estimation.decimation import PASS_SHARE, decimated_blocks
from uwtrack_cli.estimation.noise_floor import TILE_FRAMES
from uwtrack_cli.estimation.window import hann
from uwtrack_cli.spectra.band_envelopes import HOPS, WINDOW_RATES, BandEnvelopes, EnvelopePlan
from uwtrack_cli.spectra.dipoles import directional_channels, true_components
from uwtrack_cli.spectra.spectrogram import resolve_decimation, time_base

USUAL_BAND_HZ = (400.0, 8000.0)
"""Band of cavitation that is taken unless another is given, cut to the sound's."""

HIGHEST_SHARE = 0.45
"""Share of the sample rate to which the usual band reaches at most."""

USUAL_WINDOW_S, LEAST_WINDOW_S = 8.0, 1.5
"""Window that is taken unless another is given, and the shortest one in a recording of
which it would be more than a third, s."""

LARGEST_SHARE = 1.75
"""Multiple of the median magnitude of all bands that one band may contribute."""

FEWEST_CELLS = 4
"""Cells of the short transform that the whole band must hold."""

FEWEST_SAMPLES = 16
"""Samples that a short window must hold."""


def resolve_demon(recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return band, decimation and window as they follow from a recording.

    Of every option of `demodulate`, None is open. What does not fit is left open: a
    window in too short a recording, and a band at a sample rate too low for the rates
    that are wanted.
    """
    found: dict[str, Any] = {}
    fs = recording.sample_rate_hz
    if options["band_hz"] is None and fs >= _least_rate_hz(options["rate_hz"]):
        top = min(USUAL_BAND_HZ[1], HIGHEST_SHARE * fs)
        found["band_hz"] = (min(USUAL_BAND_HZ[0], 0.25 * top), top)
    found |= resolve_decimation(recording, {**options, **found})
    if options["window_s"] is None and recording.duration_s >= 2.0 * LEAST_WINDOW_S:
        third = recording.duration_s / 3.0
        found["window_s"] = min(USUAL_WINDOW_S, max(LEAST_WINDOW_S, third))
    return found


def _least_rate_hz(rate_hz: tuple[float, float]) -> float:
    """Sample rate that rates up to a limit need, Hz."""
    return FEWEST_SAMPLES * rate_hz[1] / WINDOW_RATES


@resolved_by(resolve_demon)
@checked
def demodulate(
    recording: Recording,
    *,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(1), AtMost(1e6), Increasing()]
    | None = None,
    n_bands: Annotated[int, AtLeast(1), AtMost(64)] = 8,
    rate_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e4), Increasing()] = (
        0.2,
        50.0,
    ),
    window_s: Annotated[float, Unit("s"), AtLeast(0.1), AtMost(3600)] | None = None,
    overlap: Annotated[float, AtLeast(0), AtMost(0.999)] = 0.75,
    zero_padding: Annotated[int, AtLeast(1), AtMost(8)] = 2,
    decimation: Annotated[int, AtLeast(1), AtMost(1024)] | None = None,
) -> Iterator[Spectrogram]:
    """Compute the spectrum of a recording's envelope (DEMON).

    Propellers modulate the noise of their cavitation at the shaft and blade rates, which
    can be found where no line of the vessel is above the noise.

    Parameters
    ----------
    recording
        The recording, opened for reading.
    band_hz
        Lowest and highest frequency of the sound whose envelope is taken, Hz; 400 to
        8000, cut to what the recording holds, unless given.
    n_bands
        Bands of equal width whose envelopes are added, fewer in a narrow band; a rate
        must be in several of them.
    rate_hz
        Lowest and highest modulation rate kept, Hz.
    window_s
        Length of the frames of the envelope, s; 8 unless given, less in a recording
        that is shorter than three of them.
    overlap
        Share of a frame that the next one covers again.
    zero_padding
        Spectral cells per natural bin.
    decimation
        Reduce the sample rate by this factor first, as far as the band allows and to
        10 kHz or more unless given.

    Returns
    -------
    Iterator[Spectrogram]
        Blocks of whole tiles of frames; the last one may be shorter. None has a frame
        if no window is given and the recording has no room for one.

    Raises
    ------
    OptionError
        An option is out of range, or does not go with the sample rate.
    DataError
        The recording is shorter than one window, or was not opened for reading.

    Notes
    -----
    Of noise whose power is 1 + m cos(2 pi f t) a line of mean square m^2 / 2 is left. Of
    K bands with B Hz each the noise has the density 1 / (K B) per Hz, but for overlap.
    """
    if recording.reader is None:
        raise DataError(f"{recording.name} was not opened for reading; open the sound file again.")
    given = {"band_hz": band_hz, "window_s": window_s, "rate_hz": rate_hz, "decimation": decimation}
    known = {**given, **resolve_demon(recording, given)}
    if known["band_hz"] is None or known["window_s"] is None:
        return iter([_no_frames(recording, rate_hz, overlap, zero_padding)])
    layout = _plan(
        recording, known["band_hz"], rate_hz, known["window_s"],
        _Counts(n_bands, overlap, zero_padding, known["decimation"]),
    )  # fmt: skip
    return _blocks(recording, layout)


@dataclass(frozen=True)
class _Counts:
    """Options without a unit."""

    n_bands: int
    """Number of bands."""
    overlap: float
    """Share of a frame that the next one has, too."""
    zero_padding: int
    """Cells per natural bin."""
    decimation: int
    """Factor by which the sample rate is reduced first."""


@dataclass(frozen=True)
class _Layout:
    """How envelopes are cut into frames; lengths in samples of the envelope."""

    envelope: EnvelopePlan
    """How the envelopes are made."""
    window: int
    """Length of the analysis window."""
    hop: int
    """Distance of two frames."""
    fft_length: int
    """Length of the transform."""
    kept: slice
    """Cells that are returned."""
    decimation: int
    """Samples of the recording for one of those that the envelopes are made of."""

    @property
    def frequency_hz(self) -> FloatArray:
        step = self.envelope.rate_hz / self.fft_length
        return step * np.arange(self.kept.start, self.kept.stop)


def _plan(
    recording: Recording,
    band_hz: tuple[float, float],
    rate_hz: tuple[float, float],
    window_s: float,
    counts: _Counts,
) -> _Layout:
    fs = recording.sample_rate_hz / counts.decimation
    highest_hz = 0.5 * fs * (PASS_SHARE if counts.decimation > 1 else 1.0)
    after = "" if counts.decimation == 1 else f" after decimation by {counts.decimation}"
    if band_hz[1] > highest_hz:
        raise OptionError(
            f"band_hz = {band_hz[0]:g} {band_hz[1]:g} reaches above {highest_hz:g} Hz, "
            f"all that {recording.name} holds{after}; give a band below it, or none."
        )
    if fs < _least_rate_hz(rate_hz):
        raise OptionError(
            f"rates up to {rate_hz[1]:g} Hz need a sample rate of "
            f"{_least_rate_hz(rate_hz):g} Hz or more, and {recording.name} has {fs:g} Hz"
            f"{after}; lower the upper limit of rate_hz."
        )
    window = HOPS * round(WINDOW_RATES / rate_hz[1] * fs / HOPS)
    envelope = EnvelopePlan(fs, window, _cells(band_hz, window, fs), counts.n_bands)
    length = max(16, round(window_s * envelope.rate_hz))
    hop = max(1, round(length * (1.0 - counts.overlap)))
    length = round(hop / (1.0 - counts.overlap))  # so that the overlap is as stated
    if recording.duration_s < window_s + window / fs:
        raise DataError(
            f"{recording.name} lasts {recording.duration_s:g} s, less than one window of "
            f"{window_s:g} s of its envelope; give a shorter one (demon --window-s, or "
            "run --set demon.window_s=SECONDS)."
        )
    fft_length = length * counts.zero_padding
    kept = _kept(envelope, fft_length, rate_hz)
    return _Layout(envelope, length, hop, fft_length, kept, counts.decimation)


def _cells(band_hz: tuple[float, float], window: int, fs: float) -> slice:
    from scipy.fft import next_fast_len

    length = next_fast_len(window, real=True)
    frequency = np.fft.rfftfreq(length, 1.0 / fs)
    inside = np.flatnonzero((frequency >= band_hz[0]) & (frequency <= band_hz[1]))
    if inside.size < FEWEST_CELLS:
        raise OptionError(
            f"band_hz = {band_hz[0]:g} {band_hz[1]:g} is too narrow: it must be "
            f"{FEWEST_CELLS * fs / length:.4g} Hz wide for rates of this range; widen it, "
            "or lower the upper limit of rate_hz."
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


def _kept(envelope: EnvelopePlan, fft_length: int, rate_hz: tuple[float, float]) -> slice:
    frequency = np.fft.rfftfreq(fft_length, 1.0 / envelope.rate_hz)
    inside = np.flatnonzero((frequency >= rate_hz[0]) & (frequency <= rate_hz[1]))
    if inside.size < 8:
        raise OptionError(
            f"rate_hz = {rate_hz[0]:g} {rate_hz[1]:g} holds {inside.size} cells of "
            f"{envelope.rate_hz / fft_length:.3g} Hz; at least 8 are needed: widen it, or "
            "lengthen window_s."
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


def _blocks(recording: Recording, layout: _Layout) -> Iterator[Spectrogram]:
    assert recording.reader is not None  # noqa: S101 - checked before
    channels = directional_channels(recording.sensor)
    envelopes = BandEnvelopes(layout.envelope, channels)
    width = len(layout.envelope.groups)
    pending = np.zeros((0, len(channels), width), np.float32)
    valid = np.zeros(0, np.bool_)
    wanted = TILE_FRAMES
    next_frame = 0
    for samples in decimated_blocks(recording.reader, layout.decimation, recording.block_samples):
        more, holds = envelopes.feed(samples)
        pending, valid = np.concatenate([pending, more]), np.append(valid, holds)
        while pending.shape[0] >= layout.window + (wanted - 1) * layout.hop:
            part = (pending, valid)
            yield _block(recording, layout, part, (next_frame, wanted))
            next_frame += wanted
            gone = wanted * layout.hop
            pending, valid = pending[gone:], valid[gone:]
    more, holds = envelopes.finish()
    pending, valid = np.concatenate([pending, more]), np.append(valid, holds)
    rest = max(0, 1 + (pending.shape[0] - layout.window) // layout.hop)
    if rest > 0 or next_frame == 0:
        part = (pending, valid)
        yield _block(recording, layout, part, (next_frame, rest))


def _no_frames(
    recording: Recording, rate_hz: tuple[float, float], overlap: float, zero_padding: int
) -> Spectrogram:
    """Return a block without frames for a recording that has no room for one."""
    least_hz = _least_rate_hz(rate_hz)
    if recording.sample_rate_hz < least_hz:
        cause = (
            f"has a sample rate of {recording.sample_rate_hz:g} Hz, and rates up to "
            f"{rate_hz[1]:g} Hz need {least_hz:g} Hz or more (rate_hz)"
        )
    else:
        cause = (
            f"lasts {recording.duration_s:g} s, and rates of shafts and blades need "
            f"{2.0 * LEAST_WINDOW_S:g} s or more"
        )
    warn(f"{recording.name} {cause}: there is no spectrum of its envelope.")
    length = round(USUAL_WINDOW_S * recording.sample_rate_hz)
    cell_hz = 1.0 / (USUAL_WINDOW_S * zero_padding)
    frequency = np.arange(rate_hz[0], rate_hz[1], cell_hz)
    empty = np.zeros((0, frequency.size), np.float32)
    directed = empty if recording.sensor.has_direction else None
    return Spectrogram(
        frames=time_base(
            recording,
            0,
            np.zeros(0),
            window_samples=length,
            hop_samples=max(1, round(length * (1.0 - overlap))),
            fft_length=length * zero_padding,
        ),
        frequency_hz=frequency,
        power_density=empty,
        intensity_east=directed,
        intensity_north=directed,
        reference=MODULATION,
    )


def _block(
    recording: Recording,
    layout: _Layout,
    envelopes: tuple[FloatArray, BoolArray],
    place: tuple[int, int],
) -> Spectrogram:
    first, count = place
    frames = _frames(recording, layout, envelopes[1], first, count)
    density = _density(envelopes[0], layout, count)
    east, north = None, None
    if recording.sensor.has_direction:
        east, north = true_components(recording.sensor, frames, *density)
    return Spectrogram(
        frames=frames,
        frequency_hz=layout.frequency_hz,
        power_density=density[0],
        intensity_east=east,
        intensity_north=north,
        reference=MODULATION,
    )


def _density(envelopes: FloatArray, layout: _Layout, count: int) -> tuple[FloatArray, ...]:
    """Return density and intensities of the bands' sum, shape (frame, rate) each."""
    from scipy.fft import rfft

    window = np.asarray(hann(layout.window), np.float32)
    n_bands = envelopes.shape[2]
    scale = 2.0 / (layout.envelope.rate_hz * float(np.sum(window**2))) / n_bands**2
    n_cells = layout.kept.stop - layout.kept.start
    out = np.empty((envelopes.shape[1], count, n_cells), np.float32)
    for k in range(count):
        frame = envelopes[k * layout.hop : k * layout.hop + layout.window]
        centred = (frame - frame.mean(axis=0)) * window[:, None, None]
        spectrum = rfft(centred, layout.fft_length, axis=0)[layout.kept]
        size = np.abs(spectrum[:, 0])
        usual = np.median(size, axis=1, keepdims=True)
        share = np.minimum(1.0, LARGEST_SHARE * usual / np.maximum(size, 1e-30))
        total = (spectrum * share[:, None]).sum(axis=2)
        for component in range(out.shape[0]):
            cross = total[:, 0] * np.conj(total[:, component])
            out[component, k] = scale * cross.real
    return tuple(out)


def _frames(
    recording: Recording, layout: _Layout, valid: BoolArray, first: int, count: int
) -> Frames:
    plan, samples = layout.envelope, layout.decimation
    hop = plan.hop * samples
    known = np.concatenate([[0], np.cumsum(valid)])
    begin = np.arange(count) * layout.hop
    return time_base(
        recording,
        first,
        (known[begin + layout.window] - known[begin]) / layout.window,
        window_samples=layout.window * hop,
        hop_samples=layout.hop * hop,
        fft_length=layout.fft_length * hop,
        # an envelope sample stands for the hop in the middle of its short window
        offset_samples=(plan.window - plan.hop) // 2 * samples,
    )
