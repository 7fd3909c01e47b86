"""What waited on disk is what would have waited in memory, bit for bit."""

import os
import tempfile

import pytest
from synthetic_containers import synthetic

from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Levels, Overview
from uwtrack_cli.errors import OutputError
from uwtrack_cli.files import spill as module
from uwtrack_cli.files.spill import Spill


def blocks_of(kind, count):
    return [synthetic(kind, 4, seed=k) for k in range(count)]


@pytest.mark.parametrize("held_bytes", [0, 3000, 1 << 30])
def test_blocks_come_back_as_their_join(monkeypatch, held_bytes):
    monkeypatch.setattr(module, "HELD_BYTES", held_bytes)
    kinds = (Overview, Levels, Lines)
    blocks = {kind: blocks_of(kind, 7) for kind in kinds}
    with Spill() as spill:
        for k in range(7):
            for kind in kinds:
                spill.append(blocks[kind][k])
        found = spill.joined()
    assert [type(item) for item in found] == list(kinds)
    for item in found:
        assert item.equals(type(item).join(blocks[type(item)])), item.NAME


def test_nothing_is_left_behind(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "HELD_BYTES", 0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Spill() as spill:
        spill.append(synthetic(Frames, 4))
        assert list(tmp_path.iterdir()) == []  # nameless from the start


def test_a_folder_without_room_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "HELD_BYTES", 0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with Spill() as spill, pytest.raises(OutputError, match=r"missing.*TMPDIR"):
        spill.append(synthetic(Levels, 4))


def test_a_disk_that_fills_is_one_sentence(monkeypatch, tmp_path):
    (tmp_path / "full").symlink_to("/dev/full")
    full = os.open("/dev/full", os.O_RDWR), str(tmp_path / "full")
    monkeypatch.setattr(module, "HELD_BYTES", 0)
    monkeypatch.setattr(tempfile, "mkstemp", lambda **_words: full)
    with Spill() as spill, pytest.raises(OutputError, match="cannot keep") as caught:
        spill.append(synthetic(Levels, 4))
    assert "\n" not in str(caught.value)
