"""The retarded-time law of a straight passage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uwtrack_cli.motion.passage.model.law import passage_law, slant_over_speed_s

CASES = {
    "vessel": (1500.0, 6.0, 250.0, 19.0),
    "train": (343.0, 34.1, 7.0, 2.0),
    "satellite": (299792458.0, 7372.0, 1.387e6, 0.0),
    "overhead": (1500.0, 5.0, 19.1, 19.0),
}


def law_of(name, time_s):
    c, speed, slant, height = CASES[name]
    horizontal = np.sqrt(slant**2 - height**2)
    theta = np.array([0.25, np.log(horizontal / speed), speed])
    return theta, passage_law(time_s, theta, c, height, with_height=True)


@pytest.mark.parametrize("name", CASES)
def test_emission_time_and_range_agree_with_newtons_method(name):
    c, speed, slant, height = CASES[name]
    width = slant / speed
    time = 0.25 + width * np.linspace(-8, 8, 81)
    _, law = law_of(name, time)
    emitted = time - 0.25 - slant / c
    for _ in range(40):
        distance = np.hypot(slant, speed * emitted)
        excess = emitted + distance / c - (time - 0.25)
        emitted = emitted - excess / (1 + speed**2 * emitted / (c * distance))
    distance = np.hypot(slant, speed * emitted)
    ratio = 1 / (1 + speed**2 * emitted / (c * distance))
    flat = np.sqrt(slant**2 - height**2)
    np.testing.assert_allclose(1 + law.shift, ratio, rtol=1e-13)
    np.testing.assert_allclose(law.angle, np.arctan2(speed * emitted, flat), atol=1e-12)
    np.testing.assert_allclose(law.spread, 2 * np.log(slant / distance), rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_partials_agree_with_central_differences(name):
    c, speed, slant, height = CASES[name]
    time = 0.25 + slant / speed * np.linspace(-4, 4, 41)
    theta, law = law_of(name, time)
    for number in range(4):
        size = 1e-5 * (slant / speed, 1.0, speed, max(height, 1.0))[number]
        step = size * np.eye(4)[number]
        plus = passage_law(time, theta + step[:3], c, height + step[3])
        minus = passage_law(time, theta - step[:3], c, height - step[3])
        for row, kind in enumerate(("shift", "angle", "spread")):
            slope = (getattr(plus, kind) - getattr(minus, kind)) / (2 * size)
            ours = law.rows[..., row, 1 + number, :]
            allowed = 1e-6 * max(np.abs(slope).max(), 1e-9)
            np.testing.assert_allclose(ours, slope, atol=allowed)


def test_the_slant_range_is_never_below_the_depth_difference():
    speed, height = np.array([0.5, 3.0, 12.0]), 19.0
    slant = speed * slant_over_speed_s(np.full(3, 1e-6), speed, height)
    np.testing.assert_allclose(slant, height, rtol=1e-9)


@given(mach=st.floats(1e-4, 0.3), width=st.floats(0.1, 500.0), rest=st.floats(20.0, 2000.0))
@settings(max_examples=60, deadline=None)
def test_corrected_equation_5_is_the_exact_law_relabelled(mach, width, rest):
    c = 1500.0
    speed = mach * c
    time = width * np.linspace(-6, 6, 61)
    exact = passage_law(time, np.array([0.0, np.log(width), speed]), c).shift
    range_m = width * speed * np.sqrt(1 - mach**2)
    # Choi et al. (2014), eq. 5 with a plus sign under the root
    paper = -(speed / c) * time / np.sqrt((range_m / speed) ** 2 + time**2)
    difference = rest * (1 + exact) - rest / (1 - mach**2) * (1 + paper)
    assert np.abs(difference).max() < 1e-9


def test_the_sound_of_the_closest_approach_arrives_d_over_c_later():
    c, speed, slant = 1500.0, 6.0, 250.0
    theta = np.array([100.0, np.log(slant / speed), speed])
    law = passage_law(np.array([100.0 + slant / c]), theta, c)
    assert abs(law.shift[0]) < 1e-15
    assert abs(law.spread[0]) < 1e-12
    assert abs(law.angle[0]) < 1e-12
