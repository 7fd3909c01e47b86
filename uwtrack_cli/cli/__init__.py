"""The command line: the only floor that knows typer, rich and exit codes."""

import os
import sys

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables by which the usual BLAS libraries are told their number of threads."""


def main() -> None:
    """Run the program; the console script's entry.

    A standard output that is closed takes nothing, and no file is opened in its place.
    BLAS works in one thread unless the environment says otherwise: how sums are parted
    among threads changes their last digits, and the matrices are too small to gain.
    """
    for name in BLAS_THREADS:  # before numpy is imported
        os.environ.setdefault(name, "1")
    if sys.stdout is None:  # as Python leaves it (`sys.__stdout__` stays so)
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
    from uwtrack_cli.cli.app import app

    app()
