"""The comb of a family's lines, against drawn combs of known spacing."""

from dataclasses import replace

import numpy as np
import pytest

from uwtrack_cli.presence.line_summary import LineSummary
from uwtrack_cli.presence.tonal_segments import LineComb, fit_comb, is_mains_comb


def lines_at(frequency_hz, std_hz):
    """Steady lines of one segment."""
    n = len(frequency_hz)
    unknown = np.full(n, np.nan)
    return LineSummary(
        frequency_hz=np.asarray(frequency_hz, float),
        frequency_std_hz=np.broadcast_to(np.asarray(std_hz, float), n).copy(),
        from_s=np.zeros(n), to_s=np.full(n, 60.0), level_db=np.full(n, 60.0),
        bearing_deg=unknown, bearing_std_deg=unknown, contact=np.zeros(n, np.int64),
        family=np.full(n, -1), status=np.full(n, "steady"), line_id=np.arange(n) + 1,
        resolution_hz=np.full(len(frequency_hz), 0.25),
    )  # fmt: skip


def comb_of(lines, spacing_hz, offset_hz=0.0):
    """The comb of all lines; the tracker's spacing is off by a thousandth."""
    every = np.arange(lines.frequency_hz.size)
    free = np.ones(every.size, np.bool_)
    return fit_comb(lines, every, free, 1.001 * spacing_hz, offset_hz)


@pytest.mark.parametrize("offset_hz", [0.0, 1.7])
def test_the_deviation_of_a_spacing_is_what_lines_scatter(offset_hz):
    """Teeth miss by 0.04 Hz, and one line of long frames claims 0.001 Hz."""
    rng = np.random.default_rng(71)
    tooth = np.array([2, 4, 6, 7, 8, 9, 12, 16, 17, 19])
    std = np.array([0.001, *[0.02] * 9])
    off = []
    for _ in range(100):
        scatter = rng.normal(0, np.hypot(0.04, std))
        lines = lines_at(offset_hz + 4.26 * tooth + scatter, std)
        comb = comb_of(lines, 4.26, offset_hz)
        assert np.diff(comb.tooth).tolist() == np.diff(tooth).tolist()
        assert (comb.offset_hz == 0.0) == (offset_hz == 0.0)
        off.append((comb.spacing_hz - 4.26) / comb.spacing_std_hz)
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_an_offset_that_the_lines_leave_open_is_none():
    rng = np.random.default_rng(72)
    tooth = np.arange(90, 110)
    lines = lines_at(15.68 * tooth + rng.normal(0, 0.1, tooth.size), 0.1)
    comb = comb_of(lines, 15.68, offset_hz=0.2)
    assert comb.offset_hz == 0.0
    assert abs(comb.spacing_hz - 15.68) < 4 * comb.spacing_std_hz
    assert comb.spacing_std_hz == pytest.approx(0.1 / np.sqrt(20) / 100, rel=0.4)


def test_lines_between_the_teeth_halve_the_spacing():
    rng = np.random.default_rng(73)
    tooth = np.sort(rng.choice(np.arange(20, 80), 20, replace=False))
    lines = lines_at(7.84 * tooth + rng.normal(0, 0.02, 20), 0.02)
    comb = comb_of(lines, 15.68)
    assert comb.spacing_hz == pytest.approx(7.84, abs=0.002)
    assert comb.tooth.tolist() == tooth.tolist()


def test_odd_harmonics_are_twice_as_far_apart_as_they_are_high():
    """As of a rectified current, told with a spacing that is a third."""
    frequency = 60.0 * np.array([1, 3, 5, 7, 9, 13])
    comb = comb_of(lines_at(frequency, 0.02), 40.0 / 1.001, offset_hz=20.0)
    assert comb.spacing_hz == pytest.approx(120.0, abs=0.01)
    assert comb.offset_hz == pytest.approx(60.0, abs=0.05)


def test_a_free_line_on_a_tooth_is_the_familys_and_one_beside_it_is_not():
    lines = lines_at([12.0, 18.0, 24.0, 36.0, 30.0, 33.0, 600.0], 0.02)
    own = np.arange(4)
    comb = fit_comb(lines, own, np.ones(7, np.bool_), 6.0)
    assert comb.rows.tolist() == [0, 1, 2, 3, 4]
    hum = replace(lines, status=np.array(["steady"] * 4 + ["hum"] * 3))
    assert fit_comb(hum, own, np.ones(7, np.bool_), 6.0).rows.tolist() == own.tolist()


def test_lines_beside_the_teeth_at_random_divide_no_spacing():
    """Long frames part what shorter ones blur: some lines of a comb miss its teeth."""
    rng = np.random.default_rng(74)
    told = []
    for _ in range(100):
        true = 0.72 * np.arange(10, 24)
        blurred = rng.choice(14, 6, replace=False)
        true[blurred] += rng.uniform(-0.36, 0.36, 6)
        told.append(comb_of(lines_at(true, 0.005), 0.72).spacing_hz)
    assert np.mean(np.abs(np.array(told) - 0.72) < 0.02) >= 0.99


@pytest.mark.parametrize(
    ("spacing_hz", "offset_hz", "is_mains"),
    [
        (60.0045, 0.0, True),
        (49.97, 0.0, True),
        (100.02, 0.0, True),
        (60.3, 0.0, False),
        (60.0, 20.0, False),
        (180.0, 0.0, False),
        (6.0, 0.0, False),
    ],
)
def test_a_comb_of_mains_is_no_vessel(spacing_hz, offset_hz, is_mains):
    """A grid holds its frequency within a thousandth; engines have other rates."""
    none = np.zeros(0, np.int64)
    assert is_mains_comb(LineComb(spacing_hz, 0.01, offset_hz, none, none)) == is_mains
