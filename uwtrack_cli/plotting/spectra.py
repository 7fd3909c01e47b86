"""Pictures of the overview and of the levels."""

from typing import TYPE_CHECKING

import numpy as np

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.spectra import Levels, Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.text_escaping import figure_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_overview(overview: Overview, ax: "Axes") -> "Axes":
    """Draw the lofargram: time to the right, frequency upwards, level as shade.

    The shades are relative to the median of each frequency, so that a steep
    ambient spectrum does not hide the lines.
    """
    check_axes(overview, "time_s", "frequency_hz")
    step_db = (overview.ceiling_db - overview.floor_db) / 255.0
    level_db = overview.floor_db + overview.shade * step_db
    relative = level_db - np.median(level_db, axis=0)
    image = ax.pcolormesh(
        overview.time_s, overview.frequency_hz, relative.T,
        cmap="Greys", vmin=-3.0, vmax=18.0, shading="nearest", rasterized=True,
    )  # fmt: skip
    ax.figure.colorbar(image, ax=ax, label="dB above the median", pad=0.01)
    ax.set(xlabel="time (s)", ylabel="frequency (Hz)")
    return ax


def check_axes(container: Container, *names: str) -> None:
    """Refuse axes of a picture that are not numbers, as only a forged file has them.

    Parameters
    ----------
    container
        What is drawn.
    names
        Its columns that are axes.

    Raises
    ------
    DataError
        A column holds a value that is not finite.
    """
    for name in names:
        if not np.isfinite(getattr(container, name)).all():
            msg = (
                f"{name} of the {container.NAME} holds values that are no numbers; the "
                f"file is not as it was made: make it again with 'uwtrack rerun'."
            )
            raise DataError(msg)


def draw_levels(levels: Levels, ax: "Axes") -> "Axes":
    """Draw the broadband level of each frame with its deviation."""
    time_s = levels.frames.time_s
    ax.plot(time_s, levels.level_db, ".", markersize=2, color="#444444")
    band = f"{levels.band_low_hz:.0f}-{levels.band_high_hz:.0f} Hz"
    ax.set(
        xlabel="time (s)",
        ylabel=f"level {band}\n(dB re {figure_text(levels.reference)})",
    )
    return ax


def draw_bearings(levels: Levels, ax: "Axes") -> "Axes":
    """Draw the broadband bearings that are known to 30 degrees or better."""
    known = levels.bearing_std_deg < 30.0
    time_s = levels.frames.time_s
    ax.plot(
        time_s[known], levels.bearing_deg[known], ".", markersize=2, color="#444444"
    )
    ax.set(xlabel="time (s)", ylabel="bearing (deg)", ylim=(0, 360))
    ax.set_yticks(range(0, 361, 90))
    return ax
