"""What is not known exactly enters the deviations of a closest approach."""

import numpy as np
import pytest

from tests.draws.passage_truth import Scene
from tests.motion.nuisance_coverage import (
    CLASSES,
    QUANTITIES,
    analyse,
    holds_on_both_sides,
    score,
    told,
)
from tests.support import binomial_interval
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors


def deviations(draws):
    return np.array([np.abs(d.error) / d.std for d in draws])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["overhead", "near, no line"])
def test_intervals_hold_when_the_truth_is_drawn_from_what_is_told(kind):
    """Errors of 8 drawn passages; coverage of many is in tests/acceptance."""
    draws = [score(kind, seed) for seed in range(1, 9)]
    values = deviations(draws)
    values = values[:, np.isfinite(values).all(axis=0)]
    assert values.shape[1] >= 4
    hits = (values <= 1.96).sum(axis=0)
    assert all(binomial_interval(int(n), len(draws))[1] >= 0.95 for n in hits)
    assert holds_on_both_sides(values)
    assert values.max() < 5
    assert not any(draw.wrong_side for draw in draws)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("kind", CLASSES)
def test_intervals_hold_over_four_hundred_passages(kind):
    first = int(np.random.SeedSequence().generate_state(1)[0])
    draws = [score(kind, first + k) for k in range(400)]
    for place, name in enumerate(QUANTITIES):
        values = deviations(draws)[:, place]
        values = values[np.isfinite(values)]
        low, high = binomial_interval(int((values <= 1.96).sum()), values.size)
        assert values.size == 0 or (low <= 0.97 and high >= 0.93), (name, first)
        assert (values > 5).mean() < 0.005 if values.size else True, (name, first)


def test_the_sound_speed_scales_the_speed_and_its_share_is_stated():
    """v = M c: an uncertain c of 1 % is 1 % of v, in quadrature with the rest."""
    scene = Scene(6.0, 250.0, 30.0, (63.0, 126.0, 189.0, 310.0), height_m=19.0)
    row = analyse(scene, 0.0, np.random.default_rng(3))
    sensor, _ = told()
    share = {item.name: item for item in row.nuisances}
    relative = sensor.sound_speed_std_mps / 1500.0 * row.values["speed_mps"]
    sound = share["sound_speed_mps"]
    assert sound.share * row.values["speed_std_mps"] ** 2 == pytest.approx(relative**2, rel=0.02)
    assert sound.std == pytest.approx(7.5, rel=0.01)
    assert 0 < sum(item.share for item in row.nuisances) <= 1 + 1e-9
    assert share["compass_deg"].std == pytest.approx(2.0)
    assert row.values["course_std_deg"] > 2.0


def test_an_overhead_passage_measures_the_depth_better_than_it_was_told():
    scene = Scene(5.0, 21.3, 34.0, (126.0, 189.0, 310.0), height_m=21.0)
    row = analyse(scene, 0.0, np.random.default_rng(4))
    depth = {item.name: item for item in row.nuisances}["source_depth_m"]
    assert depth.std < 1.0
    assert abs(depth.value - 1.0) < 3.5 * depth.std
    assert row.values["slant_range_m"] >= row.values["horizontal_range_m"]
    error = row.values["slant_range_m"] - scene.range_m
    assert abs(error) < 3.5 * row.values["slant_range_std_m"]


def test_zero_means_known_exactly():
    exact = Sensor(id="h1", depth_m=22.0, depth_std_m=0.0, sound_speed_std_mps=0.0)
    priors = nuisance_priors(exact, None, None, 3.0, 0.0)
    assert priors.medium.height_std_m == 0.0
    assert priors.medium.height_m == 19.0


def test_what_is_not_stated_has_a_deviation():
    bare = nuisance_priors(Sensor(id="h1", depth_m=22.0), None, None, 3.0, 2.0)
    assert bare.std.tolist() == [2.0, 0.5, 15.0, 2.0]
    given = nuisance_priors(Sensor(id="h1"), 1480.0, None, 3.0, 2.0)
    assert given.std[2] == pytest.approx(7.4)
    assert given.medium.height_m == 0.0
    assert given.medium.height_std_m == 0.0


@pytest.mark.parametrize("name", ["source_depth_std_m", "sound_speed_std_mps"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_deviation_that_cannot_be_is_refused(name, value):
    with pytest.raises(OptionError, match=rf"{name} must be a (finite )?number"):
        find_encounters(**{name: value})


@pytest.mark.parametrize("key", ["depth_std_m", "sound_speed_std_mps"])
@pytest.mark.parametrize("value", ["-1.0", "nan", "inf"])
def test_a_deviation_of_the_sensor_file_that_cannot_be_is_refused(key, value, tmp_path):
    path = tmp_path / "h.sensor.toml"
    path.write_text(f'id = "h1"\ndepth_m = 20.0\n{key} = {value}\n')
    with pytest.raises((DataError, OptionError), match=key):
        load_sensor(path)
