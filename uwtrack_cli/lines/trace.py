"""Spectrogram to frequency lines by track-before-detect.

**Method.** No peak is picked. In overlapping windows the most likely path through the
cells is found by dynamic programming, and a line is declared when its whole path is
too likely for noise; so lines some 6 dB weaker are found than by tracking peaks. One
line after another is taken out of the window. Paths are then measured, smoothed and
joined from window to window. How high paths score in the recording's own noise is
measured where no line can be (`lines.paths.recording_noise`): thresholds are raised by
what it exceeds white noise, and the rate of false lines that is left is stated.

**Conventions.** The points of a line are final one window after they were recorded,
those of lines that come together when they have parted (`lines.paths.meetings`).

**References.** Streit & Barrett, IEEE Trans. ASSP 38(4), 586-598 (1990); Barrett &
Holdsworth, IEEE Trans. SP 41(10), 2965-2976 (1993).
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.line_points import LinePoints, no_table, to_lines
from uwtrack_cli.lines.paths.path_tracer import PathTracer, TraceRule
from uwtrack_cli.lines.paths.trace_threshold import TraceThreshold, tail_key
from uwtrack_cli.lines.tracker_options import Harmonics, ProcessNoise

_MOTION, _HARMONICS = ProcessNoise(), Harmonics()


@checked
def trace_lines(
    blocks: Iterator[Spectrogram],
    *,
    false_lines_per_khz_hour: Annotated[float, Unit("1/(kHz h)"), AtLeast(1e-9), AtMost(1e9)] = 1.0,
    window_frames: Annotated[int, AtLeast(32), AtMost(240)] = 120,
    shortest_frames: Annotated[int, AtLeast(4), AtMost(240)] = 10,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    motion: ProcessNoise = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> Iterator[Lines]:
    """Track frequency lines that are too weak for any single frame.

    Searches whole minutes at once, so it finds vessels that `track` misses; a line that
    bends by more than a cell per frame is for `track`.

    Parameters
    ----------
    blocks
        Spectrogram, block by block.
    false_lines_per_khz_hour
        Lines that noise alone may cause, per kHz of band and hour, in frames of any length.
    window_frames
        Frames that are searched together, a multiple of 4; also the latency.
    shortest_frames
        Frames for which a line must last, at most the frames searched together.
    band_hz
        Lowest and highest frequency searched in Hz; everything unless given.
    motion
        How fast frequencies and bearings may change.
    harmonics
        What a harmonic family looks like.

    Yields
    ------
    Lines
        One block per input block with the points that are final, then the rest
        with the table of lines.

    Raises
    ------
    OptionError
        An option is out of range, or the noise of such frames is not known.

    Notes
    -----
    The score of a path is the sum over its cells of ln I0(2 sqrt(d y)) - d with
    d = 1.5 and y the power over noise, minus ln 8 per move of one cell. With 60 s and
    1 s frames, half of all lines of -1.0 dB over the noise in 1 Hz are found. With a
    directional sensor, the evidence that the path's sound has one bearing is added
    to its score, with the threshold raised so that noise starts no more lines: half of
    the lines of about 1 dB less are found.
    """
    _check(window_frames, shortest_frames)
    tracer: PathTracer | None = None
    frames: Frames | None = None
    reference = ""
    for block in blocks:
        frames, reference = block.frames, block.reference
        if tracer is None:
            rule = trace_rule(
                block,
                false_lines_per_khz_hour=false_lines_per_khz_hour,
                window_frames=window_frames,
                shortest_frames=shortest_frames,
                band_hz=band_hz,
                motion=motion,
                harmonics=harmonics,
            )
            tracer = PathTracer(rule, block)
        points = LinePoints.join(tracer.push(block))
        yield to_lines(frames, points, no_table(), tracer.scalars(reference))
    if tracer is not None and frames is not None:
        points = tracer.finish()
        nothing = frames.take("frame", slice(0, 0))
        scalars = tracer.scalars(reference)
        yield to_lines(nothing, points, tracer.line_table(), scalars)


def _check(window_frames: int, shortest_frames: int) -> None:
    if window_frames % 4:
        raise OptionError(f"window_frames must be a multiple of 4, got {window_frames}.")
    if shortest_frames > window_frames:
        raise OptionError(
            f"shortest_frames must be at most window_frames = {window_frames}, got "
            f"{shortest_frames}."
        )


def trace_rule(
    block: Spectrogram,
    *,
    false_lines_per_khz_hour: float = 1.0,
    window_frames: int = 120,
    shortest_frames: int = 10,
    band_hz: tuple[float, float] | None = None,
    motion: ProcessNoise = _MOTION,
    harmonics: Harmonics = _HARMONICS,
) -> TraceRule:
    """Derive the tracer's settings from the options and the first block.

    Raises
    ------
    OptionError
        The noise of such frames is not known, or the band is empty.
    """
    frames = block.frames
    overlap = 1.0 - frames.hop_samples / frames.window_samples
    padding = frames.cells_per_bin
    key = tail_key(overlap, padding)
    threshold = TraceThreshold(
        false_lines_per_khz_hour, key[0], key[1], frames.hop_s, window_frames
    )
    band = band_hz or (0.0, float(block.frequency_hz[-1]))
    inside = (block.frequency_hz >= band[0]) & (block.frequency_hz <= band[1])
    if np.count_nonzero(inside) < 64 * padding:
        raise OptionError(
            f"band_hz = {band[0]:g} {band[1]:g} holds {np.count_nonzero(inside)} cells "
            f"of the spectrogram; trace needs at least {64 * padding}."
        )
    return TraceRule(window_frames, threshold, shortest_frames, band, motion, harmonics)
