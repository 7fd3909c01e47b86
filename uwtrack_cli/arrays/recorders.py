"""Recorders of one clock as the hydrophones of one array.

**Method.** The samples of all recorders are read from the time at which the last one begins
until the first one ends. What is left of the start times below a sample is kept, and so is
the standard deviation of each clock.

**Conventions.** The places of the hydrophones are east, north and up, m, from the first
recorder. A channel has the name of its recorder.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording, Samples, read_segment
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError


@dataclass(frozen=True)
class RecordersReader:
    """Reads one channel of each of several recordings, from samples of one time on."""

    recordings: tuple[Recording, ...]
    """The recordings, whose readers can go back."""
    channels: tuple[int, ...]
    """Channel taken of each, from 0."""
    first_samples: tuple[int, ...]
    """Sample of each at which the common time begins."""
    n_samples: int
    """Samples of the common time."""
    late_s: tuple[float, ...]
    """By how much these samples lie after the begin of the common time, s."""
    clock_std_s: tuple[float, ...]
    """Deviation of each clock, s; nan where it is not told."""

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield consecutive blocks of so many samples, the last one shorter."""
        for first in range(0, self.n_samples, block_samples):
            yield self.segment(first, min(block_samples, self.n_samples - first))

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples from one on."""
        parts = [
            read_segment(one.reader, first + first_sample, n_samples)[:, channel]
            for one, first, channel in zip(
                self.recordings, self.first_samples, self.channels, strict=True
            )
            if one.reader is not None
        ]
        return np.stack(parts, axis=1)


def join_recorders(recordings: Sequence[Recording]) -> Recording:
    """Return recordings of several recorders as that of one array.

    Parameters
    ----------
    recordings
        One of each recorder, with start times, opened for reading.

    Raises
    ------
    DataError
        Recorders have no start time or place, rates that differ, or no time in common.
    """
    names = [one.sensor.id for one in recordings]
    if len(set(names)) < len(names):
        raise DataError(
            f"the recordings are of the sensors {', '.join(names)}: delays across files "
            f"need recorders of different identifiers, each with a sensor file."
        )
    rates = {one.sample_rate_hz for one in recordings}
    if len(rates) > 1:
        found = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise DataError(f"the recordings have sample rates of {found} Hz; delays need one.")
    (rate_hz,) = rates
    starts = []
    for one in recordings:
        if one.start_utc_ns is None:
            raise DataError(
                f"{one.name} has no start time, and delays across files need one: give "
                f"--start-utc where all begin at once, or --time-pattern."
            )
        starts.append(one.start_utc_ns)
    begin = max(starts)
    since_s = np.array([(begin - start) / NANOSECONDS for start in starts])
    first = np.rint(since_s * rate_hz).astype(int)
    count = min(one.n_samples - int(n) for one, n in zip(recordings, first, strict=True))
    if count <= 0:
        raise DataError(f"{', '.join(one.name for one in recordings)} have no time in common.")
    stds = [one.sensor.clock_std_s for one in recordings]
    reader = RecordersReader(
        tuple(recordings),
        tuple(_omni(one.sensor) for one in recordings),
        tuple(first.tolist()),
        count,
        tuple((first / rate_hz - since_s).tolist()),
        tuple(np.nan if std is None else std for std in stds),
    )
    digest = sha256("".join(one.digest for one in recordings).encode()).hexdigest()
    return replace(
        recordings[0],
        sensor=_array_of([one.sensor for one in recordings]),
        name=", ".join(one.name for one in recordings),
        n_samples=count,
        n_channels=len(recordings),
        start_utc_ns=begin,
        first_sample=0,
        file_channels="",
        digest=digest,
        reader=reader,
    )


def _omni(sensor: Sensor) -> int:
    """Return the channel that hears all directions alike, from 0."""
    names = sensor.channel_names
    return names.index("omni") if "omni" in names else 0


def _array_of(sensors: Sequence[Sensor]) -> Sensor:
    """Return the array whose hydrophones are the recorders."""
    moving = [one.id for one in sensors if one.navigation is not None]
    if moving:
        raise DataError(f"recorder {moving[0]} moves: delays across files need fixed places.")
    places = _places(sensors)
    depths = [0.0 if one.depth_m is None else one.depth_m for one in sensors]
    rows = [
        f"{east:.3f},{north:.3f},{-depth:.3f}"
        for (east, north), depth in zip(places.tolist(), depths, strict=True)
    ]
    first = sensors[0]
    return Sensor(
        id="+".join(one.id for one in sensors),
        kind="array",
        channels=",".join(one.id for one in sensors),
        latitude=first.latitude,
        longitude=first.longitude,
        east_m=first.east_m,
        north_m=first.north_m,
        position_std_m=max(one.position_std_m for one in sensors),
        depth_m=0.0,
        sound_speed_mps=first.sound_speed_mps,
        sound_speed_std_mps=first.sound_speed_std_mps,
        element_positions_m=";".join(rows),
        heading_source="fixed",
    )


def _places(sensors: Sequence[Sensor]) -> FloatArray:
    """Return east and north of recorders from the first one, m, shape (recorder, 2)."""
    if all(s.latitude is not None and s.longitude is not None for s in sensors):
        pairs = [(float(s.latitude or 0), float(s.longitude or 0)) for s in sensors]
        origin = Origin(*pairs[0])
        return np.array([to_grid(*pair, origin) for pair in pairs])
    if all(s.east_m is not None and s.north_m is not None for s in sensors):
        found = np.array([(s.east_m, s.north_m) for s in sensors], float)
        return np.asarray(found - found[0])
    raise DataError(
        "delays across files need the places of all recorders, of one kind: latitude "
        "and longitude, or east_m and north_m, in their sensor files."
    )
