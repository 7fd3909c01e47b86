"""Hydrophones that do not work: dead, clipped, loud or inverted.

**Method.** The level of every hydrophone in a block is compared with the median of all.
The sign of the correlation of neighbours, at frequencies at which a wave from any
direction turns by less than a right angle between them, finds an inverted one.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.errors import DataError, warn

DEAD_DB, HOT_DB = 20.0, 8.0
"""Distance of a level from the median at which a hydrophone is left out, and told."""

FEWEST_ALIVE = 2
"""Hydrophones that a beam needs: two tell an angle."""

SURE_DEVIATIONS = 6.0
"""Deviations of a correlation of noise from which its sign counts."""


@dataclass
class ElementCheck:
    """Watches the hydrophones of an array, block by block; each is told of once."""

    names: tuple[str, ...]
    """Names of the channels."""
    along_m: FloatArray
    """Places, m."""
    quarter_hz: float
    """Frequency at which neighbours lie a quarter of a wavelength apart, Hz."""
    _sign: FloatArray | None = None
    """Signs of the hydrophones; None until they were compared."""
    _told: set[tuple[str, str]] = field(default_factory=set)
    """Channels and what was said of them."""

    def alive(
        self, spectra: NDArray[np.complex64], frequency_hz: FloatArray, time_s: float
    ) -> BoolArray:
        """Return which hydrophones are used in a block that begins at a time, s.

        Spectra have the shape (cell, element, frame).

        Raises
        ------
        DataError
            Too few work.
        """
        power = (spectra.real**2 + spectra.imag**2).mean(axis=(0, 2))
        if not power.any():  # a gap
            return np.ones(power.size, np.bool_)
        with np.errstate(divide="ignore"):
            level_db = 10.0 * np.log10(power / np.median(power[power > 0.0]))
        alive = np.abs(level_db) < DEAD_DB
        for k in np.flatnonzero(np.abs(level_db) >= HOT_DB):
            self._tell_level(self.names[k], float(level_db[k]), time_s)
        if np.count_nonzero(alive) < FEWEST_ALIVE:
            raise DataError(
                f"{np.count_nonzero(alive)} of {alive.size} hydrophones have a level "
                f"within {DEAD_DB:g} dB of the median at {time_s:.1f} s; beams need "
                f"{FEWEST_ALIVE}: check the recording, or leave this part out with "
                f"--start-s and --stop-s."
            )
        if self._sign is None:
            gaps = np.diff(np.sort(self.along_m[alive]))
            # neighbours of a dead one lie farther apart
            highest_hz = self.quarter_hz * float(np.median(np.diff(np.sort(self.along_m))))
            is_low = frequency_hz <= highest_hz / float(gaps.max())
            self._compare_signs(spectra[is_low], alive)
        return np.asarray(alive)

    def upright(self, spectra: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return spectra, (cell, element, frame), in which all signs are alike."""
        if self._sign is None or np.all(self._sign > 0.0):
            return spectra
        return spectra * self._sign[:, np.newaxis].astype(np.float32)

    def _tell_level(self, name: str, level_db: float, time_s: float) -> None:
        what = "left out" if abs(level_db) >= DEAD_DB else "used"
        if (name, what) in self._told:
            return
        self._told.add((name, what))
        level = f"{abs(level_db):.0f} dB {'above' if level_db > 0 else 'below'}"
        if not np.isfinite(level_db):
            level = "silent, far below"
        warn(
            f"hydrophone {name} is {level} the median of the array at {time_s:.1f} s; "
            f'it is {what} (channel name "-" leaves it out of the whole recording).'
        )

    def _compare_signs(self, spectra: NDArray[np.complex64], alive: BoolArray) -> None:
        self._sign = np.ones(alive.size)
        order = np.argsort(self.along_m)
        order = order[alive[order]]
        near = spectra[:, order]
        if near.size == 0:
            return
        cross = (near[:, 1:] * near[:, :-1].conj()).real.sum(axis=(0, 2))
        power = (near.real**2 + near.imag**2).sum(axis=(0, 2))
        coherence = cross / np.sqrt(power[1:] * power[:-1])
        n_cells = near.shape[0] * near.shape[2] / 4.0  # padded, overlapping
        if np.any(np.abs(coherence) < SURE_DEVIATIONS / np.sqrt(n_cells)):
            return  # a chain of signs is as sure as its weakest link
        sign = np.cumprod(np.append(1.0, np.sign(coherence)))
        usual = np.sign(sign.sum()) or 1.0
        for k in order[sign != usual]:
            self._sign[k] = -1.0
            warn(
                f"hydrophone {self.names[k]} has the opposite sign of its neighbours "
                f"(inverted wiring?); its sign is turned."
            )


def with_silent_elements(samples: FloatArray) -> FloatArray:
    """Return samples in which a channel that holds no number at all is silent.

    Such a channel, nan throughout, is a dead hydrophone, which is left out. Samples
    that are missing for a time, or from all channels, stay a gap.
    """
    lost = np.isnan(samples).all(axis=0)
    if not lost.any() or lost.all():
        return samples
    return np.where(lost, np.zeros(1, samples.dtype), samples)
