"""What version 0.3 renamed is understood under its old name for one version."""

import json

import h5py
import numpy as np
import pytest

import uwtrack_cli
from tests.files.synthetic_containers import synthetic
from uwtrack_cli.cli.json_schemas import json_schema
from uwtrack_cli.data import renamed
from uwtrack_cli.data.transients import Transients
from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.hdf5.checksum import append_checksum
from uwtrack_cli.files.hdf5.history import HistoryStep
from uwtrack_cli.files.hdf5.product import read_product, write_product
from uwtrack_cli.flow.catalogue import STAGES, find_stage
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe

RECIPE = """
[spectrogram]
[levels]
[rises]
[peaks]
[track]
[ladder]
input = ["track"]
[cpa]
input = ["ladder", "levels"]
ask_sound = false
"""


def test_an_old_recipe_is_that_of_the_new_names():
    old = Recipe.from_toml("mine", RECIPE)
    new = RECIPE.replace("[rises]", '[rises]\nstage = "transients"')
    new = new.replace("[ladder]", '[ladder]\nstage = "multi-resolution"')
    assert old == Recipe.from_toml("mine", new.replace("ask_sound", "rest_frame_test"))
    assert load_recipe("ladder") == load_recipe("multi-resolution")
    setting = ["rises.least_spreads=8", "cpa.ask_sound=false"]
    steps = {step.name: step for step in load_recipe("auto").with_settings(setting).steps}
    assert steps["transients"].options == {"least_spreads": 8.0}
    assert steps["cpa"].options["rest_frame_test"] is False
    with pytest.raises(OptionError, match="both are given"):
        find_stage("cpa").bind({"ask_sound": True, "rest_frame_test": True})


def test_every_name_leads_to_one_that_exists():
    assert set(renamed.STAGES.values()) <= set(STAGES)
    for (stage, _), now in renamed.OPTIONS.items():
        assert now in find_stage(stage).defaults
    for (stage, name), words in renamed.VALUES.items():
        for old, new in words.items():
            assert find_stage(stage).bind({name: old}) == {name: new}
    step = {"stage": "ladder", "options": {}, "versions": {}, "sources": []}
    assert HistoryStep.from_json(json.dumps(step)).stage == "multi-resolution"


def test_an_old_name_of_the_package_is_the_new_one():
    for old, new in renamed.PYTHON.items():
        with pytest.warns(DeprecationWarning, match=f"now called {new}"):
            found = getattr(uwtrack_cli, old)
        assert found is getattr(uwtrack_cli, new)


def test_an_old_table_is_read(tmp_path, uwtrack):
    path = tmp_path / "old.h5"
    table = synthetic(Transients, 2)
    write_product(path, [table])
    with h5py.File(path, "r+") as file:
        (own,) = (g for g in file.values() if "transients" in g)
        own.move("transients", "rises")
        own["rises"].attrs["container"] = np.bytes_("rises")
    with path.open("r+b") as file:
        append_checksum(file)
    with read_product(path) as product:
        assert product.read(Transients).equals(table)
    shown = json.loads(uwtrack("show", path, "rises", "--format", "json").stdout)
    assert (shown["table"], shown["container"]) == ("transients", "transients")
    assert shown["rise"] == shown["transient"]
    assert uwtrack("show", path, "rises", "--axis", "rise").exit_code == 0


def test_old_words_of_the_command_line_say_what_they_are_now(uwtrack):
    for words, new in (
        (("ladder", "--help"), "multi-resolution"),
        (("export", "none.h5", "--to", "csv", "--container", "lines"), "--table"),
        (("pdaf", "none.h5", "--targets", "told"), "given"),
        (("pdaf", "none.h5", "--targets=told"), "--targets=given"),
    ):
        done = uwtrack(*words)
        assert f"is now called {new}; the old name goes in 0.4" in done.stderr
    assert "none.h5" in done.stderr
    assert "no option" not in done.stderr


def test_json_has_old_keys_beside_the_new_ones_and_its_schema_says_so():
    row = {"alternative_motion_model": {"motion_model": "joined", "probability": 0.1},
           "reasons": {"motion_model": "no lines"}}  # fmt: skip
    both = renamed.with_old_keys(row)
    assert both["rival"] == {"reading": "joined", "weight": 0.1}
    assert set(both["reasons"]) == {"motion_model", "reading"}
    known = json_schema("encounters")["items"]
    assert known["properties"]["rival"]["properties"].keys() == {"reading", "weight"}
    assert known["properties"]["reading"]["deprecated"]
    assert "reading" not in known["required"]
