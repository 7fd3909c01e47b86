"""Sound of a file or a stream, opened as its sensor file says what it is.

**Method.** The audio of a sonobuoy is taken apart into omni, east and north. A recorder
whose clock is known to be fast or slow has the sample rate that it had in truth, so that
every frequency and time after it is right; spans are told in true seconds.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from uwtrack_cli.data.recording import UNENDED, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.audio.live_recording import live_span, open_live_recording
from uwtrack_cli.files.audio.recording_file import open_recording, span_in
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.spectra.demultiplex import RATE_HZ


def open_file(
    path: Path,
    *,
    sensor: Sensor | None,
    start_s: float | None,
    stop_s: float | None,
    **how: Any,
) -> Recording:
    """Open a recording; the audio of a buoy as omni, east and north.

    As `open_recording`, with its options and errors; the sample rate is without the
    clock error of the sensor, and the span is in true seconds.
    """
    start_s, stop_s = _by_clock(sensor, start_s), _by_clock(sensor, stop_s)
    if sensor is None or not sensor.is_multiplexed:
        return _in_true_time(
            open_recording(path, sensor=sensor, start_s=start_s, stop_s=stop_s, **how)
        )
    whole = demultiplex(open_recording(path, sensor=sensor, **how))
    span = span_in(path, whole.n_samples, RATE_HZ, start_s, stop_s)
    return _in_true_time(whole.part(*span))


def open_live(
    path: Path,
    *,
    sensor: Sensor | None,
    start_s: float | None,
    stop_s: float | None,
    **how: Any,
) -> Recording:
    """Open sound that is still coming; the audio of a buoy as omni, east and north.

    As `open_live_recording`, with its options and errors; times as of `open_file`.
    """
    start_s, stop_s = _by_clock(sensor, start_s), _by_clock(sensor, stop_s)
    if sensor is None or not sensor.is_multiplexed:
        return _in_true_time(
            open_live_recording(
                path, sensor=sensor, start_s=start_s, stop_s=stop_s, **how
            )
        )
    first, last = live_span(RATE_HZ, start_s, stop_s)
    whole = demultiplex(open_live_recording(path, sensor=sensor, **how))
    return _in_true_time(whole.part(first, UNENDED if last is None else last))


def _by_clock(sensor: Sensor | None, time_s: float | None) -> float | None:
    """Return a time since the first sample as the recorder's clock counts it."""
    if sensor is None or time_s is None:
        return time_s
    return time_s / _clock_share(sensor)


def _clock_share(sensor: Sensor) -> float:
    """Return a frequency in a recording over what it is in truth."""
    return 1.0 + 1e-6 * (sensor.clock_error_ppm or 0.0)


def _in_true_time(recording: Recording) -> Recording:
    """Return a recording with the sample rate that its recorder had in truth."""
    rate_hz = recording.sample_rate_hz / _clock_share(recording.sensor)
    true = replace(recording, sample_rate_hz=rate_hz)
    if true.start_utc_ns is None:
        return true
    first = recording.first_sample
    late_ns = true.elapsed_ns(first) - recording.elapsed_ns(first)
    return replace(true, start_utc_ns=true.start_utc_ns + late_ns)
