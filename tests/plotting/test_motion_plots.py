"""Pictures of motions show what the containers say, and nothing that they do not."""

import numpy as np
import pytest

from uwtrack_cli.data.motions import Motions
from uwtrack_cli.plotting.motions import QUANTITIES, draw_motions, draw_updates

matplotlib = pytest.importorskip("matplotlib")


def motions(**changes):
    count = 2
    values = {}
    for name, spec in Motions.columns().items():
        axis = spec.axes[0]
        if spec.optional:
            continue
        size = {"motion": count, "update": 3, "rest_line": 1, "reason": 0}[axis]
        shape = (size, *(4 for _ in spec.axes[1:]))
        kind = "U1" if spec.dtype.kind == "U" else spec.dtype
        values[name] = np.zeros(shape, dtype=kind)
    values |= {
        "contact": [1, 1], "mode": [1, 2], "weight": [0.9, 0.1],
        "range_m": [1000.0, 2000.0], "bearing_deg": [90.0, 0.0],
        "speed_mps": [5.0, 5.0], "course_deg": [0.0, 90.0],
        "now_time_s": [100.0, 100.0], "observable": [True, True],
        "covariance": np.stack([np.diag([100.0, 1.0, 0.1, 1.0])] * 2),
        "update_contact": [1, 1, 1], "update_time_s": [10.0, 50.0, 100.0],
        "update_range_m": [1500.0, 900.0, 1000.0],
        "update_range_std_m": [1e9, 200.0, 10.0],
    }  # fmt: skip
    facts = {"solver": "mle", "loss": "squares", "doppler": "interval",
             "propagation": "instant", "sound_speed_mps": 1500.0,
             "statement": ""}  # fmt: skip
    return Motions(**{**values, **facts, **changes})


@pytest.fixture
def ax():
    from matplotlib.figure import Figure

    return Figure().add_subplot()


def test_every_mode_is_drawn_where_it_starts_and_ends(ax):
    assert draw_motions(motions(), ax) is ax
    tracks = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 2]
    assert np.allclose(tracks[0], [[1000.0, 0.0], [1000.0, 500.0]], atol=1e-9)
    assert np.allclose(tracks[1], [[0.0, 2000.0], [500.0, 2000.0]], atol=1e-9)
    assert len(ax.patches) == 2


def test_the_ellipse_is_long_along_the_uncertain_axis(ax):
    far = np.stack([np.diag([1e4, 1e-4, 0.1, 1.0])] * 2)
    draw_motions(motions(covariance=far), ax)
    box = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert box.width > 10.0 * box.height  # the first contact lies due east


def test_an_untold_range_is_a_ray_along_the_bearing(ax):
    draw_motions(motions(observable=[False, False], range_m=[np.nan, np.nan]), ax)
    ray = ax.lines[1].get_xydata()
    assert ray[1, 0] > 0
    assert ray[1, 1] == pytest.approx(0.0, abs=1e-9)
    assert ax.lines[1].get_linestyle() == ":"


def test_nothing_told_is_said(ax):
    draw_motions(motions(bearing_deg=[np.nan, np.nan]), ax)
    assert "no motion" in ax.texts[0].get_text()


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_estimates_over_time_carry_their_band(ax, quantity):
    assert draw_updates(motions(), ax, quantity) is ax
    assert len(ax.collections) == 1


def test_estimates_before_the_range_is_observable_are_left_out(ax):
    draw_updates(motions(), ax)
    assert ax.lines[0].get_xdata().tolist() == [50.0, 100.0]
