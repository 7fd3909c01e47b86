"""How well the sound speed is known where nobody says so."""

from uwtrack_cli.constants import SOUND_SPEED_WATER_MPS
from uwtrack_cli.data.sensor import Sensor

GIVEN_SHARE, NOMINAL_SHARE = 0.005, 0.01
"""Deviation of a sound speed that is given without one, and of the nominal one."""


def sound_speed_std(sensor: Sensor, option_mps: float | None) -> float:
    """Return the deviation of the sound speed, m/s, of an option or of the sensor.

    The sensor's own deviation belongs to its own sound speed.

    Examples
    --------
    >>> sound_speed_std(Sensor(id="h1"), None)
    15.0
    """
    if option_mps is not None:
        return GIVEN_SHARE * option_mps
    if sensor.sound_speed_std_mps is not None:
        return sensor.sound_speed_std_mps
    is_nominal = sensor.sound_speed_mps == SOUND_SPEED_WATER_MPS
    return sensor.sound_speed_mps * (NOMINAL_SHARE if is_nominal else GIVEN_SHARE)
