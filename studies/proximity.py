"""One proximity sensor against two: position errors over half an hour.

**Method.** The Monte Carlo experiment of the paper's section 4.1: a vessel passes two
sensors; time, range over speed, bearing and sensor position carry uniform errors.
Case A predicts from one sensor with a speed of stated error, Case B from two without
Doppler, by the paper's weights and by the weighted least squares that `locate` uses.

**Conventions.** Figures are root-mean-square position errors in metres, with 95 %
intervals. The geometry of the paper's Fig. 4 is lost: see the assumptions.

**References.** Choi et al. (2014), eqs. 1, 15-20; eq. 15 corrected, and as printed.
"""

from dataclasses import dataclass

import numpy as np

from studies.rows import load_reference, root_row
from uwtrack_cli.acoustics.geometry import compass_unit
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.motion.fusion.motion_fit import Approaches, fit_motion, speed_from_two

COURSE_DEG, RANGE_M, ALONG_M = 80.0, 200.0, (771.7, 1543.3)
RANGE_SHARE, DISC_M, BEARING_DEG, TIME_S = 0.20, 25.0, 3.0, 5.0
SPEED_SHARES = {"A0": 0.0, "A5": 0.053, "A20": 0.20}
SPEEDS_KN = (5.0, 10.0, 15.0)
MINUTES = (0.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0)


@dataclass(frozen=True)
class _Draw:
    """Erroneous data of all runs; the last axis but one is the sensor."""

    speed_mps: float
    """True speed, m/s."""
    time_s: FloatArray
    """Times of the closest approaches, s, ``(run, 2)``."""
    width_s: FloatArray
    """Range over speed, s, ``(run, 2)``."""
    bearing_deg: FloatArray
    """Bearings at the closest approach, compass degrees, ``(run, 2)``."""
    sensor: FloatArray
    """Stated positions of the sensors, m, ``(run, 2, 2)``."""
    speed_error: FloatArray
    """Draws in (-1, 1) of the single sensor's speed error, ``(run,)``."""


def study_proximity(*, runs: int = 10_000, seed: int = 1) -> Study:
    """Compare position errors of one and of two proximity sensors over 30 minutes.

    ``runs``: monte Carlo runs per speed.
    """
    reference = load_reference("proximity")
    rng = np.random.default_rng(seed)
    rows: list[StudyRow] = []
    for knots in SPEEDS_KN:
        draw = _draw(knots * KNOT_MPS, runs, rng)
        known = {
            item["time_min"]: item["rmse_m"]
            for item in reference["rows"]
            if item["speed_kn"] == knots
        }
        tracks = _tracks(draw)
        for minutes in MINUTES:
            truth = draw.speed_mps * 60 * minutes * compass_unit(COURSE_DEG)
            case = f"{knots:g} kn, {minutes:g} min"
            for name, predict in tracks.items():
                place = predict(60 * minutes)
                rows += _row(case, name, known[minutes].get(name), place, truth)
        rows += _speed_row(knots, draw, reference["speed_rmse_mps"])
    return Study(
        "proximity", reference["source"], runs, seed, tuple(rows),
        (reference["assumptions"], *REMARKS),
    )  # fmt: skip


REMARKS = (
    "A0, A5, A20: one sensor; speed exact, within 5.3 %, within 20 %",
    "B_p1, B_p2: two sensors, speed by corrected eq. 15, each sensor by itself",
    "B_paper: their mean with the weights of eq. 19; B_cpaw: weights 1/r^2",
    "B_chord: course from eq. 11; B_ls: weighted least squares, as in locate",
    "B_printedA: eq. 15 with its printed sign, which is wrong",
)


def _draw(speed_mps: float, runs: int, rng: np.random.Generator) -> _Draw:
    along = np.array(ALONG_M)
    right = compass_unit(COURSE_DEG + 90.0)
    sensor = along[:, None] * compass_unit(COURSE_DEG) + RANGE_M * right
    angle = 2 * np.pi * rng.random((runs, 2))
    reach = DISC_M * np.sqrt(rng.random((runs, 2)))
    offset = reach[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def uniform(half_width: float) -> FloatArray:
        return rng.uniform(-half_width, half_width, (runs, 2))

    return _Draw(
        speed_mps,
        along / speed_mps + uniform(TIME_S),
        RANGE_M / speed_mps * (1 + uniform(RANGE_SHARE)),
        COURSE_DEG - 90.0 + uniform(BEARING_DEG),
        sensor + offset,
        rng.uniform(-1.0, 1.0, runs),
    )


class _Track:
    """A predicted straight motion: position at any time, for all runs."""

    def __init__(self, start: FloatArray, velocity: FloatArray, time_s: FloatArray) -> None:
        self.start, self.velocity, self.time_s = start, velocity, time_s

    def __call__(self, time_s: float) -> FloatArray:
        """Return the positions, shape (runs, 2)."""
        lag = (time_s - self.time_s)[:, None]
        position: FloatArray = self.start + lag * self.velocity
        return position


class _Mean:
    """The two sensors' predictions, weighted."""

    def __init__(self, tracks: tuple[_Track, _Track], draw: _Draw, kind: str) -> None:
        self.tracks, self.draw, self.kind = tracks, draw, kind

    def __call__(self, time_s: float) -> FloatArray:
        """Return the positions, shape (runs, 2)."""
        square = self.draw.width_s**2
        if self.kind == "range":
            square = square + (time_s - self.draw.time_s) ** 2
        share = (square[:, 1] / square.sum(axis=1))[:, None]
        mean: FloatArray = share * self.tracks[0](time_s) + (1 - share) * self.tracks[1](time_s)
        return mean


def _tracks(draw: _Draw) -> dict[str, _Track | _Mean]:
    """Every method's prediction."""
    tracks: dict[str, _Track | _Mean] = {}
    for name, share in SPEED_SHARES.items():
        speed = draw.speed_mps * (1 + share * draw.speed_error)
        tracks[name] = _single(draw, 0, speed)
    miss = draw.width_s[..., None] * compass_unit(draw.bearing_deg)
    speed = speed_from_two(draw.sensor, draw.time_s, miss)
    pair = (_single(draw, 0, speed), _single(draw, 1, speed))
    tracks |= {"B_p1": pair[0], "B_p2": pair[1]}
    tracks |= {"B_paper": _Mean(pair, draw, "range"), "B_cpaw": _Mean(pair, draw, "")}
    chord = _chord(draw, speed, miss)
    tracks["B_chord"] = _Mean((chord[0], chord[1]), draw, "range")
    tracks["B_ls"] = _least_squares(draw, pair[0])
    wrong = _printed_speed(draw, miss)
    both = (_single(draw, 0, wrong), _single(draw, 1, wrong))
    tracks["B_printedA"] = _Mean(both, draw, "range")
    return tracks


def _single(draw: _Draw, sensor: int, speed: FloatArray) -> _Track:
    """Predict from one sensor: eq. 1 with the sensor to starboard."""
    bearing = draw.bearing_deg[:, sensor]
    reach = (draw.width_s[:, sensor] * speed)[:, None]
    return _Track(
        draw.sensor[:, sensor] + reach * compass_unit(bearing),
        speed[:, None] * compass_unit(bearing + 90.0),
        draw.time_s[:, sensor],
    )


def _chord(draw: _Draw, speed: FloatArray, miss: FloatArray) -> list[_Track]:
    """Predict with the course between the two closest approaches: eq. 11."""
    nearest = draw.sensor + speed[:, None, None] * miss
    step = nearest[:, 1] - nearest[:, 0]
    unit = step / np.hypot(step[:, 0], step[:, 1])[:, None]
    return [_Track(nearest[:, k], speed[:, None] * unit, draw.time_s[:, k]) for k in (0, 1)]


def _printed_speed(draw: _Draw, miss: FloatArray) -> FloatArray:
    """Return the speed by eq. 15 as printed, with a plus sign in A."""
    base = draw.sensor[:, 1] - draw.sensor[:, 0]
    turn = miss[:, 1] - miss[:, 0]
    a = (draw.time_s[:, 1] - draw.time_s[:, 0]) ** 2 + (turn**2).sum(axis=-1)
    b, c = (base * turn).sum(axis=-1), (base**2).sum(axis=-1)
    speed: FloatArray = (b + np.sqrt(b**2 + a * c)) / a
    return speed


def _least_squares(draw: _Draw, start: _Track) -> _Track:
    """Fit time, width and bearing of both sensors by weighted least squares."""
    width = RANGE_M / draw.speed_mps
    variance = np.array(
        [TIME_S**2 / 3, (RANGE_SHARE * width) ** 2 / 3, np.nan, np.deg2rad(BEARING_DEG) ** 2 / 3]
    )
    runs = draw.time_s.shape[0]
    unknown = np.full((runs, 2), np.nan)
    bearing = np.deg2rad(draw.bearing_deg)
    approaches = Approaches(
        np.stack([draw.time_s, draw.width_s, unknown, bearing], axis=-1),
        np.tile(np.diag(np.nan_to_num(variance)), (2, 1, 1)),
        np.ones(2),
        draw.sensor,
        np.full(2, DISC_M / 2),
        np.zeros(2),
        np.zeros(2),
    )
    reference = float(np.mean(ALONG_M)) / draw.speed_mps
    first = np.concatenate([start(reference), start.velocity], axis=1)
    state = fit_motion(approaches, first, reference).state
    return _Track(state[:, :2], state[:, 2:], np.full(runs, reference))


def _row(
    case: str, name: str, known: float | None, position: FloatArray, truth: FloatArray
) -> list[StudyRow]:
    square = ((position - truth) ** 2).sum(axis=-1)
    return root_row(case, f"{name}, position (m)", known, square)


def _speed_row(knots: float, draw: _Draw, known: dict[str, float]) -> list[StudyRow]:
    miss = draw.width_s[..., None] * compass_unit(draw.bearing_deg)
    speed = speed_from_two(draw.sensor, draw.time_s, miss)
    square = (speed - draw.speed_mps) ** 2
    reference = known.get(f"{knots:g}")
    return root_row(f"{knots:g} kn", "corrected eq. 15, speed (m/s)", reference, square)
