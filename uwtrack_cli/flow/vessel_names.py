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

from uwtrack_cli.acoustics.geodesy import places_on_grid
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import RecordedFiles, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.hdf5.product import Source, source_of
from uwtrack_cli.files.tables.ais import read_ais
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.flow.engine import Revision
from uwtrack_cli.flow.scoring.encounter_scores import score_encounters
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors, origin_of

WITHIN_M = 2000.0
"""Range within which AIS vessels are expected to be detected unless told, m."""


MARGIN_S, NEAR_DEG = 600.0, 0.5
"""Time beside a recording, and difference in latitude, within which tracks are drawn."""


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
        origin_of(sensor)
        shift_s = RecordedSensors([sensor], [recording]).shift_s(sensor.id, self.truth)
        first_s, last_s = (second + shift_s for second in self.span_s)
        if first_s > recording.duration_s or last_s < 0.0:
            warn(f"no vessel gets a name: {self.said_span()}.")

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last message, s from the start of the truth."""
        tracks = self.truth.tracks
        return (
            min((float(track.time_s[0]) for track in tracks), default=np.inf),
            max((float(track.time_s[-1]) for track in tracks), default=-np.inf),
        )

    def said_span(self) -> str:
        """Return from when to when there are messages, in words."""
        start_ns = self.truth.start_utc_ns
        if not self.truth.tracks or start_ns is None:
            return f"{self.truth.name} has no message with a position"
        first, last = (
            format_utc(start_ns + round(second * NANOSECONDS))[:16].replace("T", " ")
            for second in self.span_s
        )
        return f"{self.truth.name} has messages from {first} to {last} UTC"

    def name(
        self, encounters: Encounters, sensors: Sequence[Sensor], recordings: Sequence[Recording]
    ) -> Encounters:
        """Return encounters with the names of their vessels.

        Raises
        ------
        DataError
            The place of a sensor or the start of a recording is not known.
        """
        n = encounters.n_encounters
        names, numbers = np.full(n, "", object), np.full(n, "", object)
        probability = np.full(n, np.nan)
        if n:
            recorded = RecordedSensors(sensors, recordings, encounters)
            scores = score_encounters(encounters, self.truth, recorded, within_m=self.within_m)
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


def tracks_past(
    vessels: AisVessels, sensor: Sensor, recording: Recording | None
) -> list[VesselTrack]:
    """Return where vessels were while a sensor recorded.

    ``sensor``: the sensor, of known latitude and longitude.

    Returned: times in s from the first sample, east and north of the sensor in m.

    Raises
    ------
    DataError
        The place of the sensor or the start of the recording is not known.
    """
    if recording is None:
        raise DataError(f"the recording of sensor {sensor.id!r} is not known.")
    vessels.check(recording)
    origin = origin_of(sensor)
    shift_s = RecordedSensors([sensor], [recording]).shift_s(sensor.id, vessels.truth)
    found = []
    for track in vessels.truth.tracks:
        time_s = track.time_s + shift_s
        heard = (time_s > -MARGIN_S) & (time_s < recording.duration_s + MARGIN_S)
        near = heard & (np.abs(track.first - origin.latitude) < NEAR_DEG)
        if near.any():
            east, north = places_on_grid(track.first[near], track.second[near], origin)
            found.append(
                VesselTrack(
                    vessel=_parted(track.vessel)[0],
                    time_s=time_s[near],
                    first=east,
                    second=north,
                    speed_mps=track.speed_mps[near],
                    course_deg=track.course_deg[near],
                )
            )
    return found


def revision(
    recording: Recording, files: RecordedFiles | None = None, vessels: AisVessels | None = None
) -> Revision:
    """Return what is done last to the encounters of a recording.

    Those of another part of it are left out, and vessels get their names.

    ``files``: how it was joined, if it was. ``vessels``: vessels that may have passed,
    if they are known.
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

    ``within_m``: largest range at which a vessel is expected to be detected, m.

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
