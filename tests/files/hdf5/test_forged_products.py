"""Products that were changed, with a checksum written anew: a sentence, and no harm."""

import resource
import time

import h5py
import numpy as np
import pytest

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5 import product as verify
from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum
from uwtrack_cli.files.hdf5.layout import CONTAINERS
from uwtrack_cli.files.hdf5.product import read_product, verify_product, write_product


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "p.h5"
    write_product(path, [synthetic(Levels, 5), synthetic(Encounters, 2)])
    return path


def forge(path, change):
    """Change a product, and write its checksum anew, as anybody can."""
    content = path.read_bytes()[:-LINE_BYTES]
    path.write_bytes(content)
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:
        change(file)
    with path.open("r+b") as file:
        append_checksum(file)


def read_everything(path):
    with read_product(path) as product:
        for sensor, name, step in product.paths:
            product.read(CONTAINERS[name], sensor, step)


def nested_groups(file):
    group = file
    for _ in range(20_000):
        group = group.create_group("g")


def column_as_scale(file):
    group = file["h1/levels"]
    del group["level_db"]
    column = group.create_dataset(
        "level_db", shape=(400_000_000,), dtype="f8", chunks=(1024,), fletcher32=True
    )
    column.make_scale("level_db")


def shared_heap_object(file):
    """Many attributes whose text is one and the same object of 30 MB."""
    text = h5py.string_dtype()
    group = file["h1/levels"]
    for i in range(100):
        group.attrs.create(f"a{i}", "x" * 300_000, dtype=text)


def many_objects(file):
    for i in range(10_000):
        file["h1"].create_group(f"g{i}")


def chunk_of_gigabytes(file):
    group = file["h1/levels"]
    del group["level_db"]
    group.create_dataset(
        "level_db", shape=(5,), maxshape=(None,), dtype="f8", chunks=(400_000_000,)
    )


def wide_texts(file):
    group = file["encounters"]
    del group["side"]
    group.create_dataset("side", shape=(2,), dtype="S2000000000", chunks=(1,))


def endless_frames(file):
    file["h1/frames"].attrs["first_frame"] = np.int64(2**62)


def unknown_rows(file):
    file["encounters/rest_encounter"][:] = 2**60


FORGED = (
    nested_groups, column_as_scale, shared_heap_object, many_objects,
    chunk_of_gigabytes, wide_texts, endless_frames, unknown_rows,
)  # fmt: skip
HARMLESS = {shared_heap_object, endless_frames}
"""Forgeries that leave a product which can be read."""


@pytest.mark.slow
@pytest.mark.parametrize("change", FORGED, ids=[f.__name__ for f in FORGED])
def test_a_forged_product_costs_neither_time_nor_memory(path, change):
    forge(path, change)
    before = [resource.getrusage(who).ru_maxrss for who in
              (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]  # fmt: skip
    begin = time.process_time()
    if change in HARMLESS:
        read_everything(path)
    else:
        with pytest.raises(DataError) as caught:
            read_everything(path)
        assert "\n" not in str(caught.value)
    assert bool(verify_product(path)) == (change not in HARMLESS)
    assert time.process_time() - begin < 60.0
    after = [resource.getrusage(who).ru_maxrss for who in
             (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]  # fmt: skip
    assert max(b - a for a, b in zip(before, after, strict=True)) < 300_000


def crash(*_):
    import os
    import signal

    os.kill(os.getpid(), signal.SIGSEGV)


def test_verify_goes_on_after_a_file_that_ends_the_library(path, uwtrack, monkeypatch):
    good = path.with_name("good.h5")
    write_product(good, [synthetic(Levels, 5)])
    read = verify.content_problems
    monkeypatch.setattr(
        verify, "content_problems",
        lambda name, *rest: crash() if name == str(path) else read(name, *rest),
    )  # fmt: skip
    done = uwtrack("verify", path, good)
    assert done.exit_code == 1
    assert "ends the process" in done.output
    assert "good.h5" in done.output
