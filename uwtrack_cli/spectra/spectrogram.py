"""Sound to spectrogram: one-sided power density, and intensity where directional.

**Method.** Hann-windowed frames, zero-padded, one transform each. Frames lie on a grid
that starts with the first sample; the last incomplete frame is left out.

**Conventions.** Power density in reference^2/Hz, one-sided: it integrates to the mean
square of the signal. The intensity components are the real parts of omni times the
conjugate of the dipole channels, turned to east and north.

**References.** Welch 1967; D'Spain et al. 1991 for active intensity by DIFAR sensors.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Rungs, Unit, checked, resolved_by
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import FULL_SCALE, MICROPASCAL, Spectrogram
from uwtrack_cli.errors import DataError, OptionError, warn
from uwtrack_cli.estimation.decimation import PASS_SHARE, decimated_blocks, usual_decimation
from uwtrack_cli.estimation.noise_floor import TILE_FRAMES
from uwtrack_cli.spectra.dipoles import directional_channels, true_components
from uwtrack_cli.spectra.frame_transform import FrameTransform, lost_samples

BLOCK_SAMPLES = 1 << 18
"""Samples, after decimation, that a block of whole tiles spans at most, if it can."""

LIVE_BLOCK_S = 4.0
"""Longest block of live sound, unless a tile of the noise floor is longer, s: what is
told of it is late by as much."""


def resolve_spectrogram(recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return window and decimation as they follow from a recording and all options."""
    found = resolve_decimation(recording, options)
    if options["largest_share"] is not None:
        longest_s = options["largest_share"] * recording.duration_s
        found["window_s"] = min(options["window_s"], longest_s)
    return found


def resolve_decimation(recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the decimation that a band allows, where it is left open."""
    if options["decimation"] is not None:
        return {}
    highest_hz = None if options["band_hz"] is None else options["band_hz"][1]
    return {"decimation": usual_decimation(recording.sample_rate_hz, highest_hz)}


@resolved_by(resolve_spectrogram)
@checked
def compute_spectrogram(
    recording: Recording,
    *,
    window_s: Annotated[float, Unit("s"), AtLeast(1e-6), AtMost(3600), Rungs()] = 1.0,
    overlap: Annotated[float, AtLeast(0), AtMost(0.999)] = 0.5,
    zero_padding: Annotated[int, AtLeast(1), AtMost(8)] = 2,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    decimation: Annotated[int, AtLeast(1), AtMost(1024)] | None = None,
    largest_share: Annotated[float, AtLeast(1e-3), AtMost(1)] | None = None,
) -> Iterator[Spectrogram]:
    """Compute the spectrogram of a recording, block by block.

    Parameters
    ----------
    recording
        The recording, opened for reading.
    window_s
        Length of the analysis window, s. The command takes several, for a spectrogram
        of each.
    overlap
        Share of a window that the next one covers again.
    zero_padding
        Spectral cells per natural bin; 2 loses less between the bins.
    band_hz
        Lowest and highest frequency kept, Hz; by default all.
    decimation
        Reduce the sample rate by this factor first, as far as the band allows and to
        10 kHz or more unless given; 1 leaves it. What is left ends at 0.4 of the new rate.
    largest_share
        Greatest share of the recording that a window may take; it is shortened to
        that. None for the window as it is.

    Returns
    -------
    Iterator[Spectrogram]
        Blocks of whole tiles of frames; the last one may be shorter.

    Raises
    ------
    OptionError
        An option is out of range.
    DataError
        The recording is shorter than one window, or was not opened for reading.

    Notes
    -----
    ``P = 2 |X|^2 / (f_s sum w^2)`` except at zero and the Nyquist frequency, where the
    factor 2 is absent (Welch 1967): the density that scipy.signal.welch returns.
    """
    given = {
        "window_s": window_s, "largest_share": largest_share,
        "band_hz": band_hz, "decimation": decimation,
    }  # fmt: skip
    used = {**given, **resolve_spectrogram(recording, given)}
    layout = plan_frames(
        recording, used["window_s"], overlap, zero_padding, band_hz, used["decimation"]
    )
    if recording.sensor.element_along_m is not None:
        warn(
            f"the spectrogram is that of hydrophone {recording.sensor.channel_names[0]} "
            f"of array {recording.sensor.id!r} alone; 'uwtrack beamform' uses all."
        )
    return _blocks(recording, layout)


def plan_frames(
    recording: Recording,
    window_s: float,
    overlap: float,
    zero_padding: int,
    band_hz: tuple[float, float] | None,
    decimation: int,
) -> FrameTransform:
    """Return how a recording is cut into frames, after checking that it can be.

    Options as those of `compute_spectrogram`, the decimation resolved.

    Raises
    ------
    OptionError
        The window or the band holds too little.
    DataError
        The recording is shorter than one window, or was not opened for reading.
    """
    if recording.reader is None:
        raise DataError(f"{recording.name} was not opened for reading; open the sound file again.")
    rate_hz = recording.sample_rate_hz / decimation
    window = round(window_s * rate_hz)
    if window < 16:
        raise OptionError(
            f"window_s = {window_s} s holds {max(window, 0)} samples at {rate_hz:g} Hz; "
            "at least 16 are needed."
        )
    if recording.n_samples < window * decimation:
        raise DataError(
            f"{recording.name} lasts {recording.duration_s:g} s, less than one window "
            f"of {window_s:g} s; give a shorter one (spectrogram --window-s, or "
            f"run --set STEP.window_s=SECONDS for the recipe's step with {window_s:g} s)."
        )
    hop = max(1, round(window * (1.0 - overlap)))
    fft_length = window * zero_padding
    frequency_hz = np.fft.rfftfreq(fft_length, 1.0 / rate_hz)
    if decimation > 1:  # above it, sound has folded
        frequency_hz = frequency_hz[frequency_hz <= 0.5 * PASS_SHARE * rate_hz]
    return FrameTransform(
        rate_hz, decimation, window, hop, fft_length, _kept(frequency_hz, band_hz)
    )


def _kept(frequency_hz: FloatArray, band_hz: tuple[float, float] | None) -> slice:
    if band_hz is None:
        return slice(0, frequency_hz.size)
    low, high = band_hz
    inside = np.flatnonzero((frequency_hz >= low) & (frequency_hz <= high))
    if inside.size < 8:
        raise OptionError(
            f"band_hz = {low:g} {high:g} must reach below the highest frequency of the "
            f"recording, {frequency_hz[-1]:g} Hz, and hold 8 cells."
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


def _blocks(recording: Recording, layout: FrameTransform) -> Iterator[Spectrogram]:
    wanted = _block_frames(layout)
    if recording.is_live:
        tile_s = TILE_FRAMES * layout.hop / layout.rate_hz
        wanted = min(wanted, TILE_FRAMES * max(1, int(LIVE_BLOCK_S / tile_s)))
    for samples, first, count in frame_blocks(recording, layout, wanted):
        yield _block(recording, layout, samples, first, count)


def frame_blocks(
    recording: Recording, layout: FrameTransform, block_frames: int
) -> Iterator[tuple[FloatArray, int, int]]:
    """Yield the samples of so many frames at a time, reading the recording once.

    The last block may have fewer.

    Yields
    ------
    tuple
        Samples, shape (sample, channel), in uPa if calibrated, after decimation; the
        index of the first frame, and the number of frames.
    """
    assert recording.reader is not None  # noqa: S101 - checked in plan_frames
    scale_to_upa = np.float32(recording.sensor.full_scale_upa or 1.0)
    parts = [np.zeros((0, recording.n_channels), np.float32)]
    wanted = layout.window + (block_frames - 1) * layout.hop
    next_frame = 0
    for samples in decimated_blocks(recording.reader, layout.decimation, recording.block_samples):
        parts.append(samples * scale_to_upa)
        if sum(map(len, parts)) < wanted:
            continue
        pending = np.concatenate(parts)
        while pending.shape[0] >= wanted:
            yield pending, next_frame, block_frames
            next_frame += block_frames
            pending = pending[block_frames * layout.hop :]
        parts = [pending.copy()]  # of what was yielded, nothing is held
    pending = np.concatenate(parts)
    rest = 1 + (pending.shape[0] - layout.window) // layout.hop
    if rest > 0:
        yield pending, next_frame, rest


def _block_frames(layout: FrameTransform) -> int:
    """Frames in a block: whole tiles of the noise floor."""
    tiles = BLOCK_SAMPLES // (layout.hop * TILE_FRAMES)
    return min(max(1, tiles), 16) * TILE_FRAMES


def _block(
    recording: Recording,
    layout: FrameTransform,
    samples: FloatArray,
    first_frame: int,
    n_frames: int,
) -> Spectrogram:
    sensor = recording.sensor
    frames = describe_frames(recording, layout, samples, first_frame, n_frames)
    whole = bool((frames.valid_fraction == 1.0).all())
    clean = samples if whole else np.nan_to_num(samples)
    columns = directional_channels(sensor)
    is_flat = _flat_frames(clean[:, list(columns)], layout, n_frames)
    if len(columns) == 1:
        power = layout.power(clean[:, columns[0]], n_frames)
        power[is_flat] = 0.0
        return _spectrogram(sensor, layout, frames, power)
    power, first, second = layout.intensity(clean[:, list(columns)], n_frames)
    power[is_flat], first[is_flat], second[is_flat] = 0.0, 0.0, 0.0
    parts = true_components(sensor, frames, power, first, second)
    return _spectrogram(sensor, layout, frames, power, *parts)


def _spectrogram(
    sensor: Sensor,
    layout: FrameTransform,
    frames: Frames,
    power: FloatArray,
    east: FloatArray | None = None,
    north: FloatArray | None = None,
) -> Spectrogram:
    return Spectrogram(
        frames=frames,
        frequency_hz=layout.frequency_hz,
        power_density=power,
        intensity_east=east,
        intensity_north=north,
        reference=FULL_SCALE if sensor.full_scale_upa is None else MICROPASCAL,
    )


def describe_frames(
    recording: Recording,
    layout: FrameTransform,
    samples: FloatArray,
    first_frame: int,
    n_frames: int,
) -> Frames:
    """Return the time base of a block of so many frames from one on.

    Samples, shape (sample, channel), are nan where there is none.
    """
    return time_base(
        recording,
        first_frame,
        1.0 - lost_samples(samples, layout.window, layout.hop, n_frames) / layout.window,
        window_samples=layout.window * layout.decimation,
        hop_samples=layout.hop * layout.decimation,
        fft_length=layout.fft_length * layout.decimation,
    )


def time_base(
    recording: Recording,
    first_frame: int,
    valid_fraction: FloatArray,
    *,
    window_samples: int,
    hop_samples: int,
    fft_length: int,
    offset_samples: int = 0,
) -> Frames:
    """Return the frames of a recording, without noise floor.

    Frame 0 begins at the offset; lengths are in samples of the recording.
    """
    count = valid_fraction.size
    index = np.arange(first_frame, first_frame + count, dtype=np.int64)
    start = index * hop_samples + offset_samples
    start_utc_ns = recording.start_utc_ns
    if start_utc_ns is not None:
        start_utc_ns += round(recording.sensor.clock_offset_s * 1e9)
    return Frames(
        start_sample=start,
        time_s=(start + window_samples / 2) / recording.sample_rate_hz,
        valid_fraction=valid_fraction,
        band_low_hz=np.zeros(0),
        band_high_hz=np.zeros(0),
        noise_db=np.full((count, 0), np.nan),
        threshold_db=np.full(count, np.nan),
        sensor=recording.sensor.id,
        sample_rate_hz=recording.sample_rate_hz,
        window_samples=window_samples,
        hop_samples=hop_samples,
        fft_length=fft_length,
        first_frame=first_frame,
        start_utc_ns=start_utc_ns,
    )


FLAT_SAMPLES = 8
"""Samples at the begin of a frame that are looked at first: sound changes within them."""


def _flat_frames(samples: FloatArray, layout: FrameTransform, n_frames: int) -> BoolArray:
    """Tell in which frames nothing changes: a converter that is stuck, no sound.

    What rounding leaves of them has a spectrum of steady lines.
    """
    first = np.arange(n_frames) * layout.hop
    begin = samples[first[:, None] + np.arange(min(FLAT_SAMPLES, layout.window))]
    is_flat: BoolArray = (begin == begin[:, :1]).all(axis=(1, 2))
    for frame in np.flatnonzero(is_flat):
        whole = samples[first[frame] : first[frame] + layout.window]
        is_flat[frame] = bool((whole == whole[0]).all())
    return is_flat
