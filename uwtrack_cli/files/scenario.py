"""Scenario files: a TOML table of what is in the water.

**Conventions.** The keys are those of `uwtrack_cli.simulate.scenario`: scalars of the
scenario, ``[[sensor]]``, ``[[vessel]]`` with ``[vessel.closest_approach]`` or
``[vessel.track]``, ``[[vessel.line]]``, ``[vessel.broadband]``, and ``[noise]``.
"""

import tomllib
from pathlib import Path

from uwtrack_cli.errors import DataError
from uwtrack_cli.simulate.scenario import Scenario
from uwtrack_cli.simulate.table import from_table


def read_scenario(path: Path) -> Scenario:
    """Read a scenario from a TOML file.

    Parameters
    ----------
    path
        The TOML file.

    Returns
    -------
    Scenario
        The scenario, with every key and value checked.

    Raises
    ------
    DataError
        The file is missing or is no TOML.
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        msg = f"cannot read the scenario {path}: {error.strerror or error}."
        raise DataError(msg) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        msg = f"{path} is not a TOML file: {error}."
        raise DataError(msg) from error
    return from_table(Scenario, table)
