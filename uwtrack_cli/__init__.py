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
    "open_recording": "files.audio",
    "find_sensor": "files.sensors",
    "compute_spectrogram": "stages.spectrogram",
    "pool_overview": "stages.overview",
    "measure_levels": "stages.levels",
    "find_peaks": "stages.peaks",
    "classify_peaks": "stages.classify",
    "track_lines": "stages.track",
    "track_lines_pda": "stages.track_pda",
    "trace_lines": "stages.trace",
    "find_encounters": "stages.cpa",
    "locate_vessels": "stages.locate",
    "estimate_motion": "stages.tma",
    "track_in_clutter": "stages.pdaf",
    "discriminate_contacts": "stages.discriminate",
    "load_recipe": "flow.shipped",
    "run_recipe": "flow.chain",
    "read_product": "files.product",
    "write_product": "files.product",
    "simulate_recordings": "simulate",
}

__all__ = [*_HOMES, "__version__"]  # noqa: PLE0604 - names of the table above


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
