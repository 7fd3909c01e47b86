"""Steering of the hydrophones for every beam, made block of cells by block of cells.

**Method.** The steering of cells that lie evenly goes on by one factor from each to the next,
so that a block of them takes one exponential of its first cell, and products: as fast as
keeping the steering of all cells, which takes gigabytes for a hundred hydrophones.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray

AT_ONCE = 16
"""Cells that go on from one exponential."""

KEPT_VALUES = 1 << 22
"""Values of a steering of all cells that is kept as it is: 32 MB."""


@dataclass(eq=False)
class Steering:
    """exp(-2 pi j f t) of leads t, to be summed with the spectra.

    Sliced by cells, it gives an array of shape (cell, beam, element).
    """

    frequency_hz: FloatArray
    """Frequency of every cell, Hz; they lie evenly."""
    lead_s: FloatArray
    """How much earlier each hydrophone hears, s, shape (beam, element)."""

    def __post_init__(self) -> None:
        """Make it as a whole where it is small."""
        step_hz = float(np.diff(self.frequency_hz[:2]).sum())
        ahead = np.arange(min(AT_ONCE, self.frequency_hz.size)) * step_hz
        self._ahead = self._turned(ahead[:, None, None])
        self._whole: NDArray[np.complex64] | None = None
        if self.frequency_hz.size * self.lead_s.size <= KEPT_VALUES:
            self._whole = self._made(0, self.frequency_hz.size)

    @property
    def n_beams(self) -> int:
        """Number of beams."""
        return len(self.lead_s)

    def __getitem__(self, cells: slice) -> NDArray[np.complex64]:
        """Return the steering of consecutive cells."""
        if self._whole is not None:
            return self._whole[cells]
        first, stop, _ = cells.indices(self.frequency_hz.size)
        return self._made(first, stop)

    def thinned(self, step: int) -> "Steering":
        """Return that of every so many-th cell."""
        return replace(self, frequency_hz=self.frequency_hz[::step])

    def of_elements(self, chosen: BoolArray) -> "Steering":
        """Return that of some of the hydrophones."""
        return self if chosen.all() else replace(self, lead_s=self.lead_s[:, chosen])

    def _made(self, first: int, stop: int) -> NDArray[np.complex64]:
        made = np.empty((stop - first, *self.lead_s.shape), np.complex64)
        for begin in range(first, stop, AT_ONCE):
            part = made[begin - first : begin - first + AT_ONCE]
            base = self._turned(self.frequency_hz[begin])
            np.multiply(base, self._ahead[: len(part)], out=part)
        return made

    def _turned(self, frequency_hz: FloatArray | float) -> NDArray[np.complex64]:
        turned = np.exp(-2j * np.pi * frequency_hz * self.lead_s)
        return np.asarray(turned, np.complex64)
