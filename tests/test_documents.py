"""The documentation site builds without a warning, and its commands run as they stand."""

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import lxml.html
import numpy as np
import pytest
import soundfile

from tests.first_half_hour import COMMANDS_PAGE, Shell, repeated
from tests.first_half_hour import PAGE as HALF_HOUR
from uwtrack_cli.cli.app import COMMANDS, load_command
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.tables.json_rows import object_keys

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
FENCED = re.compile(r"^```(sh|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ELSEWHERE = {"github-actions.md", "notebook.md"}
"""Pages whose code is run by a test of its own, and by the build."""

EXECUTED = [
    page
    for page in PAGES
    if page.name not in ELSEWHERE and FENCED.search(page.read_text(encoding="utf-8"))
]


def build_site():
    """Build the site as by `make docs`, only what is new, and return its folder."""
    folder = ROOT / "docs" / "_build" / "html"
    words = ["-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [sys.executable, *words, ROOT / "docs", folder], capture_output=True, text=True,
        check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_site_builds_without_a_warning_and_every_link_arrives():
    site = build_site()
    for name in COMMANDS:
        assert (site / f"reference/generated/commands/{name}.html").exists()
    trees = {
        path: lxml.html.parse(path).getroot()
        for path in site.rglob("*.html")
        if (ROOT / "docs" / path.relative_to(site)).with_suffix(".md").exists()
    }
    names = {path: set(tree.xpath("//@id")) for path, tree in trees.items()}
    for path, tree in trees.items():
        for link in tree.xpath("//a/@href | //img/@src"):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.exists(), f"{path.name}: {link}"
            if parts.fragment and target in names:
                assert unquote(parts.fragment) in names[target], f"{path.name}: {link}"
    for path in site.rglob("*.html"):  # nothing is fetched from elsewhere
        tree = lxml.html.parse(path).getroot()
        for fetched in tree.xpath("//script/@src | //link[@rel='stylesheet']/@href"):
            assert not urlsplit(fetched).netloc, f"{path.name}: {fetched}"
    assert trees[site / "methods.html"].xpath("//*[local-name() = 'mfrac']")
    notebook = trees[site / "notebook.html"].text_content()
    assert "2024-05-01 12:02:28" in notebook  # it was executed
    assert "false_alarm_probability must be a number" in notebook


@pytest.fixture(scope="session")
def sound_programs(tmp_path_factory):
    """Programs that give sound, as sox, ffmpeg and arecord do."""
    folder = tmp_path_factory.mktemp("bin")
    noise = np.random.default_rng(1).normal(0.0, 0.1, 4 * 48_000)
    soundfile.write(folder / "sound.wav", noise, 48_000, subtype="PCM_24")
    (0x7FFF * noise.clip(-1, 1)).astype("<i2").tofile(folder / "sound.raw")
    for name, sound in (("sox", "wav"), ("arecord", "wav"), ("ffmpeg", "raw")):
        program = folder / name
        program.write_text(f"#!/bin/sh\nexec cat {folder}/sound.{sound}\n")
        program.chmod(0o755)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", EXECUTED, ids=lambda page: page.stem)
def test_the_blocks_of_a_page_run_in_their_order(
    page, shared_program, sound_programs, tmp_path, monkeypatch
):
    (tmp_path / "recorder.wav").write_bytes((sound_programs / "sound.wav").read_bytes())
    folders = (shared_program, sound_programs, Path(sys.executable).parent)
    path = ":".join([*map(str, folders), os.environ["PATH"]])
    monkeypatch.setenv("PATH", path)
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    script = ["set -eu", "export MPLBACKEND=agg"]
    for language, code in FENCED.findall(page.read_text(encoding="utf-8")):
        script.append(code if language == "sh" else f"python <<'CODE'\n{code}CODE")
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", "\n".join(script)], cwd=tmp_path,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    if page.stem == "soundtrap-folder":
        shown = re.sub(r"\s+", " ", page.read_text(encoding="utf-8"))
        for line in done.stdout.splitlines()[:5]:  # what it prints is what it says
            assert re.sub(r"\s+", " ", line).strip() in shown


@pytest.mark.slow
@pytest.mark.parametrize("path", [HALF_HOUR, COMMANDS_PAGE], ids=lambda p: p.stem)
def test_what_is_typed_prints_what_the_page_says(path, shared_program, tmp_path):
    folders = (shared_program, Path(sys.executable).parent)
    shell = Shell(
        tmp_path,
        {
            **os.environ,
            "HOME": str(tmp_path), "COLUMNS": "80", "MPLBACKEND": "agg",
            "PATH": ":".join([*map(str, folders), os.environ["PATH"]]),
        },
    )  # fmt: skip
    try:
        page = path.read_text(encoding="utf-8")
        now = repeated(page, shell.type, installs=False)
    finally:
        shell.close()
    numbers = re.compile(r"(?<![\w.])-?\d+\.\d+(?![\w.])|(?<= )\d+(?= |$)")
    for told, printed in zip(page.splitlines(), now.splitlines(), strict=True):
        words = [" ".join(numbers.sub("N", line).split()) for line in (told, printed)]
        assert words[0] == words[1]
        found = [numbers.findall(line) for line in (told, printed)]
        # the last digit may differ from machine to machine
        for one, other in zip(*found, strict=True):
            unit = 0.1 if "." in one else 1.0
            assert float(one) == pytest.approx(float(other), rel=0.01, abs=unit)


def test_every_command_has_an_example_and_every_key_of_a_result_its_row():
    typed = COMMANDS_PAGE.read_text(encoding="utf-8")
    assert not re.search(r"^error:", typed, re.MULTILINE)
    for name in COMMANDS:
        assert re.search(rf"^\$ uwtrack {name}( |$)", typed, re.MULTILINE), name
    sections = (ROOT / "docs" / "numbers.md").read_text(encoding="utf-8").split("\n## ")
    for section in sections:
        kind = CONTAINERS.get(section.partition("\n")[0])
        if kind is not None:
            table = section.partition("\n###")[0]
            rows = [line.split("|")[1] for line in table.splitlines() if "| `" in line]
            keys = [key for row in rows for key in re.findall(r"`(\w+)`", row)]
            assert sorted(keys) == sorted(object_keys(kind)), kind.NAME


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.stem)
def test_commands_stand_in_blocks_that_are_run(page):
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    lines = [line.strip() for line in text.splitlines()]
    names = "|".join(COMMANDS)
    typed = re.compile(rf"uwtrack ({names})( |$)|python -")
    assert not [line for line in lines if typed.match(line)]


def test_every_other_command_line_names_commands_and_options_that_exist():
    right = [page for page in PAGES if page != HALF_HOUR]  # it types wrong ones, too
    documents = [*right, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    lines = [
        (page.name, line)
        for page in documents
        for line in page.read_text(encoding="utf-8").splitlines()
        if re.match(r"(    |\s*- run: )?.*\buwtrack [a-z]", line)
    ]
    assert len(lines) > 100
    for page, line in lines:
        for words in re.findall(r"\buwtrack ([a-z][a-z-]*)([^`|;&#]*)", line):
            if words[0] not in COMMANDS:
                assert "`" not in line.split("uwtrack " + words[0])[0][-2:], (page, line)
                continue
            params = load_command(words[0]).params
            known = {flag for p in params for flag in (*p.opts, *p.secondary_opts)}
            known |= {"-h", "--help"}
            given = re.findall(r"(?<=\s)--[a-z][a-z-]*", words[1])
            assert set(given) <= known, f"{page}: {line}"
