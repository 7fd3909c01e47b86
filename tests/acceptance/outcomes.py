"""What came of a case, in the words of the frozen files.

An outcome is a dictionary with some of these keys:

* ``hours``: length of the sound.
* ``vessels``: one entry for each true vessel: ``due``, ``found``, ``status``, ``side``
  ('right', 'wrong' or 'none') and ``quantities``: for each that is given its ``error``,
  ``std`` and, where there is one, its Cramer-Rao ``bound``.
* ``false``: rows that are false, each with ``why``, ``status`` and ``time_s``.
* ``values``: what is given besides, without a truth: ``value`` and ``std`` by name.
* ``rows``: rows of a real recording: their values and standard deviations.
* ``codes``: what else was detected, as codes: kind and reading of each stretch.
* ``scores``: figures with the side that is better: ``value``, ``better`` ('more',
  'less', 'same'), ``slack``.
* ``counts``: [hits, of] by name, for the rates.
* ``cost``: CPU time over that of the reference, peak memory in MB. Never compared.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from tests.draws.recordings import QUANTITIES, Drawn, Passage
from uwtrack_cli.cli.app import app
from uwtrack_cli.flow.results import read_results

Outcome = dict[str, Any]

STATUSES = ("", "level-only", "no-speed", "extrapolated", "ok")
"""Statuses of a row, from worst to best; empty for a vessel that is not found."""

LOWEST_LEVEL_HZ = 100.0
"""Bands below are not held: the sea is loudest there."""

BEYOND = 5.0
"""A quantity so many standard deviations off makes its row false."""


def command(*words: object) -> str:
    """Run a command of the program in this process; return its standard output."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exit_code:
        told = done.stderr.strip() or repr(done.exception)
        msg = f"uwtrack {words[0]} ended with {done.exit_code}: {told[-500:]}"
        raise RuntimeError(msg)
    return done.stdout


def run(path: Path, words: Sequence[object] = ()) -> tuple[list[dict[str, Any]], list[str]]:
    """Run the whole chain over a recording; return its rows and codes."""
    product = path.with_suffix(".run.h5")
    made = ("-o", product, "--overwrite", "--json", "--quiet")
    rows = json.loads(command("run", path, *made, *words))
    stretches = json.loads(command("show", product, "presence", "--format", "json"))
    codes = {
        f"{one['kind']} {one.get('motion_model') or ''}".strip()
        for one in stretches
        if not one["encounter"]
    }
    return rows, sorted(codes)


def run_drawn(drawn: Drawn, folder: Path, words: Sequence[object] = ()) -> Outcome:
    """Run the whole chain over a drawn recording, and hold it against its truth."""
    path = folder / "drawn.wav"
    drawn.write(path)
    rows, _ = run(path, (*drawn.words, *words))
    return {
        "hours": drawn.hours, **score(rows, drawn.passages),
        "values": radiated(path.with_suffix(".run.h5")) if rows else {},
    }  # fmt: skip


def radiated(product: Path) -> dict[str, dict[str, float]]:
    """Return the radiated noise levels of a run, in bands from 100 Hz on, if it has any."""
    if "radiated" not in read_results(product):  # recipes of arrays measure none
        return {}
    told = json.loads(command("show", product, "radiated", "--format", "json"))
    return {
        f"level of {one['contact']} at {one['centre_hz']:.0f} Hz": {
            "value": one["radiated_noise_level_db"],
            "std": one["radiated_noise_level_std_db"],
        }
        for one in told["level"]
        if one["centre_hz"] > LOWEST_LEVEL_HZ and one["radiated_noise_level_db"] is not None
    }


def deviations(row: dict[str, Any], one: Passage) -> dict[str, dict[str, float]]:
    """Return error, standard deviation and bound of each quantity that a row gives."""
    found = {}
    for name in QUANTITIES:
        stem, unit = name.rsplit("_", 1)
        std, truth = row.get(f"{stem}_std_{unit}"), one.truth[name]
        if row.get(name) is None or std is None or not np.isfinite(truth):
            continue
        error = float(row[name]) - truth
        if unit == "deg":
            error = (error + 180.0) % 360.0 - 180.0
        found[name] = {"error": error, "std": float(std)}
        if name in one.bound:
            found[name]["bound"] = one.bound[name]
    return found


def score(rows: Sequence[dict[str, Any]], passages: Sequence[Passage]) -> Outcome:
    """Hold rows against the vessels that truly pass.

    A row is of a vessel where its time lies within three of its standard deviations or
    half of R/v; of several the better status wins, then the nearer one. Others are
    false: nothing passes there, or a vessel is found twice. So is one of which a
    quantity is beyond five standard deviations.
    """
    near = sorted(
        (-STATUSES.index(row["status"]), abs(row["time_s"] - one.time_s), place, number)
        for place, row in enumerate(rows)
        for number, one in enumerate(passages)
        if abs(row["time_s"] - one.time_s)
        < max(3.0 * row["time_std_s"], 0.5 * one.truth["range_over_speed_s"])
    )
    row_of: dict[int, int] = {}
    for _, _, place, number in near:
        if number not in row_of and place not in row_of.values():
            row_of[number] = place
    vessels, false = [], []
    for number, one in enumerate(passages):
        row = rows[row_of[number]] if number in row_of else {}
        side = row.get("side") or ""
        quantities = deviations(row, one)
        vessels.append({
            "due": one.is_due, "found": bool(row), "status": row.get("status", ""),
            "side": "none" if not side or not one.side
            else "right" if side == one.side else "wrong",
            "quantities": quantities,
        })  # fmt: skip
        far = [n for n, q in quantities.items() if abs(q["error"]) > BEYOND * q["std"]]
        if far:
            false.append(_false(row, f"beyond {BEYOND:g}: {', '.join(far)}"))
    twice = {place for _, _, place, _ in near} - set(row_of.values())
    for place, row in enumerate(rows):
        if place not in row_of.values():
            false.append(_false(row, "twice" if place in twice else "nothing passes"))
    numbers = [row["contact"] for row in rows]
    false += [_false(r, "number") for k, r in enumerate(rows) if r["contact"] in numbers[:k]]
    return {"vessels": vessels, "false": false}


def _false(row: dict[str, Any], why: str) -> dict[str, Any]:
    return {
        "why": why, "status": row["status"], "time_s": row["time_s"],
        "probability": row["probability"],
    }  # fmt: skip


def scored(value: float, better: str, slack: float) -> dict[str, Any]:
    """Return a figure of which more or less is better, and by what it may be worse."""
    return {"value": float(value), "better": better, "slack": slack}
