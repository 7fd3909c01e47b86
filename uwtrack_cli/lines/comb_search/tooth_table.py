"""What each cell, and each drift through it, says for a line: the table of teeth.

**Method.** Along each drift the power over noise is compared with a steady line of several
levels, equally likely before; a tooth sounds or is silent. What is not a tooth may still
be a line, of something else: so a line so strong that it is beyond doubt says for a comb
only as much as lines are rare, and no single one makes a comb. How rare they are is asked
of the window itself. Beside a loud line its leakage looks like lines, too, and so do drifts
that cross it: a tooth is where the amplitude is nearly the greatest around.

**Conventions.** Evidence in nepers, zero where nothing is known. Cells have the shape
(frame, cell), the table (drift, cell + 2): nothing is beyond either end of the band.

**References.** Rice (1945) for a line in noise; Robbins (1956) for the share of lines,
found from the data itself.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.lines.comb_search.drift_sums import drift_sums
from uwtrack_cli.lines.sensitivity import amplitude_log_ratio

LEVELS = (1.2, 3.0, 8.0)
"""Levels of a tooth that are tried, in those that a window of so many frames hears alone at
one standard deviation, sqrt(2 / frames)."""

MOST_SCORE = 3.0
"""Cap on what a cell says, nepers: a click is no tooth."""

STEPS, MOST_AMPLITUDE = 256, 16.0
"""Steps of the table of what an amplitude says, and its end, beyond which the cap is."""

SOUNDING = 0.6
"""Share of the teeth, from the first that sounds to the last, that sound."""

LEAST_STRAY = 5e-4
"""Least share of cells in which lines of no comb are expected."""

SKIRT = 0.75
"""Share of the greatest mean amplitude nearby below which a cell is a line's leakage: half
a natural bin off Hann's response is at .85, one bin off at .5 (Harris 1978)."""

SKIRT_BINS = 2.0
"""Natural bins to either side from which a line leaks (Hann's main lobe)."""

LOUD_SIGMAS = 6.0
"""Deviations of the noise's mean amplitude beyond which a line has skirts to speak of."""

AMPLITUDE_MEAN, AMPLITUDE_STD = 0.886, 0.463
"""Mean and deviation of the square root of an exponential power (Rayleigh)."""

SURE = 30.0
"""Evidence, nepers, beyond which more changes nothing."""


def tooth_levels(n_frames: float) -> FloatArray:
    """Return the levels of teeth that are tried: power over noise in their cell."""
    return np.asarray(np.array(LEVELS) * np.sqrt(2.0 / n_frames), np.float32)


def cell_evidence(
    power_ratio: FloatArray, levels: FloatArray, independent: float
) -> FloatArray:
    """Return what each cell says for a line of each level, and its amplitude.

    ``independent`` is the share of frames that are as good as independent. Shape
    (level + 1, frame, cell); the last is the amplitude over that of noise.
    """
    known = np.isfinite(power_ratio)
    amplitude = np.sqrt(np.where(known, power_ratio, 0.0), dtype=np.float32)
    step = np.minimum(amplitude * np.float32(STEPS), STEPS * MOST_AMPLITUDE)
    step = step.astype(np.int32)
    middle = (np.arange(int(STEPS * MOST_AMPLITUDE) + 1) + 0.5) / STEPS
    score = np.empty((len(levels) + 1, *amplitude.shape), np.float32)
    for plane, level in zip(score, levels, strict=False):
        column = np.minimum(amplitude_log_ratio(middle**2, level), MOST_SCORE)
        (independent * column).astype(np.float32).take(step, out=plane)
    np.subtract(amplitude, np.float32(AMPLITUDE_MEAN), out=score[-1])
    score[:, ~known] = 0.0
    return score


def tooth_table(
    evidence: FloatArray, most_cells: int, bin_cells: int
) -> tuple[FloatArray, float]:
    """Return the table of teeth, and the share of cells with a line.

    Of the evidence of cells, (level + 1, frame, cell), along drifts of up to so many
    cells; a natural bin has ``bin_cells``.
    """
    total = drift_sums(evidence, most_cells)
    likelihood: FloatArray = np.zeros_like(total[0])
    for own in total[:-1]:
        likelihood += np.exp(np.minimum(own, np.float32(SURE)))
    likelihood /= np.float32(len(total) - 1)
    likelihood -= np.float32(1.0)  # over that of noise, less one
    likelihood[_is_skirt(total[-1], evidence.shape[1], bin_cells)] = 0.0
    share = stray_share(likelihood[most_cells])
    n_drifts, n_cells = likelihood.shape
    table = np.zeros((n_drifts, n_cells + 2), np.float32)
    table[:, 1:-1] = np.log1p(np.float32(SOUNDING) * likelihood)
    table[:, 1:-1] -= np.log1p(np.float32(share) * likelihood)
    return table, share


def _is_skirt(amplitude: FloatArray, n_frames: int, bin_cells: int) -> BoolArray:
    """Tell which drifts and cells are the leakage of a line beside them."""
    greatest = amplitude.max(axis=0)
    half = round(SKIRT_BINS * bin_cells)
    padded = np.pad(greatest, half, mode="edge")
    nearby = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=1)
    is_loud = nearby > LOUD_SIGMAS * AMPLITUDE_STD * np.sqrt(n_frames)
    return np.asarray((amplitude < SKIRT * nearby) & is_loud)


def stray_share(likelihood: FloatArray) -> float:
    """Return the share of cells that hold a line, at least `LEAST_STRAY`.

    By two steps of expectation and maximisation, from the likelihood ratio less one.
    """
    share = LEAST_STRAY
    for _ in range(2):
        held = share * (likelihood + 1.0) / (1.0 + share * likelihood)
        share = max(float(held.mean()), LEAST_STRAY)
    return share
