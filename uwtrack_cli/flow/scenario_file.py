"""Scenario files: a TOML table of what is in the water.

**Conventions.** The keys are those of `uwtrack_cli.simulate.scenario`: scalars of the
scenario, ``[[sensor]]``, ``[[vessel]]`` with ``[vessel.closest_approach]`` or
``[vessel.track]``, ``[[vessel.line]]``, ``[vessel.broadband]``, and ``[noise]``.
"""

from pathlib import Path

from uwtrack_cli.files.tables.toml_tables import read_toml
from uwtrack_cli.simulate.scenario import Scenario, make_scenario


def read_scenario(path: Path) -> Scenario:
    """Read a scenario from a TOML file.

    Returned: the scenario, with every key and value checked.

    Raises
    ------
    DataError
        The file is missing or is no TOML.
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    return make_scenario(read_toml(path))
