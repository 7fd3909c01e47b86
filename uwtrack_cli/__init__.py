"""uwtrack: hydrophone recordings in, vessel tracks out.

The public names, in the order of the flow; each is imported when it is first used.

Examples
--------
>>> from uwtrack_cli import find_peaks
>>> find_peaks.__name__
'find_peaks'
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "open_recording": "files.audio.recording_file",
    "find_sensor": "files.tables.sensors",
    "compute_spectrogram": "spectra.spectrogram",
    "demodulate": "spectra.demon",
    "pool_overview": "spectra.overview",
    "measure_levels": "spectra.levels",
    "find_peaks": "spectra.peaks",
    "form_beams": "arrays.beamform",
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
    "run_recipe": "flow.engine",
    "read_product": "files.hdf5.product",
    "write_product": "files.hdf5.product",
    "simulate_recordings": "simulate",
}

__all__ = [*_HOMES, "__version__"]  # noqa: PLE0604 - names of the table above


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
