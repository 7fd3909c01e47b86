"""Pictures of a decision between contacts: the odds and their four terms over scans."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.decisions import FILTERS, Decision
from uwtrack_cli.files.text_escaping import figure_text
from uwtrack_cli.plotting.style import calm, contact_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_odds(decision: Decision, ax: "Axes") -> "Axes":
    """Draw the log odds of every pair over time, with thresholds and decisions."""
    for pair in range(decision.verdict.size):
        rows = decision.scan_pair == pair
        names = (int(decision.first_contact[pair]), int(decision.second_contact[pair]))
        color = contact_color(pair + 1)
        ax.plot(
            decision.scan_time_s[rows], decision.log_odds[rows], "o-", markersize=3,
            color=color, label=figure_text(f"{names[0]} or {names[1]}: {decision.verdict[pair]}"),
        )  # fmt: skip
        if np.isfinite(decision.decision_time_s[pair]):
            ax.plot(
                decision.decision_time_s[pair], decision.final_log_odds[pair], "s",
                markersize=9, fillstyle="none", color=color,
            )  # fmt: skip
    for level in (decision.lower_threshold, decision.upper_threshold):
        ax.axhline(level, linestyle="--", linewidth=0.8, color="k")
    ax.set(xlabel="time (s)", ylabel="log odds (second moves)")
    ax.legend(loc="best", fontsize="small")
    return calm(ax)


def draw_terms(decision: Decision, ax: "Axes", pair: int = 0) -> "Axes":
    """Draw the four log likelihoods of a pair over time."""
    rows = decision.scan_pair == pair
    for index, name in enumerate(FILTERS):
        style = "-" if index < 2 else "--"
        fit = decision.consistency[pair, index]
        ax.plot(
            decision.scan_time_s[rows], decision.log_likelihood[rows, index], style,
            color=contact_color(index + 1), label=f"{name} (p = {fit:.2g})",
        )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="log likelihood")
    ax.legend(loc="best", fontsize="small")
    return calm(ax)
