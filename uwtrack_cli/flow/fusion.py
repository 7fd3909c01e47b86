"""Fuse what several sensors heard at the same time into positions.

**Conventions.** Recordings belong together when their sensors differ and all share
some time; without UTC they are taken to start at once. The recipe's own ``locate``
step is applied, with its options; a recipe without one fuses nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.encounters import Fixes
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.files.product import HistoryStep
from uwtrack_cli.flow.products import history_of_recipe, whole_stage
from uwtrack_cli.flow.recipe import Recipe, Step


@dataclass(frozen=True)
class Fusion:
    """A step that joins several recordings, and the file that its result goes to."""

    recipe: Recipe
    step: Step
    recordings: tuple[Recording, ...]
    target: Path

    def apply(self, made: Sequence[Container]) -> list[Container]:
        """Locate over the containers of all recordings; the result comes last."""
        return whole_stage(self.step, [c for c in made if not isinstance(c, Fixes)], [])

    def history(self) -> list[HistoryStep]:
        """Return how each recording was read, the steps over each, and the last."""
        runs = [history_of_recipe(self.recipe, r) for r in self.recordings]
        rest = [step for step in runs[0][1:] if step.stage != self.step.stage_name]
        last = HistoryStep.now(self.step.stage_name, self.step.values())
        return [*(run[0] for run in runs), *rest, last]


def plan_fusion(
    recipe: Recipe, sources: Sequence[Path], recordings: Sequence[Recording]
) -> Fusion | None:
    """Return how recordings are to be fused, None if they do not belong together.

    Parameters
    ----------
    recipe
        The recipe that the recordings are run with.
    sources
        Files of the recordings; the first one names the result.
    recordings
        The recordings, opened.
    """
    step = next((s for s in recipe.steps if s.stage_name == "locate"), None)
    sensors = {recording.sensor.id for recording in recordings}
    if step is None or len(sensors) < 2 or not _overlap(recordings):
        return None
    target = sources[0].with_name(f"{sources[0].stem}.fixes.h5")
    return Fusion(recipe, step, tuple(recordings), target)


def _overlap(recordings: Sequence[Recording]) -> bool:
    begins = [(r.start_utc_ns or 0) / NANOSECONDS for r in recordings]
    ends = [b + r.duration_s for b, r in zip(begins, recordings, strict=True)]
    return max(begins) < min(ends)
