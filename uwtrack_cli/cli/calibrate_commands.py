"""`calibrate`: a vector sensor and a vessel of known track."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from uwtrack_cli.cli.command_factory import AsJson, Output, with_parameters
from uwtrack_cli.cli.console import put, say, say_wrote, show_table
from uwtrack_cli.cli.recording_arguments import SOURCE_PARAMETERS, open_source
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit
from uwtrack_cli.errors import OutputError

if TYPE_CHECKING:
    from uwtrack_cli.flow.calibration import Calibration

BESIDE = ".calibrated.sensor.toml"
"""What the name of the new sensor file ends with, unless another is given."""

UNUSED = ("own_ship", "channel")
"""Options of recordings that a sensor at rest with all its channels has no use for."""


@with_parameters([p for p in SOURCE_PARAMETERS if p.name not in UNUSED])
def calibrate(
    source: Path,
    *,
    truth: Path,
    vessel: str | None = None,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()] = (
        100.0,
        1500.0,
    ),
    window_s: Annotated[float, Unit("s"), AtLeast(0.01), AtMost(60)] = 1.0,
    within_m: Annotated[float, Unit("m"), AtLeast(1), AtMost(1e5)] = 2000.0,
    output: Output = None,
    json_output: AsJson = False,
    **source_options: Any,
) -> None:
    """Calibrate the dipoles of a DIFAR sensor by a vessel whose track is known.

    Measures gains, crosstalk and orientation, and writes a new sensor file with them.
    It never replaces a file. The standard deviation of the compass is the one that
    remains after the calibration.

    Parameters
    ----------
    source
        Recording of a DIFAR sensor that a vessel passes.
    truth
        Track of the vessel: NAME.truth.json, or an AIS table.
    vessel
        Name or MMSI of the vessel; by default the one that comes nearest.
    band_hz
        Band in Hz between whose lines the vessel is detected.
    window_s
        Length of a frame in s.
    within_m
        Largest range in m at which frames are used.
    output
        New sensor file; pass.calibrated.sensor.toml unless given.
    """
    from uwtrack_cli.files.atomic import check_target, write_text
    from uwtrack_cli.files.tables.sensors import sensor_text
    from uwtrack_cli.flow.calibration import calibrate_sensor
    from uwtrack_cli.flow.scoring.score_product import read_any_truth

    target = source.with_name(source.stem + BESIDE) if output is None else output
    if target.exists():
        raise OutputError(
            f"{target} exists already, and calibrate replaces no sensor file: name "
            f"another one with -o."
        )
    check_target(target, overwrite=False)
    recording = open_source(source, source_options)
    known = read_any_truth(truth)
    found, sensor = calibrate_sensor(
        recording, known, vessel=vessel, band_hz=band_hz, window_s=window_s, within_m=within_m
    )
    heading = (
        f"# Gains, crosstalk and compass measured with {source.name} and "
        f"{known.name}: {found.vessel} at {found.least_range_m:.0f} m.\n"
    )
    write_text(target, heading + sensor_text(sensor))
    if json_output:
        put([json.dumps(asdict(found), ensure_ascii=False)])
    else:
        _show(found)
    say_wrote(target)


def _show(found: "Calibration") -> None:
    show_table(("quantity", "value", "std", ""), list(map(_row, found.quantities)))
    say(
        f"bearings of {found.vessel} over {found.span_deg:.0f} degrees erred by "
        f"{found.error_before_deg:.1f} degrees rms, and by {found.error_after_deg:.1f} "
        f"with this; {found.compass_std_deg:.2g} degrees are left in other directions"
    )
    if found.multiplex is not None:
        in_phase, ahead = found.multiplex.split(",")
        say(
            f"in the audio {in_phase} is in phase with the 15 kHz pilot, and {ahead} a "
            f"quarter of a period ahead of it"
        )


def _row(item: Any) -> Sequence[str]:
    remark = "" if item.is_told else "not determined by this passage"
    return item.quantity, f"{item.value:.4g}", f"{item.std:.2g}", remark
