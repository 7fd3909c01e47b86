"""Measure how high the best path scores in noise: the tables behind `trace`.

**Method.** White Gaussian noise goes through the spectrogram, its noise floor and the
path search exactly as sound does. The best score per window and 250 Hz is noted; its
upper tail is fitted by an exponential, whose two numbers stand in
``lines/paths/trace_threshold.py``, as does the mean score of the paths that no line can
take (`lines.paths.recording_noise`). Run ``python -m studies.trace_noise``
to make them again (about five minutes).

**Conventions.** Exceedances are per window and kHz of band.

**References.** Gumbel, "Statistics of Extremes" (1958).
"""

import json
import sys
from collections.abc import Iterator
from itertools import product

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.lines.line_points import LinePoints
from uwtrack_cli.lines.paths.path_search import (
    MOVE_PENALTY,
    PathSearch,
    best_scores,
    cell_scores,
    whiten,
)
from uwtrack_cli.lines.paths.path_tracer import PathTracer, TraceRule
from uwtrack_cli.lines.paths.recording_noise import surrogate_scores
from uwtrack_cli.lines.paths.trace_window import WindowData
from uwtrack_cli.lines.trace import trace_rule
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ, BAND_HZ = 4096.0, 250.0
LENGTHS = (32, 60, 120, 240)
HOURS = 2.0


class _BestScores(PathTracer):
    """A tracer that only notes the best score of each window and band."""

    def __init__(self, rule: TraceRule, *args: object) -> None:
        super().__init__(rule, *args)  # type: ignore[arg-type]
        self.best: list[FloatArray] = []
        self.surrogates: list[FloatArray] = []

    def _window(
        self,
        data: WindowData,
        *,
        is_last: bool,  # noqa: ARG002 - the signature of the base
    ) -> LinePoints:
        ratio = whiten(data.power_ratio, data.cells_per_bin)
        scores = cell_scores(ratio)
        total, moves = best_scores(scores, MOVE_PENALTY)
        width = round(BAND_HZ * data.window_s * data.cells_per_bin)
        used = total.size // width * width
        self.best.append(total[:used].reshape(-1, width).max(axis=1))
        search = PathSearch([], total, moves, scores)
        self.surrogates.append(surrogate_scores(search, data.cells_per_bin, int(data.frame[0])))
        return LinePoints.join([])


def noise_recording(seed: int, hours: float) -> Recording:
    """Return white noise that is made when it is read."""
    n_samples = int(hours * 3600 * RATE_HZ)

    def read(block: int) -> Iterator[Samples]:
        rng = np.random.default_rng(seed)
        for start in range(0, n_samples, block):
            size = (min(block, n_samples - start), 1)
            yield 0.1 * rng.standard_normal(size, dtype=np.float32)

    return Recording(
        sensor=Sensor(id="noise"), name="noise", sample_rate_hz=RATE_HZ,
        n_samples=n_samples, n_channels=1, reader=read,
    )  # fmt: skip


def measure_tail(
    overlap: float, padding: int, n_frames: int, *, hours: float, seed: int
) -> tuple[float, float, float]:
    """Return offset and slope of the best score's tail, and the mean surrogate's score.

    All in nepers.
    """
    blocks = compute_spectrogram(
        noise_recording(seed, hours), overlap=overlap, zero_padding=padding
    )
    noter: _BestScores | None = None
    for block in blocks:
        if noter is None:
            noter = _BestScores(trace_rule(block, window_frames=n_frames), block)
        noter.push(block)
    if noter is None:
        return float("nan"), float("nan"), float("nan")
    best = np.sort(np.concatenate(noter.best))[::-1]
    # the upper twentieth: its mean excess is the slope
    count = max(best.size // 20, 10)
    slope = float(np.mean(best[:count]) - best[count])
    per_khz = count / best.size * 1e3 / BAND_HZ
    offset = float(best[count] + slope * np.log(per_khz))
    return offset, slope, float(np.mean(noter.surrogates))


def main() -> None:
    """Measure all tails of the table and print them as they come."""
    for overlap, padding in product((0.5, 0.75), (2, 1)):
        for n_frames in LENGTHS:
            tail = measure_tail(overlap, padding, n_frames, hours=HOURS, seed=100 + n_frames)
            row = {"overlap": overlap, "padding": padding, "frames": n_frames}
            row |= {"offset": round(tail[0], 2), "slope": round(tail[1], 3)}
            row |= {"surrogate": round(tail[2], 2)}
            sys.stdout.write(json.dumps(row) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
