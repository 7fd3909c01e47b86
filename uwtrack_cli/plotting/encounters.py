"""Pictures of closest approaches: the fitted laws over the measurements."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.acoustics.passage import Passage, passage_law
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.plotting.style import contact_color

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_fits(encounters: Encounters, time_s: FloatArray, ax: "Axes") -> "Axes":
    """Draw the fitted Doppler curve of every line of every encounter."""
    for row, name in enumerate(encounters.contact):
        law = _law(encounters, row, time_s)
        for rest in encounters.rest_frequency_hz[encounters.rest_encounter == row]:
            curve = rest * (1.0 + law.shift[0])
            ax.plot(time_s, curve, "--", linewidth=0.8, color=contact_color(int(name)))
    return ax


def draw_bearing_fits(encounters: Encounters, time_s: FloatArray, ax: "Axes") -> "Axes":
    """Draw the fitted bearing of every encounter."""
    turn = {"starboard": 1.0, "port": -1.0}
    for row, name in enumerate(encounters.contact):
        side = turn.get(str(encounters.side[row]))
        if side is None:
            continue
        law = _law(encounters, row, time_s)
        bearing = encounters.bearing_deg[row] + side * np.degrees(law.angle[0])
        bearing = np.mod(bearing, 360.0)
        jumps = np.abs(np.diff(bearing, prepend=bearing[:1])) > 180.0
        bearing[jumps] = np.nan
        ax.plot(time_s, bearing, "--", linewidth=1.0, color=contact_color(int(name)))
    return ax


def mark_times(encounters: Encounters, ax: "Axes") -> "Axes":
    """Mark the time of every closest approach with its deviation."""
    for time_s, std_s, name in zip(
        encounters.time_s, encounters.time_std_s, encounters.contact, strict=True
    ):
        color = contact_color(int(name))
        ax.axvline(time_s, linewidth=0.8, color=color)
        if np.isfinite(std_s):
            ax.axvspan(time_s - std_s, time_s + std_s, alpha=0.2, color=color)
    return ax


def draw_shifts(
    encounters: Encounters, lines: Lines | None, time_s: FloatArray, ax: "Axes"
) -> "Axes":
    """Draw the relative Doppler shift: measured on every line, and as fitted."""
    for row, name in enumerate(encounters.contact):
        color = contact_color(int(name))
        own = encounters.rest_encounter == row
        if not own.any():
            continue
        ax.plot(time_s, 1e3 * _law(encounters, row, time_s).shift[0], color=color)
        if lines is None:
            continue
        for line, rest in zip(
            encounters.rest_line_id[own], encounters.rest_frequency_hz[own], strict=True
        ):
            points = lines.line == line
            shift = lines.measured_frequency_hz[points] / rest - 1.0
            ax.plot(lines.time_s[points], 1e3 * shift, ".", markersize=1.5, color=color)
    ax.set(xlabel="time (s)", ylabel="Doppler shift\n(1/1000)")
    _fit_ordinate(encounters, ax)
    return ax


def _fit_ordinate(encounters: Encounters, ax: "Axes") -> None:
    """Show the curves: outliers and weak lines may leave the panel."""
    mach = encounters.speed_mps / encounters.sound_speed_mps
    if np.isfinite(mach).any():
        reach = 2.0e3 * float(np.nanmax(mach))
        ax.set_ylim(-reach, reach)


def _law(encounters: Encounters, row: int, time_s: FloatArray) -> Passage:
    speed = encounters.speed_mps[row]
    parameters = [
        encounters.time_s[row],
        np.log(encounters.range_over_speed_s[row]),
        speed if np.isfinite(speed) else 0.0,
    ]
    return passage_law(
        time_s, np.array([parameters]), float(encounters.sound_speed_mps[row])
    )
