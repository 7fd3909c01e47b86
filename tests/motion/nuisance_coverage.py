"""Coverage of stated intervals when what is told is not exact.

Passages of one vessel are drawn, and with them what the program cannot know: depths of
source and sensor, sound speed and compass, from the priors that it is told (or the
source depth uniformly from 0.4 to 7 m). Measurements come from the independent law of
`passage_truth`. A quantity is covered when it lies within 1.96 stated deviations.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from tests.draws.passage_truth import Scene, measure
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import FULL_SCALE
from uwtrack_cli.motion.passage.candidates import examine
from uwtrack_cli.motion.passage.encounter_rows import CpaContext, passage_row
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors

QUANTITIES = (
    "time", "speed", "slant range", "horizontal range", "slant over speed",
    "horizontal over speed", "course",
)  # fmt: skip
SENSOR_DEPTH_M, SENSOR_STD_M, SOUND_STD_MPS, COMPASS_STD_DEG = 22.0, 0.5, 7.5, 2.0
CLASSES = {
    "far": (80.0, 400.0, "prior"),
    "near": (15.0, 80.0, "prior"),
    "overhead": (0.5, 15.0, "prior"),
    "near, depth uniform": (15.0, 80.0, "uniform"),
    "overhead, depth uniform": (0.5, 15.0, "uniform"),
    "far, no line": (80.0, 400.0, "prior"),
    "near, no line": (15.0, 80.0, "prior"),
}


@dataclass(frozen=True)
class Draw:
    """One passage and what came of it; nan where nothing was given."""

    error: np.ndarray
    std: np.ndarray
    wrong_side: bool


def told():
    """Return the priors that the program is given."""
    sensor = Sensor(
        id="h1", depth_m=SENSOR_DEPTH_M, depth_std_m=SENSOR_STD_M,
        sound_speed_std_mps=SOUND_STD_MPS, compass_std_deg=COMPASS_STD_DEG,
    )  # fmt: skip
    return sensor, nuisance_priors(sensor, None, None, 3.0, 2.0)


def draw(kind, rng):
    """Return a scene with the truth of everything, and the compass error in degrees."""
    low, high, depth = CLASSES[kind]
    source = rng.uniform(0.4, 7.0) if depth == "uniform" else -1.0
    while source <= 0:
        source = rng.normal(3.0, 2.0)
    height = SENSOR_DEPTH_M + SENSOR_STD_M * rng.normal() - source
    horizontal = rng.uniform(low, high)
    count = int(rng.integers(1, 5))
    scene = Scene(
        speed_mps=float(rng.uniform(2.5, 8.0)),
        range_m=float(np.hypot(horizontal, height)),
        carrier_to_noise_db=float(rng.uniform(22.0, 34.0)),
        rest_hz=tuple(rng.uniform(40.0, 90.0) * np.arange(2, 2 + count)),
        level_std_db=1.0,
        bearing_std_deg=float(rng.uniform(1.5, 6.0)),
        bearing_deg=float(rng.uniform(0.0, 360.0)),
        turn=int(rng.choice([-1, 1])),
        height_m=float(height),
        sound_speed_mps=float(1500.0 + SOUND_STD_MPS * rng.normal()),
    )
    return scene, COMPASS_STD_DEG * rng.normal()


def analyse(scene, compass_deg, rng, *, has_lines=True):
    """Return the row of a drawn passage, None if none was found."""
    sensor, priors = told()
    data = measure(scene, rng, 1)
    shifted = type(data)(**{**vars(data), "bearing_deg": (data.bearing_deg - compass_deg) % 360})
    ids = np.arange(1, len(scene.rest_hz) + 1)
    if not has_lines:
        ids = ids[:0]
        shifted = type(data)(
            **{
                **vars(shifted),
                "frequency_hz": data.frequency_hz[..., :0, :],
                "frequency_std_hz": data.frequency_std_hz[..., :0, :],
            }
        )
    found = examine(shifted, (1,), ids, priors.medium, 1e-3)
    if found is None:
        return None
    context = CpaContext(sensor, priors, None, FULL_SCALE, None, 20.0)
    return passage_row(1, found.fit, context, found.line_ids)


def score(kind, seed):
    """Draw, analyse and score one passage."""
    rng = np.random.default_rng([seed, list(CLASSES).index(kind)])
    scene, compass = draw(kind, rng)
    row = analyse(scene, compass, rng, has_lines="no line" not in kind)
    if row is None:
        return Draw(np.full(7, np.nan), np.full(7, np.nan), False)
    flat = float(np.sqrt(scene.range_m**2 - scene.height_m**2))
    v = row.values
    pairs = (
        ("time_s", "time_std_s", scene.closest_s),
        ("speed_mps", "speed_std_mps", scene.speed_mps),
        ("slant_range_m", "slant_range_std_m", scene.range_m),
        ("horizontal_range_m", "horizontal_range_std_m", flat),
        ("range_over_speed_s", "range_over_speed_std_s", scene.range_m / scene.speed_mps),
        (
            "horizontal_range_over_speed_s",
            "horizontal_range_over_speed_std_s",
            flat / scene.speed_mps,
        ),
        ("course_deg", "course_std_deg", scene.bearing_deg + 90.0 * scene.turn),
    )
    error = np.array([v[name] - truth for name, _, truth in pairs])
    error[6] = (error[6] + 180.0) % 360.0 - 180.0
    side = "starboard" if scene.turn > 0 else "port"
    return Draw(error, np.array([v[std] for _, std, _ in pairs]), row.side not in ("", side))


def holds_on_both_sides(deviations):
    """Whether errors are as large as stated, neither more nor less, by quantity.

    The mean square of errors over their deviations, shape (draws, quantities), is a
    chi-square's over its degrees of freedom; a quantity in 5000 is beyond by chance.
    """
    low, high = chi2.ppf([1e-4, 1 - 1e-4], len(deviations)) / len(deviations)
    square = np.mean(np.square(deviations), axis=0)
    return bool(np.all((low < square) & (square < high)))
