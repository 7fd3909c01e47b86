"""The sensors and recordings that a result carries, and the clock of each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import BoolArray
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth
from uwtrack_cli.errors import DataError


@dataclass(frozen=True)
class RecordedSensors:
    """Sensors of a result, and the clock of each one's recording."""

    sensors: Sequence[Sensor]
    """Sensors that the result carries."""
    recordings: Sequence[Recording]
    """Recordings that the result carries."""
    encounters: Encounters | None = None
    """Its encounters, whose times tell the clock where there is no recording."""

    def recording(self, sensor: str) -> Recording | None:
        """Return the recording of a sensor, if the result carries it."""
        found = [r for r in self.recordings if r.sensor.id == sensor]
        return found[0] if found else None

    def sensor(self, sensor: str) -> Sensor:
        """Return a sensor by its identifier.

        Raises
        ------
        DataError
            The result does not carry it.
        """
        for known in self.sensors:
            if known.id == sensor:
                return known
        raise DataError(f"the result does not say where sensor {sensor!r} was.")

    def shift_s(self, sensor: str, truth: Truth) -> float:
        """Return what is added to times of the truth to get those of the result.

        Raises
        ------
        DataError
            The truth is in UTC alone, and the recording's start is not known.
        """
        recording, found = self.recording(sensor), self.encounters
        if recording is not None:
            return clock_shift_s(truth, recording.start_utc_ns, -recording.first_s)
        start = None if found is None else start_of_rows(found, found.sensor == sensor)
        return clock_shift_s(truth, start)


def start_of_rows(table: Encounters | Fixes, wanted: BoolArray | bool = True) -> int | None:
    """Return UTC of the time zero of some rows of a table, ns; None if unknown."""
    rows = np.flatnonzero((table.time_utc_ns >= 0) & wanted)
    if not rows.size:
        return None
    since_ns = round(float(table.time_s[rows[0]]) * NANOSECONDS)
    return int(table.time_utc_ns[rows[0]]) - since_ns


def clock_shift_s(truth: Truth, start_utc_ns: int | None, usual_s: float = 0.0) -> float:
    """Return what is added to times of the truth to get those of a result.

    ``start_utc_ns``: UTC of the result's time zero; None if unknown. ``usual_s``: the
    shift where both count from the begin of one file.

    Raises
    ------
    DataError
        The truth is in UTC alone, and the start is not known.
    """
    if start_utc_ns is not None and truth.start_utc_ns is not None:
        return (truth.start_utc_ns - start_utc_ns) / NANOSECONDS
    if truth.is_geographic:
        raise DataError(
            f"{truth.name} is in UTC, and the start of the recording is not "
            f"known: run again with --start-utc or --time-pattern."
        )
    return usual_s


def origin_of(sensor: Sensor) -> Origin:
    """Return the origin of a grid about a sensor.

    Raises
    ------
    DataError
        Its latitude and longitude are not known.
    """
    if sensor.latitude is None or sensor.longitude is None:
        raise DataError(
            f"sensor {sensor.id!r} has no latitude and longitude, which AIS needs: "
            f"give them in its sensor file and run again."
        )
    return Origin(sensor.latitude, sensor.longitude)
