"""uwtrack: hydrophone recordings in, vessel tracks out.

The public names: `run` and what it gives, the stages in the order of the flow, the
containers, and the errors. Each is imported when it is first used; `__init__.pyi`
tells their types.

Examples
--------
>>> from uwtrack_cli import find_peaks
>>> find_peaks.__name__
'find_peaks'
"""

import warnings
from importlib import import_module
from typing import Any

from uwtrack_cli.data.renamed import PYTHON

__version__ = "0.3.0"

_HOMES = {
    "run": "flow.results",
    "read_results": "flow.results",
    "Results": "flow.results",
    "SourceOptions": "flow.results",
    "to_pandas": "files.tables.dataframes",
    "to_xarray": "files.tables.dataframes",
    "open_recording": "files.audio.recording_file",
    "find_sensor": "files.tables.sensors",
    "compute_spectrogram": "spectra.spectrogram",
    "demodulate": "spectra.demon",
    "pool_overview": "spectra.overview",
    "measure_levels": "spectra.levels",
    "find_peaks": "spectra.peaks",
    "find_transients": "spectra.transients",
    "form_beams": "arrays.beamform",
    "track_bearings": "arrays.track_bearings",
    "measure_delays": "arrays.delays",
    "find_directions": "arrays.directions",
    "classify_peaks": "lines.classify",
    "track_lines": "lines.track",
    "track_lines_pda": "lines.track_pda",
    "trace_lines": "lines.trace",
    "find_encounters": "motion.cpa",
    "find_presence": "presence.presence",
    "locate_vessels": "motion.locate",
    "estimate_motion": "motion.tma",
    "track_in_clutter": "clutter.pdaf",
    "discriminate_contacts": "discrimination.discriminate",
    "load_recipe": "flow.shipped_recipes",
    "copy_sample": "flow.shipped_recipes",
    "Recipe": "flow.recipe",
    "run_recipe": "flow.engine",
    "Product": "files.hdf5.product",
    "read_product": "files.hdf5.product",
    "write_product": "files.hdf5.product",
    "make_scenario": "simulate",
    "simulate_recordings": "simulate",
    "Container": "data.base",
    "Recording": "data.recording",
    "RecordedFiles": "data.recording",
    "Sensor": "data.sensor",
    "Navigation": "data.sensor",
    "Frames": "data.frames",
    "Spectrogram": "data.spectra",
    "Overview": "data.spectra",
    "Levels": "data.spectra",
    "Decidecades": "data.decidecades",
    "Fringes": "data.fringes",
    "RadiatedLevels": "data.decidecades",
    "Delays": "data.directions",
    "Directions": "data.directions",
    "BearingTime": "data.bearing_time",
    "Peaks": "data.peaks",
    "Families": "data.peaks",
    "Transients": "data.transients",
    "Lines": "data.lines",
    "Lock": "data.recording",
    "Presence": "data.presence",
    "Encounters": "data.encounters",
    "Fixes": "data.encounters",
    "Motions": "data.motions",
    "Series": "data.series",
    "Contacts": "data.scans",
    "Scans": "data.scans",
    "Roc": "data.scans",
    "Target": "data.targets",
    "Decision": "data.decisions",
    "UwtrackError": "errors",
    "DataError": "errors",
    "OptionError": "errors",
    "OutputError": "errors",
    "UwtrackWarning": "errors",
}

__all__ = [*_HOMES, "__version__"]  # noqa: PLE0604 - names of the table above


def __getattr__(name: str) -> Any:
    """Import a public name from its module; an old name warns."""
    if new := PYTHON.get(name):
        warnings.warn(
            f"{name} is now called {new}; the old name goes in 0.4.",
            DeprecationWarning,
            stacklevel=2,
        )
        return __getattr__(new)
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """Return the public names, for completion and help."""
    return sorted(__all__)
