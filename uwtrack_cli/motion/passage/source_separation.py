"""Several passages in one broadband: what each puts into levels and bearings.

**Method.** Sources are added one by one where the levels and bearings are least
explained, all motions being fitted together each time. A source is a passage if what
it alone would have given (the working response of the joint fit) shows one by the
same test as everything else. It must be the loudest at its own closest approach, and
apart from the others by half the sum of the widths d/v: else it may be the flank of
another, under a law of spreading that is not quite the assumed one.

**Conventions.** The deviations of a passage are those of its own fit, widened by what
the joint fit loses to the others.
"""

from dataclasses import replace

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.motion.passage.broadband_sum import (
    N_COMMON,
    N_EACH,
    BroadbandSeries,
    KnownSources,
    SourceFit,
    alone,
    fit_sources,
    no_sources,
    widening,
)
from uwtrack_cli.motion.passage.candidates import (
    CandidatePassage,
    RecordingSpan,
    examine_from,
    has_closest_approach,
)
from uwtrack_cli.motion.passage.fit.estimator import PassageFit
from uwtrack_cli.motion.passage.fit.initial_estimates import find_initial_estimates
from uwtrack_cli.motion.passage.model.measurements import (
    NEPER_DB,
    PassageData,
    contact_data,
    make_blocks,
    thin,
)

MOST_SOURCES = 40
"""Passages without lines that are sought in one recording."""

FUTILE = 2
"""Sources that may be added without one more passage coming of it."""

STEP, CLOSE = 0.5, 0.999
"""Step of the differences that tell what a deviation changes, in deviations, and share of
a correlation that is taken, lest it be singular."""

FEWEST_LEVELS = 32
"""Frames below which the broadband is not divided."""


def separate_sources(
    levels: Levels,
    found: list[CandidatePassage],
    medium: Medium,
    false_alarm_probability: float,
    limits: RecordingSpan,
) -> tuple[list[Levels], list[CandidatePassage]]:
    """Divide the broadband among the passages found and those it shows itself.

    Parameters
    ----------
    levels
        Broadband levels and bearings.
    found
        Passages that lines have shown.
    medium
        Sound speed and depth difference.
    false_alarm_probability
        Probability of a passage in noise alone.
    limits
        Length of the frames and ends of the recording.

    Returns
    -------
    tuple[list[Levels], list[CandidatePassage]]
        What each would have given alone, those found first; and those without lines.
    """
    if levels.frames.n_frames < FEWEST_LEVELS:
        return [levels] * len(found), []
    whole = contact_data(None, levels, ())
    search = _Search(thin(whole), found, medium, false_alarm_probability, limits)
    sources, passages = search.run()
    if not passages or len(passages) + len(found) < 2:
        return [levels] * len(found), []
    sound, known = sound_of(whole), _known(found, whole.time_s)
    shares = [
        _replaced(levels, alone(sources, row, sound, known))
        for row in range(len(found) + len(passages))
    ]
    return shares, passages


class _Search:
    """Adds sources to a joint fit while they explain more than noise could."""

    def __init__(
        self,
        data: PassageData,
        found: list[CandidatePassage],
        medium: Medium,
        probability: float,
        limits: RecordingSpan,
    ) -> None:
        self.data, self.found, self.medium = data, found, medium
        self.probability, self.limits = probability, limits
        self.sound = sound_of(data)
        self.known = _known(found, data.time_s)
        places = 2.0 * data.time_s.size
        self.smallest_gain = float(np.log(places / probability))

    def run(self) -> tuple[SourceFit, list[CandidatePassage]]:
        """Return the joint fit of the sources that are passages, and the passages."""
        if np.isfinite(self.sound.power).sum() < FEWEST_LEVELS:
            return SourceFit(np.zeros(1), np.zeros(0), 0.0, 0), []
        sources = no_sources(self.sound, self.known)
        best: tuple[SourceFit, list[CandidatePassage | None]] = (sources, [])
        futile = 0
        while futile < FUTILE and sources.turn.size < MOST_SOURCES:
            grown = self._grown(sources)
            if grown is None:
                break
            sources, passing = grown, self._passing(grown)
            more = _count(passing) > _count(best[1])
            best, futile = ((sources, passing), 0) if more else (best, futile + 1)
        sources, passing = best
        while _count(passing) < len(passing):
            kept = sources.take([n for n, item in enumerate(passing) if item])
            sources = fit_sources(self.sound, self.known, kept.theta[None], kept.turn[None])
            passing = self._passing(sources)
        return sources, [item for item in passing if item]

    def _grown(self, sources: SourceFit) -> SourceFit | None:
        """Add the source that explains most of what is unexplained."""
        rest = alone(sources, None, self.sound, self.known)
        starts = find_initial_estimates(
            make_blocks(_measured(rest, self.data)), self.medium, n_starts=2
        )
        x = (rest.time_s - starts.theta[:, 0:1]) / np.exp(starts.theta[:, 1:2])
        ahead = rest.bearing - starts.turn[:, None] * np.arctan(x)
        weight = 1 / (rest.bearing_std**2 * (1 + x**2))
        vector = np.nansum(weight * np.exp(1j * ahead), axis=1)
        level = sources.background - starts.theta[:, 3]
        new = np.column_stack([starts.theta[:, :2], level, np.angle(vector)])
        count = starts.turn.size
        theta = np.concatenate([np.tile(sources.theta, (count, 1)), new], axis=1)
        turn = np.column_stack([np.tile(sources.turn, (count, 1)), starts.turn])
        # without a bearing the turn of a source changes nothing
        turns = (1.0, -1.0) if np.isfinite(self.sound.bearing).any() else (1.0,)
        theta, turn = _with_halves(sources, theta, turn, turns)
        if not theta.size:
            return None
        grown = fit_sources(self.sound, self.known, theta, turn)
        return grown if sources.cost - grown.cost > self.smallest_gain else None

    def _passing(self, sources: SourceFit) -> list[CandidatePassage | None]:
        """Return which of the free sources are passages; None for the others."""
        wider = widening(sources, self.sound, self.known)
        return [self._examined(sources, row, wider[row]) for row in range(len(wider))]

    def _examined(self, sources: SourceFit, row: int, wider: FloatArray) -> CandidatePassage | None:
        time, width, power, _ = sources.motion[row]
        if not self.limits.first_s < time < self.limits.last_s:
            return None
        if not self._stands_apart(sources, row):
            return None
        own = alone(sources, len(self.found) + row, self.sound, self.known)
        start = np.array([[time, width, 0.0, sources.background - power]])
        made = examine_from(
            _measured(own, self.data), ((1,), np.empty(0, np.int64)),
            (start, sources.turn[row : row + 1]), self.medium, self.probability,
        )  # fmt: skip
        if made is None or not has_closest_approach(made.fit, made.blocks, self.limits):
            return None
        factor = np.array([wider[0], wider[1], 1.0, wider[2], 1.0])
        outer = np.outer(factor, factor)
        fit = replace(
            made.fit,
            covariance=made.fit.covariance * outer[:4, :4],
            full_covariance=made.fit.full_covariance * outer,
        )
        return replace(made, fit=fit)

    def _stands_apart(self, sources: SourceFit, row: int) -> bool:
        """Return whether a source is loudest and clear of the others when nearest."""
        time, width = sources.motion[row, 0], np.exp(sources.motion[row, 1])
        here, law = np.array([time]), sources.theta[1]
        others = [n for n in range(sources.turn.size) if n != row]
        own, spread, _ = _known(self.found, here).moved(sources.theta[None])
        power = np.exp(
            np.concatenate(
                [
                    own[0, :, 0] + law * spread[0, :, 0],
                    _log_power(sources.motion[others], law, time),
                ]
            )
        )
        if power.sum() > np.exp(sources.motion[row, 2]):
            return False
        place = [
            (float(item.fit.theta[0, 0]), float(item.fit.range_over_speed_s[0]))
            for item in self.found
        ]
        place += [
            (float(sources.motion[n, 0]), float(np.exp(sources.motion[n, 1])))
            for n in others
            if sources.motion[n, 2] > sources.motion[row, 2] + np.log(0.1)
        ]
        return all(abs(other - time) > 0.5 * (width + other_width) for other, other_width in place)


def _with_halves(
    sources: SourceFit, theta: FloatArray, turn: FloatArray, turns: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Add starts in which one source is parted into two side by side."""
    more, turned = [theta], [turn]
    for row, (time, width, power, bearing) in enumerate(sources.motion):
        reach = 0.6 * np.exp(width)
        swing = sources.turn[row] * np.arctan(0.6)
        first = N_COMMON + N_EACH * (sources.n_known + row)
        halved = np.append(sources.theta, np.zeros(N_EACH))
        halved[first : first + N_EACH] = (time - reach, width - np.log(2), power, bearing - swing)
        halved[-N_EACH:] = time + reach, width - np.log(2), power, bearing + swing
        for other in turns:
            more.append(halved[None])
            turned.append(np.append(sources.turn, other * sources.turn[row])[None])
    return np.concatenate(more), np.concatenate(turned)


def _log_power(motion: FloatArray, law: float, time_s: float) -> FloatArray:
    x = (time_s - motion[:, 0]) / np.exp(motion[:, 1])
    power: FloatArray = motion[:, 2] - law * np.log1p(x**2)
    return power


def _count(passing: list[CandidatePassage | None]) -> int:
    return sum(item is not None for item in passing)


def _known(found: list[CandidatePassage], time_s: FloatArray) -> KnownSources:
    """Spreading and bearing of passages that lines have shown, and how far they are."""
    shape = len(found), time_s.size
    spread, bearing = np.empty(shape), np.empty(shape)
    slopes = np.zeros((2, *shape, 3))
    precision = np.tile(np.eye(3), (len(found), 1, 1))
    for row, item in enumerate(found):
        fit = item.fit
        spread[row], bearing[row] = _heard(fit, time_s)
        has_bearing = bool(np.isfinite(fit.covariance[0, 3, 3]))
        if not has_bearing:
            bearing[row] = np.nan
        covariance, unit = _deviations(fit, has_bearing=has_bearing)
        precision[row] = np.linalg.inv(covariance)
        for place, off in enumerate(unit[:2]):
            theta = np.repeat(fit.theta, 2, axis=0)
            theta[:, place] += STEP * off * np.array([1.0, -1.0])
            up, down = (_heard(replace(fit, theta=one[None]), time_s) for one in theta)
            slopes[:, row, :, place] = (np.array(up) - down) / (2.0 * STEP)
        slopes[1, row, :, 2] = unit[2]
    return KnownSources(spread, bearing, slopes[0], slopes[1], precision)


def _heard(fit: PassageFit, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return spreading, in nepers, and bearing, rad, of a passage."""
    law = fit.law(time_s)
    ahead = fit.turn[0] * law.angle[0] + np.deg2rad(fit.bearing_deg[0])
    return law.spread[0], ahead


def _deviations(fit: PassageFit, *, has_bearing: bool) -> tuple[FloatArray, FloatArray]:
    """Return correlation and deviations of time, ln of d/v and bearing (rad)."""
    places = [0, 1, 3] if has_bearing else [0, 1]
    width = float(fit.range_over_speed_s[0])
    scale = np.array([1.0, 1.0 / width, np.deg2rad(1.0)])[: len(places)]
    own = fit.covariance[0][np.ix_(places, places)] * np.outer(scale, scale)
    std = np.sqrt(np.maximum(np.diag(own), 1e-18))
    correlation, unit = np.eye(3), np.zeros(3)
    count = len(places)
    correlation[:count, :count] = own / np.outer(std, std)
    correlation[:count, :count] *= CLOSE
    correlation[np.diag_indices(3)] = 1.0
    unit[:count] = std
    return correlation, unit


def sound_of(data: PassageData) -> BroadbandSeries:
    """Return levels and bearings of the broadband alone, in fit units.

    Parameters
    ----------
    data
        Measurements without lines: one row of levels and one of bearings.
    """
    return BroadbandSeries(
        data.time_s,
        data.level_db[0] / NEPER_DB,
        data.level_std_db[0] / NEPER_DB,
        np.deg2rad(data.bearing_deg[0]),
        np.deg2rad(data.bearing_std_deg[0]),
    )


def _measured(sound: BroadbandSeries, like: PassageData) -> PassageData:
    return replace(
        like,
        level_db=NEPER_DB * sound.power[None],
        level_std_db=NEPER_DB * sound.power_std[None],
        bearing_deg=np.rad2deg(sound.bearing)[None] % 360.0,
        bearing_std_deg=np.rad2deg(sound.bearing_std)[None],
    )


def _replaced(levels: Levels, sound: BroadbandSeries) -> Levels:
    return replace(
        levels,
        excess_db=NEPER_DB * sound.power,
        excess_std_db=NEPER_DB * sound.power_std,
        bearing_deg=np.rad2deg(sound.bearing) % 360.0,
        bearing_std_deg=np.rad2deg(sound.bearing_std),
    )
