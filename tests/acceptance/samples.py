"""Part of the shipped samples: recordings by every recipe that takes them, and tables."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.acceptance.outcomes import Outcome, command, radiated, run, score, scored
from tests.draws.recordings import Passage
from uwtrack_cli.flow.shipped_recipes import shipped_folder

Case = Callable[[Path], Outcome]

RECORDINGS = ("pass", "mono", "propeller", "noise", "small-array")
"""Recordings that are run by the default recipe."""

CHI_SQUARE_95 = 5.99
"""Of two degrees of freedom."""

RECIPES = ("vessel", "weak-lines", "multi-resolution", "small-craft")
"""Recipes beside the default one that are run over the passage."""


def _copy(name: str, folder: Path) -> Path:
    for path in shipped_folder("sample_data").glob(f"{name}*"):
        shutil.copy(path, folder)
    return folder / f"{name}.wav"


def _passages(path: Path) -> list[Passage]:
    told = json.loads(path.with_suffix(".truth.json").read_text(encoding="utf-8"))
    return [
        Passage(one["time_s"], one["speed_mps"], one["slant_range_m"],
                one["course_deg"], one["side"])
        for one in told["encounters"]
    ]  # fmt: skip


def recording(name: str, recipe: str, folder: Path) -> Outcome:
    """Run a sample, and hold its rows against its truth."""
    path = _copy(name, folder)
    words = ("--recipe", recipe) if recipe else ()
    rows, codes = run(path, words)
    passages = _passages(path)
    if path.stem == "mono":  # a single hydrophone cannot tell course or side
        passages = [Passage(p.time_s, p.speed_mps, p.slant_range_m) for p in passages]
    values = radiated(path.with_suffix(".run.h5")) if rows and not recipe else {}
    return {**score(rows, passages), "codes": codes, "values": values}


def two_sensors(folder: Path) -> Outcome:
    """Run both sensors, and hold the fused place against the truth."""
    _copy("two-sensors", folder)
    sounds = [folder / f"two-sensors-h{k}.wav" for k in (1, 2)]
    command("run", *sounds, "-q", "--set", "locate.every_s=20.0")
    truth = json.loads((folder / "two-sensors.truth.json").read_text(encoding="utf-8"))
    track = truth["vessels"][0]["track"]
    fixes = json.loads(
        command("show", folder / "two-sensors-h1.fixes.h5", "fixes", "--format", "json")
    )
    far = []
    for one in fixes:
        east, north = (
            np.interp(one["time_s"], track["time_s"], track[axis]) for axis in ("east_m", "north_m")
        )
        far.append(np.hypot(one["east_m"] - east, one["north_m"] - north))
    return {"scores": {"fixes": scored(len(far), "more", 0),
                       "median error, m": scored(np.median(far), "less", 1.0)}}  # fmt: skip


def towed_array(folder: Path) -> Outcome:
    """Run the towed array, and hold the motion against the vessel's."""
    path = _copy("towed-array", folder)
    product = folder / "towed.h5"
    command("run", path, "-o", product, "-q")
    told = json.loads(command("show", product, "motions", "--format", "json"))
    truth = json.loads(path.with_suffix(".truth.json").read_text(encoding="utf-8"))
    track = truth["vessels"][0]["track"]
    speed = float(np.hypot(track["velocity_east_mps"][0], track["velocity_north_mps"][0]))
    return {"vessels": [_motion(told, {"speed_mps": speed})],
            "counts": {"contacts beyond one": [len({m["contact"] for m in told}) - 1, 1]}}  # fmt: skip


def _motion(told: list[dict[str, Any]], truth: dict[str, float]) -> dict[str, Any]:
    best = told[0] if told else {}
    quantities = {}
    for name, value in truth.items():
        if best.get(name) is None:
            continue
        stem, unit = name.rsplit("_", 1)
        error = best[name] - value
        if unit == "deg":
            error = (error + 180.0) % 360.0 - 180.0
        quantities[name] = {"error": error, "std": best[f"{stem}_std_{unit}"]}
    return {
        "due": True, "found": bool(best), "side": "none", "quantities": quantities,
        "status": "ok" if best.get("observable") else "",
    }  # fmt: skip


def bearings(folder: Path) -> Outcome:
    """Run `tma` on the table of bearings."""
    data = shipped_folder("sample_data")
    told = json.loads(
        command("tma", data / "bearings.csv", "--own-ship", data / "own-ship.csv",
                "--sound-speed-mps", 1480, "-o", folder / "t.h5", "--json", "-q")
    )  # fmt: skip
    truth = json.loads((data / "bearings.truth.json").read_text(encoding="utf-8"))
    names = ("range_m", "bearing_deg", "speed_mps", "course_deg")
    return {"vessels": [_motion(told, {name: truth[name] for name in names})]}


def contacts(folder: Path) -> Outcome:
    """Run `discriminate` on the table of contacts."""
    data = shipped_folder("sample_data")
    told = json.loads(
        command("discriminate", data / "contacts.csv", "--own-ship",
                data / "observer.csv", "-o", folder / "d.h5", "--json", "-q")
    )  # fmt: skip
    truth = json.loads((data / "contacts.truth.json").read_text(encoding="utf-8"))
    right = told["moving_contact"] == truth["moving_contact"]
    return {"counts": {"pairs right": [int(right), 1]}}


def scans(folder: Path) -> Outcome:
    """Run `pdaf` on the table of scans, as the README does."""
    data, product = shipped_folder("sample_data"), folder / "scans.target.h5"
    command("pdaf", data / "scans.csv", "--detector-cell-volume", 900,
            "--detector-snr-db", 15, "--motion-acceleration-std", 3.16,
            "--start-velocity-std", 100, "-o", product, "-q")  # fmt: skip
    told = json.loads(command("show", product, "target", "--format", "json"))
    truth = json.loads((data / "scans.truth.json").read_text(encoding="utf-8"))
    off, squares = [], []
    for one in told["scan"]:
        true = [np.interp(one["time_s"], truth["time_s"], truth[k]) for k in ("z_1_m", "z_2_m")]
        error = np.array(one["state"])[[0, 2]] - true
        covariance = np.array(one["state_covariance"])[np.ix_([0, 2], [0, 2])]
        off.append(np.hypot(*error))
        squares.append(error @ np.linalg.solve(covariance, error))
    held = int((np.array(squares) < CHI_SQUARE_95).sum())
    return {"scores": {"scans": scored(len(off), "more", 0),
                       "median error, m": scored(np.median(off), "less", 0.5)},
            "counts": {"ellipses of pdaf": [held, len(off)]}}  # fmt: skip


def cases() -> dict[str, Case]:
    """Return all cases of samples."""
    made: dict[str, Case] = {name: partial(recording, name, "") for name in RECORDINGS}
    for recipe in RECIPES:
        made[f"pass by {recipe}"] = partial(recording, "pass", recipe)
    made["two-sensors"] = two_sensors
    made["towed-array"] = towed_array
    made["bearings"] = bearings
    made["contacts"] = contacts
    made["scans"] = scans
    return made
