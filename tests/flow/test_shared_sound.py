"""Sources that share a recording read it once, and each sees what it would see alone."""

import numpy as np
import pytest

from tests.support import recording_of, white_noise
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.estimation.decimation import Decimator
from uwtrack_cli.flow.engine import SharedSound, run_recipe
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

THREE_RATES = """
[spectrogram]
window_s = 0.5
output = true
[low]
stage = "spectrogram"
window_s = 1.0
band_hz = [10.0, 2000.0]
output = true
[lower]
stage = "spectrogram"
window_s = 3.0
band_hz = [10.0, 300.0]
output = true
"""


@pytest.mark.parametrize("block", [700, 65_536])
@pytest.mark.parametrize("factors", [(1, 1, 1), (4, 1, 4)], ids=str)
def test_readers_that_take_turns_read_once_and_see_the_same(block, factors):
    sound = white_noise(20_000, 1).astype("f4")[:, None]
    passes = []

    def reader(_):
        passes.append(block)
        for start in range(0, len(sound), block):
            yield sound[start : start + block]

    shared = SharedSound(reader, factors)
    sizes = (256, 1000, 7)
    taken = [one(size) for one, size in zip(shared.readers, sizes, strict=True)]
    parts: list[list[np.ndarray]] = [[], [], []]
    open_ones = [0, 1, 2]
    rng = np.random.default_rng(1)
    while open_ones:
        k = int(rng.choice(open_ones))
        part = next(taken[k], None)
        if part is None:
            open_ones.remove(k)
        else:
            parts[k].append(part)
    for pieces, factor, size in zip(parts, factors, sizes, strict=True):
        alone = Decimator(factor)
        expected = np.concatenate([alone.feed(sound), alone.finish(1)])
        np.testing.assert_array_equal(np.concatenate(pieces), expected)
        assert {len(piece) for piece in pieces[:-1]} <= {size}
    assert len(passes) == 1


def test_steps_of_several_rates_give_what_each_gives_alone():
    samples = white_noise(30 * 48_000, 2, rate_hz=48_000.0)
    recording = recording_of(samples, 48_000.0)
    recipe = Recipe.from_toml("three", THREE_RATES)
    found = [c for c in run_recipe(recording, recipe) if isinstance(c, Spectrogram)]
    for own, options in zip(
        found,
        (
            {"window_s": 0.5},
            {"window_s": 1.0, "band_hz": (10.0, 2000.0)},
            {"window_s": 3.0, "band_hz": (10.0, 300.0)},
        ),
        strict=True,
    ):
        alone = Spectrogram.join(list(compute_spectrogram(recording, **options)))
        assert own.equals(alone)
    assert found[0].frequency_hz[-1] == 24_000.0
