"""Lines of real recordings; skipped without UWTRACK_REAL_DATA."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.signal import medfilt, welch

from tests.lines.ship_lines import reference
from tests.support import recording_of
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.lines.trace import trace_lines
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.lines.tracker_options import ProcessNoise
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

FOLDER = Path(os.environ.get("UWTRACK_REAL_DATA", "/nonexistent"))
pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="UWTRACK_REAL_DATA is not set")


def blocks_of(path: str, **options):
    samples, rate = soundfile.read(FOLDER / path, dtype="float32", always_2d=True)
    return list(compute_spectrogram(recording_of(samples[:, 0], rate), **options))


def track(path: str, motion: ProcessNoise | None = None, **options) -> Lines:
    # with process noise as given, the recipe for vehicles: it keeps fewer peaks
    kept = 0.1 if motion is None else 0.01
    blocks = blocks_of(path, **options)
    peaks = [find_peaks(block, kept_probability=kept) for block in blocks]
    return Lines.join(list(track_lines(iter(peaks), motion=motion or ProcessNoise())))


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
    means = np.array([np.median(found.frequency_hz[found.line == k]) for k in found.line_id])
    # the listed spacing is rounded to a quarter of a hertz
    near = np.abs(means[None, :] - listed[:, None]) < 0.02 * listed[:, None] + 0.25
    assert near.any(axis=1).sum() >= 4
    ratio = found.families.spacing_hz / spacing_hz
    whole = np.maximum(ratio, 1.0 / ratio)
    assert np.any(np.abs(whole - np.round(whole)) < 0.03 * whole)


@pytest.mark.parametrize("name", ["kennicott_31", "ruby_princess_5"])
def test_the_strong_lines_of_a_long_average_are_followed(name: str) -> None:
    """Lines of a dense comb that waver were once taken for each other's jumps."""
    samples, rate = soundfile.read(FOLDER / "ships" / f"{name}.wav", dtype="float32")
    true_hz, level_db = reference(samples, rate)
    lines = track(f"ships/{name}.wav", **VESSEL)
    strong = true_hz[level_db > 7.5]
    assert strong.size >= 5
    away = np.abs(strong[:, None] - lines.frequency_hz)
    assert away.min(axis=1).max() <= 1.0


def test_the_horn_of_the_train_is_followed_through_the_passage() -> None:
    motion = ProcessNoise(frequency_hz2ps3=50.0, doppler_ps3=0.1, adaptation=0.0)
    lines = track(
        "train/traindoppler.wav", motion, window_s=0.1, overlap=0.8, band_hz=(50.0, 4000.0)
    )
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
        means = np.array([np.median(lines.frequency_hz[lines.line == k]) for k in lines.line_id])
        at = np.argmin(np.abs(means - mains))
        assert abs(means[at] - mains) < 0.5
        assert lines.line_status[at] == "hum"
        assert lines.line_contact[at] == 0


VESSEL = {"band_hz": (10.0, 2000.0)}
VEHICLE = {"window_s": 0.1, "overlap": 0.8, "band_hz": (50.0, 4000.0)}
FAST = ProcessNoise(frequency_hz2ps3=50.0, doppler_ps3=0.5, adaptation=0.0)
RECORDINGS = {
    # settings of the recipe for it, and spacings in Hz that its README lists; the
    # train's is the lowest line of the horn, before and after the passage
    "ships/kennicott_31.wav": (VESSEL, None, (6.25,)),
    "ships/nave_orbit_10.wav": (VESSEL, None, (3.75,)),
    "ships/ruby_princess_5.wav": (VESSEL, None, (8.5,)),
    "orcasound/NATURE11_09_02_21_20_2701.flac": (VESSEL, None, (60.0,)),
    "cars/known_30_mph_15degreesC_6meters.wav": (VEHICLE, FAST, ()),
    "train/traindoppler.wav": (VEHICLE, FAST, (352.6, 288.8)),
}
_GREATEST_ORDER = 8


@cache
def false_families(path: str) -> tuple[str, ...]:
    """Families that are neither listed nor in the spectrum of the whole recording."""
    options, motion, listed = RECORDINGS[path]
    lines = track(path, motion, **options)
    families = lines.families
    false = []
    for number, spacing in zip(families.family, families.spacing_hz, strict=True):
        members = lines.line_id[lines.line_family == number]
        if set(lines.line_status[lines.line_family == number]) == {"hum"}:
            continue
        means = [np.median(lines.frequency_hz[lines.line == k]) for k in members]
        is_listed = any(are_related(float(spacing), known) for known in listed)
        band = (min(means) - spacing, max(means) + spacing)
        if not is_listed and not stands_out(path, float(spacing), band):
            false.append(f"{spacing:.2f} Hz, {len(means)} lines")
    return tuple(false)


def are_related(spacing_hz: float, known_hz: float) -> bool:
    """Tell whether one spacing is a small multiple of the other.

    Listed spacings are rounded to a quarter of a hertz.
    """
    ratio = max(spacing_hz / known_hz, known_hz / spacing_hz)
    slack = 0.02 + 0.125 / known_hz
    return round(ratio) <= _GREATEST_ORDER and abs(ratio / round(ratio) - 1) < slack


def stands_out(path: str, spacing_hz: float, band_hz: tuple[float, float]) -> bool:
    """Tell whether the spectrum repeats itself at a spacing and twice and thrice it.

    Nothing of the tracker is used: the logarithm of the mean spectrum, flattened, is
    correlated with itself, and the spacing must beat 19 of 20 others.
    """
    lag_hz, likeness = own_likeness(path, band_hz)
    step = lag_hz[1]

    def score(spacing: float) -> float:
        at = np.rint(spacing * np.arange(1, 4) / step).astype(int)
        near = at[:, None] + np.arange(-2, 3)
        return float(likeness[np.clip(near, 0, likeness.size - 1)].max(axis=1).mean())

    widest = min(60.0, (band_hz[1] - band_hz[0]) / 4.0)
    others = np.array([score(d) for d in np.arange(2.5, widest, 0.1)])
    return float(np.mean(others < score(spacing_hz))) > 0.95


def own_likeness(path: str, band_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    samples, rate = soundfile.read(FOLDER / path, always_2d=True)
    window = int(5 * rate)
    frequency, power = welch(
        samples[:, 0], rate, nperseg=window, noverlap=window * 4 // 5, nfft=4 * window
    )
    inside = (frequency > band_hz[0]) & (frequency < band_hz[1])
    step = frequency[1]
    level = 10.0 * np.log10(power[inside])
    level = np.clip(level - medfilt(level, 2 * int(3.0 / step) + 1), -3.0, 10.0)
    level -= level.mean()
    product = np.correlate(level, level, "full")[level.size - 1 :]
    product /= np.arange(level.size, 0, -1) * np.var(level)
    return step * np.arange(level.size), product


@pytest.mark.parametrize("path", RECORDINGS)
def test_no_false_family_is_found(path: str) -> None:
    assert false_families(path) == ()


def test_a_spacing_that_is_not_in_the_spectrum_does_not_stand_out() -> None:
    band = (1400.0, 1700.0)
    assert stands_out("ships/nave_orbit_10.wav", 7.84, band)
    assert not stands_out("ships/nave_orbit_10.wav", 22.07, band)
    assert not stands_out("ships/nave_orbit_10.wav", 9.9, band)


def doppler_factor(time_s: FloatArray) -> FloatArray:
    """Received over emitted frequency of the train, from its known passage."""
    speed, closest_m, middle_s, sound = 34.1, 7.0, 9.60, 343.0
    emitted = time_s.copy()
    for _ in range(200):
        emitted = time_s - np.hypot(closest_m, speed * (emitted - middle_s)) / sound
    along = speed * (emitted - middle_s)
    return 1.0 / (1.0 + speed * along / (np.hypot(closest_m, along) * sound))


def test_no_line_of_the_horn_changes_places_with_another_in_the_passage() -> None:
    motion = ProcessNoise(frequency_hz2ps3=50.0, doppler_ps3=0.1, adaptation=0.0)
    lines = track("train/traindoppler.wav", motion, **VEHICLE)
    rest = []
    for k in lines.line_id:
        at = lines.line == k
        time = lines.time_s[at]
        # the blast lasts until 10.8 s
        if time[0] <= 9.4 and time[-1] >= 10.3:
            during = (time > 9.0) & (time < 10.8)
            rest.append((lines.frequency_hz[at] / doppler_factor(time))[during])
    assert len(rest) >= 5
    bells = np.array([np.median(values) for values in rest])
    # different lines are different bells or overtones
    assert np.diff(np.sort(bells)).min() > 20.0
    for own, values in enumerate(rest):
        away = np.abs(np.log(values[:, None] / bells))
        # at every moment nearer to itself than to any other line
        assert (away.argmin(axis=1) == own).all(), bells[own]
        assert away[[0, -1], own].max() < 0.03, bells[own]
