"""Weigh all peaks near a line, or take one: what association by probability gains.

**Method.** Simulated recordings of six tones on a passage (a Doppler swing), of two tones
that cross, and of noise alone go through `spectrogram`, `peaks` and either `track` or the
probabilistic tracker. Both start lines by the same score, so that their rates of false
lines are the same; noise alone checks it.

**References.** Choi, Kim and Hong (2001); Gelfand, Fortmann and Bar-Shalom (1996).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from studies.rows import exact_row, mean_row
from studies.tones import simulate_tones
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.estimation.detection_threshold import best_prior
from uwtrack_cli.estimation.operating_curve import model_curve
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.track_pda import track_lines_pda
from uwtrack_cli.lines.tracker_options import ScoreLogic
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

Tracker = Literal["track", "track-pda"]
_TRACKERS: tuple[Tracker, ...] = ("track", "track-pda")
_RATE_HZ, _LENGTH_S = 1000.0, 300.0
_RESTS_HZ = (83.0, 127.0, 181.0, 233.0, 311.0, 389.0)
_SWING, _SWING_S = 5e-3, 30.0
_KEPT = (1e-2, 1e-1)
_SNRS_DB = (0.0, 3.0, 6.0, 10.0)
_NEAR_HZ = 1.0
_REMARKS = (
    (
        "cover: share of true line-frames with a line within 1 Hz; pieces: lines per "
        "tone; error: root mean square of the smoothed frequency on covered points."
    ),
    (
        "wanted: the false alarm probability that maximises q2 for a line that searches "
        "so many cells. Peaks kept down to 0.01 are too few for weak lines: the rule then "
        "rests at that limit, and takes its advantage from peaks kept down to 0.1."
    ),
    (
        "Lines start by the same score in both trackers; the noise rows count the lines "
        "in noise alone with 200 wanted per kHz and hour."
    ),
)


def study_line_association(*, runs: int = 4, seed: int = 1) -> Study:
    """Compare line tracking by assignment and by probabilistic association.

    ``runs``: number of simulated recordings of each kind, 300 s long.

    Returned: coverage, pieces and errors of both trackers; there is no published
    reference.
    """
    rows = list(_depth_rows())
    for kept in _KEPT:
        for snr_db in _SNRS_DB:
            found = [passage(snr_db, kept, seed + run) for run in range(runs)]
            for tracker in _TRACKERS:
                case = f"passage, {snr_db:g} dB, kept {kept:g}, {tracker}"
                rows += _passage_rows(case, [each[tracker] for each in found])
        for tracker in _TRACKERS:
            case = f"kept {kept:g}, {tracker}"
            crossed = [crossing(kept, seed + run)[tracker] for run in range(runs)]
            noise = [noise_lines(kept, seed + run)[tracker] for run in range(runs)]
            rows += mean_row(
                f"crossing, {case}", "followed through (share)", None, np.array(crossed)
            )
            rows += mean_row(f"noise alone, {case}", "lines in 300 s", None, np.array(noise))
    return Study("line-association", "no published figures", runs, seed, tuple(rows), _REMARKS)


@dataclass(frozen=True)
class PassageFigures:
    """What a tracker made of the six tones of a passage."""

    cover: float
    """Share of the line-frames with a line within 1 Hz."""
    pieces: float
    """Lines per tone."""
    error_hz: float
    """Root-mean-square error of the smoothed frequency on covered points, Hz."""


def passage(snr_db: float, kept: float, seed: int) -> dict[Tracker, PassageFigures]:
    """Track six tones with a Doppler swing.

    ``snr_db``: power of each tone over the noise in its cell, in dB. ``kept``:
    exceedance probability of the weakest peaks kept.
    """
    time_s = np.arange(round(_LENGTH_S * _RATE_HZ)) / _RATE_HZ
    samples = simulate_tones(
        np.random.default_rng(seed), _swing(time_s), snr_db, sample_rate_hz=_RATE_HZ
    )
    found = {}
    for tracker, lines in _track(samples, kept, ScoreLogic()).items():
        error = lines.frequency_hz - _swing(lines.time_s)
        tone = np.abs(error).argmin(axis=0)
        error = np.take_along_axis(error, tone[None], axis=0)[0]
        near = np.abs(error) < _NEAR_HZ
        covered = {*zip(tone[near].tolist(), lines.frame[near].tolist(), strict=True)}
        total = len(_RESTS_HZ) * lines.frames.n_frames
        found[tracker] = PassageFigures(
            len(covered) / total,
            np.unique(lines.line[near]).size / len(_RESTS_HZ),
            math.sqrt(float((error[near] ** 2).mean())) if near.any() else math.nan,
        )
    return found


def crossing(kept: float, seed: int) -> dict[Tracker, float]:
    """Track two tones that cross; return the share followed from end to end.

    ``kept``: exceedance probability of the weakest peaks kept.
    """
    time_s = np.arange(round(_LENGTH_S * _RATE_HZ)) / _RATE_HZ
    slide = 0.05 * (time_s - 0.5 * _LENGTH_S)
    samples = simulate_tones(
        np.random.default_rng(seed), np.stack([200.0 + slide, 200.0 - slide]), 8.0,
        sample_rate_hz=_RATE_HZ,
    )  # fmt: skip
    found = {}
    for tracker, lines in _track(samples, kept, ScoreLogic()).items():
        followed = 0
        for sign in (1.0, -1.0):
            true = 200.0 + sign * 0.05 * (lines.time_s - 0.5 * _LENGTH_S)
            near = np.abs(lines.frequency_hz - true) < _NEAR_HZ
            early = near & (lines.time_s > 80.0) & (lines.time_s < 110.0)
            late = near & (lines.time_s > 190.0) & (lines.time_s < 220.0)
            followed += bool(np.intersect1d(lines.line[early], lines.line[late]).size)
        found[tracker] = followed / 2.0
    return found


def noise_lines(kept: float, seed: int) -> dict[Tracker, float]:
    """Count the lines that are found in noise alone at a raised rate.

    ``kept``: exceedance probability of the weakest peaks kept.
    """
    silence = np.full((1, round(_LENGTH_S * _RATE_HZ)), np.nan)
    samples = simulate_tones(np.random.default_rng(seed), silence, 0.0, sample_rate_hz=_RATE_HZ)
    lax = ScoreLogic(false_lines_per_khz_hour=200.0)
    found = _track(samples, kept, lax)
    return {tracker: float(lines.line_id.size) for tracker, lines in found.items()}


def _swing(time_s: FloatArray) -> FloatArray:
    """Return the frequency of every tone over time, ``(tone, time)``."""
    shift = 1.0 - _SWING * np.tanh((time_s - 0.5 * _LENGTH_S) / _SWING_S)
    tones: FloatArray = np.multiply.outer(np.array(_RESTS_HZ), shift)
    return tones


def _track(samples: FloatArray, kept: float, score: ScoreLogic) -> dict[Tracker, Lines]:
    """Run both trackers on the peaks of a recording."""

    def read(n_samples: int) -> Iterator[Samples]:
        table = samples.astype(np.float32)[:, None]
        for start in range(0, len(table), n_samples):
            yield table[start : start + n_samples]

    recording = Recording(
        sensor=Sensor(id="study"), name="study.wav", sample_rate_hz=_RATE_HZ,
        n_samples=samples.size, n_channels=1, reader=read,
    )  # fmt: skip
    blocks: list[Peaks] = [
        find_peaks(block, kept_probability=kept) for block in compute_spectrogram(recording)
    ]
    return {
        "track": Lines.join(list(track_lines(iter(blocks), score=score))),
        "track-pda": Lines.join(list(track_lines_pda(iter(blocks), score=score))),
    }


def _depth_rows() -> Iterator[StudyRow]:
    """Say which false alarm rate lines of a certain width would want."""
    for snr_db in (3.0, 10.0):
        curve = model_curve("steady", 10.0 ** (snr_db / 10.0))
        cells = np.array([1.0, 2.0, 5.0, 20.0])
        wanted = best_prior(curve, cells, (1e-6, 0.5), dimension=1)
        for size, value in zip(cells, wanted, strict=True):
            case = f"wanted, {snr_db:g} dB, {size:g} cells"
            yield exact_row(case, "false alarm probability", None, float(value))


def _passage_rows(case: str, figures: list[PassageFigures]) -> Iterator[StudyRow]:
    names = ("cover (share)", "pieces per tone", "frequency error (Hz)")
    table = np.array([(each.cover, each.pieces, each.error_hz) for each in figures])
    for name, values in zip(names, table.T, strict=True):
        yield from mean_row(case, name, None, values)
