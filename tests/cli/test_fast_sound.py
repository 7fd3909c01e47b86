"""Recordings of high sample rates: the result is that of their low band."""

import io
import warnings
from functools import cache

import numpy as np
import pytest
import soundfile
from scipy.signal import resample_poly

from tests.draws.brief_passages import in_memory
from tests.support import recording_of
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.recording import HeldSamples
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import UwtrackNote
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import make_scenario

RATE_HZ, LENGTH_S = 24_000, 150.0


@cache
def passage():
    """Sound of a vessel that passes, in full-scale units, shape (n,)."""
    scenario = make_scenario({
        "seed": 11, "duration_s": LENGTH_S, "sample_rate_hz": float(RATE_HZ),
        "sensor": [{"id": "h1", "kind": "omni", "depth_m": 20.0, "full_scale_db": 155.0,
                    "east_m": 0.0, "north_m": 0.0}],
        "vessel": [{
            "name": "v1",
            "closest_approach": {
                "time_s": 73.0, "horizontal_range_m": 80.0, "speed_mps": 7.0,
                "course_deg": 30.0, "side": "port",
            },
            "line": [{"fundamental_hz": 41.3, "harmonics": 5, "step_db": -1.0,
                      "cn0_db_hz": 38.0}],
            "broadband": {"band_hz": [80.0, 10_000.0], "snr_db": 6.0},
        }],
        "noise": {"density_db": 70.0, "slope_db_per_decade": -17.0},
    })  # fmt: skip
    return np.concatenate(list(in_memory(scenario).reader(1 << 18)))[:, 0]


def made_of(samples, rate_hz, recipe):
    recording = recording_of(samples, rate_hz)
    held = HeldSamples(samples.astype("f4")[:, None])
    object.__setattr__(recording, "reader", held)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackNote)  # one omni sensor has no position
        made = run_recipe(recording, recipe)
    return {type(container): container for container in made}


@pytest.mark.slow
def test_a_passage_is_that_of_the_sound_which_scipy_has_slowed_down():
    recipe = load_recipe("vessel")
    slow = resample_poly(passage(), 1, 6)
    fast_one = made_of(passage(), float(RATE_HZ), recipe)
    slow_one = made_of(slow, RATE_HZ / 6.0, recipe)
    fast, expected = fast_one[Encounters], slow_one[Encounters]
    assert fast.status.tolist() == expected.status.tolist() == ["ok"]
    for name in ("time_s", "range_over_speed_s", "speed_mps", "slant_range_m"):
        body, unit = name.rsplit("_", 1)
        std = getattr(expected, f"{body}_std_{unit}")[0]
        assert abs(getattr(fast, name)[0] - getattr(expected, name)[0]) < 0.1 * std
        assert getattr(fast, f"{body}_std_{unit}")[0] == pytest.approx(std, rel=0.03)
    evidence = fast.rest_frame_evidence[0], expected.rest_frame_evidence[0]
    assert evidence[0] == pytest.approx(evidence[1], abs=0.05)
    difference = fast_one[Levels].level_db - slow_one[Levels].level_db
    # a cell near the limit of lines may count in one and not in the other, and scipy's
    # own filter has a ripple: the levels are held against the full rate below
    assert np.abs(np.median(difference)) < 0.02
    assert np.quantile(np.abs(difference), 0.95) < 0.05


def test_levels_are_those_of_the_full_rate():
    text = "[spectrogram]\nband_hz = [10.0, 2000.0]\n[levels]\n"
    low = Recipe.from_toml("low", text)
    full = low.with_settings(["spectrogram.decimation=1"])
    some = passage()[: 40 * RATE_HZ]
    one, other = (made_of(some, float(RATE_HZ), r)[Levels] for r in (low, full))
    np.testing.assert_allclose(one.level_db, other.level_db, atol=0.01)
    np.testing.assert_allclose(one.excess_db, other.excess_db, atol=0.02)


@pytest.mark.slow
def test_history_has_the_decimation_and_live_sound_and_a_rerun_give_the_same(uwtrack, tmp_path):
    memory = io.BytesIO()
    some = passage()[60 * RATE_HZ : 80 * RATE_HZ]
    soundfile.write(memory, some, RATE_HZ, "PCM_16", format="WAV")
    (tmp_path / "a.wav").write_bytes(memory.getvalue())
    assert uwtrack("run", "a.wav", "-q").exit_code == 0
    with read_product(tmp_path / "a.run.h5") as product:
        used = {
            past.step_name: past.options["decimation"]
            for past in product.history
            if "decimation" in past.options
        }
    assert used["spectrogram"] == used["short-spectrogram"] == 2
    assert uwtrack("rerun", "a.run.h5", "-o", "again.h5", "-q").exit_code == 0
    words = ("run", "-", "-o", "live.h5", "-q")
    assert uwtrack(*words, input=memory.getvalue()).exit_code == 0
    for other in ("again.h5", "live.h5"):
        done = uwtrack("diff", "a.run.h5", other)
        assert done.exit_code == 0, done.stdout
