"""A recipe is a graph: its steps join, nothing runs in vain, branches do not mix."""

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.arrays.test_array_chain import scene
from tests.draws.brief_passages import car_by_auto
from tests.draws.comb_sounds import comb_sound
from tests.support import recording_of, white_noise
from uwtrack_cli.data.base import Container
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels, Spectrogram
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.hdf5.product import (
    HistoryStep,
    ProductWriter,
    read_product,
    source_of,
    verify_product,
)
from uwtrack_cli.files.tables.sensors import find_sensor
from uwtrack_cli.flow.batch import Job, run_job
from uwtrack_cli.flow.catalogue import STAGES
from uwtrack_cli.flow.engine import Engine, MemorySink, run_recipe
from uwtrack_cli.flow.products import run_into_product
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.rerun_sources import SourceFinder, _navigation_of, read_tables
from uwtrack_cli.flow.shipped_recipes import load_recipe, shipped_recipes
from uwtrack_cli.flow.stage import plain
from uwtrack_cli.simulate.recordings import simulate_recordings

RECIPES_0_1 = Path(__file__).parent / "recipes-0.1.0"
"""Recipes as 0.1.0 shipped them."""

RATE_HZ = 2000.0

TWO_BRANCHES = """
[spectrogram]
band_hz = [10.0, 900.0]

[fine]
stage = "spectrogram"
window_s = 0.25

[peaks]
input = "spectrogram"

[track]
output = true

[fine-peaks]
stage = "peaks"
input = "fine"

[fine-track]
stage = "track"
input = "fine-peaks"
output = true
"""

TWO_RUNGS = TWO_BRANCHES + '[cpa]\ninput = "track"\n'


def tones(seconds: float = 60.0, seed: int = 3) -> np.ndarray:
    time = np.arange(round(RATE_HZ * seconds)) / RATE_HZ
    sound = white_noise(time.size, seed, density=1e-3, rate_hz=RATE_HZ)
    for frequency in (200.0, 333.0, 512.5):
        sound += 0.5 * np.sin(2 * np.pi * (frequency * time + 0.005 * time**2))
    return sound


def results(recipe: Recipe, recording, made=()) -> dict[str, Container]:
    """Every kept result of a recipe by the name of its step, unless it is made."""
    graph = recipe.graph()
    made = (made or run_recipe(recording, recipe))[2:]
    names = [step.name for step in graph.steps() if step.name in graph.outputs]
    return dict(zip(names, made, strict=True))


def up_to(recipe: Recipe, last: set[str]) -> Recipe:
    """A recipe without the steps that the last ones do not need."""
    nodes = {node.step.name: node for node in recipe.graph().nodes}
    needed: set[str] = set()
    asked = list(last)
    while asked:
        name = asked.pop()
        if name not in needed:
            needed.add(name)
            asked += sum(dict(nodes[name].sources).values(), ())
    steps = [
        replace(step, is_output=step.is_output or step.name in last)
        for step in recipe.steps
        if step.name in needed
    ]
    return replace(recipe, steps=tuple(steps))


def test_the_nearest_earlier_step_that_fits_is_read():
    graph = load_recipe("vessel").graph()
    read = {node.step.name: dict(node.sources) for node in graph.nodes}
    assert read["peaks"] == {"spectrogram": ("spectrogram",)}
    assert read["track"] == {"blocks": ("peaks",)}
    assert read["cpa"] == {"lines": ("track",), "levels": ("levels",)}
    assert read["locate"] == {"encounters": ("cpa",)}


def two_vessels():
    """Sound of a towed array that hears a vessel of lines and one without."""
    noise = {"band_hz": [40.0, 240.0], "source_level_db": 155.0}
    lined = scene(duration_s=130.0)
    other = scene(duration_s=130.0, place=(900.0, -600.0), broadband=noise)
    return replace(lined, vessels=(*lined.vessels, *other.vessels))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
@pytest.mark.parametrize("name", shipped_recipes())
def test_every_step_of_a_shipped_recipe_changes_the_result(short_pass, samples, name):
    recipe = load_recipe(name)
    graph = recipe.graph()
    own = samples / f"{name}.wav"  # of the recipes for arrays
    sound = own if own.exists() else short_pass
    sensor = find_sensor(sound)
    recording = open_recording(sound, sensor=sensor, start_s=45.0, stop_s=58.0)
    made = ()
    if name == "auto":  # what passes within a second
        recording, made = car_by_auto()
    elif name == "towed-array":  # a vessel of lines, and one without
        (recording,) = simulate_recordings(two_vessels())
    whole = results(recipe, recording, made)
    # auto has the steps of vessel, which are tried there, and its own
    known = load_recipe("vessel").steps if name == "auto" else ()
    # a car has no comb: `test_combs_of_auto_are_heard_in_presence` tries them
    known += tuple(step for step in recipe.steps if step.stage.name == "combs")
    for gone in (step for step in recipe.steps if step not in known):
        readers = {
            node.step.name
            for node in graph.nodes
            if any(gone.name in steps for steps in dict(node.sources).values())
        }
        left = replace(recipe, steps=tuple(s for s in recipe.steps if s != gone))
        try:
            left.checked()
        except OptionError:
            continue  # another step has no input then, or works in vain
        assert readers or gone.name in graph.outputs
        kept = readers & set(whole)  # a table that is made again is not
        made = results(up_to(left, kept), recording) if kept else {}
        changed = [r for r in kept if not made[r].equals(whole[r])]
        assert changed or not readers, gone.name


@pytest.mark.parametrize("gone", ["long-combs", "slow-combs"])
def test_combs_of_auto_are_heard_in_presence(gone):
    """A machine and a slow shaft of which no line is heard alone."""
    spacing_hz = {"long-combs": 8.3, "slow-combs": 0.9}[gone]
    teeth = np.arange(2, 14) if gone == "long-combs" else np.arange(8, 30)
    recording = comb_sound(spacing_hz * teeth, level_db=-5.0, seconds=200.0, seed=5)
    recipe = load_recipe("auto")
    steps = {step.name: step for step in recipe.steps}
    resolution = {"long-combs": "long-spectrogram", "slow-combs": "slow-spectrogram"}[gone]
    own = [steps[resolution], steps[gone]]
    read = replace(steps["presence"], inputs=(gone,))
    found = results(replace(recipe, steps=(*own, read)), recording)["presence"]
    vessel = found.kind == "vessel"
    assert np.abs(found.spacing_hz[vessel] / spacing_hz - 1.0).max() < 2e-3


def test_what_is_written_is_read_whatever_is_nearer():
    recipe = Recipe.from_toml("two", TWO_RUNGS)
    graph = recipe.graph()
    read = {node.step.name: dict(node.sources) for node in graph.nodes}
    assert read["track"] == {"blocks": ("peaks",)}
    assert read["fine-track"] == {"blocks": ("fine-peaks",)}
    assert read["cpa"] == {"lines": ("track",)}
    assert graph.outputs == {"track", "fine-track", "cpa"}


def test_steps_may_be_written_in_any_order_when_they_name_their_inputs():
    text = "[peaks]\ninput = 'spectrogram'\noutput = true\n[spectrogram]\n"
    names = [s.name for s in Recipe.from_toml("odd", text).graph().steps()]
    assert names == ["spectrogram", "peaks"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[peaks]\n", ("no step that reads the recording", "[spectrogram]")),
        ("", ("no step that reads the recording", "none")),
        ("[spectrogram]\n[track]\n", ("[track]", "families or peaks", "[peaks]")),
        (
            "[spectrogram]\n[classify]\n[peaks]\n[track]\n",
            ("[classify]", "reads peaks", "[peaks] makes it: move it before"),
        ),
        ("[spectrogram]\n[levels]\n[peaks]\n", ("[peaks]", "no step reads", "output")),
        (
            "[spectrogram]\n[peaks]\n[track]\n[trace]\n[cpa]\n",
            ("[track]", "no step reads", "input of [cpa]"),
        ),
        (
            "[spectrogram]\n[peaks]\ninput = 'track'\n[track]\ninput = 'peaks'\n",
            ("[peaks]", "reads spectrogram", "[track] makes lines"),
        ),
        ("[spectrogram]\n[peaks]\ninput = 'spektrogram'\n", ("Did you mean",)),
        (
            "[spectrogram]\n[fine]\nstage='spectrogram'\n[peaks]\ninput=['spectrogram', 'fine']\n",
            ("[peaks]", "takes one spectrogram", "'fine' is one more"),
        ),
        ("[spectrogram]\n[odd]\n", ("no stage 'odd'", "spectrogram, ")),
        ("[spectrogram]\nstage = 3\n", ("spectrogram.stage must be a text",)),
        ("[spectrogram]\ninput = 3\n", ("spectrogram.input must be a list",)),
        ("[spectrogram]\noutput = 1\n", ("spectrogram.output must be true or false",)),
        ("['a b']\nstage = 'spectrogram'\n", ("'a b' is no name of a step",)),
        ("[cpa]\n[spectrogram]\n", ("[cpa]", "reads lines")),
    ],
)
def test_a_recipe_that_does_not_join_is_refused_with_a_remedy(text, words):
    with pytest.raises(OptionError) as caught:
        Recipe.from_toml("odd", text)
    for word in words:
        assert word in str(caught.value)


def smooth_peaks(peaks: Peaks) -> Peaks:
    """Return peaks as they are: a stage that reads what it makes."""
    return peaks


def test_a_circle_is_named(monkeypatch):
    monkeypatch.setitem(STAGES, "smooth", f"{__name__}:smooth_peaks")
    Recipe.from_toml("ok", "[spectrogram]\n[peaks]\n[smooth]\n[track]\n")
    with pytest.raises(OptionError, match=r"wait for each other: .*one.*two"):
        Recipe.from_toml(
            "circle",
            "[spectrogram]\noutput = true\n"
            "[one]\nstage = 'smooth'\ninput = 'two'\n"
            "[two]\nstage = 'smooth'\ninput = 'one'\n"
            "[track]\n",
        )


@pytest.mark.parametrize("name", ["vessel", "two"])
def test_a_recipe_with_its_wiring_reads_back(name):
    recipe = Recipe.from_toml("two", TWO_RUNGS) if name == "two" else load_recipe(name)
    again = Recipe.from_toml(name, recipe.to_toml())
    assert [(s.name, s.stage_name, s.inputs, s.is_output) for s in again.steps] == [
        (s.name, s.stage_name, s.inputs, s.is_output) for s in recipe.steps
    ]
    changed = recipe.with_settings(["peaks.false_alarm_probability=1e-5"])
    (peaks,) = [s for s in changed.steps if s.name == "peaks"]
    assert peaks.options["false_alarm_probability"] == 1e-5


def test_each_branch_is_what_it_is_alone():
    recording = recording_of(tones(), RATE_HZ)
    both = results(Recipe.from_toml("two", TWO_RUNGS), recording)
    coarse = "[spectrogram]\nband_hz = [10.0, 900.0]\n[peaks]\n[track]\n[cpa]\n"
    fine = "[spectrogram]\nwindow_s = 0.25\n[peaks]\n[track]\n"
    alone = results(Recipe.from_toml("coarse", coarse), recording)
    assert both["track"].equals(alone["track"])
    assert both["cpa"].equals(alone["cpa"])
    finer = results(Recipe.from_toml("fine", fine), recording)["track"]
    assert both["fine-track"].equals(finer)
    assert isinstance(finer, Lines)
    assert finer.line_id.size >= 3


def test_the_first_source_begins_whatever_ends_earlier():
    """A product's time base is that of the first source."""
    text = (
        "[spectrogram]\nwindow_s = 2.0\noutput = true\n"
        "[short]\nstage = 'spectrogram'\nwindow_s = 0.05\noutput = true\n"
    )
    recipe = Recipe.from_toml("long and short", text)
    made: list[str] = []
    watch = Mock(made=lambda step, _: made.append(step.name))
    engine = Engine(recipe.graph(), [], MemorySink(), watch)
    engine.run_recording(recording_of(tones(30.0), RATE_HZ))
    assert made[0] == "spectrogram"
    # then the one whose next block ends first
    assert made[1:4] == ["short"] * 3


@pytest.mark.slow
def test_results_of_a_step_keep_its_name_in_the_product(tmp_path):
    recipe = Recipe.from_toml("two", TWO_RUNGS)
    recording = recording_of(tones(), RATE_HZ)
    expected = results(recipe, recording)
    with ProductWriter(tmp_path / "p.h5") as writer:
        run_into_product(recording, recipe, writer)
    with read_product(tmp_path / "p.h5") as product:
        usual = product.read(Lines, step="")
        fine = product.read(Lines, step="fine-track")
        assert usual.frequency_hz.tobytes() == expected["track"].frequency_hz.tobytes()
        assert fine.frequency_hz.tobytes() == expected["fine-track"].frequency_hz.tobytes()
        steps = {s.step_name: s for s in product.history}
    assert steps["fine-track"].stage == "track"
    assert steps["fine-track"].inputs == ("fine-peaks",)
    assert steps["cpa"].inputs == ("track",)


@pytest.mark.slow
def test_a_product_of_branches_is_made_again_from_its_history(uwtrack, short_pass):
    Path("two.toml").write_text(TWO_BRANCHES, encoding="utf-8")
    words = ["--recipe", "two.toml", "--stop-s", 40, "-o", "p.run.h5"]
    done = uwtrack("run", short_pass, *words)
    assert done.exit_code == 0, done.output
    again = uwtrack("rerun", "p.run.h5", "--source", short_pass, "-o", "again.run.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", "p.run.h5", "again.run.h5").exit_code == 0
    shown = uwtrack("show", "p.run.h5", "lines", "--step", "fine-track", "--format", "csv")
    assert shown.exit_code == 0, shown.output
    unclear = uwtrack("show", "p.run.h5", "lines")
    assert unclear.exit_code == 1
    said = " ".join(unclear.stderr.split())
    assert "of several steps: track, fine-track; name one of them with --step" in said
    usual = uwtrack("show", "p.run.h5", "lines", "--step", "track", "--format", "csv")
    assert usual.exit_code == 0, usual.output
    assert usual.stdout != shown.stdout


TWO_PASSAGES = """
[spectrogram]
band_hz = [10.0, 900.0]
[levels]
[peaks]
[track]
[trace]
[fine]
stage = "spectrogram"
window_s = 0.5
[fine-peaks]
stage = "peaks"
[fine-track]
stage = "track"
[cpa]
input = ["track", "levels"]
[lines]
stage = "cpa"
input = "trace"
[h1]
stage = "cpa"
input = ["fine-track", "levels"]
[locate]
input = ["cpa", "lines", "h1"]
"""


@pytest.fixture(scope="session")
def branched(short_pass, tmp_path_factory) -> Path:
    """A product with three steps that make lines, and three that make encounters."""
    path = tmp_path_factory.mktemp("branched") / "p.run.h5"
    recipe = Recipe.from_toml("three", TWO_PASSAGES)
    outcome = run_job(Job((short_pass,), path, recipe))
    assert outcome.status == "done", outcome.message
    return path


def test_results_of_any_step_have_a_place_of_their_own(branched):
    assert verify_product(branched) == []
    with read_product(branched) as product:
        steps = {(key.name, key.step) for key in product.paths}
    assert {("lines", "track"), ("lines", "trace"), ("lines", "fine-track")} <= steps
    assert {("encounters", ""), ("encounters", "lines"), ("encounters", "h1")} <= steps


COMMANDS_OF_ONE_RESULT = (
    "show {} lines", "plot {} -o p.png", "report {} -o p.html", "cpa {} -o c.h5",
    "locate {} -o f.h5", "export {} --to geojson -o p.geojson",
    "export {} --to raven -o p.txt", "export {} --to csv --table lines -o p.csv",
    "score {} --truth pass.truth.json",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS_OF_ONE_RESULT)
def test_a_command_asks_for_the_branch_and_takes_it(words, uwtrack, branched, samples):
    shutil.copy(samples / "pass.truth.json", ".")
    plain = uwtrack(*words.format(branched).split())
    assert plain.exit_code == 1, plain.output
    assert "name one of them with --step" in " ".join(plain.stderr.split())
    unknown = uwtrack(*words.format(branched).split(), "--step", "nobody")
    assert unknown.exit_code == 1
    assert "without a step 'nobody'; its steps: spectrogram," in " ".join(unknown.stderr.split())
    chosen = uwtrack(*words.format(branched).split(), "--step", "fine-track")
    assert chosen.exit_code == 0, chosen.output


def test_a_branch_is_carried_on(uwtrack, branched):
    done = uwtrack("locate", branched, "--step", "fine-track", "-o", "f.fixes.h5")
    assert done.exit_code == 0, done.output
    with read_product(branched) as product, read_product("f.fixes.h5") as located:
        assert located.read(Lines).equals(product.read(Lines, step="fine-track"))
        assert located.read(Encounters).equals(product.read(Encounters, step="h1"))
        assert located.history[-1].inputs == ("h1",)


@pytest.mark.slow
def test_a_command_on_a_run_is_made_again_with_its_own_options(uwtrack, short_pass):
    Path("one.toml").write_text("[spectrogram]\n[peaks]\n[track]\n[cpa]\n")
    uwtrack("run", short_pass, "--recipe", "one.toml", "-o", "p.run.h5")
    done = uwtrack("cpa", "p.run.h5", "--source-depth-m", 15, "-o", "c.h5")
    assert done.exit_code == 0, done.output
    again = uwtrack("rerun", "c.h5", "--source", short_pass, "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", "c.h5", "again.h5").exit_code == 0
    assert uwtrack("diff", "c.h5", "p.run.h5").exit_code == 4


def test_the_navigation_that_a_sensor_file_names_is_no_table_of_its_own(tmp_path):
    sensor, nav = tmp_path / "a.sensor.toml", tmp_path / "nav.csv"
    sensor.write_text('id = "a"\nkind = "array"\nnavigation = "nav.csv"\n')
    nav.write_text("time_s,east_m,north_m\n0,0,0\n")
    assert _navigation_of(sensor) == [nav]
    assert _navigation_of(nav) == []


def test_a_table_of_delays_is_read_again_with_its_sensor(tmp_path):
    table, sensor = tmp_path / "d.csv", tmp_path / "a.sensor.toml"
    table.write_text("time_s,channel_a,channel_b,delay_s,delay_std_s\n0,a,b,0.001,1e-5\n")
    sensor.write_text('id = "tripod"\n')
    sources = tuple(map(source_of, (sensor, table)))
    past = HistoryStep(stage="directions", sources=sources)
    finder = SourceFinder(tmp_path / "x.directions.h5", ())
    made = {type(one): one for one in read_tables([past], finder)}
    assert made[Delays].delay_s.tolist() == [0.001]
    assert made[Sensor].id == "tripod"


@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_a_batch_resumes_a_recipe_with_branches(noise_wav, tmp_path):
    recipe = Recipe.from_toml("two", TWO_BRANCHES)
    job = Job((noise_wav,), tmp_path / "p.run.h5", recipe)
    assert run_job(job).status == "done"
    assert run_job(replace(job, resume=True)).status == "resumed"
    other = recipe.with_settings(["fine.window_s=0.2"])
    refused = run_job(replace(job, resume=True, recipe=other))
    assert refused.status == "failed"
    assert "another recipe" in refused.message
    job = replace(job, resume=True, recipe=other, overwrite=True)
    assert run_job(job).status == "done"


def test_a_marked_output_is_kept_though_it_only_passes_by():
    text = "[spectrogram]\noutput = true\n[peaks]\noutput = true\n[levels]\n"
    made = results(Recipe.from_toml("kept", text), recording_of(tones(10.0), RATE_HZ))
    assert isinstance(made["spectrogram"], Spectrogram)
    assert isinstance(made["peaks"], Peaks)
    assert isinstance(made["levels"], Levels)


def test_a_graph_without_steps_lacks_what_they_alone_feed():
    graph = load_recipe("auto").graph()
    names = [
        step.name for step in graph.without(["long-lines", "long-levels", "transients"]).steps()
    ]
    assert "long-cpa" not in names  # closest approaches of nothing
    left = {node.step.name: node for node in graph.without(["long-lines"]).nodes}
    (read,) = {n for n in left["presence"].sources.values() if "track" in n}
    assert read == ("track", "slow-lines", "long-combs", "slow-combs")
    assert "cpa" in names
    names = [step.name for step in graph.without(["spectrogram"]).steps()]
    assert not {"peaks", "track", "levels"} & set(names)
    assert {"cpa", "long-cpa", "presence"} <= set(names)  # by fringes alone


@pytest.mark.parametrize("name", shipped_recipes())
def test_the_graph_of_a_recipe_is_drawn(uwtrack, name):
    done = uwtrack("recipes", "--graph", name)
    assert done.exit_code == 0, done.output
    assert load_recipe(name).steps[0].name in done.stdout
    drawn = uwtrack("recipes", "--graph", name, "-o", f"{name}.svg")
    assert drawn.exit_code == 0, drawn.output
    assert "<svg" in Path(f"{name}.svg").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_product_of_single_commands_is_made_again(uwtrack, short_pass):
    for words in (
        ("spectrogram", short_pass, "--stop-s", 40, "-o", "p.spectrogram.h5"),
        ("peaks", "p.spectrogram.h5"),
        ("classify", "p.peaks.h5"),
        ("track", "p.families.h5"),
        ("levels", "p.spectrogram.h5"),
        ("cpa", "p.lines.h5", "p.levels.h5"),
    ):
        assert uwtrack(*words).exit_code == 0
    for name in ("p.lines.h5", "p.encounters.h5"):
        again = uwtrack("rerun", name, "--source", short_pass, "-o", f"again.{name}")
        assert again.exit_code == 0, again.output
        assert uwtrack("diff", name, f"again.{name}").exit_code == 0
    with read_product("p.encounters.h5") as product:
        inputs = {s.step_name: s.inputs for s in product.history}
    assert inputs["track"] == ("classify",)
    assert set(inputs["cpa"]) == {"track", "levels"}


@pytest.mark.parametrize("path", sorted(RECIPES_0_1.glob("*.toml")), ids=lambda p: p.stem)
def test_a_recipe_that_came_with_0_1_0_still_joins(path):
    steps = load_recipe(path).steps
    written = tomllib.loads(path.read_text(encoding="utf-8"))
    assert [step.name for step in steps] == list(written)[1:]
    for step in steps:
        for option, value in written[step.name].items():
            now = plain(step.options[option])
            nested = isinstance(value, dict)
            assert ({key: now[key] for key in value} if nested else now) == value


def test_lines_for_presence_alone_do_not_say_how_a_recipe_is_slowed_down():
    graph = load_recipe("auto").graph()
    bands = {s.name: s.options.get("band_hz") for s in graph.steps()}
    assert bands["slow-spectrogram"][1] < bands["long-spectrogram"][1] == 800.0
    with pytest.warns(UwtrackWarning, match=r"16 times as long"):
        graph.resolved(recording_of(np.zeros((10, 1)), 100.0))


def test_a_recipe_is_slowed_down_for_a_recorder_of_low_frequencies():
    """Infrasound at 100 Hz: levels of 100 to 1500 Hz are those of 3.3 to 50 Hz."""
    graph = load_recipe("vessel").graph()
    with pytest.warns(UwtrackWarning, match="30 times as long"):
        slow = graph.resolved(recording_of(np.zeros((10, 1)), 100.0))
    options = {step.name: step.options for step in slow.steps()}
    assert options["levels"]["band_hz"] == pytest.approx((100 / 30, 50.0))
    assert options["spectrogram"]["band_hz"] == pytest.approx((1 / 3, 200 / 3))
    assert options["spectrogram"]["window_s"] == pytest.approx(30.0)
    for rate_hz, decimation in ((1000.0, 1), (96_000.0, 8)):
        same = graph.resolved(recording_of(np.zeros((10, 1)), rate_hz))
        for own, before in zip(same.steps(), graph.steps(), strict=True):
            given = dict(before.options)
            if own.name == "spectrogram":  # no step reads more than its band
                given["decimation"] = decimation
            assert own.options == given


def test_a_recorder_too_slow_for_any_recipe_is_told_so_and_not_of_a_window():
    recording = recording_of(np.zeros((4000, 1)), 1.0)
    with (
        pytest.warns(UwtrackWarning, match="1600 times as long"),
        pytest.raises(DataError, match="sample rate of 1 Hz") as refused,
    ):
        load_recipe("auto").graph().resolved(recording)
    assert "window_s" not in str(refused.value)


def test_a_band_that_a_person_sets_is_not_lowered():
    """Lowered, it would be of other sound than what was asked for."""
    asked = load_recipe("presence").with_settings(["demon.band_hz=[3000, 5000]"])
    same = asked.graph().resolved(recording_of(np.zeros((10, 1)), 4000.0))
    options = {step.name: step.options for step in same.steps()}
    assert options["demon"]["band_hz"] == (3000.0, 5000.0)
    assert options["spectrogram"]["window_s"] == 1.0
