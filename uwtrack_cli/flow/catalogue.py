"""The stages of the program, on one screen.

Commands, recipe steps, tasks, history and the tests of every stage derive from this
list: to add a stage, write its function and add a line here. The functions are named,
not imported, so that listing them costs nothing.
"""

from functools import cache
from typing import TYPE_CHECKING

from uwtrack_cli.data import renamed
from uwtrack_cli.errors import OptionError

if TYPE_CHECKING:
    from uwtrack_cli.flow.stage import Stage

STAGES: dict[str, str] = {
    "spectrogram": "uwtrack_cli.spectra.spectrogram:compute_spectrogram",
    "demon": "uwtrack_cli.spectra.demon:demodulate",
    "overview": "uwtrack_cli.spectra.overview:pool_overview",
    "levels": "uwtrack_cli.spectra.levels:measure_levels",
    "decidecades": "uwtrack_cli.spectra.decidecades:measure_decidecades",
    "fringes": "uwtrack_cli.spectra.fringes:measure_fringes",
    "peaks": "uwtrack_cli.spectra.peaks:find_peaks",
    "transients": "uwtrack_cli.spectra.transients:find_transients",
    "beamform": "uwtrack_cli.arrays.beamform:form_beams",
    "track-bearings": "uwtrack_cli.arrays.track_bearings:track_bearings",
    "delays": "uwtrack_cli.arrays.delays:measure_delays",
    "directions": "uwtrack_cli.arrays.directions:find_directions",
    "classify": "uwtrack_cli.lines.classify:classify_peaks",
    "track": "uwtrack_cli.lines.track:track_lines",
    "track-pda": "uwtrack_cli.lines.track_pda:track_lines_pda",
    "trace": "uwtrack_cli.lines.trace:trace_lines",
    "combs": "uwtrack_cli.lines.combs:find_combs",
    "multi-resolution": "uwtrack_cli.lines.multi_resolution:join_rungs",
    "cpa": "uwtrack_cli.motion.cpa:find_encounters",
    "zoom": "uwtrack_cli.flow.zoom:zoom_in",
    "radiated": "uwtrack_cli.motion.radiated:estimate_radiated_levels",
    "presence": "uwtrack_cli.presence.presence:find_presence",
    "locate": "uwtrack_cli.motion.locate:locate_vessels",
    "tma": "uwtrack_cli.motion.tma:estimate_motion",
    "pdaf": "uwtrack_cli.clutter.pdaf:track_in_clutter",
    "discriminate": "uwtrack_cli.discrimination.discriminate:discriminate_contacts",
}
"""Where the function of each stage is, in the order of the chain."""


@cache
def find_stage(name: str) -> "Stage":
    """Return the stage of a name.

    Raises
    ------
    OptionError
        There is no such stage; the names of all are listed.
    """
    from uwtrack_cli.flow.stage import Stage

    name = renamed.STAGES.get(name, name)
    if name not in STAGES:
        raise OptionError(f"there is no stage {name!r}; the stages are: {', '.join(STAGES)}.")
    return Stage(name, STAGES[name])


def summary_of(target: str) -> str:
    """Return the first line of a function's docstring without importing it.

    ``target``: module and function as ``package.module:function``.

    Examples
    --------
    >>> summary_of("uwtrack_cli.flow.catalogue:find_stage")
    'Return the stage of a name.'
    """
    _, _, docstring = _source_of(target).partition('"""')
    return docstring.partition("\n")[0].partition('"""')[0]


@cache
def output_class(target: str) -> str:
    """Return the name of the class that a stage makes without importing the stage.

    Examples
    --------
    >>> output_class(STAGES["track"]), output_class(STAGES["levels"])
    ('Lines', 'Levels')
    """
    _, _, hint = _source_of(target).partition(") -> ")
    return hint.partition(":\n")[0].removeprefix("Iterator[").removesuffix("]")


def _source_of(target: str) -> str:
    """Return the source of a function, from its parameters to the end of its module."""
    from importlib.util import find_spec
    from pathlib import Path

    module, _, function = target.partition(":")
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return ""
    text = Path(spec.origin).read_text(encoding="utf-8")
    return text.partition(f"\ndef {function}(")[2]
