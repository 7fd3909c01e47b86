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

Further sources are sought in what the known ones leave: the whitened spectra across
their steering vectors, in which the same share is Beta(1, N - m - 1) after m sources.
Errors of places, gains and delays leave some sound of a strong source there, too, and a
vessel that moves within the frame: what is coherent with a known source over sixteen
bins is taken off before. Then each direction is measured again across all others. N
hydrophones tell N / 2 sources; of a frame in which more are heard only those are told
that stand far above all that is left.

**Conventions.** The first direction of a frame is the strongest; other maxima that
explain its sound nearly as well are its lobes, weighted by likelihood. The deviation is
that of the Fisher information of a random signal, with the ratio that the frame itself
shows.

**References.** L. L. Scharf & B. Friedlander, IEEE Trans. Signal Process. 42 (1994):
the matched subspace statistic; H. Cox, J. Acoust. Soc. Am. 54 (1973): isotropic noise;
R. R. Blandford, Geophysics 39 (1974): its use on arrays in the ground.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.arrays.direction_grid import DirectionGrid, SpatialArray
from uwtrack_cli.arrays.steering import Steering
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.window import BIN_CORRELATION

BAND_BINS = 16
"""Natural bins over which a hydrophone's level, and the noise's share, are taken."""

FEWEST_BINS = 8
"""Natural bins that a direction needs."""

SCORING_STEPS = 5
"""Newton steps from a beam's maximum to that of the likelihood."""

LARGEST_ISOTROPIC = 0.995
"""Largest share of isotropic noise that is whitened: beyond, errors of place count."""

DRAWN_FRAMES = (512, 1024)
"""Frames of drawn noise of each kind by which the threshold is set, whatever the
array's shape, at least and at most: the rate differs from the stated one by 9 to 7 % by
them (one deviation)."""

DRAWN_VALUES = 200_000_000
"""Beams times bins times frames from which no more than the least are drawn."""

DRAWN_ISOTROPIC = (0.0, 0.5, 0.95)
"""Share of isotropic noise in those of each kind; the rest is independent."""

DRAWN_AT_ONCE = 32
"""Of these, so many at once, as beams are formed of."""

DRAWN_SHARES = (0.1, 0.2, 0.3)
"""Shares of them, the highest, that tell how many directions noise fills."""

FILLED_AT = (1.0, 0.92, 0.86)
"""Directions that noise fills at the heights of these shares, over those at the first."""

GROWTH = 0.55
"""Directions filled at greater heights go as this power of -ln Q: near a high maximum the
sums of neighbours are less alike. From 0.1 to 0.01 that is 1.2 to 1.3 times; both figures
are the means over fifteen arrays and kinds of noise (studies/constants/directions.py)."""

GROWTH_ROUNDS = 8
"""Times that the number of directions at a height is found from itself: it settles
within three."""

ELEMENTS_PER_SOURCE = 2
"""Hydrophones for each source that is sought in a frame."""

ROUNDS, STILL = 8, 0.1
"""Times that sources of a frame are measured in turns at most, and the way, in
deviations, from which they are measured once more."""

CLEAR_RATIO = 10.0
"""Power over all else in its beam from which a source is told although more sources are
heard than the hydrophones tell apart."""

LEAST_ACROSS = 0.1
"""Share of a steering vector that must lie across those of the known sources."""

LEAST_WEIGHT = 0.01
"""Lobes of less weight are not listed."""

MOST_FILLED = 256
"""Arrays, bands and kinds of noise that are kept."""

_FILLED: dict[int, float] = {}
"""Directions that noise fills, which take a second to find, by array and kind."""


@dataclass(frozen=True, eq=False)
class DirectionLobes(Rows):
    """Other directions that explain the sound of a source."""

    frame: IntArray
    """Row of the frame in the block."""
    source: IntArray
    """Number of the source that it may be."""
    toward: FloatArray
    """Direction u, shape (lobe, 3)."""
    weight: FloatArray
    """Its weight."""


NO_LOBES = DirectionLobes(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
)


@dataclass(frozen=True, eq=False)
class FoundDirections(Rows):
    """Directions of a block, one row each, those of a frame one after the other."""

    frame: IntArray
    """Row of the frame in the block."""
    source: IntArray
    """Number of the source in its frame, 0 the strongest."""
    beam: IntArray
    """Beam next to the direction."""
    toward: FloatArray
    """Direction u, shape (n, 3)."""
    covariance: FloatArray
    """Its covariance, shape (n, 3, 3)."""
    snr: FloatArray
    """Power over noise in the beam, mean over the band."""
    lobes: DirectionLobes = NO_LOBES
    """What they may be instead."""

    def copy(self) -> "FoundDirections":
        """Return one whose measured columns can be written."""
        return replace(
            self, toward=self.toward.copy(), covariance=self.covariance.copy(), snr=self.snr.copy()
        )

    def put(self, rows: IntArray, other: "FoundDirections") -> None:
        """Take the measured columns of some rows from another one."""
        self.toward[rows] = other.toward[rows]
        self.covariance[rows] = other.covariance[rows]
        self.snr[rows] = other.snr[rows]

    @classmethod
    def none(cls) -> "FoundDirections":
        """Return no directions."""
        no = np.zeros(0, np.int64)
        return cls(no, no, no, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))

    def of_part(self, rows: slice) -> "FoundDirections":
        """Return those of a part of the block, counted from its first frame."""
        found = self.of_frames(np.arange(rows.start, rows.stop))
        lobes = replace(found.lobes, frame=found.lobes.frame - rows.start)
        return replace(found, frame=found.frame - rows.start, lobes=lobes)

    def of_frames(self, frames: IntArray) -> "FoundDirections":
        """Return the rows and lobes of some frames."""
        lobes = self.lobes.take(np.isin(self.lobes.frame, frames))
        return replace(self.take(np.isin(self.frame, frames)), lobes=lobes)


@dataclass(frozen=True, eq=False)
class _WhiteSound:
    """Sound of a block whose noise was made white, a stretch of bins at a time."""

    parts: list[tuple[slice, NDArray[np.complex64], NDArray[np.complex64]]]
    """Stretches of bins, spectra (bin, element, frame), and what made them white."""
    places_m: FloatArray
    """Places of the hydrophones about their middle, shape (element, 3)."""

    @property
    def n_elements(self) -> int:
        """Number of hydrophones."""
        return len(self.places_m)


@dataclass(frozen=True, eq=False)
class _Known(Rows):
    """Directions that are known of some frames, as many of each."""

    frame: IntArray
    """Rows of the frames in the block, shape (row,)."""
    toward: FloatArray
    """Directions, shape (row, source, 3)."""

    @property
    def n_sources(self) -> int:
        """Number of sources of each frame."""
        return int(self.toward.shape[1])

    def without(self, source: int) -> "_Known":
        """Return all but one of each frame."""
        return _Known(self.frame, np.delete(self.toward, source, axis=1))


@dataclass(frozen=True, eq=False)
class DirectionSearch:
    """Seeks the directions of broadband sound in every frame.

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

    def __post_init__(self) -> None:
        """Refuse a band that is too narrow."""
        if self.frequency_hz.size < FEWEST_BINS:
            raise OptionError(
                f"the band holds {self.frequency_hz.size} bins of one over the window; "
                f"directions need {FEWEST_BINS}: give --band-hz or a longer --window-s."
            )

    @cached_property
    def _bands(self) -> list[slice]:
        """Stretches of bins of which noise and levels are taken together."""
        return bands_of(self.frequency_hz.size)

    def find(
        self, spectra: NDArray[np.complex64], turns: Steering, alive: BoolArray, is_whole: BoolArray
    ) -> FoundDirections:
        """Find the directions of a block, in the frames that are whole.

        Spectra in the natural bins have the shape (bin, element, frame), the steering
        of the grid's beams (bin, beam, element).
        """
        height, sound, share = self._heights(spectra, turns, alive)
        limit = self._threshold(turns, alive, share)
        frame = np.flatnonzero((self._best(height) > limit) & is_whole)
        known = _Known(frame, np.zeros((frame.size, 0, 3)))
        found = [self._measured(sound, height[:, frame], known)]
        known = _Known(found[0].frame, found[0].toward[:, None])
        crowded: IntArray = np.zeros(0, np.int64)
        while known.frame.size and known.n_sources < sound.n_elements - 1:
            sound, share = self._whitened_across(sound, known, is_whole)
            limit = self._threshold(turns, alive, share)
            known = self._measured_together(sound, known, found)
            height = self._heights_across(sound, turns.of_elements(alive), known)
            is_sure = self._best(height) > limit
            known = known.take(is_sure)
            if known.n_sources >= max(1, sound.n_elements // ELEMENTS_PER_SOURCE):
                crowded = known.frame
                break
            more = self._measured(sound, height[:, is_sure], known)
            known, found = self._joined_by(more, sound, known, found)
        return _joined(found, crowded)

    def _joined_by(
        self, more: FoundDirections, sound: _WhiteSound, known: _Known, found: list[FoundDirections]
    ) -> tuple[_Known, list[FoundDirections]]:
        """Measure known sources of some frames together with one more of each.

        A frame keeps what it had where the new source runs into another one.
        """
        known = known.take(np.searchsorted(known.frame, more.frame))
        joined = np.concatenate([known.toward, more.toward[:, None]], axis=1)
        before = [one.copy() for one in found]
        known = self._measured_together(sound, _Known(known.frame, joined), [*found, more])
        apart = np.linalg.norm(known.toward[:, :-1] - known.toward[:, -1:], axis=2)
        is_apart = apart.min(axis=1) > self.grid.step
        for one, old in zip(found, before, strict=True):
            rows = np.searchsorted(one.frame, known.frame[~is_apart])
            one.put(rows, old)
        more = more.of_frames(known.frame[is_apart])
        return known.take(is_apart), [*found, more]

    def _whitened_across(
        self, white: _WhiteSound, known: _Known, is_whole: BoolArray
    ) -> tuple[_WhiteSound, float]:
        """Whiten again by what is left across known sources; also the share over all.

        A source is coherent as isotropic noise is, and would be taken for some.
        """
        found, places = [], white.places_m
        free = np.setdiff1d(np.flatnonzero(is_whole), known.frame)
        groups = (known, _Known(free, np.zeros((free.size, 0, 3))))
        apart_s = np.linalg.norm(places[:, None] - places[None], axis=2)
        apart_s /= self.array.sound_speed_mps
        plain = np.eye(len(places), dtype=np.complex64)[None]
        whole = np.zeros((2, 3))
        for bins, heard, root in white.parts:
            waves = 2.0 * np.multiply.outer(self.frequency_hz[bins], apart_s)
            equal = np.linalg.inv(root) @ heard
            fitted = np.zeros((2, 3))
            for group in groups:
                sound = equal[:, :, group.frame].transpose(0, 2, 1)
                leads = self._leads(bins, group.toward, places)
                for source in range(group.n_sources):
                    sound = _without_coherent(sound, leads[:, :, source], plain)
                fitted += _noise_products(sound, _basis(leads, plain), np.sinc(waves))
            whole += fitted
            own = _whitener(np.sinc(waves), _isotropic_share(fitted))
            found.append((bins, (own @ equal).astype(np.complex64), own))
        return _WhiteSound(found, places), _isotropic_share(whole)

    def _heights(
        self, spectra: NDArray[np.complex64], turns: Steering, alive: BoolArray
    ) -> tuple[FloatArray, _WhiteSound, float]:
        """Return the sum over the band, shape (beam, frame), and what it is made of.

        The last is the share of isotropic noise over the whole band.
        """
        equal, used = _equalised(spectra[:, alive]), turns.of_elements(alive)
        height = np.zeros((self.grid.n_beams, spectra.shape[2]))
        parts, fitted = [], []
        for bins in self._bands:
            coherence = self.array.isotropic_coherence(self.frequency_hz[bins])
            coherence = coherence[:, alive][:, :, alive]
            heard, root, match = _whitened(equal[bins], coherence)
            steered = used[bins].conj() @ root.transpose(0, 2, 1)
            height += _log_gain(heard, steered)
            parts.append((bins, heard, root))
            fitted.append(match)
        seen, full = np.sum(fitted, axis=0)
        share = float(np.clip(seen / max(full, 1e-9), 0.0, 1.0))
        return height, _WhiteSound(parts, self.array.centred_m[alive]), share

    def _best(self, height: FloatArray) -> FloatArray:
        """Return the highest maximum of every frame, those at the rim left out."""
        maxima = np.where(self.grid.is_maximum(height), height, -np.inf)
        return np.asarray(maxima.max(axis=0))

    def _threshold(self, turns: Steering, alive: BoolArray, share: float) -> float:
        """Return what the sum over the band reaches in noise at the stated rate.

        One direction reaches a height with the probability Q of a gamma law, the best
        of n independent ones with 1 - exp(-n Q). Heights that known shares of frames of
        drawn noise exceed tell n, for independent and for isotropic noise (whose
        whitening is estimated) and a half of each; between them ln n follows the share.
        At greater heights n grows a little.
        """
        from scipy.special import gammainccinv

        kinds = np.array(DRAWN_ISOTROPIC)
        upper = int(np.clip(np.searchsorted(kinds, share), 1, kinds.size - 1))
        ends = kinds[upper - 1 : upper + 1]
        logs = [np.log(self._own_directions(turns, alive, float(end))) for end in ends]
        n_own = float(np.exp(np.interp(share, ends, logs)))
        shape = self.frequency_hz.size / BIN_CORRELATION
        due = -np.log1p(-self.probability)
        known = np.log(n_own / -np.log1p(-DRAWN_SHARES[0]))  # -ln Q at the first share
        n_there = n_own
        for _ in range(GROWTH_ROUNDS):
            n_there = n_own * max(np.log(n_there / due) / known, 0.1) ** GROWTH
        return float(BIN_CORRELATION * gammainccinv(shape, min(due / n_there, 1.0)))

    def _own_directions(self, turns: Steering, alive: BoolArray, share: float) -> float:
        """Return how many directions noise with a share of isotropic noise fills."""
        from scipy.special import gammaincc

        key = hash(
            (
                self.array.places_m.tobytes(), self.array.sound_speed_mps,
                self.frequency_hz.tobytes(), self.grid.toward.tobytes(),
                alive.tobytes(), share,
            )
        )  # fmt: skip
        if key in _FILLED:
            return _FILLED[key]
        rng = np.random.default_rng(1)
        coherence = self.array.isotropic_coherence(self.frequency_hz)
        mixed = (1.0 - share) * np.eye(alive.size) + share * coherence
        root = np.linalg.cholesky(mixed).astype(np.complex64)
        best = []
        n_values = self.grid.n_beams * self.frequency_hz.size
        n_frames = int(np.clip(DRAWN_VALUES // n_values, *DRAWN_FRAMES))
        for _ in range(n_frames // DRAWN_AT_ONCE):
            size = (2, self.frequency_hz.size + 2, alive.size, DRAWN_AT_ONCE)
            real, imaginary = rng.standard_normal(size, np.float32)
            bins = real + 1j * imaginary
            # as Hann's window does
            windowed = bins[1:-1] - 0.5 * (bins[:-2] + bins[2:])
            best.append(self._best(self._heights(root @ windowed, turns, alive)[0]))
        shares = np.array(DRAWN_SHARES)
        height = np.quantile(np.concatenate(best), 1.0 - shares)
        shape = self.frequency_hz.size / BIN_CORRELATION
        chance = gammaincc(shape, height / BIN_CORRELATION)
        told = -np.log1p(-shares) / chance / np.array(FILLED_AT)
        filled = max(1.0, float(np.exp(np.log(told).mean())))
        if len(_FILLED) >= MOST_FILLED:
            _FILLED.clear()
        _FILLED[key] = filled
        return _FILLED[key]

    def _heights_across(self, white: _WhiteSound, turns: Steering, known: _Known) -> FloatArray:
        """Return the sum over the band across known sources, shape (beam, row)."""
        height = np.zeros((self.grid.n_beams, known.frame.size))
        share = np.zeros(height.shape)
        n_left = white.n_elements - known.n_sources
        for bins, heard, root in white.parts:
            leads = self._leads(bins, known.toward, white.places_m)
            sound = heard[:, :, known.frame].transpose(0, 2, 1)
            for source in range(known.n_sources):
                sound = _without_coherent(sound, leads[:, :, source], root)
            basis = _basis(leads, root)
            sound = _across(sound, basis)
            steered = turns[bins].conj() @ root.transpose(0, 2, 1)
            full = (np.abs(steered) ** 2).sum(axis=2)[:, :, None]
            left = full - sum(np.abs(steered.conj() @ one.transpose(0, 2, 1)) ** 2 for one in basis)
            pressure = steered.conj() @ sound.transpose(0, 2, 1)
            power = (np.abs(sound) ** 2).sum(axis=2)
            along = np.abs(pressure) ** 2 / np.maximum(left, 1e-6 * full)
            gain = along / np.maximum(power, np.finfo(np.float32).tiny)[:, None, :]
            height -= (n_left - 1.0) * _log_sum(1.0 - gain)
            share += (left / full).sum(axis=0)
        share /= self.frequency_hz.size
        return np.where(share > LEAST_ACROSS, height, 0.0)

    def _measured_together(
        self, sound: _WhiteSound, known: _Known, found: list[FoundDirections]
    ) -> _Known:
        """Measure every direction of some frames again, across the others of its frame.

        The rows of ``found``, one of each source, take what is measured.
        """
        toward = known.toward.copy()
        left = np.arange(known.frame.size)
        for _ in range(ROUNDS if len(found) > 1 else 1):
            far = np.zeros(left.size, np.bool_)
            for source, one in enumerate(found):
                others = _Known(known.frame[left], toward[left]).without(source)
                moved, covariance, snr = self._polished(sound, toward[left, source], others)
                way = np.square(moved - toward[left, source]).sum(axis=1)
                far |= way > STILL**2 * np.trace(covariance, axis1=1, axis2=2)
                toward[left, source] = moved
                rows = np.searchsorted(one.frame, known.frame[left])
                one.toward[rows], one.covariance[rows] = moved, covariance
                one.snr[rows] = snr
            left = left[far]
            if not left.size:
                break
        return _Known(known.frame, toward)

    def _measured(self, sound: _WhiteSound, height: FloatArray, known: _Known) -> FoundDirections:
        """Refine the maxima of some frames, list the lobes, state the deviations."""
        is_peak = self.grid.is_maximum(height)
        peak_beam, peak_row = np.nonzero(is_peak)
        around = np.concatenate([peak_beam[:, None], self.grid.neighbours[peak_beam]], axis=1)
        toward, top = self.grid.refine(peak_beam, height[around, peak_row[:, None]])
        n_left = sound.n_elements - known.n_sources
        best = np.full(known.frame.size, -np.inf)
        np.maximum.at(best, peak_row, top)
        gain = n_left / (n_left - 1.0) / BIN_CORRELATION
        weight = np.exp(np.minimum(gain * (top - best[peak_row]), 0.0))
        total = np.bincount(peak_row, weight, minlength=known.frame.size)
        weight /= total[peak_row]
        is_first = top == best[peak_row]
        order = np.flatnonzero(is_first)
        order = order[np.unique(peak_row[order], return_index=True)[1]]
        rows = peak_row[order]
        is_lobe = (weight >= LEAST_WEIGHT) & ~is_first
        best_toward, covariance, snr = self._polished(sound, toward[order], known.take(rows))
        lobe_frame = known.frame[peak_row[is_lobe]]
        return FoundDirections(
            frame=known.frame[rows],
            source=np.full(rows.size, known.n_sources),
            beam=peak_beam[order],
            toward=best_toward,
            covariance=covariance,
            snr=snr,
            lobes=DirectionLobes(
                frame=lobe_frame,
                source=np.full(lobe_frame.size, known.n_sources),
                toward=toward[is_lobe],
                weight=weight[is_lobe],
            ),
        )

    def _polished(
        self, white: _WhiteSound, toward: FloatArray, others: _Known
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Climb from beams' maxima to that of the likelihood, with its curvature."""
        for _ in range(SCORING_STEPS):
            moved, *_ = self._score(white, toward, others)
            length = np.linalg.norm(moved, axis=1)
            moved *= np.minimum(1.0, self.grid.step / np.maximum(length, 1e-12))[:, None]
            toward = toward + moved
            if not self.array.is_planar:
                toward = toward / np.linalg.norm(toward, axis=1)[:, None]
        _, covariance, snr = self._score(white, toward, others)
        return toward, covariance, snr

    def _leads(self, bins: slice, toward: FloatArray, places: FloatArray) -> NDArray[np.complex128]:
        """Return the phases of waves, shape (bin, ..., element)."""
        wave = 2.0 * np.pi * self.frequency_hz[bins]
        lead_s = toward @ places.T / self.array.sound_speed_mps
        return np.asarray(np.exp(1j * np.multiply.outer(wave, lead_s)))

    def _score(
        self, white: _WhiteSound, toward: FloatArray, others: _Known
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the step to the maximum, inverse information and ratio in the beam.

        All is taken across the steering vectors of the other sources, which leave N
        dimensions. The likelihood is -N sum n ln(1 - g), g the share of n bins together
        that the direction explains. Information of a bin is 2 S^2 / (1 + |w|^2 S) (|w|^2 d'd -
        |w'd|^2) / |w|^2 with w and d the whitened steering vector and its derivatives
        and S the signal over the noise at a hydrophone; bins count as independent ones.
        The likelihood itself, which knows neither, bends by 2 N / (N - 1) |w|^2 S.
        """
        frame, places = others.frame, white.places_m
        n_left = white.n_elements - others.n_sources
        score = np.zeros((frame.size, 3))
        information, curvature = np.zeros((2, frame.size, 3, 3))
        total = np.zeros(frame.size)
        for bins, heard, root in white.parts:
            wave = 2.0 * np.pi * self.frequency_hz[bins]
            turned = self._leads(bins, toward, places)  # bin, row, element
            basis = _basis(self._leads(bins, others.toward, places), root)
            first = _across(turned @ root.transpose(0, 2, 1), basis)
            slope = 1j * wave[:, None, None] / self.array.sound_speed_mps * turned
            slopes = np.stack(
                [
                    _across((slope * places[:, k]) @ root.transpose(0, 2, 1), basis)
                    for k in range(3)
                ],
                -1,
            )
            size = (np.abs(first) ** 2).sum(axis=2)
            sound = _across(heard[:, :, frame].transpose(0, 2, 1), basis)
            beam = (first.conj() * sound).sum(axis=2)
            power = np.maximum((np.abs(sound) ** 2).sum(axis=(0, 2)), 1e-30)
            along = np.abs(beam) ** 2 / size
            share = np.minimum(along.sum(axis=0) / power, 1.0 - 1e-6)
            ratio = np.maximum(n_left * share - 1.0, 0.0) / (1.0 - share)
            crossed = np.einsum("frm,frmk->frk", first.conj(), slopes)
            change = np.einsum("frmk,frm->frk", slopes.conj(), sound)
            change = 2.0 * (change * beam.conj()[..., None]).real
            change -= 2.0 * along[..., None] * crossed.real
            change = (change / size[..., None]).sum(axis=0)
            score += (n_left * wave.size / (power * (1.0 - share)))[:, None] * change
            inner = np.einsum("frmk,frml->frkl", slopes.conj(), slopes)
            outer = crossed[..., :, None].conj() * crossed[..., None, :]
            tensor = (inner.real - outer.real / size[..., None, None]) / size[..., None, None]
            weight = 2.0 * ratio**2 / (1.0 + ratio)
            information += weight[:, None, None] * tensor.sum(axis=0)
            bend = 2.0 * ratio * n_left / (n_left - 1.0)
            curvature += bend[:, None, None] * tensor.sum(axis=0)
            total += ratio * wave.size
        mean = total / self.frequency_hz.size
        covariance = _inverse(information / BIN_CORRELATION, toward, self.array)
        step = np.einsum("nij,nj->ni", _inverse(curvature, toward, self.array), score)
        return step, covariance, mean


def _basis(
    leads: NDArray[np.complex128], root: NDArray[np.complex64]
) -> list[NDArray[np.complex128]]:
    """Return unit vectors that span the whitened steering vectors of some sources.

    Of leads of shape (bin, row, source, element) one of shape (bin, row, element) each.
    """
    found: list[NDArray[np.complex128]] = []
    for source in range(leads.shape[2]):
        one = _across(leads[:, :, source] @ root.transpose(0, 2, 1), found)
        size = np.sqrt((np.abs(one) ** 2).sum(axis=2, keepdims=True))
        found.append(one / np.maximum(size, 1e-12))
    return found


def _across(vectors: NDArray[Any], basis: list[NDArray[np.complex128]]) -> NDArray[Any]:
    """Return what of vectors, shape (bin, row, element), lies across unit vectors."""
    for one in basis:
        vectors = vectors - one * (one.conj() * vectors).sum(axis=2, keepdims=True)
    return vectors


def _without_coherent(
    sound: NDArray[Any], leads: NDArray[np.complex128], root: NDArray[np.complex64]
) -> NDArray[Any]:
    """Return whitened spectra, shape (bin, row, element), without a source's sound.

    Its sound at each hydrophone is the sound of its beam times a factor that is the
    same in the few bins, once their phases are turned as for its direction.
    """
    (steered,) = _basis(leads[:, :, None], root)
    beam = (steered.conj() * sound).sum(axis=2)
    colour = np.linalg.inv(root)
    aligned = (sound @ colour.transpose(0, 2, 1)) * leads.conj()
    power = np.maximum((np.abs(beam) ** 2).sum(axis=0), 1e-30)
    factor = np.einsum("fr,frn->rn", beam.conj(), aligned) / power[:, None]
    aligned = aligned - beam[:, :, None] * factor
    return np.asarray((aligned * leads) @ root.transpose(0, 2, 1))


def _joined(found: list[FoundDirections], crowded: IntArray) -> FoundDirections:
    """Return the directions of all sources, those of a frame one after the other.

    Of crowded frames, which hold more sources than the hydrophones tell apart, those
    are left out that do not stand out.
    """
    whole = FoundDirections.join(found)
    lobes = DirectionLobes.join([each.lobes for each in found])
    order = np.lexsort([whole.source, whole.frame])
    clear = ~np.isin(whole.frame, crowded) | (whole.snr >= CLEAR_RATIO)
    whole = whole.take(order[clear[order]])
    kept = set(zip(whole.frame, whole.source, strict=True))
    owners = zip(lobes.frame, lobes.source, strict=True)
    is_kept = np.array([one in kept for one in owners], np.bool_)
    return replace(whole, lobes=lobes.take(is_kept))


def _inverse(information: FloatArray, toward: FloatArray, array: SpatialArray) -> FloatArray:
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


def bands_of(n_bins: int) -> list[slice]:
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
    for bins in bands_of(len(power)):
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
    root = _whitener(coherence, match[0] / max(match[1], 1e-9))
    return root @ equal, root, match


def _whitener(coherence: FloatArray, share: float) -> NDArray[np.complex64]:
    """Return what whitens noise with a share of isotropic noise."""
    share = min(max(share, 0.0), LARGEST_ISOTROPIC)
    noise = (1.0 - share) * np.eye(coherence.shape[1]) + share * coherence
    return np.asarray(np.linalg.inv(np.linalg.cholesky(noise)), np.complex64)


def _noise_products(
    sound: NDArray[Any], basis: list[NDArray[np.complex128]], coherence: FloatArray
) -> FloatArray:
    """Return products of the covariances of noise, shape (2, 3).

    Rows are independent and isotropic noise across the unit vectors; columns the same,
    and what is heard of each.
    """
    n_bins, n_rows, n_alive = sound.shape
    across: NDArray[Any] = np.broadcast_to(np.eye(n_alive), (n_bins, n_rows, n_alive, n_alive))
    for one in basis:
        across = across - one[..., :, None] * one[..., None, :].conj()
    heard = _across(sound, basis)
    kinds = (across, across @ coherence[:, None] @ across)
    return np.array(
        [
            [np.einsum("brij,brji->", one, other).real for other in kinds]
            + [np.einsum("bri,brij,brj->", heard.conj(), one, heard).real]
            for one in kinds
        ]
    )


def _isotropic_share(products: FloatArray) -> float:
    """Return the share of isotropic noise by least squares of `_noise_products`."""
    square, seen = products[:, :2], products[:, 2]
    ridge = 1e-9 * np.trace(square) * np.eye(2)
    alone, around = np.maximum(np.linalg.solve(square + ridge, seen), 0.0)
    return float(around / max(alone + around, 1e-12))


def _log_gain(heard: NDArray[np.complex64], steering: NDArray[np.complex64]) -> FloatArray:
    """Return -(N - 1) sum ln(1 - g) over a few bins, shape (beam, frame)."""
    n_alive = heard.shape[1]
    size = (steering.real**2 + steering.imag**2).sum(axis=2)
    pressure = steering.conj() @ heard
    power = (heard.real**2 + heard.imag**2).sum(axis=1)
    rest = np.square(pressure.real)
    rest += np.square(pressure.imag)
    rest /= size[:, :, None]
    rest /= np.maximum(power, np.finfo(np.float32).tiny)[:, None, :]
    np.subtract(np.float32(1.0), rest, out=rest)
    return np.asarray(-(n_alive - 1.0) * _log_sum(rest))


def _log_sum(rest: FloatArray) -> FloatArray:
    """Return the sum of logarithms over the first axis, of values of 1e-7 and more.

    Products of four, which single precision holds, take a quarter of the logarithms.
    """
    np.maximum(rest, np.float32(1e-7), out=rest)
    for _ in range(2):
        half = len(rest) // 2
        rest[:half] *= rest[half : 2 * half]
        rest = np.delete(rest, slice(half, 2 * half), axis=0)
    return np.asarray(np.log(rest).sum(axis=0))
