"""CPU-time ratios of the line tracker against peers in the same process."""

import dataclasses
import time
from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np
import pytest

from studies.line_scene import second_frames
from studies.trace_noise import noise_recording
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracker_options import Feedback, Harmonics
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

N_LINES, SPACING_HZ = 50, 17.3
CLUTTER_SHARE = 0.4
"""Clutter peaks per line."""
pytestmark = pytest.mark.benchmark


def line_load(
    n_frames: int, seed: int = 1, n_lines: int = N_LINES, spacing_hz: float = SPACING_HZ
) -> Peaks:
    """Lines seen nine times of ten, and clutter: twenty peaks a frame beside fifty."""
    rng = np.random.default_rng(seed)
    frame, line = np.nonzero(rng.random((n_frames, n_lines)) < 0.9)
    noise_frame = np.repeat(np.arange(n_frames), round(CLUTTER_SHARE * n_lines))
    frequency = np.concatenate(
        [
            100.0 + spacing_hz * line + 0.3 * rng.standard_normal(line.size),
            rng.uniform(50.0, 990.0, noise_frame.size),
        ]
    )
    bearing = np.concatenate(
        [100.0 + rng.standard_normal(line.size), rng.uniform(0.0, 360.0, noise_frame.size)]
    )
    snr = np.concatenate([np.full(line.size, 14.0), rng.uniform(9.5, 11.0, noise_frame.size)])
    frames = np.concatenate([frame, noise_frame])
    order = np.lexsort((frequency, frames))
    return Peaks(
        frames=second_frames(n_frames, 9.0),
        frame=frames[order],
        frequency_hz=frequency[order],
        frequency_std_hz=np.full(frames.size, 0.3),
        level_db=snr[order],
        snr_db=snr[order],
        bearing_deg=bearing[order] % 360.0,
        bearing_std_deg=np.ones(frames.size),
        is_detection=np.ones(frames.size, dtype=bool),
        false_alarm_probability=1e-2,
        kept_probability=1e-2,
        reference="full scale",
        lowest_hz=0.0,
        highest_hz=1000.0,
    )


def cpu_s(work: Callable[[], object], repeats: int = 3) -> float:
    """Least CPU time of a few repetitions."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def stonesoup_frame_s(
    peaks: Peaks, n_warm: int, n_frames: int, *, is_shared: bool = False
) -> float:
    """CPU time per frame of Stone Soup's Kalman filter with global assignment.

    Every detection carries its own variances, as every peak of ours does, or all of
    them share one model, which Stone Soup predicts once for a track.
    """
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(1e-2), ConstantVelocity(1e-4)])
    sensor = LinearGaussian(4, (0, 2), np.diag([1.0, 0.09]))
    predictor, updater = KalmanPredictor(motion), KalmanUpdater(sensor)
    associator = GNNWith2DAssignment(
        DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=4.0)
    )
    epoch = datetime(2024, 5, 1)  # noqa: DTZ001 - Stone Soup wants naive times
    tracks = {
        Track([GaussianState(
            [[100.0], [0.0], [100.0 + SPACING_HZ * k], [0.0]],
            np.diag([1.0, 0.01, 0.09, 0.001]), timestamp=epoch,
        )])
        for k in range(N_LINES)
    }  # fmt: skip
    start = 0.0
    for frame in range(n_warm + n_frames):
        if frame == n_warm:
            start = time.process_time()
        now = epoch + timedelta(seconds=frame + 1)
        rows = np.flatnonzero(peaks.frame == frame)
        detections = {
            Detection(
                [[peaks.bearing_deg[k]], [peaks.frequency_hz[k]]],
                timestamp=now,
                measurement_model=sensor if is_shared else LinearGaussian(
                    4, (0, 2), np.diag([
                        float(peaks.bearing_std_deg[k]) ** 2,
                        float(peaks.frequency_std_hz[k]) ** 2,
                    ]),
                ),
            )
            for k in rows
        }  # fmt: skip
        for track, choice in associator.associate(tracks, detections, now).items():
            track.append(updater.update(choice) if choice else choice.prediction)
    return (time.process_time() - start) / n_frames


@pytest.fixture(scope="session")
def stone_soup_s() -> float:
    """CPU time per frame of Stone Soup where each detection has its own variances."""
    return stonesoup_frame_s(line_load(300), n_warm=1, n_frames=4)


def test_tracking_is_at_least_300_times_faster_than_stone_soup(stone_soup_s) -> None:
    n_frames = 300
    peaks = line_load(n_frames)
    alone = Feedback(classifier="none", every_frames=n_frames, hold_frames=n_frames)
    ours = cpu_s(lambda: list(track_lines(iter([peaks]), feedback=alone)), 6) / n_frames
    print(f"track {1e3 * ours:.2f} ms, Stone Soup {1e3 * stone_soup_s:.0f} ms per frame")
    assert stone_soup_s / ours >= 300.0


def feedback_frame_s(peaks: Peaks, n_frames: int) -> float:
    """CPU time per frame of our tracker with a classification in every frame."""
    every = Feedback(births="families", every_frames=1)
    comb = Harmonics(spacing_hz=(15.0, 60.0), teeth=14)

    def work() -> None:
        families = classify_peaks(peaks, spacing_hz=(15.0, 60.0), teeth=14, most_peaks=100)
        list(track_lines(iter([families]), feedback=every, harmonics=comb))

    return cpu_s(work, repeats=6) / n_frames


def test_tracking_with_feedback_is_at_least_60_times_faster_than_stone_soup(stone_soup_s) -> None:
    n_frames = 100
    peaks = line_load(n_frames)
    ours = feedback_frame_s(peaks, n_frames)
    print(f"feedback {1e3 * ours:.2f} ms, Stone Soup {1e3 * stone_soup_s:.0f} ms")
    assert stone_soup_s / ours >= 60.0


def test_with_one_model_for_all_detections_stone_soup_stays_behind() -> None:
    n_frames = 100
    peaks = line_load(n_frames)
    alone = Feedback(classifier="none", every_frames=n_frames, hold_frames=n_frames)
    track = cpu_s(lambda: list(track_lines(iter([peaks]), feedback=alone)), 6)
    feedback = feedback_frame_s(peaks, n_frames)
    theirs = stonesoup_frame_s(peaks, n_warm=1, n_frames=4, is_shared=True)
    ratios = theirs / (track / n_frames), theirs / feedback
    print(f"one model: track {ratios[0]:.0f} times, feedback {ratios[1]:.0f} times")
    assert ratios[0] >= 70.0
    assert ratios[1] >= 10.0


def frame_over_transform(peaks: Peaks, feedback: Feedback | None = None) -> float:
    """CPU time of a frame of the tracker over that of a transform of 8000 points.

    The end of a recording, when lines are grouped once, is not counted.
    """
    from scipy.fft import rfft

    rows = np.random.default_rng(0).standard_normal((64, 8000))
    edges = np.arange(0, peaks.frames.n_frames + 1, 50)

    def transforms() -> None:
        for row in rows:
            rfft(row)

    def frames() -> float:
        blocks = [_between(peaks, *edges[k : k + 2]) for k in range(edges.size - 1)]
        options = {} if feedback is None else {"feedback": feedback}
        lines = track_lines(iter(blocks), **options)  # type: ignore[arg-type]
        next(lines)
        start = time.process_time()
        for _ in blocks[1:]:
            next(lines)
        return (time.process_time() - start) / (peaks.frames.n_frames - edges[1])

    return min(frames() for _ in range(2)) / (cpu_s(transforms, 6) / len(rows))


def _between(peaks: Peaks, first: int, last: int) -> Peaks:
    is_in = (peaks.frame >= first) & (peaks.frame < last)
    columns = {
        field.name: getattr(peaks, field.name)[is_in]
        for field in dataclasses.fields(peaks)
        if np.shape(getattr(peaks, field.name)) == is_in.shape
    }
    frames = peaks.frames.take("frame", slice(first, last))
    return dataclasses.replace(peaks, frames=frames, **columns)


@pytest.mark.parametrize(
    ("n_lines", "spacing_hz", "n_frames", "most"), [(50, 17.3, 600, 55.0), (200, 4.5, 400, 80.0)]
)
def test_a_frame_with_many_lines_costs_some_transforms(n_lines, spacing_hz, n_frames, most):
    # the aim is 7 and 20; without families the second is met
    peaks = line_load(n_frames, 1, n_lines, spacing_hz)
    alone = Feedback(classifier="none", every_frames=1000, hold_frames=1000)
    ratios = frame_over_transform(peaks), frame_over_transform(peaks, alone)
    print(f"{n_lines} lines: {ratios[0]:.0f} transforms, {ratios[1]:.0f} alone")
    assert ratios[0] <= most


def test_tracing_takes_at_most_60_times_the_bare_transforms() -> None:
    from scipy.fft import rfft

    blocks = list(compute_spectrogram(noise_recording(1, 0.2)))
    frames = blocks[0].frames
    n_frames = sum(block.frames.n_frames for block in blocks)
    rows = np.ones((n_frames, frames.window_samples), dtype=np.float32)

    def transforms() -> None:
        for row in rows:
            rfft(row, frames.fft_length)

    bare = cpu_s(transforms)
    ours = cpu_s(lambda: list(trace_lines(iter(blocks))), repeats=2)
    print(f"trace {ours:.2f} s, transforms {bare:.3f} s")
    assert ours <= 60.0 * bare
