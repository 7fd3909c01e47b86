"""Fuse what several sensors heard at the same time into positions.

**Conventions.** Recordings belong together when their sensors differ and all share
some time; without UTC they are taken to start at once. The recipe's own ``locate``
step is applied, with its options; a recipe without one fuses nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.files.hdf5.product import HistoryStep
from uwtrack_cli.flow.products import Held, history_of_graph, source_of_recording, whole_result
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.step import Step


@dataclass(frozen=True)
class Fusion:
    """A step that joins several recordings, and the file that its result goes to."""

    recipe: Recipe
    """The recipe of all recordings."""
    step: Step
    """The step that joins them."""
    recordings: tuple[Recording, ...]
    """The recordings, opened."""
    target: Path
    """File of the result."""

    def apply(self, made: Sequence[Held]) -> list[Held]:
        """Locate over the results of all recordings; the fixes come last."""
        graph = self.recipe.graph()
        steps = {step.name: step for step in graph.steps()}
        node = next(n for n in graph.nodes if n.step.name == self.step.name)
        read = {graph.product_key(steps[name]) for names in node.sources.values() for name in names}
        left = [
            held
            for held in made
            if not isinstance(held.container, Fixes)
            and (held.step in read or not isinstance(held.container, Encounters))
        ]
        return whole_result(self.step, left, [])

    def history(self) -> list[HistoryStep]:
        """Return how each recording was read, the steps over each, and the last."""
        graph = self.recipe.graph()
        runs = [
            history_of_graph(graph.resolved(r), [source_of_recording(r)]) for r in self.recordings
        ]
        readers = [step for run in runs for step in run if step.sources]
        own = self.step.name
        rest = [s for s in runs[0] if not s.sources and s.step_name != own]
        last = next(s for s in runs[0] if s.step_name == own)
        return [*readers, *rest, last]


def plan_fusion(
    recipe: Recipe, sources: Sequence[Path], recordings: Sequence[Recording]
) -> Fusion | None:
    """Return how recordings are to be fused, None if they do not belong together."""
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
