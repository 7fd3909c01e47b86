"""Part of tables: `cpa`, `tma`, `locate`, `pdaf` and `discriminate` on drawn measurements."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.acceptance.outcomes import BEYOND, Outcome
from tests.draws.contact_pairs import contact_pair
from tests.draws.crossing_targets import end_of
from tests.draws.measured_passages import QUANTITIES as PASSAGE_QUANTITIES
from tests.draws.measured_passages import READ_AS, STILL, score
from tests.draws.motion_records import CASES, NAMES
from tests.draws.motion_records import score as score_motion
from tests.draws.sensor_tables import buoys
from uwtrack_cli.discrimination.discriminate import discriminate_contacts
from uwtrack_cli.motion.locate import locate_vessels

Case = Callable[[Path], Outcome]

PASSAGES = {
    "straight": 48, "jitter": 16, "frequency-step": 12, "frequency-ramp": 12, "turn": 12,
    "speed-change": 12, "bend": 8, "two-targets": 8, "machinery": 16, "constant": 8,
    "joined": 8,
}  # fmt: skip
"""Draws of each kind."""

MOTIONS = {"exact": 12, "sound speed 1 %": 12, "compass 1 degree": 12, "navigation 5 m": 12,
           "AR(1) 0.9": 12, "all": 12}  # fmt: skip
"""Records of each scenario, by what is drawn."""

BATCH = 8
FIXES = 24
PAIRS = 60
CROSSINGS = 60


def _entry(error: Any, std: Any, bound: Any) -> dict[str, float]:
    one = {"error": float(error), "std": float(std)}
    if np.isfinite(bound):
        one["bound"] = float(bound)
    return one


def passages(kind: str, seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Hold `cpa` of drawn tables against what passes, or does not."""
    vessels, false, right = [], [], 0
    for number in range(seed, seed + count):
        for one in score(kind, number):
            right += one.reading == READ_AS.get(kind, kind)
            if kind in STILL:
                if np.isfinite(one.error[0]):
                    false.append({"why": "nothing passes", "status": one.reading,
                                  "time_s": float(one.error[0])})  # fmt: skip
                continue
            quantities = {
                name: _entry(*values)
                for name, *values in zip(
                    PASSAGE_QUANTITIES, one.error, one.std, one.bound, strict=True
                )
                if np.isfinite(values[0]) and np.isfinite(values[1])
            }
            bound = one.bound[2] / one.slant_m
            vessels.append({
                "due": not bound > 0.05, "found": bool(quantities),
                "status": "ok" if quantities else "",
                "side": "wrong" if one.is_wrong else "none", "quantities": quantities,
            })  # fmt: skip
            far = [n for n, q in quantities.items() if abs(q["error"]) > BEYOND * q["std"]]
            if far:
                false.append({"why": f"beyond {BEYOND:g}: {', '.join(far)}",
                              "status": one.reading, "time_s": float(number)})  # fmt: skip
    return {"vessels": vessels, "false": false,
            "counts": {f"read {kind}": [right, max(len(vessels), count)]}}  # fmt: skip


def motions(name: str, kind: str, seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Hold `tma` of the published scenarios against their truth."""
    vessels, held = [], Counter()
    for number in range(seed, seed + count):
        one = score_motion(name, kind, number)
        held.update(np.flatnonzero(one.holds).tolist())
        quantities = {
            quantity: {"error": float(error), "std": float(std)}
            for quantity, error, std in zip(NAMES, one.error, one.std, strict=True)
            if np.isfinite(error) and np.isfinite(std)
        }
        vessels.append({
            "due": True, "found": bool(quantities), "side": "none",
            "status": "ok" if quantities else "", "quantities": quantities,
        })  # fmt: skip
    names = ("range", "speed", "course")
    return {"vessels": vessels,
            "counts": {f"interval of {n}": [held[k], count] for k, n in enumerate(names)}}  # fmt: skip


def fixes(seed: int, count: int, moving: bool, folder: Path) -> Outcome:  # noqa: ARG001
    """Hold `locate` of drifting buoys with offsets and outliers against the boat."""
    vessels, held = [], 0
    for number in range(seed, seed + count):
        series, place, velocity, _ = buoys(number, rows=36, moving=moving)
        found = locate_vessels(series=series, at=["600"])
        quantities = {}
        if found.time_s.size:
            off = np.array([found.east_m[0], found.north_m[0]]) - place - 600.0 * velocity
            covariance = found.covariance_m2[0]
            held += bool(off @ np.linalg.solve(covariance, off) < 5.99)
            quantities = {
                axis: {"error": float(off[k]), "std": float(np.sqrt(covariance[k, k]))}
                for k, axis in enumerate(("east_m", "north_m"))
            }
        vessels.append({
            "due": True, "found": bool(quantities), "side": "none",
            "status": "ok" if quantities else "", "quantities": quantities,
        })  # fmt: skip
    return {"vessels": vessels, "counts": {"ellipses": [held, count]}}


def pairs(seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the verdicts of `discriminate` on a source and its repeater."""
    said = Counter(
        discriminate_contacts(*contact_pair(seed=number), miss=0.005, false_alarm=0.005).verdict[0]
        for number in range(seed, seed + count)
    )
    return {"counts": {"pairs right": [said["first moves"], count],
                       "pairs wrong": [said["second moves"], count]}}  # fmt: skip


def crossings(angle_deg: float, seed: int, count: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Count the targets that `pdaf` follows past another one among false measurements."""
    ends = Counter(end_of(number, angle_deg) for number in range(seed, seed + count))
    return {"counts": {f"{name} at {angle_deg:g} degrees": [ends[name], count]
                       for name in ("own", "lost")}}  # fmt: skip


def cases(seed: int) -> dict[str, Case]:
    """Return all cases of tables."""
    made: dict[str, Case] = {}
    for kind, count in PASSAGES.items():
        for first in range(0, count, BATCH):
            size = min(BATCH, count - first)
            made[f"cpa {kind} {seed + first}"] = partial(passages, kind, seed + first, size)
    for kind, count in MOTIONS.items():
        for name in CASES:
            made[f"tma {name}, {kind}"] = partial(motions, name, kind, seed, count)
    for moving in (True, False):
        name = "locate a boat" if moving else "locate what is at rest"
        made[name] = partial(fixes, seed, FIXES, moving)
    made["discriminate"] = partial(pairs, seed, PAIRS)
    for angle in (20.0, 90.0):
        made[f"pdaf crossing at {angle:g}"] = partial(crossings, angle, seed, CROSSINGS)
    return made
