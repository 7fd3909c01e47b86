"""The stages of the program, on one screen.

Commands, recipe steps, tasks, history and the tests of every stage derive from this
list: to add a stage, write its function and add a line here.
"""

from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.stage import Stage
from uwtrack_cli.stages.classify import classify_peaks
from uwtrack_cli.stages.cpa import find_encounters
from uwtrack_cli.stages.levels import measure_levels
from uwtrack_cli.stages.overview import pool_overview
from uwtrack_cli.stages.peaks import find_peaks
from uwtrack_cli.stages.spectrogram import compute_spectrogram
from uwtrack_cli.stages.track import track_lines

STAGES: tuple[Stage, ...] = (
    Stage("spectrogram", compute_spectrogram),
    Stage("overview", pool_overview),
    Stage("levels", measure_levels),
    Stage("peaks", find_peaks),
    Stage("classify", classify_peaks),
    Stage("track", track_lines),
    Stage("cpa", find_encounters),
)


def find_stage(name: str) -> Stage:
    """Return the stage of a name.

    Raises
    ------
    OptionError
        There is no such stage; the names of all are listed.
    """
    for stage in STAGES:
        if stage.name == name:
            return stage
    names = ", ".join(stage.name for stage in STAGES)
    msg = f"there is no stage {name!r}; the stages are: {names}."
    raise OptionError(msg)
