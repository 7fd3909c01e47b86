"""Gains, crosstalk and orientation of two dipoles from a vessel of known bearing.

**Method.** In every frame the intensities along the dipoles, over the power of the omni
channel, are a linear image of the direction of the vessel (gains, crosstalk,
orientation), of the omni channel that leaks into them, and of the ambient's own
directed sound, which counts less the louder the vessel is. Nonlinear least squares with
a loss that grows linearly for frames that fit badly; every unknown but the orientation
has a prior, so that a passage that shows few directions cannot tell much and says so.
Errors of the known track (place, clock) are unknowns with priors, too.

**Conventions.** Angles clockwise from the nominal second axis (north, or the bow) to
the vessel. The response is that of `Sensor.dipole_response`.

**References.** Greene et al. (2004), J. Acoust. Soc. Am. 116, 2678 (DIFAR recorders
calibrated by sources of known place); Huber (1964) for the loss.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.angles import wrap_deg, wrap_rad

NAMES = (
    "first_gain", "second_gain", "dipole_crosstalk", "first_omni_crosstalk",
    "second_omni_crosstalk", "orientation_deg",
)  # fmt: skip
"""What is measured, in the order of the unknowns."""

GAIN_STD, SHARE_STD = 0.4, 0.15
"""Prior deviations: of the logarithm of a gain, and of a share of another channel."""

LARGEST_GAIN, LARGEST_SHARE = 100.0, 0.9
"""Limits of a gain (and of its inverse) and of a share: those of the sensor file."""

AMBIENT_STD, DIRECTED_STD = 0.3, 0.5
"""Prior deviations: of the ambient over the quiet density, which is 1, and of its
directed part, in the same unit."""

MODEL_STD = 0.02
"""Deviation of the direction of sound about the model, rad: paths by way of surface
and bottom."""

LEAST_SCALE = 0.5
"""Least variance of the residuals over the one expected with which deviations are
given: quiet sound does not show how far paths of its own may lead."""

FEWEST_FRAMES = 30
"""Frames in which the vessel is heard that a calibration needs."""

LEAST_EXCESS = 1.5
"""Power over the quiet density from which a frame counts as the vessel's."""

SMOOTHED_FRAMES = 9
"""Frames over which the power is averaged that tells the ambient's share."""

LEAST_SPAN_DEG = 40.0
"""Change of the vessel's bearing that a calibration needs."""

MIRRORED_SHARE = 0.5
"""The mirror image of the axes fits when it leaves less than this share of the cost."""

TOLD_SHARE = 0.7
"""A quantity is told by the passage if its deviation is below this share of the prior."""

MAX_LAG = 200
"""Frames over which the correlation of the residuals is summed."""


class MirroredDipolesError(DataError):
    """The bearings of a passage turn the wrong way round."""


@dataclass(frozen=True)
class KnownPassage:
    """Where sound came from, frame by frame, as a track says; shape (frame,)."""

    angle_rad: FloatArray
    """Angle from the nominal second axis to the vessel, clockwise."""
    cos_elevation: FloatArray
    """Cosine of the angle between the sound's way and the horizontal."""
    slope: FloatArray
    """Change of that angle with each error of the track, shape (frame, error), rad."""
    prior_std: FloatArray
    """Deviation of each of these errors, in its unit, shape (error,)."""
    power: FloatArray
    """Power over the quiet density."""
    intensity: FloatArray
    """Intensity along both dipoles, in the same unit, shape (frame, 2)."""
    n_cells: FloatArray
    """Independent cells of each frame."""


@dataclass(frozen=True)
class DipoleFit:
    """What was measured of two dipoles, with deviations; order of `NAMES`."""

    value: FloatArray
    """Gains, dipole crosstalk, omni crosstalk and orientation in degrees, shape (6,)."""
    std: FloatArray
    """Their standard deviations, shape (6,)."""
    is_told: BoolArray
    """Whether the passage tells them, beyond what was assumed, shape (6,)."""
    bearing_std_deg: float
    """Deviation that the calibration leaves in a bearing, rms over all directions."""
    before_deg: float
    """Root mean square error of the bearings of the passage before, degrees."""
    after_deg: float
    """The same with what was measured."""
    n_frames: int
    """Frames in which the vessel was heard."""
    span_deg: float
    """Change of its bearing over them, degrees."""


def fit_dipoles(known: KnownPassage) -> DipoleFit:
    """Fit the response of two dipoles to a passage of known bearings.

    Frames that are not finite, or too quiet, are left out.

    Raises
    ------
    DataError
        The vessel is hardly heard, or shows too few directions.
    MirroredDipolesError
        The axes are mirrored.
    """
    heard = _heard(known)
    angle = np.unwrap(known.angle_rad[heard])
    span_deg = float(np.degrees(np.ptp(angle))) if angle.size else 0.0
    if angle.size < FEWEST_FRAMES or span_deg < LEAST_SPAN_DEG:
        raise DataError(
            f"the vessel is above the quiet time in {angle.size} frames over "
            f"{span_deg:.0f} degrees of bearing; a calibration needs {FEWEST_FRAMES} "
            f"frames and {LEAST_SPAN_DEG:g} degrees. Take a nearer passage, or the band "
            f"in which it is loud (--band-hz)."
        )
    problem = _Problem(known, heard)
    fit = problem.solve()
    mirrored = _Problem(known, heard, mirror=-1.0).solve()
    if mirrored.cost < MIRRORED_SHARE * fit.cost:
        raise MirroredDipolesError(
            "the bearings turn the wrong way round: the dipoles are exchanged, or one "
            "of them is inverted. Correct the order of the channels in the sensor file, "
            "or the sign of the channel."
        )
    covariance = problem.covariance(fit)
    prior = np.append(problem.prior_std[:5], np.pi)
    std = np.sqrt(np.diag(covariance))
    value, unit = fit.x[:6].copy(), np.ones(6)
    value[:2] = np.exp(value[:2])
    unit[:2], unit[5] = value[:2], np.degrees(1.0)
    value[5] = wrap_deg(np.degrees(value[5]))
    return DipoleFit(
        value=value,
        std=std[:6] * unit,
        is_told=std[:6] < TOLD_SHARE * prior,
        bearing_std_deg=_bearing_std_deg(fit.x, covariance[:6, :6]),
        before_deg=problem.bearing_error_deg(np.zeros(fit.x.size)),
        after_deg=problem.bearing_error_deg(fit.x),
        n_frames=int(angle.size),
        span_deg=span_deg,
    )


def _heard(known: KnownPassage) -> BoolArray:
    finite = np.isfinite(known.angle_rad) & np.isfinite(known.intensity).all(axis=1)
    with np.errstate(invalid="ignore"):
        loud = _smoothed(known.power) >= LEAST_EXCESS
    return finite & loud


def _smoothed(power: FloatArray) -> FloatArray:
    """Return the running mean: a frame's own noise must not choose its own model."""
    weight = np.ones(SMOOTHED_FRAMES)
    there = np.isfinite(power)
    total = np.convolve(np.where(there, power, 0.0), weight, "same")
    count = np.convolve(there.astype(float), weight, "same")
    return np.where(there, total / np.maximum(count, 1.0), np.nan)


def _image(x: FloatArray, angle: FloatArray) -> FloatArray:
    """Return what both dipoles show of a distant source alone, shape (frame, 2)."""
    turned = angle - x[5]
    sine, cosine = np.sin(turned), np.cos(turned)
    first = np.exp(x[0]) * (sine + x[2] * cosine + x[3])
    second = np.exp(x[1]) * (x[2] * sine + cosine + x[4])
    return np.stack([first, second], axis=-1)


class _Problem:
    """Residuals of a passage: six unknowns of the response, ambient, track errors."""

    def __init__(self, known: KnownPassage, heard: BoolArray, mirror: float = 1.0) -> None:
        self.angle = mirror * known.angle_rad[heard]
        self.level = known.cos_elevation[heard][:, None]
        self.slope = mirror * known.slope[heard]
        self.ratio = (known.intensity / known.power[:, None])[heard]
        self.power = _smoothed(known.power)[heard]
        # isotropic noise in the cells beside the vessel's, and paths of its own
        noise = 1.0 / (6.0 * self.power * known.n_cells[heard])
        self.std = np.sqrt(noise + MODEL_STD**2)[:, None]
        self.prior_std = np.concatenate(
            [
                [GAIN_STD, GAIN_STD, SHARE_STD, SHARE_STD, SHARE_STD, np.inf],
                [AMBIENT_STD, DIRECTED_STD, DIRECTED_STD], known.prior_std,
            ]
        )  # fmt: skip

    def model(self, x: FloatArray) -> FloatArray:
        """Return intensity over power, shape (frame, 2)."""
        angle = self.angle + self.slope @ x[9:]
        ambient = (1.0 + x[6]) / self.power
        share = np.clip(1.0 - ambient, 0.0, 1.0)[:, None]
        gains = np.exp(x[:2])
        leak = gains * x[3:5]
        directed = gains * x[7:9] / self.power[:, None]
        direct = self.level * (_image(x, angle) - leak)
        return np.asarray(share * direct + leak + directed)

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return the residuals over their deviations, the priors' last."""
        part = (self.ratio - self.model(x)) / self.std
        return np.concatenate([part.ravel(), x / self.prior_std])

    def solve(self) -> Any:
        """Return the best fit from four orientations."""
        from scipy.optimize import least_squares

        starts = np.zeros((4, self.prior_std.size))
        starts[:, 5] = np.arange(4) * np.pi / 2.0
        scale = np.where(np.isfinite(self.prior_std), self.prior_std, 1.0)
        limit = np.full(self.prior_std.size, np.inf)
        limit[:2], limit[2:5] = np.log(LARGEST_GAIN), LARGEST_SHARE
        found = [
            least_squares(
                self.residuals, start, loss="huber", f_scale=2.0,
                x_scale=np.maximum(scale, 1e-6), bounds=(-limit, limit),
            )
            for start in starts
        ]  # fmt: skip
        return min(found, key=lambda one: float(one.cost))

    def covariance(self, fit: Any) -> FloatArray:
        """Return the covariance of the unknowns, widened by what the frames share."""
        n_data = self.ratio.size
        rows = fit.jac[:n_data]
        residual = self.residuals(fit.x)[:n_data].reshape(-1, 2)
        scale = float(np.mean(np.clip(residual, -2.0, 2.0) ** 2))
        scale = max(scale, LEAST_SCALE)
        widened = scale * _correlated_frames(residual)
        prior = np.diag(self.prior_std**-2.0)
        return np.asarray(np.linalg.inv(rows.T @ rows / widened + prior))

    def bearing_error_deg(self, x: FloatArray) -> float:
        """Return the rms error of bearings that a response gives, degrees."""
        matrix = _matrix(x)
        ideal = np.linalg.solve(matrix[:, :2], (self.ratio - matrix[:, 2]).T)
        # what the ambient and errors of the track do is no error of the response
        off = np.arctan2(*ideal) + x[5] - (self.angle + self.slope @ x[9:])
        error = np.degrees(wrap_rad(off))
        return float(np.sqrt(np.average(error**2, weights=self.power)))


def _matrix(x: FloatArray) -> FloatArray:
    gains = np.exp(x[:2])[:, None]
    shares = np.array([[1.0, x[2], x[3]], [x[2], 1.0, x[4]]])
    return np.asarray(gains * shares)


def _correlated_frames(residual: FloatArray) -> float:
    """Return by how much the correlation of the frames widens a variance, at least 1."""
    n = residual.shape[0]
    power = float(np.sum(residual**2))
    total = 1.0
    for lag in range(1, min(MAX_LAG, n // 4)):
        here = float(np.sum(residual[lag:] * residual[:-lag])) / power
        if here <= 0.0:
            break
        total += 2.0 * here
    return total


def _bearing_std_deg(x: FloatArray, covariance: FloatArray) -> float:
    """Return the deviation of corrected bearings, rms over 72 directions."""
    angle = np.arange(72) * np.pi / 36.0
    seen = _image(x, angle)

    def bearing(values: FloatArray) -> FloatArray:
        matrix = _matrix(values)
        ideal = np.linalg.solve(matrix[:, :2], (seen - matrix[:, 2]).T)
        return np.asarray(np.arctan2(*ideal) + values[5])

    step = 1e-5
    slopes = []
    for k in range(6):
        moved = np.tile(x[:6], (2, 1))
        moved[:, k] += [step, -step]
        change = wrap_rad(bearing(moved[0]) - bearing(moved[1]))
        slopes.append(change / (2.0 * step))
    table = np.array(slopes)
    variance = np.einsum("in,ij,jn->n", table, covariance, table)
    return float(np.degrees(np.sqrt(variance.mean())))
