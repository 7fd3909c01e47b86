"""The three terms of a calibration, and whether they can be true together.

**Method.** A full-scale sample stands for the pressure
``adc_peak_v * 10**(-(sensitivity + gain)/20)``, in uPa. Recorders saturate between
about 1e3 uPa (60 dB re 1 uPa) and 1e12 uPa (240 dB); a value outside betrays a wrong
sign or unit, and the term farthest from what is sold is named.
"""

import math
from collections.abc import Mapping

from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.toml_tables import Number

CALIBRATION: dict[str, Number] = {
    "sensitivity_db_re_v_per_upa": Number(-400.0, 400.0, "dB re 1 V/uPa"),
    "gain_db": Number(-200.0, 200.0, "dB"),
    "adc_peak_v": Number(1e-6, 1e6, "V"),
}
USUAL = {
    "sensitivity_db_re_v_per_upa": (-230.0, -120.0),
    "gain_db": (-40.0, 80.0),
    "adc_peak_v": (0.05, 60.0),
}
HINTS = {
    "sensitivity_db_re_v_per_upa": (
        "hydrophones have -230 to -120 dB re 1 V/uPa; a value re 1 V/Pa needs -120 dB"
    ),
    "gain_db": "amplifiers have -40 to 80 dB; an amplification factor is no dB value",
    "adc_peak_v": "converters have 0.05 to 60 V; the peak is meant, in volts",
}
FULL_SCALE_UPA = (1e3, 1e12)


def check_calibration(facts: Mapping[str, float], where: str) -> None:
    """Refuse a calibration that is incomplete or cannot be true.

    Raises
    ------
    DataError
        One or two of the three terms are missing, or together they give a
        full-scale pressure that no recorder has.
    """
    given = [key for key in CALIBRATION if key in facts]
    if not given:
        return
    missing = [key for key in CALIBRATION if key not in facts]
    if missing:
        msg = (
            f"{where}: a calibration needs {', '.join(CALIBRATION)}; "
            f"{', '.join(missing)} is missing. Give all three, or none if unknown."
        )
        raise DataError(msg)
    sensor = Sensor(
        id="",
        sensitivity_db_re_v_per_upa=facts["sensitivity_db_re_v_per_upa"],
        gain_db=facts["gain_db"],
        adc_peak_v=facts["adc_peak_v"],
    )
    full_scale_upa = sensor.full_scale_upa or 0.0
    low, high = FULL_SCALE_UPA
    if not low <= full_scale_upa <= high:
        wrong = max(USUAL, key=lambda key: _oddness(key, facts[key]))
        msg = (
            f"{where}: the calibration makes a full-scale sample {full_scale_upa:.3g} "
            f"uPa, outside {low:g} to {high:g}; {wrong} = {facts[wrong]:g} looks "
            f"wrong ({HINTS[wrong]})."
        )
        raise DataError(msg)


def _oddness(key: str, value: float) -> float:
    """Return how far a term lies outside what is usual, dB."""
    low, high = USUAL[key]
    if key == "adc_peak_v":
        return 20.0 * math.log10(max(value / high, low / value))
    return max(low - value, value - high)
