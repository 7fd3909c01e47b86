"""The measurement-domain scene of the line study: lines, clutter, magnitudes.

**Method.** Ten lines at equal distances share one Doppler factor and one bearing. Each
frame every line has a magnitude N(10, 1 + s^2) and every cell of the band a noise
magnitude N(0, s^2); what exceeds the kept threshold is measured, lines with Gaussian
errors and noise anywhere. The noise is anchored so that at -20 dB the detection
threshold gives a detection probability of 0.75 and a false-alarm rate of 1e-3.

Variants: a threshold that moves with the noise, the amplitudes as literally printed,
a fan of beams with a band of cells each, steady lines of no family beside the ten,
a fade in the middle, a sharp turn of the vessel.

**Conventions.** One frame per second. Nothing here is shared with the tracker.
Magnitudes are scaled so that the detection threshold is the same in all variants.

**References.** Choi (2014), section 4, with the anchoring that its printed figures
require (its literal amplitude model contradicts its detection probabilities).
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.peaks import Peaks

N_FRAMES, N_LINES, N_CELLS = 200, 10, 400
BAND_HZ = (450.0, 850.0)
LINE_MAGNITUDE, THRESHOLD = 10.0, 8.1064
FREQUENCY_STD_HZ, BEARING_STD_DEG = 0.5, 1.0
ALPHA = 0.8
FALSE_ALARM_SIGMAS = 3.0902
"""Threshold of a false-alarm rate of 1e-3, in deviations of the noise."""

LITERAL_THRESHOLD = 9.3255
"""Threshold that N(10, 1), the printed magnitude of a line, exceeds at 75 %."""

FADE_FRAMES, FADE_MAGNITUDE = (80, 120), 6.0
TURN_S, TURN_BEARING_S, TURN_DEG, TURN_DOPPLER = 5.0, 10.0, 20.0, 3e-3


@dataclass(frozen=True)
class SceneRule:
    """Variants of the scene.

    Attributes
    ----------
    snr_db
        SNR in the paper's sense, -20 dB being the anchor.
    n_lines
        Lines of the vessel, 30 Hz apart.
    n_interferers
        Steady lines at random places and bearings, of no family.
    n_beams
        Fans of cells: 36 of 400 cells are the dense clutter.
    threshold
        Fixed as anchored, moving with the noise, or with the printed amplitudes.
    course
        A steady vessel, one whose lines fade, or one that turns sharply.
    """

    snr_db: float
    n_lines: int = N_LINES
    n_interferers: int = 0
    n_beams: int = 1
    threshold: Literal["anchored", "moving", "literal"] = "anchored"
    course: Literal["steady", "fading", "turning"] = "steady"


@dataclass(frozen=True)
class LineScene:
    """A scene of lines: what was measured, and the truth behind it."""

    peaks: Peaks
    """Measurements."""
    source: IntArray
    """Line of each peak, n_lines and above for interferers, -1 for noise."""
    frequency_hz: FloatArray
    """True frequency, shape (frame, line)."""
    bearing_deg: FloatArray
    """True bearing, shape (frame, line)."""


def noise_std(snr_db: float) -> float:
    """Return the noise magnitude's deviation at an SNR (anchored at -20 dB)."""
    return float(2.6232 * 10.0 ** (-(snr_db + 20.0) / 20.0))


class AmplitudeModel(NamedTuple):
    """How magnitudes scatter, and from where they are detected."""

    noise_std: float
    """Deviation of noise."""
    line_std: float
    """Deviation of a line."""
    threshold: float
    """Detection threshold."""


def amplitude_model(rule: SceneRule) -> AmplitudeModel:
    """Return the model of a scene."""
    if rule.threshold == "literal":
        return AmplitudeModel(10.0 ** (-rule.snr_db / 20.0), 1.0, LITERAL_THRESHOLD)
    sigma = noise_std(rule.snr_db)
    level = THRESHOLD if rule.threshold == "anchored" else FALSE_ALARM_SIGMAS * sigma
    return AmplitudeModel(sigma, float(np.hypot(1.0, sigma)), level)


def simulate_scene(rule: SceneRule, rng: np.random.Generator) -> LineScene:
    """Draw one scene of 200 frames."""
    time = np.arange(N_FRAMES, dtype=float)
    frequency, bearing = _truth(rule, time, rng)
    sigma, line_sigma, threshold = amplitude_model(rule)
    mean = np.full(frequency.shape, LINE_MAGNITUDE)
    if rule.course == "fading":
        mean[slice(*FADE_FRAMES), : rule.n_lines] = FADE_MAGNITUDE
    magnitude = rng.normal(mean, line_sigma)
    frame, line = np.nonzero(magnitude > ALPHA * threshold)
    noise = rng.normal(0.0, sigma, (N_FRAMES, N_CELLS * rule.n_beams))
    noise_frame, cell = np.nonzero(noise > ALPHA * threshold)
    n_noise = noise_frame.size
    measured = np.concatenate([
        frequency[frame, line] + rng.normal(0.0, FREQUENCY_STD_HZ, line.size),
        rng.uniform(*BAND_HZ, n_noise),
    ])  # fmt: skip
    turned = np.concatenate([
        bearing[frame, line] + rng.normal(0.0, BEARING_STD_DEG, line.size),
        rng.uniform(0.0, 360.0, n_noise),
    ])  # fmt: skip
    loud = np.concatenate([magnitude[frame, line], noise[noise_frame, cell]])
    source = np.concatenate([line, np.full(n_noise, -1)])
    all_frames = np.concatenate([frame, noise_frame])
    order = np.lexsort((measured, all_frames))
    peaks = to_peaks(
        all_frames[order], measured[order], turned[order] % 360.0,
        loud[order] * (THRESHOLD / threshold),
    )  # fmt: skip
    return LineScene(peaks, source[order], frequency, bearing)


def _truth(
    rule: SceneRule, time: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    doppler, own_bearing = 1e-3 * np.tanh((time - 100.0) / 40.0), 100.0 + 0.2 * time
    if rule.course == "turning":
        doppler = TURN_DOPPLER * np.tanh((time - 100.0) / TURN_S)
        own_bearing += TURN_DEG * np.tanh((time - 100.0) / TURN_BEARING_S)
    lines = (500.0 + 30.0 * np.arange(rule.n_lines)) * (1.0 - doppler)[:, None]
    bearing = np.repeat(own_bearing[:, None], rule.n_lines, axis=1)
    # interferers keep clear of the lines, so that a track has one owner
    cells = np.arange(rule.n_interferers)
    offset = rng.uniform(8.0, 22.0, rule.n_interferers)
    steady = 500.0 + 30.0 * (1 + cells) + offset
    their_bearing = rng.uniform(0.0, 360.0, rule.n_interferers)
    shape = (time.size, rule.n_interferers)
    return (
        np.concatenate([lines, np.broadcast_to(steady, shape)], axis=1),
        np.concatenate([bearing, np.broadcast_to(their_bearing, shape)], axis=1),
    )


def to_peaks(
    frame: IntArray, frequency: FloatArray, bearing: FloatArray, loud: FloatArray
) -> Peaks:
    """Make the container from measurements of known deviations."""
    return Peaks(
        frames=second_frames(N_FRAMES, 20.0 * np.log10(THRESHOLD)),
        frame=frame,
        frequency_hz=frequency,
        frequency_std_hz=np.full(frame.size, FREQUENCY_STD_HZ),
        level_db=20.0 * np.log10(loud),
        snr_db=10.0 * np.log10(loud**2 - 1.0),
        bearing_deg=bearing,
        bearing_std_deg=np.full(frame.size, BEARING_STD_DEG),
        is_detection=loud > THRESHOLD,
        false_alarm_probability=1e-3,
        kept_probability=6.71e-3,
        reference="full scale",
        lowest_hz=BAND_HZ[0],
        highest_hz=BAND_HZ[1],
    )


def second_frames(n_frames: int, threshold_db: float) -> Frames:
    """Return frames of one second, one after the other."""
    number = np.arange(n_frames)
    return Frames(
        start_sample=2000 * number,
        time_s=number + 0.5,
        valid_fraction=np.ones(n_frames),
        band_low_hz=np.array(BAND_HZ[:1]),
        band_high_hz=np.array(BAND_HZ[1:]),
        noise_db=np.zeros((n_frames, 1)),
        threshold_db=np.full(n_frames, threshold_db),
        sensor="study",
        sample_rate_hz=2000.0,
        window_samples=2000,
        hop_samples=2000,
        fft_length=2000,
    )
