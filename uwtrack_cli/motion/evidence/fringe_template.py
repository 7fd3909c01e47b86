"""How likely an image of fringes is under a passage, whatever the pattern looks like.

**Method.** A row of the image is a smooth course of its own, what stays in each cell,
and the pattern of the closest approach, shifted along log frequency and fading as the
vessel goes away. The pattern is free: a spline whose coefficients have a normal prior, its
variance and the distance of its knots found from the data. All of these enter linearly:
they are integrated out exactly, together, so that what takes a row's course away takes
nothing of the pattern with it. The log of the probability that is left depends on the
passage alone, and its curvature at the maximum is its precision.

**Conventions.** Times count as heard; the law is that of the time of emission: the sound
that arrives at t left at t - R/c, and its pattern is that of the range then. The shift is
the waveguide invariant times ln(R / R0). Several vessels' patterns add.

**References.** Chuprov (1982); D'Spain and Kuperman, JASA 106, 2454 (1999), for the
invariant; Rasmussen and Williams (2006), section 2.7, for what is integrated out.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.evidence.fringe_panel import Panel

UNKNOWNS = {
    "time_s": 1e-3, "width_s": 1e-3, "fading": 1e-2, "invariant": 1e-3, "mach": 1e-4,
    "tilt": 1e-2,
}  # fmt: skip
"""What is asked of a passage, with a small step of each: time in R/v, logarithms of R/v
and of the fading, the invariant, speed over that of sound, and the tilt."""

CONTRAST_STD = 0.35
"""Deviation of a row's own contrast, as a share: a sea that swings by 1.5 dB hides more or
less of the pattern."""

SATURATION = (1.0, 0.5)
"""What the logarithm of vessel and sea bends by, over half of what that of a vessel which
has one ratio to the sea in all cells does; and its deviation."""

OWN_BEND = 0.1
"""Deviation of what the spectrum of a vessel bends by over that of the sea, beside level and
slope, nepers: it rises and falls with her, in place."""

FOUR = np.arange(4)
"""Coefficients of a cubic spline that make a value."""


ROW_ORDER, FREE_ORDER = 4, 1
"""Order of the polynomial over log frequency that a row has of its own, and up to which it
is free: level and slope. What rain, a squall or the vessel's own spectrum bend within some
octaves beside them has the prior variance `Panel.bend`."""


class Hypothesis(NamedTuple):
    """A straight passage as fringes see it."""

    time_s: float
    """Closest approach, when it was, not when it is heard, s."""
    width_s: float
    """Slant range over speed there, s."""
    invariant: float = 1.0
    """Waveguide invariant; 1 for a mirror."""
    fading: float = 0.4
    """How the contrast falls: by 1 / (1 + fading ((t - t0) / w)^2)."""
    mach: float = 0.0037
    """Speed over that of sound."""
    tilt: float = 0.0
    """How the logarithm of the contrast grows with that of frequency: a vessel's spectrum
    slopes otherwise than the sea's, and where she is fainter, so is the pattern."""
    course: tuple[FloatArray, FloatArray] | None = None
    """Contrast at times, s, instead of one that fades; None for that of a passage."""
    swing: tuple[FloatArray, FloatArray] | None = None
    """Shift of the logarithm of frequency at times, s, instead of that of a passage."""

    def changed(self, name: str, by: float) -> "Hypothesis":
        """Return the passage with one of its unknowns changed; R/v and fading by e^by."""
        value = float(getattr(self, name))
        is_log = name in {"width_s", "fading"}
        new: dict[str, Any] = {name: value * np.exp(by) if is_log else value + by}
        return self._replace(**new)


class Template(NamedTuple):
    """Prior of a pattern."""

    knots: float
    """Distance of the knots of its spline, cells."""
    variance: float
    """Variance of its coefficients, nepers^2."""


def _solve(root: FloatArray, right: FloatArray, *, upper: bool = False) -> FloatArray:
    """Solve the triangular system of a lower root, or of its transpose."""
    from scipy.linalg import solve_triangular

    return np.asarray(
        solve_triangular(root, right, lower=True, trans="T" if upper else "N", check_finite=False)
    )


def smooth_courses(weight: FloatArray) -> FloatArray:
    """Return the smooth courses of a row, of unit weight and independent of each other.

    ``weight``: precision of each cell. Shape (course, cell).
    """
    bent = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, weight.size), ROW_ORDER)
    unit = np.linalg.qr(bent * np.sqrt(weight)[:, None])[0]
    return np.asarray(unit.T / np.sqrt(weight))


def course_shares(bend: float) -> FloatArray:
    """Return which share of each smooth course a row is taken to have of its own.

    ``bend``: prior variance of those that are not free, over that of noise.
    """
    share = np.full(ROW_ORDER + 1, bend / (1.0 + bend))
    share[: FREE_ORDER + 1] = 1.0
    return share


class Shape(NamedTuple):
    """A pattern as it was found: what a passage is linearised about."""

    pattern: FloatArray
    """Coefficients of its spline."""
    lowest: int
    """Place of the first of them, in knots."""


class Explained(NamedTuple):
    """What the linear unknowns are, given the passages."""

    log_likelihood: float
    """Log of the probability density of the image."""
    pattern: list[FloatArray]
    """Coefficients of each template."""
    lowest: list[int]
    """Place of the first coefficient of each, in knots."""
    contrast: FloatArray
    """Contrast of each row by itself, as a share above that of the law; empty without a
    shape."""
    residual: FloatArray
    """What is left, the course of each row taken off, shape (row, cell)."""


def relative_range(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return the range over that of the closest approach, of what arrives at times."""
    lag, mach = (time_s - passage.time_s) / passage.width_s, passage.mach
    root = np.sqrt((mach * lag) ** 2 + (1.0 - mach**2) * (1.0 + lag**2))
    return np.asarray((root - mach * lag) / (1.0 - mach**2))


def shift_of(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return by how much the logarithm of a pattern's frequencies has moved."""
    if passage.swing is not None:
        return np.asarray(np.interp(time_s, *passage.swing))
    return passage.invariant * np.log(relative_range(time_s, passage))


def contrast_of(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return the contrast of the pattern over that at the closest approach."""
    if passage.course is not None:
        return np.asarray(np.interp(time_s, *passage.course))
    range_2 = relative_range(time_s, passage) ** 2
    return np.asarray(1.0 / (1.0 + passage.fading * (range_2 - 1.0)))


class _Bent(NamedTuple):
    """What a passage shows of a pattern, and what of it changes with the unknowns."""

    shown: FloatArray
    """The pattern in the cells of each row, shape (row, cell)."""
    saturated: FloatArray
    """What it has more where the vessel is louder than the sea, shape (row, cell)."""
    slopes: FloatArray
    """Its derivatives by the unknowns, shape (unknown, row, cell)."""


class _Spline(NamedTuple):
    """Where each cell of each row lies on a template."""

    first: IntArray
    """First of its four coefficients, shape (row, cell)."""
    weight: FloatArray
    """Their weights, shape (row, cell, 4)."""
    size: int
    """Coefficients of the template."""
    lowest: int
    """Place of the first of them, in knots."""

    def values(self, pattern: FloatArray) -> FloatArray:
        """Return the pattern in every cell, shape (row, cell)."""
        parts = (self.weight[:, :, k] * pattern[self.first + k] for k in range(4))
        return np.asarray(sum(parts))


def _spline(
    time_s: FloatArray, cells: FloatArray, cell: float, knots: float,
    passage: Hypothesis, count: int, lowest: int | None = None,
) -> _Spline:  # fmt: skip
    """Return the cubic spline of a template in the cells of each row.

    ``count``: cells of the band, about whose middle a pattern is tilted.
    """
    shift = shift_of(time_s, passage) / cell
    place = (cells - shift[:, None]) / knots
    low = int(np.floor(place.min())) - 1 if lowest is None else lowest
    place = place - low
    whole = np.floor(place).astype(np.int64)
    x = place - whole
    y = 1.0 - x
    weight = np.stack(
        [y**3 / 6.0, 2.0 / 3.0 - x * x * (1.0 - 0.5 * x),
         2.0 / 3.0 - y * y * (1.0 - 0.5 * y), x**3 / 6.0], axis=2,
    )  # fmt: skip
    weight *= contrast_of(time_s, passage)[:, None, None]
    weight *= np.exp(passage.tilt * (cell * (cells - 0.5 * count)))[:, None]
    return _Spline(whole - 1, weight, int(whole.max()) + 3, low)


def _bent(panel: Panel, template: Template, passage: Hypothesis, shape: Shape) -> _Bent:
    """Return what a passage shows of a pattern that was found."""
    cells = np.arange(panel.precision.size)
    shift = shift_of(panel.time_s, passage)
    place = (cells - shift[:, None] / panel.cell) / template.knots - shape.lowest
    whole = np.floor(place).astype(np.int64)
    x = place - whole
    y = 1.0 - x
    padded = np.concatenate([np.zeros(8), shape.pattern, np.zeros(8)])
    first = np.clip(whole - 1 + 8, 0, padded.size - 4)
    a, b, c, d = (padded[first + k] for k in range(4))
    height = (a * y**3 + d * x**3) / 6.0
    height += b * (2.0 / 3.0 - x * x * (1.0 - 0.5 * x))
    height += c * (2.0 / 3.0 - y * y * (1.0 - 0.5 * y))
    slope = 0.5 * (d * x * x - a * y * y)
    slope += b * x * (1.5 * x - 2.0) - c * y * (1.5 * y - 2.0)
    slope /= -panel.cell * template.knots
    # a pattern that is tilted is one in its place
    above = panel.cell * (cells - 0.5 * cells.size)
    grown = np.exp(passage.tilt * above)
    height, slope = height * grown, slope * grown
    contrast = contrast_of(panel.time_s, passage)
    moved, faded = [], []
    for name, step in UNKNOWNS.items():
        size = step * passage.width_s if name == "time_s" else step
        ends = [passage.changed(name, sign * size) for sign in (0.5, -0.5)]
        up, down = (shift_of(panel.time_s, end) for end in ends)
        moved.append((up - down) / step)
        up, down = (contrast_of(panel.time_s, end) for end in ends)
        faded.append((up - down) / step)
    slopes = (contrast * np.array(moved))[:, :, None] * slope
    slopes += np.array(faded)[:, :, None] * height
    slopes[list(UNKNOWNS).index("tilt")] = contrast[:, None] * height * above
    extra = (0.5 * contrast * (1.0 - contrast))[:, None] * height**2
    return _Bent(contrast[:, None] * height, extra, slopes)


class FringeModel:
    """The image of some rows, of which passages are asked.

    ``panel``: the rows. ``templates``: prior of the pattern of each vessel. ``shape``: the
    first one's pattern, of which each row then has a contrast of its own, and the louder
    ones more than the law of a faint vessel says; None leaves that out.
    """

    def __init__(
        self, panel: Panel, templates: Sequence[Template], shape: Shape | None = None
    ) -> None:
        self.panel, self.templates, self.shape = panel, list(templates), shape
        self._weight = panel.precision
        self._cells = np.arange(self._weight.size, dtype=float)
        self._line = smooth_courses(self._weight)
        self._share = course_shares(panel.bend)
        self._given = panel.value - panel.value.mean(axis=0, dtype=float)
        self._value = self._free(self._given)
        self._square = float((self._given * self._value * self._weight).sum())
        n_rows = len(self._value)
        independent = self._value.size - (FREE_ORDER + 1) * n_rows
        self._logs = 0.5 * (
            n_rows * float(np.log(self._weight).sum())
            - independent * float(np.log(2.0 * np.pi))
            - (n_rows - 1) * (ROW_ORDER - FREE_ORDER) * float(np.log1p(panel.bend))
        )

    def _free(self, values: FloatArray) -> FloatArray:
        """Take what is likely the course of each row off, and what stays in each cell.

        A product of this with what it was taken from is one of both free of it.
        """
        part = (values * self._weight) @ self._line.T * self._share
        values = values - part @ self._line
        return np.asarray(values - values.mean(axis=-2, keepdims=True))

    def log_likelihood(self, passages: Sequence[Hypothesis]) -> float:
        """Return the log of the probability density of the image, nepers."""
        return self._solved(passages).log_likelihood

    def explain(self, passages: Sequence[Hypothesis]) -> Explained:
        """Return the likeliest patterns, and what they leave."""
        solved = self._solved(passages)
        pattern = solved.unknowns
        whole, at = np.zeros_like(self._value), 0
        parts = []
        for spline in solved.splines:
            parts.append(pattern[at : at + spline.size])
            whole += spline.values(parts[-1])
            at += spline.size
        contrast: FloatArray = np.zeros(0)
        if solved.bent is not None:
            contrast = pattern[at : at + len(self._value)]
            at += contrast.size
            whole += contrast[:, None] * solved.bent.shown
            whole += (SATURATION[0] + pattern[-1]) * solved.bent.saturated
        if passages:
            own = self._spectrum(passages[0])
            whole += np.tensordot(pattern[at : at + len(own)], own, 1)
        lowest = [spline.lowest for spline in solved.splines]
        return Explained(
            solved.log_likelihood, parts, lowest, contrast, self._value - self._free(whole)
        )

    def _spectrum(self, passage: Hypothesis) -> FloatArray:
        """Return what a vessel's spectrum may bend rows by, shape (order, row, cell).

        In parts of unit prior variance.
        """
        bent = self._line[FREE_ORDER + 1 :, None, :]
        own = contrast_of(self.panel.time_s, passage)[None, :, None]
        return np.asarray(OWN_BEND * np.sqrt(self._weight.sum()) * own * bent)

    def along(self, pattern: FloatArray) -> tuple[FloatArray, float]:
        """Return what rows tell of how much each has of a pattern in place.

        Its measurement times its precision, shape (row,), and that precision.
        """
        heavy = pattern * self._weight
        smooth = self._line @ heavy
        told = float(pattern @ heavy - self._share @ smooth**2)
        return self._value @ heavy, told

    def step(
        self, passage: Hypothesis, precision: FloatArray, mean: FloatArray
    ) -> tuple[FloatArray, FloatArray, Shape]:
        """Return by how much the unknowns of a passage are off, and their covariance.

        One step of Gauss and Newton about the shape, with every linear unknown in it, and
        the pattern that belongs to it.

        Parameters
        ----------
        passage
            Where the shape was found.
        precision, mean
            Of the prior of what each of `UNKNOWNS` is off by; a precision of infinity
            holds one where it is.
        """
        solved = self._solved([passage], precision, mean)
        free = np.flatnonzero(np.isfinite(precision))
        moved, covariance = np.zeros(mean.size), np.zeros((mean.size, mean.size))
        moved[free] = solved.unknowns[-free.size :]
        unit = np.eye(len(solved.root))[:, -free.size :]
        half = _solve(solved.root, unit)
        covariance[np.ix_(free, free)] = half.T @ half
        (spline,) = solved.splines
        return moved, covariance, Shape(solved.unknowns[: spline.size], spline.lowest)

    def _solved(
        self,
        passages: Sequence[Hypothesis],
        precision: FloatArray | None = None,
        mean: FloatArray | None = None,
    ) -> "_Solved":
        """Integrate the linear unknowns out.

        They are the coefficients of the patterns, and with a shape the contrast of each
        row, saturation, and what is asked of the passage (where it has a ``precision``).
        """
        places = zip(passages, self.templates, strict=True)
        splines = [
            _spline(self.panel.time_s, self._cells, self.panel.cell, t.knots, p, self._cells.size)
            for p, t in places
        ]
        if not splines:
            told = self._logs - 0.5 * self._square
            return _Solved(told, np.zeros((0, 0)), np.zeros(0), splines, None)
        prior = np.concatenate(
            [np.full(s.size, 1.0 / t.variance)
             for s, t in zip(splines, self.templates, strict=True)]
        )  # fmt: skip
        bent, value, given = None, self._value, self._given
        offset: FloatArray = np.zeros(0)
        images = self._spectrum(passages[0])
        spectrum = np.ones(len(images))
        if self.shape is None:
            prior = np.concatenate([prior, spectrum])
        else:
            bent = _bent(self.panel, self.templates[0], passages[0], self.shape)
            images = np.concatenate([images, bent.saturated[None]])
            asked: FloatArray = np.zeros(0)
            if precision is not None and mean is not None:
                free = np.isfinite(precision)
                images = np.concatenate([images, bent.slopes[free]])
                asked = precision[free]
                offset = asked * mean[free]
            value = value - SATURATION[0] * self._free(bent.saturated)
            given = given - SATURATION[0] * bent.saturated
            own = np.full(len(value), CONTRAST_STD**-2.0)
            prior = np.concatenate([prior, own, spectrum, [SATURATION[1] ** -2.0], asked])
        normal, right = self._normal(splines, bent, images, value)
        right[right.size - offset.size :] += offset
        square = float((given * value * self._weight).sum())
        told, root, unknowns = self._integrated(normal, right, prior, square)
        return _Solved(told, root, unknowns, splines, bent)

    def of_variances(self, passage: Hypothesis, variances: Sequence[float]) -> list[float]:
        """Return `log_likelihood` for some variances of the one template."""
        normal, right, _ = self.information(passage)
        return [
            self._integrated(normal.copy(), right, np.full(right.size, 1.0 / each), self._square)[0]
            for each in variances
        ]

    def information(self, passage: Hypothesis) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what rows tell of a pattern, and the places of its coefficients, cells.

        The matrix of the normal equations and their right side.
        """
        (template,) = self.templates
        spline = _spline(
            self.panel.time_s,
            self._cells,
            self.panel.cell,
            template.knots,
            passage,
            self._cells.size,
        )
        own = self._spectrum(passage)
        normal, right = self._normal([spline], None, own, self._value)
        # what of it a spectrum in place may be tells nothing
        at = slice(spline.size, None)
        known = normal[at, at] + np.eye(len(own))
        gain = np.linalg.solve(known, normal[at, : at.start]).T
        place = template.knots * (spline.lowest + np.arange(spline.size))
        return (
            normal[: at.start, : at.start] - gain @ normal[at, : at.start],
            right[: at.start] - gain @ right[at], place,
        )  # fmt: skip

    def _integrated(
        self, normal: FloatArray, right: FloatArray, prior: FloatArray, square: float
    ) -> tuple[float, FloatArray, FloatArray]:
        """Return log-likelihood, root of the precision, and the likeliest unknowns.

        ``square``: of the values, in deviations.
        """
        place = np.arange(right.size)
        normal[place, place] += prior
        root = np.linalg.cholesky(normal)
        half = _solve(root, right)
        log_det = 2.0 * np.log(np.diag(root)).sum() - np.log(prior).sum()
        told = self._logs - 0.5 * (square - float(half @ half) + float(log_det))
        return told, root, _solve(root, half, upper=True)

    def _normal(
        self, splines: list["_Spline"], bent: "_Bent | None", images: FloatArray, value: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return normal matrix and right side, free of the courses and the cells.

        Of all coefficients, the contrast of each row where something is ``bent``, and
        ``images``. ``value``: free of courses and cells already.
        """
        n_rows, n_cells = value.shape
        starts = np.cumsum([0, *(spline.size for spline in splines)]).tolist()
        count = starts.pop()
        pairs = zip(splines, starts, strict=True)
        # design: for each cell of each row, some coefficients and their weights
        index = np.concatenate([s.first[:, :, None] + FOUR + at for s, at in pairs], 2)
        share = np.concatenate([s.weight for s in splines], axis=2)
        weighted = share * self._weight[:, None]
        row = (np.arange(n_rows)[:, None, None] * count + index).ravel()
        cell = (np.arange(n_cells)[None, :, None] * count + index).ravel()
        index_flat = index.ravel()

        def by_row(values: FloatArray) -> FloatArray:
            each = (weighted * values[..., None]).ravel()
            every = np.asarray(np.bincount(row, each, n_rows * count), float)
            return every.reshape(n_rows, count)

        def whole(values: FloatArray) -> FloatArray:
            each = (weighted * values[:, :, None]).ravel()
            return np.asarray(np.bincount(index_flat, each, count), float)

        held = count + (0 if bent is None else n_rows)
        normal = np.zeros((held + len(images),) * 2)
        right = np.zeros(len(normal))
        normal[:count, :count] = _products(index, share, weighted, count)
        right[:count] = whole(value)
        # what the courses of the rows and the cells by themselves have of it
        stays = np.zeros((n_cells, held))
        each = np.bincount(cell, weighted.ravel(), n_cells * count)
        stays[:, :count] = each.reshape(n_cells, count)
        line = np.sqrt(self._share)[:, None] * self._line
        courses = np.array([by_row(one) for one in line])
        both = np.zeros((len(line), held))
        both[:, :count] = courses.sum(axis=1)
        if bent is not None:
            heavy, own = bent.shown * self._weight, np.arange(n_rows)
            normal[count:held, :count] = by_row(bent.shown)
            told = line @ heavy.T
            both[:, count:] = told
            square = (heavy * bent.shown).sum(axis=1) - (told**2).sum(axis=0)
            normal[count + own, count + own] = square
            # a row's course is its own: what it has of the pattern in that row alone
            normal[count:held, :count] -= (told[:, :, None] * courses).sum(axis=0)
            right[count:held] = (heavy * value).sum(axis=1)
            stays[:, count:] = heavy.T
        freed = self._free(images)
        if bent is not None:
            normal[held:, count:held] = (freed * heavy).sum(axis=2)
            normal[:count, count:held] = normal[count:held, :count].T
        flat = courses.reshape(-1, count)
        normal[:count, :count] -= flat.T @ flat
        stays /= np.sqrt(n_rows * self._weight)[:, None]
        normal[:held, :held] += both.T @ both / n_rows - stays.T @ stays
        for k, (image, own_freed) in enumerate(zip(images, freed, strict=True), held):
            normal[k, :count] = whole(own_freed)
            normal[k, held:] = np.tensordot(images, own_freed * self._weight, 2)
            right[k] = (image * self._weight * value).sum()
        normal[:held, held:] = normal[held:, :held].T
        return normal, right


class _Solved(NamedTuple):
    """The linear unknowns, given the passages."""

    log_likelihood: float
    """Log of the probability density of the image."""
    root: FloatArray
    """Lower root of their precision."""
    unknowns: FloatArray
    """Coefficients of each pattern, contrast of each row, saturation, what is asked."""
    splines: list[_Spline]
    """Where the patterns lie."""
    bent: _Bent | None
    """What was linearised."""


def _products(index: IntArray, share: FloatArray, weighted: FloatArray, count: int) -> FloatArray:
    """Return the products of all pairs of coefficients, summed over the cells."""
    width = share.shape[2]
    if width > FOUR.size:  # pairs of several templates are many, and mostly empty
        from scipy.sparse import csr_array

        ends = np.arange(0, share.size + 1, width)
        shape = (ends.size - 1, count)
        plain, own = (
            csr_array((each.ravel(), index.ravel(), ends), shape) for each in (share, weighted)
        )
        return np.asarray((plain.T @ own).toarray())
    found = np.zeros(count * count)
    for a in range(width):
        for b in range(a, width):
            at = (index[:, :, a] * count + index[:, :, b]).ravel()
            both = np.bincount(at, (share[:, :, a] * weighted[:, :, b]).ravel(), count * count)
            found += both
            if a != b:
                found += both.reshape(count, count).T.ravel()
    return found.reshape(count, count)


def pattern_in(
    panel: Panel, passage: Hypothesis, template: Template, pattern: FloatArray, model: Panel
) -> FloatArray:
    """Return the pattern that was found in one panel in the cells of another.

    ``model``: the panel that it was found in. Shape (row, cell); nothing beyond what that
    panel has shown.
    """
    cells = np.arange(model.precision.size, dtype=float)
    low = _spline(model.time_s, cells, model.cell, template.knots, passage, cells.size).lowest
    finer = panel.cell / model.cell
    places = (np.arange(panel.precision.size) + 0.5) * finer - 0.5
    spline = _spline(panel.time_s, places, model.cell, template.knots, passage, cells.size, low)
    padded = np.concatenate([np.zeros(8), pattern, np.zeros(8)])
    first = np.clip(spline.first + 8, 4, padded.size - 5)
    return spline._replace(first=first).values(padded)
