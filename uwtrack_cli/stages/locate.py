"""Positions: where a vessel was, is and will be, from its closest approaches.

**Method.** One sensor whose lines gave a speed fixes the motion by itself; several
sensors are fused by weighted least squares, without Doppler too. Encounters belong
together if a chi-square gate says so; what remains ambiguous is listed with weights.

**Conventions.** Straight motion; east and north in metres on the grid of the sensors,
latitude and longitude where the sensors have them. The covariance grows with the time
from the closest approaches.

**References.** Choi et al. (2014), eqs. 1-2 and 8-19 corrected.
"""

import warnings

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import OptionError, UwtrackWarning
from uwtrack_cli.physics.geodesy import to_latitude_longitude
from uwtrack_cli.stages.passages.pairing import Mode, group_encounters, list_modes
from uwtrack_cli.stages.passages.sites import Passages, gather_passages
from uwtrack_cli.stages.passages.times import fix_times, to_utc_ns


def locate_vessels(
    encounters: list[Encounters],
    sensors: list[Sensor],
    *,
    at: list[str] | None = None,
    every_s: float | None = None,
    until: str | None = None,
    gate_probability: float = 0.999,
) -> Fixes:
    """Locate every vessel from its closest approaches to one sensor or more.

    With one sensor the speed must be known from the lines; with several it need
    not. Without times, the positions at the closest approaches are given.

    Parameters
    ----------
    encounters
        Closest approaches, of any number of sensors and recordings.
    sensors
        The sensors, found by their identifiers.
    at
        Times of the positions: UTC such as 2026-01-31T12:00:00Z, or seconds from
        the first sample.
    every_s
        Distance of regular times in seconds, above zero.
    until
        End of the regular times: UTC, or seconds from the first sample; by default
        the last closest approach.
    gate_probability
        Probability that encounters of one vessel are joined, between 0 and 1.

    Returns
    -------
    Fixes
        One row per vessel, time and mode.

    Raises
    ------
    DataError
        Sensors are missing, or their positions or clocks cannot be combined.
    OptionError
        An option is out of its range.

    Notes
    -----
    Choi et al. (2014), eq. 1 with the side per sensor; eqs. 15-16 with
    A = t_d^2 - |D|^2 as the start without Doppler; weighted least squares on times,
    widths, speeds and bearings with the deviations of position, clock and compass.
    """
    _check(every_s, until, gate_probability)
    passages = gather_passages(encounters, sensors)
    parts: list[dict[str, FloatArray | list[str]]] = []
    vessel = 0
    groups = group_encounters(passages, gate_probability)
    listed = list_modes(passages, groups, gate_probability)
    for members, modes in zip(groups, listed, strict=True):
        if not modes:
            names = ", ".join(passages.sensor[row] for row in members)
            msg = (
                f"no position for the encounter of sensor {names}: one sensor needs "
                "a speed and a bearing; give the encounters of more sensors."
            )
            warnings.warn(msg, UwtrackWarning, stacklevel=2)
            continue
        vessel += 1
        contact = passages.contact[members[0]] if _is_single(passages) else vessel
        times = fix_times(
            passages.approaches.measured[list(members), 0],
            passages.start_utc_ns, at, every_s, until,
        )  # fmt: skip
        parts += [
            _rows(contact, number, mode, times, passages)
            for number, mode in enumerate(modes, 1)
        ]
    return _fixes(parts, passages)


def _check(every_s: float | None, until: str | None, probability: float) -> None:
    if every_s is not None and not every_s > 0:
        msg = f"every_s must be above 0, got {every_s}."
        raise OptionError(msg)
    if until is not None and every_s is None:
        msg = f"until ({until}) needs every_s: the distance of the times."
        raise OptionError(msg)
    if not 0 < probability < 1:
        msg = f"gate_probability must be in (0, 1), got {probability}."
        raise OptionError(msg)


def _is_single(passages: Passages) -> bool:
    return len(set(passages.sensor)) <= 1


def _rows(
    contact: int,
    number: int,
    mode: Mode,
    times: FloatArray,
    passages: Passages,
) -> dict[str, FloatArray | list[str]]:
    """Predict one mode at all times: state and covariance grow with the lag."""
    lag = times - mode.reference_s
    transition = np.tile(np.eye(4), (times.size, 1, 1))
    transition[:, 0, 2] = transition[:, 1, 3] = lag
    state = transition @ mode.state
    covariance = transition @ mode.covariance @ np.swapaxes(transition, 1, 2)
    velocity = mode.state[2:]
    speed = float(np.hypot(*velocity))
    along = velocity / speed
    across = np.array([along[1], -along[0]])
    spread = mode.covariance[2:, 2:]
    names = sorted({passages.sensor[row] for row in mode.members})
    count = times.size
    return {
        "contact": np.full(count, float(contact)),
        "mode": np.full(count, float(number)),
        "weight": np.full(count, mode.weight),
        "time_s": times,
        "east_m": state[:, 0],
        "north_m": state[:, 1],
        "covariance_m2": covariance[:, :2, :2],
        "speed_mps": np.full(count, speed),
        "speed_std_mps": np.full(count, np.sqrt(along @ spread @ along)),
        "course_deg": np.full(count, np.rad2deg(np.arctan2(*velocity)) % 360.0),
        "course_std_deg": np.full(
            count, np.rad2deg(np.sqrt(across @ spread @ across) / speed)
        ),
        "sensors": [",".join(names)] * count,
    }


def _fixes(parts: list[dict[str, FloatArray | list[str]]], passages: Passages) -> Fixes:
    def gather(name: str) -> FloatArray:
        values = [np.asarray(part[name], float) for part in parts]
        return np.concatenate(values) if values else np.empty(0)

    origin = passages.grid.origin
    east, north = gather("east_m"), gather("north_m")
    unknown = np.full(east.shape, np.nan)
    latitude, longitude = (
        to_latitude_longitude(east, north, origin) if origin else (unknown, unknown)
    )
    time = gather("time_s")
    covariance = gather("covariance_m2")
    plain = ("weight", "speed_mps", "speed_std_mps", "course_deg", "course_std_deg")
    return Fixes(
        **{name: gather(name) for name in plain},
        contact=gather("contact").astype(np.int64),
        mode=gather("mode").astype(np.int64),
        time_s=time,
        time_utc_ns=to_utc_ns(time, passages.start_utc_ns),
        east_m=east,
        north_m=north,
        latitude=latitude,
        longitude=longitude,
        covariance_m2=covariance.reshape(-1, 2, 2),
        sensors=np.array(
            [name for part in parts for name in part["sensors"]], dtype=np.str_
        ),
        origin=passages.grid.name,
        origin_latitude=origin.latitude if origin else None,
        origin_longitude=origin.longitude if origin else None,
    )
