"""How well a motion explains bearings among which some are another's.

**Method.** A bearing is the source's with a Gaussian error, or it is another's or comes from
anywhere. Which one is not known, so both are summed in every row (McLachlan & Peel 2000, eq.
1.4): where the motion that is tried stays far from a row, the row was probably another's, and
costs no more. Weights that are kept from the best motion instead would charge it in full, and
would call the region of such motions smaller, or place it where a few rows of another pulled
it. The constant error of each sensor is taken at its best for the motion that is tried, by
repeated weighted means, and the width of its likelihood there is counted (Laplace's
approximation).

**References.** McLachlan & Peel 2000, Finite Mixture Models; Dempster, Laird & Rubin 1977, J.
R. Stat. Soc. B 39, 1.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.model import predict_values
from uwtrack_cli.motion.target_motion.objective import bearing_errors, medium_of
from uwtrack_cli.motion.target_motion.problem import Problem

PASSES = 3
"""Passes that bring the constant errors to their best."""


@dataclass(frozen=True, eq=False)
class RowMixture:
    """What the rows of a record say of one source, whoever they belong to."""

    problem: Problem
    """The record, every bearing with its full weight; each row has at most one."""
    share: float
    """Share of the bearings that is the source's."""
    other_density: FloatArray
    """Probability that a bearing is not the source's, times its density then, 1/rad,
    shape (rows,)."""
    offset_rad: FloatArray
    """Constant errors at the motion that was found, rad, shape (streams,)."""

    def log_likelihood(self, state: FloatArray) -> FloatArray:
        """Return the log likelihood of motions (x, y, vx, vy) up to a constant."""
        problem = self.problem
        stream = problem.bearing_weight.argmax(axis=0)
        rows = np.arange(stream.size)
        weight = problem.bearing_weight[stream, rows]
        heard = weight > 0
        model, _ = predict_values(problem.track, state, medium_of(problem))
        measured = problem.bearing_rad[:, np.newaxis, stream, rows]
        off = bearing_errors(problem.of_streams(stream), model, measured)[0][:, 0]
        off, stream, weight = off[:, heard], stream[heard], weight[heard]
        other = self.other_density[heard]
        top = self.share * weight / np.sqrt(2.0 * np.pi)
        members = np.eye(len(problem.bearing_weight))[stream]
        precision = problem.offset_precision
        free = np.isfinite(precision)
        prior = np.where(free, precision, 0.0)

        def weigh(offset: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            """Return errors, densities, and what each stream tells of its offset."""
            error = wrap_rad(off + offset[:, stream])
            own = top * np.exp(-0.5 * (error * weight) ** 2)
            return error, own, own / (own + other) * weight**2

        offset = np.tile(np.where(free, self.offset_rad, 0.0), (len(state), 1))
        for _ in range(PASSES):
            error, _, each = weigh(offset)
            pull = (each * (error - offset[:, stream])) @ members
            offset = np.where(free, -pull / np.maximum(each @ members + prior, 1e-300), 0)
        _, own, each = weigh(offset)
        width = np.log1p(each @ members / np.where(free, precision, np.inf)).sum(axis=1)
        value = np.log(own + other).sum(axis=1)
        return np.asarray(value - 0.5 * ((prior * offset**2).sum(axis=1) + width))
