"""Directions that an array heard, as the bearings of a passage.

**Method.** A direction belongs to its frame. The levels of one hydrophone have frames
of their own: each takes the direction that is nearest in time, if it lies within the
hop. Without levels the bearings are a series by themselves.

Of several sources in a frame a contact has one. Where its lines have bearings it is the
source that lies nearest to them, and none if none lies near: which one is the strongest
changes as vessels come and go. Without lines the levels, which are those of all sources
together, have the strongest one's direction; and the series has a contact for every
source whose direction goes on from frame to frame (a Kalman filter of bearing and rate
for each, and the likeliest pairing of a frame's directions with them).

The error of the array's heading, the same for all, is not among the deviations.

**References.** Y. Bar-Shalom, P. K. Willett & X. Tian, Tracking and Data Fusion (2011),
section 3.7 (pairing of the likeliest total).
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.directions import LINE, Directions
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.assignment import assign
from uwtrack_cli.estimation.constant_velocity import transition, white_acceleration

GATE = 4.0
"""Deviations within which a direction may be that of a source or of a line."""

WIDEST_DEG = 30.0
"""Most by which it may be off, however long the source was not heard."""

LEAST_FRAMES = 8
"""Directions of one source that make a contact: false ones are single."""

STEP_DEG, RATE_STEP_DEG = 1.0, 0.5
"""Deviations by which a bearing, and its rate, change unforeseen from one frame to the
next; frames are chosen short beside the passage."""


def with_directions(levels: Levels | None, directions: Directions | None) -> Levels | None:
    """Return levels with the bearings of an array.

    Parameters
    ----------
    levels
        Levels of one hydrophone.
    directions
        What the array heard, in the order of time; None leaves the levels as they are.
    """
    if levels is None or directions is None:
        return levels
    directions = directions.strongest()
    nearest = _nearest(levels.frames.time_s, directions, levels.frames.hop_s)
    bearing, std = np.full((2, levels.frames.n_frames), np.nan)
    # a direction counts once: for the frame that is nearest to it
    _, first = np.unique(nearest, return_index=True)
    taken = first[nearest[first] >= 0]
    bearing[taken] = directions.bearing_deg[nearest[taken]]
    std[taken] = directions.bearing_std_deg[nearest[taken]]
    return replace(levels, bearing_deg=bearing, bearing_std_deg=std)


def with_directions_of(
    levels: Levels, directions: Directions | None, lines: Lines | None, contacts: tuple[int, ...]
) -> Levels:
    """Return levels with the bearings of the source that some contacts are.

    Parameters
    ----------
    levels
        Levels of one hydrophone, with the bearings of the strongest source.
    directions
        What the array heard; None leaves the levels as they are.
    lines
        Tracked lines. Without a bearing of theirs the levels stay as they are.
    contacts
        Numbers of the contacts.
    """
    if directions is None or lines is None or directions.source is None:
        return levels
    ids = lines.line_id[np.isin(lines.line_contact, contacts)]
    known = np.isin(lines.line, ids) & np.isfinite(lines.bearing_deg)
    if not known.any():
        return levels
    found = with_directions(levels, _beside_lines(directions, lines, known))
    return levels if found is None else found


def _beside_lines(directions: Directions, lines: Lines, known: BoolArray) -> Directions:
    """Return of every frame the direction nearest to the lines, as its only one."""
    points = np.flatnonzero(known)
    points = points[np.argsort(lines.time_s[points], kind="stable")]
    times, first, count = np.unique(lines.time_s[points], return_index=True, return_counts=True)
    variance = lines.bearing_covariance[points, 0, 0].astype(np.float64)
    weight = 1.0 / np.maximum(variance, 1e-6)
    turn = weight * np.exp(1j * np.radians(lines.bearing_deg[points]))
    sums = np.add.reduceat(turn, first), np.add.reduceat(weight, first)
    bearing, std = np.degrees(np.angle(sums[0])), np.sqrt(count / sums[1])
    step_s = float(np.diff(times).min()) if times.size > 1 else 0.0
    at = np.searchsorted(times, directions.time_s)
    at = np.clip(at, 1, max(times.size - 1, 1))
    left, right = at - 1, np.minimum(at, times.size - 1)
    is_left = directions.time_s - times[left] <= times[right] - directions.time_s
    near = np.where(is_left, left, right)
    reach_s = max(step_s, _step_s(directions)) + 1e-6
    off = np.abs(wrap_deg(directions.bearing_deg - bearing[near]))
    gate = GATE * np.hypot(directions.bearing_std_deg, std[near])
    own = (off <= np.minimum(gate, WIDEST_DEG)) & (
        np.abs(directions.time_s - times[near]) <= reach_s
    )
    rows = np.flatnonzero(own)
    rows = rows[np.lexsort((off[rows], directions.time_s[rows]))]
    _, best = np.unique(directions.time_s[rows], return_index=True)
    kept = directions.take("direction", rows[best])
    return replace(kept, source=np.ones(best.size, np.int64))


def _nearest(time_s: FloatArray, directions: Directions, hop_s: float) -> IntArray:
    """Return the direction nearest to each time, -1 where none lies within the hop."""
    if not directions.time_s.size or not time_s.size:
        return np.full(time_s.size, -1)
    reach_s = 0.5 * max(hop_s, _step_s(directions)) + 1e-6
    right = np.searchsorted(directions.time_s, time_s)
    right = np.clip(right, 0, directions.time_s.size - 1)
    left = np.maximum(right - 1, 0)
    apart = np.abs(directions.time_s[[left, right]] - time_s)
    nearest = np.where(apart[0] <= apart[1], left, right)
    return np.where(apart.min(axis=0) <= reach_s, nearest, -1)


def _step_s(directions: Directions) -> float:
    steps = np.diff(np.unique(directions.time_s))
    return float(steps.min()) if steps.size else 0.0


def bearing_series(directions: Directions) -> Series:
    """Return directions as a series of bearings, a contact for every source."""
    contact = sources_in_time(directions)
    kept = np.flatnonzero(contact > 0)
    kept = kept[np.lexsort((directions.time_s[kept], contact[kept]))]
    n = kept.size
    nothing = np.full(n, np.nan)
    mirrored = None
    if directions.ambiguity == LINE:  # the one lobe of every direction
        mirrored = directions.lobe_bearing_deg[kept]
    return Series(
        mirrored_bearing_deg=mirrored,
        contact=contact[kept],
        time_s=directions.time_s[kept],
        bearing_deg=directions.bearing_deg[kept],
        bearing_std_deg=directions.bearing_std_deg[kept],
        frequency_hz=np.zeros((n, 0)),
        frequency_std_hz=np.zeros((n, 0)),
        level_db=nothing,
        level_std_db=nothing,
        start_utc_ns=directions.start_utc_ns,
    )


def sources_in_time(directions: Directions) -> IntArray:
    """Return to which source every direction belongs.

    Parameters
    ----------
    directions
        What the array heard, in the order of time.

    Returns
    -------
    array, shape (direction,)
        Numbers from 1, the source that is heard in most frames; 0 for what is heard too
        seldom. Where frames have one direction each, all of it is source 1.
    """
    if directions.source is None or (directions.source == 1).all():
        return np.ones(directions.time_s.size, np.int64)
    owner = np.full(directions.time_s.size, -1)
    times, first = np.unique(directions.time_s, return_index=True)
    step_s = _step_s(directions)
    heard: list[_Heard] = []
    for time_s, rows in zip(times, np.split(np.arange(owner.size), first[1:]), strict=True):
        bearing = directions.bearing_deg[rows]
        variance = directions.bearing_std_deg[rows] ** 2
        foreseen = [one.at((time_s - one.time_s) / step_s) for one in heard]
        if foreseen:
            off = np.abs([wrap_deg(bearing - one.bearing_deg) for one in foreseen])
            total = np.array([variance + one.spread[0, 0] for one in foreseen])
            is_near = (off <= GATE * np.sqrt(total)) & (off <= WIDEST_DEG)
            numbers, places = np.nonzero(is_near)
            cost = (off**2 / total + np.log(total))[is_near]
            for pair in assign(numbers, places, cost):
                number, k = int(numbers[pair]), places[pair]
                heard[number] = foreseen[number].with_bearing(bearing[k], variance[k], time_s)
                owner[rows[k]] = number
        for k in np.flatnonzero(owner[rows] < 0):
            owner[rows[k]] = len(heard)
            heard.append(_Heard.new(bearing[k], variance[k], time_s))
    count = np.bincount(owner, minlength=len(heard))
    order = np.argsort(-count, kind="stable")
    order = order[count[order] >= min(LEAST_FRAMES, count.max(initial=0))]
    rank: IntArray = np.zeros(len(heard), np.int64)
    rank[order] = np.arange(1, order.size + 1)
    return np.asarray(rank[owner])


@dataclass(frozen=True, eq=False)
class _Heard:
    """A source whose bearing is followed, by the frame."""

    bearing_deg: float
    """Its bearing."""
    rate_deg: float
    """Its change from frame to frame."""
    spread: FloatArray
    """Covariance of both, degrees^2."""
    time_s: float
    """When it was heard last."""

    @classmethod
    def new(cls, bearing_deg: float, variance_deg2: float, time_s: float) -> "_Heard":
        """Begin with a bearing; its rate is not known."""
        spread = np.diag([variance_deg2, (WIDEST_DEG / GATE) ** 2])
        return cls(bearing_deg, 0.0, spread, time_s)

    def at(self, frames: float) -> "_Heard":
        """Return what is foreseen so many frames on."""
        forward = transition(frames)
        noise = RATE_STEP_DEG**2 * white_acceleration(frames).matrix
        noise[0, 0] += STEP_DEG**2 * frames
        spread = forward @ self.spread @ forward.T + noise
        return replace(self, bearing_deg=self.bearing_deg + frames * self.rate_deg, spread=spread)

    def with_bearing(self, bearing_deg: float, variance_deg2: float, time_s: float) -> "_Heard":
        """Return what is known with one more bearing."""
        gain = self.spread[:, 0] / (self.spread[0, 0] + variance_deg2)
        off = float(wrap_deg(bearing_deg - self.bearing_deg))
        return _Heard(
            bearing_deg=self.bearing_deg + float(gain[0]) * off,
            rate_deg=self.rate_deg + float(gain[1]) * off,
            spread=self.spread - np.outer(gain, self.spread[0]),
            time_s=time_s,
        )
