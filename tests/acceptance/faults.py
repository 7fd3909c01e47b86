"""Deliberate faults at the seams of the program: each must make acceptance red.

A fault replaces one piece of text in a copy of the package and of the recipes; some
cases of acceptance are run with it, and what is red is listed. A fault that nothing sees, or
whose text is no longer there, is an error: give it a new place. By hand, some minutes:
``python -m tests.acceptance faults [NAME ...]`` writes tests/baselines/faults.md.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tests.acceptance.parts import SHORT
from tests.acceptance.tables_of_figures import BASELINES

ROOT = Path(__file__).parents[2]
COPIED, LINKED = ("uwtrack_cli", "pipelines"), ("tests", "studies", "sample_data")


HEAD = """# Deliberate faults, and what acceptance says of them

Made by `python -m tests.acceptance faults`: each fault is planted in a copy of the
package, and the cases named in tests/acceptance/faults.py are run with it.

"""


class Fault(NamedTuple):
    """One fault, and the cases that are run with it."""

    name: str
    """What is wrong."""
    path: str
    """Module or recipe, from the root."""
    old: str
    """Text that is there."""
    new: str
    """Text that takes its place."""
    cases: tuple[tuple[str, str], ...]
    """Parts, and what the names of their cases hold."""


ROWS = "uwtrack_cli/motion/passage/encounter_rows.py"
FAULTS = (
    Fault("the threshold of peaks doubled", "uwtrack_cli/spectra/peaks.py",
          "    ratio = power / floor\n", "    ratio = power / (2.0 * floor)\n",
          (("lines", "sensitivity of track"),)),
    Fault("the noise floor 3 dB too low", "uwtrack_cli/estimation/noise_floor.py",
          "= _tile_floors(beams[chunk, kept], zero_padding)",
          "= 0.5 * _tile_floors(beams[chunk, kept], zero_padding)",
          (("lines", "noise: white"),)),
    Fault("the standard deviation of the time halved", ROWS,
          'row.values["time_std_s"] = float(np.sqrt(variance[0]))',
          'row.values["time_std_s"] = 0.5 * float(np.sqrt(variance[0]))',
          (("samples", "mono"),)),
    Fault("the standard deviation of R/v doubled", ROWS,
          'row.values["range_over_speed_std_s"] = float(np.sqrt(variance[1]))',
          'row.values["range_over_speed_std_s"] = 2.0 * float(np.sqrt(variance[1]))',
          (("samples", "mono"),)),
    Fault("sides swapped", ROWS, "row.side = side_of_vessel(turn)",
          "row.side = side_of_vessel(-turn)", (("harder", "overhead 381503"),)),
    Fault("levels left out of cpa", "pipelines/auto.toml",
          '[cpa]\ninput = ["track", "levels",', '[cpa]\ninput = ["track",',
          (("quiet", "quiet 381407"),)),
    Fault("frames of a tenth of a second dropped", "pipelines/auto.toml",
          'input = ["cpa", "long-cpa", "transients", "track", "long-lines", "levels"]',
          'input = ["cpa", "long-cpa", "track", "long-lines", "levels"]',
          (("vehicles", "two cars 381605"),)),
    Fault("the background of radiated levels beside other vessels",
          "uwtrack_cli/motion/radiated.py", "far &= other.distance(time_s) >= FAR",
          "far &= other.distance(time_s) >= 0.0",
          (("two-vessels", "two vessels 381205"), ("two-vessels", "two vessels 381206"))),
    Fault("false lines of two lengths of frames not summed", "uwtrack_cli/lines/multi_resolution.py",
          "=sum(one.false_lines", "=max(one.false_lines",
          (("lines", "two lengths"),)),
    Fault("bearings turned by ten degrees", "uwtrack_cli/spectra/dipoles.py",
          "offset = np.full(frames.n_frames, sensor.compass_offset_deg)",
          "offset = np.full(frames.n_frames, sensor.compass_offset_deg + 10.0)",
          (("harder", "overhead 381503"),)),
    Fault("the compass left out of what tma states",
          "uwtrack_cli/motion/target_motion/error_budget.py",
          "r.side[0] * np.radians(std)", "r.side[0] * np.radians(0.1 * std)",
          (("tables", "tma S1-T1, compass 1 degree"),)),
)  # fmt: skip


def _copy(folder: Path, fault: Fault) -> None:
    """Copy the tree with the fault in it; raise `ValueError` if its text is gone."""
    text = (ROOT / fault.path).read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        msg = f"{fault.path} holds {fault.old!r} {text.count(fault.old)} times, not once."
        raise ValueError(msg)
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in LINKED:
        (folder / name).symlink_to(ROOT / name)
    (folder / fault.path).write_text(text.replace(fault.old, fault.new), encoding="utf-8")


def seen(fault: Fault) -> list[str]:
    """Return what is red with a fault."""
    red: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _copy(folder, fault)
        for part, pattern in fault.cases:
            words = ["-m", "tests.acceptance", "check", part, "--cases", pattern]
            done = subprocess.run(
                [sys.executable, *words, "--processes", "1"], cwd=folder, text=True,
                capture_output=True, check=False,
                env={**os.environ, "PYTHONPATH": str(folder)},
            )  # fmt: skip
            red += [
                line.removeprefix("RED ")
                for line in done.stdout.splitlines() if line.startswith("RED ")
            ]  # fmt: skip
    return red


def is_short(red: Sequence[str]) -> bool:
    """Tell whether a case of the short set is among what is red."""
    return any(
        words.startswith(f"{part}: {name}:")
        for words in red for part, names in SHORT.items() for name in names
    )  # fmt: skip


def plant(names: Sequence[str]) -> int:
    """Plant faults whose name holds one of the words, all without any; write the table."""
    lines = ["| fault | red | by the short set | for example |", "|---|---|---|---|"]
    missed = 0
    for fault in FAULTS:
        if names and not any(name in fault.name for name in names):
            continue
        try:
            red = seen(fault)
        except ValueError as error:  # the place has moved
            sys.stdout.write(f"{fault.name}: {error}\n")
            red = []
        missed += not red
        told = "yes" if is_short(red) else "no"
        example = red[0].replace("|", "/") if red else "**nothing sees it**"
        lines.append(f"| {fault.name} (`{fault.path}`) | {len(red)} | {told} | {example} |")
        sys.stdout.write(lines[-1] + "\n")
        sys.stdout.flush()
        if not names:
            text = HEAD + "\n".join(lines) + "\n"
            (BASELINES / "faults.md").write_text(text, encoding="utf-8")
    return int(missed > 0)
