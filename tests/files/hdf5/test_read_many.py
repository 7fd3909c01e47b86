"""Many products are read in one child process, and one that ends it costs itself alone."""

import os
import signal

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import read_many


def value_of(product):
    """What is asked of a product: one of them ends the process that asks."""
    if product.name.endswith("deadly.h5"):
        os.kill(os.getpid(), signal.SIGKILL)
    return [product.name, os.getpid()]


def test_one_child_reads_many_and_says_what_cannot_be_read(tmp_path, pass_run):
    content = pass_run.read_bytes()
    for name in ("a.h5", "b.h5"):
        (tmp_path / name).write_bytes(content)
    (tmp_path / "cut.h5").write_bytes(content[:5000])
    paths = [tmp_path / name for name in ("a.h5", "cut.h5", "none.h5", "b.h5")]
    one, cut, none, other = read_many(f"{__name__}:value_of", paths)
    assert one[0] == str(paths[0])
    assert other[0] == str(paths[3])
    assert one[1] == other[1] != os.getpid()
    assert isinstance(cut, DataError)
    assert "cut short" in str(cut)
    assert isinstance(none, DataError)
    assert "does not exist" in str(none)


def test_a_product_that_ends_the_child_costs_itself_alone(tmp_path, pass_run):
    content = pass_run.read_bytes()
    paths = [tmp_path / name for name in ("a.h5", "deadly.h5", "b.h5")]
    for path in paths:
        path.write_bytes(content)
    one, deadly, other = read_many(f"{__name__}:value_of", paths)
    assert [one[0], other[0]] == [str(paths[0]), str(paths[2])]
    assert isinstance(deadly, DataError)
    assert "deadly.h5 is damaged: reading it ends the process" in str(deadly)
