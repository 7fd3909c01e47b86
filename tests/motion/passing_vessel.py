"""Containers of a vessel that passes, straight from the truth of a scene."""

import numpy as np

from tests.draws.passage_truth import Scene, received
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families
from uwtrack_cli.data.spectra import Levels

RATE_HZ, WINDOW_S = 2000.0, 1.0


def frames_of(length_s, start_utc_ns=None, sensor="h1"):
    hop = int(RATE_HZ * WINDOW_S)
    count = int(length_s / WINDOW_S)
    start = hop * np.arange(count)
    return Frames(
        start_sample=start,
        time_s=(start + hop / 2) / RATE_HZ,
        valid_fraction=np.ones(count),
        band_low_hz=np.array([10.0]),
        band_high_hz=np.array([1000.0]),
        noise_db=np.full((count, 1), 60.0),
        threshold_db=np.full(count, 9.0),
        sensor=sensor,
        sample_rate_hz=RATE_HZ,
        window_samples=hop,
        hop_samples=hop,
        fft_length=2 * hop,
        start_utc_ns=start_utc_ns,
    )


def no_families():
    none = np.empty(0)
    return Families(
        family=none, frame=none, spacing_hz=none, spacing_std_hz=none, offset_hz=none,
        is_harmonic=none, n_members=none, log10_chance=none, peak_family=none,
    )  # fmt: skip


def lines_of_scenes(scenes, rng, *, has_bearing=True, status="moving", frames=None):
    """One contact per scene; raw measurements with their true deviations."""
    frames = frames or frames_of(scenes[0].length_s)
    time = np.asarray(frames.time_s)
    points, numbers, contacts = [], [], []
    for contact, scene in enumerate(scenes, 1):
        motion = np.array([scene.closest_s, scene.range_m / scene.speed_mps, scene.speed_mps, 0.0])
        ratio, angle, distance = received(scene, time, motion)
        far = distance / scene.range_m
        for rest in scene.rest_hz:
            numbers.append(len(numbers) + 1)
            contacts.append(contact)
            std = 0.003 * far
            bearing_std = 3.0 * far
            bearing = scene.bearing_deg + scene.turn * np.rad2deg(angle)
            measured = bearing + bearing_std * rng.normal(size=time.size)
            points.append(
                (
                    np.full(time.size, numbers[-1]),
                    rest * ratio + std * rng.normal(size=time.size),
                    std,
                    measured % 360 if has_bearing else np.full(time.size, np.nan),
                    bearing_std if has_bearing else np.full(time.size, np.nan),
                    -20 * np.log10(far),
                )
            )
    columns = [np.concatenate(column) for column in zip(*points, strict=True)]
    return lines_of_columns(frames, columns, contacts, status)


def lines_of_columns(frames, columns, contacts, status="moving"):
    """Lines that are measured in every frame, one after the other.

    The columns are the line, frequency and deviation (Hz), bearing and deviation
    (degrees) and level (dB) of every point; each line has its contact.
    """
    time = np.asarray(frames.time_s)
    numbers = range(1, len(contacts) + 1)
    n = columns[0].size
    blank = np.zeros(n)
    return Lines(
        frames=frames,
        families=no_families(),
        line=columns[0],
        frame=np.tile(np.arange(time.size), len(numbers)),
        time_s=np.tile(time, len(numbers)),
        frequency_hz=columns[1],
        frequency_rate_hzps=blank,
        frequency_covariance=np.zeros((n, 2, 2)),
        bearing_deg=columns[3],
        bearing_rate_degps=blank,
        bearing_covariance=np.zeros((n, 2, 2)),
        association=np.full(n, 2),
        measured_frequency_hz=columns[1],
        measured_frequency_std_hz=columns[2],
        measured_bearing_deg=columns[3],
        measured_bearing_std_deg=columns[4],
        measured_level_db=100.0 + columns[5],
        measured_snr_db=20.0 + columns[5],
        line_id=np.array(numbers),
        line_contact=np.array(contacts),
        line_family=np.full(len(numbers), -1),
        line_status=np.array([status] * len(numbers)),
        reference="1 uPa",
        false_lines_per_khz_hour=1.0,
        weakest_line_snr_db=3.0,
    )


def levels_of_scene(scene, rng, *, snr_db=15.0, level_db=120.0, has_bearing=True):
    """Broadband levels and bearings; ``level_db`` is the vessel's at its closest."""
    frames = frames_of(scene.length_s)
    time = np.asarray(frames.time_s)
    motion = np.array([scene.closest_s, scene.range_m / scene.speed_mps, scene.speed_mps, 0.0])
    _, angle, distance = received(scene, time, motion)
    near = (scene.range_m / distance) ** 2
    excess = 10 * np.log10(10 ** (snr_db / 10) * near + 1)
    excess = excess + rng.normal(size=time.size)
    std = 3.0 / np.sqrt(near)
    bearing = scene.bearing_deg + scene.turn * np.rad2deg(angle)
    unknown = np.full(time.size, np.nan)
    return Levels(
        frames=frames,
        level_db=excess + level_db - snr_db,
        excess_db=excess,
        excess_std_db=np.ones(time.size),
        bearing_deg=(bearing + std * rng.normal(size=time.size)) % 360 if has_bearing else unknown,
        bearing_std_deg=std if has_bearing else unknown,
        band_low_hz=100.0,
        band_high_hz=1000.0,
        reference="1 uPa",
    )


__all__ = ["Scene", "frames_of", "levels_of_scene", "lines_of_columns", "lines_of_scenes"]
