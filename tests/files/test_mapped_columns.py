"""Long columns on disk: the same values, and hardly anything of them in memory."""

import numpy as np
import psutil
import pytest

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.files.hdf5 import writer as hdf5_writer
from uwtrack_cli.files.hdf5.product import ProductWriter, read_product
from uwtrack_cli.files.hdf5.writer import on_disk


def test_what_a_writer_reads_back_is_what_the_product_holds(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5_writer, "LEAST_MAPPED_BYTES", 1000)
    lines = synthetic(Lines, 300)
    with ProductWriter(tmp_path / "a.h5") as writer:
        writer.append(lines)
        held = writer.read_back(Lines)
        assert isinstance(held.time_s.base, np.memmap)
        assert isinstance(held.frames.time_s.base, np.memmap)
        assert held.equals(Lines.join([lines]))
    with read_product(tmp_path / "a.h5") as product:
        assert product.read(Lines).equals(held)


@pytest.mark.parametrize("values", [np.zeros((0, 3)), np.arange(99.0)])
def test_what_is_short_stays_in_memory(values):
    assert on_disk(values) is values


def test_what_is_not_looked_at_takes_no_memory():
    process = psutil.Process()
    held = on_disk(np.arange(12_800_000.0).reshape(-1, 64))  # 100 MB
    before = process.memory_info().rss
    window = held[100_000:100_100].copy()
    assert window[0, 0] == 6_400_000.0
    assert process.memory_info().rss - before < 20e6
    assert held.sum() == (12_800_000 - 1) * 6_400_000.0
    assert process.memory_info().rss - before > 30e6  # the figure sees what is


def test_on_a_full_disk_it_stays_in_memory(monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(hdf5_writer.tempfile, "TemporaryFile", full)
    values = np.arange(100_000.0)
    assert on_disk(values) is values
