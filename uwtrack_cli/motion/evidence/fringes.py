"""Closest approaches told by interference fringes alone.

**Method.** *Propose*: for every time and range over speed of a grid, the rows of the
image are shifted as the law says and stacked; what a free template explains is the gain,
and noise gains nothing, since the template has a prior. *Fit*: the exact likelihood of the
image (`fringe_template`) is climbed by Newton's method, with its curvature as precision;
the waveguide invariant is one for a mirror, or free with a broad prior, and both count by
their evidence. *Weigh*: against the same pattern that stays, is upside down, shifts
evenly, or belongs to a ship outside the recording, and against lines of a machine.
*Assign*: what the strongest explains is taken out, the rest is searched again, and in the
end all are fitted together.

**Conventions.** Times are those of the closest approach as it is, by the law at the time
of emission; the speed enters by R0/c alone, with its prior among vessels unless lines
tell it. Nepers throughout.

**References.** Chuprov (1982); D'Spain and Kuperman, JASA 106, 2454 (1999); Cockrell and
Schmidt, JASA 127, 2780 (2010), for the spread of the invariant in shallow water.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.motion.association import PassageReport, same_vessel
from uwtrack_cli.motion.evidence.fringe_lines import (
    LINE_KNOTS,
    course_share,
    likeliest_course,
    lines_gain,
)
from uwtrack_cli.motion.evidence.fringe_mirror import Mirror, mirror_of
from uwtrack_cli.motion.evidence.fringe_panel import ANY_BEND, FEWEST_ROWS, Panel, panel_of
from uwtrack_cli.motion.evidence.fringe_template import (
    UNKNOWNS,
    FringeModel,
    Hypothesis,
    Shape,
    Template,
    contrast_of,
    course_shares,
    pattern_in,
    shift_of,
    smooth_courses,
)

LEAST_WIDTH_S, WIDTH_STEP = 6.0, 1.2
"""Smallest R/v that is sought, s, and the ratio of one to the next."""

LONGEST_WIDTH = 1.5
"""Largest R/v that is sought, over the length of what is searched at once."""

ROWS_OF_WIDTH, TOGETHER, REACH = 16.0, 2, 5.0
"""Rows of each R/v at least, neighbouring cells that are taken together, and R/v on either
side that are stacked. Rows are a power of two of the image's, so that few are made."""

BETWEEN = (-0.4, -0.2, 0.2, 0.4)
"""Parts of a step of R/v by which the likeliest one is moved."""

LEAST_ROWS = 48
"""Rows of what is searched at once, where R/v is as long as the recording."""

OUTSIDE = 3.0
"""R/v before and after the recording up to which a passage is sought, as a rival."""

VARIANCES = (0.002, 0.01, 0.05, 0.25)
"""Variances of a template that are tried, nepers^2."""

USUAL_FADING = 0.4
"""Fading of the contrast that proposals assume."""


class Proposal(NamedTuple):
    """A passage of the grid."""

    gain: float
    """Nepers over noise."""
    time_s: float
    """Closest approach, s."""
    width_s: float
    """Range over speed, s."""


class _Stack(NamedTuple):
    """Rows that can be shifted and stacked."""

    time_s: FloatArray
    """Middle of each row, s; those without sound are between them, shape (row,)."""
    step_s: float
    """Time from one row to the next, s."""
    weighted: FloatArray
    """Values times precision, 0 without sound, shape (row, cell)."""
    has_sound: FloatArray
    """Whether a row has sound, 0 or 1, shape (row,)."""
    precision: FloatArray
    """Precision, shape (cell,)."""
    cell: float
    """Step of the logarithm of frequency."""
    spectra: dict[tuple[int, ...], NDArray[np.complexfloating]]
    """Two-dimensional spectra of the values, by size: what is asked for once."""

    @classmethod
    def of(cls, panel: Panel) -> "_Stack":
        """Return the rows of a panel."""
        first, step_s = float(panel.time_s[0]), panel.step_s
        row = np.rint((panel.time_s - first) / step_s).astype(np.int64)
        count = int(row[-1]) + 1
        weighted = np.zeros((count, panel.precision.size), np.float32)
        weighted[row] = flattened(panel) * panel.precision
        has_sound = np.zeros(count, np.float32)
        has_sound[row] = 1.0
        time_s = first + step_s * np.arange(count)
        return cls(
            time_s, step_s, weighted, has_sound, panel.precision.astype(np.float32), panel.cell, {}
        )

    def gains(self, width_s: float) -> tuple[FloatArray, FloatArray]:
        """Return times, s, and what a passage of some R/v at each gains, nepers.

        Every row is tried, and as many before and after the rows as `OUTSIDE` says. What
        shifts and stacks is a correlation, of the image and of the law's course in it.
        """
        from scipy.fft import irfft, irfft2, next_fast_len, rfft, rfft2

        count, n_cells = self.weighted.shape
        wide = width_s / self.step_s
        out = int(min(OUTSIDE * wide, count))
        reach = int(min(REACH * wide, count + out))
        row = np.arange(-reach, reach + 1)
        square = (row / wide) ** 2
        shift = np.rint(0.5 * np.log1p(square) / self.cell).astype(np.int64)
        contrast = 1.0 / (1.0 + USUAL_FADING * square)
        farthest = int(shift.max())
        size = tuple(
            next_fast_len(each, real=True) for each in (count + out + reach, n_cells + farthest)
        )
        place = np.arange(-out, count + out)
        course = np.zeros(size, np.float32)
        course[row, shift] = contrast
        # half a spectrum along time, the whole one along frequency
        if size not in self.spectra:
            self.spectra[size] = rfft2(self.weighted, size[::-1], (1, 0))
        seen = np.conj(rfft2(course, axes=(1, 0))) * self.spectra[size]
        total = irfft2(seen, size[::-1], (1, 0), overwrite_x=True)[place] ** 2
        # what rows of one shift weigh, and what the cells that they show do
        course = np.zeros((size[0], farthest + 1), np.float32)
        course[row, shift] = contrast**2
        known = rfft(self.has_sound, size[0])[:, None]
        rows = irfft(np.conj(rfft(course, axis=0)) * known, size[0], 0)[place]
        shown = np.zeros((farthest + 1, size[1]), np.float32)
        for k, cells in enumerate(shown):
            cells[(np.arange(n_cells) - k) % size[1]] = self.precision
        weight = np.maximum(rows @ shown, 0.0)
        gains = []
        for s in VARIANCES:
            less = s * weight
            less += np.float32(1.0)
            gain = np.float32(s) * total
            gain /= less
            gain -= np.log(less, out=less)
            gains.append(gain.sum(axis=1))
        found = np.max(gains, axis=0)
        return self.time_s[0] + self.step_s * place, 0.5 * found


def flattened(panel: Panel) -> FloatArray:
    """Return the values less the course of each row and the usual of each cell.

    For proposals alone: what is taken off here takes some of a pattern with it.
    """
    courses = smooth_courses(panel.precision)
    share = course_shares(panel.bend)[:, None]
    value = panel.value - np.median(panel.value, axis=0)
    for _ in range(2):
        value = value - ((value * panel.precision) @ courses.T) @ (share * courses)
        value = value - value.mean(axis=0)
    return np.asarray(value)


class _Leftovers(NamedTuple):
    """What passages leave of themselves in an image that they were taken out of.

    A source sounds otherwise ahead than astern, and no law holds exactly: a pattern that
    moves as theirs, whose contrast changes along the rows. It is there beside whatever is
    asked.
    """

    panel: Panel
    """The rows."""
    known: list[tuple[Hypothesis, Template]]
    """Their patterns."""

    def beside(self, asked: list[tuple[Hypothesis, Template]]) -> float:
        """Return how likely the image is under some patterns, and these beside them."""
        model, passages = self._model(asked)
        return model.log_likelihood(passages)

    def moving(self, one: Hypothesis, prior: Template) -> float:
        """Return the same of a pattern that moves, the contrast of each row its own.

        What known passages leave may rise and fall in place, too: beside them, something
        that does so is allowed as it is where nothing moves.
        """
        model, passages = self._model([(one, prior)])
        shown = model.explain(passages)
        shape = Shape(shown.pattern[0], shown.lowest[0])
        own = FringeModel(self.panel, model.templates, shape).log_likelihood(passages)
        if not self.known:
            return own
        still = likeliest_still(self.panel._replace(value=shown.residual))
        model, passages = self._model([(one, prior), (still.course, still.prior)])
        model = FringeModel(self.panel, model.templates, shape)
        return max(own, model.log_likelihood(passages) + still.share)

    def _model(
        self, asked: list[tuple[Hypothesis, Template]]
    ) -> tuple[FringeModel, list[Hypothesis]]:
        every = [*asked, *self.known]
        model = FringeModel(self.panel, [template for _, template in every])
        return model, [passage for passage, _ in every]


class FringeEvidence:
    """What an image of fringes says of passages: proposals, residuals, likelihood.

    ``fringes``: the image. ``mach``: speed of vessels over that of sound, and its
    deviation.
    """

    def __init__(self, fringes: Fringes, mach: tuple[float, float]) -> None:
        self.fringes, self.mach = fringes, mach
        self._known: list[FringePassage] = []
        self._stacks: dict[int, _Stack | None] = {}
        self._proposals: list[Proposal] | None = None
        self._panels: dict[tuple[int, int], Panel | None] = {}

    def leftovers(self, panel: Panel) -> "_Leftovers":
        """Return what the known passages may have left of themselves in some rows."""
        span = 2.0 * (panel.time_s - panel.time_s[0]) / np.ptp(panel.time_s) - 1.0
        courses = np.polynomial.legendre.legvander(span, LEFT_ORDER).T
        return _Leftovers(panel, [
            (one.fitted._replace(course=(panel.time_s, course * contrast)), one.template)
            for one in self._known
            for contrast in [contrast_of(panel.time_s, one.fitted)]
            for course in courses
        ])  # fmt: skip

    def explained(self, known: Sequence["FringePassage"]) -> "FringeEvidence":
        """Return the evidence of what some passages leave."""
        rest = FringeEvidence(self.fringes, self.mach)
        rest._known, rest._panels = list(known), self._panels
        return rest

    def panel(self, step_s: float, cells: int = 1) -> Panel | None:
        """Return the image, less the patterns that are known.

        ``step_s``: time that a row is averaged over; less where that leaves few rows.
        """
        span_s = self.fringes.time_s.size * self.fringes.average_s
        step_s = min(step_s, span_s / LEAST_ROWS)
        key = int(step_s / self.fringes.average_s + 1e-6), cells
        if key not in self._panels:  # averages are asked for again and again
            self._panels[key] = panel_of(self.fringes, step_s, cells)
        panel = self._panels[key]
        if panel is None:
            return None
        for one in self._known:
            own = _changing(one.fitted, one.contrast, self.fringes.time_s)
            for passage, pattern in zip(own, one.pattern, strict=True):
                made = pattern_in(panel, passage, one.template, pattern, one.panel)
                panel = panel._replace(value=panel.value - made)
        return panel

    def gains(self, width_s: float) -> tuple[FloatArray, FloatArray]:
        """Return times, s, and what a passage of some R/v at each gains, nepers."""
        rows = max(1.0, width_s / ROWS_OF_WIDTH / self.fringes.average_s)
        doublings = int(np.log2(rows))
        if doublings not in self._stacks:
            panel = self.panel(2.0**doublings * self.fringes.average_s, TOGETHER)
            self._stacks[doublings] = panel and _Stack.of(panel)
        stack = self._stacks[doublings]
        return stack.gains(width_s) if stack else (np.zeros(0), np.zeros(0))

    def proposals(self) -> list[Proposal]:
        """Return the likeliest passage of each R/v, the likeliest first."""
        if self._proposals is None:
            self._proposals = self._proposed()
        return self._proposals

    def _proposed(self) -> list[Proposal]:
        time_s = self.fringes.time_s
        if time_s.size < FEWEST_ROWS:
            return []
        span_s = float(time_s[-1] - time_s[0])
        count = int(np.log(LONGEST_WIDTH * span_s / LEAST_WIDTH_S) / np.log(WIDTH_STEP))
        widths = LEAST_WIDTH_S * WIDTH_STEP ** np.arange(max(0, count + 1))
        found = sorted(self._likeliest(widths.tolist()), reverse=True)
        # dense fringes are sharp: what is between the steps is asked about the likeliest
        finer = [found[0].width_s * WIDTH_STEP**k for k in BETWEEN] if found else []
        return sorted(found + self._likeliest(finer), reverse=True)

    def _likeliest(self, widths: Sequence[float]) -> list[Proposal]:
        """Return the likeliest passage of each R/v, and the likeliest that can be told."""
        found = set()
        for width_s in widths:
            place_s, gain = self.gains(width_s)
            inside = np.flatnonzero(self.is_inside(place_s, width_s))
            for within in (np.arange(gain.size), inside):
                if within.size:
                    k = within[np.argmax(gain[within])]
                    found.add(Proposal(float(gain[k]), float(place_s[k]), width_s))
        return list(found)

    def can_tell(self, one: "FringePassage") -> bool:
        """Return whether a passage is near enough to the recording."""
        passage = one.passage
        return bool(self.is_inside(np.array(passage.time_s), passage.width_s))

    def is_inside(self, time_s: FloatArray, width_s: float) -> BoolArray:
        """Return whether closest approaches at times, s, can be told."""
        first, last = self.fringes.time_s[[0, -1]]
        reach_s = INSIDE * width_s
        return np.asarray((first - reach_s < time_s) & (time_s < last + reach_s))


# Fit


FIT_ROWS, FIT_REACH, FIT_CELLS = 10.0, 6.0, 2
"""Rows of R/v, R/v on either side and neighbouring cells that the fit takes together."""

BENDS = (0.1, 1.0, 10.0, 100.0, 1e3, ANY_BEND)
"""Variances of what rows bend by that are tried, over that of noise."""

KNOTS = (1.5, 3.0, 6.0)
"""Distances of a template's knots that are tried, in the fit's cells."""

FADING_PRIOR = (float(np.log(USUAL_FADING)), 0.7)
"""Mean and deviation of the logarithm of the fading: from noise alone to no noise."""

TILT = 0.2
"""Deviation of the slope of a vessel's spectrum from that of the sea, nepers by the
logarithm of frequency: 0.6 dB per octave."""

INVARIANT_PRIOR = (1.1, 0.25)
"""Mean and deviation of the invariant of a waveguide."""

COUNTS = 0.05
"""Probability from which the deviations of a waveguide are worked out."""

BROAD_SHARE = 0.5
"""Prior probability that the invariant is not that of a mirror."""

CHANNEL_LONGER, CHANNEL_WIDTH = 0.023, 0.017
"""By how much images in a bottom make the logarithm of R/v longer: they are those of a
sensor that lies deeper, and so farther; mean and deviation
(studies/constants/fringe_water.py). It goes with the inverse square of the range, which
fringes do not tell."""

LARGEST_STEP = np.array([0.15, 0.15, 1.0, 0.2, 1.0, 0.3])
"""What a step of the fit changes each of `UNKNOWNS` by at most."""

WIDEST_STEP = 1.0
"""Deviation of a step of the time, in R/v, and of the logarithm of R/v: so wide that it only
counts where nothing is seen of them."""

PROFILED, LEAST_BEND = 1.5, 0.1
"""Deviations to either side at which the log-likelihood is asked for its curvature, and
least curvature, over that of the last step."""

MOST_STEPS, CLOSE = 12, 0.1
"""Steps at most, and deviations of a step of time and R/v that is the last."""

# Weigh

INSIDE = 0.25
"""R/v beyond the ends of the recording up to which a closest approach is told."""

TEMPERED_NEPERS, TEMPERED_SHARE = 3.0, 0.012
"""What the difference of two explanations is divided by: nepers, and a share of what the
better one explains, since neither is all that the sea does
(tests/draws/fringe_rates.py)."""

PRIOR_LOG_ODDS = -9.0
"""Log of the rate of passages over that of sounds whose tempered evidence is as good. A
vessel that passes outside the recording is as usual as one that passes inside."""

LEAST_GAIN = 20.0
"""Gain of a proposal, nepers, from which it is fitted: rows in random order have 6 at
most (tests/draws/fringe_rates.py)."""

STAYS, UPSIDE_DOWN, OUTSIDE_ALONE = "stays", "upside-down", "outside"
MOVING_LINES = "moving-lines"
"""Codes of what else may be: a pattern that rises and falls where it is, one that moves
the other way, a source that comes or goes all the time, or drifts evenly, and lines that
move together, as those of a machine whose speed swings."""

AWAY = (0.2, 0.6, 2.0, 6.0)
"""How far outside the rows a source that comes or goes is, in their length."""

PERHAPS = -5.0
"""Log odds from which a further passage is taken out, for all to be fitted once more: what
the first ones are wrong by, while it is still there, speaks against it."""

LEFT_ORDER = 2
"""Order of the contrast, along the rows, of what a known passage leaves of itself."""

CORRELATIONS = (0.0, 0.7, 0.95, 0.99)
"""Correlations of its course from row to row that are tried."""

COURSE_VARIANCES = (1e-4, 1e-3, 0.01, 0.1, 1.0)
"""Variances of it that are tried, over the square of the largest."""

STILL_VARIANCES = (0.01, 0.1, 1.0)
"""Variances of what rises and falls in place, nepers^2."""

MOST_SHOWN = 0.72
"""How often a vessel without noise about her shows a pattern: rough seas, and sensors near
the surface, leave none (studies/constants/fringe_shown.py)."""

MOST_PASSAGES = 3
"""Passages of a stretch at most."""

ALIKE = 0.5
"""Share of the likeliest proposal's gain from which others are about as good."""


@dataclass(frozen=True)
class FringePassage:
    """A passage that fringes tell."""

    passage: Hypothesis
    """The likeliest one; its time is the mean, and so is its R/v."""
    covariance: FloatArray
    """Of time (s) and range over speed (s), shape (2, 2)."""
    surface: Hypothesis
    """The one by the law of a mirror, which holds where there is no bottom."""
    surface_covariance: FloatArray
    """Of its time and range over speed, shape (2, 2)."""
    gain: float
    """Nepers over an image without a pattern."""
    density: float
    """Log of the prior density of its unknowns over the largest, nepers."""
    rival: str
    """Code of the strongest explanation in which nothing passes."""
    rival_gain: float
    """What that gains with a pattern of any shape."""
    rival_pattern: float
    """What the shape that it says gains over any shape, nepers."""
    rival_prior: float
    """Log of its prior probability over that of a passage."""
    template: Template
    """Prior of its pattern."""
    fitted: Hypothesis
    """The one that its pattern was found by."""
    contrast: tuple[FloatArray, FloatArray]
    """What the contrast of each row is more, as a share, at times, s."""
    pattern: list[FloatArray]
    """Coefficients of its pattern, and of what of it changes in time."""
    misfit: float
    """What the residuals' variance and correlation in time make of one measurement."""
    panel: Panel
    """The rows that it was found in."""
    mirror: Mirror | None = None
    """Likeliest delay of the surface's image; None before it was sought."""

    @property
    def report(self) -> PassageReport:
        """What is compared with other reports of a vessel."""
        time_std_s, width_std_s = np.sqrt(np.diag(self.covariance)).tolist()
        passage = self.passage
        return PassageReport(passage.time_s, time_std_s, passage.width_s, width_std_s)

    @property
    def scale(self) -> float:
        """What a difference of log evidence is divided by, nepers."""
        most = max(self.gain, self.rival_gain) / self.misfit
        return TEMPERED_NEPERS + TEMPERED_SHARE * most

    @property
    def log_odds(self) -> float:
        """Log of the odds that something passes, against its strongest rival."""
        more = (self.gain - self.rival_gain) / self.misfit
        # shapes of one pattern on one course: what the sea does besides is in both
        shape = self.rival_pattern / self.misfit
        return float(self.density - self.rival_prior + more / self.scale - shape)

    @property
    def probability(self) -> float:
        """Probability that something passes."""
        return float(1.0 / (1.0 + np.exp(-np.clip(self.log_odds, -50.0, 50.0))))


class _Fitted(NamedTuple):
    """The likeliest passage under one law of the water."""

    passage: Hypothesis
    covariance: FloatArray
    """Of what is asked (`UNKNOWNS`), shape (unknown, unknown); 0 where it is held."""
    prior: FloatArray
    """Precision of each before, shape (unknown,); infinite where it is held."""
    log_likelihood: float
    """Log of the probability of the image there, nepers."""
    log_density: float
    """Log of the prior density there over the largest, nepers."""
    log_share: float
    """Log of the prior probability of what agrees with the image, nepers."""
    model: FringeModel
    """The image, about the likeliest pattern."""

    def covariance_with(self, misfit: float) -> FloatArray:
        """Return that of time and R/v where noise has a multiple of its variance.

        What was known before is as well known then.
        """
        free = np.isfinite(self.prior)
        known = np.diag(self.prior[free])
        told = np.linalg.inv(self.covariance[np.ix_(free, free)]) - known
        return np.asarray(np.linalg.inv(told / misfit + known)[:2, :2])


class _Law(NamedTuple):
    """What is known of a passage before."""

    mean: FloatArray
    """Of each of `UNKNOWNS`; nan where it is what a step begins with."""
    deviation: FloatArray
    """0 where one is held."""

    @classmethod
    def of(cls, mach: tuple[float, float], *, is_mirror: bool) -> "_Law":
        """Return the law of a mirror or of a waveguide."""
        invariant = (1.0, 0.0) if is_mirror else INVARIANT_PRIOR
        unknown = (np.nan, WIDEST_STEP)
        tilt = (0.0, TILT)
        each = np.array([unknown, unknown, FADING_PRIOR, invariant, mach, tilt])
        return cls(each[:, 0], each[:, 1])

    def off(self, passage: Hypothesis) -> FloatArray:
        """Return by how much the mean of each is above a passage's."""
        fading = float(np.log(passage.fading))
        own = np.array([0.0, 0.0, fading, passage.invariant, passage.mach, passage.tilt])
        return np.where(np.isfinite(self.mean), self.mean - own, 0.0)

    @property
    def precision(self) -> FloatArray:
        """Precision of each; infinite where it is held."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.deviation**-2.0)

    def log_density(self, passage: Hypothesis) -> float:
        """Return the log of the density of what is known, of unit normal ones."""
        known = (self.deviation > 0.0) & np.isfinite(self.mean)
        off = self.off(passage)[known] / self.deviation[known]
        return -0.5 * float(off @ off)


def fit_passage(
    evidence: FringeEvidence, start: Proposal, fading: float = USUAL_FADING
) -> FringePassage | None:
    """Return the passage about a proposal; None where too little of it was recorded."""
    mirror = _Law.of(evidence.mach, is_mirror=True)
    first = Hypothesis(start.time_s, start.width_s, fading=fading, mach=evidence.mach[0])
    told = _climbed(evidence, first, mirror)
    if told is None:
        return None
    # the finer parts of a pattern are seen from where it lies
    finer = _best_template(told.model.panel, told.passage)
    if finer != told.model.templates[0]:
        model = _about(told.model.panel, finer, told.passage)
        told = _climbed(evidence, told.passage, mirror, model) or told
    channel = _Law.of(evidence.mach, is_mirror=False)
    free = _climbed(evidence, told.passage, channel, told.model) or told
    return _weighed(evidence, _profiled(told, mirror), free)


def _climbed(
    evidence: FringeEvidence, start: Hypothesis, law: _Law, model: FringeModel | None = None
) -> _Fitted | None:
    """Return the likeliest passage near one, by the method of Gauss and Newton.

    ``model``: the image, which is kept; None takes rows that suit the passage.
    """
    is_given = model is not None
    rows = model or _rows_about(evidence, start, None)
    here = about = start
    covariance: FloatArray = np.eye(len(UNKNOWNS))
    for _ in range(MOST_STEPS):
        if not (is_given or _is_near(here, about)):
            rows, about = _rows_about(evidence, here, rows), here
        if rows is None:
            return None
        by, covariance, shape = rows.step(here, law.precision, law.off(here))
        deviation = np.sqrt(np.diag(covariance))
        share = min(1.0, *(LARGEST_STEP / np.maximum(np.abs(by), 1e-9)))
        here = _moved(here, by * share)
        rows = FringeModel(rows.panel, rows.templates, shape)
        if np.max(np.abs(by[:2]) / deviation[:2]) < CLOSE:
            break
    if rows is None:
        return None
    return _fitted(here, covariance, law, rows)


def _fitted(here: Hypothesis, covariance: FloatArray, law: _Law, rows: FringeModel) -> _Fitted:
    """Return a passage with its evidence."""
    is_asked = np.diag(covariance) > 0.0
    log_det = float(np.linalg.slogdet(covariance[np.ix_(is_asked, is_asked)])[1])
    density = law.log_density(here)
    share = density + 0.5 * log_det
    share -= float(np.log(law.deviation[is_asked]).sum())
    told = rows.log_likelihood([here])
    return _Fitted(here, covariance, law.precision, told, density, share, rows)


def _moved(passage: Hypothesis, by: FloatArray) -> Hypothesis:
    """Return a passage with its unknowns changed; its time in R/v."""
    for name, one in zip(UNKNOWNS, by, strict=True):
        size = one * passage.width_s if name == "time_s" else one
        passage = passage.changed(name, float(size))
    return passage


def _profiled(fitted: _Fitted, law: _Law) -> _Fitted:
    """Return a fit whose time and R/v have the curvature of the log-likelihood itself.

    A step of Gauss and Newton takes what noise leaves in the pattern for a part of it,
    whose bends tell time and R/v, too. As either moves, the others follow as the fit has
    them, and the pattern and the rows' contrasts are found again.
    """
    model, here = fitted.model, fitted.passage
    covariance = fitted.covariance

    def told(passage: Hypothesis) -> float:
        rows = _shaped(model.panel, model.templates[0], passage)
        return rows.log_likelihood([passage]) + law.log_density(passage)

    middle = told(here)  # about the same pattern as both sides
    shift, wider = np.zeros(len(UNKNOWNS)), np.ones(len(UNKNOWNS))
    for k in range(2):
        variance = float(covariance[k, k])
        by = PROFILED * covariance[:, k] / np.sqrt(variance)
        low, high = (told(_moved(here, sign * by)) for sign in (-1.0, 1.0))
        bend = max(2.0 * middle - low - high, LEAST_BEND * PROFILED**2)
        wider[k] = PROFILED / np.sqrt(bend)
        shift += by * float(np.clip(0.5 * (high - low) / bend, -1.0, 1.0))
    here = _moved(here, shift)
    rows = _shaped(model.panel, model.templates[0], here)
    return _fitted(here, covariance * np.outer(wider, wider), law, rows)


def _rows_about(
    evidence: FringeEvidence, here: Hypothesis, model: FringeModel | None
) -> FringeModel | None:
    """Return the rows that suit a passage, about its pattern; None if they are few.

    ``model``: rows whose template is kept; None chooses one.
    """
    panel = evidence.panel(here.width_s / FIT_ROWS, FIT_CELLS)
    if panel is None:
        return None
    panel = panel.near(here.time_s, FIT_REACH * here.width_s)
    if panel.time_s.size < FEWEST_ROWS:
        return None
    if model:
        panel = panel._replace(bend=model.panel.bend)
        return _shaped(panel, model.templates[0], here)
    return _about(panel, _best_template(panel, here), here)


def _about(panel: Panel, template: Template, passage: Hypothesis) -> FringeModel:
    """Return the image about the likeliest pattern of a passage, as rows bend in it."""
    told = [panel._replace(bend=each) for each in BENDS]
    panel = max(told, key=lambda one: FringeModel(one, [template]).log_likelihood([passage]))
    return _shaped(panel, template, passage)


def _shaped(panel: Panel, template: Template, passage: Hypothesis) -> FringeModel:
    """Return the image about the likeliest pattern of a passage."""
    shown = FringeModel(panel, [template]).explain([passage])
    return FringeModel(panel, [template], Shape(shown.pattern[0], shown.lowest[0]))


def _is_near(one: Hypothesis, other: Hypothesis) -> bool:
    """Return whether the same rows suit both."""
    apart = abs(one.time_s - other.time_s) / one.width_s
    return bool(max(apart, abs(np.log(one.width_s / other.width_s))) < 0.1)


def _best_template(panel: Panel, passage: Hypothesis) -> Template:
    """Return the prior of a pattern that makes the image likeliest."""
    return _likeliest_template(panel, passage, KNOTS, VARIANCES)


def _likeliest_template(
    panel: Panel, passage: Hypothesis, knots: Sequence[float], variances: Sequence[float]
) -> Template:
    told: list[tuple[float, Template]] = []
    for each in knots:
        model = FringeModel(panel, [Template(each, 1.0)])
        found = model.of_variances(passage, variances)
        told += [(f, Template(each, v)) for f, v in zip(found, variances, strict=True)]
    return max(told)[1]


def _weighed(evidence: FringeEvidence, mirror: _Fitted, channel: _Fitted) -> FringePassage:
    """Weigh mirror and waveguide, and hold both against what else may be."""
    told = mirror.model.explain([mirror.passage])
    misfit = _misfit(told.residual, mirror.model.panel.precision)
    nothing = FringeModel(mirror.model.panel, []).log_likelihood([])
    # neither law is all that the sea does: as among other explanations
    scale = TEMPERED_NEPERS * misfit
    scale += TEMPERED_SHARE * max(mirror.log_likelihood - nothing, 0.0)
    odds = (channel.log_likelihood - mirror.log_likelihood) / scale
    odds += channel.log_share - mirror.log_share
    odds += np.log(BROAD_SHARE / (1.0 - BROAD_SHARE))
    share = float(1.0 / (1.0 + np.exp(-np.clip(odds, -50.0, 50.0))))
    if share > COUNTS:
        channel = _profiled(channel, _Law.of(evidence.mach, is_mirror=False))
    fitted = channel if share > 0.5 else mirror
    found, model = fitted.passage, fitted.model
    # both in times of the mirror's R/v
    scale_s = mirror.passage.width_s
    ratio = channel.passage.width_s / scale_s
    off = np.array([(channel.passage.time_s - mirror.passage.time_s) / scale_s, np.log(ratio)])
    units = np.array([ratio, 1.0])
    told = model.explain([found])
    misfit = _misfit(told.residual, model.panel.precision)
    own = channel.covariance_with(misfit) * np.outer(units, units)
    both = (1.0 - share) * mirror.covariance_with(misfit) + share * own
    both = both + share * (1.0 - share) * np.outer(off, off)
    own_contrast = model.panel.time_s, told.contrast
    changing = _changing(found, own_contrast, model.panel.time_s)
    taken = FringeModel(model.panel, model.templates * len(changing)).explain(changing)
    rest = evidence.leftovers(model.panel)
    likelihood = rest.moving(found, model.templates[0])
    nothing = rest.beside([])
    width_s = scale_s * float(np.exp(share * off[1]))
    middle = found._replace(
        time_s=mirror.passage.time_s + share * float(off[0]) * scale_s, width_s=width_s
    )
    slope = np.array([scale_s, width_s])
    one = FringePassage(
        middle, both * np.outer(slope, slope), mirror.passage,
        mirror.covariance_with(misfit) * scale_s**2, likelihood - nothing,
        fitted.log_density, "", -np.inf, 0.0, 0.0, model.templates[0], found,
        own_contrast, taken.pattern, misfit, model.panel,
    )  # fmt: skip
    for other in _rivals(evidence, fitted, rest, misfit * one.scale):
        rival = replace(
            one, rival=other.code, rival_gain=other.log_likelihood - nothing,
            rival_pattern=other.pattern, rival_prior=other.log_prior,
        )  # fmt: skip
        one = min(one, rival, key=lambda each: each.log_odds)
        if one.log_odds < PERHAPS:  # it is refused, whatever else there is
            break
    return one


def _mirrored(one: FringePassage, frequency_hz: FloatArray) -> FringePassage:
    """Look for the surface's image in a pattern.

    ``frequency_hz``: middles of the cells of the image.
    """
    lowest_hz = float(np.exp(np.log(frequency_hz[:FIT_CELLS]).mean()))
    mirror = mirror_of(one.panel, one.fitted, one.template, one.misfit, lowest_hz)
    return replace(one, mirror=mirror)


def in_water(one: FringePassage) -> FringePassage:
    """Weigh water without a bottom, where nothing but the surface sounds, and a channel.

    The invariant is that of a mirror in the first, and images in a bottom make R/v longer
    in the second. How likely it is, the pattern says: whether one comb is all of it.
    """
    if one.mirror is None:
        return one
    alone = one.mirror.alone
    # what seems to be a rest may be what the law of a comb does not say
    odds = alone / (TEMPERED_NEPERS if alone > 0.0 else one.scale)
    share = float(1.0 / (1.0 + np.exp(np.clip(odds, -50.0, 50.0))))
    width_s = one.passage.width_s
    channel = one.passage.changed("width_s", -CHANNEL_LONGER)
    more = np.diag([0.0, CHANNEL_WIDTH * width_s])
    off = np.array([channel.time_s - one.surface.time_s, channel.width_s - one.surface.width_s])
    both = (1.0 - share) * one.surface_covariance + share * (one.covariance + more**2)
    return replace(
        one, covariance=both + share * (1.0 - share) * np.outer(off, off),
        passage=one.passage._replace(
            time_s=one.surface.time_s + share * float(off[0]),
            width_s=one.surface.width_s + share * float(off[1]),
        ),
    )  # fmt: skip


def _changing(
    passage: Hypothesis, own: tuple[FloatArray, FloatArray], time_s: FloatArray
) -> list[Hypothesis]:
    """Return a passage, and the same with contrasts that change in time.

    A source sounds otherwise ahead than astern, and a loud one has another pattern: what
    is taken out of the image may change. ``own``: what each row has more, at times, s.
    """
    contrast = contrast_of(time_s, passage)
    lag = np.clip((time_s - passage.time_s) / passage.width_s, -3.0, 3.0)
    whole = contrast * (1.0 + np.interp(time_s, *own, left=0.0, right=0.0))
    courses = (whole, contrast * lag, contrast * (1.0 - contrast))
    return [passage._replace(course=(time_s, course)) for course in courses]


def _misfit(residual: FloatArray, precision: FloatArray) -> float:
    """Return by what the variance of residuals is more than noise gives, one at least.

    Correlation along time is summed up to the lag at which it is lost.
    """
    own = residual * np.sqrt(precision)
    variance = float((own**2).mean())
    usual = float((precision * (own**2).mean(axis=0)).sum() / precision.sum())
    # precision counts neighbours: of independent cells the mean square is below one
    total = 1.0
    for lag in range(1, len(own) // 4):
        told = float((own[lag:] * own[:-lag]).mean()) / max(variance, 1e-9)
        if told < 2.0 / np.sqrt(own.size / 4.0):
            break
        total += 2.0 * told
    return max(total, 1.0) * max(usual, 1.0)


class _Rival(NamedTuple):
    """An explanation in which nothing passes."""

    code: str
    """What it is."""
    log_likelihood: float
    """Of the image, nepers."""
    pattern: float = 0.0
    """What the shape of its pattern gains over any shape, nepers."""
    log_prior: float = -PRIOR_LOG_ODDS
    """Log of its prior probability over that of a passage."""


def _rivals(
    evidence: FringeEvidence, fitted: _Fitted, rest: _Leftovers, divisor: float
) -> Iterator[_Rival]:
    """Yield explanations in which nothing passes.

    ``divisor``: what log-likelihoods are divided by.
    """
    model, found = fitted.model, fitted.passage
    panel, own = model.panel, model.templates[0]
    still = likeliest_still(panel)
    one = still.course, still.prior
    # rows may bend otherwise where nothing passes
    own_bend = [_Leftovers(panel._replace(bend=each), rest.known) for each in BENDS]
    likely, in_place = max(
        ((each.beside([one]), each) for each in own_bend), key=lambda each: each[0]
    )
    yield _Rival(STAYS, likely + still.share)
    # rain adds power: where its logarithm bends, the square of its course is there, too
    bent = _still(panel, np.square(contrast_of(panel.time_s, still.course)))
    for variance in STILL_VARIANCES:
        bending = bent, Template(still.prior.knots, variance)
        yield _Rival(STAYS, in_place.beside([one, bending]) + still.share)
    upside = [
        found._replace(invariant=-1.0, time_s=found.time_s + k * found.width_s)
        for k in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]
    alone = FringeModel(panel, [own])
    best = max(upside, key=lambda each: alone.log_likelihood([each]))
    yield _Rival(UPSIDE_DOWN, rest.moving(best, own))
    first, last = float(panel.time_s[0]), float(panel.time_s[-1])
    even = (panel.time_s, np.ones(panel.time_s.size))
    away = [
        Hypothesis(place, 1.0, 1.0, course=even, tilt=found.tilt)
        for share in AWAY
        for place in (first - share * (last - first), last + share * (last - first))
    ]
    best = max(away, key=lambda each: alone.log_likelihood([each]))
    yield _Rival(OUTSIDE_ALONE, rest.moving(best, own), log_prior=0.0)
    for passage in _passing_outside(evidence, fitted):
        yield _Rival(OUTSIDE_ALONE, rest.moving(passage, own), log_prior=0.0)
    swing = likeliest_course(
        panel, flattened(panel), shift_of(panel.time_s, found),
        contrast_of(panel.time_s, found), max(VARIANCES),
    )  # fmt: skip
    machine = Hypothesis(0.0, 1.0, course=even, swing=(panel.time_s, swing), tilt=found.tilt)
    # as fine as lines are, too: fringes of many images of a loud vessel are no wider
    own = _likeliest_template(panel, machine, (LINE_KNOTS, *KNOTS), VARIANCES)
    free = FringeModel(panel, [own]).log_likelihood([machine])
    pattern = lines_gain(panel, machine) - free
    pattern += FringeModel(panel, []).log_likelihood([])
    share = course_share(panel, machine, own, divisor)
    likely = rest.moving(machine, own)
    yield _Rival(MOVING_LINES, likely, pattern, share - PRIOR_LOG_ODDS)


def _passing_outside(evidence: FringeEvidence, fitted: _Fitted) -> Iterator[Hypothesis]:
    """Yield passages outside the recording that the same rows may be of."""
    every = evidence.proposals()
    far = [
        one for one in every
        if not evidence.is_inside(np.array(one.time_s), one.width_s)
        and one.gain > ALIKE * every[0].gain
    ]  # fmt: skip
    law = _Law.of(evidence.mach, is_mirror=True)
    for one in far[:1]:
        start = fitted.passage._replace(time_s=one.time_s, width_s=one.width_s, invariant=1.0)
        told = _climbed(evidence, start, law, fitted.model)
        if told is not None:
            passage = told.passage
            if not evidence.is_inside(np.array(passage.time_s), passage.width_s):
                yield passage


def _still(panel: Panel, course: FloatArray) -> Hypothesis:
    """Return a pattern that stays where it is, and rises and falls in time."""
    return Hypothesis(0.0, 1.0, 0.0, course=(panel.time_s, course))


class LikeliestStill(NamedTuple):
    """A pattern that rises and falls in place, as it explains rows best."""

    course: Hypothesis
    """How it rises and falls."""
    prior: Template
    """Of its pattern."""
    share: float
    """Log of the prior probability of courses that agree with the rows, nepers."""


def likeliest_still(panel: Panel) -> LikeliestStill:
    """Return what explains rows best in place.

    Its course is that of the level, as of rain, or any; what it deviates by is a normal
    process whose variance and correlation from row to row are found from the rows, so that
    a course that follows noise gains nothing.

    Parameters
    ----------
    panel
        Rows of the image, shape (frames, cells), with their precisions.
    """
    value = flattened(panel) * np.sqrt(panel.precision)
    course = np.linalg.svd(value, full_matrices=False)[0]
    level = (panel.value - np.median(panel.value, axis=0)) @ panel.precision
    starts = [course[:, 0], level - np.quantile(level, 0.1)]
    found = []
    for start in starts:
        own = start / np.abs(start).max()
        still = _still(panel, own)
        prior = _likeliest_template(panel, still, KNOTS[:2], STILL_VARIANCES)
        model = FringeModel(panel, [prior])
        pattern = model.explain([still]).pattern[0]
        row = int(np.argmax(np.abs(own)))
        shape = pattern_in(panel, still, prior, pattern, panel)[row] / own[row]
        heard, told = model.along(shape)
        square = float((own**2).mean())
        is_level = start is starts[1]
        usual = own if is_level else np.zeros(own.size)
        variances = square * np.array(COURSE_VARIANCES if is_level else (1.0,))
        off = heard - told * (usual - usual.mean())
        _, share, by = max(_process(off, told, variances), key=lambda each: each[0])
        one = _still(panel, usual + by)
        likely = model.log_likelihood([one]) + share
        found.append((likely, LikeliestStill(one, prior, share)))
    return max(found, key=lambda each: each[0])[1]


def _process(
    heard: FloatArray, told: float, variances: FloatArray
) -> Iterator[tuple[float, float, FloatArray]]:
    """Yield what normal processes gain, the log of their prior share, and their mean.

    ``heard``: measurements times their precision. ``told``: that precision.
    """
    for correlation in CORRELATIONS:
        value, axes = np.linalg.eigh(_precision_of(heard.size, correlation))
        part = heard @ axes
        for variance in variances:
            before = value / variance
            mean = part / (before + told)
            share = 0.5 * float(np.log(before / (before + told)).sum())
            share -= 0.5 * float(before @ mean**2)
            gain = float(part @ mean - 0.5 * told * mean @ mean) + share
            yield gain, share, axes @ mean


def _precision_of(count: int, correlation: float) -> FloatArray:
    """Return the precision of a process of unit variance whose neighbours correlate."""
    own = np.full(count, 1.0 + correlation**2)
    own[[0, -1]] = 1.0
    beside = np.full(count - 1, -correlation)
    total = np.diag(own) + np.diag(beside, 1) + np.diag(beside, -1)
    return np.asarray(total / (1.0 - correlation**2))


STRETCH_S = 3600.0
"""Length of what is searched at once; the next begins in its middle, s."""


def fringe_passages(fringes: Fringes, mach: tuple[float, float]) -> list[FringePassage]:
    """Return the passages that an image of fringes tells, in the order of time.

    Parameters
    ----------
    fringes
        The image.
    mach
        Speed of vessels over that of sound, and its deviation.
    """
    time_s = fringes.time_s
    if time_s.size < FEWEST_ROWS or not fringes.frequency_hz.size:
        return []
    first, last = float(time_s[0]), float(time_s[-1])
    found: list[FringePassage] = []
    for start_s in np.arange(first, max(last - 0.5 * STRETCH_S, first + 1.0), 0.5 * STRETCH_S):
        rows = (time_s >= start_s) & (time_s < start_s + STRETCH_S)
        part = fringes.take("row", np.flatnonzero(rows))
        middle_s = start_s + 0.5 * STRETCH_S
        for one in _of_stretch(FringeEvidence(part, mach)):
            lag_s = one.passage.time_s - middle_s
            is_own = (
                -0.25 * STRETCH_S <= lag_s < 0.25 * STRETCH_S
                or (lag_s < 0.0 and start_s == first)
                or (lag_s >= 0.0 and start_s + STRETCH_S > last)
            )
            if is_own:
                found.append(one)
    return sorted(found, key=lambda one: one.passage.time_s)


def evidence_of_levels(
    fringes: Fringes, mach: tuple[float, float], known: Sequence[FringePassage],
    report: PassageReport,
) -> float:  # fmt: skip
    """Return the log evidence of fringes for a passage that levels tell, nepers.

    A vessel shows a pattern that moves as the passage has it, whose odds against rivals
    are weighed as ever, or none: the louder she is in the band, the less often. What rises
    in place is evidence of levels, and counts there. nan where too little was recorded.
    ``known``: passages that are taken out of the image.
    """
    width_s = report.range_over_speed_s
    if width_s < LEAST_WIDTH_S:
        return float("nan")
    near = np.abs(fringes.time_s - report.time_s) <= 2.0 * FIT_REACH * width_s
    part = fringes.take("row", np.flatnonzero(near))
    evidence = FringeEvidence(part, mach).explained(known)
    one = fit_passage(evidence, Proposal(0.0, report.time_s, width_s))
    if one is None:
        return float("nan")
    law = Hypothesis(report.time_s, width_s, fading=1.0)
    course = contrast_of(part.time_s, law)
    power = 10.0 ** ((part.level_db - np.nanmax(part.level_db)) / 10.0)
    heard = np.isfinite(power)
    rise, sea = np.polyfit(course[heard], power[heard], 1).tolist()
    unseen = 1.0 - MOST_SHOWN * max(rise, 0.0) / max(rise + sea, 1e-9)
    agrees = same_vessel(one.report, report) > 0.0
    shown = np.exp(min(one.log_odds, 50.0)) if agrees else 0.0
    return float(np.log(unseen + (1.0 - unseen) * shown))


def _of_stretch(evidence: FringeEvidence) -> list[FringePassage]:
    """Return the passages of a stretch that can be told."""
    known: list[FringePassage] = []
    for _ in range(MOST_PASSAGES):
        rest = evidence.explained(known)
        one = likeliest_fit(rest)
        if one is None or one.log_odds < (PERHAPS if known else 0.0):
            break
        known.append(one)
    # each once more, with the others taken out as they are in the end
    for k, one in enumerate(known):
        if len(known) > 1 and evidence.can_tell(one):
            start = Proposal(one.gain, one.passage.time_s, one.passage.width_s)
            rest = evidence.explained(known[:k] + known[k + 1 :])
            known[k] = fit_passage(rest, start, one.passage.fading) or one
    # images in a bottom make R/v longer each by its own: they are of one vessel
    vessels: list[FringePassage] = []
    frequency_hz = evidence.fringes.frequency_hz
    told = [one for one in known if one.log_odds >= 0.0 and evidence.can_tell(one)]
    for one in (in_water(_mirrored(each, frequency_hz)) for each in told):
        if all(same_vessel(one.report, other.report) <= 0.0 for other in vessels):
            vessels.append(one)
    return vessels


def likeliest_fit(evidence: FringeEvidence) -> FringePassage | None:
    """Return the likeliest passage; None if there is none.

    Far from its closest approach a vessel fixes little but its bend, and where patterns
    overlap a short piece gains as much as a long passage: of proposals that are about as
    good, the likeliest, the likeliest that can be told and the longest of these are fitted.
    """
    every = evidence.proposals()
    least = max(LEAST_GAIN, ALIKE * every[0].gain) if every else LEAST_GAIN
    alike = [one for one in every if one.gain >= least]
    inside = [one for one in alike if evidence.is_inside(np.array(one.time_s), one.width_s)]
    longest = sorted(inside, key=lambda one: -one.width_s)
    starts: list[Proposal] = []
    for one in (*alike[:1], *inside[:1], *longest[:1]):
        if all(_is_apart(one, other) for other in starts):
            starts.append(one)
    fits = [fit_passage(evidence, one) for one in starts]
    return max((one for one in fits if one), key=lambda one: one.log_odds, default=None)


def _is_apart(one: Proposal, other: Proposal) -> bool:
    """Return whether two proposals lie in different places."""
    ratio = abs(float(np.log(one.width_s / other.width_s)))
    return abs(one.time_s - other.time_s) > 0.5 * one.width_s or ratio > 0.6
