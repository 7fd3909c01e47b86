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
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.evidence.fringe_panel import Panel

FOUR = np.arange(4)
"""Coefficients of a cubic spline that make a value."""


ROW_ORDER = 4
"""Order of the polynomial over log frequency that a row has of its own: level, slope, and
what rain, a squall or the vessel's own spectrum bend within some octaves."""


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
    course: tuple[FloatArray, FloatArray] | None = None
    """Contrast at times, s, instead of one that fades; None for that of a passage."""


class Template(NamedTuple):
    """Prior of a pattern."""

    knots: float
    """Distance of the knots of its spline, cells."""
    variance: float
    """Variance of its coefficients, nepers^2."""


def smooth_courses(weight: FloatArray) -> FloatArray:
    """Return the smooth courses of a row, of unit weight and independent of each other.

    ``weight``: precision of each cell. Shape (course, cell).
    """
    bent = np.polynomial.legendre.legvander(
        np.linspace(-1.0, 1.0, weight.size), ROW_ORDER
    )
    unit = np.linalg.qr(bent * np.sqrt(weight)[:, None])[0]
    return np.asarray(unit.T / np.sqrt(weight))


class Explained(NamedTuple):
    """What the linear unknowns are, given the passages."""

    log_likelihood: float
    """Log of the probability density of the image."""
    pattern: list[FloatArray]
    """Coefficients of each template."""
    residual: FloatArray
    """What is left, the course of each row taken off, shape (row, cell)."""


def relative_range(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return the range over that of the closest approach, of what arrives at times."""
    lag, mach = (time_s - passage.time_s) / passage.width_s, passage.mach
    root = np.sqrt((mach * lag) ** 2 + (1.0 - mach**2) * (1.0 + lag**2))
    return np.asarray((root - mach * lag) / (1.0 - mach**2))


def shift_of(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return by how much the logarithm of a pattern's frequencies has moved."""
    return passage.invariant * np.log(relative_range(time_s, passage))


def contrast_of(time_s: FloatArray, passage: Hypothesis) -> FloatArray:
    """Return the contrast of the pattern over that at the closest approach."""
    if passage.course is not None:
        return np.asarray(np.interp(time_s, *passage.course))
    range_2 = relative_range(time_s, passage) ** 2
    return np.asarray(1.0 / (1.0 + passage.fading * (range_2 - 1.0)))


class _Spline(NamedTuple):
    """Where each cell of each row lies on a template."""

    first: IntArray
    """First of its four coefficients, shape (row, cell)."""
    weight: FloatArray
    """Their weights, shape (row, cell, 4)."""
    size: int
    """Coefficients of the template."""

    def values(self, pattern: FloatArray) -> FloatArray:
        """Return the pattern in every cell, shape (row, cell)."""
        parts = (self.weight[:, :, k] * pattern[self.first + k] for k in range(4))
        return np.asarray(sum(parts))


def _spline(
    time_s: FloatArray, cells: FloatArray, cell: float, knots: float,
    passage: Hypothesis, lowest: float | None = None,
) -> tuple[_Spline, float]:  # fmt: skip
    """Return the cubic spline of a template, and the place of its first coefficient."""
    shift = shift_of(time_s, passage) / cell
    place = (cells - shift[:, None]) / knots
    low = float(np.floor(place.min())) - 1.0 if lowest is None else lowest
    place = place - low
    whole = np.floor(place).astype(np.int64)
    x = place - whole
    y = 1.0 - x
    weight = np.stack(
        [y**3 / 6.0, 2.0 / 3.0 - x * x * (1.0 - 0.5 * x),
         2.0 / 3.0 - y * y * (1.0 - 0.5 * y), x**3 / 6.0], axis=2,
    )  # fmt: skip
    weight *= contrast_of(time_s, passage)[:, None, None]
    return _Spline(whole - 1, weight, int(whole.max()) + 3), low


class FringeModel:
    """The image of some rows, of which passages are asked.

    ``panel``: the rows. ``templates``: prior of the pattern of each vessel.
    """

    def __init__(self, panel: Panel, templates: Sequence[Template]) -> None:
        self.panel, self.templates = panel, list(templates)
        self._weight = panel.precision
        self._cells = np.arange(self._weight.size, dtype=float)
        self._line = smooth_courses(self._weight)
        self._value = self._free(panel.value.astype(float))
        self._square = float((self._value**2 * self._weight).sum())
        independent = self._value.size - self._line.shape[0] * len(self._value)
        self._logs = 0.5 * (
            len(self._value) * float(np.log(self._weight).sum())
            - independent * float(np.log(2.0 * np.pi))
        )

    def _free(self, values: FloatArray) -> FloatArray:
        """Take the smooth course of each row off, and what stays in each cell."""
        part = (values * self._weight) @ self._line.T
        values = values - part @ self._line
        return np.asarray(values - values.mean(axis=0))

    def log_likelihood(self, passages: Sequence[Hypothesis]) -> float:
        """Return the log of the probability density of the image, nepers."""
        return self._solved(passages)[0]

    def residuals(self, passages: Sequence[Hypothesis]) -> FloatArray:
        """Return what passages leave, in standard deviations, shape (row, cell)."""
        return self.explain(passages).residual * np.sqrt(self._weight)

    def explain(self, passages: Sequence[Hypothesis]) -> Explained:
        """Return the likeliest patterns, and what they leave."""
        likelihood, root, half, splines = self._solved(passages)
        pattern = np.linalg.solve(root.T, half) if half.size else half
        whole, at = np.zeros_like(self._value), 0
        parts = []
        for spline in splines:
            parts.append(pattern[at : at + spline.size])
            whole += spline.values(parts[-1])
            at += spline.size
        return Explained(likelihood, parts, self._value - self._free(whole))

    def _solved(
        self, passages: Sequence[Hypothesis]
    ) -> tuple[float, FloatArray, FloatArray, list["_Spline"]]:
        """Integrate the patterns out."""
        n_rows, n_cells = self._value.shape
        splines = [
            _spline(self.panel.time_s, self._cells, self.panel.cell, t.knots, p)[0]
            for p, t in zip(passages, self.templates, strict=True)
        ]
        if not splines:
            nothing = np.zeros(0)
            return self._logs - 0.5 * self._square, nothing, nothing, splines
        starts = np.cumsum([0, *(spline.size for spline in splines)]).tolist()
        count = starts.pop()
        pairs = zip(splines, starts, strict=True)
        # design: for each cell of each row, some coefficients and their weights
        index = np.concatenate([s.first[:, :, None] + FOUR + at for s, at in pairs], 2)
        share = np.concatenate([s.weight for s in splines], axis=2)
        weighted = share * self._weight[:, None]
        normal = _products(index, share, weighted, count)
        # what the courses of the rows and the cells by themselves have of it
        row = (np.arange(n_rows)[:, None, None] * count + index).ravel()
        for line in self._line:
            told = np.bincount(row, (weighted * line[:, None]).ravel(), n_rows * count)
            told = told.reshape(n_rows, count)
            normal -= told.T @ told
            both = told.sum(axis=0)
            normal += np.outer(both, both) / n_rows
        cell = (np.arange(n_cells)[None, :, None] * count + index).ravel()
        stays = np.bincount(cell, weighted.ravel(), n_cells * count)
        stays = stays.reshape(n_cells, count) / np.sqrt(n_rows * self._weight)[:, None]
        normal -= stays.T @ stays
        prior = np.concatenate(
            [np.full(s.size, t.variance)
             for s, t in zip(splines, self.templates, strict=True)]
        )  # fmt: skip
        place = np.arange(count)
        normal[place, place] += 1.0 / prior
        value = (weighted * self._value[:, :, None]).ravel()
        right = np.bincount(index.ravel(), value, count)
        root = np.linalg.cholesky(normal)
        half = np.linalg.solve(root, right)
        log_det = 2.0 * np.log(np.diag(root)).sum() + np.log(prior).sum()
        cost = self._square - float(half @ half) + float(log_det)
        return self._logs - 0.5 * cost, root, half, splines


def _products(
    index: IntArray, share: FloatArray, weighted: FloatArray, count: int
) -> FloatArray:
    """Return the products of all pairs of coefficients, summed over the cells."""
    width = share.shape[2]
    if width > FOUR.size:  # pairs of several templates are many, and mostly empty
        from scipy.sparse import csr_array

        ends = np.arange(0, share.size + 1, width)
        shape = (ends.size - 1, count)
        plain, own = (
            csr_array((each.ravel(), index.ravel(), ends), shape)
            for each in (share, weighted)
        )
        return np.asarray((plain.T @ own).toarray())
    found = np.zeros(count * count)
    for a in range(width):
        for b in range(a, width):
            at = (index[:, :, a] * count + index[:, :, b]).ravel()
            both = np.bincount(
                at, (share[:, :, a] * weighted[:, :, b]).ravel(), count * count
            )
            found += both
            if a != b:
                found += both.reshape(count, count).T.ravel()
    return found.reshape(count, count)


def pattern_in(
    panel: Panel, passage: Hypothesis, template: Template, pattern: FloatArray,
    model: Panel,
) -> FloatArray:  # fmt: skip
    """Return the pattern that was found in one panel in the cells of another.

    ``model``: the panel that it was found in. Shape (row, cell); nothing beyond what that
    panel has shown.
    """
    cells = np.arange(model.precision.size, dtype=float)
    _, low = _spline(model.time_s, cells, model.cell, template.knots, passage)
    finer = panel.cell / model.cell
    places = (np.arange(panel.precision.size) + 0.5) * finer - 0.5
    spline, _ = _spline(
        panel.time_s, places, model.cell, template.knots, passage, lowest=low
    )
    padded = np.concatenate([np.zeros(8), pattern, np.zeros(8)])
    first = np.clip(spline.first + 8, 4, padded.size - 5)
    return _Spline(first, spline.weight, spline.size).values(padded)
