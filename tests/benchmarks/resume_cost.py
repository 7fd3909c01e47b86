"""Lay many recordings and their products down, and print what `--resume` costs.

Run as ``python -m tests.benchmarks.resume_cost FOLDER COUNT``. One recording of 16 s of
noise is run with `auto`; it and its product are copied into COUNT folders, where each
is as good as one of its own: a product names its recording without the folder. Bytes
behind the end of the HDF5 file make the checksum of each another. What is printed as JSON
is the cost of ``batch --resume`` over all of them with one job, start included.
"""

import io
import json
import re
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import soundfile

from uwtrack_cli.files.hdf5.checksum import LINE_BYTES, append_checksum


def batch(*words: str | Path) -> dict[str, float]:
    """Run the command, and return what it cost."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.monotonic()
    program = [sys.executable, "-m", "uwtrack_cli", "batch", *map(str, words)]
    done = subprocess.run(program, check=True, capture_output=True, text=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = re.search(r"(\d+) resumed", done.stderr)
    return {
        "resumed": int(said[1]) if said else 0,
        "cpu_s": used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime,
        "wall_s": time.monotonic() - begin,
        "peak_mb": used.ru_maxrss / 1024,
    }


def main(folder: Path, count: int) -> dict[str, float]:
    """Make recordings and products, and look them over."""
    sounds, products = folder / "sounds", folder / "products"
    first = sounds / "00000" / "noise.wav"
    first.parent.mkdir(parents=True)
    noise = np.random.default_rng(1).normal(0.0, 0.05, 16 * 4000)
    soundfile.write(first, noise, 4000, subtype="PCM_16")
    batch(sounds, "-o", products)
    (product,) = products.rglob("*.h5")
    content = product.read_bytes()[:-LINE_BYTES]
    for k in range(1, count):
        shutil.copytree(first.parent, sounds / f"{k:05d}")
        path = products / f"{k:05d}" / product.name
        path.parent.mkdir()
        data = io.BytesIO(content)
        data.seek(0, io.SEEK_END)
        data.write(f"{k:08d}".encode())
        append_checksum(data)
        path.write_bytes(data.getvalue())
    cost = batch(sounds, "-o", products, "--resume", "--jobs", "1")
    return {"products": count, "bytes": len(content), **cost}


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), int(sys.argv[2]))))
