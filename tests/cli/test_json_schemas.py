"""Every JSON output has a schema; the samples satisfy it; its keys do not change."""

import json
from pathlib import Path

import jsonschema
import pytest

from uwtrack_cli.cli.json_schemas import VERSION, json_schema, schema_names
from uwtrack_cli.errors import OptionError

KNOWN = Path(__file__).parents[1] / "baselines" / "json_schemas.json"
CHECK = jsonschema.Draft202012Validator


@pytest.mark.parametrize("name", schema_names())
def test_a_schema_is_valid_and_says_what_every_key_is(name):
    schema = json_schema(name)
    CHECK.check_schema(schema)
    assert schema["$id"].endswith(f":{name}:{VERSION}")
    assert schema["title"]


def test_keys_and_types_of_a_version_do_not_change():
    """Add new keys with `python -m tests.cli.test_json_schemas`; others need a version."""
    before = json.loads(KNOWN.read_text())
    assert before["version"] == VERSION
    for name, keys in before["outputs"].items():
        now = types_by_key(json_schema(name))
        assert {k: now.get(k) for k in keys} == keys, name


def types_by_key(schema, place=""):
    """The type of every key of a schema, by its place."""
    found = {place: json.dumps(schema.get("type"), sort_keys=True)}
    for key, inner in schema.get("properties", {}).items():
        found |= types_by_key(inner, f"{place}.{key}")
    if isinstance(schema.get("items"), dict):
        found |= types_by_key(schema["items"], f"{place}[]")
    return found


@pytest.fixture(scope="session")
def products(tmp_path_factory, samples, short_pass):
    """Products of the samples with every container that a recording and tables give."""
    from typer.testing import CliRunner

    from uwtrack_cli.cli.app import app

    folder = tmp_path_factory.mktemp("products")

    def run(*words):
        done = CliRunner().invoke(app, [str(w) for w in words])
        assert done.exit_code == 0, done.output

    run("run", short_pass, "-o", folder / "pass.run.h5", "--keep-peaks",
        "--start-utc", "2024-05-01T12:00:00Z")  # fmt: skip
    run("tma", samples / "bearings.csv", "--own-ship", samples / "own-ship.csv",
        "--sound-speed-mps", 1480, "-o", folder / "b.motions.h5")  # fmt: skip
    run("pdaf", samples / "scans.csv", "--detector-cell-volume", 900,
        "--detector-snr-db", 15, "--motion-acceleration-std", 3.16,
        "--start-velocity-std", 100, "-o", folder / "s.target.h5")  # fmt: skip
    run("discriminate", samples / "contacts.csv", "--own-ship", samples / "observer.csv",
        "-o", folder / "c.decision.h5")  # fmt: skip
    return folder


SHOWN = {
    "pass.run.h5": ("recording", "sensor", "frames", "overview", "levels", "families",
                    "lines", "encounters", "fixes"),
    "b.motions.h5": ("motions", "series", "navigation"),
    "s.target.h5": ("target", "scans"),
    "c.decision.h5": ("decision", "contacts"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("file", "name"), [(f, n) for f, names in SHOWN.items() for n in names])
def test_what_show_prints_of_the_samples_satisfies_its_schema(uwtrack, products, file, name):
    done = uwtrack("show", products / file, name, "--format", "json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    CHECK(json_schema(name)).validate(printed)
    if name == "encounters":  # the check can fail
        printed[0]["speed_mps"] = "fast"
        assert not CHECK(json_schema(name)).is_valid(printed)


@pytest.mark.slow
def test_reports_satisfy_their_schemas(uwtrack, products, samples, tmp_path):
    run = products / "pass.run.h5"
    for words, name in (
        (("info", run, "--json"), "info"),
        (("score", run, "--truth", samples / "pass.truth.json", "--json"), "score"),
        (("diff", run, products / "b.motions.h5", "--json"), "diff"),
        (("batch", samples / "noise.wav", "-o", tmp_path / "out", "--json"), "batch"),
        (("study", "proximity", "--runs", 1, "--json"), "study"),
    ):
        done = uwtrack(*words)
        assert done.exit_code in {0, 4}, done.output
        CHECK(json_schema(name)).validate(json.loads(done.stdout))


def test_the_command_prints_a_schema(uwtrack):
    done = uwtrack("show", "--schema", "encounters")
    assert json.loads(done.stdout) == json_schema("encounters")
    done = uwtrack("show", "--schema", "encounter")
    assert done.exit_code == 2
    assert "Did you mean 'encounters'" in " ".join(done.stderr.split())
    with pytest.raises(OptionError, match="has no output"):
        json_schema("nothing")


if __name__ == "__main__":
    outputs = {name: types_by_key(json_schema(name)) for name in schema_names()}
    text = json.dumps({"version": VERSION, "outputs": outputs}, indent=1)
    KNOWN.write_text(text + "\n")
