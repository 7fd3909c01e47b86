"""Every stage is documented, bound and listed as the house promises."""

import inspect
import pickle
import re
import sys
from contextlib import suppress
from pathlib import Path
from subprocess import run
from typing import Literal, get_args, get_origin

import pytest

from uwtrack_cli.data.options import range_of, unit_of
from uwtrack_cli.errors import OptionError
from uwtrack_cli.flow.catalogue import STAGES, find_stage, summary_of
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe, shipped_recipes
from uwtrack_cli.flow.step import Step

NAMES = list(STAGES)
UNITS = {
    "s": "s", "hz": "Hz", "db": "dB", "deg": "degree", "mps": "m/s", "m": "m",
    "hzps": "Hz/s", "degps": "degree/s", "mps2": "m/s^2", "ps3": "1/s^3",
    "hz2ps3": "Hz^2/s^3", "deg2ps3": "degree^2/s^3",
}  # fmt: skip
"""Unit that the last word of an option's name stands for."""


def is_numeric(kind):
    """Whether a type is, or holds, a number."""
    parts = get_args(kind)
    return kind in {int, float} or (get_origin(kind) is not Literal and any(map(is_numeric, parts)))


@pytest.mark.parametrize("name", NAMES)
def test_a_stage_has_a_summary_and_its_options_have_help(name):
    stage = find_stage(name)
    assert summary_of(STAGES[name]).endswith(".")
    assert stage.inputs
    for option in stage.options:
        assert option.text.endswith("."), (name, option.name)
        assert len(option.text) > 10, (name, option.name)


@pytest.mark.parametrize("name", NAMES)
def test_a_number_has_a_range_on_both_sides_and_the_unit_of_its_name(name):
    for option in find_stage(name).options:
        if not is_numeric(option.type):
            continue
        limits = range_of(option.hint)
        assert re.search("above|at least", limits), (name, option.flat_name)
        assert re.search("below|at most", limits), (name, option.flat_name)
        expected = UNITS.get(option.name.rsplit("_", 1)[-1])
        if expected is not None:
            assert unit_of(option.hint) == expected, (name, option.flat_name)
        assert limits in option.help, (name, option.flat_name)


EXTREMES = [1e308, -1e308, 1e-308, 2**63, -(2**63), 10**400, float("nan"), float("inf")]


@pytest.mark.parametrize("value", EXTREMES, ids=repr)
@pytest.mark.parametrize("name", NAMES)
def test_an_extreme_number_is_accepted_or_refused_in_a_sentence(name, value):
    stage = find_stage(name)
    refused = 0
    for option in stage.options:
        if option.type not in {int, float, int | None, float | None}:
            continue
        given = {option.name: value}
        with suppress(OptionError):
            stage.bind(given if option.group is None else {option.group: given})
            continue
        refused += 1
    if not abs(value) < 1e300:
        numbers = [o for o in stage.options if o.type in {int, float}]
        assert refused >= len(numbers)


@pytest.mark.parametrize("name", NAMES)
def test_the_defaults_of_a_stage_pass_its_own_check(name):
    stage = find_stage(name)
    assert stage.bind(stage.defaults) == stage.defaults


@pytest.mark.parametrize("name", NAMES)
def test_a_task_is_small(name):
    step = Step(name, name, find_stage(name).bind({}))
    assert len(pickle.dumps(step)) < 1500
    assert pickle.loads(pickle.dumps(step)) == step


@pytest.mark.parametrize("name", NAMES)
def test_a_stage_is_in_a_recipe_or_stands_alone_and_has_an_example(name):
    page = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()
    assert f"$ uwtrack {name}" in page
    recipes = [load_recipe(r) for r in shipped_recipes()]
    in_recipe = any(step.stage_name == name for r in recipes for step in r.steps)
    tables = {"tma", "pdaf", "discriminate", "directions"}  # what they read
    alone = {"classify", "delays"}  # families of single frames; a table for others
    assert in_recipe or name in {*alone, *tables}


@pytest.mark.parametrize("name", NAMES)
def test_the_summary_in_the_list_of_commands_is_the_docstrings(name):
    text = inspect.getdoc(find_stage(name).function)
    assert summary_of(STAGES[name]) == text.split("\n", 1)[0]


def test_a_name_that_is_no_stage_lists_the_stages():
    with pytest.raises(OptionError, match="spectrogram, demon, overview"):
        find_stage("spectrograms")


@pytest.mark.parametrize("name", shipped_recipes())
def test_a_recipe_written_out_reads_back_with_the_same_values(name):
    recipe = load_recipe(name)
    again = Recipe.from_toml(name, recipe.to_toml())
    assert [s.values() for s in again.steps] == [s.values() for s in recipe.steps]
    assert recipe.description


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"overlap": "half"}, "overlap must be a number"),
        ({"overlap": True}, "overlap must be a number"),
        ({"band_hz": [1.0]}, "takes 2 values, got 1"),
        ({"band_hz": 3.0}, "must be a list"),
        ({"zero_padding": 2.5}, "must be a whole number"),
        ({"window": 1.0}, "Did you mean 'window_s'"),
        ({"window_s": float("inf")}, "must be a finite number"),
        ({"window_s": 10**400}, "a whole number beyond 64 bits"),
        ({"band_hz": [1.0, float("nan")]}, "must be a finite number"),
    ],
)
def test_an_option_of_the_wrong_shape_is_refused(given, text):
    with pytest.raises(OptionError, match=text):
        find_stage("spectrogram").bind(given)


def test_a_policy_is_a_table_in_a_recipe():
    feedback = find_stage("track").bind({"feedback": {"alpha": 0.5}})["feedback"]
    assert feedback.alpha == 0.5
    with pytest.raises(OptionError, match=r"track\.feedback has no option 'alfa'"):
        find_stage("track").bind({"feedback": {"alfa": 0.5}})


def test_settings_override_options_and_fields_of_policies():
    recipe = load_recipe("vessel").with_settings(
        ["spectrogram.window_s=2", "track.feedback.alpha=0.6", "track.initiation=count"]
    )
    options = {step.name: step.options for step in recipe.steps}
    assert options["spectrogram"]["window_s"] == 2.0
    assert options["track"]["feedback"].alpha == 0.6
    assert options["track"]["initiation"] == "count"


def test_help_imports_no_slow_module():
    code = (
        "import sys; sys.argv=['uwtrack','--help']\n"
        "from uwtrack_cli.cli import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "slow={'scipy','h5py','soundfile','matplotlib','pandas','distributed'}\n"
        "found=slow & {m.split('.')[0] for m in sys.modules}\n"
        "sys.exit(f'slow: {found}' if found else 0)\n"
    )
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
