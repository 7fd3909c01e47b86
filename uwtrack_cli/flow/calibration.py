"""A vector sensor calibrated by a vessel whose track is known.

**Method.** The track (AIS, or a truth file) is brought to the clock of the recording and
to a grid about the sensor; sound that is heard now left the vessel a range earlier. The
bearings that follow are what the channels of the sensor should have shown
(`spectra.dipole_calibration`). Frames in which another vessel of the track file is
nearly as near are left out.

**Conventions.** What was measured replaces what the sensor file said of gains, crosstalk
and compass; the orientation is added to its compass offset.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.acoustics.geodesy import places_on_grid
from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError
from uwtrack_cli.flow.scoring.ais_passages import FAR_DEG, interpolate_track
from uwtrack_cli.flow.scoring.recorded_sensors import RecordedSensors, origin_of
from uwtrack_cli.spectra.dipole_calibration import (
    NAMES,
    DipoleFit,
    KnownPassage,
    MirroredDipolesError,
    fit_dipoles,
)
from uwtrack_cli.spectra.levels import WhitenedFrames, whiten_frames
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

N_BANDS = 16
"""Sub-bands that are whitened one by one."""

CLOCK_STD_S = 5.0
"""Deviation of a recorder's clock against that of AIS where the sensor file tells none."""

ALONE = 2.0
"""Another vessel must be so many times as far as the one that is used."""

MIRRORED = {"east": "-east", "north": "north"}
"""What the dipoles of a multiplex are when bearings turn the wrong way round."""

TURNED = {"east": "-north", "north": "east"}
"""What they are when bearings are 90 degrees too small."""

STEP_M, STEP_S = 1.0, 0.1
"""Steps of the differences that give the slopes of bearings."""


@dataclass(frozen=True)
class MeasuredQuantity:
    """One quantity of a calibration."""

    quantity: str
    """What was measured: a gain, a share of another channel, or the orientation."""
    value: float
    """Its value; 1 or degrees."""
    std: float
    """Its standard deviation."""
    is_told: bool
    """Whether the passage tells it, beyond what is assumed of any sensor."""


@dataclass(frozen=True)
class Calibration:
    """What a passage tells of a vector sensor."""

    sensor: str
    """Identifier of the sensor."""
    vessel: str
    """Vessel whose track was used."""
    quantities: tuple[MeasuredQuantity, ...]
    """Gains, crosstalk and orientation."""
    compass_offset_deg: float
    """Compass offset of the sensor with the orientation in it, degrees."""
    compass_std_deg: float
    """Deviation of bearings that the calibration leaves, degrees."""
    error_before_deg: float
    """Root mean square error of the bearings of the passage before, degrees."""
    error_after_deg: float
    """The same after."""
    n_frames: int
    """Frames in which the vessel was heard."""
    span_deg: float
    """Change of its bearing over them, degrees."""
    least_range_m: float
    """Least horizontal range of the vessel in these frames, m."""
    multiplex: str | None
    """Of a buoy's audio, the dipole in phase with the 15 kHz pilot and the one ahead of
    it, comma separated; None of any other sensor."""


def calibrate_sensor(
    recording: Recording,
    truth: Truth,
    *,
    vessel: str | None = None,
    band_hz: tuple[float, float] = (100.0, 1500.0),
    window_s: float = 1.0,
    within_m: float = 2000.0,
) -> tuple[Calibration, Sensor]:
    """Measure gains, crosstalk and orientation of a vector sensor at a fixed place.

    Parameters
    ----------
    recording
        A recording in which the vessel passes, opened for reading.
    vessel
        Name, or a part of it; the vessel that comes nearest unless given.
    band_hz
        Band between whose lines the vessel is heard, Hz; cut to the recording's.
    window_s
        Length of a frame, s.
    within_m
        Largest horizontal range at which frames are used, m.

    Returns
    -------
    tuple
        What was measured, and the sensor with it.

    Raises
    ------
    DataError
        The sensor has no dipoles, moves or has no place; the track does not tell the
        passage, or the sound does not.
    """
    sensor = recording.sensor
    _check_sensor(sensor)
    shift_s = RecordedSensors([sensor], [recording]).shift_s(sensor.id, truth)
    frames = _frames(recording, band_hz, window_s)
    time_s = frames.time_s - shift_s
    tracks = list(_tracks(truth, sensor, (float(time_s[0]), float(time_s[-1]))))
    heard = {track.name: track.heard(time_s, sensor.sound_speed_mps) for track in tracks}
    name = _chosen(heard, vessel, within_m, truth)
    track = next(one for one in tracks if one.name == name)
    range_m = np.hypot(*heard[name])
    others = [np.hypot(*place) for other, place in heard.items() if other != name]
    apart = np.full(range_m.shape, np.inf)
    for other in others:
        apart = np.fmin(apart, other)
    with np.errstate(invalid="ignore"):
        used = (range_m <= within_m) & (apart > ALONE * range_m)
    passage = _passage(sensor, truth, frames, (track, time_s, used))
    fit, sensor = _fit(passage, sensor)
    return _measured(sensor, name, fit, float(np.min(range_m[used]))), _corrected(sensor, fit)


def _fit(known: KnownPassage, sensor: Sensor) -> tuple[DipoleFit, Sensor]:
    """Return the fit to a passage, and the sensor with the signs of its multiplex.

    Signs and order of the dipoles in a multiplex are a convention: those are taken with
    which bearings turn the right way round, and are off by less than 45 degrees.
    """
    if sensor.multiplex is None:
        return fit_dipoles(known), sensor
    try:
        fit = fit_dipoles(known)
    except MirroredDipolesError:
        known = replace(known, intensity=known.intensity * np.array([-1.0, 1.0]))
        sensor = replace(sensor, multiplex=_renamed(sensor.multiplex, MIRRORED))
        fit = fit_dipoles(known)
    turns = round(float(fit.value[5]) / 90.0) % 4
    for _ in range(turns):
        east, north = known.intensity.T
        known = replace(known, intensity=np.stack([north, -east], axis=1))
        sensor = replace(sensor, multiplex=_renamed(sensor.multiplex, TURNED))
    return (fit_dipoles(known) if turns else fit), sensor


def _renamed(multiplex: str | None, names: Mapping[str, str]) -> str:
    """Return the dipoles of a multiplex under other names."""
    found = []
    for name in (multiplex or "").split(","):
        new = names[name.removeprefix("-")]
        found.append(f"-{new}" if name.startswith("-") else new)
    return ",".join(found).replace("--", "")


def _check_sensor(sensor: Sensor) -> None:
    if not sensor.has_direction:
        raise DataError(
            f"sensor {sensor.id!r} has no dipoles to calibrate; give a sensor file with "
            f'kind = "difar".'
        )
    if sensor.navigation is not None:
        raise DataError(
            f"sensor {sensor.id!r} has navigation, and a calibration needs a sensor at "
            f"a fixed place: give its latitude and longitude and its heading_deg."
        )


def _frames(recording: Recording, band_hz: tuple[float, float], window_s: float) -> WhitenedFrames:
    """Return frames along the recorded axes themselves, with nothing corrected."""
    own = recording.sensor.channels.replace("x", "east").replace("y", "north")
    bare = Sensor(id=recording.sensor.id, kind="difar", channels=own)
    blocks = compute_spectrogram(replace(recording, sensor=bare), window_s=window_s, zero_padding=1)
    highest = min(band_hz[1], 0.45 * recording.sample_rate_hz)
    return whiten_frames(blocks, band_hz=(band_hz[0], highest), n_bands=N_BANDS)


@dataclass(frozen=True)
class _Track:
    """A vessel's track on a grid about the sensor."""

    name: str
    """Name of the vessel."""
    track: VesselTrack
    """Its track as the file has it."""
    east_m: FloatArray
    """Its places, east of the sensor, m, shape (row,)."""
    north_m: FloatArray
    """The same, north of the sensor."""

    def heard(self, time_s: FloatArray, sound_speed_mps: float) -> FloatArray:
        """Return where the sound heard at some times was made, shape (2, time), m."""
        place = self._at(time_s)
        for _ in range(2):  # ships are slow: the error falls by their Mach number
            place = self._at(time_s - np.hypot(*place) / sound_speed_mps)
        return place

    def _at(self, time_s: FloatArray) -> FloatArray:
        return np.stack(interpolate_track(self.track, self.east_m, self.north_m, time_s))


def _tracks(truth: Truth, sensor: Sensor, span_s: tuple[float, float]) -> Iterator[_Track]:
    """Yield the tracks of all vessels that were near during a span of time."""
    if not truth.is_geographic and sensor.id not in truth.sensor_places:
        raise DataError(f"{truth.name} does not say where sensor {sensor.id!r} was.")
    origin = origin_of(sensor) if truth.is_geographic else None
    for track in truth.tracks:
        is_there = track.time_s[0] <= span_s[1] and track.time_s[-1] >= span_s[0]
        if track.time_s.size < 2 or not is_there:
            continue
        if origin is None:
            east, north = truth.sensor_places[sensor.id]
            yield _Track(track.vessel, track, track.first - east, track.second - north)
        elif np.abs(track.first - origin.latitude).min() <= FAR_DEG:
            yield _Track(track.vessel, track, *places_on_grid(track.first, track.second, origin))


def _chosen(heard: dict[str, FloatArray], vessel: str | None, within_m: float, truth: Truth) -> str:
    """Return the vessel of a name, or the one that comes nearest."""
    least = {
        name: float(np.nanmin(np.hypot(*place)))
        for name, place in heard.items()
        if np.isfinite(place).all(axis=0).any()
    }
    if vessel is not None:
        named = [name for name in least if vessel.casefold() in name.casefold()]
        if len(named) != 1:
            words = ", ".join(sorted(least)[:8]) or "none"
            raise DataError(
                f"exactly one vessel of {truth.name} must be named by {vessel!r} during "
                f"the recording, found {len(named)}; there are: {words}."
            )
        least = {named[0]: least[named[0]]}
    near = [name for name, range_m in least.items() if range_m <= within_m]
    if not near:
        most = f"; the nearest came to {min(least.values()):.0f} m" if least else ""
        raise DataError(
            f"{truth.name} has no vessel within {within_m:g} m of the sensor during the "
            f"recording{most}. Is the start of the recording right (--start-utc)?"
        )
    return min(near, key=lambda name: least[name])


def _passage(
    sensor: Sensor,
    truth: Truth,
    frames: WhitenedFrames,
    where: tuple[_Track, FloatArray, FloatArray],
) -> KnownPassage:
    """Return the known bearings, and how errors of place and clock would change them."""
    track, time_s, used = where
    turns = "x" in sensor.channel_names
    turn = sensor.compass_offset_deg + (sensor.heading_deg if turns else 0.0)

    def angle(shift: FloatArray, late_s: float = 0.0) -> FloatArray:
        east, north = track.heard(time_s - late_s, sensor.sound_speed_mps)
        return np.asarray(np.arctan2(east + shift[0], north + shift[1]))

    here = angle(np.zeros(2))
    steps = [
        (np.array([STEP_M, 0.0]), 0.0, STEP_M),
        (np.array([0.0, STEP_M]), 0.0, STEP_M),
        (np.zeros(2), STEP_S, STEP_S),
    ]
    slopes = [
        _difference(angle(shift, late_s), angle(-shift, -late_s)) / (2.0 * step)
        for shift, late_s, step in steps
    ]
    place_std = float(np.hypot(truth.position_std_m, sensor.position_std_m))
    usual = CLOCK_STD_S if truth.is_geographic else 0.0
    clock_std = usual if sensor.clock_std_s is None else sensor.clock_std_s
    std = np.array([place_std, place_std, clock_std])
    height_m = 0.0 if sensor.depth_m is None else sensor.depth_m - SOURCE_DEPTH_M
    range_m = np.hypot(*track.heard(time_s, sensor.sound_speed_mps))
    return KnownPassage(
        cos_elevation=range_m / np.hypot(range_m, height_m),
        angle_rad=np.where(used, here - np.radians(turn), np.nan),
        slope=np.stack(slopes, axis=-1)[:, std > 0.0],
        prior_std=std[std > 0.0],
        power=frames.power,
        intensity=frames.intensity,
        n_cells=frames.n_cells,
    )


def _difference(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray((one - other + np.pi) % (2.0 * np.pi) - np.pi)


def _measured(sensor: Sensor, vessel: str, fit: DipoleFit, least_range_m: float) -> Calibration:
    quantities = [
        MeasuredQuantity(name, float(value), float(std), bool(told))
        for name, value, std, told in zip(NAMES, fit.value, fit.std, fit.is_told, strict=True)
    ]
    return Calibration(
        sensor=sensor.id,
        vessel=vessel,
        quantities=tuple(quantities),
        compass_offset_deg=_corrected(sensor, fit).compass_offset_deg,
        compass_std_deg=fit.bearing_std_deg,
        error_before_deg=fit.before_deg,
        error_after_deg=fit.after_deg,
        n_frames=fit.n_frames,
        span_deg=fit.span_deg,
        least_range_m=least_range_m,
        multiplex=sensor.multiplex,
    )


def _corrected(sensor: Sensor, fit: DipoleFit) -> Sensor:
    """Return the sensor with what was measured."""
    value = [round(float(v), 5) for v in fit.value]
    return replace(
        sensor,
        dipole_gains=f"{value[0]},{value[1]}",
        dipole_crosstalk=value[2],
        omni_crosstalk=f"{value[3]},{value[4]}",
        compass_offset_deg=round((sensor.compass_offset_deg + value[5] + 180.0) % 360.0 - 180.0, 3),
        compass_std_deg=round(fit.bearing_std_deg, 3),
        north=None,
    )
