"""Coloured noise: its strength and correlation time, and the information it takes.

**Method.** Residuals are white noise (of known variance, or stronger) plus coloured
noise whose correlation falls exponentially (an Ornstein-Uhlenbeck process). Strengths
and correlation times are weighed by the restricted likelihood, which knows that the
fit has absorbed some of the coloured noise; the covariance is the mean over all that
are likely (uniform in their logarithms). A passage is short compared with the
correlation time, so the likeliest noise alone would promise too much: where the
coloured noise looks like the passage, little of it is left in the residuals.

The information is that of means over cells much shorter than the passage, with the
covariance of white and coloured noise. Differences within a cell are left out:
coloured noise is rough, so that a slope within a cell has little information. Sums
over cells and one small matrix stand for a matrix as large as the series is long.

What has inertia wanders smoothly: its covariance is that of Matern with the order 3/2,
whose course has a slope at every instant. It is tried beside the other where one asks
whether a machine or a passage has moved the frequencies.

**Conventions.** One series; residuals, shape (n,), have the precision of the white part,
an inverse variance, zero where a value is missing; time in seconds. The width is range
over speed in seconds: the time that matters to a passage.

**References.** Patterson and Thompson (1971), Biometrika 58, 545 (REML);
Rasmussen and Williams (2006), Gaussian Processes, eq. 4.17 (Matern's covariance).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.least_squares import orthonormal
from uwtrack_cli.estimation.row_offsets import Design, padded

N_CORRELATION_TIMES = 7
FEWEST_CELLS, MOST_CELLS = 60, 160
MOST_SPECTRA = 4
"""Sets of spectra of coloured noise that are kept: those of the three kinds of one
contact, of its frequencies rough and smooth."""

FEWEST_MORE = 8
"""Measurements beyond what is free without which nothing can be told."""

CELLS_PER_WIDTH = 12.0
"""Noise that forgets within such a share of d/v acts as white noise."""

SMALLEST_WIDENING = 1.1
"""Factor on a variance, in the worst direction of the design, from which coloured noise
is not taken for white."""

SMALLEST_SHARE = 1e-2
"""Part of the coloured variance below which a correlation time is left out."""

SMALLEST_GAIN = 2.0
"""Gain in log-likelihood below which the noise counts as white."""


MOST_PRODUCTS = 2e5
"""Products of columns of all rivals that are held at once."""

STRENGTHS = np.geomspace(1e-3, 1e6, 46)
"""Strengths of coloured noise to try, over the white noise of a cell."""

FINE_STRENGTHS = np.geomspace(0.62, 1.6, 9)
"""Strengths to try beside the best of every second of them, over it."""


@dataclass(frozen=True)
class ColouredNoise:
    """Variances and correlation times of coloured noise, inflation of the white part.

    The covariance is ``inflation`` times (white + the sum of ``variance`` times
    exponential), one for each correlation time.
    """

    variance: FloatArray
    """Variances of the exponential parts, shape (parts,)."""
    correlation_time_s: FloatArray
    """Their correlation times, s, shape (parts,)."""
    inflation: float = 1.0
    """Factor on the whole covariance, one or more."""

    @property
    def is_white(self) -> bool:
        """Whether the noise is as expected: white and not stronger."""
        return not self.variance.size and self.inflation <= 1


NO_COLOUR = np.empty(0)
WHITE = ColouredNoise(NO_COLOUR, NO_COLOUR)


def fit_coloured_noise(
    residual: FloatArray,
    precision: FloatArray,
    time_s: FloatArray,
    design: FloatArray,
    width_s: float,
    others: tuple[FloatArray, FloatArray],
) -> ColouredNoise:
    """Find strength and correlation time of coloured noise in the residuals of a fit.

    ``design`` are the partials of the model that was fitted, shape (n, p): what it
    could absorb. What other measurements hold in place, it cannot: their information
    enters as ``others``, values and rows of the design (unit variance).

    Notes
    -----
    With C = V + s^2 K(tau) the restricted log-likelihood is
    -(ln|C| + ln|X' C^-1 X| + e' P e) / 2; V whitens, and the eigenvectors of K give it
    for every s^2 at once.
    """
    if _too_few(precision, design.shape[1]):
        return WHITE
    free = Design.free(design)
    value, columns, size, time = _cells(residual, precision, time_s, free, width_s)
    columns = np.concatenate([columns, others[1]])
    basis = orthonormal(columns)
    value = np.concatenate([value, others[0]])
    freedom = value.size - basis.shape[1]
    plain, inflated, inflation = _white_likelihood(value, basis, freedom)
    variances = _variances(size)
    correlation_times, values, vectors = _spectra(size, time)
    likelihood, inflations = _likelihood(
        _turn(vectors, value[None, :, None])[:, 0, :, 0],
        _turn(vectors, basis[None])[:, 0],
        padded(values, value.size),
        variances,
        freedom,
    )
    behind = likelihood.max() - likelihood
    chance = np.exp(-behind) / np.exp(-behind).sum()
    inner = float((chance * inflations).sum())
    strength = (chance * inflations) @ variances / inner
    kept = strength > SMALLEST_SHARE * strength.sum()
    noise = ColouredNoise(strength[kept], correlation_times[kept], inner)
    if _matters(noise, size, time, basis):
        return noise
    if inflated <= plain + SMALLEST_GAIN:
        return WHITE
    return ColouredNoise(NO_COLOUR, NO_COLOUR, inflation)


def _matters(noise: ColouredNoise, root: FloatArray, time: FloatArray, basis: FloatArray) -> bool:
    """Return whether coloured noise widens what the design determines."""
    lag = np.abs(time[:, None] - time[None, :])
    kernel = np.zeros_like(lag)
    for variance, memory_s in zip(noise.variance, noise.correlation_time_s, strict=True):
        kernel += variance * np.exp(-lag / memory_s)
    covariance = np.eye(root.size) + root[:, None] * kernel * root
    own, others = basis[: root.size], basis[root.size :]
    information = own.T @ np.linalg.solve(covariance, own) + others.T @ others
    least = float(np.linalg.eigvalsh(information)[0])
    return least * SMALLEST_WIDENING < 1.0


def _variances(root: FloatArray) -> FloatArray:
    """Strengths of coloured noise to try, beside that of the white noise of a cell."""
    return np.asarray(np.mean(root**-2.0) * STRENGTHS)


def _turn(vectors: FloatArray, rows: FloatArray) -> FloatArray:
    """Turn rows of series into the eigenvectors of each correlation time; others stay.

    Rows of shape (series, n + others, p) give results of shape (times, series, same).
    """
    count = vectors.shape[-1]
    turned = vectors.swapaxes(-1, -2)[:, None] @ rows[:, :count]
    others = np.broadcast_to(rows[:, count:], (len(vectors), *rows[:, count:].shape))
    return np.concatenate([turned, others], axis=-2)


def coloured_likelihoods(
    series: list[tuple[FloatArray, Design]],
    precision: FloatArray,
    time_s: FloatArray,
    width_s: float,
    *,
    smooth: bool = False,
) -> FloatArray:
    """Return the best log-likelihood of rival readings of one series.

    As `likelihoods_by_noise`: every reading may have coloured noise of its own strength
    and correlation time, so that a drift is not taken for a signal.
    """
    by_noise = likelihoods_by_noise(series, precision, time_s, width_s, smooth=smooth)
    return np.asarray(by_noise.max(axis=0))


def likelihoods_by_noise(
    series: list[tuple[FloatArray, Design]],
    precision: FloatArray,
    time_s: FloatArray,
    width_s: float,
    *,
    smooth: bool = False,
) -> FloatArray:
    """Return the best log-likelihoods with white noise, and with coloured noise, too.

    For each reading the residuals (n,) and the columns that are free or known in part; coloured
    noise may have a slope at every instant where it may be ``smooth``: that is as likely
    as the other beforehand. White noise first, shape (2, readings); zeros where there is
    too little to tell.
    """
    if any(_too_few(precision, columns.n_free) for _, columns in series):
        return np.zeros((2, len(series)))
    cells = [_cells(e, precision, time_s, x, width_s) for e, x in series]
    root, time = cells[0][2:]
    rivals = [(value, orthonormal(columns)) for value, columns, _, _ in cells]
    white = np.array([_white_likelihood(e, x, None)[1] for e, x in rivals])
    best = np.full((1 + smooth, white.size), -np.inf)
    groups = list(_alike(rivals))
    for kind, of_kind in enumerate(best):
        _, values, vectors = _spectra(root, time, smooth=kind > 0)
        for rows, value, columns in groups:
            turned = _turn(vectors, value[..., None])[..., 0], _turn(vectors, columns)
            eigen = padded(values, value.shape[-1])[:, None]
            found = _best_variance(*turned, eigen, root)[0]
            of_kind[rows] = found.max(axis=0)
    mean = np.logaddexp.reduce(best, axis=0) - np.log(len(best))
    return np.stack([white, mean])


def _alike(
    rivals: list[tuple[FloatArray, FloatArray]],
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Yield rivals with as many columns together, as far as they fit into the memory.

    Rows, values of shape (rivals, n) and columns of shape (rivals, n, p).
    """
    width = np.array([columns.shape[1] for _, columns in rivals])
    for p in np.unique(width):
        rows = np.flatnonzero(width == p)
        each = N_CORRELATION_TIMES * rivals[0][0].size * max(p, 1) ** 2
        most = max(1, int(MOST_PRODUCTS / each))
        for first in range(0, rows.size, most):
            part = rows[first : first + most]
            yield (
                part, np.stack([rivals[k][0] for k in part]),
                np.stack([rivals[k][1] for k in part]),
            )  # fmt: skip


def gains_of_shapes(
    residual: FloatArray,
    columns: Design,
    shapes: FloatArray,
    precision: FloatArray,
    time_s: FloatArray,
    width_s: float,
    *,
    with_coloured_noise: bool,
    smooth: bool = False,
) -> FloatArray:
    """Return what shapes of given sizes gain beside a reading, in its own noise.

    Beside residuals and the columns of a reading, shapes (n, shapes) are tried; the noise is
    white, or the reading's best coloured one, ``smooth`` ones among them. Gains in log-likelihood, shape (shapes,);
    zeros where there is too little to tell.
    """
    if _too_few(precision, columns.n_free):
        return np.zeros(shapes.shape[1])
    whole = columns.beside(*shapes.T)
    value, both, root, time = _cells(residual, precision, time_s, whole, width_s)
    free, more = np.split(both, [columns.known.size], axis=1)
    free = orthonormal(free)
    weight = np.ones(value.size)
    if with_coloured_noise:
        kinds = [_spectra(root, time, smooth=kind) for kind in (False, True)[: 1 + smooth]]
        values, vectors = (np.concatenate([one[k] for one in kinds]) for k in (1, 2))
        every, values = np.column_stack([value, free]), padded(values, value.size)
        turned = _turn(vectors, every[None])[:, 0]
        found, variance = _best_variance(turned[..., 0], turned[..., 1:], values, root)
        best = int(np.argmax(found))
        value, free = turned[best, :, 0], turned[best, :, 1:]
        more = _turn(vectors[best : best + 1], more[None])[0, 0]
        weight = 1 / (1 + variance[best] * values[best])
    scale = np.sqrt(weight)
    free = orthonormal(free * scale[:, None])
    value, more = value * scale, more * scale[:, None]
    value = value - free @ (free.T @ value)
    more = more - free @ (free.T @ more)
    inflation = max(float(value @ value) / value.size, 1.0)
    return np.asarray((value @ more - 0.5 * (more**2).sum(axis=0)) / inflation)


def _too_few(precision: FloatArray, n_free: int) -> bool:
    """Return whether so many free columns leave too little of the measurements."""
    return bool(np.count_nonzero(precision > 0) < n_free + FEWEST_MORE)


def _cells(
    residual: FloatArray, precision: FloatArray, time_s: FloatArray, design: Design, width_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Whitened means of cells of measurements: value, design, root size, time.

    Under value and design stand the rows of what is known of the design.
    """
    used = np.flatnonzero(precision > 0)
    wanted = CELLS_PER_WIDTH * float(np.ptp(time_s)) / width_s
    count = int(np.clip(wanted, FEWEST_CELLS, MOST_CELLS))
    starts = np.unique(np.linspace(0, used.size, count, endpoint=False).astype(int))
    weight = precision[used]
    size = np.add.reduceat(weight, starts)
    root = np.sqrt(size)
    value = np.add.reduceat(weight * residual[used], starts) / root
    columns = np.add.reduceat(weight[:, None] * design.columns[used], starts, axis=0)
    columns = Design(columns / size[:, None], design.known).rows(root)
    time = np.add.reduceat(weight * time_s[used], starts) / size
    return padded(value, len(columns)), columns, root, time


def _white_likelihood(
    value: FloatArray, columns: FloatArray, freedom: int | None
) -> tuple[float, float, float]:
    """Log-likelihood of white noise as expected, and with its best inflation."""
    left = value - columns @ (columns.T @ value)
    square = np.array([left @ left])
    likelihood, inflation = _with_inflation(square, value.size, freedom)
    return float(-0.5 * square[0]), float(likelihood[0]), float(inflation[0])


def _with_inflation(
    square: FloatArray, size: int, freedom: int | None
) -> tuple[FloatArray, FloatArray]:
    """Maximise over a common factor of the covariance that is not below one."""
    count = size if freedom is None else freedom
    inflation = np.maximum(square / count, 1.0)
    return -0.5 * (square / inflation + count * np.log(inflation)), inflation


def _spectra(
    root: FloatArray, time: FloatArray, *, smooth: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return correlation times with eigenvalues and vectors of the coloured noise.

    They are relative to the white noise of cells of a root size: shapes (times,),
    (times, n) and (times, n, n).
    """
    return _spectra_of(root.tobytes(), time.tobytes(), smooth=smooth)


@lru_cache(maxsize=MOST_SPECTRA)
def _spectra_of(
    root_bytes: bytes, time_bytes: bytes, *, smooth: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the spectra once for all readings of a series: they take most of the time."""
    root, time = np.frombuffer(root_bytes), np.frombuffer(time_bytes)
    span = float(time[-1] - time[0])
    step = span / max(time.size - 1, 1)
    each = np.geomspace(2 * step, max(span, 3 * step), N_CORRELATION_TIMES)
    lag = np.abs(time[:, None] - time[None, :]) / each[:, None, None]
    if smooth:
        lag *= np.sqrt(3.0)
    kernel = np.exp(-lag)
    if smooth:
        kernel *= 1.0 + lag
    values, vectors = np.linalg.eigh(root[:, None] * kernel * root[None, :])
    return each, np.maximum(values, 0.0), vectors


def _best_variance(
    turned: FloatArray, design: FloatArray, values: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maximise the likelihood over the variances; and where.

    Of several correlation times and series with as many columns: values of shape (..., n)
    and columns of shape (..., n, p) give results of shape (...).
    """
    variances = _variances(root)[::2]
    likelihood = _likelihood(turned, design, values, variances, None)[0]
    middle = np.argmax(likelihood, axis=-1)
    fine = variances[middle][..., None] * FINE_STRENGTHS
    likelihood = _likelihood(turned, design, values, fine, None)[0]
    best = np.argmax(likelihood, axis=-1)[..., None]
    return (
        np.take_along_axis(likelihood, best, axis=-1)[..., 0],
        np.take_along_axis(fine, best, axis=-1)[..., 0],
    )


def _likelihood(
    value: FloatArray,
    design: FloatArray,
    eigen: FloatArray,
    variances: FloatArray,
    freedom: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return log-likelihood and inflation for every variance, shape (..., variances).

    Values of shape (..., n), columns of shape (..., n, p), eigenvalues of a shape that
    goes with those of the values, variances of shape (variances,) or (..., variances).
    """
    spread = 1 + variances[..., None] * eigen[..., None, :]
    weight = 1 / spread
    # the products of the columns are the same for every variance
    size, p = design.shape[-2:]
    products = design[..., :, None] * design[..., None, :]
    normal = weight @ products.reshape(*design.shape[:-2], size, p * p)
    normal = normal.reshape(*normal.shape[:-1], p, p)
    right = weight @ (design * value[..., None])
    solved = np.linalg.solve(normal, right[..., None])[..., 0]
    square = (weight @ (value**2)[..., None])[..., 0]
    square = square - (right * solved).sum(axis=-1)
    likelihood, inflation = _with_inflation(square, size, freedom)
    likelihood = likelihood - 0.5 * np.log(spread).sum(axis=-1)
    if freedom is not None:
        likelihood = likelihood - 0.5 * np.linalg.slogdet(normal)[1]
    return likelihood, inflation


MOST_INFORMATION_CELLS = 600
"""Cells of a long series: instants a few times as many lose less than 3 % (a test)."""


@dataclass(frozen=True)
class InformationLoss:
    """Inverse covariance of the white noise less that of white and coloured noise.

    With the coloured parts as unknowns of their own, whose prior precision has a narrow
    band (they are Markov processes), a product costs a few operations per cell.
    """

    weight: FloatArray
    """Inverse variances of the white part, shape (n,)."""
    starts: IntArray
    """First instants of the cells, shape (cells,)."""
    size: FloatArray
    """Sums of the weights of the cells, shape (cells,)."""
    factor: FloatArray
    """Banded Cholesky factor (upper form) of the posterior precision of the coloured
    parts, cell by cell, shape (parts + 1, cells times parts); empty without parts."""
    inflation: float
    """Factor on the whole covariance."""

    def times(self, rows: FloatArray) -> FloatArray:
        """Multiply rows, shape (..., n), by the loss."""
        weighted = rows * self.weight
        sums = np.add.reduceat(weighted, self.starts, axis=-1)
        kept = (sums / self.size - self._coloured(sums)) / self.inflation
        lengths = np.diff(self.starts, append=self.weight.size)
        return weighted - self.weight * np.repeat(kept, lengths, axis=-1)

    def _coloured(self, sums: FloatArray) -> FloatArray:
        """Return the coloured noise that sums of weighted rows over cells tell of."""
        from scipy.linalg.lapack import dpbtrs

        n_parts = self.factor.shape[1] // self.size.size
        if not n_parts:
            return np.zeros_like(sums)
        right = np.repeat(sums.reshape(-1, self.size.size), n_parts, axis=1)
        solved, _ = dpbtrs(self.factor, np.asfortranarray(right.T))
        parts = solved.T.reshape(*sums.shape, n_parts)
        return np.asarray(parts.sum(axis=-1))


def information_loss(
    weight: FloatArray, time_s: FloatArray, noise: ColouredNoise
) -> InformationLoss:
    """Find what coloured noise takes from the information of a series.

    Weights are inverse variances of the white part, shape (n,); zero is missing.

    Notes
    -----
    With C = V + A K A', V the variances of the cells' means, K the covariance of the
    parts and A their sum, C^-1 = V^-1 - V^-1 A (K^-1 + A' V^-1 A)^-1 A' V^-1 (Woodbury);
    K^-1 of a process whose correlation falls exponentially is tridiagonal.
    """
    from scipy.linalg.lapack import dpbtrf

    used = np.flatnonzero(weight > 0)
    count = min(used.size, MOST_INFORMATION_CELLS)
    starts = used[np.linspace(0, used.size, count, endpoint=False).astype(int)]
    starts[:1] = 0
    size = np.add.reduceat(weight, starts)
    time = np.add.reduceat(weight * time_s, starts) / size
    n_parts = noise.variance.size
    band = np.zeros((n_parts + 1, n_parts * size.size))
    # row u - k of the upper form holds the diagonal k places above the main one
    for above in range(n_parts):
        band[n_parts - above] = np.repeat(size, n_parts)
        places = np.arange(above)  # the first ones would couple with the cell before
        band[n_parts - above].reshape(-1, n_parts)[:, places] = 0.0
    if n_parts:
        step = np.diff(time)[:, None]
        rho = np.exp(-step / noise.correlation_time_s)
        gain = 1 / (noise.variance * -np.expm1(-2 * step / noise.correlation_time_s))
        diagonal = np.tile(1 / noise.variance, (size.size, 1))
        diagonal[:-1] += gain * rho**2
        diagonal[1:] += gain - 1 / noise.variance
        band[n_parts] += diagonal.ravel()
        band[0, n_parts:] = -(gain * rho).ravel()
        band, _ = dpbtrf(band)
    return InformationLoss(weight, starts, size, band, noise.inflation)
