"""Broadband sound of a planar or volume array to directions, frame by frame.

**Method.** In every cell the share g of the hydrophones' power that a plane wave from a
direction explains is, in noise alone, Beta(1, N - 1): -(N - 1) ln(1 - g) is exponential
of mean 1 whatever the noise's level, so that gusts and rain do not raise the rate. Its
sum over the band is, but for a factor, the likelihood of a source of unknown spectrum
in noise of unknown spectrum; the largest over all directions is the estimate, and a
direction is told where it exceeds what noise reaches at the stated rate in a frame.
Before, each hydrophone is scaled to its own power in sixteen bins, and isotropic noise,
which is coherent between near hydrophones, is whitened: its share is estimated block by
block from the coherence of all pairs.

**Conventions.** A frame has one direction, the strongest; other maxima that explain its
sound nearly as well are its lobes, weighted by likelihood. The deviation is that of the
Fisher information of a random signal, with the ratio that the frame itself shows.

**References.** L. L. Scharf & B. Friedlander, IEEE Trans. Signal Process. 42 (1994):
the matched subspace statistic; H. Cox, J. Acoust. Soc. Am. 54 (1973): isotropic noise;
R. R. Blandford, Geophysics 39 (1974): its use on arrays in the ground.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.arrays.direction_grid import DirectionGrid, SpatialArray
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.errors import OptionError

BAND_BINS = 16
"""Natural bins over which a hydrophone's level, and the noise's share, are taken."""

FEWEST_BINS = 8
"""Natural bins that a direction needs."""

BIN_CORRELATION = 1.944
"""Correlation sum of natural bins under a Hann window, 1 + 2 (4/9 + 1/36)."""

SCORING_STEPS = 5
"""Newton steps from a beam's maximum to that of the likelihood."""

LARGEST_ISOTROPIC = 0.995
"""Largest share of isotropic noise that is whitened: beyond, errors of place count."""

DRAWN_FRAMES = 128
"""Frames of drawn noise of each kind by which the threshold is set, whatever the
array's shape: the rate differs from the stated one by 17 % (one deviation)."""

DRAWN_ISOTROPIC = 0.95
"""Share of isotropic noise in those of the second kind; the rest is independent."""

DRAWN_AT_ONCE = 32
"""Of these, so many at once, as beams are formed of."""

DRAWN_SHARE = 0.25
"""Share of them, the highest, that tells how many directions noise fills."""

HIGHER_FACTOR = 1.2
"""Directions that noise fills at the heights of rates of 0.1 and less, over those at
the share above: neighbours are less alike there (calibration/directions.py)."""

LEAST_WEIGHT = 0.01
"""Lobes of less weight are not listed."""

Whitened = tuple[NDArray[np.complex64], NDArray[np.complex64]]
"""Spectra, shape (bin, element, frame), and what made their noise white."""


@dataclass(frozen=True, eq=False)
class FoundDirections:
    """Directions of a block; one row per frame that has one."""

    frame: IntArray
    """Row of the frame in the block."""
    beam: IntArray
    """Beam next to the direction."""
    toward: FloatArray
    """Direction u, shape (n, 3)."""
    covariance: FloatArray
    """Its covariance, shape (n, 3, 3)."""
    snr: FloatArray
    """Power over noise in the beam, mean over the band."""
    lobe_frame: IntArray
    """Row of the frame of every lobe."""
    lobe_toward: FloatArray
    """Other directions that explain the sound, shape (lobe, 3)."""
    lobe_weight: FloatArray
    """Their weights."""


@dataclass(frozen=True, eq=False)
class DirectionSearch:
    """Seeks the direction of broadband sound in every frame.

    Parameters
    ----------
    array, grid
        The hydrophones, and beams over their directions.
    frequency_hz
        Natural bins of the band, Hz.
    probability
        Share of frames of noise in which a direction may be found.

    Raises
    ------
    OptionError
        The band holds too few bins.
    """

    array: SpatialArray
    grid: DirectionGrid
    frequency_hz: FloatArray
    probability: float
    _directions: dict[bytes, tuple[float, float]] = field(
        default_factory=dict, init=False
    )
    """Directions that independent and isotropic noise fill, by who is alive."""

    def __post_init__(self) -> None:
        """Refuse a band that is too narrow."""
        if self.frequency_hz.size < FEWEST_BINS:
            msg = (
                f"the band holds {self.frequency_hz.size} bins of one over the window; "
                f"directions need {FEWEST_BINS}: give --band-hz or a longer --window-s."
            )
            raise OptionError(msg)

    def find(
        self,
        spectra: NDArray[np.complex64],
        turns: NDArray[np.complex64],
        alive: BoolArray,
        is_whole: BoolArray,
    ) -> FoundDirections:
        """Find the directions of a block.

        Parameters
        ----------
        spectra
            Spectra in the natural bins, shape (bin, element, frame).
        turns
            Steering of the grid's beams in these bins, shape (bin, beam, element).
        alive
            Hydrophones that are used.
        is_whole
            Frames that are searched.
        """
        height, parts, share = self._heights(spectra, turns, alive)
        is_found = self._best(height) > self._threshold(turns, alive, share)
        frame = np.flatnonzero(is_found & is_whole)
        return self._measured(parts, height[:, frame], frame, alive)

    def _heights(
        self,
        spectra: NDArray[np.complex64],
        turns: NDArray[np.complex64],
        alive: BoolArray,
    ) -> tuple[FloatArray, list[Whitened], float]:
        """Return the sum over the band, shape (beam, frame), and what it is made of.

        The last is the share of isotropic noise over the whole band.
        """
        equal = _equalised(spectra[:, alive])
        parts: list[Whitened] = []
        height = np.zeros((self.grid.n_beams, spectra.shape[2]))
        fitted = []
        for bins in _bands(self.frequency_hz.size):
            coherence = self.array.isotropic_coherence(self.frequency_hz[bins])
            coherence = coherence[:, alive][:, :, alive]
            heard, root, match = _whitened(equal[bins], coherence)
            steered = turns[bins][:, :, alive].conj() @ root.transpose(0, 2, 1)
            height += _log_gain(heard, steered)
            parts.append((heard, root))
            fitted.append(match)
        seen, full = np.sum(fitted, axis=0)
        return height, parts, float(np.clip(seen / max(full, 1e-9), 0.0, 1.0))

    def _best(self, height: FloatArray) -> FloatArray:
        """Return the highest maximum of every frame, those at the rim left out."""
        maxima = np.where(self.grid.is_maximum(height), height, -np.inf)
        return np.asarray(maxima.max(axis=0))

    def _threshold(
        self, turns: NDArray[np.complex64], alive: BoolArray, share: float
    ) -> float:
        """Return what the sum over the band reaches in noise at the stated rate.

        One direction reaches a height with the probability Q of a gamma law, the best
        of n independent ones with 1 - exp(-n Q). A height that a known share of frames
        of drawn noise exceeds tells n, for independent and for isotropic noise (whose
        whitening is estimated); between them ln n follows the share of the latter.
        """
        from scipy.special import gammainccinv

        shape = self.frequency_hz.size / BIN_CORRELATION
        key = alive.tobytes()
        if key not in self._directions:
            self._directions[key] = (
                self._own_directions(turns, alive, 0.0),
                self._own_directions(turns, alive, DRAWN_ISOTROPIC),
            )
        ends = np.log(self._directions[key])
        n_own = float(np.exp(np.interp(share, [0.0, DRAWN_ISOTROPIC], ends)))
        return float(BIN_CORRELATION * gammainccinv(shape, self.probability / n_own))

    def _own_directions(
        self, turns: NDArray[np.complex64], alive: BoolArray, share: float
    ) -> float:
        """Return how many directions noise with a share of isotropic noise fills."""
        from scipy.special import gammaincc

        rng = np.random.default_rng(1)
        coherence = self.array.isotropic_coherence(self.frequency_hz)
        mixed = (1.0 - share) * np.eye(alive.size) + share * coherence
        root = np.linalg.cholesky(mixed).astype(np.complex64)
        best = []
        for _ in range(DRAWN_FRAMES // DRAWN_AT_ONCE):
            size = (2, self.frequency_hz.size + 2, alive.size, DRAWN_AT_ONCE)
            real, imaginary = rng.standard_normal(size, np.float32)
            bins = real + 1j * imaginary
            windowed = bins[1:-1] - 0.5 * (
                bins[:-2] + bins[2:]
            )  # as Hann's window does
            best.append(self._best(self._heights(root @ windowed, turns, alive)[0]))
        height = float(np.quantile(np.concatenate(best), 1.0 - DRAWN_SHARE))
        shape = self.frequency_hz.size / BIN_CORRELATION
        chance = float(gammaincc(shape, height / BIN_CORRELATION))
        return float(max(1.0, -np.log(1.0 - DRAWN_SHARE) / chance * HIGHER_FACTOR))

    def _measured(
        self,
        parts: list[Whitened],
        height: FloatArray,
        frame: IntArray,
        alive: BoolArray,
    ) -> FoundDirections:
        """Refine the maxima, list the lobes, state the deviations."""
        is_peak = self.grid.is_maximum(height)
        peak_beam, peak_row = np.nonzero(is_peak)
        around = np.concatenate(
            [peak_beam[:, None], self.grid.neighbours[peak_beam]], axis=1
        )
        toward, top = self.grid.refine(peak_beam, height[around, peak_row[:, None]])
        n_alive = int(np.count_nonzero(alive))
        best = np.full(frame.size, -np.inf)
        np.maximum.at(best, peak_row, top)
        gain = n_alive / (n_alive - 1.0) / BIN_CORRELATION
        weight = np.exp(np.minimum(gain * (top - best[peak_row]), 0.0))
        total = np.bincount(peak_row, weight, minlength=frame.size)
        weight /= total[peak_row]
        is_first = top == best[peak_row]
        order = np.flatnonzero(is_first)
        order = order[np.unique(peak_row[order], return_index=True)[1]]
        rows = peak_row[order]
        is_lobe = (weight >= LEAST_WEIGHT) & ~is_first
        best_toward, covariance, snr = self._polished(
            parts, toward[order], frame[rows], self.array.centred_m[alive]
        )
        return FoundDirections(
            frame=frame[rows],
            beam=peak_beam[order],
            toward=best_toward,
            covariance=covariance,
            snr=snr,
            lobe_frame=frame[peak_row[is_lobe]],
            lobe_toward=toward[is_lobe],
            lobe_weight=weight[is_lobe],
        )

    def _polished(
        self,
        parts: list[Whitened],
        toward: FloatArray,
        frame: IntArray,
        places: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Climb from beams' maxima to that of the likelihood, with its curvature."""
        for _ in range(SCORING_STEPS):
            moved, *_ = self._score(parts, toward, frame, places)
            length = np.linalg.norm(moved, axis=1)
            moved *= np.minimum(1.0, self.grid.step / np.maximum(length, 1e-12))[
                :, None
            ]
            toward = toward + moved
            if not self.array.is_planar:
                toward = toward / np.linalg.norm(toward, axis=1)[:, None]
        _, covariance, snr = self._score(parts, toward, frame, places)
        return toward, covariance, snr

    def _score(
        self,
        parts: list[Whitened],
        toward: FloatArray,
        frame: IntArray,
        places: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the step to the maximum, inverse information and ratio in the beam.

        The likelihood is -N sum n ln(1 - g), g the share of n bins together that the
        direction explains. Information of a bin is 2 S^2 / (1 + |w|^2 S) (|w|^2 d'd -
        |w'd|^2) / |w|^2 with w and d the whitened steering vector and its derivatives
        and S the signal over the noise at a hydrophone; bins count as independent ones.
        The likelihood itself, which knows neither, bends by 2 N / (N - 1) |w|^2 S.
        """
        score = np.zeros((frame.size, 3))
        information, curvature = np.zeros((2, frame.size, 3, 3))
        total = np.zeros(frame.size)
        lead_s = toward @ places.T / self.array.sound_speed_mps
        for bins, (heard, root) in zip(
            _bands(self.frequency_hz.size), parts, strict=True
        ):
            wave = 2.0 * np.pi * self.frequency_hz[bins]
            turned = np.exp(1j * np.multiply.outer(wave, lead_s))  # bin, row, element
            first = turned @ root.transpose(0, 2, 1)
            slope = 1j * wave[:, None, None] / self.array.sound_speed_mps * turned
            slopes = np.stack(
                [(slope * places[:, k]) @ root.transpose(0, 2, 1) for k in range(3)], -1
            )
            size = (np.abs(first) ** 2).sum(axis=2)
            sound = heard[:, :, frame].transpose(0, 2, 1)
            beam = (first.conj() * sound).sum(axis=2)
            power = np.maximum((np.abs(sound) ** 2).sum(axis=(0, 2)), 1e-30)
            along = np.abs(beam) ** 2 / size
            share = np.minimum(along.sum(axis=0) / power, 1.0 - 1e-6)
            n_alive = len(places)
            ratio = np.maximum(n_alive * share - 1.0, 0.0) / (1.0 - share)
            crossed = np.einsum("frm,frmk->frk", first.conj(), slopes)
            change = np.einsum("frmk,frm->frk", slopes.conj(), sound)
            change = 2.0 * (change * beam.conj()[..., None]).real
            change -= 2.0 * along[..., None] * crossed.real
            change = (change / size[..., None]).sum(axis=0)
            score += (n_alive * wave.size / (power * (1.0 - share)))[:, None] * change
            inner = np.einsum("frmk,frml->frkl", slopes.conj(), slopes)
            outer = crossed[..., :, None].conj() * crossed[..., None, :]
            tensor = (inner.real - outer.real / size[..., None, None]) / size[
                ..., None, None
            ]
            weight = 2.0 * ratio**2 / (1.0 + ratio)
            information += weight[:, None, None] * tensor.sum(axis=0)
            bend = 2.0 * ratio * n_alive / (n_alive - 1.0)
            curvature += bend[:, None, None] * tensor.sum(axis=0)
            total += ratio * wave.size
        mean = total / self.frequency_hz.size
        covariance = _inverse(information / BIN_CORRELATION, toward, self.array)
        step = np.einsum("nij,nj->ni", _inverse(curvature, toward, self.array), score)
        return step, covariance, mean


def _inverse(
    information: FloatArray, toward: FloatArray, array: SpatialArray
) -> FloatArray:
    """Invert the information on the two directions in which u can vary."""
    if array.is_planar:
        normal = np.broadcast_to(array.normal, toward.shape)
    else:
        normal = toward / np.linalg.norm(toward, axis=1)[:, None]
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    inside = across @ information @ across
    size = np.maximum(np.trace(inside, axis1=1, axis2=2), 1e-12)
    filled = inside + (size[:, None, None] * normal[:, :, None]) * normal[:, None, :]
    filled += 1e-9 * size[:, None, None] * np.eye(3)
    return np.asarray(across @ np.linalg.inv(filled) @ across)


def _bands(n_bins: int) -> list[slice]:
    """Cut the bins into stretches of sixteen or a little more."""
    count = max(1, n_bins // BAND_BINS)
    edges = np.linspace(0, n_bins, count + 1).astype(int)
    return [slice(*pair) for pair in pairwise(edges.tolist())]


def _equalised(spectra: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Give all hydrophones one level in every stretch of bins, and in every frame.

    The level is that of the stretch over the block, times that of the frame over the
    band: a level of its own for each stretch and frame, from sixteen bins, would itself
    depend on the noise and raise the rate of false directions.
    """
    power = spectra.real**2 + spectra.imag**2
    tiny = np.finfo(np.float32).tiny
    for bins in _bands(len(power)):
        level = np.maximum(power[bins].mean(axis=(0, 2)), tiny)
        power[bins] /= level[:, None]
        spectra[bins] /= np.sqrt(level)[:, None]
    return np.asarray(spectra / np.sqrt(np.maximum(power.mean(axis=0), tiny)))


def _whitened(
    equal: NDArray[np.complex64], coherence: FloatArray
) -> tuple[NDArray[np.complex64], NDArray[np.complex64], tuple[float, float]]:
    """Return spectra of a few bins with white noise, and what whitened it.

    The last are what the pairs show of the coherence of isotropic noise, and what they
    would show of it if all noise were so.
    """
    upper = np.triu_indices(coherence.shape[1], 1)
    cross = np.einsum("fit,fjt->fij", equal, equal.conj()).real
    n_used = max(int(np.count_nonzero(equal.any(axis=(0, 1)))), 1)
    pairs, seen = coherence[:, *upper], cross[:, *upper] / n_used
    match = float((pairs * seen).sum()), float((pairs**2).sum())
    share = min(max(match[0] / max(match[1], 1e-9), 0.0), LARGEST_ISOTROPIC)
    noise = (1.0 - share) * np.eye(coherence.shape[1]) + share * coherence
    root = np.linalg.inv(np.linalg.cholesky(noise)).astype(np.complex64)
    return root @ equal, root, match


def _log_gain(
    heard: NDArray[np.complex64], steering: NDArray[np.complex64]
) -> FloatArray:
    """Return -(N - 1) sum ln(1 - g) over a few bins, shape (beam, frame)."""
    n_alive = heard.shape[1]
    size = (steering.real**2 + steering.imag**2).sum(axis=2)
    pressure = steering.conj() @ heard
    power = (heard.real**2 + heard.imag**2).sum(axis=1)
    along = (pressure.real**2 + pressure.imag**2) / size[:, :, None]
    share = along / np.maximum(power, np.finfo(np.float32).tiny)[:, None, :]
    rest = np.maximum(1.0 - share, np.float32(1e-7))
    return np.asarray(-(n_alive - 1.0) * np.log(rest).sum(axis=0))
