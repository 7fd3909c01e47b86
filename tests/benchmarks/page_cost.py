"""What pages cost: CPU time and peak memory of one process each.

Run with ``python -m tests.benchmarks.page_cost FILE ...``: a product has the page of its
recording, that of its first passage and its report; a folder has its report, and a
recording its spectrogram. The first row is what alone the import of the libraries costs.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

IMPORT = ["-c", "import matplotlib.figure, scipy.fft, jinja2"]


def cost(words):
    """Return exit code, CPU time in seconds and peak memory in MB of a process."""
    child = subprocess.Popen([sys.executable, *words], stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return child.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def pages(path):
    """Return the commands of the pages that a file or folder may have, by name."""
    if path.is_dir():
        return {"folder": ["report", path, "-o", "folder.html"]}
    if path.suffix != ".h5":
        return {"spectrogram": ["plot", path, "-o", "sound.png"]}
    return {
        "recording": ["plot", path, "-o", "recording.png"],
        "passage": ["plot", path, "--passage", "1", "-o", "passage.png"],
        "report": ["report", path, "-o", "report.html"],
    }


def main(paths):
    print(f"{'import':<12} {cost(IMPORT)[1]:5.1f} s", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for path in map(Path, paths):
            for name, (verb, source, *more, made) in pages(path.resolve()).items():
                words = [verb, str(source), *more, f"{folder}/{made}", "--overwrite"]
                code, cpu_s, peak_mb = cost(["-m", "uwtrack_cli", *words])
                if code == 0:  # else it holds no passage
                    row = f"{name:<12} {cpu_s:5.1f} s {peak_mb:5.0f} MB  {path.name}"
                    print(row, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
