"""Which tables are read as which containers."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from uwtrack_cli.data.base import Container
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.scan_tables import (
    read_contacts,
    read_delays,
    read_roc,
    read_scans,
)
from uwtrack_cli.files.tables.series import read_series

TABLES = (".csv", ".txt", ".tsv")
"""Endings of tables."""


def table_readers(
    sensors: Sequence[Sensor] = (),
) -> dict[str, Callable[[Path], Container]]:
    """Return the reader of each container that a CSV table may be, by its name.

    ``sensors``: those that a table may name in its rows.
    """
    return {
        "delays": read_delays,
        "series": partial(read_series, sensors=sensors),
        "scans": read_scans,
        "contacts": read_contacts,
        "navigation": read_navigation,
        "roc": read_roc,
    }
