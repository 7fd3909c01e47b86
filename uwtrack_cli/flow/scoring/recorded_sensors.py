"""The sensors and recordings that a result carries, and the clock of each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.encounters import Encounters
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
        msg = f"the result does not say where sensor {sensor!r} was."
        raise DataError(msg)

    def shift_s(self, sensor: str, truth: Truth) -> float:
        """Return what is added to times of the truth to get those of the result.

        Raises
        ------
        DataError
            The truth is in UTC alone, and the recording's start is not known.
        """
        recording = self.recording(sensor)
        start = self._start_of_rows(sensor) if recording is None else recording.start_utc_ns
        if start is not None and truth.start_utc_ns is not None:
            return (truth.start_utc_ns - start) / NANOSECONDS
        if truth.is_geographic:
            msg = (
                f"{truth.name} is in UTC, and the start of the recording is not "
                f"known: run again with --start-utc or --time-pattern."
            )
            raise DataError(msg)
        return -recording.first_s if recording is not None else 0.0

    def _start_of_rows(self, sensor: str) -> int | None:
        """Return UTC of the time zero of a table's encounters, ns; None if unknown."""
        found = self.encounters
        if found is None:
            return None
        rows = np.flatnonzero((found.sensor == sensor) & (found.time_utc_ns >= 0))
        if not rows.size:
            return None
        since_ns = round(float(found.time_s[rows[0]]) * NANOSECONDS)
        return int(found.time_utc_ns[rows[0]]) - since_ns
