"""Meet damaged inputs one after the other; print what came of it as JSON.

Run as ``python -m tests.stress.fuzz FOLDER FIRST COUNT [KIND]``; each mutant has its
number as its seed, so that a single one can be met again.
"""

import contextlib
import io
import json
import resource
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from tests.stress.mutants import MUTANTS, commands
from uwtrack_cli.cli.app import app

PATIENCE_S = 60
ACCEPTED = {0, 1, 2}
AT_THE_HEADER = (
    "no recording that can be read", "is not an HDF5 file", "damaged or was cut short",
    "was changed or cut short", "does not exist", "is empty", "no valid TOML",
    "not readable as TOML", "is not a TOML file", "is no CSV table", "holds no table",
    "there is no recipe", "has column names, but no rows", "holds no samples",
)  # fmt: skip


class Hang(BaseException):
    """A mutant that takes more processor time than patience allows."""


def _give_up(*_):
    raise Hang


def base_inputs(folder: Path) -> None:
    """Write what the mutants are made from."""
    import soundfile

    time_s = np.arange(20 * 500) / 500.0
    glide = 80.0 - 1.5 * np.tanh((time_s - 10.0) / 3.0)
    sound = 0.05 * np.random.default_rng(1).standard_normal(time_s.size)
    sound += 0.05 * np.sin(2 * np.pi * np.cumsum(glide) / 500.0)
    soundfile.write(folder / "base.wav", sound, 500)
    (folder / "m.sensor.toml").write_text(
        'id = "h1"\nkind = "omni"\nchannels = ["omni"]\nlatitude = 35.0\n'
        "longitude = 128.5\nposition_std_m = 10.0\ndepth_m = 22.0\n"
        "sound_speed_mps = 1500.0\nclock_std_s = 0.5\n"
        "sensitivity_db_re_v_per_upa = -165.0\ngain_db = 20.0\nadc_peak_v = 1.0\n"
    )
    (folder / "m.toml").write_text(
        'description = "x"\n[spectrogram]\nwindow_s = 1.0\n[levels]\n[peaks]\n'
        "false_alarm_probability = 1e-4\n[classify]\n[track]\n[cpa]\n"
        "source_depth_m = 3.0\n"
    )
    (folder / "s.toml").write_text(
        "seed = 1\nduration_s = 2.0\nsample_rate_hz = 500.0\nsound_speed_mps = 1500.0\n"
        '[[sensor]]\nid = "a"\ndepth_m = 20.0\nfull_scale_db = 140.0\n'
        "[[vessel]]\nclosest_approach = { time_s = 1.0, slant_range_m = 200.0, "
        'speed_mps = 6.0, course_deg = 81.0, side = "port" }\n'
        "[[vessel.line]]\nfrequency_hz = 63.0\ncn0_db_hz = 35.0\n"
        "[noise]\ndensity_db = 60.0\n"
    )
    seconds = np.arange(0.0, 100.0)
    ahead = 6.0 * (seconds - 50.0)
    shift = -6.0 / 1500.0 * ahead / np.hypot(ahead, 200.0)
    rows = [f"{t},{300 * (1 + s):.4f},0.05,{90 + t / 2:.2f},1.0"
            for t, s in zip(seconds, shift, strict=True)]  # fmt: skip
    head = "time_s,frequency_hz,frequency_std_hz,bearing_deg,bearing_std_deg"
    (folder / "base.csv").write_text("\n".join([head, *rows]) + "\n")
    words = ["run", str(folder / "base.wav"), "-o", str(folder / "base.h5"), "-q",
             "--sensor", str(folder / "m.sensor.toml")]  # fmt: skip
    done = CliRunner().invoke(app, words)
    if done.exit_code != 0:
        raise SystemExit(done.output)


def meet(number: int, base: Path, folder: Path, kind: str) -> list[dict]:
    """Meet one mutant in an empty folder."""
    rng = np.random.default_rng(number)
    kind = kind or MUTANTS[number % len(MUTANTS)]
    found = []
    for words, _ in commands(kind, folder, base, rng):
        begin = _used_s()
        row = {"number": number, "kind": kind, "words": words, "trouble": ""}
        signal.setitimer(signal.ITIMER_PROF, PATIENCE_S)
        try:
            done = CliRunner().invoke(app, words)
            signal.setitimer(signal.ITIMER_PROF, 0)
            said = done.output
            accepted = ACCEPTED | {4} if words[0] == "diff" else ACCEPTED
            if done.exit_code not in accepted or "Traceback" in said:
                row["trouble"] = f"exit {done.exit_code}: {said[-300:]}"
            elif "the program failed" in said:
                row["trouble"] = said.strip()[-300:]
            row["past_header"] = not any(text in said for text in AT_THE_HEADER)
        except Hang:
            row["trouble"] = "hang"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        row["seconds"] = _used_s() - begin
        allowed = ("m.", "s.", "out.")
        strange = [p.name for p in folder.iterdir() if not p.name.startswith(allowed)]
        if strange:
            row["trouble"] += f" left {strange}"
        found.append(row)
    return found


def _used_s() -> float:
    """Processor time of this process and of those that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _own_peak_mb() -> float:
    """Most memory held; ru_maxrss begins with the size of whoever started this."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def main(base: Path, first: int, count: int, kind: str = "") -> dict:
    """Meet mutants FIRST to FIRST + COUNT, and sum up."""
    import os
    import shutil

    signal.signal(signal.SIGPROF, _give_up)
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    rows = []
    for number in range(first, first + count):
        folder = base / f"mutant{number}"
        folder.mkdir()
        os.chdir(folder)
        with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
            rows += meet(number, base, folder, kind)
        os.chdir(base)
        shutil.rmtree(folder)
    return {
        "met": len(rows),
        "past_header": sum(row.get("past_header", False) for row in rows),
        "trouble": [row for row in rows if row["trouble"]],
        "slowest_s": max(row["seconds"] for row in rows),
        "peak_mb": max(
            _own_peak_mb(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        ),
    }


if __name__ == "__main__":
    place, first_number, how_many, *kinds = sys.argv[1:]
    found = main(Path(place), int(first_number), int(how_many), *kinds)
    sys.stdout.write(json.dumps(found))
