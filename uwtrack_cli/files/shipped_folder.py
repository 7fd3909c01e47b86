"""Where the recipes and sample recordings are that come with the program."""

from pathlib import Path

import uwtrack_cli
from uwtrack_cli.errors import DataError

FOLDERS = ("pipelines", "sample_data")


def shipped_folder(name: str) -> Path:
    """Return a folder that comes with the program.

    An installed package carries it inside; in a checkout it lies beside the package.

    Parameters
    ----------
    name
        ``pipelines`` or ``sample_data``.

    Raises
    ------
    DataError
        The installation lacks the folder.
    """
    if name not in FOLDERS:
        msg = f"there is no shipped folder {name!r}; there are {', '.join(FOLDERS)}."
        raise DataError(msg)
    package = Path(uwtrack_cli.__file__).resolve().parent
    for folder in (package / "_shipped" / name, package.parent / name):
        if folder.is_dir():
            return folder
    msg = f"this installation of uwtrack lacks its folder {name}; install it again."
    raise DataError(msg)
