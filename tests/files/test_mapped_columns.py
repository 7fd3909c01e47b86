"""Long columns on disk: the same values, and hardly anything of them in memory."""

import numpy as np
import psutil

from uwtrack_cli.data.decidecades import Decidecades
from uwtrack_cli.files import mapped_columns
from uwtrack_cli.files.mapped_columns import on_disk


def levels(n_rows):
    level_db = np.arange(n_rows * 64.0).reshape(n_rows, 64)
    return Decidecades(
        time_s=np.arange(1.0 * n_rows), centre_hz=np.arange(64.0) + 10, level_db=level_db,
        average_s=1.0, reference="1 uPa", sensor="h1", start_utc_ns=None,
    )  # fmt: skip


def test_values_are_the_same_and_short_columns_stay_in_memory():
    made = levels(2000)
    held = on_disk(made)
    assert held.equals(made)
    assert isinstance(held.level_db.base, np.memmap)
    assert not isinstance(held.centre_hz.base, np.memmap)


def test_what_is_not_looked_at_takes_no_memory():
    process = psutil.Process()
    held = on_disk(levels(200_000))  # 100 MB
    before = process.memory_info().rss
    window = held.level_db[100_000:100_100].copy()
    assert window[0, 0] == 6_400_000.0
    assert process.memory_info().rss - before < 20e6
    assert held.level_db.sum() == (12_800_000 - 1) * 6_400_000.0
    assert process.memory_info().rss - before > 30e6  # the figure sees what is


def test_on_a_full_disk_columns_stay_in_memory(monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mapped_columns.tempfile, "TemporaryFile", full)
    made = levels(2000)
    held = on_disk(made)
    assert held.equals(made)
    assert not isinstance(held.level_db.base, np.memmap)
