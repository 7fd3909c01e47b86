"""No output ever replaces a file that its command reads, whatever the name."""

import ast
import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import soundfile
from typer.testing import CliRunner

from tests.support import package_modules
from uwtrack_cli.cli.app import COMMANDS, app, load_command
from uwtrack_cli.files.atomic import atomic_target
from uwtrack_cli.files.input_ledger import as_input, input_ledger, not_an_input
from uwtrack_cli.flow.shipped_recipes import load_recipe

RATE = 1000
SENSOR = 'id = "h1"\ndepth_m = 20.0\nnavigation = "{}"\n'
TRACK = "time_s,east_m,north_m,heading_deg\n0,0,0,90\n60,30,0,90\n"
AIS = """\
mmsi,time_utc,latitude,longitude,speed_kn,course_deg
1,2024-05-01T12:00:00Z,50.0,-4.0,5,270
1,2024-05-01T12:01:00Z,50.0,-4.001,5,270
"""
SCENE = """\
seed = 1
duration_s = 4.0
sample_rate_hz = 500.0
sensor = [{id = "h1", depth_m = 20.0, full_scale_db = 140.0}]
noise = {density_db = 70.0}
"""


@pytest.fixture(scope="session")
def made(tmp_path_factory, samples):
    """A folder with everything that a command can read."""
    folder = tmp_path_factory.mktemp("inputs")
    sound = 0.1 * np.random.default_rng(1).standard_normal(12 * RATE)
    sound += 0.1 * np.sin(2 * np.pi * 200.0 * np.arange(sound.size) / RATE)
    soundfile.write(folder / "pass.wav", sound, RATE)
    for stem, track in (("pass.sensor", "found.csv"), ("named", "named.csv")):
        (folder / f"{stem}.toml").write_text(SENSOR.format(track))
        (folder / track).write_text(TRACK)
    (folder / "mine.toml").write_text(load_recipe("vessel").to_toml())
    (folder / "scene.toml").write_text(SCENE)
    array, rate = soundfile.read(samples / "towed-array.wav", frames=8_000)
    soundfile.write(folder / "array.wav", array, rate)
    shutil.copy(samples / "towed-array.sensor.toml", folder / "array.sensor.toml")
    array, rate = soundfile.read(samples / "small-array.wav", frames=8_000)
    soundfile.write(folder / "small.wav", array, rate)
    shutil.copy(samples / "small-array.sensor.toml", folder / "small.sensor.toml")
    for name in ("towed-array.nav.csv", "way.csv"):
        shutil.copy(samples / "towed-array.nav.csv", folder / name)
    (folder / "ais.csv").write_text(AIS)
    for name in ("bearings", "own-ship", "scans", "contacts", "observer"):
        shutil.copy(samples / f"{name}.csv", folder)
    phase = 2.0 * np.pi * 7500.0 / 48_000 * np.arange(48_000)
    soundfile.write(folder / "buoy.wav", 0.1 * (np.sin(phase) - np.sin(2 * phase)), 48_000)
    (folder / "buoy.sensor.toml").write_text('id = "b1"\nkind = "difar-multiplexed"\n')
    (folder / "roc.csv").write_text(
        "false_alarm_probability,detection_probability\n1e-4,0.5\n1e-3,0.7\n1e-2,0.9\n"
    )
    for words in (
        ["run", "pass.wav", "--keep-peaks", "-o", "pass.run.h5"],
        ["spectrogram", "pass.wav", "-o", "pass.spectrogram.h5"],
        ["delays", "small.wav", "-o", "small.delays.h5"],
        ["beamform", "array.wav", "--own-ship", "way.csv", "-o", "array.beams.h5"],
    ):
        before = Path.cwd()
        os.chdir(folder)
        try:
            done = CliRunner().invoke(app, words)
        finally:
            os.chdir(before)
        assert done.exit_code == 0, done.output
    return folder


SOUND = "pass.wav --sensor named.toml"
SOUND_FILES = "pass.wav named.toml named.csv"
FOUND_FILES = "pass.wav pass.sensor.toml found.csv"
SPECTRA, PEAKS = "pass.spectrogram.h5", "pass.run.h5"
CASES: dict[str, list[tuple[str, str, str]]] = {
    "run": [
        (f"{SOUND} --recipe mine.toml -o aim.h5", "aim.h5", SOUND_FILES + " mine.toml"),
        ("pass.wav -o aim.h5", "aim.h5", FOUND_FILES),
        (f"{SOUND}", "pass.run.h5", "named.toml named.csv"),
    ],
    "batch": [
        (f"{SOUND} --recipe mine.toml -o out --jobs 1", f"out/{name}", files)
        for name in ("pass.run.h5", "batch.csv", "batch.jsonl")
        for files in (SOUND_FILES + " mine.toml",)
    ]
    + [("pass.wav -o out --jobs 1", "out/pass.run.h5", FOUND_FILES)],
    "recipes": [("--graph mine.toml -o aim.svg", "aim.svg", "mine.toml")],
    "rerun": [("pass.run.h5 -o aim.h5", "aim.h5", "pass.run.h5 pass.wav")],
    "difar": [("buoy.wav -o aim.wav", "aim.wav", "buoy.wav buoy.sensor.toml")],
    "spectrogram": [
        (f"{SOUND} -o aim.h5", "aim.h5", SOUND_FILES),
        ("pass.wav -o aim.h5", "aim.h5", FOUND_FILES),
    ],
    "demon": [
        (f"{SOUND} -o aim.h5", "aim.h5", SOUND_FILES),
        ("pass.wav -o aim.h5", "aim.h5", FOUND_FILES),
    ],
    "beamform": [
        ("array.wav --own-ship way.csv -o aim.h5", "aim.h5", "array.wav array.sensor.toml way.csv")
    ],
    "track-bearings": [("array.beams.h5 -o aim.h5", "aim.h5", "array.beams.h5")],
    "delays": [("small.wav -o aim.h5", "aim.h5", "small.wav small.sensor.toml")],
    "directions": [("small.delays.h5 -o aim.h5", "aim.h5", "small.delays.h5")],
    "overview": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "levels": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "decidecades": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "fringes": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "peaks": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "transients": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "classify": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "track": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "track-pda": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "multi-resolution": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "combs": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "trace": [(f"{SPECTRA} -o aim.h5", "aim.h5", SPECTRA)],
    "presence": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "radiated": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "zoom": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "cpa": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "locate": [(f"{PEAKS} -o aim.h5", "aim.h5", PEAKS)],
    "tma": [
        ("bearings.csv --own-ship own-ship.csv -o aim.h5", "aim.h5", "bearings.csv own-ship.csv")
    ],
    "forecast": [("own-ship.csv way.csv -o aim.csv", "aim.csv", "own-ship.csv way.csv")],
    "pdaf": [("scans.csv --roc roc.csv -o aim.h5", "aim.h5", "scans.csv roc.csv")],
    "discriminate": [
        ("contacts.csv --own-ship observer.csv -o aim.h5", "aim.h5", "contacts.csv observer.csv")
    ],
    "plot": [
        (f"{PEAKS} -o aim.png", "aim.png", PEAKS),
        (f"{SOUND} -o aim.png", "aim.png", SOUND_FILES),
    ],
    "passages": [
        ("pass.run.h5 --to csv -o aim.csv --fresh", "aim.csv", "pass.run.h5"),
        ("pass.run.h5 --ais ais.csv --to csv -o aim.csv --fresh", "aim.csv", "ais.csv"),
        (". --to jsonl -o aim.csv --fresh", "aim.csv", "pass.run.h5"),
    ],
    "report": [(f"{PEAKS} -o aim.html", "aim.html", PEAKS)],
    "export": [
        (f"{PEAKS} --to {form} -o aim.x", "aim.x", PEAKS) for form in ("csv", "raven", "netcdf")
    ],
    "simulate": [
        ("scene.toml -o out/scene.wav", f"out/scene.{ending}", "scene.toml")
        for ending in ("wav", "sensor.toml", "truth.json")
    ],
    "sample": [("mono -o out", "out/mono.{}", "")],
}
"""Arguments of each command, the name of its output, and the files that it reads."""


def digests(folder):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def aim(output, source, way):
    """Let the name of an output be another name of an input."""
    output.parent.mkdir(exist_ok=True)
    if way == "itself":
        return
    output.unlink(missing_ok=True)
    if way == "symbolic":
        output.symlink_to(source)
    else:
        output.hardlink_to(source)


@pytest.mark.parametrize("name", [n for n in CASES if n != "sample"])
def test_an_output_aimed_at_an_input_is_refused(uwtrack, made, tmp_path, name):
    for words, output, files in CASES[name]:
        for source in files.split():
            for way in ("symbolic", "hard", "itself"):
                if way == "itself" and "aim.h5" not in words:
                    continue
                work = tmp_path / f"{len(list(tmp_path.iterdir()))}"
                shutil.copytree(made, work)
                os.chdir(work)
                aim(Path(output), (work / source), way)
                before = digests(work)
                given = words.replace("aim.h5", source) if way == "itself" else words
                done = uwtrack(name, *given.split(), "--overwrite")
                case = (name, given, source, way, done.output)
                assert done.exit_code == 1, case
                assert done.stderr.count("error:") == 1, case
                assert "is read by this command" in done.stderr, case
                assert digests(work) == before, case
                shutil.rmtree(work)


def test_a_sample_is_not_copied_onto_itself(uwtrack, samples, tmp_path):
    before = digests(samples)
    done = uwtrack("sample", "mono", "-o", samples, "--overwrite")
    assert done.exit_code == 1
    assert "is read by this command" in done.stderr
    (tmp_path / "mono.truth.json").symlink_to(samples / "mono.wav")
    assert uwtrack("sample", "mono", "--overwrite").exit_code == 1
    assert not (tmp_path / "mono.wav").exists()
    assert digests(samples) == before


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_writes_has_its_inputs_aimed_at(name):
    names = {parameter.name for parameter in load_command(name).params}
    if name == "watch":  # it replaces its own journal and products alone
        return
    if name in {"calibrate", "init-sensor"}:  # no --overwrite: what is there is left
        assert "overwrite" not in names
        return
    assert ("overwrite" in names) == (name in CASES)
    assert bool(names & {"output", "folder"}) == (name in CASES)


def test_a_product_that_is_remembered_is_kept(uwtrack, made, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    shutil.copy(made / "pass.run.h5", tmp_path)
    assert uwtrack("passages", "pass.run.h5").exit_code == 0
    before = digests(tmp_path)
    words = ["--to", "csv", "-o", "pass.run.h5", "--overwrite"]
    done = uwtrack("passages", "pass.run.h5", *words)
    assert done.exit_code == 1
    assert "is read by this command" in done.stderr
    assert digests(tmp_path) == before


def test_a_file_redirected_to_standard_input_is_kept(start, made, tmp_path):
    work = tmp_path / "work"
    shutil.copytree(made, work)
    before = digests(work)
    with (work / "pass.run.h5").open("rb") as file:
        done = start(
            "cpa", "-", "-o", "pass.run.h5", "--overwrite", cwd=work, stdin=file,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    _, said = done.communicate()
    assert done.returncode == 1, said
    assert "is read by this command" in said
    assert digests(work) == before


def write_while_reading(path):
    with atomic_target(path, overwrite=True) as temporary:
        temporary.write_text("theirs")
        assert as_input(path).read_text() == "mine"


def test_a_file_that_is_read_after_the_target_was_checked_is_kept(tmp_path):
    late = tmp_path / "late.toml"
    late.write_text("mine")
    with input_ledger(), pytest.raises(OSError, match="is read by this command"):
        write_while_reading(late)
    assert late.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["late.toml"]


def test_what_is_only_looked_at_and_what_is_written_may_be_replaced(tmp_path):
    old = tmp_path / "old"
    old.write_text("1")
    with input_ledger():
        with not_an_input():
            as_input(old).read_text()
        for text in ("2", "3"):
            with atomic_target(old, overwrite=True) as temporary:
                temporary.write_text(text)
    as_input(old)
    with atomic_target(old, overwrite=True) as temporary:
        temporary.write_text("4")
    assert old.read_text() == "4"


OPENERS = {
    "open", "fdopen", "read_text", "read_bytes", "SoundFile", "File", "info",
    "is_hdf5", "load", "fromfile", "genfromtxt", "loadtxt", "memmap", "copyfile",
    "copy", "copy2", "read",
}  # fmt: skip
"""Functions and methods that read a file, by any of their owners."""
OWNERS = {"read": {"soundfile"}, "load": {"np", "tomllib", "json"},
          "copy": {"shutil"}, "info": {"soundfile"}}  # fmt: skip
"""Owners that make a common name one that reads a file."""
JUSTIFIED = {
    ("cli/console.py", "os.open"): "the null device",
    ("cli/live_run.py", "os.open"): "the null device",
    ("cli/targets.py", "path.open"): "a temporary file of its own",
    ("files/audio/byte_stream.py", "self._path.open"): "noted when it was found",
    ("files/audio/byte_stream.py", "os.fdopen"): "standard input, which is noted",
    ("files/atomic.py", "os.open"): "folders, and the file to write",
    ("files/hdf5/examination.py", "h5py.h5a.open"): "an attribute of an open file",
    ("files/hdf5/examination.py", "h5py.h5o.open"): "an object of an open file",
    ("files/hdf5/examination.py", "path.open"): "a product that is looked over",
    ("flow/batch_report.py", "table.read_bytes"): "refused where it is an input",
    ("flow/batch_report.py", "path.read_text"): "refused where it is an input",
    ("files/limited_process.py", "os.open"): "the null device",
    ("files/limited_process.py", "open"): "what the system says of this process",
    ("flow/exports/passage_tables.py", "path.read_bytes"): "a temporary file of its own",
    ("files/hdf5/writer.py", "np.memmap"): "a temporary file of its own",
    ("files/audio/recording_file.py", "path.open"): "a temporary file of its own",
    ("cli/__init__.py", "open"): "the null device, to write to",
    ("flow/watch.py", "self.path.open"): "the journal, which it writes itself",
    ("flow/catalogue.py", "Path(spec.origin).read_text"): "the program itself",
}


def reads(call):
    """Tell what a call reads a file with, empty if it does not."""
    function = call.func
    if isinstance(function, ast.Name):
        return "open" if function.id == "open" else ""
    if not isinstance(function, ast.Attribute) or function.attr not in OPENERS:
        return ""
    owner = ast.unparse(function.value)
    if owner not in OWNERS.get(function.attr, {owner}):
        return ""
    texts = [a.value for a in call.args if isinstance(a, ast.Constant)]
    texts += [k.value.value for k in call.keywords if isinstance(k.value, ast.Constant)]
    is_write = any(t in {"w", "wb", "w+b", "r+", "a", "x"} for t in texts)
    if is_write or any("as_input(" in ast.unparse(part) for part in ast.walk(call)
                       if isinstance(part, ast.expr)):  # fmt: skip
        return ""
    return f"{owner}.{function.attr}"


@pytest.mark.slow
def test_nothing_is_opened_for_reading_without_being_noted():
    found = []
    for path, tree in package_modules().items():
        name = path.as_posix()
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and ast.unparse(node) == "sys.stdin":
                where = {"files/input_ledger.py", "files/limited_process.py"}
                assert name in where, f"{name} reads standard input by itself"
            what = reads(node) if isinstance(node, ast.Call) else ""
            known = {(name, what), (name, f"*.{what.rpartition('.')[2]}")}
            if what and not known & JUSTIFIED.keys():
                found.append(f"{name}, line {node.lineno}: {what}")
    assert not found, found
