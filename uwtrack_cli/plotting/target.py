"""Pictures of a target in clutter: the track, and how the threshold followed it."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.style import (
    NO_CONTACT,
    calm,
    contact_color,
    draw_ellipse,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOR = contact_color(1)


def draw_target(target: Target, scans: Scans | None, ax: "Axes") -> "Axes":
    """Draw the track with its 95 % regions, and the measurements where given.

    Two or more components are drawn as a map of the first two, one over time.
    """
    if target.component.size == 1:
        return _draw_over_time(target, scans, ax)
    if scans is not None:
        x, y = scans.measured[:, 0], scans.measured[:, 1]
        ax.plot(x, y, ".", markersize=1.5, color=NO_CONTACT, zorder=1)
    ax.plot(target.state[:, 0], target.state[:, 2], "-o", markersize=2, color=_COLOR)
    _draw_ellipses(target, ax)
    lost = target.lost
    ax.plot(target.state[lost, 0], target.state[lost, 2], "kx", label="lost")
    _fit_view(target, ax)
    ax.set(xlabel=_label(target, 0), ylabel=_label(target, 1))
    return calm(ax)


def draw_threshold(target: Target, ax: "Axes") -> "Axes":
    """Draw the threshold used at each scan, and the score for a lost target."""
    ax.step(target.time_s, target.threshold, where="mid", color=_COLOR)
    ax.set(
        xlabel="time (s)", ylabel=f"threshold ({figure_text(target.threshold_rule)})"
    )
    other = ax.twinx()
    other.fill_between(
        target.time_s, target.loss_cusum, step="mid", alpha=0.2, color="k"
    )
    other.set(ylabel="score of loss", ylim=(0.0, None))
    return calm(ax)


def _draw_over_time(target: Target, scans: Scans | None, ax: "Axes") -> "Axes":
    if scans is not None:
        ax.plot(
            scans.time_s, scans.measured[:, 0], ".", markersize=1.5, color=NO_CONTACT
        )
    middle, half = target.state[:, 0], 1.96 * target.state_std[:, 0]
    ax.plot(target.time_s, middle, color=_COLOR)
    ax.fill_between(
        target.time_s, middle - half, middle + half, alpha=0.25, color=_COLOR
    )
    ax.plot(target.time_s[target.lost], middle[target.lost], "kx", label="lost")
    ax.set(xlabel="time (s)", ylabel=_label(target, 0))
    return calm(ax)


def _draw_ellipses(target: Target, ax: "Axes") -> None:
    for mean, covariance in zip(target.state, target.state_covariance, strict=True):
        place = covariance[np.ix_([0, 2], [0, 2])]
        draw_ellipse(ax, mean[[0, 2]], place, _COLOR, alpha=0.1)


def _fit_view(target: Target, ax: "Axes") -> None:
    """Show the track: clutter may fill a window many times its size."""
    reach = 4.0 * np.sqrt(np.nanmedian(target.state_std[:, [0, 2]] ** 2, axis=0))
    low = target.state[:, [0, 2]].min(axis=0) - reach
    high = target.state[:, [0, 2]].max(axis=0) + reach
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def _label(target: Target, index: int) -> str:
    unit = str(target.component_unit[index])
    name = str(target.component[index])
    return figure_text(f"{name} ({unit})" if unit else name)
