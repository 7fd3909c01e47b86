"""Lines of real recordings; skipped without UWTRACK_REAL_DATA."""

import os
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tests.support import recording_of
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.stages.lines.policies import Motion
from uwtrack_cli.stages.peaks import find_peaks
from uwtrack_cli.stages.spectrogram import compute_spectrogram
from uwtrack_cli.stages.trace import trace_lines
from uwtrack_cli.stages.track import track_lines

FOLDER = Path(os.environ.get("UWTRACK_REAL_DATA", "/nonexistent"))
pytestmark = pytest.mark.skipif(
    not FOLDER.exists(), reason="UWTRACK_REAL_DATA is not set"
)


def blocks_of(path: str, **options):
    samples, rate = soundfile.read(FOLDER / path, dtype="float32", always_2d=True)
    return list(compute_spectrogram(recording_of(samples[:, 0], rate), **options))


def track(path: str, motion: Motion | None = None, **options) -> Lines:
    peaks = [find_peaks(block) for block in blocks_of(path, **options)]
    return Lines.join(list(track_lines(iter(peaks), motion=motion or Motion())))


@pytest.mark.parametrize(
    ("name", "spacing_hz", "orders"),
    [
        ("kennicott_31", 6.25, (3, 4, 6, 10, 12, 20)),
        ("nave_orbit_10", 3.75, (2, 3, 4, 5, 6, 8)),
        ("ruby_princess_5", 8.5, (1, 2, 3, 4, 6, 8)),
    ],
)
def test_the_listed_family_of_a_ship_is_found_and_no_other(
    name: str, spacing_hz: float, orders: tuple[int, ...]
) -> None:
    found = Lines.join(list(trace_lines(iter(
        blocks_of(f"ships/{name}.wav", window_s=4.0, overlap=0.75, band_hz=(2.0, 400.0))
    ), window_frames=40 if name != "nave_orbit_10" else 80)))  # fmt: skip
    listed = spacing_hz * np.array(orders)
    means = np.array(
        [np.median(found.frequency_hz[found.line == k]) for k in found.line_id]
    )
    # the listed spacing is rounded to a quarter of a hertz
    near = np.abs(means[None, :] - listed[:, None]) < 0.02 * listed[:, None] + 0.25
    assert near.any(axis=1).sum() >= 4
    ratio = found.families.spacing_hz / spacing_hz
    whole = np.maximum(ratio, 1.0 / ratio)
    assert np.any(np.abs(whole - np.round(whole)) < 0.03 * whole)


def test_the_horn_of_the_train_is_followed_through_the_passage() -> None:
    motion = Motion(frequency_hz2ps3=50.0, doppler_ps3=0.1)
    lines = track(
        "train/traindoppler.wav", motion, window_s=0.1, overlap=0.8,
        band_hz=(50.0, 4000.0),
    )  # fmt: skip
    through = [
        k for k in lines.line_id
        for time in [lines.time_s[lines.line == k]]
        if time[0] < 9.6 and time[-1] > 10.3
    ]  # fmt: skip
    # approach over recession at v = 34.1 m/s is 1.2208; inside the passage less
    ratios = []
    for k in through:
        at = lines.line == k
        early = lines.frequency_hz[at][np.argmin(np.abs(lines.time_s[at] - 9.25))]
        late = lines.frequency_hz[at][np.argmin(np.abs(lines.time_s[at] - 10.8))]
        ratios.append(early / late)
    horn = [r for r in ratios if 1.12 < r < 1.23]
    assert len(horn) >= 5
    assert len(horn) >= len(through) - 1
    contacts = lines.line_contact[np.isin(lines.line_id, through)]
    assert np.bincount(contacts[contacts > 0]).max() >= 4


def test_the_electrical_lines_of_the_hydrophone_are_hum() -> None:
    lines = track("orcasound/NATURE11_09_02_21_20_2701.flac", band_hz=(10.0, 2000.0))
    for mains in (60.0, 300.0, 540.0):
        means = np.array(
            [np.median(lines.frequency_hz[lines.line == k]) for k in lines.line_id]
        )
        at = np.argmin(np.abs(means - mains))
        assert abs(means[at] - mains) < 0.5
        assert lines.line_status[at] == "hum"
        assert lines.line_contact[at] == 0
