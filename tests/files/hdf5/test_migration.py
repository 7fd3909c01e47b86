"""Files of older versions are read as if they were written today.

`version-1.lines.h5.gz` was written by the program of the time, from 24 s of a steady
tone of 50 Hz and one that rises from 83 Hz. `version-2.h5.gz` was written by version
0.1.0, from encounters, motions, a decision, a target and levels of its samples, and
`version-2.json.gz` holds what its `show --format json` printed of them. Neither is made
again.
"""

import gzip
import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.presence import Presence
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.checksum import append_checksum
from uwtrack_cli.files.hdf5.layout import CONTAINERS, SCHEMA_VERSION
from uwtrack_cli.files.hdf5.migration import RENAMED_IN
from uwtrack_cli.files.hdf5.product import read_product, verify_product, write_product

FOLDER = Path(__file__).parent


def unpacked(name, path):
    with gzip.open(FOLDER / name) as packed, path.open("wb") as target:
        shutil.copyfileobj(packed, target)
    return path


@pytest.fixture
def old(tmp_path):
    """A product of version 1 beside nothing else."""
    return unpacked("version-1.lines.h5.gz", tmp_path / "tone.lines.h5")


@pytest.fixture
def second(tmp_path):
    """A product of version 2."""
    return unpacked("version-2.h5.gz", tmp_path / "second.h5")


def test_what_version_2_printed_is_printed_of_its_files(second, uwtrack):
    printed = json.loads(gzip.decompress((FOLDER / "version-2.json.gz").read_bytes()))
    csv_text = printed.pop("target csv").replace("loss_evidence", "loss_cusum")
    for before, now in (("effort", "valid_fraction"), ("loss_evidence", "loss_cusum")):
        for container, axis in (("frames", "frame"), ("target", "scan")):
            for row in printed[container][axis]:
                if before in row:
                    row[now] = row.pop(before)
    sensor = printed["sensor"]
    sensor |= {"depth_std_m": None, "sound_speed_std_mps": None, "full_scale_db": None}
    sensor |= {"element_along_m": None, "tow_offset_m": None, "heading_source": None}
    sensor |= {"element_positions_m": None}
    sensor |= {"dipole_gains": None, "dipole_crosstalk": 0.0, "omni_crosstalk": None}
    sensor |= dict.fromkeys(("navigation_position_std_m", "navigation_velocity_std_mps"))
    sensor |= dict.fromkeys(("north", "multiplex", "response", "clock_error_ppm"))
    printed["target"] |= dict.fromkeys(
        ("clutter_ratio", "clutter_ratio_std", "confirming_score", "crowded_scans")
    )
    printed["target"] |= dict.fromkeys(("false_tracks_per_hour", "smoothing_scans"))
    added = ("_std_m", "_over_speed_s", "_over_speed_std_s")
    for row in printed["encounters"]:
        row.update({f"horizontal_range{name}": None for name in added}, nuisances={})
        row.update(rest_frame_evidence=None, misfit=None, vessel=None)
        row.update(motion_model=None, motion_model_probability=None, change=None)
        row.update(alternative_motion_model=None)
        row.update(probability=None, alternative=None, alternative_probability=None)
        row.update(evidence=[])
        row["reasons"]["vessel"] = "no AIS table was given"
    with read_product(second) as product:
        assert product.schema_version == 2
        assert {key.name for key in product.paths} == set(printed)
    for name, expected in printed.items():
        shown = json.loads(uwtrack("show", second, name, "--format", "json").stdout)
        shown = shown if isinstance(shown, list) else [shown]
        before = expected if isinstance(expected, list) else [expected]
        for row, known in zip(shown, before, strict=True):
            assert {key: row[key] for key in known} == known, name
    shown = uwtrack("show", second, "target", "--format", "csv")
    assert shown.stdout.splitlines() == csv_text.splitlines()
    assert [len(row["ambiguities"]) for row in printed["encounters"]] == [0, 2, 1]
    assert len(printed["encounters"][0]["reasons"]) > 1


def test_a_file_of_version_2_is_whole_and_its_rows_may_be_read_in_blocks(second):
    assert verify_product(second) == []
    with read_product(second) as product:
        levels = product.read(Levels)
        blocks = list(product.stream(Levels, block_rows=7))
    assert len(blocks) == 6
    assert Levels.join(blocks).equals(levels)
    assert (levels.frames.valid_fraction == 1.0).all()


def test_what_is_read_from_version_2_is_stored_in_todays_version(second, tmp_path):
    with read_product(second) as product:
        found = [product.read(kind) for kind in (Encounters, Motions, Decision, Levels)]
    write_product(tmp_path / "now.h5", found)
    with read_product(tmp_path / "now.h5") as product:
        assert product.schema_version == SCHEMA_VERSION
        for container in found:
            assert product.read(type(container)).equals(container)


def test_a_json_text_of_version_2_that_is_none_is_refused(second):
    with h5py.File(second, "r+") as file:
        reasons = file["encounters/reasons"]
        reasons[0] = b"[1, 2"
    with second.open("r+b") as file:
        append_checksum(file)
    with read_product(second) as product, pytest.raises(DataError, match="JSON text"):
        product.read(Encounters)


def test_renamed_columns_are_columns_of_today():
    for names in RENAMED_IN.values():
        for (container, now), before in names.items():
            columns = CONTAINERS[container].columns()
            assert now in columns
            assert before not in columns


@pytest.mark.parametrize("kind", [Encounters, Presence, Fixes, Motions])
def test_a_file_of_version_4_has_the_columns_of_today(kind, tmp_path):
    path = tmp_path / "old.h5"
    table = synthetic(kind, 3)
    if kind is Fixes:
        names = np.array(["stationary", "moving", ""])
        table = replace(table, motion_model=names, alternative_motion_model=names[::-1])
    write_product(path, [table])
    with h5py.File(path, "r+") as file:
        (own,) = (g[kind.NAME] for g in (file, *file.values()) if kind.NAME in g)
        for (container, now), before in RENAMED_IN[5].items():
            if container == kind.NAME:
                own.move(now, before)
        if kind is Fixes:
            for name in ("reading", "rival"):
                words = [b"still" if one == b"stationary" else one for one in own[name]]
                own[name][:] = words
        file.attrs["schema_version"] = 4
    with path.open("r+b") as file:
        append_checksum(file)
    with read_product(path) as product:
        assert product.read(kind).equals(table)
    assert verify_product(path) == []


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
    np.testing.assert_allclose(lines.measured_frequency_std_hz[order[0]], std[order[1]], rtol=6e-8)
    steady = lines.frequency_hz[np.abs(lines.frequency_hz - 50.0) < 1.0]
    assert steady.size > 30
    assert steady == pytest.approx(50.0, abs=0.1)


def test_an_older_file_is_whole_and_goes_through_the_chain(old, uwtrack):
    assert verify_product(old) == []
    assert uwtrack("cpa", old, "-o", "new.h5", "-q").exit_code == 0
    with read_product(old.parent / "new.h5") as made:
        assert made.schema_version == SCHEMA_VERSION
        assert made.read(Lines).line.size > 30
    shown = [uwtrack("show", name, "lines", "--format", "csv").stdout for name in (old, "new.h5")]
    assert shown[0] == shown[1]


def test_a_file_that_claims_todays_version_is_held_to_it(old):
    with h5py.File(old, "r+") as file:
        file.attrs["schema_version"] = SCHEMA_VERSION
    with old.open("r+b") as file:
        append_checksum(file)
    with read_product(old) as product, pytest.raises(DataError, match="expected int32"):
        product.read(Lines)
