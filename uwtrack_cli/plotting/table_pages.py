"""Pages of targets in clutter and of decisions between contacts.

A target's page: its track among the measurements, and how the threshold followed it. A
decision's page: the log odds of each pair, and the four terms they rest on, over scans.
"""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uwtrack_cli.data.decisions import FILTERS, Decision
from uwtrack_cli.data.scans import Scans
from uwtrack_cli.data.targets import Target
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.layout import HeadLine, alone, page_figure
from uwtrack_cli.plotting.style import (
    NO_CONTACT,
    calm,
    contact_color,
    draw_band,
    draw_ellipse,
)
from uwtrack_cli.plotting.view import Scene, View


def target_figure(scene: Scene, view: View) -> Figure:
    """Return the tracks of targets among false measurements, and their threshold.

    Raises
    ------
    DataError
        There is no track, or it holds no scan.
    """
    target, scans = scene.first(Target), scene.first(Scans)
    if target is None or not target.scan.size:
        msg = "the track holds no scan, so there is nothing to draw."
        raise DataError(msg)
    blocks = [alone(5.4, partial(draw_target, target, scans)),
              alone(2.6, partial(draw_threshold, target))]  # fmt: skip
    return page_figure([HeadLine("Track in clutter")], view, blocks)


def decision_figure(scene: Scene, view: View) -> Figure:
    """Return the odds between two contacts over the scans, and what they rest on.

    Raises
    ------
    DataError
        No contacts were compared.
    """
    decision = scene.first(Decision)
    if decision is None or not decision.scan_time_s.size:
        msg = "no contacts were compared, so there is nothing to draw."
        raise DataError(msg)
    blocks = [alone(4.0, partial(draw, decision)) for draw in (draw_odds, draw_terms)]
    return page_figure([HeadLine("Which one moves")], view, blocks)


def draw_target(target: Target, scans: Scans | None, ax: Axes) -> Axes:
    """Draw the track with its 95 % regions, and the measurements where given.

    Two or more components are drawn as a map of the first two, one over time.
    """
    is_map, lost = target.component.size > 1, target.lost
    # ranges, bearings and rates are measured of what is drawn in east and north
    if scans is not None and scans.component.tolist() == target.component.tolist():
        first = scans.measured[:, 0]
        across = (first, scans.measured[:, 1]) if is_map else (scans.time_s, first)
        ax.plot(*across, ".", ms=1.5, color=NO_CONTACT, zorder=1, label="measurements")
    for number, own in enumerate(target.targets, 1):
        color = contact_color(number)
        if not is_map:
            half = 1.96 * own.state_std[:, 0]
            draw_band(ax, own.time_s, own.state[:, 0], half, color)
            continue
        ax.plot(own.state[:, 0], own.state[:, 2], "-o", markersize=2, color=color)
        for mean, covariance in zip(own.state, own.state_covariance, strict=True):
            place = covariance[np.ix_([0, 2], [0, 2])]
            draw_ellipse(ax, mean[[0, 2]], place, color, alpha=0.1)
    place = target.state[:, [0, 2]] if is_map else None
    lost_at = (target.time_s, target.state[:, 0]) if place is None else tuple(place.T)
    ax.plot(*(one[lost] for one in lost_at), "kx", label="lost")
    ax.legend(fontsize=8)
    names = [f"{name} ({unit})" if unit else str(name) for name, unit in
             zip(target.component, target.component_unit, strict=True)]  # fmt: skip
    names = list(map(figure_text, names if is_map else ["time (s)", *names]))
    ax.set(xlabel=names[0], ylabel=names[1])
    if place is not None:  # clutter may fill a window many times the track's size
        variance = target.state_std[:, [0, 2]] ** 2
        reach = 4.0 * np.sqrt(np.nanmedian(variance, axis=0))
        low, high = place.min(axis=0) - reach, place.max(axis=0) + reach
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return calm(ax)


def draw_threshold(target: Target, ax: Axes) -> Axes:
    """Draw the threshold used at each scan, and the score for a lost target."""
    for number, own in enumerate(target.targets, 1):
        ax.step(own.time_s, own.threshold, where="mid", color=contact_color(number))
    ax.set(
        xlabel="time (s)", ylabel=f"threshold ({figure_text(target.threshold_rule)})"
    )
    other = ax.twinx()
    for own in target.targets:
        other.fill_between(own.time_s, own.loss_cusum, step="mid", alpha=0.2, color="k")
    other.set(ylim=(0.0, None))
    other.set_ylabel("score of loss", fontsize=8)
    other.tick_params(labelsize=8)
    return calm(ax)


def draw_odds(decision: Decision, ax: Axes) -> Axes:
    """Draw the log odds of every pair over time, with thresholds and decisions."""
    for pair, verdict in enumerate(decision.verdict):
        rows, color = decision.scan_pair == pair, contact_color(pair + 1)
        first, second = decision.first_contact[pair], decision.second_contact[pair]
        name = figure_text(f"{first} or {second}: {verdict}")
        ax.plot(decision.scan_time_s[rows], decision.log_odds[rows], "o-", ms=3,
                color=color, label=name)  # fmt: skip
        ax.plot(decision.decision_time_s[pair], decision.final_log_odds[pair], "s",
                ms=9, fillstyle="none", color=color)  # fmt: skip
    for level in (decision.lower_threshold, decision.upper_threshold):
        ax.axhline(level, linestyle="--", linewidth=0.8, color="k")
    ax.set(xlabel="time (s)", ylabel="log odds (second moves)")
    ax.legend(loc="best", fontsize="small")
    return calm(ax)


def draw_terms(decision: Decision, ax: Axes) -> Axes:
    """Draw the four log likelihoods of the first pair over time."""
    rows = decision.scan_pair == 0
    for index, name in enumerate(FILTERS):
        style = "-" if index < 2 else "--"
        fit = decision.consistency[0, index]
        ax.plot(
            decision.scan_time_s[rows], decision.log_likelihood[rows, index], style,
            color=contact_color(index + 1), label=f"{name} (p = {fit:.2g})",
        )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="log likelihood")
    ax.legend(loc="best", fontsize="small")
    return calm(ax)
