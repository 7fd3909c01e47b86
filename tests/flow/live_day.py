"""Hold the events of live sound to the rows of the same sound run at once.

Run as ``python -m tests.flow.live_day HOURS PASSAGES RATE_HZ``: draws the sound, sends
it through a pipe with ``--json``, runs the file, and prints what both cost and how far
they are apart, as JSON.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import soundfile

from tests.benchmarks.long_run import scenario
from uwtrack_cli.simulate import simulate_recordings

PROGRAM = [sys.executable, "-m", "uwtrack_cli"]
PASSED = ("ok", "level-only", "extrapolated")
QUANTITIES = (
    ("time_s", "time_std_s"),
    ("speed_mps", "speed_std_mps"),
    ("range_over_speed_s", "range_over_speed_std_s"),
)


def compare(events, encounters, presence, end_s):
    """Return how the last word on every passage and segment agrees with the file's.

    Parameters
    ----------
    events
        Every event, in the order in which it was told.
    encounters, presence
        Rows of the file, as `show --format json` gives them.
    end_s
        Length of the sound, s: what was told before is counted for itself.

    Returns
    -------
    dict
        Counts, the greatest difference in deviations of the file's, and how long after
        the closest approach passages were told and final, s, beyond 2 and 4 d/v.
    """
    told = _by_number(events, "encounter", "contact")
    last = {k: rows[-1] for k, rows in told.items() if rows[-1]["status"] in PASSED}
    pairs = _nearest(last, encounters)
    worst = max(
        (abs(last[k][q] - row[q]) / row[std] for k, row in pairs.items()
         for q, std in QUANTITIES if row[q] is not None and row[std]),
        default=0.0,
    )  # fmt: skip
    first_late, final_late, n_after = [], [], 0
    for number, row in pairs.items():
        rows, width_s = told[number], row["range_over_speed_s"]
        finals = [one["decided_s"] for one in rows if one["final"]]
        if rows[0]["decided_s"] < end_s:
            first_late.append(rows[0]["decided_s"] - row["time_s"] - 2 * width_s)
        if finals[0] < end_s:
            final_late.append(finals[0] - row["time_s"] - 4 * width_s)
            n_after += len(finals) > 1
    heard = {k: rows[-1] for k, rows in _by_number(events, "presence", "segment").items()}
    keys = ("kind", "from_s", "to_s", "n_lines", "spacing_hz")
    own = sorted(repr([row[key] for key in keys]) for row in heard.values())
    theirs = sorted(repr([row[key] for key in keys]) for row in presence)
    return {
        "n_encounters": len(encounters),
        "n_told": len(last),
        "n_paired": len(pairs),
        "n_withdrawn": len(told) - len(last),
        "n_changed_after_final": n_after,
        "greatest_difference_in_deviations": worst,
        "told_after_2_widths_s": max(first_late, default=None),
        "final_after_4_widths_s": max(final_late, default=None),
        "n_presence": len(theirs),
        "n_presence_told_the_same": len(theirs) - len(_without(theirs, own)),
        "n_presence_withdrawn_or_parts": len(_without(own, theirs)),
    }


def _by_number(events, kind, key):
    found = {}
    for event in events:
        if event["event"] == kind:
            found.setdefault(event[key], []).append(event)
    return found


def _nearest(last, rows):
    """Pair what was told with rows of the file, one to one, by time."""
    near = sorted(
        (abs(one["time_s"] - row["time_s"]), number, n)
        for number, one in last.items()
        for n, row in enumerate(rows)
    )
    found, taken = {}, set()
    for apart_s, number, n in near:
        if apart_s < 30.0 and number not in found and n not in taken:
            found[number] = rows[n]
            taken.add(n)
    return found


def _without(some, others):
    """Return what is left of a list when that of another is taken out."""
    left = list(some)
    for one in others:
        if one in left:
            left.remove(one)
    return left


def draw(path, hours, n_passages, rate_hz):
    """Write drawn sound of one channel as a WAV file, block by block."""
    (recording,) = simulate_recordings(scenario(hours, n_passages, rate_hz))
    with soundfile.SoundFile(path, "w", int(rate_hz), 1, "PCM_16") as file:
        for block in recording.reader(1 << 16):
            file.write(np.clip(0.5 * block[:, 0], -1.0, 1.0))


def measure(folder, hours, n_passages, rate_hz):
    """Draw, run both ways, and compare; the processor time is that of the children."""
    sound, live, whole = (folder / name for name in ("d.wav", "live.h5", "file.h5"))
    draw(sound, hours, n_passages, rate_hz)
    costs = [_children_s()]
    with sound.open("rb") as content:
        done = subprocess.run(
            [*PROGRAM, "run", "-", "--json", "-q", "-o", live], stdin=content,
            stdout=subprocess.PIPE, check=True,
        )  # fmt: skip
    costs.append(_children_s())
    subprocess.run([*PROGRAM, "run", sound, "-q", "-o", whole], check=True)
    costs.append(_children_s())
    events = [json.loads(line) for line in done.stdout.splitlines()]
    compared = compare(events, *tables(whole), 3600.0 * hours)
    words = [*PROGRAM, "diff", live, whole]
    same = subprocess.run(words, check=False, capture_output=True).returncode == 0
    live_s, file_s = np.diff(costs)
    return {
        "live_cpu_s": live_s, "file_cpu_s": file_s,
        "times_real_time": 3600.0 * hours / live_s, "files_equal": same, **compared,
    }  # fmt: skip


def tables(product):
    """Return the encounters and the presence of a product."""
    return [
        json.loads(
            subprocess.run(
                [*PROGRAM, "show", product, name, "--format", "json"],
                check=True, capture_output=True,
            ).stdout
        )
        for name in ("encounters", "presence")
    ]  # fmt: skip


def _children_s():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        asked = float(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
        sys.stdout.write(json.dumps(measure(Path(name), *asked), indent=1) + "\n")
