"""Part of arrays: a towed array and a small one, and directions of single frames."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.acceptance.outcomes import BEYOND, Outcome
from tests.draws.array_scenes import (
    RATE_HZ,
    TETRAHEDRON,
    TURN,
    frames_from_anywhere,
    scene,
    sensor_of,
    truth_at,
)
from tests.support import recording_of
from uwtrack_cli.arrays.beamform import form_beams
from uwtrack_cli.data.bearing_time import BearingTime
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate.recordings import simulate_recordings

Case = Callable[[Path], Outcome]

NOISE = {"band_hz": [40.0, 240.0], "source_level_db": 152.0}
TOWED: dict[str, dict[str, Any]] = {
    "lines, turn": {"turn": [TURN]},
    "lines, no turn": {},
    "lines, other side": {
        "turn": [{"at_s": 110.0, "course_deg": 80.0, "rate_deg_per_s": 2.0}],
        "place": (-1100.0, 300.0),
    },
    "broadband, turn": {"turn": [TURN], "broadband": NOISE},
}


def towed(name: str, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Hold the modes of `tma` behind a towed array against the vessel's motion."""
    drawn = scene(seed=seed, **TOWED[name])
    (recording,) = simulate_recordings(drawn)
    made = run_recipe(recording, load_recipe("towed-array"))
    found = next(item for item in made if isinstance(item, Motions))
    modes = []
    for k in range(found.mode.size):
        quantities = {}
        for quantity, truth in truth_at(drawn, found.time_s[k]).items():
            stem, unit = quantity.rsplit("_", 1)
            error = float(getattr(found, quantity)[k] - truth)
            if unit == "deg":
                error = (error + 180.0) % 360.0 - 180.0
            std = float(getattr(found, f"{stem}_std_{unit}")[k])
            if np.isfinite(error) and np.isfinite(std):
                quantities[quantity] = {"error": error, "std": std}
        far = max((abs(one["error"]) / one["std"] for one in quantities.values()), default=np.inf)
        modes.append((far, k, quantities))
    far, best, quantities = min(modes, default=(np.inf, -1, {}))
    # without a turn both sides stay, and one of two modes is the mirror
    wrong = [m for m in modes if m[1] != best and found.weight[m[1]] > found.weight[best] + 0.1]
    contacts = int(np.unique(found.contact).size)
    return {
        "vessels": [{
            "due": True, "found": far < BEYOND, "status": "ok" if far < BEYOND else "",
            "side": "wrong" if wrong else "right", "quantities": quantities,
        }],
        "false": [{"why": "contact", "status": "ok", "time_s": 0.0}] * max(contacts - 1, 0),
    }  # fmt: skip


def directions(rho_db: float, seed: int, folder: Path) -> Outcome:  # noqa: ARG001
    """Hold the directions of frames of a small array, each from anywhere."""
    samples, azimuth_deg, elevation_deg = frames_from_anywhere(rho_db, seed)
    beams = form_beams(
        recording_of(samples, RATE_HZ, sensor_of(TETRAHEDRON)), overlap=0.0,
        zero_padding=1, band_hz=(60.0, 700.0), false_alarm_probability=1e-3,
    )  # fmt: skip
    joined = BearingTime.join(list(beams)).directions
    assert joined is not None
    found = joined.strongest()
    frame = np.rint(found.time_s - 0.5).astype(int)
    off = (found.bearing_deg - azimuth_deg[frame] + 180.0) % 360.0 - 180.0
    rise = found.elevation_deg - elevation_deg[frame]
    every = np.concatenate([off / found.bearing_std_deg, rise / found.elevation_std_deg])
    return {"counts": {
        f"directions at {rho_db:g} dB": [int(frame.size), azimuth_deg.size],
        "directions within 1.96": [int((np.abs(every) <= 1.96).sum()), every.size],
        "directions within 0.6745": [int((np.abs(every) <= 0.6745).sum()), every.size],
    }}  # fmt: skip


def cases(seed: int) -> dict[str, Case]:
    """Return all cases of arrays."""
    made: dict[str, Case] = {f"towed: {name}": partial(towed, name, seed) for name in TOWED}
    for rho_db in (0.0, 10.0):
        made[f"directions at {rho_db:g} dB"] = partial(directions, rho_db, seed)
    return made
