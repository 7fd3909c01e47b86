"""Which ellipses of a motion are to be trusted."""

from types import SimpleNamespace

import numpy as np
import pytest

from uwtrack_cli.motion.target_motion.modes import Interval
from uwtrack_cli.motion.target_motion.motion_table import ellipse_agrees

RANGE_M, SPEED_MPS, COURSE = 5000.0, 6.0, np.radians(170.0)
CENTRE = {"range": np.log(RANGE_M), "speed": SPEED_MPS, "course": COURSE}
WIDTH = {"range": 0.04, "speed": 0.5, "course": 0.1}


def mode(name="speed", low=1.0, high=1.0, *, turns=0, cut=(False, False), holds=True):
    """A mode whose intervals are those of its deviations but for one, in shares."""
    q = [CENTRE["range"], 0.3, SPEED_MPS * np.sin(COURSE), SPEED_MPS * np.cos(COURSE)]
    std = [WIDTH["range"] * RANGE_M, 0.01, WIDTH["speed"], WIDTH["course"]]
    spans = {}
    for key, centre in CENTRE.items():
        shares = (low, high) if key == name else (1.0, 1.0)
        at = centre + (2.0 * np.pi * turns if key == "course" else 0.0)
        below, above = (1.96 * share * WIDTH[key] for share in shares)
        open_ends = cut if key == name else (False, False)
        spans[key] = Interval(at - below, at + above, *open_ends)
    return SimpleNamespace(
        q=np.array(q), covariance=np.diag(np.square(std)), intervals=spans, ellipse_holds=holds
    )


@pytest.mark.parametrize("name", CENTRE)
@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (1.0, 1.0, True), (0.8, 1.2, True), (1.2, 0.8, True),
        (1.3, 1.0, False), (1.0, 1.3, False), (0.7, 1.0, False), (1.0, 0.7, False),
    ],
)  # fmt: skip
def test_an_ellipse_is_trusted_where_it_is_as_wide_as_the_likelihood(name, low, high, expected):
    assert ellipse_agrees(mode(name, low, high)) is expected


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_a_course_is_the_same_whichever_way_the_interval_counts(turns):
    assert ellipse_agrees(mode(turns=turns))
    assert not ellipse_agrees(mode("course", 0.5, 1.0, turns=turns))


@pytest.mark.parametrize("cut", [(True, False), (False, True)])
def test_an_interval_that_the_search_has_cut_is_not_trusted(cut):
    assert not ellipse_agrees(mode(cut=cut))


def test_intervals_that_agree_do_not_make_a_joint_ellipse_hold():
    assert not ellipse_agrees(mode(holds=False))
