"""Pages of motions, bearing-time records, targets in clutter and decisions."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.plotting.bearing_time import (
    draw_bearing_time,
    draw_heading,
    draw_line_angles,
)
from uwtrack_cli.plotting.decision import draw_odds, draw_terms
from uwtrack_cli.plotting.motions import draw_motions, draw_updates
from uwtrack_cli.plotting.target import draw_target, draw_threshold

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

C = TypeVar("C", bound=Container)


def first(containers: Sequence[Container], kind: type[C]) -> C | None:
    """Return the first container of a kind, None if there is none."""
    return next((c for c in containers if isinstance(c, kind)), None)


def draw_motion_page(containers: Sequence[Container], figure: "Figure") -> None:
    """Draw the modes of a target's motion and its range over time.

    Of an array there is its bearing-time record, too.
    """
    motions, record = first(containers, Motions), first(containers, BearingTime)
    if motions is not None and record is not None:
        top, upper, lower = figure.subplots(3, 1, height_ratios=[1.4, 1.4, 0.8])
        _draw_record(record, containers, top)
        draw_motions(motions, upper)
        draw_updates(motions, lower)
    elif motions is not None:
        upper, lower = figure.subplots(2, 1, height_ratios=[2.0, 1.0])
        draw_motions(motions, upper)
        draw_updates(motions, lower)


def draw_record_page(containers: Sequence[Container], figure: "Figure") -> None:
    """Draw the bearing-time record of an array, and how it pointed."""
    record = first(containers, BearingTime)
    if record is not None:
        upper, lower = figure.subplots(2, 1, height_ratios=[3.0, 1.0], sharex=True)
        _draw_record(record, containers, upper)
        draw_heading(record, lower)


def _draw_record(
    record: BearingTime, containers: Sequence[Container], ax: "Axes"
) -> None:
    draw_bearing_time(record, ax)
    lines = first(containers, Lines)
    if lines is not None:
        draw_line_angles(record, lines, ax)


def draw_target_page(containers: Sequence[Container], figure: "Figure") -> None:
    """Draw the track of a target among false measurements, and its threshold."""
    target = first(containers, Target)
    if target is not None:
        upper, lower = figure.subplots(2, 1, height_ratios=[2.0, 1.0])
        draw_target(target, first(containers, Scans), upper)
        draw_threshold(target, lower)


def draw_decision_page(containers: Sequence[Container], figure: "Figure") -> None:
    """Draw the odds between two contacts over the scans, and what they rest on."""
    decision = first(containers, Decision)
    if decision is not None:
        upper, lower = figure.subplots(2, 1)
        draw_odds(decision, upper)
        draw_terms(decision, lower)


TABLE_PAGES: dict[type[Container], Callable[[Sequence[Container], "Figure"], None]] = {
    Motions: draw_motion_page,
    BearingTime: draw_record_page,
    Target: draw_target_page,
    Decision: draw_decision_page,
}
"""Page of each of these containers."""
