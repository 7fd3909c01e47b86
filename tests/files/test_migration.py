"""Files of older versions are read as if they were written today.

`version-1.lines.h5.gz` was written by the program of the time, from 24 s of a steady
tone of 50 Hz and one that rises from 83 Hz; it is not made again.
"""

import gzip
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from uwtrack_cli.data.lines import Lines
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.layout import SCHEMA_VERSION
from uwtrack_cli.files.migration import MIGRATIONS
from uwtrack_cli.files.product import read_product, verify_product
from uwtrack_cli.files.seal import append_seal

STORED = Path(__file__).parent / "version-1.lines.h5.gz"


@pytest.fixture
def old(tmp_path):
    """A product of version 1 beside nothing else."""
    path = tmp_path / "tone.lines.h5"
    with gzip.open(STORED) as packed, path.open("wb") as target:
        shutil.copyfileobj(packed, target)
    return path


def test_every_older_version_leads_to_the_next():
    assert sorted(MIGRATIONS) == list(range(1, SCHEMA_VERSION))


def test_lines_of_version_1_are_read_in_single_precision(old):
    with h5py.File(old) as file:
        stored = file["unnamed/lines"]
        assert stored["bearing_deg"].dtype == np.float64
        frequency = stored["frequency_hz"][:]
        std = stored["measured_frequency_std_hz"][:]
    with read_product(old) as product:
        assert product.schema_version == 1
        lines = product.read(Lines)
    assert lines.line.dtype == np.int32
    assert lines.measured_frequency_std_hz.dtype == np.float32
    order = np.argsort(lines.frequency_hz), np.argsort(frequency)
    np.testing.assert_array_equal(lines.frequency_hz[order[0]], frequency[order[1]])
    np.testing.assert_allclose(
        lines.measured_frequency_std_hz[order[0]], std[order[1]], rtol=6e-8
    )
    steady = lines.frequency_hz[np.abs(lines.frequency_hz - 50.0) < 1.0]
    assert steady.size > 30
    assert steady == pytest.approx(50.0, abs=0.1)


def test_an_older_file_is_whole_and_goes_through_the_chain(old, uwtrack):
    assert verify_product(old) == []
    assert uwtrack("cpa", old, "-o", "new.h5", "-q").exit_code == 0
    with read_product(old.parent / "new.h5") as made:
        assert made.schema_version == SCHEMA_VERSION
        assert made.read(Lines).line.size > 30
    shown = [uwtrack("show", name, "lines", "--format", "csv").stdout
             for name in (old, "new.h5")]  # fmt: skip
    assert shown[0] == shown[1]


def test_a_file_that_claims_todays_version_is_held_to_it(old):
    with h5py.File(old, "r+") as file:
        file.attrs["schema_version"] = SCHEMA_VERSION
    with old.open("r+b") as file:
        append_seal(file)
    with read_product(old) as product, pytest.raises(DataError, match="expected int32"):
        product.read(Lines)
