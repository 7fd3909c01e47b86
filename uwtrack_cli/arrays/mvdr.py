"""Minimum-variance beams (MVDR, Capon): sources nearer than a beam's width, apart.

**Method.** The power of a direction is that of the beam which passes it unchanged and
lets the least of everything else through. The covariance of the hydrophones is the mean
over the frames of a block; a share of its trace is added to the diagonal, so that a
source between two beams is not suppressed as if it were noise.

**References.** J. Capon, Proc. IEEE 57 (1969); B. D. Carlson, IEEE Trans. Aerosp.
Electron. Syst. 24 (1988) for the loading.
"""

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray


def mvdr_power(
    spectra: NDArray[np.complex64],
    steering: NDArray[np.complex64],
    loading: float,
) -> FloatArray:
    """Return the power of every direction in every cell.

    Parameters
    ----------
    spectra
        Spectra, shape (cell, element, frame).
    steering
        exp(-j k x u), shape (cell, beam, element).
    loading
        Addition to the diagonal as a share of the mean power of a hydrophone.

    Returns
    -------
    array, shape (cell, beam)
        1 / (v^H (R + e I)^-1 v).
    """
    wide = spectra.astype(np.complex128)
    n_elements, n_frames = wide.shape[1:]
    covariance = wide @ wide.conj().transpose(0, 2, 1) / n_frames
    trace = np.trace(covariance, axis1=1, axis2=2).real / n_elements
    floor = np.maximum(loading * trace, np.finfo(np.float32).tiny)
    inverse = np.linalg.inv(covariance + floor[:, None, None] * np.eye(n_elements))
    turned = steering.astype(np.complex128)
    denominator = ((turned @ inverse) * turned.conj()).sum(axis=2).real
    return np.asarray(1.0 / denominator)
