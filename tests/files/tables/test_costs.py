"""Small inputs that were made to cost much are refused soon, in one sentence."""

import json
import subprocess
import sys

import pytest

from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.csv_table import MAX_CELLS, MAX_COLUMNS, read_table
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.files.tables.toml_tables import parse_toml, read_toml
from uwtrack_cli.flow.recipe import Recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe, shipped_recipes

MEGABYTES = 500
CPU_S = 120.0

COLUMNS, CELLS = f"more than {MAX_COLUMNS} columns", f"more than {MAX_CELLS} cells"
PARTS = "more than 32 parts"
ATTACKS = {
    "columns.csv": (
        lambda: ",".join(f"c{k}" for k in range(100_000)) + "\n" + "1," * 100_000,
        COLUMNS,
    ),
    "same.csv": (lambda: "a," * 900 + "\n" + "1," * 900, "empty or named twice"),
    "commas.csv": (lambda: "," * 57_000_000, COLUMNS),
    "rows.csv": (lambda: "a,b\n" + "1,1\n" * 14_000_000, CELLS),
    "key.toml": (lambda: "a" + ".a" * 20_000 + " = 1", PARTS),
    "keys.toml": (lambda: ("a" + ".a" * 20 + " = 1\n") * 20_000, "no valid TOML"),
    "inline.toml": (lambda: "id = {a" + ".a" * 20_000 + " = 1}", PARTS),
    "header.toml": (lambda: "[a" + ".a" * 20_000 + "]", PARTS),
    "quoted.toml": (lambda: '"a b"' + '."a b"' * 7000 + " = 1", PARTS),
    "nested.toml": (lambda: "id = " + "[" * 200_000, "nested too deeply"),
    "digits.toml": (lambda: "depth_m = " + "9" * 5000, "thousands of digits"),
    "huge.toml": (lambda: 'id = "h1"\ndepth_m = ' + "9" * 4000, "beyond 64 bits"),
    "hexadecimal.toml": (lambda: 'id = "h1"\ndepth_m = 0x' + "F" * 900_000, "beyond 64 bits"),
    "name.toml": (lambda: 'id = "' + "k" * 900_000 + '"', "1 to 200 characters"),
    "long-key.toml": (lambda: '"' + "k" * 900_000 + '" = 1', "has no key"),
}
"""Text of each file, and what is said of it."""

CHILD = """
import json, sys, time
from pathlib import Path
from uwtrack_cli.files.tables.csv_table import read_table
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.errors import DataError
begin = time.process_time()
said = {}
for path in map(Path, sys.argv[1:]):
    try:
        read_table(path) if path.suffix == ".csv" else load_sensor(path)
    except DataError as error:
        said[path.name] = str(error)
# not ru_maxrss, which begins with the size of the process that started this one
status = Path("/proc/self/status").read_text()
used = int(status.partition("VmHWM:")[2].split()[0]) / 1024
print(json.dumps([said, used, time.process_time() - begin]))
"""


@pytest.mark.slow
def test_small_files_cost_little(tmp_path):
    for name, (text, _) in ATTACKS.items():
        (tmp_path / name).write_text(text())
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *(tmp_path / name for name in ATTACKS)],
        capture_output=True, text=True, check=True, timeout=300,
    )  # fmt: skip
    said, used_mb, cpu_s = json.loads(done.stdout)
    for name, (_, wanted) in ATTACKS.items():
        assert wanted in said[name], name
        assert len(said[name]) < 1500, name
    assert used_mb < MEGABYTES
    assert cpu_s < CPU_S


def test_numbers_of_thousands_of_digits_are_refused_in_a_sentence(uwtrack, tmp_path):
    digits = "9" * 4000
    (tmp_path / "r.toml").write_text(f"[spectrogram]\nwindow_s = {digits}\n")
    for words in (
        ["recipes", "--show", "r.toml"],
        ["run", "a.wav", "--set", f"spectrogram.window_s={digits}"],
        ["run", "a.wav", "--set", f"spectrogram.window_s={digits}{digits}"],
        ["study", "tma", "--runs", digits],
    ):
        done = uwtrack(*words)
        assert done.exit_code == 2, done.output
        assert len(done.stderr) < 400
        assert "error: " in done.stderr
        assert "program failed" not in done.stderr


def test_what_people_write_is_still_read(tmp_path):
    for name in shipped_recipes():
        assert Recipe.from_toml(name, load_recipe(name).to_toml()).steps
    dots = "x = [" + "1.5, " * 200 + "]\n# " + "." * 100 + '\ny = "' + "." * 100 + '"\n'
    assert len(parse_toml(dots)["x"]) == 200
    assert parse_toml("a.b.c.d = 1") == {"a": {"b": {"c": {"d": 1}}}}
    path = tmp_path / "a.toml"
    path.write_text('id = "h1"\ndepth_m = 20\n')
    assert read_toml(path) == {"id": "h1", "depth_m": 20}
    assert load_sensor(path).depth_m == 20.0
    path = tmp_path / "a.csv"
    path.write_text('a,"b c"\n1,"x,""y"""\n\n# no\n2,z \n')
    table = read_table(path)
    assert dict(table.cells) == {"a": ["1", "2"], "b_c": ['x,"y"', "z"]}
    assert table.lines == [2, 5]


def test_a_recipe_as_large_as_no_recipe_is_refused(tmp_path):
    path = tmp_path / "r.toml"
    path.write_text("#" * (1 << 21))
    with pytest.raises(OptionError, match="larger than"):
        load_recipe(str(path))
    with pytest.raises(DataError, match="larger than"):
        read_toml(path)
