"""Pages of targets in clutter and of decisions between contacts."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.decision import draw_odds, draw_terms
from uwtrack_cli.plotting.style import WIDE_IN, new_figure
from uwtrack_cli.plotting.target import draw_target, draw_threshold
from uwtrack_cli.plotting.view import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT_IN = 8.0
"""Height of these pages, inches."""


def target_figure(containers: Sequence[Container]) -> "Figure":
    """Return the track of a target among false measurements, and its threshold.

    Raises
    ------
    DataError
        There is no track, or it holds no scan.
    """
    scene = Scene(containers)
    target = scene.first(Target)
    if target is None or not target.scan.size:
        msg = "the track holds no scan, so there is nothing to draw."
        raise DataError(msg)
    figure = new_figure(WIDE_IN, HEIGHT_IN)
    upper, lower = figure.subplots(2, 1, height_ratios=[2.0, 1.0])
    draw_target(target, scene.first(Scans), upper)
    draw_threshold(target, lower)
    return figure


def decision_figure(containers: Sequence[Container]) -> "Figure":
    """Return the odds between two contacts over the scans, and what they rest on.

    Raises
    ------
    DataError
        No contacts were compared.
    """
    decision = Scene(containers).first(Decision)
    if decision is None or not decision.scan_time_s.size:
        msg = "no contacts were compared, so there is nothing to draw."
        raise DataError(msg)
    figure = new_figure(WIDE_IN, HEIGHT_IN)
    upper, lower = figure.subplots(2, 1)
    draw_odds(decision, upper)
    draw_terms(decision, lower)
    return figure
