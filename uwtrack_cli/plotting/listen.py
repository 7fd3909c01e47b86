"""The sound of a passage, for an ear: its band alone, and faster where it is low.

**Method.** The part about the closest approach is cut to its band in the frequency
domain, with soft edges, and brought to the lowest sample rate that holds it. Played
faster, its pitch rises by the same factor. Its loudest moment is as loud as can be.
"""

from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.audio.recording_file import flac_bytes
from uwtrack_cli.plotting.html_page import data_address
from uwtrack_cli.plotting.passage_fit import ReportedPassage, shown_span
from uwtrack_cli.plotting.view import Scene, View

LONGEST_S = 60.0
"""Longest part that is given, s."""

REACH, EDGE = 1.5, 0.1
"""The band reaches from the lowest line over, to the highest times the first; its edges
are soft over such a share."""

USUAL_HZ = (50.0, 4000.0)
"""Band of a passage without a line."""

LEAST_RATE_HZ, PEAK = 8000.0, 0.9
"""Lowest sample rate that is written, which every browser plays, and greatest value."""


def sound_of(scene: Scene, row: int, speed_up: float) -> dict[str, Any] | None:
    """Return the sound of a passage as a page has it; None where it is not at hand.

    ``speed_up``: how many times faster it is played.
    """
    recording, encounters = scene.first(Recording), scene.encounters
    if recording is None or recording.reader is None or encounters is None:
        return None
    fit = ReportedPassage(encounters, row)
    span_s = shown_span(scene, fit, View())
    middle = float(np.clip(fit.marked_s, *span_s))
    begin = max(span_s[0], middle - 0.5 * LONGEST_S)
    end = min(span_s[1], middle + 0.5 * LONGEST_S)
    lines = encounters.rest_frequency_hz[fit.rest_rows]
    low, high = lines.min(initial=np.inf) / REACH, lines.max(initial=0.0) * REACH
    low, high = (low, high) if lines.size else USUAL_HZ
    high = min(high, 0.5 * recording.sample_rate_hz)
    try:
        samples = recording.stretch(begin, end)[:, 0]
    except DataError:  # the sound has gone since it was found
        return None
    sound, rate_hz = in_band(samples, recording.sample_rate_hz, (low, high))
    content = flac_bytes(sound, round(rate_hz * speed_up))
    faster = f", {speed_up:g} times faster" if speed_up != 1.0 else ""
    text = f"{end - begin:.0f} s of sound, {low:.0f} to {high:.0f} Hz{faster}"
    return {"address": data_address("audio/flac", content), "text": text}


def in_band(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Return sound cut to a band, as loud as can be, and its new sample rate, Hz."""
    sound = np.nan_to_num(np.asarray(samples, float))
    spectrum = np.fft.rfft(sound)
    frequency = np.fft.rfftfreq(sound.size, 1.0 / rate_hz)
    low, high = band_hz
    rise = np.clip((frequency - low) / (EDGE * low) + 1.0, 0.0, 1.0)
    fall = np.clip((high - frequency) / (EDGE * high) + 1.0, 0.0, 1.0)
    spectrum *= rise * fall
    wanted = max(2.0 * high * (1.0 + EDGE), LEAST_RATE_HZ)
    count = min(sound.size, round(sound.size * wanted / rate_hz))
    short = np.fft.irfft(spectrum[: count // 2 + 1], count)
    peak = float(np.abs(short).max(initial=0.0))
    return (PEAK / peak * short if peak > 0 else short), rate_hz * count / sound.size
