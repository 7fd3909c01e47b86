"""Contacts of a bearing-time record that is drawn, without any of the chain's formulas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import find_peaks

from studies.line_scene import second_frames
from uwtrack_cli.arrays.track_bearings import prominent_peaks, track_bearings
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.errors import DataError
from uwtrack_cli.lines.line_points import LinePoints, LineTable, no_families, to_lines

HOP_S, BEAMS, NOISE = 1.0, 53, 0.03


def drawn(truths, heading_deg, seed=1, heights=(0.5, 0.5), slope=0.0):
    """A record in which vessels stand out at compass bearings, on either side."""
    rng = np.random.default_rng(seed)
    frames = second_frames(heading_deg.size, 9.0)
    step = 2.0 / (BEAMS - 5)
    cosines = -1.0 + step * np.arange(-2, BEAMS - 2)
    around = 1.0 - slope * cosines**2
    power = around + NOISE * rng.standard_normal((heading_deg.size, BEAMS))
    for bearing_deg, height in zip(truths, heights, strict=False):
        at = np.cos(np.radians(bearing_deg - heading_deg))
        power += height * np.exp(-0.5 * ((cosines - at[:, None]) / (2 * step)) ** 2)
    nothing = np.zeros(heading_deg.size)
    return BearingTime(
        frames=frames,
        cos_angle=cosines,
        diffuse_power=around / np.median(around),
        level_db=10 * np.log10(power),
        excess_db=10 * np.log10(power),
        east_m=nothing,
        north_m=nothing,
        heading_deg=heading_deg,
        bend_deg=nothing,
        band_low_hz=50.0,
        band_high_hz=700.0,
        design_frequency_hz=750.0,
        sidelobe_db=30.0,
        beamformer="conventional",
        side="starboard",
        ambiguity="mirror",
        reference="full scale",
    )


def bearing_of(start_deg, end_deg, n_frames):
    """A bearing that changes fastest half-way, as that of a vessel that passes."""
    x = np.linspace(-1.0, 1.0, n_frames)
    return start_deg + (end_deg - start_deg) * (0.5 + np.arctan(2 * x) / 2.214297)


def turned(n_frames, to_deg):
    """A heading that turns from 0 within 40 s, half-way."""
    time_s = HOP_S * np.arange(n_frames)
    middle = time_s[-1] / 2.0
    return np.interp(time_s, [middle - 20.0, middle + 20.0], [0.0, to_deg])


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_bearings_err_as_stated_also_where_the_background_slopes(slope):
    misses = []
    for seed in range(12):
        truth = bearing_of(40.0 + seed, 150.0, 600)
        record = drawn([truth], np.zeros(600), seed, heights=(0.1,), slope=slope)
        found = track_bearings(record)
        assert np.unique(found.contact).tolist() == [1]
        assert found.time_s.size > 55
        at = np.interp(found.time_s, record.frames.time_s, truth)
        misses.append((found.bearing_deg - at) / found.bearing_std_deg)
    share = np.mean(np.abs(np.concatenate(misses)) < 1.96)
    assert 0.92 < share < 0.985
    spread = float(np.std(np.concatenate(misses)))
    assert 0.8 < spread < 1.15


def test_noise_alone_is_no_contact():
    for seed in range(20):
        assert track_bearings(drawn([], np.zeros(600), seed)).time_s.size == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_contact_keeps_its_number_through_a_turn_on_either_side(side):
    heading = turned(600, 60.0)
    truth = side * bearing_of(70.0, 110.0, 600)
    record = drawn([truth], heading)
    found = track_bearings(record)
    assert np.unique(found.contact).tolist() == [1]
    assert found.time_s.max() - found.time_s.min() > 500.0
    at = np.interp(found.time_s, record.frames.time_s, truth)
    turn = np.interp(found.time_s, record.frames.time_s, heading)
    cone = np.abs((at - turn + 180.0) % 360.0 - 180.0)
    written = (turn + cone) % 360.0  # of starboard, whichever side it was
    off = (found.bearing_deg - written + 180.0) % 360.0 - 180.0
    assert np.abs(off / found.bearing_std_deg).max() < 4.5


def test_cones_that_cross_keep_their_contacts():
    truths = [bearing_of(40.0, 120.0, 600), bearing_of(-100.0, -50.0, 600)]
    found = track_bearings(drawn(truths, np.zeros(600)))
    assert np.unique(found.contact).tolist() == [1, 2]
    first, second = (found.bearing_deg[found.contact == k] for k in (1, 2))
    ends = sorted([(first[0], first[-1]), (second[0], second[-1])])
    np.testing.assert_allclose(ends, [(40.0, 120.0), (100.0, 50.0)], atol=3.0)


def test_sidelobes_of_a_loud_vessel_are_no_contacts():
    truths = [bearing_of(60.0, 100.0, 600), bearing_of(120.0, 150.0, 600)]
    loud = drawn(truths, np.zeros(600), heights=(100.0, 0.1))
    assert np.unique(track_bearings(loud).contact).tolist() == [1]


def test_an_array_that_is_no_line_has_its_directions_elsewhere():
    record = drawn([], np.zeros(100))
    planar = replace(
        record, cos_angle=None, diffuse_power=None, azimuth_deg=np.linspace(0.0, 353.0, BEAMS)
    )
    with pytest.raises(DataError, match="no line"):
        track_bearings(planar)


@pytest.mark.parametrize("step", [0.0, 0.5])
def test_peaks_and_their_heights_are_those_of_scipy(step):
    rng = np.random.default_rng(3)
    for size in (1, 2, 3, *rng.integers(4, 60, 200)):
        values = rng.standard_normal(size)
        if step:  # with flat tops
            values = step * np.round(values / step)
        for least in (0.0, 0.5, 2.0):
            wanted, facts = find_peaks(values, prominence=least)
            top, height = prominent_peaks(values, least)
            assert np.array_equal(top, wanted)
            assert np.array_equal(height, facts["prominences"])


@pytest.mark.parametrize(("line_std_deg", "number"), [(1.0, 2), (12.0, 1)])
def test_a_contact_whose_lines_scatter_as_stated_keeps_their_number(line_std_deg, number):
    # eight degrees apart: far beyond one degree, well within the deviations of a pair
    truth = bearing_of(40.0, 120.0, 400)
    record = drawn([truth], np.zeros(400))
    frames = record.frames
    count, nothing = frames.n_frames, np.zeros(frames.n_frames)
    points = LinePoints(
        line=np.ones(count, np.int64),
        frame=np.arange(count),
        time_s=frames.time_s,
        state=np.zeros((count, 5, 2)),
        measured=np.stack(
            [nothing + 100.0, nothing + 0.1, truth + 8.0, nothing + line_std_deg,
             nothing, nothing], axis=1,
        ),
        association=np.full(count, 2),
    )  # fmt: skip
    one = np.ones(1, np.int64)
    table = LineTable(one, one, -one, np.array(["moving"]), np.zeros(1), no_families())
    lines = to_lines(frames, points, table, {
        "reference": "full scale", "false_lines_per_khz_hour": 1.0,
        "weakest_line_snr_db": 1.0,
    })  # fmt: skip
    assert set(track_bearings(record, lines).contact.tolist()) == {number}
