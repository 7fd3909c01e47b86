"""A line array: where its hydrophones are, and what it can tell apart.

**Method.** Directions are cosines u with the array's head. Beams lie evenly in u, a
quarter of a beam's width apart, and go two steps beyond the ends, so that a source
ahead or astern lies between beams. The deviation of a direction is the first-order one
of the maximum of a shaded beam; with equal weights it is the Cramer-Rao bound.

**Conventions.** Metres along the array, positive towards its head. u = 1 is ahead. The
design frequency is that at which two hydrophones lie half a wavelength apart.

**References.** H. L. Van Trees, Optimum Array Processing (2002), sections 2.4 and 3.1
(beam pattern, shading); C. L. Dolph, Proc. IRE 34 (1946) for the Chebyshev weights.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray

Shading = Literal["uniform", "hann", "chebyshev"]

STEPS_BEYOND = 2
"""Beams beyond ahead and astern."""

CLEAR_SHARE = 0.97
"""Share of the design frequency below which no beam sees the other end's alias."""

UNIFORM_SIDELOBE_DB, MOST_SIDELOBE_DB = 13.0, 80.0
"""Highest sidelobe of a beam with equal weights below its main lobe, and of what is no lobe
at all, dB (Harris 1978)."""

PATTERN_POINTS = 64
"""Directions per hydrophone at which the pattern of a beam is looked at."""

LARGEST_STD_DEG = 30.0
"""Largest deviation of an angle that is stated."""


@dataclass(frozen=True, eq=False)
class LineArray:
    """The hydrophones that a line array has."""

    along_m: FloatArray
    """Places of the hydrophones, m, positive to the head, shape (element,)."""
    sound_speed_mps: float
    """Speed of sound, m/s."""

    @property
    def spacing_m(self) -> float:
        """Usual distance of neighbouring hydrophones, m."""
        return float(np.median(np.diff(np.sort(self.along_m))))

    @property
    def aperture_m(self) -> float:
        """Distance of the outermost hydrophones, m."""
        return float(np.ptp(self.along_m))

    @property
    def design_frequency_hz(self) -> float:
        """Frequency above which directions are not unique, Hz."""
        return self.sound_speed_mps / (2.0 * self.spacing_m)

    @property
    def n_places(self) -> int:
        """Hydrophones that an array of this length and spacing has."""
        return round(self.aperture_m / self.spacing_m) + 1

    def beam_cosines(self, n_beams: int) -> FloatArray:
        """Return the cosines of beams from u = -1 to 1, and a little beyond."""
        step = 2.0 / (n_beams - 1)
        number = np.arange(-STEPS_BEYOND, n_beams + STEPS_BEYOND)
        return -1.0 + step * number

    def weights(self, shading: Shading, sidelobe_db: float) -> FloatArray:
        """Return the weight of every hydrophone; their sum is 1.

        Notes
        -----
        The windows hold for even spacing; other places take the value between.
        """
        n = self.n_places
        if shading == "uniform":
            window: FloatArray = np.ones(n)
        elif shading == "hann":
            window = np.hanning(n + 2)[1:-1]
        else:
            window = chebyshev_window(n, sidelobe_db)
        at = (self.along_m - self.along_m.min()) / self.aperture_m * (n - 1)
        weight = np.interp(at, np.arange(n), window)
        return np.asarray(weight / weight.sum())

    def steering(
        self, frequency_hz: FloatArray, cos_angle: FloatArray, weights: FloatArray
    ) -> NDArray[np.complex64]:
        """Return w_n exp(-j 2 pi f x_n u / c), to be summed with the spectra.

        Of frequencies, Hz, and cosines of the beams: shape (cell, beam, element).
        """
        phase = -2j * np.pi * frequency_hz[:, None, None] * self.lead_s(cos_angle)
        return np.asarray(weights * np.exp(phase), np.complex64)

    def sidelobe_db(self, weights: FloatArray) -> float:
        """Return the highest sidelobe of the beams below their main lobe, dB.

        Weights of hydrophones that are left out are 0. It is the highest rise behind the
        first minimum, up to half the distance of the grating lobes.
        """
        points = PATTERN_POINTS * self.n_places
        turn = np.linspace(0.0, np.pi / self.spacing_m, points)
        power = np.abs(np.exp(1j * np.multiply.outer(turn, self.along_m)) @ weights) ** 2
        rises = np.flatnonzero(np.diff(power) > 0.0)
        if not rises.size:
            return MOST_SIDELOBE_DB
        below_db = -10.0 * np.log10(float(power[rises[0] :].max()) / float(power[0]))
        return float(min(below_db, MOST_SIDELOBE_DB))

    def lead_s(self, cos_angle: FloatArray) -> FloatArray:
        """Return how much earlier each hydrophone hears, s, shape (beam, element)."""
        return np.multiply.outer(cos_angle, self.along_m) / self.sound_speed_mps

    def diffuse_power(
        self, frequency_hz: FloatArray, cos_angle: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Return what isotropic noise gives in each beam, over the median of all beams.

        It is averaged over the frequencies, Hz.

        Notes
        -----
        w^H G w with G = sinc(2 f |x_i - x_j| / c) (Van Trees 2002, section 4.5).
        """
        apart = np.abs(np.subtract.outer(self.along_m, self.along_m))
        total = np.zeros(cos_angle.size)
        for one in frequency_hz:
            steering = self.steering(np.array([one]), cos_angle, weights)[0]
            coherence = np.sinc(2.0 * one * apart / self.sound_speed_mps)
            power = np.einsum("bi,bi->b", steering.conj(), steering @ coherence).real
            total += power / np.median(power)
        return np.asarray(total / frequency_hz.size)

    def lobe_cosine(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the distance in the cosine of directions that look alike, c / (f d).

        It is infinite for hydrophones at uneven distances, whose lobes are lower by half.
        """
        turn = np.exp(2j * np.pi * self.along_m / self.spacing_m)
        if abs(turn.mean()) ** 2 < 0.5:
            return np.full(np.shape(frequency_hz), np.inf)
        return np.asarray(self.sound_speed_mps / (frequency_hz * self.spacing_m))

    def cosine_std(
        self, snr: FloatArray, frequency_hz: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Return the standard deviation of a peak's cosine.

        SNR is that of the tone in the beam's cell; a hydrophone of weight 0 is not
        used.

        Notes
        -----
        var = sum w^2 x^2 / (2 rho k^2 (sum w x^2)^2) with x from the weighted middle,
        k = 2 pi f / c and rho = snr sum w^2 the ratio at one hydrophone: the maximum of
        a periodogram to first order. Equal weights give 6 / (rho k^2 d^2 N (N^2 - 1)).
        """
        x = self.along_m - float(np.sum(weights * self.along_m))
        wave = 2.0 * np.pi * frequency_hz / self.sound_speed_mps
        rho = np.maximum(snr, 1e-6) * float(np.sum(weights**2))
        share = float(np.sum((weights * x) ** 2)) / float(np.sum(weights * x**2)) ** 2
        return np.asarray(np.sqrt(share / (2.0 * rho)) / wave)


def chebyshev_window(n: int, sidelobe_db: float) -> FloatArray:
    """Return n weights whose sidelobes are all equal and the main lobe narrowest.

    Notes
    -----
    The pattern is T_(n-1)(x0 cos(pi s / n)), T_(n-1)(x0) = 10^(dB/20) (Dolph 1946),
    and the weights are its Fourier transform.
    """
    height = 10.0 ** (sidelobe_db / 20.0)
    x0 = np.cosh(np.arccosh(height) / (n - 1))
    s = np.arange(1, (n - 1) // 2 + 1)
    x = x0 * np.cos(np.pi * s / n)
    pattern = np.where(
        np.abs(x) > 1.0,
        np.cosh((n - 1) * np.arccosh(np.maximum(np.abs(x), 1.0))),
        np.cos((n - 1) * np.arccos(np.clip(x, -1.0, 1.0))),
    )
    place = np.arange(n) - 0.5 * (n - 1)
    turn = np.cos(2.0 * np.pi * np.multiply.outer(place, s) / n)
    return np.asarray(height + 2.0 * (turn * pattern).sum(axis=1))


def angle_std_deg(cos_angle: FloatArray, cosine_std: FloatArray) -> FloatArray:
    """Return the standard deviation of an angle from that of its cosine, degrees.

    Near ahead and astern the angle goes as the root of the cosine, and its deviation
    stays finite: sigma_u / sqrt(max(sin^2 theta, sigma_u)).

    Examples
    --------
    >>> angle_std_deg(np.array([0.0, 1.0]), np.array([0.01, 0.01])).round(2).tolist()
    [0.57, 5.73]
    """
    sine2 = 1.0 - np.minimum(cos_angle**2, 1.0)
    std = cosine_std / np.sqrt(np.maximum(sine2, cosine_std))
    return np.minimum(np.degrees(std), LARGEST_STD_DEG)
