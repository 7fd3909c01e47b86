"""Spectrogram to combs: the machine before any of its lines.

**Method.** A machine makes a fundamental and its multiples, and all of them drift by the
same share. So windows of minutes are searched for fundamentals, with all of their teeth
at once and no peak picked (`lines.comb_search`): eight teeth are heard together some
5 dB below any one of them. Of fundamental, half, third and double the silent teeth decide.
Every tooth that sounds is a line of the comb's family, however weak it is alone.

**Conventions.** The points of a comb are final one window after they were recorded.

**References.** Streit & Barrett, IEEE Trans. ASSP 38(4), 586-598 (1990); Taylor, Astron.
Astrophys. Suppl. 15, 367 (1974); Suvorova et al., Phys. Rev. D 93, 123009 (2016).
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.options import Above, AtLeast, AtMost, Increasing, Unit, checked
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.lines.comb_search.comb_tracker import CombSearch, CombTracker
from uwtrack_cli.lines.followed_lines import FollowedLines
from uwtrack_cli.lines.tracker_options import ProcessNoise

_MOTION = ProcessNoise()

_WINDOW_FRAMES = (16, 512)
"""Fewest and most frames of a window."""


@checked
def find_combs(
    blocks: Iterator[Spectrogram],
    *,
    false_combs_per_hour: Annotated[float, Unit("1/h"), AtLeast(1e-9), AtMost(1e6)] = 1.0,
    fundamental_hz: Annotated[
        tuple[float, float], Unit("Hz"), AtLeast(1e-3), AtMost(1e6), Increasing()
    ] = (0.5, 60.0),
    teeth: Annotated[int, AtLeast(3), AtMost(64)] = 32,
    search_s: Annotated[float, Unit("s"), Above(0), AtMost(36_000)] = 120.0,
    drift_ps: Annotated[float, Unit("1/s"), AtLeast(0), AtMost(1e-2)] = 5e-5,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    motion: ProcessNoise = _MOTION,
) -> Iterator[Lines]:
    """Detect machines by all of their harmonics at once.

    A comb is a fundamental with at least three multiples that drift together: a shaft
    and its blades, a generator, an engine.

    Parameters
    ----------
    blocks
        Spectrogram, block by block.
    false_combs_per_hour
        Combs that noise alone may cause in an hour, at any fundamental.
    fundamental_hz
        Least and greatest fundamental in Hz; teeth at least four resolutions apart.
    teeth
        Highest multiple of the fundamental that is searched.
    search_s
        Time that is searched together, s, about: a power of two of frames, 16 to 512.
    drift_ps
        Greatest change of a fundamental in a second, as a share of it.
    band_hz
        Lowest and highest frequency searched in Hz; everything unless given.
    motion
        How fast bearings may change.

    Yields
    ------
    Lines
        One block per input block with the points that are final, then the rest
        with the table of lines.

    Raises
    ------
    OptionError
        An option is out of range, or no comb fits into the band.

    Notes
    -----
    The evidence of a comb is the sum over its teeth of ln(1 - q + q L) - ln(1 - s + s L):
    L is the likelihood ratio of a steady line along the drift, q = 0.6 the share of teeth
    that sound, s the share of cells in which the window has lines at all.
    """

    def make_tracker(block: Spectrogram) -> CombTracker:
        return _tracker(
            CombSearch(
                false_combs_per_hour,
                window_frames(search_s, block.frames.hop_s),
                fundamental_hz,
                teeth,
                drift_ps,
                band_hz or (0.0, float(block.frequency_hz[-1])),
                motion,
            ),
            block,
        )

    return FollowedLines(blocks, make_tracker)


def window_frames(search_s: float, hop_s: float) -> int:
    """Return the power of two of frames that lasts about as long, from 16 to 512.

    Examples
    --------
    >>> window_frames(120.0, 0.5), window_frames(120.0, 2.0), window_frames(120.0, 6.0)
    (256, 64, 16)
    """
    least, most = _WINDOW_FRAMES
    return int(np.clip(2 ** round(np.log2(search_s / hop_s)), least, most))


def _tracker(rule: CombSearch, block: Spectrogram) -> CombTracker:
    frequency, band = block.frequency_hz, rule.band_hz
    inside = (frequency >= band[0]) & (frequency <= band[1])
    least = 64 * block.frames.cells_per_bin
    if np.count_nonzero(inside) < least:
        raise OptionError(
            f"band_hz = {band[0]:g} {band[1]:g} holds {np.count_nonzero(inside)} cells "
            f"of the spectrogram; combs needs at least {least}."
        )
    tracker = CombTracker(rule, block)
    if not tracker.grid.bands:
        low, high = rule.fundamental_hz
        raise OptionError(
            f"fundamental_hz = {low:g} {high:g} has no comb of three teeth, four "
            f"resolutions of {tracker.bin_hz:g} Hz apart, in band_hz = {band[0]:g} "
            f"{band[1]:g}: make frames longer with 'uwtrack spectrogram --window-s', or "
            "the band wider."
        )
    return tracker
