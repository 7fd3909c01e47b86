"""The DEMON page: the averaged spectrum of the envelope, and its rates over time.

**Method.** The spectrum is the mean power over all frames, over the floor of its
neighbourhood. Rates that belong to one shaft are marked at the shaft's rate and at that
of the blades; a multiple that was not heard has no mark.

**References.** Nielsen, "Sonar Signal Processing" (1991), chapter 3.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.page_layout import (
    HeadLine,
    PagePart,
    page_figure,
    span_title,
    timed,
)
from uwtrack_cli.plotting.panels import rates_part
from uwtrack_cli.plotting.picture import (
    FrequencyAxis,
    draw_picture,
    over_floor,
    overview_levels,
    overview_picture,
)
from uwtrack_cli.plotting.style import MEASURED, Span, calm, contact_color, within
from uwtrack_cli.plotting.view import Scene, View
from uwtrack_cli.spectra.demon import demodulate
from uwtrack_cli.spectra.overview import pool_overview

SPECTRUM_IN, GRAM_IN = 2.8, 2.4
"""Heights of the spectrum and of the picture over time, inches."""

USUAL_HZ = 30.0
"""Highest rate that is drawn where no rates were found."""


class Shaft(NamedTuple):
    """A stretch in which a shaft was heard."""

    number: int
    """Passage that it belongs to; 0 for none."""
    shaft_hz: float
    """Rate of the shaft."""
    blade_hz: float
    """Rate of the blades; nan if unknown."""
    rates_hz: tuple[float, ...]
    """Rates that were heard."""

    @property
    def words(self) -> str:
        """What is known of it."""
        text = f"shaft {self.shaft_hz:.2f} Hz ({60 * self.shaft_hz:.0f} rpm)"
        blades = self.blade_hz / self.shaft_hz
        if not np.isfinite(blades) or round(blades) < 2:
            return text
        return f"{text}, blades {self.blade_hz:.2f} Hz ({round(blades)} to a shaft)"


def demon_figure(scene: Scene, view: View) -> Figure:
    """Return the DEMON page of a recording.

    Raises
    ------
    DataError
        The product has no spectrum of the envelope, and its sound is not at hand.
    """
    envelope = scene.envelope or _of_sound(scene)
    span_s = view.span_s(scene.times_s or (0.0, 1.0), scene.clock)
    shafts = list(_shafts(scene, span_s))
    highest = 1.25 * max((max(s.rates_hz) for s in shafts), default=USUAL_HZ / 1.25)
    rate_hz = envelope.frequency_hz
    low, high = view.band_hz or (0.0, min(highest, float(rate_hz[-1])))
    names = [r.name for r in scene.all(Recording)]
    heads = [HeadLine(span_title(span_s, scene.clock, [*names, "DEMON"]))]
    heads += [HeadLine(shaft.words, number=shaft.number) for shaft in shafts]
    if not shafts:
        heads.append(
            HeadLine("no shaft was found; 'uwtrack run --recipe presence' seeks one")
        )
    inside = within(envelope.time_s, span_s)
    power = 10.0 ** (overview_levels(envelope)[inside] / 10.0)
    level = over_floor(10.0 * np.log10(np.nanmean(power, axis=0))[np.newaxis])[0]

    def spectrum(part: SubFigure) -> None:
        ax = calm(part.subplots(), "mean over the\nneighbourhood (dB)")
        ax.plot(rate_hz, level, color=MEASURED, lw=0.8)
        shown = level[within(rate_hz, (low, high))]
        top = float(np.nanmax(shown, initial=1.0))
        for shaft in shafts:
            _mark(shaft, top, ax)
        bottom = float(np.nanmin(shown, initial=0.0))
        ax.set(xlim=(low, high), ylim=(bottom, 1.25 * top))
        ax.set_xlabel("modulation rate (Hz)", fontsize=9)

    gram = [PagePart(GRAM_IN, part.draw) for part in rates_part(scene, span_s)]
    if not gram or scene.envelope is None or view.band_hz is not None:
        picture = overview_picture(envelope, FrequencyAxis(low, high, False), span_s)

        def draw(ax: Axes) -> None:
            draw_picture(picture, ax)
            ax.set_ylabel("modulation\nrate (Hz)", fontsize=8)

        gram = [PagePart(GRAM_IN, draw)]
    lower = timed(gram, view, scene.clock, span_s)
    return page_figure(heads, view, [PagePart(SPECTRUM_IN + 0.4, spectrum), lower])


def _of_sound(scene: Scene) -> Overview:
    """Return the spectrum of the envelope of a recording whose sound is at hand."""
    recording = scene.first(Recording)
    if recording is None or recording.reader is None:
        msg = (
            "the file holds no spectrum of the envelope, and the recording does not lie "
            "beside it: run with --recipe presence, which keeps one."
        )
        raise DataError(msg)
    *_, found = pool_overview(demodulate(recording))
    return found


def _shafts(scene: Scene, span_s: Span) -> Iterator[Shaft]:
    """Yield what was heard of shafts in a span."""
    found = scene.presence
    if found is None:
        return
    for row in scene.stretches(span_s).tolist():
        rates = np.sort(found.rate_hz[found.rate_stretch == row])
        if rates.size:
            spacing = float(found.spacing_hz[row])
            is_of_rates = spacing <= rates[0] * 1.02  # not of its lines
            shaft, blade = (
                spacing if is_of_rates else rates[0],
                found.blade_rate_hz[row],
            )
            yield Shaft(scene.owner(row), shaft, blade, tuple(rates.tolist()))


def _mark(shaft: Shaft, top_db: float, ax: Axes) -> None:
    color = contact_color(shaft.number) if shaft.number else contact_color(2)
    for rate in shaft.rates_hz:
        is_blade = abs(rate - shaft.blade_hz) < 0.02 * rate
        name = "blades" if is_blade else f"{rate / shaft.shaft_hz:.0f}"
        name = "shaft" if abs(rate - shaft.shaft_hz) < 0.02 * rate else name
        ax.axvline(rate, ymax=0.88, color=color, lw=1.6 if is_blade else 0.8, alpha=0.7,
                   linestyle="-" if is_blade else "--")  # fmt: skip
        ax.text(rate, 1.13 * top_db, name, ha="center", fontsize=7, color=color)
