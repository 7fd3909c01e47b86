"""Pictures of tracks in clutter and of decisions show the numbers they are given."""

import numpy as np
import pytest

from uwtrack_cli.data.base import reason_columns
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.analysis_pages import (
    draw_odds,
    draw_target,
    draw_terms,
    draw_threshold,
    target_figure,
)
from uwtrack_cli.plotting.view import Scene, View


@pytest.fixture
def ax():
    from matplotlib.figure import Figure

    return Figure().subplots()


def _target(scans=4, dimension=2):
    ones = np.ones(scans)
    size = (scans, 2 * dimension)
    state = np.arange(float(np.prod(size))).reshape(size)
    return Target(
        scan=np.arange(scans), time_s=np.arange(float(scans)), state=state,
        state_covariance=np.tile(np.eye(2 * dimension), (scans, 1, 1)),
        model_probability=np.ones((scans, 1)), false_alarm_probability=0.01 * ones,
        detection_probability=0.9 * ones, threshold=3.0 * ones, gate=4.0 * ones,
        gate_volume=ones, expected_clutter=ones, validated=np.zeros(scans, int),
        miss_probability=ones, information_reduction=ones, score=ones,
        loss_cusum=ones, lost=np.arange(scans) > 2, association_scan=[],
        association_row=[], association_probability=[],
        component=[f"z_{i + 1}" for i in range(dimension)],
        component_unit=["m"] * dimension, threshold_rule="prior",
    )  # fmt: skip


def _scans(dimension=2):
    return Scans(
        scan=[0, 1], time_s=[0.0, 1.0], measured=np.full((2, dimension), 7.0),
        measured_std=np.ones((2, dimension)), amplitude=[1.0, 1.0],
        component=[f"z_{k + 1}" for k in range(dimension)], component_unit=["m"] * dimension,
    )  # fmt: skip


def _decision():
    return Decision(
        first_contact=[1], second_contact=[2], verdict=["first moves"],
        probability=[0.99], final_log_odds=[-3.0], decision_time_s=[2.0],
        decision_scan=[3], expected_scans=[3.0], fixed_scans=[6.0],
        fixed_verdict=["first moves"], consistency=np.full((1, 4), 0.5),
        inverse_range_std=[[0.1, 0.2]], observable=[[True, True]], **reason_columns("reason_pair", [{}]),
        scan_pair=[0, 0, 0], scan_time_s=[0.0, 1.0, 2.0], log_odds=[0.0, -1.0, -3.0],
        log_likelihood=np.arange(12.0).reshape(3, 4), lower_threshold=-2.9,
        upper_threshold=2.9, miss_probability=0.05, false_alarm_probability=0.05,
        moving_contact=1,
    )  # fmt: skip


def test_a_track_in_the_plane_is_drawn_with_an_ellipse_per_scan(ax):
    target = _target()
    assert draw_target(target, _scans(), ax) is ax
    assert len(ax.patches) == 4
    np.testing.assert_array_equal(ax.lines[1].get_xdata(), target.state[:, 0])
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), target.state[:, 2])
    assert ax.get_xlabel() == "z_1 (m)"


def test_a_single_component_is_drawn_over_time(ax):
    target = _target(dimension=1)
    draw_target(target, _scans(1), ax)
    np.testing.assert_array_equal(ax.lines[1].get_xdata(), target.time_s)
    assert ax.get_xlabel() == "time (s)"


def test_the_threshold_and_its_rule_are_shown(ax):
    draw_threshold(_target(), ax)
    assert "prior" in ax.get_ylabel()
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), 3.0)


def test_an_empty_track_has_no_page():
    with pytest.raises(DataError, match="no scan"):
        target_figure(Scene([_target(0)]), View())


def test_the_odds_are_drawn_with_both_thresholds_and_the_verdict(ax):
    draw_odds(_decision(), ax)
    levels = [line.get_ydata()[0] for line in ax.lines[-2:]]
    assert levels == [-2.9, 2.9]
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [0.0, -1.0, -3.0])
    assert ax.get_legend().get_texts()[0].get_text() == "1 or 2: first moves"


def test_the_four_terms_are_named_with_their_consistency(ax):
    draw_terms(_decision(), ax)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names[0] == "first moves (p = 0.5)"
    assert len(names) == 4
    np.testing.assert_array_equal(ax.lines[3].get_ydata(), [3.0, 7.0, 11.0])
