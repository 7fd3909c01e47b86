"""A product is whole or it is refused: damage, hostile contents, kills, targets."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError, OutputError, UwtrackError
from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum
from uwtrack_cli.files.hdf5.layout import CONTAINERS, SCHEMA_VERSION
from uwtrack_cli.files.hdf5.product import (
    HistoryStep,
    ProductWriter,
    Source,
    read_product,
    read_product_bytes,
    source_of,
    verify_product,
    write_product,
)


@pytest.fixture
def path(tmp_path):
    """A small product."""
    path = tmp_path / "p.h5"
    steps = [HistoryStep.now("levels", {"a": 1})]
    write_product(path, [synthetic(Levels, 5), synthetic(Encounters, 2)], history=steps)
    return path


def forge(path):
    """Give a changed file a right checksum, as an attacker would."""
    with path.open("r+b") as file:
        append_checksum(file)


def read_everything(path):
    with read_product(path) as product:
        for sensor, name, _ in product.paths:
            product.read(CONTAINERS[name], sensor)


def test_untouched_product_has_no_problem(path):
    assert verify_product(path) == []


def test_any_changed_byte_is_found(path):
    content = path.read_bytes()
    places = np.random.default_rng(5).choice(len(content), 12)
    for place in [*places, 0, 9, len(content) - 1, len(content) - LINE_BYTES]:
        changed = bytearray(content)
        changed[place] ^= 0x10
        with pytest.raises(DataError):
            read_product_bytes(bytes(changed))


@pytest.mark.parametrize("keep", [0, 1, 100, 600, 0.3, 0.9, -1, -LINE_BYTES])
def test_truncated_product_is_refused_in_one_sentence(path, keep):
    content = path.read_bytes()
    n_bytes = int(keep * len(content)) if isinstance(keep, float) else keep
    path.write_bytes(content[:n_bytes])
    with pytest.raises(DataError, match=r"empty|not an HDF5|cut short") as caught:
        read_product(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(verify_product(path)) == 1


def test_newer_schema_is_refused_by_name(path):
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 99
        file.attrs["program_version"] = "7.1"
    for forged in (False, True):
        if forged:
            forge(path)
        with pytest.raises(DataError) as caught:
            read_product(path)
        for word in (
            "schema version 99",
            "uwtrack 7.1",
            f"up to version {SCHEMA_VERSION}",
            "newer",
        ):
            assert word in str(caught.value)


def test_product_without_its_mark_is_called_incomplete(path):
    with h5py.File(path, "r+") as file:
        del file.attrs["complete"]
    with pytest.raises(DataError, match="incomplete"):
        read_product(path)


def test_foreign_files_are_refused_for_what_they_are(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.arange(3)
    (tmp_path / "text.h5").write_text("hello\n")
    (tmp_path / "empty.h5").touch()
    (tmp_path / "folder.h5").mkdir()
    expected = {
        "other.h5": "another program",
        "text.h5": "not an HDF5 file",
        "empty.h5": "empty",
        "folder.h5": "folder",
        "missing.h5": "does not exist",
    }
    for name, reason in expected.items():
        with pytest.raises(DataError, match=reason):
            read_product(tmp_path / name)
    with pytest.raises(DataError, match="empty"):
        read_product_bytes(b"")
    with pytest.raises(DataError, match="device"):
        read_product("/dev/null")


def huge(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset(
        "level_db", shape=(2**50,), chunks=(1024,), dtype="f8", fletcher32=True
    )


def external_link(file):
    del file["h1/levels/level_db"]
    file["h1/levels/level_db"] = h5py.ExternalLink("/etc/passwd", "/x")


def soft_link(file):
    file["h1/again"] = h5py.SoftLink("/h1/levels")


def cycle(file):
    file["h1/levels/up"] = file["/h1"]


def external_storage(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset(
        "level_db", shape=(5,), dtype="f8", external=[("/etc/passwd", 0, 40)]
    )


def virtual(file):
    del file["h1/levels/level_db"]
    layout = h5py.VirtualLayout(shape=(5,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", shape=(5,))
    file["h1/levels"].create_virtual_dataset("level_db", layout)


def foreign_filter(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset("level_db", data=np.zeros(5), chunks=(5,), compression="gzip")


def wrong_type(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset("level_db", data=np.zeros(5, "i4"))


def wrong_rank(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset("level_db", data=np.zeros((5, 2)))


def wrong_length(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset("level_db", data=np.zeros(4))


def compound(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset("level_db", data=np.zeros(5, "f8,i4"))


def objects(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_dataset(
        "level_db", data=[b"cos\nsystem\n"], dtype=h5py.special_dtype(vlen=bytes)
    )


def missing_column(file):
    del file["h1/levels/level_db"]


def group_for_column(file):
    del file["h1/levels/level_db"]
    file["h1/levels"].create_group("level_db")


def array_attribute(file):
    file["h1/levels"].attrs["band_low_hz"] = np.zeros(1000)


def text_for_number(file):
    file["h1/levels"].attrs["band_low_hz"] = "low"


def missing_attribute(file):
    del file["h1/levels"].attrs["band_low_hz"]


def wrong_part(file):
    file["h1/levels"].attrs["frames"] = "/encounters"


def no_part(file):
    file["h1/levels"].attrs["frames"] = "../../etc"


def own_part(file):
    file["h1/levels"].attrs["frames"] = "/h1/levels"


def bad_history(file):
    del file["history"]
    file.create_dataset("history", data=np.array([b"[" * 100]))


def vast_history(file):
    file["history"].resize(2**40, axis=0)


HOSTILE = (
    huge, external_link, soft_link, cycle, external_storage, virtual, foreign_filter,
    wrong_type, wrong_rank, wrong_length, compound, objects, missing_column,
    group_for_column, array_attribute, text_for_number, missing_attribute, wrong_part,
    no_part, own_part, bad_history, vast_history,
)  # fmt: skip


@pytest.mark.parametrize("change", HOSTILE, ids=[h.__name__ for h in HOSTILE])
def test_hostile_contents_are_refused_before_they_are_allocated(path, change):
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:
        change(file)
    forge(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError) as caught:
        read_everything(path)
    assert "\n" not in str(caught.value)
    assert verify_product(path)
    used_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert used_mb < 100


def test_history_names_sources_that_have_changed(path, tmp_path):
    source = tmp_path / "pass.wav"
    source.write_bytes(b"sound")
    step = HistoryStep.now("levels", {}, [source_of(source), source_of(path)])
    write_product(tmp_path / "q.h5", [synthetic(Levels, 2)], history=[step])
    assert verify_product(tmp_path / "q.h5") == []
    source.write_bytes(b"other")
    (problem,) = verify_product(tmp_path / "q.h5")
    assert "pass.wav" in problem
    wrong = HistoryStep.now("levels", {}, [Source(name="x.wav", digest="12")])
    write_product(tmp_path / "r.h5", [synthetic(Levels, 2)], history=[wrong])
    (problem,) = verify_product(tmp_path / "r.h5")
    assert "no SHA-256" in problem


def test_existing_file_is_kept_unless_overwrite_is_given(path):
    before = path.read_bytes()
    with pytest.raises(OutputError, match="--overwrite"):
        write_product(path, [synthetic(Levels, 1)])
    assert path.read_bytes() == before
    write_product(path, [synthetic(Lines, 1)], overwrite=True)
    read_everything(path)


def test_input_is_never_the_target(path):
    link = path.with_name("link.h5")
    link.symlink_to(path)
    for target in (path, link):
        with pytest.raises(OutputError, match="input"):
            write_product(target, [synthetic(Levels, 1)], overwrite=True, inputs=[path])
    assert verify_product(path) == []


def test_targets_that_cannot_be_written_are_refused(path, tmp_path):
    expected = {
        tmp_path: "folder",
        tmp_path / "no" / "x.h5": "does not exist",
        path / "x.h5": "not a folder",
        "/dev/full": "device",
        tmp_path / ("x" * 300): "too long",
        tmp_path / "a\0b": "null",
    }
    for target, reason in expected.items():
        with pytest.raises(OutputError, match=reason):
            write_product(target, [synthetic(Levels, 1)], overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["p.h5"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="permission"):
        write_product(tmp_path / "x.h5", [synthetic(Levels, 1)])
    tmp_path.chmod(0o700)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError("x"), SystemExit])
def test_error_while_writing_leaves_nothing(tmp_path, error):
    def write():
        with ProductWriter(tmp_path / "p.h5") as writer:
            writer.append(synthetic(Levels, 100))
            raise error

    with pytest.raises(type(error) if isinstance(error, Exception) else error):
        write()
    assert list(tmp_path.iterdir()) == []


def test_error_while_replacing_keeps_the_old_file(path):
    before = path.read_bytes()

    def write():
        with ProductWriter(path, overwrite=True) as writer:
            writer.append(synthetic(Levels, 100))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["p.h5"]


KILLED = """
import sys, numpy as np
sys.path.insert(0, sys.argv[2])
from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.files.hdf5.product import ProductWriter
block = synthetic(Spectrogram, 200)
print("ready", flush=True)
with ProductWriter(sys.argv[1], overwrite=True) as writer:
    for _ in range(200):
        writer.append(block)
print("done", flush=True)
"""


def kill_a_writer(target, delay_s):
    command = [sys.executable, "-c", KILLED, str(target), str(Path(__file__).parents[3])]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)


LEFT_BY_A_KILL = {"p.h5"}


def check_after_kills(tmp_path, delays):
    target = tmp_path / "p.h5"
    for delay_s in delays:
        kill_a_writer(target, delay_s)
        if target.exists():
            assert verify_product(target) == []
        assert {p.name for p in tmp_path.iterdir()} <= LEFT_BY_A_KILL
    old = synthetic(Levels, 3)
    write_product(target, [old], overwrite=True)
    for delay_s in delays[: len(delays) // 2]:
        kill_a_writer(target, delay_s)
        assert verify_product(target) == []


def test_kill_while_writing_leaves_no_half_file_under_the_name(tmp_path):
    check_after_kills(tmp_path, [0.0, 0.05, 0.2])


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_hundred_kills_while_writing_leave_no_half_file(tmp_path):
    rng = np.random.default_rng(11)
    check_after_kills(tmp_path, list(rng.uniform(0.0, 1.0, 100)))


LIMITED = """
import resource, signal, sys
sys.path.insert(0, sys.argv[2])
from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.errors import OutputError
from uwtrack_cli.files.hdf5.product import ProductWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
try:
    with ProductWriter(sys.argv[1], overwrite=True) as writer:
        for _ in range(60):
            writer.append(synthetic(Spectrogram, 200))
except OutputError as error:
    print(error)
    sys.exit(1)
"""


@pytest.mark.parametrize("limit", [100, 5_000, 100_000, 5_000_000])
def test_full_disk_is_an_error_of_one_sentence_and_leaves_nothing(tmp_path, limit):
    target = tmp_path / "p.h5"
    here = str(Path(__file__).parents[3])
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(target), here, str(limit)],
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert done.stdout.startswith(f"cannot write {target}")
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("nameless", [True, False])
@pytest.mark.parametrize("overwrite", [True, False])
def test_file_appears_whole_where_files_need_names_too(tmp_path, monkeypatch, nameless, overwrite):
    if not nameless:
        monkeypatch.setattr("uwtrack_cli.files.atomic.NAMELESS", tmp_path / "none")
    target = tmp_path / "p.h5"
    levels = synthetic(Levels, 3)
    with ProductWriter(target, overwrite=overwrite) as writer:
        writer.write(levels)
        assert not target.exists()
        assert len(list(tmp_path.iterdir())) == (0 if nameless else 1)
    assert [p.name for p in tmp_path.iterdir()] == ["p.h5"]
    assert verify_product(target) == []
    plain = tmp_path / "plain"
    plain.touch()
    assert target.stat().st_mode == plain.stat().st_mode


def test_two_writers_of_one_target_do_not_mix(tmp_path):
    target = tmp_path / "p.h5"

    def write():
        with ProductWriter(target) as writer:
            writer.write(synthetic(Levels, 2))
            write_product(target, [synthetic(Levels, 3)])

    with pytest.raises(OutputError, match="appeared meanwhile"):
        write()
    with read_product(target) as product:
        assert product.read(Levels).level_db.size == 3
    assert [p.name for p in tmp_path.iterdir()] == ["p.h5"]


def mutants(content, n, seed):
    """Yield damaged copies of a file, most of them beyond its first bytes."""
    for i in range(n):
        chance = random.Random(seed * 1_000_000 + i)  # noqa: S311
        changed = bytearray(content)
        kind = chance.randrange(4)
        if kind == 0:
            for _ in range(chance.choice([1, 1, 2, 8, 64])):
                changed[chance.randrange(len(changed))] = chance.randrange(256)
        elif kind == 1:
            changed = changed[: chance.randrange(1, len(changed))]
        elif kind == 2:
            at = chance.randrange(len(changed) - 8)
            changed[at : at + 8] = chance.choice([b"\xff" * 8, b"\0" * 8])
        else:
            source, at = (chance.randrange(len(changed) - 400) for _ in range(2))
            n_bytes = chance.randrange(1, 400)
            changed[at : at + n_bytes] = changed[source : source + n_bytes]
        if changed != content:
            yield bytes(changed)


def check_mutants(path, n, seed):
    content = path.read_bytes()
    refused = 0
    for mutant in mutants(content, n, seed):
        path.write_bytes(mutant)
        with pytest.raises(UwtrackError):
            read_product(path)
        refused += 1
    return refused


def test_damaged_copies_are_refused_without_a_crash(path):
    assert check_mutants(path, 20, 1) > 12


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_two_thousand_damaged_copies_are_refused_without_a_crash(path):
    assert check_mutants(path, 2000, 2) > 1900
