"""Make many products of one, each of an hour of its own, and print what a table costs.

Run as ``python -m tests.benchmarks.many_results PRODUCT FOLDER COUNT``. The copies
hold the tables of the product, not its picture, lines and levels. Each has the start,
the digest of its sound and the times of its passages changed, and a checksum that fits:
to `passages` they are results of COUNT recordings. What is printed as JSON
is processor time and peak memory of `passages FOLDER` when it knows none of them, all
of them, and all but ten.
"""

import io
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import h5py

from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum
from uwtrack_cli.files.hdf5.product import read_product, write_product

TABLES = (Recording, Sensor, Encounters, Fixes)
APART_NS = 3600 * 10**9


def write_copy(content: bytes, k: int, path: Path) -> None:
    """Write a product as that of another recording, k hours later."""
    data = io.BytesIO(content[:-LINE_BYTES])
    with h5py.File(data, "r+") as file:
        recordings = []

        def change(name: str, item: h5py.Group | h5py.Dataset) -> None:
            if "start_utc_ns" in item.attrs:
                item.attrs["start_utc_ns"] += k * APART_NS
            if name.endswith("/recording"):
                recordings.append(item)
            if isinstance(item, h5py.Dataset) and name.endswith("utc_ns"):
                item[...] += k * APART_NS

        file.visititems(change)
        for item in recordings:
            item.attrs["digest"] = f"{k:064x}"
    append_checksum(data)
    path.write_bytes(data.getvalue())


def passages(folder: Path, cache: Path) -> dict[str, float]:
    """Run the command, and return what it cost."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.monotonic()
    program = "from uwtrack_cli.cli import main; main()"
    words = [sys.executable, "-c", program, "passages", str(folder)]
    done = subprocess.run(
        [*words, "--per", "month", "--to", "json"], capture_output=True, check=True,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)}, text=True,
    )  # fmt: skip
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "passages": sum(row["passages"] for row in json.loads(done.stdout)),
        "cpu_s": used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime,
        "wall_s": time.monotonic() - begin,
        "peak_mb": used.ru_maxrss / 1024,
    }


def main(product: Path, folder: Path, count: int) -> dict[str, dict[str, float]]:
    """Make the copies, and run `passages` over them three times."""
    results = folder / "results"
    results.mkdir(parents=True)
    with read_product(product) as whole:
        found = [c for kind in TABLES for c in whole.read_all(kind)]
    write_product(folder / "tables.h5", found)
    content = (folder / "tables.h5").read_bytes()
    for k in range(count):
        write_copy(content, k, results / f"r{k:05d}.run.h5")
    costs = {name: passages(results, folder / "cache") for name in ("new", "known")}
    for k in range(count, count + 10):
        write_copy(content, k, results / f"r{k:05d}.run.h5")
    return {**costs, "ten_new": passages(results, folder / "cache")}


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))))
