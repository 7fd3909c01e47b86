"""Pictures of an array's record show the contacts and peaks where they are."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.arrays.test_track_bearings import bearing_of, drawn
from uwtrack_cli.arrays.line_array import LineArray
from uwtrack_cli.arrays.track_bearings import track_bearings
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.plotting.bearing_time import (
    draw_beam_pattern,
    draw_contact_angles,
    draw_frequency_azimuth,
)
from uwtrack_cli.plotting.view import Scene


def record_and_truth():
    truth = -bearing_of(70.0, 110.0, 600)  # on port, written for starboard
    return drawn([truth], np.full(600, 30.0)), np.abs(truth - 30.0)


def test_contacts_without_lines_lie_at_their_angles():
    record, angle_deg = record_and_truth()
    ax = Figure().subplots()
    draw_contact_angles(record, Scene([track_bearings(record)]), ax)
    (line,) = ax.lines
    wanted = np.interp(line.get_xdata(), record.frames.time_s, angle_deg)
    assert line.get_xdata().size > 50
    np.testing.assert_allclose(line.get_ydata(), wanted, atol=1.5)


def test_peaks_of_the_span_lie_over_frequency_and_angle():
    record, _ = record_and_truth()
    frame = np.array([10, 100, 101, 500])
    peaks = Peaks(
        frames=record.frames, frame=frame, frequency_hz=[120.0, 310.0, 450.0, 600.0],
        frequency_std_hz=np.full(4, 0.1), level_db=np.zeros(4),
        snr_db=[12.0, 20.0, 15.0, 30.0], bearing_deg=np.full(4, np.nan),
        bearing_std_deg=np.full(4, np.nan), is_detection=[True, True, False, True],
        cone_deg=[10.0, 62.0, 90.0, 120.0], cone_std_deg=np.ones(4),
        is_aliased=np.zeros(4, bool), false_alarm_probability=1e-4,
        kept_probability=1e-3, reference="full scale", lowest_hz=50.0,
        highest_hz=700.0,
    )  # fmt: skip
    ax = Figure().subplots()
    draw_frequency_azimuth(record, peaks, ax, (50.0, 600.0))
    (dots,) = ax.collections
    assert dots.get_offsets().tolist() == [[310.0, 62.0], [600.0, 120.0]]
    assert ax.get_ylim() == (180.0, 0.0)


def test_the_pattern_is_that_of_the_shading():
    record, _ = record_and_truth()
    array = LineArray(np.arange(12.0) - 5.5, 1500.0)
    ax = Figure().subplots()
    draw_beam_pattern(replace(record, shading="chebyshev"), array, ax)
    low, middle, high = ax.lines
    assert [line.get_label() for line in ax.lines] == ["175 Hz", "350 Hz", "700 Hz"]
    for line in (low, middle, high):
        level, angle = line.get_xdata(), line.get_ydata()
        assert angle[np.argmax(level)] == 90.0
        assert level.max() == pytest.approx(0.0, abs=1e-6)
    level = high.get_xdata()
    tops = (level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])
    sidelobes = np.sort(level[1:-1][tops])[:-1]
    np.testing.assert_allclose(sidelobes, -30.0, atol=0.05)  # Dolph 1946: all equal
