"""Names of vessels by AIS: which vessel each closest approach was.

**Method.** The closest approaches of the AIS vessels to the sensor are matched with the
encounters as `score` does it (`docs/ais.md` is the protocol): by time, speed, range,
course and bearing, each with its deviation, one vessel each. The name goes with the
probability that it was that vessel rather than another one, listed or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import Source, source_of
from uwtrack_cli.files.tables.ais import read_ais
from uwtrack_cli.flow.engine import Revision
from uwtrack_cli.flow.scoring.encounter_scores import score_encounters
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors

WITHIN_M = 2000.0
"""Range within which AIS vessels are expected to be detected unless told, m."""


@dataclass(frozen=True)
class AisVessels:
    """Vessels of an AIS table."""

    truth: Truth
    """Where they were."""
    source: Source
    """The table, for the history."""
    within_m: float = WITHIN_M
    """Largest range at which a vessel is expected to be detected, m."""

    def check(self, recording: Recording) -> None:
        """Refuse a recording whose place or time is not known, before the work.

        Raises
        ------
        DataError
            AIS needs the latitude and longitude of the sensor and the start in UTC.
        """
        sensor = recording.sensor
        if sensor.latitude is None or sensor.longitude is None:
            msg = (
                f"{self.truth.name} needs to know where sensor {sensor.id!r} is: give "
                f"latitude and longitude in its sensor file."
            )
            raise DataError(msg)
        RecordedSensors([sensor], [recording]).shift_s(sensor.id, self.truth)

    def name(
        self,
        encounters: Encounters,
        sensors: Sequence[Sensor],
        recordings: Sequence[Recording],
    ) -> Encounters:
        """Return encounters with the names of their vessels.

        Parameters
        ----------
        encounters
            What was found.
        sensors
            Their sensors.
        recordings
            Their recordings.

        Raises
        ------
        DataError
            The place of a sensor or the start of a recording is not known.
        """
        n = encounters.n_encounters
        names, numbers = np.full(n, "", object), np.full(n, "", object)
        probability = np.full(n, np.nan)
        if n:
            recorded = RecordedSensors(sensors, recordings)
            scores = score_encounters(
                encounters, self.truth, recorded, within_m=self.within_m
            )
            found = {(w.sensor, w.contact): w for w in scores.identities if w.vessel}
            keys = zip(map(str, encounters.sensor), encounters.contact, strict=True)
            for row, key in enumerate(keys):
                who = found.get((key[0], int(key[1])))
                if who is not None and who.vessel is not None:
                    names[row], numbers[row] = _parted(who.vessel)
                    probability[row] = dict(who.candidates).get(who.vessel, np.nan)
        return replace(
            encounters,
            vessel_name=names.astype(np.str_),
            vessel_mmsi=numbers.astype(np.str_),
            vessel_probability=probability,
            ais_name=self.source.name,
            ais_digest=self.source.digest,
            ais_within_m=self.within_m,
        )


def revision(
    recording: Recording,
    files: RecordedFiles | None = None,
    vessels: AisVessels | None = None,
) -> Revision:
    """Return what is done last to the encounters of a recording.

    Those of another part of it are left out, and vessels get their names.

    Parameters
    ----------
    recording
        The recording.
    files
        How it was joined, if it was.
    vessels
        Vessels that may have passed, if they are known.
    """
    span_s = None if files is None else files.kept_span_s(recording.start_utc_ns)

    def revise(encounters: Encounters) -> Encounters:
        kept = encounters if span_s is None else _within(encounters, span_s)
        if vessels is None:
            return kept
        return vessels.name(kept, [recording.sensor], [recording])

    return revise


def _within(encounters: Encounters, span_s: tuple[float, float]) -> Encounters:
    """Return the encounters of a span; without a time, those whose sound came in it."""
    unknown = np.isnan(encounters.time_s)
    time_s = np.where(unknown, encounters.arrival_time_s, encounters.time_s)
    outside = (time_s < span_s[0]) | (time_s >= span_s[1])
    return encounters.take("encounter", np.flatnonzero(~outside))


def read_vessels(path: Path, within_m: float = WITHIN_M) -> AisVessels:
    """Read an AIS table as vessels that may have passed.

    Parameters
    ----------
    path
        The table.
    within_m
        Largest range at which a vessel is expected to be detected, m.

    Raises
    ------
    DataError
        The table cannot be read.
    """
    return AisVessels(read_ais(path), source_of(path), within_m)


def _parted(vessel: str) -> tuple[str, str]:
    """Return name and MMSI of a vessel of an AIS table."""
    name, _, rest = vessel.rpartition(" (")
    number = rest.rstrip(")") if name else vessel
    return name or vessel, number
