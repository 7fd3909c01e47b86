"""The picture of docs/fringes.md: python -m tests.draws.fringe_picture docs/fringes.png."""

import sys

import matplotlib as mpl

from tests.draws.fringe_rates import MACH
from tests.draws.fringe_sounds import draw_power, fringes_of
from uwtrack_cli.motion.evidence.fringes import fringe_passages
from uwtrack_cli.plotting.fringe_image import FringeImage, law_of

SEED = 2
"""A drawn vessel in shallow water."""


def main(path: str) -> None:
    """Draw the fringes of a vessel that cannot be heard, and what they tell."""
    mpl.use("Agg")
    from matplotlib.figure import Figure

    frequency, power, _ = draw_power(SEED, is_deep=False)
    fringes = fringes_of(frequency, power)
    found = [one.passage for one in fringe_passages(fringes, MACH)]
    laws = [law_of(one.time_s, one.width_s, one.mach) for one in found]
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    image, ax = FringeImage.of(fringes, (0.0, fringes.time_s[-1])), figure.subplots()
    assert image is not None
    ax.set_xlim(0.0, fringes.time_s[-1])
    image.draw(ax, laws)
    ax.set_xlabel("time (s)", fontsize=8)
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    main(sys.argv[1])
