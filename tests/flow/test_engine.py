"""Command = recipe = library, blocks do not matter, and a run is honest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.spectra import Levels, Overview, Spectrogram
from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.tables.sensors import find_sensor
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.step import simple_step
from uwtrack_cli.lines.classify import classify_peaks
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.overview import pool_overview
from uwtrack_cli.spectra.peaks import find_peaks
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

KINDS = (Overview, Levels, Lines, Encounters)


def assert_same(found, expected):
    """In a file, all containers of a sensor share the frames that know the noise."""
    if hasattr(found, "frames"):
        np.testing.assert_array_equal(found.frames.time_s, expected.frames.time_s)
        found = replace(found, frames=expected.frames)
    assert found.equals(expected), type(found).__name__


def opened(path):
    return open_recording(path, sensor=find_sensor(path))


@pytest.fixture(scope="session")
def by_library(short_pass):
    """The chain written out with the functions themselves."""
    recording = opened(short_pass)
    band = (10.0, 2000.0)
    blocks = list(compute_spectrogram(recording, window_s=1.0, band_hz=band))
    peaks = [find_peaks(block) for block in blocks]
    families = [classify_peaks(block) for block in peaks]
    lines = Lines.join(list(track_lines(iter(families))))
    levels = Levels.join(list(measure_levels(iter(blocks))))
    overview = Overview.join(list(pool_overview(iter(blocks))))
    encounters = find_encounters(lines, levels, recording.sensor, recording=recording)
    return {
        type(c): c
        for c in (Peaks.join(peaks), Families.join(families), lines, levels, overview, encounters)
    }


def test_a_run_is_the_library(short_pass, by_library):
    made = run_recipe(opened(short_pass), load_recipe("vessel"), keep=[Peaks])
    for kind in set(by_library) - {Families}:  # the recipe tracks the peaks themselves
        found = next(c for c in made if type(c) is kind)
        assert found.equals(by_library[kind]), kind.__name__


@pytest.mark.slow
def test_the_commands_one_by_one_are_the_library(uwtrack, short_pass, by_library):
    sound = short_pass
    Path(sound.name).symlink_to(sound)  # `cpa` asks the sound beside the product
    for words in (
        ["spectrogram", sound, "--band-hz", 10, 2000, "-o", "p.spectrogram.h5"],
        ["levels", "p.spectrogram.h5"],
        ["peaks", "p.spectrogram.h5"],
        ["classify", "p.peaks.h5"],
        ["track", "p.families.h5"],
        ["cpa", "p.levels.h5", "p.lines.h5"],
    ):
        done = uwtrack(*words)
        assert done.exit_code == 0, done.output
        assert done.stdout == ""
    for name, kinds in {
        "p.levels.h5": [Levels, Overview],
        "p.families.h5": [Families],
        "p.encounters.h5": [Encounters, Lines, Levels, Overview],
    }.items():
        with read_product(name) as product:
            for kind in kinds:
                assert_same(product.read(kind), by_library[kind])


def test_the_run_command_is_the_library(uwtrack, short_pass, by_library):
    words = ("run", short_pass, "--recipe", "vessel", "-o", "p.run.h5")
    assert uwtrack(*words).exit_code == 0
    with read_product("p.run.h5") as product:
        for kind in KINDS:
            assert_same(product.read(kind, step=""), by_library[kind])
        assert [step.stage for step in product.history] == [
            step.stage_name for step in load_recipe("vessel").steps
        ]


@pytest.mark.parametrize("block", [999, 30_000])
def test_how_the_sound_is_read_does_not_matter(block):
    rng = np.random.default_rng(1)
    time = np.arange(2000 * 60) / 2000
    tone = np.sin(2 * np.pi * (200 * time + 0.002 * time**2))
    sound = tone + white_noise(time.size, 2, density=1e-2, rate_hz=2000.0)
    sound += 0.3 * np.sin(2 * np.pi * 400 * time + rng.uniform())
    recipe = load_recipe("vessel")
    one, other = (run_recipe(recording_of(sound, 2000.0, block=b), recipe) for b in (block, None))
    for first, second in zip(one[2:], other[2:], strict=True):
        assert first.equals(second), first.NAME


def test_noise_holds_no_vessel(samples):
    made = run_recipe(opened(samples / "noise.wav"), load_recipe("vessel"))
    (encounters,) = [c for c in made if isinstance(c, Encounters)]
    assert not set(encounters.status) & {"ok", "extrapolated", "level-only"}


def test_the_spectrogram_passes_by(short_pass):
    made = run_recipe(opened(short_pass), load_recipe("vessel"))
    assert not any(isinstance(c, Spectrogram | Peaks) for c in made)


def test_a_recipe_must_begin_with_sound(short_pass):
    recipe = Recipe("odd", "", (simple_step("peaks"),))
    with pytest.raises(OptionError, match=r"no step that reads the recording"):
        run_recipe(opened(short_pass), recipe)
