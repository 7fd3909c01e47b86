"""Simulated recordings on disk: sound, sensor file and truth beside each other.

**Conventions.** ``pass.wav`` has ``pass.sensor.toml`` (what the sensor's owner knows)
and ``pass.truth.json`` (what happened). A scenario with several sensors makes
``NAME-ID.wav`` for each of them, and one ``NAME.truth.json`` over all. The sensor of
a moving platform has its positions in ``NAME.nav.csv``.

The keys of a scenario file are those of `uwtrack_cli.simulate.scenario`: scalars of the
scenario, ``[[sensor]]``, ``[[vessel]]`` with ``[vessel.closest_approach]`` or
``[vessel.track]``, ``[[vessel.line]]``, ``[vessel.broadband]``, and ``[noise]``.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.atomic import check_target, write_text
from uwtrack_cli.files.audio.recording_file import write_wav
from uwtrack_cli.files.tables.sensors import sensor_text
from uwtrack_cli.files.tables.toml_tables import read_toml
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import Scenario, make_scenario
from uwtrack_cli.simulate.scenario_truth import truth

SCENARIO_SUFFIX = ".scenario.toml"
"""What the name of a scenario file in a folder of samples ends with."""

BLOCK_SAMPLES = 65536
"""Samples made at a time."""


def write_simulation(
    scenario: Scenario, path: Path, *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write every recording of a scenario, with sensor files and truth.

    ``path``: the WAV file; with several sensors, ``-ID`` is put before its suffix.

    Returned: the files written, the recordings first.

    Raises
    ------
    OutputError
        A file exists already or cannot be written.

    Warns
    -----
    UwtrackWarning
        Samples exceed full scale and are clipped.
    """
    check_target(path, overwrite=True)  # it has a name, and its folder is there
    recordings = simulate_recordings(scenario)
    several = len(recordings) > 1
    endings = [f"-{r.sensor.id}" if several else "" for r in recordings]
    sounds = [path.with_name(f"{path.stem}{end}{path.suffix}") for end in endings]
    whole = path.with_suffix(".truth.json")
    targets = [*sounds, whole]
    for recording, sound in zip(recordings, sounds, strict=True):
        targets += [*sensor_names(sound, recording.sensor), _truth_name(sound)]
    for target in targets:  # all or none
        check_target(target, overwrite=overwrite)
    others = []
    for recording, sound in zip(recordings, sounds, strict=True):
        write_wav(
            sound,
            _metered(recording, sound.name),
            recording.sample_rate_hz,
            overwrite=overwrite,
            start_utc_ns=recording.start_utc_ns,
        )
        facts = json.dumps(truth(scenario, recording.sensor.id))
        told = write_sensor(sound, recording.sensor, overwrite=overwrite)
        write_text(_truth_name(sound), facts + "\n", overwrite=overwrite)
        others += [told[0], _truth_name(sound), *told[1:]]
    if several:
        write_text(whole, json.dumps(truth(scenario)) + "\n", overwrite=overwrite)
        others.append(whole)
    return (*sounds, *others)


def remake_samples(directory: Path, into: Path | None = None) -> tuple[Path, ...]:
    """Make all sample recordings again from the scenario files of a folder.

    ``directory``: folder with ``NAME.scenario.toml`` files. ``into``: folder for the
    results; by default the same folder.

    Returned: the files written.

    Raises
    ------
    DataError
        The folder holds no scenario.
    """
    scenarios = sorted(directory.glob(f"*{SCENARIO_SUFFIX}"))
    if not scenarios:
        raise DataError(f"{directory} holds no file that ends with {SCENARIO_SUFFIX}.")
    target = directory if into is None else into
    return tuple(
        written
        for source in scenarios
        for written in write_simulation(
            read_scenario(source),
            target / f"{source.name.removesuffix(SCENARIO_SUFFIX)}.wav",
            overwrite=True,
        )
    )


def _truth_name(sound: Path) -> Path:
    return sound.with_suffix(".truth.json")


def _metered(recording: Recording, name: str) -> Iterator[Samples]:
    """Pass the blocks on; warn at the end if any sample exceeds full scale."""
    assert recording.reader is not None  # noqa: S101 - simulate_recordings gives one
    peak, clipped = 0.0, 0
    for block in recording.reader(BLOCK_SAMPLES):
        size = np.abs(block)
        peak = max(peak, float(size.max()))
        clipped += int(np.count_nonzero(size > 1.0))
        yield block
    if clipped:
        warn(
            f"{name}: {clipped} samples exceed full scale and are clipped; raise "
            f"full_scale_db (or lower gain_db) by {20.0 * np.log10(peak):.1f} dB."
        )


def write_sensor(sound: Path, sensor: Sensor, *, overwrite: bool) -> list[Path]:
    """Write the sensor file of a recording and, if it moves, its positions.

    Returned: the files written, those of `sensor_names`.
    """
    written = sensor_names(sound, sensor)
    navigation_name = ""
    if sensor.navigation is not None:
        navigation_name = written[1].name
        navigation = _navigation_text(sensor.navigation)
        write_text(written[1], navigation, overwrite=overwrite)
    write_text(written[0], sensor_text(sensor, navigation_name), overwrite=overwrite)
    return written


def sensor_names(sound: Path, sensor: Sensor) -> list[Path]:
    """Return where the sensor of a recording and, if it moves, positions are written."""
    endings = [".sensor.toml"] + [".nav.csv"] * (sensor.navigation is not None)
    return [sound.with_suffix(ending) for ending in endings]


def _navigation_text(navigation: Navigation) -> str:
    columns = (navigation.time_s, navigation.east_m, navigation.north_m)
    rows = zip(*columns, navigation.heading_deg, strict=True)
    lines = [f"{t:.3f},{e:.4f},{n:.4f},{h:.5f}" for t, e, n, h in rows]
    return "\n".join(["time_s,east_m,north_m,heading_deg", *lines]) + "\n"


def read_scenario(path: Path) -> Scenario:
    """Read a scenario from a TOML file.

    Returned: the scenario, with every key and value checked.

    Raises
    ------
    DataError
        The file is missing or is no TOML.
    OptionError
        A key is unknown or missing, or a value is not accepted.
    """
    return make_scenario(read_toml(path))
