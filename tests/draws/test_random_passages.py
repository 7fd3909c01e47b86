"""Drawn scenarios: seeded part by part, inside their ranges, and all of them sound."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws.random_passages import DISTURBANCES, SAMPLE_RATES_HZ, draw_scenario
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate import simulate_recordings, truth

DRAWN = [draw_scenario(seed) for seed in range(400)]


def test_a_seed_draws_the_same_and_another_one_something_else():
    assert draw_scenario(7) == draw_scenario(7)
    assert draw_scenario(7) != draw_scenario(8)


def test_leaving_out_a_disturbance_changes_nothing_else():
    whole = draw_scenario(5, n_vessels=2, kinds=list(DISTURBANCES))
    less = draw_scenario(
        5, n_vessels=2, kinds=[k for k in DISTURBANCES if k not in {"rain", "gusts"}]
    )
    assert whole.noise.rain
    assert less == replace(whole, noise=replace(whole.noise, rain=(), gusts=None))
    one = draw_scenario(5, n_vessels=1, kinds=[])
    assert one.vessels == draw_scenario(5, n_vessels=3, kinds=[]).vessels[:1]


def test_each_disturbance_is_there_when_asked_for_and_alone():
    bare = draw_scenario(1, n_vessels=1, kinds=[])
    for kind in DISTURBANCES:
        assert draw_scenario(1, n_vessels=1, kinds=[kind]) != bare, kind
    with pytest.raises(OptionError, match="unknown disturbance 'hail'; known: rain"):
        draw_scenario(1, kinds=["hail"])


def test_drawn_values_cover_their_ranges():
    own = [[v for v in s.vessels if v.name == ""] for s in DRAWN]
    assert {len(vessels) for vessels in own} == {1, 2, 3, 4}
    assert {s.sample_rate_hz for s in DRAWN} == set(SAMPLE_RATES_HZ)
    vessels = [v for group in own for v in group]
    depths = np.array([v.source_depth_m for v in vessels])
    assert 0.4 <= depths.min() < 0.5
    assert 6.9 < depths.max() <= 7.0
    ranges = np.array([v.closest_approach.horizontal_range_m for v in vessels])
    assert np.mean(ranges < 5.0) == pytest.approx(0.15, abs=0.04)
    assert ranges.max() <= 800.0
    times = np.array([v.closest_approach.time_s for v in vessels])
    near_ends = (times < 40.0) | (times > 440.0)
    assert np.mean(near_ends) == pytest.approx(0.3, abs=0.05)
    cavitating = [v.broadband.cavitation is not None for v in vessels]
    assert np.mean(cavitating) == pytest.approx(0.6, abs=0.06)
    for key in ("rain", "drift", "swell", "gusts", "shrimp", "knocks", "hum"):
        share = np.mean([bool(getattr(s.noise, key)) for s in DRAWN])
        assert share == pytest.approx(0.5, abs=0.1), key


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_drawn_recording_can_be_made_and_is_finite(seed):
    scenario = draw_scenario(seed, sample_rate_hz=4000.0, duration_s=30.0, kinds=list(DISTURBANCES))
    (recording,) = simulate_recordings(scenario)
    sound = np.concatenate(list(recording.reader(60_000)))
    assert sound.shape == (120_000, recording.n_channels)
    assert np.isfinite(sound).all()
    assert sound.std() > 0.0
    assert len(truth(scenario)["vessels"]) == len(scenario.vessels)


def test_noise_alone_has_no_encounter():
    scenario = draw_scenario(3, n_vessels=0, kinds=["gear change", "rain"])
    assert truth(scenario)["encounters"] == []
